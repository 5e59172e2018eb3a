//! A selection as iLand's list of single trees: what its landscapes are initialised from.
//!
//! iLand reads it with `initialization.type` `single`: columns by name, diameters in cm, heights in m, places in metres from
//! the south-west corner of its project area, which is to be the selection's. Lines that begin with `#` are comments.
//!
//! # Reference
//! iland-model.org, "initialize trees"; Seidl et al. 2012, doi:10.1016/j.ecolmodel.2012.02.015.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use super::WriteError;
use super::selection::Selection;
use super::species_code;
use crate::progress::{Reporter, Warning};
use crate::species::Form;

/// Least height of a tree in iLand; lower ones are saplings, of which it keeps cohorts (Seidl et al. 2012).
const LEAST_HEIGHT_M: f32 = 4.0;

/// Plants of a selection that are single trees in iLand, in the order of their ids.
pub fn trees(selection: &Selection) -> Vec<usize> {
    let Selection { plants, biome, .. } = selection;
    let is_tree = |plant: &usize| {
        let form = biome.species[usize::from(plants.species[*plant])].form;
        matches!(form, Form::Tree | Form::ShrubTree) && plants.height_m[*plant] >= LEAST_HEIGHT_M
    };
    let mut trees: Vec<usize> = (0..plants.len()).filter(is_tree).collect();
    trees.sort_unstable_by_key(|tree| plants.id[*tree]);
    trees
}

/// Writes a file.
///
/// # Errors
/// If no tree is as high as iLand's are, two species have one code, the file cannot be written, or the run was cancelled.
pub fn write(path: &Path, selection: &Selection, reporter: &Reporter) -> Result<(), WriteError> {
    let Selection { plants, biome, window, frame, .. } = selection;
    let codes = species_code::codes(biome)?;
    let trees = trees(selection);
    if trees.is_empty() {
        let what = format!(
            "none of {} plants is a tree of {LEAST_HEIGHT_M} m or more, as iLand's are",
            plants.len()
        );
        return Err(WriteError::Refused { what });
    }
    let left_out = plants.len() - trees.len();
    if left_out > 0 {
        let text = format!(
            "left out {left_out} plants that are no trees or lower than {LEAST_HEIGHT_M} m, which iLand has no single trees for"
        );
        reporter.warn(Warning::Other { text });
    }

    let stage = reporter.stage("iland", trees.len() as u64);
    let corner = frame.south_west();
    let (east_m, north_m) = (corner.east_m - window.west, corner.north_m - window.south);
    let mut out = BufWriter::new(File::create(path)?);
    writeln!(
        out,
        "# {}: x and y in metres from {}, {} ({})",
        selection.name, window.west, window.south, frame.crs
    )?;
    writeln!(out, "id,x,y,species,dbh,height,age")?;
    // ids of plants have more digits than iLand's
    for (id, tree) in (1..).zip(&trees) {
        let tree = *tree;
        writeln!(
            out,
            "{id},{:.3},{:.3},{},{:.2},{:.2},{:.0}",
            east_m + f64::from(plants.east_m[tree]),
            north_m + f64::from(plants.north_m[tree]),
            codes[usize::from(plants.species[tree])],
            100.0 * plants.dbh_m[tree],
            plants.height_m[tree],
            plants.age_years[tree].max(1.0), // 0 stands for an unknown age
        )?;
    }
    out.flush()?;
    stage.advance(trees.len() as u64);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::export::selection::tests::scene;
    use crate::export::selection::{Filter, Selection};
    use crate::raster::MapWindow;

    #[test]
    fn trees_are_told_in_iland_s_units_from_the_corner() {
        let home = tempfile::tempdir().unwrap();
        let path = home.path().join("trees.csv");
        let mut content = scene();
        let beech = content.biome.species_index("european-beech").unwrap_or(6);
        content.plants.species = vec![beech as u16; 4];
        let bbox = Some(MapWindow { west: 1002.0, south: 2000.0, east: 1020.0, north: 2020.0 });
        let selection = Selection::new(content, &Filter { bbox, ..Filter::default() }).unwrap();
        let reporter = Reporter::silent();
        write(&path, &selection, &reporter).unwrap();
        let text = std::fs::read_to_string(path).unwrap();
        assert_eq!(
            text,
            "# forest: x and y in metres from 1002, 2000 (EPSG:32611)\n\
             id,x,y,species,dbh,height,age\n\
             1,8.000,9.500,fasy,25.00,8.00,30\n"
        );
        assert_eq!(reporter.warnings().len(), 1, "of two low plants");
    }
}
