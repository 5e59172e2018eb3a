//! A model's instances as a glTF node.

use serde_json::json;

use super::builder::{Component, GlbBuilder};
use super::metadata::FeatureTables;
use crate::export::instances::InstanceGroup;
use crate::export::materials::linear_table;
use crate::export::scene3d::Scene3d;

/// The extension that holds places, turns and sizes of instances.
pub const INSTANCING: &str = "EXT_mesh_gpu_instancing";
/// The extension that tells instances apart.
pub const INSTANCE_FEATURES: &str = "EXT_instance_features";

/// Which instances of a group are meant.
#[derive(Clone, Copy)]
pub enum Chosen<'a> {
    /// All, so many.
    All(usize),
    /// Those at these places in the group's arrays.
    Some(&'a [u32]),
}

impl Chosen<'_> {
    /// Number of instances.
    pub fn len(&self) -> usize {
        match self {
            Self::All(count) => *count,
            Self::Some(places) => places.len(),
        }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Their places in the group's arrays.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = usize> + '_ {
        (0..self.len()).map(|i| match self {
            Self::All(_) => i,
            Self::Some(places) => places[i] as usize,
        })
    }
}

/// Adds instances of a group, moved by `place`, and their rows of the property table; gives their node.
pub fn add_group(
    glb: &mut GlbBuilder,
    features: &mut FeatureTables,
    scene: &Scene3d<'_>,
    group: &InstanceGroup,
    chosen: Chosen<'_>,
    mesh: usize,
    place: &dyn Fn([f32; 3]) -> [f32; 3],
) -> usize {
    let translation = glb.floats(chosen.iter().map(|i| place(group.position_m[i])));
    let rotation = glb.floats(chosen.iter().map(|i| group.rotation[i]));
    let scale = glb.floats(chosen.iter().map(|i| group.scale[i]));
    let light = linear_table();
    let view = glb.view(|bin| {
        for i in chosen.iter() {
            let channel = |srgb: u8| (light[usize::from(srgb)] * 255.0 + 0.5) as u8; // within 0..=255
            let [r, g, b] = group.tint_srgb[i].map(channel);
            bin.extend_from_slice(&[r, g, b, 255]);
        }
    });
    let color = glb.accessor(view, 0, Component::U8, "VEC4", chosen.len());
    glb.set_accessor(color, "normalized", true.into());
    let (table, first) = features.add(group.table, chosen.iter().map(|i| group.row[i]));
    // whole numbers are exact in f32 below 2²⁴, and vertex data may hold no longer whole ones
    let feature = glb.floats((first..first + chosen.len()).map(|feature| [feature as f32]));
    glb.uses(INSTANCING);
    glb.uses(INSTANCE_FEATURES);
    glb.node(json!({
        "name": scene.instances.archetypes[group.archetype].key,
        "mesh": mesh,
        "extensions": {
            INSTANCING: { "attributes": {
                "TRANSLATION": translation, "ROTATION": rotation, "SCALE": scale,
                "_COLOR_0": color, "_FEATURE_ID_0": feature,
            } },
            INSTANCE_FEATURES: { "featureIds": [{
                "featureCount": chosen.len(), "attribute": 0, "propertyTable": table,
            }] },
        },
    }))
}
