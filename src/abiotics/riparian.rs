//! Land along channels: its height above the nearest drainage, and the channel water its soil takes up.
//!
//! Beside a channel with water the water table lies near the surface and keeps part of the root zone
//! full. With weight w (1 at the channel's level, 0 at the reach) and the share f of the demand its flow
//! can meet that month,
//!
//! ```text
//! moisture      M' = M + w f (capacity − M)
//! transpiration T' = demand · M' / capacity, so T' − T = w f demand (1 − M / capacity)
//! ```
//!
//! and T' − T is taken from the channel's discharge, there and all the way down: water stays conserved.
//! Where a channel begins does not depend on the weather, so a drought moves no bank; it lowers f.
//!
//! # Reference
//! Height above nearest drainage: Rennó et al. 2008, "HAND, a new terrain descriptor using SRTM-DEM",
//! Remote Sensing of Environment 112(9), doi:10.1016/j.rse.2008.03.018; Nobre et al. 2011, "Height Above
//! the Nearest Drainage", Journal of Hydrology 404, doi:10.1016/j.jhydrol.2011.03.051.

use rayon::prelude::*;

use crate::progress::{Cancelled, Reporter};
use crate::raster::{Cell, MONTHS};

use super::drainage::{self, DrainageSurface, NEIGHBOURS};
use super::routing::{ChannelCell, LEAVES_MAP};

/// Marks an entry of [`NearestDrainage::target`] as an index of a channel cell, not of a map cell.
const CHANNEL: u32 = 1 << 31;
const UNKNOWN: u32 = u32::MAX;

/// Way down of a cell whose water leaves the map, and of one that is masked; others are directions.
const OUTWARD: u8 = 8;
const MASKED: u8 = 9;

/// Cells between two looks at the cancel flag.
const CANCEL_INTERVAL: usize = 1 << 20;

/// The steepest way down from each cell: a direction of [`NEIGHBOURS`], [`OUTWARD`] or [`MASKED`].
fn ways_down(surface: &DrainageSurface) -> Vec<u8> {
    let cols = surface.cols();
    let way_down = |index: usize| {
        let cell = Cell { row: index / cols, col: index % cols };
        if surface.height_m(cell) == f32::INFINITY {
            return MASKED;
        }
        surface.descent(cell).steepest_inward().map_or(OUTWARD, |direction| direction as u8)
    };
    (0..surface.rows() * cols).into_par_iter().map(way_down).collect()
}

/// Where each cell's water first meets a channel, or else leaves the map.
pub(super) struct NearestDrainage {
    target: Vec<u32>,
}

impl NearestDrainage {
    /// Follows the steepest way down from every valid cell.
    ///
    /// # Errors
    /// [`Cancelled`] once the run was cancelled.
    pub fn new(
        surface: &DrainageSurface,
        channels: &[ChannelCell],
        reporter: &Reporter,
    ) -> Result<Self, Cancelled> {
        let cols = surface.cols();
        let ways_down = ways_down(surface);
        reporter.check_cancelled()?;
        let mut target = vec![UNKNOWN; surface.rows() * cols];
        for (i, channel) in channels.iter().enumerate() {
            target[channel.cell as usize] = CHANNEL | i as u32; // fewer than cells
        }
        let steps = NEIGHBOURS.map(|(row, col)| row * cols as isize + col);
        let mut path = Vec::new();
        for start in 0..target.len() {
            if start % CANCEL_INTERVAL == 0 {
                reporter.check_cancelled()?;
            }
            if ways_down[start] == MASKED {
                continue;
            }
            let mut index = start;
            let end = loop {
                if target[index] != UNKNOWN {
                    break target[index];
                }
                path.push(index);
                match steps.get(ways_down[index] as usize) {
                    Some(&way) => index = drainage::step(index, way),
                    None => break index as u32, // cells are limited to 400 million
                }
            };
            for index in path.drain(..) {
                target[index] = end;
            }
        }
        Ok(Self { target })
    }

    /// Index of the channel cell that the cell's water first meets, if it does on the map.
    #[inline]
    fn channel(&self, index: usize) -> Option<usize> {
        let target = self.target[index];
        (target != UNKNOWN && target & CHANNEL != 0).then_some((target & !CHANNEL) as usize)
    }

    /// Height of each cell above its drainage in metres, ≥ 0; above the place where its water leaves the
    /// map where it meets no channel; 0 where masked.
    pub fn heights_m(&self, surface: &DrainageSurface, channels: &[ChannelCell]) -> Vec<f32> {
        let cols = surface.cols();
        let height_at =
            |index: usize| surface.height_m(Cell { row: index / cols, col: index % cols });
        let height_m = |(index, &target): (usize, &u32)| {
            if target == UNKNOWN {
                return 0.0;
            }
            let drainage =
                self.channel(index).map_or(target as usize, |i| channels[i].cell as usize);
            height_at(index) - height_at(drainage)
        };
        self.target.par_iter().enumerate().map(height_m).collect()
    }
}

/// Weight of a channel's water table at a height above it: 1 at its level, 0 from `reach_m` up.
#[inline]
fn water_table_weight(height_m: f32, reach_m: f32) -> f32 {
    if height_m >= reach_m {
        return 0.0;
    }
    let t = 1.0 - height_m / reach_m;
    t * t
}

/// What the uptake took.
pub(super) struct Uptake {
    /// Taken from channels over the whole map, mm summed over cells.
    pub taken_mm: [f64; MONTHS],
}

/// Wets riparian soil from its channel: raises `moisture_mm`, lowers the channels' outflow.
/// `demand_mm(index)` is the atmosphere's demand each month.
pub(super) fn take_up(
    drainage: &NearestDrainage,
    heights_m: &[f32],
    channels: &mut [ChannelCell],
    moisture_mm: &mut [Vec<f32>; MONTHS],
    capacity_mm: f32,
    reach_m: f32,
    demand_mm: impl Fn(usize) -> [f32; MONTHS],
) -> Uptake {
    let channel_and_weight = |index: usize| {
        let weight = water_table_weight(heights_m[index], reach_m);
        drainage.channel(index).filter(|_| weight > 0.0).map(|channel| (channel, weight))
    };

    // What the land along each channel cell lacks
    let mut lacking_mm = vec![[0.0_f64; MONTHS]; channels.len()];
    let banks = (0..heights_m.len()).filter_map(|index| Some((index, channel_and_weight(index)?)));
    for (index, (channel, weight)) in banks {
        for (m, demand) in demand_mm(index).into_iter().enumerate() {
            let missing_fraction = 1.0 - moisture_mm[m][index] / capacity_mm;
            lacking_mm[channel][m] += f64::from(weight * demand * missing_fraction);
        }
    }

    // What it gets
    let (met_fraction, taken_mm) = share_out(channels, &lacking_mm);
    moisture_mm.par_iter_mut().enumerate().for_each(|(m, month)| {
        for (index, moisture) in month.iter_mut().enumerate() {
            if let Some((channel, weight)) = channel_and_weight(index) {
                *moisture += weight * met_fraction[channel][m] * (capacity_mm - *moisture);
            }
        }
    });
    Uptake { taken_mm }
}

/// Serves every channel cell's want from its flow, never more than flows anywhere below it. Where water
/// is short a cell takes of what reaches it only its part of all wants from there to the mouth, so
/// that banks fare alike along a channel. Lowers the channels' outflow; returns the share of each want
/// that was met, and the total taken.
fn share_out(
    channels: &mut [ChannelCell],
    wanted_mm: &[[f64; MONTHS]],
) -> (Vec<[f32; MONTHS]>, [f64; MONTHS]) {
    let receivers = receiver_indices(channels);

    // What may be taken at or above each cell without drying a cell below: the flow of the driest
    // stretch below, shared by tributaries in proportion to their flow
    let mut inflow_mm = vec![[0.0_f64; MONTHS]; channels.len()];
    for (channel, receiver) in channels.iter().zip(&receivers) {
        if let Some(receiver) = *receiver {
            add(&mut inflow_mm[receiver], &channel.outflow_mm);
        }
    }
    let mut allowed_mm = vec![[0.0_f64; MONTHS]; channels.len()];
    for i in (0..channels.len()).rev() {
        for m in 0..MONTHS {
            let flow = channels[i].outflow_mm[m];
            allowed_mm[i][m] = match receivers[i] {
                Some(r) if inflow_mm[r][m] > 0.0 => {
                    flow * (allowed_mm[r][m] / inflow_mm[r][m]).min(1.0)
                }
                _ => flow,
            };
        }
    }

    // Wants from each cell down to its mouth
    let mut below_mm = wanted_mm.to_vec();
    for i in (0..channels.len()).rev() {
        if let Some(receiver) = receivers[i] {
            let from_there = below_mm[receiver];
            add(&mut below_mm[i], &from_there);
        }
    }

    // Taken from the head waters down
    let mut taken_mm = inflow_mm;
    taken_mm.fill([0.0; MONTHS]);
    let mut met_fraction = vec![[0.0_f32; MONTHS]; channels.len()];
    let mut total_mm = [0.0; MONTHS];
    for i in 0..channels.len() {
        for m in 0..MONTHS {
            let wanted = wanted_mm[i][m];
            if wanted > 0.0 {
                let available = (allowed_mm[i][m] - taken_mm[i][m]).max(0.0);
                let given = wanted * (available / below_mm[i][m]).min(1.0);
                met_fraction[i][m] = (given / wanted) as f32;
                taken_mm[i][m] += given;
                total_mm[m] += given;
            }
            if let Some(receiver) = receivers[i] {
                taken_mm[receiver][m] += taken_mm[i][m];
            }
            channels[i].outflow_mm[m] = (channels[i].outflow_mm[m] - taken_mm[i][m]).max(0.0);
        }
    }
    (met_fraction, total_mm)
}

fn add(sum_mm: &mut [f64; MONTHS], more_mm: &[f64; MONTHS]) {
    for (sum, more) in sum_mm.iter_mut().zip(more_mm) {
        *sum += more;
    }
}

/// Position in `channels` of each channel cell's receiver.
fn receiver_indices(channels: &[ChannelCell]) -> Vec<Option<usize>> {
    let mut by_cell: Vec<(u32, usize)> =
        channels.iter().enumerate().map(|(i, channel)| (channel.cell, i)).collect();
    by_cell.sort_unstable();
    let position = |channel: &ChannelCell| {
        if channel.receiver == LEAVES_MAP {
            return None;
        }
        let found = by_cell.binary_search_by_key(&channel.receiver, |&(cell, _)| cell);
        assert!(found.is_ok(), "a channel ends inside the map");
        found.ok().map(|at| by_cell[at].1)
    };
    channels.par_iter().map(position).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two tributaries 0 and 1 join in 2, which flows to 3 and out.
    fn network(flows_mm: [f64; 4]) -> Vec<ChannelCell> {
        let receivers = [12, 12, 13, LEAVES_MAP];
        (0..4)
            .map(|i| ChannelCell {
                cell: 10 + i as u32,
                receiver: receivers[i],
                outflow_mm: [flows_mm[i]; MONTHS],
            })
            .collect()
    }

    #[test]
    fn wants_are_met_where_water_suffices_and_are_taken_all_the_way_down() {
        let mut channels = network([10.0, 30.0, 41.0, 42.0]);
        let wanted = [[1.0; MONTHS], [0.0; MONTHS], [2.0; MONTHS], [4.0; MONTHS]];
        let (met, total) = share_out(&mut channels, &wanted);
        assert_eq!((met[0][3], met[2][3], met[3][3], total[3]), (1.0, 1.0, 1.0, 7.0));
        let left: Vec<f64> = channels.iter().map(|c| c.outflow_mm[3]).collect();
        assert_eq!(left, [9.0, 30.0, 38.0, 35.0]);
    }

    #[test]
    fn nobody_upstream_takes_what_a_dry_stretch_below_no_longer_carries() {
        // 36 of the 40 mm seep away in the bed of cell 2
        let mut channels = network([10.0, 30.0, 4.0, 5.0]);
        let wanted = [[100.0; MONTHS]; 4];
        let (met, total) = share_out(&mut channels, &wanted);
        // the tributaries may have 1 and 3 of the 4 mm, and take a third: two more cells want as much
        assert!((met[0][0] - 0.01 / 3.0).abs() < 1e-6 && (met[1][0] - 0.01).abs() < 1e-6);
        assert!((met[2][0] - (4.0 - 4.0 / 3.0) / 200.0).abs() < 1e-6);
        assert!(total[0] <= 5.0 + 1e-9);
        assert!(channels.iter().all(|c| c.outflow_mm.iter().all(|&q| q >= 0.0)));
        assert!(channels[3].outflow_mm[0].abs() < 1e-9);
    }

    #[test]
    fn the_water_table_fades_with_height() {
        assert_eq!(water_table_weight(0.0, 2.0), 1.0);
        assert_eq!(water_table_weight(1.0, 2.0), 0.25);
        assert_eq!(water_table_weight(7.0, 2.0), 0.0);
    }
}
