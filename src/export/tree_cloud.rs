//! A selection as a point cloud: each plant a point at its top, with its measures as extra bytes (LAS, LAZ).

use std::fs::File;
use std::io::BufWriter;
use std::path::Path;

use super::WriteError;
use super::selection::Selection;
use crate::io::las::{Attribute, AttributeValues, AttributedPoints, write_attributed};
use crate::progress::Reporter;

/// Class of low, medium and high vegetation (ASPRS LAS 1.4, Table 17).
const CLASSES: [u8; 3] = [3, 4, 5];

/// Heights at which medium and high vegetation begin. chosen: what clouds of national surveys are sorted by.
const CLASS_FROM_M: [f32; 2] = [0.5, 2.0];

/// Writes a file, packed if its name ends in `.laz`.
///
/// # Errors
/// If it cannot be written.
pub fn write(path: &Path, selection: &Selection, reporter: &Reporter) -> Result<(), WriteError> {
    let Selection { plants, biome, frame, .. } = selection;
    let stage = reporter.stage("las", plants.len() as u64);
    let corner = frame.south_west();
    let places: Vec<[f64; 3]> = (0..plants.len())
        .map(|i| {
            [
                corner.east_m + f64::from(plants.east_m[i]),
                corner.north_m + f64::from(plants.north_m[i]),
                f64::from(plants.z_m[i]) + f64::from(plants.height_m[i]),
            ]
        })
        .collect();
    let class = |height_m: &f32| CLASSES[CLASS_FROM_M.partition_point(|from| from <= height_m)];
    let classes: Vec<u8> = plants.height_m.iter().map(class).collect();
    let layers: Vec<u8> = plants.layer.iter().map(|layer| *layer as u8).collect(); // two of them
    let reals = |name, description, values| Attribute {
        name,
        description,
        values: AttributeValues::Reals(values),
    };
    let attributes = [
        reals("height_m", "height above ground", &plants.height_m),
        reals("crown_radius_m", "crown radius", &plants.crown_radius_m),
        reals("dbh_m", "stem diameter, breast height", &plants.dbh_m),
        Attribute {
            name: "species",
            description: "see the record of wildwood",
            values: AttributeValues::Codes(&plants.species),
        },
        Attribute {
            name: "id",
            description: "the plant's id",
            values: AttributeValues::Ids(&plants.id),
        },
    ];
    let species: Vec<String> = biome
        .species
        .iter()
        .enumerate()
        .map(|(number, species)| format!("{number} {}", species.key))
        .collect();
    let note = format!("species: {}; user data: 0 canopy, 1 undergrowth", species.join(", "));
    let points = AttributedPoints {
        places: &places,
        classes: &classes,
        user_data: &layers,
        attributes: &attributes,
        note: &note,
    };
    let is_compressed = path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("laz"));
    let out = BufWriter::new(File::create(path)?);
    let out = write_attributed(&points, &frame.crs, is_compressed, out)
        .map_err(|e| WriteError::Io(std::io::Error::other(e)))?;
    out.into_inner().map_err(|e| WriteError::Io(e.into_error()))?;
    stage.advance(plants.len() as u64);
    Ok(())
}
