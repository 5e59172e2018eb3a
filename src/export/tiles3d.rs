//! A scene as 3D Tiles 1.1: a folder with `tileset.json`, the ground, and a quadtree of instanced glTF tiles on the globe.
//!
//! The root holds the ground. Beneath it the forest is a quadtree whose leaves hold every instance as near models; their parents hold
//! those of a metre and more as middle models, and all above them the canopy as far models. A tile is replaced by its children
//! as the eye comes near. Models lie in `models/`, which tiles share. Elevations are taken as heights above the ellipsoid.
//! A scene in local metres has no place on the globe and stays in its own frame.
//!
//! Reading order: [`plan`] (which tiles there are, and what is in them), then this file (their content and `tileset.json`).
//!
//! # Reference
//! OGC 22-025r4, 3D Tiles 1.1.

pub mod plan;

use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::path::Path;

use rayon::prelude::*;
use serde_json::{Value, json};

use self::plan::{Plan, Tile};
use super::WriteError;
use super::globe::Globe;
use super::gltf::builder::GlbBuilder;
use super::gltf::instancing::{Chosen, add_group};
use super::gltf::metadata::FeatureTables;
use super::gltf::models::{ModelData, add_terrain, encode_model};
use super::gltf::y_up;
use super::instance_bounds::Bounds;
use super::scene3d::{Lod, Scene3d, identifier};
use crate::math;
use crate::raster::{Crs, CrsError};

/// Error of a tile of far models as a share of its side, of middle models, and of the ground alone.
/// chosen: on a screen 1000 pixels high, tiles are replaced where they are a quarter of it, leaves come within 110 m of a side of 100 m.
const FAR_ERROR_FRACTION: f64 = 1.0 / 40.0;
const MIDDLE_ERROR_FRACTION: f64 = 1.0 / 100.0;
const GROUND_ERROR_FRACTION: f64 = 1.0;

const NO_TURN: [f64; 16] =
    [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0];

/// Where the scene's metres lie in the tileset's frame.
struct Frame {
    globe: Option<Globe>,
}

impl Frame {
    fn place_m(&self, map_m: [f32; 3]) -> [f64; 3] {
        self.globe.as_ref().map_or_else(|| map_m.map(f64::from), |globe| globe.place_m(map_m))
    }

    /// Around a box that is bent: around places on its floor and ceiling, near enough for the Earth not to bulge between them.
    fn bounds(&self, bounds: &Bounds) -> [[f64; 3]; 2] {
        // chosen: 5 mm of bulge
        const STEP_M: f32 = 500.0;
        let steps = |k: usize| ((bounds.high[k] - bounds.low[k]) / STEP_M).ceil().max(1.0) as usize;
        let (cols, rows) = (steps(0), steps(1));
        let between = |k: usize, step: usize, steps: usize| {
            math::lerp(bounds.low[k], bounds.high[k], step as f32 / steps as f32)
        };
        let mut around = [[f64::MAX; 3], [f64::MIN; 3]];
        for at in 0..(cols + 1) * (rows + 1) {
            let x = between(0, at % (cols + 1), cols);
            let y = between(1, at / (cols + 1), rows);
            for z in [bounds.low[2], bounds.high[2]] {
                let place = self.place_m([x, y, z]);
                for k in 0..3 {
                    around[0][k] = around[0][k].min(place[k]);
                    around[1][k] = around[1][k].max(place[k]);
                }
            }
        }
        around
    }
}

/// A model's bytes by archetype and level, and the file that holds them.
struct Models {
    levels: Vec<[Option<(String, ModelData)>; 3]>,
}

/// Writes a scene into an empty folder.
///
/// # Errors
/// Whatever writing gives; [`WriteError::Refused`] where the CRS has no place on Earth.
pub fn write(folder: &Path, scene: &Scene3d<'_>) -> Result<(), WriteError> {
    let plan = Plan::new(scene);
    let terrain = Bounds::of_points(&scene.terrain.position_m);
    let all = plan.root().map_or(terrain, |root| root.bounds.union(terrain));
    let globe = match scene.crs {
        Crs::Local => None,
        crs if all.is_empty() => return Err(nowhere(crs, "there is nothing in it")),
        crs => {
            let [low, high] = [all.low, all.high].map(|corner| [corner[0], corner[1]]);
            let globe = Globe::new(crs, scene.instances.origin, low, high);
            Some(globe.map_err(|e: CrsError| WriteError::Refused { what: e.to_string() })?)
        }
    };
    let frame = Frame { globe };
    let models = write_models(folder, scene, &plan)?;
    if !scene.terrain.triangles.is_empty() {
        write_terrain(folder, scene, &frame)?;
    }
    fs::create_dir_all(folder.join("tiles"))?;
    let has_content = plan
        .tiles
        .par_iter()
        .map(|tile| write_tile(folder, scene, &frame, &plan, &models, tile))
        .collect::<Result<Vec<bool>, _>>()?;
    let tileset = Tileset { scene, frame: &frame, plan: &plan, has_content }.json(&all);
    fs::write(folder.join("tileset.json"), format!("{tileset:#}\n"))?;
    Ok(())
}

fn nowhere(crs: &Crs, why: &str) -> WriteError {
    WriteError::Refused { what: format!("the scene has no place in {crs}: {why}") }
}

/// Writes every model that a tile shows.
fn write_models(folder: &Path, scene: &Scene3d<'_>, plan: &Plan) -> Result<Models, WriteError> {
    let path = folder.join("models");
    fs::create_dir_all(&path)?;
    let used = plan.used_levels(scene);
    let levels = scene.instances.archetypes.par_iter().zip(used).enumerate().map(
        |(number, (archetype, used))| -> Result<_, WriteError> {
            let mut levels = [const { None }; 3];
            for lod in Lod::ALL.into_iter().filter(|lod| used[*lod as usize]) {
                let model = encode_model(archetype, lod);
                let file = format!("{}_{number}.{}.bin", identifier(&archetype.key), lod.name());
                fs::write(path.join(&file), &model.bytes)?;
                levels[lod as usize] = Some((format!("../models/{file}"), model));
            }
            Ok(levels)
        },
    );
    Ok(Models { levels: levels.collect::<Result<_, _>>()? })
}

fn save(glb: GlbBuilder, path: &Path) -> Result<(), WriteError> {
    let mut out = BufWriter::with_capacity(1 << 20, File::create(path)?);
    glb.write(&mut out)?;
    Ok(out.flush()?)
}

fn write_terrain(folder: &Path, scene: &Scene3d<'_>, frame: &Frame) -> Result<(), WriteError> {
    let mut glb = GlbBuilder::default();
    // within some kilometres of the origin: f32 holds millimetres
    let node = add_terrain(&mut glb, scene, &|at| frame.place_m(at).map(|m| m as f32));
    glb.set_root(scene.name, &y_up([0.0; 3]), &node.into_iter().collect::<Vec<_>>());
    save(glb, &folder.join("terrain.glb"))
}

/// The middle of a tile in the tileset's frame.
fn middle_m(frame: &Frame, tile: &Tile) -> [f64; 3] {
    let bounds = &tile.bounds;
    frame.place_m(std::array::from_fn(|k| 0.5 * (bounds.low[k] + bounds.high[k])))
}

/// Writes what a tile shows; gives whether it shows anything.
fn write_tile(
    folder: &Path,
    scene: &Scene3d<'_>,
    frame: &Frame,
    plan: &Plan,
    models: &Models,
    tile: &Tile,
) -> Result<bool, WriteError> {
    let shown = plan.shown(scene, tile);
    if shown.is_empty() {
        return Ok(false);
    }
    let middle = middle_m(frame, tile);
    let place = |at: [f32; 3]| {
        let place = frame.place_m(at);
        std::array::from_fn(|k| (place[k] - middle[k]) as f32) // within a tile
    };
    let mut glb = GlbBuilder::default();
    let mut features = FeatureTables::default();
    let mut nodes = Vec::new();
    let mut mesh_of = std::collections::BTreeMap::new();
    for (group, instances) in &shown {
        let group = &scene.instances.groups[*group];
        let Some((uri, model)) = &models.levels[group.archetype][tile.lod as usize] else {
            unreachable!("models of every level that is shown are written")
        };
        let mesh = *mesh_of.entry(group.archetype).or_insert_with(|| {
            glb.link_model(model, uri, &scene.instances.archetypes[group.archetype], scene.biome)
        });
        let chosen = Chosen::Some(instances);
        nodes.push(add_group(&mut glb, &mut features, scene, group, chosen, mesh, &place));
    }
    features.write(&mut glb, scene);
    glb.set_root(&tile.name(), &y_up([0.0; 3]), &nodes);
    save(glb, &folder.join("tiles").join(format!("{}.glb", tile.name())))?;
    Ok(true)
}

/// `box` of a bounding volume: its middle and half its sides, from `from`.
fn bounding_box([low, high]: [[f64; 3]; 2], from: [f64; 3]) -> Value {
    // chosen: room for what single precision takes from places, and for bulges
    const ROOM_M: f64 = 0.02;
    let middle: [f64; 3] = std::array::from_fn(|k| 0.5 * (low[k] + high[k]) - from[k]);
    let half: [f64; 3] = std::array::from_fn(|k| 0.5 * (high[k] - low[k]) + ROOM_M);
    let mut sides = middle.to_vec();
    for (k, half_m) in half.into_iter().enumerate() {
        sides.extend((0..3).map(|axis| if axis == k { half_m } else { 0.0 }));
    }
    json!({ "box": sides })
}

/// What `tileset.json` tells.
struct Tileset<'a> {
    scene: &'a Scene3d<'a>,
    frame: &'a Frame,
    plan: &'a Plan,
    /// Whether tiles show anything, in the plan's order.
    has_content: Vec<bool>,
}

impl Tileset<'_> {
    /// A tile with its children, `parent_m` its parent's middle.
    fn tile(&self, place: usize, tile: &Tile, parent_m: [f64; 3]) -> Value {
        let middle = middle_m(self.frame, tile);
        let mut matrix = NO_TURN;
        (0..3).for_each(|k| matrix[12 + k] = middle[k] - parent_m[k]);
        let side_m = self.plan.side_m(tile.depth);
        let error_m = match tile.lod {
            Lod::Near => 0.0,
            Lod::Middle => side_m * MIDDLE_ERROR_FRACTION,
            Lod::Far => side_m * FAR_ERROR_FRACTION,
        };
        let mut json = json!({
            "transform": matrix,
            "boundingVolume": bounding_box(self.frame.bounds(&tile.bounds), middle),
            "geometricError": error_m,
            "refine": "REPLACE",
        });
        if self.has_content[place] {
            json["content"] = json!({ "uri": format!("tiles/{}.glb", tile.name()) });
        }
        let children = self.plan.children(tile);
        let children: Vec<Value> =
            children.map(|(place, child)| self.tile(place, child, middle)).collect();
        if !children.is_empty() {
            json["children"] = Value::Array(children);
        }
        json
    }

    fn json(&self, all: &Bounds) -> Value {
        let side_m = self.plan.side_m(0).max(1.0);
        let mut root = json!({
            "boundingVolume": bounding_box(self.frame.bounds(all), [0.0; 3]),
            "geometricError": side_m * GROUND_ERROR_FRACTION,
            "refine": "ADD",
        });
        if let Some(globe) = &self.frame.globe {
            root["transform"] = json!(globe.root());
        }
        if !self.scene.terrain.triangles.is_empty() {
            root["content"] = json!({ "uri": "terrain.glb" });
        }
        if let Some(tile) = self.plan.root() {
            root["children"] = json!([self.tile(0, tile, [0.0; 3])]);
        }
        json!({
            "asset": {
                "version": "1.1",
                "extras": {
                    "generator": concat!("wildwood ", env!("CARGO_PKG_VERSION")),
                    "crs": self.scene.crs.to_string(),
                    "heights": "elevations of the scene, taken as heights above the WGS 84 ellipsoid",
                },
            },
            "geometricError": 2.0 * side_m * GROUND_ERROR_FRACTION,
            "root": root,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::example3d::Example;
    use super::*;

    fn multiplied(a: &[f64], b: &[f64]) -> Vec<f64> {
        (0..16).map(|at| (0..4).map(|k| a[4 * k + at % 4] * b[at / 4 * 4 + k]).sum()).collect()
    }

    fn numbers(value: &Value) -> Vec<f64> {
        value.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
    }

    /// Walks a tile: errors fall, boxes hold the children's; gives the number of leaf instances by their property tables.
    fn walk(folder: &Path, tile: &Value, frame: &[f64], parent_error: f64) -> u64 {
        let own =
            tile["transform"].as_array().map_or(NO_TURN.to_vec(), |_| numbers(&tile["transform"]));
        let frame = multiplied(frame, &own);
        let error = tile["geometricError"].as_f64().unwrap();
        assert!(error < parent_error);
        let children = tile["children"].as_array().cloned().unwrap_or_default();
        let mut count = 0;
        if let Some(uri) = tile["content"]["uri"].as_str() {
            let bytes = fs::read(folder.join(uri)).unwrap();
            let len = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
            let json: Value = serde_json::from_slice(&bytes[20..20 + len]).unwrap();
            for buffer in json["buffers"].as_array().unwrap() {
                if let Some(uri) = buffer["uri"].as_str() {
                    let len = fs::metadata(folder.join("tiles").join(uri)).unwrap().len();
                    assert_eq!(Some(len), buffer["byteLength"].as_u64());
                }
            }
            let tables = json["extensions"]["EXT_structural_metadata"]["propertyTables"].as_array();
            if children.is_empty() {
                count += tables.unwrap().iter().map(|t| t["count"].as_u64().unwrap()).sum::<u64>();
            }
        }
        count + children.iter().map(|child| walk(folder, child, &frame, error)).sum::<u64>()
    }

    #[test]
    fn leaves_hold_every_instance_and_errors_fall() {
        let example = Example::new(500);
        let folder = tempfile::tempdir().unwrap();
        write(folder.path(), &example.scene()).unwrap();
        let text = fs::read_to_string(folder.path().join("tileset.json")).unwrap();
        let tileset: Value = serde_json::from_str(&text).unwrap();
        assert_eq!(tileset["asset"]["version"], "1.1");
        let top = tileset["geometricError"].as_f64().unwrap();
        assert_eq!(walk(folder.path(), &tileset["root"], &NO_TURN, top), 500 + 50 + 50);
        let place = numbers(&tileset["root"]["transform"]);
        let radius_m = place[12..15].iter().map(|v| v * v).sum::<f64>().sqrt();
        assert!((radius_m - 6_370_000.0).abs() < 10_000.0);
    }

    #[test]
    fn local_metres_stay_in_their_frame() {
        let mut example = Example::new(30);
        example.crs = Crs::Local;
        let folder = tempfile::tempdir().unwrap();
        write(folder.path(), &example.scene()).unwrap();
        let text = fs::read_to_string(folder.path().join("tileset.json")).unwrap();
        let tileset: Value = serde_json::from_str(&text).unwrap();
        assert!(tileset["root"]["transform"].is_null());
        assert_eq!(tileset["root"]["content"]["uri"], "terrain.glb");
    }
}
