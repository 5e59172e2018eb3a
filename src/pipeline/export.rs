//! A scene, or a part of it, in the formats of other programs.
//!
//! Reading order: [`ExportRequest`], [`run`]; formats in [`export_format`](super::export_format), the file or folder they go
//! to in `export_output`, what is selected in [`selection`].

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::json;

use super::export_format::{ExportFormat, OutputKind};
use super::export_output::{NOTE, Output, write_error};
use super::scene_files::{read_deadwood, read_plants};
use super::{Error, close_up, export_3d, import};
use crate::export::WriteError;
use crate::export::instances::FeatureTable;
use crate::export::points::Flavour;
use crate::export::scene3d::Lod;
use crate::export::selection::{self, ExportLayer, Filter, SceneContent, Selection};
use crate::plants::Plants;
use crate::progress::Reporter;
use crate::scene::Manifest;
use crate::species::Biome;

/// What coordinates of 3D formats count from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Origin {
    /// The middle of the selection, so that single precision holds them.
    #[default]
    Local,
    /// The origin of the map.
    Map,
}

/// Settings of the formats.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ExportOptions {
    /// Crowns as polygons beside the points of plants (GeoPackage).
    pub has_crowns: bool,
    /// What coordinates of 3D formats count from.
    pub origin: Origin,
    /// Level of detail of models; `None` goes by the number of instances.
    pub lod: Option<Lod>,
    /// Axes and unit of lists of points.
    pub flavour: Flavour,
}

/// What is to be exported, and where to.
#[derive(Clone, Debug)]
pub struct ExportRequest {
    /// Scene folder.
    pub folder: PathBuf,
    /// File or folder that is written.
    pub output: PathBuf,
    /// Format; `None` goes by the ending of `output`.
    pub format: Option<ExportFormat>,
    /// Part of the scene.
    pub filter: Filter,
    /// Settings of the format.
    pub options: ExportOptions,
}

/// What was exported.
#[derive(Clone, Debug, PartialEq)]
pub struct Exported {
    /// Its format.
    pub format: ExportFormat,
    /// Number of rows by table, in the order of files.
    pub rows: Vec<(FeatureTable, usize)>,
    /// Its size.
    pub bytes: u64,
}

/// Exports what is asked for.
///
/// # Errors
/// If the folder holds no scene, nothing is selected, the format cannot hold it, or the output cannot be written.
pub fn run(request: &ExportRequest, reporter: &Reporter) -> Result<Exported, Error> {
    let format = format_of(request)?;
    let manifest = Manifest::read(&request.folder)?.ok_or_else(|| {
        let folder = request.folder.display();
        Error::Usage { what: format!("{folder}: no scene there; name a folder from wildwood grow") }
    })?;
    check_apart(request, &manifest)?;
    let output = Output::begin(&request.output, format)?;
    let selection = select(request, &manifest, format, reporter)?;
    if let (OutputKind::File, tables @ [_, _, ..]) =
        (format.output_kind(&request.output), &selection.tables()[..])
        && matches!(format, ExportFormat::Parquet | ExportFormat::Csv)
    {
        let what = format!(
            "{}: a single file holds one table, and {} are selected; choose one with --layers, or name a folder with -o",
            request.output.display(),
            tables.len()
        );
        return Err(Error::Usage { what });
    }

    let stage = reporter.stage("export", selection.len() as u64);
    let staged = output.staged();
    write(format, &selection, &request.options, &staged, reporter).map_err(|e| match e {
        WriteError::Io(source) => write_error(&request.output, source),
        WriteError::Cancelled(cancelled) => cancelled.into(),
        WriteError::Refused { what } => {
            Error::Usage { what: format!("{}: {what}", request.output.display()) }
        }
    })?;
    if format.output_kind(&request.output) == OutputKind::Folder {
        let note = note(format, &selection, &request.options);
        fs::write(staged.join(NOTE), note)
            .map_err(|source| write_error(&request.output.join(NOTE), source))?;
    }
    reporter.check_cancelled()?;
    let bytes = output.commit()?;
    stage.advance(selection.len() as u64);
    let rows = selection.tables().into_iter().map(|table| (table, selection.rows(table)));
    Ok(Exported { format, rows: rows.collect(), bytes })
}

/// Writes a selection to a path: a file that is not there yet, or an empty folder.
fn write(
    format: ExportFormat,
    selection: &Selection,
    options: &ExportOptions,
    to: &Path,
    reporter: &Reporter,
) -> Result<(), WriteError> {
    match format {
        ExportFormat::GeoPackage
        | ExportFormat::Parquet
        | ExportFormat::Csv
        | ExportFormat::GeoJson
        | ExportFormat::Las
        | ExportFormat::ILand
        | ExportFormat::EcoViz => Err(not_yet(format)),
        ExportFormat::Usd
        | ExportFormat::Glb
        | ExportFormat::Tiles3d
        | ExportFormat::Mitsuba
        | ExportFormat::Points => export_3d::write(format, selection, options, to, reporter),
    }
}

fn not_yet(format: ExportFormat) -> WriteError {
    WriteError::Refused { what: format!("the format {} is not written yet", format.name()) }
}

/// The format that is asked for, or that the output's ending stands for.
fn format_of(request: &ExportRequest) -> Result<ExportFormat, Error> {
    request.format.or_else(|| ExportFormat::of_ending(&request.output)).ok_or_else(|| {
        let names: Vec<&str> = ExportFormat::ALL.map(ExportFormat::name).to_vec();
        let what = format!(
            "{}: its ending tells no format; give --to with one of {}",
            request.output.display(),
            names.join(", ")
        );
        Error::Usage { what }
    })
}

/// Refuses to take the place of a file of the scene, or of the scene itself.
fn check_apart(request: &ExportRequest, manifest: &Manifest) -> Result<(), Error> {
    let canonical = |path: &Path| fs::canonicalize(path).ok();
    let Some(output) = canonical(&request.output) else { return Ok(()) };
    let is_scene = canonical(&request.folder).is_some_and(|folder| {
        output == folder || manifest.files().any(|file| output == folder.join(file))
    });
    if is_scene {
        let what = format!(
            "{}: belongs to the scene itself; name another output with -o",
            request.output.display()
        );
        return Err(Error::Usage { what });
    }
    Ok(())
}

/// Reads the scene and cuts it.
fn select(
    request: &ExportRequest,
    manifest: &Manifest,
    format: ExportFormat,
    reporter: &Reporter,
) -> Result<Selection, Error> {
    let stage = reporter.stage("read scene", 2);
    let folder = &request.folder;
    let biome = Biome::builtin(&manifest.scene.biome)?;
    let elevation_m = import::load_terrain(folder, manifest)?.elevation_m;
    reporter.check_cancelled()?;
    stage.advance(1);
    let frame = elevation_m.frame();
    let plants = if folder.join(close_up::PLANTS_FILE).exists() {
        read_plants(folder, &biome, frame)?
    } else {
        Plants::default()
    };
    let deadwood = read_deadwood(folder, &biome, frame)?;
    reporter.check_cancelled()?;
    stage.advance(1);
    let name = manifest.scene.name.clone();
    let scene = SceneContent { name, biome, elevation_m, plants, deadwood };
    let filter = holdable(&request.filter, format, &scene)?;
    Ok(Selection::new(scene, &filter)?)
}

/// The filter, with the layers that the format can hold where none are asked for.
fn holdable(filter: &Filter, format: ExportFormat, scene: &SceneContent) -> Result<Filter, Error> {
    let holds = |layer: &ExportLayer| format.tables().contains(&layer.table());
    let mut filter = filter.clone();
    match &filter.layers {
        Some(asked) => {
            if let Some(layer) = asked.iter().find(|layer| !holds(layer)) {
                let what = format!("--layers {}: {} holds none", layer.name(), format.name());
                return Err(Error::Usage { what });
            }
        }
        None => {
            let present = selection::layers_of(scene).into_iter().filter(holds).collect();
            filter.layers = Some(present);
        }
    }
    Ok(filter)
}

/// What is said in a folder of what it holds.
fn note(format: ExportFormat, selection: &Selection, options: &ExportOptions) -> String {
    let window = &selection.window;
    let layers: Vec<&str> = selection.layers.iter().map(|layer| layer.name()).collect();
    let note = json!({
        "format": format.name(),
        "generator": concat!("wildwood ", env!("CARGO_PKG_VERSION")),
        "scene": selection.name,
        "biome": selection.biome.key,
        "crs": selection.frame.crs.to_string(),
        "bbox": [window.west, window.south, window.east, window.north],
        "layers": layers,
        "origin": match options.origin { Origin::Local => "local", Origin::Map => "map" },
        "rows": {
            "plants": selection.plants.len(),
            "snags": selection.snags.len(),
            "downed_logs": selection.downed_logs.len(),
        },
    });
    format!("{note:#}\n")
}
