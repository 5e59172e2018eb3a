//! Land along channels: its height above the nearest drainage, and the channel water its soil takes up.
//!
//! Beside a channel with water the water table lies near the surface and keeps part of the root zone
//! full. With weight w (1 at the channel's level, 0 at the reach) and the bank's wetness φ (0 dry, 1 as wet
//! as the channel can make it)
//!
//! ```text
//! moisture      M' = M + w φ (capacity − M)
//! transpiration T' = demand · M' / capacity, so T' − T = w φ demand (1 − M / capacity)
//! ```
//!
//! What banks transpire more, T' − T, and what they come to hold more, M' − M, is taken from the channel's
//! discharge, there and all the way down; what they hold less than the month before flows back. φ is 1 where
//! the flow suffices for both, else what it suffices for, so water is conserved in every month and no channel
//! gives more than it carries. Where a channel begins does not depend on the weather, so a drought moves no
//! bank; it lowers φ.
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

/// What banks took from channels over the whole map, mm summed over cells.
pub(super) struct Uptake {
    /// Transpired.
    pub transpired_mm: [f64; MONTHS],
    /// Held more at the month's end than at its start; negative where it flowed back.
    pub storage_change_mm: [f64; MONTHS],
}

/// The land along one channel cell, mm summed over its cells, if its banks were as wet as can be.
#[derive(Clone, Copy, Default)]
struct Banks {
    /// Transpiration more than the soil's own water allows.
    transpired_mm: [f64; MONTHS],
    /// Water held more than the soil's own.
    held_mm: [f64; MONTHS],
}

/// Years until the banks' wetness repeats: it is forgotten in the first month with enough flow.
const SPIN_UP_YEARS: usize = 2;

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
    let mut banks = vec![Banks::default(); channels.len()];
    let land = (0..heights_m.len()).filter_map(|index| Some((index, channel_and_weight(index)?)));
    for (index, (channel, weight)) in land {
        for (m, demand) in demand_mm(index).into_iter().enumerate() {
            let missing_mm = weight * (capacity_mm - moisture_mm[m][index]);
            banks[channel].held_mm[m] += f64::from(missing_mm);
            banks[channel].transpired_mm[m] += f64::from(missing_mm * demand / capacity_mm);
        }
    }

    // What it gets
    let (wetness, uptake) = wet(channels, &banks);
    moisture_mm.par_iter_mut().enumerate().for_each(|(m, month)| {
        for (index, moisture) in month.iter_mut().enumerate() {
            if let Some((channel, weight)) = channel_and_weight(index) {
                *moisture += weight * wetness[channel][m] * (capacity_mm - *moisture);
            }
        }
    });
    uptake
}

/// Wetness of each channel cell's banks month by month, as far as the channels' flow goes; lowers their outflow.
fn wet(channels: &mut [ChannelCell], banks: &[Banks]) -> (Vec<[f32; MONTHS]>, Uptake) {
    let receivers = receiver_indices(channels);
    let mut wetness = vec![[0.0_f32; MONTHS]; channels.len()];
    let mut held_mm = vec![0.0_f64; channels.len()];
    let mut uptake = Uptake { transpired_mm: [0.0; MONTHS], storage_change_mm: [0.0; MONTHS] };
    let mut wanted_mm = vec![0.0_f64; channels.len()];
    let months = (0..SPIN_UP_YEARS).flat_map(|year| (0..MONTHS).map(move |m| (year, m)));
    for (year, m) in months {
        for (i, wanted) in wanted_mm.iter_mut().enumerate() {
            *wanted = banks[i].transpired_mm[m] + banks[i].held_mm[m] - held_mm[i];
        }
        let mut flow_mm: Vec<f64> = channels.iter().map(|c| c.outflow_mm[m]).collect();
        let given_mm = share_out(&receivers, &mut flow_mm, &wanted_mm);
        let (mut transpired, mut stored) = (0.0, 0.0);
        for i in 0..channels.len() {
            let most_mm = banks[i].transpired_mm[m] + banks[i].held_mm[m];
            let share = if most_mm > 0.0 { (given_mm[i] + held_mm[i]) / most_mm } else { 0.0 };
            transpired += share * banks[i].transpired_mm[m];
            let holds_mm = share * banks[i].held_mm[m];
            stored += holds_mm - held_mm[i];
            held_mm[i] = holds_mm;
            wetness[i][m] = share as f32; // 0..=1
        }
        if year + 1 == SPIN_UP_YEARS {
            (uptake.transpired_mm[m], uptake.storage_change_mm[m]) = (transpired, stored);
            for (channel, flow) in channels.iter_mut().zip(&flow_mm) {
                channel.outflow_mm[m] = *flow;
            }
        }
    }
    (wetness, uptake)
}

/// Serves every channel cell's want from a month's flow, never more than flows anywhere below it. Where water
/// is short a cell takes of what reaches it only its part of all wants from there to the mouth, so
/// that banks fare alike along a channel; a negative want flows back. Lowers `flow_mm`; returns what each got.
fn share_out(receivers: &[Option<usize>], flow_mm: &mut [f64], wanted_mm: &[f64]) -> Vec<f64> {
    let count = receivers.len();

    // What may be taken at or above each cell without drying a cell below: the flow of the driest
    // stretch below, shared by tributaries in proportion to their flow
    let mut inflow_mm = vec![0.0_f64; count];
    for (flow, receiver) in flow_mm.iter().zip(receivers) {
        if let Some(receiver) = *receiver {
            inflow_mm[receiver] += flow;
        }
    }
    let mut allowed_mm = vec![0.0_f64; count];
    for i in (0..count).rev() {
        allowed_mm[i] = match receivers[i] {
            Some(r) if inflow_mm[r] > 0.0 => flow_mm[i] * (allowed_mm[r] / inflow_mm[r]).min(1.0),
            _ => flow_mm[i],
        };
    }

    // Wants from each cell down to its mouth
    let mut below_mm: Vec<f64> = wanted_mm.iter().map(|wanted| wanted.max(0.0)).collect();
    for i in (0..count).rev() {
        if let Some(receiver) = receivers[i] {
            below_mm[i] += below_mm[receiver];
        }
    }

    // Taken from the head waters down
    let mut taken_mm = vec![0.0_f64; count];
    let mut given_mm = vec![0.0_f64; count];
    for i in 0..count {
        let wanted = wanted_mm[i];
        given_mm[i] = if wanted > 0.0 {
            let available = (allowed_mm[i] - taken_mm[i]).max(0.0);
            wanted * (available / below_mm[i]).min(1.0)
        } else {
            wanted
        };
        taken_mm[i] += given_mm[i];
        if let Some(receiver) = receivers[i] {
            taken_mm[receiver] += taken_mm[i];
        }
        flow_mm[i] = (flow_mm[i] - taken_mm[i]).max(0.0);
    }
    given_mm
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

    fn shared(flows_mm: [f64; 4], wanted_mm: [f64; 4]) -> (Vec<f64>, Vec<f64>) {
        let receivers = receiver_indices(&network(flows_mm));
        let mut left = flows_mm.to_vec();
        let given = share_out(&receivers, &mut left, &wanted_mm);
        (given, left)
    }

    #[test]
    fn wants_are_met_where_water_suffices_and_are_taken_all_the_way_down() {
        let (given, left) = shared([10.0, 30.0, 41.0, 42.0], [1.0, 0.0, 2.0, 4.0]);
        assert_eq!(given, [1.0, 0.0, 2.0, 4.0]);
        assert_eq!(left, [9.0, 30.0, 38.0, 35.0]);
    }

    #[test]
    fn what_banks_lose_flows_back_all_the_way_down() {
        let (given, left) = shared([10.0, 30.0, 41.0, 42.0], [-3.0, 0.0, 1.0, 0.0]);
        assert_eq!(given, [-3.0, 0.0, 1.0, 0.0]);
        assert_eq!(left, [13.0, 30.0, 43.0, 44.0]);
    }

    #[test]
    fn nobody_upstream_takes_what_a_dry_stretch_below_no_longer_carries() {
        // 36 of the 40 mm seep away in the bed of cell 2
        let (given, left) = shared([10.0, 30.0, 4.0, 5.0], [100.0; 4]);
        // the tributaries may have 1 and 3 of the 4 mm, and take a third: two more cells want as much
        assert!((given[0] - 1.0 / 3.0).abs() < 1e-9 && (given[1] - 1.0).abs() < 1e-9);
        assert!((given[2] - (4.0 - 4.0 / 3.0) / 2.0).abs() < 1e-9);
        assert!(given.iter().sum::<f64>() <= 5.0 + 1e-9);
        assert!(left.iter().all(|&q| q >= 0.0));
        assert!(left[3].abs() < 1e-9);
    }

    #[test]
    fn dry_banks_fill_as_far_as_the_flow_goes_and_give_back_what_they_lose() {
        let mut channels = vec![ChannelCell {
            cell: 0,
            receiver: LEAVES_MAP,
            outflow_mm: std::array::from_fn(|m| if m == 0 { 0.0 } else { 30.0 }),
        }];
        // room for 50 mm until June, for 20 mm afterwards, and 10 mm of transpiration
        let banks = [Banks {
            transpired_mm: [10.0; MONTHS],
            held_mm: std::array::from_fn(|m| if m < 6 { 50.0 } else { 20.0 }),
        }];
        let before: f64 = channels[0].outflow_mm.iter().sum();
        let (wetness, uptake) = wet(&mut channels, &banks);
        // January has no flow: the 20 mm of December serve 60 mm of wants
        assert!((wetness[0][0] - 20.0 / 60.0).abs() < 1e-6, "{}", wetness[0][0]);
        // February: 30 mm of flow and 16.7 mm held serve 60 mm
        assert!((wetness[0][1] - (30.0 + 50.0 / 3.0) / 60.0).abs() < 1e-6);
        assert_eq!(wetness[0][4], 1.0);
        assert!((uptake.storage_change_mm[6] + 30.0).abs() < 1e-9, "30 mm flow back in July");
        let after: f64 = channels[0].outflow_mm.iter().sum();
        let taken: f64 = uptake.transpired_mm.iter().chain(&uptake.storage_change_mm).sum();
        assert!((before - after - taken).abs() < 1e-9, "{before} {after} {taken}");
        assert!(uptake.storage_change_mm.iter().sum::<f64>().abs() < 1e-9, "the year repeats");
    }

    #[test]
    fn the_water_table_fades_with_height() {
        assert_eq!(water_table_weight(0.0, 2.0), 1.0);
        assert_eq!(water_table_weight(1.0, 2.0), 0.25);
        assert_eq!(water_table_weight(7.0, 2.0), 0.0);
    }
}
