//! A report on a scene: what is read for it, and where it goes.

use std::fs;
use std::path::{Path, PathBuf};

use super::export_output::{check_apart, check_file};
use super::scene_content::{read_manifest, read_scene};
use super::{Error, grow};
use crate::export::report::figures::{self, CanopyFit, Figure};
use crate::export::report::{self, ReportInput, Stand};
use crate::progress::Reporter;
use crate::scene::{self, Manifest, StageEntry};

/// File in the scene folder that a report is written to.
pub const REPORT_FILE: &str = "report.html";
/// Pictures of a scene that a report shows.
const PICTURES: [(&str, &str); 2] = [("Over the years", "timeline.png"), ("Map", "preview.png")];

/// Writes a report on a scene to `output`, or into its folder. Gives its figures and where it lies.
///
/// # Errors
/// If the folder holds no scene, its plants cannot be read, or the report cannot be written.
pub fn run(
    folder: &Path,
    output: Option<&Path>,
    reporter: &Reporter,
) -> Result<(Vec<Figure>, PathBuf), Error> {
    let manifest = read_manifest(folder)?;
    let path = output.map_or_else(|| folder.join(REPORT_FILE), Path::to_path_buf);
    check_apart(&path, folder, &manifest)?;
    check_file(&path, "report", |head| head.starts_with(b"<!doctype html>"))?;
    let scene = read_scene(folder, &manifest, reporter)?;
    if scene.plants.is_empty() {
        let folder = folder.display();
        let what =
            format!("{folder}: the scene has no plants; grow a forest in it first (wildwood grow)");
        return Err(Error::Usage { what });
    }
    let pictures = PICTURES
        .iter()
        .filter_map(|(caption, file)| {
            fs::read(folder.join(file)).ok().map(|png| ((*caption).to_owned(), png))
        })
        .collect();
    let input = ReportInput {
        fit: manifest.stages.get(grow::STAGE).and_then(fit).filter(|_| scene.years == 0),
        facts: facts(&manifest, scene.years),
        pictures,
        scene: &scene,
    };
    let stand = Stand::of(&scene);
    let figures = figures::figures(&input, &stand);
    reporter.check_cancelled()?;
    let page = report::html(&input, &stand, &figures);
    scene::write_beside(&path, page.as_bytes())?;
    Ok((figures, path))
}

/// How well trees fit the canopy, as the stage recorded it.
fn fit(stage: &StageEntry) -> Option<CanopyFit> {
    let figure = |name: &str| stage.figures.get(name).and_then(toml::Value::as_float);
    Some(CanopyFit {
        coverage_fraction: figure("coverage_fraction")?,
        overhang_fraction: figure("overhang_fraction")?,
        height_rmse_m: figure("height_rmse_m")?,
    })
}

fn facts(manifest: &Manifest, years: u32) -> Vec<(String, String)> {
    let scene = &manifest.scene;
    let [east, north] = scene.extent_m;
    let mut facts = vec![
        ("extent".to_owned(), format!("{east:.0} × {north:.0} m, cells of {} m", scene.cell_m)),
        ("coordinates".to_owned(), scene.crs.clone()),
        ("biome, seed".to_owned(), format!("{}, {}", scene.biome, scene.seed)),
    ];
    let inputs: Vec<&str> = manifest.inputs.iter().map(|input| input.file.as_str()).collect();
    if !inputs.is_empty() {
        facts.push(("made from".to_owned(), inputs.join(", ")));
    }
    if years > 0 {
        facts.push(("years simulated".to_owned(), years.to_string()));
    }
    facts
}
