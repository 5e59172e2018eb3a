//! Highest returns to the canopy's surface and height.
//!
//! # Reference
//! Pits, cells deep below the canopy around them because the pulse slipped through the crown: Khosravipour
//! et al. 2014, Generating pit-free canopy height models from airborne lidar, doi:10.14358/PERS.80.9.863.
//! # Departures
//! They stack triangulations of the returns above 0, 2, 5, 10 and 15 m; here a pit is filled where it
//! is seen, from the cells around it, as Ben-Arie et al. 2009 do (doi:10.1016/j.cageo.2009.02.003).

use std::sync::Arc;

use rayon::prelude::*;

use super::layout::cell_index;
use crate::io::las::PointCloud;
use crate::progress::{Reporter, Warning};
use crate::raster::{Grid, Mask};

/// Classes that are no vegetation: building, rail, road, wires and what holds them, bridge
/// (LAS 1.4 R15, table 17).
const BUILT: [u8; 8] = [6, 10, 11, 13, 14, 15, 16, 17];

/// How far a surface reaches into cells without returns, m. chosen: closes what chance leaves open
/// at two points a cell, and no clearing.
const FILL_REACH_M: f64 = 2.0;
/// Neighbours with a height without which an empty cell stays empty.
const FILL_NEIGHBOURS: usize = 3;

/// Height over every neighbour at which a cell is a bird or a wire, for cells up to 1 m; it grows
/// with wider cells, which may hold a whole tree. chosen: crowns are no steeper than 10 m a metre.
const SPIKE_M_PER_M: f32 = 10.0;

/// Widest cells in which pits are filled, m. chosen: gaps of more than 1 m² are real.
const PIT_CELL_M: f64 = 1.0;
/// Depth under its neighbours at which a cell is a pit, m. chosen: below the height from which
/// vegetation counts as trees.
const PIT_DEPTH_M: f32 = 2.0;
/// Neighbours that must stand that much higher. chosen: more than half of the eight, so that the
/// straight edge of a crown (three or five) is kept.
const PIT_NEIGHBOURS: usize = 6;
/// Rounds of filling: the second closes pits of two cells.
const PIT_ROUNDS: usize = 2;

/// DSM and CHM over a DEM.
pub(super) fn surfaces(
    cloud: &PointCloud,
    dem: &Grid<f32>,
    max_canopy_height_m: f32,
    reporter: &Reporter,
) -> (Grid<f32>, Grid<f32>) {
    let stage = reporter.stage("canopy surface", cloud.len() as u64);
    let frame = dem.frame();
    let mut highest: Vec<Option<f32>> = vec![None; frame.len()];
    let mut highest_plant: Vec<Option<f32>> = vec![None; frame.len()];
    let (mut too_high, mut built) = (0_u64, 0_u64);
    for index in 0..cloud.len() {
        let [x, y, z] = cloud.position(index);
        let z = z as f32; // heights below 10 km keep millimetres
        let cell = cell_index(frame, x, y);
        if dem.mask().is_valid(cell) && z - dem.values()[cell] > max_canopy_height_m {
            too_high += 1;
            continue;
        }
        raise(&mut highest[cell], z);
        if BUILT.contains(&cloud.class(index)) {
            built += 1;
        } else {
            raise(&mut highest_plant[cell], z);
        }
    }
    stage.advance(cloud.len() as u64);
    if too_high > 0 {
        let text = format!("left out {too_high} returns more than {max_canopy_height_m} m above ground");
        reporter.warn(Warning::Other { text });
    }
    if built > 0 {
        let text =
            format!("{built} returns from buildings, wires and bridges do not count as canopy");
        reporter.warn(Warning::Other { text });
    }

    let mut height: Vec<Option<f32>> = (0..frame.len())
        .map(|cell| {
            let ground = dem.mask().is_valid(cell).then(|| dem.values()[cell])?;
            match (highest_plant[cell], highest[cell]) {
                (Some(top), _) => Some((top - ground).max(0.0)),
                (None, Some(_)) => Some(0.0), // a roof
                (None, None) => None,
            }
        })
        .collect();
    let (rows, cols) = (frame.rows, frame.cols);
    let spikes = remove_spikes(&mut height, rows, cols, frame.transform.cell_m);
    if spikes > 0 {
        reporter.warn(Warning::SpikesRemoved { cells: spikes });
    }
    let reach = (FILL_REACH_M / frame.transform.cell_m).ceil() as usize;
    for _ in 0..reach {
        fill_empty(&mut highest, dem.mask(), rows, cols);
        fill_empty(&mut height, dem.mask(), rows, cols);
    }
    if frame.transform.cell_m <= PIT_CELL_M {
        for _ in 0..PIT_ROUNDS {
            fill_pits(&mut height, rows, cols);
        }
    }
    (grid(dem, highest), grid(dem, height))
}

fn raise(top: &mut Option<f32>, z: f32) {
    *top = Some(top.map_or(z, |t| t.max(z)));
}

/// A grid on the DEM's frame, masked where there is no value.
fn grid(dem: &Grid<f32>, values: Vec<Option<f32>>) -> Grid<f32> {
    let mask = Mask::new(values.iter().map(Option::is_some).collect());
    let values = values.into_iter().map(Option::unwrap_or_default).collect();
    Grid::new(Arc::clone(dem.frame()), Arc::new(mask), values)
}

/// The heights of the eight cells around one, ascending; absent beyond the edge or where unknown.
struct Neighbours {
    heights: [f32; 8],
    count: usize,
}

impl Neighbours {
    fn of(values: &[Option<f32>], rows: usize, cols: usize, row: usize, col: usize) -> Self {
        let mut found = Self { heights: [0.0; 8], count: 0 };
        for r in row.saturating_sub(1)..(row + 2).min(rows) {
            for c in col.saturating_sub(1)..(col + 2).min(cols) {
                if let (Some(height), false) = (values[r * cols + c], (r, c) == (row, col)) {
                    found.heights[found.count] = height;
                    found.count += 1;
                }
            }
        }
        found.heights[..found.count].sort_unstable_by(f32::total_cmp);
        found
    }

    fn known(&self) -> &[f32] {
        &self.heights[..self.count]
    }

    /// The middle height; of an even number, the lower of the middle two.
    fn median(&self) -> Option<f32> {
        self.known().get(self.count.checked_sub(1)? / 2).copied()
    }
}

/// Replaces each cell by what `rule` makes of it and its neighbours' old heights; counts the changes.
fn change(
    values: &mut [Option<f32>],
    rows: usize,
    cols: usize,
    rule: impl Fn(usize, Option<f32>, &Neighbours) -> Option<f32> + Sync,
) -> usize {
    let old = values.to_vec();
    values
        .par_chunks_mut(cols)
        .enumerate()
        .map(|(row, line)| {
            let mut changed = 0;
            for (col, value) in line.iter_mut().enumerate() {
                let around = Neighbours::of(&old, rows, cols, row, col);
                let new = rule(row * cols + col, *value, &around);
                changed += usize::from(new != *value);
                *value = new;
            }
            changed
        })
        .sum()
}

/// Lowers cells that stand alone far above all their neighbours to the neighbours' median.
fn remove_spikes(values: &mut [Option<f32>], rows: usize, cols: usize, cell_m: f64) -> usize {
    let spike_m = SPIKE_M_PER_M * cell_m.max(1.0) as f32;
    change(values, rows, cols, |_, value, around| match (value, around.known().last()) {
        (Some(height), Some(top)) if around.count >= FILL_NEIGHBOURS && height > top + spike_m => {
            around.median()
        }
        _ => value,
    })
}

/// Gives empty cells over known ground the median of their neighbours.
fn fill_empty(values: &mut [Option<f32>], ground: &Mask, rows: usize, cols: usize) -> usize {
    change(values, rows, cols, |cell, value, around| {
        let fill = value.is_none() && ground.is_valid(cell) && around.count >= FILL_NEIGHBOURS;
        if fill { around.median() } else { value }
    })
}

/// Raises cells deep under nearly all their neighbours to the neighbours' median.
fn fill_pits(values: &mut [Option<f32>], rows: usize, cols: usize) -> usize {
    change(values, rows, cols, |_, value, around| match value {
        Some(height) => {
            let higher = around.known().iter().filter(|h| **h > height + PIT_DEPTH_M).count();
            if higher >= PIT_NEIGHBOURS { around.median() } else { value }
        }
        None => None,
    })
}
