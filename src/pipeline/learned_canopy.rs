//! A learned canopy: paint and terrain become footprint and canopy height on the scene's cells.

use std::path::PathBuf;

use super::Error;
use super::paint::{Paint, StandRaster};
use super::scene_files::StageFiles;
use crate::canopy::learned::bare;
use crate::canopy::learned::coarse::CoarseCells;
use crate::canopy::learned::generator::{self, CoarseGround, Generators};
use crate::canopy::learned::sketch::{Density, Sketch};
use crate::canopy::learned::stand_height;
use crate::inference::{ModelSource, Runtimes, TileLayout};
use crate::progress::{Reporter, Warning};
use crate::raster::Grid;
use crate::terrain::Terrain;

/// What is painted.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum PaintSource {
    /// A sketch: picture or raster.
    Sketch(PathBuf),
    /// One density everywhere.
    Density(Density),
    /// A footprint: picture or raster, 0 open, anything else that is paint canopy.
    Footprint(PathBuf),
}

/// How tall stands are to be.
#[derive(Clone, Debug, PartialEq)]
pub enum StandHeight {
    /// About this, in m.
    About(f32),
    /// As a raster says, in m.
    Raster(PathBuf),
}

/// A canopy to generate.
#[derive(Clone, Debug, PartialEq)]
pub struct LearnedRequest {
    /// Where.
    pub paint: PaintSource,
    /// How tall; none is what the scene's last learned canopy was asked for in metres, else the default.
    pub stand_height: Option<StandHeight>,
    /// By which networks.
    pub models: ModelSource,
    /// Run by which program.
    pub runtimes: Runtimes,
}

/// Paint and networks, read and checked before anything is written.
pub struct ReadyCanopy {
    generators: Generators,
    paint: ReadyPaint,
    stand: ReadyStand,
}

enum ReadyPaint {
    Sketch(Paint),
    Density(Density),
    Footprint(Paint),
}

enum ReadyStand {
    About(f32),
    Raster(Box<StandRaster>),
}

/// A generated canopy.
pub struct LearnedCanopy {
    /// Height on the scene's cells, m.
    pub chm_m: Grid<f32>,
    sketch: Option<Sketch>,
    footprint: Grid<bool>,
    runtime: String,
    stand_height_mean_m: f64,
}

/// Name of the canopy's parameters in `scene.toml`.
pub(super) const LEARNED: &str = "learned";
/// Name of the stand height among them.
const STAND_HEIGHT_M: &str = "stand_height_m";

impl LearnedRequest {
    /// The same request; where it asks for no stand height, with the one in metres that a canopy was painted with before.
    pub fn with_stand_of(self, painted: Option<&toml::Value>) -> Self {
        let kept = painted
            .and_then(|painted| painted.get(STAND_HEIGHT_M)?.as_float())
            .map(|m| StandHeight::About(m as f32)); // written from f32
        Self { stand_height: self.stand_height.or(kept), ..self }
    }

    fn stand_height(&self) -> StandHeight {
        self.stand_height.clone().unwrap_or(StandHeight::About(stand_height::DEFAULT_M))
    }

    /// The files that are read.
    pub fn files(&self) -> Vec<PathBuf> {
        let paint = match &self.paint {
            PaintSource::Sketch(path) | PaintSource::Footprint(path) => Some(path.clone()),
            PaintSource::Density(_) => None,
        };
        let stand = match self.stand_height() {
            StandHeight::Raster(path) => Some(path),
            StandHeight::About(_) => None,
        };
        let models = match &self.models {
            ModelSource::BuiltIn => Vec::new(),
            ModelSource::Folder(folder) => {
                ["footprint.onnx", "footprint.toml", "height.onnx", "height.toml"]
                    .map(|name| folder.join(name))
                    .to_vec()
            }
        };
        paint.into_iter().chain(stand).chain(models).collect()
    }

    /// What the canopy depends on besides the content of its files. Runtimes agree to 1e-4 and do not count, unless one
    /// is asked for.
    pub fn key(&self) -> String {
        let paint = match &self.paint {
            PaintSource::Sketch(_) => "sketch".to_owned(),
            PaintSource::Footprint(_) => "footprint".to_owned(),
            PaintSource::Density(density) => density.name().to_owned(),
        };
        let stand = match self.stand_height() {
            StandHeight::About(m) => format!("{m}"),
            StandHeight::Raster(_) => "raster".to_owned(),
        };
        let built_in = match self.models {
            ModelSource::BuiltIn => {
                concat!(
                    include_str!("../../models/footprint.toml"),
                    include_str!("../../models/height.toml")
                )
            }
            ModelSource::Folder(_) => "",
        };
        format!("{paint} {stand} {} {built_in}", self.runtimes.choice)
    }

    /// What `scene.toml` keeps of it.
    pub fn parameters(&self) -> toml::Table {
        let name = |path: &PathBuf| -> toml::Value {
            path.file_name().unwrap_or_default().to_string_lossy().into_owned().into()
        };
        let mut table = toml::Table::new();
        match &self.paint {
            PaintSource::Sketch(path) => table.insert("sketch".to_owned(), name(path)),
            PaintSource::Footprint(path) => table.insert("footprint".to_owned(), name(path)),
            PaintSource::Density(density) => {
                table.insert("density".to_owned(), density.name().into())
            }
        };
        match self.stand_height() {
            StandHeight::About(m) => table.insert(STAND_HEIGHT_M.to_owned(), f64::from(m).into()),
            StandHeight::Raster(path) => table.insert("stand_height".to_owned(), name(&path)),
        };
        table
    }

    /// Reads the paint and opens the networks.
    ///
    /// # Errors
    /// If something cannot be read or is out of range.
    pub fn ready(&self, reporter: &Reporter) -> Result<ReadyCanopy, Error> {
        let stand_height = self.stand_height();
        if let StandHeight::About(m) = stand_height
            && !stand_height::RANGE_M.contains(&m)
        {
            let range = stand_height::RANGE_M;
            let what = format!(
                "--stand-height {m}: give metres from {} to {}",
                range.start(),
                range.end()
            );
            return Err(Error::Usage { what });
        }
        let paint = match &self.paint {
            PaintSource::Sketch(path) => ReadyPaint::Sketch(Paint::read(path)?),
            PaintSource::Density(density) => ReadyPaint::Density(*density),
            PaintSource::Footprint(path) => ReadyPaint::Footprint(Paint::read(path)?),
        };
        let stand = match stand_height {
            StandHeight::About(m) => ReadyStand::About(m),
            StandHeight::Raster(path) => ReadyStand::Raster(Box::new(StandRaster::read(&path)?)),
        };
        let say = |text: String| reporter.warn(Warning::Other { text });
        let generators = Generators::open(&self.models, &self.runtimes, say)?;
        Ok(ReadyCanopy { generators, paint, stand })
    }
}

impl ReadyCanopy {
    /// Generates the canopy.
    ///
    /// # Errors
    /// If paint does not lie on the scene, the runtime fails, or the run was cancelled.
    pub fn generate(
        &self,
        terrain: &Terrain,
        discharge_m3_s: &Grid<f32>,
        seed: u64,
        reporter: &Reporter,
    ) -> Result<LearnedCanopy, Error> {
        let scene = terrain.elevation_m.frame();
        let cells = CoarseCells::of(scene);
        let elevation_m = cells.averaged(&terrain.elevation_m);
        let under_rivers = bare::under_rivers(discharge_m3_s, &cells);
        let stand_m = match &self.stand {
            ReadyStand::About(m) => stand_height::around(*m, &cells, seed),
            ReadyStand::Raster(stand) => stand.onto(&cells, scene, reporter)?,
        };
        let ground = CoarseGround::new(cells, elevation_m, under_rivers, stand_m);
        let layout = TileLayout::default();

        // sketch, then footprint
        let of_sketch = |sketch: Sketch| {
            let footprint = self.generators.footprint(&ground, &sketch, seed, layout, reporter)?;
            Ok::<_, Error>((Some(sketch), footprint))
        };
        let (sketch, footprint) = match &self.paint {
            ReadyPaint::Sketch(paint) => of_sketch(paint.onto(&ground.cells, scene, reporter)?)?,
            ReadyPaint::Density(density) => of_sketch(generator::whole(&ground.cells, *density))?,
            ReadyPaint::Footprint(paint) => {
                let painted = paint.onto(&ground.cells, scene, reporter)?;
                let canopy = painted.values().iter().map(|d| *d != Density::Empty).collect();
                (None, ground.allowed(canopy))
            }
        };

        // height, then crowns
        let height_m = self.generators.height_m(&ground, &footprint, seed, layout, reporter)?;
        let stage = reporter.stage("crowns", 1);
        let chm_m = ground.onto_scene(&height_m, &terrain.elevation_m, seed);
        stage.advance(1);
        let total: f64 = ground.stand_m.iter().map(|m| f64::from(*m)).sum();
        Ok(LearnedCanopy {
            chm_m,
            sketch,
            footprint,
            runtime: self.generators.runtime_name(),
            stand_height_mean_m: total / ground.stand_m.len().max(1) as f64,
        })
    }
}

impl LearnedCanopy {
    /// Writes the sketch and the footprint on the networks' cells, to be edited and used again.
    pub fn write(&self, files: &mut StageFiles<'_>) -> Result<(), Error> {
        if let Some(sketch) = &self.sketch {
            let codes = sketch.values().iter().map(|d| f32::from(*d as u8)).collect();
            let band = "density: 0 empty, 1 sparse, 2 dense";
            files.grid("sketch.tif", band, "", &sketch.with_values(codes))?;
        }
        let canopy = self.footprint.values().iter().map(|c| f32::from(u8::from(*c))).collect();
        let band = "footprint: 1 canopy above 3 m";
        files.grid("footprint.tif", band, "", &self.footprint.with_values(canopy))
    }

    /// What `scene.toml` tells of it.
    pub fn figures(&self) -> toml::Table {
        let mut table = toml::Table::new();
        let canopy = self.footprint.valid_values().filter(|canopy| **canopy).count();
        let cells = self.footprint.mask().valid_count().max(1);
        table.insert("runtime".to_owned(), self.runtime.clone().into());
        table.insert("footprint_fraction".to_owned(), (canopy as f64 / cells as f64).into());
        table.insert("stand_height_mean_m".to_owned(), self.stand_height_mean_m.into());
        table
    }
}
