//! A stand under way: trees that placement seeds, moves, fits and drops.

use super::crowns::{Crowns, GridSize, MAX_RADIUS_UNITS, middle_units};
use super::envelopes::Envelopes;
use super::seeding::Seed;
use super::species_map::{NO_SPECIES, SpeciesMap};
use super::working_cells::WorkingCells;
use crate::raster::Grid;
use crate::species::Biome;

/// How far from the trunk a tree's top may be. chosen: leaning stems and uneven branches; a cell of usual models.
const TOP_REACH_M: f32 = 1.0;
/// How far from the canopy's top that it makes a tree's trunk may stand, as a share of its crown's radius. chosen: crowns
/// are lopsided where neighbours press them.
const TOP_REACH_FRACTION: f32 = 0.7;
/// How much higher than the canopy over its trunk a tree may be. chosen: so much rougher are crowns on 1 m cells; a tree
/// as low as the gap between branches over its trunk would have too narrow a crown.
const TOP_ABOVE_TRUNK_M: f32 = 1.5;

/// What trees are placed on: the canopy, the ground beneath, and who can stand where.
#[derive(Clone, Copy)]
pub struct Ground<'a> {
    /// Working cells.
    pub cells: &'a WorkingCells<'a>,
    /// Canopy height model, metres, on the scene's cells.
    pub chm_m: &'a Grid<f32>,
    /// Elevation, metres, on the scene's cells.
    pub elevation_m: &'a Grid<f32>,
    /// Lowest elevation of the scene, metres.
    pub lowest_m: f32,
    /// Species on the scene's cells.
    pub species: &'a SpeciesMap,
    /// The biome the species are of.
    pub biome: &'a Biome,
    /// How wide its species' crowns may be.
    pub envelopes: &'a Envelopes,
}

/// In place of a top's working cell: the tree makes none.
pub const NO_TOP: u32 = u32::MAX;

/// In place of a settled crown's worth: another place or radius may be better.
pub const UNSETTLED: i32 = i32::MIN;

/// Trees under way, struct of arrays; the crowns' arrays are as long as the others.
#[derive(Clone, Debug, Default)]
pub struct Stand {
    /// Position, radius and depth in units.
    pub crowns: Crowns,
    /// Height above ground, metres.
    pub height_m: Vec<f32>,
    /// Index into the biome's species.
    pub species: Vec<u8>,
    /// Narrowest crown of the species at this height, units.
    pub narrowest: Vec<i32>,
    /// Widest crown of the species at this height, units.
    pub widest: Vec<i32>,
    /// What the crown was worth when no place around was better; [`UNSETTLED`] before, and since the tree moved.
    pub settled_worth: Vec<i32>,
    /// Working cell of the canopy's top that the tree makes, near which it stays; [`NO_TOP`] if it makes none.
    pub top: Vec<u32>,
}

/// A tree's values that follow from where it stands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Standing {
    /// Height above ground, metres.
    pub height_m: f32,
    /// Index into the biome's species.
    pub species: u8,
    /// Narrowest crown, units.
    pub narrowest: i32,
    /// Widest crown, units.
    pub widest: i32,
    /// Elevation of the top above the datum, units.
    top_z: i32,
}

impl Ground<'_> {
    /// Height of a tree with its trunk in working cell `index`, metres: the highest canopy within [`TOP_REACH_M`], but no
    /// more than [`TOP_ABOVE_TRUNK_M`] over the canopy above the trunk.
    fn height_m(&self, index: usize) -> f32 {
        let cells = self.cells;
        let at_trunk_m = self.chm_m.values()[cells.scene_index(index)];
        if cells.per_cell > 1 {
            return at_trunk_m; // one value holds for more than a top's reach
        }
        let reach = (TOP_REACH_M / cells.cell_m) as usize; // one or two cells
        let GridSize { rows, cols } = cells.size;
        let (row, col) = (index / cols, index % cols);
        let mut highest_m = at_trunk_m;
        for row in row.saturating_sub(reach)..(row + reach + 1).min(rows) {
            for index in
                row * cols + col.saturating_sub(reach)..row * cols + (col + reach + 1).min(cols)
            {
                if cells.is_canopy[index] {
                    highest_m = highest_m.max(self.chm_m.values()[index]);
                }
            }
        }
        highest_m.min(at_trunk_m + TOP_ABOVE_TRUNK_M)
    }

    /// Bounds of the envelope of any tree with its trunk in working cell `index`, units; `None` where no tree can stand.
    pub fn widest_envelope(&self, index: usize) -> Option<[i32; 2]> {
        let scene = self.cells.scene_index(index);
        let species = self.species.values()[scene];
        if !self.cells.is_canopy[index] || species == NO_SPECIES {
            return None;
        }
        let at_trunk_m = self.chm_m.values()[scene];
        let [narrowest, _] = self.envelopes.at(species, at_trunk_m);
        let [_, widest] = self.envelopes.at(species, at_trunk_m + TOP_ABOVE_TRUNK_M);
        Some([narrowest, widest])
    }

    /// What a tree with its trunk in working cell `index` would be; `None` where no tree can stand.
    pub fn standing(&self, index: usize) -> Option<Standing> {
        let scene = self.cells.scene_index(index);
        let species = self.species.values()[scene];
        if !self.cells.is_canopy[index] || species == NO_SPECIES {
            return None;
        }
        let height_m = self.height_m(index);
        let [narrowest, widest] = self.envelopes.at(species, height_m);
        let units = self.cells.units_per_m();
        let top_m = self.elevation_m.values()[scene] - self.lowest_m + height_m;
        Some(Standing {
            height_m,
            species,
            narrowest,
            widest,
            top_z: MAX_RADIUS_UNITS + (top_m * units).round() as i32, // mountains are under 2²⁴ units high
        })
    }
}

impl Stand {
    /// Number of trees.
    pub fn len(&self) -> usize {
        self.crowns.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.crowns.is_empty()
    }

    /// Adds a tree.
    pub fn seed(&mut self, ground: &Ground<'_>, seed: Seed, is_top: bool) {
        let Seed { index, radius, standing } = seed;
        let cols = ground.cells.size.cols;
        self.crowns.x.push(middle_units(index % cols));
        self.crowns.y.push(middle_units(index / cols));
        self.crowns.radius.push(radius);
        self.crowns.center_z.push(standing.top_z - radius);
        self.height_m.push(standing.height_m);
        self.species.push(standing.species);
        self.narrowest.push(standing.narrowest);
        self.widest.push(standing.widest);
        self.settled_worth.push(UNSETTLED);
        self.top.push(if is_top { index as u32 } else { NO_TOP }); // grids have less than 2³² cells
    }

    /// What a tree would be with its trunk at a place in units; `None` where it cannot stand. A tree that makes a top of
    /// the canopy keeps its height and species, and stays within 0.7 of a typical crown of it.
    pub fn standing_at(
        &self,
        ground: &Ground<'_>,
        tree: usize,
        [x, y]: [i32; 2],
    ) -> Option<Standing> {
        let index = ground.cells.index_within(x, y)?;
        let there = ground.standing(index)?;
        let top = self.top[tree];
        if top == NO_TOP {
            return Some(there);
        }
        let cols = ground.cells.size.cols;
        let (dx, dy) =
            (x - middle_units(top as usize % cols), y - middle_units(top as usize / cols));
        let typical = i32::midpoint(self.narrowest[tree], self.widest[tree]) as f32;
        let reach = (typical * TOP_REACH_FRACTION) as i32; // shorter than a crown
        let trunk_m = ground.chm_m.values()[ground.cells.scene_index(index)];
        let is_near = dx * dx + dy * dy <= reach * reach
            && there.species == self.species[tree]
            && trunk_m >= self.height_m[tree] - TOP_ABOVE_TRUNK_M;
        is_near.then(|| Standing {
            height_m: self.height_m[tree],
            species: self.species[tree],
            narrowest: self.narrowest[tree],
            widest: self.widest[tree],
            top_z: self.crowns.center_z[tree] + self.crowns.radius[tree],
        })
    }

    /// Moves a tree, whose crown stays within the species' envelope; it stays where it is if it cannot stand there.
    pub fn move_to(&mut self, ground: &Ground<'_>, tree: usize, x: i32, y: i32) {
        if [x, y] == [self.crowns.x[tree], self.crowns.y[tree]] {
            return;
        }
        let Some(standing) = self.standing_at(ground, tree, [x, y]) else { return };
        self.settled_worth[tree] = UNSETTLED;
        self.crowns.x[tree] = x;
        self.crowns.y[tree] = y;
        let radius = self.crowns.radius[tree].clamp(standing.narrowest, standing.widest);
        self.crowns.radius[tree] = radius;
        self.crowns.center_z[tree] = standing.top_z - radius;
        self.height_m[tree] = standing.height_m;
        self.species[tree] = standing.species;
        self.narrowest[tree] = standing.narrowest;
        self.widest[tree] = standing.widest;
    }

    /// Gives a tree another crown; its top stays where it is.
    pub fn resize(&mut self, tree: usize, radius: i32) {
        let top_z = self.crowns.center_z[tree] + self.crowns.radius[tree];
        self.crowns.radius[tree] = radius;
        self.crowns.center_z[tree] = top_z - radius;
    }

    /// Keeps the trees marked so, in their order.
    pub fn keep(&mut self, is_kept: &[bool]) {
        fn keep<T>(values: &mut Vec<T>, is_kept: &[bool]) {
            let mut kept = is_kept.iter();
            values.retain(|_| *kept.next().unwrap_or(&false));
        }
        keep(&mut self.crowns.x, is_kept);
        keep(&mut self.crowns.y, is_kept);
        keep(&mut self.crowns.radius, is_kept);
        keep(&mut self.crowns.center_z, is_kept);
        keep(&mut self.height_m, is_kept);
        keep(&mut self.species, is_kept);
        keep(&mut self.narrowest, is_kept);
        keep(&mut self.widest, is_kept);
        keep(&mut self.settled_worth, is_kept);
        keep(&mut self.top, is_kept);
    }
}

#[cfg(test)]
pub(super) mod fixture {
    use super::*;
    use crate::raster::Cell;

    /// Calls `test` with flat ground under canopy of 1 m cells, `height_m` high by row and column, where `key` stands all over.
    pub fn on_ground<T>(
        [rows, cols]: [usize; 2],
        height_m: impl FnMut(Cell) -> f32,
        key: &str,
        test: impl FnOnce(&Ground<'_>) -> T,
    ) -> T {
        let biome = Biome::builtin("sonoma").unwrap();
        let chm_m = Grid::from_fn(rows, cols, 1.0, height_m);
        let elevation_m = chm_m.with_values(vec![100.0; rows * cols]);
        let species = chm_m.with_values(vec![biome.species_index(key).unwrap() as u8; rows * cols]);
        let cells = WorkingCells::new(&chm_m, chm_m.mask(), 3.0);
        let envelopes = Envelopes::new(&biome, cells.units_per_m(), chm_m.range().unwrap().1);
        test(&Ground {
            cells: &cells,
            chm_m: &chm_m,
            elevation_m: &elevation_m,
            lowest_m: 100.0,
            species: &species,
            biome: &biome,
            envelopes: &envelopes,
        })
    }

    impl Stand {
        /// Adds a tree with its trunk in the middle of a cell.
        pub fn plant(&mut self, ground: &Ground<'_>, cell: [usize; 2], radius: i32, is_top: bool) {
            let index = cell[0] * ground.cells.size.cols + cell[1];
            let standing = ground.standing(index).expect("a tree cannot stand there");
            self.seed(ground, Seed { index, radius, standing }, is_top);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::fixture::on_ground;
    use super::*;

    #[test]
    fn trees_that_make_a_top_stay_near_it_and_keep_its_height() {
        let slope = |cell: crate::raster::Cell| 20.0 - 0.5 * cell.col as f32;
        on_ground([20, 30], slope, "redwood", |ground| {
            let mut stand = Stand::default();
            stand.plant(ground, [10, 5], 60, true);
            stand.plant(ground, [10, 5], 60, false);
            let height_m = stand.height_m[0];
            assert_eq!(height_m, 18.0); // a metre beside the trunk
            let at = |col: usize| [middle_units(col), middle_units(10)];
            for (col, may_top, may_other) in
                [(6, true, true), (8, false, true), (19, false, true), (29, false, true)]
            {
                let top = stand.standing_at(ground, 0, at(col));
                assert_eq!(top.map(|t| t.height_m), may_top.then_some(height_m), "column {col}");
                assert_eq!(stand.standing_at(ground, 1, at(col)).is_some(), may_other);
            }
            assert_eq!(stand.standing_at(ground, 1, [-1, 300]), None);
            stand.move_to(ground, 1, middle_units(19), middle_units(10));
            assert_eq!(stand.height_m[1], 11.0);
            assert!(stand.crowns.radius[1] <= stand.widest[1]);
            let top_z = stand.crowns.center_z[1] + stand.crowns.radius[1];
            assert_eq!(top_z - MAX_RADIUS_UNITS, 11 * 32);
        });
    }
}
