//! Profile: a strip through the square's middle from the side, looking north, in true scale.
//!
//! Every plant rooted in the strip stands on the ground line of the strip's middle, so that a cross slope hides nothing.
//!
//! # Reference
//! Davis & Richards 1933, "The vegetation of Moraballi Creek, British Guiana", Journal of Ecology 21, 350–384, who drew the first.

use rayon::prelude::*;

use super::area::Area;
use super::deadwood::{DownedLogBeside, Footing, SnagBeside, part_within};
use super::ground::Litters;
use super::light::{Band, LightSheet};
use super::silhouettes::Standing;
use super::symbols::Symbol;
use super::variety;
use crate::export::canvas::{Canvas, Rect};
use crate::export::fit::fit_window;
use crate::export::furniture::{FRAME_INK, GREY_INK, INK, LABEL, UNIT};
use crate::export::lettering::{Align, Lettering, Style};
use crate::export::scale;
use crate::plants::deadwood::Deadwood;
use crate::plants::{Layer, Plants};
use crate::raster::{Grid, MapWindow};
use crate::species::Biome;

/// Depth of the strip: a share of the square's side between these. chosen: profile diagrams are 5–10 m deep.
const DEPTHS_M: std::ops::RangeInclusive<f64> = 5.0..=10.0;
const DEPTH_FRACTION: f64 = 0.125;
/// Height that the profile is brought to where it would be taller, by a smaller scale over a longer strip.
const TALLEST_PX: f32 = 1000.0;
/// Room above the highest top and below the lowest ground.
const ABOVE_PX: f32 = 22.0;
const BELOW_PX: f32 = 34.0;
/// Haze before what stands at the strip's far side.
const MOST_HAZE: f32 = 0.28;

const SKY: [f32; 3] = [253.0, 253.0, 251.0];
const PARALLEL: [f32; 3] = [188.0, 194.0, 198.0];
const BEYOND: [f32; 3] = [240.0, 239.0, 235.0];
const HUMUS: [f32; 3] = [98.0, 76.0, 58.0];
const SUBSOIL: [f32; 3] = [214.0, 198.0, 172.0];
/// The ground's colour far below its line, and how far that is.
const DEEP: [f32; 3] = [240.0, 233.0, 220.0];
const DEEP_PX: f32 = 110.0;
const GRASS: [f32; 3] = [112.0, 148.0, 66.0];

/// The strip that a profile shows.
pub struct Transect {
    /// Metres east of the scene's south-west corner to the strip's western end.
    west_m: f32,
    middle_north_m: f32,
    depth_m: f32,
    px_per_m: f32,
    /// Elevation of the ground at each column of pixels.
    ground_m: Vec<f32>,
    /// Whether the ground is known there.
    is_known: Vec<bool>,
    /// Share of the soil under litter, and grass height in metres, at each column.
    litter: Option<Vec<f32>>,
    grass_m: Option<Vec<f32>>,
    low_m: f32,
    /// Highest top or ground, and the greatest height over ground.
    high_m: f32,
    tallest_m: f32,
    /// Plants of the strip, the farthest first.
    plants: Vec<usize>,
    /// Snags of the strip, and the downed logs that reach into it with the part that does, 0..=1 from the thick end.
    snags: Vec<usize>,
    downed_logs: Vec<(usize, [f32; 2])>,
    /// Columns of the square's western and eastern side.
    sides_px: [f32; 2],
}

/// Part of the input that a transect is cut from.
#[derive(Clone, Copy)]
pub struct Site<'a> {
    /// Terrain.
    pub elevation_m: &'a Grid<f32>,
    /// What lies on it.
    pub litters: &'a Litters<'a>,
    /// What grows on it.
    pub plants: &'a Plants,
    /// What is dead there.
    pub deadwood: Option<&'a Deadwood>,
}

/// What stands or lies in a profile.
enum Thing {
    Plant(Standing),
    Snag(SnagBeside),
    DownedLog(DownedLogBeside),
}

impl Transect {
    /// The strip through an area's middle, `width` pixels long: at the plan's scale where it is not too tall then.
    pub fn new(site: &Site<'_>, area: &Area, width: u32) -> Self {
        let plan_px_per_m = (f64::from(width) / area.size_m()) as f32;
        let mut px_per_m = plan_px_per_m;
        // a smaller scale shows a longer strip, which may be taller: a few steps settle it
        for _ in 0..6 {
            let transect = Self::at_scale(site, area, width, px_per_m);
            let tall_m = transect.high_m - transect.low_m;
            let fitting = (TALLEST_PX - ABOVE_PX - BELOW_PX) / tall_m.max(0.1);
            if px_per_m <= fitting * 1.02 {
                return transect;
            }
            px_per_m = fitting;
        }
        Self::at_scale(site, area, width, px_per_m)
    }

    /// The lowest `cut_m` metres over the highest ground at the plan's scale, where the whole stand is shown at less
    /// than two thirds of it.
    pub fn understorey(
        &self,
        site: &Site<'_>,
        area: &Area,
        width: u32,
        cut_m: f32,
    ) -> Option<Self> {
        let plan_px_per_m = (f64::from(width) / area.size_m()) as f32;
        if self.px_per_m > plan_px_per_m / 1.5 {
            return None;
        }
        let mut transect = Self::at_scale(site, area, width, plan_px_per_m);
        let highest_ground_m =
            transect.ground_m.iter().fold(f32::MIN, |highest, z| highest.max(*z));
        transect.high_m = transect.high_m.min(highest_ground_m + cut_m);
        transect.tallest_m = transect.tallest_m.min(transect.high_m - transect.low_m);
        let px = (transect.high_m - transect.low_m) * plan_px_per_m;
        (px <= TALLEST_PX).then_some(transect)
    }

    fn at_scale(site: &Site<'_>, area: &Area, width: u32, px_per_m: f32) -> Self {
        let Site { elevation_m, litters, plants, deadwood } = site;
        let (frame, middle) = (elevation_m.frame(), area.middle());
        let corner = frame.south_west();
        let width_m = f64::from(width) / f64::from(px_per_m);
        let depth_m = (DEPTH_FRACTION * area.size_m()).clamp(*DEPTHS_M.start(), *DEPTHS_M.end());
        let half_px_m = 0.5 / f64::from(px_per_m);
        let window = MapWindow {
            west: middle.east_m - width_m / 2.0,
            east: middle.east_m + width_m / 2.0,
            south: middle.north_m - half_px_m,
            north: middle.north_m + half_px_m,
        };
        let cols = width as usize;
        let line = fit_window(elevation_m, &window, 1, cols);
        let is_known = line.mask().as_slice().to_vec();
        let ground_m = bridged(line.values(), &is_known);
        let [litter, grass] = litters.in_window(&window, 1, cols).map(|g| g.map(Grid::into_values));
        let tallest_grass_m = litters.grass_height_m.map_or(0.0, |(_, most)| most);
        let grass_m = grass.map(|shares| shares.iter().map(|s| s * tallest_grass_m).collect());

        // differences of map coordinates of one scene: f32 holds millimetres
        let west_m = (window.west - corner.east_m) as f32;
        let middle_north_m = (middle.north_m - corner.north_m) as f32;
        let (width_m, depth_m) = (width_m as f32, depth_m as f32);
        let is_rooted = |&i: &usize| {
            (west_m..west_m + width_m).contains(&plants.east_m[i])
                && (plants.north_m[i] - middle_north_m).abs() <= depth_m / 2.0
        };
        let mut rooted: Vec<usize> = (0..plants.len()).into_par_iter().filter(is_rooted).collect();
        rooted.sort_by(|&a, &b| {
            plants.north_m[b].total_cmp(&plants.north_m[a]).then(plants.id[a].cmp(&plants.id[b]))
        });
        let (mut snags, mut downed_logs) = (Vec::new(), Vec::new());
        if let Some(deadwood) = deadwood {
            let Deadwood { snags: dead, downed_logs: logs } = deadwood;
            snags.extend((0..dead.len()).filter(|&i| {
                (west_m..west_m + width_m).contains(&dead.east_m[i])
                    && (dead.north_m[i] - middle_north_m).abs() <= depth_m / 2.0
            }));
            let strip = [
                [west_m, west_m + width_m],
                [middle_north_m - depth_m / 2.0, middle_north_m + depth_m / 2.0],
            ];
            downed_logs.extend((0..logs.len()).filter_map(|i| {
                let thick = [logs.east_m[i], logs.north_m[i]];
                Some((i, part_within(thick, logs.thin_end_m(i), strip)?))
            }));
        }
        let of_known = || ground_m.iter().zip(&is_known).filter(|(_, k)| **k).map(|(z, _)| *z);
        let low_m = of_known().fold(f32::MAX, f32::min).min(f32::MAX);
        let low_m = if low_m == f32::MAX { 0.0 } else { low_m };
        let highest_ground_m = of_known().fold(low_m, f32::max);
        let mut transect = Self {
            west_m,
            middle_north_m,
            depth_m,
            px_per_m,
            ground_m,
            is_known,
            litter,
            grass_m,
            low_m,
            high_m: highest_ground_m,
            tallest_m: 0.0,
            plants: rooted,
            snags,
            downed_logs,
            sides_px: [0.0; 2],
        };
        let half_px = (area.size_m() / 2.0) as f32 * px_per_m;
        let middle_px = width as f32 / 2.0;
        transect.sides_px = [middle_px - half_px, middle_px + half_px];
        for &i in &transect.plants {
            let top_m = transect.ground_at(plants.east_m[i]) + plants.height_m[i];
            transect.high_m = transect.high_m.max(top_m);
            transect.tallest_m = transect.tallest_m.max(plants.height_m[i]);
        }
        for &i in &transect.snags {
            // there are snags only where there is deadwood
            let Some(Deadwood { snags, .. }) = deadwood else { continue };
            let top_m = transect.ground_at(snags.east_m[i]) + snags.height_m[i];
            transect.high_m = transect.high_m.max(top_m);
            transect.tallest_m = transect.tallest_m.max(snags.height_m[i]);
        }
        // bare ground has some air over it as well
        transect.high_m = transect.high_m.max(highest_ground_m + 3.0);
        transect
    }

    fn column(&self, east_m: f32) -> usize {
        let col = (east_m - self.west_m) * self.px_per_m;
        (col.max(0.0) as usize).min(self.ground_m.len() - 1)
    }

    fn ground_at(&self, east_m: f32) -> f32 {
        self.ground_m[self.column(east_m)]
    }

    /// Row of an elevation.
    fn row(&self, z_m: f32) -> f32 {
        ABOVE_PX + (self.high_m - z_m) * self.px_per_m
    }

    /// Height of the profile.
    pub fn height_px(&self) -> u32 {
        (ABOVE_PX + BELOW_PX + (self.high_m - self.low_m) * self.px_per_m).ceil() as u32 // some hundred
    }

    /// Depth of the strip from north to south, in metres.
    pub fn depth_m(&self) -> f32 {
        self.depth_m
    }

    /// Length of the strip, in metres.
    pub fn length_m(&self) -> f32 {
        self.ground_m.len() as f32 / self.px_per_m
    }

    /// Number of plants in the strip: canopy trees, undergrowth.
    pub fn counts(&self, plants: &Plants) -> [usize; 2] {
        let trees = self.plants.iter().filter(|&&i| plants.layer[i] == Layer::Canopy).count();
        [trees, self.plants.len() - trees]
    }

    /// Number of snags and of downed logs in the strip.
    pub fn dead_counts(&self) -> [usize; 2] {
        [self.snags.len(), self.downed_logs.len()]
    }

    /// Draws the profile with its upper left corner at `[x, y]`, and its axes.
    /// `canopy_cover_fraction` tells how crowded the canopy is: the more, the higher crowns begin.
    pub fn draw(
        &self,
        canvas: &mut Canvas,
        lettering: &Lettering,
        [x, y]: [u32; 2],
        site: &Site<'_>,
        biome: &Biome,
        canopy_cover_fraction: f32,
    ) -> Rect {
        let things = self.things(site, biome, canopy_cover_fraction);
        let (rows, cols) = (self.height_px() as usize, self.ground_m.len());
        let [west_px, east_px] = self.sides_px;
        let mut sheet = LightSheet::new(rows, cols, |pixel| {
            let middle = (pixel % cols) as f32 + 0.5;
            if (west_px..east_px).contains(&middle) { SKY } else { BEYOND }
        });
        let heights = self.parallels();
        sheet.draw(|band| {
            self.draw_parallels(band, &heights);
            for thing in &things {
                match thing {
                    Thing::Plant(plant) => plant.draw(band),
                    Thing::Snag(snag) => snag.draw(band),
                    Thing::DownedLog(downed_log) => {
                        downed_log.draw(band, |col| self.row(self.ground_m[col]))
                    }
                }
            }
            self.draw_ground(band);
        });
        let rect = sheet.onto(canvas, [x, y]);
        canvas.frame(rect, FRAME_INK);
        self.axes(canvas, lettering, rect, &heights);
        rect
    }

    /// What the strip holds, the farthest first.
    fn things(&self, site: &Site<'_>, biome: &Biome, crowding: f32) -> Vec<Thing> {
        let plants = site.plants;
        let mut things: Vec<(f32, Thing)> = self
            .plants
            .iter()
            .map(|&i| (plants.north_m[i], Thing::Plant(self.standing(plants, biome, i, crowding))))
            .collect();
        let Some(Deadwood { snags, downed_logs }) = site.deadwood else {
            return things.into_iter().map(|(_, thing)| thing).collect();
        };
        for &i in &self.snags {
            let footing = self.footing(snags.east_m[i], snags.north_m[i]);
            let snag = SnagBeside::new(snags, i, biome, footing, crowding);
            things.push((snags.north_m[i], Thing::Snag(snag)));
        }
        for &(i, part) in &self.downed_logs {
            let [thick, thin] =
                [[downed_logs.east_m[i], downed_logs.north_m[i]], downed_logs.thin_end_m(i)];
            let at = |along: f32, axis: usize| thick[axis] + along * (thin[axis] - thick[axis]);
            let middle = 0.5 * (part[0] + part[1]);
            let footing = self.footing(at(middle, 0), at(middle, 1));
            let x = part.map(|along| (at(along, 0) - self.west_m) * self.px_per_m);
            let log = DownedLogBeside::new(downed_logs, i, part, x, footing);
            things.push((at(middle, 1), Thing::DownedLog(log)));
        }
        things.sort_by(|(a, _), (b, _)| b.total_cmp(a)); // stable
        things.into_iter().map(|(_, thing)| thing).collect()
    }

    /// Where something at a place in the strip stands on the ground line.
    fn footing(&self, east_m: f32, north_m: f32) -> Footing {
        let col = self.column(east_m);
        let south = 0.5 - (north_m - self.middle_north_m) / self.depth_m;
        Footing {
            x: (east_m - self.west_m) * self.px_per_m,
            foot_y: self.row(self.ground_m[col]),
            fall: self.fall(col),
            px_per_m: self.px_per_m,
            haze_fraction: MOST_HAZE * (1.0 - south.clamp(0.0, 1.0)),
        }
    }

    /// Rows that the ground falls a column to the east, over a metre or so.
    fn fall(&self, col: usize) -> f32 {
        let reach = self.px_per_m.max(1.0) as usize;
        let (before, after) =
            (col.saturating_sub(reach), (col + reach).min(self.ground_m.len() - 1));
        let fall_m = self.ground_m[before] - self.ground_m[after];
        fall_m * self.px_per_m / (after - before).max(1) as f32
    }

    fn standing(&self, plants: &Plants, biome: &Biome, i: usize, crowding: f32) -> Standing {
        let species = &biome.species[usize::from(plants.species[i])];
        let height_m = plants.height_m[i];
        let Footing { x, foot_y, fall, px_per_m, haze_fraction } =
            self.footing(plants.east_m[i], plants.north_m[i]);
        Standing {
            x,
            foot_y,
            fall,
            px_per_m,
            height_m,
            radius_m: plants.crown_radius_m[i],
            crown_base_m: species.crown_base_m(height_m, crowding).min(0.9 * height_m),
            dbh_m: plants.dbh_m[i],
            shape: species.crown.shape,
            symbol: Symbol::of(species),
            color: species.color_srgb.map(f32::from),
            seed: variety::of_plant(plants.id[i]),
            haze_fraction,
        }
    }

    /// Heights over ground that lines are drawn at.
    fn parallels(&self) -> Vec<f32> {
        let most = f64::from(self.tallest_m.max(2.0)) * 1.02;
        let at_most = ((most * f64::from(self.px_per_m) / 36.0) as usize).clamp(1, 9);
        scale::ticks(0.0, most, at_most).into_iter().skip(1).map(|h| h as f32).collect()
    }

    fn draw_parallels(&self, band: &mut Band<'_>, heights_m: &[f32]) {
        for (col, z_m) in self.ground_m.iter().enumerate() {
            for height_m in heights_m {
                let y = self.row(z_m + height_m);
                let (rows, _) = band.touched([0.0, y - 1.0], [0.0, y + 1.0]);
                for row in rows {
                    let alpha = (1.0 - (row as f32 + 0.5 - y).abs()).clamp(0.0, 1.0);
                    band.lay(row, col, PARALLEL, alpha);
                }
            }
            // where the square ends
            for side in self.sides_px {
                if self.is_longer() && (col as f32 + 0.5 - side).abs() <= 0.5 {
                    let (rows, _) = band.touched([0.0, 0.0], [0.0, f32::MAX / 2.0]);
                    rows.filter(|row| row % 10 < 6)
                        .for_each(|row| band.lay(row, col, FRAME_INK.map(f32::from), 1.0));
                }
            }
        }
    }

    fn draw_ground(&self, band: &mut Band<'_>) {
        let [_, cols] = band.size();
        for col in 0..cols {
            let line = self.row(self.ground_m[col]);
            if let Some(grass_m) = &self.grass_m {
                self.draw_blades(band, col, line, grass_m[col]);
            }
            let litter = self.litter.as_ref().map_or(0.3, |l| l[col]);
            let humus_px = 3.0 + 5.0 * litter;
            let (rows, _) = band.touched([0.0, line - 1.0], [0.0, f32::MAX / 2.0]);
            for row in rows {
                let below = row as f32 + 0.5 - line;
                let alpha = (below + 0.5).clamp(0.0, 1.0);
                if !self.is_known[col] {
                    let hatch = if (row + col).is_multiple_of(9) { 205.0 } else { 226.0 };
                    band.lay(row, col, [hatch; 3], alpha);
                    continue;
                }
                let mineral = ((below - humus_px) / 6.0).clamp(0.0, 1.0);
                let deep = (below / DEEP_PX).clamp(0.0, 1.0);
                let stones = 10.0 * (variety::speck(31, col as i32 / 3, row as i32 / 2) - 0.5);
                let color = std::array::from_fn(|c| {
                    let soil = SUBSOIL[c] + deep * (DEEP[c] - SUBSOIL[c]);
                    HUMUS[c] + mineral * (soil - HUMUS[c]) + stones
                });
                band.lay(row, col, color, alpha);
            }
        }
    }

    /// Grass in its height: blades that lean this way and that.
    fn draw_blades(&self, band: &mut Band<'_>, col: usize, line: f32, height_m: f32) {
        let look = |aspect: u32| variety::unit(col as u32, aspect);
        let tall = height_m * self.px_per_m * (0.35 + 0.65 * look(1));
        if tall < 0.5 || look(2) < 0.35 {
            return;
        }
        let (rows, _) = band.touched([0.0, line - tall], [0.0, line]);
        for row in rows {
            let up = ((line - row as f32 - 0.5) / tall).clamp(0.0, 1.0);
            let lean = (look(3) - 0.5) * 0.5 * tall * up * up;
            let at = col as f32 + lean;
            if at >= 0.0 && (at as usize) < band.size()[1] {
                let bright = 40.0 * (look(4) - 0.5) + 30.0 * up;
                band.lay(row, at as usize, GRASS.map(|c| c + bright), 0.85);
            }
        }
    }

    /// Heights over ground on the left, where they begin; elevations on the right.
    fn axes(&self, canvas: &mut Canvas, lettering: &Lettering, rect: Rect, heights_m: &[f32]) {
        let (left, right) = (rect.x as f32 - 7.0, rect.right() as f32 + 7.0);
        let top = rect.y as f32;
        let style = LABEL;
        for height_m in std::iter::once(&0.0).chain(heights_m) {
            let y = top + self.row(self.ground_m[0] + height_m);
            if y < top + 4.0 {
                continue; // a line that begins above the picture
            }
            tick(canvas, rect.x, y, -1);
            let label = scale::trimmed(f64::from(*height_m), 1);
            lettering.draw(canvas, left, y + 5.0, Align::Right, &label, style);
        }
        let (low, high) = (f64::from(self.low_m), f64::from(self.high_m));
        let at_most = (self.height_px() as usize / 60).clamp(1, 8);
        let grey = Style { color: GREY_INK, ..LABEL };
        for z_m in scale::ticks(low, high, at_most) {
            let y = top + self.row(z_m as f32);
            tick(canvas, rect.right(), y, 1);
            lettering.draw(canvas, right, y + 5.0, Align::Left, &scale::trimmed(z_m, 1), grey);
        }
        let [west, east] = self.sides_px.map(|side| rect.x as f32 + side);
        let letters = Style { bold: true, size_px: 17.0, color: INK };
        let inside = if self.is_longer() { 0.0 } else { 14.0 };
        lettering.draw(canvas, west + inside, top + 20.0, Align::Center, "A", letters);
        lettering.draw(canvas, east - inside, top + 20.0, Align::Center, "A′", letters);
        lettering.draw(
            canvas,
            rect.x as f32,
            top - 9.0,
            Align::Left,
            "height over ground, m",
            UNIT,
        );
        let x = rect.right() as f32;
        lettering.draw(canvas, x, top - 9.0, Align::Right, "elevation, m", UNIT);
    }

    /// Whether the strip reaches beyond the square.
    pub fn is_longer(&self) -> bool {
        self.sides_px[0] > 1.0
    }
}

/// A tick of an axis beside a column, to the left (−1) or right (1).
fn tick(canvas: &mut Canvas, x: u32, y: f32, side: i64) {
    for step in 0..4 {
        let at = if side < 0 { i64::from(x) - 1 - step } else { i64::from(x) + step };
        canvas.blend(at, y as i64, INK, 1.0);
    }
}

/// Values with those that are not known replaced by the nearest known one; 0 where none is.
fn bridged(values: &[f32], is_known: &[bool]) -> Vec<f32> {
    let known: Vec<usize> = (0..values.len()).filter(|&i| is_known[i]).collect();
    let nearest = |i: usize| {
        let after = known.partition_point(|&k| k < i);
        let sides = [after.checked_sub(1).map(|at| known[at]), known.get(after).copied()];
        let found = sides.into_iter().flatten().min_by_key(|k| k.abs_diff(i));
        found.map_or(0.0, |k| values[k])
    };
    (0..values.len()).map(nearest).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_take_the_nearest_known_value() {
        let known = [false, true, false, false, true, false];
        let line = bridged(&[9.0, 1.0, 9.0, 9.0, 4.0, 9.0], &known);
        assert_eq!(line, [1.0, 1.0, 1.0, 4.0, 4.0, 4.0]);
        assert_eq!(bridged(&[9.0; 2], &[false; 2]), [0.0; 2]);
    }

    /// Two trees on a slope that rises one metre in ten to the east, 200 m on a side.
    fn transect(area: &str) -> (Transect, Plants) {
        let slope = Grid::from_fn(100, 100, 2.0, |c| 0.2 * c.col as f32);
        let mut plants = Plants::default();
        for (id, east_m, north_m, height_m) in [(1, 90.0, 101.0, 20.0), (2, 110.0, 108.0, 30.0)] {
            plants.id.push(id);
            plants.species.push(0);
            plants.layer.push(Layer::Canopy);
            plants.east_m.push(east_m);
            plants.north_m.push(north_m);
            plants.z_m.push(0.1 * east_m);
            plants.height_m.push(height_m);
            plants.crown_radius_m.push(2.0);
            plants.dbh_m.push(0.3);
            plants.age_years.push(50.0);
            plants.vigor.push(1.0);
        }
        let litters = Litters { grass_height_m: None, litterfall: None };
        let site = Site { elevation_m: &slope, litters: &litters, plants: &plants, deadwood: None };
        let transect = Transect::new(&site, &area.parse().unwrap(), 1200);
        (transect, plants)
    }

    #[test]
    fn only_plants_rooted_in_the_strip_are_shown() {
        let (transect, plants) = transect("100,100,100");
        assert_eq!(transect.depth_m(), 10.0);
        assert_eq!(transect.counts(&plants), [1, 0], "one stands 8 m off the middle line");
        assert_eq!(transect.length_m(), 100.0);
        assert!(!transect.is_longer());
    }

    #[test]
    fn scale_is_true_and_heights_count_from_the_ground_line() {
        let (transect, plants) = transect("100,100,100");
        let z_m = transect.ground_at(plants.east_m[0]);
        // cell centres rise 0.2 m each 2 m: 0.1 · east − 0.1
        assert!((z_m - 8.9).abs() < 0.02, "{z_m}");
        let tall_px = transect.row(z_m) - transect.row(z_m + 20.0);
        assert!((tall_px - 20.0 * 12.0).abs() < 1e-2, "{tall_px}");
    }

    #[test]
    fn tall_trees_in_a_small_square_are_shown_over_a_longer_strip() {
        let (transect, _) = transect("90,100,12");
        assert!(transect.is_longer() && transect.length_m() > 25.0);
        assert!((transect.height_px() as f32) < 1.1 * TALLEST_PX, "{}", transect.height_px());
    }
}
