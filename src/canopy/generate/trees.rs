//! Trees of a generated canopy: their sizes, and which of them make up the cover asked for.

use rayon::prelude::*;

use super::planting::{Lattice, PlantingSpot};
use super::stands::Stands;
use crate::math::lerp;
use crate::raster::Mask;
use crate::rng::{self, Key, Process};

/// Height of a stand's lowest and highest grown trees, as shares of its mean. Chosen: a canopy layer varies by about
/// a tenth or two either way, and has few that stand out.
const HEIGHT_FRACTIONS: [f32; 2] = [0.72, 1.22];
/// Crown radius as a share of the spacing, of conifers and of broadleaved trees. Chosen: all trees together
/// cover 93 % of the land, the most that can be asked for.
const RADIUS_FRACTIONS: [f32; 2] = [0.84, 0.98];
/// Crown radius in open woodland against that in closed stands. Chosen: light from the side widens crowns.
const OPEN_WIDTH_FRACTION: f32 = 1.2;
/// Crowns are at most this wide for their height. Chosen: half the height in radius is an old oak in the open.
const WIDEST_RADIUS_PER_HEIGHT: f32 = 0.5;
/// Young trees grow where woods fall short by this much at most.
const EDGE: f32 = 0.22;
/// Lowest and highest young tree, m: beneath what counts as canopy.
const YOUNG_HEIGHT_M: [f32; 2] = [0.4, 1.8];

/// A tree that was drawn into a canopy.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GeneratedTree {
    /// Metres east of the map's south-west corner.
    pub east_m: f32,
    /// Metres north of it.
    pub north_m: f32,
    /// Height above ground.
    pub height_m: f32,
    /// Crown radius.
    pub crown_radius_m: f32,
    /// Height lost from the tree's top to its crown's rim, as a share of the height.
    pub crown_depth_fraction: f32,
    /// Outline of the crown: 0 a cone, 1 a paraboloid.
    pub roundness: f32,
}

impl GeneratedTree {
    /// Height of the crown's surface in metres, by the squared distance from the trunk in crown radii, 0..=1.
    #[inline]
    pub fn surface_m(&self, distance2: f32) -> f32 {
        let fall = lerp(distance2.sqrt(), distance2, self.roundness);
        self.height_m * (1.0 - self.crown_depth_fraction * fall)
    }
}

/// A tree and how much its place is for woods.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Planted {
    /// The tree.
    pub tree: GeneratedTree,
    /// Level of cover up to which it stands, see [`super::stands::Spot::woodland`].
    pub value: f32,
    /// 0..1: whether a young one stands in its place where it does not.
    pub luck: f32,
}

/// All trees by lattice row.
#[derive(Clone, Debug)]
pub struct PlantedRows {
    /// Canopy trees, and young ones that count as none.
    pub rows: Vec<Vec<Planted>>,
    /// Level that canopy trees are above.
    pub level: f32,
}

impl PlantedRows {
    /// The canopy trees, from north to south.
    pub fn canopy(&self) -> Vec<GeneratedTree> {
        let all = self.rows.iter().flatten();
        all.filter(|p| p.value > self.level).map(|p| p.tree).collect()
    }
}

/// A grown tree at every place.
pub fn grown(
    lattice: &Lattice,
    places: &[Vec<PlantingSpot>],
    stands: &Stands<'_>,
    seed: u64,
) -> PlantedRows {
    let widest_m = lattice.widest_crown_m();
    let grow = |spot: &PlantingSpot| {
        let stand = stands.spot(spot.east_m, spot.north_m);
        let (process, entity) = (Process::CanopyTree, spot.entity);
        let draws = |month| rng::uniforms(Key { seed, process, year: 0, month, entity });
        let ([luck, size, kind, width], [young, ..]) = (draws(0), draws(1));
        let conifer = stand.kind > 1.4 * kind - 0.7;
        // few stand out: the square root makes most draws large
        let share = lerp(HEIGHT_FRACTIONS[0], HEIGHT_FRACTIONS[1], 0.5 * (size.sqrt() + size));
        let height_m = stand.height_m * share;
        let radius_fraction = RADIUS_FRACTIONS[usize::from(!conifer)]
            * lerp(0.86, 1.14, width)
            * lerp(1.0, OPEN_WIDTH_FRACTION, stand.openness)
            * share;
        let crown_radius_m =
            (spot.spacing_m * radius_fraction).min(WIDEST_RADIUS_PER_HEIGHT * height_m);
        let (depth, roundness) = if conifer { (0.62, 0.2) } else { (0.45, 0.9) };
        let tree = GeneratedTree {
            east_m: spot.east_m,
            north_m: spot.north_m,
            height_m,
            crown_radius_m: crown_radius_m.min(widest_m),
            crown_depth_fraction: depth * lerp(0.85, 1.15, young),
            roundness,
        };
        Planted { tree, value: stand.woodland + stand.openness * (luck - 0.5), luck: young }
    };
    let rows = places.par_iter().map(|row| row.iter().map(grow).collect()).collect();
    PlantedRows { rows, level: f32::NEG_INFINITY }
}

/// The trees that together cover the share asked for: those above the level that so much of the land is above.
/// `cover_values` holds for each cell the greatest value of the crowns over it. Some young trees stand along the edges.
pub fn standing(
    planted: PlantedRows,
    cover_values: &[f32],
    mask: &Mask,
    cover_fraction: f32,
) -> PlantedRows {
    let mut values: Vec<f32> =
        cover_values.iter().zip(mask.as_slice()).filter(|(_, v)| **v).map(|(c, _)| *c).collect();
    let covered = (f64::from(cover_fraction) * values.len() as f64).round() as usize; // 0..=len
    let level = match values.len().checked_sub(covered + 1) {
        Some(place) => *values.select_nth_unstable_by(place, f32::total_cmp).1,
        None => f32::NEG_INFINITY,
    };
    let keep = |mut planted: Planted| {
        if planted.value > level {
            return Some(planted);
        }
        if planted.value < level - EDGE || planted.luck > 0.45 {
            return None;
        }
        let tree = &mut planted.tree;
        tree.height_m = lerp(YOUNG_HEIGHT_M[0], YOUNG_HEIGHT_M[1], planted.luck / 0.45);
        tree.crown_radius_m *= 0.6;
        tree.roundness = 1.0;
        Some(planted)
    };
    let rows = planted
        .rows
        .into_par_iter()
        .map(|row| row.into_iter().filter_map(keep).collect())
        .collect();
    PlantedRows { rows, level }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tree(roundness: f32) -> GeneratedTree {
        GeneratedTree {
            east_m: 0.0,
            north_m: 0.0,
            height_m: 20.0,
            crown_radius_m: 3.0,
            crown_depth_fraction: 0.5,
            roundness,
        }
    }

    #[test]
    fn crowns_fall_from_the_top_to_their_rim() {
        for roundness in [0.0, 0.4, 1.0] {
            assert_eq!(tree(roundness).surface_m(0.0), 20.0);
            assert!((tree(roundness).surface_m(1.0) - 10.0).abs() < 1e-5);
        }
        // half way out a cone has lost half, a paraboloid a quarter
        assert!((tree(0.0).surface_m(0.25) - 15.0).abs() < 1e-5);
        assert!((tree(1.0).surface_m(0.25) - 17.5).abs() < 1e-5);
    }

    #[test]
    fn the_level_leaves_just_the_cover_asked_for() {
        let values: Vec<f32> = (0..100).map(|i| i as f32 / 100.0).collect();
        let rows = vec![
            values.iter().map(|&value| Planted { tree: tree(1.0), value, luck: 1.0 }).collect(),
        ];
        let planted = PlantedRows { rows, level: f32::NEG_INFINITY };
        let mask = Mask::all_valid(100);
        for (cover, expected) in [(0.0, 0), (0.3, 30), (1.0, 100)] {
            let left = standing(planted.clone(), &values, &mask, cover);
            assert_eq!(left.canopy().len(), expected, "cover {cover}");
        }
    }
}
