//! Ground and canopy surfaces of a classified point cloud.
//!
//! Reading order: [`Params`] and [`surfaces`] here, `layout` (the grid), `ground` (which ground points count),
//! `triangulation` (points to DEM), `voids` (what stays masked), `canopy` (highest returns to DSM and CHM), [`synthetic`] (a made-up cloud).

mod canopy;
mod ground;
mod layout;
pub mod synthetic;
mod triangulation;
mod voids;

use std::sync::Arc;

use crate::io::las::PointCloud;
use crate::progress::{Cancelled, Reporter};
use crate::raster::{Crs, Grid, Mask};

/// How a cloud becomes surfaces.
#[derive(Clone, Debug, PartialEq)]
pub struct Params {
    /// Cell width, m; `None` takes the smallest of 0.5, 1, 2, 5, 10 m that holds two points on average
    /// (where there are points at all).
    pub cell_m: Option<f64>,
    /// Widest disk without ground points, m across, over which ground is interpolated.
    /// Default 40, chosen: under closed canopy the ground is hit every few metres, and houses are narrower.
    pub max_gap_m: f64,
    /// Widest disk without any return, m across, over which ground is interpolated; in sparse clouds
    /// at least five mean spacings.
    /// Default 15, chosen: brooks and wet roads are narrower, and water that is wider is masked.
    pub max_void_m: f64,
    /// Returns higher above ground than this, m, are birds or clouds.
    /// Default 120, chosen: the tallest tree on Earth stands 116 m.
    pub max_canopy_height_m: f32,
    /// Most cells of the grid.
    pub max_cells: usize,
}

/// Cells beyond which a surface is not changed: spikes look one cell about, pits two, fills three metres.
const REACH_CELLS: f64 = 10.0;
/// Cell width where none is given, at most, m.
const WIDEST_CELL_M: f64 = 10.0;

impl Params {
    /// How far points bear on surfaces, m: over the widest gap, as judges of ground points there, and a
    /// few cells on. Clouds of less than a ground point in 25 m² reach a little farther.
    pub fn reach_m(&self) -> f64 {
        self.max_gap_m.max(self.max_void_m)
            + ground::REACH_M
            + REACH_CELLS * self.cell_m.unwrap_or(WIDEST_CELL_M)
    }
}

impl Default for Params {
    fn default() -> Self {
        Self {
            cell_m: None,
            max_gap_m: 40.0,
            max_void_m: 15.0,
            max_canopy_height_m: 120.0,
            max_cells: crate::io::Limits::default().max_cells,
        }
    }
}

/// Surfaces of a cloud on one frame; each has its own mask.
#[derive(Clone, Debug)]
pub struct CloudSurfaces {
    /// Bare earth, m; masked on water, in gaps wider than [`Params`] allow, and outside the points.
    pub dem_m: Grid<f32>,
    /// Highest return, m, buildings and wires included; masked where there are none nearby.
    pub dsm_m: Grid<f32>,
    /// Canopy height above the DEM, m, ≥ 0; buildings, wires and bridges count as no canopy.
    pub chm_m: Grid<f32>,
}

/// Why a cloud gives no surfaces.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
#[allow(missing_docs, reason = "the message tells what the fields are")]
pub enum Error {
    /// No ground class.
    #[error(
        "none of the cloud's {points} points is classed as ground (class 2); classify it first (`pdal ground in.laz out.laz`, or LAStools `lasground`), or give a DEM"
    )]
    NoGround { points: usize },
    /// Ground points, but no surface.
    #[error(
        "the cloud's {ground_points} ground points lie too far apart for a surface; no gap may be wider than {max_gap_m} m: give a denser cloud, or a DEM"
    )]
    GroundTooSparse { ground_points: usize, max_gap_m: f64 },
    /// No points.
    #[error("the cloud has no points; give another, or check --bbox")]
    NoPoints,
    /// Too many cells.
    #[error(
        "the cloud spans {width_m:.0} × {height_m:.0} m, {cells} cells of {cell_m} m, more than the limit of {max_cells}; give --bbox or a larger --cell, and check it for points far off"
    )]
    TooLarge { width_m: f64, height_m: f64, cells: u64, cell_m: f64, max_cells: usize },
    /// Points with nothing but emptiness between them.
    #[error(
        "the cloud spans {width_m:.0} × {height_m:.0} m, but its points cover only {covered_m2:.0} m² of that; some lie {distance_km:.1} km from the others: give --bbox (west,south,east,north) around the points that are wanted"
    )]
    FarPoints { width_m: f64, height_m: f64, covered_m2: f64, distance_km: f64 },
    /// A parameter out of its range.
    #[error(
        "{name} must be a positive number of metres, not {value}; leave it out for the default"
    )]
    Parameter { name: &'static str, value: f64 },
    /// The run was cancelled.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

/// DEM, DSM and CHM of a cloud whose coordinates are metres (see [`PointCloud::to_metres`]) of `crs`.
///
/// The grid's edges are multiples of its cell in map coordinates, so grids of neighbouring clouds fit.
///
/// # Errors
/// If the cloud has no points or no ground, spans too much, or the run was cancelled.
pub fn surfaces(
    cloud: &PointCloud,
    crs: Crs,
    params: &Params,
    reporter: &Reporter,
) -> Result<CloudSurfaces, Error> {
    for (name, value) in [
        ("the cell", params.cell_m.unwrap_or(1.0)),
        ("the largest gap", params.max_gap_m),
        ("the largest void", params.max_void_m),
        ("the largest canopy height", f64::from(params.max_canopy_height_m)),
    ] {
        if !(value.is_finite() && value > 0.0) {
            return Err(Error::Parameter { name, value });
        }
    }
    let bounds = cloud.bounds().ok_or(Error::NoPoints)?;
    let covered_m2 = layout::covered_m2(cloud, &bounds);
    layout::check_extent(cloud, &bounds, covered_m2)?;
    let density_per_m2 = cloud.len() as f64 / covered_m2;
    let frame = Arc::new(layout::frame(&bounds, density_per_m2, crs, params)?);
    let ground = ground::points(cloud, &frame, reporter)?;
    let surface = triangulation::interpolate(&ground, &frame, params.max_gap_m, reporter)?;
    let voids = voids::cells(cloud, &frame, params.max_void_m, density_per_m2);
    let known = surface.mask().as_slice().iter().zip(&voids).map(|(valid, void)| *valid && !void);
    let mask = Arc::new(Mask::new(known.collect()));
    let dem_m = Grid::new(Arc::clone(&frame), mask, surface.into_values());
    if dem_m.mask().valid_count() == 0 {
        let (ground_points, max_gap_m) = (ground.len(), params.max_gap_m);
        return Err(Error::GroundTooSparse { ground_points, max_gap_m });
    }
    reporter.check_cancelled()?;
    let (dsm_m, chm_m) = canopy::surfaces(cloud, &dem_m, params.max_canopy_height_m, reporter);
    Ok(CloudSurfaces { dem_m, dsm_m, chm_m })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::Limits;
    use crate::io::las::{self, Quantization};
    use crate::raster::MapPoint;

    #[test]
    fn a_made_up_forest_gives_its_ground_and_its_trees_back() {
        let cloud = synthetic::forest(3, 200.0, 4.0);
        let reporter = Reporter::silent();
        let made = surfaces(&cloud, Crs::Epsg(32633), &Params::default(), &reporter).unwrap();
        let frame = made.dem_m.frame();
        assert_eq!((frame.rows, frame.cols, frame.transform.cell_m), (200, 200, 1.0));
        let mut squares = 0.0;
        for index in (0..frame.len()).filter(|i| made.dem_m.mask().is_valid(*i)) {
            let MapPoint { east_m, north_m } = frame.transform.center(frame.cell(index));
            let truth = synthetic::ground_elevation_m(MapPoint { east_m, north_m });
            squares += (f64::from(made.dem_m.values()[index]) - truth).powi(2);
        }
        let rmse_m = (squares / made.dem_m.mask().valid_count() as f64).sqrt();
        assert!(rmse_m < 0.05, "{rmse_m} m");
        assert!(made.dem_m.mask().valid_count() > 39_500);
        let (low, high) = made.chm_m.range().unwrap();
        assert!(low == 0.0 && (22.0..29.0).contains(&high), "{low} {high}");
        let covered = made.chm_m.valid_values().filter(|h| **h > 3.0).count() as f64;
        assert!((0.3..0.8).contains(&(covered / 40_000.0)), "{covered}");
    }

    #[test]
    fn one_and_two_threads_give_the_same_bits() {
        let cloud = synthetic::forest(4, 120.0, 9.0);
        let run = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let params = Params { cell_m: Some(0.25), ..Params::default() };
            pool.install(|| surfaces(&cloud, Crs::Local, &params, &Reporter::silent())).unwrap()
        };
        let (one, two) = (run(1), run(2));
        for (a, b) in [(&one.dem_m, &two.dem_m), (&one.dsm_m, &two.dsm_m), (&one.chm_m, &two.chm_m)]
        {
            assert_eq!(a.mask(), b.mask());
            let bits = |g: &Grid<f32>| g.values().iter().map(|v| v.to_bits()).collect::<Vec<_>>();
            assert!(bits(a) == bits(b), "values differ between one and two threads");
        }
    }

    #[test]
    fn what_cannot_be_done_is_said() {
        let axes = [Quantization { scale: 0.01, offset: 0.0 }; 3];
        let run = |points: &[[f64; 3]], params: &Params| {
            let mut cloud = crate::io::las::PointCloud::new(axes, None, None);
            points.iter().for_each(|p| cloud.push(*p, 2));
            surfaces(&cloud, Crs::Local, params, &Reporter::silent()).map(|_| ()).unwrap_err()
        };
        let default = Params::default();
        assert_eq!(run(&[], &default), Error::NoPoints);
        let line = [[0.0, 0.0, 1.0], [1.0, 1.0, 1.0], [2.0, 2.0, 1.0]];
        let fine = Params { cell_m: Some(0.5), ..Params::default() };
        let sparse = Error::GroundTooSparse { ground_points: 3, max_gap_m: 40.0 };
        assert_eq!(run(&line, &fine), sparse);
        for bad in [0.0, -1.0, f64::NAN] {
            let params = Params { cell_m: Some(bad), ..Params::default() };
            assert!(matches!(run(&line, &params), Error::Parameter { .. }));
        }
    }

    /// Mean elevation and canopy height of a rectangle, and share of its cells with a CHM.
    fn figures(made: &CloudSurfaces, [west, south, east, north]: [f64; 4]) -> [f64; 3] {
        let frame = made.dem_m.frame();
        let inside: Vec<usize> = (0..frame.len())
            .filter(|i| {
                let p = frame.transform.center(frame.cell(*i));
                p.east_m > west && p.east_m < east && p.north_m > south && p.north_m < north
            })
            .collect();
        let mean = |grid: &Grid<f32>| {
            let known: Vec<f64> = inside
                .iter()
                .filter(|i| grid.mask().is_valid(**i))
                .map(|i| f64::from(grid.values()[*i]))
                .collect();
            (known.iter().sum::<f64>() / known.len() as f64, known.len())
        };
        let ((dem, _), (chm, known)) = (mean(&made.dem_m), mean(&made.chm_m));
        [dem, chm, known as f64 / inside.len() as f64]
    }

    /// Means of the same rectangles in grids others made of the same clouds (lasR, pyfor, lidR).
    /// Theirs keep the pits, so their canopies are some 0.3 m lower.
    #[test]
    fn real_clouds_agree_with_other_programs() {
        let Some(folder) = las::tests::data() else { return };
        for (name, rectangle, dem_m, chm_m, known) in [
            ("bcts_1.laz", [885_060.0, 629_200.0, 885_160.0, 629_300.0], 329.783, 8.151, 1.0),
            ("osbs.laz", [405_020.0, 3_276_320.0, 405_180.0, 3_276_480.0], 38.539, 5.224, 1.0),
            (
                "quebec_topography.laz",
                [273_560.0, 5_274_460.0, 273_640.0, 5_274_560.0],
                805.441,
                4.340,
                0.975,
            ),
        ] {
            let cloud = las::read(&folder.join(name), None, &Limits::default()).unwrap();
            let params = Params { cell_m: Some(1.0), ..Params::default() };
            let made = surfaces(&cloud, Crs::Local, &params, &Reporter::silent()).unwrap();
            let [dem, chm, share] = figures(&made, rectangle);
            assert!((dem - dem_m).abs() < 0.1, "{name}: {dem} m, not {dem_m}");
            assert!((0.1..0.4).contains(&(chm - chm_m)), "{name}: {chm} m, not {chm_m}");
            assert!((share - known).abs() < 0.01, "{name}: {share}");
        }
    }

    #[test]
    fn issue_2_lakes_stay_masked_with_returns_and_without() {
        let Some(folder) = las::tests::data() else { return };
        let path = folder.join("quebec_topography.laz");
        let cloud = las::read(&path, None, &Limits::default()).unwrap();
        let params = Params { cell_m: Some(1.0), ..Params::default() };
        let made = surfaces(&cloud, Crs::Local, &params, &Reporter::silent()).unwrap();
        let at = |row, col| made.dem_m.get(crate::raster::Cell { row, col });
        assert_eq!((at(60, 110), at(130, 75), at(150, 195)), (None, None, None));
        // a lake with returns, classed as water
        assert_eq!((at(220, 20), at(200, 30)), (None, None));
        assert!(made.dem_m.mask().valid_count() > 30_000);
    }
}
