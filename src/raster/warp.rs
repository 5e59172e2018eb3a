//! A raster onto another grid: turned, scaled, or in another coordinate reference system.
//!
//! Each target cell asks where it lies in the source. The exact projection is too slow to ask for
//! every cell, so it is asked on a lattice and interpolated between, where that is checked to be
//! good; see `CellMap`.

use rayon::prelude::*;

use super::resample::{CellPosition, Kernel, Samples};
use super::{Affine, GeoTransform, Projector};
use crate::progress::{Cancelled, Reporter};

/// Values on a target grid and which of them are valid; 0 where not.
#[derive(Clone, Debug, PartialEq)]
pub struct Warped {
    /// Row-major values.
    pub values: Vec<f32>,
    /// One flag a cell.
    pub valid: Vec<bool>,
}

/// A source grid: cells and where they lie.
#[derive(Clone, Copy, Debug)]
pub struct Source<'a> {
    /// Values and flags.
    pub samples: Samples<'a>,
    /// Map position, in the source's CRS.
    pub affine: Affine,
}

/// A north-up target grid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Target {
    /// Number of rows.
    pub rows: usize,
    /// Number of columns.
    pub cols: usize,
    /// Map position, in the target's CRS.
    pub transform: GeoTransform,
}

/// Resamples `source` onto `target`; `to_source` takes target coordinates to the source's CRS,
/// `None` if they share one. Same bits for any number of threads.
///
/// # Errors
/// [`Cancelled`] once the run was cancelled.
///
/// # Panics
/// If the source's affine has no inverse.
pub fn warp(
    source: &Source<'_>,
    target: &Target,
    to_source: Option<&Projector>,
    kernel: Kernel,
    reporter: &Reporter,
) -> Result<Warped, Cancelled> {
    let stage = reporter.stage("warp", target.rows as u64);
    let mut map = ExactMap::new(&source.affine, target, to_source);
    if to_source.is_some_and(Projector::gives_degrees) {
        let [middle_deg, _] = map_coordinates(&source.affine, source.samples.middle());
        map.middle_longitude_deg = Some(middle_deg);
    }
    let map = CellMap::new(map, target);
    let cells = target.rows * target.cols;
    let mut warped = Warped { values: vec![0.0; cells], valid: vec![false; cells] };
    if cells == 0 {
        return Ok(warped);
    }
    let rows =
        warped.values.par_chunks_mut(target.cols).zip(warped.valid.par_chunks_mut(target.cols));
    rows.enumerate().try_for_each(|(row, (values, valid))| {
        reporter.check_cancelled()?;
        for (col, (value, valid)) in values.iter_mut().zip(valid).enumerate() {
            let place = |rows: f64, cols: f64| map.source_of(row as f64 + rows, col as f64 + cols);
            let drawn = place(0.5, 0.5).and_then(|middle| {
                source.samples.draw(kernel, middle, || {
                    Some([place(0.0, 0.0)?, place(0.0, 1.0)?, place(1.0, 1.0)?, place(1.0, 0.0)?])
                })
            });
            if let Some(drawn) = drawn {
                (*value, *valid) = (drawn, true);
            }
        }
        stage.advance(1);
        Ok(())
    })?;
    Ok(warped)
}

/// Source cells that one target cell covers at the target's middle, as a side (the root of the area).
///
/// `None` where the middle has no place in the source's CRS.
pub fn source_cells_per_target_cell(
    affine: &Affine,
    target: &Target,
    to_source: Option<&Projector>,
) -> Option<f64> {
    let exact = ExactMap::new(affine, target, to_source);
    let (row, col) = (target.rows as f64 / 2.0, target.cols as f64 / 2.0);
    let at = exact.source_of(row, col)?;
    let down = exact.source_of(row + 1.0, col)?;
    let right = exact.source_of(row, col + 1.0)?;
    let area =
        (down.row - at.row) * (right.col - at.col) - (down.col - at.col) * (right.row - at.row);
    Some(area.abs().sqrt())
}

/// Map coordinates of a place in a raster, counted in cells from its first corner.
pub fn map_coordinates(affine: &Affine, at: CellPosition) -> [f64; 2] {
    [
        affine.origin_x + at.col * affine.col_dx + at.row * affine.row_dx,
        affine.origin_y + at.col * affine.col_dy + at.row * affine.row_dy,
    ]
}

/// Area of a cell in square units of the CRS; negative where rows run from the north, as usual.
pub fn signed_cell_area(affine: &Affine) -> f64 {
    affine.col_dx * affine.row_dy - affine.col_dy * affine.row_dx
}

/// A longitude moved by whole turns to lie nearest to another, degrees.
pub fn nearest_turn(longitude_deg: f64, middle_deg: f64) -> f64 {
    longitude_deg + 360.0 * ((middle_deg - longitude_deg) / 360.0).round()
}

/// The exact way from target cells to source cells.
struct ExactMap<'a> {
    affine: Affine,
    transform: GeoTransform,
    to_source: Option<&'a Projector>,
    /// Longitudes are moved by whole turns to lie nearest to this one: rasters count from 0° to 360°, or cross 180°.
    middle_longitude_deg: Option<f64>,
}

/// Source positions are rounded to this many parts of a cell: rounding errors of map coordinates
/// (1e-9 cells) then move no centre off a centre, and equal grids resample to equal bits.
const POSITION_PARTS: f64 = (1 << 20) as f64;

fn rounded(position: f64) -> f64 {
    (position * POSITION_PARTS).round_ties_even() / POSITION_PARTS
}

impl<'a> ExactMap<'a> {
    fn new(affine: &Affine, target: &Target, to_source: Option<&'a Projector>) -> Self {
        assert!(signed_cell_area(affine) != 0.0, "the source's cells have no area");
        Self { affine: *affine, transform: target.transform, to_source, middle_longitude_deg: None }
    }

    fn source_of(&self, row: f64, col: f64) -> Option<CellPosition> {
        let t = &self.transform;
        let mut point = [t.west_m + col * t.cell_m, t.north_m - row * t.cell_m];
        if let Some(projector) = self.to_source {
            point = projector.project(point)?;
        }
        if let Some(middle_deg) = self.middle_longitude_deg {
            point[0] = nearest_turn(point[0], middle_deg);
        }
        let a = &self.affine;
        let (x, y) = (point[0] - a.origin_x, point[1] - a.origin_y);
        let area = signed_cell_area(a);
        Some(CellPosition {
            row: rounded((y * a.col_dx - x * a.col_dy) / area),
            col: rounded((x * a.row_dy - y * a.row_dx) / area),
        })
    }
}

/// Target cells between nodes of the first lattice tried; each further one halves it.
const COARSEST_STEP: usize = 64;
/// Below this the lattice costs about what it saves.
const FINEST_STEP: usize = 4;
/// Most error of interpolated source positions, in source cells; chosen: 1/40 of a cell moves a
/// height by 2.5 % of the rise across one cell.
const POSITION_TOLERANCE_CELLS: f64 = 0.025;

/// Exact source positions on every `step`-th corner of the target.
struct Lattice {
    step: usize,
    rows: usize,
    cols: usize,
    nodes: Vec<Option<CellPosition>>,
}

impl Lattice {
    fn new(exact: &ExactMap<'_>, target: &Target, step: usize) -> Self {
        let rows = target.rows.div_ceil(step) + 1;
        let cols = target.cols.div_ceil(step) + 1;
        let node = |i: usize| exact.source_of((i / cols * step) as f64, (i % cols * step) as f64);
        let nodes = (0..rows * cols).into_par_iter().map(node).collect();
        Self { step, rows, cols, nodes }
    }

    /// The interpolated source position, `None` where a node around it has none.
    #[inline]
    fn source_of(&self, row: f64, col: f64) -> Option<CellPosition> {
        let (row, col) = (row / self.step as f64, col / self.step as f64);
        // target positions are not negative; the last node serves the block before it
        let node_row = (row as usize).min(self.rows - 2);
        let node_col = (col as usize).min(self.cols - 2);
        let (down, right) = (row - node_row as f64, col - node_col as f64);
        let first = node_row * self.cols + node_col;
        let mix = |a: CellPosition, b: CellPosition, t: f64| CellPosition {
            row: a.row + (b.row - a.row) * t,
            col: a.col + (b.col - a.col) * t,
        };
        let upper = mix(self.nodes[first]?, self.nodes[first + 1]?, right);
        let below = first + self.cols;
        let lower = mix(self.nodes[below]?, self.nodes[below + 1]?, right);
        Some(mix(upper, lower, down))
    }

    /// Whether interpolation is good everywhere.
    ///
    /// Asked at the middle of each block **and** of its edges: a conformal projection bends alike
    /// and oppositely along rows and columns, and the two cancel in the block's middle.
    fn is_good(&self, exact: &ExactMap<'_>) -> bool {
        (0..(self.rows - 1) * (self.cols - 1)).into_par_iter().all(|block| {
            let row = (block / (self.cols - 1) * self.step) as f64;
            let col = (block % (self.cols - 1) * self.step) as f64;
            let half = self.step as f64 / 2.0;
            let places =
                [(half, half), (0.0, half), (half, 0.0), (2.0 * half, half), (half, 2.0 * half)];
            places.into_iter().all(|(down, right)| {
                match (
                    self.source_of(row + down, col + right),
                    exact.source_of(row + down, col + right),
                ) {
                    (Some(guess), Some(truth)) => {
                        let off = (guess.row - truth.row).abs().max((guess.col - truth.col).abs());
                        off <= POSITION_TOLERANCE_CELLS
                    }
                    // such blocks are asked exactly
                    (None, _) => true,
                    (Some(_), None) => false,
                }
            })
        })
    }
}

/// Where target cells lie in the source: interpolated where a lattice is good, else exact.
struct CellMap<'a> {
    exact: ExactMap<'a>,
    lattice: Option<Lattice>,
}

impl<'a> CellMap<'a> {
    fn new(exact: ExactMap<'a>, target: &Target) -> Self {
        let mut lattice = None;
        if exact.to_source.is_some() && target.rows > 0 && target.cols > 0 {
            let mut step = COARSEST_STEP;
            while lattice.is_none() && step >= FINEST_STEP {
                lattice = Some(Lattice::new(&exact, target, step)).filter(|l| l.is_good(&exact));
                step /= 2;
            }
        }
        Self { exact, lattice }
    }

    #[inline]
    fn source_of(&self, row: f64, col: f64) -> Option<CellPosition> {
        let interpolated = self.lattice.as_ref().and_then(|lattice| lattice.source_of(row, col));
        interpolated.or_else(|| self.exact.source_of(row, col))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::raster::Crs;

    const NORTH_UP: Affine = Affine {
        origin_x: 0.0,
        origin_y: 60.0,
        col_dx: 1.0,
        col_dy: 0.0,
        row_dx: 0.0,
        row_dy: -1.0,
    };

    fn target(rows: usize, cols: usize, west_m: f64, north_m: f64, cell_m: f64) -> Target {
        Target { rows, cols, transform: GeoTransform { west_m, north_m, cell_m } }
    }

    /// Heights of a function of map coordinates.
    fn drawn(affine: &Affine, rows: usize, cols: usize, f: impl Fn([f64; 2]) -> f64) -> Vec<f32> {
        let place =
            |i: usize| CellPosition { row: (i / cols) as f64 + 0.5, col: (i % cols) as f64 + 0.5 };
        (0..rows * cols).map(|i| f(map_coordinates(affine, place(i))) as f32).collect()
    }

    fn warp_silently(
        source: &Source<'_>,
        to: &Target,
        by: Option<&Projector>,
        kernel: Kernel,
    ) -> Warped {
        warp(source, to, by, kernel, &Reporter::silent()).unwrap()
    }

    #[test]
    fn the_same_grid_keeps_its_bits() {
        let affine = Affine { origin_x: 563_999.5, origin_y: 146_999.5, ..NORTH_UP };
        let values = drawn(&affine, 20, 30, |[x, y]| (x * 0.37 + y * 0.11).fract() + 300.0);
        let valid: Vec<bool> = (0..600_usize).map(|i| !i.is_multiple_of(7)).collect();
        let source = Source { samples: Samples::new(20, 30, &values, &valid), affine };
        let to = target(20, 30, 563_999.5, 146_999.5, 1.0);
        for kernel in [Kernel::Nearest, Kernel::Bilinear, Kernel::Bicubic, Kernel::Average] {
            let warped = warp_silently(&source, &to, None, kernel);
            assert_eq!(warped.valid, valid);
            let kept = warped.values.iter().zip(&values).zip(&valid).filter(|(_, v)| **v);
            assert!(kept.clone().all(|((a, b), _)| a == b));
        }
    }

    #[test]
    fn a_ramp_survives_turning() {
        // turned by the 3-4-5 angle, cells of 0.5 m
        let affine = Affine {
            origin_x: 100.0,
            origin_y: 200.0,
            col_dx: 0.4,
            col_dy: 0.3,
            row_dx: 0.3,
            row_dy: -0.4,
        };
        let ramp = |[x, y]: [f64; 2]| 10.0 + 0.5 * x - 0.25 * y;
        let values = drawn(&affine, 80, 80, ramp);
        let valid = vec![true; values.len()];
        let source = Source { samples: Samples::new(80, 80, &values, &valid), affine };
        let to = target(10, 10, 122.0, 202.0, 0.45);
        let truth =
            Affine { origin_x: 122.0, origin_y: 202.0, col_dx: 0.45, row_dy: -0.45, ..NORTH_UP };
        let expected = drawn(&truth, 10, 10, ramp);
        // cells are even steps to the average: it meets the ramp to an eighth of a step (0.28 m)
        for (kernel, bound) in
            [(Kernel::Bilinear, 1e-4), (Kernel::Bicubic, 1e-4), (Kernel::Average, 0.035)]
        {
            let warped = warp_silently(&source, &to, None, kernel);
            assert!(warped.valid.iter().all(|v| *v));
            for (found, expected) in warped.values.iter().zip(&expected) {
                assert!((found - expected).abs() < bound, "{kernel:?}: {found} for {expected}");
            }
        }
    }

    #[test]
    fn averaging_keeps_the_mean() {
        let values = drawn(&NORTH_UP, 60, 60, |[x, y]| (x * 12.9898 + y * 78.233).fract() * 50.0);
        let valid = vec![true; values.len()];
        let source = Source { samples: Samples::new(60, 60, &values, &valid), affine: NORTH_UP };
        let mean = |v: &[f32]| v.iter().map(|v| f64::from(*v)).sum::<f64>() / v.len() as f64;
        // 60 cells in 20, and in 24 (cells cut in parts)
        for (count, cell_m) in [(20, 3.0), (24, 2.5)] {
            let warped = warp_silently(
                &source,
                &target(count, count, 0.0, 60.0, cell_m),
                None,
                Kernel::Average,
            );
            assert!((mean(&warped.values) - mean(&values)).abs() < 1e-5);
        }
    }

    #[test]
    fn the_lattice_is_as_good_as_promised() {
        let projector = Projector::new(&Crs::Epsg(32633), &Crs::Epsg(4326)).unwrap();
        let second = 1.0 / 3600.0;
        let affine =
            Affine { origin_x: 12.0, origin_y: 47.0, col_dx: second, row_dy: -second, ..NORTH_UP };
        let to = target(700, 900, 280_000.0, 5_200_000.0, 25.0);
        let map = CellMap::new(ExactMap::new(&affine, &to, Some(&projector)), &to);
        assert!(map.lattice.is_some());
        let mut worst = 0.0_f64;
        for i in 0..70_000 {
            let (row, col) = ((i / 100) as f64 + 0.37, (i % 100 * 9) as f64 + 0.61);
            let guess = map.source_of(row, col).unwrap();
            let truth = map.exact.source_of(row, col).unwrap();
            worst = worst.max((guess.row - truth.row).abs()).max((guess.col - truth.col).abs());
        }
        assert!(worst < 0.05, "off by {worst} source cells");
        assert!(worst > 0.0, "the lattice was not used");
        let scale = source_cells_per_target_cell(&affine, &to, Some(&projector)).unwrap();
        assert!((scale - 25.0 / (30.87_f64 * 30.87 * 0.684).sqrt()).abs() < 0.02, "{scale}");
    }

    #[test]
    fn issue_2_longitudes_from_0_to_360_and_across_180() {
        let projector = Projector::new(&Crs::Epsg(32601), &Crs::Epsg(4326)).unwrap();
        // 0.2° around 180°, as its west part counts and as its east part does
        let to = target(50, 50, 166_500.0, 5_209_000.0, 100.0);
        let [west_deg, north_deg] = projector.project([166_400.0, 5_212_000.0]).unwrap();
        let mut drawn = Vec::new();
        for turn in [0.0, 360.0, -360.0] {
            let affine = Affine {
                origin_x: nearest_turn(west_deg, 180.0) - 0.05 + turn,
                origin_y: north_deg + 0.05,
                col_dx: 0.001,
                row_dy: -0.001,
                ..NORTH_UP
            };
            let values: Vec<f32> = (0..250 * 200).map(|i| (i % 250) as f32).collect();
            let valid = vec![true; values.len()];
            let source = Source { samples: Samples::new(200, 250, &values, &valid), affine };
            drawn.push(warp_silently(&source, &to, Some(&projector), Kernel::Bilinear));
        }
        assert!(drawn[0].valid.iter().all(|v| *v));
        for other in &drawn[1..] {
            assert_eq!(other.valid, drawn[0].valid);
            let off = |(a, b): (&f32, &f32)| (a - b).abs();
            assert!(other.values.iter().zip(&drawn[0].values).map(off).all(|d| d < 1e-3));
        }
    }

    #[test]
    fn places_without_projection_are_missing() {
        // a target that reaches over the pole: nodes beyond it have no place in UTM's inverse
        let projector = Projector::new(&Crs::Epsg(4326), &Crs::Epsg(32633)).unwrap();
        let affine =
            Affine { origin_x: 400_000.0, origin_y: 1.0e7, col_dx: 1e3, row_dy: -1e3, ..NORTH_UP };
        let values = vec![5.0; 100 * 200];
        let valid = vec![true; values.len()];
        let source = Source { samples: Samples::new(100, 200, &values, &valid), affine };
        let to = target(12, 4, 14.0, 91.0, 0.5);
        let warped = warp_silently(&source, &to, Some(&projector), Kernel::Bilinear);
        assert!(!warped.valid[0] && warped.valid[3 * 4]);
    }

    #[test]
    fn any_number_of_threads_gives_the_same_bits() {
        let projector = Projector::new(&Crs::Epsg(32633), &Crs::Epsg(4326)).unwrap();
        let affine =
            Affine { origin_x: 14.0, origin_y: 47.0, col_dx: 3e-4, row_dy: -2e-4, ..NORTH_UP };
        let values = drawn(&affine, 90, 90, |[x, y]| (x * 1298.98 + y * 782.33).fract() * 50.0);
        let valid: Vec<bool> = (0..values.len()).map(|i| !i.is_multiple_of(11)).collect();
        let source = Source { samples: Samples::new(90, 90, &values, &valid), affine };
        let to = target(120, 130, 423_500.0, 5_205_500.0, 17.0);
        for kernel in [Kernel::Bicubic, Kernel::Average] {
            let run = |threads: usize| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                pool.install(|| warp_silently(&source, &to, Some(&projector), kernel))
            };
            let one = run(1);
            assert!(one.valid.iter().filter(|v| **v).count() > 1000);
            assert_eq!(one, run(2));
        }
    }

    #[test]
    fn cancelling_stops_it() {
        let cancelled = std::sync::Arc::new(std::sync::atomic::AtomicBool::new(true));
        struct Nobody;
        impl crate::progress::Sink for Nobody {
            fn event(&self, _: &crate::progress::Event<'_>) {}
        }
        let reporter = Reporter::new(Box::new(Nobody), cancelled);
        let source = Source { samples: Samples::new(1, 1, &[1.0], &[true]), affine: NORTH_UP };
        let to = target(2, 2, 0.0, 1.0, 0.5);
        assert_eq!(warp(&source, &to, None, Kernel::Bilinear, &reporter), Err(Cancelled));
    }
}
