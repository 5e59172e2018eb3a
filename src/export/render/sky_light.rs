//! Light among crowns: the share of the sky that each place of the stand sees, and how deep the sun reaches into it.
//!
//! Crowns are poured into a coarse lattice as foliage that thins light; light is then swept through it layer by layer, along a few
//! directions of the sky and along the sun's. What lies deep in a crown, low in the stand or in a hollow is dark.

use rayon::prelude::*;

use super::coverage::floor;
use super::vector::{UP, Vec3, vec3};
use super::world::World;
use crate::export::instances::InstanceGroup;
use crate::math;
use crate::tree::archetype::Archetype;
use crate::tree::mesh::Material;

/// Most cells of the lattice. chosen: 1 km² in cells of 2 m, and some tens of megabytes.
const MOST_CELLS: f32 = 9e6;
/// Least width of a cell, m. chosen: a shrub's.
const LEAST_CELL_M: f32 = 0.8;
/// Height of a cell over its width. chosen: crowns have more structure upwards than across.
const LAYER_SHARE: f32 = 0.8;
/// Directions of the sky beside the zenith. chosen: enough that no streaks show in soft light.
const RING: usize = 6;
/// Elevation of that ring. chosen: halves the hemisphere's cosine-weighted light beside the zenith's cap.
const RING_ELEVATION_RAD: f32 = 0.70;
/// Weight of the zenith; the ring shares the rest.
const ZENITH_WEIGHT: f32 = 0.28;
/// How much a metre of crown thins light. chosen: crowns of 5 m leave a third of the sky.
const EXTINCTION_PER_M: f32 = 0.42;
/// Heights at which a crown's width is known.
const BINS: usize = 8;

/// The lattice.
pub struct SkyLight {
    rows: usize,
    cols: usize,
    layers: usize,
    cell_m: f32,
    layer_m: f32,
    west_m: f32,
    north_m: f32,
    /// Layer, counted from height 0, of each column's lowest cell.
    base: Vec<i32>,
    /// Share of the sky, 0–255, column by column from below.
    sky: Vec<u8>,
    /// Share of the sun.
    sun: Vec<u8>,
}

/// How wide a model's crown is at each height.
#[derive(Clone, Copy, Debug, Default)]
struct Profile {
    low: f32,
    high: f32,
    radius: [f32; BINS],
}

impl Profile {
    fn of(archetype: &Archetype) -> Self {
        let parts = archetype.levels[1].parts.iter();
        let foliage = parts.filter(|part| part.material == Material::Foliage);
        let places: Vec<[f32; 3]> = foliage.flat_map(|part| part.positions.clone()).collect();
        let low = places.iter().fold(f32::INFINITY, |low, p| low.min(p[2]));
        let high = places.iter().fold(f32::NEG_INFINITY, |high, p| high.max(p[2]));
        if low >= high {
            return Self::default();
        }
        let mut radius = [0.0_f32; BINS];
        for [x, y, z] in places {
            let bin = ((z - low) / (high - low) * BINS as f32) as usize; // at most BINS
            let bin = bin.min(BINS - 1);
            radius[bin] = radius[bin].max((x * x + y * y).sqrt());
        }
        for bin in 1..BINS {
            if radius[bin] == 0.0 {
                radius[bin] = radius[bin - 1]; // between tiers
            }
        }
        Self { low, high, radius }
    }
}

impl SkyLight {
    /// Light in a world around `middle`, as far as `reach_m`; `sun` is the direction to the sun.
    pub fn new(world: &World<'_>, sun: Vec3, middle: Vec3, reach_m: f32) -> Self {
        let ground = &world.ground;
        let [far_east, far_south] = ground.far_edges_m();
        let west_m = ground.west_m.max(middle.x - reach_m).min(far_east - 1.0);
        let north_m = ground.north_m.min(middle.y + reach_m).max(far_south + 1.0);
        let width_m = far_east.min(middle.x + reach_m).max(west_m + 1.0) - west_m;
        let depth_m = north_m - far_south.max(middle.y - reach_m).min(north_m - 1.0);
        let tallest_m = world.tallest_m + 1.0;
        let volume_m3 = width_m * depth_m * tallest_m;
        let wanted_m = math::powf(volume_m3 / (LAYER_SHARE * MOST_CELLS), 1.0 / 3.0);
        let cell_m = wanted_m.max(LEAST_CELL_M);
        let layer_m = cell_m * LAYER_SHARE;
        let count = |length_m: f32, step_m: f32| ((length_m / step_m).ceil() as usize).max(1); // some hundreds
        let (rows, cols) = (count(depth_m, cell_m), count(width_m, cell_m));
        let layers = count(tallest_m, layer_m) + 2;
        let base = (0..rows * cols).map(|i| {
            let x = west_m + ((i % cols) as f32 + 0.5) * cell_m;
            let y = north_m - ((i / cols) as f32 + 0.5) * cell_m;
            let z = ground.height_m(x, y).unwrap_or(ground.range_m[0]);
            (z / layer_m).floor() as i32 // some hundreds
        });
        let mut light = Self {
            rows,
            cols,
            layers,
            cell_m,
            layer_m,
            west_m,
            north_m,
            base: base.collect(),
            sky: Vec::new(),
            sun: Vec::new(),
        };
        let density = light.density(world);
        light.sweep_all(&density, sun);
        light
    }

    /// Extinction a metre of each cell.
    fn density(&self, world: &World<'_>) -> Vec<f32> {
        let profiles: Vec<Profile> = world.instances.archetypes.iter().map(Profile::of).collect();
        let mut density = vec![0.0; self.rows * self.cols * self.layers];
        for group in &world.instances.groups {
            let profile = &profiles[group.archetype];
            if profile.high <= profile.low || !world.group_has_leaves(group) {
                continue;
            }
            for i in 0..group.position_m.len() {
                self.pour(&mut density, group, i, profile);
            }
        }
        density
    }

    fn pour(&self, density: &mut [f32], group: &InstanceGroup, i: usize, profile: &Profile) {
        let [x, y, z] = group.position_m[i];
        let [sx, sy, sz] = group.scale[i];
        let stretch = 0.5 * (sx + sy);
        let (low_m, high_m) = (profile.low * sz, profile.high * sz);
        let col = (x - self.west_m) / self.cell_m;
        let row = (self.north_m - y) / self.cell_m;
        let reach = profile.radius.iter().fold(0.0_f32, |a, b| a.max(*b)) * stretch / self.cell_m;
        let is_outside = col < -reach
            || row < -reach
            || col > self.cols as f32 + reach
            || row > self.rows as f32 + reach;
        if is_outside {
            return;
        }
        let first = ((z + low_m) / self.layer_m).floor() as i32; // some hundreds
        let last = ((z + high_m) / self.layer_m).floor() as i32;
        for layer in first..=last {
            let bottom_m = (layer as f32 * self.layer_m).max(z + low_m);
            let top_m = ((layer + 1) as f32 * self.layer_m).min(z + high_m);
            let share = (top_m - bottom_m) / self.layer_m;
            if share <= 0.0 {
                continue;
            }
            let t = (0.5 * (bottom_m + top_m) - z - low_m) / (high_m - low_m);
            let bin = ((t * BINS as f32).max(0.0) as usize).min(BINS - 1); // within the bins
            let radius = profile.radius[bin] * stretch / self.cell_m;
            self.disk(density, [row, col], radius, layer, share * EXTINCTION_PER_M);
        }
    }

    fn disk(
        &self,
        density: &mut [f32],
        [row, col]: [f32; 2],
        radius: f32,
        layer: i32,
        amount: f32,
    ) {
        let mut add = |r: i64, c: i64, amount: f32| {
            let (Ok(r), Ok(c)) = (usize::try_from(r), usize::try_from(c)) else { return };
            if r >= self.rows || c >= self.cols {
                return;
            }
            let column = r * self.cols + c;
            let Ok(level) = usize::try_from(layer - self.base[column]) else { return };
            if level < self.layers {
                let cell = &mut density[column * self.layers + level];
                *cell = (*cell + amount).min(3.0 * EXTINCTION_PER_M);
            }
        };
        if radius < 0.7 {
            let area = std::f32::consts::PI * radius * radius;
            add(row.floor() as i64, col.floor() as i64, amount * area.min(1.0)); // some thousands
            return;
        }
        let (r0, r1) = ((row - radius).floor() as i64, (row + radius).ceil() as i64);
        let (c0, c1) = ((col - radius).floor() as i64, (col + radius).ceil() as i64);
        for r in r0..r1 {
            for c in c0..c1 {
                let (dr, dc) = (r as f32 + 0.5 - row, c as f32 + 0.5 - col);
                let edge = radius - (dr * dr + dc * dc).sqrt() + 0.5;
                if edge > 0.0 {
                    add(r, c, amount * edge.min(1.0));
                }
            }
        }
    }

    fn sweep_all(&mut self, density: &[f32], sun: Vec3) {
        let mut directions = vec![(vec3(0.0, 0.0, 1.0), ZENITH_WEIGHT)];
        for k in 0..RING {
            let azimuth = (k as f32 + 0.3) * std::f32::consts::TAU / RING as f32;
            let level = math::cos(RING_ELEVATION_RAD);
            let up = math::sin(RING_ELEVATION_RAD);
            let d = vec3(math::sin(azimuth) * level, math::cos(azimuth) * level, up);
            directions.push((d, (1.0 - ZENITH_WEIGHT) / RING as f32));
        }
        // the sun's last; near the horizon its light would cross the lattice in one layer
        let low = sun.z < 0.12;
        directions.push((if low { vec3(sun.x, sun.y, 0.12).normalize_or(UP) } else { sun }, 0.0));
        let mut swept: Vec<Vec<u8>> =
            directions.par_iter().map(|(d, _)| self.sweep(density, *d)).collect();
        self.sun = swept.pop().unwrap_or_default();
        let weights: Vec<f32> = directions.iter().map(|(_, w)| *w).collect();
        self.sky = (0..density.len())
            .into_par_iter()
            .with_min_len(65536)
            .map(|i| {
                let sum: f32 = swept.iter().zip(&weights).map(|(s, w)| f32::from(s[i]) * w).sum();
                sum.round().clamp(0.0, 255.0) as u8 // clamped
            })
            .collect();
    }

    /// Share of the light from a direction that reaches each cell's middle.
    fn sweep(&self, density: &[f32], direction: Vec3) -> Vec<u8> {
        let path_m = self.layer_m / direction.z;
        let shift = path_m / self.cell_m;
        let (east, south) = (direction.x * shift, -direction.y * shift);
        let (c0, r0) = (east.floor(), south.floor());
        let (tc, tr) = (east - c0, south - r0);
        let (c0, r0) = (c0 as isize, r0 as isize); // a few cells
        let (rows, cols) = (self.rows, self.cols);
        let lowest = self.base.iter().copied().min().unwrap_or(0);
        let highest = self.base.iter().copied().max().unwrap_or(0) + self.layers as i32; // some tens
        let mut above = vec![1.0_f32; rows * cols];
        let mut here = above.clone();
        let mut light = vec![0_u8; density.len()];
        let half_m = 0.5 * path_m;
        for layer in (lowest..highest).rev() {
            for row in 0..rows {
                for col in 0..cols {
                    let from = |dr: isize, dc: isize| {
                        let r = row as isize + r0 + dr; // grids are far smaller than isize
                        let c = col as isize + c0 + dc;
                        let inside = r >= 0 && c >= 0 && r < rows as isize && c < cols as isize;
                        if inside { above[r as usize * cols + c as usize] } else { 1.0 }
                    };
                    let north = from(0, 0) + (from(0, 1) - from(0, 0)) * tc;
                    let next = from(1, 0) + (from(1, 1) - from(1, 0)) * tc;
                    let arriving = north + (next - north) * tr;
                    let column = row * cols + col;
                    let level = layer - self.base[column];
                    let left = if level < 0 {
                        0.0
                    } else if let level = level as usize // not negative
                        && level < self.layers
                    {
                        let cell = column * self.layers + level;
                        // foliage is clumped, so light dies off more slowly than in a mist
                        let thinning = density[cell];
                        let middle = arriving / (1.0 + thinning * half_m);
                        light[cell] = (middle * 255.0 + 0.5) as u8; // within 0..=1
                        arriving / (1.0 + thinning * path_m)
                    } else {
                        arriving
                    };
                    here[column] = left;
                }
            }
            std::mem::swap(&mut above, &mut here);
        }
        light
    }

    /// Shares of the sky and of the sun at a place, 0..=1.
    #[inline]
    pub fn at(&self, place: Vec3) -> [f32; 2] {
        let col = (place.x - self.west_m) / self.cell_m - 0.5;
        let row = (self.north_m - place.y) / self.cell_m - 0.5;
        let up = place.z / self.layer_m - 0.5;
        let (c0, r0, l0) = (floor(col) as f32, floor(row) as f32, floor(up) as f32);
        let (tc, tr, tl) = (col - c0, row - r0, up - l0);
        // cells of the lattice or clamped to its rim
        let clamp = |v: f32, last: usize| v.clamp(0.0, last as f32) as usize;
        let (mut sky, mut sun) = (0.0, 0.0);
        for (r, wr) in [(r0, 1.0 - tr), (r0 + 1.0, tr)] {
            for (c, wc) in [(c0, 1.0 - tc), (c0 + 1.0, tc)] {
                let column = clamp(r, self.rows - 1) * self.cols + clamp(c, self.cols - 1);
                let level = l0 as i32 - self.base[column]; // some hundreds
                let [a, b] = [level, level + 1].map(|level| {
                    let Ok(level) = usize::try_from(level.max(0)) else { return [255.0, 255.0] };
                    if level >= self.layers {
                        return [255.0, 255.0];
                    }
                    let cell = column * self.layers + level;
                    [f32::from(self.sky[cell]), f32::from(self.sun[cell])]
                });
                let weight = wr * wc / 255.0;
                sky += weight * (a[0] + (b[0] - a[0]) * tl);
                sun += weight * (a[1] + (b[1] - a[1]) * tl);
            }
        }
        [sky, sun]
    }
}
