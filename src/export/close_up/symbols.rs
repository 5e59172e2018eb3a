//! Symbols of plants from above: rosettes of ferns, mats of herbs, lumpy shrubs, saplings, rings of canopy trees.

use std::f32::consts::TAU;

use super::light::Band;
use super::variety::{speck, unit};
use crate::export::relief::lit;
use crate::math::{atan2, cos, sin};
use crate::species::{Form, Leaf, Species};

/// Least radius of a symbol: smaller plants are still seen.
const LEAST_RADIUS_PX: f32 = 1.3;
/// Least radius of a stem's dot.
const LEAST_STEM_PX: f32 = 2.0;
const BARK: [f32; 3] = [64.0, 48.0, 38.0];
const DARK: [f32; 3] = [24.0, 26.0, 30.0];
const PALE: [f32; 3] = [255.0, 252.0, 240.0];
/// Leaves of a mat of herbs, metres apart, and the fewest pixels that takes.
const LEAF_M: f32 = 0.15;
const LEAST_LEAF_PX: f32 = 4.2;
/// Width of a crown's ring.
const RING_PX: f32 = 2.6;
/// How much of its own colour a crown lays over what is below it.
const CROWN_TINT: f32 = 0.10;
/// How dark the shade of a crown is that lets no light through.
const CROWN_SHADE: f32 = 0.42;

/// How a plant of the undergrowth is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Symbol {
    /// Fronds around a middle.
    Fern,
    /// A mat of small leaves.
    Herb,
    /// A disc of several domes.
    Shrub,
    /// A small disc with its stem in the middle; spiky with needles.
    Sapling {
        /// Needles or broad leaves.
        needles: bool,
    },
}

impl Symbol {
    /// The symbol of a species' undergrowth.
    pub fn of(species: &Species) -> Self {
        match (species.form, species.leaf) {
            (_, Leaf::Frond) => Self::Fern,
            (Form::Herb, _) => Self::Herb,
            (Form::Shrub | Form::ShrubVine, _) => Self::Shrub,
            (Form::ShrubTree | Form::Tree, leaf) => Self::Sapling { needles: leaf == Leaf::Needle },
        }
    }
}

/// A plant of the undergrowth on the sheet, in pixels from its upper left corner.
#[derive(Clone, Copy, Debug)]
pub struct LowPlant {
    /// Column of its middle.
    pub x: f32,
    /// Row of its middle.
    pub y: f32,
    /// Crown radius.
    pub radius: f32,
    /// Height above ground.
    pub height: f32,
    /// Pixels a metre.
    pub px_per_m: f32,
    /// Colour of its species.
    pub color: [f32; 3],
    /// What sets it apart from others of its species.
    pub seed: u32,
    /// How it is drawn.
    pub symbol: Symbol,
}

/// A canopy tree on the sheet, in pixels from its upper left corner.
#[derive(Clone, Copy, Debug)]
pub struct CanopyTree {
    /// Column of its stem.
    pub x: f32,
    /// Row of its stem.
    pub y: f32,
    /// Crown radius.
    pub radius: f32,
    /// Radius of its stem at breast height.
    pub stem_radius: f32,
    /// Colour of its species.
    pub color: [f32; 3],
    /// Share of the light that its crown takes.
    pub absorbed_light_fraction: f32,
}

/// What of a symbol lies over a pixel.
struct Ink {
    color: [f32; 3],
    alpha: f32,
}

/// A place on a symbol: radii east and south of its middle, and the distance from it.
#[derive(Clone, Copy)]
struct Place {
    east: f32,
    south: f32,
    distance: f32,
}

/// Coverage of a pixel by its distance inside an edge, in pixels.
fn edge(inside_px: f32) -> f32 {
    (inside_px + 0.5).clamp(0.0, 1.0)
}

/// Light from the north-west on a dome's side, −1..=1.
fn dome(east: f32, south: f32) -> f32 {
    (-0.55 * (east + south) - 0.3 * (east * east + south * south)).clamp(-1.0, 1.0)
}

impl LowPlant {
    /// Draws the plant's shadow and the plant.
    pub fn draw(&self, band: &mut Band<'_>) {
        let radius = self.radius.max(LEAST_RADIUS_PX);
        let far = 2.0 * radius + 2.0; // its shadow too
        if band.touched([0.0, self.y - far], [0.0, self.y + far]).0.is_empty() {
            return;
        }
        self.cast(band);
        let Self { x, y, .. } = *self;
        match self.symbol {
            Symbol::Fern => each_pixel(band, x, y, radius, 1.0, |at| self.fern(at, radius)),
            Symbol::Herb => {
                let turn = TAU * unit(self.seed, 98);
                let turn = [cos(turn), sin(turn)];
                each_pixel(band, x, y, radius, 1.0, |at| self.herb(at, radius, turn));
            }
            Symbol::Shrub => {
                let lumps = self.lumps();
                each_pixel(band, x, y, radius, 1.1, |at| self.shrub(at, radius, &lumps));
            }
            Symbol::Sapling { needles } => {
                each_pixel(band, x, y, radius, 1.0, |at| self.sapling(at, radius, needles));
            }
        }
    }

    /// The shadow on what lies south-east.
    fn cast(&self, band: &mut Band<'_>) {
        let shift = (0.3 * self.height).clamp(0.6, 0.6 * self.radius.max(1.2));
        let soft = (0.25 * self.radius).max(1.0);
        each_pixel(band, self.x + shift, self.y + shift, self.radius, 1.1, |at| {
            let inside = (1.0 - at.distance) * self.radius / soft;
            Some(Ink { color: DARK, alpha: 0.3 * inside.clamp(0.0, 1.0) })
        });
    }

    fn fern(&self, at: Place, radius: f32) -> Option<Ink> {
        let fronds = 8 + self.seed % 4;
        let step = TAU / fronds as f32;
        let along = atan2(at.south, at.east) / step + unit(self.seed, 0);
        let nearest = along.round();
        let frond = (nearest as i32).rem_euclid(fronds.cast_signed()).cast_unsigned();
        let length = 0.78 + 0.22 * unit(self.seed, 1 + frond);
        let q = at.distance / length;
        if q >= 1.0 {
            return None;
        }
        let aside = (along - nearest) * step * at.distance;
        // leaflets show where they are some pixels long
        let leaflet = (q * 11.0 + aside.abs() * 9.0).fract();
        let notch = if radius > 16.0 { 0.22 * leaflet } else { 0.0 };
        let half_width = (0.6 * q * (1.0 - q) + 0.03) * (1.0 - notch);
        let alpha = edge((half_width - aside.abs()) * radius) * edge((1.0 - q) * radius - 0.5);
        let fold = if aside * (at.east - at.south) > 0.0 { 0.12 } else { -0.12 };
        let rib = radius > 9.0 && aside.abs() * radius < 0.7 && q < 0.9;
        let light =
            0.8 * dome(at.east, at.south) + fold + 0.3 * (unit(self.seed, 20 + frond) - 0.5)
                - 0.35 * (1.0 - q).powi(6)
                + if rib { 0.4 } else { 0.0 };
        Some(Ink { color: lit(self.color, light.clamp(-1.0, 1.0), 1.0), alpha })
    }

    fn herb(&self, at: Place, radius: f32, [cos_turn, sin_turn]: [f32; 2]) -> Option<Ink> {
        let leaf_px = (LEAF_M * self.px_per_m).max(LEAST_LEAF_PX);
        // a lattice of leaves, turned and shaken until no rows are seen
        let (across, down) = (radius / leaf_px * cos_turn, radius / leaf_px * sin_turn);
        let x = at.east * across - at.south * down;
        let y = at.east * down + at.south * across;
        let (col, row) = (x.floor(), y.floor());
        let look = |aspect: u32| speck(self.seed ^ aspect, col as i32, row as i32);
        let (jitter_x, jitter_y) = (0.4 * (look(1) - 0.5), 0.4 * (look(2) - 0.5));
        let (dx, dy) = (x - col - 0.5 - jitter_x, y - row - 0.5 - jitter_y);
        // three lobes, as of sorrel and clover
        let angle = atan2(dy, dx) + TAU * look(3);
        let lobe = 0.36 + if leaf_px > 5.0 { 0.11 * cos(3.0 * angle) } else { 0.0 };
        let sparse = at.distance * at.distance * at.distance;
        let leaf = if look(4) < sparse {
            0.0
        } else {
            edge((lobe - (dx * dx + dy * dy).sqrt()) * leaf_px)
        };
        // mats of some pixels show no leaves: their ground is all there is to see
        let dense = 0.34 + 0.5 * (1.0 - radius / 7.0).max(0.0);
        let mat = dense * edge((0.97 - at.distance) * radius) * (1.0 - 0.6 * sparse);
        let light = (0.6 * (look(5) - 0.4)).clamp(-1.0, 1.0);
        let inside = edge((1.0 - at.distance) * radius);
        let alpha = inside * (leaf + (1.0 - leaf) * mat);
        let color =
            if leaf > 0.3 { lit(self.color, light, 1.0) } else { lit(self.color, -0.25, 1.0) };
        Some(Ink { color, alpha })
    }

    /// Middles and radii of a shrub's domes, in its own radii.
    fn lumps(&self) -> [[f32; 3]; 7] {
        std::array::from_fn(|lump| {
            let look = |aspect: u32| unit(self.seed, 100 + 4 * lump as u32 + aspect);
            if lump == 0 {
                return [0.0, 0.0, 0.6];
            }
            let turn = TAU * ((lump as f32 + 0.55 * (look(0) - 0.5)) / 6.0 + unit(self.seed, 99));
            let away = 0.5 + 0.12 * look(1);
            [away * cos(turn), away * sin(turn), 0.36 + 0.1 * look(2)]
        })
    }

    fn shrub(&self, at: Place, radius: f32, lumps: &[[f32; 3]; 7]) -> Option<Ink> {
        let (mut inside, mut height, mut on) = (f32::MIN, f32::MIN, [0.0; 2]);
        for [east, south, lump] in *lumps {
            let (dx, dy) = (at.east - east, at.south - south);
            let away2 = dx * dx + dy * dy;
            // distance inside the edge, to first order
            inside = inside.max(0.5 * (lump - away2 / lump));
            // domes in the middle stand higher
            let here = lump * lump - away2 - 0.1 * (east * east + south * south);
            if here > height {
                (height, on) = (here, [dx / lump, dy / lump]);
            }
        }
        let alpha = edge(inside * radius);
        if alpha <= 0.0 {
            return None;
        }
        let rim = (1.0 - inside * radius / (0.07 * radius + 1.5)).clamp(0.0, 1.0);
        let [dx, dy] = on;
        let crease = (dx * dx + dy * dy).min(1.2);
        let leaves = self.leaves(at, radius);
        let light = 0.55 * dome(at.east, at.south) + 0.55 * dome(dx, dy) - 0.18 * crease * crease
            + 0.22 * leaves
            + 0.1
            - 0.4 * rim;
        Some(Ink { color: lit(self.color, light.clamp(-1.0, 1.0), 1.0), alpha })
    }

    /// Texture of leaves, −½..=½.
    fn leaves(&self, at: Place, radius: f32) -> f32 {
        let (col, row) = ((at.east * radius) as i32 / 2, (at.south * radius) as i32 / 2);
        speck(self.seed, col, row) - 0.5
    }

    fn sapling(&self, at: Place, radius: f32, needles: bool) -> Option<Ink> {
        let reach = if needles {
            let spikes = 7.0 + (self.seed % 3) as f32;
            0.86 + 0.14 * cos(spikes * atan2(at.south, at.east) + TAU * unit(self.seed, 0))
        } else {
            1.0
        };
        let inside = reach - at.distance;
        let alpha = edge(inside * radius);
        if alpha <= 0.0 {
            return None;
        }
        let stem = edge(0.13_f32.max(0.9 / radius) * radius - at.distance * radius);
        let rim = (1.0 - inside * radius / 1.6).clamp(0.0, 1.0);
        let leaves = self.leaves(at, radius);
        let light = 0.9 * dome(at.east, at.south) + 0.15 + 0.2 * leaves - 0.55 * rim;
        let color = lit(self.color, light.clamp(-1.0, 1.0), 1.0);
        let stem = if radius > 3.0 { 0.85 * stem } else { 0.0 };
        Some(Ink { color: std::array::from_fn(|c| color[c] + stem * (DARK[c] - color[c])), alpha })
    }
}

impl CanopyTree {
    /// Multiplies the light left below crowns, for rows from `first_row` on of `cols` pixels.
    pub fn dim(&self, light: &mut [f32], band: &Band<'_>, first_row: usize, cols: usize) {
        let [r, x, y] = [self.radius, self.x, self.y];
        let (rows, across) = band.touched([x - r - 1.0, y - r - 1.0], [x + r + 1.0, y + r + 1.0]);
        for row in rows {
            let dy = row as f32 + 0.5 - y;
            for col in across.clone() {
                let dx = col as f32 + 0.5 - x;
                let taken = edge(r - (dx * dx + dy * dy).sqrt());
                let left = 1.0 - CROWN_SHADE * self.absorbed_light_fraction * taken;
                light[(row - first_row) * cols + col] *= left;
            }
        }
    }

    /// Draws the crown as a tint within a ring.
    pub fn ring(&self, band: &mut Band<'_>) {
        each_pixel(band, self.x, self.y, self.radius, 1.0, |at| {
            let inside = (1.0 - at.distance) * self.radius;
            let ring = edge(inside) * edge(RING_PX - inside - 0.5);
            let (color, alpha) = if ring > 0.0 {
                (self.color, CROWN_TINT + (0.95 - CROWN_TINT) * ring)
            } else {
                (self.color, CROWN_TINT * edge(inside))
            };
            Some(Ink { color, alpha })
        });
    }

    /// Draws the stem in true size, but never too small to be seen, in a pale rim.
    pub fn stem(&self, band: &mut Band<'_>) {
        let radius = self.stem_radius.max(LEAST_STEM_PX);
        let rim = 1.4;
        let around = radius + rim;
        each_pixel(band, self.x, self.y, around, 1.0, |at| {
            let inside = radius - at.distance * around;
            let alpha = 0.8 * edge(around - at.distance * around);
            let wood = edge(inside);
            // rings of the cut stem
            let ring = if radius > 7.0 {
                0.25 * ((at.distance * around / 2.2).fract() - 0.5)
            } else {
                0.0
            };
            let wood_color = lit(BARK, ring.clamp(-1.0, 1.0), 1.0);
            let color = std::array::from_fn(|c| PALE[c] + wood * (wood_color[c] - PALE[c]));
            Some(Ink { color, alpha: alpha.max(wood) })
        });
    }
}

/// Lays what `ink` gives over all pixels of a disc, `reach` radii wide.
fn each_pixel(
    band: &mut Band<'_>,
    x: f32,
    y: f32,
    radius: f32,
    reach: f32,
    ink: impl Fn(Place) -> Option<Ink>,
) {
    let far = reach * radius + 1.0;
    let (rows, cols) = band.touched([x - far, y - far], [x + far, y + far]);
    let most = far / radius;
    for row in rows {
        let south = (row as f32 + 0.5 - y) / radius;
        for col in cols.clone() {
            let east = (col as f32 + 0.5 - x) / radius;
            let distance = (east * east + south * south).sqrt();
            if distance > most {
                continue;
            }
            if let Some(Ink { color, alpha }) = ink(Place { east, south, distance })
                && alpha > 0.0
            {
                band.lay(row, col, color, alpha);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::export::canvas::Canvas;
    use crate::export::close_up::light::LightSheet;
    use crate::species::Biome;

    const EACH: [Symbol; 5] = [
        Symbol::Fern,
        Symbol::Herb,
        Symbol::Shrub,
        Symbol::Sapling { needles: true },
        Symbol::Sapling { needles: false },
    ];

    /// Pixels that a symbol of a radius of 30 changes on a white sheet of 100 × 100, with the means of their places.
    fn drawn(symbol: Symbol, radius: f32) -> (usize, [f64; 2], f64) {
        let plant = LowPlant {
            x: 50.0,
            y: 50.0,
            radius,
            height: 0.0,
            px_per_m: 20.0,
            color: [30.0, 60.0, 220.0],
            seed: 77,
            symbol,
        };
        let mut sheet = LightSheet::new(100, 100, |_| [255.0; 3]);
        sheet.draw(|band| plant.draw(band));
        let mut canvas = Canvas::new(100, 100, [0; 3]);
        sheet.onto(&mut canvas, [0, 0]);
        let blue: Vec<[f64; 2]> = canvas
            .image()
            .enumerate_pixels()
            .filter(|(_, _, p)| i32::from(p.0[2]) - i32::from(p.0[0]) > 25)
            .map(|(x, y, _)| [f64::from(x) + 0.5, f64::from(y) + 0.5])
            .collect();
        let count = blue.len().max(1) as f64;
        let mean = std::array::from_fn(|axis| blue.iter().map(|p| p[axis]).sum::<f64>() / count);
        let away = |[x, y]: &[f64; 2]| ((x - 50.0) * (x - 50.0) + (y - 50.0) * (y - 50.0)).sqrt();
        let far = blue.iter().map(away).fold(0.0, f64::max);
        (blue.len(), mean, far)
    }

    #[test]
    fn symbols_lie_round_their_place_within_their_radius() {
        for symbol in EACH {
            let (count, [x, y], far) = drawn(symbol, 30.0);
            let disc = std::f64::consts::PI * 900.0;
            let share = count as f64 / disc;
            assert!((0.3..1.1).contains(&share), "{symbol:?} covers {share} of its disc");
            assert!((x - 50.0).abs() < 3.0 && (y - 50.0).abs() < 3.0, "{symbol:?}: {x} {y}");
            assert!((24.0..33.5).contains(&far), "{symbol:?} reaches {far}");
        }
    }

    #[test]
    fn the_smallest_plant_is_seen() {
        for symbol in EACH {
            assert!(drawn(symbol, 0.05).0 >= 1, "{symbol:?}");
        }
    }

    #[test]
    fn species_have_the_symbols_of_their_form() {
        let sonoma = Biome::builtin("sonoma").unwrap();
        let of = |key: &str| Symbol::of(sonoma.species_by_key(key).unwrap());
        assert_eq!(of("western-swordfern"), Symbol::Fern);
        assert_eq!(of("redwood-sorrel"), Symbol::Herb);
        assert_eq!(of("toyon"), Symbol::Shrub);
        assert_eq!(of("douglas-fir"), Symbol::Sapling { needles: true });
        assert_eq!(of("coast-live-oak"), Symbol::Sapling { needles: false });
    }
}
