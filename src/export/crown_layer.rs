//! Crowns from above: little domes in the colours of their species, lit from the north-west, as a layer to lay over a map.
//!
//! Crowns of some pixels are drawn at several samples a pixel, taller over lower ones. Smaller ones cannot be told
//! apart: each adds its area to the pixels it lies in, and the canopy reads as a tint.

use std::ops::Range;

use rayon::prelude::*;

use super::relief::{self, lit};
use crate::plants::{Layer, Plants};
use crate::raster::Frame;
use crate::species::Biome;

/// Rows of pixels drawn by one worker at a time.
const BAND_ROWS: usize = 16;
/// Radius below which crowns are a tint, pixels: a disc of 1.5 pixels is a dot without form.
const LEAST_DRAWN_PX: f32 = 0.75;
/// Radius from which a crown shows all of its light and shade, pixels.
const WELL_SEEN_PX: f32 = 4.0;
/// Rise of a crown's dome in radii, as the lamp sees it.
const DOME_RISE: f32 = 0.5;
/// How much darker a crown's rim is, in light of −1..=1.
const RIM_SHADE: f32 = 0.5;
/// How far a crown's shadow falls to the south and to the east, in radii.
const SHADOW_SHIFT: f32 = 0.42;
/// No crown here.
const NONE: u32 = u32::MAX;

/// Canopy over a map's pixels, row-major from the north-west.
#[derive(Clone, Debug, PartialEq)]
pub struct CrownLayer {
    /// Colour of what is covered, 0..=255 a channel.
    pub color: Vec<[f32; 3]>,
    /// Share of the pixel under crowns.
    pub cover: Vec<f32>,
    /// Share of the pixel that is ground in a crown's shadow.
    pub shadow: Vec<f32>,
}

/// A crown on the sheet, in pixels from the map's upper left corner.
#[derive(Clone, Copy, Debug)]
struct Disc {
    x: f32,
    y: f32,
    radius: f32,
    /// Elevation of the tree's top, pixels.
    top: f32,
    color: [f32; 3],
}

/// Sums over samples of one pixel: colours as light (squares of code values), and counts.
#[derive(Clone, Copy, Debug, Default)]
struct Sum {
    light: [f32; 3],
    cover: f32,
    shadow: f32,
}

impl CrownLayer {
    /// Crowns of the canopy's plants over a map of `rows` × `cols` pixels that shows the ground of `frame`.
    pub fn draw(plants: &Plants, biome: &Biome, frame: &Frame, rows: usize, cols: usize) -> Self {
        let discs = discs(plants, biome, frame, rows, cols);
        let typical = typical_radius(&discs);
        let bands = Bands::of(&discs, rows);
        let mut sums = vec![Sum::default(); rows * cols];
        sums.par_chunks_mut(BAND_ROWS * cols).enumerate().for_each(|(band, sums)| {
            let near = bands.discs[bands.of_band(band)].iter().map(|&i| &discs[i as usize]);
            let first_row = band * BAND_ROWS;
            if typical < LEAST_DRAWN_PX {
                tint(sums, cols, first_row, near);
            } else {
                domes(sums, cols, first_row, near, typical);
            }
        });
        let color = |sum: &Sum| sum.light.map(|l| (l / sum.cover.max(1e-6)).sqrt());
        Self {
            color: sums.iter().map(color).collect(),
            cover: sums.iter().map(|s| s.cover.min(1.0)).collect(),
            shadow: sums.iter().map(|s| s.shadow).collect(),
        }
    }
}

fn discs(plants: &Plants, biome: &Biome, frame: &Frame, rows: usize, cols: usize) -> Vec<Disc> {
    let height_m = frame.rows as f32 * frame.cell_m();
    let px_per_m = cols as f32 / (frame.cols as f32 * frame.cell_m());
    let disc = |i: usize| Disc {
        x: plants.east_m[i] * px_per_m,
        y: (height_m - plants.north_m[i]) * (rows as f32 / height_m),
        radius: (plants.crown_radius_m[i] * px_per_m).max(1e-3),
        top: (plants.z_m[i] + plants.height_m[i]) * px_per_m,
        color: biome.species[usize::from(plants.species[i])].color_srgb.map(f32::from),
    };
    (0..plants.len())
        .into_par_iter()
        .filter(|&i| plants.layer[i] == Layer::Canopy)
        .map(disc)
        .collect()
}

/// Radius in pixels by which most of the canopy is drawn: the mean weighted by area, 0 without crowns.
fn typical_radius(discs: &[Disc]) -> f32 {
    let (mut areas, mut cubes) = (0.0_f64, 0.0_f64);
    for disc in discs {
        let radius = f64::from(disc.radius);
        areas += radius * radius;
        cubes += radius * radius * radius;
    }
    (cubes / areas.max(1e-9)) as f32
}

/// Which discs touch which band of rows.
struct Bands {
    starts: Vec<u32>,
    discs: Vec<u32>,
}

impl Bands {
    fn of(discs: &[Disc], rows: usize) -> Self {
        let count = rows.div_ceil(BAND_ROWS);
        let touched = |disc: &Disc| -> Range<usize> {
            // crown, shadow, and a pixel for what rounding moves; `as` cuts negatives to 0
            let reach = disc.radius * (1.0 + SHADOW_SHIFT) + 1.0;
            let first = ((disc.y - reach).max(0.0) / BAND_ROWS as f32) as usize;
            let end = ((disc.y + reach) / BAND_ROWS as f32 + 1.0) as usize;
            first.min(count)..end.min(count)
        };
        let mut starts = vec![0_u32; count + 1];
        for disc in discs {
            touched(disc).for_each(|band| starts[band + 1] += 1);
        }
        for band in 0..count {
            starts[band + 1] += starts[band];
        }
        let mut next = starts.clone();
        let mut sorted = vec![0_u32; starts[count] as usize];
        for (index, disc) in discs.iter().enumerate() {
            for band in touched(disc) {
                sorted[next[band] as usize] = index as u32; // scenes hold far fewer than 2³² trees
                next[band] += 1;
            }
        }
        Self { starts, discs: sorted }
    }

    fn of_band(&self, band: usize) -> Range<usize> {
        self.starts[band] as usize..self.starts[band + 1] as usize
    }
}

/// Adds each crown's area and colour to the four pixels around it.
fn tint<'a>(
    sums: &mut [Sum],
    cols: usize,
    first_row: usize,
    discs: impl Iterator<Item = &'a Disc>,
) {
    let rows = sums.len() / cols;
    for disc in discs {
        let (x, y) = (disc.x - 0.5, disc.y - 0.5 - first_row as f32);
        let (left, above) = (x.floor(), y.floor());
        let (u, v) = (x - left, y - above);
        let area = std::f32::consts::PI * disc.radius * disc.radius;
        for (row, share_v) in [(above, 1.0 - v), (above + 1.0, v)] {
            for (col, share_u) in [(left, 1.0 - u), (left + 1.0, u)] {
                let inside = (0.0..rows as f32).contains(&row) && (0.0..cols as f32).contains(&col);
                if inside {
                    let sum = &mut sums[row as usize * cols + col as usize];
                    let covered = area * share_u * share_v;
                    sum.cover += covered;
                    for (light, code) in sum.light.iter_mut().zip(disc.color) {
                        *light += covered * code * code;
                    }
                }
            }
        }
    }
}

/// Draws crowns at several samples a pixel: the highest dome is seen, beside it the ground lies in shade or light.
fn domes<'a>(
    sums: &mut [Sum],
    cols: usize,
    first_row: usize,
    discs: impl Iterator<Item = &'a Disc> + Clone,
    typical: f32,
) {
    // chosen: edges of small crowns need sixteen samples to lie smoothly, large ones nine
    let samples = if typical < 3.0 { 4 } else { 3 };
    let (wide, high) = (cols * samples, sums.len() / cols * samples);
    let scale = samples as f32;
    let discs: Vec<&Disc> = discs.collect();
    let mut surface = vec![f32::NEG_INFINITY; wide * high];
    let mut owner = vec![NONE; wide * high];
    let mut shaded = vec![false; wide * high];
    for (index, disc) in (0_u32..).zip(&discs) {
        let center = disc.top - disc.radius;
        within(disc, 0.0, first_row, scale, [wide, high], |row, cols, [x, y, radius2]| {
            let line = row * wide;
            for col in cols {
                let dx = col as f32 + 0.5 - x;
                let rise2 = radius2 - dx * dx - y * y;
                if rise2 >= 0.0 {
                    let here = center + rise2.sqrt() / scale;
                    if here > surface[line + col] {
                        surface[line + col] = here;
                        owner[line + col] = index;
                    }
                }
            }
        });
        within(disc, SHADOW_SHIFT, first_row, scale, [wide, high], |row, cols, [x, y, radius2]| {
            for col in cols {
                let dx = col as f32 + 0.5 - x;
                shaded[row * wide + col] |= dx * dx + y * y <= radius2;
            }
        });
    }
    // shade and average
    let seen = ((typical - LEAST_DRAWN_PX) / (WELL_SEEN_PX - LEAST_DRAWN_PX)).clamp(0.0, 1.0);
    let strength = 0.5 + 0.5 * seen;
    let share = 1.0 / (scale * scale);
    for row in 0..high {
        for col in 0..wide {
            let sample = row * wide + col;
            let sum = &mut sums[row / samples * cols + col / samples];
            if owner[sample] == NONE {
                sum.shadow += share * f32::from(u8::from(shaded[sample]));
                continue;
            }
            let disc = discs[owner[sample] as usize];
            let x = ((col as f32 + 0.5) / scale - disc.x) / disc.radius;
            let y = ((row as f32 + 0.5) / scale + first_row as f32 - disc.y) / disc.radius;
            let color = lit(disc.color, dome_light(x, y), strength);
            sum.cover += share;
            for (light, code) in sum.light.iter_mut().zip(color) {
                *light += share * code * code;
            }
        }
    }
}

/// Calls `draw` for each row of samples that a disc moved south-east by `shift` radii may touch, with the columns it
/// may touch and in samples: the column of its middle, the row's distance from it, the square of its radius.
fn within(
    disc: &Disc,
    shift: f32,
    first_row: usize,
    scale: f32,
    [wide, high]: [usize; 2],
    mut draw: impl FnMut(usize, Range<usize>, [f32; 3]),
) {
    let radius = disc.radius * scale;
    let x = disc.x * scale + shift * radius;
    let y = (disc.y - first_row as f32) * scale + shift * radius;
    // `as` cuts negatives to 0
    let span = |at: f32, end: usize| {
        let first = ((at - radius) as usize).min(end);
        first..((at + radius + 1.0) as usize).min(end)
    };
    for row in span(y, high) {
        draw(row, span(x, wide), [x, row as f32 + 0.5 - y, radius * radius]);
    }
}

/// Light on a dome at a place in radii east and south of its top, −1..=1 against flat ground's 0.
fn dome_light(east: f32, south: f32) -> f32 {
    let distance2 = east * east + south * south;
    // a paraboloid's normal is (2k·east, 2k·south, 1)
    let (gx, gy) = (2.0 * DOME_RISE * east, 2.0 * DOME_RISE * south);
    let flat = std::f32::consts::FRAC_1_SQRT_2;
    let cosine = (flat - 0.5 * (gx + gy)) / (1.0 + gx * gx + gy * gy).sqrt();
    let lamp = relief::against_flat(cosine.max(0.0));
    (lamp - RIM_SHADE * distance2 * distance2).clamp(-1.0, 1.0)
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// Trees at places east and south of a square map's corner, m: east, south, radius, height, species.
    pub fn plants(side_m: f32, trees: &[(f32, f32, f32, f32, u16)]) -> Plants {
        let mut plants = Plants::default();
        for (id, &(east_m, south_m, radius_m, height_m, species)) in (0..).zip(trees) {
            plants.id.push(id);
            plants.species.push(species);
            plants.layer.push(Layer::Canopy);
            plants.east_m.push(east_m);
            plants.north_m.push(side_m - south_m);
            plants.z_m.push(100.0);
            plants.height_m.push(height_m);
            plants.crown_radius_m.push(radius_m);
            plants.dbh_m.push(0.3);
            plants.age_years.push(60.0);
            plants.vigor.push(0.8);
        }
        plants
    }

    fn sonoma() -> Biome {
        Biome::builtin("sonoma").unwrap()
    }

    fn area(layer: &CrownLayer) -> f32 {
        layer.cover.iter().sum()
    }

    #[test]
    fn crowns_cover_their_area_in_any_scale() {
        let frame = Frame::local(100, 100, 1.0);
        let plants = plants(100.0, &[(30.0, 40.0, 6.0, 20.0, 3), (70.2, 61.7, 4.5, 12.0, 5)]);
        let area_m2 = std::f32::consts::PI * (36.0 + 20.25);
        for size in [8, 30, 100, 400] {
            let layer = CrownLayer::draw(&plants, &sonoma(), &frame, size, size);
            let got_m2 = area(&layer) * (100.0 / size as f32) * (100.0 / size as f32);
            assert!((got_m2 / area_m2 - 1.0).abs() < 0.03, "{size} pixels: {got_m2} m²");
        }
    }

    #[test]
    fn taller_crowns_lie_over_lower_ones_and_are_lit_from_the_north_west() {
        let frame = Frame::local(40, 40, 1.0);
        let both = plants(40.0, &[(20.0, 20.0, 8.0, 30.0, 0), (24.0, 20.0, 8.0, 15.0, 1)]);
        let alone = plants(40.0, &[(20.0, 20.0, 8.0, 30.0, 0)]);
        let draw = |p: &Plants| CrownLayer::draw(p, &sonoma(), &frame, 200, 200);
        let (both, alone) = (draw(&both), draw(&alone));
        // in the overlap, inside both crowns
        assert_eq!(both.color[100 * 200 + 125], alone.color[100 * 200 + 125]);
        let sum = |c: [f32; 3]| c.iter().sum::<f32>();
        let (lit, dark) = (alone.color[85 * 200 + 85], alone.color[115 * 200 + 115]);
        assert!(sum(lit) > 1.3 * sum(dark), "{lit:?} {dark:?}");
        // the shadow lies south-east
        assert!(alone.shadow[135 * 200 + 135] == 1.0 && alone.shadow[65 * 200 + 65] == 0.0);
    }

    #[test]
    fn the_layer_is_the_same_for_any_number_of_threads() {
        let frame = Frame::local(300, 300, 1.0);
        let trees: Vec<_> = (0..900)
            .map(|i| {
                (10.0 * (i % 30) as f32, 10.0 * (i / 30) as f32, 4.0 + (i % 5) as f32, 20.0, i % 16)
            })
            .collect();
        let plants = plants(300.0, &trees);
        let pool = |n| rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap();
        for size in [40, 300] {
            let draw = || CrownLayer::draw(&plants, &sonoma(), &frame, size, size);
            assert!(pool(1).install(draw) == pool(2).install(draw));
        }
    }

    #[test]
    fn no_plants_leave_the_ground_bare_and_plants_beyond_the_edge_are_no_trouble() {
        let frame = Frame::local(20, 20, 1.0);
        let none = CrownLayer::draw(&Plants::default(), &sonoma(), &frame, 50, 50);
        assert!(none.cover.iter().chain(&none.shadow).all(|v| *v == 0.0));
        let beyond = plants(20.0, &[(-3.0, -3.0, 5.0, 9.0, 0), (900.0, 900.0, 5.0, 9.0, 0)]);
        let layer = CrownLayer::draw(&beyond, &sonoma(), &frame, 50, 50);
        assert!(layer.cover[0] > 0.0 && layer.cover[50 * 50 - 1] == 0.0);
    }
}
