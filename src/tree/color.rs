//! Natural colours of leaves, bark, dead wood and soil; species' colours of maps are no leaf's.

use super::habit::Habit;
use super::mesh::Material;
use crate::species::{Leaf, Species};

/// Greens of needles, broad leaves and fronds, sRGB. chosen: summer foliage in daylight, dark enough that light can brighten it.
const NEEDLE: [f32; 3] = [58.0, 80.0, 52.0];
const BROAD: [f32; 3] = [88.0, 114.0, 54.0];
const FROND: [f32; 3] = [82.0, 118.0, 52.0];
/// How far a map colour that is green shifts that of the leaf. chosen: species stay told apart, and stay green.
const MAP_SHARE: f32 = 0.25;
/// Bare wood by decay class, sRGB: from fresh to silver and, in downed logs, to crumbling brown (class 5).
const WOOD: [[u8; 3]; 5] =
    [[170, 138, 102], [164, 146, 122], [168, 160, 148], [176, 170, 160], [134, 112, 88]];
/// Bark loses its colour after death: share of grey by decay class.
const GREY_SHARE: [f32; 5] = [0.15, 0.3, 0.5, 0.6, 0.6];
const GREY: [f32; 3] = [146.0, 140.0, 132.0];
/// Soil between roots.
const SOIL: [u8; 3] = [88, 66, 48];

/// A leaf green for a species whose genus has none: that of its kind of leaf, nearer to its map colour where that is green.
pub fn leaf_green(species: &Species) -> [u8; 3] {
    let base = match species.leaf {
        Leaf::Needle => NEEDLE,
        Leaf::Broad => BROAD,
        Leaf::Frond => FROND,
    };
    let [r, g, b] = species.color_srgb.map(f32::from);
    let is_green = g > r && g > b;
    let map = if is_green { [r, g, b] } else { base };
    // as dark as the leaf: light and shade come later
    let brightness = (base[0] + base[1] + base[2]) / (map[0] + map[1] + map[2]).max(1.0);
    std::array::from_fn(|k| byte(base[k] + MAP_SHARE * (map[k] * brightness - base[k])))
}

fn byte(value: f32) -> u8 {
    value.round().clamp(0.0, 255.0) as u8 // in range
}

impl Material {
    /// Natural colour of this material of a species, sRGB; `decay_class` is 0 of live plants, else 1–5.
    pub fn base_color_srgb(self, species: &Species, decay_class: u8) -> [u8; 3] {
        let habit = Habit::of(species);
        let class = usize::from(decay_class.clamp(1, 5)) - 1;
        match self {
            Self::Bark if decay_class == 0 => habit.bark_srgb,
            Self::Bark => std::array::from_fn(|k| {
                let live = f32::from(habit.bark_srgb[k]);
                byte(live + GREY_SHARE[class] * (GREY[k] - live))
            }),
            Self::Foliage => habit.foliage_srgb,
            Self::Wood => WOOD[class],
            Self::Soil => SOIL,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::species::Biome;

    #[test]
    fn leaves_are_green_whatever_the_map_says() {
        for name in Biome::BUILTIN_NAMES {
            for species in &Biome::builtin(name).unwrap().species {
                for [r, g, b] in
                    [Material::Foliage.base_color_srgb(species, 0), leaf_green(species)]
                {
                    assert!(g > r && r >= b.saturating_sub(20), "{}: {r} {g} {b}", species.key);
                }
            }
        }
    }

    #[test]
    fn standing_wood_pales_and_soil_is_brown() {
        let sonoma = Biome::builtin("sonoma").unwrap();
        let brightness = |class| {
            let color = Material::Wood.base_color_srgb(&sonoma.species[0], class);
            color.into_iter().map(u32::from).sum::<u32>()
        };
        assert!((1..4).all(|class| brightness(class) < brightness(class + 1)));
        let [r, g, b] = Material::Soil.base_color_srgb(&sonoma.species[0], 5);
        assert!(r > g && g > b);
    }
}
