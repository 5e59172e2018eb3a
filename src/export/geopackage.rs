//! A selection as a GeoPackage: plants and snags as points, downed logs as lines, crowns as polygons if asked for.

use std::ops::Range;
use std::path::Path;

use super::WriteError;
use super::instances::FeatureTable;
use super::selection::Selection;
use crate::io::geopackage::{self, Layer, Shape};
use crate::io::table::{Column, Table, Values};
use crate::progress::Reporter;
use crate::raster::resample::{CellPosition, Samples};

/// Columns of plants that crowns have too.
const CROWN_COLUMNS: [&str; 6] =
    ["id", "species", "layer", "geometry", "height_m", "crown_radius_m"];

/// Writes a file that does not exist yet.
///
/// # Errors
/// If it cannot be written, or the run was cancelled.
pub fn write(
    path: &Path,
    selection: &Selection,
    has_crowns: bool,
    reporter: &Reporter,
) -> Result<(), WriteError> {
    let elevation_m = &selection.elevation_m;
    let frame = elevation_m.frame();
    let samples =
        Samples::new(frame.rows, frame.cols, elevation_m.values(), elevation_m.mask().as_slice());
    // ends of downed logs may lie where no elevation is known: there the middle's stands in
    let ground_m = |[x, y]: [f64; 2], otherwise_m: f32| {
        let row = (frame.transform.north_m - y) / frame.transform.cell_m;
        let col = (x - frame.transform.west_m) / frame.transform.cell_m;
        samples.bilinear(CellPosition { row, col }).unwrap_or(otherwise_m)
    };
    let tables: Vec<(FeatureTable, Box<dyn Table + '_>)> =
        selection.tables().into_iter().map(|table| (table, selection.table(table))).collect();
    let mut layers = Vec::with_capacity(tables.len() + 1);
    for (of, table) in &tables {
        let (description, shape) = match of {
            FeatureTable::Plants => ("Live plants, at their stems", Shape::Point { z: "z_m" }),
            FeatureTable::Snags => ("Dead trees that still stand", Shape::Point { z: "z_m" }),
            FeatureTable::DownedLogs => (
                "Wood on the ground, from its thick end to its thin one",
                Shape::Line { z: "z_m", elevation_m: &ground_m },
            ),
        };
        layers.push(Layer { name: of.name(), description, table: table.as_ref(), shape });
    }
    let crowns = tables
        .iter()
        .find(|(of, _)| *of == FeatureTable::Plants && has_crowns)
        .map(|(_, plants)| Crowns::new(plants.as_ref()));
    if let Some(crowns) = &crowns {
        layers.push(Layer {
            name: "crowns",
            description: "Crowns of live plants: polygons with the area of a disk of the crown's radius",
            table: crowns,
            shape: Shape::Disk { radius: "crown_radius_m" },
        });
    }
    geopackage::write(path, &layers, &selection.frame.crs, reporter).map_err(|e| match e {
        geopackage::Error::Cancelled(cancelled) => cancelled.into(),
        other => WriteError::Io(std::io::Error::other(other)),
    })
}

/// Plants with those columns only that tell of a crown.
struct Crowns<'a> {
    plants: &'a dyn Table,
    columns: Vec<Column>,
    /// Where the columns stand in the table of plants.
    of_plants: Vec<usize>,
}

impl<'a> Crowns<'a> {
    fn new(plants: &'a dyn Table) -> Self {
        let all = plants.columns();
        let of_plants: Vec<usize> =
            (0..all.len()).filter(|column| CROWN_COLUMNS.contains(&all[*column].name)).collect();
        let columns = of_plants.iter().map(|column| all[*column]).collect();
        Self { plants, columns, of_plants }
    }
}

impl Table for Crowns<'_> {
    fn rows(&self) -> usize {
        self.plants.rows()
    }

    fn columns(&self) -> &[Column] {
        &self.columns
    }

    fn values(&self, column: usize, rows: Range<usize>) -> Values<'_> {
        self.plants.values(self.of_plants[column], rows)
    }
}
