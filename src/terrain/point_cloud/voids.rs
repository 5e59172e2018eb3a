//! Where a cloud has no returns from land at all: lakes, and land that was not flown.
//!
//! Ground is seldom hit under closed canopy, yet the canopy is; still water gives nothing back, or what
//! is classed as water. So the ground between is interpolated over wide gaps where there are other
//! returns, and over narrow ones, such as brooks, where there are none.

use rayon::prelude::*;

use super::ground::WATER;
use super::layout::cell_index;
use crate::io::las::PointCloud;
use crate::raster::Frame;

/// Empty disks narrower than this many times the points' mean spacing come about by chance.
/// chosen: in points strewn at random one of five spacings is empty with chance exp(−25 π/4), 3e-9.
const CHANCE_SPACINGS: f64 = 5.0;

/// Cells that an empty disk of diameter `max_void_m` reaches, a disk that holds no return but from water
/// and has its centre in a cell of the frame. In sparse clouds the diameter doubles until it is no chance.
pub(super) fn cells(
    cloud: &PointCloud,
    frame: &Frame,
    max_void_m: f64,
    density_per_m2: f64,
) -> Vec<bool> {
    let mut returns = vec![false; frame.len()];
    for index in 0..cloud.len() {
        if cloud.class(index) != WATER {
            let [x, y, _] = cloud.position(index);
            returns[cell_index(frame, x, y)] = true;
        }
    }
    // doubled, not fitted: a part of the cloud, whose density is nearly the whole's, has the same disks
    let mut diameter_m = max_void_m;
    while diameter_m < CHANCE_SPACINGS / density_per_m2.sqrt() {
        diameter_m *= 2.0;
    }
    let radius = diameter_m / 2.0 / frame.transform.cell_m;
    let occupied = within(&returns, frame, radius);
    let centers: Vec<bool> = occupied.iter().map(|near| !near).collect();
    within(&centers, frame, radius)
}

/// Cells whose centre lies at most `radius` cells from the centre of a marked one.
fn within(marked: &[bool], frame: &Frame, radius: f64) -> Vec<bool> {
    let (rows, cols) = (frame.rows, frame.cols);
    // one beyond the circle; `as` saturates, and no column is longer
    let far = (radius as u32).saturating_add(1).min(rows as u32);
    // distance along the column, down from the north, then up from the south
    let mut along = vec![far; rows * cols];
    for row in 0..rows {
        for col in 0..cols {
            let at = row * cols + col;
            let north = if row > 0 { along[at - cols] + 1 } else { far };
            along[at] = if marked[at] { 0 } else { north.min(far) };
        }
    }
    for at in (0..rows.saturating_sub(1) * cols).rev() {
        along[at] = along[at].min(along[at + cols] + 1);
    }
    // how far a column at a given distance may be off to lie within the circle
    let width: Vec<Option<usize>> = (0..=far)
        .map(f64::from)
        .map(|distance| {
            let rest = radius * radius - distance * distance;
            (rest >= 0.0).then(|| rest.sqrt() as usize)
        })
        .collect();
    let mut near = vec![false; rows * cols];
    near.par_chunks_mut(cols).enumerate().for_each(|(row, line)| {
        for col in 0..cols {
            if let Some(width) = width[along[row * cols + col] as usize] {
                let (first, last) = (col.saturating_sub(width), (col + width).min(cols - 1));
                line[first..=last].fill(true);
            }
        }
    });
    near
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::las::Quantization;

    #[test]
    fn within_is_a_euclidean_distance() {
        let frame = Frame::local(23, 31, 1.0);
        let marked: Vec<bool> = (0..frame.len()).map(|i| i * 7919 % 101 == 0).collect();
        for radius in [0.0, 1.0, 1.5, 3.2, 6.0] {
            let near = within(&marked, &frame, radius);
            for (index, near) in near.iter().enumerate() {
                let here = frame.cell(index);
                let brute = (0..frame.len()).filter(|i| marked[*i]).any(|i| {
                    let there = frame.cell(i);
                    let (dr, dc) = (here.row.abs_diff(there.row), here.col.abs_diff(there.col));
                    (dr * dr + dc * dc) as f64 <= radius * radius
                });
                assert_eq!(*near, brute, "{here:?} within {radius}");
            }
        }
    }

    #[test]
    fn issue_2_a_pond_is_a_void_and_a_narrow_brook_is_not() {
        let mut cloud = PointCloud::new([Quantization { scale: 0.01, offset: 0.0 }; 3], None, None);
        let frame = Frame::local(100, 100, 1.0);
        for index in 0..frame.len() {
            let p = frame.transform.center(frame.cell(index));
            let pond = (p.east_m - 30.0).hypot(p.north_m - 30.0) < 12.0;
            let brook = (p.east_m - 70.0).abs() < 4.0;
            if !pond && !brook {
                cloud.push([p.east_m, p.north_m, 0.0], 2);
            }
        }
        let dry = cells(&cloud, &frame, 15.0, 1.0);
        // the same with returns from the water's surface
        for index in (0..frame.len()).step_by(3) {
            let p = frame.transform.center(frame.cell(index));
            let pond = (p.east_m - 30.0).hypot(p.north_m - 30.0) < 12.0;
            if pond || (p.east_m - 70.0).abs() < 4.0 {
                cloud.push([p.east_m, p.north_m, 0.0], WATER);
            }
        }
        let voids = cells(&cloud, &frame, 15.0, 1.0);
        assert_eq!(voids, dry);
        let at = |east: f64, north: f64| voids[cell_index(&frame, east, north)];
        assert!(at(30.5, 30.5) && at(30.5, 40.5) && at(22.5, 23.5));
        assert!(!at(70.5, 50.5) && !at(50.5, 30.5) && !at(30.5, 43.5));
        // sparse points leave such holes by chance
        assert!(!cells(&cloud, &frame, 15.0, 0.02).contains(&true));
    }
}
