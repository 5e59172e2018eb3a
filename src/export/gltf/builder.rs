//! A binary glTF under way: its buffers, and the JSON that says what lies where.

use std::collections::BTreeMap;
use std::io::{self, Write};

use serde_json::{Value, json};

use super::models::{ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER, ModelData};
use crate::export::WriteError;
use crate::export::materials::{linear, material_name};
use crate::species::Biome;
use crate::tree::archetype::Archetype;
use crate::tree::mesh::Material;

/// glTF's number of a component type.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Component {
    /// Whole numbers of a byte.
    U8 = 5121,
    /// Whole numbers of two bytes.
    U16 = 5123,
    /// Whole numbers of four bytes.
    U32 = 5125,
    /// Single precision.
    F32 = 5126,
}

/// Views begin at multiples of this: enough for any type of a property table.
const ALIGNMENT: usize = 8;
const GLB_MAGIC: u32 = 0x4654_6C67;
const GLB_VERSION: u32 = 2;
const JSON_CHUNK: u32 = 0x4E4F_534A;
const BIN_CHUNK: u32 = 0x004E_4942;

/// A binary glTF under way.
#[derive(Default)]
pub struct GlbBuilder {
    bin: Vec<u8>,
    external: Vec<Value>,
    views: Vec<Value>,
    accessors: Vec<Value>,
    meshes: Vec<Value>,
    materials: Vec<Value>,
    nodes: Vec<Value>,
    root: Option<usize>,
    extensions: serde_json::Map<String, Value>,
    used: Vec<&'static str>,
    extras: Option<Value>,
    material_of: BTreeMap<String, usize>,
}

impl GlbBuilder {
    /// Adds bytes as a view of their own.
    pub fn view(&mut self, write: impl FnOnce(&mut Vec<u8>)) -> usize {
        self.bin.resize(self.bin.len().next_multiple_of(ALIGNMENT), 0);
        let start = self.bin.len();
        write(&mut self.bin);
        self.views.push(json!({
            "buffer": 0, "byteOffset": start, "byteLength": self.bin.len() - start,
        }));
        self.views.len() - 1
    }

    /// Adds tuples of `f32` as a view and an accessor.
    pub fn floats<const N: usize>(
        &mut self,
        values: impl ExactSizeIterator<Item = [f32; N]>,
    ) -> usize {
        let count = values.len();
        let view = self.view(|bin| {
            bin.reserve(count * N * size_of::<f32>());
            for tuple in values {
                tuple.iter().for_each(|value| bin.extend_from_slice(&value.to_le_bytes()));
            }
        });
        self.accessor(view, 0, Component::F32, tuple_type(N), count)
    }

    /// Adds an accessor on a view.
    pub fn accessor(
        &mut self,
        view: usize,
        offset: usize,
        component: Component,
        tuple: &str,
        count: usize,
    ) -> usize {
        self.accessors.push(json!({
            "bufferView": view, "byteOffset": offset, "componentType": component as u32,
            "type": tuple, "count": count,
        }));
        self.accessors.len() - 1
    }

    /// Sets a property of an accessor.
    pub fn set_accessor(&mut self, accessor: usize, key: &str, value: Value) {
        self.accessors[accessor][key] = value;
    }

    /// Says what the view of an accessor is for.
    pub fn set_target(&mut self, accessor: usize, target: u32) {
        let view = self.accessors[accessor]["bufferView"].as_u64().unwrap_or_default() as usize;
        self.views[view]["target"] = target.into();
    }

    /// Adds a model whose bytes are part of the file; gives its mesh.
    pub fn embed_model(
        &mut self,
        model: &ModelData,
        archetype: &Archetype,
        biome: &Biome,
    ) -> usize {
        self.bin.resize(self.bin.len().next_multiple_of(ALIGNMENT), 0);
        let start = self.bin.len();
        self.bin.extend_from_slice(&model.bytes);
        self.model(model, 0, start, archetype, biome)
    }

    /// Adds a model whose bytes are a file of their own at `uri`; gives its mesh.
    pub fn link_model(
        &mut self,
        model: &ModelData,
        uri: &str,
        archetype: &Archetype,
        biome: &Biome,
    ) -> usize {
        self.external.push(json!({ "uri": uri, "byteLength": model.bytes.len() }));
        self.model(model, self.external.len(), 0, archetype, biome)
    }

    fn model(
        &mut self,
        model: &ModelData,
        buffer: usize,
        start: usize,
        archetype: &Archetype,
        biome: &Biome,
    ) -> usize {
        let mut primitives = Vec::new();
        for part in &model.parts {
            let [first, second, third] = [part.positions_at, part.normals_at, part.indices_at];
            let lengths = [second - first, third - second, part.end_at - third];
            let targets = [ARRAY_BUFFER, ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER];
            let mut view = |at: usize, length: usize, target: u32| {
                self.views.push(json!({
                    "buffer": buffer, "byteOffset": start + at, "byteLength": length, "target": target,
                }));
                self.views.len() - 1
            };
            let views = [
                view(first, lengths[0], targets[0]),
                view(second, lengths[1], targets[1]),
                view(third, lengths[2], targets[2]),
            ];
            let positions = self.accessor(views[0], 0, Component::F32, "VEC3", part.vertices);
            self.set_accessor(positions, "min", json!(part.bounds.low));
            self.set_accessor(positions, "max", json!(part.bounds.high));
            let normals = self.accessor(views[1], 0, Component::F32, "VEC3", part.vertices);
            let indices = self.accessor(views[2], 0, part.index, "SCALAR", part.indices);
            let material = self.material(archetype, part.material, biome);
            primitives.push(json!({
                "attributes": { "POSITION": positions, "NORMAL": normals },
                "indices": indices, "material": material,
            }));
        }
        self.mesh(&archetype.key, primitives)
    }

    /// Adds a mesh.
    pub fn mesh(&mut self, name: &str, primitives: Vec<Value>) -> usize {
        self.meshes.push(json!({ "name": name, "primitives": primitives }));
        self.meshes.len() - 1
    }

    fn material(&mut self, archetype: &Archetype, material: Material, biome: &Biome) -> usize {
        let name = material_name(archetype, material, biome);
        self.named_material(&name, archetype.color_srgb(material), material == Material::Foliage)
    }

    /// A matte material of a colour; one of the same name is taken again.
    pub fn named_material(&mut self, name: &str, color: [u8; 3], is_double_sided: bool) -> usize {
        if let Some(material) = self.material_of.get(name) {
            return *material;
        }
        let [r, g, b] = color.map(linear);
        let mut material = json!({
            "name": name,
            "pbrMetallicRoughness": {
                "baseColorFactor": [r, g, b, 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.9,
            },
        });
        if is_double_sided {
            material["doubleSided"] = true.into();
        }
        self.materials.push(material);
        self.material_of.insert(name.to_owned(), self.materials.len() - 1);
        self.materials.len() - 1
    }

    /// Adds a node.
    pub fn node(&mut self, node: Value) -> usize {
        self.nodes.push(node);
        self.nodes.len() - 1
    }

    /// Adds the node that all others hang on.
    pub fn set_root(&mut self, name: &str, matrix: &[f64; 16], children: &[usize]) {
        let mut root = json!({ "name": name, "matrix": matrix });
        if !children.is_empty() {
            root["children"] = json!(children);
        }
        self.root = Some(self.node(root));
    }

    /// Names an extension that the file uses.
    pub fn uses(&mut self, extension: &'static str) {
        if !self.used.contains(&extension) {
            self.used.push(extension);
        }
    }

    /// Sets an extension of the whole file.
    pub fn set_extension(&mut self, extension: &'static str, value: Value) {
        self.uses(extension);
        self.extensions.insert(extension.to_owned(), value);
    }

    /// Sets what the file says of itself.
    pub fn set_extras(&mut self, extras: Value) {
        self.extras = Some(extras);
    }

    /// Writes the file.
    ///
    /// # Errors
    /// Whatever writing gives; [`WriteError::Refused`] where it would be 4 GiB or larger, which glTF cannot be.
    pub fn write(mut self, out: &mut dyn Write) -> Result<(), WriteError> {
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        let mut text = serde_json::to_vec(&self.json()).map_err(io::Error::from)?;
        text.resize(text.len().next_multiple_of(4), b' ');
        // a file without data of its own has no second chunk
        let has_bin = !self.bin.is_empty();
        let length = 12 + 8 + text.len() + if has_bin { 8 + self.bin.len() } else { 0 };
        let whole = |length: usize| {
            u32::try_from(length).map_err(|_| WriteError::Refused {
                what: "glTF cannot be larger than 4 GiB; export a part with --bbox, or 3dtiles"
                    .to_owned(),
            })
        };
        for word in [GLB_MAGIC, GLB_VERSION, whole(length)?, whole(text.len())?, JSON_CHUNK] {
            out.write_all(&word.to_le_bytes())?;
        }
        out.write_all(&text)?;
        if has_bin {
            for word in [whole(self.bin.len())?, BIN_CHUNK] {
                out.write_all(&word.to_le_bytes())?;
            }
            out.write_all(&self.bin)?;
        }
        Ok(())
    }

    fn json(&mut self) -> Value {
        let mut asset = json!({
            "version": "2.0",
            "generator": concat!("wildwood ", env!("CARGO_PKG_VERSION")),
        });
        if let Some(extras) = self.extras.take() {
            asset["extras"] = extras;
        }
        let mut buffers = vec![json!({ "byteLength": self.bin.len() })];
        buffers.append(&mut self.external);
        let mut gltf = json!({ "asset": asset, "scene": 0, "scenes": [{}] });
        if let Some(root) = self.root {
            gltf["scenes"][0]["nodes"] = json!([root]);
        }
        // arrays of glTF have an entry at least, or are left out
        let mut set = |key: &str, values: &mut Vec<Value>| {
            if !values.is_empty() {
                gltf[key] = Value::Array(std::mem::take(values));
            }
        };
        set("nodes", &mut self.nodes);
        set("meshes", &mut self.meshes);
        set("materials", &mut self.materials);
        set("accessors", &mut self.accessors);
        set("bufferViews", &mut self.views);
        if !self.bin.is_empty() {
            set("buffers", &mut buffers);
        }
        if !self.used.is_empty() {
            gltf["extensionsUsed"] = json!(self.used);
        }
        // a viewer without it would show every model once, at the origin
        if self.used.contains(&super::instancing::INSTANCING) {
            gltf["extensionsRequired"] = json!([super::instancing::INSTANCING]);
        }
        if !self.extensions.is_empty() {
            gltf["extensions"] = Value::Object(std::mem::take(&mut self.extensions));
        }
        gltf
    }
}

fn tuple_type(components: usize) -> &'static str {
    match components {
        1 => "SCALAR",
        2 => "VEC2",
        3 => "VEC3",
        4 => "VEC4",
        other => unreachable!("tuples of {other} are none of glTF's"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn views_are_aligned_and_materials_are_shared() {
        let mut glb = GlbBuilder::default();
        let first = glb.view(|bin| bin.extend_from_slice(b"abc"));
        let second = glb.floats([[1.0, 2.0, 3.0]].into_iter());
        assert_eq!((first, second), (0, 0));
        assert_eq!(glb.views[1]["byteOffset"], 8);
        assert_eq!(glb.accessors[0]["type"], "VEC3");
        let oak = glb.named_material("oak", [9, 9, 9], true);
        assert_eq!(glb.named_material("oak", [1, 1, 1], true), oak);
    }

    #[test]
    fn an_empty_file_is_a_file() {
        let mut out = Vec::new();
        let mut glb = GlbBuilder::default();
        glb.set_root("nothing", &super::super::y_up([0.0; 3]), &[]);
        glb.write(&mut out).unwrap();
        let json: Value = serde_json::from_slice(&out[20..]).unwrap();
        assert!(json.get("buffers").is_none() && json.get("meshes").is_none());
    }
}
