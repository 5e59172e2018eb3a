//! Poisson-disk tiles: even but irregular points over any area, from sixteen small tiles that fit each other.
//!
//! Each corner of the tiles' lattice has one of two colours, drawn by its absolute place on the map, and a tile is the one
//! of the set with its four corners' colours: so the pattern does not repeat, and any window shows the same points. Points
//! of a square around a corner depend on its colour alone, those of a strip along an edge on the colours of its two ends;
//! what is left of a tile is its own. All are strewn with the largest distance first, then between those points with
//! one √2 shorter, and so on: so the first points of a tile, as many as one likes, are spread evenly too, across seams.
//!
//! # Reference
//! Kapp et al. 2020, section 6.3, doi:10.1145/3414685.3417848 (one tile); Lagae & Dutré 2006, "An alternative for Wang
//! tiles: colored edges versus colored corners", ACM Transactions on Graphics 25(4), doi:10.1145/1183287.1183296.

use std::f64::consts::{FRAC_1_SQRT_2, SQRT_2};

use rayon::prelude::*;

use super::dart_throwing::{Dart, Rectangle, fill};
use crate::raster::{Cell, Grid};
use crate::rng::{Key, Process, entity_of_cell, words};

/// Colours of corners.
const COLORS: usize = 2;
/// Edges of one direction: one for each pair of ends.
const EDGES: usize = COLORS * COLORS;
/// Tiles: one for each four corners.
const TILES: usize = EDGES * EDGES;

/// Half width of the strip along an edge, in distances w = 1/(√2 − 1): the strip one level coarser, √2 wider, then reaches
/// a distance beyond this one, so that its points alone decide what fits here.
const STRIP: f64 = SQRT_2 + 1.0;
/// Half width of the square around a corner, in distances: strips that meet there stay a distance apart, √2·(h − w) = 1.
const SQUARE: f64 = STRIP + FRAC_1_SQRT_2;

/// Greatest distance in tile widths: squares at the ends of an edge stay a distance apart, 2h + 1 = 1/r.
pub const MOST_DISTANCE: f32 = 0.138;
/// Least distance that tiles are made for, in tile widths: about 7,000 points a tile.
pub const LEAST_DISTANCE: f32 = 0.01;

/// A point of a tile, in tile widths from its south-west corner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TilePoint {
    /// East, 0..1.
    pub east: f32,
    /// North, 0..1.
    pub north: f32,
    /// Place in the order of points, 0..1: those below a density are as many as it says of all points.
    pub rank: f32,
}

/// A point of an area.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FloorPoint {
    /// Metres east of the grid's south-west corner.
    pub east_m: f32,
    /// Metres north of it.
    pub north_m: f32,
    /// Cell of the grid.
    pub cell: Cell,
    /// Place in the order of points, 0..1, below the cell's density.
    pub rank: f32,
}

/// Tiles of points that fit each other along all edges.
#[derive(Clone, Debug, PartialEq)]
pub struct PoissonTiles {
    seed: u64,
    min_distance: f32,
    /// By colour of the corners: south-west, south-east, north-west, north-east are bits 0 to 3.
    tiles: Vec<Vec<TilePoint>>,
}

/// Points of a corner's square, of an edge's strip, or of a tile's rest, and the level each came with.
type Part = Vec<(Dart, usize)>;

impl PoissonTiles {
    /// Tiles whose points are at least `min_distance` tile widths apart, within and across tiles, and leave no place
    /// farther than that from all of them; about 0.7/`min_distance`² points a tile.
    ///
    /// # Panics
    /// If the distance is outside [`LEAST_DISTANCE`]..=[`MOST_DISTANCE`].
    pub fn generate(seed: u64, min_distance: f32) -> Self {
        assert!(
            (LEAST_DISTANCE..=MOST_DISTANCE).contains(&min_distance),
            "a distance of {min_distance} tile widths: tiles are made for {LEAST_DISTANCE} to {MOST_DISTANCE}"
        );
        let mut distances = vec![f64::from(min_distance)];
        while distances[0] * SQRT_2 <= f64::from(MOST_DISTANCE) {
            distances.insert(0, distances[0] * SQRT_2);
        }

        // Strewn from the largest distance to the least
        let mut set = Set {
            corners: vec![Part::new(); COLORS],
            across: vec![Part::new(); EDGES],
            up: vec![Part::new(); EDGES],
            inner: vec![Part::new(); TILES],
        };
        for (level, &distance) in distances.iter().enumerate() {
            set.strew(seed, level, distance);
        }

        // Ranks: each level follows those before it, in an order drawn for each point
        let tiles: Vec<Vec<(Dart, usize)>> = (0..TILES).map(|tile| set.tile(tile)).collect();
        let up_to =
            |level: usize| tiles.iter().flatten().filter(|(_, of)| *of < level).count() as f64;
        let all = up_to(distances.len());
        // shares of one
        let starts: Vec<f32> =
            (0..=distances.len()).map(|level| (up_to(level) / all) as f32).collect();
        let point = |&(dart, level): &(Dart, usize)| TilePoint {
            east: dart.at[0] as f32, // 0..1
            north: dart.at[1] as f32,
            rank: starts[level] + (starts[level + 1] - starts[level]) * dart.draw,
        };
        let ranked = |part: &Vec<(Dart, usize)>| {
            let mut points: Vec<TilePoint> = part.iter().map(point).collect();
            points.sort_by(|a, b| a.rank.total_cmp(&b.rank));
            points
        };
        Self { seed, min_distance, tiles: tiles.iter().map(ranked).collect() }
    }

    /// Least distance of two points, in tile widths.
    pub fn min_distance(&self) -> f32 {
        self.min_distance
    }

    /// Points of a tile, mean over the set.
    pub fn points_per_tile(&self) -> f32 {
        self.tiles.iter().map(Vec::len).sum::<usize>() as f32 / TILES as f32
    }

    /// Every tile of the set, for programs that lay them out themselves: index = Σ colour · (1 south-west, 2 south-east,
    /// 4 north-west, 8 north-east).
    pub fn all(&self) -> &[Vec<TilePoint>] {
        &self.tiles
    }

    /// Points of the tile so many tiles east and north of the origin of map coordinates, by rank.
    pub fn tile_at(&self, tile_east: i64, tile_north: i64) -> &[TilePoint] {
        let color = |east: i64, north: i64| {
            let entity = entity_of_cell(tile_east + east, tile_north + north);
            let key =
                Key { seed: self.seed, process: Process::PoissonCorner, year: 0, month: 0, entity };
            words(key)[0] as usize % COLORS
        };
        let corners = [color(0, 0), color(1, 0), color(0, 1), color(1, 1)];
        let tile = corners.iter().rev().fold(0, |index, color| index * COLORS + color);
        &self.tiles[tile]
    }

    /// Points over the valid cells of a grid of densities, shares in 0..=1 of the points of densest ground, which lie
    /// `min_distance_m` or more apart: where the density is d, those whose rank is below d. Tile after tile from the
    /// south-west.
    ///
    /// # Panics
    /// If the distance is not above 0.
    pub fn over<'a>(
        &'a self,
        density: &'a Grid<f32>,
        min_distance_m: f64,
    ) -> impl Iterator<Item = FloorPoint> + 'a {
        assert!(min_distance_m > 0.0, "points {min_distance_m} m apart: give a distance above 0");
        let (frame, corner) = (density.frame(), density.frame().south_west());
        let tile_m = min_distance_m / f64::from(self.min_distance);
        let cell_m = frame.transform.cell_m;
        let size_m = [frame.cols, frame.rows].map(|cells| cells as f64 * cell_m);
        let tiles = |from_m: f64, size_m: f64| {
            // far below 2⁵³
            let number = |m: f64| (m / tile_m).floor() as i64;
            number(from_m)..=number(from_m + size_m)
        };
        let [across, up] = [tiles(corner.east_m, size_m[0]), tiles(corner.north_m, size_m[1])];
        let tile = move |(tile_east, tile_north): (i64, i64)| {
            self.tile_at(tile_east, tile_north).iter().filter_map(move |point| {
                let place_m = |tile: i64, at: f32, corner_m: f64| {
                    (tile as f64 + f64::from(at)) * tile_m - corner_m
                };
                let east_m = place_m(tile_east, point.east, corner.east_m);
                let north_m = place_m(tile_north, point.north, corner.north_m);
                if !(0.0..size_m[0]).contains(&east_m) || !(0.0..size_m[1]).contains(&north_m) {
                    return None;
                }
                // not negative; `get` sees to what lies beyond
                let cell = Cell {
                    row: ((size_m[1] - north_m) / cell_m) as usize,
                    col: (east_m / cell_m) as usize,
                };
                let wanted = *density.get(cell)? > point.rank;
                // a scene's places fit f32 to the millimetre
                wanted.then_some(FloorPoint {
                    east_m: east_m as f32,
                    north_m: north_m as f32,
                    cell,
                    rank: point.rank,
                })
            })
        };
        up.flat_map(move |north| across.clone().map(move |east| (east, north))).flat_map(tile)
    }
}

/// The parts that tiles are put together from.
struct Set {
    /// By colour, from the corner.
    corners: Vec<Part>,
    /// Edges from west to east, by west + 2 · east, from the west end.
    across: Vec<Part>,
    /// Edges from south to north, by south + 2 · north, from the south end.
    up: Vec<Part>,
    /// By the tile's corners, from the south-west one.
    inner: Vec<Part>,
}

/// Colours of a tile's corners: south-west, south-east, north-west, north-east.
fn colors(tile: usize) -> [usize; 4] {
    std::array::from_fn(|bit| tile >> bit & 1)
}

/// Where a tile's corners lie, in the order of [`colors`].
const CORNERS: [[f64; 2]; 4] = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]];

fn moved(part: &Part, by: [f64; 2]) -> impl Iterator<Item = (Dart, usize)> + '_ {
    part.iter().map(move |&(dart, level)| {
        (Dart { at: [dart.at[0] + by[0], dart.at[1] + by[1]], ..dart }, level)
    })
}

impl Set {
    /// Strews the points of one more level: corners, then edges, then what is left of tiles. What lies a distance around
    /// each of these is known by then.
    fn strew(&mut self, seed: u64, level: usize, distance: f64) {
        let (strip, square) = (STRIP * distance, SQUARE * distance);
        // levels are fewer than twenty, parts fewer than thirty
        let key = |part: usize| Key {
            seed,
            process: Process::PoissonTile,
            year: level as u16,
            month: 0,
            entity: part as u64,
        };
        let place = |(dart, _): (Dart, usize)| dart.at;
        let with_level = |darts: Vec<Dart>| darts.into_iter().map(move |dart| (dart, level));

        for (color, corner) in self.corners.iter_mut().enumerate() {
            let region = [Rectangle { low: [-square; 2], high: [square; 2] }];
            let standing = moved(corner, [0.0; 2]).map(place).collect::<Vec<_>>();
            let darts = fill(&region, standing.into_iter(), distance, key(color));
            corner.extend(with_level(darts));
        }

        let (along, beside) = ([square, 1.0 - square], [-strip, strip]);
        for (ends, end) in (0..EDGES).map(|ends| (ends, [ends % COLORS, ends / COLORS])) {
            for (edges, first, region, far) in [
                (
                    &mut self.across,
                    COLORS,
                    Rectangle { low: [along[0], beside[0]], high: [along[1], beside[1]] },
                    [1.0, 0.0],
                ),
                (
                    &mut self.up,
                    COLORS + EDGES,
                    Rectangle { low: [beside[0], along[0]], high: [beside[1], along[1]] },
                    [0.0, 1.0],
                ),
            ] {
                let standing = moved(&self.corners[end[0]], [0.0; 2])
                    .chain(moved(&self.corners[end[1]], far))
                    .chain(moved(&edges[ends], [0.0; 2]))
                    .map(place);
                let darts = fill(&[region], standing, distance, key(first + ends));
                edges[ends].extend(with_level(darts));
            }
        }

        // a cross of three rectangles: squares reach farther in than strips
        let (low, high) = ([strip, square], [1.0 - strip, 1.0 - square]);
        let region = [
            Rectangle { low: [low[0], low[1]], high: [high[0], high[1]] },
            Rectangle { low: [low[1], low[0]], high: [high[1], low[1]] },
            Rectangle { low: [low[1], high[1]], high: [high[1], high[0]] },
        ];
        let darts: Vec<Vec<Dart>> = (0..TILES)
            .into_par_iter()
            .map(|tile| {
                let standing = self.parts(tile).map(place).collect::<Vec<_>>();
                fill(&region, standing.into_iter(), distance, key(COLORS + 2 * EDGES + tile))
            })
            .collect();
        for (inner, darts) in self.inner.iter_mut().zip(darts) {
            inner.extend(with_level(darts));
        }
    }

    /// All points of a tile's parts, those beyond its edges too.
    fn parts(&self, tile: usize) -> impl Iterator<Item = (Dart, usize)> + '_ {
        let corner = colors(tile);
        let edge = |from: usize, to: usize| corner[from] + COLORS * corner[to];
        let corners = (0..4).flat_map(move |at| moved(&self.corners[corner[at]], CORNERS[at]));
        corners
            .chain(moved(&self.across[edge(0, 1)], CORNERS[0]))
            .chain(moved(&self.across[edge(2, 3)], CORNERS[2]))
            .chain(moved(&self.up[edge(0, 2)], CORNERS[0]))
            .chain(moved(&self.up[edge(1, 3)], CORNERS[1]))
            .chain(moved(&self.inner[tile], CORNERS[0]))
    }

    /// The points within a tile.
    fn tile(&self, tile: usize) -> Part {
        // as they will stand in f32, so that a point on a seam belongs to one tile
        let inside = |at: f64| (0.0..1.0).contains(&at) && (at as f32) < 1.0;
        self.parts(tile).filter(|(dart, _)| dart.at.into_iter().all(inside)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::raster::{Frame, GeoTransform, Mask};
    use std::sync::Arc;

    const DISTANCE: f32 = 1.0 / 32.0;
    const SIDE: f64 = 8.0;

    /// A field of densities `side` m wide with its south-west corner at a place; points are 1/32 m apart at least.
    fn field(
        west_m: f64,
        south_m: f64,
        side: f64,
        cell_m: f64,
        density: impl Fn(Cell) -> f32,
    ) -> Grid<f32> {
        let cells = (side / cell_m) as usize;
        let transform = GeoTransform { west_m, north_m: south_m + side, cell_m };
        let frame = Frame { transform, ..Frame::local(cells, cells, cell_m) };
        let values = (0..frame.len()).map(|index| density(frame.cell(index))).collect();
        let mask = Mask::all_valid(frame.len());
        Grid::new(Arc::new(frame), Arc::new(mask), values)
    }

    fn points(tiles: &PoissonTiles, density: &Grid<f32>) -> Vec<FloorPoint> {
        tiles.over(density, f64::from(DISTANCE)).collect()
    }

    /// Points by square cells `side` wide.
    fn by_cell(points: &[FloorPoint], side: f32) -> impl Fn(f32, f32) -> Vec<FloorPoint> + '_ {
        let count = (SIDE as f32 / side) as usize + 1;
        let mut cells = vec![Vec::new(); count * count];
        let line = move |at: f32| ((at / side).max(0.0) as usize).min(count - 1);
        for point in points {
            cells[line(point.north_m) * count + line(point.east_m)].push(*point);
        }
        move |east: f32, north: f32| {
            let around = |at: f32| line(at - side)..=line(at + side);
            around(north)
                .flat_map(|row| around(east).map(move |col| row * count + col))
                .flat_map(|cell| cells[cell].clone())
                .collect()
        }
    }

    fn least_distance(points: &[FloorPoint], search: f32) -> f32 {
        let near = by_cell(points, search);
        let mut least = f32::INFINITY;
        for a in points {
            for b in near(a.east_m, a.north_m).iter().filter(|b| *b != a) {
                let (x, y) = (a.east_m - b.east_m, a.north_m - b.north_m);
                least = least.min((x * x + y * y).sqrt());
            }
        }
        least
    }

    #[test]
    fn points_keep_their_distance_across_seams_and_so_do_the_first_of_them() {
        let tiles = PoissonTiles::generate(3, DISTANCE);
        let all = points(&tiles, &field(-3.5, 1000.2, SIDE, 1.0, |_| 1.0));
        let least = least_distance(&all, 0.05);
        assert!((DISTANCE - 1e-5..DISTANCE * 1.01).contains(&least), "{least}");
        // a quarter of the points is two levels earlier: twice the distance, but for the share of points that do not split
        // quite evenly
        for (density, levels) in [(0.23, 2), (0.11, 3)] {
            let few: Vec<FloorPoint> = all.iter().copied().filter(|p| p.rank < density).collect();
            let least = least_distance(&few, 0.2) / DISTANCE;
            assert!(least > f32::powi(2.0, levels).sqrt() - 1e-3, "{density}: {least}");
        }
    }

    #[test]
    fn no_place_is_farther_from_all_points_than_their_distance() {
        let tiles = PoissonTiles::generate(4, DISTANCE);
        let all = points(&tiles, &field(0.3, -0.7, SIDE, 1.0, |_| 1.0));
        let near = by_cell(&all, 0.05);
        let mut widest = 0.0_f32;
        for sample in 0..400_000 {
            let at = |line: i32| 0.1 + (SIDE as f32 - 0.2) * (line as f32 + 0.37) / 633.0;
            let (east, north) = (at(sample % 633), at(sample / 633));
            let distance = |p: &FloorPoint| {
                let (x, y) = (p.east_m - east, p.north_m - north);
                (x * x + y * y).sqrt()
            };
            widest = widest.max(near(east, north).iter().map(distance).fold(1.0, f32::min));
        }
        assert!(widest < DISTANCE * 1.002, "{widest}");
        assert!(widest > DISTANCE * 0.9, "the search sees holes: {widest}");
    }

    #[test]
    fn densities_are_as_asked() {
        let tiles = PoissonTiles::generate(1, DISTANCE);
        let per_tile = f64::from(tiles.points_per_tile());
        // 0.7 points a square of the distance: saturated strewing has 0.547/(π/4) = 0.696
        assert!((0.66..0.74).contains(&(per_tile / 1024.0)), "{per_tile}");
        for density in [0.02, 0.1, 0.37, 0.5, 0.81, 1.0] {
            let count = points(&tiles, &field(0.0, 0.0, SIDE, 1.0, |_| density)).len() as f64;
            let expected = per_tile * SIDE * SIDE * f64::from(density);
            let bound = 0.01 * expected + 2.0 * expected.sqrt();
            assert!((count - expected).abs() < bound, "{density}: {count} {expected}");
        }
        assert_eq!(points(&tiles, &field(0.0, 0.0, SIDE, 1.0, |_| 0.0)).len(), 0);
    }

    #[test]
    fn points_lie_in_cells_of_their_density_and_none_where_masked() {
        let tiles = PoissonTiles::generate(1, DISTANCE);
        let east_only = field(100.0, 50.0, SIDE, 0.5, |c| if c.col >= 8 { 0.6 } else { 0.0 });
        let found = points(&tiles, &east_only);
        assert!(found.iter().all(|p| p.east_m >= 4.0 && p.rank < 0.6));
        for p in &found {
            assert_eq!(p.cell.col, (p.east_m / 0.5) as usize);
            assert_eq!(p.cell.row, ((8.0 - p.north_m) / 0.5) as usize);
        }
        let north = east_only.mask().as_slice().iter().enumerate().map(|(i, _)| i < 128).collect();
        let masked = Grid::new(
            Arc::clone(east_only.frame()),
            Arc::new(Mask::new(north)),
            east_only.values().to_vec(),
        );
        let found = points(&tiles, &masked);
        assert!(!found.is_empty() && found.iter().all(|p| p.north_m >= 4.0));
    }

    #[test]
    fn seams_are_as_dense_as_the_middle() {
        let tiles = PoissonTiles::generate(2, DISTANCE);
        let all: Vec<&TilePoint> = tiles.all().iter().flatten().collect();
        let rim = 3.5 * DISTANCE;
        let is_rim = |p: &&&TilePoint| [p.east, p.north].iter().any(|v| *v < rim || *v > 1.0 - rim);
        let share = all.iter().filter(is_rim).count() as f32 / all.len() as f32;
        let area = 1.0 - (1.0 - 2.0 * rim) * (1.0 - 2.0 * rim);
        assert!((share / area - 1.0).abs() < 0.04, "{share} of the points on {area}");
    }

    #[test]
    fn equal_seeds_give_equal_tiles_on_any_number_of_threads_and_others_do_not() {
        let with = |threads: usize, seed: u64| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| PoissonTiles::generate(seed, 0.06))
        };
        assert_eq!(with(1, 9), with(3, 9));
        assert_ne!(with(1, 9).tiles, with(1, 10).tiles);
    }

    #[test]
    fn windows_of_a_map_show_the_same_points() {
        let tiles = PoissonTiles::generate(1, DISTANCE);
        let whole = points(&tiles, &field(500.0, 200.0, 6.0, 1.0, |_| 0.3));
        let part = points(&tiles, &field(502.0, 203.0, 2.0, 1.0, |_| 0.3));
        let inside =
            |p: &&FloorPoint| (2.0..4.0).contains(&p.east_m) && (3.0..5.0).contains(&p.north_m);
        assert_eq!(whole.iter().filter(inside).count(), part.len());
    }

    #[test]
    fn tiles_do_not_repeat() {
        let tiles = PoissonTiles::generate(1, 0.1);
        let at = |east: i64, north: i64| tiles.tile_at(east, north).as_ptr();
        for period in 1..20 {
            let equal = (0..400).filter(|i| at(i % 20, i / 20) == at(i % 20 + period, i / 20));
            assert!(equal.count() < 200, "period {period}");
        }
        let mut seen: Vec<_> = (0..400).map(|i| at(i % 20, i / 20)).collect();
        seen.sort_unstable();
        seen.dedup();
        assert_eq!(seen.len(), TILES);
    }
}
