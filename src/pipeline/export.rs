//! A scene, or a part of it, in the formats of other programs.
//!
//! Reading order: [`ExportRequest`], [`run`]; formats in [`export_format`](super::export_format), the file or folder they go
//! to in `export_output`, what is selected in [`selection`].

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::json;

use super::export_format::{ExportFormat, OutputKind};
use super::export_output::{NOTE, Output, check_apart, write_error};
use super::scene_content::{read_manifest, read_scene};
use super::{Error, export_3d};
use crate::export::instances::FeatureTable;
use crate::export::points::Flavour;
use crate::export::scene3d::Lod;
use crate::export::selection::{self, ExportLayer, Filter, SceneContent, Selection};
use crate::export::{WriteError, ecoviz, geojson, geopackage, iland, tables, tree_cloud};
use crate::plants::table::TableFormat;
use crate::progress::Reporter;
use crate::scene::Manifest;

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
    if request.options.has_crowns && format != ExportFormat::GeoPackage {
        let what = format!("--crowns is for gpkg, and {} has no polygons", format.name());
        return Err(Error::Usage { what });
    }
    let manifest = read_manifest(&request.folder)?;
    check_apart(&request.output, &request.folder, &manifest)?;
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
    if request.options.has_crowns && !selection.tables().contains(&FeatureTable::Plants) {
        let what = "--crowns needs plants; add canopy or undergrowth to --layers".to_owned();
        return Err(Error::Usage { what });
    }

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
    let written = |table: FeatureTable| match format {
        ExportFormat::ILand => iland::trees(&selection).len(),
        _ => selection.rows(table),
    };
    let rows = selection.tables().into_iter().map(|table| (table, written(table)));
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
        ExportFormat::GeoPackage => geopackage::write(to, selection, options.has_crowns, reporter),
        ExportFormat::Parquet => write_tables(selection, TableFormat::Parquet, to, reporter),
        ExportFormat::Csv => write_tables(selection, TableFormat::Csv, to, reporter),
        ExportFormat::GeoJson => geojson::write(to, selection, reporter),
        ExportFormat::Las => tree_cloud::write(to, selection, reporter),
        ExportFormat::ILand => iland::write(to, selection, reporter),
        ExportFormat::EcoViz => ecoviz::write(to, selection, reporter),
        ExportFormat::Usd
        | ExportFormat::Glb
        | ExportFormat::Tiles3d
        | ExportFormat::Mitsuba
        | ExportFormat::Points => export_3d::write(format, selection, options, to, reporter),
    }
}

fn write_tables(
    selection: &Selection,
    format: TableFormat,
    to: &Path,
    reporter: &Reporter,
) -> Result<(), WriteError> {
    match selection.tables()[..] {
        // a file was asked for, and it holds one table
        [table] if !to.is_dir() => tables::write_file(to, selection, table, format),
        _ => tables::write_folder(to, selection, format, reporter),
    }
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

/// Reads the scene and cuts it.
fn select(
    request: &ExportRequest,
    manifest: &Manifest,
    format: ExportFormat,
    reporter: &Reporter,
) -> Result<Selection, Error> {
    let scene = read_scene(&request.folder, manifest, reporter)?;
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::demo;
    use crate::terrain::generate::GenerateParams;

    fn demo_scene(home: &Path) -> PathBuf {
        let folder = home.join("forest");
        let params = GenerateParams { rows: 64, cols: 64, ..GenerateParams::default() };
        demo::run(folder.clone(), "sonoma", &params, &Reporter::silent()).unwrap();
        folder
    }

    fn request(folder: &Path, output: PathBuf, format: Option<ExportFormat>) -> ExportRequest {
        ExportRequest {
            folder: folder.to_path_buf(),
            output,
            format,
            filter: Filter::default(),
            options: ExportOptions::default(),
        }
    }

    fn names(folder: &Path) -> Vec<String> {
        let entries = fs::read_dir(folder).unwrap();
        let mut names: Vec<String> =
            entries.map(|e| e.unwrap().file_name().to_string_lossy().into_owned()).collect();
        names.sort();
        names
    }

    #[test]
    fn a_scene_is_exported_and_an_export_replaced_but_nothing_else() {
        let home = tempfile::tempdir().unwrap();
        let folder = demo_scene(home.path());
        let before = names(&folder);
        let silent = Reporter::silent();
        let table = fs::read(folder.join("plants.parquet")).unwrap();

        // tables: the same bytes as the scene's, again over themselves
        let tables = home.path().join("tables");
        for _ in 0..2 {
            let request = request(&folder, tables.clone(), Some(ExportFormat::Parquet));
            let exported = run(&request, &silent).unwrap();
            assert!(exported.rows[0].1 > 0 && exported.bytes > table.len() as u64);
        }
        assert_eq!(fs::read(tables.join("plants.parquet")).unwrap(), table);
        assert!(names(&tables).contains(&NOTE.to_owned()));

        // files, by their endings
        for name in ["a.gpkg", "a.las", "a.laz", "a.pdb"] {
            for _ in 0..2 {
                run(&request(&folder, home.path().join(name), None), &silent).unwrap();
            }
        }

        // what is no export of the format stays
        let told = |output: PathBuf, format| {
            let error = run(&request(&folder, output, format), &silent).unwrap_err();
            assert!(error.is_bad_input(), "{error}");
            error.to_string()
        };
        let las = Some(ExportFormat::Las);
        assert!(told(home.path().join("a.gpkg"), las).contains("is no las"));
        assert!(told(tables.clone(), Some(ExportFormat::Csv)).contains("is no export to csv"));
        assert!(told(tables.clone(), las).contains("is a folder"));
        assert!(told(folder.clone(), Some(ExportFormat::Parquet)).contains("the scene itself"));
        let own = folder.join("plants.parquet");
        assert!(told(own, None).contains("the scene itself"));
        assert!(told(home.path().join("no/a.gpkg"), None).contains("does not exist"));
        assert!(told(home.path().join("a.xyz"), None).contains("give --to"));
        let local = told(home.path().join("a.geojson"), None);
        assert!(local.contains("local metres"), "{local}");
        assert_eq!(names(&folder), before);
        assert_eq!(names(home.path()), ["a.gpkg", "a.las", "a.laz", "a.pdb", "forest", "tables"]);
    }

    #[test]
    fn a_folder_without_a_scene_is_refused() {
        let home = tempfile::tempdir().unwrap();
        let output = home.path().join("a.gpkg");
        let error = run(&request(home.path(), output, None), &Reporter::silent()).unwrap_err();
        assert!(error.is_bad_input() && error.to_string().contains("no scene"), "{error}");
    }
}
