//! Places of trees: a jittered lattice, thinned until no two stand nearer than their spacing.
//!
//! # Reference
//! Random sequential addition of hard disks by rounds: a place is kept where it comes first among all its neighbours
//! that are still open (Luby 1986, doi:10.1137/0215074). The result depends on no order of work.

use std::ops::Range;

use rayon::prelude::*;

use super::GenerateParams;
use super::stands::Stands;
use crate::math::lerp;
use crate::raster::{Frame, Grid};
use crate::rng::{self, Key, Process};

/// Trees in a covered square of the spacing's width, on maps without cover and on maps all covered; measured, with
/// spacing and rounds as below. Crowns of open woodland overlap less, so fewer make up the same cover.
const TREES_PER_SQUARE: [f64; 2] = [0.45, 0.58];
/// Lattice step as a share of the middle spacing: twice it is the widest spacing, so two steps hold all neighbours.
const STEP_FRACTION: f64 = 0.65;
/// Spacing in poor and in tall stands, as shares of the middle one. Chosen: tall stands hold fewer, larger trees.
const SPACING_FRACTIONS: [f32; 2] = [0.84, 1.13];
/// Single trees' room around these, as shares. Chosen: equal room for all would show as a pattern.
const ROOM_FRACTIONS: [f32; 2] = [0.85, 1.15];
/// Neighbouring lattice cells looked at on each side.
const NEIGHBOURS: usize = 2;
/// Rounds of thinning. Chosen: few places are open after three; those are left empty.
const ROUNDS: usize = 3;
/// Widest crown as a share of the middle spacing, see `trees`.
const WIDEST_CROWN_FRACTION: f64 = 1.7;

/// A square lattice over the map and a rim around it; row 0 lies north.
#[derive(Clone, Debug)]
pub struct Lattice {
    /// Rows of the lattice.
    pub rows: usize,
    /// Columns of the lattice.
    pub cols: usize,
    step_m: f64,
    spacing_m: f64,
    /// Absolute lattice cell of the north-west corner, counted east and north from the CRS's origin.
    first_east: i64,
    first_north: i64,
    /// South-west corner of the map.
    west_m: f64,
    south_m: f64,
}

/// A place where a tree may stand, within its lattice cell.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Place {
    /// Share of the step east of the lattice cell's west edge.
    east: f32,
    /// Share of the step north of its south edge.
    north: f32,
    /// Distance to keep from others, in steps.
    spacing: f32,
    rank: u32,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    Open,
    Kept,
    Gone,
}

/// A place that a tree takes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlantingSpot {
    /// Metres east of the map's south-west corner.
    pub east_m: f32,
    /// Metres north of it.
    pub north_m: f32,
    /// Distance to its neighbours, m.
    pub spacing_m: f32,
    /// The absolute lattice cell, as draws are keyed by it.
    pub entity: u64,
}

impl Lattice {
    /// The lattice for the density asked for.
    pub fn new(frame: &Frame, params: &GenerateParams) -> Self {
        let per_m2 = f64::from(params.trees_per_ha) / 1e4;
        // trees stand on the covered part alone; below a tenth of cover they stand singly and need not be denser
        let cover = f64::from(params.cover_fraction).max(0.1);
        let per_square = TREES_PER_SQUARE[0] + (TREES_PER_SQUARE[1] - TREES_PER_SQUARE[0]) * cover;
        let spacing_m = (per_square * cover / per_m2).sqrt();
        let step_m = STEP_FRACTION * spacing_m;
        let t = frame.transform;
        let south_m = t.north_m - frame.rows as f64 * t.cell_m;
        let rim_m = WIDEST_CROWN_FRACTION * spacing_m;
        let cell = |m: f64| (m / step_m).floor() as i64; // far below 2⁵³
        let east_m = t.west_m + frame.cols as f64 * t.cell_m;
        let (first_east, last_east) = (cell(t.west_m - rim_m), cell(east_m + rim_m));
        let (last_north, first_north) = (cell(south_m - rim_m), cell(t.north_m + rim_m));
        Self {
            rows: (first_north - last_north + 1) as usize, // positive
            cols: (last_east - first_east + 1) as usize,
            step_m,
            spacing_m,
            first_east,
            first_north,
            west_m: t.west_m,
            south_m,
        }
    }

    /// Farthest a place or a crown reaches beyond the map, m.
    pub fn reach_m(&self) -> f64 {
        WIDEST_CROWN_FRACTION * self.spacing_m + 2.0 * self.step_m
    }

    /// Widest crown, m.
    pub fn widest_crown_m(&self) -> f32 {
        (WIDEST_CROWN_FRACTION * self.spacing_m) as f32
    }

    /// Rows of the lattice with places between two distances north of the map's south edge.
    pub fn rows_between(&self, south_m: f32, north_m: f32) -> Range<usize> {
        let row = |m: f32| {
            let north = ((f64::from(m) + self.south_m) / self.step_m).floor() as i64; // far below 2⁵³
            (self.first_north - north).clamp(0, self.rows as i64)
        };
        // within 0..=rows; one row more on either side for what rounding moves
        let first = (row(north_m) - 1).max(0) as usize;
        first..(row(south_m) + 2).min(self.rows as i64) as usize
    }

    fn entity(&self, row: usize, col: usize) -> u64 {
        rng::entity_of_cell(self.first_east + col as i64, self.first_north - row as i64)
    }

    /// Metres east and north of the map's south-west corner.
    fn position_m(&self, row: usize, col: usize, east: f32, north: f32) -> [f32; 2] {
        let at = |cell: i64, share: f32, origin: f64| {
            // some kilometres: millimetres survive
            ((cell as f64 + f64::from(share)) * self.step_m - origin) as f32
        };
        [
            at(self.first_east + col as i64, east, self.west_m),
            at(self.first_north - row as i64, north, self.south_m),
        ]
    }
}

/// The places trees take, lattice row by lattice row from the north; none on masked ground.
pub fn places(
    lattice: &Lattice,
    stands: &Stands<'_>,
    ground: &Grid<f32>,
    seed: u64,
) -> Vec<Vec<PlantingSpot>> {
    let (mut states, candidates) = candidates(lattice, stands, ground, seed);
    for _ in 0..ROUNDS {
        states = thinned(lattice, &candidates, &states);
    }
    let mut kept = Vec::new();
    states
        .par_chunks(lattice.cols)
        .zip(candidates.par_chunks(lattice.cols))
        .enumerate()
        .map(|(row, (states, places))| {
            let kept = |(col, _)| {
                let place: &Place = &places[col];
                let [east_m, north_m] = lattice.position_m(row, col, place.east, place.north);
                let spacing_m = place.spacing * lattice.step_m as f32;
                PlantingSpot { east_m, north_m, spacing_m, entity: lattice.entity(row, col) }
            };
            states.iter().enumerate().filter(|(_, s)| **s == State::Kept).map(kept).collect()
        })
        .collect_into_vec(&mut kept);
    kept
}

fn candidates(
    lattice: &Lattice,
    stands: &Stands<'_>,
    ground: &Grid<f32>,
    seed: u64,
) -> (Vec<State>, Vec<Place>) {
    let steps_per_spacing = (1.0 / STEP_FRACTION) as f32;
    (0..lattice.rows * lattice.cols)
        .into_par_iter()
        .map(|index| {
            let (row, col) = (index / lattice.cols, index % lattice.cols);
            let process = Process::CanopyLattice;
            let entity = lattice.entity(row, col);
            let words = rng::words(Key { seed, process, year: 0, month: 0, entity });
            let (east, north) = (rng::unit_interval(words[0]), rng::unit_interval(words[1]));
            let [east_m, north_m] = lattice.position_m(row, col, east, north);
            let land = ground.mask().is_valid(stands.cell(east_m, north_m));
            let quality = stands.quality(east_m, north_m);
            let room = lerp(ROOM_FRACTIONS[0], ROOM_FRACTIONS[1], rng::unit_interval(words[3]));
            let stand = lerp(SPACING_FRACTIONS[0], SPACING_FRACTIONS[1], quality);
            let spacing = steps_per_spacing * stand * room;
            let state = if land { State::Open } else { State::Gone };
            (state, Place { east, north, spacing, rank: words[2] })
        })
        .unzip()
}

/// One round: open places that come first among their open neighbours are kept, those near a kept one go.
fn thinned(lattice: &Lattice, places: &[Place], states: &[State]) -> Vec<State> {
    let decide = |index: usize| {
        let (row, col) = (index / lattice.cols, index % lattice.cols);
        let place = &places[index];
        let mut first = true;
        let rows = row.saturating_sub(NEIGHBOURS)..(row + NEIGHBOURS + 1).min(lattice.rows);
        let cols = col.saturating_sub(NEIGHBOURS)..(col + NEIGHBOURS + 1).min(lattice.cols);
        for r in rows {
            for c in cols.clone() {
                let other = r * lattice.cols + c;
                let near = &places[other];
                let state = states[other];
                // lattice order settles equal ranks
                let ahead = (near.rank, other) < (place.rank, index);
                if state == State::Gone || other == index || (state == State::Open && !ahead) {
                    continue;
                }
                let east = c as f32 - col as f32 + near.east - place.east;
                let north = row as f32 - r as f32 + near.north - place.north;
                let apart = 0.5 * (place.spacing + near.spacing);
                if east * east + north * north < apart * apart {
                    if state == State::Kept {
                        return State::Gone;
                    }
                    first = false;
                }
            }
        }
        if first { State::Kept } else { State::Open }
    };
    (0..places.len())
        .into_par_iter()
        .map(|index| if states[index] == State::Open { decide(index) } else { states[index] })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::canopy::generate::tests::{flat_site, hills};

    fn planted(seed: u64, west_m: f64) -> (Lattice, Vec<PlantingSpot>) {
        let mut terrain = hills(100, 1.0);
        let mut frame = terrain.elevation_m.frame().as_ref().clone();
        frame.transform.west_m = west_m;
        let grid = &terrain.elevation_m;
        terrain.elevation_m =
            Grid::new(frame.into(), std::sync::Arc::clone(grid.mask()), grid.values().to_vec());
        let params = GenerateParams { seed, trees_per_ha: 600.0, ..GenerateParams::default() };
        let site = flat_site(&terrain, 40.0, 12.0, 0.2);
        let frame = terrain.elevation_m.frame();
        let lattice = Lattice::new(frame, &params);
        let stands = Stands::new(frame, &site, lattice.reach_m(), &params);
        let rows = places(&lattice, &stands, &terrain.elevation_m, seed);
        (lattice, rows.into_iter().flatten().collect())
    }

    #[test]
    fn no_two_places_are_nearer_than_their_spacing_and_none_is_left_free() {
        let (lattice, spots) = planted(3, 0.0);
        assert!(spots.len() > 500, "{}", spots.len());
        for (i, a) in spots.iter().enumerate() {
            for b in &spots[i + 1..] {
                let (e, n) = (a.east_m - b.east_m, a.north_m - b.north_m);
                let apart = 0.5 * (a.spacing_m + b.spacing_m);
                assert!((e * e + n * n).sqrt() > apart - 1e-3, "{a:?} {b:?}");
            }
        }
        // a place farther than 1.8 of the widest spacing from all trees would be a hole
        let hole = 1.8 * 1.3 * lattice.spacing_m as f32;
        for i in 0..400 {
            let (e, n) = (5.0 * (i % 20) as f32, 5.0 * (i / 20) as f32);
            let near = |s: &PlantingSpot| (s.east_m - e).abs() + (s.north_m - n).abs() < hole * 1.5;
            assert!(spots.iter().any(near), "nothing near ({e}, {n})");
        }
    }

    #[test]
    fn a_place_keeps_its_tree_in_another_window() {
        let (_, here) = planted(3, 0.0);
        let (_, east) = planted(3, 20.0);
        let inside = |s: &&PlantingSpot| (30.0..90.0).contains(&s.east_m);
        let moved = here.iter().filter(inside).filter(|s| {
            let same = |o: &PlantingSpot| {
                o.entity == s.entity && (s.east_m - 20.0 - o.east_m).abs() < 1e-3
            };
            (0.0..100.0).contains(&s.north_m) && !east.iter().any(same)
        });
        assert_eq!(moved.count(), 0);
    }
}
