//! Rivers as lines: smooth, wider and stronger with discharge.

use rayon::prelude::*;

use crate::math::ln;
use crate::raster::Grid;

/// Streams below this share of the largest discharge are not drawn where no river cells are named.
const LEAST_DISCHARGE_FRACTION: f32 = 0.01;
/// Line width of the least stream.
const THIN_PX: f32 = 1.0;
/// Line width of the largest river.
const WIDE_PX: f32 = 4.2;
/// Opacity of the least stream.
const FAINT: f32 = 0.5;
/// Times positions are averaged with their neighbours along the stream: hides the grid's eight directions.
const SMOOTHING_PASSES: usize = 10;

/// Most cells drawn as reaches, those of the largest discharge; chosen: more would cover the map.
const MOST_REACHES: usize = 200_000;

/// A cell of a drawn stream.
struct Reach {
    cell: usize,
    discharge_m3_s: f32,
    /// Place in pixels.
    at: [f32; 2],
    /// The reach downstream, and the largest one upstream.
    downstream: Option<usize>,
    upstream: Option<usize>,
}

/// How much of each of `rows` × `cols` pixels is river, 0..=1.
/// Drawn are the cells flagged in `river`, or without flags those of the largest discharges.
pub fn coverage(
    discharge_m3_s: &Grid<f32>,
    river: Option<&[bool]>,
    rows: usize,
    cols: usize,
) -> Vec<f32> {
    let frame = discharge_m3_s.frame();
    let per_cell = [cols as f32 / frame.cols.max(1) as f32, rows as f32 / frame.rows.max(1) as f32];
    let mut drawn = vec![0.0_f32; rows * cols];
    let mut reaches = reaches(discharge_m3_s, river, per_cell);
    let Some(largest) = reaches.iter().map(|r| r.discharge_m3_s).reduce(f32::max) else {
        return drawn;
    };
    let least = reaches.iter().map(|r| r.discharge_m3_s).fold(largest, f32::min);
    let least = least.max(1e-3 * LEAST_DISCHARGE_FRACTION * largest).max(f32::MIN_POSITIVE);
    for _ in 0..SMOOTHING_PASSES {
        smooth(&mut reaches);
    }
    let span = ln((largest / least).max(1.0 + 1e-3));
    for reach in &reaches {
        let size = (ln((reach.discharge_m3_s / least).max(1.0)) / span).clamp(0.0, 1.0);
        let to = reach.downstream.map_or(reach.at, |d| reaches[d].at);
        let width = THIN_PX + size * (WIDE_PX - THIN_PX);
        let opacity = FAINT + (1.0 - FAINT) * size;
        stroke(&mut drawn, rows, cols, reach.at, to, width, opacity);
    }
    drawn
}

fn reaches(discharge: &Grid<f32>, river: Option<&[bool]>, per_cell: [f32; 2]) -> Vec<Reach> {
    let frame = discharge.frame();
    let q = discharge.values();
    let valid = |cell: usize| discharge.mask().is_valid(cell);
    let largest = discharge.valid_values().copied().fold(0.0_f32, f32::max);
    let chosen = |cell: usize| {
        valid(cell)
            && match river {
                Some(flags) => flags.get(cell).copied().unwrap_or(false),
                None => q[cell] > 0.0 && q[cell] >= LEAST_DISCHARGE_FRACTION * largest,
            }
    };
    let mut cells: Vec<usize> = (0..frame.len()).into_par_iter().filter(|&c| chosen(c)).collect();
    if cells.len() > MOST_REACHES {
        let place = cells.len() - MOST_REACHES;
        cells.select_nth_unstable_by(place, |&a, &b| q[a].total_cmp(&q[b]).then(a.cmp(&b)));
        cells.drain(..place);
        cells.sort_unstable();
    }
    let mut reaches: Vec<Reach> = cells
        .iter()
        .map(|&cell| {
            let at = frame.cell(cell);
            Reach {
                cell,
                discharge_m3_s: q[cell],
                at: [(at.col as f32 + 0.5) * per_cell[0], (at.row as f32 + 0.5) * per_cell[1]],
                downstream: None,
                upstream: None,
            }
        })
        .collect();
    // water goes on where there is more of it, by the least increase: discharge grows step by step downstream
    let downstream: Vec<Option<usize>> = reaches
        .par_iter()
        .map(|reach| {
            let at = frame.cell(reach.cell);
            let next = (at.row.saturating_sub(1)..(at.row + 2).min(frame.rows))
                .flat_map(|r| {
                    (at.col.saturating_sub(1)..(at.col + 2).min(frame.cols))
                        .map(move |c| r * frame.cols + c)
                })
                .filter(|&n| n != reach.cell && q[n] > reach.discharge_m3_s && chosen(n))
                .min_by(|&a, &b| q[a].total_cmp(&q[b]));
            next.and_then(|n| cells.binary_search(&n).ok())
        })
        .collect();
    for (giver, receiver) in downstream.into_iter().enumerate() {
        reaches[giver].downstream = receiver;
        if let Some(receiver) = receiver {
            let larger = reaches[receiver]
                .upstream
                .is_none_or(|u| reaches[u].discharge_m3_s < reaches[giver].discharge_m3_s);
            if larger {
                reaches[receiver].upstream = Some(giver);
            }
        }
    }
    reaches
}

fn smooth(reaches: &mut [Reach]) {
    let places: Vec<[f32; 2]> = reaches.iter().map(|r| r.at).collect();
    for reach in reaches {
        if let (Some(up), Some(down)) = (reach.upstream, reach.downstream) {
            for (axis, at) in reach.at.iter_mut().enumerate() {
                *at = 0.5 * *at + 0.25 * (places[up][axis] + places[down][axis]);
            }
        }
    }
}

/// Lays a line with round ends over what is drawn; where lines meet the stronger shows.
fn stroke(
    drawn: &mut [f32],
    rows: usize,
    cols: usize,
    [ax, ay]: [f32; 2],
    [bx, by]: [f32; 2],
    width: f32,
    opacity: f32,
) {
    let reach = width / 2.0 + 1.0;
    // `as` cuts negatives to 0: the sheet's edge
    let (left, right) = ((ax.min(bx) - reach) as usize, (ax.max(bx) + reach) as usize);
    let (top, bottom) = ((ay.min(by) - reach) as usize, (ay.max(by) + reach) as usize);
    let (dx, dy) = (bx - ax, by - ay);
    let length2 = (dx * dx + dy * dy).max(1e-12);
    for row in top..=bottom.min(rows.saturating_sub(1)) {
        for col in left..=right.min(cols.saturating_sub(1)) {
            let (px, py) = (col as f32 + 0.5 - ax, row as f32 + 0.5 - ay);
            let t = ((px * dx + py * dy) / length2).clamp(0.0, 1.0);
            let (ox, oy) = (px - t * dx, py - t * dy);
            let inside = width / 2.0 + 0.5 - (ox * ox + oy * oy).sqrt();
            let pixel = &mut drawn[row * cols + col];
            *pixel = pixel.max(inside.clamp(0.0, 1.0) * opacity);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_river_is_a_widening_line() {
        // flows east along row 4, growing
        let grid =
            Grid::from_fn(9, 40, 1.0, |c| if c.row == 4 { 0.05 + c.col as f32 * 0.1 } else { 0.0 });
        let drawn = coverage(&grid, None, 90, 400);
        let width_at = |col: usize| (0..90).map(|row| drawn[row * 400 + col]).sum::<f32>();
        assert!(width_at(380) > 3.0 && width_at(380) < 5.0, "{}", width_at(380));
        assert!(width_at(20) < width_at(200) && width_at(200) < width_at(380));
        assert_eq!(drawn[10 * 400 + 200], 0.0);
        assert!((6..394).all(|col| width_at(col) > 0.0), "no gaps");
    }

    #[test]
    fn only_flagged_cells_are_drawn() {
        let grid = Grid::from_fn(10, 10, 1.0, |_| 1.0);
        assert!(coverage(&grid, Some(&[false; 100]), 10, 10).iter().all(|c| *c == 0.0));
        let mut flags = [false; 100];
        flags[55] = true;
        assert!(coverage(&grid, Some(&flags), 10, 10)[55] > 0.4);
    }
}
