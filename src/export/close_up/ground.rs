//! Ground of a close-up: bare soil, litter and grass as they lie, under the light of the relief.

use super::variety::{clumps, speck};
use crate::export::canvas::Rect;
use crate::export::fit::fit_window;
use crate::export::preview;
use crate::export::relief::lit;
use crate::raster::{Grid, MapWindow};

/// Colours of the ground, pale enough that plants stand out.
const SOIL: [f32; 3] = [214.0, 202.0, 178.0];
const LITTER: [f32; 3] = [170.0, 130.0, 90.0];
const GRASS: [f32; 3] = [150.0, 178.0, 104.0];
/// How much of the relief's light the ground takes.
const RELIEF: f32 = 0.6;
/// Most of the ground's colour that litter or grass take.
const MOST_COVER: f32 = 0.9;

/// Ground at a picture's pixels.
pub struct GroundCover {
    ground: preview::Ground,
    /// Share of the soil that litter covers.
    litter: Option<Grid<f32>>,
    /// Grass height as a share of the tallest.
    grass: Option<Grid<f32>>,
    cols: usize,
    px_per_m: f32,
}

/// What lies on the ground; what is missing is not drawn.
#[derive(Clone, Copy, Debug)]
pub struct Litters<'a> {
    /// Grass height in metres, and the tallest there can be.
    pub grass_height_m: Option<(&'a Grid<f32>, f32)>,
    /// Share of the ground under litter.
    pub litterfall: Option<&'a Grid<f32>>,
}

impl Litters<'_> {
    /// Share of soil under litter, and grass height as a share of the tallest, in a window's pixels.
    pub fn in_window(
        &self,
        window: &MapWindow,
        rows: usize,
        cols: usize,
    ) -> [Option<Grid<f32>>; 2] {
        let share = |grid: &Grid<f32>, most: f32| {
            let mut share = fit_window(grid, window, rows, cols);
            share.values_mut().iter_mut().for_each(|v| *v = (*v / most.max(1e-6)).clamp(0.0, 1.0));
            share
        };
        let litter = self.litterfall.map(|grid| share(grid, 1.0));
        [litter, self.grass_height_m.map(|(grid, most)| share(grid, most))]
    }
}

impl GroundCover {
    /// The ground of a window in `side` × `side` pixels.
    pub fn of(
        elevation_m: &Grid<f32>,
        litters: &Litters<'_>,
        window: &MapWindow,
        side: u32,
    ) -> Self {
        let cols = side as usize;
        let fitted = fit_window(elevation_m, window, cols, cols);
        let rect = Rect { x: 0, y: 0, width: side, height: side };
        let [litter, grass] = litters.in_window(window, cols, cols);
        let px_per_m = (f64::from(side) / (window.east - window.west)) as f32;
        Self { ground: preview::Ground::of(&fitted, rect), litter, grass, cols, px_per_m }
    }

    /// Elevation at the pixels; masked where the ground is not known.
    pub fn elevation_m(&self) -> &Grid<f32> {
        &self.ground.elevation_m
    }

    /// Colour of a pixel, counted row by row; `None` where the ground is not known.
    pub fn color(&self, pixel: usize) -> Option<[f32; 3]> {
        if !self.ground.elevation_m.mask().is_valid(pixel) {
            return None;
        }
        let (col, row) = ((pixel % self.cols) as i32, (pixel / self.cols) as i32); // some thousand pixels
        let (x_m, y_m) = (col as f32 / self.px_per_m, row as f32 / self.px_per_m);
        let of = |share: &Option<Grid<f32>>| share.as_ref().map_or(0.0, |s| s.values()[pixel]);
        let patches =
            0.5 * clumps(11, x_m / 0.9, y_m / 0.9) + 0.5 * clumps(12, x_m / 0.3, y_m / 0.3);
        let mut color = SOIL;
        // leaves lie in flecks, grass stands in blades: their share decides how many there are
        let fleck = speck(13, col / 3, row / 2);
        let litter = of(&self.litter);
        mix(&mut color, LITTER, MOST_COVER * (litter + 0.25 * litter * patches).clamp(0.0, 1.0));
        let blade = speck(14, col / 2, row / 5);
        let grass = of(&self.grass);
        mix(&mut color, GRASS, MOST_COVER * (grass + 0.35 * grass * patches).clamp(0.0, 1.0));
        let texture = 0.05 * patches + 0.16 * (fleck - 0.5) * litter + 0.2 * (blade - 0.5) * grass;
        let light = RELIEF * self.ground.light[pixel] + texture;
        Some(lit(color, light.clamp(-1.0, 1.0), 1.0))
    }
}

fn mix(color: &mut [f32; 3], other: [f32; 3], share: f32) {
    for (channel, other) in color.iter_mut().zip(other) {
        *channel += share * (other - *channel);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mean_color(litters: &Litters<'_>) -> [f32; 3] {
        let flat = Grid::from_fn(40, 40, 2.0, |_| 100.0);
        let window = MapWindow { west: 10.0, south: 10.0, east: 50.0, north: 50.0 };
        let cover = GroundCover::of(&flat, litters, &window, 80);
        let colors: Vec<[f32; 3]> = (0..6400).filter_map(|pixel| cover.color(pixel)).collect();
        assert_eq!(colors.len(), 6400);
        std::array::from_fn(|c| colors.iter().map(|color| color[c]).sum::<f32>() / 6400.0)
    }

    #[test]
    fn grass_is_green_and_litter_brown() {
        let full = Grid::from_fn(40, 40, 2.0, |_| 0.5);
        let bare = mean_color(&Litters { grass_height_m: None, litterfall: None });
        let grass = mean_color(&Litters { grass_height_m: Some((&full, 0.5)), litterfall: None });
        let covered = Grid::from_fn(40, 40, 2.0, |_| 1.0);
        let litter = mean_color(&Litters { grass_height_m: None, litterfall: Some(&covered) });
        let green = |c: [f32; 3]| 2.0 * c[1] - c[0] - c[2];
        assert!(green(grass) > green(bare) + 40.0, "{grass:?} {bare:?}");
        assert!(litter[0] - litter[2] > bare[0] - bare[2] + 30.0, "{litter:?} {bare:?}");
        assert!(litter.iter().sum::<f32>() < bare.iter().sum::<f32>());
    }

    #[test]
    fn ground_beyond_the_scene_has_no_colour() {
        let flat = Grid::from_fn(40, 40, 2.0, |_| 100.0);
        let window = MapWindow { west: -20.0, south: 10.0, east: 20.0, north: 50.0 };
        let litters = Litters { grass_height_m: None, litterfall: None };
        let cover = GroundCover::of(&flat, &litters, &window, 80);
        assert!(cover.color(0).is_none() && cover.color(79).is_some());
    }
}
