//! Valley floors: gravel and loam fill the river's notch, and the river lies in a bed of its own.

use rayon::prelude::*;

use super::drainage::Drainage;
#[cfg(test)]
use super::drainage::for_neighbours;
use super::extent::Extent;
use super::noise::by_rows;

/// How the main river shapes its valley.
#[derive(Clone, Copy, Debug)]
pub struct Floor {
    /// Drained area from which a stream fills its valley.
    pub stream_area_m2: f32,
    /// Depth of the fill where the largest river runs.
    pub max_fill_m: f32,
    /// Depth of the bed below the floor where the largest river runs.
    pub max_bed_m: f32,
    /// Half width of the bed where the largest river runs.
    pub max_half_width_m: f32,
}

/// Least fall of a floor along its stream, rise over run; chosen: gravel rivers of hills fall 0.2–2 %.
const FLOOR_SLOPE: f32 = 0.005;

/// Height of the rises a river bends around, as a share of the fill; chosen: bends stay on the floor.
const BEND_RISE: f32 = 0.25;

/// Fills the valleys of large streams to level floors with soft feet of slopes, lets the rivers bend on them
/// around the rises of `bends` (−1..1), then cuts their beds.
pub fn shape(
    height_m: &mut Vec<f32>,
    bends: &[f32],
    wobble: &[u32],
    outlets: &[u32],
    extent: &Extent,
    floor: &Floor,
) {
    let drainage = Drainage::of(height_m, wobble, outlets, extent);
    let largest = drainage.area_m2.iter().copied().fold(0.0, f32::max);
    let span = (largest.sqrt() - floor.stream_area_m2.sqrt()).max(1e-3);
    // 0 for the least stream, 1 for the largest river; width and depth grow as the root of the area
    let size_of =
        |area_m2: f32| ((area_m2.sqrt() - floor.stream_area_m2.sqrt()) / span).clamp(0.0, 1.0);
    let is_stream = |cell: usize| drainage.area_m2[cell] >= floor.stream_area_m2;

    // the floor's level: that of the next stream downhill
    let mut level_m = vec![f32::NEG_INFINITY; extent.len()];
    let mut fill_m = vec![0.0_f32; extent.len()];
    for &cell in &drainage.order {
        let cell = cell as usize;
        let receiver = drainage.receiver[cell] as usize;
        if is_stream(cell) {
            let fill = floor.max_fill_m * size_of(drainage.area_m2[cell]);
            // where a large river's fill dams a side valley, that fills as well
            let run_m = drainage.step_cells[cell] * extent.cell_m as f32;
            level_m[cell] = (height_m[cell] + fill).max(level_m[receiver] + FLOOR_SLOPE * run_m);
            fill_m[cell] = level_m[cell] - height_m[cell];
        } else {
            (fill_m[cell], level_m[cell]) = (fill_m[receiver], level_m[receiver]);
        }
    }
    let filled: Vec<f32> = height_m
        .par_iter()
        .zip(&level_m)
        .zip(&fill_m)
        .map(|((&z, &level), &fill)| if fill > 0.0 { soft_max(z, level, 0.6 * fill) } else { z })
        .collect();
    // neighbouring paths meet the stream at different places: even out the steps on the floor
    let weight: Vec<f32> = filled
        .par_iter()
        .zip(&level_m)
        .zip(&fill_m)
        .map(
            |((&z, &level), &fill)| {
                if fill > 0.0 { (1.5 - (z - level) / fill).clamp(0.0, 1.0) } else { 0.0 }
            },
        )
        .collect();
    *height_m = smooth(filled, &weight, extent);

    // the river finds its way anew, around low rises that the floor itself does not keep
    let wavy: Vec<f32> = height_m
        .par_iter()
        .zip(&weight)
        .zip(bends.par_iter().zip(&fill_m))
        .map(|((z, w), (bend, fill))| z + BEND_RISE * fill * w * bend)
        .collect();
    let winding = Drainage::of(&wavy, wobble, outlets, extent);
    cut_beds(height_m, &winding, extent, floor, &size_of);
}

/// The larger of two, rounded within `width`: never below the larger, never more than a quarter of `width` above it.
fn soft_max(a: f32, b: f32, width: f32) -> f32 {
    let overlap = (width - (a - b).abs()).max(0.0);
    a.max(b) + overlap * overlap / (4.0 * width)
}

/// Passes of a five-point mean, as strong as each cell's weight.
fn smooth(mut values: Vec<f32>, weight: &[f32], extent: &Extent) -> Vec<f32> {
    // chosen: evens steps over about 10 m at 2 m cells
    let passes = ((200.0 / (extent.cell_m * extent.cell_m)) as usize).clamp(2, 60);
    for _ in 0..passes {
        values = by_rows(extent, |row, out| {
            let line = |r: usize| &values[r * extent.cols..][..extent.cols];
            let here = line(row);
            let (north, south) =
                (line(row.saturating_sub(1)), line((row + 1).min(extent.rows - 1)));
            for (col, value) in out.iter_mut().enumerate() {
                let (west, east) =
                    (here[col.saturating_sub(1)], here[(col + 1).min(extent.cols - 1)]);
                let mean = (north[col] + south[col] + west + east) / 4.0;
                let w = 0.8 * weight[row * extent.cols + col];
                *value = here[col] + w * (mean - here[col]);
            }
        });
    }
    values
}

/// Half width of the level bottom of a bed: a smooth course passes between cell centres, and some must lie in it.
const CORE_CELLS: f32 = 0.75;

/// Cuts parabolic beds along the streams, falling all the way to the outlet.
fn cut_beds(
    height_m: &mut [f32],
    drainage: &Drainage,
    extent: &Extent,
    floor: &Floor,
    size_of: &dyn Fn(f32) -> f32,
) {
    let cell_m = extent.cell_m as f32;
    let surface = height_m.to_vec();
    let courses = smooth_courses(drainage, extent, floor.stream_area_m2);
    let mut bed_m = vec![f32::INFINITY; extent.len()];
    // upstream first, so that a bed never climbs downstream
    for &(cell, [x, y]) in courses.iter().rev() {
        let size = size_of(drainage.area_m2[cell]);
        let depth_m = floor.max_bed_m * (0.1 + 0.9 * size);
        bed_m[cell] = bed_m[cell].min(surface[cell] - depth_m);
        let receiver = drainage.receiver[cell] as usize;
        if receiver != cell {
            bed_m[receiver] = bed_m[receiver].min(bed_m[cell] - 1e-4);
        }
        let half_width_m = (floor.max_half_width_m * (0.3 + 0.7 * size)).max(0.5 * cell_m);
        let reach = CORE_CELLS + half_width_m / cell_m;
        // `as` cuts negatives to 0: the extent's edge
        let span = |at: f32, count: usize| {
            (at - reach).ceil() as usize..((at + reach).floor() as usize + 1).min(count)
        };
        for row in span(y, extent.rows) {
            for col in span(x, extent.cols) {
                let (right, down) = (col as f32 - x, row as f32 - y);
                let distance = (right * right + down * down).sqrt();
                if distance < reach {
                    let bank = ((distance - CORE_CELLS) / (reach - CORE_CELLS)).max(0.0);
                    let at = row * extent.cols + col;
                    let ceiling = bed_m[cell] + depth_m * bank * bank;
                    height_m[at] = height_m[at].min(ceiling);
                }
            }
        }
    }
}

/// The streams' cells from the outlet upstream, each with its place (column, row) on a course without the
/// corners of the grid's eight directions.
fn smooth_courses(
    drainage: &Drainage,
    extent: &Extent,
    stream_area_m2: f32,
) -> Vec<(usize, [f32; 2])> {
    /// Passes of averaging along the stream; chosen: takes out bends of some ten cells.
    const PASSES: usize = 25;
    let cells: Vec<usize> = drainage.order.iter().map(|&cell| cell as usize).collect();
    let cells: Vec<usize> =
        cells.into_iter().filter(|&cell| drainage.area_m2[cell] >= stream_area_m2).collect();
    let mut slot = vec![usize::MAX; extent.len()];
    for (i, &cell) in cells.iter().enumerate() {
        slot[cell] = i;
    }
    // receivers of streams are streams: area only grows
    let down: Vec<usize> =
        cells.iter().map(|&cell| slot[drainage.receiver[cell] as usize]).collect();
    let mut up: Vec<Option<usize>> = vec![None; cells.len()];
    for (i, &to) in down.iter().enumerate() {
        let area = |slot: usize| drainage.area_m2[cells[slot]];
        if to != i && up[to].is_none_or(|other| area(other) < area(i)) {
            up[to] = Some(i);
        }
    }
    let mut place: Vec<[f32; 2]> = cells
        .iter()
        .map(|cell| [(cell % extent.cols) as f32, (cell / extent.cols) as f32])
        .collect();
    for _ in 0..PASSES {
        let before = place.clone();
        for (i, place) in place.iter_mut().enumerate() {
            if let Some(up) = up[i] {
                for (axis, at) in place.iter_mut().enumerate() {
                    *at = 0.5 * *at + 0.25 * (before[up][axis] + before[down[i]][axis]);
                }
            }
        }
    }
    cells.into_iter().zip(place).collect()
}

#[cfg(test)]
/// Cells without a lower neighbour, edges not counted.
pub fn pits(height_m: &[f32], extent: &Extent) -> usize {
    (1..extent.rows.saturating_sub(1))
        .flat_map(|row| (1..extent.cols.saturating_sub(1)).map(move |col| (row, col)))
        .filter(|&(row, col)| {
            let z = height_m[row * extent.cols + col];
            let mut lowest = f32::INFINITY;
            for_neighbours(row, col, extent, |_, n| lowest = lowest.min(height_m[n]));
            lowest >= z
        })
        .count()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn soft_max_is_the_larger_far_off_and_a_quarter_above_where_equal() {
        assert_eq!(soft_max(9.0, 1.0, 4.0), 9.0);
        assert_eq!(soft_max(1.0, 9.0, 4.0), 9.0);
        assert_eq!(soft_max(5.0, 5.0, 4.0), 6.0);
    }

    #[test]
    fn a_notch_becomes_a_floor_with_a_falling_bed() {
        let extent = Extent { rows: 60, cols: 41, cell_m: 2.0, west_m: 0.0, north_m: 120.0 };
        let mut height: Vec<f32> = (0..extent.len())
            .map(|i| 0.05 * (60 - i / 41) as f32 + 0.4 * (i % 41_usize).abs_diff(20) as f32)
            .collect();
        let level = vec![0.0; extent.len()];
        let floor =
            Floor { stream_area_m2: 400.0, max_fill_m: 4.0, max_bed_m: 1.0, max_half_width_m: 3.0 };
        shape(&mut height, &level, &vec![0; extent.len()], &[59 * 41 + 20], &extent, &floor);
        let row = &height[50 * 41..][..41];
        assert!((row[23] - row[24]).abs() < 0.12, "the floor is level: {row:?}");
        assert!(row[20] < row[23] - 0.4, "the bed lies below the floor: {row:?}");
        assert!(row[36] - row[35] > 0.3, "slopes stay: {row:?}");
        // the last cells before the working edge are cut off the map
        let bed = |row: usize| height[row * 41 + 20];
        assert!(
            (5..55).all(|row| bed(row + 1) < bed(row)),
            "{:?}",
            (0..60).map(bed).collect::<Vec<_>>()
        );
    }
}
