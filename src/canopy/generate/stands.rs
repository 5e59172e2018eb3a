//! Stands: where woods grow, how tall and of which kind, from smooth noise and what the site offers.

use crate::canopy::site::Site;
use crate::math::{lerp, smoothstep};
use crate::raster::{Cell, Frame};
use crate::terrain::generate::extent::Extent;
use crate::terrain::generate::noise::{Field, Noise};

use super::GenerateParams;

/// Cells in which noise is worked out; between them it is interpolated. A third of the shortest wave.
const NOISE_CELL_M: f64 = 8.0;
/// Moisture that counts as least and greatest: these shares of the land are drier and wetter.
const DRY_WET_FRACTIONS: [f64; 2] = [0.05, 0.95];
/// Share of the range of moisture from which ground counts as a river's bank.
const BANK_WETNESS: f32 = 0.85;
/// Yearly mean temperature at which trees give out, and at which cold no longer stunts them, °C.
/// Körner & Paulsen 2004 have treelines at a growing-season mean of 6.7 °C; temperate years are some 4 °C cooler.
const TREELINE_C: [f32; 2] = [2.0, 6.0];
/// Slopes from which woods thin out, and at which rock is bare, degrees. Chosen: soil rarely holds beyond 55°.
const STEEP_DEG: [f32; 2] = [38.0, 55.0];
/// Slopes up to which meadows lie, and from which there are none, degrees. Chosen: what can be mown.
const LEVEL_DEG: [f32; 2] = [4.0, 10.0];

/// Spread of single trees' luck at a wood's edge, in the unit of [`Spot::woodland`]. Chosen: edges a few metres wide.
const EDGE_SPREAD: f32 = 0.03;
/// The same in open woodland, on maps without cover and on maps all covered. Chosen: savannas have scattered trees.
const OPEN_SPREADS: [f32; 2] = [2.6, 1.0];

/// Noise and site over the map and a rim around it.
pub struct Stands<'a> {
    frame: &'a Frame,
    site: &'a Site,
    extent: Extent,
    /// South-west corner of the map, from the extent's north-west corner, m east and south.
    corner_m: [f32; 2],
    woodland: Vec<f32>,
    openness: Vec<f32>,
    gaps: Vec<f32>,
    meadows: Vec<f32>,
    quality: Vec<f32>,
    kind: Vec<f32>,
    dry_wet_mm: [f32; 2],
    stand_height_m: f32,
    open_spread: f32,
}

/// A place in a stand.
#[derive(Clone, Copy, Debug)]
pub struct Spot {
    /// How much the place is for woods, about −2..2: trees stand where it is above a level that the cover asked for sets.
    pub woodland: f32,
    /// Spread of single trees' luck, in the unit of `woodland`: small where woods have edges, large in open woodland.
    pub openness: f32,
    /// Mean height of grown trees, m.
    pub height_m: f32,
    /// −1 broad leaves only, 1 needles only.
    pub kind: f32,
}

impl<'a> Stands<'a> {
    /// Stands of a map and `rim_m` metres around it.
    pub fn new(frame: &'a Frame, site: &'a Site, rim_m: f64, params: &GenerateParams) -> Self {
        let t = frame.transform;
        let down = |m: f64| ((m - rim_m) / NOISE_CELL_M).floor() - 1.0;
        let up = |m: f64| ((m + rim_m) / NOISE_CELL_M).ceil() + 1.0;
        let south_m = t.north_m - frame.rows as f64 * t.cell_m;
        let east_m = t.west_m + frame.cols as f64 * t.cell_m;
        let (west, north) = (down(t.west_m), up(t.north_m));
        let extent = Extent {
            rows: (north - down(south_m)) as usize, // whole and positive
            cols: (up(east_m) - west) as usize,
            cell_m: NOISE_CELL_M,
            west_m: west * NOISE_CELL_M,
            north_m: north * NOISE_CELL_M,
        };
        let noise = |field| Noise { seed: params.seed, field };
        let smooth = noise(Field::StandHeight).fractal(310.0, 3, 0.5, &extent);
        let ages = noise(Field::StandAge).fractal(230.0, 3, 0.45, &extent);
        // stands of different age meet at a border, within a stand height changes slowly
        let quality = smooth
            .iter()
            .zip(&ages)
            .map(|(s, a)| {
                let age =
                    0.6 * smoothstep(a * 22.0 + 2.5) + 0.4 * smoothstep((a - 0.25) * 22.0 + 0.5);
                (0.5 + 0.3 * s + 0.55 * (age - 0.55)).clamp(0.0, 1.0)
            })
            .collect();
        Self {
            frame,
            site,
            corner_m: [(t.west_m - extent.west_m) as f32, (extent.north_m - south_m) as f32],
            woodland: noise(Field::Woodland).fractal(430.0, 5, 0.55, &extent),
            openness: noise(Field::Openness).fractal(380.0, 2, 0.4, &extent),
            gaps: noise(Field::Gaps).fractal(52.0, 2, 0.6, &extent),
            meadows: noise(Field::Meadows).fractal(260.0, 3, 0.5, &extent),
            quality,
            kind: noise(Field::StandKind).fractal(280.0, 2, 0.5, &extent),
            dry_wet_mm: dry_and_wet(site),
            stand_height_m: params.stand_height_m,
            open_spread: lerp(OPEN_SPREADS[0], OPEN_SPREADS[1], params.cover_fraction),
            extent,
        }
    }

    /// Quality of a place `east_m` and `north_m` metres from the map's south-west corner, 0..=1: 1 in tall stands.
    pub fn quality(&self, east_m: f32, north_m: f32) -> f32 {
        self.interpolated(east_m, north_m).of(&self.quality)
    }

    /// The cell a place lies in; beyond the map's edge the nearest.
    pub fn cell(&self, east_m: f32, north_m: f32) -> usize {
        let cell_m = self.frame.cell_m();
        // `as` cuts negatives to 0
        let col = ((east_m / cell_m) as usize).min(self.frame.cols - 1);
        let up = ((north_m / cell_m) as usize).min(self.frame.rows - 1);
        self.frame.index(Cell { row: self.frame.rows - 1 - up, col })
    }

    /// What a place is like.
    pub fn spot(&self, east_m: f32, north_m: f32) -> Spot {
        let at = self.interpolated(east_m, north_m);
        let cell = self.cell(east_m, north_m);
        let [dry, wet] = self.dry_wet_mm;
        let moisture = self.site.moisture_mm.values()[cell];
        let wetness = ((moisture - dry) / (wet - dry).max(1e-3)).clamp(0.0, 1.0);
        let slope_deg = self.site.slope_rad.values()[cell].to_degrees();
        let warmth = between(self.site.temperature_c.values()[cell], TREELINE_C);
        let steep = between(slope_deg, STEEP_DEG);

        let bank = smoothstep((wetness - BANK_WETNESS) / (1.0 - BANK_WETNESS));
        let gap = smoothstep((at.of(&self.gaps) - 0.34) * 9.0);
        let level = 1.0 - between(slope_deg, LEVEL_DEG);
        let meadow = level * smoothstep((at.of(&self.meadows) - 0.02) * 9.0) * (1.0 - bank);
        let woodland = at.of(&self.woodland) + 0.3 * (wetness - 0.5) + 0.4 * bank
            - 1.5 * steep
            - 2.0 * (1.0 - warmth)
            - 0.8 * meadow
            - 0.7 * gap;
        let openness = smoothstep(0.1 + 1.9 * at.of(&self.openness)) * (1.0 - bank);
        let site_factor =
            lerp(0.94, 1.16, wetness) * lerp(1.0, 0.7, steep) * lerp(0.3, 1.0, warmth);
        let height_m = self.stand_height_m * site_factor * lerp(0.5, 1.45, at.of(&self.quality));
        Spot {
            woodland,
            openness: lerp(EDGE_SPREAD, self.open_spread, openness),
            height_m,
            kind: (1.8 * at.of(&self.kind) + 0.3 * (0.5 - wetness)).clamp(-1.0, 1.0),
        }
    }

    fn interpolated(&self, east_m: f32, north_m: f32) -> Taps {
        let cell = NOISE_CELL_M as f32;
        let x = (self.corner_m[0] + east_m) / cell - 0.5;
        let y = (self.corner_m[1] - north_m) / cell - 0.5;
        // the rim keeps places inside; `as` and `min` hold rounding errors at its edge
        let col = (x as usize).min(self.extent.cols - 2);
        let row = (y as usize).min(self.extent.rows - 2);
        Taps {
            first: row * self.extent.cols + col,
            cols: self.extent.cols,
            u: x - col as f32,
            v: y - row as f32,
        }
    }
}

/// Where between four noise cells a place lies.
struct Taps {
    first: usize,
    cols: usize,
    u: f32,
    v: f32,
}

impl Taps {
    fn of(&self, values: &[f32]) -> f32 {
        let at = |i: usize| lerp(values[i], values[i + 1], self.u);
        lerp(at(self.first), at(self.first + self.cols), self.v)
    }
}

/// 0 up to the first bound, 1 from the second, smooth between.
fn between(value: f32, [low, high]: [f32; 2]) -> f32 {
    smoothstep((value - low) / (high - low))
}

/// Moisture of dry and of wet ground of this map, mm.
fn dry_and_wet(site: &Site) -> [f32; 2] {
    let moisture = &site.moisture_mm;
    // every n-th cell will do: some 20,000; odd, so that they do not run along columns
    let stride = (moisture.values().len() / 20_000).max(1) | 1;
    let mask = moisture.mask();
    let mut values: Vec<f32> = (0..moisture.values().len())
        .step_by(stride)
        .filter(|&cell| mask.is_valid(cell))
        .map(|cell| moisture.values()[cell])
        .collect();
    let Some(last) = values.len().checked_sub(1) else { return [0.0, 1.0] };
    DRY_WET_FRACTIONS.map(|share| {
        let place = (share * last as f64).round() as usize; // 0..=last
        *values.select_nth_unstable_by(place, f32::total_cmp).1
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::canopy::generate::tests::{flat_site, hills};

    fn mean_of(site: &Site, measure: fn(Spot) -> f32) -> f64 {
        let terrain = hills(64, 4.0);
        let params = GenerateParams::default();
        let stands = Stands::new(terrain.elevation_m.frame(), site, 20.0, &params);
        let places = (0..400).map(|i| (6.0 * (i % 20) as f32 + 60.0, 6.0 * (i / 20) as f32 + 60.0));
        places.map(|(e, n)| f64::from(measure(stands.spot(e, n)))).sum::<f64>() / 400.0
    }

    #[test]
    fn cold_and_steep_ground_bears_fewer_and_lower_trees() {
        let terrain = hills(64, 4.0);
        let good = flat_site(&terrain, 50.0, 12.0, 0.3);
        for poor in [flat_site(&terrain, 50.0, 3.0, 0.3), flat_site(&terrain, 50.0, 12.0, 0.9)] {
            for measure in [|s: Spot| s.woodland, |s: Spot| s.height_m] {
                assert!(mean_of(&poor, measure) < 0.95 * mean_of(&good, measure).abs());
            }
        }
    }

    #[test]
    fn wet_ground_of_a_map_bears_taller_woods_than_dry() {
        let terrain = hills(64, 4.0);
        let mut site = flat_site(&terrain, 50.0, 12.0, 0.3);
        // the west is dry, the east wet
        for (index, value) in site.moisture_mm.values_mut().iter_mut().enumerate() {
            *value = if index % 64 < 32 { 20.0 } else { 90.0 };
        }
        let params = GenerateParams::default();
        let stands = Stands::new(terrain.elevation_m.frame(), &site, 20.0, &params);
        let (west, east) = (stands.spot(127.9, 100.0), stands.spot(128.1, 100.0));
        assert!(east.woodland > west.woodland + 0.3 && east.height_m > 1.15 * west.height_m);
    }

    #[test]
    fn places_beyond_the_edge_take_the_nearest_cell() {
        let terrain = hills(8, 4.0);
        let site = flat_site(&terrain, 50.0, 12.0, 0.3);
        let params = GenerateParams::default();
        let stands = Stands::new(terrain.elevation_m.frame(), &site, 20.0, &params);
        assert_eq!(stands.cell(-5.0, -5.0), 56);
        assert_eq!(stands.cell(500.0, 500.0), 7);
        assert_eq!(stands.cell(0.1, 31.9), 0);
        assert!(stands.spot(-19.0, 51.0).height_m > 0.0);
    }
}
