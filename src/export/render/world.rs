//! The world of a picture: instances, ground, and the colours of everything in the season that is asked for.

use super::draw_list::{Item, ModelBounds};
use super::foliage::LeafLook;
use super::ground::Ground;
use super::noise;
use super::vector::{LUMINANCE, Vec3, vec3};
use crate::export::instances::{FeatureTable, InstanceGroup, Instances};
use crate::math;
use crate::species::{Biome, LeafHabit, Species};
use crate::tree::mesh::Material;

/// Time of the year.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Season {
    /// Full leaf.
    #[default]
    Summer,
    /// Winter-deciduous plants in colour.
    Autumn,
    /// Winter-deciduous plants bare.
    Winter,
    /// Fresh leaves.
    Spring,
}

impl Season {
    /// Every season, in the order of the year from summer.
    pub const ALL: [Self; 4] = [Self::Summer, Self::Autumn, Self::Winter, Self::Spring];

    /// Its name in flags.
    pub fn name(self) -> &'static str {
        match self {
            Self::Summer => "summer",
            Self::Autumn => "autumn",
            Self::Winter => "winter",
            Self::Spring => "spring",
        }
    }

    /// The season of a name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|season| season.name() == name)
    }
}

/// What is drawn, ready to be looked up.
pub struct World<'a> {
    /// Who stands where.
    pub instances: &'a Instances,
    /// Boxes of archetypes.
    pub bounds: Vec<ModelBounds>,
    /// The terrain.
    pub ground: Ground,
    /// Leaves of each species.
    pub leaves: Vec<LeafLook>,
    /// Height of the tallest instance, m.
    pub tallest_m: f32,
    /// The season.
    pub season: Season,
    /// Whether a species sheds its leaves in winter.
    is_deciduous: Vec<bool>,
    /// Colours in linear light by species, decay class (0 of live plants) and material.
    palette: Vec<[[Vec3; 4]; 6]>,
    /// Decay classes of rows of snags and of downed logs.
    decay_classes: [&'a [u8]; 2],
    /// Colours that stand for a figure, by group and instance; natural ones where there are none.
    pub painted: Option<Vec<Vec<Vec3>>>,
    /// Whether plants are drawn without leaves, so that deadwood among them is seen.
    pub is_leafless: bool,
}

/// A colour channel in linear light.
fn linear(byte: u8) -> f32 {
    let v = f32::from(byte) / 255.0;
    if v <= 0.04045 { v / 12.92 } else { math::powf((v + 0.055) / 1.055, 2.4) }
}

/// An sRGB colour in linear light.
pub fn linear_rgb([r, g, b]: [u8; 3]) -> Vec3 {
    vec3(linear(r), linear(g), linear(b))
}

/// Saturation of a crown over that of its leaves. chosen: beside aerial photographs.
const CROWN_COLOURFULNESS: f32 = 0.87;

const MATERIALS: [Material; 4] =
    [Material::Bark, Material::Foliage, Material::Wood, Material::Soil];

impl<'a> World<'a> {
    /// A world of instances on a ground.
    pub fn new(
        instances: &'a Instances,
        ground: Ground,
        biome: &Biome,
        decay_classes: [&'a [u8]; 2],
        season: Season,
    ) -> Self {
        let palette = biome.species.iter().map(|species| {
            let of_class = |class: u8| {
                MATERIALS.map(|material| linear_rgb(material.base_color_srgb(species, class)))
            };
            [0, 1, 2, 3, 4, 5].map(of_class)
        });
        let tallest_m = instances
            .groups
            .iter()
            .filter(|group| group.table != FeatureTable::DownedLogs)
            .flat_map(|group| &group.scale)
            .fold(0.0_f32, |tallest, scale| tallest.max(scale[2]));
        Self {
            instances,
            bounds: instances.archetypes.iter().map(ModelBounds::of).collect(),
            ground,
            leaves: biome.species.iter().map(LeafLook::of).collect(),
            tallest_m,
            season,
            is_deciduous: biome
                .species
                .iter()
                .map(|species: &Species| species.leaf_habit == LeafHabit::WinterDeciduous)
                .collect(),
            palette: palette.collect(),
            decay_classes,
            painted: None,
            is_leafless: false,
        }
    }

    /// The species of a group.
    #[inline]
    pub fn species(&self, group: &InstanceGroup) -> usize {
        usize::from(self.instances.archetypes[group.archetype].species)
    }

    /// Whether plants of a group bear leaves in this season.
    #[inline]
    pub fn group_has_leaves(&self, group: &InstanceGroup) -> bool {
        let is_shed = self.season == Season::Winter && self.is_deciduous[self.species(group)];
        !self.is_leafless && !is_shed
    }

    /// What plants of a group bear in this season: leaves, or twigs where they are shed; nothing where leaves are left out.
    #[inline]
    pub fn foliage(&self, group: &InstanceGroup) -> Option<&LeafLook> {
        if self.is_leafless {
            None
        } else if self.group_has_leaves(group) {
            Some(&self.leaves[self.species(group)])
        } else {
            Some(&LeafLook::TWIGS)
        }
    }

    /// Whether an instance bears leaves in this season.
    #[inline]
    pub fn has_leaves(&self, item: &Item) -> bool {
        self.group_has_leaves(&self.instances.groups[item.group as usize])
    }

    /// Colour of a part of an instance, linear.
    #[inline]
    pub fn color(&self, item: &Item, material: Material) -> Vec3 {
        let group = &self.instances.groups[item.group as usize];
        let index = item.index as usize;
        if let Some(painted) = &self.painted {
            let color = painted[item.group as usize][index];
            return if material == Material::Foliage { color } else { color * 0.7 };
        }
        let class = usize::from(self.decay_class(item));
        let species = self.species(group);
        let place = MATERIALS.iter().position(|m| *m == material).unwrap_or(0);
        let base = self.palette[species][class][place];
        // a product of codes is near enough to one of light for tints around 255
        let [r, g, b] = group.tint_srgb[index].map(|byte| f32::from(byte) / 255.0);
        let tinted = base * vec3(r * r, g * g, b * b);
        if material == Material::Foliage {
            let color = self.in_season(tinted, species, item);
            // a crown's leaves face all ways and shade each other: less colourful than one leaf
            Vec3::splat(color.dot(LUMINANCE)).lerp(color, CROWN_COLOURFULNESS)
        } else {
            tinted
        }
    }

    /// Decay class of an instance, 0 of live plants.
    #[inline]
    pub fn decay_class(&self, item: &Item) -> u8 {
        let group = &self.instances.groups[item.group as usize];
        let row = group.row[item.index as usize] as usize; // rows fit into memory
        let classes = match group.table {
            FeatureTable::Plants => return 0,
            FeatureTable::Snags => self.decay_classes[0],
            FeatureTable::DownedLogs => self.decay_classes[1],
        };
        classes.get(row).copied().unwrap_or(1).clamp(1, 5)
    }

    /// Leaves' colour in the season.
    fn in_season(&self, green: Vec3, species: usize, item: &Item) -> Vec3 {
        if !self.is_deciduous[species] {
            return green;
        }
        let [a, b, c, _] = noise::four(noise::hash2(item.index ^ 0xa5a5, item.group));
        match self.season {
            Season::Summer => green,
            // twigs
            Season::Winter => vec3(0.105, 0.082, 0.066) * (0.75 + 0.5 * a),
            Season::Spring => green * vec3(1.45, 1.35, 0.8),
            Season::Autumn => {
                // chosen: yellow birches, russet oaks and beeches, some still green
                let gold = vec3(0.46, 0.27, 0.035);
                let russet = vec3(0.33, 0.105, 0.025);
                let turned = gold.lerp(russet, a * b + 0.2 * (species % 3) as f32);
                green.lerp(turned, (0.55 + 0.6 * c).min(1.0))
            }
        }
    }
}
