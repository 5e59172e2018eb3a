//! A scene for Mitsuba 3: a folder with `scene.xml`, and meshes as binary PLY in `models/`.
//!
//! Metres, z up, from the scene's origin. Every model is a shape group that instances refer to; materials are matte, foliage on both
//! sides. A sun of the afternoon and its sky give the light; the camera sees the whole scene from the south-west. Instances share their model's
//! colours: tints are left out, because instances cannot have materials of their own there.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::Path;

use rayon::prelude::*;

use super::WriteError;
use super::decimal_text::push_decimal;
use super::gltf::models::mesh_of;
use super::instance_bounds::{Bounds, rotation_matrix};
use super::instances::InstanceGroup;
use super::materials::{GROUND_SRGB, linear, material_name};
use super::scene3d::{Lod, Scene3d, identifier};
use super::text_pieces::TextPieces;
use crate::tree::mesh::Material;

/// Most instances. chosen: Mitsuba takes half a minute to read so many.
pub const MOST_INSTANCES: usize = 50_000;

/// Where the camera stands, seen from the scene's middle, in radii of the scene. chosen: a bird's view of all of it.
const CAMERA: [f32; 3] = [-1.6, -2.4, 1.6];
const FIELD_OF_VIEW_DEG: u32 = 40;
/// Towards the sun: from the south-west, 45° high. chosen: the camera sees the lit side.
const SUN: [f32; 3] = [-0.35, -0.62, 0.7];
/// How much brighter sun and sky are than Mitsuba has them. chosen: foliage in the sun is half as bright as the film is white.
const SUN_SCALE: u32 = 10;
const SKY_SCALE: u32 = 14;

/// Writes a scene into an empty folder.
///
/// # Errors
/// Whatever writing gives; [`WriteError::Refused`] where there are more than [`MOST_INSTANCES`].
pub fn write(folder: &Path, scene: &Scene3d<'_>, lod: Lod) -> Result<(), WriteError> {
    let count = scene.instances.len();
    if count > MOST_INSTANCES {
        let what = format!(
            "mitsuba takes at most {MOST_INSTANCES} instances, and {count} are selected; cut them by --bbox, --min-height or --layers"
        );
        return Err(WriteError::Refused { what });
    }
    let models = folder.join("models");
    fs::create_dir(&models)?;
    let groups: Vec<&InstanceGroup> =
        scene.instances.groups.iter().filter(|group| !group.row.is_empty()).collect();
    groups.par_iter().try_for_each(|group| -> io::Result<()> {
        let archetype = &scene.instances.archetypes[group.archetype];
        for part in &mesh_of(archetype, lod).parts {
            let path = models.join(file_name(scene, group, part.material));
            write_ply(&path, &part.positions, &part.normals, &part.triangles)?;
        }
        Ok(())
    })?;
    let terrain = scene.terrain;
    if !terrain.triangles.is_empty() {
        let path = models.join("terrain.ply");
        write_ply(&path, &terrain.position_m, &terrain.normal, &terrain.triangles)?;
    }
    let mut out = BufWriter::with_capacity(1 << 20, File::create(folder.join("scene.xml"))?);
    text(scene, &groups, lod).write(&mut out)?;
    Ok(out.flush()?)
}

/// Name of a group's shape group.
fn group_name(scene: &Scene3d<'_>, group: &InstanceGroup) -> String {
    let key = &scene.instances.archetypes[group.archetype].key;
    format!("{}_{}_{}", identifier(key), group.table.name(), group.archetype)
}

fn file_name(scene: &Scene3d<'_>, group: &InstanceGroup, material: Material) -> String {
    format!("{}.{}.ply", group_name(scene, group), material.name())
}

fn write_ply(
    path: &Path,
    positions: &[[f32; 3]],
    normals: &[[f32; 3]],
    triangles: &[[u32; 3]],
) -> io::Result<()> {
    let mut out = BufWriter::new(File::create(path)?);
    write!(
        out,
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
         property float nx\nproperty float ny\nproperty float nz\nelement face {}\nproperty list uchar int vertex_indices\nend_header\n",
        positions.len(),
        triangles.len()
    )?;
    for (position, normal) in positions.iter().zip(normals) {
        for value in position.iter().chain(normal) {
            out.write_all(&value.to_le_bytes())?;
        }
    }
    for corners in triangles {
        out.write_all(&[3])?;
        for corner in corners {
            out.write_all(&corner.to_le_bytes())?;
        }
    }
    out.flush()
}

fn text<'a>(scene: &Scene3d<'a>, groups: &[&'a InstanceGroup], lod: Lod) -> TextPieces<'a> {
    let mut pieces = TextPieces::default();
    pieces.text(head(scene, groups));
    pieces.text(materials(scene, groups, lod));
    if !scene.terrain.triangles.is_empty() {
        pieces.text(
            "    <shape type=\"ply\">\n        <string name=\"filename\" value=\"models/terrain.ply\"/>\n        \
             <ref id=\"ground\"/>\n    </shape>\n\n",
        );
    }
    for group in groups {
        let name = group_name(scene, group);
        let archetype = &scene.instances.archetypes[group.archetype];
        let mut shape = format!("    <shape type=\"shapegroup\" id=\"{name}\">\n");
        for part in &mesh_of(archetype, lod).parts {
            let material = material_name(archetype, part.material, scene.biome);
            let file = file_name(scene, group, part.material);
            let _ = write!(
                shape,
                "        <shape type=\"ply\">\n            <string name=\"filename\" value=\"models/{file}\"/>\n            \
                 <ref id=\"{material}\"/>\n        </shape>\n"
            );
        }
        shape.push_str("    </shape>\n");
        pieces.text(shape);
        let group = *group;
        pieces.entries(group.row.len(), "", move |out, i| instance(out, &name, group, i));
    }
    pieces.text("</scene>\n");
    pieces
}

fn instance(out: &mut Vec<u8>, name: &str, group: &InstanceGroup, i: usize) {
    out.extend_from_slice(b"    <shape type=\"instance\"><ref id=\"");
    out.extend_from_slice(name.as_bytes());
    out.extend_from_slice(b"\"/><transform name=\"to_world\"><matrix value=\"");
    let turn = rotation_matrix(group.rotation[i]);
    for (row, place) in turn.iter().zip(group.position_m[i]) {
        for (part, scale) in row.iter().zip(group.scale[i]) {
            push_decimal(out, part * scale, 5);
            out.push(b' ');
        }
        push_decimal(out, place, 3);
        out.push(b' ');
    }
    out.extend_from_slice(b"0 0 0 1\"/></transform></shape>\n");
}

fn head(scene: &Scene3d<'_>, groups: &[&InstanceGroup]) -> String {
    let ground = Bounds::of_points(&scene.terrain.position_m);
    let all = groups.iter().fold(ground, |all, group| {
        let model = Bounds::of_archetype(&scene.instances.archetypes[group.archetype]);
        (0..group.row.len()).fold(all, |all, i| all.union(model.of_instance(group, i)))
    });
    let all = if all.is_empty() { Bounds::EMPTY.with([0.0; 3]) } else { all };
    let middle: [f32; 3] = std::array::from_fn(|k| 0.5 * (all.low[k] + all.high[k]));
    let radius_m = (0..2).map(|k| 0.5 * (all.high[k] - all.low[k])).fold(1.0, f32::max);
    let eye: [f32; 3] = std::array::from_fn(|k| middle[k] + CAMERA[k] * radius_m);
    let [mx, my, mz] = middle;
    let [ex, ey, ez] = eye;
    let [sx, sy, sz] = SUN;
    format!(
        r#"<?xml version="1.0" encoding="utf-8"?>
<scene version="3.0.0">
    <default name="spp" value="64"/>
    <default name="width" value="1280"/>
    <default name="height" value="720"/>

    <integrator type="path">
        <integer name="max_depth" value="6"/>
    </integrator>

    <sensor type="perspective">
        <float name="fov" value="{FIELD_OF_VIEW_DEG}"/>
        <float name="near_clip" value="0.1"/>
        <float name="far_clip" value="100000"/>
        <transform name="to_world">
            <lookat origin="{ex:.2}, {ey:.2}, {ez:.2}" target="{mx:.2}, {my:.2}, {mz:.2}" up="0, 0, 1"/>
        </transform>
        <film type="hdrfilm">
            <integer name="width" value="$width"/>
            <integer name="height" value="$height"/>
        </film>
        <sampler type="independent">
            <integer name="sample_count" value="$spp"/>
        </sampler>
    </sensor>

    <emitter type="sunsky">
        <vector name="sun_direction" x="{sx}" y="{sy}" z="{sz}"/>
        <float name="turbidity" value="3"/>
        <float name="sun_scale" value="{SUN_SCALE}"/>
        <float name="sky_scale" value="{SKY_SCALE}"/>
    </emitter>

"#
    )
}

/// The materials of all models that are seen, and the ground's.
fn materials(scene: &Scene3d<'_>, groups: &[&InstanceGroup], lod: Lod) -> String {
    let mut used = BTreeMap::from([("ground".to_owned(), (GROUND_SRGB, false))]);
    for group in groups {
        let archetype = &scene.instances.archetypes[group.archetype];
        for part in &mesh_of(archetype, lod).parts {
            let name = material_name(archetype, part.material, scene.biome);
            let color = archetype.color_srgb(part.material);
            used.insert(name, (color, part.material == Material::Foliage));
        }
    }
    let mut text = String::new();
    for (name, (color, is_twosided)) in used {
        let [r, g, b] = color.map(linear);
        let matte = format!(
            "<bsdf type=\"diffuse\"{{id}}><rgb name=\"reflectance\" value=\"{r:.4}, {g:.4}, {b:.4}\"/></bsdf>"
        );
        let id = format!(" id=\"{name}\"");
        let _ = if is_twosided {
            let inner = matte.replace("{id}", "");
            writeln!(text, "    <bsdf type=\"twosided\"{id}>{inner}</bsdf>")
        } else {
            writeln!(text, "    {}", matte.replace("{id}", &id))
        };
    }
    text.push('\n');
    text
}

#[cfg(test)]
mod tests {
    use super::super::example3d::Example;
    use super::*;

    #[test]
    fn every_row_is_an_instance_and_every_file_is_there() {
        let example = Example::new(60);
        let folder = tempfile::tempdir().unwrap();
        write(folder.path(), &example.scene(), Lod::Middle).unwrap();
        let text = fs::read_to_string(folder.path().join("scene.xml")).unwrap();
        assert_eq!(text.matches("type=\"instance\"").count(), 72);
        assert_eq!(text.matches("type=\"shapegroup\"").count(), 4);
        for file in text.split("value=\"models/").skip(1) {
            let file = &file[..file.find('"').unwrap()];
            let bytes = fs::read(folder.path().join("models").join(file)).unwrap();
            assert!(bytes.starts_with(b"ply\n"));
        }
    }

    #[test]
    fn a_matrix_scales_turns_and_moves() {
        let mut example = Example::new(2);
        let group = &mut example.instances.groups[0];
        let half = 0.5_f32.sqrt();
        group.rotation[0] = [0.0, 0.0, half, half];
        group.scale[0] = [2.0, 2.0, 9.0];
        group.position_m[0] = [5.0, 6.0, 7.0];
        let mut out = Vec::new();
        instance(&mut out, "pine", group, 0);
        let text = String::from_utf8(out).unwrap();
        assert!(text.contains("value=\"0 -2 0 5 2 0 0 6 0 0 9 7 0 0 0 1\""), "{text}");
    }

    #[test]
    fn too_many_are_refused_with_what_to_do() {
        let example = Example::new(45_500);
        let folder = tempfile::tempdir().unwrap();
        let refused = write(folder.path(), &example.scene(), Lod::Far).unwrap_err().to_string();
        assert!(refused.contains("--bbox") && refused.contains("54600"), "{refused}");
    }
}
