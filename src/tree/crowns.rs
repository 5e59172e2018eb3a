//! Live trees, saplings and shrubs: stems, and crowns of tiers or of clumps.

use std::f32::consts::TAU;

use super::habit::{CrownStyle, Habit};
use super::mesh::{Material, Mesh};
use super::outline::half_width;
use super::sculptor::{Clump, Dice, GOLDEN_RAD, Knot, Lathe, Sculptor, Skirt, along, level};
use super::stem::{Stem, class_ratio};
use crate::math;
use crate::species::Species;

/// Most clumps of a crown, and sprays of leaves on each.
const MOST_CLUMPS: usize = 14;
const SPRAYS: usize = 9;
/// Stems of a shrub, by level of detail.
const SHRUB_STEMS: [usize; 3] = [5, 3, 1];

/// A woody plant in metres, of the size that its model is made for.
#[derive(Clone, Copy, Debug)]
pub struct Build {
    /// Height.
    pub height_m: f32,
    /// Crown radius.
    pub radius_m: f32,
    /// Stem diameter at breast height, or the stem's own of low plants.
    pub dbh_m: f32,
    /// Share of the height at which the crown begins.
    pub base_fraction: f32,
    /// How crowded it grew: 0 alone, 1 among others.
    pub crowding_fraction: f32,
}

impl Build {
    /// A tree or shrub whose stem is of a class: as tall as the species is with such a stem.
    pub fn of_class(species: &Species, class: usize, crowding_fraction: f32) -> Self {
        const STEPS: usize = 64;
        let ratio = class_ratio(class);
        let candidate = |step: usize| {
            let share = (step + 1) as f32 / STEPS as f32;
            // finer at the foot
            let height_m = (species.max_height_m * share * share).max(1.0);
            let radius_m = species.crown_radius_in_shade_m(height_m, crowding_fraction);
            let dbh_m = species.dbh_in_shade_m(height_m, crowding_fraction);
            (height_m, radius_m, (dbh_m / radius_m / ratio - 1.0).abs())
        };
        let candidates = (8..STEPS).map(candidate);
        let nearest = candidates.min_by(|a, b| a.2.total_cmp(&b.2));
        let (height_m, radius_m, _) = nearest.unwrap_or((10.0, 2.0, 0.0));
        let crown = &species.crown;
        let base =
            math::lerp(crown.base_fraction_isolated, crown.base_fraction_dense, crowding_fraction);
        Self {
            height_m,
            radius_m,
            dbh_m: ratio * radius_m,
            base_fraction: base.max(0.04),
            crowding_fraction,
        }
    }

    /// A seedling, sapling or low shrub.
    pub fn low(species: &Species) -> Self {
        let height_m = 1.0_f32.min(0.6 * species.max_height_m);
        let base = 0.5 * (species.crown.base_fraction_dense + species.crown.base_fraction_isolated);
        Self {
            height_m,
            radius_m: species.crown_radius_m(height_m),
            dbh_m: species.dbh_m(height_m),
            base_fraction: (0.4 * base).max(0.03),
            crowding_fraction: 0.5,
        }
    }

    /// A grown tree, for what has no crown.
    pub fn grown(species: &Species) -> Self {
        let height_m = (0.5 * species.max_height_m).max(1.0);
        Self {
            height_m,
            radius_m: species.crown_radius_m(height_m),
            dbh_m: species.dbh_m(height_m),
            base_fraction: species.crown.base_fraction_dense,
            crowding_fraction: 0.5,
        }
    }

    fn base_m(&self) -> f32 {
        self.base_fraction * self.height_m
    }

    fn crown_m(&self) -> f32 {
        self.height_m - self.base_m()
    }

    fn size(&self) -> [f32; 3] {
        [self.radius_m, self.radius_m, self.height_m]
    }
}

/// A model of a tree at a level of detail.
pub fn tree(species: &Species, build: &Build, dice: &mut Dice, detail: usize) -> Mesh {
    let habit = Habit::of(species);
    let mut sculptor = Sculptor::default();
    let bend_m = bend(&habit, build, dice);
    let end_fraction = match habit.crown {
        CrownStyle::Tiers { .. } => 0.985,
        CrownStyle::Clumps { .. } => 0.88,
    };
    let stem = Stem {
        height_m: build.height_m,
        diameter_m: build.dbh_m,
        end_fraction,
        is_broken: false,
        foot_m: [0.0; 2],
        bend_m,
        lean_m: [0.0; 2],
    };
    stem.build(&mut sculptor, Material::Bark, detail);
    crown(&mut sculptor, species, &habit, build, &[stem], dice, detail);
    sculptor.fit_foliage(build.radius_m, build.height_m);
    sculptor.into_mesh(build.size())
}

/// A model of a shrub of several stems at a level of detail.
pub fn shrub(species: &Species, build: &Build, dice: &mut Dice, detail: usize) -> Mesh {
    let habit = Habit::of(species);
    let mut sculptor = Sculptor::default();
    let count = SHRUB_STEMS[detail];
    let turn = dice.between(0.0, TAU);
    let stems: Vec<Stem> = (0..count)
        .map(|i| {
            let out = level(turn + GOLDEN_RAD * i as f32);
            let foot = 0.06 * build.radius_m;
            let reach = build.radius_m * if count == 1 { 0.0 } else { dice.between(0.3, 0.6) };
            Stem {
                height_m: build.height_m,
                diameter_m: build.dbh_m / (count as f32).sqrt(),
                end_fraction: dice.between(0.75, 0.86),
                is_broken: false,
                foot_m: [foot * out[0], foot * out[1]],
                bend_m: [0.1 * reach * out[0], 0.1 * reach * out[1]],
                lean_m: [reach * out[0], reach * out[1]],
            }
        })
        .collect();
    for stem in &stems {
        let sides = if detail == 0 { 4 } else { 3 };
        let knots = stem.knots(if detail == 0 { 0 } else { 2 });
        sculptor.tube(Material::Bark, &knots, sides, true);
    }
    crown(&mut sculptor, species, &habit, build, &stems, dice, detail);
    sculptor.fit_foliage(build.radius_m, build.height_m);
    sculptor.into_mesh(build.size())
}

fn bend(habit: &Habit, build: &Build, dice: &mut Dice) -> [f32; 2] {
    let out = level(dice.between(0.0, TAU));
    let far = habit.crook * build.height_m * dice.between(0.5, 1.0);
    [far * out[0], far * out[1]]
}

fn crown(
    sculptor: &mut Sculptor,
    species: &Species,
    habit: &Habit,
    build: &Build,
    stems: &[Stem],
    dice: &mut Dice,
    detail: usize,
) {
    let Some(stem) = stems.first() else { return };
    match (habit.crown, detail) {
        (CrownStyle::Tiers { .. }, _) => tiers(sculptor, &habit.crown, build, stem, dice, detail),
        (CrownStyle::Clumps { .. }, 0) => {
            clumps(sculptor, species, &habit.crown, build, stems, dice);
        }
        (CrownStyle::Clumps { .. }, _) => dome(sculptor, species, build, stem, dice, detail),
    }
}

/// Tiers of branches from the crown's base to the top.
fn tiers(
    sculptor: &mut Sculptor,
    style: &CrownStyle,
    build: &Build,
    stem: &Stem,
    dice: &mut Dice,
    detail: usize,
) {
    let CrownStyle::Tiers { droop, notch, thickness, roundness, raggedness } = *style else {
        return;
    };
    let (base_m, crown_m, radius_m) = (build.base_m(), build.crown_m(), build.radius_m);
    let is_low = build.height_m < 2.0;
    let near = (crown_m / (0.5 * radius_m)).round().clamp(9.0, 17.0) as usize; // within bounds
    let count = [if is_low { 7 } else { near }, 4, 2][detail];
    let tips = [10, 9, 5][detail];
    let gap_m = crown_m / count as f32;
    for tier in 0..count {
        let t = (tier as f32 + 0.15) / count as f32;
        let shade = if t < 0.1 { 0.8 + 2.0 * t } else { 1.0 };
        let reach = radius_m * math::powf(1.0 - t, roundness) * shade;
        let reach =
            reach * if detail == 0 { dice.between(1.0 - 0.5 * raggedness, 1.0) } else { 1.0 };
        let middle_m = base_m + t * crown_m + (droop * reach).max(0.0).min(0.6 * gap_m);
        let is_top = tier + 1 == count;
        let top_m = if is_top { build.height_m } else { middle_m + thickness * gap_m };
        let [x, y, _] = stem.axis(t);
        let rim_m = (middle_m - droop * reach).max(0.01 * build.height_m);
        sculptor.skirt(
            &Skirt {
                axis: [x, y],
                top_m: top_m.min(build.height_m),
                rim_m,
                under_m: rim_m + 0.35 * (middle_m - rim_m) + 0.1 * gap_m,
                radius_m: reach,
                tips: if detail == 0 && t > 0.75 { 6 } else { tips },
                notch: if detail == 0 { notch } else { 0.0 },
                raggedness,
            },
            dice,
        );
    }
    if detail == 0 && build.crowding_fraction > 0.5 && !is_low {
        stubs(sculptor, build, stem, dice);
    }
}

/// Dead branches below the crown of a tree grown among others.
fn stubs(sculptor: &mut Sculptor, build: &Build, stem: &Stem, dice: &mut Dice) {
    for i in 0..7 {
        let fraction = build.base_fraction * dice.between(0.45, 1.0);
        let out = level(GOLDEN_RAD * i as f32);
        let from = stem.axis(fraction);
        let reach = build.radius_m * dice.between(0.2, 0.5);
        let mut to = along(from, reach, out);
        to[2] -= 0.12 * reach;
        let radius = 0.1 * stem.radius_m(fraction);
        let knots = [Knot { at: from, radius }, Knot { at: to, radius: 0.0 }];
        sculptor.tube(Material::Bark, &knots, 3, false);
    }
}

/// Clumps of leaves on limbs.
fn clumps(
    sculptor: &mut Sculptor,
    species: &Species,
    style: &CrownStyle,
    build: &Build,
    stems: &[Stem],
    dice: &mut Dice,
) {
    let CrownStyle::Clumps { count, size, flatness, looseness } = *style else { return };
    let is_low = build.height_m < 2.0;
    let count = count.min(match stems.len() {
        _ if is_low => 7,
        1 => MOST_CLUMPS,
        _ => 11,
    });
    let (base_m, crown_m, radius_m) = (build.base_m(), build.crown_m(), build.radius_m);
    let shape = species.crown.shape;
    // long crowns have long clumps, so that no gaps gape
    let slender = (crown_m / radius_m / 2.4).max(1.0);
    let fuller = 1.0 + 0.35 * (slender - 1.0).min(1.2) + if is_low { 0.2 } else { 0.0 };
    let heart = [0.0, 0.0, base_m + 0.4 * crown_m];
    let turn = dice.between(0.0, TAU);
    for i in 0..count {
        let share = (i as f32 + 0.5) / count as f32;
        // clumps crowd where the crown is wide
        let t = math::lerp(share, 0.5 + 0.5 * (share - 0.5), 0.25);
        let wide = half_width(shape, 0.1 + 0.8 * t).max(0.18);
        let grown = dice.between(0.8, 1.15) * size;
        let radius = radius_m * grown * (0.55 + 0.45 * wide) * fuller;
        let room = (radius_m * wide - 0.75 * radius).max(0.0);
        let inner = 1.0 - looseness * dice.roll() * 0.6;
        // the topmost clumps gather over the stem
        let reach = room * inner * if share > 0.93 { 0.25 } else { 1.0 };
        let out = level(turn + GOLDEN_RAD * i as f32);
        let tall = (radius * flatness * slender).min(0.26 * crown_m);
        let height_m = base_m + tall * 0.8 + t * (crown_m - 1.7 * tall);
        let stem = &stems[i % stems.len()];
        let [x, y, _] = stem.axis((height_m / build.height_m).min(stem.end_fraction));
        let (x, y) = if stems.len() > 1 { (0.0, 0.0) } else { (x, y) };
        let middle = [x + reach * out[0], y + reach * out[1], height_m];
        let clump =
            Clump { middle, radii: [radius, radius, tall], frequency: 1, unevenness: 0.1, heart };
        sculptor.clump(&clump, dice);
        sculptor.sprays(&clump, SPRAYS, dice);
        if !is_low {
            limb(sculptor, build, stem, middle, dice);
        }
    }
}

/// A limb from the stem to a clump's middle.
fn limb(sculptor: &mut Sculptor, build: &Build, stem: &Stem, middle: [f32; 3], dice: &mut Dice) {
    let low = build.base_m().max(0.3 * middle[2]);
    let start_m = math::lerp(low, middle[2], dice.between(0.1, 0.55));
    let fraction = (start_m / build.height_m).min(stem.end_fraction - 0.02).max(0.02);
    let radius = 0.42 * stem.radius_m(fraction);
    let from = stem.axis(fraction);
    let knots = [Knot { at: from, radius }, Knot { at: middle, radius: 0.0 }];
    sculptor.tube(Material::Bark, &knots, 3, false);
}

/// A crown as one body.
fn dome(
    sculptor: &mut Sculptor,
    species: &Species,
    build: &Build,
    stem: &Stem,
    dice: &mut Dice,
    detail: usize,
) {
    let shares: &[f32] = if detail == 1 { &[0.08, 0.26, 0.5, 0.72, 0.9] } else { &[0.28, 0.72] };
    let (base_m, crown_m) = (build.base_m(), build.crown_m());
    let rings: Vec<(f32, f32)> = shares
        .iter()
        .map(|&t| {
            let wide = half_width(species.crown.shape, t).max(0.2);
            (base_m + t * crown_m, wide * build.radius_m)
        })
        .collect();
    let [x, y, _] = stem.axis(0.6);
    let lathe = Lathe {
        axis: if build.height_m < 2.0 { [0.0; 2] } else { [x, y] },
        low_m: base_m,
        high_m: build.height_m,
        rings: &rings,
        sides: if detail == 1 { 7 } else { 5 },
        unevenness: if detail == 1 { 0.14 } else { 0.0 },
    };
    sculptor.lathe(&lathe, dice);
}
