//! What the tables say of instances, as property tables of a glTF.

use serde_json::{Map, Value, json};

use super::builder::GlbBuilder;
use crate::export::instances::FeatureTable;
use crate::export::scene3d::Scene3d;
use crate::plants::Layer;
use crate::plants::deadwood::{Cause, DownedLogKind};

/// The extension that holds property tables.
pub const STRUCTURAL_METADATA: &str = "EXT_structural_metadata";

/// Rows of the tables that instances stand for, in the order that instances were added.
#[derive(Default)]
pub struct FeatureTables {
    /// A table's rows, tables in the order of their first instance.
    tables: Vec<(FeatureTable, Vec<u32>)>,
}

impl FeatureTables {
    /// Adds rows of a table; gives the number of its property table, and of its first row there.
    pub fn add(&mut self, table: FeatureTable, rows: impl Iterator<Item = u32>) -> (usize, usize) {
        let place = self.tables.iter().position(|(other, _)| *other == table);
        let place = place.unwrap_or_else(|| {
            self.tables.push((table, Vec::new()));
            self.tables.len() - 1
        });
        let all = &mut self.tables[place].1;
        let first = all.len();
        all.extend(rows);
        (place, first)
    }

    /// Writes the property tables.
    pub fn write(&self, glb: &mut GlbBuilder, scene: &Scene3d<'_>) {
        if self.tables.is_empty() {
            return;
        }
        let mut classes = Map::new();
        let mut tables = Vec::new();
        for (table, rows) in &self.tables {
            let mut columns = Columns { glb, rows, class: Map::new(), properties: Map::new() };
            columns.add_all(scene, *table);
            let Columns { class, properties, .. } = columns;
            let name = class_name(*table);
            classes.insert(name.to_owned(), json!({ "properties": class }));
            tables.push(json!({
                "name": table.title(), "class": name, "count": rows.len(), "properties": properties,
            }));
        }
        let schema = json!({ "id": "wildwood", "enums": enums(scene), "classes": classes });
        let value = json!({ "schema": schema, "propertyTables": tables });
        glb.set_extension(STRUCTURAL_METADATA, value);
    }
}

fn class_name(table: FeatureTable) -> &'static str {
    match table {
        FeatureTable::Plants => "plant",
        FeatureTable::Snags => "snag",
        FeatureTable::DownedLogs => "downed_log",
    }
}

/// Words that numbers stand for.
fn enums(scene: &Scene3d<'_>) -> Value {
    let values = |names: Vec<&str>| -> Vec<Value> {
        names
            .iter()
            .zip(0_u16..)
            .map(|(name, value)| json!({ "name": name, "value": value }))
            .collect()
    };
    let species = scene.biome.species.iter().map(|species| species.key.as_str()).collect();
    json!({
        "species": { "valueType": "UINT16", "values": values(species) },
        "layer": { "valueType": "UINT8", "values": values(Layer::ALL.map(Layer::name).to_vec()) },
        "kind": { "valueType": "UINT8", "values": values(DownedLogKind::ALL.map(DownedLogKind::name).to_vec()) },
        "cause": { "valueType": "UINT8", "values": values(Cause::ALL.map(Cause::name).to_vec()) },
    })
}

/// Columns of a property table under way.
struct Columns<'a> {
    glb: &'a mut GlbBuilder,
    rows: &'a [u32],
    class: Map<String, Value>,
    properties: Map<String, Value>,
}

impl Columns<'_> {
    fn add<const BYTES: usize>(
        &mut self,
        name: &str,
        definition: Value,
        value: impl Fn(usize) -> [u8; BYTES],
    ) {
        let rows = self.rows;
        let view = self.glb.view(|bin| {
            bin.reserve(BYTES * rows.len());
            rows.iter().for_each(|row| bin.extend_from_slice(&value(*row as usize)));
        });
        self.class.insert(name.to_owned(), definition);
        self.properties.insert(name.to_owned(), json!({ "values": view }));
    }

    fn add_all(&mut self, scene: &Scene3d<'_>, table: FeatureTable) {
        let number = |component: &str| json!({ "type": "SCALAR", "componentType": component });
        let word = |words: &str| json!({ "type": "ENUM", "enumType": words });
        let (ids, species) = (scene.ids(table), scene.species(table));
        self.add("id", number("UINT64"), |row| ids[row].to_le_bytes());
        self.add("species", word("species"), |row| species[row].to_le_bytes());
        match table {
            FeatureTable::Plants => {
                self.add("layer", word("layer"), |row| [scene.plants.layer[row] as u8]);
            }
            FeatureTable::Snags => {
                self.add("cause", word("cause"), |row| [scene.snags.cause[row] as u8]);
            }
            FeatureTable::DownedLogs => {
                self.add("kind", word("kind"), |row| [scene.downed_logs.kind[row] as u8]);
                self.add("cause", word("cause"), |row| [scene.downed_logs.cause[row] as u8]);
            }
        }
        if table != FeatureTable::Plants {
            self.add("decay_class", number("UINT8"), |row| [scene.decay_class(table, row)]);
        }
        for measure in scene.measures(table) {
            self.add(measure.name, number("FLOAT32"), |row| measure.values[row].to_le_bytes());
        }
    }
}
