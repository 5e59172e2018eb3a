//! Plan: the square from above. Undergrowth lies open to view, the canopy over it is rings, stems and shade.

use rayon::prelude::*;

use super::area::Area;
use super::deadwood::{DownedLogAbove, SeenDeadwood, SnagAbove};
use super::ground::GroundCover;
use super::light::{Band, LightSheet};
use super::symbols::{CanopyTree, LowPlant, Symbol};
use super::variety;
use crate::export::furniture::void_color;
use crate::plants::deadwood::Deadwood;
use crate::plants::{Layer, Plants};
use crate::raster::Frame;
use crate::species::Biome;

/// Samples along a side by which cover is measured.
const COVER_SAMPLES: usize = 256;

/// Height up to which plants are drawn under downed logs. chosen: as high as a downed log is thick.
const BELOW_DOWNED_LOGS_M: f32 = 0.5;

/// Where the square lies: in the scene, and on the sheet.
#[derive(Clone, Copy, Debug)]
pub struct View {
    /// Metres east of the scene's south-west corner to the square's.
    pub west_m: f32,
    /// Metres north of it.
    pub south_m: f32,
    /// Side of the square.
    pub size_m: f32,
    /// Side of the picture in pixels.
    pub side: u32,
}

impl View {
    /// An area of a scene on `frame`, drawn `side` pixels wide.
    pub fn new(area: &Area, frame: &Frame, side: u32) -> Self {
        let (window, corner) = (area.window(), frame.south_west());
        Self {
            // differences of map coordinates of one scene: f32 holds millimetres
            west_m: (window.west - corner.east_m) as f32,
            south_m: (window.south - corner.north_m) as f32,
            size_m: area.size_m() as f32,
            side,
        }
    }

    /// Pixels a metre.
    pub fn px_per_m(&self) -> f32 {
        self.side as f32 / self.size_m
    }

    /// Column and row of a place in the scene.
    pub fn place(&self, east_m: f32, north_m: f32) -> [f32; 2] {
        let north_edge_m = self.south_m + self.size_m;
        [(east_m - self.west_m) * self.px_per_m(), (north_edge_m - north_m) * self.px_per_m()]
    }

    /// Whether a place lies in the square, as wide by `more_m` on every side.
    pub fn contains(&self, east_m: f32, north_m: f32, more_m: f32) -> bool {
        let range = |from: f32| from - more_m..from + self.size_m + more_m;
        range(self.west_m).contains(&east_m) && range(self.south_m).contains(&north_m)
    }
}

/// Plants whose crowns reach into the square, the lowest first.
#[derive(Clone, Debug, Default)]
pub struct Seen {
    /// Canopy trees.
    pub canopy: Vec<usize>,
    /// Undergrowth.
    pub undergrowth: Vec<usize>,
}

impl Seen {
    /// The plants that a view sees.
    pub fn of(plants: &Plants, view: &View) -> Self {
        let touches = |&i: &usize| {
            view.contains(plants.east_m[i], plants.north_m[i], plants.crown_radius_m[i])
        };
        let mut seen: Vec<usize> = (0..plants.len()).into_par_iter().filter(touches).collect();
        let top = |i: usize| plants.z_m[i] + plants.height_m[i];
        seen.sort_by(|&a, &b| top(a).total_cmp(&top(b)).then(plants.id[a].cmp(&plants.id[b])));
        let (canopy, undergrowth) =
            seen.into_iter().partition(|&i| plants.layer[i] == Layer::Canopy);
        Self { canopy, undergrowth }
    }
}

/// A plant of the undergrowth on the sheet.
fn low_plant(plants: &Plants, biome: &Biome, view: &View, i: usize) -> LowPlant {
    let species = &biome.species[usize::from(plants.species[i])];
    let [x, y] = view.place(plants.east_m[i], plants.north_m[i]);
    let px_per_m = view.px_per_m();
    LowPlant {
        x,
        y,
        radius: plants.crown_radius_m[i] * px_per_m,
        height: plants.height_m[i] * px_per_m,
        px_per_m,
        color: species.color_srgb.map(f32::from),
        seed: variety::of_plant(plants.id[i]),
        symbol: Symbol::of(species),
    }
}

fn canopy_tree(plants: &Plants, biome: &Biome, view: &View, i: usize) -> CanopyTree {
    let species = &biome.species[usize::from(plants.species[i])];
    let [x, y] = view.place(plants.east_m[i], plants.north_m[i]);
    CanopyTree {
        x,
        y,
        radius: (plants.crown_radius_m[i] * view.px_per_m()).max(1.0),
        stem_radius: 0.5 * plants.dbh_m[i] * view.px_per_m(),
        color: species.color_srgb.map(f32::from),
        absorbed_light_fraction: species.absorbed_light_fraction,
    }
}

/// Draws the square from above. Downed logs lie over the lowest plants, under taller ones.
pub fn draw(
    plants: &Plants,
    seen: &Seen,
    dead: Option<&(&Deadwood, SeenDeadwood)>,
    biome: &Biome,
    view: &View,
    ground: &GroundCover,
) -> LightSheet {
    let side = view.side as usize;
    let downed_logs: Vec<DownedLogAbove> = dead.map_or_else(Vec::new, |(deadwood, seen)| {
        let downed_log = |&i: &usize| DownedLogAbove::new(&deadwood.downed_logs, i, view);
        seen.downed_logs.iter().map(downed_log).collect()
    });
    let snags: Vec<SnagAbove> = dead.map_or_else(Vec::new, |(deadwood, seen)| {
        let snag = |&i: &usize| SnagAbove::new(&deadwood.snags, i, biome, view);
        seen.snags.iter().map(snag).collect()
    });
    let is_below = |&i: &usize| !downed_logs.is_empty() && plants.height_m[i] < BELOW_DOWNED_LOGS_M;
    let (below, above): (Vec<usize>, Vec<usize>) =
        seen.undergrowth.iter().copied().partition(is_below);
    let [below, above] = [below, above].map(|some| -> Vec<LowPlant> {
        some.into_iter().map(|i| low_plant(plants, biome, view, i)).collect()
    });
    let trees: Vec<CanopyTree> =
        seen.canopy.iter().map(|&i| canopy_tree(plants, biome, view, i)).collect();
    let mut sheet = LightSheet::new(side, side, |pixel| {
        let void = || void_color(pixel % side, pixel / side).map(f32::from);
        ground.color(pixel).unwrap_or_else(void)
    });
    sheet.draw(|band| {
        below.iter().for_each(|plant| plant.draw(band));
        downed_logs.iter().for_each(|downed_log| downed_log.draw(band));
        above.iter().for_each(|plant| plant.draw(band));
        shade(band, &trees);
        snags.iter().for_each(|snag| snag.branches(band));
        trees.iter().for_each(|tree| tree.ring(band));
        trees.iter().for_each(|tree| tree.stem(band));
        snags.iter().for_each(|snag| snag.circle(band));
    });
    sheet
}

/// Dims what stands under crowns, more where several overlap.
fn shade(band: &mut Band<'_>, trees: &[CanopyTree]) {
    let [rows, cols] = band.size();
    let first_row = band.first_row();
    let mut light = vec![1.0_f32; rows * cols];
    trees.iter().for_each(|tree| tree.dim(&mut light, band, first_row, cols));
    band.shade(|row, col| 1.0 - light[(row - first_row) * cols + col]);
}

/// Shares of the square's known ground under the crowns of some plants.
pub fn cover_fraction(plants: &Plants, some: &[usize], view: &View, ground: &GroundCover) -> f64 {
    let step_m = view.size_m / COVER_SAMPLES as f32;
    let valid = ground.elevation_m().mask();
    let side = view.side as usize;
    let counts = (0..COVER_SAMPLES).into_par_iter().map(|row| {
        let north_m = view.south_m + view.size_m - (row as f32 + 0.5) * step_m;
        let mut is_covered = [false; COVER_SAMPLES];
        for &i in some {
            let (dy, r) = (plants.north_m[i] - north_m, plants.crown_radius_m[i]);
            if dy.abs() <= r {
                let half = (r * r - dy * dy).sqrt();
                let middle = plants.east_m[i] - view.west_m;
                // `as` cuts negatives to 0
                let from = (((middle - half) / step_m + 0.5) as usize).min(COVER_SAMPLES);
                let end = (((middle + half) / step_m + 0.5).max(0.0) as usize).min(COVER_SAMPLES);
                is_covered[from..end.max(from)].fill(true);
            }
        }
        let pixel_row = (2 * row + 1) * side / (2 * COVER_SAMPLES);
        let (mut known, mut covered) = (0_u32, 0_u32);
        for (col, is_covered) in is_covered.into_iter().enumerate() {
            let is_known =
                valid.is_valid(pixel_row * side + (2 * col + 1) * side / (2 * COVER_SAMPLES));
            known += u32::from(is_known);
            covered += u32::from(is_known && is_covered);
        }
        (known, covered)
    });
    let (known, covered) = counts.reduce(|| (0, 0), |a, b| (a.0 + b.0, a.1 + b.1));
    f64::from(covered) / f64::from(known.max(1))
}
