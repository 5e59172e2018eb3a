//! Silhouettes of plants from the side: stems, and crowns in the shape of their species.

use super::light::Band;
use super::symbols::Symbol;
use super::variety::{clumps, speck, unit};
use crate::export::relief::lit;
use crate::species::CrownShape;
use crate::tree::outline::half_width;

const BARK: [f32; 3] = [104.0, 84.0, 66.0];
/// Air between the viewer and what stands behind.
const HAZE: [f32; 3] = [244.0, 244.0, 240.0];
/// Least half width of a stem.
const LEAST_STEM_PX: f32 = 0.6;
/// Lowest plant that is drawn, so that mats of herbs are seen in wide transects.
const LEAST_HEIGHT_PX: f32 = 2.0;
/// Height at which stems are measured, m.
const BREAST_HEIGHT_M: f32 = 1.3;
/// Reach of a fern's fronds, in crown radii.
const FROND_REACHES: [f32; 12] =
    [-0.1, 0.14, -0.3, 0.34, -0.5, 0.54, -0.7, 0.72, -0.86, 0.88, -1.0, 0.98];

/// A plant in a profile, in pixels from the profile's upper left corner.
#[derive(Clone, Copy, Debug)]
pub struct Standing {
    /// Column of its stem.
    pub x: f32,
    /// Row of the ground at its stem.
    pub foot_y: f32,
    /// Rows that the ground falls a column to the east.
    pub fall: f32,
    /// Pixels a metre.
    pub px_per_m: f32,
    /// Height above ground.
    pub height_m: f32,
    /// Crown radius.
    pub radius_m: f32,
    /// Height of the lowest branches above ground.
    pub crown_base_m: f32,
    /// Stem diameter at breast height.
    pub dbh_m: f32,
    /// Shape of its crown.
    pub shape: CrownShape,
    /// How it grows.
    pub symbol: Symbol,
    /// Colour of its species.
    pub color: [f32; 3],
    /// What sets it apart from others of its species.
    pub seed: u32,
    /// How much air lies before it, 0..=1.
    pub haze_fraction: f32,
}

/// Coverage of a pixel by its distance inside an edge, in pixels.
fn edge(inside_px: f32) -> f32 {
    (inside_px + 0.5).clamp(0.0, 1.0)
}

impl Standing {
    /// Draws the plant.
    pub fn draw(&self, band: &mut Band<'_>) {
        match self.symbol {
            Symbol::Fern => self.fern(band),
            Symbol::Herb => self.herb(band),
            Symbol::Shrub => {
                self.stems(band, &[-0.45, 0.05, 0.5]);
                self.crown(band, false);
            }
            Symbol::Sapling { needles } => {
                self.stems(band, &[0.0]);
                self.crown(band, needles);
            }
        }
    }

    fn height_px(&self) -> f32 {
        (self.height_m * self.px_per_m).max(LEAST_HEIGHT_PX)
    }

    fn radius_px(&self) -> f32 {
        (self.radius_m * self.px_per_m).max(0.8)
    }

    fn lay(&self, band: &mut Band<'_>, row: usize, col: usize, color: [f32; 3], alpha: f32) {
        if alpha > 0.0 {
            let haze = self.haze_fraction;
            let color = std::array::from_fn(|c| color[c] + haze * (HAZE[c] - color[c]));
            band.lay(row, col, color, alpha);
        }
    }

    /// Stems from the ground into the crown; `leans` say how far each ends from the middle, in crown radii.
    fn stems(&self, band: &mut Band<'_>, leans: &[f32]) {
        let p = self.px_per_m;
        let crown_m = self.height_m - self.crown_base_m;
        let top_m =
            self.crown_base_m + if leans.len() == 1 { 0.7 * crown_m } else { 0.3 * crown_m };
        // a straight taper from breast height to the tip; several stems share the wood
        let breast_m = BREAST_HEIGHT_M.min(0.5 * self.height_m);
        let thick_m = self.dbh_m / (leans.len() as f32).sqrt();
        let reach = self.radius_px() * leans.iter().fold(0.0_f32, |a, l| a.max(l.abs()));
        let wide = reach + self.dbh_m * p + 2.0;
        // on a slope the foot's lower side stands deeper; the ground covers the rest
        let deep = self.dbh_m * p * self.fall.abs() + 1.0;
        let (rows, cols) = band.touched(
            [self.x - wide, self.foot_y - top_m * p - 1.0],
            [self.x + wide, self.foot_y + deep],
        );
        for row in rows {
            let height_m = (self.foot_y - row as f32 - 0.5) / p;
            if height_m > top_m {
                continue;
            }
            let taper = (self.height_m - height_m.max(0.0)) / (self.height_m - breast_m).max(0.01);
            let flare = 1.0 + 0.5 * (1.0 - height_m / 0.6).clamp(0.0, 1.0).powi(2);
            let half = (0.5 * thick_m * taper * flare * p).max(LEAST_STEM_PX);
            for lean in leans {
                let middle =
                    self.x + lean * self.radius_px() * (height_m / top_m.max(0.01)).clamp(0.0, 1.0);
                for col in cols.clone() {
                    let dx = col as f32 + 0.5 - middle;
                    let alpha = edge(half - dx.abs());
                    if alpha > 0.0 {
                        let bark = speck(self.seed, (dx / half * 3.0) as i32, row as i32 / 5);
                        let light = -0.6 * (dx / half).clamp(-1.0, 1.0) + 0.4 * (bark - 0.5) - 0.1;
                        self.lay(band, row, col, lit(BARK, light.clamp(-1.0, 1.0), 1.0), alpha);
                    }
                }
            }
        }
    }

    fn crown(&self, band: &mut Band<'_>, needles: bool) {
        let p = self.px_per_m;
        let (radius, top_y) = (self.radius_px(), self.foot_y - self.height_px());
        let base_y = self.foot_y - self.crown_base_m * p;
        let length = (base_y - top_y).max(1.0);
        // branches of conifers stand in whorls
        let whorls = (length / p / 0.9).clamp(5.0, 24.0);
        // leaves in clumps, never finer than pixels show
        let clump_px = [(0.8 * p).max(5.0), (0.28 * p).max(2.5)];
        let droop = if needles { 0.25 * radius.min(0.8 * p) } else { 0.0 };
        let (rows, cols) = band.touched(
            [self.x - 1.15 * radius - 1.0, top_y - 1.0],
            [self.x + 1.15 * radius + 1.0, base_y + droop + 1.0],
        );
        for row in rows {
            let y = row as f32 + 0.5;
            for col in cols.clone() {
                let dx = col as f32 + 0.5 - self.x;
                let side = if dx < 0.0 { 1 } else { 2 };
                // drooping branches: the outline further out belongs to a whorl higher up
                let away = dx.abs() / radius;
                let ragged = (0.5 * p).min(0.09 * length)
                    * clumps(self.seed ^ 5, dx / (0.8 * p).max(4.0), 9.5);
                let along = (base_y - y + droop * away) / length;
                let along = along + ragged * (1.0 - along).clamp(0.0, 1.0) / length;
                if !(-0.02..=1.02).contains(&along) {
                    continue;
                }
                let mut half = radius * half_width(self.shape, along);
                if needles {
                    let whorl = (along * whorls + 0.37 * side as f32 + unit(self.seed, 3)).fract();
                    half *= 1.0 - 0.34 * whorl;
                    half += 0.6;
                } else {
                    let lump = clumps(self.seed ^ side, along * length / (0.9 * p).max(5.0), 0.5);
                    half *= 1.0 + 0.13 * lump;
                }
                let inside = half - dx.abs();
                let alpha = edge(inside) * edge(along * length) * edge((1.0 - along) * length);
                if alpha <= 0.0 {
                    continue;
                }
                let foliage = 0.6 * clumps(self.seed, dx / clump_px[0] + 500.0, y / clump_px[0])
                    + 0.4 * clumps(self.seed ^ 7, dx / clump_px[1] + 500.0, y / clump_px[1]);
                let round = dx / half.max(1.0);
                let rim = (1.0 - inside / 2.5).clamp(0.0, 1.0);
                let light = -0.42 * round + 0.45 * (along - 0.5) + 0.36 * foliage - 0.28 * rim;
                // full light would bleach the species' colour
                let light = if light > 0.0 { 0.5 * light } else { light.max(-1.0) };
                // here and there one sees through
                let gap = 1.0 - 0.45 * crate::math::smoothstep((-0.5 - foliage) / 0.25);
                self.lay(band, row, col, lit(self.color, light, 1.0), alpha * gap);
            }
        }
    }

    fn fern(&self, band: &mut Band<'_>) {
        let (high, wide) = (self.height_px(), self.radius_px());
        let (rows, cols) = band.touched(
            [self.x - wide - 1.0, self.foot_y - high - 1.0],
            [self.x + wide + 1.0, self.foot_y],
        );
        // a frond rises, arches at 0.82 of its reach, and hangs: y = tall · (2.43 s − 1.48 s²)
        for row in rows {
            let y = self.foot_y - row as f32 - 0.5;
            for col in cols.clone() {
                let dx = col as f32 + 0.5 - self.x;
                for (frond, reach) in (0_u32..).zip(FROND_REACHES) {
                    // outer fronds hang lower
                    let tall = high
                        * (0.85 + 0.15 * unit(self.seed, 40 + frond))
                        * (1.0 - 0.4 * reach * reach);
                    let reach_px = reach * wide * (0.85 + 0.15 * unit(self.seed, 50 + frond));
                    let s = dx / reach_px;
                    if !(0.0..=1.0).contains(&s) {
                        continue;
                    }
                    let away = (y - tall * (2.43 - 1.48 * s) * s).abs();
                    let slope = tall * (2.43 - 2.96 * s) / reach_px;
                    let blade = (0.055 * high * (1.0 - s) + 0.5).max(0.6)
                        * (1.0 - 0.35 * (s * 9.0).fract());
                    let alpha = edge(blade - away / (1.0 + slope * slope).sqrt());
                    let light = 0.55 * s - 0.35 + 0.3 * (unit(self.seed, 60 + frond) - 0.5);
                    self.lay(band, row, col, lit(self.color, light, 1.0), alpha);
                }
            }
        }
    }

    fn herb(&self, band: &mut Band<'_>) {
        let (high, wide) = (self.height_px(), self.radius_px());
        // mats lie on the ground as it slopes
        let skew = wide * self.fall.abs();
        let (rows, cols) = band.touched(
            [self.x - wide, self.foot_y - high - skew - 1.0],
            [self.x + wide, self.foot_y + skew],
        );
        let leaf_px = (0.1 * self.px_per_m).max(2.0);
        for row in rows {
            for col in cols.clone() {
                let dx = col as f32 + 0.5 - self.x;
                let y = self.foot_y + self.fall * dx - row as f32 - 0.5;
                let s = (dx / wide).clamp(-1.0, 1.0);
                let leaf = (dx / leaf_px).floor();
                let bump = 1.0 - (2.0 * (dx / leaf_px - leaf) - 1.0).powi(2);
                let tall = 0.55 + 0.45 * speck(self.seed, leaf as i32, 0);
                let top = high * (1.0 - s * s).sqrt() * tall * (0.7 + 0.3 * bump);
                let light = 0.8 * (y / high) - 0.5 + 0.4 * (speck(self.seed, leaf as i32, 1) - 0.5);
                let color = lit(self.color, light.clamp(-1.0, 1.0), 1.0);
                self.lay(band, row, col, color, edge(top - y));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::export::canvas::Canvas;
    use crate::export::close_up::light::LightSheet;

    /// Box of the coloured pixels of a plant 5 m tall and 2 m in radius, standing at (100, 180) at 30 pixels a metre.
    fn extent(symbol: Symbol, shape: CrownShape) -> [u32; 4] {
        let plant = Standing {
            x: 100.0,
            foot_y: 180.0,
            fall: 0.0,
            px_per_m: 30.0,
            height_m: 5.0,
            radius_m: 2.0,
            crown_base_m: 1.0,
            dbh_m: 0.2,
            shape,
            symbol,
            color: [20.0, 160.0, 40.0],
            seed: 5,
            haze_fraction: 0.0,
        };
        let mut sheet = LightSheet::new(200, 200, |_| [255.0; 3]);
        sheet.draw(|band| plant.draw(band));
        let mut canvas = Canvas::new(200, 200, [0; 3]);
        sheet.onto(&mut canvas, [0, 0]);
        let drawn: Vec<_> =
            canvas.image().enumerate_pixels().filter(|(_, _, p)| p.0 != [255; 3]).collect();
        let x = || drawn.iter().map(|p| p.0);
        let y = || drawn.iter().map(|p| p.1);
        [x().min().unwrap(), y().min().unwrap(), x().max().unwrap(), y().max().unwrap()]
    }

    #[test]
    fn plants_stand_on_the_ground_in_true_size() {
        let symbols =
            [Symbol::Fern, Symbol::Herb, Symbol::Shrub, Symbol::Sapling { needles: true }];
        for symbol in symbols {
            for shape in [CrownShape::Ellipsoid, CrownShape::Cone, CrownShape::InvertedCone] {
                let [left, top, right, bottom] = extent(symbol, shape);
                assert!((28..=80).contains(&top), "{symbol:?} {shape:?}: top {top}");
                assert!((177..=182).contains(&bottom), "{symbol:?} {shape:?}: bottom {bottom}");
                assert!(
                    (30..=60).contains(&left) && (140..=170).contains(&right),
                    "{symbol:?} {shape:?}: {left} {right}"
                );
            }
        }
        let [_, top, ..] = extent(Symbol::Sapling { needles: false }, CrownShape::Ellipsoid);
        assert!((29..=31).contains(&top), "{top}");
    }
}
