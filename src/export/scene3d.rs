//! A scene as 3D formats see it: ground, instances, and what the tables say of each of them.

use super::instances::{FeatureTable, InstanceGroup, Instances};
use super::terrain_mesh::TerrainMesh;
use crate::plants::Plants;
use crate::plants::deadwood::{DownedLogs, Snags};
use crate::raster::Crs;
use crate::species::Biome;
use crate::tree::archetype::LEVELS;

/// What a 3D format is written from. Rows of groups count in the tables given here.
#[derive(Clone, Copy)]
pub struct Scene3d<'a> {
    /// The scene's name.
    pub name: &'a str,
    /// System of map coordinates.
    pub crs: &'a Crs,
    /// Species.
    pub biome: &'a Biome,
    /// Ground, in metres from the instances' origin.
    pub terrain: &'a TerrainMesh,
    /// Who stands where.
    pub instances: &'a Instances,
    /// Live plants.
    pub plants: &'a Plants,
    /// Snags.
    pub snags: &'a Snags,
    /// Downed logs.
    pub downed_logs: &'a DownedLogs,
}

/// A level of detail of models.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Lod {
    /// For a walk in the forest.
    Near,
    /// For a forest over a valley.
    Middle,
    /// For a forest on the horizon.
    Far,
}

/// Most instances that are written near by default. chosen: what editors still turn fluently.
pub const MOST_NEAR_INSTANCES: usize = 20_000;

impl Lod {
    /// Every level, the finest first, in the order of an archetype's.
    pub const ALL: [Self; LEVELS] = [Self::Near, Self::Middle, Self::Far];

    /// The level's name in flags and files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Near => "near",
            Self::Middle => "middle",
            Self::Far => "far",
        }
    }

    /// The level of a name in a flag.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|level| level.name() == name)
    }

    /// The level for so many instances where none is asked for.
    pub fn for_instances(count: usize) -> Self {
        if count <= MOST_NEAR_INSTANCES { Self::Near } else { Self::Middle }
    }
}

/// A measure of every feature of a table.
#[derive(Clone, Copy)]
pub struct Measure<'a> {
    /// Name, as in the table.
    pub name: &'static str,
    /// Digits behind the point that tell something.
    pub decimals: usize,
    /// A value a row.
    pub values: &'a [f32],
}

impl FeatureTable {
    /// Every table, in the order of files.
    pub const ALL: [Self; 3] = [Self::Plants, Self::Snags, Self::DownedLogs];

    /// What 3D formats call its features together.
    pub fn title(self) -> &'static str {
        match self {
            Self::Plants => "Plants",
            Self::Snags => "Snags",
            Self::DownedLogs => "DownedLogs",
        }
    }
}

/// Measures that formats with few columns keep: size and age.
pub const MAIN_MEASURES: usize = 2;

impl<'a> Scene3d<'a> {
    /// Number of rows of a table.
    pub fn rows(&self, table: FeatureTable) -> usize {
        self.ids(table).len()
    }

    /// Ids of a table's features.
    pub fn ids(&self, table: FeatureTable) -> &'a [u64] {
        match table {
            FeatureTable::Plants => &self.plants.id,
            FeatureTable::Snags => &self.snags.id,
            FeatureTable::DownedLogs => &self.downed_logs.id,
        }
    }

    /// Species of a table's features, indices into the biome's.
    pub fn species(&self, table: FeatureTable) -> &'a [u16] {
        match table {
            FeatureTable::Plants => &self.plants.species,
            FeatureTable::Snags => &self.snags.species,
            FeatureTable::DownedLogs => &self.downed_logs.species,
        }
    }

    /// Measures of a table's features, the first [`MAIN_MEASURES`] a size and an age: since germination, death or fall.
    pub fn measures(&self, table: FeatureTable) -> Vec<Measure<'a>> {
        let measure = |name, decimals, values| Measure { name, decimals, values };
        match table {
            FeatureTable::Plants => vec![
                measure("height_m", 3, &self.plants.height_m),
                measure("age_years", 1, &self.plants.age_years),
                measure("crown_radius_m", 3, &self.plants.crown_radius_m),
                measure("dbh_m", 4, &self.plants.dbh_m),
                measure("vigor", 3, &self.plants.vigor),
            ],
            FeatureTable::Snags => vec![
                measure("height_m", 3, &self.snags.height_m),
                measure("years_dead", 1, &self.snags.years_dead),
                measure("height_at_death_m", 3, &self.snags.height_at_death_m),
                measure("dbh_m", 4, &self.snags.dbh_m),
                measure("branch_fraction", 3, &self.snags.branch_fraction),
            ],
            FeatureTable::DownedLogs => vec![
                measure("length_m", 3, &self.downed_logs.length_m),
                measure("years_down", 1, &self.downed_logs.years_down),
                measure("diameter_base_m", 4, &self.downed_logs.diameter_base_m),
                measure("diameter_tip_m", 4, &self.downed_logs.diameter_tip_m),
            ],
        }
    }

    /// What a feature is: a plant's layer, a snag, or the kind of a downed log.
    pub fn kind(&self, table: FeatureTable, row: usize) -> &'static str {
        match table {
            FeatureTable::Plants => self.plants.layer[row].name(),
            FeatureTable::Snags => "snag",
            FeatureTable::DownedLogs => self.downed_logs.kind[row].name(),
        }
    }

    /// What killed a snag or brought a downed log to the ground; empty for live plants.
    pub fn cause(&self, table: FeatureTable, row: usize) -> &'static str {
        match table {
            FeatureTable::Plants => "",
            FeatureTable::Snags => self.snags.cause[row].name(),
            FeatureTable::DownedLogs => self.downed_logs.cause[row].name(),
        }
    }

    /// Decay class of a snag or downed log, 1–5; 0 for live plants.
    pub fn decay_class(&self, table: FeatureTable, row: usize) -> u8 {
        match table {
            FeatureTable::Plants => 0,
            FeatureTable::Snags => self.snags.decay_class[row],
            FeatureTable::DownedLogs => self.downed_logs.decay_class[row],
        }
    }

    /// Groups of a table, with a name each that is unique in it and made of letters, digits and underscores.
    pub fn named_groups(&self, table: FeatureTable) -> Vec<(String, &'a InstanceGroup)> {
        let mut named: Vec<(String, &InstanceGroup)> = Vec::new();
        for group in self.instances.groups.iter().filter(|g| g.table == table && !g.row.is_empty())
        {
            let key = &self.instances.archetypes[group.archetype].key;
            let mut name = identifier(key);
            if named.iter().any(|(other, _)| *other == name) {
                name = format!("{name}_{}", group.archetype);
            }
            named.push((name, group));
        }
        named
    }
}

/// Letters, digits and underscores of a key, the first no digit.
pub fn identifier(key: &str) -> String {
    let mut name: String =
        key.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
    if name.is_empty() || name.starts_with(|c: char| c.is_ascii_digit()) {
        name.insert(0, '_');
    }
    name
}

#[cfg(test)]
mod tests {
    use super::super::example3d::Example;
    use super::*;

    #[test]
    fn levels_keep_their_names_and_follow_the_number_of_instances() {
        for (place, level) in Lod::ALL.into_iter().enumerate() {
            assert_eq!((Lod::from_name(level.name()), level as usize), (Some(level), place));
        }
        assert_eq!(Lod::from_name("low"), None);
        assert_eq!(
            (Lod::for_instances(20_000), Lod::for_instances(20_001)),
            (Lod::Near, Lod::Middle)
        );
    }

    #[test]
    fn names_of_groups_are_identifiers_and_differ() {
        let mut example = Example::new(50);
        example.instances.archetypes[1].key = "coast.live-oak".to_owned();
        example.instances.archetypes[0].key = "coast-live.oak".to_owned();
        let names: Vec<String> =
            example.scene().named_groups(FeatureTable::Plants).into_iter().map(|n| n.0).collect();
        assert_eq!(names, ["coast_live_oak", "coast_live_oak_1"]);
        assert_eq!(identifier("7-up"), "_7_up");
    }

    #[test]
    fn every_table_has_a_size_and_an_age_first_and_a_value_a_row() {
        let example = Example::new(50);
        let scene = example.scene();
        for table in FeatureTable::ALL {
            let measures = scene.measures(table);
            assert!(measures[0].name.ends_with("_m") && measures[1].name.contains("year"));
            assert!(measures.iter().all(|m| m.values.len() == scene.rows(table)));
            assert!(scene.rows(table) > 0 && !scene.kind(table, 0).is_empty());
            assert_eq!(scene.cause(table, 0).is_empty(), table == FeatureTable::Plants);
            assert_eq!(scene.decay_class(table, 0) == 0, table == FeatureTable::Plants);
            assert_eq!(scene.species(table).len(), scene.rows(table));
        }
    }
}
