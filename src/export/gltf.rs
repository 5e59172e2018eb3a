//! A scene as binary glTF: one node for each model, whose instances stand in `EXT_mesh_gpu_instancing`.
//!
//! Metres. Nodes are z up, east along x; the root node turns them to glTF's y up. Positions are single precision from the
//! scene's origin, which the root's matrix may add. What the tables say stands in property tables (`EXT_structural_metadata`), a row an
//! instance, named by `_FEATURE_ID_0` (`EXT_instance_features`). `_COLOR_0` is the tint of an instance, in light.
//!
//! Reading order: [`builder`] (buffers and their views), [`models`] (meshes and materials), [`instancing`] (nodes),
//! [`metadata`] (property tables).
//!
//! # Reference
//! Khronos Group, glTF 2.0; EXT_mesh_gpu_instancing; Cesium, EXT_instance_features and EXT_structural_metadata.

pub mod builder;
pub mod instancing;
pub mod metadata;
pub mod models;

use std::io;

use serde_json::json;

use self::builder::GlbBuilder;
use self::instancing::{Chosen, add_group};
use self::metadata::FeatureTables;
use self::models::{add_terrain, encode_model};
use super::WriteError;
use super::scene3d::{Lod, Scene3d};

/// How a scene is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GltfOptions {
    /// Level of detail of all models.
    pub lod: Lod,
    /// Whether the scene stands at its map coordinates rather than at 0.
    pub is_on_map: bool,
}

/// The matrix that turns east, north, up to glTF's axes and moves the origin, by columns.
pub fn y_up([x, y, z]: [f64; 3]) -> [f64; 16] {
    [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 1.0, 0.0, 0.0, x, z, -y, 1.0]
}

/// Writes a scene as a `.glb` file.
///
/// # Errors
/// Whatever writing gives; [`WriteError::Refused`] where it would be larger than glTF allows.
pub fn write(
    out: &mut dyn io::Write,
    scene: &Scene3d<'_>,
    options: &GltfOptions,
) -> Result<(), WriteError> {
    let mut glb = GlbBuilder::default();
    let mut features = FeatureTables::default();
    let mut nodes = Vec::new();
    nodes.extend(add_terrain(&mut glb, scene, &|place| place));
    for group in scene.instances.groups.iter().filter(|group| !group.row.is_empty()) {
        let archetype = &scene.instances.archetypes[group.archetype];
        let model = encode_model(archetype, options.lod);
        let mesh = glb.embed_model(&model, archetype, scene.biome);
        let chosen = Chosen::All(group.row.len());
        nodes.push(add_group(&mut glb, &mut features, scene, group, chosen, mesh, &|place| place));
    }
    features.write(&mut glb, scene);
    let origin = if options.is_on_map { scene.instances.origin } else { [0.0; 3] };
    glb.set_root(scene.name, &y_up(origin), &nodes);
    glb.set_extras(json!({ "crs": scene.crs.to_string(), "origin": scene.instances.origin }));
    glb.write(out)
}

#[cfg(test)]
mod tests {
    use serde_json::Value;

    use super::super::example3d::Example;
    use super::*;

    /// The two chunks of a binary glTF.
    fn chunks(bytes: &[u8]) -> (Value, Vec<u8>) {
        let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
        assert_eq!((&bytes[..4], word(4), word(8)), (&b"glTF"[..], 2, bytes.len()));
        let json_len = word(12);
        assert_eq!((&bytes[16..20], json_len % 4), (&b"JSON"[..], 0));
        let json = serde_json::from_slice(&bytes[20..20 + json_len]).unwrap();
        let bin = 20 + json_len;
        assert_eq!((&bytes[bin + 4..bin + 8], word(bin) % 4), (&b"BIN\0"[..], 0));
        (json, bytes[bin + 8..bin + 8 + word(bin)].to_vec())
    }

    fn written(example: &Example, is_on_map: bool) -> (Value, Vec<u8>) {
        let mut out = Vec::new();
        let options = GltfOptions { lod: Lod::Far, is_on_map };
        write(&mut out, &example.scene(), &options).unwrap();
        chunks(&out)
    }

    fn floats(json: &Value, bin: &[u8], accessor: &Value) -> Vec<f32> {
        let accessor = &json["accessors"][accessor.as_u64().unwrap() as usize];
        let view = &json["bufferViews"][accessor["bufferView"].as_u64().unwrap() as usize];
        let start = view["byteOffset"].as_u64().unwrap() as usize;
        let len = view["byteLength"].as_u64().unwrap() as usize;
        let whole = bin[start..start + len].chunks_exact(4);
        whole.map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect()
    }

    #[test]
    fn every_row_is_an_instance_at_its_place() {
        let example = Example::new(101);
        let (json, bin) = written(&example, false);
        let mut count = 0;
        let nodes = json["nodes"].as_array().unwrap();
        let groups = nodes.iter().filter(|node| node["extensions"].is_object());
        for (node, group) in groups.zip(&example.instances.groups) {
            let instancing = &node["extensions"]["EXT_mesh_gpu_instancing"]["attributes"];
            let places = floats(&json, &bin, &instancing["TRANSLATION"]);
            let expected: Vec<f32> = group.position_m.iter().flatten().copied().collect();
            assert_eq!(places, expected);
            let turns = floats(&json, &bin, &instancing["ROTATION"]);
            assert_eq!(turns[..4], group.rotation[0]);
            let sizes = floats(&json, &bin, &instancing["SCALE"]);
            assert_eq!(sizes[..3], group.scale[0]);
            count += places.len() / 3;
        }
        assert_eq!(count, 101 + 11 + 11);
        let rows = |table: usize| {
            json["extensions"]["EXT_structural_metadata"]["propertyTables"][table]["count"].as_u64()
        };
        assert_eq!([rows(0), rows(1), rows(2)], [Some(101), Some(11), Some(11)]);
    }

    #[test]
    fn property_tables_say_what_tables_say() {
        let example = Example::new(101);
        let (json, bin) = written(&example, false);
        let metadata = &json["extensions"]["EXT_structural_metadata"];
        let view = |property: &str| {
            let view = metadata["propertyTables"][0]["properties"][property]["values"].as_u64();
            let view = &json["bufferViews"][view.unwrap() as usize];
            assert_eq!(view["byteOffset"].as_u64().unwrap() % 8, 0, "aligned for any type");
            &bin[view["byteOffset"].as_u64().unwrap() as usize..]
                [..view["byteLength"].as_u64().unwrap() as usize]
        };
        let ids: Vec<u64> =
            view("id").chunks_exact(8).map(|b| u64::from_le_bytes(b.try_into().unwrap())).collect();
        let rows: Vec<usize> = example.instances.groups[..2]
            .iter()
            .flat_map(|g| &g.row)
            .map(|r| *r as usize)
            .collect();
        let expected: Vec<u64> = rows.iter().map(|row| example.plants.id[*row]).collect();
        assert_eq!(ids, expected);
        let heights: Vec<f32> = view("height_m")
            .chunks_exact(4)
            .map(|b| f32::from_le_bytes(b.try_into().unwrap()))
            .collect();
        assert!(rows.iter().zip(heights).all(|(row, h)| example.plants.height_m[*row] == h));
        let species = u16::from_le_bytes(view("species")[..2].try_into().unwrap());
        let names = &metadata["schema"]["enums"]["species"]["values"];
        assert_eq!(names[usize::from(species)]["name"], example.biome.species[8].key);
    }

    #[test]
    fn the_root_turns_z_up_to_y_up_and_may_stand_on_the_map() {
        let (json, _) = written(&Example::new(3), true);
        let root = &json["nodes"][json["scenes"][0]["nodes"][0].as_u64().unwrap() as usize];
        let matrix: Vec<f64> =
            root["matrix"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
        let turn = |p: [f64; 3]| -> Vec<f64> {
            (0..3)
                .map(|row| {
                    matrix[12 + row] + (0..3).map(|c| matrix[4 * c + row] * p[c]).sum::<f64>()
                })
                .collect()
        };
        assert_eq!(turn([1.0, 2.0, 3.0]), [256_001.0, 353.0, -4_110_002.0]);
    }
}
