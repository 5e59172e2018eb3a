//! Codes of species in four letters, as iLand and EcoViz have them: two of the genus and two of the epithet.

use super::WriteError;
use crate::species::Biome;

/// Code of each species of a biome, in its order: *Abies alba* is `abal`, *Quercus robur* `quro`.
///
/// # Errors
/// If two species have one code, or a botanical name is too short.
pub fn codes(biome: &Biome) -> Result<Vec<String>, WriteError> {
    let mut codes: Vec<String> = Vec::with_capacity(biome.species.len());
    for species in &biome.species {
        let name = &species.scientific_name;
        let refuse = |why: String| WriteError::Refused { what: format!("{name}: {why}") };
        let code = code(name).ok_or_else(|| refuse("no code of four letters".to_owned()))?;
        if let Some(other) = codes.iter().position(|other| *other == code) {
            let other = &biome.species[other].scientific_name;
            return Err(refuse(format!("has the code `{code}` of {other}")));
        }
        codes.push(code);
    }
    Ok(codes)
}

/// The code of a botanical name.
fn code(scientific_name: &str) -> Option<String> {
    let mut words = scientific_name.split_whitespace();
    let mut two = || {
        let word = words.next()?.to_lowercase();
        let letters: String = word.chars().take(2).collect();
        (letters.len() == 2).then_some(letters)
    };
    Some(two()? + &two()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_are_those_of_iland() {
        for (name, expected) in [
            ("Picea abies", "piab"),
            ("Abies alba", "abal"),
            ("Fagus sylvatica", "fasy"),
            ("Quercus robur", "quro"),
            ("Quercus petraea", "qupe"),
            ("Acer pseudoplatanus", "acps"),
            ("Pseudotsuga menziesii", "psme"),
        ] {
            assert_eq!(code(name).as_deref(), Some(expected));
        }
        assert_eq!((code("Quercus"), code("")), (None, None));
    }

    #[test]
    fn no_two_species_of_a_biome_have_one_code() {
        for name in Biome::BUILTIN_NAMES {
            let biome = Biome::builtin(name).unwrap();
            assert_eq!(codes(&biome).unwrap().len(), biome.species.len());
        }
        let mut biome = Biome::builtin("pyrenees").unwrap();
        biome.species[0].scientific_name = biome.species[1].scientific_name.clone();
        assert!(codes(&biome).unwrap_err().to_string().contains("has the code"));
    }
}
