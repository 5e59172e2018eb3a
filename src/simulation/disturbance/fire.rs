//! Wildfire: which cells burn, by a cellular automaton.
//!
//! # Reference
//! Alexandridis et al. 2008, doi:10.1016/j.amc.2008.06.046; Peytavie et al. 2024, section 5.3.1, Eqs. 12–13,
//! doi:10.1145/3641816.

use std::f32::consts::{FRAC_PI_4, SQRT_2};

use crate::math;
use crate::rng::{self, Key, Process};

/// Chance that fire passes between two cells of common fuel, on flat ground in still air (P₀; PAPER_NOTES §10).
const COMMON_FUEL_PROBABILITY: f32 = 0.6;
/// Dry fuel burns so many times better than common fuel (a of Eq. 13; PAPER_NOTES §10).
const DRY_FUEL_FACTOR: f32 = 3.258;
/// How fast moisture damps fire, per percent (b of Eq. 13; PAPER_NOTES §10).
const MOISTURE_DAMPING_PER_PERCENT: f32 = 0.111;
/// How fast slope drives fire, per degree (a of Eq. 13; PAPER_NOTES §10).
const SLOPE_GAIN_PER_DEGREE: f32 = 0.063;
/// How fast wind drives fire along it, per m/s (c₁ of Eq. 13; PAPER_NOTES §10).
const WIND_GAIN_S_M: f32 = 0.045;
/// How fast wind holds fire back aslant and against it, per m/s (c₂ of Eq. 13; Alexandridis 2008, whose value other programs after
/// that paper have too; PAPER_NOTES §10 has 0.191).
const CROSSWIND_GAIN_S_M: f32 = 0.131;
/// Power of height (d of Eq. 12; PAPER_NOTES §10).
const HEIGHT_EXPONENT: f32 = 0.932;
/// Fuel of this height and above is common fuel. chosen: tall shrubs carry fire as forest does.
const COMMON_FUEL_HEIGHT_M: f32 = 2.0;
/// P_den of sparse and of dense fuel (Alexandridis 2008, table of densities).
const SPARSE_TO_DENSE: [f32; 2] = [-0.4, 0.3];
/// Steps of row and column to the eight neighbours.
const NEIGHBOURS: [(isize, isize); 8] =
    [(-1, 0), (-1, 1), (0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1)];

/// Where a fire begins, in shares of the plot from its south-west corner.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Ignition {
    /// Share of the plot's width.
    pub east_fraction: f32,
    /// Share of the plot's height.
    pub north_fraction: f32,
    /// Cells whose centre is no further off burn at once, and the cell of the place itself.
    pub radius_m: f32,
}

/// A wildfire; its wind blows towards the direction given.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Wildfire {
    /// Speed of the wind towards the east.
    pub wind_east_m_s: f32,
    /// Speed of the wind towards the north.
    pub wind_north_m_s: f32,
    /// Where it begins.
    pub ignitions: Vec<Ignition>,
}

/// What there is to burn in a cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FuelCell {
    /// Height of the tallest plant or snag, 0 where there is none.
    pub height_m: f32,
    /// Share of the densest fuel there is, 0..=1; a cell of 0 does not burn.
    pub density_fraction: f32,
    /// How readily this vegetation burns, −1..=1 (P_veg).
    pub vegetation: f32,
    /// Water in the fuel, percent of its dry mass.
    pub moisture_percent: f32,
}

/// Fuel and ground of a plot, row-major, row 0 north.
#[derive(Clone, Copy, Debug)]
pub struct FuelMap<'a> {
    /// Rows of cells.
    pub rows: usize,
    /// Columns of cells.
    pub cols: usize,
    /// Side of a cell.
    pub cell_m: f32,
    /// Absolute map column of the first column.
    pub first_east: i64,
    /// Absolute map row of the first row, counted southwards.
    pub first_south: i64,
    /// Elevation of the cells' centres.
    pub elevation_m: &'a [f32],
    /// What there is to burn.
    pub cells: &'a [FuelCell],
}

/// Which cells a fire burns.
///
/// A burning cell tries each neighbour that can burn once, then is burnt. Each cell and direction has one draw a month, so the
/// burnt cells are those that the ignited ones reach over links that pass: whichever cell is visited first.
///
/// Where fire passes with a chance below a quarter it dies out, above 0.3 it burns nearly all; common fuel on flat ground
/// in still air reaches these at 18.5 % and 17 % of moisture.
///
/// # Reference
/// Peytavie et al. 2024, Eq. 12; fuel and moisture are those of the cell that may catch fire.
pub fn burn(fuel: &FuelMap, fire: &Wildfire, seed: u64, year: u16, month: u8) -> Vec<bool> {
    let count = fuel.rows * fuel.cols;
    assert!(
        fuel.elevation_m.len() == count && fuel.cells.len() == count,
        "a fuel map needs an elevation and a fuel for each cell"
    );
    let readiness: Vec<f32> = fuel.cells.iter().map(burning_readiness).collect();
    let wind = NEIGHBOURS.map(|step| wind_factor(fire, step));
    let mut burning = ignited_cells(fuel, fire);
    burning.retain(|&cell| fuel.cells[cell].density_fraction > 0.0);
    let mut burnt = vec![false; count];
    for &cell in &burning {
        burnt[cell] = true;
    }
    while let Some(cell) = burning.pop() {
        let (row, col) = (cell / fuel.cols, cell % fuel.cols);
        let east = fuel.first_east + col as i64; // exact: grids are far smaller than 2⁶³
        let south = fuel.first_south + row as i64;
        let entity = rng::entity_of_cell(east, -south);
        let words = rng::words(Key { seed, process: Process::Wildfire, year, month, entity });
        for (direction, &(row_step, col_step)) in NEIGHBOURS.iter().enumerate() {
            let neighbour = (row.wrapping_add_signed(row_step), col.wrapping_add_signed(col_step));
            if neighbour.0 >= fuel.rows || neighbour.1 >= fuel.cols {
                continue;
            }
            let neighbour = neighbour.0 * fuel.cols + neighbour.1;
            if burnt[neighbour] || readiness[neighbour] <= 0.0 {
                continue;
            }
            let apart_m =
                if row_step != 0 && col_step != 0 { SQRT_2 * fuel.cell_m } else { fuel.cell_m };
            let rise_m = fuel.elevation_m[neighbour] - fuel.elevation_m[cell];
            let probability =
                readiness[neighbour] * wind[direction] * slope_factor(rise_m / apart_m);
            if half_word_draw(words, direction) < probability.min(1.0) {
                burnt[neighbour] = true;
                burning.push(neighbour);
            }
        }
    }
    burnt
}

/// Share of a place that burnt, 0..=1: bilinear between cells' centres, as the nearest centre beyond the outermost.
///
/// # Reference
/// Peytavie et al. 2024, section 5.3.1: F(p).
pub fn damage_fraction(
    burnt: &[bool],
    rows: usize,
    cols: usize,
    cell_m: f32,
    east_m: f32,
    south_m: f32,
) -> f32 {
    assert!(burnt.len() == rows * cols && rows > 0 && cols > 0, "burnt cells fill the grid");
    let between = |distance_m: f32, count: usize| {
        let centre = (distance_m / cell_m - 0.5).clamp(0.0, (count - 1) as f32); // exact below 2²⁴
        let first = centre as usize; // not negative: truncation is floor
        (first, (first + 1).min(count - 1), centre - first as f32)
    };
    let (north, south, down) = between(south_m, rows);
    let (west, east, right) = between(east_m, cols);
    let value = |row: usize, col: usize| if burnt[row * cols + col] { 1.0 } else { 0.0 };
    let above = math::lerp(value(north, west), value(north, east), right);
    let below = math::lerp(value(south, west), value(south, east), right);
    math::lerp(above, below, down)
}

/// Chance that a cell catches fire from a neighbour as high in still air, not clamped; 0 where nothing burns.
///
/// # Reference
/// Peytavie et al. 2024, Eq. 12: P₀ (1 + P_veg) (1 + P_den) P_w P_h; Eq. 13: P_w.
/// # Departures
/// P_h = h^0.932 in metres is 20 at 25 m: any forest would burn whatever its moisture. P₀ was fitted to forest, so fuel of 2 m
/// and above has P_h = 1 and lower fuel (h / 2 m)^0.932. P_den runs straight from sparse to dense, −0.4..=0.3, with density:
/// the −1..=1 printed would keep thin forest from burning at all.
fn burning_readiness(cell: &FuelCell) -> f32 {
    if cell.density_fraction <= 0.0 || cell.height_m <= 0.0 {
        return 0.0;
    }
    let [sparse, dense] = SPARSE_TO_DENSE;
    let density = math::lerp(sparse, dense, cell.density_fraction.min(1.0));
    let moisture =
        DRY_FUEL_FACTOR * math::exp(-MOISTURE_DAMPING_PER_PERCENT * cell.moisture_percent);
    let height = math::powf((cell.height_m / COMMON_FUEL_HEIGHT_M).min(1.0), HEIGHT_EXPONENT);
    COMMON_FUEL_PROBABILITY * (1.0 + cell.vegetation) * (1.0 + density) * moisture * height
}

/// How many times likelier fire passes up a slope than over flat ground; below 1 downhill.
///
/// # Reference
/// Peytavie et al. 2024, Eq. 13: e^(a m), with m in degrees.
fn slope_factor(rise_per_m: f32) -> f32 {
    math::exp(SLOPE_GAIN_PER_DEGREE * math::atan(rise_per_m) * (45.0 / FRAC_PI_4))
}

/// How many times likelier fire passes to a neighbour than in still air.
///
/// # Reference
/// Peytavie et al. 2024, Eq. 13: e^(V (c₁ + c₂ (cos θ − 1))), θ between the wind and the way of the fire.
fn wind_factor(fire: &Wildfire, (row_step, col_step): (isize, isize)) -> f32 {
    let (east, north) = (col_step as f32, -row_step as f32); // −1, 0 or 1
    let (wind_east, wind_north) = (fire.wind_east_m_s, fire.wind_north_m_s);
    let speed_m_s = (wind_east * wind_east + wind_north * wind_north).sqrt();
    let along_m_s = (wind_east * east + wind_north * north) / (east * east + north * north).sqrt();
    math::exp(WIND_GAIN_S_M * speed_m_s + CROSSWIND_GAIN_S_M * (along_m_s - speed_m_s))
}

/// Cells where a fire begins, whether or not they can burn.
fn ignited_cells(fuel: &FuelMap, fire: &Wildfire) -> Vec<usize> {
    let mut ignited = Vec::new();
    for ignition in &fire.ignitions {
        // in cells, between centres; grids are far smaller than 2²⁴ cells wide
        let middle_col = ignition.east_fraction * fuel.cols as f32 - 0.5;
        let middle_row = (1.0 - ignition.north_fraction) * fuel.rows as f32 - 0.5;
        let radius = ignition.radius_m / fuel.cell_m;
        for row in 0..fuel.rows {
            for col in 0..fuel.cols {
                let [down, right] = [row as f32 - middle_row, col as f32 - middle_col];
                let is_place = down.abs().max(right.abs()) <= 0.5;
                if is_place || down * down + right * right <= radius * radius {
                    ignited.push(row * fuel.cols + col);
                }
            }
        }
    }
    ignited
}

/// One of eight draws in 0..1 that four words hold, 16 bits each.
fn half_word_draw(words: [u32; 4], direction: usize) -> f32 {
    let half = words[direction / 2] >> (16 * (direction % 2)) & 0xffff;
    half as f32 / 65_536.0 // exact in f32
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIDE: usize = 121;
    const COMMON: FuelCell = FuelCell {
        height_m: 20.0,
        density_fraction: 4.0 / 7.0, // P_den = 0
        vegetation: 0.0,
        moisture_percent: 0.0,
    };

    fn moisture_for(probability: f32) -> f32 {
        math::ln(COMMON_FUEL_PROBABILITY * DRY_FUEL_FACTOR / probability)
            / MOISTURE_DAMPING_PER_PERCENT
    }

    fn fire(wind_east_m_s: f32, radius_m: f32) -> Wildfire {
        let ignition = Ignition { east_fraction: 0.5, north_fraction: 0.5, radius_m };
        Wildfire { wind_east_m_s, wind_north_m_s: 0.0, ignitions: vec![ignition] }
    }

    fn burnt_at(moisture_percent: f32, fire: &Wildfire, rise_m: f32, seed: u64) -> Vec<bool> {
        let cells = vec![FuelCell { moisture_percent, ..COMMON }; SIDE * SIDE];
        let elevation_m: Vec<f32> =
            (0..SIDE * SIDE).map(|cell| (cell % SIDE) as f32 * rise_m).collect();
        let fuel = FuelMap {
            rows: SIDE,
            cols: SIDE,
            cell_m: 10.0,
            first_east: -60,
            first_south: 7,
            elevation_m: &elevation_m,
            cells: &cells,
        };
        burn(&fuel, fire, seed, 12, 8)
    }

    fn share(burnt: &[bool]) -> f32 {
        burnt.iter().filter(|&&cell| cell).count() as f32 / burnt.len() as f32
    }

    fn mean_share(moisture_percent: f32) -> f32 {
        let runs = 0..12;
        runs.map(|seed| share(&burnt_at(moisture_percent, &fire(0.0, 50.0), 0.0, seed)))
            .sum::<f32>()
            / 12.0
    }

    #[test]
    fn dry_fuel_burns_all_and_wet_fuel_where_it_was_lit() {
        assert_eq!(share(&burnt_at(0.0, &fire(0.0, 0.0), 0.0, 1)), 1.0);
        assert_eq!(
            burnt_at(100.0, &fire(0.0, 0.0), 0.0, 1).iter().filter(|&&cell| cell).count(),
            1
        );
        // 81 centres within five cells of one
        let lit = burnt_at(100.0, &fire(0.0, 50.0), 0.0, 1);
        assert_eq!(lit.iter().filter(|&&cell| cell).count(), 81);
    }

    #[test]
    fn bare_ground_stops_fire() {
        let mut cells = vec![COMMON; 9 * 9];
        for row in 0..9 {
            cells[row * 9 + 6].density_fraction = 0.0;
        }
        let elevation_m = vec![0.0; 81];
        let fuel = FuelMap {
            rows: 9,
            cols: 9,
            cell_m: 10.0,
            first_east: 0,
            first_south: 0,
            elevation_m: &elevation_m,
            cells: &cells,
        };
        let burnt = burn(&fuel, &fire(0.0, 0.0), 1, 1, 1);
        assert!((0..81).all(|cell| burnt[cell] == (cell % 9 < 6)));
    }

    #[test]
    fn fire_dies_out_below_a_chance_of_a_quarter() {
        // bonds between a cell and its eight neighbours percolate at 0.2504
        assert!(mean_share(moisture_for(0.22)) < 0.1);
        assert!(mean_share(moisture_for(0.30)) > 0.8);
    }

    #[test]
    fn moisture_lowers_what_burns() {
        let shares: Vec<f32> = (0..9).map(|step| mean_share(12.0 + step as f32)).collect();
        assert!(shares.windows(2).all(|pair| pair[1] < pair[0]), "{shares:?}");
    }

    #[test]
    fn wind_draws_fire_out_downwind() {
        let burnt = burnt_at(moisture_for(0.35), &fire(8.0, 20.0), 0.0, 5);
        let cells = || (0..SIDE * SIDE).filter(|&cell| burnt[cell]);
        let middle = (SIDE / 2) as isize;
        let east = cells().map(|cell| (cell % SIDE) as isize - middle).max().unwrap();
        let west = cells().map(|cell| middle - (cell % SIDE) as isize).max().unwrap();
        let south = cells().map(|cell| (cell / SIDE) as isize - middle).max().unwrap();
        assert!(east >= 3 * west && east > south, "{east} {west} {south}");
    }

    #[test]
    fn fire_climbs() {
        let burnt = burnt_at(moisture_for(0.25), &fire(0.0, 50.0), 3.0, 5);
        let count = |uphill: bool| {
            let is_uphill = |cell: &usize| (cell % SIDE > SIDE / 2) == uphill;
            (0..SIDE * SIDE).filter(|&cell| burnt[cell]).filter(is_uphill).count()
        };
        assert!(count(true) > 3 * count(false), "{} {}", count(true), count(false));
    }

    #[test]
    fn factors_have_their_closed_forms() {
        assert!((burning_readiness(&COMMON) - 0.6 * 3.258).abs() < 1e-5);
        let at_10 = FuelCell { moisture_percent: 10.0, ..COMMON };
        assert!((burning_readiness(&at_10) - 0.6 * 3.258 * 0.329_559).abs() < 1e-5);
        assert!((slope_factor(1.0) - math::exp(0.063 * 45.0)).abs() < 1e-3);
        assert!((slope_factor(-1.0) * slope_factor(1.0) - 1.0).abs() < 1e-5);
        assert!((wind_factor(&fire(10.0, 0.0), (0, 1)) - math::exp(0.45)).abs() < 1e-5);
        assert!((wind_factor(&fire(10.0, 0.0), (1, 0)) - math::exp(-0.86)).abs() < 1e-5);
        assert_eq!(wind_factor(&fire(0.0, 0.0), (1, 1)), 1.0);
    }

    #[test]
    fn height_counts_below_two_metres_only() {
        let at = |height_m| burning_readiness(&FuelCell { height_m, ..COMMON });
        // the printed h^0.932 would give a ratio of 8.6
        assert_eq!(at(20.0), at(2.0));
        assert!((at(1.0) / at(2.0) - 0.524).abs() < 1e-3);
        assert_eq!(at(0.0), 0.0);
    }

    #[test]
    fn a_fire_burns_the_same_cells_again() {
        let run = |seed| burnt_at(moisture_for(0.28), &fire(3.0, 30.0), 0.5, seed);
        assert_eq!(run(4), run(4));
        assert_ne!(run(4), run(5));
    }

    #[test]
    fn damage_runs_straight_between_centres() {
        let burnt = [true, false, true, true];
        let at = |east_m, south_m| damage_fraction(&burnt, 2, 2, 10.0, east_m, south_m);
        assert_eq!([at(5.0, 5.0), at(15.0, 5.0), at(15.0, 15.0)], [1.0, 0.0, 1.0]);
        assert_eq!([at(10.0, 5.0), at(10.0, 10.0), at(15.0, 7.5)], [0.5, 0.75, 0.25]);
        assert_eq!([at(-3.0, -3.0), at(20.0, 0.0)], [1.0, 0.0]);
    }
}
