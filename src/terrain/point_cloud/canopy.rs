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
/// in clouds of one point a m², and no clearing.
const FILL_REACH_M: f64 = 3.0;
/// Neighbours with a height without which an empty cell stays empty.
const FILL_NEIGHBOURS: usize = 3;

/// Height over every return beneath it and around it at which one is a bird, for cells up to 1 m; it
/// grows with wider cells, which may hold a whole tree. chosen: crowns are no steeper than 10 m a metre.
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

/// DSM and CHM over a DEM; birds are taken from the returns, so neither has them.
pub(super) fn surfaces(
    cloud: &PointCloud,
    dem: &Grid<f32>,
    max_canopy_height_m: f32,
    reporter: &Reporter,
) -> (Grid<f32>, Grid<f32>) {
    let stage = reporter.stage("canopy surface", cloud.len() as u64);
    let mut returns = Returns::of(cloud, dem, max_canopy_height_m);
    stage.advance(cloud.len() as u64);
    returns.report(max_canopy_height_m, reporter);

    let frame = dem.frame();
    let (cols, cell_m) = (frame.cols, frame.transform.cell_m);
    let spikes = returns.remove_spikes(cols, cell_m);
    if spikes > 0 {
        reporter.warn(Warning::SpikesRemoved { cells: spikes });
    }
    let mut height = returns.canopy_heights(dem);
    let mut highest = returns.highest();
    drop(returns);
    for _ in 0..(FILL_REACH_M / cell_m).ceil() as usize {
        fill_empty(&mut highest, dem.mask(), cols);
        fill_empty(&mut height, dem.mask(), cols);
    }
    if cell_m <= PIT_CELL_M {
        for _ in 0..PIT_ROUNDS {
            fill_pits(&mut height, cols);
        }
    }
    (grid(dem, highest), grid(dem, height))
}

/// The highest returns of each cell, m above sea level.
struct Returns {
    /// Of classes that may be plants, or the ground: the highest, and the one below it.
    plants: Vec<[Option<f32>; 2]>,
    /// Of buildings, wires and bridges.
    built: Vec<Option<f32>>,
    /// Number left out as too high.
    too_high: u64,
    /// Number from buildings, wires and bridges.
    built_returns: u64,
}

impl Returns {
    fn of(cloud: &PointCloud, dem: &Grid<f32>, max_height_m: f32) -> Self {
        let cells = dem.frame().len();
        let mut found = Self {
            plants: vec![[None; 2]; cells],
            built: vec![None; cells],
            too_high: 0,
            built_returns: 0,
        };
        for index in 0..cloud.len() {
            let [x, y, z] = cloud.position(index);
            let z = z as f32; // heights below 10 km keep millimetres
            let cell = cell_index(dem.frame(), x, y);
            if dem.mask().is_valid(cell) && z - dem.values()[cell] > max_height_m {
                found.too_high += 1;
                continue;
            }
            let z = Some(z); // None is less than any
            if BUILT.contains(&cloud.class(index)) {
                found.built_returns += 1;
                found.built[cell] = higher(found.built[cell], z);
                continue;
            }
            let [first, second] = found.plants[cell];
            if z > first {
                found.plants[cell] = [z, first];
            } else if z > second {
                found.plants[cell][1] = z;
            }
        }
        found
    }

    fn report(&self, max_height_m: f32, reporter: &Reporter) {
        if self.too_high > 0 {
            reporter.warn(Warning::ReturnsTooHigh { returns: self.too_high, max_height_m });
        }
        if self.built_returns > 0 {
            reporter.warn(Warning::BuiltReturns { returns: self.built_returns });
        }
    }

    /// Elevation of the highest return of any class.
    fn highest(&self) -> Vec<Option<f32>> {
        self.plants.iter().zip(&self.built).map(|(plants, b)| higher(plants[0], *b)).collect()
    }

    /// Takes away returns that stand alone: far above the cell's next and above all around. What is
    /// below a bird is taken for the canopy; without it, the neighbours' median. Counts the cells.
    fn remove_spikes(&mut self, cols: usize, cell_m: f64) -> usize {
        let spike_m = SPIKE_M_PER_M * cell_m.max(1.0) as f32;
        let old = self.highest();
        let built = &self.built;
        self.plants
            .par_iter_mut()
            .enumerate()
            .map(|(cell, plants)| {
                let [Some(top), next] = *plants else { return 0 };
                let below = higher(next, built[cell]);
                if below.is_some_and(|b| top <= b + spike_m) {
                    return 0;
                }
                let around = Neighbours::of(&old, cols, cell);
                let alone = around.known().iter().all(|h| top > h + spike_m);
                if !alone || around.count < FILL_NEIGHBOURS {
                    return 0;
                }
                *plants = [next.or(if below.is_none() { around.median() } else { None }), None];
                1
            })
            .sum()
    }

    /// Height of the highest plant above ground, m; 0 where there are only roofs and wires.
    fn canopy_heights(&self, dem: &Grid<f32>) -> Vec<Option<f32>> {
        let height = |cell: usize| {
            let ground = dem.mask().is_valid(cell).then(|| dem.values()[cell])?;
            match (self.plants[cell][0], self.built[cell]) {
                (Some(z), _) => Some((z - ground).max(0.0)),
                (None, roof) => roof.map(|_| 0.0),
            }
        };
        (0..self.plants.len()).into_par_iter().map(height).collect()
    }
}

/// The higher of two heights; none is lower than any.
fn higher(a: Option<f32>, b: Option<f32>) -> Option<f32> {
    if b > a { b } else { a }
}

/// A grid on the DEM's frame, masked where there is no value.
fn grid(dem: &Grid<f32>, values: Vec<Option<f32>>) -> Grid<f32> {
    let mask = Mask::new(values.iter().map(Option::is_some).collect());
    let values = values.into_iter().map(Option::unwrap_or_default).collect();
    Grid::new(Arc::clone(dem.frame()), Arc::new(mask), values)
}

/// The known heights of the up to eight cells around one.
struct Neighbours {
    heights: [f32; 8],
    count: usize,
}

impl Neighbours {
    fn of(values: &[Option<f32>], cols: usize, cell: usize) -> Self {
        let (row, col, rows) = (cell / cols, cell % cols, values.len() / cols);
        let mut found = Self { heights: [0.0; 8], count: 0 };
        for r in row.saturating_sub(1)..(row + 2).min(rows) {
            for c in col.saturating_sub(1)..(col + 2).min(cols) {
                if let (Some(height), false) = (values[r * cols + c], (r, c) == (row, col)) {
                    found.heights[found.count] = height;
                    found.count += 1;
                }
            }
        }
        found
    }

    fn known(&self) -> &[f32] {
        &self.heights[..self.count]
    }

    /// The middle height; of an even number, the lower of the middle two.
    fn median(mut self) -> Option<f32> {
        let middle = self.count.checked_sub(1)? / 2;
        let known = &mut self.heights[..self.count];
        Some(*known.select_nth_unstable_by(middle, f32::total_cmp).1)
    }
}

/// Replaces each cell by what `rule` makes of all old heights; counts the changes.
fn change(
    values: &mut [Option<f32>],
    cols: usize,
    rule: impl Fn(usize, &[Option<f32>]) -> Option<f32> + Sync,
) -> usize {
    let old = values.to_vec();
    values
        .par_chunks_mut(cols)
        .enumerate()
        .map(|(row, line)| {
            let mut changed = 0;
            for (col, value) in line.iter_mut().enumerate() {
                let new = rule(row * cols + col, &old);
                changed += usize::from(new != *value);
                *value = new;
            }
            changed
        })
        .sum()
}

/// Gives empty cells over known ground the median of their neighbours.
fn fill_empty(values: &mut [Option<f32>], ground: &Mask, cols: usize) -> usize {
    change(values, cols, |cell, old| {
        if old[cell].is_some() || !ground.is_valid(cell) {
            return old[cell];
        }
        let around = Neighbours::of(old, cols, cell);
        if around.count >= FILL_NEIGHBOURS { around.median() } else { None }
    })
}

/// Raises cells deep under nearly all their neighbours to the neighbours' median.
fn fill_pits(values: &mut [Option<f32>], cols: usize) -> usize {
    change(values, cols, |cell, old| {
        let height = old[cell]?;
        let around = Neighbours::of(old, cols, cell);
        let higher = around.known().iter().filter(|h| **h > height + PIT_DEPTH_M).count();
        if higher >= PIT_NEIGHBOURS { around.median() } else { Some(height) }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::las::Quantization;
    use crate::raster::Cell;

    /// Flat ground at 100 m, 20 × 20 m, a return in each cell, with canopy of `height` and `class`.
    fn chm_of(
        height: impl Fn(usize, usize) -> f64,
        class: impl Fn(usize, usize) -> u8,
        extra: &[([f64; 3], u8)],
    ) -> (Grid<f32>, Vec<Warning>) {
        let (_, chm, warnings) = both_of(height, class, extra);
        (chm, warnings)
    }

    fn both_of(
        height: impl Fn(usize, usize) -> f64,
        class: impl Fn(usize, usize) -> u8,
        extra: &[([f64; 3], u8)],
    ) -> (Grid<f32>, Grid<f32>, Vec<Warning>) {
        let dem = Grid::from_fn(20, 20, 1.0, |_| 100.0);
        let mut cloud = PointCloud::new([Quantization { scale: 0.01, offset: 0.0 }; 3], None, None);
        for index in 0..400 {
            let cell = dem.frame().cell(index);
            let p = dem.frame().transform.center(cell);
            let h = height(cell.row, cell.col);
            if h.is_finite() {
                cloud.push([p.east_m, p.north_m, 100.0 + h], class(cell.row, cell.col));
            }
        }
        for (position, class) in extra {
            cloud.push(*position, *class);
        }
        let reporter = Reporter::silent();
        let (dsm, chm) = surfaces(&cloud, &dem, 120.0, &reporter);
        (dsm, chm, reporter.warnings())
    }

    fn cone(row: usize, col: usize) -> f64 {
        (18.0 - 4.0 * (row as f64 - 10.0).hypot(col as f64 - 10.0)).max(0.0)
    }

    const TOP: Cell = Cell { row: 10, col: 10 };

    #[test]
    fn a_tree_on_a_plane_has_its_height() {
        let (chm, warnings) = chm_of(cone, |_, _| 5, &[]);
        assert_eq!((chm[TOP], warnings.len()), (18.0, 0));
        for index in 0..400 {
            let cell = chm.frame().cell(index);
            assert!((f64::from(chm[cell]) - cone(cell.row, cell.col)).abs() < 0.006, "{cell:?}");
        }
    }

    #[test]
    fn returns_below_ground_are_no_canopy() {
        let (chm, _) = chm_of(|_, _| -0.4, |_, _| 2, &[]);
        assert_eq!(chm.range(), Some((0.0, 0.0)));
    }

    #[test]
    fn birds_go_and_snags_stay() {
        let bird = [([10.5, 9.5, 125.0], 1)];
        let (chm, warnings) = chm_of(|_, _| 2.0, |_, _| 3, &bird);
        assert_eq!(chm[TOP], 2.0);
        assert_eq!(warnings, [Warning::SpikesRemoved { cells: 1 }]);
        // a snag as thin gives returns on its way down
        let snag = [([10.5, 9.5, 125.0], 1), ([10.5, 9.5, 117.0], 1), ([10.5, 9.5, 109.0], 1)];
        assert_eq!(chm_of(|_, _| 2.0, |_, _| 3, &snag).0[TOP], 25.0);
        // above the tallest tree: not even seen
        let (chm, warnings) = chm_of(|_, _| 2.0, |_, _| 3, &[([10.5, 9.5, 300.0], 1)]);
        assert_eq!(chm[TOP], 2.0);
        assert_eq!(warnings, [Warning::ReturnsTooHigh { returns: 1, max_height_m: 120.0 }]);
    }

    #[test]
    fn issue_2_birds_are_gone_from_the_surface_as_well() {
        let bird = [([10.5, 9.5, 125.0], 1)];
        let (dsm, chm, _) = both_of(|_, _| 2.0, |_, _| 3, &bird);
        assert_eq!((dsm[TOP], dsm.range(), chm[TOP]), (102.0, Some((102.0, 102.0)), 2.0));
        // alone in its cell
        let hole = |r: usize, c: usize| if (r, c) == (10, 10) { f64::NAN } else { 2.0 };
        let (dsm, chm, _) = both_of(hole, |_, _| 3, &bird);
        assert_eq!((dsm[TOP], chm[TOP]), (102.0, 2.0));
        // over a roof: the roof stays, and is no canopy
        let (dsm, chm, _) = both_of(|_, _| 8.0, |_, _| 6, &bird);
        assert_eq!((dsm[TOP], chm[TOP]), (108.0, 0.0));
        // a wire is no bird
        let wire = [([10.5, 9.5, 125.0], 14)];
        let (dsm, chm, _) = both_of(|_, _| 2.0, |_, _| 3, &wire);
        assert_eq!((dsm[TOP], chm[TOP]), (125.0, 2.0));
    }

    #[test]
    fn pits_are_filled_and_gaps_stay() {
        let pit = |r: usize, c: usize| if r == 10 && (10..12).contains(&c) { 0.0 } else { 15.0 };
        let (chm, _) = chm_of(pit, |_, _| 5, &[]);
        assert_eq!((chm[TOP], chm[Cell { row: 10, col: 11 }]), (15.0, 15.0));
        let gap = |r: usize, c: usize| {
            if (9..12).contains(&r) && (9..12).contains(&c) { 0.0 } else { 15.0 }
        };
        assert_eq!(chm_of(gap, |_, _| 5, &[]).0[TOP], 0.0);
        let edge = |_: usize, c: usize| if c < 10 { 15.0 } else { 0.0 };
        assert_eq!(chm_of(edge, |_, _| 5, &[]).0[TOP], 0.0);
    }

    #[test]
    fn buildings_and_wires_are_no_canopy() {
        let house = |r: usize, c: usize| r < 10 && c < 10;
        let height = |r, c| if house(r, c) { 8.0 } else { 1.0 };
        let wire = [([15.5, 4.5, 112.0], 14)];
        let (chm, warnings) = chm_of(height, |r, c| if house(r, c) { 6 } else { 3 }, &wire);
        assert_eq!(chm[Cell { row: 4, col: 4 }], 0.0);
        assert_eq!(chm[Cell { row: 15, col: 15 }], 1.0);
        assert_eq!(warnings, [Warning::BuiltReturns { returns: 101 }]);
    }

    #[test]
    fn empty_cells_take_their_neighbours_and_voids_stay() {
        let hole = |r: usize, c: usize| {
            let near = (r, c) == (3, 3);
            let wide = (r as f64 - 12.0).hypot(c as f64 - 12.0) < 6.0;
            if near || wide { f64::NAN } else { 7.0 }
        };
        let (chm, _) = chm_of(hole, |_, _| 5, &[]);
        assert_eq!(chm.get(Cell { row: 3, col: 3 }), Some(&7.0));
        assert_eq!(chm.get(Cell { row: 12, col: 7 }), Some(&7.0)); // 3 m from the rim at most
        assert_eq!(chm.get(Cell { row: 12, col: 12 }), None);
    }
}
