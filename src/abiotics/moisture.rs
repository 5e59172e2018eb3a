//! Soil moisture of every month from a model that conserves water.
//!
//! Rain less evaporation, and water from upslope, enter a bounded soil store as slope and season allow
//! (`water_balance`); runoff and drainage run down a depression-free surface and gather in channels
//! (`drainage`, `routing`); land little above a channel drinks from it (`riparian`), and channels with
//! enough discharge are rivers. Over the whole map and in every month
//!
//! ```text
//! rain = evaporation + transpiration + change of storage + outflow
//! ```
//!
//! Everything follows from rain, so a drought that scales rain changes all of it.
//!
//! # Calibration
//! Infiltration, store and evaporated share are the values Kapp et al. 2020 ran. The three rates
//! [`MoistureParams`] calls calibrated were chosen once, for both species sets together, so that yearly
//! mean moisture lies where the species tables put their plants: 50–100 mm on Californian oak savanna
//! (Kapp 2020, Table 3), 20–40 mm on the steep Gresolet slopes (Peytavie 2024, Table 5). They are
//! plausible as soil physics, but nothing was measured on these sites. With each tile's own sunlight
//! they give yearly means (10th, 50th, 90th percentile of cells) of 13, 32, 66 mm on Gresolet, where 86 % of
//! cells suit at least one of its species, and in Sonoma's climate 36, 52, 95 mm on San Joaquin's savanna
//! and 39, 63, 102 mm on a gentle Slovenian tile, where every cell suits one.
//! # Departures
//! Kapp 2020 draws rivers from catchment area and drops its runoff; here rivers follow discharge.
//! Water standing in rivers is not moisture: their beds hold at most the soil's capacity, and
//! [`Water::river`] tells where they run. Water reaches its outlet in the month it falls or drains.
//! Roads dam no water that a short trench lets through (`breaching`); elsewhere the terrain keeps them.
//! Catchments end at the map's edge: water from beyond it is unknown and missing.

use rayon::prelude::*;

use crate::progress::{Cancelled, Reporter};
use crate::raster::{Grid, MONTHS, MonthlyGrid};
use crate::species::Climate;
use crate::terrain::Terrain;

use super::drainage::DrainageSurface;
use super::riparian::{NearestDrainage, take_up};
use super::routing::{Routed, route};
use super::water_balance::{CellSite, DAYS, WaterYear};

/// What the moisture model can be told.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct MoistureParams {
    /// Rate at which any soil drains below its roots, per month.
    /// Calibrated (see the module).
    pub percolation_per_month: f32,
    /// Rate at which soil drains along a slope, per month and sine of the slope.
    /// Calibrated (see the module).
    pub hillslope_drainage_per_month: f32,
    /// Length of slope, m, over which 63 % of the water running or seeping down it would enter the
    /// soil, had it room. Makes hollows wet at any cell size. Calibrated (see the module).
    pub run_on_infiltration_m: f32,
    /// Land that must drain to a place for a channel to begin there, m²; never under
    /// [`CHANNEL_MIN_CELLS`] cells. chosen: 1 ha, within the source areas
    /// that Montgomery & Dietrich 1988 mapped in humid and Mediterranean hills.
    pub channel_area_m2: f32,
    /// Mean discharge from which a channel is a river, m³/s. chosen: 1 l/s, which 6 ha with 500 mm of
    /// yearly runoff give: the small end of streams that flow most of the year.
    pub river_discharge_m3_s: f32,
    /// Height above a channel up to which its water table wets the root zone, m. chosen: about the depth
    /// of tree roots and capillary rise together.
    pub riparian_reach_m: f32,
}

impl Default for MoistureParams {
    fn default() -> Self {
        Self {
            percolation_per_month: 0.4,
            hillslope_drainage_per_month: 2.4,
            run_on_infiltration_m: 200.0,
            channel_area_m2: 10_000.0,
            river_discharge_m3_s: 0.001,
            riparian_reach_m: 2.0,
        }
    }
}

/// Fewest cells a channel drains, whatever their size. chosen: on coarse grids a handful of cells is no
/// valley, and single flow would draw stripes.
pub const CHANNEL_MIN_CELLS: f32 = 64.0;

/// Water on a terrain through the year.
#[derive(Clone, Debug)]
pub struct Water {
    /// Plant-available water in the soil, mean over each month, mm.
    pub moisture_mm: MonthlyGrid,
    /// Runoff and drainage through each cell, mean over the year, m³/s.
    pub discharge_m3_s: Grid<f32>,
    /// Height above the channel (or else the map's edge) that the cell's water first reaches, m, ≥ 0.
    pub height_above_drainage_m: Grid<f32>,
    /// Where a river runs.
    pub river: Grid<bool>,
    /// The books, January first.
    pub balance: [WaterBalance; MONTHS],
}

/// Where a month's rain went; means over the valid cells, mm.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WaterBalance {
    /// Rain.
    pub rain_mm: f64,
    /// Evaporated before it reached the soil.
    pub evaporation_mm: f64,
    /// Drawn by vegetation, from soil and channels.
    pub transpiration_mm: f64,
    /// Gained by the soil.
    pub storage_change_mm: f64,
    /// Left the map.
    pub outflow_mm: f64,
}

impl WaterBalance {
    /// Rain that is not accounted for, mm.
    pub fn error_mm(&self) -> f64 {
        self.rain_mm
            - self.evaporation_mm
            - self.transpiration_mm
            - self.storage_change_mm
            - self.outflow_mm
    }
}

/// Moisture and rivers of a terrain in a climate. `open_sky_sunlight_h` is what `sunlight_h` would be on
/// open flat ground.
///
/// # Errors
/// [`Cancelled`] once the run was cancelled.
///
/// # Panics
/// If the grids differ in size.
pub fn run(
    terrain: &Terrain,
    slope_rad: &Grid<f32>,
    sunlight_h: &MonthlyGrid,
    open_sky_sunlight_h: [f32; MONTHS],
    climate: &Climate,
    params: &MoistureParams,
    reporter: &Reporter,
) -> Result<Water, Cancelled> {
    let elevation_m = &terrain.elevation_m;
    let frame = elevation_m.frame();
    assert_eq!(slope_rad.frame().len(), frame.len(), "slope is not on the terrain's grid");
    assert_eq!(sunlight_h.frame().len(), frame.len(), "sunlight is not on the terrain's grid");
    let valid_cells = elevation_m.mask().valid_count();
    let stage = reporter.stage("moisture", valid_cells as u64);
    let cell_m = frame.cell_m();
    let cell_m2 = cell_m * cell_m;
    let surface = DrainageSurface::new(elevation_m, reporter)?;

    // Every cell's year, from the ridges down
    let altitude_range_m = elevation_m.range().unwrap_or_default();
    let water_year = WaterYear::new(
        climate,
        terrain.latitude_rad,
        open_sky_sunlight_h,
        altitude_range_m,
        cell_m,
        params,
    );
    let demand_mm = |index: usize| {
        let sun_h = std::array::from_fn(|month| sunlight_h.month(month)[index]);
        water_year.demand_mm(elevation_m.values()[index], &sun_h)
    };
    let channel_area_cells = (params.channel_area_m2 / cell_m2).max(CHANNEL_MIN_CELLS);
    let Routed { mut moisture_mm, mut yearly_outflow_mm, mut channels, sums } =
        route(&surface, channel_area_cells, reporter, &stage, |index, run_on_mm| {
            let site =
                CellSite { slope_rad: slope_rad.values()[index], demand_mm: demand_mm(index) };
            water_year.run(&site, run_on_mm)
        })?;

    // Land along channels
    let drainage = NearestDrainage::new(&surface, &channels, reporter)?;
    let heights_m = drainage.heights_m(&surface, &channels);
    let uptake = take_up(
        &drainage,
        &heights_m,
        &mut channels,
        &mut moisture_mm,
        climate.soil.soil_capacity_mm,
        params.riparian_reach_m,
        demand_mm,
    );

    // Discharge and rivers
    for channel in &channels {
        yearly_outflow_mm[channel.cell as usize] = channel.outflow_mm.iter().sum::<f64>() as f32;
    }
    let discharge_per_yearly_mm = cell_m2 / 1000.0 / (DAYS.iter().sum::<f32>() * 86_400.0);
    yearly_outflow_mm.par_iter_mut().for_each(|mm| *mm *= discharge_per_yearly_mm);
    let mut river = vec![false; frame.len()];
    for cell in channels.iter().map(|channel| channel.cell as usize) {
        river[cell] = yearly_outflow_mm[cell] >= params.river_discharge_m3_s;
    }

    // The books
    let evaporated = f64::from(climate.soil.evaporated_rain_fraction);
    let cells = valid_cells.max(1) as f64;
    let balance = std::array::from_fn(|m| WaterBalance {
        rain_mm: f64::from(climate.rain_mm[m]),
        evaporation_mm: f64::from(climate.rain_mm[m]) * evaporated,
        transpiration_mm: (sums.transpiration_mm[m] + uptake.transpired_mm[m]) / cells,
        storage_change_mm: (sums.storage_change_mm[m] + uptake.storage_change_mm[m]) / cells,
        outflow_mm: (sums.outflow_mm[m] - uptake.transpired_mm[m] - uptake.storage_change_mm[m])
            / cells,
    });
    Ok(Water {
        moisture_mm: MonthlyGrid::new(frame.clone(), elevation_m.mask().clone(), moisture_mm),
        discharge_m3_s: elevation_m.with_values(yearly_outflow_mm),
        height_above_drainage_m: elevation_m.with_values(heights_m),
        river: elevation_m.with_values(river),
        balance,
    })
}

#[cfg(test)]
mod tests {
    use std::path::{Path, PathBuf};
    use std::sync::Arc;

    use super::*;
    use crate::io::{Limits, raster_file};
    use crate::math;
    use crate::raster::{Cell, Frame, Mask};
    use crate::species::Soil;

    /// Kapp 2020's Sonoma (PAPER_NOTES §3).
    fn sonoma() -> Climate {
        Climate {
            latitude_deg: 38.578,
            station_altitude_m: 0.0,
            temperature_c: [13.5, 16.4, 18.6, 20.9, 24.4, 28.4, 32.1, 30.4, 29.3, 25.2, 18.2, 13.4],
            clear_sky_fraction: [0.7; MONTHS],
            rain_mm: [201.3, 162.5, 145.4, 73.6, 20.2, 12.8, 8.0, 11.0, 19.4, 52.9, 145.2, 158.6],
            lapse_rate_c_per_m: 0.0065,
            soil: Soil {
                evaporated_rain_fraction: 0.25,
                infiltration_max_mm: 100.0,
                infiltration_full_slope_rad: 5f32.to_radians(),
                infiltration_none_slope_rad: 55f32.to_radians(),
                soil_capacity_mm: 180.0,
            },
        }
    }

    fn slope(elevation_m: &Grid<f32>) -> Grid<f32> {
        let frame = elevation_m.frame();
        let at = |row: usize, col: usize, here: f32| {
            *elevation_m.get(Cell { row, col }).unwrap_or(&here)
        };
        let values = (0..frame.len()).map(|i| {
            let (Cell { row, col }, here) = (frame.cell(i), elevation_m.values()[i]);
            let east = at(row, col + 1, here) - at(row, col.saturating_sub(1), here);
            let south = at(row + 1, col, here) - at(row.saturating_sub(1), col, here);
            math::atan((east * east + south * south).sqrt() / (2.0 * frame.cell_m()))
        });
        elevation_m.with_values(values.collect())
    }

    fn water(elevation_m: &Grid<f32>, climate: &Climate, params: &MoistureParams) -> Water {
        let terrain = Terrain {
            elevation_m: elevation_m.clone(),
            latitude_rad: 0.67,
            grid_convergence_rad: 0.0,
        };
        let (frame, mask) = (elevation_m.frame(), elevation_m.mask());
        let hours = std::array::from_fn(|_| vec![8.0; frame.len()]);
        let sunlight_h = MonthlyGrid::new(frame.clone(), mask.clone(), hours);
        let slope_rad = slope(elevation_m);
        let reporter = Reporter::silent();
        run(&terrain, &slope_rad, &sunlight_h, [8.0; MONTHS], climate, params, &reporter).unwrap()
    }

    /// Hills, hollows and pits without any pattern.
    fn rough(rows: usize, cols: usize, cell_m: f64) -> Grid<f32> {
        Grid::from_fn(rows, cols, cell_m, |cell| {
            let (r, c) = (cell.row as f32, cell.col as f32);
            300.0
                + 0.2 * r
                + 14.0 * math::sin(r * 0.071 + 0.4) * math::cos(c * 0.053)
                + 4.0 * math::sin(r * 0.19 + c * 0.23)
                + 0.5 * math::sin(r * 12.9898 + c * 78.233)
        })
    }

    fn with_lake(elevation_m: &Grid<f32>) -> Grid<f32> {
        let frame = elevation_m.frame();
        let in_lake = |i: usize| {
            let Cell { row, col } = frame.cell(i);
            (40..60).contains(&row) && (50..90).contains(&col)
        };
        let mask = Mask::new((0..frame.len()).map(|i| !in_lake(i)).collect());
        Grid::new(frame.clone(), Arc::new(mask), elevation_m.values().to_vec())
    }

    fn assert_closed(water: &Water) {
        for (month, books) in water.balance.iter().enumerate() {
            assert!(
                books.error_mm().abs() <= 1e-6 * books.rain_mm,
                "month {month}: {:.2e} of rain",
                books.error_mm() / books.rain_mm
            );
            assert!(books.outflow_mm >= 0.0, "month {month}: {books:?}");
        }
    }

    #[test]
    fn water_in_is_water_out_every_month() {
        let params = MoistureParams { river_discharge_m3_s: 2e-4, ..MoistureParams::default() };
        for elevation_m in [rough(150, 170, 4.0), with_lake(&rough(150, 170, 4.0))] {
            let water = water(&elevation_m, &sonoma(), &params);
            assert_closed(&water);
            assert!(water.river.valid_values().any(|&r| r), "the books include rivers");
            let yearly: f64 = water.balance.iter().map(|b| b.storage_change_mm).sum();
            assert!(yearly.abs() < 2e-3, "the year repeats: {yearly}");
        }
    }

    #[test]
    fn moisture_stays_within_the_soil_on_any_ground() {
        let flat = Grid::from_fn(70, 80, 1.0, |_| 12.0);
        let single = Grid::from_fn(1, 1, 1.0, |_| 12.0);
        let cliffs =
            Grid::from_fn(70, 80, 1.0, |cell| ((cell.row * 7 + cell.col * 13) % 19) as f32 * 9.0);
        for elevation_m in [flat, single, cliffs, with_lake(&rough(100, 120, 1.0))] {
            let water = water(&elevation_m, &sonoma(), &MoistureParams::default());
            assert_closed(&water);
            for month in 0..MONTHS {
                for &mm in water.moisture_mm.month(month) {
                    assert!((0.0..=180.001).contains(&mm), "{mm}");
                }
            }
            assert!(water.discharge_m3_s.values().iter().all(|q| q.is_finite() && *q >= 0.0));
            assert!(
                water.height_above_drainage_m.values().iter().all(|&h| (0.0..1e4).contains(&h))
            );
        }
        let masked = Grid::new(
            Arc::new(Frame::local(3, 3, 1.0)),
            Arc::new(Mask::new(vec![false; 9])),
            vec![0.0; 9],
        );
        assert_eq!(
            water(&masked, &sonoma(), &MoistureParams::default()).balance[0].outflow_mm,
            0.0
        );
    }

    #[test]
    fn issue_2_water_of_flats_at_sea_level_is_not_lost() {
        let coast = |sea_m: f32| {
            Grid::from_fn(60, 70, 10.0, |cell| {
                sea_m.max(0.8 * (cell.col as f32 - 35.0) + 3.0 * math::sin(cell.row as f32 / 9.0))
            })
        };
        for sea_m in [0.0, -0.0, -1e-6, 1e-30, -3.0] {
            let flat = Grid::from_fn(30, 40, 10.0, |_| sea_m);
            for elevation_m in [flat, coast(sea_m)] {
                assert_closed(&water(&elevation_m, &sonoma(), &MoistureParams::default()));
            }
        }
    }

    #[test]
    fn discharge_of_a_sealed_ramp_is_the_rain_on_the_land_above() {
        let mut climate = sonoma();
        climate.rain_mm = [80.0; MONTHS];
        climate.soil.infiltration_max_mm = 0.0;
        let params =
            MoistureParams { run_on_infiltration_m: f32::INFINITY, ..MoistureParams::default() };
        let ramp = Grid::from_fn(121, 40, 5.0, |cell| 100.0 - cell.col as f32);
        let water = water(&ramp, &climate, &params);
        for col in [0, 7, 39] {
            let area_m2 = 25.0 * (col + 1) as f32; // the middle row is out of reach of the sides
            let expected = area_m2 * 12.0 * 0.060 / (365.0 * 86_400.0);
            let got = water.discharge_m3_s[Cell { row: 60, col }];
            assert!((got / expected - 1.0).abs() < 1e-5, "column {col}: {got}, {expected}");
        }
        assert!(water.balance.iter().all(|b| (b.outflow_mm - 60.0).abs() < 1e-4));
    }

    #[test]
    fn a_valley_is_wettest_at_the_bottom_and_its_ridges_are_driest() {
        let valley = Grid::from_fn(120, 121, 3.0, |cell| {
            (cell.col as f32 - 60.0).abs() * 0.6 + (120 - cell.row) as f32 * 0.15
        });
        let mean = water(&valley, &sonoma(), &MoistureParams::default()).moisture_mm.yearly_mean();
        let row: Vec<f32> = (0..121).map(|col| mean[Cell { row: 90, col }]).collect();
        for col in 2..60 {
            assert!(row[col] <= row[col + 1] + 1e-3, "left side falls at column {col}");
            assert!(row[120 - col] <= row[119 - col] + 1e-3, "right side falls at {}", 120 - col);
        }
        assert!(row[60] > 1.5 * row[5], "{} {}", row[60], row[5]);
    }

    #[test]
    fn a_cone_is_alike_in_all_four_directions() {
        let cone = Grid::from_fn(101, 101, 2.0, |cell| {
            let (r, c) = (cell.row as f32 - 50.0, cell.col as f32 - 50.0);
            200.0 - 0.5 * (r * r + c * c).sqrt()
        });
        let mean = water(&cone, &sonoma(), &MoistureParams::default()).moisture_mm.yearly_mean();
        for row in 0..101 {
            for col in 0..101 {
                let turned = mean[Cell { row: col, col: 100 - row }];
                assert!((mean[Cell { row, col }] - turned).abs() < 0.02, "({row}, {col})");
            }
        }
    }

    #[test]
    fn a_river_passes_beneath_a_road_with_all_its_water() {
        let valley = |crown_m: f32| {
            Grid::from_fn(160, 121, 2.0, |cell| {
                let side = cell.col.abs_diff(60) as f32;
                let ground_m = 400.0 - 0.06 * cell.row as f32 + (0.3 * side).min(2.5) + 0.02 * side;
                let is_road = (90..94).contains(&cell.row); // 8 m
                if is_road { ground_m.max(394.5 + crown_m) } else { ground_m }
            })
        };
        let params = MoistureParams { river_discharge_m3_s: 2e-4, ..MoistureParams::default() };
        let (open, dammed) =
            (water(&valley(-9.0), &sonoma(), &params), water(&valley(3.0), &sonoma(), &params));
        // at the road's foot side water comes sooner: more than without, and the same further down
        for (row, most) in [(80, 1.01), (100, 1.3), (120, 1.1), (158, 1.02)] {
            let bed = Cell { row, col: 60 };
            let ratio = dammed.discharge_m3_s[bed] / open.discharge_m3_s[bed];
            assert!(dammed.river[bed] && (0.98..most).contains(&ratio), "row {row}: {ratio}");
        }
    }

    #[test]
    fn a_drought_dries_everything_downstream_of_it() {
        let params = MoistureParams { river_discharge_m3_s: 2e-4, ..MoistureParams::default() };
        let elevation_m = rough(150, 170, 4.0);
        let mut drought = sonoma();
        drought.rain_mm = drought.rain_mm.map(|mm| mm / 2.0);
        let (wet, dry) =
            (water(&elevation_m, &sonoma(), &params), water(&elevation_m, &drought, &params));
        for i in 0..elevation_m.values().len() {
            for m in 0..MONTHS {
                let (before, after) = (wet.moisture_mm.month(m)[i], dry.moisture_mm.month(m)[i]);
                assert!(
                    after <= before + 1e-3,
                    "cell {i}, month {m}: {before} mm, then {after} mm"
                );
            }
            let (before, after) = (wet.discharge_m3_s.values()[i], dry.discharge_m3_s.values()[i]);
            assert!(after <= before, "cell {i}: {before} m³/s, then {after} m³/s");
        }
        let rivers = |water: &Water| water.river.values().iter().filter(|r| **r).count();
        assert!(rivers(&dry) * 10 < rivers(&wet) * 9, "{} of {}", rivers(&dry), rivers(&wet));
        let mean = |water: &Water| -> f32 { water.moisture_mm.yearly_mean().values().iter().sum() };
        assert!(mean(&dry) < 0.8 * mean(&wet));
    }

    #[test]
    fn channels_wet_the_land_along_them_and_pay_for_it() {
        let params = MoistureParams { river_discharge_m3_s: 2e-4, ..MoistureParams::default() };
        let no_banks = MoistureParams { riparian_reach_m: 0.0, ..params.clone() };
        let elevation_m = rough(150, 170, 4.0);
        let (with, without) =
            (water(&elevation_m, &sonoma(), &params), water(&elevation_m, &sonoma(), &no_banks));
        let july = |water: &Water, i: usize| water.moisture_mm.month(6)[i];
        let mut wetted = 0;
        for i in 0..elevation_m.values().len() {
            assert!(july(&with, i) >= july(&without, i) - 1e-3);
            assert!(with.discharge_m3_s.values()[i] <= without.discharge_m3_s.values()[i]);
            let near = with.height_above_drainage_m.values()[i] < 2.0;
            wetted += usize::from(july(&with, i) > july(&without, i) + 0.1);
            assert!(near || july(&with, i) == july(&without, i), "cell {i} lies above the reach");
        }
        assert!(wetted > 50, "{wetted}");
        assert!(with.balance[6].transpiration_mm > without.balance[6].transpiration_mm);
        assert!(with.balance[6].outflow_mm < without.balance[6].outflow_mm);
    }

    #[test]
    fn same_bits_with_one_and_two_threads() {
        let elevation_m = with_lake(&rough(200, 230, 2.0));
        let with_threads = |n: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap();
            pool.install(|| water(&elevation_m, &sonoma(), &MoistureParams::default()))
        };
        let (one, two) = (with_threads(1), with_threads(2));
        for m in 0..MONTHS {
            assert_eq!(one.moisture_mm.month(m), two.moisture_mm.month(m));
        }
        assert_eq!(one.discharge_m3_s.values(), two.discharge_m3_s.values());
        assert_eq!(one.river.values(), two.river.values());
        assert_eq!(one.balance, two.balance);
    }

    /// Spearman's rank correlation; ties keep their order, which a map of floats hardly notices.
    fn rank_correlation(a: &[f32], b: &[f32]) -> f64 {
        let ranks = |values: &[f32]| {
            let mut order: Vec<usize> = (0..values.len()).collect();
            order.sort_by(|&i, &j| values[i].total_cmp(&values[j]));
            let mut rank = vec![0.0; values.len()];
            for (place, i) in order.into_iter().enumerate() {
                rank[i] = place as f64;
            }
            rank
        };
        let middle = (a.len() as f64 - 1.0) / 2.0;
        let (a, b) = (ranks(a), ranks(b));
        let covariance: f64 = a.iter().zip(&b).map(|(x, y)| (x - middle) * (y - middle)).sum();
        covariance / a.iter().map(|x| (x - middle) * (x - middle)).sum::<f64>()
    }

    /// Height above the mean of the land within 50 m to each side, at valid cells.
    fn relative_height_m(elevation_m: &Grid<f32>) -> Vec<f32> {
        let frame = elevation_m.frame();
        let reach = (50.0 / frame.cell_m()).round().max(1.0) as usize;
        // summed-area table of heights and valid cells
        let stride = frame.cols + 1;
        let mut sums = vec![(0.0_f64, 0.0_f64); (frame.rows + 1) * stride];
        for i in 0..frame.len() {
            let Cell { row, col } = frame.cell(i);
            let own = match elevation_m.get(Cell { row, col }) {
                Some(&z) => (f64::from(z), 1.0),
                None => (0.0, 0.0),
            };
            let at = |r: usize, c: usize| sums[r * stride + c];
            let (up, left, both) = (at(row, col + 1), at(row + 1, col), at(row, col));
            sums[(row + 1) * stride + col + 1] =
                (own.0 + up.0 + left.0 - both.0, own.1 + up.1 + left.1 - both.1);
        }
        (0..frame.len())
            .filter(|&i| elevation_m.mask().is_valid(i))
            .map(|i| {
                let Cell { row, col } = frame.cell(i);
                let (r0, r1) = (row.saturating_sub(reach), (row + reach + 1).min(frame.rows));
                let (c0, c1) = (col.saturating_sub(reach), (col + reach + 1).min(frame.cols));
                let at = |r: usize, c: usize| sums[r * stride + c];
                let (a, b, c, d) = (at(r1, c1), at(r0, c1), at(r1, c0), at(r0, c0));
                let mean = (a.0 - b.0 - c.0 + d.0) / (a.1 - b.1 - c.1 + d.1);
                (f64::from(elevation_m.values()[i]) - mean) as f32
            })
            .collect()
    }

    /// Heights of a file as they are, on cells of a given width.
    fn real_tile(path: &Path, cell_m: f64) -> Grid<f32> {
        let raster = raster_file::read(path, None, &Limits::default()).unwrap();
        let frame = Frame::local(raster.rows, raster.cols, cell_m);
        Grid::new(Arc::new(frame), Arc::new(Mask::new(raster.valid)), raster.values)
    }

    #[test]
    fn valleys_are_moist_and_ridges_dry_on_every_real_tile() {
        let data = std::env::var_os("WILDWOOD_DATA").map_or_else(
            || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/data"),
            PathBuf::from,
        );
        if !data.is_dir() {
            eprintln!("skipped: ../shared/data is missing");
            return;
        }
        let tiles = [
            ("canopy_pairs/neon_sjer_4m_dtm.tif", 4.0),
            ("canopy_pairs/neon_harv_4m_dtm.tif", 4.0),
            ("canopy_pairs/bcts_bc_dtm.tif", 1.0),
            ("canopy_pairs/lidR_topography_dtm.tif", 1.0),
            ("canopy_pairs/pyfor_osbs_dtm.tif", 1.0),
            ("dem/slovenia_TM1_564_146_1m.tif", 1.0),
            ("dem/SFX_A01_2012_laz_1_denoised_dtm.tif", 2.0),
            ("gresolet/heightfield.elv", 2.0),
        ];
        for (name, cell_m) in tiles {
            let elevation_m = real_tile(&data.join(name), cell_m);
            let water = water(&elevation_m, &sonoma(), &MoistureParams::default());
            assert_closed(&water);
            let moisture: Vec<f32> =
                water.moisture_mm.yearly_mean().valid_values().copied().collect();
            let rho = rank_correlation(&relative_height_m(&elevation_m), &moisture);
            eprintln!("{name}: rank correlation {rho:.2}");
            assert!(rho < -0.1, "{name}: moisture rises with height, {rho:.2}");
        }
    }
}
