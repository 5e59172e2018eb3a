//! One cell's water year: rain and run-on in, evaporation, transpiration and drainage out.
//!
//! The soil is a bounded store that drains and transpires in proportion to what it holds, so a month
//! with an even inflow i has a closed form. With k = k_drain + k_transpire (per month) and start S₀:
//!
//! ```text
//! S(t)   = S₀ e^(−kt) + (i/k)(1 − e^(−kt))          the store at time t of the month, 0..=1
//! S₁     = S₀ e^(−k) + i φ,      φ = (1 − e^(−k))/k   the store at the month's end
//! S̄      = S₀ φ + i ψ,           ψ = (1 − φ)/k        its mean over the month: the map's moisture
//! S₀ + i − S₁ = k S̄                                  what left, shared as k_drain : k_transpire
//! ```
//!
//! What is offered to the soil is net rain up to the infiltration capacity of the slope, plus the share
//! 1 − e^(−cell width / L) of the water that comes from upslope; of that enters what keeps S₁ ≤ capacity,
//! the rest runs on. S(t) never leaves the span between S₀ and S₁, so S₁ ≤ capacity bounds the whole month.
//! All amounts are millimetres over the cell, all rates per month.
//!
//! # Reference
//! Infiltration by slope, store size, evaporated share: Kapp et al. 2020, section 5.1,
//! doi:10.1145/3414685.3417848, with the values its authors ran.
//! Transpiration in proportion to the store: Manabe 1969, "Climate and the ocean circulation I",
//! Monthly Weather Review 97(11), without its upper threshold.
//! Demand: Hamon 1963, "Computation of direct runoff amounts from storm rainfall", IAHS Publ. 63,
//! in the metric form of Lu et al. 2005, "A comparison of six potential evapotranspiration methods",
//! Journal of the American Water Resources Association 41(3), doi:10.1111/j.1752-1688.2005.tb03759.x.
//! Drainage as gravity along the slope: Beven 1981, "Kinematic subsurface stormflow", Water Resources
//! Research 17(5), doi:10.1029/WR017i005p01419.
//! # Departures
//! Slope limits the infiltration of rain only: water from upslope comes slowly and largely within the
//! soil, and were it limited too, steep hollows would be as dry as the slopes that feed them.
//! No snow: winter's precipitation enters the soil in winter.

use crate::math;
use crate::raster::MONTHS;
use crate::species::{Climate, Soil};

use super::moisture::MoistureParams;
use super::solar;
use super::temperature::temperature_c;

/// Days of each month in a common year.
pub(super) const DAYS: [f32; MONTHS] =
    [31.0, 28.0, 31.0, 30.0, 31.0, 30.0, 31.0, 31.0, 30.0, 31.0, 30.0, 31.0];

/// Largest difference between the store on 1 January and a year later, mm.
/// chosen: far below what any species tells apart; the rest is booked as storage change.
const CYCLE_TOLERANCE_MM: f32 = 1e-3;

/// Years tried before an unclosed cycle is accepted. chosen: the Newton steps need 2–4.
const MAX_YEARS: usize = 20;

/// Rates below this take the series of φ and ψ, whose next terms are under 1e-7.
const SERIES_RATE: f32 = 0.05;

/// What all cells share: weather and soil.
pub(super) struct WaterYear {
    net_rain_mm: [f32; MONTHS],
    /// Demand per hour of daily sun, by altitude, mm/h.
    demand_table: DemandTable,
    soil: Soil,
    params: MoistureParams,
    /// Share of passing water that may enter the soil of one cell.
    run_on_share: f32,
}

/// A cell's place in the water year.
pub(super) struct CellSite {
    /// Slope, radians.
    pub slope_rad: f32,
    /// Atmospheric demand of each month, mm.
    pub demand_mm: [f32; MONTHS],
}

/// A cell's year once its store repeats.
#[derive(Default)]
pub(super) struct CellYear {
    /// Mean water in the soil.
    pub moisture_mm: [f32; MONTHS],
    /// Water the plants drew.
    pub transpiration_mm: [f64; MONTHS],
    /// Store at the month's end less that at its start.
    pub storage_change_mm: [f64; MONTHS],
    /// Runoff and drainage to lower cells.
    pub outflow_mm: [f64; MONTHS],
}

/// The factors of one month's closed form.
#[derive(Clone, Copy, Default)]
struct MonthFactors {
    /// e^(−k).
    kept: f32,
    /// φ.
    from_inflow: f32,
    /// ψ.
    mean_from_inflow: f32,
    /// k_drain / k.
    drained_fraction: f32,
}

impl MonthFactors {
    fn new(drain_rate: f32, transpire_rate: f32) -> Self {
        let k = drain_rate + transpire_rate;
        if k < SERIES_RATE {
            let phi = 1.0 - k * (0.5 - k * (1.0 / 6.0 - k / 24.0));
            return Self {
                kept: 1.0 - k * phi,
                from_inflow: phi,
                mean_from_inflow: 0.5 - k * (1.0 / 6.0 - k * (1.0 / 24.0 - k / 120.0)),
                drained_fraction: if k > 0.0 { drain_rate / k } else { 0.0 },
            };
        }
        let kept = math::exp(-k);
        let per_k = 1.0 / k;
        let from_inflow = (1.0 - kept) * per_k;
        Self {
            kept,
            from_inflow,
            mean_from_inflow: (1.0 - from_inflow) * per_k,
            drained_fraction: drain_rate * per_k,
        }
    }
}

impl WaterYear {
    /// The water year of a climate on cells of a given width, between two altitudes.
    pub fn new(
        climate: &Climate,
        latitude_rad: f64,
        open_sky_sunlight_h: [f32; MONTHS],
        altitude_range_m: (f32, f32),
        cell_m: f32,
        params: &MoistureParams,
    ) -> Self {
        let demand_mm_per_h = |altitude_m| {
            std::array::from_fn(|month| {
                let demand_mm = open_demand_mm(climate, latitude_rad, month, altitude_m);
                // in polar night there is neither sun nor demand
                demand_mm / open_sky_sunlight_h[month].max(MIN_OPEN_SUNLIGHT_H)
            })
        };
        Self {
            net_rain_mm: climate.rain_mm.map(|p| p * (1.0 - climate.soil.evaporated_rain_fraction)),
            demand_table: DemandTable::new(altitude_range_m, demand_mm_per_h),
            soil: climate.soil.clone(),
            params: params.clone(),
            run_on_share: 1.0 - math::exp(-cell_m / params.run_on_infiltration_m),
        }
    }

    /// The soil's facts.
    pub fn soil(&self) -> &Soil {
        &self.soil
    }

    /// Atmospheric demand for water each month, mm: Hamon's, scaled by the cell's share of open sun.
    #[inline]
    pub fn demand_mm(&self, altitude_m: f32, sunlight_h: &[f32; MONTHS]) -> [f32; MONTHS] {
        let mut demand_mm = self.demand_table.at(altitude_m);
        for (demand, sun) in demand_mm.iter_mut().zip(sunlight_h) {
            *demand *= sun;
        }
        demand_mm
    }

    /// Share of its store that a soil drains in a month, as a rate; steeper soils drain faster.
    pub fn drain_rate_per_month(&self, slope_rad: f32) -> f32 {
        self.params.percolation_per_month
            + self.params.hillslope_drainage_per_month * math::sin(slope_rad)
    }

    /// The year of a cell that receives `run_on_mm` from above, once its store repeats.
    pub fn run(&self, site: &CellSite, run_on_mm: &[f64; MONTHS]) -> CellYear {
        let soil = self.soil();
        let capacity_mm = soil.soil_capacity_mm;
        let intake_mm = infiltration_capacity_mm(soil, site.slope_rad);
        let drain_rate = self.drain_rate_per_month(site.slope_rad);

        // Each month's factors and the water offered to the soil
        let mut factors = [MonthFactors::default(); MONTHS];
        let mut offered_mm = [0.0_f32; MONTHS];
        for m in 0..MONTHS {
            factors[m] = MonthFactors::new(drain_rate, site.demand_mm[m] / capacity_mm);
            let passing_mm = run_on_mm[m] as f32 * self.run_on_share;
            offered_mm[m] = self.net_rain_mm[m].min(intake_mm) + passing_mm;
        }

        // The store of 1 January that a year brings back: the year's map is piecewise linear, and
        // Newton's step is the fixed point of the piece it stands on
        let mut start_mm = 0.5 * capacity_mm;
        let mut year = CellYear::default();
        for _ in 0..MAX_YEARS {
            let (end_mm, memory) = year_end(&factors, &offered_mm, start_mm, capacity_mm);
            start_mm = if memory < 0.999 {
                ((end_mm - memory * start_mm) / (1.0 - memory)).clamp(0.0, capacity_mm)
            } else {
                end_mm
            };
            let end_mm = self.record(&factors, &offered_mm, run_on_mm, start_mm, &mut year);
            if (end_mm - start_mm).abs() < CYCLE_TOLERANCE_MM {
                break;
            }
            start_mm = end_mm;
        }
        year
    }

    /// Books a year that starts with a given store; returns the store at its end.
    fn record(
        &self,
        factors: &[MonthFactors; MONTHS],
        offered_mm: &[f32; MONTHS],
        run_on_mm: &[f64; MONTHS],
        start_mm: f32,
        year: &mut CellYear,
    ) -> f32 {
        let capacity_mm = self.soil().soil_capacity_mm;
        let mut store_mm = start_mm;
        for m in 0..MONTHS {
            let f = factors[m];
            let (inflow_mm, end_mm) = month_end(f, offered_mm[m], store_mm, capacity_mm);
            let mean_mm = store_mm * f.from_inflow + inflow_mm * f.mean_from_inflow;
            year.moisture_mm[m] = mean_mm.clamp(0.0, capacity_mm);
            // sums in f64: in a dry month a last digit of the store is not small beside the rain
            let change_mm = f64::from(end_mm) - f64::from(store_mm);
            let lost_mm = (f64::from(inflow_mm) - change_mm).max(0.0);
            let drained_mm = lost_mm * f64::from(f.drained_fraction);
            let runoff_mm = run_on_mm[m] + f64::from(self.net_rain_mm[m]) - f64::from(inflow_mm);
            year.transpiration_mm[m] = lost_mm - drained_mm;
            year.storage_change_mm[m] = change_mm;
            year.outflow_mm[m] = runoff_mm.max(0.0) + drained_mm;
            store_mm = end_mm;
        }
        store_mm
    }
}

/// Inflow that fits, and the store at the month's end.
#[inline]
fn month_end(f: MonthFactors, offered_mm: f32, store_mm: f32, capacity_mm: f32) -> (f32, f32) {
    let kept_mm = store_mm * f.kept;
    let end_mm = kept_mm + offered_mm * f.from_inflow;
    if end_mm <= capacity_mm {
        (offered_mm, end_mm)
    } else {
        (((capacity_mm - kept_mm) / f.from_inflow).clamp(0.0, offered_mm), capacity_mm)
    }
}

/// The store after a year, and by how much it moves per millimetre more at the year's start.
#[inline]
fn year_end(
    factors: &[MonthFactors; MONTHS],
    offered_mm: &[f32; MONTHS],
    start_mm: f32,
    capacity_mm: f32,
) -> (f32, f32) {
    let (mut store_mm, mut memory) = (start_mm, 1.0);
    for (&f, &offered) in factors.iter().zip(offered_mm) {
        let (_, end_mm) = month_end(f, offered, store_mm, capacity_mm);
        memory = if end_mm < capacity_mm { memory * f.kept } else { 0.0 };
        store_mm = end_mm;
    }
    (store_mm, memory)
}

/// Most water that can enter the soil in a month, mm: all on gentle ground, none on cliffs.
///
/// # Reference
/// The values Kapp et al. 2020 ran: 100 mm below 5°, none from 55°, linear between.
pub(super) fn infiltration_capacity_mm(soil: &Soil, slope_rad: f32) -> f32 {
    let (full, none) = (soil.infiltration_full_slope_rad, soil.infiltration_none_slope_rad);
    let share = if slope_rad <= full { 1.0 } else { (none - slope_rad) / (none - full) };
    soil.infiltration_max_mm * share.clamp(0.0, 1.0)
}

/// Demand per hour of sun at evenly spaced altitudes, read by linear interpolation:
/// cheaper than the formula by far, and within 1e-6 of it at a spacing of one metre.
struct DemandTable {
    lowest_m: f32,
    steps_per_m: f32,
    rows: Vec<[f32; MONTHS]>,
}

impl DemandTable {
    fn new((lowest_m, highest_m): (f32, f32), at_altitude: impl Fn(f32) -> [f32; MONTHS]) -> Self {
        let range_m = (highest_m - lowest_m).max(1.0);
        let steps = range_m.ceil().min(MAX_TABLE_STEPS);
        let step_m = range_m / steps;
        let rows =
            (0..=steps as usize).map(|i| at_altitude(lowest_m + i as f32 * step_m)).collect();
        Self { lowest_m, steps_per_m: 1.0 / step_m, rows }
    }

    #[inline]
    fn at(&self, altitude_m: f32) -> [f32; MONTHS] {
        let place = ((altitude_m - self.lowest_m) * self.steps_per_m).max(0.0);
        let below = (place as usize).min(self.rows.len() - 2);
        let (low, high) = (&self.rows[below], &self.rows[below + 1]);
        let t = (place - below as f32).min(1.0);
        std::array::from_fn(|m| math::lerp(low[m], high[m], t))
    }
}

/// Most steps of a [`DemandTable`]. chosen: one a metre up to any mountain on Earth.
const MAX_TABLE_STEPS: f32 = 10_000.0;

/// Open-sky sun below which a month counts as polar night, hours a day. chosen: 4 minutes.
const MIN_OPEN_SUNLIGHT_H: f32 = 0.07;

/// Atmospheric demand for water on open flat ground in a month, mm.
///
/// # Reference
/// Hamon 1963 as in Lu et al. 2005, with a calibration factor of 1.
fn open_demand_mm(climate: &Climate, latitude_rad: f64, month: usize, altitude_m: f32) -> f32 {
    let declination_rad = solar::declination_rad(solar::REPRESENTATIVE_DAY[month]);
    let day_length_h = solar::day_length_h(latitude_rad, declination_rad) as f32; // 0–24
    let vapour_g_m3 = saturated_vapour_density_g_m3(temperature_c(climate, month, altitude_m));
    HAMON_MM_PER_DAY * DAYS[month] * day_length_h / 12.0 * vapour_g_m3
}

/// Hamon's daily demand per unit of vapour density for a day of 12 h, mm per g/m³. Lu et al. 2005.
const HAMON_MM_PER_DAY: f32 = 0.1651;

/// Water vapour that saturates air, g/m³.
///
/// # Reference
/// Lu et al. 2005: 216.7 e / (T + 273.3), e = 6.108 exp(17.26939 T / (T + 237.3)) in hPa.
fn saturated_vapour_density_g_m3(temperature_c: f32) -> f32 {
    // outside of this span there is no such weather, only broken heights; the formula has a pole
    let t = temperature_c.clamp(-80.0, 60.0);
    216.7 * 6.108 * math::exp(17.26939 * t / (t + 237.3)) / (t + 273.3)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn climate(rain_mm: f32, temperature_c: f32) -> Climate {
        Climate {
            latitude_deg: 45.0,
            station_altitude_m: 0.0,
            temperature_c: [temperature_c; MONTHS],
            clear_sky_fraction: [0.5; MONTHS],
            rain_mm: [rain_mm; MONTHS],
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

    fn water_year(rain_mm: f32) -> WaterYear {
        let params = MoistureParams::default();
        WaterYear::new(&climate(rain_mm, 15.0), 0.8, [6.0; MONTHS], (0.0, 900.0), 1.0, &params)
    }

    #[test]
    fn a_steady_month_after_month_stands_at_inflow_over_rate() {
        let year = water_year(60.0);
        let site = CellSite { slope_rad: 0.3, demand_mm: [54.0; MONTHS] };
        let cell = year.run(&site, &[0.0; MONTHS]);
        let rate = year.drain_rate_per_month(0.3) + 54.0 / 180.0;
        for m in 0..MONTHS {
            assert!((cell.moisture_mm[m] - 45.0 / rate).abs() < 1e-3);
            assert!((cell.transpiration_mm[m] - f64::from(45.0 / rate * 0.3)).abs() < 1e-3);
            assert!(cell.storage_change_mm[m].abs() < 1e-3);
        }
    }

    #[test]
    fn every_month_closes_and_the_year_repeats() {
        let mut year = water_year(0.0);
        year.net_rain_mm = std::array::from_fn(|m| if m % 12 < 5 { 150.0 } else { 2.0 * m as f32 });
        for slope_deg in [0.0_f32, 4.0, 20.0, 54.0, 70.0] {
            for run_on in [0.0, 30.0, 5e4] {
                for demand in [0.0, 40.0, 170.0] {
                    let site = CellSite {
                        slope_rad: slope_deg.to_radians(),
                        demand_mm: std::array::from_fn(|m| demand * (m % 5) as f32 / 2.0),
                    };
                    let cell = year.run(&site, &[run_on; MONTHS]);
                    let mut drift = 0.0;
                    for m in 0..MONTHS {
                        let gained = f64::from(year.net_rain_mm[m]) + run_on;
                        let spent = cell.transpiration_mm[m]
                            + cell.storage_change_mm[m]
                            + cell.outflow_mm[m];
                        assert!(
                            (gained - spent).abs() < 1e-9 * gained.max(1e3),
                            "{slope_deg}° {run_on} {demand}"
                        );
                        assert!((0.0..=180.0).contains(&cell.moisture_mm[m]));
                        assert!(
                            cell.transpiration_mm[m] <= f64::from(site.demand_mm[m]) * 1.001 + 1e-3
                        );
                        drift += cell.storage_change_mm[m];
                    }
                    assert!(drift.abs() < 2e-3, "{slope_deg}° {run_on} {demand}: {drift}");
                }
            }
        }
    }

    #[test]
    fn series_and_closed_form_meet() {
        let (below, above) = (MonthFactors::new(0.0499999, 0.0), MonthFactors::new(0.0500001, 0.0));
        assert!((below.kept - above.kept).abs() < 1e-6);
        assert!((below.from_inflow - above.from_inflow).abs() < 3e-6);
        assert!((below.mean_from_inflow - above.mean_from_inflow).abs() < 6e-5);
        assert_eq!(MonthFactors::new(0.0, 0.0).kept, 1.0);
    }

    #[test]
    fn infiltration_falls_linearly_from_five_to_fifty_five_degrees() {
        let soil = climate(0.0, 0.0).soil;
        for (slope_deg, expected) in
            [(0.0, 100.0), (5.0, 100.0), (30.0, 50.0), (55.0, 0.0), (80.0, 0.0)]
        {
            let got = infiltration_capacity_mm(&soil, f32::to_radians(slope_deg));
            assert!((got - expected).abs() < 1e-3, "{slope_deg}°: {got}");
        }
    }

    #[test]
    fn demand_is_hamons_and_follows_the_sun() {
        // 20 °C: 17.3 g/m³ saturate air (tables); 12 h days at the equator: 0.1651·17.3 mm a day
        assert!((saturated_vapour_density_g_m3(20.0) - 17.3).abs() < 0.1);
        let climate = climate(0.0, 20.0);
        let params = MoistureParams::default();
        let year = WaterYear::new(&climate, 0.0, [8.0; MONTHS], (0.0, 2500.5), 1.0, &params);
        let open = year.demand_mm(0.0, &[8.0; MONTHS]);
        assert!((open[0] - 31.0 * 0.1651 * 17.3).abs() < 0.6);
        assert!((year.demand_mm(0.0, &[2.0; MONTHS])[0] / open[0] - 0.25).abs() < 1e-6);
        for altitude_m in [0.0, 0.37, 1234.56, 2500.5] {
            let (table, formula) = (
                year.demand_mm(altitude_m, &[8.0; MONTHS])[6],
                open_demand_mm(&climate, 0.0, 6, altitude_m),
            );
            assert!((table / formula - 1.0).abs() < 2e-6, "{altitude_m} m: {table}, {formula}");
        }
    }

    #[test]
    fn steep_ground_sheds_rain_but_takes_water_from_upslope() {
        let year = water_year(80.0);
        let site = CellSite { slope_rad: 1.0, demand_mm: [30.0; MONTHS] };
        assert!(year.run(&site, &[0.0; MONTHS]).moisture_mm.iter().all(|&mm| mm < 1e-3));
        let seeping_mm =
            5000.0 * (1.0 - math::exp(-1.0 / MoistureParams::default().run_on_infiltration_m));
        let rate = year.drain_rate_per_month(1.0) + 30.0 / 180.0;
        let fed = year.run(&site, &[5000.0; MONTHS]).moisture_mm[3];
        assert!((fed - seeping_mm / rate).abs() < 0.01, "{fed}");
    }

    #[test]
    fn more_water_never_dries_a_cell() {
        let year = water_year(50.0);
        let site = CellSite { slope_rad: 0.1, demand_mm: [70.0; MONTHS] };
        let mut last = year.run(&site, &[0.0; MONTHS]);
        for run_on in [1.0, 50.0, 1e3, 1e5, 1e8] {
            let next = year.run(&site, &[run_on; MONTHS]);
            for m in 0..MONTHS {
                assert!(next.moisture_mm[m] >= last.moisture_mm[m] - 1e-4);
                assert!(next.outflow_mm[m] >= last.outflow_mm[m] - 1e-4);
            }
            last = next;
        }
    }
}
