//! A stand under way: trees that placement seeds, moves, fits and drops.

use super::crown_fit::RING_UNITS;
use super::crowns::{Crowns, GridSize, MAX_RADIUS_UNITS, middle_units};
use super::seeding::Seed;
use super::species_map::{NO_SPECIES, SpeciesMap};
use super::working_cells::WorkingCells;
use crate::raster::Grid;
use crate::species::Biome;

/// How far a crown may be from its species' allometry, as a share of it.
/// chosen: crowns of one species and height vary by about a third between open and closed stands (the growth tables of
/// Peytavie 2024; Pretzsch et al. 2015, doi:10.1016/j.ufug.2015.04.006).
pub const CROWN_ENVELOPE_FRACTION: f32 = 0.35;

/// How far from the trunk a tree's top may be. chosen: leaning stems and uneven branches; a cell of usual models.
const TOP_REACH_M: f32 = 1.0;
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
}

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
    /// Whether the tree stands under a top of the canopy, which holds it in place.
    pub is_top: Vec<bool>,
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
    /// Widest crown that any tree here can have, in units.
    pub fn widest(&self) -> i32 {
        let highest_m = self.chm_m.valid_values().fold(0.0_f32, |highest, &h| highest.max(h));
        let radius_m = self.biome.canopy_species().map(|s| {
            self.biome.species[s].crown_radius_m(highest_m) * (1.0 + CROWN_ENVELOPE_FRACTION)
        });
        let widest_m = radius_m.fold(0.0, f32::max);
        ((widest_m * self.cells.units_per_m()) as i32).clamp(1, MAX_RADIUS_UNITS)
    }

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

    /// What a tree with its trunk in working cell `index` would be; `None` where no tree can stand.
    pub fn standing(&self, index: usize) -> Option<Standing> {
        let scene = self.cells.scene_index(index);
        let species = self.species.values()[scene];
        if !self.cells.is_canopy[index] || species == NO_SPECIES {
            return None;
        }
        let height_m = self.height_m(index);
        let radius_m = self.biome.species[usize::from(species)].crown_radius_m(height_m);
        let units = self.cells.units_per_m();
        // whole rings, at least one, the widest inside and the narrowest outside of the bounds
        let rings = |m: f32| m * units / RING_UNITS as f32;
        let bound =
            |rings: f32| (rings as i32).clamp(1, MAX_RADIUS_UNITS / RING_UNITS) * RING_UNITS;
        let widest = bound(rings(radius_m * (1.0 + CROWN_ENVELOPE_FRACTION)).floor());
        let narrowest = bound(rings(radius_m * (1.0 - CROWN_ENVELOPE_FRACTION)).ceil()).min(widest);
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
        self.is_top.push(is_top);
    }

    /// Moves a tree, whose crown keeps its share of the species' envelope; stays where no tree can stand there.
    pub fn shift(&mut self, ground: &Ground<'_>, tree: usize, x: i32, y: i32) {
        let Some(standing) = ground.standing(ground.cells.index_at(x, y)) else { return };
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
        keep(&mut self.is_top, is_kept);
    }
}
