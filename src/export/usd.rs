//! A scene as OpenUSD text: the ground, and a point instancer for each model of plants, snags and downed logs.
//!
//! Metres, z up. Instancers stand under `/Forest/Plants`, `/Forest/Snags` and `/Forest/DownedLogs`; each holds its model in all levels of
//! detail, and the variant set `lod` of `/Forest` chooses one for the whole forest. Positions are single precision, local to `/Forest`, which
//! stands at the origin or, if asked for, at its double precision place on the map. Instances carry the table's `ids` and the primvars `tint`,
//! a size and an age.
//!
//! # Reference
//! OpenUSD: the schemas of UsdGeom and UsdShade, and the specification of `UsdPreviewSurface` 2.6.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io;

use rayon::prelude::*;

use super::decimal_text::{push_decimal, push_tuple, push_whole};
use super::instance_bounds::Bounds;
use super::instances::{FeatureTable, InstanceGroup};
use super::materials::{GROUND_SRGB, linear, linear_table, material_name};
use super::scene3d::{Lod, MAIN_MEASURES, Scene3d};
use super::text_pieces::TextPieces;
use crate::tree::mesh::{Material, MeshPart};

/// How a scene is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct UsdOptions {
    /// The level of detail that is shown first.
    pub lod: Lod,
    /// Whether the scene stands at its map coordinates rather than at 0.
    pub is_on_map: bool,
}

/// Digits of places and vertices on the ground: millimetres.
const PLACE_DECIMALS: usize = 3;
/// Digits of sizes, which seedlings have few of, and of vertices of models one unit large.
const SIZE_DECIMALS: usize = 4;
/// Digits of turns: half precision holds no more.
const TURN_DECIMALS: usize = 4;

/// Writes a scene as a `.usda` file.
///
/// # Errors
/// Whatever writing gives.
pub fn write(out: &mut dyn io::Write, scene: &Scene3d<'_>, options: &UsdOptions) -> io::Result<()> {
    let mut pieces = TextPieces::default();
    head(&mut pieces, scene, options);
    materials(&mut pieces, scene);
    terrain(&mut pieces, scene);
    for table in FeatureTable::ALL {
        let groups = scene.named_groups(table);
        if !groups.is_empty() {
            pieces.text(format!("    def Xform \"{}\"\n    {{\n", table.title()));
            for (name, group) in &groups {
                instancer(&mut pieces, scene, table, name, group);
            }
            pieces.text("    }\n\n");
        }
    }
    levels(&mut pieces, scene);
    pieces.text("}\n");
    pieces.write(out)
}

/// A text between quotes, with nothing in it that would end it.
fn quoted(text: &str) -> String {
    let clean: String = text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
    format!("\"{}\"", clean.replace('\\', "\\\\").replace('"', "\\\""))
}

fn head(pieces: &mut TextPieces<'_>, scene: &Scene3d<'_>, options: &UsdOptions) {
    let [x, y, z] = scene.instances.origin;
    let mut text = format!(
        "#usda 1.0\n(\n    customLayerData = {{\n        dictionary wildwood = {{\n            string crs = {crs}\n            \
         double3 origin = ({x}, {y}, {z})\n        }}\n    }}\n    defaultPrim = \"Forest\"\n    doc = {doc}\n    \
         metersPerUnit = 1\n    upAxis = \"Z\"\n)\n\n",
        crs = quoted(&scene.crs.to_string()),
        doc = quoted(&format!("{}, a forest by wildwood", scene.name)),
    );
    let _ = write!(
        text,
        "def Xform \"Forest\" (\n    kind = \"component\"\n    variants = {{\n        string lod = \"{}\"\n    }}\n    \
         prepend variantSets = \"lod\"\n)\n{{\n",
        options.lod.name()
    );
    if options.is_on_map {
        let _ = write!(
            text,
            "    double3 xformOp:translate = ({x}, {y}, {z})\n    uniform token[] xformOpOrder = [\"xformOp:translate\"]\n\n"
        );
    }
    pieces.text(text);
}

/// Every material of every species that is seen, and the ground's.
fn materials(pieces: &mut TextPieces<'_>, scene: &Scene3d<'_>) {
    let mut used = BTreeMap::new();
    for group in scene.instances.groups.iter().filter(|group| !group.row.is_empty()) {
        let archetype = &scene.instances.archetypes[group.archetype];
        for part in archetype.levels.iter().flat_map(|mesh| &mesh.parts) {
            let name = material_name(archetype, part.material, scene.biome);
            used.insert(name, archetype.color_srgb(part.material));
        }
    }
    let mut text = "    def Scope \"Materials\"\n    {\n".to_owned();
    let mut add = |name: &str, color: [u8; 3]| {
        let [r, g, b] = color.map(linear);
        let path = format!("/Forest/Materials/{name}");
        let _ = write!(
            text,
            "        def Material \"{name}\"\n        {{\n            token outputs:surface.connect = <{path}/Surface.outputs:surface>\n\n            \
             def Shader \"Surface\"\n            {{\n                uniform token info:id = \"UsdPreviewSurface\"\n                \
             color3f inputs:diffuseColor = ({r:.4}, {g:.4}, {b:.4})\n                float inputs:metallic = 0\n                \
             float inputs:roughness = 0.9\n                token outputs:surface\n            }}\n        }}\n\n"
        );
    };
    add("ground", GROUND_SRGB);
    used.iter().for_each(|(name, color)| add(name, *color));
    text.push_str("    }\n\n");
    pieces.text(text);
}

/// Triangles of one material.
struct Surface<'a> {
    name: &'a str,
    material: String,
    positions: &'a [[f32; 3]],
    normals: &'a [[f32; 3]],
    triangles: &'a [[u32; 3]],
    decimals: usize,
    is_double_sided: bool,
}

fn surface<'a>(pieces: &mut TextPieces<'a>, surface: &Surface<'a>, indent: &str) {
    let Surface { name, positions, normals, triangles, decimals, .. } = *surface;
    let material = &surface.material;
    let sided = if surface.is_double_sided { "true" } else { "false" };
    pieces.text(format!(
        "{indent}def Mesh \"{name}\" (\n{indent}    prepend apiSchemas = [\"MaterialBindingAPI\"]\n{indent})\n{indent}{{\n\
         {indent}    uniform bool doubleSided = {sided}\n"
    ));
    extent(pieces, &Bounds::of_points(positions), indent);
    array(pieces, indent, "int[] faceVertexCounts", triangles.len(), |out, _| out.push(b'3'), "");
    let corners = move |out: &mut Vec<u8>, i: usize| {
        for (place, corner) in triangles[i].iter().enumerate() {
            if place > 0 {
                out.extend_from_slice(b", ");
            }
            push_whole(out, u64::from(*corner));
        }
    };
    array(pieces, indent, "int[] faceVertexIndices", triangles.len(), corners, "");
    pieces.text(format!("{indent}    rel material:binding = </Forest/Materials/{material}>\n"));
    let normal = move |out: &mut Vec<u8>, i: usize| push_tuple(out, normals[i], TURN_DECIMALS);
    let vertex = format!(" (\n{indent}        interpolation = \"vertex\"\n{indent}    )");
    array(pieces, indent, "normal3f[] normals", normals.len(), normal, &vertex);
    let point = move |out: &mut Vec<u8>, i: usize| push_tuple(out, positions[i], decimals);
    array(pieces, indent, "point3f[] points", positions.len(), point, "");
    pieces.text(format!("{indent}    uniform token subdivisionScheme = \"none\"\n{indent}}}\n\n"));
}

/// An attribute of `count` entries.
fn array<'a>(
    pieces: &mut TextPieces<'a>,
    indent: &str,
    attribute: &str,
    count: usize,
    entry: impl Fn(&mut Vec<u8>, usize) + Send + Sync + Clone + 'a,
    metadata: &str,
) {
    pieces.text(format!("{indent}    {attribute} = ["));
    pieces.entries(count, ", ", entry);
    pieces.text(format!("]{metadata}\n"));
}

/// The attribute `extent`, where there is something.
fn extent(pieces: &mut TextPieces<'_>, bounds: &Bounds, indent: &str) {
    if bounds.is_empty() {
        return;
    }
    let mut text = format!("{indent}    float3[] extent = [").into_bytes();
    push_tuple(&mut text, bounds.low, PLACE_DECIMALS);
    text.extend_from_slice(b", ");
    push_tuple(&mut text, bounds.high, PLACE_DECIMALS);
    text.extend_from_slice(b"]\n");
    pieces.piece(move |out| out.extend_from_slice(&text));
}

fn terrain<'a>(pieces: &mut TextPieces<'a>, scene: &Scene3d<'a>) {
    let terrain = scene.terrain;
    if terrain.triangles.is_empty() {
        return;
    }
    let ground = Surface {
        name: "Terrain",
        material: "ground".to_owned(),
        positions: &terrain.position_m,
        normals: &terrain.normal,
        triangles: &terrain.triangles,
        decimals: PLACE_DECIMALS,
        is_double_sided: false,
    };
    surface(pieces, &ground, "    ");
}

fn instancer<'a>(
    pieces: &mut TextPieces<'a>,
    scene: &Scene3d<'a>,
    table: FeatureTable,
    name: &str,
    group: &'a InstanceGroup,
) {
    let indent = "        ";
    let archetype = &scene.instances.archetypes[group.archetype];
    let count = group.row.len();
    pieces.text(format!("{indent}def PointInstancer \"{name}\"\n{indent}{{\n"));
    let model = Bounds::of_archetype(archetype);
    let around = (0..count)
        .into_par_iter()
        .map(|i| model.of_instance(group, i))
        .reduce(|| Bounds::EMPTY, Bounds::union);
    extent(pieces, &around, indent);
    let ids = scene.ids(table);
    let id = move |out: &mut Vec<u8>, i: usize| push_whole(out, ids[group.row[i] as usize]);
    array(pieces, indent, "int64[] ids", count, id, "");
    let turn = move |out: &mut Vec<u8>, i: usize| {
        let [x, y, z, w] = group.rotation[i];
        push_tuple(out, [w, x, y, z], TURN_DECIMALS); // USD writes the real part first
    };
    array(pieces, indent, "quath[] orientations", count, turn, "");
    let place =
        move |out: &mut Vec<u8>, i: usize| push_tuple(out, group.position_m[i], PLACE_DECIMALS);
    array(pieces, indent, "point3f[] positions", count, place, "");
    let each = format!(" (\n{indent}        interpolation = \"vertex\"\n{indent}    )");
    for measure in scene.measures(table).into_iter().take(MAIN_MEASURES) {
        let value = move |out: &mut Vec<u8>, i: usize| {
            push_decimal(out, measure.values[group.row[i] as usize], measure.decimals);
        };
        let attribute = format!("float[] primvars:{}", measure.name);
        array(pieces, indent, &attribute, count, value, &each);
    }
    pieces.text(format!(
        "{indent}    string primvars:species = {} (\n{indent}        interpolation = \"constant\"\n{indent}    )\n",
        quoted(&scene.biome.species[usize::from(archetype.species)].key),
    ));
    let light = linear_table();
    let tint = move |out: &mut Vec<u8>, i: usize| {
        push_tuple(out, group.tint_srgb[i].map(|channel| light[usize::from(channel)]), 3);
    };
    array(pieces, indent, "color3f[] primvars:tint", count, tint, &each);
    array(pieces, indent, "int[] protoIndices", count, |out, _| out.push(b'0'), "");
    let size = move |out: &mut Vec<u8>, i: usize| push_tuple(out, group.scale[i], SIZE_DECIMALS);
    array(pieces, indent, "float3[] scales", count, size, "");
    prototypes(pieces, scene, group);
    pieces.text(format!("{indent}}}\n\n"));
}

/// The model in every level of detail.
fn prototypes<'a>(pieces: &mut TextPieces<'a>, scene: &Scene3d<'a>, group: &InstanceGroup) {
    let indent = "            ";
    let archetype = &scene.instances.archetypes[group.archetype];
    pieces.text(format!("\n{indent}def Scope \"Prototypes\"\n{indent}{{\n"));
    for (level, mesh) in Lod::ALL.into_iter().zip(&archetype.levels) {
        pieces.text(format!("{indent}    def Xform \"{}\"\n{indent}    {{\n", level.name()));
        for part in &mesh.parts {
            let MeshPart { material, positions, normals, triangles } = part;
            let of_part = Surface {
                name: material.name(),
                material: material_name(archetype, *material, scene.biome),
                positions,
                normals,
                triangles,
                decimals: SIZE_DECIMALS,
                is_double_sided: *material == Material::Foliage,
            };
            surface(pieces, &of_part, "                    ");
        }
        pieces.text(format!("{indent}    }}\n\n"));
    }
    pieces.text(format!("{indent}}}\n"));
}

/// The variants of `/Forest`: which prototype every instancer takes.
fn levels(pieces: &mut TextPieces<'_>, scene: &Scene3d<'_>) {
    let mut text = "    variantSet \"lod\" = {\n".to_owned();
    for level in Lod::ALL {
        let _ = writeln!(text, "        \"{}\" {{", level.name());
        for table in FeatureTable::ALL {
            let groups = scene.named_groups(table);
            if groups.is_empty() {
                continue;
            }
            let over = table.title();
            let _ = writeln!(text, "            over \"{over}\"\n            {{");
            for (name, _) in groups {
                let _ = writeln!(
                    text,
                    "                over \"{name}\"\n                {{\n                    \
                     rel prototypes = </Forest/{over}/{name}/Prototypes/{}>\n                }}",
                    level.name()
                );
            }
            text.push_str("            }\n");
        }
        text.push_str("        }\n");
    }
    text.push_str("    }\n");
    pieces.text(text);
}

#[cfg(test)]
mod tests {
    use super::super::example3d::Example;
    use super::*;

    fn written(example: &Example, is_on_map: bool) -> String {
        let mut out = Vec::new();
        let options = UsdOptions { lod: Lod::Middle, is_on_map };
        write(&mut out, &example.scene(), &options).unwrap();
        String::from_utf8(out).unwrap()
    }

    #[test]
    fn every_row_is_an_instance_and_braces_close() {
        let example = Example::new(205);
        let text = written(&example, false);
        for (open, close) in [('{', '}'), ('(', ')'), ('[', ']')] {
            let count = |c: char| text.matches(c).count();
            assert_eq!(count(open), count(close), "{open}");
        }
        let entries = |attribute: &str| -> usize {
            let arrays = text.match_indices(attribute).map(|(at, _)| {
                let rest = &text[at + attribute.len()..];
                let inner = &rest[..rest.find(']').unwrap()];
                inner.matches("(").count().max(inner.split(',').count())
            });
            arrays.sum()
        };
        assert_eq!(entries("int64[] ids = ["), 205 + 21 + 21);
        assert_eq!(entries("float[] primvars:height_m = ["), 205 + 21);
        assert_eq!(entries("float[] primvars:length_m = ["), 21);
        assert_eq!(text.matches("def PointInstancer").count(), 4);
        assert_eq!(text.matches("rel prototypes").count(), 12);
        assert!(text.contains("string lod = \"middle\""));
    }

    #[test]
    fn places_and_turns_are_the_instances() {
        let mut example = Example::new(2);
        let group = &mut example.instances.groups[0];
        group.position_m[0] = [12.3456, -7.0, 0.5];
        group.rotation[0] = [0.1, 0.2, 0.3, 0.927_36];
        let text = written(&example, false);
        assert!(text.contains("positions = [(12.346, -7, 0.5)"));
        assert!(text.contains("orientations = [(0.9274, 0.1, 0.2, 0.3)"));
        assert!(!text.contains("xformOp"));
    }

    #[test]
    fn on_the_map_the_root_stands_at_the_origin() {
        let text = written(&Example::new(2), true);
        assert!(text.contains("double3 xformOp:translate = (256000, 4110000, 350)"));
    }

    #[test]
    fn names_cannot_break_out_of_their_quotes() {
        assert_eq!(quoted("a\"b\\c\nd"), "\"a\\\"b\\\\c d\"");
    }

    #[test]
    fn an_empty_forest_is_a_file() {
        let mut example = Example::new(0);
        example.instances.groups.clear();
        assert!(written(&example, true).contains("def Mesh \"Terrain\""));
    }
}
