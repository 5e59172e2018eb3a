//! A scene as lists of points for engines and Houdini: a table and a JSON list of who stands where, how turned and how large.
//!
//! The folder holds `points.csv`, `points.json` (the same, as records) and `models.csv` (what every `mesh` is). One row an instance:
//!
//! | column | |
//! |---|---|
//! | `id`, `table` | feature, and the table that it is a row of |
//! | `mesh` | key of the model, also the name of its node in a `.glb` of the same selection |
//! | `species`, `kind` | species, and what it is: canopy, undergrowth, snag, or kind of downed log |
//! | `x`, `y`, `z` | place, in the flavour's axes and unit |
//! | `qx`, `qy`, `qz`, `qw` | turn, a unit quaternion in the flavour's axes |
//! | `yaw_deg` | the turn about the upright alone, by the flavour's own sense |
//! | `sx`, `sy`, `sz` | factors of a model that is one unit large, along the flavour's axes |
//! | `tint_r`, `tint_g`, `tint_b` | what colours are multiplied with, 0–1, sRGB |
//! | `size_m`, `years` | height or length; years since germination, death or fall |
//! | `decay_class` | 1–5, 0 for live plants |
//!
//! | flavour | axes | unit |
//! |---|---|---|
//! | `houdini` | right-handed, y up: east, up, south | metre |
//! | `unity` | left-handed, y up: east, up, north | metre |
//! | `unreal` | left-handed, z up: east, south, up | centimetre |
//!
//! Models are metres in all flavours: an engine that imports them in its own unit applies the factors as they are.

use std::io::{self, Write};

use super::decimal_text::{push_decimal, push_whole};
use super::instances::{FeatureTable, InstanceGroup};
use super::scene3d::Scene3d;
use super::text_pieces::TextPieces;
use crate::math;

/// Axes and unit of a list of points.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Flavour {
    /// East, up, south in metres.
    #[default]
    Houdini,
    /// East, up, north in metres: left-handed.
    Unity,
    /// East, south, up in centimetres: left-handed.
    Unreal,
}

/// An instance in a flavour's axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Place, in the flavour's unit.
    pub place: [f32; 3],
    /// Turn, a unit quaternion x, y, z, w.
    pub turn: [f32; 4],
    /// Turn about the upright, degrees, by the flavour's sense.
    pub yaw_deg: f32,
    /// Factors along the axes.
    pub scale: [f32; 3],
}

impl Flavour {
    /// Every flavour.
    pub const ALL: [Self; 3] = [Self::Houdini, Self::Unity, Self::Unreal];

    /// The flavour's name in flags.
    pub fn name(self) -> &'static str {
        match self {
            Self::Houdini => "houdini",
            Self::Unity => "unity",
            Self::Unreal => "unreal",
        }
    }

    /// The flavour of a name in a flag.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|flavour| flavour.name() == name)
    }

    /// Units in a metre.
    fn units_per_m(self) -> f32 {
        match self {
            Self::Houdini | Self::Unity => 1.0,
            Self::Unreal => 100.0,
        }
    }

    /// East, north, up in the flavour's axes.
    fn axes(self, [east, north, up]: [f32; 3]) -> [f32; 3] {
        match self {
            Self::Houdini => [east, up, -north],
            Self::Unity => [east, up, north],
            Self::Unreal => [east, -north, up],
        }
    }

    /// An instance in this flavour.
    pub fn point(self, group: &InstanceGroup, i: usize) -> Point {
        let [x, y, z, w] = group.rotation[i];
        // an axis of rotation is a vector that changes its sign with the handedness of the axes
        let mirrored = if self == Self::Houdini { 1.0 } else { -1.0 };
        let [qx, qy, qz] = self.axes([x, y, z]).map(|part| mirrored * part);
        // counter-clockwise from above, about the upright axis as it is in the flavour
        let yaw_rad = math::atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z));
        let [sx, sy, sz] = group.scale[i];
        let scale = match self {
            Self::Houdini | Self::Unity => [sx, sz, sy],
            Self::Unreal => [sx, sy, sz],
        };
        Point {
            place: self.axes(group.position_m[i]).map(|metres| metres * self.units_per_m()),
            turn: [qx, qy, qz, w],
            yaw_deg: mirrored * yaw_rad.to_degrees(),
            scale,
        }
    }
}

/// Columns in order.
pub const COLUMNS: [&str; 22] = [
    "id",
    "table",
    "mesh",
    "species",
    "kind",
    "x",
    "y",
    "z",
    "qx",
    "qy",
    "qz",
    "qw",
    "yaw_deg",
    "sx",
    "sy",
    "sz",
    "tint_r",
    "tint_g",
    "tint_b",
    "size_m",
    "years",
    "decay_class",
];

/// What stands between the values of a row.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Style {
    Csv,
    Json,
}

/// A row under way.
struct Row<'a> {
    out: &'a mut Vec<u8>,
    style: Style,
    column: usize,
}

impl Row<'_> {
    fn next(&mut self) {
        if self.column > 0 {
            self.out.push(b',');
        }
        if self.style == Style::Json {
            self.out.push(b'"');
            self.out.extend_from_slice(COLUMNS[self.column].as_bytes());
            self.out.extend_from_slice(b"\":");
        }
        self.column += 1;
    }

    /// A key of letters, digits, hyphens and points.
    fn word(&mut self, word: &str) {
        self.next();
        let quote: &[u8] = if self.style == Style::Json { b"\"" } else { b"" };
        self.out.extend_from_slice(quote);
        self.out.extend_from_slice(word.as_bytes());
        self.out.extend_from_slice(quote);
    }

    fn number(&mut self, number: f32, decimals: usize) {
        self.next();
        push_decimal(self.out, number, decimals);
    }

    fn whole(&mut self, number: u64) {
        self.next();
        push_whole(self.out, number);
    }
}

/// Writes `points.csv`.
///
/// # Errors
/// Whatever writing gives.
pub fn write_csv(out: &mut dyn Write, scene: &Scene3d<'_>, flavour: Flavour) -> io::Result<()> {
    let mut pieces = TextPieces::default();
    pieces.text(format!("{}\n", COLUMNS.join(",")));
    for table in FeatureTable::ALL {
        for (_, group) in scene.named_groups(table) {
            rows(&mut pieces, scene, group, flavour, Style::Csv);
            pieces.text("\n");
        }
    }
    pieces.write(out)
}

/// Writes `points.json`: what the axes are, and the rows as records.
///
/// # Errors
/// Whatever writing gives.
pub fn write_json(out: &mut dyn Write, scene: &Scene3d<'_>, flavour: Flavour) -> io::Result<()> {
    let mut pieces = TextPieces::default();
    let head = serde_json::json!({
        "flavour": flavour.name(),
        "units_per_metre": flavour.units_per_m(),
        "crs": scene.crs.to_string(),
        "origin": scene.instances.origin,
    });
    let head = head.to_string();
    pieces.text(format!("{},\"points\":[\n", &head[..head.len() - 1]));
    let mut is_first = true;
    for table in FeatureTable::ALL {
        for (_, group) in scene.named_groups(table) {
            if !is_first {
                pieces.text(",\n");
            }
            is_first = false;
            rows(&mut pieces, scene, group, flavour, Style::Json);
        }
    }
    pieces.text("\n]}\n");
    pieces.write(out)
}

/// Writes `models.csv`: the keys of meshes, with the number of their instances.
///
/// # Errors
/// Whatever writing gives.
pub fn write_models(out: &mut dyn Write, scene: &Scene3d<'_>) -> io::Result<()> {
    writeln!(out, "mesh,table,species,scientific_name,instances")?;
    for table in FeatureTable::ALL {
        for (_, group) in scene.named_groups(table) {
            let archetype = &scene.instances.archetypes[group.archetype];
            let species = &scene.biome.species[usize::from(archetype.species)];
            writeln!(
                out,
                "{},{},{},\"{}\",{}",
                archetype.key,
                table.name(),
                species.key,
                species.scientific_name.replace('"', "\"\""),
                group.row.len()
            )?;
        }
    }
    Ok(())
}

fn rows<'a>(
    pieces: &mut TextPieces<'a>,
    scene: &Scene3d<'a>,
    group: &'a InstanceGroup,
    flavour: Flavour,
    style: Style,
) {
    let table = group.table;
    let archetype = &scene.instances.archetypes[group.archetype];
    let species = scene.biome.species[usize::from(archetype.species)].key.as_str();
    let (ids, measures, scene) = (scene.ids(table), scene.measures(table), *scene);
    let separator = if style == Style::Json { ",\n" } else { "\n" };
    pieces.entries(group.row.len(), separator, move |out, i| {
        let row = group.row[i] as usize;
        let point = flavour.point(group, i);
        if style == Style::Json {
            out.push(b'{');
        }
        let mut text = Row { out, style, column: 0 };
        text.whole(ids[row]);
        text.word(table.name());
        text.word(&archetype.key);
        text.word(species);
        text.word(scene.kind(table, row));
        let place_decimals = if flavour == Flavour::Unreal { 1 } else { 3 };
        point.place.iter().for_each(|at| text.number(*at, place_decimals));
        point.turn.iter().for_each(|part| text.number(*part, 5));
        text.number(point.yaw_deg, 2);
        point.scale.iter().for_each(|factor| text.number(*factor, 4));
        group.tint_srgb[i].iter().for_each(|c| text.number(f32::from(*c) / 255.0, 3));
        measures.iter().take(2).for_each(|m| text.number(m.values[row], m.decimals));
        text.whole(u64::from(scene.decay_class(table, row)));
        if style == Style::Json {
            out.push(b'}');
        }
    });
}

#[cfg(test)]
mod tests {
    use super::super::example3d::Example;
    use super::super::instance_bounds::rotation_matrix;
    use super::*;

    #[test]
    fn flavours_turn_vectors_as_the_scene_does() {
        let mut example = Example::new(2);
        let group = &mut example.instances.groups[0];
        group.rotation[0] = [0.182_574, 0.365_148, 0.547_723, 0.730_297];
        let turn = rotation_matrix(group.rotation[0]);
        let turned = |matrix: [[f32; 3]; 3], v: [f32; 3]| -> [f32; 3] {
            std::array::from_fn(|a| (0..3).map(|b| matrix[a][b] * v[b]).sum())
        };
        for flavour in Flavour::ALL {
            let point = flavour.point(group, 0);
            for v in [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.3, -0.2, 0.9]] {
                // turned in the scene, then seen in the flavour's axes; and the other way round
                let expected = flavour.axes(turned(turn, v));
                let found = turned(rotation_matrix(point.turn), flavour.axes(v));
                assert!(
                    found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-5),
                    "{flavour:?}"
                );
            }
        }
    }

    #[test]
    fn yaw_is_counter_clockwise_where_axes_are_right_handed() {
        let mut example = Example::new(2);
        let group = &mut example.instances.groups[0];
        let half = 0.5_f32.sqrt();
        group.rotation[0] = [0.0, 0.0, half, half];
        let yaw = Flavour::ALL.map(|flavour| flavour.point(group, 0).yaw_deg.round());
        assert_eq!(yaw, [90.0, -90.0, -90.0]);
        group.position_m[0] = [1.0, 2.0, 3.0];
        let places = Flavour::ALL.map(|flavour| flavour.point(group, 0).place);
        assert_eq!(places, [[1.0, 3.0, -2.0], [1.0, 3.0, 2.0], [100.0, -200.0, 300.0]]);
    }

    #[test]
    fn both_lists_hold_every_row() {
        let example = Example::new(33);
        let (mut csv, mut json, mut models) = (Vec::new(), Vec::new(), Vec::new());
        write_csv(&mut csv, &example.scene(), Flavour::Unity).unwrap();
        write_json(&mut json, &example.scene(), Flavour::Unity).unwrap();
        write_models(&mut models, &example.scene()).unwrap();
        let csv = String::from_utf8(csv).unwrap();
        assert!(csv.lines().all(|line| line.split(',').count() == COLUMNS.len()));
        assert_eq!(csv.lines().count(), 1 + 33 + 4 + 4);
        let json: serde_json::Value = serde_json::from_slice(&json).unwrap();
        assert_eq!(json["points"].as_array().unwrap().len(), 41);
        let first = &json["points"][0];
        assert_eq!(first["mesh"], "coast-live-oak.tree.forest.s0");
        assert_eq!(first["size_m"].as_f64(), Some(1.0));
        assert_eq!(String::from_utf8(models).unwrap().lines().count(), 5);
        assert_eq!(Flavour::from_name("unreal"), Some(Flavour::Unreal));
    }
}
