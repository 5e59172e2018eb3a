//! Target shares: which part of the canopy each species is asked to take.
//!
//! # Reference
//! Kapp et al. 2020, section 5.1: target occupancy t_s, for the whole landscape or a brush's region.

use std::collections::BTreeMap;

use serde::ser::{Serialize, SerializeMap, Serializer};

use crate::species::Biome;

/// Sums this near to 1 count as 1. chosen: shares are written with two or three digits (0.33 × 3 is 0.99, which
/// leaves 1 % to other species; 0.333 × 3 does not).
pub const FULL_SUM_TOLERANCE: f64 = 0.005;

/// What is wrong with target shares.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
#[allow(missing_docs, reason = "the message tells what the fields are")]
pub enum ShareError {
    /// Not `species=share`.
    #[error("`{text}` is no share; write species=share, as in redwood=0.4,douglas-fir=0.3")]
    Unreadable { text: String },
    /// A species named twice.
    #[error("species `{species}` has two shares; give one")]
    Twice { species: String },
    /// The biome has no such species.
    #[error("biome {biome} has no species `{species}`; its canopy species are {canopy}")]
    Unknown { species: String, biome: String, canopy: String },
    /// The species lives in the undergrowth alone.
    #[error(
        "species `{species}` of biome {biome} grows in the undergrowth alone; the canopy species are {canopy}"
    )]
    NotCanopy { species: String, biome: String, canopy: String },
    /// Not within 0 and 1.
    #[error(
        "the share of `{species}` is {share}, not between 0 and 1 (0.4 is 40 %); the canopy species of biome {biome} are {canopy}"
    )]
    OutOfRange { species: String, share: f64, biome: String, canopy: String },
    /// More than all of it.
    #[error("the shares of {species} sum to {sum:.3}, more than 1; lower some of them")]
    TooMuch { species: String, sum: f64 },
}

/// One species' target.
#[derive(Clone, Debug, PartialEq)]
struct Share {
    key: String,
    species: usize,
    fraction: f64,
}

/// Target shares that a biome can serve: known canopy species, each once, in sum at most 1.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Shares(Vec<Share>);

impl Shares {
    /// Shares by species key.
    ///
    /// # Errors
    /// [`ShareError`] for species that the biome's canopy does not have, shares outside 0..=1, sums above 1.
    pub fn new(by_key: &BTreeMap<String, f64>, biome: &Biome) -> Result<Self, ShareError> {
        let canopy = || {
            let keys = biome.canopy_species().map(|index| biome.species[index].key.as_str());
            keys.collect::<Vec<_>>().join(", ")
        };
        let mut shares = Vec::with_capacity(by_key.len());
        for (key, &fraction) in by_key {
            let (species, biome_key) = (key.clone(), biome.key.clone());
            let Some(index) = biome.species_index(key) else {
                return Err(ShareError::Unknown { species, biome: biome_key, canopy: canopy() });
            };
            if !biome.species[index].can_be_canopy() {
                return Err(ShareError::NotCanopy { species, biome: biome_key, canopy: canopy() });
            }
            if !(0.0..=1.0).contains(&fraction) {
                let (share, biome) = (fraction, biome_key);
                return Err(ShareError::OutOfRange { species, share, biome, canopy: canopy() });
            }
            shares.push(Share { key: key.clone(), species: index, fraction });
        }
        shares.sort_by_key(|share| share.species);
        let shares = Self(shares);
        let sum = shares.sum();
        if sum > 1.0 + FULL_SUM_TOLERANCE {
            let species = by_key.keys().map(String::as_str).collect::<Vec<_>>().join(", ");
            return Err(ShareError::TooMuch { species, sum });
        }
        Ok(shares)
    }

    /// Shares as a flag gives them: `redwood=0.4,douglas-fir=0.3`.
    ///
    /// # Errors
    /// As [`Shares::new`], and for text of another form.
    pub fn parse(text: &str, biome: &Biome) -> Result<Self, ShareError> {
        let mut by_key = BTreeMap::new();
        for part in text.split(',').map(str::trim).filter(|part| !part.is_empty()) {
            let unreadable = || ShareError::Unreadable { text: part.to_owned() };
            let (key, fraction) = part.split_once('=').ok_or_else(unreadable)?;
            let fraction = fraction.trim().parse().map_err(|_| unreadable())?;
            let key = key.trim().to_owned();
            if by_key.insert(key.clone(), fraction).is_some() {
                return Err(ShareError::Twice { species: key });
            }
        }
        Self::new(&by_key, biome)
    }

    /// Whether no species has a target.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The target of a species by its index in the biome, 0..=1; `None` where it has none.
    pub fn of(&self, species: usize) -> Option<f64> {
        self.0.iter().find(|share| share.species == species).map(|share| share.fraction)
    }

    /// Sum of all targets.
    pub fn sum(&self) -> f64 {
        self.0.iter().map(|share| share.fraction).sum()
    }

    /// Whether the targets take all of the canopy.
    pub fn is_full(&self) -> bool {
        (self.sum() - 1.0).abs() <= FULL_SUM_TOLERANCE
    }
}

impl Serialize for Shares {
    /// As a table of species keys, the way users write it.
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(self.0.len()))?;
        for share in &self.0 {
            map.serialize_entry(&share.key, &share.fraction)?;
        }
        map.end()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Shares, ShareError> {
        Shares::parse(text, &Biome::builtin("sonoma").unwrap())
    }

    #[test]
    fn shares_are_read_by_key() {
        let shares = parse(" redwood = 0.4, douglas-fir=0.3,").unwrap();
        let biome = Biome::builtin("sonoma").unwrap();
        assert_eq!(shares.of(biome.species_index("redwood").unwrap()), Some(0.4));
        assert_eq!(shares.of(biome.species_index("gray-pine").unwrap()), None);
        assert!(!shares.is_full() && !shares.is_empty());
        assert!(parse("redwood=0.666,gray-pine=0.333").unwrap().is_full());
        assert!(parse("").unwrap().is_empty());
        assert_eq!(toml::to_string(&shares).unwrap(), "douglas-fir = 0.3\nredwood = 0.4\n");
    }

    #[test]
    fn errors_name_the_species_and_what_the_biome_has() {
        let message = |text: &str| parse(text).unwrap_err().to_string();
        for text in ["spruce=0.4", "tanoak=0.4", "redwood=-0.1", "redwood=nan", "redwood=40"] {
            let (message, key) = (message(text), text.split('=').next().unwrap());
            assert!(message.contains(&format!("`{key}`")), "{message}");
            assert!(
                message.contains("coast-live-oak") && message.contains("gray-pine"),
                "{message}"
            );
        }
        let too_much = message("redwood=0.6,douglas-fir=0.6");
        assert!(too_much.contains("douglas-fir, redwood sum to 1.200"), "{too_much}");
        assert!(message("redwood").contains("species=share"));
        assert!(message("redwood=much").contains("species=share"));
        assert!(message("redwood=0.1,redwood=0.2").contains("two shares"));
    }
}
