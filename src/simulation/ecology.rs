//! Ecology: small experiments that show what emerges from the processes, each with the figure that field ecology names.
//!
//! # Reference
//! Kapp et al. 2020, section 7.2 and Figs. 7, 13–15, 20, doi:10.1145/3414685.3417848. Self-thinning: Yoda et al. 1963,
//! "Self-thinning in overcrowded pure stands".

use super::plot::GroundCell;
use super::{CanopyTree, Community, Competition, Parameters, Plot};
use crate::math;
use crate::plants::buckets::Buckets;
use crate::progress::{Cancelled, Reporter};
use crate::raster::MONTHS;
use crate::species::Biome;

/// What an experiment found, and what it should.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Finding {
    /// What was measured.
    pub name: &'static str,
    /// What it came to.
    pub value: f64,
    /// Least that is right.
    pub low: f64,
    /// Most that is right.
    pub high: f64,
}

impl Finding {
    /// Whether the value is within its range.
    pub fn is_right(&self) -> bool {
        (self.low..=self.high).contains(&self.value)
    }
}

/// Plants at least so high are counted, m: seedlings come and go.
const COUNTED_M: f32 = 0.1;

/// All experiments, on Sonoma's species.
///
/// # Errors
/// [`Cancelled`] once the run was cancelled.
pub fn run(reporter: &Reporter) -> Result<Vec<Finding>, Cancelled> {
    let sonoma = Biome::builtin("sonoma").expect("a built-in biome is sound");
    let experiments: [&dyn Fn() -> Vec<Finding>; 5] = [
        &|| vec![self_thinning(&sonoma)],
        &|| succession_and_equilibrium(&sonoma),
        &|| gradients(&sonoma),
        &|| gap_dynamics(&sonoma),
        &|| vec![clustering(&sonoma)],
    ];
    let stage = reporter.stage("ecology", experiments.len() as u64);
    let mut findings = Vec::new();
    for experiment in experiments {
        reporter.check_cancelled()?;
        findings.extend(experiment());
        stage.advance(1);
    }
    Ok(findings)
}

/// Even ground.
fn even(side_m: usize, cell: GroundCell) -> Vec<GroundCell> {
    vec![cell; side_m * side_m]
}

fn ground(sun_h: f32, moisture_mm: f32, temperature_c: f32) -> GroundCell {
    GroundCell {
        sun_h: [sun_h; MONTHS],
        moisture_mm: [moisture_mm; MONTHS],
        temperature_c: [temperature_c; MONTHS],
        slope_rad: 0.05,
    }
}

fn species_of(biome: &Biome, key: &str) -> u16 {
    let index = biome.species_index(key).expect("the biome has the species");
    index as u16 // biomes have some dozens
}

fn tree(biome: &Biome, key: &str, place: [f32; 2], crown_radius_m: f32) -> CanopyTree {
    CanopyTree {
        species: species_of(biome, key),
        east_m: place[0],
        south_m: place[1],
        crown_radius_m,
        height_m: 24.0,
        crown_base_m: 12.0,
    }
}

/// Rows of trees over a square, left out where `is_gap`.
fn rows_of_trees(
    biome: &Biome,
    keys: &[&str],
    side_m: f32,
    spacing_m: f32,
    is_gap: impl Fn([f32; 2]) -> bool,
) -> Vec<CanopyTree> {
    let count = (side_m / spacing_m) as usize;
    let place =
        |i: usize| [(i % count) as f32 + 0.5, (i / count) as f32 + 0.5].map(|n| n * spacing_m);
    (0..count * count)
        .map(|i| (i, place(i)))
        .filter(|(_, place)| !is_gap(*place))
        .map(|(i, place)| tree(biome, keys[(i + i / count) % keys.len()], place, 0.56 * spacing_m))
        .collect()
}

fn apart_m(a: [f32; 2], b: [f32; 2]) -> f32 {
    let [east_m, south_m] = [a[0] - b[0], a[1] - b[1]];
    (east_m * east_m + south_m * south_m).sqrt()
}

/// Years of a community from bare ground; what `at_end` gives of each.
fn live<T>(
    community: &mut Community,
    years: u16,
    mut at_end: impl FnMut(&Community) -> T,
) -> Vec<T> {
    (0..years)
        .map(|_| {
            community.live_a_year();
            at_end(community)
        })
        .collect()
}

/// Plants of a species, or of all, that a condition on their place holds for.
fn count(community: &Community, species: Option<u16>, is_there: impl Fn([f32; 2]) -> bool) -> f64 {
    let is_counted = |plant: &usize| {
        species.is_none_or(|species| community.species[*plant] == species)
            && community.height_m[*plant] >= COUNTED_M
            && is_there([community.east_m[*plant], community.south_m[*plant]])
    };
    (0..community.len()).filter(is_counted).count() as f64
}

/// Area of a species' crowns, m².
fn crown_area_m2(community: &Community, species: u16) -> f64 {
    let own = (0..community.len()).filter(|plant| community.species[*plant] == species);
    own.map(|plant| std::f64::consts::PI * f64::from(community.crown_radius_m[plant]).powi(2)).sum()
}

/// Slope of log mean crown volume against log density in an even-aged stand of one species once it is crowded.
///
/// # Reference
/// Yoda et al. 1963: −3/2; field values lie between −1.2 and −1.8.
fn self_thinning(biome: &Biome) -> Finding {
    const SIDE_M: usize = 24;
    let species = species_of(biome, "douglas-fir");
    let parameters = Parameters { open_limit_m: f32::INFINITY, ..Parameters::kapp2020() };
    let cells = even(SIDE_M, ground(7.0, 110.0, 18.0));
    let plot = Plot::new([SIDE_M; 2], 1.0, cells, &[], biome, &parameters);
    let mut community = Community::new(plot, biome, parameters, 1);
    let planted = 12 * SIDE_M * SIDE_M;
    for id in 0..planted as u64 {
        // a lattice without a pattern: steps by two irrational shares
        let place = [0.754_877_67, 0.569_840_3]
            .map(|share: f64| (share * (id + 1) as f64).fract() as f32 * SIDE_M as f32);
        community.plant(id, species, place, 0.0);
    }
    let by_year = live(&mut community, 90, |community| {
        let plants = community.len().max(1) as f64;
        let volumes = community.crown_radius_m.iter().zip(&community.height_m);
        let volume_m3: f64 = volumes.map(|(r, h)| f64::from(r * r * h)).sum();
        [plants, volume_m3 / plants]
    });
    // crowded, but not yet a handful whose edges count
    let crowded: Vec<[f64; 2]> = (by_year.iter().step_by(5))
        .filter(|[plants, _]| *plants < 0.4 * planted as f64 && *plants > 40.0)
        .map(|[plants, volume_m3]| [math::ln_f64(*plants), math::ln_f64(*volume_m3)])
        .collect();
    Finding { name: "self-thinning slope", value: slope(&crowded), low: -1.8, high: -1.2 }
}

/// Slope of the reduced major axis: both measures scatter.
fn slope(points: &[[f64; 2]]) -> f64 {
    let count = points.len().max(1) as f64;
    let mean = |axis: usize| points.iter().map(|point| point[axis]).sum::<f64>() / count;
    let (x, y) = (mean(0), mean(1));
    let (mut xx, mut yy, mut xy) = (0.0, 0.0, 0.0);
    for point in points {
        xx += (point[0] - x).powi(2);
        yy += (point[1] - y).powi(2);
        xy += (point[0] - x) * (point[1] - y);
    }
    if xx > 0.0 { xy.signum() * (yy / xx).sqrt() } else { f64::NAN }
}

/// A year of oak woodland: crown areas of poison oak and laurel, m², and the number of all plants.
type OakYear = ([f64; 2], f64);

/// Oak woodland with a glade, from bare ground, year by year.
fn oak_woodland(biome: &Biome) -> Vec<OakYear> {
    const SIDE_M: usize = 40;
    let parameters = Parameters::kapp2020();
    let trees =
        rows_of_trees(biome, &["california-black-oak", "coast-live-oak"], 40.0, 10.0, |place| {
            apart_m(place, [20.0; 2]) < 12.0
        });
    let cells = even(SIDE_M, ground(8.0, 60.0, 16.0));
    let plot = Plot::new([SIDE_M; 2], 1.0, cells, &trees, biome, &parameters);
    let mut community = Community::new(plot, biome, parameters, 1);
    let species = ["pacific-poison-oak", "california-laurel"].map(|key| species_of(biome, key));
    live(&mut community, 200, |community| {
        let areas_m2 = species.map(|species| crown_area_m2(community, species));
        (areas_m2, community.len() as f64)
    })
}

/// How far a fast species comes down from its peak, and how much a slow one gains meanwhile; then, how far the number of plants
/// strays from its mean in the last 50 years of 200.
///
/// # Reference
/// Kapp et al. 2020, Fig. 15: fast species peak, then laurel, slower but better suited, gains; a dynamic equilibrium from about
/// year 125 on.
fn succession_and_equilibrium(biome: &Biome) -> Vec<Finding> {
    let by_year = oak_woodland(biome);
    let peak = by_year.iter().enumerate().max_by(|(_, a), (_, b)| a.0[0].total_cmp(&b.0[0]));
    let at_peak = peak.map_or(0, |(year, _)| year);
    let last = &by_year[150..];
    let mean = |of: &dyn Fn(&OakYear) -> f64| last.iter().map(of).sum::<f64>() / last.len() as f64;
    let plants = mean(&|year| year.1);
    let strays = last.iter().map(|year| (year.1 / plants - 1.0).abs()).fold(0.0, f64::max);
    vec![
        Finding {
            name: "succession: crowns of poison oak at their peak over those at the end",
            value: by_year[at_peak].0[0] / mean(&|year| year.0[0]),
            low: 1.5,
            high: f64::INFINITY,
        },
        Finding {
            name: "succession: crowns of laurel at the end over those at that peak",
            value: mean(&|year| year.0[1]) / by_year[at_peak].0[1].max(1.0),
            low: 3.0,
            high: f64::INFINITY,
        },
        Finding {
            name: "equilibrium: farthest from the mean, years 151–200",
            value: strays,
            low: 0.0,
            high: 0.1,
        },
    ]
}

/// How much denser shade plants stand in moist shade than in dry sun, and sagebrush the other way round.
///
/// # Reference
/// Kapp et al. 2020, Fig. 7.
fn gradients(biome: &Biome) -> Vec<Finding> {
    const SIDE_M: usize = 48;
    let parameters = Parameters::kapp2020();
    // seeds of both kinds everywhere: a row of trees down the middle
    let trees: Vec<CanopyTree> = (0..12)
        .map(|i| {
            let key = ["redwood", "gray-pine"][i % 2];
            tree(biome, key, [24.0, 4.0 * i as f32 + 2.0], 3.5)
        })
        .collect();
    let [west, east] = [ground(3.0, 110.0, 15.0), ground(10.5, 45.0, 15.0)];
    let cells = (0..SIDE_M * SIDE_M)
        .map(|cell| if cell % SIDE_M < SIDE_M / 2 { west } else { east })
        .collect();
    let plot = Plot::new([SIDE_M; 2], 1.0, cells, &trees, biome, &parameters);
    let mut community = Community::new(plot, biome, parameters, 1);
    let is_west = |[east_m, _]: [f32; 2]| east_m < 19.0;
    let is_east = |[east_m, _]: [f32; 2]| east_m > 29.0;
    let keys = ["redwood-sorrel", "western-swordfern", "california-sagebrush"];
    let by_year = live(&mut community, 60, |community| {
        keys.map(|key| {
            let species = Some(species_of(biome, key));
            [count(community, species, is_west), count(community, species, is_east)]
        })
    });
    let sum =
        |of: usize, side: usize| by_year[40..].iter().map(|counts| counts[of][side]).sum::<f64>();
    let names = [
        "gradient: sorrel in moist shade over dry sun",
        "gradient: swordfern in moist shade over dry sun",
        "gradient: sagebrush in dry sun over moist shade",
    ];
    let ratio = |of: usize| {
        if of < 2 { sum(of, 0) / sum(of, 1).max(1.0) } else { sum(of, 1) / sum(of, 0).max(1.0) }
    };
    (0..3)
        .map(|of| Finding { name: names[of], value: ratio(of), low: 3.0, high: f64::INFINITY })
        .collect()
}

/// How much denser woody undergrowth stands in a gap, and at its edge, than under closed canopy.
///
/// # Reference
/// Kapp et al. 2020, Fig. 13.
fn gap_dynamics(biome: &Biome) -> Vec<Finding> {
    const SIDE_M: usize = 60;
    let parameters = Parameters::kapp2020();
    let from_middle = |place: [f32; 2]| apart_m(place, [30.0; 2]);
    let trees = rows_of_trees(biome, &["redwood", "douglas-fir"], 60.0, 6.0, |place| {
        from_middle(place) < 14.0
    });
    let cells = even(SIDE_M, ground(8.0, 80.0, 16.0));
    let plot = Plot::new([SIDE_M; 2], 1.0, cells, &trees, biome, &parameters);
    let mut community = Community::new(plot, biome, parameters, 1);
    let ring = |low_m: f32, high_m: f32| {
        move |place: [f32; 2]| (low_m..high_m).contains(&from_middle(place))
    };
    let rings = [(0.0, 9.0), (9.0, 13.0), (19.0, 29.0)];
    let woody: Vec<u16> = (0..biome.species.len() as u16)
        .filter(|species| biome.species[usize::from(*species)].form != crate::species::Form::Herb)
        .collect();
    let by_year = live(&mut community, 100, |community| {
        rings.map(|(low_m, high_m)| {
            let area_m2 = f64::from(high_m * high_m - low_m * low_m) * std::f64::consts::PI;
            let of = |species: &u16| count(community, Some(*species), ring(low_m, high_m));
            woody.iter().map(of).sum::<f64>() / area_m2
        })
    });
    let mean = |of: usize| by_year[60..].iter().map(|densities| densities[of]).sum::<f64>();
    let names = [
        "gap: woody plants in the gap over closed canopy",
        "gap: woody plants at its edge over closed canopy",
    ];
    (0..2)
        .map(|of| Finding {
            name: names[of],
            value: mean(of) / mean(2).max(1e-9),
            low: 1.2,
            high: f64::INFINITY,
        })
        .collect()
}

/// Pair correlation at 1 m of ours over that of competition by intersecting circles, means of four runs.
///
/// # Reference
/// Kapp et al. 2020, section 7.2 and Fig. 20; Deussen et al. 1998, doi:10.1145/280814.280898.
fn clustering(biome: &Biome) -> Finding {
    const SIDE_M: usize = 50;
    let correlation = |competition: Competition, seed: u64| {
        let parameters = Parameters { competition, ..Parameters::kapp2020() };
        let trees = rows_of_trees(
            biome,
            &["redwood", "california-black-oak", "gray-pine"],
            50.0,
            10.0,
            |[east_m, _]| (20.0..36.0).contains(&east_m),
        );
        let cells = even(SIDE_M, ground(8.0, 70.0, 16.0));
        let plot = Plot::new([SIDE_M; 2], 1.0, cells, &trees, biome, &parameters);
        let mut community = Community::new(plot, biome, parameters, seed);
        live(&mut community, 120, |_| ());
        pair_correlation(&community, 1.0, 0.25, SIDE_M as f32)
    };
    let sum = |competition| (1..=4).map(|seed| correlation(competition, seed)).sum::<f64>();
    Finding {
        name: "clustering: pair correlation at 1 m, ours over circles that may not meet",
        value: sum(Competition::Resources) / sum(Competition::Intersection).max(1e-9),
        low: 1.05,
        high: f64::INFINITY,
    }
}

/// Density of plants so far from a plant, over their mean density; plants nearer than that to the rim are not asked.
fn pair_correlation(community: &Community, distance_m: f32, half_width_m: f32, side_m: f32) -> f64 {
    let places: Vec<[f32; 2]> = (0..community.len())
        .filter(|plant| community.height_m[*plant] >= COUNTED_M)
        .map(|plant| [community.east_m[plant], community.south_m[plant]])
        .collect();
    let (near_m, far_m) = (distance_m - half_width_m, distance_m + half_width_m);
    let is_inside = |place: &&[f32; 2]| place.iter().all(|m| *m > far_m && *m < side_m - far_m);
    let (mut asked, mut found) = (0.0, 0.0);
    let (east_m, south_m): (Vec<f32>, Vec<f32>) = places.iter().map(|[e, s]| (*e, *s)).unzip();
    let buckets = Buckets::new(&east_m, &south_m, far_m);
    for place in places.iter().filter(is_inside) {
        asked += 1.0;
        buckets.near(*place, far_m, |other| {
            if (near_m..far_m).contains(&apart_m(*place, places[other])) {
                found += 1.0;
            }
        });
    }
    let density = places.len() as f64 / f64::from(side_m * side_m);
    let ring_m2 = std::f64::consts::PI * f64::from(far_m * far_m - near_m * near_m);
    found / (asked * density * ring_m2)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn assert_right(findings: impl IntoIterator<Item = Finding>) {
        for finding in findings {
            println!("{}: {:.3}", finding.name, finding.value);
            assert!(finding.is_right(), "{finding:?}");
        }
    }

    #[test]
    fn crowded_stands_thin_themselves() {
        assert_right([self_thinning(&Biome::builtin("sonoma").unwrap())]);
    }

    #[test]
    fn fast_species_peak_and_yield_and_numbers_come_to_an_equilibrium() {
        assert_right(succession_and_equilibrium(&Biome::builtin("sonoma").unwrap()));
    }

    #[test]
    fn plants_follow_shade_moisture_and_sun() {
        assert_right(gradients(&Biome::builtin("sonoma").unwrap()));
    }

    #[test]
    fn gaps_and_edges_are_denser_than_closed_canopy() {
        assert_right(gap_dynamics(&Biome::builtin("sonoma").unwrap()));
    }

    #[test]
    fn competition_for_resources_clusters_more_than_circles_that_may_not_meet() {
        assert_right([clustering(&Biome::builtin("sonoma").unwrap())]);
    }
}
