//! Crown fit: how wide each crown is, by the canopy around its trunk.
//!
//! A crown is wide enough where one ring more would lie more over what is no canopy than over canopy that no other crown
//! covers. The species' envelope bounds it.
//!
//! # Departures
//! Kapp et al. 2020, Eq. 2 gives the radius by height alone: then crowns leave gaps where real ones are wide and hang far
//! over edges where real ones are narrow. The allometry is the middle of the envelope here.

use super::cover::Cover;
use super::crowns::{MAX_RADIUS_UNITS, UNITS_PER_CELL, disk_spans, middle_units, whole_root};
use super::stand::{Ground, Stand};
use super::tiles::Tiling;

/// Width of the rings that a crown may grow or shrink by; envelopes are whole numbers of rings.
pub const RING_UNITS: i32 = UNITS_PER_CELL / 4;
const MAX_RINGS: usize = (MAX_RADIUS_UNITS / RING_UNITS) as usize + 1;

/// Worth of a cell of canopy that no other crown covers.
pub const CANOPY_WORTH: i32 = 10;

/// A crown at a place: the radius of the greatest worth, and that worth.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fit {
    /// Radius in units.
    pub radius: i32,
    /// Canopy that it alone covers less the price of what is no canopy, in [`CANOPY_WORTH`] a cell.
    pub worth: i32,
}

/// The best crown around (`x`, `y`); `own` is the radius that `cover` counts for it, 0 if it is not
/// counted, and `price` what a cell that is no canopy costs.
pub fn best_fit(
    ground: &Ground<'_>,
    cover: &Cover,
    [x, y]: [i32; 2],
    [narrowest, widest]: [i32; 2],
    own: i32,
    price: i32,
) -> Fit {
    let size = ground.cells.size;

    // worth of each ring
    let mut rings = [0_i32; MAX_RINGS];
    for span in disk_spans(x, y, widest, size) {
        let dy = middle_units(span.row) - y;
        let start = span.row * size.cols;
        for col in span.first_col..span.end_col {
            let index = start + col;
            let dx = middle_units(col) - x;
            let squared = dx * dx + dy * dy;
            if cover.count(index) > u16::from(squared <= own * own) {
                continue; // another's too: neither gained nor lost
            }
            // a centre just on a ring's outer edge is still inside it
            let ring = (whole_root((squared - 1).max(0)) / RING_UNITS) as usize; // not negative
            rings[ring] += if ground.cells.is_canopy[index] { CANOPY_WORTH } else { -price };
        }
    }

    // the radius of the greatest worth; of equals the one nearest to the middle of the envelope
    let inner = (narrowest / RING_UNITS) as usize; // not negative
    let outer = (widest / RING_UNITS) as usize;
    let middle = i32::midpoint(narrowest, widest);
    let mut worth: i32 = rings[..inner].iter().sum();
    let mut best = (worth, -(narrowest - middle).abs(), narrowest);
    for (ring, value) in (1..).zip(&rings[..outer]).skip(inner) {
        worth += value;
        let radius = ring * RING_UNITS;
        best = best.max((worth, -(radius - middle).abs(), radius));
    }
    Fit { radius: best.2, worth: best.0 }
}

/// Fits every crown once, one after the other among neighbours, and drops trees whose crown is worth less than
/// `least_worth` of them. Gives how many were dropped.
pub fn fit(
    ground: &Ground<'_>,
    tiling: Tiling,
    cover: &Cover,
    price: i32,
    least_worth: impl Fn(usize, &Stand) -> i32 + Sync,
    stand: &mut Stand,
) -> usize {
    let trees = tiling.sorted(stand.crowns.x.iter().copied().zip(stand.crowns.y.iter().copied()));
    let fits = tiling.run(|tile| {
        let fit = |&tree: &u32| {
            let tree = tree as usize;
            let (x, y) = (stand.crowns.x[tree], stand.crowns.y[tree]);
            let own = stand.crowns.radius[tree];
            let envelope = [stand.narrowest[tree], stand.widest[tree]];
            let fit = best_fit(ground, cover, [x, y], envelope, own, price);
            if fit.worth < least_worth(tree, stand) {
                cover.remove(x, y, own);
                return 0;
            }
            if fit.radius != own {
                cover.remove(x, y, own);
                cover.add(x, y, fit.radius);
            }
            fit.radius
        };
        trees[tile].iter().map(fit).collect::<Vec<i32>>()
    });
    let mut is_kept = vec![true; stand.len()];
    for (&tree, radius) in trees.iter().flatten().zip(fits.into_iter().flatten()) {
        let tree = tree as usize;
        is_kept[tree] = radius > 0;
        if radius > 0 {
            stand.resize(tree, radius);
        }
    }
    let before = stand.len();
    stand.keep(&is_kept);
    before - stand.len()
}
