//! Maps of any size through a network, by overlapping tiles.
//!
//! A network sees no farther than its card's halo, and treats all cells alike that lie alike on its stride. Each tile is
//! therefore handed over with a halo, begun at a multiple of the stride **on the map**; the network works out what lies
//! inside. What a cell gets depends neither on the layout of tiles nor on the window that is looked at.

use std::sync::atomic::{AtomicUsize, Ordering};

use super::InferenceError;
use super::runtime::{Network, Tile};
use crate::progress::Reporter;

/// Maps that a network takes, on one lattice; outside them their border goes on.
pub struct MapPlanes<'a> {
    /// Number of rows.
    pub rows: usize,
    /// Number of columns.
    pub cols: usize,
    /// Row 0 on the map, counted in cells southward from the CRS's origin.
    pub first_south: i64,
    /// Column 0 on the map, counted in cells eastward from the CRS's origin.
    pub first_east: i64,
    /// One map a channel, row-major.
    pub planes: Vec<&'a [f32]>,
}

/// Cores of tiles are at most this large.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TileLayout {
    /// Rows of a core.
    pub rows: usize,
    /// Columns of a core.
    pub cols: usize,
}

impl Default for TileLayout {
    /// Wide enough that halos cost less than the cores, small enough that a square kilometre occupies two threads.
    fn default() -> Self {
        Self { rows: 128, cols: 512 }
    }
}

/// A core, in rows and columns of the map.
#[derive(Clone, Copy)]
struct Core {
    row: usize,
    col: usize,
    rows: usize,
    cols: usize,
}

impl Network {
    /// What the network gives for every cell of the maps, row-major; `noise` gives a value for (cells south, cells east)
    /// on the map.
    ///
    /// # Errors
    /// If the runtime fails, or the run was cancelled.
    ///
    /// # Panics
    /// If the maps are not those of the network's card.
    pub fn run(
        &self,
        maps: &MapPlanes<'_>,
        noise: impl Fn(i64, i64) -> f32 + Sync,
        layout: TileLayout,
        name: &'static str,
        reporter: &Reporter,
    ) -> Result<Vec<f32>, InferenceError> {
        let MapPlanes { rows, cols, .. } = *maps;
        assert_eq!(maps.planes.len(), self.card.channels.len(), "not the network's channels");
        for plane in &maps.planes {
            assert_eq!(plane.len(), rows * cols, "a channel does not fill the map");
        }
        let cores = cores(rows, cols, layout);
        let stage = reporter.stage(name, cores.len() as u64);
        // threads of our own: runtimes have pools, and a worker of rayon that waits for another pool begins further
        // tiles meanwhile, one upon the other
        let next = AtomicUsize::new(0);
        let work = || {
            let mut kept = Vec::new();
            while let Some(core) = cores.get(next.fetch_add(1, Ordering::Relaxed)) {
                reporter.check_cancelled()?;
                kept.push((*core, self.tile(maps, &noise, *core)?));
                stage.advance(1);
            }
            Ok::<_, InferenceError>(kept)
        };
        let threads = rayon::current_num_threads().min(cores.len());
        let tiles = std::thread::scope(|scope| {
            let workers: Vec<_> = (0..threads).map(|_| scope.spawn(work)).collect();
            let joined = workers.into_iter().map(|worker| {
                worker.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
            });
            joined.collect::<Result<Vec<_>, _>>()
        })?;
        let mut values = vec![0.0; rows * cols];
        for (core, tile) in tiles.into_iter().flatten() {
            for (row, kept) in tile.chunks_exact(core.cols).enumerate() {
                values[(core.row + row) * cols + core.col..][..core.cols].copy_from_slice(kept);
            }
        }
        Ok(values)
    }

    /// The network's values in a core.
    fn tile(
        &self,
        maps: &MapPlanes<'_>,
        noise: &(impl Fn(i64, i64) -> f32 + Sync),
        core: Core,
    ) -> Result<Vec<f32>, InferenceError> {
        // sizes of maps fit i64
        let (stride, halo) = (self.card.stride_cells as i64, self.card.halo_cells as i64);
        let span = |first: i64, begin: usize, cells: usize| {
            let begin = first + begin as i64;
            let from = (begin - halo).div_euclid(stride) * stride;
            let until = -(-(begin + cells as i64 + halo)).div_euclid(stride) * stride;
            (from - first, (until - from) as usize)
        };
        let (top, rows) = span(maps.first_south, core.row, core.rows);
        let (left, cols) = span(maps.first_east, core.col, core.cols);
        let inside = |at: i64, cells: usize| at.clamp(0, cells as i64 - 1) as usize;

        // the border goes on outside
        let source_cols: Vec<usize> =
            (0..cols as i64).map(|col| inside(left + col, maps.cols)).collect();
        let mut conditions = Vec::with_capacity(maps.planes.len() * rows * cols);
        for plane in &maps.planes {
            for row in 0..rows as i64 {
                let line = &plane[inside(top + row, maps.rows) * maps.cols..][..maps.cols];
                conditions.extend(source_cols.iter().map(|col| line[*col]));
            }
        }
        let mut drawn = Vec::with_capacity(rows * cols);
        for row in 0..rows as i64 {
            let south = maps.first_south + top + row;
            let first_east = maps.first_east + left;
            drawn.extend((0..cols as i64).map(|col| noise(south, first_east + col)));
        }
        let channels = maps.planes.len();
        let halo = self.card.halo_cells;
        let tile = Tile { channels, rows, cols, conditions, noise: drawn, halo };
        let [_, cols_inside] = tile.inside();
        let values = self.runtime.run(tile)?;

        // the core lies within
        let inside = |core: usize, first: i64| (core as i64 - first) as usize - halo;
        let (down, right) = (inside(core.row, top), inside(core.col, left));
        let lines =
            (down..down + core.rows).map(|row| &values[row * cols_inside + right..][..core.cols]);
        Ok(lines.flatten().copied().collect())
    }
}

/// Cores that make up a map, as equal as can be.
fn cores(rows: usize, cols: usize, layout: TileLayout) -> Vec<Core> {
    let spans = |cells: usize, most: usize| {
        let parts = cells.div_ceil(most.max(1)).max(1);
        (0..parts).map(move |part| {
            let begin = part * cells / parts;
            (begin, (part + 1) * cells / parts - begin)
        })
    };
    spans(rows, layout.rows)
        .flat_map(|(row, rows)| {
            spans(cols, layout.cols).map(move |(col, cols)| Core { row, col, rows, cols })
        })
        .filter(|core| core.rows * core.cols > 0)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::runtime::Runtime;
    use crate::inference::{Card, Model, ModelSource, RuntimeChoice, Runtimes};
    use crate::rng::{self, Key, Process};

    fn draw(south: i64, east: i64) -> f32 {
        let entity = rng::entity_of_cell(east, -south);
        let key = Key { seed: 5, process: Process::StrewnPoints, year: 0, month: 0, entity };
        2.0 * rng::uniforms(key)[0] - 1.0
    }

    fn height_network() -> Network {
        let channels = ["footprint", "relief", "gradient_east", "gradient_north", "stand_height"];
        let model = Model::load(&ModelSource::BuiltIn, "height", &channels).unwrap();
        let runtimes = Runtimes { choice: RuntimeChoice::Rten, ..Runtimes::default() };
        runtimes.open(&model, |text| panic!("{text}")).unwrap()
    }

    struct Window {
        rows: usize,
        cols: usize,
        first_south: i64,
        first_east: i64,
    }

    /// The network's values in a window of an endless map.
    fn values(network: &Network, window: &Window, layout: TileLayout) -> Vec<f32> {
        let Window { rows, cols, first_south, first_east } = *window;
        let plane = |scale: f32, shift: i64| -> Vec<f32> {
            let cells =
                (0..rows as i64).flat_map(|row| (0..cols as i64).map(move |col| (row, col)));
            cells
                .map(|(row, col)| {
                    scale * draw((first_south + row) / 7 + shift, (first_east + col) / 7)
                })
                .collect()
        };
        let footprint: Vec<f32> = plane(1.0, 0).iter().map(|v| f32::from(*v > -0.2)).collect();
        let others = [plane(0.5, 100), plane(0.5, 200), plane(0.5, 300), plane(0.6, 400)];
        let mut planes = vec![footprint.as_slice()];
        planes.extend(others.iter().map(Vec::as_slice));
        let maps = MapPlanes { rows, cols, first_south, first_east, planes };
        network.run(&maps, draw, layout, "test", &Reporter::silent()).unwrap()
    }

    fn worst(a: &[f32], b: &[f32]) -> f32 {
        a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
    }

    #[test]
    fn nine_tiles_give_what_one_gives() {
        let network = height_network();
        let window = Window { rows: 150, cols: 170, first_south: -37, first_east: 1003 };
        let one = values(&network, &window, TileLayout { rows: 1000, cols: 1000 });
        let nine = values(&network, &window, TileLayout { rows: 50, cols: 57 });
        assert!(one.iter().any(|h| *h > 5.0) && one.iter().any(|h| *h < 3.0));
        assert!(worst(&one, &nine) < 1e-5, "{}", worst(&one, &nine));
    }

    #[test]
    fn a_window_gives_what_the_whole_gives_a_halo_from_its_rim() {
        let network = height_network();
        let whole = Window { rows: 210, cols: 220, first_south: -37, first_east: 1003 };
        let part = Window { rows: 160, cols: 150, first_south: -17, first_east: 1043 };
        let layout = TileLayout::default();
        let (all, some) = (values(&network, &whole, layout), values(&network, &part, layout));
        let halo = network.card.halo_cells;
        for row in halo..part.rows - halo {
            let a = &all[(row + 20) * whole.cols + 40 + halo..][..part.cols - 2 * halo];
            let b = &some[row * part.cols + halo..][..part.cols - 2 * halo];
            assert!(worst(a, b) < 1e-5);
        }
    }

    #[test]
    fn any_number_of_threads_gives_the_same_bits() {
        let network = height_network();
        let window = Window { rows: 130, cols: 100, first_south: 3, first_east: -5 };
        let layout = TileLayout { rows: 40, cols: 60 };
        let run = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| values(&network, &window, layout))
        };
        assert!(run(1) == run(3));
    }

    #[test]
    fn tiny_maps_and_maps_of_a_line_go_through() {
        let network = height_network();
        for (rows, cols) in [(1, 1), (1, 40), (33, 2)] {
            let window = Window { rows, cols, first_south: 11, first_east: 7 };
            assert_eq!(values(&network, &window, TileLayout::default()).len(), rows * cols);
        }
    }

    /// Gives back its first channel inside the halo.
    struct Echo;

    impl Runtime for Echo {
        fn name(&self) -> &str {
            "echo"
        }

        fn run(&self, tile: Tile) -> Result<Vec<f32>, InferenceError> {
            assert!(tile.rows.is_multiple_of(16) && tile.cols.is_multiple_of(16));
            let [rows, cols] = tile.inside();
            let line = |row| &tile.conditions[(row + tile.halo) * tile.cols + tile.halo..][..cols];
            Ok((0..rows).flat_map(line).copied().collect())
        }
    }

    #[test]
    fn cores_are_put_back_where_they_were_cut() {
        let card = Card::parse(
            include_str!("../../models/height.toml"),
            "card",
            "height",
            &["footprint", "relief", "gradient_east", "gradient_north", "stand_height"],
        );
        let network = Network { card: card.unwrap(), runtime: Box::new(Echo) };
        let map: Vec<f32> = (0..61 * 83).map(|i| i as f32).collect();
        let planes = vec![map.as_slice(); 5];
        let maps = MapPlanes { rows: 61, cols: 83, first_south: -8, first_east: 5, planes };
        let layout = TileLayout { rows: 20, cols: 30 };
        let echoed = network.run(&maps, draw, layout, "test", &Reporter::silent()).unwrap();
        assert!(echoed == map);
    }
}
