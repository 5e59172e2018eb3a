//! Trees of a coarse canopy: a jittered lattice, thinned by crown width, each tree as tall as the map says at its place.
//!
//! # Reference
//! Thinning in rounds as in `generate::planting` (Luby 1986, doi:10.1137/0215074), the widest crown first instead of
//! the luckiest: wide crowns stand where the coarse map has its tops.

use rayon::prelude::*;

use super::detail::{Blocks, CANOPY_M};
use crate::math::lerp;
use crate::rng::{self, Key, Process};

/// Places for trees along a block's side. Chosen: four to a block of 4 m are four times the trees that real canopies
/// show tops of, enough that thinning finds no holes.
pub const PLACES: usize = 2;
/// Passes of thinning, keeping and clearing by turns. Chosen: a fifth keeping would find another hundredth of the trees.
const PASSES: usize = 7;
/// Places looked at on each side; trees keep at most so many steps apart.
const NEIGHBOURS: usize = 3;
/// Crown radius of a tree without height, m, and what each metre of height adds. Fitted with all "fitted" below: height
/// differences at 1, 2, 4, 8 m, rumple, tops a hectare and cover of two airborne canopies of 1 m (British Columbia
/// conifers, Florida pine savanna) brought to 4 m and back.
const RADIUS_M: f32 = 1.04;
const RADIUS_PER_HEIGHT: f32 = 0.118;
/// Widest crown, m, and as a share of a block, so that none reaches farther than blocks are looked at. Chosen.
const WIDEST_RADIUS_M: f32 = 5.0;
const WIDEST_RADIUS_BLOCKS: f32 = 1.25;
/// Single crowns are wider or narrower by this share. Chosen: equal crowns would show as a pattern.
const RADIUS_SPREAD: f32 = 0.16;
/// Blocks on each side that tell how open a place is; the outermost of the map bear no trees.
const RIM_BLOCKS: usize = 2;
/// Open blocks of the 25 around a tree from which on it stands in the open. Chosen: half.
const OPEN_BLOCKS: f32 = 12.0;
/// Crown radius in the open against that in closed canopy. Chosen: by eye, so that oaks of a savanna are single crowns.
const OPEN_WIDTH: f32 = 1.8;
/// Depth of crowns in uneven canopy against that in even. Fitted.
const UNEVEN_DEPTH: f32 = 1.58;
/// Distance between trees as a share of their mean radius. Fitted.
const SPACING_FRACTION: f32 = 1.41;
/// Least distance between trees, m. Chosen: shrubs' stems.
const LEAST_SPACING_M: f32 = 1.2;
/// How much luck a tree's rank holds. Chosen: with less, rows of trees wait for each other and thinning leaves holes.
const LUCK: f32 = 0.6;
/// Fall of the crown's surface from the top to its rim per metre outwards. Fitted: alike in low and in tall canopies.
const FALL_PER_M: f32 = 1.89;
/// Least and greatest fall to the rim, as shares of the height. Fitted; the greatest chosen.
const DEPTH_FRACTIONS: [f32; 2] = [0.35, 0.9];
/// Tops against the coarse height, and half of how they differ among themselves. Fitted; the spread chosen.
const TOP_FRACTION: f32 = 1.0;
const TOP_SPREAD: f32 = 0.05;
/// How far a crown may reach over a lower block, m. Fitted: a tenth of a block's cells may lie above its percentile.
const OVERHANG_M: f32 = 1.23;

/// Draws at a place of the lattice that bend what is around it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Node {
    /// Shift to the east, to the south, each −1..1, and height of the undergrowth, 0..1.
    pub draws: [f32; 3],
}

/// A tree whose crown the map shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CrownTree {
    /// Column of the block it stands in.
    pub block_col: usize,
    /// Metres east of the block's west edge.
    pub east_m: f32,
    /// Metres south of the block's north edge.
    pub south_m: f32,
    /// Height of the top.
    pub height_m: f32,
    /// Crown radius.
    pub radius_m: f32,
    /// Height lost from the top to the crown's rim, as a share of the height.
    pub depth_fraction: f32,
}

/// A place where a tree may stand.
#[derive(Clone, Copy, Debug)]
struct Place {
    tree: CrownTree,
    /// Greater ones take their places first.
    rank: f32,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    Open,
    Kept,
    Gone,
}

/// The lattice's nodes, row-major, and the trees by row of blocks.
pub fn planted(blocks: &Blocks, seed: u64) -> (Vec<Node>, Vec<Vec<CrownTree>>) {
    let cols = blocks.cols * PLACES;
    let (nodes, places): (Vec<Node>, Vec<Option<Place>>) = (0..blocks.rows * PLACES * cols)
        .into_par_iter()
        .map(|index| node_and_place(blocks, index / cols, index % cols, seed))
        .unzip();
    let mut states: Vec<State> =
        places.iter().map(|p| if p.is_some() { State::Open } else { State::Gone }).collect();
    for pass in 0..PASSES {
        states = thinned(blocks.cell_m, cols, &places, &states, pass % 2 == 0);
    }
    let trees = states
        .par_chunks(PLACES * cols)
        .zip(places.par_chunks(PLACES * cols))
        .map(|(states, places)| {
            let kept = states.iter().zip(places).filter(|(s, _)| **s == State::Kept);
            kept.filter_map(|(_, place)| place.map(|p| p.tree)).collect()
        })
        .collect();
    (nodes, trees)
}

/// What the lattice holds at a place; no tree where the block is no canopy or lies at the rim.
fn node_and_place(blocks: &Blocks, row: usize, col: usize, seed: u64) -> (Node, Option<Place>) {
    // far below 2⁶³; rows count southwards, keys northwards
    let east = blocks.first_east * PLACES as i64 + col as i64;
    let north = -(blocks.first_south * PLACES as i64 + row as i64 + 1);
    let entity = rng::entity_of_cell(east, north);
    let process = Process::CanopyDetailLattice;
    let draws = |month| rng::uniforms(Key { seed, process, year: 0, month, entity });
    let ([across, down, luck, form], [shift_east, shift_south, size, width]) = (draws(0), draws(1));
    let node = Node { draws: [2.0 * shift_east - 1.0, 2.0 * shift_south - 1.0, form] };
    let (block_row, block_col) = (row / PLACES, col / PLACES);
    let here_m = blocks.height_m(block_row, block_col);
    let at_rim = !(RIM_BLOCKS..blocks.rows - RIM_BLOCKS).contains(&block_row)
        || !(RIM_BLOCKS..blocks.cols - RIM_BLOCKS).contains(&block_col);
    if here_m <= CANOPY_M || at_rim {
        return (node, None);
    }
    // the tree by itself
    let step_m = blocks.cell_m / PLACES as f32; // a small count
    let east_m = ((col % PLACES) as f32 + across) * step_m; // 0 or 1
    let south_m = ((row % PLACES) as f32 + down) * step_m;
    let height_m = here_m * (TOP_FRACTION + TOP_SPREAD * (2.0 * size - 1.0));
    let block = block_row * blocks.cols + block_col;
    let open = blocks.around_block(block, RIM_BLOCKS).filter(|h| *h <= CANOPY_M).count();
    let openness = (open as f32 / OPEN_BLOCKS).min(1.0); // some blocks
    let free_radius_m = ((RADIUS_M + RADIUS_PER_HEIGHT * height_m)
        * lerp(1.0 - RADIUS_SPREAD, 1.0 + RADIUS_SPREAD, width)
        * lerp(1.0, OPEN_WIDTH, openness))
    .min(WIDEST_RADIUS_M)
    .min(WIDEST_RADIUS_BLOCKS * blocks.cell_m);
    let [least, greatest] = DEPTH_FRACTIONS;
    let depth_fraction = ((FALL_PER_M * free_radius_m / height_m).clamp(least, greatest)
        * lerp(0.85, 1.15, form)
        * lerp(UNEVEN_DEPTH, 1.0, blocks.evenness[block].max(openness)))
    .min(1.0);
    // narrowed until it stays below its lower neighbours' heights
    let mut radius_m = free_radius_m;
    for down in 0..3 {
        for across in 0..3 {
            let near_m = blocks.height_m(block_row + down - 1, block_col + across - 1);
            if near_m >= here_m {
                continue;
            }
            let (east, south) =
                (gap_m(across, east_m, blocks.cell_m), gap_m(down, south_m, blocks.cell_m));
            let reach_m = (east * east + south * south).sqrt() + OVERHANG_M;
            let near_m = if near_m <= CANOPY_M { 0.0 } else { near_m };
            let drop = 1.0 - near_m / height_m;
            radius_m = radius_m.min(reach_m * (depth_fraction / drop).max(1.0));
        }
    }
    let tree = CrownTree { block_col, east_m, south_m, height_m, radius_m, depth_fraction };
    (
        node,
        Some(Place { tree, rank: radius_m * height_m.sqrt() * lerp(1.0 - LUCK, 1.0 + LUCK, luck) }),
    )
}

/// Distance along one axis from a place in a block to the block before (0), to itself (1), or to the one behind (2).
fn gap_m(neighbour: usize, at_m: f32, cell_m: f32) -> f32 {
    match neighbour {
        0 => at_m,
        1 => 0.0,
        _ => cell_m - at_m,
    }
}

/// One pass: either open places that come first among their open neighbours are kept, or those near kept ones go.
fn thinned(
    cell_m: f32,
    cols: usize,
    places: &[Option<Place>],
    states: &[State],
    keeping: bool,
) -> Vec<State> {
    let rows = places.len() / cols;
    let widest_m = NEIGHBOURS as f32 * cell_m / PLACES as f32; // small counts
    let decide = |index: usize, place: &Place| {
        let (row, col) = (index / cols, index % cols);
        let hinders = |r: usize, c: usize| {
            let (other, sought) = (r * cols + c, if keeping { State::Open } else { State::Kept });
            let Some(near) = &places[other] else { return false };
            // lattice order settles equal ranks
            let ahead = !keeping || (near.rank, other) > (place.rank, index);
            if states[other] != sought || !ahead || other == index {
                return false;
            }
            let (a, b) = (&near.tree, &place.tree);
            // differences of a block or two are exact
            let blocks = |to: usize, from: usize| to as f32 - from as f32;
            let east = blocks(c / PLACES, col / PLACES) * cell_m + a.east_m - b.east_m;
            let south = blocks(r / PLACES, row / PLACES) * cell_m + a.south_m - b.south_m;
            let apart_m = (SPACING_FRACTION * 0.5 * (a.radius_m + b.radius_m))
                .clamp(LEAST_SPACING_M, widest_m);
            east * east + south * south < apart_m * apart_m
        };
        let near_cols = col.saturating_sub(NEIGHBOURS)..(col + NEIGHBOURS + 1).min(cols);
        let mut near_rows = row.saturating_sub(NEIGHBOURS)..(row + NEIGHBOURS + 1).min(rows);
        let hindered = near_rows.any(|r| near_cols.clone().any(|c| hinders(r, c)));
        match (keeping, hindered) {
            (true, false) => State::Kept,
            (false, true) => State::Gone,
            _ => State::Open,
        }
    };
    states
        .par_iter()
        .zip(places)
        .enumerate()
        .map(|(index, (state, place))| match place {
            Some(place) if *state == State::Open => decide(index, place),
            _ => *state,
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn blocks(heights_m: Vec<f32>, cols: usize) -> Blocks {
        let rows = heights_m.len() / cols;
        Blocks::new([rows, cols], [-3, 11], 4.0, heights_m)
    }

    #[test]
    fn trees_keep_their_distance_and_stand_in_canopy() {
        let heights_m = (0..900).map(|i| if i % 30 < 12 { 1.0 } else { 18.0 }).collect();
        let (_, rows) = planted(&blocks(heights_m, 30), 4);
        let mut at = Vec::new();
        for (row, trees) in rows.iter().enumerate() {
            for t in trees {
                assert!(t.block_col >= 12 && t.height_m > 16.0, "{t:?}");
                let (x, y) = (t.block_col as f32 * 4.0, row as f32 * 4.0);
                at.push((x + t.east_m, y + t.south_m, t.radius_m));
            }
        }
        assert!(at.len() > 150, "{}", at.len());
        for (i, a) in at.iter().enumerate() {
            for b in &at[i + 1..] {
                let apart = (SPACING_FRACTION * 0.5 * (a.2 + b.2)).clamp(LEAST_SPACING_M, 6.0);
                assert!((a.0 - b.0).hypot(a.1 - b.1) > apart - 1e-3, "{a:?} {b:?}");
            }
        }
    }

    #[test]
    fn crowns_are_wider_in_taller_canopy_and_narrow_beside_lower_blocks() {
        let mean_m = |height_m: f32| {
            let (_, rows) = planted(&blocks(vec![height_m; 900], 30), 4);
            let trees: Vec<_> = rows.into_iter().flatten().collect();
            trees.iter().map(|t| t.radius_m).sum::<f32>() / trees.len() as f32
        };
        let (low_m, tall_m) = (mean_m(4.0), mean_m(28.0));
        assert!((1.2..2.6).contains(&low_m) && (3.5..5.5).contains(&tall_m), "{low_m} {tall_m}");
        let mut alone = vec![0.0; 81];
        alone[40] = 20.0;
        let (_, rows) = planted(&blocks(alone, 9), 4);
        let trees: Vec<_> = rows.into_iter().flatten().collect();
        // a block of 4 m holds a crown of half that, and what hangs over
        assert!(!trees.is_empty() && trees.iter().all(|t| t.radius_m <= 2.0 + OVERHANG_M));
    }
}
