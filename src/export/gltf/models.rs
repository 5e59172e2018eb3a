//! Models and the ground as glTF meshes.

use serde_json::json;

use super::builder::{Component, GlbBuilder};
use crate::export::instance_bounds::Bounds;
use crate::export::materials::GROUND_SRGB;
use crate::export::scene3d::{Lod, Scene3d};
use crate::tree::archetype::Archetype;
use crate::tree::mesh::{Material, Mesh};

/// glTF's numbers of what a view is for.
pub const ARRAY_BUFFER: u32 = 34962;
/// The same of indices.
pub const ELEMENT_ARRAY_BUFFER: u32 = 34963;

/// A model's bytes, and where in them its parts lie.
pub struct ModelData {
    /// Vertices and indices.
    pub bytes: Vec<u8>,
    /// Its parts.
    pub parts: Vec<PartData>,
}

/// Where a model's part of one material lies in its bytes.
pub struct PartData {
    /// What it is made of.
    pub material: Material,
    /// Number of vertices.
    pub vertices: usize,
    /// Number of indices.
    pub indices: usize,
    /// Type of the indices.
    pub index: Component,
    /// Where places of vertices begin.
    pub positions_at: usize,
    /// Where normals begin.
    pub normals_at: usize,
    /// Where indices begin.
    pub indices_at: usize,
    /// Where it ends.
    pub end_at: usize,
    /// Around its vertices.
    pub bounds: Bounds,
}

/// The mesh of a level of detail, or of the next finer one that has triangles.
pub fn mesh_of(archetype: &Archetype, lod: Lod) -> &Mesh {
    let levels = &archetype.levels[..=lod as usize];
    let mesh = levels.iter().rev().find(|mesh| mesh.triangle_count() > 0);
    mesh.unwrap_or(&archetype.levels[0])
}

/// A model as bytes.
pub fn encode_model(archetype: &Archetype, lod: Lod) -> ModelData {
    let mut bytes = Vec::new();
    let mut parts = Vec::new();
    for part in mesh_of(archetype, lod).parts.iter().filter(|part| !part.triangles.is_empty()) {
        let positions_at = bytes.len();
        push_floats(&mut bytes, &part.positions);
        let normals_at = bytes.len();
        push_floats(&mut bytes, &part.normals);
        let indices_at = bytes.len();
        let index = push_indices(&mut bytes, &part.triangles, part.positions.len());
        parts.push(PartData {
            material: part.material,
            vertices: part.positions.len(),
            indices: 3 * part.triangles.len(),
            index,
            positions_at,
            normals_at,
            indices_at,
            end_at: bytes.len(),
            bounds: Bounds::of_points(&part.positions),
        });
        bytes.resize(bytes.len().next_multiple_of(4), 0);
    }
    ModelData { bytes, parts }
}

fn push_floats(bytes: &mut Vec<u8>, tuples: &[[f32; 3]]) {
    tuples.iter().flatten().for_each(|value| bytes.extend_from_slice(&value.to_le_bytes()));
}

/// Appends indices in as few bytes as they need.
fn push_indices(bytes: &mut Vec<u8>, triangles: &[[u32; 3]], vertices: usize) -> Component {
    let corners = triangles.iter().flatten();
    // the greatest number restarts strips and is no vertex
    if vertices <= usize::from(u16::MAX) {
        corners.for_each(|corner| bytes.extend_from_slice(&(*corner as u16).to_le_bytes())); // below 2¹⁶
        Component::U16
    } else {
        corners.for_each(|corner| bytes.extend_from_slice(&corner.to_le_bytes()));
        Component::U32
    }
}

/// Adds the ground, its vertices moved by `place`; gives its node, `None` if there is no ground.
pub fn add_terrain(
    glb: &mut GlbBuilder,
    scene: &Scene3d<'_>,
    place: &dyn Fn([f32; 3]) -> [f32; 3],
) -> Option<usize> {
    let terrain = scene.terrain;
    if terrain.triangles.is_empty() {
        return None;
    }
    let places: Vec<[f32; 3]> = terrain.position_m.iter().map(|at| place(*at)).collect();
    let bounds = Bounds::of_points(&places);
    let positions = glb.floats(places.into_iter());
    glb.set_accessor(positions, "min", json!(bounds.low));
    glb.set_accessor(positions, "max", json!(bounds.high));
    let normals = glb.floats(terrain.normal.iter().copied());
    [positions, normals].iter().for_each(|accessor| glb.set_target(*accessor, ARRAY_BUFFER));
    let mut index = Component::U32;
    let view = glb.view(|bin| {
        index = push_indices(bin, &terrain.triangles, terrain.position_m.len());
    });
    let indices = glb.accessor(view, 0, index, "SCALAR", 3 * terrain.triangles.len());
    glb.set_target(indices, ELEMENT_ARRAY_BUFFER);
    let material = glb.named_material("ground", GROUND_SRGB, false);
    let primitive = json!({
        "attributes": { "POSITION": positions, "NORMAL": normals },
        "indices": indices, "material": material,
    });
    let mesh = glb.mesh("terrain", vec![primitive]);
    Some(glb.node(json!({ "name": "terrain", "mesh": mesh })))
}

#[cfg(test)]
mod tests {
    use super::super::super::example3d::Example;
    use super::*;

    #[test]
    fn a_level_without_triangles_is_the_next_finer_one() {
        let mut archetype = Example::new(1).instances.archetypes[0].clone();
        assert_eq!(mesh_of(&archetype, Lod::Far).triangle_count(), 12);
        archetype.levels[2] = Mesh::default();
        assert_eq!(mesh_of(&archetype, Lod::Far).triangle_count(), 24);
        archetype.levels[1] = Mesh::default();
        assert_eq!(mesh_of(&archetype, Lod::Far).triangle_count(), 48);
    }

    #[test]
    fn bytes_of_a_model_are_its_parts() {
        let archetype = &Example::new(1).instances.archetypes[0];
        let model = encode_model(archetype, Lod::Near);
        let [stem, crown] = &model.parts[..] else { panic!("two materials") };
        assert_eq!((stem.vertices, stem.indices, stem.index), (72, 72, Component::U16));
        assert_eq!(crown.positions_at % 4, 0);
        let at = crown.positions_at;
        let x = f32::from_le_bytes(model.bytes[at..at + 4].try_into().unwrap());
        assert_eq!(x, archetype.levels[0].parts[1].positions[0][0]);
        assert_eq!(crown.bounds.high[2], 1.0);
    }
}
