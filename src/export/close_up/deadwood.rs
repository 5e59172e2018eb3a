//! Deadwood of a close-up: downed logs and snags, from above and from the side.

use super::light::Band;
use super::plan::View;
use super::variety::{self, clumps, speck, unit};
use crate::export::deadwood_layer::{downed_log_color, lowest_first};
use crate::export::relief::lit;
use crate::export::strokes::{Ends, Stroke, edge};
use crate::math::{cos, sin};
use crate::plants::deadwood::{Deadwood, DownedLogKind, DownedLogs, Snags};
use crate::species::{Biome, Species};

/// Least width of a downed log.
const LEAST_WIDTH_PX: f32 = 1.4;
/// Root plate of an uprooted tree: its reach to both sides in diameters of the stem, and its thickness.
const ROOT_PLATE: f32 = 1.7;
const ROOT_PLATE_THICK: f32 = 0.35;
const EARTH: [f32; 3] = [78.0, 58.0, 44.0];
const DARK: [f32; 3] = [24.0, 26.0, 30.0];
/// A snag's circle from above: its least radius, and the width of its lines.
const LEAST_CIRCLE_PX: f32 = 5.0;
const CIRCLE_LINE_PX: f32 = 1.7;
const CIRCLE_INK: [f32; 3] = [66.0, 68.0, 74.0];
const CIRCLE_GROUND: [f32; 3] = [238.0, 238.0, 236.0];
/// Dead branches.
const BRANCH: [f32; 3] = [92.0, 90.0, 90.0];
/// Most branches of a snag: from above, from the side.
const MOST_SPOKES: f32 = 9.0;
const MOST_BRANCHES: f32 = 22.0;
/// Bare stems: fresh, and weathered to silver.
const STEM: [f32; 3] = [134.0, 124.0, 114.0];
const WEATHERED: [f32; 3] = [178.0, 176.0, 172.0];
/// Wood of a downed log's end.
const CUT: [f32; 3] = [212.0, 184.0, 144.0];
/// Air between the viewer and what stands behind.
const HAZE: [f32; 3] = [244.0, 244.0, 240.0];
/// Height at which stems are measured, m.
const BREAST_HEIGHT_M: f32 = 1.3;
/// A stem shorter than this share of what it was is broken.
const WHOLE_FRACTION: f32 = 0.98;

/// Texture of bark, −1..=1, at a place along and across a stem in pixels: streaks along it.
fn bark(seed: u32, along: f32, across: f32) -> f32 {
    clumps(seed, along / 11.0, across / 1.7 + 300.0)
}

/// Lays what `ink` gives over all that a stroke covers, by the place along and across it.
fn lay_stroke(band: &mut Band<'_>, stroke: &Stroke, ink: impl Fn(f32, f32) -> ([f32; 3], f32)) {
    let [from, to] = stroke.bounds();
    let (rows, cols) = band.touched(from, to);
    for row in rows {
        for col in cols.clone() {
            let touch = stroke.touch([col as f32 + 0.5, row as f32 + 0.5]);
            if touch.coverage > 0.0 {
                let (color, alpha) = ink(touch.along, touch.across);
                band.lay(row, col, color, alpha * touch.coverage);
            }
        }
    }
}

/// Deadwood that a view sees.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SeenDeadwood {
    /// Snags whose stem or branches reach into the square, by their ids.
    pub snags: Vec<usize>,
    /// Downed logs of which a part lies in the square, the freshest last.
    pub downed_logs: Vec<usize>,
}

impl SeenDeadwood {
    /// What of it a view sees.
    pub fn of(deadwood: &Deadwood, view: &View) -> Self {
        let Deadwood { snags, downed_logs } = deadwood;
        const MORE_M: f32 = 6.0; // branches, root plates
        let is_standing = |&i: &usize| view.contains(snags.east_m[i], snags.north_m[i], MORE_M);
        let mut standing: Vec<usize> = (0..snags.len()).filter(is_standing).collect();
        standing.sort_by_key(|&i| snags.id[i]);
        let edges = |from: f32| [from - MORE_M, from + view.size_m + MORE_M];
        let is_lying = |&i: &usize| {
            let thick = [downed_logs.east_m[i], downed_logs.north_m[i]];
            part_within(thick, downed_logs.thin_end_m(i), [edges(view.west_m), edges(view.south_m)])
                .is_some()
        };
        let lying = lowest_first(downed_logs, (0..downed_logs.len()).filter(is_lying));
        Self { snags: standing, downed_logs: lying }
    }

    /// Of snags and downed logs those that belong to the square: rooted in it, or with their middle in it.
    pub fn own(&self, deadwood: &Deadwood, view: &View) -> Self {
        let Deadwood { snags, downed_logs } = deadwood;
        let is_rooted = |i: &usize| view.contains(snags.east_m[*i], snags.north_m[*i], 0.0);
        let is_mostly_in = |i: &usize| {
            let [east_m, north_m] = downed_logs.thin_end_m(*i);
            let [east_m, north_m] = [
                0.5 * (east_m + downed_logs.east_m[*i]),
                0.5 * (north_m + downed_logs.north_m[*i]),
            ];
            view.contains(east_m, north_m, 0.0)
        };
        Self {
            snags: self.snags.iter().copied().filter(is_rooted).collect(),
            downed_logs: self.downed_logs.iter().copied().filter(is_mostly_in).collect(),
        }
    }

    /// Volume of its downed logs when they came down, m³.
    pub fn downed_m3(&self, deadwood: &Deadwood) -> f64 {
        self.downed_logs.iter().map(|&i| deadwood.downed_logs.volume_m3(i)).sum()
    }
}

/// The part of a line, 0..=1 from its beginning, that lies between two values on each axis.
pub fn part_within(from: [f32; 2], to: [f32; 2], edges: [[f32; 2]; 2]) -> Option<[f32; 2]> {
    let (mut start, mut end) = (0.0_f32, 1.0_f32);
    for axis in 0..2 {
        let along = to[axis] - from[axis];
        let [low, high] = edges[axis].map(|edge| edge - from[axis]);
        if along.abs() < 1e-6 {
            if low > 0.0 || high < 0.0 {
                return None;
            }
            continue;
        }
        let (one, other) = (low / along, high / along);
        start = start.max(one.min(other));
        end = end.min(one.max(other));
    }
    (start <= end).then_some([start, end])
}

/// A downed log from above.
#[derive(Clone, Copy, Debug)]
pub struct DownedLogAbove {
    stroke: Stroke,
    color: [f32; 3],
    is_uprooted: bool,
    seed: u32,
}

impl DownedLogAbove {
    /// A downed log on a view's sheet.
    pub fn new(downed_logs: &DownedLogs, i: usize, view: &View) -> Self {
        let [east_m, north_m] = downed_logs.thin_end_m(i);
        let half = |diameter_m: f32| 0.5 * (diameter_m * view.px_per_m()).max(LEAST_WIDTH_PX);
        let stroke = Stroke {
            from: view.place(downed_logs.east_m[i], downed_logs.north_m[i]),
            to: view.place(east_m, north_m),
            half_width: [half(downed_logs.diameter_base_m[i]), half(downed_logs.diameter_tip_m[i])],
            ends: Ends::Square,
        };
        Self {
            stroke,
            color: downed_log_color(downed_logs.decay_class[i]),
            is_uprooted: downed_logs.kind[i] == DownedLogKind::Uprooted,
            seed: variety::of_plant(downed_logs.id[i]),
        }
    }

    /// A downed log across a legend's symbol of `side` pixels.
    pub fn symbol(side: f32) -> Self {
        let stroke = Stroke {
            from: [1.5, 0.7 * side],
            to: [side - 1.5, 0.3 * side],
            half_width: [3.4, 1.8],
            ends: Ends::Square,
        };
        Self { stroke, color: downed_log_color(2), is_uprooted: false, seed: 5 }
    }

    /// Draws the downed log's shadow and the downed log.
    pub fn draw(&self, band: &mut Band<'_>) {
        let Stroke { from, to, half_width, .. } = self.stroke;
        let length = ((to[0] - from[0]).powi(2) + (to[1] - from[1]).powi(2)).sqrt().max(1e-3);
        let ahead = [(to[0] - from[0]) / length, (to[1] - from[1]) / length];
        let shift = (0.7 * half_width[0]).clamp(0.6, 6.0);
        let shadow =
            Stroke { from: from.map(|v| v + shift), to: to.map(|v| v + shift), ..self.stroke };
        lay_stroke(band, &shadow, |_, _| (DARK, 0.32));
        // lamp in the north-west; `across` counts to the right of the downed log's direction
        let facing = std::f32::consts::FRAC_1_SQRT_2 * (ahead[1] - ahead[0]);
        lay_stroke(band, &self.stroke, |along, across| {
            let half = half_width[0] + along * (half_width[1] - half_width[0]);
            let bark = bark(self.seed, along * length, across * half);
            let light = 0.65 * facing * across + 0.25 * bark - 0.12 * across * across;
            (lit(self.color, light.clamp(-1.0, 1.0), 1.0), 1.0)
        });
        if self.is_uprooted {
            let reach = ROOT_PLATE * 2.0 * half_width[0];
            let side = [-ahead[1] * reach, ahead[0] * reach];
            let plate = Stroke {
                from: [from[0] - side[0], from[1] - side[1]],
                to: [from[0] + side[0], from[1] + side[1]],
                half_width: [(ROOT_PLATE_THICK * 2.0 * half_width[0]).max(1.0); 2],
                ends: Ends::Round,
            };
            lay_stroke(band, &plate, |along, across| {
                let clod = clumps(self.seed ^ 9, along * 2.0 * reach / 4.0, across);
                (lit(EARTH, 0.45 * clod, 1.0), 1.0)
            });
        }
    }
}

/// A snag from above: a crossed circle in the width of its stem, never too small to be seen, with what branches it has.
#[derive(Clone, Copy, Debug)]
pub struct SnagAbove {
    at: [f32; 2],
    radius: f32,
    /// Reach of its branches, pixels, and their number.
    reach: f32,
    spokes: u32,
    seed: u32,
}

impl SnagAbove {
    /// A snag on a view's sheet.
    pub fn new(snags: &Snags, i: usize, biome: &Biome, view: &View) -> Self {
        let stem_px = 0.5 * snags.dbh_m[i] * view.px_per_m();
        Self {
            at: view.place(snags.east_m[i], snags.north_m[i]),
            radius: (stem_px + 2.0).max(LEAST_CIRCLE_PX),
            reach: branch_m(snags, i, biome) * view.px_per_m(),
            spokes: (MOST_SPOKES * snags.branch_fraction[i]).round() as u32, // a few
            seed: variety::of_plant(snags.id[i]),
        }
    }

    /// A snag in a legend's symbol of `side` pixels.
    pub fn symbol(side: f32) -> Self {
        Self { at: [0.5 * side; 2], radius: 0.33 * side, reach: 0.0, spokes: 0, seed: 3 }
    }

    /// Draws its branches.
    pub fn branches(&self, band: &mut Band<'_>) {
        for spoke in 0..self.spokes {
            let turn = (spoke as f32 + 0.6 * unit(self.seed, spoke)) / self.spokes as f32;
            let angle = std::f32::consts::TAU * (turn + unit(self.seed, 90));
            let reach = self.radius + self.reach * (0.45 + 0.55 * unit(self.seed, 30 + spoke));
            let [x, y] = self.at;
            let stroke = Stroke {
                from: self.at,
                to: [x + reach * cos(angle), y + reach * sin(angle)],
                half_width: [1.3, 0.6],
                ends: Ends::Round,
            };
            lay_stroke(band, &stroke, |along, _| (BRANCH, 0.9 - 0.4 * along));
        }
    }

    /// Draws its crossed circle.
    pub fn circle(&self, band: &mut Band<'_>) {
        let (radius, [x, y]) = (self.radius, self.at);
        let half = 0.5 * CIRCLE_LINE_PX;
        let reach = radius + 1.0;
        let (rows, cols) = band.touched([x - reach, y - reach], [x + reach, y + reach]);
        for row in rows {
            for col in cols.clone() {
                let (dx, dy) = (col as f32 + 0.5 - x, row as f32 + 0.5 - y);
                let inside = radius - (dx * dx + dy * dy).sqrt();
                let ring = edge(CIRCLE_LINE_PX - inside - 0.5);
                let diagonals = [dx - dy, dx + dy]
                    .map(|d| edge(half - d.abs() * std::f32::consts::FRAC_1_SQRT_2));
                let ink = ring.max(diagonals[0]).max(diagonals[1]);
                let color = std::array::from_fn(|c| {
                    CIRCLE_GROUND[c] + ink * (CIRCLE_INK[c] - CIRCLE_GROUND[c])
                });
                let alpha = edge(inside) * (0.85 + 0.15 * ink);
                if alpha > 0.0 {
                    band.lay(row, col, color, alpha);
                }
            }
        }
    }
}

/// Radius of the crown that a snag's branches made up.
fn branch_m(snags: &Snags, i: usize, biome: &Biome) -> f32 {
    species(snags, i, biome).crown_radius_m(snags.height_at_death_m[i])
}

fn species<'a>(snags: &Snags, i: usize, biome: &'a Biome) -> &'a Species {
    &biome.species[usize::from(snags.species[i])]
}

/// Where something stands or lies in a profile.
#[derive(Clone, Copy, Debug)]
pub struct Footing {
    /// Column of its stem.
    pub x: f32,
    /// Row of the ground at its stem.
    pub foot_y: f32,
    /// Rows that the ground falls a column to the east.
    pub fall: f32,
    /// Pixels a metre.
    pub px_per_m: f32,
    /// How much air lies before it, 0..=1.
    pub haze_fraction: f32,
}

fn hazy(color: [f32; 3], haze_fraction: f32) -> [f32; 3] {
    std::array::from_fn(|c| color[c] + haze_fraction * (HAZE[c] - color[c]))
}

/// A snag from the side: a bare stem, broken off where it is shorter than it was, with what branches it has.
#[derive(Clone, Copy, Debug)]
pub struct SnagBeside {
    footing: Footing,
    height_m: f32,
    height_at_death_m: f32,
    dbh_m: f32,
    crown_base_m: f32,
    crown_radius_m: f32,
    branches: u32,
    color: [f32; 3],
    seed: u32,
}

impl SnagBeside {
    /// A snag of a profile; `canopy_cover_fraction` tells how high its branches begin.
    pub fn new(
        snags: &Snags,
        i: usize,
        biome: &Biome,
        footing: Footing,
        canopy_cover_fraction: f32,
    ) -> Self {
        let at_death_m = snags.height_at_death_m[i].max(snags.height_m[i]);
        let weathered = f32::from(snags.decay_class[i].clamp(1, 5) - 1) / 4.0;
        Self {
            footing,
            height_m: snags.height_m[i],
            height_at_death_m: at_death_m,
            dbh_m: snags.dbh_m[i],
            crown_base_m: species(snags, i, biome)
                .crown_base_m(at_death_m, canopy_cover_fraction)
                .min(0.9 * at_death_m),
            crown_radius_m: branch_m(snags, i, biome),
            branches: (MOST_BRANCHES * snags.branch_fraction[i]).round() as u32, // a few
            color: std::array::from_fn(|c| STEM[c] + weathered * (WEATHERED[c] - STEM[c])),
            seed: variety::of_plant(snags.id[i]),
        }
    }

    /// Half the stem's width at a height, pixels.
    fn half_px(&self, height_m: f32) -> f32 {
        // a straight taper from breast height to where the tip was
        let breast_m = BREAST_HEIGHT_M.min(0.5 * self.height_at_death_m);
        let taper = (self.height_at_death_m - height_m.max(0.0))
            / (self.height_at_death_m - breast_m).max(0.01);
        let flare = 1.0 + 0.5 * (1.0 - height_m / 0.6).clamp(0.0, 1.0).powi(2);
        (0.5 * self.dbh_m * taper * flare * self.footing.px_per_m).max(0.7)
    }

    /// Draws branches and stem.
    pub fn draw(&self, band: &mut Band<'_>) {
        self.draw_branches(band);
        let Footing { x, foot_y, fall, px_per_m: p, haze_fraction } = self.footing;
        let wide = self.half_px(0.0) + 2.0;
        let deep = self.dbh_m * p * fall.abs() + 1.0;
        let is_broken = self.height_m < WHOLE_FRACTION * self.height_at_death_m;
        // splinters as long as the stem is wide
        let top_half = self.half_px(self.height_m);
        let splinter_m = if is_broken {
            (2.4 * top_half / p).max(3.0 / p).min(0.5 * self.height_m)
        } else {
            0.0
        };
        let (rows, cols) =
            band.touched([x - wide, foot_y - self.height_m * p - 1.0], [x + wide, foot_y + deep]);
        for row in rows {
            let height_m = (foot_y - row as f32 - 0.5) / p;
            let half = self.half_px(height_m);
            for col in cols.clone() {
                let dx = col as f32 + 0.5 - x;
                let side = (dx / half).clamp(-1.0, 1.0);
                // one side of the break stands higher, in three or four teeth
                let tooth = speck(self.seed, ((dx / top_half + 1.0) * 2.0).floor() as i32, 7);
                let slant = if self.seed.is_multiple_of(2) { side } else { -side };
                let lost = splinter_m * (0.55 * tooth + 0.45 * (0.5 + 0.5 * slant));
                let alpha = edge(half - dx.abs()) * edge((self.height_m - lost - height_m) * p);
                if alpha > 0.0 {
                    let grain = speck(self.seed, (side * 3.0) as i32, row as i32 / 7) - 0.5;
                    let light = (-0.55 * side + 0.35 * grain).clamp(-1.0, 1.0);
                    band.lay(row, col, hazy(lit(self.color, light, 1.0), haze_fraction), alpha);
                }
            }
        }
    }

    fn draw_branches(&self, band: &mut Band<'_>) {
        let Footing { x, foot_y, px_per_m: p, haze_fraction, .. } = self.footing;
        let crown_m = self.height_at_death_m - self.crown_base_m;
        for branch in 0..self.branches {
            let along = (branch as f32 + unit(self.seed, branch)) / self.branches as f32;
            let height_m = self.crown_base_m + 0.94 * along * crown_m;
            if height_m > 0.97 * self.height_m {
                continue; // it fell with the top
            }
            let side = if (branch + self.seed % 2).is_multiple_of(2) { -1.0 } else { 1.0 };
            let reach_m = self.crown_radius_m
                * (1.0 - 0.8 * along)
                * (0.35 + 0.6 * unit(self.seed, 40 + branch));
            let rise_m = reach_m * (0.1 + 0.45 * unit(self.seed, 70 + branch));
            let stroke = Stroke {
                from: [x, foot_y - height_m * p],
                to: [x + side * reach_m * p, foot_y - (height_m + rise_m) * p],
                half_width: [(0.1 * self.dbh_m * p).max(0.7), 0.5],
                ends: Ends::Round,
            };
            let color = hazy(lit(self.color, -0.25, 1.0), haze_fraction);
            lay_stroke(band, &stroke, |along, _| (color, 0.95 - 0.45 * along));
        }
    }
}

/// A downed log from the side: what of it lies in the strip.
#[derive(Clone, Copy, Debug)]
pub struct DownedLogBeside {
    /// Columns of the thick and the thin end of that part.
    x: [f32; 2],
    /// Diameters there, pixels.
    diameter: [f32; 2],
    /// Share of its direction that points at the viewer.
    end_on: f32,
    /// Whether the thick end is the near one.
    is_thick_near: bool,
    color: [f32; 3],
    haze_fraction: f32,
    seed: u32,
}

impl DownedLogBeside {
    /// A downed log of a profile: the part `[start, end]` of its length, whose ends lie at columns `x`.
    pub fn new(
        downed_logs: &DownedLogs,
        i: usize,
        [start, end]: [f32; 2],
        x: [f32; 2],
        footing: Footing,
    ) -> Self {
        let [base_m, tip_m] = [downed_logs.diameter_base_m[i], downed_logs.diameter_tip_m[i]];
        let diameter = |along: f32| {
            ((base_m + along * (tip_m - base_m)) * footing.px_per_m).max(LEAST_WIDTH_PX)
        };
        let north = cos(downed_logs.azimuth_rad[i]);
        Self {
            x,
            diameter: [diameter(start), diameter(end)],
            end_on: north.abs(),
            is_thick_near: north > 0.0,
            color: downed_log_color(downed_logs.decay_class[i]),
            haze_fraction: footing.haze_fraction,
            seed: variety::of_plant(downed_logs.id[i]),
        }
    }

    /// Draws the downed log onto a ground whose row `ground` gives by column.
    pub fn draw(&self, band: &mut Band<'_>, ground: impl Fn(usize) -> f32) {
        let [x0, x1] = self.x;
        let caps = self.diameter.map(|d| 0.5 * d * self.end_on);
        let left = (x0 - caps[0]).min(x1 - caps[1]) - 1.0;
        let right = (x0 + caps[0]).max(x1 + caps[1]) + 1.0;
        let near = if self.is_thick_near { 0 } else { 1 };
        // all rows of the band: the ground under the downed log may rise and fall
        let (rows, cols) = band.touched([left, 0.0], [right, f32::MAX / 2.0]);
        for col in cols {
            let middle = col as f32 + 0.5;
            let along = if (x1 - x0).abs() > 1e-3 { (middle - x0) / (x1 - x0) } else { 0.0 };
            let within = along.clamp(0.0, 1.0);
            let d = self.diameter[0] + within * (self.diameter[1] - self.diameter[0]);
            let body = edge(middle - x0.min(x1)) * edge(x0.max(x1) - middle);
            let line = ground(col);
            for row in rows.clone() {
                let up = (line - row as f32 - 0.5) / d;
                if !(-0.5..=1.0 + 1.0 / d).contains(&up) {
                    continue;
                }
                let solid = body * edge((1.0 - up) * d);
                // ends are ellipses, the narrower the less they face the viewer
                let cap = |end: usize| {
                    let half = [caps[end].max(0.3), 0.5 * self.diameter[end]];
                    let across = (middle - self.x[end]) / half[0];
                    let high = ((line - row as f32 - 0.5) - half[1]) / half[1];
                    edge((1.0 - (across * across + high * high).sqrt()) * half[0].min(half[1]))
                };
                let face = if self.end_on > 0.25 { cap(near) } else { 0.0 };
                let alpha = solid.max(cap(1 - near)).max(face);
                if alpha > 0.0 {
                    let bark = bark(self.seed, middle, up * d);
                    let light = (0.9 * (up - 0.55) + 0.25 * bark).clamp(-1.0, 1.0);
                    let bark = lit(self.color, light, 1.0);
                    let cut: [f32; 3] =
                        std::array::from_fn(|c| CUT[c] + 0.35 * (self.color[c] - CUT[c]));
                    let color = std::array::from_fn(|c| bark[c] + face * (cut[c] - bark[c]));
                    band.lay(row, col, hazy(color, self.haze_fraction), alpha);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::export::canvas::Canvas;
    use crate::export::close_up::light::LightSheet;
    use crate::export::deadwood_layer::tests::{downed_logs, snags};

    const FOOTING: Footing =
        Footing { x: 100.0, foot_y: 180.0, fall: 0.0, px_per_m: 10.0, haze_fraction: 0.0 };

    /// Pixels of a white sheet of 200 × 200 that something changes: their number, and the box around them.
    fn drawn(draw: impl Fn(&mut Band<'_>) + Sync + Send) -> (usize, [u32; 4]) {
        let mut sheet = LightSheet::new(200, 200, |_| [255.0; 3]);
        sheet.draw(draw);
        let mut canvas = Canvas::new(200, 200, [0; 3]);
        sheet.onto(&mut canvas, [0, 0]);
        let seen: Vec<_> =
            canvas.image().enumerate_pixels().filter(|(_, _, p)| p.0[1] < 250).collect();
        let (x, y) = (|| seen.iter().map(|p| p.0), || seen.iter().map(|p| p.1));
        let bounds = [x().min(), y().min(), x().max(), y().max()].map(|v| v.unwrap_or(0));
        (seen.len(), bounds)
    }

    #[test]
    fn parts_of_a_line_within_a_square() {
        let square = [[0.0, 10.0], [0.0, 10.0]];
        assert_eq!(part_within([-10.0, 5.0], [10.0, 5.0], square), Some([0.5, 1.0]));
        assert_eq!(part_within([2.0, 2.0], [3.0, 9.0], square), Some([0.0, 1.0]));
        assert_eq!(part_within([-5.0, 2.0], [2.0, -5.0], square), None);
        assert_eq!(part_within([5.0, 20.0], [5.0, 11.0], square), None);
    }

    #[test]
    fn snags_stand_as_tall_as_what_is_left_of_them() {
        let biome = Biome::builtin("sonoma").unwrap();
        for (height_m, branches) in [(14.0, 0.0), (6.0, 0.0), (14.0, 1.0), (6.0, 1.0)] {
            let snags = snags(&[(0.0, 0.0, height_m, 14.0, 0.5, branches, 2)]);
            let snag = SnagBeside::new(&snags, 0, &biome, FOOTING, 0.5);
            let (count, [left, top, right, bottom]) = drawn(|band| snag.draw(band));
            let expected = 180.0 - 10.0 * height_m;
            assert!((top as f32 - expected).abs() < 6.0, "{height_m}: {top}");
            assert!((178..=182).contains(&bottom) && count > 100);
            assert!(branches == 0.0 || height_m < 14.0 || right - left > 15, "{left} {right}");
        }
    }

    #[test]
    fn logs_lie_on_the_ground_in_their_length_and_as_a_disc_seen_from_their_end() {
        let east = std::f32::consts::FRAC_PI_2;
        let aside = downed_logs(&[(0.0, 0.0, 9.0, 1.0, east, 2)]);
        let downed_log = DownedLogBeside::new(&aside, 0, [0.0, 1.0], [60.0, 150.0], FOOTING);
        let (_, [left, top, right, bottom]) = drawn(|band| downed_log.draw(band, |_| 180.0));
        assert!(left.abs_diff(60) <= 1 && right.abs_diff(150) <= 1, "{left} {right}");
        // the ground is drawn over what reaches below it
        assert!(top.abs_diff(170) <= 1 && (179..=185).contains(&bottom), "{top} {bottom}");
        let end_on = downed_logs(&[(0.0, 0.0, 9.0, 1.0, 0.0, 2)]);
        let downed_log = DownedLogBeside::new(&end_on, 0, [0.0, 0.5], [100.0, 100.0], FOOTING);
        let (count, [left, _, right, _]) = drawn(|band| downed_log.draw(band, |_| 180.0));
        assert!(left.abs_diff(95) <= 1 && right.abs_diff(104) <= 1, "{left} {right}");
        assert!((60..110).contains(&count), "{count}");
    }

    #[test]
    fn crossed_circles_and_thin_logs_are_seen_in_small_scales() {
        let biome = Biome::builtin("sonoma").unwrap();
        let view = View { west_m: 0.0, south_m: 0.0, size_m: 1000.0, side: 200 };
        let snags = snags(&[(500.0, 500.0, 20.0, 20.0, 0.3, 0.0, 1)]);
        let snag = SnagAbove::new(&snags, 0, &biome, &view);
        assert!(drawn(|band| snag.circle(band)).0 > 20);
        let downed_logs = downed_logs(&[(400.0, 500.0, 100.0, 0.1, 0.0, 1)]);
        let (_, [left, top, right, bottom]) =
            drawn(|band| DownedLogAbove::new(&downed_logs, 0, &view).draw(band));
        assert!(right - left <= 4 && bottom - top >= 18, "{left} {top} {right} {bottom}");
    }
}
