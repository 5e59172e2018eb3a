//! `wildwood export`: a scene in the formats of GIS, 3D and forest programs.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use serde_json::{Map, json};

use super::{Outcome, ScenePart, Shared, terminal};
use crate::export::instances::FeatureTable;
use crate::export::points::Flavour;
use crate::export::scene3d::Lod;
use crate::export::selection::{ExportLayer, Filter};
use crate::pipeline::export::{self, ExportOptions, ExportRequest, Exported, Origin};
use crate::pipeline::export_format::ExportFormat;
use crate::progress::Reporter;

/// What `wildwood export` takes.
#[derive(Args)]
pub struct ExportArguments {
    /// Scene folder with a forest, from wildwood grow or wildwood age.
    #[arg(value_name = "FOLDER")]
    folder: PathBuf,
    /// Format: gpkg, parquet, csv, geojson, las, iland, pdb, usd, glb, 3dtiles, mitsuba or points [default: by the ending of -o].
    #[arg(long, value_name = "FORMAT", value_parser = format)]
    to: Option<ExportFormat>,
    /// File that is written; a folder for 3dtiles, mitsuba and points, and for parquet and csv unless it ends in .parquet or .csv.
    #[arg(long, short, value_name = "FILE|FOLDER")]
    output: PathBuf,
    #[command(flatten)]
    part: ScenePart,
    /// Layers: canopy, undergrowth, snags, logs [default: all that the scene has and the format holds].
    #[arg(long, value_name = "LAYER,…", value_delimiter = ',', num_args = 1, value_parser = layer)]
    layers: Option<Vec<ExportLayer>>,
    /// Leave out plants and snags lower than this.
    #[arg(
        long,
        value_name = "METRES",
        default_value_t = 0.0,
        value_parser = height,
        allow_hyphen_values = true
    )]
    min_height: f32,
    /// Crowns as polygons in a layer of their own (gpkg).
    #[arg(long)]
    crowns: bool,
    /// What coordinates of 3D formats count from: the selection's middle, so that single precision holds them, or the map's origin.
    #[arg(long, value_enum, default_value_t)]
    origin: OriginArgument,
    /// Level of detail of models in usd, glb and mitsuba: near, middle or far [default: near up to 20,000 instances, else middle].
    /// In usd it is the first choice of a variant set that has all.
    #[arg(long, value_name = "LEVEL", value_parser = level)]
    lod: Option<Lod>,
    /// Axes and unit of points: houdini (y up, metres), unity (left-handed, y up, metres) or unreal (left-handed, z up, centimetres).
    #[arg(long, value_name = "FLAVOUR", default_value = "houdini", value_parser = flavour)]
    flavour: Flavour,
}

/// `--origin` on the command line.
#[derive(Clone, Copy, Default, ValueEnum)]
enum OriginArgument {
    /// The selection's middle.
    #[default]
    Local,
    /// The map's origin.
    Map,
}

fn format(text: &str) -> Result<ExportFormat, String> {
    ExportFormat::from_name(text).ok_or_else(|| {
        format!(
            "no such format; give one of {}",
            ExportFormat::ALL.map(ExportFormat::name).join(", ")
        )
    })
}

fn layer(text: &str) -> Result<ExportLayer, String> {
    ExportLayer::from_name(text.trim()).ok_or_else(|| {
        format!(
            "no such layer; give some of {}",
            ExportLayer::ALL.map(ExportLayer::name).join(", ")
        )
    })
}

fn level(text: &str) -> Result<Lod, String> {
    Lod::from_name(text)
        .ok_or_else(|| format!("no such level; give one of {}", Lod::ALL.map(Lod::name).join(", ")))
}

fn flavour(text: &str) -> Result<Flavour, String> {
    Flavour::from_name(text).ok_or_else(|| {
        format!("no such flavour; give one of {}", Flavour::ALL.map(Flavour::name).join(", "))
    })
}

fn height(text: &str) -> Result<f32, String> {
    match text.parse() {
        Ok(height_m) if (0.0..=1000.0).contains(&height_m) => Ok(height_m),
        _ => Err("give metres from 0 to 1000".to_owned()),
    }
}

pub fn run(arguments: &ExportArguments, shared: &Shared, reporter: &Reporter) -> Outcome {
    let bbox = arguments.part.window()?;
    let request = ExportRequest {
        folder: arguments.folder.clone(),
        output: arguments.output.clone(),
        format: arguments.to,
        filter: Filter {
            bbox,
            layers: arguments.layers.clone(),
            min_height_m: arguments.min_height,
        },
        options: ExportOptions {
            has_crowns: arguments.crowns,
            origin: match arguments.origin {
                OriginArgument::Local => Origin::Local,
                OriginArgument::Map => Origin::Map,
            },
            lod: arguments.lod,
            flavour: arguments.flavour,
        },
    };
    let exported = export::run(&request, reporter)?;
    report(&request, &exported, shared);
    Ok(())
}

/// Says what was written.
fn report(request: &ExportRequest, exported: &Exported, shared: &Shared) {
    let path = request.output.display().to_string();
    if shared.json {
        let rows: Map<String, serde_json::Value> = exported
            .rows
            .iter()
            .map(|(table, rows)| (table.name().to_owned(), json!(rows)))
            .collect();
        terminal::line(&json!({
            "event": "done",
            "output": path,
            "format": exported.format.name(),
            "rows": rows,
            "bytes": exported.bytes,
        }));
        return;
    }
    if shared.quiet {
        return;
    }
    let rows: Vec<String> = exported
        .rows
        .iter()
        .map(|(table, rows)| {
            let what = match table {
                FeatureTable::Plants => "plants",
                FeatureTable::Snags => "snags",
                FeatureTable::DownedLogs => "downed logs",
            };
            format!("{rows} {what}")
        })
        .collect();
    let megabytes = exported.bytes as f64 / 1e6;
    terminal::say(&format!("{path}: {}, {megabytes:.1} MB", rows.join(", ")));
}
