//! Shading: what the crowns of all plants over a cell take of its light.
//!
//! Crowns are disks. A crown counts for the share of the cell that it covers, so that a million herbs narrower than a cell
//! shade as their areas do. Rows are worked on in bands; in each cell crowns come in the order of the plants, so bands and
//! threads do not show.

use rayon::prelude::*;

use crate::plants::Plants;
use crate::raster::Frame;
use crate::species::Biome;

/// Rows of a band. chosen: at 1,000–4,000 columns its two maps fit a core's second cache, and few crowns reach over two.
const BAND_ROWS: usize = 32;

/// Gauss–Legendre nodes on 0..1: lines across a row along which a crown's chord is measured. chosen: four err by less than
/// 0.7 % of a crown's area.
const NODES: [f32; 4] = [0.069_431_84, 0.330_009_5, 0.669_990_5, 0.930_568_2];
/// Their weights.
const WEIGHTS: [f32; 4] = [0.173_927_42, 0.326_072_58, 0.326_072_58, 0.173_927_42];

/// What all crowns over each cell do to its light, row-major.
#[derive(Clone, Debug, PartialEq)]
pub struct GroundShade {
    /// Share of the light that reaches the ground, mean over the cell: Π(1 − α·s) over crowns of absorption α, each over
    /// a share s of the cell. It is the mean for crowns that lie in the cell independently of each other.
    pub light_fraction: Vec<f32>,
    /// Cumulative alpha, mean over the cell: Σ α·s.
    pub cumulative_absorption: Vec<f32>,
}

/// A crown from above, in cells from the grid's north-west corner.
#[derive(Clone, Copy)]
struct Crown {
    east: f32,
    south: f32,
    radius: f32,
    absorbed_light_fraction: f32,
}

/// Shade of all plants on the ground.
///
/// # Reference
/// Kapp et al. 2020, section 6.3: incident alpha.
/// # Departures
/// The paper tells nothing of crowns narrower than a cell (and its program leaves them out): here they count by area.
///
/// # Panics
/// If a plant has no place, no radius, or a species the biome does not have.
pub fn ground_shade(frame: &Frame, plants: &Plants, biome: &Biome) -> GroundShade {
    let (rows, cols) = (frame.rows, frame.cols);
    let bands = crowns_by_band(frame, plants, biome);
    let mut light_fraction = vec![1.0_f32; rows * cols];
    let mut cumulative_absorption = vec![0.0_f32; rows * cols];
    let band_cells = (BAND_ROWS * cols).max(1);
    light_fraction
        .par_chunks_mut(band_cells)
        .zip(cumulative_absorption.par_chunks_mut(band_cells))
        .enumerate()
        .for_each(|(band, (light, absorption))| {
            let first_row = band * BAND_ROWS;
            for crown in &bands.crowns[bands.starts[band]..bands.starts[band + 1]] {
                for row in rows_of(crown, first_row, (first_row + BAND_ROWS).min(rows)) {
                    let cells = (row - first_row) * cols..(row - first_row + 1) * cols;
                    shade_row(crown, row, &mut light[cells.clone()], &mut absorption[cells]);
                }
            }
        });
    GroundShade { light_fraction, cumulative_absorption }
}

/// Crowns band after band, in each in the order of the plants; a crown that reaches over bands stands in each.
struct Bands {
    crowns: Vec<Crown>,
    /// Where each band's crowns start, and the end.
    starts: Vec<usize>,
}

fn crowns_by_band(frame: &Frame, plants: &Plants, biome: &Biome) -> Bands {
    let absorbed: Vec<f32> = biome.species.iter().map(|s| s.absorbed_light_fraction).collect();
    let (rows, cell_m) = (frame.rows, frame.transform.cell_m);
    let crown = |plant: usize| {
        let place_m = [plants.east_m[plant], plants.north_m[plant], plants.crown_radius_m[plant]];
        assert!(
            place_m.iter().all(|m| m.is_finite()),
            "plant {}: place and radius are {place_m:?}",
            plants.id[plant]
        );
        let [east, north, radius] = place_m.map(|m| f64::from(m) / cell_m);
        Crown {
            // thousands of cells: f32 leaves a thousandth of one
            east: east as f32,
            south: (rows as f64 - north) as f32,
            radius: radius as f32,
            absorbed_light_fraction: absorbed[usize::from(plants.species[plant])],
        }
    };
    let bands_of = |crown: &Crown| {
        let rows = rows_of(crown, 0, rows);
        // none for crowns beside the map
        if rows.is_empty() { 0..0 } else { rows.start / BAND_ROWS..(rows.end - 1) / BAND_ROWS + 1 }
    };
    let all: Vec<Crown> = (0..plants.len()).into_par_iter().map(crown).collect();
    let mut starts = vec![0_usize; rows.div_ceil(BAND_ROWS) + 1];
    for crown in &all {
        for band in bands_of(crown) {
            starts[band + 1] += 1;
        }
    }
    for band in 1..starts.len() {
        starts[band] += starts[band - 1];
    }
    let nobody = Crown { east: 0.0, south: 0.0, radius: 0.0, absorbed_light_fraction: 0.0 };
    let mut crowns = vec![nobody; starts.last().copied().unwrap_or(0)];
    let mut next = starts.clone();
    for crown in all {
        for band in bands_of(&crown) {
            crowns[next[band]] = crown;
            next[band] += 1;
        }
    }
    Bands { crowns, starts }
}

/// Those of the rows `first..end` that a crown reaches into.
#[inline]
fn rows_of(crown: &Crown, first: usize, end: usize) -> std::ops::Range<usize> {
    // `as` cuts negatives to 0
    let from = ((crown.south - crown.radius) as usize).clamp(first, end);
    let to = ((crown.south + crown.radius).ceil() as usize).clamp(from, end);
    from..to
}

/// Enters a crown into one row of both maps.
#[inline]
fn shade_row(crown: &Crown, row: usize, light: &mut [f32], absorption: &mut [f32]) {
    let cols = absorption.len();
    let mut enter = |col: usize, share: f32| {
        let taken = crown.absorbed_light_fraction * share;
        light[col] *= 1.0 - taken;
        absorption[col] += taken;
    };
    let (top, left) = (row as f32, crown.east - crown.radius);
    let (from, to) =
        ((crown.south - crown.radius).max(top), (crown.south + crown.radius).min(top + 1.0));
    let depth = to - from;
    if depth <= 0.0 || crown.east + crown.radius <= 0.0 {
        return;
    }

    // A crown within one cell
    let square = crown.radius * crown.radius;
    let within_row = from > top && to < top + 1.0;
    if within_row && left >= 0.0 && left.floor() == (crown.east + crown.radius).floor() {
        let col = left as usize;
        if col < cols {
            enter(col, std::f32::consts::PI * square);
        }
        return;
    }

    // Chords along four lines across the row
    let mut chords = [[0.0_f32; 2]; 4];
    for (chord, node) in chords.iter_mut().zip(NODES) {
        let away = from + depth * node - crown.south;
        let half = (square - away * away).max(0.0).sqrt();
        *chord = [crown.east - half, crown.east + half];
    }
    let lowest = |side: usize| chords.iter().fold(f32::INFINITY, |m, chord| m.min(chord[side]));
    let highest = |side: usize| chords.iter().fold(-f32::INFINITY, |m, chord| m.max(chord[side]));
    // `as` cuts negatives to 0
    let first = (lowest(0) as usize).min(cols);
    let end = (highest(1).ceil() as usize).clamp(first, cols);
    let inner_first = (highest(0).ceil() as usize).clamp(first, end);
    let inner_end = (lowest(1) as usize).clamp(inner_first, end);
    let mut rim = |col: usize| {
        let (west, east) = (col as f32, (col + 1) as f32);
        let mut share = 0.0;
        for (chord, weight) in chords.iter().zip(WEIGHTS) {
            share += weight * (chord[1].min(east) - chord[0].max(west)).max(0.0);
        }
        enter(col, (share * depth).min(1.0));
    };
    (first..inner_first).for_each(&mut rim);
    (inner_end..end).for_each(&mut rim);
    (inner_first..inner_end).for_each(|col| enter(col, depth));
}

/// Plants that tests strew.
#[cfg(test)]
pub(super) mod strewn_plants {
    use crate::plants::{Layer, Plants};
    use crate::rng::{Key, Process, uniforms};

    /// Plants of one species at places and radii in metres.
    pub fn plants_at(species: u16, places_m: &[[f32; 3]]) -> Plants {
        let count = places_m.len();
        Plants {
            id: (0..count as u64).collect(),
            species: vec![species; count],
            layer: vec![Layer::Canopy; count],
            east_m: places_m.iter().map(|p| p[0]).collect(),
            north_m: places_m.iter().map(|p| p[1]).collect(),
            z_m: vec![0.0; count],
            height_m: vec![5.0; count],
            crown_radius_m: places_m.iter().map(|p| p[2]).collect(),
            dbh_m: vec![0.1; count],
            age_years: vec![10.0; count],
            vigor: vec![1.0; count],
        }
    }

    /// Plants strewn over a square, most of them narrower than a metre.
    pub fn strewn(count: u64, side_m: f32, species: u16, radius_m: impl Fn(f32) -> f32) -> Plants {
        let place = |entity| {
            let key =
                Key { seed: 1, process: Process::StrewnPoints, year: species, month: 0, entity };
            let [east, north, size, _] = uniforms(key);
            [east * side_m, north * side_m, radius_m(size)]
        };
        plants_at(species, &(0..count).map(place).collect::<Vec<_>>())
    }

    /// 70,000 trees and 500,000 small plants on 1 km².
    pub fn trees_and_herbs() -> Plants {
        let mut plants = strewn(70_000, 1000.0, 9, |size| 2.0 + 3.0 * size);
        let herbs = strewn(500_000, 1000.0, 0, |size| 0.1 + 0.9 * size * size);
        plants.id.extend(herbs.id.iter().map(|id| id + 70_000));
        plants.species.extend(herbs.species);
        plants.east_m.extend(herbs.east_m);
        plants.north_m.extend(herbs.north_m);
        plants.crown_radius_m.extend(herbs.crown_radius_m);
        plants
    }
}

#[cfg(test)]
mod tests {
    use super::strewn_plants::{plants_at, strewn, trees_and_herbs};
    use super::*;
    use crate::raster::Cell;

    fn sonoma() -> Biome {
        Biome::builtin("sonoma").unwrap()
    }

    #[test]
    fn a_crown_covers_the_area_of_its_disk_wherever_it_lies() {
        let biome = sonoma();
        let alpha = biome.species[0].absorbed_light_fraction;
        let frame = Frame::local(40, 50, 1.0);
        for (east, north, radius) in [
            (20.5, 20.5, 0.05),
            (20.0, 20.0, 0.05),
            (20.3, 20.9, 0.4),
            (20.99, 20.01, 0.8),
            (17.3, 22.7, 1.7),
            (21.6, 18.2, 7.3),
        ] {
            let shade = ground_shade(&frame, &plants_at(0, &[[east, north, radius]]), &biome);
            let sum: f32 = shade.cumulative_absorption.iter().sum();
            let area = std::f32::consts::PI * radius * radius;
            assert!((sum / alpha / area - 1.0).abs() < 0.007, "{radius}: {sum} {area}");
        }
    }

    #[test]
    fn shares_of_cells_are_those_of_many_samples() {
        let biome = sonoma();
        let alpha = biome.species[0].absorbed_light_fraction;
        let frame = Frame::local(16, 16, 2.0);
        for place in [[15.1, 16.3, 0.9], [13.7, 17.7, 3.1], [16.2, 15.9, 8.45], [0.3, 31.5, 4.0]] {
            let shade = ground_shade(&frame, &plants_at(0, &[place]), &biome);
            for (index, absorbed) in shade.cumulative_absorption.iter().enumerate() {
                let Cell { row, col } = frame.cell(index);
                let covered = (0..10_000).filter(|sample| {
                    let (x, y) = ((sample % 100) as f32 + 0.5, (sample / 100) as f32 + 0.5);
                    let east = (col as f32 + x / 100.0) * 2.0 - place[0];
                    let north = (16.0 - row as f32 - y / 100.0) * 2.0 - place[1];
                    east * east + north * north < place[2] * place[2]
                });
                let expected = covered.count() as f32 / 10_000.0;
                let share = absorbed / alpha;
                assert!((share - expected).abs() < 0.02, "{place:?} {index}: {share} {expected}");
            }
        }
    }

    #[test]
    fn light_multiplies_and_alpha_adds_up() {
        let biome = sonoma();
        let alpha = biome.species[9].absorbed_light_fraction;
        let frame = Frame::local(20, 20, 1.0);
        let shade =
            ground_shade(&frame, &plants_at(9, &[[10.5, 10.5, 6.0], [11.5, 10.5, 6.0]]), &biome);
        let at = frame.index(Cell { row: 9, col: 10 });
        assert!((shade.light_fraction[at] - (1.0 - alpha) * (1.0 - alpha)).abs() < 1e-6);
        assert!((shade.cumulative_absorption[at] - 2.0 * alpha).abs() < 1e-6);
        assert_eq!(shade.light_fraction[0], 1.0);
        assert_eq!(shade.cumulative_absorption[0], 0.0);
    }

    #[test]
    fn many_small_plants_let_through_what_their_area_does() {
        // 20,000 herbs of 10 cm on 100 × 100 m: Σs = 0.0628; independent places leave e^(−α·Σs) to first order
        let biome = sonoma();
        let alpha = biome.species[0].absorbed_light_fraction;
        let frame = Frame::local(100, 100, 1.0);
        let shade = ground_shade(&frame, &strewn(20_000, 100.0, 0, |_| 0.1), &biome);
        let mean = shade.light_fraction.iter().sum::<f32>() / 1e4;
        let expected = 1.0 - alpha * 2.0 * std::f32::consts::PI * 0.01;
        assert!((mean - expected).abs() < 0.002, "{mean} {expected}");
    }

    #[test]
    fn crowns_at_the_edge_and_beyond_do_no_harm() {
        let biome = sonoma();
        let frame = Frame::local(10, 10, 1.0);
        let places = [[0.0, 0.0, 1.0], [10.0, 10.0, 0.2], [-5.0, 3.0, 2.0], [4.0, 30.0, 6.0]];
        let shade = ground_shade(&frame, &plants_at(0, &places), &biome);
        let shaded = shade.light_fraction.iter().filter(|light| **light < 1.0).count();
        assert_eq!(shaded, 2);
        let nothing = ground_shade(&frame, &plants_at(0, &[[4.0, 4.0, 0.0]]), &biome);
        assert!(nothing.light_fraction.iter().all(|light| *light == 1.0));
    }

    #[test]
    fn any_number_of_threads_gives_the_same_bits() {
        let biome = sonoma();
        let frame = Frame::local(210, 190, 1.0);
        let plants = strewn(30_000, 200.0, 3, |size| 0.1 + 5.0 * size * size * size);
        let with = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| ground_shade(&frame, &plants, &biome))
        };
        assert_eq!(with(1), with(3));
    }

    #[test]
    #[ignore = "a measurement: run by name with --release and --nocapture"]
    fn seconds_of_a_square_kilometre() {
        let biome = sonoma();
        let frame = Frame::local(1000, 1000, 1.0);
        let plants = trees_and_herbs();
        for _ in 0..5 {
            let started = std::time::Instant::now();
            let bands = crowns_by_band(&frame, &plants, &biome);
            let sorted_s = started.elapsed().as_secs_f64();
            let shade = ground_shade(&frame, &plants, &biome);
            let seconds = started.elapsed().as_secs_f64() - sorted_s;
            let light = shade.light_fraction.iter().sum::<f32>() / 1e6;
            println!(
                "{seconds:.3} s, of which {sorted_s:.3} s in bands of {}; light {light:.3}",
                bands.crowns.len()
            );
        }
    }
}
