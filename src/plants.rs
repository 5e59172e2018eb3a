//! Living plants of a scene: one array a measure.

pub mod buckets;
mod checks;
pub mod deadwood;
pub mod downed_logs_table;
pub mod history_tables;
pub mod snags_table;
pub mod table;

use crate::species::Biome;

/// Which layer of the forest a plant belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Layer {
    /// Trees whose crowns the sky sees.
    Canopy,
    /// Everything beneath them.
    Undergrowth,
}

impl Layer {
    /// Every layer, in the order of their numbers.
    pub const ALL: [Self; 2] = [Self::Canopy, Self::Undergrowth];

    /// The layer's name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Canopy => "canopy",
            Self::Undergrowth => "undergrowth",
        }
    }

    /// The layer of a name in a file.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|layer| layer.name() == name)
    }
}

/// Living plants, struct of arrays: the arrays are of one length, one plant an index.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Plants {
    /// Stable and unique in a scene; below 2⁶³, for the sake of programs that know signed numbers only.
    pub id: Vec<u64>,
    /// Index into the biome's species.
    pub species: Vec<u16>,
    /// Layer of the forest.
    pub layer: Vec<Layer>,
    /// Metres east of the scene's south-west corner.
    pub east_m: Vec<f32>,
    /// Metres north of the scene's south-west corner.
    pub north_m: Vec<f32>,
    /// Elevation of the ground at the trunk.
    pub z_m: Vec<f32>,
    /// Height above ground.
    pub height_m: Vec<f32>,
    /// Crown radius.
    pub crown_radius_m: Vec<f32>,
    /// Stem diameter at breast height.
    pub dbh_m: Vec<f32>,
    /// Idealized age: years of unhindered growth to this height.
    pub age_years: Vec<f32>,
    /// Suitability of the site, −0.2..=1.
    pub vigor: Vec<f32>,
}

impl Plants {
    /// Number of plants.
    pub fn len(&self) -> usize {
        self.id.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.id.is_empty()
    }

    /// Adds other plants after these.
    pub fn append(&mut self, other: Self) {
        self.id.extend(other.id);
        self.species.extend(other.species);
        self.layer.extend(other.layer);
        self.east_m.extend(other.east_m);
        self.north_m.extend(other.north_m);
        self.z_m.extend(other.z_m);
        self.height_m.extend(other.height_m);
        self.crown_radius_m.extend(other.crown_radius_m);
        self.dbh_m.extend(other.dbh_m);
        self.age_years.extend(other.age_years);
        self.vigor.extend(other.vigor);
    }

    /// Number of plants of each species of `biome`, in its order.
    pub fn count_by_species(&self, biome: &Biome) -> Vec<usize> {
        let mut counts = vec![0; biome.species.len()];
        for &species in &self.species {
            counts[usize::from(species)] += 1;
        }
        counts
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn layers_keep_their_names() {
        for layer in Layer::ALL {
            assert_eq!(Layer::from_name(layer.name()), Some(layer));
        }
        assert_eq!(Layer::from_name("Canopy"), None);
    }
}
