//! Which tiles a forest is cut into: a quadtree of one depth, without its empty parts.

use rayon::prelude::*;

use crate::export::instance_bounds::Bounds;
use crate::export::instances::FeatureTable;
use crate::export::scene3d::{Lod, Scene3d};
use crate::plants::Layer;

/// Instances of a leaf in the mean, at most. chosen: 250 KB a tile.
const LEAF_INSTANCES: usize = 4_000;
/// Greatest side of a leaf. chosen: near models of a quarter kilometre are what graphics cards hold.
const LEAF_SIDE_M: f32 = 250.0;
/// Depths of leaves: three levels of detail need two above them, and 16,384 leaves are files enough.
const DEPTHS: std::ops::RangeInclusive<u32> = 2..=7;
/// Least height, or length of downed logs, that middle models are shown of.
/// chosen: what is lower is two pixels high where a tile of them is shown.
const MIDDLE_LEAST_M: f32 = 1.0;
/// Least height of snags that far models are shown of. chosen: those that stand out of the canopy.
const FAR_SNAG_LEAST_M: f32 = 5.0;

/// An instance's leaf.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Entry {
    leaf: u32,
    group: u32,
    instance: u32,
}

/// A tile.
#[derive(Clone, Debug)]
pub struct Tile {
    /// Steps from the root.
    pub depth: u32,
    /// Its number at its depth, along the quadtree's curve.
    pub code: u32,
    /// Its level of detail.
    pub lod: Lod,
    /// Around all instances in it, in the scene's metres, whether its level shows them or not.
    pub bounds: Bounds,
    first: usize,
    end: usize,
}

impl Tile {
    /// Its name in files: depth, column from the west, row from the south.
    pub fn name(&self) -> String {
        let axis =
            |from: u32| (0..16).map(|bit| (self.code >> (2 * bit + from) & 1) << bit).sum::<u32>();
        format!("{}_{}_{}", self.depth, axis(0), axis(1))
    }
}

/// All tiles, and what is in them.
pub struct Plan {
    /// Tiles, the root first, each depth along its curve.
    pub tiles: Vec<Tile>,
    depth: u32,
    side_m: f32,
    entries: Vec<Entry>,
}

impl Plan {
    /// Cuts a scene's forest.
    pub fn new(scene: &Scene3d<'_>) -> Self {
        let groups = &scene.instances.groups;
        let ground = groups
            .par_iter()
            .map(|group| Bounds::of_points(&group.position_m))
            .reduce(|| Bounds::EMPTY, Bounds::union);
        if ground.is_empty() {
            return Self { tiles: vec![], depth: 0, side_m: 0.0, entries: vec![] };
        }
        let side_m = (ground.high[0] - ground.low[0]).max(ground.high[1] - ground.low[1]).max(1.0);
        let count = scene.instances.len();
        let is_fine = |depth: &u32| {
            count >> (2 * depth) <= LEAF_INSTANCES
                && side_m / (1_u32 << depth) as f32 <= LEAF_SIDE_M
        };
        let depth = DEPTHS.clone().find(is_fine).unwrap_or(*DEPTHS.end());
        let cells = 1_u32 << depth;
        let leaf = |place: [f32; 3]| {
            let cell = |k: usize| {
                let share = (place[k] - ground.low[k]) / side_m;
                ((share * cells as f32) as u32).min(cells - 1) // not negative
            };
            spread(cell(0)) | spread(cell(1)) << 1
        };
        let mut entries: Vec<Entry> = (0_u32..)
            .zip(groups)
            .flat_map(|(group, of)| {
                (0_u32..)
                    .zip(&of.position_m)
                    .map(move |(instance, place)| (group, instance, *place))
            })
            .map(|(group, instance, place)| Entry { leaf: leaf(place), group, instance })
            .collect();
        entries.par_sort_unstable();
        let mut plan = Self { tiles: vec![], depth, side_m, entries };
        plan.tiles = plan.all_tiles(scene);
        plan
    }

    /// Tiles of every depth; bounds of leaves from their instances, of others from their children.
    fn all_tiles(&self, scene: &Scene3d<'_>) -> Vec<Tile> {
        let mut tiles = Vec::new();
        for depth in 0..=self.depth {
            let lod = match self.depth - depth {
                0 => Lod::Near,
                1 => Lod::Middle,
                _ => Lod::Far,
            };
            let code = |entry: &Entry| entry.leaf >> (2 * (self.depth - depth));
            let mut first = 0;
            for run in self.entries.chunk_by(|a, b| code(a) == code(b)) {
                let end = first + run.len();
                let bounds = Bounds::EMPTY;
                tiles.push(Tile { depth, code: code(&run[0]), lod, bounds, first, end });
                first = end;
            }
        }
        let models: Vec<Bounds> =
            scene.instances.archetypes.par_iter().map(Bounds::of_archetype).collect();
        let leaf_bounds: Vec<Bounds> = tiles
            .par_iter()
            .filter(|tile| tile.depth == self.depth)
            .map(|tile| {
                let around = |entry: &Entry| {
                    let group = &scene.instances.groups[entry.group as usize];
                    models[group.archetype].of_instance(group, entry.instance as usize)
                };
                self.entries[tile.first..tile.end]
                    .iter()
                    .map(around)
                    .fold(Bounds::EMPTY, Bounds::union)
            })
            .collect();
        let leaves = tiles.len() - leaf_bounds.len();
        for (leaf, bounds) in leaf_bounds.iter().enumerate() {
            let code = tiles[leaves + leaf].code;
            for depth in 0..=self.depth {
                let at = place_of(&tiles, depth, code >> (2 * (self.depth - depth)));
                tiles[at].bounds = tiles[at].bounds.union(*bounds);
            }
        }
        tiles
    }

    /// The tile that holds all others, `None` where there is nothing.
    pub fn root(&self) -> Option<&Tile> {
        self.tiles.first()
    }

    /// Tiles one step below, and their places among all tiles.
    pub fn children(&self, tile: &Tile) -> impl Iterator<Item = (usize, &Tile)> {
        let (depth, code) = (tile.depth + 1, tile.code);
        let first = place_of(&self.tiles, depth, code << 2);
        let is_child = move |other: &Tile| other.depth == depth && other.code >> 2 == code;
        (first..).zip(&self.tiles[first..]).take_while(move |(_, other)| is_child(other))
    }

    /// Side of the square of tiles of a depth.
    pub fn side_m(&self, depth: u32) -> f64 {
        f64::from(self.side_m) / f64::from(1_u32 << depth)
    }

    /// What a tile shows: groups, and of each the instances.
    pub fn shown(&self, scene: &Scene3d<'_>, tile: &Tile) -> Vec<(usize, Vec<u32>)> {
        let mut of_group: Vec<Vec<u32>> = vec![Vec::new(); scene.instances.groups.len()];
        for entry in &self.entries[tile.first..tile.end] {
            if is_shown(scene, entry, tile.lod) {
                of_group[entry.group as usize].push(entry.instance);
            }
        }
        of_group.into_iter().enumerate().filter(|(_, shown)| !shown.is_empty()).collect()
    }

    /// Which levels of every archetype a tile shows.
    pub fn used_levels(&self, scene: &Scene3d<'_>) -> Vec<[bool; 3]> {
        let mut used = vec![[false; 3]; scene.instances.archetypes.len()];
        for entry in &self.entries {
            let archetype = scene.instances.groups[entry.group as usize].archetype;
            for lod in Lod::ALL {
                let used = &mut used[archetype][lod as usize];
                *used = *used || is_shown(scene, entry, lod);
            }
        }
        used
    }
}

/// Where a tile of a depth and code stands among tiles, or would stand.
fn place_of(tiles: &[Tile], depth: u32, code: u32) -> usize {
    tiles.partition_point(|tile| (tile.depth, tile.code) < (depth, code))
}

/// Whether a level of detail shows an instance.
fn is_shown(scene: &Scene3d<'_>, entry: &Entry, lod: Lod) -> bool {
    let group = &scene.instances.groups[entry.group as usize];
    let row = group.row[entry.instance as usize] as usize;
    match (lod, group.table) {
        (Lod::Near, _) => true,
        (Lod::Middle, FeatureTable::Plants) => scene.plants.height_m[row] >= MIDDLE_LEAST_M,
        (Lod::Middle, FeatureTable::Snags) => scene.snags.height_m[row] >= MIDDLE_LEAST_M,
        (Lod::Middle, FeatureTable::DownedLogs) => {
            scene.downed_logs.length_m[row] >= MIDDLE_LEAST_M
        }
        (Lod::Far, FeatureTable::Plants) => scene.plants.layer[row] == Layer::Canopy,
        (Lod::Far, FeatureTable::Snags) => scene.snags.height_m[row] >= FAR_SNAG_LEAST_M,
        (Lod::Far, FeatureTable::DownedLogs) => false,
    }
}

/// A number's bits with a gap before each.
fn spread(number: u32) -> u32 {
    (0..16).map(|bit| (number >> bit & 1) << (2 * bit)).sum()
}

#[cfg(test)]
mod tests {
    use super::super::super::example3d::{Example, SIDE_M};
    use super::*;

    #[test]
    fn tiles_hold_their_instances_and_children() {
        let example = Example::new(700);
        let scene = example.scene();
        let plan = Plan::new(&scene);
        let root = plan.root().unwrap();
        assert_eq!((root.first, root.end, root.lod), (0, 840, Lod::Far));
        for tile in &plan.tiles {
            let children: Vec<&Tile> = plan.children(tile).map(|(_, child)| child).collect();
            if tile.depth < plan.depth {
                assert_eq!(
                    children.iter().map(|c| c.end - c.first).sum::<usize>(),
                    tile.end - tile.first
                );
            }
            for child in children {
                let both = tile.bounds.union(child.bounds);
                assert_eq!(both, tile.bounds, "a parent's box holds its children's");
            }
            for entry in &plan.entries[tile.first..tile.end] {
                let group = &scene.instances.groups[entry.group as usize];
                let archetype = &scene.instances.archetypes[group.archetype];
                let around =
                    Bounds::of_archetype(archetype).of_instance(group, entry.instance as usize);
                assert_eq!(tile.bounds.union(around), tile.bounds);
            }
        }
    }

    #[test]
    fn levels_show_less_the_farther_they_are() {
        let example = Example::new(700);
        let scene = example.scene();
        let plan = Plan::new(&scene);
        let shown = |lod: Lod| -> usize {
            let of_level = plan.tiles.iter().filter(|tile| tile.lod == lod);
            of_level.flat_map(|tile| plan.shown(&scene, tile)).map(|(_, all)| all.len()).sum()
        };
        let canopy = example.plants.layer.iter().filter(|l| **l == Layer::Canopy).count();
        assert_eq!(shown(Lod::Near), 840);
        assert_eq!(shown(Lod::Far), canopy + 70);
        assert!(shown(Lod::Middle) <= 840);
    }

    #[test]
    fn names_tell_column_and_row() {
        let tile =
            |code| Tile { depth: 2, code, lod: Lod::Near, bounds: Bounds::EMPTY, first: 0, end: 0 };
        assert_eq!(tile(0b0110).name(), "2_2_1");
        assert_eq!(tile(spread(3) | spread(2) << 1).name(), "2_3_2");
    }

    #[test]
    fn leaves_are_small_enough() {
        let example = Example::new(40_000);
        let plan = Plan::new(&example.scene());
        assert!(plan.side_m(plan.depth) <= f64::from(SIDE_M) / 4.0);
        let leaves = plan.tiles.iter().filter(|tile| tile.depth == plan.depth).count();
        assert!(48_000 / leaves <= LEAF_INSTANCES);
    }
}
