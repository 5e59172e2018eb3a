//! A selection in a 3D format: instances and ground about an origin, then the writer of the format.

use std::borrow::Cow;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use super::export::{ExportOptions, Origin};
use super::export_format::ExportFormat;
use crate::export::WriteError;
use crate::export::gltf::{self, GltfOptions};
use crate::export::instances::Instances;
use crate::export::scene3d::{Lod, Scene3d};
use crate::export::selection::Selection;
use crate::export::terrain_mesh::{MOST_TRIANGLES, TerrainMesh};
use crate::export::tiles3d;
use crate::export::usd::{self, UsdOptions};
use crate::export::{mitsuba, points};
use crate::plants::Plants;
use crate::plants::deadwood::{DownedLogs, Snags};
use crate::progress::Reporter;

/// What positions count from: the selection's middle in whole metres, a whole metre below its lowest ground.
fn origin(selection: &Selection) -> [f64; 3] {
    let window = &selection.window;
    let lowest_m = selection.elevation_m.range().map_or(0.0, |(low, _)| f64::from(low));
    let middle = |from: f64, to: f64| (0.5 * (from + to)).round();
    [middle(window.west, window.east), middle(window.south, window.north), lowest_m.floor()]
}

/// Tables whose positions count from the south-west corner of the selection's own ground.
struct Shifted<'a> {
    plants: Cow<'a, Plants>,
    snags: Cow<'a, Snags>,
    downed_logs: Cow<'a, DownedLogs>,
}

impl<'a> Shifted<'a> {
    fn new(selection: &'a Selection) -> Self {
        let mut shifted = Self {
            plants: Cow::Borrowed(&selection.plants),
            snags: Cow::Borrowed(&selection.snags),
            downed_logs: Cow::Borrowed(&selection.downed_logs),
        };
        let (scene, ground) =
            (selection.frame.south_west(), selection.elevation_m.frame().south_west());
        if scene != ground {
            let east_m = ground.east_m - scene.east_m;
            let north_m = ground.north_m - scene.north_m;
            let move_all = |values: &mut [f32], by_m: f64| {
                // within a scene: f32 holds millimetres
                values.iter_mut().for_each(|value| *value = (f64::from(*value) - by_m) as f32);
            };
            let plants = shifted.plants.to_mut();
            move_all(&mut plants.east_m, east_m);
            move_all(&mut plants.north_m, north_m);
            let snags = shifted.snags.to_mut();
            move_all(&mut snags.east_m, east_m);
            move_all(&mut snags.north_m, north_m);
            let downed_logs = shifted.downed_logs.to_mut();
            move_all(&mut downed_logs.east_m, east_m);
            move_all(&mut downed_logs.north_m, north_m);
        }
        shifted
    }
}

/// Writes a selection in a 3D format to a path: a file that is not there yet, or an empty folder.
///
/// # Errors
/// Whatever writing gives, and what the format cannot hold.
///
/// # Panics
/// If the format is none of 3D.
pub(super) fn write(
    format: ExportFormat,
    selection: &Selection,
    options: &ExportOptions,
    to: &Path,
    reporter: &Reporter,
) -> Result<(), WriteError> {
    let origin = origin(selection);
    let shifted = Shifted::new(selection);
    let (plants, snags, downed_logs) = (&shifted.plants, &shifted.snags, &shifted.downed_logs);
    let ground = &selection.elevation_m;
    let instances = Instances::of(plants, snags, downed_logs, ground, &selection.biome, origin);
    drop(shifted);
    reporter.check_cancelled()?;
    let terrain = TerrainMesh::new(ground, origin, None, MOST_TRIANGLES);
    let scene = Scene3d {
        name: &selection.name,
        crs: &selection.frame.crs,
        biome: &selection.biome,
        terrain: &terrain,
        instances: &instances,
        plants: &selection.plants,
        snags: &selection.snags,
        downed_logs: &selection.downed_logs,
    };
    reporter.check_cancelled()?;
    let lod = options.lod.unwrap_or_else(|| Lod::for_instances(instances.len()));
    let is_on_map = options.origin == Origin::Map;
    let file = || File::create(to).map(|file| BufWriter::with_capacity(1 << 20, file));
    match format {
        ExportFormat::Usd => {
            let mut out = file()?;
            usd::write(&mut out, &scene, &UsdOptions { lod, is_on_map })?;
            out.flush()?;
        }
        ExportFormat::Glb => {
            let mut out = file()?;
            gltf::write(&mut out, &scene, &GltfOptions { lod, is_on_map })?;
            out.flush()?;
        }
        ExportFormat::Tiles3d => tiles3d::write(to, &scene)?,
        ExportFormat::Mitsuba => mitsuba::write(to, &scene, lod)?,
        ExportFormat::Points => {
            points::write_csv(&mut File::create(to.join("points.csv"))?, &scene, options.flavour)?;
            points::write_json(
                &mut File::create(to.join("points.json"))?,
                &scene,
                options.flavour,
            )?;
            let mut models = BufWriter::new(File::create(to.join("models.csv"))?);
            points::write_models(&mut models, &scene)?;
            models.flush()?;
        }
        _ => unreachable!("{} is no 3D format", format.name()),
    }
    Ok(())
}
