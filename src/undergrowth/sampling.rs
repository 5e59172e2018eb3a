//! Sampling: undergrowth thrown onto the ground by the statistics of its cluster.
//!
//! Each ground cell gets as many plants as its cluster has at its chance of seeds, each a species and a height of that
//! cluster's, then a place in the cell. Blocks of ground are filled in four turns, so that blocks of one turn do not touch:
//! the result depends on neither threads nor their order.
//!
//! # Reference
//! Kapp et al. 2020, section 6.2, Sampling, doi:10.1145/3414685.3417848.
//! # Departures
//! Their passes go on until a cluster's density is reached; here a cell's number of plants follows at once from its density,
//! so that no cell waits for others. Their sampler ignores which sub-biomes are near; here no plant stands where its
//! sub-biome sheds no seeds.

use rayon::prelude::*;

use super::Synthesis;
use super::disks::Disks;
use super::statistics::{ClusterFinder, SpeciesShare};
use crate::plants::{Layer, Plants};
use crate::progress::{Cancelled, Reporter};
use crate::rng::{self, Key, Process};

/// Width of the blocks that are filled at once, m. chosen: some thousands of plants; much more than plants keep apart.
pub const BLOCK_M: f32 = 32.0;
/// Places that are tried for a plant. chosen: the fourth is hardly needed.
const TRIES: u8 = 4;
/// Share of its crown's radius that a plant keeps free of others' same share. chosen: of 0–0.4 the one that leaves pair
/// distances of simulated plots nearest to theirs.
const CORE_FRACTION: f32 = 0.15;
/// Side of the squares in which neighbours are sought, m. chosen: two cores, but of shrubs wider than 3 m.
const SQUARE_M: f32 = 1.0;
/// Ids of undergrowth begin here, those of the canopy end far below.
const FIRST_ID: u64 = 1 << 40;
/// Most plants of a cell: ids of the next begin after so many. chosen: cells of 10 m with 160 plants a m².
const IDS_PER_CELL: u64 = 1 << 14;

/// Undergrowth on the ground of a scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Undergrowth {
    /// Unique in a scene.
    pub id: Vec<u64>,
    /// The plants.
    pub disks: Disks,
    /// Index of the ground cell that each was made for.
    pub cell: Vec<u32>,
    /// Index of its cluster.
    pub cluster: Vec<u16>,
}

/// Canopy trees as undergrowth sees them, metres from the north-west corner.
#[derive(Clone, Debug, Default)]
pub struct Trees {
    /// Their crowns.
    pub disks: Disks,
    /// Radius of the trunk.
    pub trunk_m: Vec<f32>,
}

impl Trees {
    /// The canopy trees of a scene so many metres high from south to north.
    pub fn of(plants: &Plants, scene_height_m: f32) -> Self {
        let mut trees = Self::default();
        for tree in (0..plants.len()).filter(|tree| plants.layer[*tree] == Layer::Canopy) {
            let place = [plants.east_m[tree], scene_height_m - plants.north_m[tree]];
            let (radius_m, height_m) = (plants.crown_radius_m[tree], plants.height_m[tree]);
            trees.disks.push(plants.species[tree], place, radius_m, height_m);
            trees.trunk_m.push(0.5 * plants.dbh_m[tree]);
        }
        trees
    }
}

/// A plant before it has a place.
#[derive(Clone, Copy)]
struct Unplaced {
    cell: u32,
    number: u16,
    cluster: u16,
    species: u16,
    height_m: f32,
    radius_m: f32,
    place: [f32; 2],
}

/// Undergrowth of a scene, cells in their order.
///
/// ```
/// use wildwood::canopy::site::Site;
/// use wildwood::plants::{Layer, Plants};
/// use wildwood::raster::{Grid, Mask};
/// use wildwood::simulation::Parameters;
/// use wildwood::undergrowth::{Conditions, Statistics, Synthesis, Trees, sampling};
/// use wildwood::{progress::Reporter, species::Biome};
///
/// // a redwood in the middle of level ground of 40 m
/// let biome = Biome::builtin("sonoma")?;
/// let redwood = biome.species_index("redwood").ok_or("no redwood")?;
/// let canopy = Plants {
///     id: vec![1],
///     species: vec![redwood as u16],
///     layer: vec![Layer::Canopy],
///     east_m: vec![20.0],
///     north_m: vec![20.0],
///     z_m: vec![300.0],
///     height_m: vec![30.0],
///     crown_radius_m: vec![4.0],
///     dbh_m: vec![0.8],
///     age_years: vec![60.0],
///     vigor: vec![1.0],
/// };
/// let level = Grid::from_fn(40, 40, 1.0, |_| 0.0);
/// let everywhere = |value: f32| level.with_values(vec![value; 40 * 40]);
/// let site = Site {
///     sun_h: everywhere(8.5),
///     moisture_mm: everywhere(120.0),
///     temperature_c: everywhere(15.0),
///     slope_rad: everywhere(0.1),
/// };
///
/// let parameters = Parameters::undergrowth(&biome);
/// let undergrowth = sampling::sample(
///     &Synthesis {
///         conditions: &Conditions::under(&canopy, &site, &biome, &parameters),
///         allowed: &Mask::all_valid(40 * 40),
///         trees: &Trees::of(&canopy, 40.0),
///         statistics: &Statistics::builtin(&biome)?,
///         biome: &biome,
///         seed: 1,
///     },
///     &Reporter::silent(),
/// )?;
/// assert!(undergrowth.disks.len() > 100);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// [`Cancelled`] once the run was cancelled.
pub fn sample(synthesis: &Synthesis<'_>, reporter: &Reporter) -> Result<Undergrowth, Cancelled> {
    let frame = synthesis.conditions.site().slope_rad.frame();
    let layout = Layout::new(frame.rows, frame.cols, frame.cell_m());
    let stage = reporter.stage("undergrowth", 4);
    let sampler = Sampler::new(synthesis);
    let trunks = layout.trunks(synthesis.trees);
    let mut blocks: Vec<Vec<Unplaced>> = vec![Vec::new(); layout.rows * layout.cols];
    for turn in 0..4 {
        reporter.check_cancelled()?;
        let of_turn = layout.of_turn(turn);
        let filled: Vec<Vec<Unplaced>> = of_turn
            .par_iter()
            .map(|block| sampler.fill(*block, &layout, &trunks[*block], &blocks))
            .collect();
        of_turn.into_iter().zip(filled).for_each(|(block, plants)| blocks[block] = plants);
        stage.advance(1);
    }
    let mut plants = Vec::with_capacity(blocks.iter().map(Vec::len).sum());
    blocks.into_iter().for_each(|block| plants.extend(block));
    plants.par_sort_unstable_by_key(|plant| (plant.cell, plant.number));
    let mut undergrowth = Undergrowth {
        id: plants.iter().map(Unplaced::id).collect(),
        cell: plants.iter().map(|plant| plant.cell).collect(),
        cluster: plants.iter().map(|plant| plant.cluster).collect(),
        disks: Disks::default(),
    };
    for plant in &plants {
        undergrowth.disks.push(plant.species, plant.place, plant.radius_m, plant.height_m);
    }
    Ok(undergrowth)
}

impl Unplaced {
    fn id(&self) -> u64 {
        FIRST_ID + u64::from(self.cell) * IDS_PER_CELL + u64::from(self.number)
    }
}

/// Blocks of ground cells.
pub(super) struct Layout {
    pub rows: usize,
    pub cols: usize,
    /// Ground cells along a block's side.
    pub cells: usize,
    ground_rows: usize,
    ground_cols: usize,
    cell_m: f32,
}

impl Layout {
    pub fn new(ground_rows: usize, ground_cols: usize, cell_m: f32) -> Self {
        let cells = ((BLOCK_M / cell_m).round() as usize).max(2);
        let (rows, cols) = (ground_rows.div_ceil(cells), ground_cols.div_ceil(cells));
        Self { rows, cols, cells, ground_rows, ground_cols, cell_m }
    }

    /// Blocks of one of four turns.
    pub fn of_turn(&self, turn: usize) -> Vec<usize> {
        let of_turn = |block: &usize| (block / self.cols % 2) * 2 + block % self.cols % 2 == turn;
        (0..self.rows * self.cols).filter(of_turn).collect()
    }

    /// The block of a place.
    pub fn block_at(&self, [east_m, south_m]: [f32; 2]) -> usize {
        let block_m = self.cells as f32 * self.cell_m;
        // `as` cuts negatives to 0
        let line = |at_m: f32, count: usize| ((at_m / block_m) as usize).min(count - 1);
        line(south_m, self.rows) * self.cols + line(east_m, self.cols)
    }

    /// West and north edge of a block.
    pub fn corner_m(&self, block: usize) -> [f32; 2] {
        let block_m = self.cells as f32 * self.cell_m;
        [(block % self.cols) as f32 * block_m, (block / self.cols) as f32 * block_m]
    }

    /// Side of a block.
    pub fn side_m(&self) -> f32 {
        self.cells as f32 * self.cell_m
    }

    /// Blocks around one.
    pub fn around(&self, block: usize) -> impl Iterator<Item = usize> + '_ {
        let (row, col) = (block / self.cols, block % self.cols);
        let rows = row.saturating_sub(1)..(row + 2).min(self.rows);
        rows.flat_map(move |row| {
            (col.saturating_sub(1)..(col + 2).min(self.cols)).map(move |col| row * self.cols + col)
        })
        .filter(move |other| *other != block)
    }

    /// Trunks by the blocks that they may reach into: place and radius.
    fn trunks(&self, trees: &Trees) -> Vec<Vec<([f32; 2], f32)>> {
        let mut trunks = vec![Vec::new(); self.rows * self.cols];
        for (tree, radius_m) in trees.trunk_m.iter().enumerate() {
            let place = [trees.disks.east_m[tree], trees.disks.south_m[tree]];
            let reach_m = radius_m + SQUARE_M;
            let mut reached: Vec<usize> = [[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]]
                .iter()
                .map(|[east, south]| {
                    self.block_at([place[0] + east * reach_m, place[1] + south * reach_m])
                })
                .collect();
            reached.dedup();
            reached.sort_unstable();
            reached.dedup();
            reached.into_iter().for_each(|block| trunks[block].push((place, *radius_m)));
        }
        trunks
    }
}

struct Sampler<'a> {
    synthesis: &'a Synthesis<'a>,
    finder: ClusterFinder<'a>,
    sub_biomes: Vec<u32>,
    /// Absolute number of the first column and row.
    first: [i64; 2],
}

impl<'a> Sampler<'a> {
    fn new(synthesis: &'a Synthesis<'a>) -> Self {
        let transform = synthesis.conditions.site().slope_rad.frame().transform;
        // places are below 10⁹ cells
        let number = |m: f64| (m / transform.cell_m).round() as i64;
        let bits = |sub_biomes: &Vec<usize>| sub_biomes.iter().fold(0, |bits, i| bits | 1 << i);
        let species = &synthesis.biome.species;
        Self {
            finder: ClusterFinder::new(synthesis.statistics),
            sub_biomes: species.iter().map(|species| bits(&species.sub_biomes)).collect(),
            first: [number(transform.west_m), number(transform.north_m)],
            synthesis,
        }
    }

    /// A block's plants, the widest placed first.
    fn fill(
        &self,
        block: usize,
        layout: &Layout,
        trunks: &[([f32; 2], f32)],
        blocks: &[Vec<Unplaced>],
    ) -> Vec<Unplaced> {
        let mut plants = self.unplaced(block, layout);
        plants.sort_unstable_by(|a, b| {
            let wider = b.radius_m.total_cmp(&a.radius_m);
            wider.then((a.cell, a.number).cmp(&(b.cell, b.number)))
        });
        let mut squares = Squares::new(layout.corner_m(block), layout.side_m());
        for other in layout.around(block) {
            blocks[other].iter().for_each(|plant| squares.add(plant.place, plant.radius_m));
        }
        plants.retain_mut(|plant| {
            let Some(place) = self.place(plant, layout, trunks, &squares) else { return false };
            plant.place = place;
            squares.add(place, plant.radius_m);
            true
        });
        plants
    }

    /// How many plants of which kind a block's cells get.
    fn unplaced(&self, block: usize, layout: &Layout) -> Vec<Unplaced> {
        let Layout { cells, ground_rows, ground_cols, cell_m, .. } = *layout;
        let (top, left) = (block / layout.cols * cells, block % layout.cols * cells);
        let Synthesis { conditions, allowed, statistics, biome, .. } = *self.synthesis;
        let mut plants = Vec::new();
        let mut known: (u32, &[usize]) = (0, &[]);
        for row in top..(top + cells).min(ground_rows) {
            for col in left..(left + cells).min(ground_cols) {
                let cell = row * ground_cols + col;
                let seeds = conditions.seeds(cell);
                if !allowed.as_slice()[cell] || seeds.sub_biomes == 0 {
                    continue;
                }
                if known.0 != seeds.sub_biomes {
                    known = (seeds.sub_biomes, self.finder.clusters(seeds.sub_biomes));
                }
                let factors = conditions.factors(cell, seeds);
                let index = self.finder.nearest(&factors, known.1);
                let cluster = &statistics.clusters[index];
                let expected = cluster.plants_per_m2(seeds.chance_per_year) * cell_m * cell_m;
                let entity = self.entity(row, col);
                let number = expected + self.draw(Process::UndergrowthCount, entity, 0, 0)[0];
                let number = (number as u64).min(IDS_PER_CELL - 1) as u16;
                let species = statistics.species(index);
                let may_grow = |share: &&SpeciesShare| {
                    self.sub_biomes[usize::from(share.species)] & seeds.sub_biomes != 0
                };
                let total: f32 = species.iter().filter(may_grow).map(|share| share.share).sum();
                if total <= 0.0 {
                    continue;
                }
                for number in 0..number {
                    let [choice, size, east, south] =
                        self.draw(Process::UndergrowthPlant, entity, number, 0);
                    let Some(share) = chosen(species.iter().filter(may_grow), choice * total)
                    else {
                        continue;
                    };
                    // of the heights that there is room for
                    let room = share.share_below(conditions.limit_m(cell));
                    if room <= 0.0 {
                        continue;
                    }
                    let height_m = share.height_at_m(size * room);
                    let grown = &biome.species[usize::from(share.species)];
                    plants.push(Unplaced {
                        cell: cell as u32, // scenes have fewer cells
                        number,
                        cluster: index as u16,
                        species: share.species,
                        height_m,
                        radius_m: grown.crown_radius_m(height_m),
                        place: [(col as f32 + east) * cell_m, (row as f32 + south) * cell_m],
                    });
                }
            }
        }
        plants
    }

    /// The first place tried where neither trunk nor core of another is, or the best one outside trunks.
    fn place(
        &self,
        plant: &Unplaced,
        layout: &Layout,
        trunks: &[([f32; 2], f32)],
        squares: &Squares,
    ) -> Option<[f32; 2]> {
        let cell = plant.cell as usize;
        let (row, col) = (cell / layout.ground_cols, cell % layout.ground_cols);
        let entity = self.entity(row, col);
        let mut best: Option<(f32, [f32; 2])> = None;
        let mut draws = [0.0; 4];
        for round in 0..TRIES {
            let place = if round == 0 {
                plant.place
            } else {
                // a draw has two places
                if round % 2 == 1 {
                    draws =
                        self.draw(Process::UndergrowthPlant, entity, plant.number, round / 2 + 1);
                }
                let [east, south] =
                    if round % 2 == 1 { [draws[0], draws[1]] } else { [draws[2], draws[3]] };
                [(col as f32 + east) * layout.cell_m, (row as f32 + south) * layout.cell_m]
            };
            let is_in_trunk = trunks.iter().any(|(trunk, radius_m)| {
                let [east_m, south_m] = [place[0] - trunk[0], place[1] - trunk[1]];
                east_m * east_m + south_m * south_m < radius_m * radius_m
            });
            if is_in_trunk {
                continue;
            }
            let clearance_m = squares.clearance_m(place, plant.radius_m);
            if clearance_m >= 0.0 {
                return Some(place);
            }
            if best.is_none_or(|(best_m, _)| clearance_m > best_m) {
                best = Some((clearance_m, place));
            }
        }
        best.map(|(_, place)| place)
    }

    fn entity(&self, row: usize, col: usize) -> u64 {
        rng::entity_of_cell(self.first[0] + col as i64, self.first[1] - row as i64)
    }

    fn draw(&self, process: Process, entity: u64, number: u16, round: u8) -> [f32; 4] {
        rng::uniforms(Key {
            seed: self.synthesis.seed,
            process,
            year: number,
            month: round,
            entity,
        })
    }
}

/// The share that a number below the sum of all falls into.
fn chosen<'a>(
    shares: impl Iterator<Item = &'a SpeciesShare>,
    mut left: f32,
) -> Option<&'a SpeciesShare> {
    let mut last = None;
    for share in shares.filter(|share| share.share > 0.0) {
        last = Some(share);
        left -= share.share;
        if left < 0.0 {
            break;
        }
    }
    last
}

/// Plants of a block and of the rim around it, by square.
struct Squares {
    corner_m: [f32; 2],
    count: usize,
    /// The newest plant of each square, counted from 1; 0 is none.
    newest: Vec<u32>,
    /// The plant before, in the same square.
    before: Vec<u32>,
    plants: Vec<([f32; 2], f32)>,
}

impl Squares {
    fn new(corner_m: [f32; 2], side_m: f32) -> Self {
        let count = (side_m / SQUARE_M).ceil() as usize + 2;
        Self {
            corner_m: corner_m.map(|m| m - SQUARE_M),
            count,
            newest: vec![0; count * count],
            before: Vec::new(),
            plants: Vec::new(),
        }
    }

    /// Row and column of a place; none far outside.
    fn square(&self, place: [f32; 2]) -> Option<[usize; 2]> {
        let line = |at_m: f32, from_m: f32| {
            let line = (at_m - from_m) / SQUARE_M;
            (line >= 0.0 && line < self.count as f32).then_some(line as usize)
        };
        Some([line(place[1], self.corner_m[1])?, line(place[0], self.corner_m[0])?])
    }

    fn add(&mut self, place: [f32; 2], radius_m: f32) {
        let Some([row, col]) = self.square(place) else { return };
        let square = row * self.count + col;
        self.before.push(self.newest[square]);
        self.plants.push((place, CORE_FRACTION * radius_m));
        self.newest[square] = self.plants.len() as u32; // some thousands
    }

    /// Free distance to the nearest core, below 0 where cores meet.
    fn clearance_m(&self, place: [f32; 2], radius_m: f32) -> f32 {
        let Some([row, col]) = self.square(place) else { return 0.0 };
        let core_m = CORE_FRACTION * radius_m;
        let mut least_m = f32::INFINITY;
        for row in row.saturating_sub(1)..(row + 2).min(self.count) {
            for col in col.saturating_sub(1)..(col + 2).min(self.count) {
                let mut next = self.newest[row * self.count + col];
                while next > 0 {
                    let (other, other_m) = self.plants[next as usize - 1];
                    let [east_m, south_m] = [place[0] - other[0], place[1] - other[1]];
                    let away_m = (east_m * east_m + south_m * south_m).sqrt();
                    least_m = least_m.min(away_m - core_m - other_m);
                    next = self.before[next as usize - 1];
                }
            }
        }
        least_m
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::super::statistics::tests::example;
    use super::super::{Conditions, Statistics};
    use super::*;
    use crate::canopy::site::Site;
    use crate::raster::{Grid, Mask};
    use crate::simulation::Parameters;
    use crate::species::Biome;

    /// 120 × 120 m with conifers of two rows in the west, bare beyond.
    fn scene(biome: &Biome) -> (Site, Plants) {
        let of = |value: f32| Grid::from_fn(120, 120, 1.0, |_| value);
        let site = Site {
            sun_h: of(8.5),
            moisture_mm: of(80.0),
            temperature_c: of(12.0),
            slope_rad: of(0.1),
        };
        let mut trees = Plants::default();
        for tree in 0..20 {
            trees.id.push(tree);
            trees.species.push(biome.species_index("redwood").unwrap() as u16);
            trees.layer.push(Layer::Canopy);
            trees.east_m.push(12.0 + 8.0 * (tree % 2) as f32);
            trees.north_m.push(6.0 * tree as f32 + 3.0);
            trees.z_m.push(0.0);
            trees.height_m.push(25.0);
            trees.crown_radius_m.push(4.0);
            trees.dbh_m.push(1.2);
            trees.age_years.push(60.0);
            trees.vigor.push(1.0);
        }
        (site, trees)
    }

    /// What `with` makes of the scene, but for a line of cells where nothing may stand.
    pub fn with_scene<T>(
        biome: &Biome,
        statistics: &Statistics,
        with: impl FnOnce(&Synthesis<'_>) -> T,
    ) -> T {
        let (site, trees) = scene(biome);
        let conditions = Conditions::under(&trees, &site, biome, &Parameters::kapp2020());
        let allowed = Mask::new((0..120 * 120).map(|cell| cell / 120 != 50).collect::<Vec<bool>>());
        let trees = Trees::of(&trees, 120.0);
        let (conditions, allowed, trees, seed) = (&conditions, &allowed, &trees, 7);
        with(&Synthesis { conditions, allowed, trees, statistics, biome, seed })
    }

    fn grown(biome: &Biome, threads: usize) -> Undergrowth {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            with_scene(biome, &example(biome), |synthesis| {
                sample(synthesis, &Reporter::silent()).unwrap()
            })
        })
    }

    /// Plants a cell should have.
    fn expected(biome: &Biome) -> f32 {
        let statistics = example(biome);
        with_scene(biome, &statistics, |synthesis| {
            let finder = ClusterFinder::new(&statistics);
            let of_cell = |cell: usize| {
                let seeds = synthesis.conditions.seeds(cell);
                let factors = synthesis.conditions.factors(cell, seeds);
                let index = finder.nearest(&factors, finder.clusters(seeds.sub_biomes));
                statistics.clusters[index].plants_per_m2(seeds.chance_per_year)
            };
            (0..120 * 120).filter(|cell| synthesis.allowed.is_valid(*cell)).map(of_cell).sum()
        })
    }

    #[test]
    fn cells_get_the_plants_of_their_cluster_and_none_where_none_may_stand() {
        let biome = Biome::builtin("sonoma").unwrap();
        let (undergrowth, wanted) = (grown(&biome, 1), expected(&biome));
        let found = undergrowth.disks.len() as f32;
        assert!((found / wanted - 1.0).abs() < 0.03, "{found} for {wanted}");
        assert!(undergrowth.cell.iter().all(|cell| cell / 120 != 50));
        let trees = with_scene(&biome, &example(&biome), |synthesis| synthesis.trees.clone());
        for tree in 0..trees.disks.len() {
            let at = [trees.disks.east_m[tree], trees.disks.south_m[tree]];
            let places = undergrowth.disks.east_m.iter().zip(&undergrowth.disks.south_m);
            let is_outside = |(east_m, south_m): (&f32, &f32)| {
                (east_m - at[0]).powi(2) + (south_m - at[1]).powi(2) >= trees.trunk_m[tree].powi(2)
            };
            assert!(places.into_iter().all(is_outside), "a plant in a trunk");
        }
        // seeds of conifers reach 48 m from the eastern row
        assert!(undergrowth.disks.east_m.iter().all(|east_m| *east_m < 20.0 + 48.0 + 6.0));
        // ferns under crowns, shrubs beside them
        let key = |plant: usize| &biome.species[usize::from(undergrowth.disks.species[plant])].key;
        for plant in 0..undergrowth.disks.len() {
            let is_fern = ["western-swordfern", "redwood-sorrel"].contains(&key(plant).as_str());
            assert_eq!(is_fern, undergrowth.cluster[plant] == 0);
        }
        let ferns = undergrowth.cluster.iter().filter(|cluster| **cluster == 0).count();
        assert!(ferns > 300 && ferns < undergrowth.cluster.len() - 300, "{ferns}");
        assert!(undergrowth.id.is_sorted_by(|a, b| a < b));
    }

    #[test]
    fn threads_do_not_matter() {
        let biome = Biome::builtin("sonoma").unwrap();
        assert_eq!(grown(&biome, 1), grown(&biome, 3));
    }
}
