//! Placement: the trees that make up a canopy height model.
//!
//! # Reference
//! Kapp et al. 2020, section 5.2 and Algorithm 1, doi:10.1145/3414685.3417848.
//! # Departures
//! Each crown is fitted to the canopy within its species' envelope (`crown_fit`), so that the tops and openings which the
//! canopy shows decide how dense trees stand, and not the allometry alone. The roomiest openings are seeded first. Rounds
//! end when enough canopy is covered; then trees that are not needed for that go.

use rayon::prelude::*;

use super::conflicts;
use super::cover::Cover;
use super::crown_fit::{self, CANOPY_WORTH};
use super::crowns::UNITS_PER_CELL;
use super::seeding;
use super::stand::{Ground, NO_TOP, Stand, UNSETTLED};
use super::tiles::Tiling;
use super::visibility::{RenderVisibility, Visibility};
use crate::progress::{Cancelled, Reporter};

/// Share of its crown that a tree must show to the sky to live.
/// chosen: half of what Kapp's program has (0.3, PAPER_NOTES §6): crowns are fitted here, so less of them is hidden.
const STARVES_BELOW_FRACTION: f64 = 0.15;
/// Part of the way to the centre of what it shows that a tree moves in a round: a quarter. Kapp's program (PAPER_NOTES §6).
const SHIFT_DIVISOR: i32 = 4;
/// Share of its narrowest crown that a top must gain to bear a tree. chosen: below it the tops of one crown's branches
/// become trees.
const TOP_GAIN_FRACTION: f32 = 0.4;
/// Canopy that a tree which makes a top must alone cover, m². chosen: half of a 3 m tree's crown.
const TOP_LEAST_M2: f32 = 1.5;
/// Canopy that other trees must alone cover, m², in the first round. chosen: the roomiest openings first.
const FIRST_LEAST_M2: f32 = 5.0;
/// From round to round that falls by this factor. chosen: slower falls take more rounds and save one tree in fifty.
const LEAST_FALLS_BY: f32 = 0.4;
/// Down to this, m². chosen: the crown of the lowest trees that count as canopy.
const LAST_LEAST_M2: f32 = 0.3;
/// Price of a cell under a crown that is no canopy, where canopy is worth [`CANOPY_WORTH`]. chosen on measured canopies of
/// 1 m cells: at 10, a tenth more trees hang over a hundredth less.
const OVERHANG_PRICE: i32 = 9;
/// Once the least canopy is reached the price falls by this factor a round, so that ragged canopy is covered too. chosen: four
/// rounds to a price of nearly nothing.
const PRICE_FALLS_BY: f32 = 0.5;
/// Share of the canopy that some species can stand in which is to be covered. chosen: 98 % and a hair.
const COVERAGE_GOAL_FRACTION: f64 = 0.981;
/// The same on working cells that are parts of scene cells. chosen: about a hundredth of what lies between the middles of
/// working cells is not covered, where the middles are.
const COVERAGE_GOAL_OF_PARTS_FRACTION: f64 = 0.992;
/// Trees that make a top and alone cover more than this share of their crown are never thinned. chosen: lone trees stay.
const MOST_THINNED_FRACTION: f64 = 0.5;
/// Rounds end when this much more is covered. chosen: the last conflicts uncover about as much.
const COVERAGE_SPARE_FRACTION: f64 = 0.001;

/// How trees are placed.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct PlacementParams {
    /// Cells at least this high are canopy.
    pub canopy_min_height_m: f32,
    /// Rounds of Algorithm 1 at most.
    pub max_rounds: usize,
}

impl Default for PlacementParams {
    fn default() -> Self {
        // 3 m: PAPER_NOTES §6; rounds: measured canopies take three to nine
        Self { canopy_min_height_m: 3.0, max_rounds: 10 }
    }
}

/// A placed stand and what the sky sees of it.
#[derive(Clone, Debug)]
pub struct Placed {
    /// The trees.
    pub stand: Stand,
    /// What the sky sees of them.
    pub visibility: Visibility,
    /// Rounds it took.
    pub rounds: usize,
}

/// Why placement ended early.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PlacementError {
    /// The run was cancelled.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    /// The renderer's device failed.
    #[error("{what}")]
    Renderer {
        /// What failed.
        what: String,
    },
}

/// Places trees. The [crate's example](crate) comes by here, on the ground that a canopy height model makes.
///
/// # Errors
/// If the run was cancelled, or the renderer's device failed.
pub fn place(
    ground: &Ground<'_>,
    params: &PlacementParams,
    renderer: &mut dyn RenderVisibility,
    reporter: &Reporter,
) -> Result<Placed, PlacementError> {
    let stage = reporter.stage("placement", params.max_rounds as u64);
    let cells = ground.cells;
    let worth_of_m2 = |m2: f32| (m2 * CANOPY_WORTH as f32 / (cells.cell_m * cells.cell_m)) as i32;
    let tiling = Tiling::new(cells.size, ground.envelopes.widest());
    let mut visibility = Visibility::default();
    let mut render = |stand: &Stand, visibility: &mut Visibility| {
        renderer
            .render(&stand.crowns, cells.canopy(), visibility)
            .map_err(|what| PlacementError::Renderer { what })
    };

    // initial seeding
    let mut stand = Stand::default();
    let cover = Cover::new(cells.size);
    let tops = seeding::tops(ground);
    for seed in
        seeding::accepted_tops(ground, tiling, &cover, &tops, OVERHANG_PRICE, TOP_GAIN_FRACTION)
    {
        stand.seed(ground, seed, true);
    }
    drop(tops);

    // rounds of Algorithm 1
    let is_plantable: Vec<bool> = (0..cells.is_canopy.len())
        .into_par_iter()
        .map(|index| cells.is_plantable(index, ground.species))
        .collect();
    let is_of_parts = cells.per_cell > 1;
    let goal = if is_of_parts { COVERAGE_GOAL_OF_PARTS_FRACTION } else { COVERAGE_GOAL_FRACTION };
    let mut rounds = 0;
    let (mut least_m2, mut price) = (FIRST_LEAST_M2, OVERHANG_PRICE as f32);
    while rounds < params.max_rounds {
        reporter.check_cancelled()?;
        let least = worth_of_m2(least_m2);
        for seed in seeding::openings(ground, tiling, &cover, price as i32, least) {
            stand.seed(ground, seed, false);
        }
        render(&stand, &mut visibility)?;
        let is_fed = fed(ground, &stand, &visibility);
        shift(ground, &mut stand, &visibility);
        stand.keep(&is_fed);
        conflicts::resolve(cells, &mut stand, true);
        cover.count_all(&stand.crowns);
        let top_least = worth_of_m2(TOP_LEAST_M2).min(least);
        let least_of =
            |tree: usize, stand: &Stand| if stand.top[tree] == NO_TOP { least } else { top_least };
        crown_fit::fit(ground, tiling, &cover, price as i32, least_of, &mut stand);
        rounds += 1;
        stage.advance(1);
        if cover.covered_fraction(&is_plantable) >= goal + COVERAGE_SPARE_FRACTION {
            break;
        }
        if least_m2 > LAST_LEAST_M2 {
            least_m2 = (least_m2 * LEAST_FALLS_BY).max(LAST_LEAST_M2);
        } else {
            price *= PRICE_FALLS_BY;
        }
    }
    // crowns that were fitted since may hold others again: they shrink once more, and then no conflict is left
    conflicts::resolve(cells, &mut stand, true);
    conflicts::resolve(cells, &mut stand, false);
    cover.count_all(&stand.crowns);
    thin(ground, &cover, goal, &is_plantable, &mut stand);
    drop(cover);
    render(&stand, &mut visibility)?;
    Ok(Placed { stand, visibility, rounds })
}

/// Moves trees that make no top and have not settled towards the middle of the canopy that they show.
fn shift(ground: &Ground<'_>, stand: &mut Stand, visibility: &Visibility) {
    for tree in 0..stand.len() {
        let cells = visibility.canopy_cells[tree] as i32; // a crown has a few thousand
        let is_settled = stand.settled_worth[tree] != UNSETTLED;
        if stand.top[tree] != NO_TOP || is_settled || cells == 0 {
            continue;
        }
        let moved = |at: i32, sum: i32| {
            let trunk_cell = at.div_euclid(UNITS_PER_CELL);
            let center =
                trunk_cell * UNITS_PER_CELL + UNITS_PER_CELL / 2 + sum * UNITS_PER_CELL / cells;
            at + (center - at) / SHIFT_DIVISOR
        };
        let x = moved(stand.crowns.x[tree], visibility.sum_cols[tree]);
        let y = moved(stand.crowns.y[tree], visibility.sum_rows[tree]);
        stand.move_to(ground, tree, x, y);
    }
}

/// Drops the trees that alone cover least, as long as enough canopy stays covered.
fn thin(ground: &Ground<'_>, cover: &Cover, goal: f64, is_plantable: &[bool], stand: &mut Stand) {
    let canopy = is_plantable.par_iter().filter(|plantable| **plantable).count() as f64;
    let covered_fraction = cover.covered_fraction(is_plantable);
    let mut spare = ((covered_fraction - goal) * canopy) as i64; // cells; none if below 0
    let size = ground.cells.size;
    let cols = size.cols;
    let alone = |tree: usize| -> i64 {
        let spans = stand.crowns.spans(tree, size);
        spans
            .map(|span| span.row * cols + span.first_col..span.row * cols + span.end_col)
            .map(|cells| {
                let counts = cover.counts(cells.clone()).zip(&is_plantable[cells]);
                counts.filter(|&(count, &plantable)| count == 1 && plantable).count() as i64
            })
            .sum()
    };
    let mut order: Vec<(i64, usize)> =
        (0..stand.len()).into_par_iter().map(|tree| (alone(tree), tree)).collect();
    order.par_sort_unstable();
    let mut is_kept = vec![true; stand.len()];
    for (_, tree) in order {
        if spare <= 0 {
            break;
        }
        // what it covers alone grows with every neighbour that goes
        let cells = alone(tree);
        let stands_alone =
            cells as f64 > MOST_THINNED_FRACTION * stand.crowns.cell_count(tree, size) as f64;
        let is_needed = stand.top[tree] != NO_TOP && stands_alone;
        if cells <= spare && !is_needed {
            spare -= cells;
            is_kept[tree] = false;
            let crowns = &stand.crowns;
            cover.remove(crowns.x[tree], crowns.y[tree], crowns.radius[tree]);
        }
    }
    stand.keep(&is_kept);
}

/// Whether each tree shows enough of its crown to live.
fn fed(ground: &Ground<'_>, stand: &Stand, visibility: &Visibility) -> Vec<bool> {
    let crowns = &stand.crowns;
    (0..stand.len())
        .into_par_iter()
        .map(|tree| {
            let all = crowns.cell_count(tree, ground.cells.size);
            let visible = visibility.visible_cells[tree];
            visible > 0 && f64::from(visible) >= STARVES_BELOW_FRACTION * all as f64
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::super::envelopes::{CROWN_ENVELOPE_FRACTION, Envelopes};
    use super::super::generate::{self, GenerateParams};
    use super::super::quality::{self, Quality};
    use super::super::site::Site;
    use super::super::species_map::{NO_SPECIES, SpeciesMap};
    use super::super::trees;
    use super::super::visibility::CpuVisibility;
    use super::super::working_cells::WorkingCells;
    use super::*;
    use crate::plants::Plants;
    use crate::raster::{Cell, Grid, Mask};
    use crate::species::Biome;
    use crate::terrain::Terrain;

    /// Hills with an even site.
    fn land(rows: usize, cols: usize, cell_m: f64) -> (Terrain, Site) {
        let elevation_m = Grid::from_fn(rows, cols, cell_m, |Cell { row, col }| {
            300.0 + 0.2 * row as f32 + 12.0 * crate::math::sin(col as f32 / 19.0)
        });
        let even = |value: f32| elevation_m.with_values(vec![value; rows * cols]);
        let site = Site {
            sun_h: even(8.0),
            moisture_mm: even(80.0),
            temperature_c: even(15.0),
            slope_rad: even(0.1),
        };
        (Terrain { elevation_m, latitude_rad: 0.67, grid_convergence_rad: 0.0 }, site)
    }

    /// Redwoods in the west, coast live oaks in the east, nothing in the south-west corner.
    fn species(chm_m: &Grid<f32>, biome: &Biome) -> SpeciesMap {
        let index = |key: &str| biome.species_index(key).unwrap() as u8;
        let (redwood, oak) = (index("redwood"), index("coast-live-oak"));
        let frame = chm_m.frame();
        let of = |i: usize| {
            let Cell { row, col } = frame.cell(i);
            match (col < frame.cols / 2, row > 4 * frame.rows / 5) {
                (true, true) if col < frame.cols / 5 => NO_SPECIES,
                (true, _) => redwood,
                _ => oak,
            }
        };
        chm_m.with_values((0..frame.len()).map(of).collect())
    }

    fn grown(rows: usize, cols: usize, cell_m: f64) -> (Plants, Quality, Grid<f32>, SpeciesMap) {
        let biome = Biome::builtin("sonoma").unwrap();
        let (terrain, site) = land(rows, cols, cell_m);
        let reporter = Reporter::silent();
        let params = GenerateParams { cover_fraction: 0.6, ..GenerateParams::default() };
        let chm_m = generate::generate(&terrain, &site, &params, &reporter).unwrap();
        // a lake: masked cells are no canopy
        let is_land =
            (0..rows * cols).map(|i| !(i / cols < rows / 8 && i % cols < cols / 8)).collect();
        let mask = Arc::new(Mask::new(is_land));
        let chm_m = Grid::new(Arc::clone(chm_m.frame()), mask, chm_m.into_values());
        let species = species(&chm_m, &biome);
        let cells = WorkingCells::new(&chm_m, chm_m.mask(), 3.0);
        let envelopes = Envelopes::new(&biome, cells.units_per_m(), chm_m.range().unwrap().1);
        let ground = Ground {
            cells: &cells,
            chm_m: &chm_m,
            elevation_m: &terrain.elevation_m,
            lowest_m: terrain.elevation_m.range().unwrap().0,
            species: &species,
            biome: &biome,
            envelopes: &envelopes,
        };
        let params = PlacementParams::default();
        let placed = place(&ground, &params, &mut CpuVisibility, &reporter).unwrap();
        let quality = quality::measure(&ground, &placed.stand, &placed.visibility);
        (trees::plants(&ground, &site, &placed.stand), quality, chm_m, species)
    }

    #[test]
    fn trees_stand_apart_on_canopy_in_crowns_of_their_own() {
        for (rows, cols, cell_m) in [(300, 260, 0.5), (220, 200, 1.0), (60, 70, 4.0)] {
            let biome = Biome::builtin("sonoma").unwrap();
            let (plants, _, chm_m, species) = grown(rows, cols, cell_m);
            assert!(plants.len() > 100, "{cell_m} m: {} trees", plants.len());
            for i in 0..plants.len() {
                let (x, y, r) = (plants.east_m[i], plants.north_m[i], plants.crown_radius_m[i]);
                let cell = Cell {
                    row: ((rows as f64 * cell_m - f64::from(y)) / cell_m) as usize,
                    col: (f64::from(x) / cell_m) as usize,
                };
                // inside the tile, on unmasked canopy that its species can stand in
                let height_m = *chm_m.get(cell).expect("a tree stands on a masked cell");
                assert!(height_m >= 3.0, "a tree stands off the canopy");
                assert_eq!(u16::from(species[cell]), plants.species[i]);
                assert!((plants.height_m[i] - height_m).abs() <= 1.5 + 1e-3);
                // within the species' envelope
                let typical = biome.species[usize::from(plants.species[i])]
                    .crown_radius_m(plants.height_m[i]);
                assert!(r <= typical * (1.0 + CROWN_ENVELOPE_FRACTION) + 1e-3);
                assert!(r >= typical * (1.0 - CROWN_ENVELOPE_FRACTION) - 1e-3);
                assert!(plants.dbh_m[i] > 0.0 && plants.age_years[i] > 0.0);
                for j in 0..i {
                    let distance = f32::hypot(plants.east_m[j] - x, plants.north_m[j] - y);
                    assert!(distance >= 1.0, "two trunks {distance} m apart");
                    let inner = (r - plants.crown_radius_m[j]).abs();
                    assert!(distance > inner - 1e-3, "a crown lies within another");
                }
            }
        }
    }

    #[test]
    fn crowns_cover_the_canopy_and_little_else() {
        let (_, fine, ..) = grown(260, 240, 1.0);
        let least = 0.98 - fine.unsuitable_fraction;
        assert!(fine.coverage_fraction > least, "{fine:?}");
        // this canopy is full of pits, which no crown can leave out
        assert!(fine.overhang_fraction < 0.12, "{fine:?}");
        assert!(fine.height_rmse_m < 1.5, "{fine:?}");
        assert!(fine.unsuitable_fraction > 0.0 && fine.unsuitable_fraction < 0.1, "{fine:?}");
    }

    #[test]
    fn any_number_of_threads_places_the_same_trees() {
        let with = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| grown(200, 210, 1.0).0)
        };
        let one = with(1);
        assert!(one.len() > 100);
        assert_eq!(one, with(2));
        assert_eq!(one, with(5));
    }

    #[test]
    fn no_canopy_bears_no_trees() {
        let biome = Biome::builtin("sonoma").unwrap();
        let (terrain, _) = land(40, 40, 1.0);
        let chm_m = terrain.elevation_m.with_values(vec![0.0; 1600]);
        let species = species(&chm_m, &biome);
        let cells = WorkingCells::new(&chm_m, chm_m.mask(), 3.0);
        let envelopes = Envelopes::new(&biome, cells.units_per_m(), chm_m.range().unwrap().1);
        let ground = Ground {
            cells: &cells,
            chm_m: &chm_m,
            elevation_m: &terrain.elevation_m,
            lowest_m: 300.0,
            species: &species,
            biome: &biome,
            envelopes: &envelopes,
        };
        let params = PlacementParams::default();
        let placed = place(&ground, &params, &mut CpuVisibility, &Reporter::silent()).unwrap();
        assert!(placed.stand.is_empty());
        let quality = quality::measure(&ground, &placed.stand, &placed.visibility);
        assert_eq!((quality.coverage_fraction, quality.overhang_fraction), (1.0, 0.0));
    }
}
