//! A selection as EcoViz's list of trees (`.pdb`, version 3.0, text): live plants and snags, each a line.
//!
//! A head of version, origin, year and number of trees; a line a tree of id, species, x, y, height, crown radius, dbh in cm and
//! whether it is dead; then the number of cohorts of saplings, of which there are none: every plant is a line of its own.
//! Snags have the crown radius that they had at death.
//!
//! # Reference
//! "EcoViz File Formats", in the documentation of EcoViz, which iLand's output `ecoviz` writes too.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use super::WriteError;
use super::selection::Selection;
use super::species_code;
use crate::progress::Reporter;

/// Writes a file.
///
/// # Errors
/// If two species have one code, the file cannot be written, or the run was cancelled.
pub fn write(path: &Path, selection: &Selection, reporter: &Reporter) -> Result<(), WriteError> {
    let Selection { plants, snags, biome, window, frame, .. } = selection;
    let codes = species_code::codes(biome)?;
    let stage = reporter.stage("ecoviz", selection.len() as u64);
    // whole metres: the format's binary sister knows no others
    let (west_m, south_m) = (window.west.floor(), window.south.floor());
    let corner = frame.south_west();
    let (east_m, north_m) = (corner.east_m - west_m, corner.north_m - south_m);
    let mut out = BufWriter::new(File::create(path)?);
    let (year, trees) = (selection.years, plants.len() + snags.len());
    write!(out, "3.0\n{west_m} {south_m}\n{year}\n{trees}\n")?;
    let mut line = |id: u64,
                    species: u16,
                    east: f32,
                    north: f32,
                    [height, radius, dbh]: [f32; 3],
                    is_dead: bool| {
        writeln!(
            out,
            "{id} {} {:.3} {:.3} {height:.3} {radius:.3} {:.2} {}",
            codes[usize::from(species)],
            east_m + f64::from(east),
            north_m + f64::from(north),
            100.0 * dbh,
            u8::from(is_dead),
        )
    };
    for i in 0..plants.len() {
        let size_m = [plants.height_m[i], plants.crown_radius_m[i], plants.dbh_m[i]];
        line(plants.id[i], plants.species[i], plants.east_m[i], plants.north_m[i], size_m, false)?;
    }
    reporter.check_cancelled()?;
    for i in 0..snags.len() {
        let species = &biome.species[usize::from(snags.species[i])];
        let radius_m = species.crown_radius_m(snags.height_at_death_m[i]);
        let size_m = [snags.height_m[i], radius_m, snags.dbh_m[i]];
        line(snags.id[i], snags.species[i], snags.east_m[i], snags.north_m[i], size_m, true)?;
    }
    writeln!(out, "0")?;
    out.flush()?;
    stage.advance(trees as u64);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::export::selection::tests::scene;
    use crate::export::selection::{ExportLayer, Filter, Selection};

    #[test]
    fn live_and_dead_are_lines() {
        let home = tempfile::tempdir().unwrap();
        let path = home.path().join("trees.pdb");
        let layers = Some(vec![ExportLayer::Canopy, ExportLayer::Snags]);
        let filter = Filter { layers, min_height_m: 4.0, bbox: None };
        let selection = Selection::new(scene(), &filter).unwrap();
        write(&path, &selection, &Reporter::silent()).unwrap();
        let text = std::fs::read_to_string(path).unwrap();
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines[..4], ["3.0", "1000 2000", "30", "3"]);
        assert_eq!(lines[4], "1 buse 0.000 0.000 20.000 3.000 50.00 0");
        assert!(
            lines[6].starts_with("9 amov 15.000 5.000 4.000 ") && lines[6].ends_with(" 25.00 1")
        );
        assert_eq!(lines[7..], ["0"]);
    }
}
