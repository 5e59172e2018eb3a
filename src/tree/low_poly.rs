//! The built-in atlas: models of some hundred triangles, made from what species files tell.
//!
//! Every model has three levels of detail:
//!
//! | model | near | middle | far |
//! |---|---|---|---|
//! | tree | 300–800 | ≤ 100 | ≤ 24 |
//! | seedling, sapling, shrub | 200–800 | ≤ 100 | ≤ 24 |
//! | herb | 200–400 | ≤ 100 | ≤ 24 |
//! | snag, stump | 30–600 | ≤ 100 | ≤ 24 |
//! | downed log | 90–300 | ≤ 100 | ≤ 24 |
//!
//! Stems are drawn within 15 % of their diameter at breast height (see [`stem`]), thin ends of downed logs within a tenth of
//! the thick end. Plants lower than [`LOW_M`] have no classes of stems.

use super::archetype::Archetype;
use super::atlas::{Atlas, DownedLogMeasures, Fitting, PlantMeasures, SnagMeasures};
use super::crowns::{self, Build};
use super::downed_logs::{self, DownedLogShape};
use super::herbs;
use super::mesh::{Material, Mesh};
use super::sculptor::Dice;
use super::snags::{self, SnagShape};
use super::stem::{self, BREAST_HEIGHT_M, CLASSES, taper};
use crate::plants::deadwood::DownedLogKind;
use crate::species::{Biome, Form, Leaf, Species};

/// Height below which woody plants are drawn as seedlings and saplings, whose stems have no classes, m. chosen: their stems are
/// thinner than anyone sees.
pub const LOW_M: f32 = 2.0;
/// Greatest height of shrub-trees that are drawn as shrubs, m. chosen: what never grows into the canopy keeps several stems.
const SHRUB_M: f32 = 12.0;
/// Crowding from which a tree is drawn as grown among others.
const CROWDED_FRACTION: f32 = 0.5;
/// Crowding that forms are made for: alone, among others.
const CROWDING: [f32; 2] = [0.0, 1.0];
/// Shares of their height at death that models of snags stand; those at 1 are whole.
const STANDING: [f32; 7] = [1.0, 0.8, 0.6, 0.42, 0.26, 0.12, 0.04];
/// Of them, those that branches are left on.
const BRANCHED: usize = 5;
/// A stem shorter than this share of what it was is broken.
const WHOLE_FRACTION: f32 = 0.98;
/// Least share of its branches that shows. chosen: below two of twenty.
const LEAST_BRANCH_FRACTION: f32 = 0.1;
/// Classes of a downed log's thin end over its thick one: within 10 % of the thick end.
const TIPS: usize = 5;
/// Shapes of each form.
const LOW_VARIANTS: usize = 3;
const TREE_VARIANTS: usize = 3;
const SHRUB_VARIANTS: usize = 2;
const DEAD_VARIANTS: usize = 2;

/// A model of a species.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Model {
    Low { variant: usize },
    Shrub { class: usize, variant: usize },
    Tree { crowding: usize, class: usize, variant: usize },
    BranchedSnag { decay: usize, standing: usize, class: usize, variant: usize },
    BareSnag { decay: usize, standing: usize, variant: usize },
    DownedLog { kind: usize, decay: usize, tip: usize, variant: usize },
}

/// Models of each kind, in the order of their numbers.
const COUNTS: [usize; 6] = [
    LOW_VARIANTS,
    CLASSES * SHRUB_VARIANTS,
    2 * CLASSES * TREE_VARIANTS,
    3 * BRANCHED * CLASSES * DEAD_VARIANTS,
    5 * STANDING.len() * DEAD_VARIANTS,
    4 * 5 * TIPS * DEAD_VARIANTS,
];
const MODELS_PER_SPECIES: usize =
    COUNTS[0] + COUNTS[1] + COUNTS[2] + COUNTS[3] + COUNTS[4] + COUNTS[5];

/// Packs digits of given bases, the first the most significant.
fn pack(digits: &[(usize, usize)]) -> usize {
    digits.iter().fold(0, |number, (digit, base)| number * base + digit)
}

impl Model {
    /// Its number among the models of its species.
    fn number(self) -> usize {
        let (kind, number) = match self {
            Self::Low { variant } => (0, variant),
            Self::Shrub { class, variant } => {
                (1, pack(&[(class, CLASSES), (variant, SHRUB_VARIANTS)]))
            }
            Self::Tree { crowding, class, variant } => {
                (2, pack(&[(crowding, 2), (class, CLASSES), (variant, TREE_VARIANTS)]))
            }
            Self::BranchedSnag { decay, standing, class, variant } => {
                let digits =
                    [(decay, 3), (standing, BRANCHED), (class, CLASSES), (variant, DEAD_VARIANTS)];
                (3, pack(&digits))
            }
            Self::BareSnag { decay, standing, variant } => {
                (4, pack(&[(decay, 5), (standing, STANDING.len()), (variant, DEAD_VARIANTS)]))
            }
            Self::DownedLog { kind, decay, tip, variant } => {
                (5, pack(&[(kind, 4), (decay, 5), (tip, TIPS), (variant, DEAD_VARIANTS)]))
            }
        };
        COUNTS[..kind].iter().sum::<usize>() + number
    }

    /// The model of a number.
    fn of_number(number: usize) -> Self {
        let (mut kind, mut rest) = (0, number);
        while kind + 1 < COUNTS.len() && rest >= COUNTS[kind] {
            rest -= COUNTS[kind];
            kind += 1;
        }
        let mut digit = |base: usize| {
            let digit = rest % base;
            rest /= base;
            digit
        };
        match kind {
            0 => Self::Low { variant: digit(LOW_VARIANTS) },
            1 => {
                let variant = digit(SHRUB_VARIANTS);
                Self::Shrub { variant, class: digit(CLASSES) }
            }
            2 => {
                let variant = digit(TREE_VARIANTS);
                let class = digit(CLASSES);
                Self::Tree { variant, class, crowding: digit(2) }
            }
            3 => {
                let variant = digit(DEAD_VARIANTS);
                let class = digit(CLASSES);
                let standing = digit(BRANCHED);
                Self::BranchedSnag { variant, class, standing, decay: digit(3) }
            }
            4 => {
                let variant = digit(DEAD_VARIANTS);
                let standing = digit(STANDING.len());
                Self::BareSnag { variant, standing, decay: digit(5) }
            }
            _ => {
                let variant = digit(DEAD_VARIANTS);
                let tip = digit(TIPS);
                let decay = digit(5);
                Self::DownedLog { variant, tip, decay, kind: digit(4) }
            }
        }
    }

    /// What tells it from the others of its species by shape; stems of all classes have one shape.
    fn shape_number(self) -> usize {
        match self {
            Self::Shrub { variant, .. } => Self::Shrub { class: 0, variant },
            Self::Tree { crowding, variant, .. } => Self::Tree { crowding, class: 0, variant },
            Self::BranchedSnag { decay, standing, variant, .. } => {
                Self::BranchedSnag { decay, standing, class: 0, variant }
            }
            other => other,
        }
        .number()
    }

    fn decay_class(self) -> u8 {
        match self {
            Self::Low { .. } | Self::Shrub { .. } | Self::Tree { .. } => 0,
            Self::BranchedSnag { decay, .. }
            | Self::BareSnag { decay, .. }
            | Self::DownedLog { decay, .. } => decay as u8 + 1, // below 5
        }
    }

    /// Its part of an archetype's name.
    fn name(self) -> String {
        let letter = |variant: usize| ["a", "b", "c"][variant.min(2)];
        let height = |standing: usize| {
            let share = STANDING[standing];
            if share < WHOLE_FRACTION { format!("h{:02.0}", 100.0 * share) } else { "whole".into() }
        };
        match self {
            Self::Low { variant } => format!("low.{}", letter(variant)),
            Self::Shrub { class, variant } => format!("shrub.s{class}.{}", letter(variant)),
            Self::Tree { crowding, class, variant } => {
                let form = ["open", "forest"][crowding];
                format!("tree.{form}.s{class}.{}", letter(variant))
            }
            Self::BranchedSnag { decay, standing, class, variant } => {
                let (decay, height) = (decay + 1, height(standing));
                format!("snag.d{decay}.{height}.s{class}.{}", letter(variant))
            }
            Self::BareSnag { decay, standing, variant } => {
                format!("snag.d{}.{}.bare.{}", decay + 1, height(standing), letter(variant))
            }
            Self::DownedLog { kind, decay, tip, variant } => {
                let (kind, decay) = (DownedLogKind::ALL[kind].name(), decay + 1);
                format!("downed-log.{kind}.d{decay}.t{}.{}", 20 * tip + 10, letter(variant))
            }
        }
    }
}

/// Whether a species is drawn with several stems.
fn is_shrub(species: &Species) -> bool {
    match species.form {
        Form::Shrub | Form::ShrubVine => true,
        Form::ShrubTree => species.max_height_m < SHRUB_M,
        Form::Herb | Form::Tree => false,
    }
}

/// Models of some hundred triangles for every species of a biome.
#[derive(Clone, Copy, Debug)]
pub struct LowPolyAtlas<'a> {
    biome: &'a Biome,
}

impl<'a> LowPolyAtlas<'a> {
    /// The atlas of a biome.
    pub fn new(biome: &'a Biome) -> Self {
        Self { biome }
    }

    fn number(species: u16, model: Model) -> u32 {
        // some hundred models for each of at most some hundred species
        (usize::from(species) * MODELS_PER_SPECIES + model.number()) as u32
    }

    fn species(&self, index: u16) -> &'a Species {
        &self.biome.species[usize::from(index)]
    }
}

/// The class of a stem of a diameter under a crown of a radius, measured at a share of the model's height.
fn stem_class(dbh_m: f32, radius_m: f32, fraction: f32) -> usize {
    stem::class_of(dbh_m / (radius_m * taper(fraction)).max(1e-6))
}

/// The middle of a class of thin ends.
fn tip_fraction(tip: usize) -> f32 {
    0.1 + 0.2 * tip as f32
}

fn variant(variety: u32, count: usize) -> usize {
    variety as usize % count
}

/// Share of the model's height at which a snag's stem is measured, and how it stands.
fn snag_fraction(snag: &SnagMeasures, standing: usize) -> f32 {
    if snag.height_m > BREAST_HEIGHT_M {
        BREAST_HEIGHT_M / snag.height_m * STANDING[standing]
    } else {
        stem::breast_fraction(snag.height_at_death_m.max(snag.height_m))
    }
}

impl Atlas for LowPolyAtlas<'_> {
    fn model_count(&self) -> usize {
        self.biome.species.len() * MODELS_PER_SPECIES
    }

    fn archetype(&self, model: u32) -> Archetype {
        let index = model as usize / MODELS_PER_SPECIES;
        let model = Model::of_number(model as usize % MODELS_PER_SPECIES);
        let species = &self.biome.species[index];
        let shape = model.shape_number() as u64;
        let dice =
            |detail: usize| Dice::of(name_hash(&species.key) << 16 | shape << 2 | detail as u64);
        let level = |detail: usize| mesh(species, model, &mut dice(detail), detail);
        Archetype {
            key: format!("{}.{}", species.key, model.name()),
            species: index as u16, // a biome's species are counted in u16
            levels: std::array::from_fn(level),
            colors_srgb: Material::ALL.map(|m| m.base_color_srgb(species, model.decay_class())),
        }
    }

    fn plant(&self, plant: &PlantMeasures) -> Fitting {
        let species = self.species(plant.species);
        let variety = plant.variety;
        let class = || {
            let fraction = stem::breast_fraction(plant.height_m);
            stem_class(plant.dbh_m, plant.crown_radius_m, fraction)
        };
        let model = if species.form == Form::Herb || plant.height_m < LOW_M {
            Model::Low { variant: variant(variety, LOW_VARIANTS) }
        } else if is_shrub(species) {
            Model::Shrub { class: class(), variant: variant(variety, SHRUB_VARIANTS) }
        } else {
            let crowding = usize::from(plant.crowding_fraction >= CROWDED_FRACTION);
            Model::Tree { crowding, class: class(), variant: variant(variety, TREE_VARIANTS) }
        };
        let radius_m = plant.crown_radius_m;
        Fitting {
            model: Self::number(plant.species, model),
            scale: [radius_m, radius_m, plant.height_m],
        }
    }

    fn snag(&self, snag: &SnagMeasures) -> Fitting {
        let species = self.species(snag.species);
        let decay = usize::from(snag.decay_class.clamp(1, 5)) - 1;
        let at_death_m = snag.height_at_death_m.max(snag.height_m).max(0.01);
        let share = snag.height_m / at_death_m;
        let standing = if share >= WHOLE_FRACTION {
            0
        } else {
            let off = |i: &usize| (STANDING[*i] - share).abs();
            (1..STANDING.len()).min_by(|a, b| off(a).total_cmp(&off(b))).unwrap_or(1)
        };
        let variant = variant(snag.variety, DEAD_VARIANTS);
        let fraction = snag_fraction(snag, standing);
        let has_branches = decay < 3
            && standing < BRANCHED
            && snag.branch_fraction >= LEAST_BRANCH_FRACTION
            && species.form != Form::Herb;
        let (model, radius_m) = if has_branches {
            let radius_m = snags::REACH[decay] * species.crown_radius_m(at_death_m);
            let class = stem_class(snag.dbh_m, radius_m, fraction);
            (Model::BranchedSnag { decay, standing, class, variant }, radius_m)
        } else {
            let foot_m = 0.5 * snag.dbh_m * taper(0.0) / taper(fraction).max(0.05);
            (Model::BareSnag { decay, standing, variant }, foot_m)
        };
        Fitting {
            model: Self::number(snag.species, model),
            scale: [radius_m, radius_m, snag.height_m],
        }
    }

    fn downed_log(&self, log: &DownedLogMeasures) -> Fitting {
        let share = log.diameter_tip_m / log.diameter_base_m.max(1e-4);
        let tip = (share * TIPS as f32).clamp(0.0, (TIPS - 1) as f32) as usize; // within classes
        let model = Model::DownedLog {
            kind: log.kind as usize,
            decay: usize::from(log.decay_class.clamp(1, 5)) - 1,
            tip,
            variant: variant(log.variety, DEAD_VARIANTS),
        };
        let diameter_m = log.diameter_base_m;
        Fitting {
            model: Self::number(log.species, model),
            scale: [log.length_m, diameter_m, diameter_m],
        }
    }
}

/// A number of a species' name, the same on every machine (FNV-1a, 32 bits).
fn name_hash(name: &str) -> u64 {
    let hash = name
        .bytes()
        .fold(0x811c_9dc5_u32, |hash, byte| (hash ^ u32::from(byte)).wrapping_mul(0x0100_0193));
    u64::from(hash)
}

fn mesh(species: &Species, model: Model, dice: &mut Dice, detail: usize) -> Mesh {
    match model {
        Model::Low { .. } => match (species.form, species.leaf) {
            (_, Leaf::Frond) => herbs::fern(species, dice, detail),
            (Form::Herb, _) => herbs::mat(species, dice, detail),
            _ if is_shrub(species) => crowns::shrub(species, &Build::low(species), dice, detail),
            _ => crowns::tree(species, &Build::low(species), dice, detail),
        },
        Model::Shrub { class, .. } => {
            crowns::shrub(species, &Build::of_class(species, class, 0.5), dice, detail)
        }
        Model::Tree { crowding, class, .. } => {
            let build = Build::of_class(species, class, CROWDING[crowding]);
            crowns::tree(species, &build, dice, detail)
        }
        Model::BranchedSnag { decay, standing, class, .. } => {
            let build = Build::of_class(species, class, 0.6);
            snags::branched(species, &build, snag_shape(decay, standing), dice, detail)
        }
        Model::BareSnag { decay, standing, .. } => {
            let build = Build::grown(species);
            snags::bare(&build, snag_shape(decay, standing), dice, detail)
        }
        Model::DownedLog { kind, decay, tip, .. } => {
            let shape = DownedLogShape {
                kind: DownedLogKind::ALL[kind],
                decay_class: decay as u8 + 1, // below 5
                tip_fraction: tip_fraction(tip),
            };
            downed_logs::downed_log(shape, dice, detail)
        }
    }
}

fn snag_shape(decay: usize, standing: usize) -> SnagShape {
    SnagShape {
        decay_class: decay as u8 + 1, // below 5
        standing_fraction: STANDING[standing],
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::tree::archetype::LEVELS;
    use crate::tree::mesh::MeshPart;

    fn biomes() -> [Biome; 2] {
        Biome::BUILTIN_NAMES.map(|name| Biome::builtin(name).unwrap())
    }

    fn model_of(number: u32) -> Model {
        Model::of_number(number as usize % MODELS_PER_SPECIES)
    }

    /// Some of all models: enough to see each kind in each class.
    fn sample(biome: &Biome) -> impl Iterator<Item = (Model, Archetype)> {
        let atlas = LowPolyAtlas::new(biome);
        let numbers = (0..atlas.model_count() as u32).step_by(11);
        let used = numbers.filter(move |number| {
            let species = &biome.species[*number as usize / MODELS_PER_SPECIES];
            match model_of(*number) {
                Model::Low { .. } => true,
                _ if species.form == Form::Herb => false,
                Model::Shrub { .. } => is_shrub(species),
                Model::Tree { .. } => !is_shrub(species),
                _ => true,
            }
        });
        used.map(move |number| (model_of(number), atlas.archetype(number)))
    }

    /// The size that a model is made for, or one like it.
    fn proportions(species: &Species, model: Model) -> [f32; 3] {
        let of = |build: Build, standing: f32| {
            [build.radius_m, build.radius_m, standing * build.height_m]
        };
        match model {
            Model::Low { .. } => of(Build::low(species), 1.0),
            Model::Shrub { class, .. } => of(Build::of_class(species, class, 0.5), 1.0),
            Model::Tree { crowding, class, .. } => {
                of(Build::of_class(species, class, CROWDING[crowding]), 1.0)
            }
            Model::BranchedSnag { standing, class, .. } => {
                of(Build::of_class(species, class, 0.6), STANDING[standing])
            }
            Model::BareSnag { .. } => [1.0, 1.0, 4.0],
            Model::DownedLog { .. } => [30.0, 1.0, 1.0],
        }
    }

    /// Checks a part, stretched by factors; returns how many of its triangles face where their normals do.
    fn check(part: &MeshPart, factors: [f32; 3], key: &str) -> usize {
        assert_eq!(part.positions.len(), part.normals.len(), "{key}");
        assert!(part.positions.iter().flatten().all(|v| v.is_finite()), "{key}");
        for normal in &part.normals {
            let long = Vec3::from(*normal).as_dvec3().length();
            assert!((long - 1.0).abs() < 1e-3, "{key}: a normal of {long}");
        }
        let facing = part.triangles.iter().filter(|corners| {
            let place = |c: &u32| {
                (Vec3::from(part.positions[*c as usize]) * Vec3::from(factors)).as_dvec3()
            };
            let at = [0, 1, 2].map(|corner| place(&corners[corner]));
            let normal = (at[1] - at[0]).cross(at[2] - at[0]);
            let sides = [(0, 1), (1, 2), (2, 0)].map(|(i, j)| at[i].distance(at[j]));
            let longest = sides.into_iter().fold(0.0, f64::max);
            assert!(normal.length() > 1e-5 * longest * longest, "{key}: a triangle of {at:?}");
            let facing = |c: &u32| Vec3::from(part.normals[*c as usize]) / Vec3::from(factors);
            let mean: f64 =
                corners.iter().map(|c| facing(c).as_dvec3().normalize().dot(normal)).sum();
            mean > 0.0
        });
        facing.count()
    }

    #[test]
    fn numbers_and_models_are_each_others_inverse() {
        for number in 0..MODELS_PER_SPECIES {
            assert_eq!(Model::of_number(number).number(), number);
        }
    }

    #[test]
    fn models_are_sound_and_face_outwards() {
        for biome in biomes() {
            for (model, archetype) in sample(&biome) {
                let species = &biome.species[usize::from(archetype.species)];
                let factors = proportions(species, model);
                for mesh in &archetype.levels {
                    let facing: usize =
                        mesh.parts.iter().map(|p| check(p, factors, &archetype.key)).sum();
                    let count = mesh.triangle_count();
                    // normals of leaves stray
                    assert!(
                        facing + (count / 25).max(1) >= count,
                        "{}: {facing} of {count}",
                        archetype.key
                    );
                }
            }
        }
    }

    #[test]
    fn triangles_are_as_many_as_the_table_says() {
        for biome in biomes() {
            for (model, archetype) in sample(&biome) {
                let species = &biome.species[usize::from(archetype.species)];
                let near = match model {
                    Model::Tree { .. } => 300..=800,
                    Model::Low { .. } if species.form == Form::Herb => 200..=400,
                    Model::Low { .. } | Model::Shrub { .. } => 200..=800,
                    Model::BranchedSnag { .. } | Model::BareSnag { .. } => 30..=600,
                    Model::DownedLog { .. } => 90..=300,
                };
                let counts: [usize; LEVELS] =
                    std::array::from_fn(|level| archetype.levels[level].triangle_count());
                assert!(near.contains(&counts[0]), "{}: {counts:?}", archetype.key);
                assert!(counts[1] <= 100 && counts[2] <= 24, "{}: {counts:?}", archetype.key);
                assert!(counts[2] > 0, "{}", archetype.key);
            }
        }
    }

    #[test]
    fn models_are_one_unit_large() {
        for biome in biomes() {
            for (model, archetype) in sample(&biome) {
                for mesh in &archetype.levels {
                    let key = &archetype.key;
                    let places = || mesh.parts.iter().flat_map(|part| &part.positions);
                    let most = |of: &dyn Fn(&[f32; 3]) -> f32| places().map(of).fold(0.0, f32::max);
                    let (high, wide) =
                        (most(&|p| p[2]), most(&|p| (p[0] * p[0] + p[1] * p[1]).sqrt()));
                    match model {
                        Model::DownedLog { .. } => {
                            let (long, back) = (most(&|p| p[0]), most(&|p| -p[0]));
                            assert!(
                                (long - 1.0).abs() < 0.1 && back < 0.05,
                                "{key}: {long} {back}"
                            );
                            assert!((0.2..2.3).contains(&high), "{key}: {high}");
                        }
                        Model::BareSnag { .. } => {
                            assert!((high - 1.0).abs() < 0.01, "{key}: {high}");
                            assert!((0.6..1.7).contains(&wide), "{key}: {wide}");
                        }
                        _ => {
                            assert!((high - 1.0).abs() < 0.01, "{key}: {high}");
                            assert!((wide - 1.0).abs() < 0.1, "{key}: {wide}");
                            // stems of broken snags reach as deep as whole ones
                            assert!(most(&|p| -p[2]) < 0.1, "{key}");
                        }
                    }
                }
            }
        }
    }

    /// Diameter of a circle as large as what the first triangles of wood and bark cut out of a height of a model.
    fn drawn_diameter(mesh: &Mesh, height: f32, first: usize) -> f32 {
        let mut area = 0.0;
        for part in mesh.parts.iter().filter(|part| part.material != Material::Foliage) {
            for corners in part.triangles.iter().take(first) {
                let at = corners.map(|c| part.positions[c as usize]);
                let mut cut: Vec<([f32; 2], bool)> = Vec::new();
                for (a, b) in [(at[0], at[1]), (at[1], at[2]), (at[2], at[0])] {
                    if (a[2] > height) != (b[2] > height) {
                        let t = (height - a[2]) / (b[2] - a[2]);
                        let place = [0, 1].map(|k| a[k] + t * (b[k] - a[k]));
                        cut.push((place, b[2] > height));
                    }
                }
                // seen from above, the outside is on the right of the cut's way
                if let [(p, p_up), (q, _)] = cut[..] {
                    let (from, to) = if p_up { (q, p) } else { (p, q) };
                    area += 0.5 * (from[0] * to[1] - to[0] * from[1]);
                }
            }
        }
        2.0 * (area.abs() / std::f32::consts::PI).sqrt()
    }

    #[test]
    fn stems_are_drawn_as_thick_as_they_are() {
        let mut count = 0;
        for biome in biomes() {
            let atlas = LowPolyAtlas::new(&biome);
            for (index, species) in (0..).zip(&biome.species).filter(|(_, s)| s.form != Form::Herb)
            {
                for (step, crowding_fraction) in (1..=8).flat_map(|s| [(s, 0.0), (s, 1.0)]) {
                    let height_m = species.max_height_m * step as f32 / 10.0;
                    let dbh_m = species.dbh_in_shade_m(height_m, crowding_fraction);
                    let crown_radius_m = species
                        .crown_radius_in_shade_m(height_m, crowding_fraction)
                        * [0.7, 1.0, 1.3][step % 3];
                    if height_m < LOW_M {
                        continue;
                    }
                    let variety = step as u32;
                    let fitting = atlas.plant(&PlantMeasures {
                        species: index,
                        height_m,
                        crown_radius_m,
                        dbh_m,
                        crowding_fraction,
                        variety,
                    });
                    let archetype = atlas.archetype(fitting.model);
                    let at = stem::breast_fraction(height_m);
                    // limbs come after the stem, or the stems of a shrub
                    let first = if is_shrub(species) { 5 * 44 } else { 77 };
                    let drawn_m =
                        fitting.scale[0] * drawn_diameter(&archetype.levels[0], at, first);
                    let share = drawn_m / dbh_m;
                    assert!((0.85..=1.15).contains(&share), "{}: {share}", archetype.key);
                    count += 1;
                }
            }
        }
        assert!(count > 200, "{count}");
    }

    #[test]
    fn dead_stems_are_drawn_as_thick_as_they_are() {
        let biome = Biome::builtin("pyrenees").unwrap();
        let atlas = LowPolyAtlas::new(&biome);
        let species = biome.species_index("silver-fir").unwrap();
        for decay_class in 1..=5 {
            for standing in [1.0, 0.9, 0.7, 0.5, 0.3, 0.2] {
                let (height_at_death_m, dbh_m) = (30.0, 0.5);
                let fitting = atlas.snag(&SnagMeasures {
                    species: species as u16,
                    height_m: standing * height_at_death_m,
                    height_at_death_m,
                    dbh_m,
                    decay_class,
                    branch_fraction: 1.0,
                    variety: 1,
                });
                let archetype = atlas.archetype(fitting.model);
                let at = BREAST_HEIGHT_M / (standing * height_at_death_m);
                let drawn_m =
                    fitting.scale[0] * drawn_diameter(&archetype.levels[0], at, usize::MAX);
                let share = drawn_m / dbh_m;
                assert!((0.85..=1.15).contains(&share), "{}: {share}", archetype.key);
            }
        }
    }

    #[test]
    fn thin_ends_of_downed_logs_are_within_a_tenth_of_the_thick_end() {
        let biome = Biome::builtin("sonoma").unwrap();
        let atlas = LowPolyAtlas::new(&biome);
        for step in 0..=20 {
            let share = step as f32 / 20.0;
            let fitting = atlas.downed_log(&DownedLogMeasures {
                species: 15,
                kind: DownedLogKind::Trunk,
                length_m: 20.0,
                diameter_base_m: 0.8,
                diameter_tip_m: 0.8 * share,
                decay_class: 2,
                variety: 0,
            });
            assert_eq!(fitting.scale, [20.0, 0.8, 0.8]);
            let Model::DownedLog { tip, .. } = model_of(fitting.model) else { panic!("no log") };
            assert!((tip_fraction(tip) - share).abs() <= 0.1001, "{share}");
        }
    }

    #[test]
    fn forms_follow_species_and_size() {
        let biome = Biome::builtin("sonoma").unwrap();
        let atlas = LowPolyAtlas::new(&biome);
        let key = |name: &str, height_m: f32, crowding_fraction: f32| {
            let fitting = atlas.plant(&PlantMeasures {
                species: biome.species_index(name).unwrap() as u16,
                height_m,
                crown_radius_m: 0.3 * height_m,
                dbh_m: 0.01 * height_m,
                crowding_fraction,
                variety: 1,
            });
            atlas.archetype(fitting.model).key
        };
        assert_eq!(key("western-swordfern", 0.8, 1.0), "western-swordfern.low.b");
        assert_eq!(key("redwood", 1.0, 1.0), "redwood.low.b");
        assert_eq!(key("redwood", 30.0, 0.9), "redwood.tree.forest.s6.b");
        assert_eq!(key("tanoak", 15.0, 0.1), "tanoak.tree.open.s7.b");
        assert_eq!(key("toyon", 3.0, 0.1), "toyon.shrub.s8.b");
    }
}
