//! Colours of surfaces in 3D formats.

use crate::species::Biome;
use crate::tree::mesh::Material;

/// Bare soil and litter between plants, sRGB. chosen: a dry brown that lets foliage stand out.
pub const GROUND_SRGB: [u8; 3] = [112, 98, 74];

impl Material {
    /// Every material, in the order of their numbers.
    pub const ALL: [Self; 4] = [Self::Bark, Self::Foliage, Self::Wood, Self::Soil];

    /// The material's name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Bark => "bark",
            Self::Foliage => "foliage",
            Self::Wood => "wood",
            Self::Soil => "soil",
        }
    }
}

/// Colour of a material on a species, sRGB.
pub fn color_srgb(material: Material, species: u16, biome: &Biome) -> [u8; 3] {
    match material {
        Material::Foliage => biome.species[usize::from(species)].color_srgb,
        Material::Bark => [92, 76, 62],    // chosen: grey-brown
        Material::Wood => [158, 142, 120], // chosen: weathered wood, paler than bark
        Material::Soil => [84, 66, 48],    // chosen: fresh soil, darker than the ground
    }
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
    fn foliage_has_the_colour_of_its_species() {
        let biome = Biome::builtin("sonoma").unwrap();
        assert_eq!(color_srgb(Material::Foliage, 3, &biome), biome.species[3].color_srgb);
        let names: Vec<&str> = Material::ALL.map(Material::name).to_vec();
        assert_eq!(names, ["bark", "foliage", "wood", "soil"]);
    }
}
