//! Statistics of a biome's undergrowth: simulations on made-up ground, plot by plot, then their analysis.
//!
//! Plots differ in relief, altitude, rain and canopy, and in which sub-biomes stand around: every combination has plots of
//! its own. A plot that was simulated lies in the work folder and is not simulated again.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::Error;
use super::biome_file::ChosenBiome;
use super::export_output::check_file;
use super::grow::{self, CanopyInput, CanopyRequest};
use super::import;
use crate::abiotics::{self, AbioticMaps};
use crate::canopy;
use crate::canopy::brush::{Brush, BrushRegion};
use crate::canopy::shares::Shares;
use crate::canopy::site::Site;

use crate::gpu::GpuChoice;
use crate::plants::{Layer, Plants};
use crate::progress::Reporter;
use crate::raster::Cell;
use crate::rng::{self, Key, Process};
use crate::scene;
use crate::simulation::{CellWindow, Community, Parameters, Plot};
use crate::species::Biome;
use crate::terrain::Terrain;
use crate::terrain::generate::{self, GenerateParams};
use crate::undergrowth::analysis::{self, LEAST_HEIGHT_M, Sample};
use crate::undergrowth::conditions::Conditions;
use crate::undergrowth::disks::Disks;
use crate::undergrowth::statistics::Statistics;

/// Version of simulated plots: another one wherever they would come out otherwise, so that none of an older kind is used again.
const SAMPLE_VERSION: u32 = 4;

/// Side of a landscape, in cells of 1 m. chosen: water has slopes to gather on, and seeds come from all sides.
const LANDSCAPE_CELLS: usize = 320;
/// Side of a plot's counted ground, m.
const COUNTED_CELLS: usize = 96;
/// Rim around it whose plants are neighbours only, m: more than the reach of disk distances.
const RIM_CELLS: usize = 4;
/// Plots of a landscape. chosen: its wettest window under trees, and its driest.
const PLOTS: usize = 2;
/// Landscapes of a combination of sub-biomes, at least; together at least [`LEAST_LANDSCAPES`]. chosen: from dry
/// to wet, some minutes in all.
const LANDSCAPES_PER_COMBINATION: usize = 4;
const LEAST_LANDSCAPES: usize = 20;
/// Windows that a plot is chosen from, along each side. chosen: they overlap by half.
const CHOICES: usize = 5;
/// Least light that trees take from a plot, as a share of it. chosen: meadows have no seeds.
const LEAST_SHADE_FRACTION: f32 = 0.05;
/// Farther than that from a plot trees are nobody's neighbours, m. chosen: the widest crown and its reach.
const TREES_WITHIN_M: f32 = 20.0;
/// Distance between middles of patches of one sub-biome, m. chosen: twice as far as seeds of middling crowns fly.
const PATCH_M: f32 = 80.0;

/// Statistics to make.
#[derive(Clone, Debug)]
pub struct StatisticsRequest {
    /// A built-in biome's name, or the path of a biome file.
    pub biome: String,
    /// The file to write.
    pub output: PathBuf,
    /// Folder that keeps simulated plots.
    pub work: PathBuf,
    /// Years that are simulated; plants are counted in every tenth of the last [`COUNTED_YEARS`].
    pub years: u16,
    /// Another seed, other plots.
    pub seed: u64,
}

/// Last years that plants are counted in. chosen: cohorts of gaps come and go within them.
pub const COUNTED_YEARS: u16 = 50;

/// Least years that leave as many to count in.
pub const LEAST_YEARS: u16 = 60;

impl StatisticsRequest {
    /// A request with the settings that the built-in statistics were made with.
    pub fn new(biome: &str, output: PathBuf, work: PathBuf) -> Self {
        Self { biome: biome.to_owned(), output, work, years: 200, seed: 1 }
    }
}

/// Simulates what is not simulated yet, analyses it and writes the file; gives what it holds.
///
/// # Errors
/// An unknown biome, files that cannot be written, a cancelled run: plots that are done stay done.
pub fn run(request: &StatisticsRequest, reporter: &Reporter) -> Result<Statistics, Error> {
    simulate_and_analyse(request, reporter).map_err(|error| match error {
        Error::Cancelled => {
            let work = request.work.display();
            let what = format!(
                "cancelled; plots that are done lie in {work}: the same command goes on from there"
            );
            Error::Failed { what }
        }
        other => other,
    })
}

fn simulate_and_analyse(
    request: &StatisticsRequest,
    reporter: &Reporter,
) -> Result<Statistics, Error> {
    let biome = ChosenBiome::read(&request.biome)?.biome;
    if request.years < LEAST_YEARS {
        let what = format!("--years {}: give at least {LEAST_YEARS}", request.years);
        return Err(Error::Usage { what });
    }
    check_file(&request.output, "statistics", |head| {
        String::from_utf8_lossy(head).starts_with("{\"format\":")
    })?;
    if request.work.exists() && !request.work.is_dir() {
        let what = format!(
            "{}: is a file where plots are kept in a folder; name another with --work",
            request.work.display()
        );
        return Err(Error::Usage { what });
    }
    let failed = |path: &Path, e: std::io::Error| Error::Failed {
        what: format!("{}: {e}; check free space and permissions", path.display()),
    };
    fs::create_dir_all(&request.work).map_err(|e| failed(&request.work, e))?;
    let landscapes = landscapes(&biome);
    let parameters = Parameters::undergrowth(&biome);
    let key = import::key(&[
        "statistics",
        env!("CARGO_PKG_VERSION"),
        &format!("{biome:?} {parameters:?} {} {} {SAMPLE_VERSION}", request.years, request.seed),
    ]);
    let stage = reporter.stage("plots", (landscapes.len() * PLOTS) as u64);
    let samples: Vec<Vec<Sample>> = (landscapes.par_iter().enumerate())
        .map(|(index, landscape)| {
            let path = |plot: usize| {
                request.work.join(format!("{}-{}.json", &key[..12], index * PLOTS + plot))
            };
            let read = |plot: usize| {
                let text = fs::read_to_string(path(plot)).ok()?;
                serde_json::from_str::<Sample>(&text).ok()
            };
            let kept: Vec<Sample> = (0..PLOTS).map_while(read).collect();
            if kept.len() == PLOTS {
                stage.advance(PLOTS as u64);
                return Ok(kept);
            }
            let grown = landscape.grow(&biome, index, request.seed, &reporter.silenced())?;
            (0..PLOTS)
                .map(|plot| {
                    let sample = match read(plot) {
                        Some(sample) => sample,
                        None => {
                            let sample = grown.simulate(
                                plot,
                                &biome,
                                request.years,
                                request.seed,
                                reporter,
                            )?;
                            let text = serde_json::to_string(&sample)
                                .map_err(|e| Error::Failed { what: e.to_string() })?;
                            scene::write_beside(&path(plot), text.as_bytes())?;
                            sample
                        }
                    };
                    stage.advance(1);
                    Ok(sample)
                })
                .collect()
        })
        .collect::<Result<_, Error>>()?;
    let samples: Vec<Sample> = samples.into_iter().flatten().collect();
    drop(stage);
    let curves = request.work.join("plants_by_year.csv");
    scene::write_beside(&curves, plants_by_year(&samples).as_bytes())?;
    reporter.check_cancelled()?;
    let _stage = reporter.stage("analysis", 1);
    let statistics = analysis::analyse(&samples, &biome, request.seed);
    scene::write_beside(&request.output, statistics.to_json().as_bytes())?;
    Ok(statistics)
}

/// Live plants on a hectare, a column a plot.
fn plants_by_year(samples: &[Sample]) -> String {
    let head: Vec<String> = (0..samples.len()).map(|plot| format!("plot_{plot}")).collect();
    let mut text = format!("year,{}\n", head.join(","));
    for year in 0..samples.first().map_or(0, |sample| sample.plants_by_year.len()) {
        let row: Vec<String> = samples
            .iter()
            .map(|sample| {
                let side_m =
                    (sample.rows as f32 * sample.cell_m, sample.cols as f32 * sample.cell_m);
                let per_ha = sample.plants_by_year[year] as f32 / (side_m.0 * side_m.1) * 10_000.0;
                format!("{per_ha:.0}")
            })
            .collect();
        text += &format!("{},{}\n", year + 1, row.join(","));
    }
    text
}

/// Ground, weather and canopy of plots.
#[derive(Clone, Copy, Debug)]
struct Landscape {
    /// One bit a sub-biome of its canopy.
    sub_biomes: u32,
    /// Number among those of its combination, and how many there are.
    number: usize,
    of: usize,
}

/// Landscapes for every combination of sub-biomes.
fn landscapes(biome: &Biome) -> Vec<Landscape> {
    let combinations = (1_u32 << biome.sub_biomes.len()) - 1;
    let of = LEAST_LANDSCAPES.div_ceil(combinations as usize).max(LANDSCAPES_PER_COMBINATION);
    (1..=combinations)
        .flat_map(|sub_biomes| (0..of).map(move |number| Landscape { sub_biomes, number, of }))
        .collect()
}

/// A landscape with its trees.
struct Grown {
    maps: AbioticMaps,
    site: Site,
    trees: Plants,
    index: usize,
}

impl Landscape {
    fn grow(
        &self,
        biome: &Biome,
        index: usize,
        seed: u64,
        reporter: &Reporter,
    ) -> Result<Grown, Error> {
        let draw = |which: u16| {
            let (process, entity) = (Process::StatisticsPlot, index as u64);
            rng::uniforms(Key { seed, process, year: which, month: 0, entity })
        };
        let between = |share: f32, low: f32, high: f32| low + (high - low) * share;
        let [relief, altitude, height, density] = draw(0);
        let [cover, rain, ..] = draw(1);
        // rain is spread evenly over a combination's landscapes, the rest is drawn
        let rain = (self.number as f32 + rain) / self.of as f32;
        let climate = biome.climate.with_rain_scaled([between(rain, 0.6, 1.7); 12]);
        let terrain = generate::generate(
            &GenerateParams {
                rows: LANDSCAPE_CELLS,
                cols: LANDSCAPE_CELLS,
                cell_m: 1.0,
                seed: seed.wrapping_mul(1000).wrapping_add(index as u64),
                relief_m: between(relief, 8.0, 110.0),
                lowest_m: climate.station_altitude_m + between(altitude, 0.0, 500.0),
                latitude_deg: climate.latitude_deg,
            },
            reporter,
        )?;
        let maps = abiotics::run(&terrain, &climate, &abiotics::Params::default(), reporter)?;
        let site = Site::of(&maps);
        let canopy = canopy::generate::GenerateParams {
            seed: seed.wrapping_mul(1000).wrapping_add(index as u64),
            cover_fraction: between(cover, 0.3, 0.92),
            stand_height_m: between(height, 9.0, 30.0),
            trees_per_ha: between(density, 150.0, 600.0),
        };
        let chm_m = canopy::generate::generate(&terrain, &site, &canopy, reporter)?;
        let brush = self.brush(&terrain, biome, index, seed)?;
        let input = CanopyInput {
            brush: Some(&brush),
            ..CanopyInput::made_up(&terrain, &site, &chm_m, biome)
        };
        let request = CanopyRequest { gpu: GpuChoice::Off, ..CanopyRequest::default() };
        let grown = grow::grow(&input, Shares::default(), seed, &request, reporter)?;
        Ok(Grown { trees: grown.plants, maps, site, index })
    }

    /// Patches of its sub-biomes: each cell is of the nearest middle's.
    fn brush(
        &self,
        terrain: &Terrain,
        biome: &Biome,
        index: usize,
        seed: u64,
    ) -> Result<Brush, Error> {
        let own: Vec<usize> =
            (0..biome.sub_biomes.len()).filter(|i| self.sub_biomes >> i & 1 == 1).collect();
        let regions = own
            .iter()
            .map(|sub_biome| {
                let sub_biome = &biome.sub_biomes[*sub_biome];
                let share = 1.0 / sub_biome.canopy.len() as f64;
                let by_key: BTreeMap<String, f64> = (sub_biome.canopy.iter())
                    .map(|species| (biome.species[*species].key.clone(), share))
                    .collect();
                Ok(BrushRegion {
                    name: sub_biome.key.clone(),
                    shares: Shares::new(&by_key, biome)?,
                })
            })
            .collect::<Result<Vec<_>, Error>>()?;
        let frame = terrain.elevation_m.frame();
        let patches = (frame.rows as f32 * frame.cell_m() / PATCH_M).ceil() as usize + 1;
        let middles: Vec<([f32; 2], u8)> = (0..patches * patches)
            .map(|patch| {
                let entity = (index * patches * patches + patch) as u64;
                let (process, year) = (Process::StatisticsPlot, 2);
                let [east, south, which, _] =
                    rng::uniforms(Key { seed, process, year, month: 0, entity });
                let place = [(patch % patches) as f32 + east, (patch / patches) as f32 + south];
                let region = ((which * own.len() as f32) as usize).min(own.len() - 1);
                (place.map(|m| (m - 0.5) * PATCH_M), region as u8 + 1) // at most 250 regions
            })
            .collect();
        let region_at = |cell: usize| {
            let Cell { row, col } = frame.cell(cell);
            let at = [col as f32 + 0.5, row as f32 + 0.5].map(|cells| cells * frame.cell_m());
            let away = |place: &[f32; 2]| (place[0] - at[0]).powi(2) + (place[1] - at[1]).powi(2);
            let nearest = middles.iter().min_by(|(a, _), (b, _)| away(a).total_cmp(&away(b)));
            nearest.map_or(0, |(_, region)| *region)
        };
        let cells = (0..frame.len()).map(region_at).collect();
        Ok(Brush { regions, cells: terrain.elevation_m.with_values(cells) })
    }
}

/// A landscape that no statistics were made on, for validation.
pub(super) struct HeldOut {
    grown: Grown,
    seed: u64,
}

impl HeldOut {
    /// A landscape under the canopy of some sub-biomes.
    pub fn grow(
        biome: &Biome,
        sub_biomes: u32,
        seed: u64,
        reporter: &Reporter,
    ) -> Result<Self, Error> {
        let landscape = Landscape { sub_biomes, number: 1, of: 2 };
        Ok(Self { grown: landscape.grow(biome, 0, seed, reporter)?, seed })
    }

    /// Its canopy trees.
    pub fn trees(&self) -> &Plants {
        &self.grown.trees
    }

    /// What it offers.
    pub fn site(&self) -> &Site {
        &self.grown.site
    }

    /// Its plots after so many years, and where in it they lie.
    pub fn simulate(
        &self,
        biome: &Biome,
        years: u16,
        reporter: &Reporter,
    ) -> Result<Vec<(CellWindow, Sample)>, Error> {
        let parameters = Parameters::undergrowth(biome);
        let conditions = Conditions::under(&self.grown.trees, &self.grown.site, biome, &parameters);
        let plot = |plot| {
            let sample = self.grown.simulate(plot, biome, years, self.seed, reporter)?;
            Ok((self.grown.window(plot, &conditions), sample))
        };
        (0..PLOTS).into_par_iter().map(plot).collect()
    }
}

impl Grown {
    /// Lives through the years of a plot: 0 is the wettest window under trees, 1 the driest.
    fn simulate(
        &self,
        plot: usize,
        biome: &Biome,
        last_year: u16,
        seed: u64,
        reporter: &Reporter,
    ) -> Result<Sample, Error> {
        let parameters = Parameters::undergrowth(biome);
        let conditions = Conditions::under(&self.trees, &self.site, biome, &parameters);
        let window = self.window(plot, &conditions);
        let frame = self.site.slope_rad.frame();
        let cell_m = frame.cell_m();
        let cells = || {
            window
                .rows
                .clone()
                .flat_map(|row| window.cols.clone().map(move |col| row * frame.cols + col))
        };
        let (west_m, north_m) =
            (window.cols.start as f32 * cell_m, window.rows.start as f32 * cell_m);
        let (width_m, height_m) =
            (window.cols.len() as f32 * cell_m, window.rows.len() as f32 * cell_m);
        let mut trees = Disks::default();
        for tree in (0..self.trees.len()).filter(|tree| self.trees.layer[*tree] == Layer::Canopy) {
            let place = [
                self.trees.east_m[tree] - west_m,
                frame.rows as f32 * cell_m - self.trees.north_m[tree] - north_m,
            ];
            let is_near =
                |at_m: f32, side_m: f32| (-TREES_WITHIN_M..side_m + TREES_WITHIN_M).contains(&at_m);
            if is_near(place[0], width_m) && is_near(place[1], height_m) {
                let (radius_m, tree_m) =
                    (self.trees.crown_radius_m[tree], self.trees.height_m[tree]);
                trees.push(self.trees.species[tree], place, radius_m, tree_m);
            }
        }
        let ground = Plot::of(&self.maps, &self.trees, biome, &parameters, &window);
        let seed = seed.wrapping_mul(1000).wrapping_add((self.index * PLOTS + plot) as u64);
        let mut community = Community::new(ground, biome, parameters, seed);
        let (mut years, mut plants_by_year) = (Vec::new(), Vec::new());
        for year in 1..=last_year {
            reporter.check_cancelled()?;
            community.live_a_year();
            plants_by_year.push(community.len() as u32); // far fewer than 2³²
            if year + COUNTED_YEARS >= last_year && (last_year - year).is_multiple_of(10) {
                let mut plants = Disks::default();
                for plant in 0..community.len() {
                    let height_m = community.height_m[plant];
                    if height_m >= LEAST_HEIGHT_M {
                        let place = [community.east_m[plant], community.south_m[plant]];
                        let radius_m = community.crown_radius_m[plant];
                        plants.push(community.species[plant], place, radius_m, height_m);
                    }
                }
                years.push((year, plants));
            }
        }
        Ok(Sample {
            rows: window.rows.len(),
            cols: window.cols.len(),
            cell_m,
            rim_m: RIM_CELLS as f32 * cell_m,
            factors: cells().map(|cell| conditions.factors(cell, conditions.seeds(cell))).collect(),
            sub_biomes: cells().map(|cell| conditions.seeds(cell).sub_biomes).collect(),
            trees,
            years,
            plants_by_year,
        })
    }

    /// The wettest window under trees, or the driest.
    fn window(&self, plot: usize, conditions: &Conditions<'_>) -> CellWindow {
        let side = COUNTED_CELLS + 2 * RIM_CELLS;
        let frame = self.site.slope_rad.frame();
        let step = (LANDSCAPE_CELLS - side) / (CHOICES - 1);
        let windows = (0..CHOICES * CHOICES).map(|choice| {
            let (row, col) = (choice / CHOICES * step, choice % CHOICES * step);
            CellWindow { rows: row..row + side, cols: col..col + side }
        });
        let mean = |window: &CellWindow, of: &dyn Fn(usize) -> f32| {
            let cells = window
                .rows
                .clone()
                .flat_map(|row| window.cols.clone().map(move |col| row * frame.cols + col));
            cells.map(|cell| f64::from(of(cell))).sum::<f64>() / (side * side) as f64
        };
        let shade =
            |window: &CellWindow| mean(window, &|cell| 1.0 - conditions.light_fraction(cell));
        let wet = |window: &CellWindow| {
            let is_wooded = shade(window) >= f64::from(LEAST_SHADE_FRACTION);
            let moisture_mm = mean(window, &|cell| self.site.moisture_mm.values()[cell]);
            let sign = if plot == 0 { 1.0 } else { -1.0 };
            (is_wooded, sign * moisture_mm)
        };
        windows
            .max_by(|a, b| {
                let (a, b) = (wet(a), wet(b));
                a.0.cmp(&b.0).then(a.1.total_cmp(&b.1))
            })
            .unwrap_or(CellWindow { rows: 0..side, cols: 0..side })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_combination_of_sub_biomes_has_landscapes() {
        let of = |name: &str| landscapes(&Biome::builtin(name).unwrap());
        let sonoma = of("sonoma");
        assert_eq!(sonoma.len(), 4 * 15);
        assert!((1..16).all(|bits| sonoma.iter().filter(|l| l.sub_biomes == bits).count() == 4));
        assert_eq!(of("pyrenees").len(), LEAST_LANDSCAPES);
    }

    #[test]
    fn a_plot_has_what_its_analysis_needs_and_reads_back() {
        let biome = Biome::builtin("sonoma").unwrap();
        let reporter = Reporter::silent();
        let held_out = HeldOut::grow(&biome, 1, 77, &reporter).unwrap();
        let plots = held_out.simulate(&biome, 12, &reporter).unwrap();
        assert_eq!(plots.len(), PLOTS);
        assert!(plots.iter().map(|(_, sample)| sample.trees.len()).sum::<usize>() > 10);
        for (window, sample) in plots {
            assert_eq!((sample.rows, sample.cols), (window.rows.len(), window.cols.len()));
            assert_eq!(sample.factors.len(), sample.rows * sample.cols);
            assert_eq!(sample.plants_by_year.len(), 12);
            let years: Vec<u16> = sample.years.iter().map(|(year, _)| *year).collect();
            assert_eq!(years, [2, 12]);
            let text = serde_json::to_string(&sample).unwrap();
            assert_eq!(serde_json::from_str::<Sample>(&text).unwrap(), sample);
        }
    }
}
