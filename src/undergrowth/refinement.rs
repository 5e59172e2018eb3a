//! Refinement: undergrowth moved, swapped and resized until plants lie to each other as the statistics say.
//!
//! What is lessened is the sum, over clusters, pairs of kinds and categories, of |pairs counted − pairs wanted|. A change is
//! kept if that sum falls. Blocks of one turn work at the same time, each on the counts at the turn's beginning and its own
//! changes since, which it weighs as if every other block of the turn made the same: so that all together do not overshoot,
//! and the result depends on neither threads nor their order.
//!
//! Moves stay in the plant's cluster, swaps and changes of size are exchanges between two plants of a cluster: densities,
//! shares and size distributions stay what sampling made them. The canopy does not change.
//!
//! # Reference
//! Kapp et al. 2020, section 6.2, Disk-based refinement, doi:10.1145/3414685.3417848; Gain et al. 2017,
//! doi:10.1111/cgf.13106.

use rayon::prelude::*;

use super::Synthesis;
use super::disk_distance::{self, BINS, REACH_M};
use super::disks::Disks;
use super::measures::{BUCKET_M, Measures, TREE_BUCKET_M, WIDE_M};
use super::sampling::{Layout, Trees, Undergrowth};
use super::statistics::{ClusterFinder, Statistics};
use crate::plants::buckets::Buckets;
use crate::progress::{Cancelled, Reporter};
use crate::rng::{self, Key, Process};

/// Farthest that a plant moves in a sweep, m. chosen: across the categories of gap, and little against a block.
const MOVE_M: f32 = 1.5;
/// Sweeps at most. chosen: by then a sweep takes less than a hundredth off the difference.
const MOST_SWEEPS: u16 = 60;
/// A sweep that takes less than this share off the difference is the last. chosen: what it gains is not worth its time.
const LEAST_GAIN: f64 = 0.005;

/// A rectangle of a scene, metres from its north-west corner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Area {
    /// Western edge.
    pub west_m: f32,
    /// Northern edge.
    pub north_m: f32,
    /// Eastern edge.
    pub east_m: f32,
    /// Southern edge.
    pub south_m: f32,
}

impl Area {
    fn contains(&self, [east_m, south_m]: [f32; 2]) -> bool {
        (self.west_m..self.east_m).contains(&east_m)
            && (self.north_m..self.south_m).contains(&south_m)
    }
}

/// What refinement did.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RefinementFigures {
    /// Plants that could be changed.
    pub plants: usize,
    /// Difference from the statistics before, and after each sweep ([`Targets::difference`]).
    pub differences: Vec<f64>,
}

/// How many pairs of each category there should be.
pub struct Targets {
    pairs: Vec<f32>,
}

impl Targets {
    /// What statistics say of so many plants on so much ground of each cluster.
    pub fn of(statistics: &Statistics, measures: &Measures, area_m2: &[f32]) -> Self {
        let species = statistics.species.len();
        let mut pairs = vec![0.0; measures.pairs.len()];
        for (cluster, area_m2) in area_m2.iter().enumerate() {
            let plants = |of: u16| measures.plants[cluster * species + usize::from(of)] as f32;
            for pair in statistics.pairs(cluster) {
                let is_canopy = usize::from(pair.near) == species;
                let density = if is_canopy { 1.0 } else { plants(pair.near) / area_m2.max(1.0) };
                let first = measures.pair(cluster, usize::from(pair.of), usize::from(pair.near));
                for (bin, near_a_plant) in pair.near_a_plant.iter().enumerate() {
                    pairs[first + bin] = near_a_plant * density * plants(pair.of);
                }
            }
        }
        Self { pairs }
    }

    /// Sum of |pairs counted − pairs wanted| over the sum of pairs wanted.
    pub fn difference(&self, measures: &Measures) -> f64 {
        let (mut apart, mut wanted) = (0.0, 0.0);
        for (count, target) in measures.pairs.iter().zip(&self.pairs) {
            apart += (f64::from(*count) - f64::from(*target)).abs();
            wanted += f64::from(*target);
        }
        if wanted > 0.0 { apart / wanted } else { 0.0 }
    }
}

/// Refines undergrowth, or what of it stands in an area.
///
/// # Errors
/// [`Cancelled`] once the run was cancelled.
pub fn refine(
    undergrowth: &mut Undergrowth,
    synthesis: &Synthesis<'_>,
    area: Option<Area>,
    reporter: &Reporter,
) -> Result<RefinementFigures, Cancelled> {
    let Synthesis { conditions, trees, statistics, .. } = *synthesis;
    let frame = conditions.site().slope_rad.frame();
    let layout = Layout::new(frame.rows, frame.cols, frame.cell_m());
    let ground = Ground::new(synthesis);
    let place = |plant: usize| [undergrowth.disks.east_m[plant], undergrowth.disks.south_m[plant]];
    let is_counted = |plant: usize| area.is_none_or(|area| area.contains(place(plant)));
    let cluster_of: Vec<Option<u16>> = (0..undergrowth.disks.len())
        .map(|plant| is_counted(plant).then(|| undergrowth.cluster[plant]))
        .collect();
    let (clusters, species) = (statistics.clusters.len(), statistics.species.len());
    let measure = |disks: &Disks| Measures::of(clusters, species, disks, &cluster_of, &trees.disks);
    let stage = reporter.stage("refinement", 4 * u64::from(MOST_SWEEPS));
    let mut measures = measure(&undergrowth.disks);
    let targets = Targets::of(statistics, &measures, &ground.area_m2(statistics, area));
    let mut figures = RefinementFigures {
        plants: cluster_of.iter().flatten().count(),
        differences: vec![targets.difference(&measures)],
    };
    let tree_buckets = Buckets::new(&trees.disks.east_m, &trees.disks.south_m, TREE_BUCKET_M);
    let shared = Shared {
        layout: &layout,
        ground: &ground,
        trees,
        tree_buckets: &tree_buckets,
        widest_tree_m: trees.disks.widest_m(),
        widest_trunk_m: trees.trunk_m.iter().copied().fold(0.0, f32::max),
        targets: &targets.pairs,
        area,
        seed: synthesis.seed,
    };
    for sweep in 1..=MOST_SWEEPS {
        let mut by_block: Vec<Vec<u32>> = vec![Vec::new(); layout.rows * layout.cols];
        for plant in 0..undergrowth.disks.len() {
            let place = [undergrowth.disks.east_m[plant], undergrowth.disks.south_m[plant]];
            by_block[layout.block_at(place)].push(plant as u32); // far fewer than 2³²
        }
        for turn in 0..4 {
            reporter.check_cancelled()?;
            let mut of_turn = layout.of_turn(turn);
            of_turn.retain(|block| {
                by_block[*block].iter().any(|plant| cluster_of[*plant as usize].is_some())
            });
            let weights = weights(&of_turn, &by_block, &cluster_of, clusters);
            let turn = Turn { undergrowth, cluster_of: &cluster_of, measures: &measures, weights };
            let changes: Vec<Changes> = of_turn
                .par_iter()
                .map_init(
                    || Scratch::new(measures.pairs.len()),
                    |scratch, block| {
                        let around = layout.around(*block);
                        let around: Vec<u32> =
                            around.flat_map(|block| by_block[block].iter().copied()).collect();
                        let mut block =
                            Block::new(&shared, &turn, scratch, *block, &by_block[*block], &around);
                        block.sweep(sweep);
                        block.changes()
                    },
                )
                .collect();
            for change in changes {
                change.write(undergrowth, &mut measures, &ground);
            }
            stage.advance(1);
        }
        let difference = targets.difference(&measures);
        let before = figures.differences[figures.differences.len() - 1];
        figures.differences.push(difference);
        if difference >= before * (1.0 - LEAST_GAIN) {
            break;
        }
    }
    debug_assert!(measures == measure(&undergrowth.disks), "counts drifted");
    Ok(figures)
}

/// How many blocks of a turn have plants of each cluster: a change counts as many times, as if all of them made it.
fn weights(
    of_turn: &[usize],
    by_block: &[Vec<u32>],
    cluster_of: &[Option<u16>],
    clusters: usize,
) -> Vec<f32> {
    let mut weights = vec![0.0; clusters];
    let mut last = vec![usize::MAX; clusters];
    for block in of_turn {
        for cluster in by_block[*block].iter().filter_map(|plant| cluster_of[*plant as usize]) {
            let cluster = usize::from(cluster);
            if last[cluster] != *block {
                last[cluster] = *block;
                weights[cluster] += 1.0;
            }
        }
    }
    weights
}

/// Ground where nothing grows.
const NO_CLUSTER: u16 = u16::MAX;

/// Clusters of the ground.
struct Ground {
    cluster: Vec<u16>,
    /// Sub-biomes that shed seeds.
    sub_biomes: Vec<u32>,
    /// Height that plants stay below, m.
    limit_m: Vec<f32>,
    rows: usize,
    cols: usize,
    cell_m: f32,
}

impl Ground {
    fn new(synthesis: &Synthesis<'_>) -> Self {
        let Synthesis { conditions, allowed, statistics, .. } = *synthesis;
        let frame = conditions.site().slope_rad.frame();
        let finder = ClusterFinder::new(statistics);
        let of_cell = |cell: usize| {
            let seeds = conditions.seeds(cell);
            let sub_biomes = seeds.sub_biomes;
            if sub_biomes == 0 || !allowed.is_valid(cell) {
                return (NO_CLUSTER, 0);
            }
            let clusters = finder.clusters(sub_biomes);
            (finder.nearest(&conditions.factors(cell, seeds), clusters) as u16, sub_biomes)
        };
        let (cluster, sub_biomes) = (0..frame.len()).into_par_iter().map(of_cell).unzip();
        let (rows, cols, cell_m) = (frame.rows, frame.cols, frame.cell_m());
        let limit_m = (0..frame.len()).map(|cell| conditions.limit_m(cell)).collect();
        Self { cluster, sub_biomes, limit_m, rows, cols, cell_m }
    }

    /// Ground of each cluster in an area.
    fn area_m2(&self, statistics: &Statistics, area: Option<Area>) -> Vec<f32> {
        let mut cells = vec![0_usize; statistics.clusters.len()];
        for (cell, cluster) in self.cluster.iter().enumerate() {
            let middle =
                [cell % self.cols, cell / self.cols].map(|at| (at as f32 + 0.5) * self.cell_m);
            if *cluster != NO_CLUSTER && area.is_none_or(|area| area.contains(middle)) {
                cells[usize::from(*cluster)] += 1;
            }
        }
        cells.into_iter().map(|cells| cells as f32 * self.cell_m * self.cell_m).collect()
    }

    fn cell_at(&self, [east_m, south_m]: [f32; 2]) -> Option<usize> {
        if east_m < 0.0 || south_m < 0.0 {
            return None;
        }
        let (row, col) = ((south_m / self.cell_m) as usize, (east_m / self.cell_m) as usize);
        (row < self.rows && col < self.cols).then_some(row * self.cols + col)
    }
}

/// What all blocks know.
struct Shared<'a> {
    layout: &'a Layout,
    ground: &'a Ground,
    trees: &'a Trees,
    tree_buckets: &'a Buckets,
    widest_tree_m: f32,
    widest_trunk_m: f32,
    targets: &'a [f32],
    area: Option<Area>,
    seed: u64,
}

/// What a turn begins with.
struct Turn<'a> {
    undergrowth: &'a Undergrowth,
    cluster_of: &'a [Option<u16>],
    measures: &'a Measures,
    weights: Vec<f32>,
}

/// Counts that a block changes; all zero between blocks.
struct Scratch {
    /// Change of each count since the turn began.
    changed: Vec<i32>,
    /// Change that is being tried.
    tried: Vec<i32>,
    /// Counts that it touches, each once.
    touched: Vec<u32>,
    is_touched: Vec<bool>,
    /// Counts that were changed.
    ever_touched: Vec<u32>,
}

impl Scratch {
    fn new(counts: usize) -> Self {
        Self {
            changed: vec![0; counts],
            tried: vec![0; counts],
            touched: Vec::new(),
            is_touched: vec![false; counts],
            ever_touched: Vec::new(),
        }
    }
}

/// A plant in a block.
#[derive(Clone, Copy)]
struct Plant {
    index: u32,
    id: u64,
    place: [f32; 2],
    radius_m: f32,
    height_m: f32,
    species: u16,
    /// None if it is seen by others only.
    cluster: Option<u16>,
}

/// What a block changed.
struct Changes {
    plants: Vec<Plant>,
    pairs: Vec<(u32, i32)>,
}

impl Changes {
    fn write(self, undergrowth: &mut Undergrowth, measures: &mut Measures, ground: &Ground) {
        for plant in self.plants {
            let index = plant.index as usize;
            let disks = &mut undergrowth.disks;
            [disks.east_m[index], disks.south_m[index]] = plant.place;
            disks.radius_m[index] = plant.radius_m;
            disks.height_m[index] = plant.height_m;
            disks.species[index] = plant.species;
            if let Some(cell) = ground.cell_at(plant.place) {
                undergrowth.cell[index] = cell as u32; // scenes have fewer cells
            }
        }
        for (pair, change) in self.pairs {
            let count = &mut measures.pairs[pair as usize];
            *count = count.saturating_add_signed(change);
        }
    }
}

/// A block at work: its own plants first, then those around.
struct Block<'a> {
    shared: &'a Shared<'a>,
    turn: &'a Turn<'a>,
    scratch: &'a mut Scratch,
    own: usize,
    plants: Vec<Plant>,
    narrow: Grid,
    wide: Grid,
}

/// Plants of a block by bucket.
struct Grid {
    corner_m: [f32; 2],
    count: usize,
    buckets: Vec<Vec<u32>>,
    widest_m: f32,
}

impl Grid {
    fn new(corner_m: [f32; 2], side_m: f32) -> Self {
        let count = (side_m / BUCKET_M).ceil() as usize;
        Self { corner_m, count, buckets: vec![Vec::new(); count * count], widest_m: 0.0 }
    }

    fn line(&self, at_m: f32, axis: usize) -> usize {
        // `as` cuts negatives to 0
        (((at_m - self.corner_m[axis]) / BUCKET_M) as usize).min(self.count - 1)
    }

    fn bucket(&self, place: [f32; 2]) -> usize {
        self.line(place[1], 1) * self.count + self.line(place[0], 0)
    }

    fn add(&mut self, plant: u32, place: [f32; 2], radius_m: f32) {
        let bucket = self.bucket(place);
        self.buckets[bucket].push(plant);
        self.widest_m = self.widest_m.max(radius_m);
    }

    fn take(&mut self, plant: u32, place: [f32; 2]) {
        let bucket = self.bucket(place);
        let plants = &mut self.buckets[bucket];
        if let Some(at) = plants.iter().position(|other| *other == plant) {
            plants.swap_remove(at);
        }
    }
}

impl<'a> Block<'a> {
    fn new(
        shared: &'a Shared<'a>,
        turn: &'a Turn<'a>,
        scratch: &'a mut Scratch,
        block: usize,
        own: &[u32],
        around: &[u32],
    ) -> Self {
        let Turn { undergrowth, cluster_of, .. } = *turn;
        let disks = &undergrowth.disks;
        let of = |index: &u32| {
            let plant = *index as usize;
            Plant {
                index: *index,
                id: undergrowth.id[plant],
                place: [disks.east_m[plant], disks.south_m[plant]],
                radius_m: disks.radius_m[plant],
                height_m: disks.height_m[plant],
                species: disks.species[plant],
                cluster: cluster_of[plant],
            }
        };
        let mut plants: Vec<Plant> = own.iter().map(of).collect();
        // what may come within reach of an own plant
        let widest_m = plants.iter().map(|plant| plant.radius_m).fold(0.0, f32::max);
        let corner_m = shared.layout.corner_m(block);
        let side_m = shared.layout.side_m();
        let is_near = |plant: &Plant| {
            let reach_m = MOVE_M + widest_m + REACH_M + plant.radius_m;
            (0..2).all(|axis| {
                let from_m = plant.place[axis] - corner_m[axis];
                from_m > -reach_m && from_m < side_m + reach_m
            })
        };
        plants.extend(around.iter().map(of).filter(is_near));
        // buckets reach as far as undergrowth may be wide; farther plants share the outermost
        let rim_m = 8.0;
        let grid = || Grid::new(corner_m.map(|m| m - rim_m), side_m + 2.0 * rim_m);
        let (mut narrow, mut wide) = (grid(), grid());
        for (plant, Plant { place, radius_m, .. }) in plants.iter().enumerate() {
            let grid = if *radius_m > WIDE_M { &mut wide } else { &mut narrow };
            grid.add(plant as u32, *place, *radius_m);
        }
        Self { shared, turn, scratch, own: own.len(), plants, narrow, wide }
    }

    /// Tries a change of each own plant.
    fn sweep(&mut self, sweep: u16) {
        for plant in 0..self.own {
            if self.plants[plant].cluster.is_none() {
                continue;
            }
            let (seed, entity) = (self.shared.seed, self.plants[plant].id);
            let process = Process::UndergrowthRefinement;
            let draws = rng::uniforms(Key { seed, process, year: sweep, month: 0, entity });
            // moves and exchanges in turn, half of the plants each
            let is_move = (usize::from(sweep) + plant).is_multiple_of(2);
            if is_move || !self.try_exchange(plant, draws) {
                self.try_move(plant, draws);
            }
        }
    }

    fn try_move(&mut self, plant: usize, [east, south, ..]: [f32; 4]) {
        let old = self.plants[plant];
        let place = [
            old.place[0] + (2.0 * east - 1.0) * MOVE_M,
            old.place[1] + (2.0 * south - 1.0) * MOVE_M,
        ];
        let ground = self.shared.ground;
        let (Some(from), Some(to)) = (ground.cell_at(old.place), ground.cell_at(place)) else {
            return;
        };
        let is_alike = ground.cluster[to] == old.cluster.unwrap_or(NO_CLUSTER)
            && ground.sub_biomes[from] == ground.sub_biomes[to]
            && old.height_m < ground.limit_m[to];
        let is_inside = self.shared.area.is_none_or(|area| area.contains(place));
        if !is_alike || !is_inside || self.is_in_trunk(place) {
            return;
        }
        self.count(plant, -1, usize::MAX);
        self.change(plant, Plant { place, ..old });
        self.count(plant, 1, usize::MAX);
        if self.is_better() {
            self.keep();
        } else {
            self.change(plant, old);
            self.forget();
        }
    }

    /// Exchanges species and size with another plant of the cluster; gives whether there was one.
    fn try_exchange(&mut self, plant: usize, [.., which, _]: [f32; 4]) -> bool {
        let other = ((which * self.own as f32) as usize).min(self.own - 1);
        let (a, b) = (self.plants[plant], self.plants[other]);
        let ground = self.shared.ground;
        let (Some(at_a), Some(at_b)) = (ground.cell_at(a.place), ground.cell_at(b.place)) else {
            return false;
        };
        let is_same = a.species == b.species && a.height_m == b.height_m;
        let has_room = a.height_m < ground.limit_m[at_b] && b.height_m < ground.limit_m[at_a];
        let is_alike = a.cluster == b.cluster && ground.sub_biomes[at_a] == ground.sub_biomes[at_b];
        if is_same || !is_alike || !has_room {
            return false;
        }
        self.count(plant, -1, usize::MAX);
        self.count(other, -1, plant);
        let with = |plant: Plant, of: Plant| Plant {
            species: of.species,
            height_m: of.height_m,
            radius_m: of.radius_m,
            ..plant
        };
        self.change(plant, with(a, b));
        self.change(other, with(b, a));
        self.count(plant, 1, usize::MAX);
        self.count(other, 1, plant);
        if self.is_better() {
            self.keep();
        } else {
            self.change(plant, a);
            self.change(other, b);
            self.forget();
        }
        true
    }

    fn is_in_trunk(&self, place: [f32; 2]) -> bool {
        let Shared { trees, tree_buckets, widest_trunk_m, .. } = self.shared;
        let mut is_in_trunk = false;
        tree_buckets.near(place, *widest_trunk_m, |tree| {
            let east_m = trees.disks.east_m[tree] - place[0];
            let south_m = trees.disks.south_m[tree] - place[1];
            is_in_trunk |= east_m * east_m + south_m * south_m < trees.trunk_m[tree].powi(2);
        });
        is_in_trunk
    }

    fn change(&mut self, plant: usize, to: Plant) {
        let old = self.plants[plant];
        let number = plant as u32; // some thousands
        if old.radius_m > WIDE_M {
            self.wide.take(number, old.place);
        } else {
            self.narrow.take(number, old.place);
        }
        let grid = if to.radius_m > WIDE_M { &mut self.wide } else { &mut self.narrow };
        grid.add(number, to.place, to.radius_m);
        self.plants[plant] = to;
    }

    /// Adds a plant's pairs, both ways, or takes them away; but for those with one other.
    fn count(&mut self, plant: usize, sign: i32, without: usize) {
        let Self { plants, narrow, wide, shared, turn, scratch, .. } = self;
        let Scratch { tried, touched, is_touched, .. } = &mut **scratch;
        let measures = turn.measures;
        let own = plants[plant];
        let Some(cluster) = own.cluster.map(usize::from) else { return };
        let mut add = |index: usize| {
            if !is_touched[index] {
                is_touched[index] = true;
                touched.push(index as u32); // far fewer than 2³²
            }
            tried[index] += sign;
        };
        let first = measures.pair(cluster, usize::from(own.species), 0);
        let away_m = |place: [f32; 2]| {
            let [east_m, south_m] = [place[0] - own.place[0], place[1] - own.place[1]];
            (east_m * east_m + south_m * south_m).sqrt()
        };
        for grid in [&*narrow, &*wide] {
            let reach_m = own.radius_m + REACH_M + grid.widest_m;
            let [left, right] = [-reach_m, reach_m].map(|by| grid.line(own.place[0] + by, 0));
            let [top, bottom] = [-reach_m, reach_m].map(|by| grid.line(own.place[1] + by, 1));
            for row in top..=bottom {
                for bucket in &grid.buckets[row * grid.count + left..=row * grid.count + right] {
                    for other in bucket {
                        let index = *other as usize;
                        let other = &plants[index];
                        let bin =
                            disk_distance::bin(away_m(other.place), own.radius_m, other.radius_m);
                        let Some(bin) = bin else { continue };
                        if index == plant || index == without {
                            continue;
                        }
                        add(first + usize::from(other.species) * BINS + bin);
                        if let Some(cluster) = other.cluster {
                            let (of, near) = (usize::from(other.species), usize::from(own.species));
                            add(measures.pair(usize::from(cluster), of, near) + bin);
                        }
                    }
                }
            }
        }
        let canopy = measures.kinds() - 1;
        let (disks, reach_m) = (&shared.trees.disks, own.radius_m + REACH_M + shared.widest_tree_m);
        shared.tree_buckets.near(own.place, reach_m, |tree| {
            let away_m = away_m([disks.east_m[tree], disks.south_m[tree]]);
            if let Some(bin) = disk_distance::bin(away_m, own.radius_m, disks.radius_m[tree]) {
                add(first + canopy * BINS + bin);
            }
        });
    }

    /// Whether what is tried brings counts nearer to what is wanted.
    fn is_better(&self) -> bool {
        let Scratch { changed, tried, touched, .. } = &*self.scratch;
        let Turn { measures, weights, .. } = self.turn;
        let of_cluster = measures.pair(1, 0, 0);
        let mut gain = 0.0;
        for index in touched {
            let index = *index as usize;
            if tried[index] != 0 {
                let weight = weights[index / of_cluster];
                let now = measures.pairs[index] as f32 + weight * changed[index] as f32;
                let then = now + weight * tried[index] as f32;
                let wanted = self.shared.targets[index];
                gain += (now - wanted).abs() - (then - wanted).abs();
            }
        }
        gain > 0.0
    }

    fn keep(&mut self) {
        let Scratch { changed, tried, touched, is_touched, ever_touched } = &mut *self.scratch;
        for index in touched.drain(..) {
            let at = index as usize;
            is_touched[at] = false;
            if tried[at] != 0 {
                changed[at] += tried[at];
                ever_touched.push(index);
                tried[at] = 0;
            }
        }
    }

    fn forget(&mut self) {
        let Scratch { tried, touched, is_touched, .. } = &mut *self.scratch;
        for index in touched.drain(..) {
            is_touched[index as usize] = false;
            tried[index as usize] = 0;
        }
    }

    /// What was changed; leaves the scratch empty.
    fn changes(mut self) -> Changes {
        let Scratch { changed, ever_touched, .. } = &mut *self.scratch;
        ever_touched.sort_unstable();
        ever_touched.dedup();
        let take = |index: u32| (index, std::mem::take(&mut changed[index as usize]));
        let pairs = ever_touched.drain(..).map(take).filter(|(_, change)| *change != 0).collect();
        self.plants.truncate(self.own);
        Changes { plants: self.plants, pairs }
    }
}

#[cfg(test)]
mod tests {
    use super::super::sampling;
    use super::super::sampling::tests::with_scene;
    use super::super::statistics::tests::example;
    use super::*;
    use crate::species::Biome;

    fn refined(
        biome: &Biome,
        area: Option<Area>,
        threads: usize,
    ) -> (Undergrowth, Undergrowth, RefinementFigures) {
        let statistics = example(biome);
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            with_scene(biome, &statistics, |synthesis| {
                let reporter = Reporter::silent();
                let sampled = sampling::sample(synthesis, &reporter).unwrap();
                let mut refined = sampled.clone();
                let figures = refine(&mut refined, synthesis, area, &reporter).unwrap();
                (sampled, refined, figures)
            })
        })
    }

    /// Heights of each cluster's species, sorted.
    fn sizes(undergrowth: &Undergrowth) -> Vec<(u16, u16, u32)> {
        let disks = &undergrowth.disks;
        let mut sizes: Vec<_> = (0..disks.len())
            .map(|i| (undergrowth.cluster[i], disks.species[i], disks.height_m[i].to_bits()))
            .collect();
        sizes.sort_unstable();
        sizes
    }

    #[test]
    fn plants_come_to_lie_as_asked_and_stay_what_they_are() {
        let biome = Biome::builtin("sonoma").unwrap();
        let (sampled, refined, figures) = refined(&biome, None, 2);
        let differences = &figures.differences;
        assert!(differences.is_sorted_by(|a, b| a >= b), "{differences:?}");
        let (first, last) = (differences[0], differences[differences.len() - 1]);
        assert!(last < 0.8 * first, "{first} {last}");
        assert_eq!(figures.plants, sampled.disks.len());
        assert_eq!(sizes(&sampled), sizes(&refined));
        assert_ne!(sampled.disks.east_m, refined.disks.east_m);
    }

    #[test]
    fn plants_outside_the_area_stay() {
        let biome = Biome::builtin("sonoma").unwrap();
        let area = Area { west_m: 10.0, north_m: 40.0, east_m: 40.0, south_m: 70.0 };
        let (sampled, refined, figures) = refined(&biome, Some(area), 2);
        let mut changed = 0;
        for plant in 0..sampled.disks.len() {
            let place = |of: &Undergrowth| [of.disks.east_m[plant], of.disks.south_m[plant]];
            assert_eq!(area.contains(place(&sampled)), area.contains(place(&refined)));
            let is_same = place(&sampled) == place(&refined);
            assert!(is_same || area.contains(place(&sampled)));
            changed += usize::from(!is_same);
        }
        assert!(changed > 20 && changed <= figures.plants, "{changed}");
    }

    #[test]
    fn threads_do_not_matter() {
        let biome = Biome::builtin("sonoma").unwrap();
        assert_eq!(refined(&biome, None, 1), refined(&biome, None, 3));
    }
}
