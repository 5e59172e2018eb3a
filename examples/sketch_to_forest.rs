//! A painted sketch becomes a forest: terrain and a picture in three colours in, a scene folder and a glTF file out.
//!
//! `cargo run --release --example sketch_to_forest [FOLDER] [DEM SKETCH]`
//!
//! DEM is what `wildwood import` reads, such as a GeoTIFF; SKETCH a PNG that is black where nothing is to grow, grey
//! (`#808080`) for scattered trees and white for woods. Without them a hillside is made up and painted.
//! FOLDER, `sketched-forest` if not given, then holds `scene/` and `forest.glb`.

use std::error::Error;
use std::fs::{self, File};
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use image::{Rgb, RgbImage};
use wildwood::export::selection::{ExportLayer, Filter};
use wildwood::inference::{ModelSource, Runtimes};
use wildwood::io::geotiff::{self, Band, CogBands, CogOptions, StoredBands};
use wildwood::pipeline::export::{self, ExportOptions, ExportRequest};
use wildwood::pipeline::grow::{self, CanopyRequest, GroundSource, GrowRequest};
use wildwood::pipeline::import::ImportRequest;
use wildwood::pipeline::learned_canopy::{LearnedRequest, PaintSource, StandHeight};
use wildwood::pipeline::undergrowth::UndergrowthRequest;
use wildwood::progress::Reporter;
use wildwood::raster::{Crs, Frame, GeoTransform};
use wildwood::terrain::generate::{self, GenerateParams};

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let folder = PathBuf::from(arguments.next().unwrap_or_else(|| "sketched-forest".to_owned()));
    let given = (arguments.next(), arguments.next());
    fs::create_dir_all(&folder)?;
    let reporter = Reporter::silent();
    let (dem, sketch) = match given {
        (Some(dem), Some(sketch)) => (PathBuf::from(dem), PathBuf::from(sketch)),
        (None, _) => made_up(&folder, &reporter)?,
        _ => return Err("usage: sketch_to_forest [FOLDER] [DEM SKETCH]".into()),
    };

    // What `wildwood grow DEM --sketch SKETCH --stand-height 18 -o FOLDER/scene` does: terrain and its maps, a canopy by
    // trained networks, its trees, and what grows beneath them. Run again, it does only what has changed.
    let scene = folder.join("scene");
    let request = GrowRequest {
        ground: GroundSource::Files(Box::new(ImportRequest::new(vec![dem], scene.clone()))),
        learned: Some(LearnedRequest {
            paint: PaintSource::Sketch(sketch),
            stand_height: Some(StandHeight::About(18.0)),
            models: ModelSource::BuiltIn,
            runtimes: Runtimes::default(), // the built-in one
        }),
        chm: None, // a measured canopy would go here
        chm_unit: None,
        canopy: CanopyRequest {
            shares: Some("redwood=0.3,douglas-fir=0.3".to_owned()), // the rest as suits the site
            ..CanopyRequest::default()
        },
        undergrowth: UndergrowthRequest::default(),
    };
    let manifest = grow::run(&request, &reporter)?;
    // the manifest, also in scene.toml, tells each stage's files, settings and figures
    let trees = manifest.stages.get(grow::STAGE).and_then(|stage| stage.figures.get("trees"));
    println!("{}: {} trees", scene.display(), trees.ok_or("no trees were counted")?);

    // The trees for Blender, Godot or a browser; plants beneath them would make the file ten times as large.
    let request = ExportRequest {
        folder: scene,
        output: folder.join("forest.glb"),
        format: None, // goes by the ending
        filter: Filter { layers: Some(vec![ExportLayer::Canopy]), ..Filter::default() },
        options: ExportOptions::default(),
    };
    let exported = export::run(&request, &reporter)?;
    println!("{}: {:.1} MB", request.output.display(), exported.bytes as f64 / 1e6);
    Ok(())
}

/// A hillside of 256 m as a GeoTIFF, and a sketch of it: woods, a belt of scattered trees, a meadow in the middle.
fn made_up(folder: &Path, reporter: &Reporter) -> Result<(PathBuf, PathBuf), Box<dyn Error>> {
    let [dem, sketch] = ["dtm.tif", "sketch.png"].map(|name| folder.join(name));
    let params = GenerateParams { rows: 128, cols: 128, relief_m: 45.0, ..Default::default() };
    let elevation_m = generate::generate(&params, reporter)?.elevation_m;
    // in the hills of Sonoma, UTM zone 10
    let frame = Frame {
        transform: GeoTransform { west_m: 500_000.0, north_m: 4_260_000.0, cell_m: params.cell_m },
        crs: Crs::parse("EPSG:32610")?,
        ..Frame::clone(elevation_m.frame())
    };
    let raster = CogBands {
        frame: &frame,
        mask: &Arc::clone(elevation_m.mask()),
        bands: &[Band { name: "elevation".to_owned(), unit: "m".to_owned() }],
        source: &StoredBands::new(&frame, vec![elevation_m.values()]),
    };
    geotiff::write_cog(BufWriter::new(File::create(&dem)?), &raster, &CogOptions::default())?;

    let picture = RgbImage::from_fn(128, 128, |x, y| {
        let (east, south) = (f64::from(x) - 64.0, f64::from(y) - 64.0);
        match east.hypot(south) {
            r if r < 24.0 => Rgb([0, 0, 0]),
            r if r < 40.0 => Rgb([0x80, 0x80, 0x80]),
            _ => Rgb([255, 255, 255]),
        }
    });
    picture.save(&sketch)?;
    Ok((dem, sketch))
}
