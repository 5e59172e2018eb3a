//! Validation: what the simulation and the synthesis of undergrowth do, beside what they should.

use super::Error;
use super::statistics::HeldOut;
use crate::progress::Reporter;
use crate::raster::Mask;
use crate::simulation::Parameters;
use crate::simulation::ecology::{self, Finding};
use crate::species::Biome;
use crate::undergrowth::disk_distance::BINS;
use crate::undergrowth::disks::Disks;
use crate::undergrowth::measures::Measures;
use crate::undergrowth::statistics::ClusterFinder;
use crate::undergrowth::{Conditions, Statistics, Trees, Undergrowth, refinement, sampling};

/// Seed of held-out landscapes: no built-in statistics were made with it.
const HELD_OUT_SEED: u64 = 77;
/// Years that held-out plots are simulated.
const YEARS: u16 = 200;

/// All findings.
///
/// # Errors
/// A cancelled run.
pub fn run(reporter: &Reporter) -> Result<Vec<Finding>, Error> {
    let mut findings = ecology::run(reporter)?;
    let sonoma = Biome::builtin("sonoma")?;
    findings.extend(synthesis(&sonoma, HELD_OUT_SEED, reporter)?);
    Ok(findings)
}

/// What a plot holds, cluster by cluster.
struct Counted {
    measures: Measures,
    plants: f64,
}

/// Synthesised undergrowth beside simulated, on a held-out landscape of conifers.
///
/// # Reference
/// Kapp et al. 2020, Fig. 11.
///
/// # Errors
/// A cancelled run, or a biome without statistics.
pub fn synthesis(biome: &Biome, seed: u64, reporter: &Reporter) -> Result<Vec<Finding>, Error> {
    let usage =
        |e: crate::undergrowth::statistics::StatisticsError| Error::Usage { what: e.to_string() };
    let statistics = Statistics::builtin(biome).map_err(usage)?;
    let stage = reporter.stage("synthesis", 3);
    let held_out = HeldOut::grow(biome, 1, seed, &reporter.silenced())?;
    let (window, simulated) = held_out.simulate(biome, YEARS, reporter)?;
    stage.advance(1);

    // the same ground, synthesised
    let conditions = Conditions::under(
        held_out.trees(),
        held_out.site(),
        biome,
        &Parameters::undergrowth(biome),
    );
    let frame = held_out.site().slope_rad.frame();
    let trees = Trees::of(held_out.trees(), frame.rows as f32 * frame.cell_m());
    let allowed = Mask::new(vec![true; frame.len()]);
    let silent = reporter.silenced();
    let mut grown =
        sampling::sample(&conditions, &allowed, &trees, &statistics, biome, seed, &silent)?;
    let [west_m, north_m] =
        [window.cols.start, window.rows.start].map(|cell| cell as f32 * frame.cell_m());
    let cut = |grown: &Undergrowth| {
        let mut disks = Disks::default();
        for plant in 0..grown.disks.len() {
            let place = [grown.disks.east_m[plant] - west_m, grown.disks.south_m[plant] - north_m];
            let is_in = |m: f32, cells: usize| (0.0..cells as f32 * frame.cell_m()).contains(&m);
            if is_in(place[0], window.cols.len()) && is_in(place[1], window.rows.len()) {
                let (radius_m, height_m) =
                    (grown.disks.radius_m[plant], grown.disks.height_m[plant]);
                disks.push(grown.disks.species[plant], place, radius_m, height_m);
            }
        }
        disks
    };
    let finder = ClusterFinder::new(&statistics);
    let cluster_of_cell: Vec<Option<u16>> = (0..simulated.abiotics.len())
        .map(|cell| {
            let clusters = finder.clusters(simulated.seeds_of(cell).sub_biomes);
            let is_counted = simulated.seeds_of(cell).sub_biomes != 0 && simulated.is_inside(cell);
            is_counted.then(|| finder.nearest(&simulated.abiotics[cell], clusters) as u16)
        })
        .collect();
    let (clusters, species) = (statistics.clusters.len(), biome.species.len());
    let counted = |plants: &Disks| {
        let cluster_of: Vec<Option<u16>> = (plants.east_m.iter().zip(&plants.south_m))
            .map(|(east_m, south_m)| cluster_of_cell[simulated.cell_at(*east_m, *south_m)])
            .collect();
        let measures = Measures::of(clusters, species, plants, &cluster_of, &simulated.trees);
        let plants = measures.plants.iter().map(|count| f64::from(*count)).sum();
        Counted { measures, plants }
    };
    // years differ by chance: their mean is what synthesis is held to
    let mut mean = Measures::new(clusters, species);
    for (_, plants) in &simulated.years {
        mean.add(&counted(plants).measures);
    }
    let years = simulated.years.len() as f64;
    let plants = mean.plants.iter().map(|count| f64::from(*count)).sum::<f64>() / years;
    let sampled = counted(&cut(&grown));
    stage.advance(1);
    let figures = refinement::refine(
        &mut grown,
        &conditions,
        &allowed,
        &trees,
        &statistics,
        biome,
        None,
        seed,
        &silent,
    )?;
    let refined = counted(&cut(&grown));
    stage.advance(1);

    let share = |measures: &Measures, of: usize| {
        let total: f64 = measures.plants.iter().map(|count| f64::from(*count)).sum();
        let own: f64 =
            measures.plants.iter().skip(of).step_by(species).map(|c| f64::from(*c)).sum();
        own / total.max(1.0)
    };
    let farthest_share = (0..species)
        .map(|of| (share(&sampled.measures, of) - share(&mean, of)).abs())
        .fold(0.0, f64::max);
    // clusters with a hundred plants a year, each weighed by its plants
    let (mut apart, mut weight) = (0.0, 0.0);
    for cluster in 0..clusters {
        let of = |measures: &Measures| {
            let counts = &measures.plants[cluster * species..(cluster + 1) * species];
            counts.iter().map(|count| f64::from(*count)).sum::<f64>()
        };
        let simulated = of(&mean) / years;
        if simulated >= 100.0 {
            apart += (of(&sampled.measures) - simulated).abs();
            weight += simulated;
        }
    }
    let before = figures.differences.first().copied().unwrap_or(0.0);
    let after = figures.differences.last().copied().unwrap_or(0.0);
    let to_simulated = |counted: &Counted| pair_difference(&counted.measures, &mean);
    let finding = |name, value, high| Finding { name, value, low: 0.0, high };
    Ok(vec![
        finding("synthesis: farthest species share from simulation", farthest_share, 0.05),
        finding(
            "synthesis: density off simulation's, all ground",
            (sampled.plants / plants - 1.0).abs(),
            0.1,
        ),
        finding(
            "synthesis: density off simulation's, mean of clusters",
            apart / f64::max(weight, 1.0),
            0.1,
        ),
        finding(
            "refinement: pair difference from statistics, after over before",
            after / before.max(1e-9),
            0.5,
        ),
        finding(
            "refinement: pair difference from simulation, after over before",
            to_simulated(&refined) / to_simulated(&sampled).max(1e-9),
            0.5,
        ),
    ])
}

/// How far distributions of disk distance lie apart: half the sum of |a − b| over the shares of the categories, mean over
/// pairs of kinds that each have a hundred neighbours in `b`, weighed by those.
fn pair_difference(a: &Measures, b: &Measures) -> f64 {
    let species = a.kinds() / 2;
    let histograms = |measures: &Measures| {
        let mut pairs = vec![0.0; species * 2 * species * BINS];
        for cluster in measures.pairs.chunks(pairs.len()) {
            pairs.iter_mut().zip(cluster).for_each(|(sum, count)| *sum += f64::from(*count));
        }
        pairs
    };
    let (a, b) = (histograms(a), histograms(b));
    let (mut apart, mut weight) = (0.0, 0.0);
    for (a, b) in a.chunks(BINS).zip(b.chunks(BINS)) {
        let (of_a, of_b) = (a.iter().sum::<f64>(), b.iter().sum::<f64>());
        if of_b >= 100.0 {
            let share = |(a, b): (&f64, &f64)| (a / of_a.max(1.0) - b / of_b).abs();
            apart += of_b * 0.5 * a.iter().zip(b).map(share).sum::<f64>();
            weight += of_b;
        }
    }
    apart / f64::max(weight, 1.0)
}
