//! A close-up of a finished scene: `close_up.png` in its folder.

use std::path::{Path, PathBuf};

use super::scene_files::{read_deadwood, read_plants};
use super::{Error, biome_file, import};
use crate::export::close_up::area::Area;
use crate::export::close_up::{CloseUpInput, close_up};
use crate::export::preview;
use crate::io::Limits;
use crate::io::raster_file;
use crate::progress::Reporter;
use crate::raster::{Grid, MapPoint, Mask};
use crate::scene::{self, Manifest};

/// The picture's name in a scene folder.
pub const FILE: &str = "close_up.png";

/// Takes the picture of a forest away that is another one now.
pub(super) fn discard(folder: &Path) {
    // a picture that cannot be removed harms nobody
    let _ = std::fs::remove_file(folder.join(FILE));
}

/// The table that tells whether a scene has plants.
pub const PLANTS_FILE: &str = "plants.parquet";

/// Refuses an area whose middle lies outside a scene.
///
/// # Errors
/// The area's error, which says where the scene lies.
pub fn check(manifest: &Manifest, area: &Area) -> Result<(), Error> {
    let [east_m, north_m] = manifest.scene.south_west_m;
    Ok(area.check_inside(MapPoint { east_m, north_m }, manifest.scene.extent_m)?)
}

/// Draws an area of a scene folder that has plants, writes the picture beside the maps, and gives its path.
/// Grass and litter are drawn where the scene has them.
///
/// # Errors
/// If the area lies outside the scene, a file of it cannot be read, or the folder cannot be written.
pub fn write(
    folder: &Path,
    manifest: &Manifest,
    area: &Area,
    reporter: &Reporter,
) -> Result<PathBuf, Error> {
    check(manifest, area)?;
    let stage = reporter.stage("close-up", 2);
    let biome = biome_file::of_scene(folder, manifest)?;
    let elevation_m = import::load_terrain(folder, manifest)?.elevation_m;
    let plants = read_plants(folder, &biome, elevation_m.frame())?;
    let deadwood = read_deadwood(folder, &biome, elevation_m.frame())?;
    let [grass, litter] =
        ["grass.tif", "litterfall.tif"].map(|file| read_where_there(folder, file, &elevation_m));
    let (grass, litter) = (grass?, litter?);
    stage.advance(1);
    reporter.check_cancelled()?;
    let input = CloseUpInput {
        elevation_m: &elevation_m,
        plants: &plants,
        biome: &biome,
        grass_height_m: grass.as_ref(),
        litterfall: litter.as_ref(),
        deadwood: deadwood.as_ref(),
    };
    let picture = close_up(&input, area, &manifest.scene.name)?;
    let path = folder.join(FILE);
    let failed = |source| scene::Error::Write { path: path.clone(), source };
    let png = preview::encode_png(&picture).map_err(std::io::Error::other).map_err(failed)?;
    scene::write_beside(&folder.join(FILE), &png)?;
    stage.advance(1);
    Ok(path)
}

/// The first band of a raster of the scene, `None` where it has none.
fn read_where_there(
    folder: &Path,
    file: &str,
    elevation_m: &Grid<f32>,
) -> Result<Option<Grid<f32>>, Error> {
    let path = folder.join(file);
    if !path.exists() {
        return Ok(None);
    }
    let raster = raster_file::read_band(&path, 0, &Limits::default())?;
    let frame = elevation_m.frame();
    if (raster.rows, raster.cols) != (frame.rows, frame.cols) {
        let problem = format!("{file} has another size than the terrain");
        return Err(scene::Error::Manifest { path, problem }.into());
    }
    Ok(Some(Grid::new(frame.clone(), Mask::new(raster.valid).into(), raster.values)))
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::sync::atomic::AtomicBool;

    use super::*;
    use crate::pipeline::demo;
    use crate::progress::{Event, Sink};
    use crate::terrain::generate::GenerateParams;

    struct Silent;
    impl Sink for Silent {
        fn event(&self, _: &Event<'_>) {}
    }

    #[test]
    fn a_scene_is_pictured_and_otherwise_left_as_it_was() {
        let home = tempfile::tempdir().unwrap();
        let folder = home.path().join("forest");
        let reporter = Reporter::new(Box::new(Silent), Arc::new(AtomicBool::new(false)));
        let params = GenerateParams { rows: 64, cols: 64, ..GenerateParams::default() };
        let manifest = demo::run(folder.clone(), "sonoma", &params, &reporter).unwrap();
        let files = || -> Vec<_> {
            let mut names: Vec<_> =
                std::fs::read_dir(&folder).unwrap().map(|e| e.unwrap().file_name()).collect();
            names.sort();
            names
        };
        let before = files();
        let outside = "500,64,30".parse().unwrap();
        let error = write(&folder, &manifest, &outside, &reporter).unwrap_err();
        assert!(error.is_bad_input() && error.to_string().contains("--preview-area"), "{error}");
        assert_eq!(files(), before);
        for size in [40, 20] {
            let area = format!("64,64,{size}").parse().unwrap();
            let path = write(&folder, &manifest, &area, &reporter).unwrap();
            let picture = image::load_from_memory(&std::fs::read(path).unwrap()).unwrap();
            assert!(picture.width() > 1200);
        }
        assert_eq!(files().len(), before.len() + 1, "the picture and nothing else");
        assert_eq!(Manifest::read(&folder).unwrap(), Some(manifest));
    }
}
