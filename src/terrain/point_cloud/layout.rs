//! The grid of a cloud: how wide its cells are, and where they lie.

use super::{Error, Params};
use crate::io::las::{Bounds, PointCloud};
use crate::raster::{Crs, Frame, GeoTransform};

/// Cell widths to choose from, m.
const CELLS_M: [f64; 5] = [0.5, 1.0, 2.0, 5.0, 10.0];
/// Points a cell holds on average at least. chosen: at two, one cell in seven is empty by chance,
/// few enough to fill from neighbours.
const POINTS_PER_CELL: f64 = 2.0;
/// Blocks that tell covered land from empty. chosen: well above the spacing of sparse clouds.
const BLOCK_M: f64 = 10.0;
/// Most such blocks; on larger extents they are widened.
const MAX_BLOCKS: f64 = 4e6;
/// Most that a cloud's extent may be of the land its points cover. chosen: a strip along a river's
/// winding course still passes.
const EMPTINESS_FACTOR: f64 = 100.0;

/// The frame of the cloud's grids.
pub(super) fn frame(
    bounds: &Bounds,
    density_per_m2: f64,
    crs: Crs,
    params: &Params,
) -> Result<Frame, Error> {
    let ([west, south, _], [east, north, _]) = (bounds.min, bounds.max);
    let cell_m = params.cell_m.unwrap_or_else(|| cell_for(density_per_m2));

    // edges snap outwards; a point on the east or south edge belongs to the last cell
    let west_m = (west / cell_m).floor() * cell_m;
    let north_m = (north / cell_m).ceil() * cell_m;
    let cols = ((east - west_m) / cell_m).ceil().max(1.0);
    let rows = ((north_m - south) / cell_m).ceil().max(1.0);
    if cols * rows > params.max_cells as f64 {
        return Err(Error::TooLarge {
            width_m: east - west,
            height_m: north - south,
            cells: (cols * rows) as u64,
            cell_m,
            max_cells: params.max_cells,
        });
    }
    let (rows, cols) = (rows as usize, cols as usize); // whole numbers below max_cells
    Ok(Frame { rows, cols, transform: GeoTransform { west_m, north_m, cell_m }, crs })
}

/// Refuses a cloud with nothing but emptiness between its points, such as one with a stray point.
pub(super) fn check_extent(
    cloud: &PointCloud,
    bounds: &Bounds,
    covered_m2: f64,
) -> Result<(), Error> {
    let ([west, south, _], [east, north, _]) = (bounds.min, bounds.max);
    let (width_m, height_m) = (east - west, north - south);
    let [middle_x, middle_y] = match cloud.middle() {
        Some(middle) if width_m * height_m > EMPTINESS_FACTOR * covered_m2 => middle,
        _ => return Ok(()),
    };
    let distance_m = |index: usize| {
        let [x, y, _] = cloud.position(index);
        ((x - middle_x) * (x - middle_x) + (y - middle_y) * (y - middle_y)).sqrt()
    };
    let distance_km = (0..cloud.len()).map(distance_m).fold(0.0, f64::max) / 1000.0;
    Err(Error::FarPoints { width_m, height_m, covered_m2, distance_km })
}

/// Land that has points, m².
pub(super) fn covered_m2(cloud: &PointCloud, bounds: &Bounds) -> f64 {
    let (min, max) = (bounds.min, bounds.max);
    let (width, height) = (max[0] - min[0], max[1] - min[1]);
    // neither on an area nor on a line are there many more
    let block_m =
        BLOCK_M.max((width * height / MAX_BLOCKS).sqrt()).max(width.max(height) / MAX_BLOCKS);
    let cols = (width / block_m) as usize + 1;
    let rows = (height / block_m) as usize + 1;
    let mut covered = vec![false; rows * cols];
    for index in 0..cloud.len() {
        let [x, y, _] = cloud.position(index);
        let (col, row) = (((x - min[0]) / block_m) as usize, ((y - min[1]) / block_m) as usize);
        covered[row * cols + col] = true;
    }
    let blocks = covered.iter().filter(|c| **c).count();
    // a cloud smaller than a block covers its own extent
    (blocks as f64 * block_m * block_m).min((width * height).max(1.0))
}

/// The smallest cell width that holds enough points, m.
fn cell_for(density_per_m2: f64) -> f64 {
    let enough = |cell: &&f64| density_per_m2 * **cell * **cell >= POINTS_PER_CELL;
    CELLS_M.iter().find(enough).copied().unwrap_or(CELLS_M[CELLS_M.len() - 1])
}

/// Index of the cell a point lies in; points on the outer edges belong to the outermost cells.
#[inline]
pub(super) fn cell_index(frame: &Frame, x: f64, y: f64) -> usize {
    let t = &frame.transform;
    let col = (((x - t.west_m) / t.cell_m) as usize).min(frame.cols - 1); // `as` floors, ≥ 0
    let row = (((t.north_m - y) / t.cell_m) as usize).min(frame.rows - 1);
    row * frame.cols + col
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::las::Quantization;

    fn cloud(points: &[[f64; 3]]) -> PointCloud {
        let mut cloud = PointCloud::new([Quantization { scale: 0.01, offset: 0.0 }; 3], None, None);
        for point in points {
            cloud.push(*point, 2);
        }
        cloud
    }

    fn frame_of(points: &[[f64; 3]], cell_m: Option<f64>) -> Result<Frame, Error> {
        let cloud = cloud(points);
        let bounds = cloud.bounds().unwrap();
        let params = Params { cell_m, ..Params::default() };
        let density_per_m2 = cloud.len() as f64 / covered_m2(&cloud, &bounds);
        frame(&bounds, density_per_m2, Crs::Local, &params)
    }

    #[test]
    fn edges_are_multiples_of_the_cell() {
        let frame = frame_of(&[[101.3, 200.0, 0.0], [104.0, 207.9, 0.0]], Some(2.0)).unwrap();
        assert_eq!((frame.transform.west_m, frame.transform.north_m), (100.0, 208.0));
        assert_eq!((frame.rows, frame.cols), (4, 2));
        assert_eq!(cell_index(&frame, 104.0, 200.0), 7); // on both far edges
        assert_eq!(cell_index(&frame, 101.3, 207.9), 0);
    }

    #[test]
    fn the_cell_follows_the_density() {
        for (density, cell) in [(0.001, 10.0), (0.9, 2.0), (2.0, 1.0), (5.4, 1.0), (8.0, 0.5)] {
            assert_eq!(cell_for(density), cell, "{density} points per m²");
        }
        // 4 points per m² on two patches far apart: the empty land between does not count
        let patch = |x: f64| {
            (0..1600).map(move |i| [x + 0.5 * f64::from(i % 40), 0.5 * f64::from(i / 40), 0.0])
        };
        let points: Vec<_> = patch(0.0).chain(patch(5000.0)).collect();
        let frame = frame_of(&points, None).unwrap();
        assert_eq!(frame.transform.cell_m, 1.0);
    }

    #[test]
    fn issue_2_a_stray_point_is_refused_and_its_distance_told() {
        let mut points: Vec<[f64; 3]> =
            (0..400).map(|i| [f64::from(i % 20), f64::from(i / 20), 0.0]).collect();
        let check = |points: &[[f64; 3]]| {
            let cloud = cloud(points);
            let bounds = cloud.bounds().unwrap();
            check_extent(&cloud, &bounds, covered_m2(&cloud, &bounds))
        };
        assert_eq!(check(&points), Ok(()));
        points.push([190_000.0, 30.0, 0.0]);
        let Err(Error::FarPoints { distance_km, .. }) = check(&points) else {
            panic!("not refused")
        };
        assert!((distance_km - 190.0).abs() < 0.05, "{distance_km}");
        // a winding strip, 60 m wide in 6 km, is none
        let strip: Vec<_> = (0..60_000)
            .map(|i| {
                let along = f64::from(i / 10);
                [along, along + 6.0 * f64::from(i % 10), 0.0]
            })
            .collect();
        assert_eq!(check(&strip), Ok(()));
    }

    #[test]
    fn issue_2_a_line_across_the_solar_system_is_an_error_and_no_giant_grid() {
        for line in [[1.0, 0.0], [0.0, 1.0]] {
            let axis = Quantization { scale: 1000.0, offset: 0.0 };
            let mut cloud = PointCloud::new([axis; 3], None, None);
            for end_m in [0.0, 2.1e12] {
                cloud.push([line[0] * end_m, line[1] * end_m, 0.0], 2);
            }
            let bounds = cloud.bounds().unwrap();
            let covered_m2 = covered_m2(&cloud, &bounds);
            let frame = frame(&bounds, 2.0 / covered_m2, Crs::Local, &Params::default());
            assert!(matches!(frame, Err(Error::TooLarge { .. })), "{frame:?}");
        }
    }

    #[test]
    fn a_point_far_off_is_an_error_and_no_giant_grid() {
        let frame = frame_of(&[[0.0; 3], [2e7, 2e7, 0.0]], Some(1.0));
        assert!(matches!(frame, Err(Error::TooLarge { .. })));
    }
}
