//! Paint: a sketch, a footprint or stand heights that a user gives, read before anything is written, then brought onto
//! coarse cells.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::{Error, onto_scene};
use crate::canopy::learned::coarse::CoarseCells;
use crate::canopy::learned::sketch::{self, Density, Sketch};
use crate::canopy::learned::stand_height;
use crate::io::{self, Limits, ParseError, raster_file};
use crate::progress::Reporter;
use crate::raster::{Frame, Grid, Mask, SourceRaster};

const PNG_MAGIC: &[u8] = b"\x89PNG\r\n\x1a\n";
const JPEG_MAGIC: &[u8] = b"\xff\xd8\xff";
/// Wrong colours or codes that an error lists.
const MOST_LISTED: usize = 6;
/// Different wrong colours or codes that are counted; a photograph has millions.
const MOST_COUNTED: usize = 1000;
/// Pictures larger than this are no sketch, pixels a side.
const MOST_PIXELS: u32 = 32_768;

/// A painted file: a picture, stretched over the scene, or a raster, which knows its place.
pub struct Paint {
    path: PathBuf,
    content: Content,
}

enum Content {
    Picture(Picture),
    Raster(SourceRaster),
}

/// A raster of stand heights in m, as its file holds it.
pub struct StandRaster {
    path: PathBuf,
    raster: SourceRaster,
}

struct Picture {
    rows: usize,
    cols: usize,
    densities: Vec<Density>,
}

impl Paint {
    /// Reads a PNG picture in the palette's colours, or a raster of 0, 1, 2.
    ///
    /// # Errors
    /// If it cannot be read, or holds other colours or codes, which are listed.
    pub fn read(path: &Path) -> Result<Self, Error> {
        let read_error = |source| io::Error::Read { path: path.to_owned(), source };
        let mut start = [0; PNG_MAGIC.len()];
        let mut file = std::fs::File::open(path).map_err(read_error)?;
        let is_png = std::io::Read::read_exact(&mut file, &mut start).is_ok() && start == PNG_MAGIC;
        if is_png {
            let bytes = std::fs::read(path).map_err(read_error)?;
            let content = Content::Picture(picture(path, &bytes)?);
            return Ok(Self { path: path.to_owned(), content });
        }
        if start.starts_with(JPEG_MAGIC) {
            let what = format!(
                "{}: a JPEG picture, which blurs paint at its edges; save it as PNG",
                path.display()
            );
            return Err(Error::Usage { what });
        }
        let raster = raster_file::read(path, None, &Limits::default())?;
        let mut wrong = BTreeMap::new();
        for (code, _) in raster.values.iter().zip(&raster.valid).filter(|(_, valid)| **valid) {
            if Density::from_code(*code).is_none() && wrong.len() < MOST_COUNTED {
                *wrong.entry(code.to_string()).or_insert(0_usize) += 1;
            }
        }
        let known = "0 (empty), 1 (sparse), 2 (dense) in one band (colours belong in a PNG)";
        refuse(path, "codes", &wrong, known)?;
        Ok(Self { path: path.to_owned(), content: Content::Raster(raster) })
    }

    /// The paint on coarse cells: of a picture the pixel, of a raster the cell, that a coarse cell's centre lies in.
    /// Where the raster has nothing, ground is empty.
    ///
    /// # Errors
    /// If the raster cannot be brought onto the scene.
    pub fn onto(
        &self,
        cells: &CoarseCells,
        scene: &Frame,
        reporter: &Reporter,
    ) -> Result<Sketch, Error> {
        let frame = &cells.frame;
        let all = || std::sync::Arc::new(Mask::all_valid(frame.len()));
        let picture = match &self.content {
            Content::Picture(picture) => picture,
            Content::Raster(raster) => {
                let mut codes = onto_scene::nearest_of(&self.path, raster, frame, reporter)?;
                if !codes.valid.contains(&true) {
                    let what = format!("{}: does not overlap the terrain", self.path.display());
                    return Err(Error::Usage { what });
                }
                cells.fill_rim(scene, &mut codes.values, &mut codes.valid);
                let density = |code: &f32| Density::from_code(*code).unwrap_or(Density::Empty);
                let densities = codes.values.iter().map(density).collect();
                return Ok(Grid::new(frame.clone(), all(), densities));
            }
        };
        let t = scene.transform;
        let share = |m: f64, cells: usize| m / (cells as f64 * t.cell_m);
        // `as` cuts what lies outside to the rim
        let pixel = |share: f64, pixels: usize| ((share * pixels as f64) as usize).min(pixels - 1);
        let density = |index: usize| {
            let at = frame.transform.center(frame.cell(index));
            let col = pixel(share(at.east_m - t.west_m, scene.cols), picture.cols);
            let row = pixel(share(t.north_m - at.north_m, scene.rows), picture.rows);
            picture.densities[row * picture.cols + col]
        };
        Ok(Grid::new(frame.clone(), all(), (0..frame.len()).map(density).collect()))
    }
}

fn picture(path: &Path, bytes: &[u8]) -> Result<Picture, Error> {
    let broken = |e: &dyn std::fmt::Display| {
        Error::from(
            ParseError::new(format!("not a PNG picture that can be read: {e}"), "save it anew")
                .at(path),
        )
    };
    let mut reader =
        image::ImageReader::with_format(std::io::Cursor::new(bytes), image::ImageFormat::Png);
    let mut limits = image::Limits::default();
    (limits.max_image_width, limits.max_image_height) = (Some(MOST_PIXELS), Some(MOST_PIXELS));
    limits.max_alloc = Some(4 << 30);
    reader.limits(limits);
    let image = reader.decode().map_err(|e| broken(&e))?.into_rgba8();
    let mut wrong = BTreeMap::new();
    let densities = image
        .pixels()
        .map(|pixel| {
            sketch::density_of_colour(pixel.0).unwrap_or_else(|| {
                let [r, g, b, alpha] = pixel.0;
                let alpha = if alpha < 255 { format!("{alpha:02x}") } else { String::new() };
                if wrong.len() < MOST_COUNTED {
                    *wrong.entry(format!("#{r:02x}{g:02x}{b:02x}{alpha}")).or_insert(0) += 1;
                }
                Density::Empty
            })
        })
        .collect();
    let names: Vec<String> = sketch::PALETTE
        .iter()
        .map(|(density, [r, g, b])| format!("#{r:02x}{g:02x}{b:02x} {}", density.name()))
        .collect();
    refuse(path, "colours", &wrong, &format!("{}, or transparent (empty)", names.join(", ")))?;
    // pictures are far below 2³² pixels a side
    Ok(Picture { rows: image.height() as usize, cols: image.width() as usize, densities })
}

/// An error that lists what is no paint, the most frequent first.
fn refuse(
    path: &Path,
    what: &str,
    wrong: &BTreeMap<String, usize>,
    known: &str,
) -> Result<(), Error> {
    if wrong.is_empty() {
        return Ok(());
    }
    let mut listed: Vec<_> = wrong.iter().collect();
    listed.sort_by(|a, b| b.1.cmp(a.1).then(a.0.cmp(b.0)));
    let names: Vec<String> =
        listed.iter().take(MOST_LISTED).map(|(name, count)| format!("{name} ({count})")).collect();
    let more = listed.len().saturating_sub(MOST_LISTED);
    let more = if more > 0 { format!(" and {more} more") } else { String::new() };
    let what = format!(
        "{}: unknown {what} {}{more}; paint with {known}, without smooth edges",
        path.display(),
        names.join(", ")
    );
    Err(Error::Usage { what })
}

impl StandRaster {
    /// Reads a raster of stand heights.
    ///
    /// # Errors
    /// If it cannot be read.
    pub fn read(path: &Path) -> Result<Self, Error> {
        let raster = raster_file::read(path, None, &Limits::default())?;
        Ok(Self { path: path.to_owned(), raster })
    }

    /// Stand heights in m on coarse cells.
    ///
    /// # Errors
    /// If the raster does not lie on the scene.
    pub fn onto(
        &self,
        cells: &CoarseCells,
        scene: &Frame,
        reporter: &Reporter,
    ) -> Result<Vec<f32>, Error> {
        let mut drawn = onto_scene::nearest_of(&self.path, &self.raster, &cells.frame, reporter)?;
        if !drawn.valid.contains(&true) {
            let what = format!("{}: does not overlap the terrain", self.path.display());
            return Err(Error::Usage { what });
        }
        cells.fill_rim(scene, &mut drawn.values, &mut drawn.valid);
        let mask = std::sync::Arc::new(Mask::new(drawn.valid));
        Ok(stand_height::of_raster(&Grid::new(cells.frame.clone(), mask, drawn.values)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn png(colours: &[[u8; 3]], width: u32) -> Vec<u8> {
        let height = colours.len() as u32 / width;
        let pixels = colours.concat();
        let mut bytes = std::io::Cursor::new(Vec::new());
        let image = image::RgbImage::from_raw(width, height, pixels).unwrap();
        image.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
        bytes.into_inner()
    }

    fn read(bytes: &[u8]) -> Result<Paint, Error> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("sketch.png");
        std::fs::write(&path, bytes).unwrap();
        Paint::read(&path)
    }

    #[test]
    fn a_picture_is_stretched_over_the_scene_row_0_north() {
        let paint = read(&png(&[[0; 3], [128; 3], [255; 3], [0, 100, 0]], 2)).unwrap();
        let scene = Frame::local(100, 200, 1.0);
        let cells = CoarseCells::of(&scene);
        let sketch = paint.onto(&cells, &scene, &Reporter::silent()).unwrap();
        let at = |row, col| sketch[crate::raster::Cell { row, col }];
        assert_eq!([at(0, 0), at(11, 24)], [Density::Empty; 2]);
        assert_eq!(at(0, 25), Density::Sparse);
        assert_eq!([at(13, 0), at(24, 49)], [Density::Dense; 2]);
    }

    #[test]
    fn unknown_colours_are_listed_the_most_frequent_first() {
        let colours = [[0; 3], [200, 0, 0], [200, 0, 0], [0, 0, 200]];
        let error = read(&png(&colours, 2)).err().unwrap();
        let text = error.to_string();
        assert!(error.is_bad_input());
        assert!(
            text.contains("#c80000 (2), #0000c8 (1)") && text.contains("#808080 sparse"),
            "{text}"
        );
    }

    #[test]
    fn a_picture_cut_short_is_told() {
        let bytes = png(&[[0; 3]; 400], 20);
        let error = read(&bytes[..bytes.len() / 2]).err().unwrap();
        assert!(error.is_bad_input() && error.to_string().contains("PNG"), "{error}");
    }
}
