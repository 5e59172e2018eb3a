//! Validation: what the simulation and the synthesis of undergrowth do, beside what they should.

use super::Error;
use super::statistics::HeldOut;
use crate::progress::Reporter;
use crate::raster::Mask;
use crate::simulation::ecology::{self, Finding};
use crate::simulation::{CellWindow, Parameters};
use crate::species::Biome;
use crate::undergrowth::analysis::Sample;
use crate::undergrowth::disk_distance::BINS;
use crate::undergrowth::disks::Disks;
use crate::undergrowth::measures::Measures;
use crate::undergrowth::statistics::ClusterFinder;
use crate::undergrowth::{
    Conditions, Statistics, Synthesis, Trees, Undergrowth, refinement, sampling,
};

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

/// A simulated plot, and the clusters of its cells.
struct Plot {
    window: CellWindow,
    simulated: Sample,
    cluster_of_cell: Vec<Option<u16>>,
}

/// Synthesised undergrowth beside simulated, on plots of a held-out landscape of conifers.
///
/// # Reference
/// Kapp et al. 2020, Fig. 11.
///
/// # Errors
/// A cancelled run, or a biome without statistics.
pub fn synthesis(biome: &Biome, seed: u64, reporter: &Reporter) -> Result<Vec<Finding>, Error> {
    let statistics =
        Statistics::builtin(biome).map_err(|e| Error::Usage { what: e.to_string() })?;
    let stage = reporter.stage("synthesis", 3);
    let silent = reporter.silenced();
    let held_out = HeldOut::grow(biome, 1, seed, &silent)?;
    let finder = ClusterFinder::new(&statistics);
    let plots: Vec<Plot> = held_out
        .simulate(biome, YEARS, reporter)?
        .into_iter()
        .map(|(window, simulated)| {
            let cluster_of = |cell: usize| {
                let sub_biomes = simulated.sub_biomes[cell];
                let clusters = finder.clusters(sub_biomes);
                let is_counted = sub_biomes != 0 && simulated.is_inside(cell);
                is_counted.then(|| finder.nearest(&simulated.factors[cell], clusters) as u16)
            };
            let cluster_of_cell = (0..simulated.factors.len()).map(cluster_of).collect();
            Plot { window, simulated, cluster_of_cell }
        })
        .collect();
    stage.advance(1);

    // the same ground, synthesised
    let (trees, site) = (held_out.trees(), held_out.site());
    let conditions = Conditions::under(trees, site, biome, &Parameters::undergrowth(biome));
    let frame = site.slope_rad.frame();
    let trees = Trees::of(trees, frame.rows as f32 * frame.cell_m());
    let allowed = Mask::new(vec![true; frame.len()]);
    let synthesis = Synthesis {
        conditions: &conditions,
        allowed: &allowed,
        trees: &trees,
        statistics: &statistics,
        biome,
        seed,
    };
    let mut grown = sampling::sample(&synthesis, &silent)?;
    let (clusters, species) = (statistics.clusters.len(), biome.species.len());
    let counted = |plot: &Plot, plants: &Disks| {
        let cell_at = |(east_m, south_m)| plot.simulated.cell_at(east_m, south_m);
        let cluster_of: Vec<Option<u16>> = (plants.east_m.iter().copied())
            .zip(plants.south_m.iter().copied())
            .map(|place| plot.cluster_of_cell[cell_at(place)])
            .collect();
        Measures::of(clusters, species, plants, &cluster_of, &plot.simulated.trees)
    };
    let of_grown = |grown: &Undergrowth| {
        let mut measures = Measures::new(clusters, species);
        for plot in &plots {
            measures.add(&counted(plot, &cut(grown, &plot.window, frame.cell_m())));
        }
        measures
    };
    // years differ by chance: synthesis is held to all of them together
    let mut simulated = Measures::new(clusters, species);
    for plot in &plots {
        plot.simulated.years.iter().for_each(|(_, plants)| simulated.add(&counted(plot, plants)));
    }
    let years = plots.first().map_or(1, |plot| plot.simulated.years.len()) as f64;
    let sampled = of_grown(&grown);
    stage.advance(1);
    let figures = refinement::refine(&mut grown, &synthesis, None, &silent)?;
    let refined = of_grown(&grown);
    stage.advance(1);

    let sum = |counts: &mut dyn Iterator<Item = &u32>| counts.map(|c| f64::from(*c)).sum::<f64>();
    let all = |measures: &Measures| sum(&mut measures.plants.iter());
    let share = |measures: &Measures, of: usize| {
        sum(&mut measures.plants.iter().skip(of).step_by(species)) / all(measures).max(1.0)
    };
    let farthest_share = (0..species)
        .map(|of| (share(&sampled, of) - share(&simulated, of)).abs())
        .fold(0.0, f64::max);
    // clusters with a hundred plants a year, each weighed by its plants
    let (mut apart, mut weight) = (0.0, 0.0);
    for cluster in 0..clusters {
        let own = cluster * species..(cluster + 1) * species;
        let of = |measures: &Measures| sum(&mut measures.plants[own.clone()].iter());
        let wanted = of(&simulated) / years;
        if wanted >= 100.0 {
            apart += (of(&sampled) - wanted).abs();
            weight += wanted;
        }
    }
    let density = all(&sampled) * years / all(&simulated).max(1.0);
    let [before, .., after] = figures.differences[..] else {
        return Err(Error::Failed { what: "refinement made no sweep".to_owned() });
    };
    let finding = |name, value, high| Finding { name, value, low: 0.0, high };
    Ok(vec![
        finding("synthesis: farthest species share from simulation's", farthest_share, 0.05),
        finding("synthesis: density off simulation's", (density - 1.0).abs(), 0.1),
        finding(
            "synthesis: density off simulation's, mean of clusters",
            apart / f64::max(weight, 1.0),
            0.1,
        ),
        finding(
            "synthesis: pair distances off simulation's, sampled",
            pair_difference(&sampled, &simulated),
            0.02,
        ),
        finding(
            "synthesis: pair distances off simulation's, refined",
            pair_difference(&refined, &simulated),
            0.02,
        ),
        finding(
            "refinement: pair difference from statistics, after over before",
            after / before.max(1e-9),
            0.5,
        ),
    ])
}

/// Plants of a window, their places counted from its corner.
fn cut(grown: &Undergrowth, window: &CellWindow, cell_m: f32) -> Disks {
    let corner = [window.cols.start, window.rows.start].map(|cell| cell as f32 * cell_m);
    let side = [window.cols.len(), window.rows.len()].map(|cells| cells as f32 * cell_m);
    let Disks { species, east_m, south_m, radius_m, height_m } = &grown.disks;
    let mut disks = Disks::default();
    for plant in 0..grown.disks.len() {
        let place = [east_m[plant] - corner[0], south_m[plant] - corner[1]];
        if (0..2).all(|axis| (0.0..side[axis]).contains(&place[axis])) {
            disks.push(species[plant], place, radius_m[plant], height_m[plant]);
        }
    }
    disks
}

/// How far distributions of disk distance lie apart: half the sum of |a − b| over the shares of the categories, mean over
/// pairs of kinds that each have a hundred neighbours in `b`, weighed by those.
fn pair_difference(a: &Measures, b: &Measures) -> f64 {
    let species = a.kinds() - 1;
    let histograms = |measures: &Measures| {
        let mut pairs = vec![0.0; species * measures.kinds() * BINS];
        let row = pairs.len();
        for cluster in measures.pairs.chunks(row) {
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
