//! A painted brush: a raster of region numbers, and a TOML file that says what each region is to be made of.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read;
use std::path::Path;
use std::sync::Arc;

use super::Error;
use super::onto_scene::read_nearest;
use crate::canopy::brush::{Brush, BrushRegion, MOST_REGIONS};
use crate::canopy::shares::Shares;
use crate::io::{self, Limits, ParseError};
use crate::progress::{Reporter, Warning};
use crate::raster::{Frame, Grid, Mask};
use crate::species::Biome;

/// Bytes read of a brush's TOML file at most. chosen: 250 regions take some tens of thousands.
const MAX_BYTES: u64 = 1 << 20;
/// Greatest region number. chosen: 16 bits, the widest that painting programs write.
const MOST_VALUE: u32 = 65_535;

/// The file's form.
#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct BrushFile {
    region: Vec<RegionTable>,
}

#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct RegionTable {
    value: u32,
    name: String,
    #[serde(default)]
    shares: BTreeMap<String, f64>,
}

/// A brush on the scene's frame; 0, nodata and what lies outside the raster are unpainted.
///
/// ```toml
/// [[region]]
/// value = 1                       # the number painted in the raster
/// name = "creek"
/// shares = { redwood = 0.4, douglas-fir = 0.3 }
/// ```
///
/// # Errors
/// The message names file and key: numbers used twice, out of range, painted and not described, or shares that the
/// biome cannot serve.
pub fn read_brush(
    raster: &Path,
    regions: &Path,
    frame: &Arc<Frame>,
    biome: &Biome,
    limits: &Limits,
    reporter: &Reporter,
) -> Result<Brush, Error> {
    let (described, values) = read_regions(regions, biome)?;
    let painted = read_nearest(raster, frame, limits, reporter)?;
    let mut cells = vec![0_u8; frame.len()];
    let mut cells_of_region = vec![0_u64; described.len()];
    let mut unknown: BTreeMap<u32, u64> = BTreeMap::new();
    for ((cell, &value), &valid) in cells.iter_mut().zip(&painted.values).zip(&painted.valid) {
        if !valid || value == 0.0 {
            continue;
        }
        let number = value as u32; // cut to 0..2³²; compared with what it was cut from
        if number as f32 != value {
            let what = format!("a cell holds {value}, which is no region number");
            let hint = "paint whole numbers, 0 where nothing is painted";
            return Err(ParseError::new(what, hint).at(raster).into());
        }
        match values.get(&number) {
            Some(&at) => {
                *cell = at as u8 + 1; // below MOST_REGIONS
                cells_of_region[at] += 1;
            }
            None => *unknown.entry(number).or_default() += 1,
        }
    }
    if let Some((number, cells)) = unknown.first_key_value() {
        let what = format!("{cells} cells hold region {number}, which {} lacks", regions.display());
        let hint = format!("add a [[region]] with value = {number} there, or paint those cells 0");
        return Err(ParseError::new(what, hint).at(raster).into());
    }
    for (region, _) in described.iter().zip(&cells_of_region).filter(|(_, cells)| **cells == 0) {
        let (regions, raster) = (regions.display(), raster.display());
        let text = format!(
            "{regions}: region \"{}\" is painted nowhere in the scene by {raster}",
            region.name
        );
        reporter.warn(Warning::Other { text });
    }
    let mask = Arc::new(Mask::all_valid(frame.len()));
    Ok(Brush { regions: described, cells: Grid::new(Arc::clone(frame), mask, cells) })
}

/// The regions in the file's order, and where each number stands among them.
fn read_regions(
    path: &Path,
    biome: &Biome,
) -> Result<(Vec<BrushRegion>, BTreeMap<u32, usize>), Error> {
    let failed = |source| io::Error::Read { path: path.to_path_buf(), source };
    let wrong = |what: String| Error::Usage { what: format!("{}: {what}", path.display()) };
    let mut bytes = Vec::new();
    let file = File::open(path).map_err(failed)?;
    file.take(MAX_BYTES + 1).read_to_end(&mut bytes).map_err(failed)?;
    if bytes.len() as u64 > MAX_BYTES {
        return Err(wrong(format!("more than {MAX_BYTES} bytes; is this the brush's TOML file?")));
    }
    let text = String::from_utf8(bytes)
        .map_err(|_| wrong("it is no text; give a TOML file with [[region]] tables".to_owned()))?;
    let file: BrushFile =
        toml::from_str(&text).map_err(|e| wrong(e.to_string().trim().to_owned()))?;
    if file.region.is_empty() || file.region.len() > MOST_REGIONS {
        let count = file.region.len();
        return Err(wrong(format!("it has {count} regions; give 1 to {MOST_REGIONS}")));
    }
    let mut regions: Vec<BrushRegion> = Vec::with_capacity(file.region.len());
    let mut values = BTreeMap::new();
    for (at, table) in file.region.into_iter().enumerate() {
        let RegionTable { value, name, shares } = table;
        let place = format!("region {} (\"{name}\")", at + 1);
        if !(1..=MOST_VALUE).contains(&value) {
            let what =
                format!("{place}: value = {value} is outside 1..={MOST_VALUE}; 0 is unpainted");
            return Err(wrong(what));
        }
        if name.trim().is_empty() || regions.iter().any(|region| region.name == name) {
            let what =
                format!("{place}: name is empty or used twice; figures are told apart by it");
            return Err(wrong(what));
        }
        if values.insert(value, at).is_some() {
            return Err(wrong(format!("{place}: value = {value} is used twice")));
        }
        let shares =
            Shares::new(&shares, biome).map_err(|e| wrong(format!("{place}: shares: {e}")))?;
        regions.push(BrushRegion { name, shares });
    }
    Ok((regions, values))
}

#[cfg(test)]
mod tests {
    use super::*;

    const ASC: &str = "ncols 4\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 5\nNODATA_value -9999\n0 3 -9999 12\n3 3 0 0\n";
    const TOML: &str = "[[region]]\nvalue = 12\nname = \"ridge\"\nshares = { gray-pine = 0.5 }\n\n[[region]]\nvalue = 3\nname = \"creek\"\n";

    fn read(asc: &str, toml: &str) -> (Result<Brush, Error>, Vec<Warning>) {
        let folder = tempfile::tempdir().unwrap();
        let (raster, regions) = (folder.path().join("b.asc"), folder.path().join("b.toml"));
        std::fs::write(&raster, asc).unwrap();
        std::fs::write(&regions, toml).unwrap();
        let biome = Biome::builtin("sonoma").unwrap();
        let frame = Arc::new(Frame::local(10, 20, 1.0));
        let reporter = Reporter::silent();
        let brush = read_brush(&raster, &regions, &frame, &biome, &Limits::default(), &reporter);
        (brush, reporter.warnings())
    }

    #[test]
    fn numbers_become_regions_of_the_file_s_order() {
        let brush = read(ASC, TOML).0.unwrap();
        let names: Vec<&str> = brush.regions.iter().map(|r| r.name.as_str()).collect();
        assert_eq!(names, ["ridge", "creek"]);
        assert!(brush.regions[1].shares.is_empty() && !brush.regions[0].shares.is_empty());
        let row =
            |row: usize| (0..20).step_by(5).map(|c| brush.cells.row(row)[c]).collect::<Vec<_>>();
        assert_eq!((row(0), row(9)), (vec![0, 2, 0, 1], vec![2, 2, 0, 0]));
        assert_eq!(brush.cells.values().iter().filter(|v| **v == 2).count(), 75);
    }

    #[test]
    fn errors_name_file_and_key() {
        let message = |asc: &str, toml: &str| read(asc, toml).0.unwrap_err().to_string();
        let unknown = message(&ASC.replace("12", "13"), TOML);
        assert!(unknown.contains("b.asc") && unknown.contains("region 13"), "{unknown}");
        assert!(message(&ASC.replace("12", "1.5"), TOML).contains("1.5"));
        assert!(message(&ASC.replace("12", "-3"), TOML).contains("-3"));
        let with = |from: &str, to: &str| message(ASC, &TOML.replace(from, to));
        for (from, to, expected) in [
            ("gray-pine", "spruce", "`spruce`"),
            ("0.5", "1.5", "`gray-pine` is 1.5"),
            ("value = 3", "value = 0", "value = 0 is outside"),
            ("value = 3", "value = 12", "value = 12 is used twice"),
            ("creek", "ridge", "used twice"),
            ("name = \"creek\"\n", "", "missing field `name`"),
            ("value = 3", "number = 3", "number"),
        ] {
            let message = with(from, to);
            assert!(message.contains("b.toml") && message.contains(expected), "{message}");
        }
        assert!(message(ASC, "region = []").contains("0 regions"));
    }

    #[test]
    fn a_region_painted_nowhere_is_told() {
        let (brush, warnings) = read(&ASC.replace("12", "0"), TOML);
        assert!(brush.is_ok());
        assert!(warnings.iter().any(|w| w.to_string().contains("\"ridge\"")), "{warnings:?}");
    }
}
