//! Generator: sketch and terrain to footprint, footprint and terrain to canopy height.
//!
//! # Reference
//! Kapp et al. 2020, section 4: (H, P) → F → C.

use std::cell::RefCell;
use std::sync::Arc;

use super::bare::CLIFF_SLOPE;
use super::coarse::CoarseCells;
use super::conditions::{TerrainChannels, encoded_height};
use super::detail::{self, CANOPY_M, CoarseCanopy};
use super::sketch::{Density, Sketch};
use super::stand_height;
use crate::inference::{
    InferenceError, MapPlanes, Model, ModelSource, Network, Runtimes, TileLayout,
};
use crate::progress::Reporter;
use crate::raster::{Grid, Mask};
use crate::rng::{self, Key, Process};

const FOOTPRINT_CHANNELS: [&str; 7] = [
    "sketch_empty",
    "sketch_sparse",
    "sketch_dense",
    "relief",
    "gradient_east",
    "gradient_north",
    "stand_height",
];
const HEIGHT_CHANNELS: [&str; 5] =
    ["footprint", "relief", "gradient_east", "gradient_north", "stand_height"];

/// The two trained networks.
pub struct Generators {
    footprint: Network,
    height: Network,
}

/// What a canopy is generated on, on coarse cells.
pub struct CoarseGround {
    /// The cells.
    pub cells: CoarseCells,
    /// Elevation, m.
    pub elevation_m: Grid<f32>,
    /// Cells that stay without trees whatever is painted.
    pub bare: Vec<bool>,
    /// Stand height, m.
    pub stand_m: Vec<f32>,
    channels: TerrainChannels,
    encoded_stand: Vec<f32>,
}

impl Generators {
    /// Opens both networks; `tell` hears of a runtime that is passed over.
    ///
    /// # Errors
    /// If a network or its runtime cannot be used.
    pub fn open(
        source: &ModelSource,
        runtimes: &Runtimes,
        tell: impl Fn(String),
    ) -> Result<Self, InferenceError> {
        let footprint = Model::load(source, "footprint", &FOOTPRINT_CHANNELS)?;
        let height = Model::load(source, "height", &HEIGHT_CHANNELS)?;
        // a library that cannot be used fails for both in the same words
        let told = RefCell::new(Vec::new());
        let tell = |text: String| {
            if !told.borrow().contains(&text) {
                told.borrow_mut().push(text.clone());
                tell(text);
            }
        };
        Ok(Self {
            footprint: runtimes.open(&footprint, tell)?,
            height: runtimes.open(&height, tell)?,
        })
    }

    /// Name of the program that runs them, or of both if they differ.
    pub fn runtime_name(&self) -> String {
        let (footprint, height) = (self.footprint.runtime_name(), self.height.runtime_name());
        if footprint == height { footprint.to_owned() } else { format!("{footprint}, {height}") }
    }

    /// Where canopy is higher than 3 m, on coarse cells. Painted empty, ground bears none but for a fringe of one cell.
    ///
    /// # Errors
    /// If the runtime fails, or the run was cancelled.
    pub fn footprint(
        &self,
        ground: &CoarseGround,
        sketch: &Sketch,
        seed: u64,
        layout: TileLayout,
        reporter: &Reporter,
    ) -> Result<Grid<bool>, InferenceError> {
        let painted = |wanted: Density| -> Vec<f32> {
            sketch.values().iter().map(|d| f32::from(u8::from(*d == wanted))).collect()
        };
        let paint = Density::ALL.map(painted);
        let [empty, sparse, dense] = &paint;
        let maps = ground.planes(&[empty, sparse, dense]);
        let noise = |south, east| noise(seed, Process::FootprintNoise, south, east);
        let height_m = self.footprint.run(&maps, noise, layout, "footprint", reporter)?;
        let canopy = height_m.iter().map(|height| *height > CANOPY_M).collect();
        Ok(ground.allowed(canopy))
    }

    /// Canopy height in m on coarse cells: above 3 m in the footprint, below outside.
    ///
    /// # Errors
    /// If the runtime fails, or the run was cancelled.
    pub fn height_m(
        &self,
        ground: &CoarseGround,
        footprint: &Grid<bool>,
        seed: u64,
        layout: TileLayout,
        reporter: &Reporter,
    ) -> Result<Grid<f32>, InferenceError> {
        let mask: Vec<f32> =
            footprint.values().iter().map(|canopy| f32::from(u8::from(*canopy))).collect();
        let maps = ground.planes(&[&mask]);
        let noise = |south, east| noise(seed, Process::HeightNoise, south, east);
        let mut height_m = self.height.run(&maps, noise, layout, "canopy height", reporter)?;
        for (index, (height_m, canopy)) in height_m.iter_mut().zip(footprint.values()).enumerate() {
            *height_m = if !ground.elevation_m.mask().is_valid(index) {
                0.0
            } else if *canopy {
                // the footprint decides, whatever the last bits of the network say
                height_m.max(CANOPY_M.next_up())
            } else {
                height_m.clamp(0.0, CANOPY_M)
            };
        }
        let cols = footprint.frame().cols;
        stand_height::follow(&mut height_m, footprint.values(), &ground.stand_m, cols);
        Ok(ground.elevation_m.with_values(height_m))
    }
}

impl CoarseGround {
    /// Ground of elevations on coarse cells, of cells under rivers, and of stand heights.
    ///
    /// # Panics
    /// If they do not fill the cells.
    pub fn new(
        cells: CoarseCells,
        elevation_m: Grid<f32>,
        under_rivers: Vec<bool>,
        stand_m: Vec<f32>,
    ) -> Self {
        assert_eq!(elevation_m.frame(), &cells.frame, "elevations lie on other cells");
        assert_eq!(stand_m.len(), cells.frame.len(), "stand heights do not fill the cells");
        let channels = TerrainChannels::of(&elevation_m);
        let bare = under_rivers.iter().zip(&channels.slope);
        let bare = bare.map(|(river, slope)| *river || *slope >= CLIFF_SLOPE).collect();
        let encode = |m: &f32| encoded_height(stand_height::trained_m(*m));
        let encoded_stand = stand_m.iter().map(encode).collect();
        Self { cells, elevation_m, bare, stand_m, channels, encoded_stand }
    }

    /// A footprint without canopy on bare and masked ground.
    ///
    /// # Panics
    /// If it does not fill the cells.
    pub fn allowed(&self, mut canopy: Vec<bool>) -> Grid<bool> {
        for (index, canopy) in canopy.iter_mut().enumerate() {
            *canopy &= !self.bare[index] && self.elevation_m.mask().is_valid(index);
        }
        self.elevation_m.with_values(canopy)
    }

    /// Coarse canopy heights on a scene's cells, with crowns where they can be shown.
    pub fn onto_scene(&self, height_m: &Grid<f32>, scene: &Grid<f32>, seed: u64) -> Grid<f32> {
        if scene.frame() == &self.cells.frame {
            let masked = height_m.values().iter().zip(scene.mask().as_slice());
            return scene
                .with_values(masked.map(|(h, land)| if *land { *h } else { 0.0 }).collect());
        }
        let CoarseCells { frame, first_east, first_south } = &self.cells;
        let coarse = CoarseCanopy {
            first_east: *first_east,
            first_north: -first_south - 1,
            rows: frame.rows,
            cols: frame.cols,
            cell_m: frame.transform.cell_m,
            heights_m: height_m.values().to_vec(),
        };
        detail::detailed(&coarse, scene, seed)
    }

    fn planes<'a>(&'a self, first: &[&'a [f32]]) -> MapPlanes<'a> {
        let mut planes: Vec<&[f32]> = first.to_vec();
        let TerrainChannels { relief, gradient_east, gradient_north, .. } = &self.channels;
        planes.extend([&relief[..], gradient_east, gradient_north, &self.encoded_stand]);
        let CoarseCells { frame, first_east, first_south } = &self.cells;
        let (first_east, first_south) = (*first_east, *first_south);
        MapPlanes { rows: frame.rows, cols: frame.cols, first_south, first_east, planes }
    }
}

/// A sketch of one density on all cells.
pub fn whole(cells: &CoarseCells, density: Density) -> Sketch {
    let count = cells.frame.len();
    Grid::new(Arc::clone(&cells.frame), Arc::new(Mask::all_valid(count)), vec![density; count])
}

/// Uniform noise of mean 0 and deviation 1 for a cell of the map.
fn noise(seed: u64, process: Process, south: i64, east: i64) -> f32 {
    let entity = rng::entity_of_cell(east, -south);
    let key = Key { seed, process, year: 0, month: 0, entity };
    rng::centred_uniform(key)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::RuntimeChoice;
    use crate::math;
    use crate::raster::Cell;

    fn generators() -> Generators {
        let runtimes = Runtimes { choice: RuntimeChoice::Rten, ..Runtimes::default() };
        Generators::open(&ModelSource::BuiltIn, &runtimes, |text| panic!("{text}")).unwrap()
    }

    fn ground(size: usize) -> CoarseGround {
        let elevation_m = Grid::from_fn(size, size, 4.0, |c| {
            300.0 + 25.0 * math::sin(c.col as f32 / 15.0) * math::cos(c.row as f32 / 11.0)
        });
        let cells = CoarseCells::of(elevation_m.frame());
        let stand_m = stand_height::around(16.0, &cells, 1);
        CoarseGround::new(cells, elevation_m, vec![false; size * size], stand_m)
    }

    /// Empty in the west, sparse in the middle, dense in the east.
    fn striped(ground: &CoarseGround) -> Sketch {
        let cols = ground.cells.frame.cols;
        let density = |index: usize| Density::ALL[(index % cols) * 3 / cols];
        whole(&ground.cells, Density::Empty).with_values((0..cols * cols).map(density).collect())
    }

    fn cover(footprint: &Grid<bool>, cols: std::ops::Range<usize>) -> f64 {
        let frame = footprint.frame();
        let cells = (0..frame.rows).flat_map(|row| cols.clone().map(move |col| Cell { row, col }));
        let (canopy, all) =
            cells.fold((0, 0), |(canopy, all), c| (canopy + usize::from(footprint[c]), all + 1));
        canopy as f64 / f64::from(all)
    }

    #[test]
    fn cover_follows_the_sketch_and_nothing_grows_on_empty_ground() {
        let (generators, ground) = (generators(), ground(96));
        let sketch = striped(&ground);
        let silent = Reporter::silent();
        let layout = TileLayout::default();
        let footprint = generators.footprint(&ground, &sketch, 1, layout, &silent).unwrap();
        assert_eq!(cover(&footprint, 0..31), 0.0);
        let (sparse, dense) = (cover(&footprint, 36..60), cover(&footprint, 68..96));
        assert!((0.08..0.38).contains(&sparse), "sparse: {sparse}");
        assert!(dense > 0.6, "dense: {dense}");
    }

    #[test]
    fn heights_agree_with_the_footprint_and_follow_the_stand() {
        let (generators, mut ground) = (generators(), ground(80));
        ground.bare[1000] = true;
        let mean_of = |ground: &CoarseGround| {
            let footprint = ground.allowed(vec![true; 6400]);
            let silent = Reporter::silent();
            let layout = TileLayout::default();
            let heights = generators.height_m(ground, &footprint, 1, layout, &silent).unwrap();
            for (height, canopy) in heights.values().iter().zip(footprint.values()) {
                assert_eq!(*height > CANOPY_M, *canopy, "{height}");
            }
            heights.values().iter().map(|h| f64::from(*h)).sum::<f64>() / 6400.0
        };
        let of_stand = |stand_m: f32| {
            let ground = self::ground(80);
            let stand = vec![stand_m; 6400];
            mean_of(&CoarseGround::new(ground.cells, ground.elevation_m, vec![false; 6400], stand))
        };
        assert!(mean_of(&ground) > 8.0);
        let means = [8.0, 14.0, 20.0, 45.0].map(of_stand);
        assert!(means.is_sorted(), "{means:?}");
        assert!((44.0..49.0).contains(&means[3]), "{means:?}");
    }

    #[test]
    fn seeds_give_other_forests_and_the_same_seed_the_same() {
        let (generators, ground) = (generators(), ground(64));
        let sketch = whole(&ground.cells, Density::Sparse);
        let run = |seed| {
            let silent = Reporter::silent();
            let layout = TileLayout::default();
            generators.footprint(&ground, &sketch, seed, layout, &silent).unwrap().into_values()
        };
        assert!(run(1) == run(1));
        assert!(run(1) != run(2));
    }
}
