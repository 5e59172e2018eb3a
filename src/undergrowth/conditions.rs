//! Conditions of the undergrowth: what the canopy leaves of a site, and the seeds that it sheds.

use rayon::prelude::*;

use crate::canopy::site::Site;
use crate::plants::{Layer, Plants};
use crate::simulation::seedbank::{self, Seeds};
use crate::simulation::{Parameters, disk_span};
use crate::species::Biome;

/// Light under crowns is worked out on cells no wider than this, m. chosen: a third of a sapling's crown.
const LIGHT_CELL_M: f32 = 1.0;
/// Seeds lie on cells at least this wide, m. chosen: their chance falls to 0 over some dozens of metres.
const SEED_CELL_M: f32 = 4.0;

/// Number of factors that clusters are told apart by.
pub const DIMENSIONS: usize = 5;

/// What undergrowth depends on, as yearly means under the canopy: light h a day, moisture mm, temperature °C, slope rad; and the
/// chance a year that a seed sprouts in a simulation cell.
///
/// # Departures
/// Kapp et al. 2020, section 6.2, cluster by the light above the canopy and by nothing but abiotic conditions. A clearing and the
/// wood around it then share one cluster and one density, and gaps cannot be told from shade; so the light here is what the
/// crowns let through. And where seeds are many herbs outnumber shrubs, so their chance counts too.
pub type Factors = [f32; DIMENSIONS];

/// Most moisture that tells places apart, mm: above it everything is a swamp (PAPER_NOTES §8).
pub const MOST_MOISTURE_MM: f32 = 250.0;

/// What grows where, cell by cell of a scene.
pub struct Conditions<'a> {
    site: &'a Site,
    /// Share of the light that the canopy lets through.
    light_fraction: Vec<f32>,
    /// Height that undergrowth stays below, m.
    limit_m: Vec<f32>,
    seeds: SeedMap,
}

impl<'a> Conditions<'a> {
    /// Conditions under a scene's canopy trees; other plants do not count.
    pub fn under(canopy: &Plants, site: &'a Site, biome: &Biome, parameters: &Parameters) -> Self {
        let crowns = Crowns::of(canopy, site, biome);
        let (light_fraction, limit_m) = shade(&crowns, site, biome, parameters.open_limit_m);
        Self {
            light_fraction,
            limit_m,
            seeds: SeedMap::new(&crowns, site, biome, parameters),
            site,
        }
    }

    /// What undergrowth of a cell depends on; `seeds` are those of [`Conditions::seeds`].
    #[inline]
    pub fn factors(&self, cell: usize, seeds: Seeds) -> Factors {
        [
            self.site.sun_h.values()[cell] * self.light_fraction[cell],
            self.site.moisture_mm.values()[cell].min(MOST_MOISTURE_MM),
            self.site.temperature_c.values()[cell],
            self.site.slope_rad.values()[cell],
            seeds.chance_per_year,
        ]
    }

    /// Seeds of a cell, at its middle.
    pub fn seeds(&self, cell: usize) -> Seeds {
        let frame = self.site.slope_rad.frame();
        let (row, col) = (cell / frame.cols, cell % frame.cols);
        self.seeds.at((col as f32 + 0.5) * frame.cell_m(), (row as f32 + 0.5) * frame.cell_m())
    }

    /// The site.
    pub fn site(&self) -> &'a Site {
        self.site
    }

    /// Height that undergrowth of a cell stays below, m: the lowest canopy above it, or what would be canopy in the open.
    pub fn limit_m(&self, cell: usize) -> f32 {
        self.limit_m[cell]
    }

    /// Share of the light that the canopy lets through to a cell.
    pub fn light_fraction(&self, cell: usize) -> f32 {
        self.light_fraction[cell]
    }
}

/// Canopy trees from above, from north to south, in metres from the scene's north-west corner.
struct Crowns {
    species: Vec<u16>,
    east_m: Vec<f32>,
    south_m: Vec<f32>,
    radius_m: Vec<f32>,
    base_m: Vec<f32>,
    widest_m: f32,
}

impl Crowns {
    fn of(plants: &Plants, site: &Site, biome: &Biome) -> Self {
        let frame = site.slope_rad.frame();
        let height_m = frame.rows as f32 * frame.cell_m();
        let mut trees: Vec<usize> =
            (0..plants.len()).filter(|index| plants.layer[*index] == Layer::Canopy).collect();
        trees.sort_by(|a, b| plants.north_m[*b].total_cmp(&plants.north_m[*a]).then(a.cmp(b)));
        let of = |measure: &[f32]| trees.iter().map(|tree| measure[*tree]).collect::<Vec<f32>>();
        let radius_m = of(&plants.crown_radius_m);
        let base_m = |tree: &usize| {
            let species = &biome.species[usize::from(plants.species[*tree])];
            species.crown_base_m(plants.height_m[*tree], 1.0)
        };
        Self {
            base_m: trees.iter().map(base_m).collect(),
            species: trees.iter().map(|tree| plants.species[*tree]).collect(),
            east_m: of(&plants.east_m),
            south_m: trees.iter().map(|tree| height_m - plants.north_m[*tree]).collect(),
            widest_m: radius_m.iter().copied().fold(0.0, f32::max),
            radius_m,
        }
    }

    /// Trees that reach as far as `radii` crown radii into the strip between two lines.
    fn reaching(&self, north_m: f32, south_m: f32, radii: f32) -> impl Iterator<Item = usize> + '_ {
        let most_m = self.widest_m * radii;
        let first = self.south_m.partition_point(|at_m| *at_m < north_m - most_m);
        let end = self.south_m.partition_point(|at_m| *at_m <= south_m + most_m);
        (first..end).filter(move |tree| {
            let reach_m = self.radius_m[*tree] * radii;
            self.south_m[*tree] > north_m - reach_m && self.south_m[*tree] < south_m + reach_m
        })
    }
}

/// Share of the light that crowns let through, mean over each of the site's cells; and the height of the lowest crown above each,
/// or `open_limit_m` where a part of it lies under none.
fn shade(crowns: &Crowns, site: &Site, biome: &Biome, open_limit_m: f32) -> (Vec<f32>, Vec<f32>) {
    let frame = site.slope_rad.frame();
    let parts = (frame.cell_m() / LIGHT_CELL_M).ceil().max(1.0) as usize;
    let (cell_m, cols) = (frame.cell_m() / parts as f32, frame.cols * parts);
    let (mut fractions, mut limits_m) = (vec![1.0; frame.len()], vec![open_limit_m; frame.len()]);
    let rows = fractions.par_chunks_mut(frame.cols.max(1));
    rows.zip(limits_m.par_chunks_mut(frame.cols.max(1))).enumerate().for_each(
        |(row, (fractions, limits_m))| {
            let (mut light, mut base_m) =
                (vec![1.0_f32; parts * cols], vec![f32::INFINITY; parts * cols]);
            let (north_m, south_m) =
                (row as f32 * frame.cell_m(), (row + 1) as f32 * frame.cell_m());
            for tree in crowns.reaching(north_m, south_m, 1.0) {
                let species = &biome.species[usize::from(crowns.species[tree])];
                let keep = 1.0 - species.absorbed_light_fraction;
                for part in 0..parts {
                    let line_m = north_m + (part as f32 + 0.5) * cell_m;
                    let from_m = line_m - crowns.south_m[tree];
                    let half_m = crowns.radius_m[tree].powi(2) - from_m * from_m;
                    if half_m > 0.0 {
                        let covered = disk_span(crowns.east_m[tree], half_m.sqrt(), cols, cell_m);
                        for at in covered {
                            light[part * cols + at] *= keep;
                            let base_m = &mut base_m[part * cols + at];
                            *base_m = base_m.min(crowns.base_m[tree]);
                        }
                    }
                }
            }
            for col in 0..frame.cols {
                let (mut sum, mut lowest_m) = (0.0, f32::INFINITY);
                for part in 0..parts {
                    for at in part * cols + col * parts..part * cols + (col + 1) * parts {
                        sum += light[at];
                        let is_open = base_m[at] == f32::INFINITY;
                        lowest_m = lowest_m.min(if is_open { open_limit_m } else { base_m[at] });
                    }
                }
                fractions[col] = sum / (parts * parts) as f32;
                limits_m[col] = lowest_m;
            }
        },
    );
    (fractions, limits_m)
}

/// Seeds on a coarse grid.
struct SeedMap {
    cell_m: f32,
    rows: usize,
    cols: usize,
    seeds: Vec<Seeds>,
}

impl SeedMap {
    fn new(crowns: &Crowns, site: &Site, biome: &Biome, parameters: &Parameters) -> Self {
        let frame = site.slope_rad.frame();
        let cell_m = frame.cell_m().max(SEED_CELL_M);
        let cells = |count: usize| ((count as f32 * frame.cell_m()) / cell_m).ceil() as usize + 1;
        let (rows, cols) = (cells(frame.rows), cells(frame.cols));
        let mut seeds = vec![Seeds::default(); rows * cols];
        let reach = parameters.seed_reach_radii;
        // values are at the grid's nodes
        seeds.par_chunks_mut(cols).enumerate().for_each(|(row, seeds)| {
            let line_m = row as f32 * cell_m;
            for tree in crowns.reaching(line_m, line_m, reach) {
                let species = &biome.species[usize::from(crowns.species[tree])];
                let Some(sub_biome) = species.canopy_sub_biome else { continue };
                let (radius_m, from_m) = (crowns.radius_m[tree], line_m - crowns.south_m[tree]);
                let half_m = ((reach * radius_m).powi(2) - from_m * from_m).max(0.0).sqrt();
                // `as` cuts negatives to 0
                let first = ((crowns.east_m[tree] - half_m) / cell_m).ceil().max(0.0) as usize;
                let end = ((crowns.east_m[tree] + half_m) / cell_m).floor() + 1.0;
                let end = (end.max(0.0) as usize).min(cols);
                for (col, seeds) in seeds.iter_mut().enumerate().take(end).skip(first) {
                    let east_m = col as f32 * cell_m - crowns.east_m[tree];
                    let away_m = (east_m * east_m + from_m * from_m).sqrt();
                    let chance = seedbank::chance_per_year(away_m / radius_m, parameters);
                    seeds.chance_per_year =
                        (seeds.chance_per_year + chance).min(parameters.most_seed_chance_per_year);
                    seeds.sub_biomes |= 1 << sub_biome;
                }
            }
        });
        Self { cell_m, rows, cols, seeds }
    }

    /// The chance between the four nodes around, and what any of them has.
    fn at(&self, east_m: f32, south_m: f32) -> Seeds {
        let place = |at_m: f32, count: usize| {
            let at = at_m / self.cell_m;
            let first = (at as usize).min(count.saturating_sub(2));
            (first, (first + 1).min(count - 1), (at - first as f32).clamp(0.0, 1.0))
        };
        let (upper, lower, down) = place(south_m, self.rows);
        let (left, right, along) = place(east_m, self.cols);
        let [a, b, c, d] = [(upper, left), (upper, right), (lower, left), (lower, right)]
            .map(|(row, col)| self.seeds[row * self.cols + col]);
        let across = |a: Seeds, b: Seeds| {
            a.chance_per_year + (b.chance_per_year - a.chance_per_year) * along
        };
        let (north, south) = (across(a, b), across(c, d));
        Seeds {
            chance_per_year: north + (south - north) * down,
            sub_biomes: a.sub_biomes | b.sub_biomes | c.sub_biomes | d.sub_biomes,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::raster::Grid;

    fn site(cell_m: f64) -> Site {
        let cells = (80.0 / cell_m) as usize;
        let of = |value: f32| Grid::from_fn(cells, cells, cell_m, |_| value);
        Site { sun_h: of(8.0), moisture_mm: of(300.0), temperature_c: of(12.0), slope_rad: of(0.1) }
    }

    fn one_tree(biome: &Biome) -> (Plants, f32) {
        let species = biome.sub_biomes[0].canopy[0];
        let tree = Plants {
            id: vec![1],
            species: vec![species as u16],
            layer: vec![Layer::Canopy],
            east_m: vec![40.0],
            north_m: vec![40.0],
            z_m: vec![0.0],
            height_m: vec![15.0],
            crown_radius_m: vec![3.0],
            dbh_m: vec![0.2],
            age_years: vec![40.0],
            vigor: vec![1.0],
        };
        (tree, 1.0 - biome.species[species].absorbed_light_fraction)
    }

    #[test]
    fn crowns_dim_the_light_by_the_share_that_they_cover() {
        let biome = Biome::builtin("sonoma").unwrap();
        let (tree, keep) = one_tree(&biome);
        for cell_m in [1.0, 4.0] {
            let site = site(cell_m);
            let conditions = Conditions::under(&tree, &site, &biome, &Parameters::kapp2020());
            let cells = (80.0 / cell_m) as usize;
            let taken_m2: f64 = (0..cells * cells)
                .map(|cell| f64::from(1.0 - conditions.light_fraction(cell)) * cell_m * cell_m)
                .sum();
            let expected_m2 = f64::from(1.0 - keep) * 9.0 * std::f64::consts::PI;
            assert!((taken_m2 / expected_m2 - 1.0).abs() < 0.15, "{taken_m2} {expected_m2}");
            let [sun_h, moisture_mm, ..] = conditions.factors(0, conditions.seeds(0));
            assert_eq!((sun_h, moisture_mm), (8.0, MOST_MOISTURE_MM));
        }
    }

    #[test]
    fn seeds_between_the_nodes_are_near_those_of_the_kernel() {
        let biome = Biome::builtin("sonoma").unwrap();
        let (tree, _) = one_tree(&biome);
        let (site, parameters) = (site(1.0), Parameters::kapp2020());
        let conditions = Conditions::under(&tree, &site, &biome, &parameters);
        for (row, col) in [(40, 45), (40, 60), (60, 70), (20, 20), (79, 79)] {
            let seeds = conditions.seeds(row * 80 + col);
            let away_m = (row as f32 + 0.5 - 40.0).hypot(col as f32 + 0.5 - 40.0);
            let expected = seedbank::chance_per_year(away_m / 3.0, &parameters);
            assert!((seeds.chance_per_year - expected).abs() < 2e-4, "{row} {col} {seeds:?}");
            assert_eq!(seeds.sub_biomes != 0, seeds.chance_per_year > 0.0, "{row} {col}");
        }
    }
}
