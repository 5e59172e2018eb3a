//! Materials of models in 3D formats: names, and colours in light.

use super::scene3d::identifier;
use crate::species::Biome;
use crate::tree::archetype::Archetype;
use crate::tree::mesh::Material;

/// Bare soil and litter between plants, sRGB. chosen: a dry brown that lets foliage stand out.
pub const GROUND_SRGB: [u8; 3] = [112, 98, 74];

/// A name for a material of a model, of letters, digits and underscores; equal names mean equal colours.
pub fn material_name(archetype: &Archetype, material: Material, biome: &Biome) -> String {
    let species = identifier(&biome.species[usize::from(archetype.species)].key);
    let [r, g, b] = archetype.color_srgb(material);
    format!("{species}_{}_{r:02x}{g:02x}{b:02x}", material.name())
}

/// A channel of a colour in light, 0..=1.
///
/// # Reference
/// IEC 61966-2-1 (sRGB).
pub fn linear(channel_srgb: u8) -> f32 {
    let coded = f32::from(channel_srgb) / 255.0;
    if coded <= 0.04045 { coded / 12.92 } else { crate::math::powf((coded + 0.055) / 1.055, 2.4) }
}

/// Light of every coded channel.
pub fn linear_table() -> [f32; 256] {
    std::array::from_fn(|channel| linear(channel as u8)) // below 256
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_of_codes_is_that_of_srgb() {
        assert_eq!((linear(0), linear(255)), (0.0, 1.0));
        assert!((linear(188) - 0.5029).abs() < 1e-3);
        assert!((linear(10) - 0.003_035).abs() < 1e-5);
        assert_eq!(linear_table()[77], linear(77));
    }

    #[test]
    fn names_tell_species_material_and_colour() {
        let example = super::super::example3d::Example::new(1);
        let pine = &example.instances.archetypes[0];
        let name = material_name(pine, Material::Foliage, &example.biome);
        assert_eq!(name, "coast_live_oak_foliage_3c5a32");
    }
}
