//! A small forest through centuries of trouble: what holds whatever happens to it, and what each event does.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, OnceLock};

use proptest::prelude::*;

use super::run::{Forest, Site};
use super::state::{State, StateRef};
use crate::abiotics::{self, AbioticMaps};
use crate::math;
use crate::plants::deadwood::{Cause, DownedLogKind, LifeEvent, LifeEventKind};
use crate::plants::{Layer, Plants};
use crate::progress::Reporter;
use crate::raster::{MONTHS, MonthlyGrid};
use crate::rng::{self, Key, Process};
use crate::simulation::deadwood::decay::deathspan_years;
use crate::simulation::deadwood::{DecayParameters, DownedLog, Snag};
use crate::simulation::disturbance::fire::{self, FuelCell, FuelMap, Ignition, Wildfire};
use crate::simulation::disturbance::{Disease, Disturbance, Event, WindStorm};
use crate::simulation::traits::Traits;
use crate::simulation::{Parameters, Plot};
use crate::species::Biome;
use crate::terrain::Terrain;
use crate::terrain::generate::{self, GenerateParams};

const SIDE_M: f32 = 64.0;
const FIR: &str = "silver-fir";
const BEECH: &str = "european-beech";

struct Scene {
    terrain: Terrain,
    maps: AbioticMaps,
    biome: Biome,
}

/// A slope of 64 m that all tests stand on.
fn scene() -> &'static Scene {
    static SCENE: OnceLock<Scene> = OnceLock::new();
    SCENE.get_or_init(|| {
        let reporter = Reporter::silent();
        let params = GenerateParams {
            rows: 32,
            cols: 32,
            relief_m: 12.0,
            lowest_m: 1250.0,
            latitude_deg: 42.5,
            ..GenerateParams::default()
        };
        let terrain = generate::generate(&params, &reporter).unwrap();
        let biome = Biome::builtin("pyrenees").unwrap();
        let params = abiotics::Params::default();
        let maps = abiotics::run(&terrain, &biome.climate, &params, &reporter).unwrap();
        Scene { terrain, maps, biome }
    })
}

/// Bare ground on which seeds are strewn everywhere.
fn bare(seed: u64) -> Forest {
    bare_of(&scene().biome, seed)
}

fn bare_of(biome: &Biome, seed: u64) -> Forest {
    let Scene { terrain, maps, .. } = scene();
    let parameters = Parameters::peytavie2024();
    let plot = Plot::open(maps, &[false; 32 * 32], biome, &parameters);
    let site = Site { plot, elevation_m: &terrain.elevation_m, biome };
    Forest::new(site, parameters, DecayParameters::peytavie2024(), seed)
}

/// A stand of trees of these species, each 10 to 130 years old.
fn stand(seed: u64, species: &[&str], trees: u64) -> Forest {
    let Scene { terrain, biome, .. } = scene();
    let traits = Traits::of(biome, &Parameters::peytavie2024());
    let mut plants = Plants::default();
    for entity in 0..trees {
        let key = Key { seed, process: Process::StrewnPoints, year: 0, month: 0, entity };
        let [east, north, kind, age] = rng::uniforms(key);
        let species = species[(kind * species.len() as f32) as usize];
        let index = biome.species_index(species).unwrap();
        let age_years = 10.0 + 120.0 * age;
        let [height_m, crown_radius_m, dbh_m] = traits[index].envelope_size_m(age_years, 0.5);
        plants.id.push(entity);
        plants.species.push(index as u16);
        plants.layer.push(Layer::Canopy);
        plants.east_m.push(east * SIDE_M);
        plants.north_m.push(north * SIDE_M);
        plants.z_m.push(0.0);
        plants.height_m.push(height_m);
        plants.crown_radius_m.push(crown_radius_m);
        plants.dbh_m.push(dbh_m);
        plants.age_years.push(age_years);
        plants.vigor.push(0.5);
    }
    bare(seed).with_plants(&plants, terrain.elevation_m.frame())
}

fn mixed(seed: u64) -> Forest {
    stand(seed, &[FIR, BEECH, "sessile-oak", "mountain-pine"], 160)
}

fn event(year: u16, month: u8, what: Disturbance) -> Event {
    Event { year, month, what }
}

/// A storm that blows to the east.
fn storm(wind_east_m_s: f32) -> Disturbance {
    Disturbance::WindStorm(WindStorm { wind_east_m_s, wind_north_m_s: 0.0 })
}

fn wildfire() -> Disturbance {
    let ignition = Ignition { east_fraction: 0.5, north_fraction: 0.5, radius_m: 20.0 };
    let ignitions = vec![ignition];
    Disturbance::Wildfire(Wildfire { wind_east_m_s: 5.0, wind_north_m_s: 0.0, ignitions })
}

fn disease(species: &str) -> Disturbance {
    Disturbance::Disease(Disease {
        species: scene().biome.species_index(species).unwrap() as u16,
        east_fraction: 0.5,
        north_fraction: 0.5,
        spread_radius_m: 40.0,
        spread_probability_per_month: 0.5,
        severity_per_month: 0.5,
        contagious_months: 12,
        recovery_months: 18,
        immune_months: 12,
        first_infected_fraction: 0.5,
    })
}

/// Trouble of all kinds, some of it in one year.
fn script() -> Vec<Event> {
    vec![
        event(6, 3, disease(BEECH)),
        event(12, 2, storm(28.0)),
        event(20, 8, wildfire()),
        event(30, 1, disease(FIR)),
        event(30, 4, storm(26.0)),
        event(30, 9, wildfire()),
        event(45, 11, storm(35.0)),
        event(58, 2, storm(24.0)),
        event(58, 2, storm(32.0)),
    ]
}

fn live(forest: &mut Forest, events: &[Event], to_year: u16) {
    while forest.year() < to_year {
        let year = forest.year() + 1;
        let of_year: Vec<Event> = events.iter().filter(|e| e.year == year).cloned().collect();
        forest.live_a_year(&of_year);
    }
}

fn bytes(state: &StateRef<'_>) -> Vec<u8> {
    postcard::to_stdvec(state).unwrap()
}

fn in_threads<T: Send>(threads: usize, run: impl FnOnce() -> T + Send) -> T {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(run)
}

/// What decay and events leave as it was.
fn kept_of_snag(snag: &Snag) -> impl PartialEq + std::fmt::Debug + use<> {
    let place = [snag.east_m, snag.south_m];
    let size = [snag.height_at_death_m, snag.crown_radius_m, snag.dbh_m, snag.deathspan_years];
    (snag.species, place, size, snag.year, snag.cause)
}

fn kept_of_downed_log(downed_log: &DownedLog) -> DownedLog {
    DownedLog { decayed_years: 0.0, ..*downed_log }
}

/// Snags and downed logs only rot: nothing dead grows or moves.
fn assert_decay(before: &Forest, after: &Forest) {
    let stood: BTreeMap<u64, &Snag> = before.stock.snags.iter().map(|s| (s.id, s)).collect();
    for snag in &after.stock.snags {
        assert!((0.0..=1.0).contains(&snag.branch_fraction) && snag.height_m > 0.0);
        assert!(snag.height_m <= snag.height_at_death_m && !snag.is_gone());
        let Some(old) = stood.get(&snag.id) else {
            assert_eq!(snag.year, after.year(), "a snag without a death");
            continue;
        };
        assert_eq!(kept_of_snag(snag), kept_of_snag(old));
        assert!(snag.decayed_years >= old.decayed_years && snag.height_m <= old.height_m);
        assert!(snag.decay_class() >= old.decay_class());
        assert!(snag.branch_fraction <= old.branch_fraction);
    }
    let lay: BTreeMap<u64, &DownedLog> =
        before.stock.downed_logs.iter().map(|downed_log| (downed_log.id, downed_log)).collect();
    for downed_log in &after.stock.downed_logs {
        assert!(downed_log.length_m > 0.0 && !downed_log.is_gone());
        assert!(downed_log.diameter_tip_m <= downed_log.diameter_base_m);
        let Some(old) = lay.get(&downed_log.id) else {
            assert_eq!(downed_log.year, after.year(), "a downed log without a fall");
            continue;
        };
        assert_eq!(kept_of_downed_log(downed_log), kept_of_downed_log(old));
        assert!(downed_log.decayed_years >= old.decayed_years);
        assert!(downed_log.decay_class() >= old.decay_class());
    }
    let ids: BTreeSet<u64> =
        after.stock.downed_logs.iter().map(|downed_log| downed_log.id).collect();
    assert_eq!(ids.len(), after.stock.downed_logs.len(), "ids of downed logs are unique");
}

/// The last year of the timeline counts what is there.
fn assert_timeline(forest: &Forest) {
    let (community, stock) = (&forest.community, &forest.stock);
    let rows = || forest.timeline().iter().filter(|row| row.year == forest.year());
    assert_eq!(rows().count(), scene().biome.species.len());
    for row in rows() {
        let of = |species: u16| species == row.species;
        let live = community.species.iter().filter(|s| of(**s)).count();
        let snags = stock.snags.iter().filter(|snag| of(snag.species)).count();
        let downed_logs =
            stock.downed_logs.iter().filter(|downed_log| of(downed_log.species)).count();
        let found = [row.live, row.snags, row.downed_logs].map(|count| count as usize);
        assert_eq!(found, [live, snags, downed_logs], "{row:?}");
    }
}

/// Each plant's history runs forward, and after its death only its snag has one.
fn assert_history(events: &[LifeEvent]) {
    let mut of_plant: BTreeMap<u64, Vec<&LifeEvent>> = BTreeMap::new();
    events.iter().for_each(|event| of_plant.entry(event.plant_id).or_default().push(event));
    for events in of_plant.values() {
        assert!(events.is_sorted_by_key(|event| (event.year, event.month)), "{events:?}");
        let begins =
            |e: &&LifeEvent| matches!(e.kind, LifeEventKind::Present | LifeEventKind::Sprouted);
        assert!(begins(&events[0]) && !events[1..].iter().any(begins));
        let dies = |event: &&&LifeEvent| event.kind == LifeEventKind::Died;
        assert!(events.iter().filter(dies).count() <= 1, "{events:?}");
        for event in events.iter().skip_while(|event| !dies(event)).skip(1) {
            let is_of_snag =
                matches!(event.kind, LifeEventKind::SnagSnapped | LifeEventKind::SnagFell);
            assert!(is_of_snag, "{events:?}");
        }
    }
}

#[test]
fn no_plant_is_lost_and_nothing_dead_lives_or_grows() {
    let mut forest = mixed(1);
    let mut died: BTreeSet<u64> = BTreeSet::new();
    let mut kinds = BTreeSet::new();
    for _ in 0..70 {
        let before = forest.clone();
        let to_year = forest.year() + 1;
        live(&mut forest, &script(), to_year);
        let now: BTreeSet<u64> = forest.community.id.iter().copied().collect();
        assert_eq!(now.len(), forest.community.len(), "ids are unique");
        died.extend(before.community.id.iter().filter(|id| !now.contains(id)));
        assert!(died.is_disjoint(&now), "a dead plant lives again");
        let tally = forest.tally();
        assert_eq!(tally.present + tally.sprouted, forest.community.len() as u64 + tally.died);
        assert_eq!(tally.died, died.len() as u64);
        assert!(forest.stock.snags.iter().all(|snag| died.contains(&snag.id)));
        assert_decay(&before, &forest);
        assert_timeline(&forest);
        kinds.extend(
            forest.stock.downed_logs.iter().map(|downed_log| (downed_log.kind, downed_log.cause)),
        );
    }
    let timeline = forest.timeline().iter();
    let [mut sprouted, mut deaths] = [0_u64; 2];
    for row in timeline {
        sprouted += u64::from(row.sprouted);
        deaths += row.deaths.iter().map(|count| u64::from(*count)).sum::<u64>();
    }
    assert_eq!((sprouted, deaths), (forest.tally().sprouted, forest.tally().died));
    let histories = forest.life_histories();
    assert_history(&histories);
    // wherever wood comes from can be told
    let known: BTreeSet<u64> = (forest.history.iter().map(|event| event.plant_id))
        .chain(forest.stock.snags.iter().map(|snag| snag.id))
        .chain(forest.community.id.iter().copied())
        .collect();
    assert!(
        forest.stock.downed_logs.iter().all(|downed_log| known.contains(&downed_log.parent_id))
    );
    // and there was something to hold to all this
    assert!(forest.stock.snags.len() > 30 && forest.stock.downed_logs.len() > 30);
    assert!(forest.burnt_m2().len() == 2 && forest.burnt_m2()[0].1 > 1000.0);
    let happened: BTreeSet<LifeEventKind> = forest.history.iter().map(|event| event.kind).collect();
    let missing = LifeEventKind::ALL[2..11].iter().filter(|kind| !happened.contains(kind));
    assert_eq!(missing.collect::<Vec<_>>(), [] as [&LifeEventKind; 0]);
    assert!(DownedLogKind::ALL.iter().all(|kind| kinds.iter().any(|(k, _)| k == kind)));
}

#[test]
fn any_number_of_threads_ages_a_forest_to_the_same_bits() {
    let run = |threads: usize| {
        in_threads(threads, || {
            let mut forest = mixed(2);
            live(&mut forest, &script(), 40);
            bytes(&forest.state())
        })
    };
    let (one, three) = (run(1), run(3));
    assert!(one.len() > 10_000 && one == three);
}

#[test]
fn a_stored_forest_goes_on_as_if_it_had_not_stopped() {
    // in the second year of a disease
    let events = [event(14, 6, disease(FIR)), event(20, 8, wildfire()), event(25, 1, storm(27.0))];
    let mut at_once = mixed(3);
    live(&mut at_once, &events, 30);
    let mut first = mixed(3);
    live(&mut first, &events, 15);
    assert!(!first.outbreaks.is_empty());
    let stored: State = postcard::from_bytes(&bytes(&first.state())).unwrap();
    let mut second = bare(3);
    assert!(second.set_state(stored));
    live(&mut second, &events, 30);
    assert!(bytes(&at_once.state()) == bytes(&second.state()));
}

/// Long downed logs of class 3 or 1 from west to east, 4 m apart, that outlast the test.
fn lay_logs(forest: &mut Forest, decayed_fraction: f32) -> Vec<bool> {
    let [rows, cols] = [forest.community.plot().rows, forest.community.plot().cols];
    let mut cells = vec![false; rows * cols];
    for number in 0..15 {
        let downed_log = DownedLog {
            id: 1_000_000 + number,
            parent_id: 1,
            species: 0,
            kind: DownedLogKind::Trunk,
            east_m: 0.0,
            south_m: 2.1 + 4.0 * number as f32,
            length_m: SIDE_M,
            diameter_base_m: 0.5,
            diameter_tip_m: 0.5,
            azimuth_rad: std::f32::consts::FRAC_PI_2,
            decayed_years: 1e6 * decayed_fraction,
            deathspan_years: 1e6,
            year: 0,
            cause: Cause::Age,
        };
        downed_log.cells([rows, cols], 0.5, |row, col| cells[row * cols + col] = true);
        forest.stock.downed_logs.push(downed_log);
    }
    forest.mark_downed_logs();
    cells
}

/// Seedlings of each species on downed logs and off them, summed over some young forests, and the area of both in m².
fn seedlings(biome: &Biome, decayed_fraction: f32) -> [(Vec<f32>, f32); 2] {
    let species = biome.species.len();
    let mut sums = [(vec![0.0; species], 0.0), (vec![0.0; species], 0.0)];
    for seed in 0..20 {
        let mut forest = bare_of(biome, seed);
        let cells = lay_logs(&mut forest, decayed_fraction);
        let plot = forest.community.plot();
        let (cols, cell_m) = (plot.cols, plot.cell_m);
        for _ in 0..4 {
            forest.live_a_year(&[]);
            let community = &forest.community;
            for plant in 0..community.len() {
                if community.year_of_sprouting(community.id[plant]) == forest.year() {
                    let [row, col] = [community.south_m[plant], community.east_m[plant]]
                        .map(|at_m| (at_m / cell_m) as usize);
                    let on = usize::from(!cells[row * cols + col]);
                    sums[on].0[usize::from(community.species[plant])] += 1.0;
                }
            }
            let on = cells.iter().filter(|is_on| **is_on).count();
            sums[0].1 += on as f32 * cell_m * cell_m;
            sums[1].1 += (cells.len() - on) as f32 * cell_m * cell_m;
        }
    }
    sums
}

#[test]
fn decaying_logs_nurse_seedlings_and_the_more_those_that_like_them() {
    let ratio = |[on, off]: &[(Vec<f32>, f32); 2]| {
        let per_m2 = |(counts, area_m2): &(Vec<f32>, f32)| counts.iter().sum::<f32>() / area_m2;
        per_m2(on) / per_m2(off)
    };
    // 0.0279 over 0.005; α only shares out
    let biome = &scene().biome;
    let decaying = ratio(&seedlings(biome, 0.45));
    assert!((decaying / 5.58 - 1.0).abs() < 0.1, "{decaying}");
    let sound = ratio(&seedlings(biome, 0.05));
    assert!((sound - 1.0).abs() < 0.1, "{sound}");
    // of two that are alike but for α, off downed logs both sprout as often, on them as α says
    let [beech, oak] = [BEECH, "sessile-oak"].map(|key| biome.species_index(key).unwrap());
    let mut alike = biome.clone();
    let alpha = alike.species[oak].decay.log_seeding_multiplier;
    alike.species[oak] = biome.species[beech].clone();
    alike.species[oak].decay.log_seeding_multiplier = alpha;
    let expected_on = alpha / (alpha + biome.species[beech].decay.log_seeding_multiplier);
    assert!(expected_on > 0.9);
    for ((counts, _), expected) in seedlings(&alike, 0.45).iter().zip([expected_on, 0.5]) {
        let both = counts[oak] + counts[beech];
        let error = 4.0 * (expected * (1.0 - expected) / both).sqrt();
        assert!(both > 500.0 && (counts[oak] / both - expected).abs() < error, "{counts:?}");
    }
}

#[test]
fn downed_logs_feed_fires() {
    let mut forest = stand(4, &[FIR, BEECH], 12);
    live(&mut forest, &[], 2);
    let without = forest.fuel(8);
    lay_logs(&mut forest, 0.05);
    let with = forest.fuel(8);
    assert!(with.iter().zip(&without).all(|(a, b)| a.density_fraction >= b.density_fraction));
    let burnt = |cells: &[FuelCell]| {
        // as wet, and as high: what differs is how much there is
        let cells: Vec<FuelCell> = (cells.iter())
            .map(|cell| FuelCell { moisture_percent: 15.0, height_m: 2.0, ..*cell })
            .collect();
        let map = FuelMap {
            rows: forest.ground.rows,
            cols: forest.ground.cols,
            cell_m: forest.ground.cell_m,
            first_east: 0,
            first_south: 0,
            elevation_m: &forest.ground.elevation_m,
            cells: &cells,
        };
        let Disturbance::Wildfire(fire) = wildfire() else { unreachable!() };
        let cells = (0..20).map(|seed| fire::burn(&map, &fire, seed, 1, 8));
        cells.map(|burnt| burnt.iter().filter(|burnt| **burnt).count()).sum::<usize>()
    };
    let (fed, unfed) = (burnt(&with), burnt(&without));
    assert!(fed as f32 > 1.2 * unfed as f32, "{fed} {unfed}");
}

/// Length of the mean of unit vectors: 1 where all point one way, near 0 where they point anywhere.
fn alignment(azimuths_rad: &[f32]) -> f32 {
    let mean = |of: fn(f32) -> f32| {
        azimuths_rad.iter().map(|azimuth| of(*azimuth)).sum::<f32>() / azimuths_rad.len() as f32
    };
    let (east, north) = (mean(math::sin), mean(math::cos));
    (east * east + north * north).sqrt()
}

#[test]
fn a_storm_throws_trees_downwind_in_its_month() {
    let mut forest = stand(5, &[FIR, BEECH], 200);
    let before = forest.clone();
    forest.live_a_year(&[event(1, 11, storm(45.0))]);
    let downed_logs = &forest.stock.downed_logs;
    let stems: Vec<&DownedLog> = (downed_logs.iter())
        .filter(|downed_log| {
            downed_log.kind != DownedLogKind::Branch && downed_log.cause == Cause::Storm
        })
        .collect();
    assert!(stems.len() > 30, "{}", stems.len());
    for stem in &stems {
        // to the east, within the gusts' sector and what trunks turn stems aside
        let aside_rad = (stem.azimuth_rad - std::f32::consts::FRAC_PI_2).abs();
        assert!(aside_rad < 0.35 + 0.6 + 1e-3, "{aside_rad}");
        let died = |e: &&LifeEvent| e.plant_id == stem.parent_id && e.kind == LifeEventKind::Died;
        let death = forest.history.iter().find(died).unwrap();
        assert_eq!((death.year, death.month, death.cause), (1, 11, Cause::Storm));
        let is_snag = forest.stock.snags.iter().any(|snag| snag.id == stem.parent_id);
        assert_eq!(is_snag, stem.kind == DownedLogKind::Top, "an uprooted tree stands no more");
        let tree = before.community.id.iter().position(|id| *id == stem.parent_id).unwrap();
        assert!(before.community.height_m[tree] >= 3.0);
    }
    let uprooted: Vec<u64> = (stems.iter())
        .filter(|stem| stem.kind == DownedLogKind::Uprooted)
        .map(|stem| stem.parent_id)
        .collect();
    assert!(!uprooted.is_empty());
    let of_storm: Vec<f32> = stems.iter().map(|stem| stem.azimuth_rad).collect();
    assert!(alignment(&of_storm) > 0.85, "{}", alignment(&of_storm));
}

#[test]
fn stems_of_decay_fall_any_way_but_rarely_across_trunks() {
    let mut forest = stand(6, &[FIR, BEECH], 300);
    let (mut azimuths_rad, mut crossed, mut by_chance, mut seen) = (vec![], 0, 0, BTreeSet::new());
    for _ in 0..50 {
        // trunks as the year's falls find them
        let trunks = forest.standing_trunks();
        forest.live_a_year(&[]);
        for stem in &forest.stock.downed_logs {
            if stem.kind == DownedLogKind::Branch || !seen.insert(stem.id) {
                continue;
            }
            azimuths_rad.push(stem.azimuth_rad);
            let at = [stem.east_m, stem.south_m];
            let across =
                |azimuth_rad| trunks.crossed(stem.parent_id, at, azimuth_rad, stem.length_m);
            crossed += across(stem.azimuth_rad);
            let turns = (0..16).map(|turn| turn as f32 * std::f32::consts::TAU / 16.0);
            by_chance += turns.map(across).sum::<usize>();
        }
    }
    assert!(azimuths_rad.len() > 60, "{}", azimuths_rad.len());
    assert!(alignment(&azimuths_rad) < 0.45, "{}", alignment(&azimuths_rad));
    assert!(3 * 16 * crossed < by_chance, "{crossed} of {} by chance", by_chance / 16);
}

fn deaths(forest: &Forest, cause: Cause) -> u32 {
    forest.timeline().iter().map(|row| row.deaths[cause as usize]).sum()
}

#[test]
fn drought_kills_and_is_named() {
    let Scene { terrain, maps, .. } = scene();
    let mut usual = mixed(7);
    let mut dry = usual.clone();
    let (frame, mask) = (terrain.elevation_m.frame(), maps.moisture_mm.mask());
    let months = std::array::from_fn(|month| {
        maps.moisture_mm.month(month).iter().map(|mm| 0.15 * mm).collect()
    });
    let moisture_mm = MonthlyGrid::new(Arc::clone(frame), Arc::clone(mask), months);
    dry.set_moisture(frame, &moisture_mm, [0.3; MONTHS]);
    live(&mut usual, &[], 4);
    live(&mut dry, &[], 4);
    let trees = |forest: &Forest| forest.community.id.iter().filter(|id| **id < 160).count();
    assert!(dry.tally().died > usual.tally().died);
    assert!(trees(&dry) + 10 < trees(&usual), "{} {}", trees(&dry), trees(&usual));
    assert_eq!((deaths(&usual, Cause::Drought), deaths(&dry, Cause::Competition)), (0, 0));
    assert!(deaths(&dry, Cause::Drought) > 20, "{}", deaths(&dry, Cause::Drought));
    let parched = |forest: &Forest| {
        let of = forest.history().iter().filter(|event| event.kind == LifeEventKind::Parched);
        of.map(|event| event.severity).collect::<Vec<_>>()
    };
    assert!(parched(&usual).is_empty() && parched(&dry).len() > 10);
    assert!(parched(&dry).iter().all(|severity| (0.5..=1.0).contains(severity)));
    // the rain comes back
    dry.set_moisture(frame, &maps.moisture_mm, [1.0; MONTHS]);
    let before = deaths(&dry, Cause::Drought);
    dry.live_a_year(&[]);
    assert_eq!(deaths(&dry, Cause::Drought), before);
}

#[test]
fn disease_kills_its_species_and_is_named() {
    let mut well = mixed(8);
    let mut ill = well.clone();
    live(&mut well, &[], 4);
    live(&mut ill, &[event(1, 4, disease(FIR))], 4);
    let fir = scene().biome.species_index(FIR).unwrap();
    let of_disease = |species: usize| {
        let rows = ill.timeline().iter().filter(|row| usize::from(row.species) == species);
        rows.map(|row| row.deaths[Cause::Disease as usize]).sum::<u32>()
    };
    assert_eq!(deaths(&well, Cause::Disease), 0);
    assert!(of_disease(fir) > 5, "{}", of_disease(fir));
    assert_eq!(deaths(&ill, Cause::Disease), of_disease(fir));
    let died = |e: &&LifeEvent| e.kind == LifeEventKind::Died && e.cause == Cause::Disease;
    for death in ill.history.iter().filter(died) {
        // whoever is as high as a breast was seen to fall ill
        let fell_ill = |e: &LifeEvent| {
            e.plant_id == death.plant_id
                && e.kind == LifeEventKind::Infected
                && e.year <= death.year
        };
        let snag = ill.stock.snags.iter().find(|snag| snag.id == death.plant_id).unwrap();
        assert!(snag.height_at_death_m < 1.5 || ill.history.iter().any(fell_ill));
    }
}

proptest! {
    #[test]
    fn wood_only_loses_density_and_thicker_wood_lasts_longer(
        diameter_m in 0.001_f32..2.0,
        thicker_m in 0.0_f32..1.0,
        species in 0..7_usize,
        steps in proptest::collection::vec(0.0_f32..5.0, 1..40),
    ) {
        let species = &scene().biome.species[species];
        let full_years = deathspan_years(species.decay.deathspan_years, diameter_m);
        let thicker = deathspan_years(species.decay.deathspan_years, diameter_m + thicker_m);
        prop_assert!(full_years > 0.0 && thicker >= full_years);
        let mut downed_log = DownedLog {
            id: 0,
            parent_id: 0,
            species: 0,
            kind: DownedLogKind::Trunk,
            east_m: 0.0,
            south_m: 0.0,
            length_m: 5.0,
            diameter_base_m: diameter_m,
            diameter_tip_m: 0.2 * diameter_m,
            azimuth_rad: 0.0,
            decayed_years: 0.0,
            deathspan_years: full_years,
            year: 0,
            cause: Cause::Decay,
        };
        let (mut density, mut class) = (downed_log.density_fraction(), downed_log.decay_class());
        prop_assert_eq!((density, class), (1.0, 1));
        for years in steps {
            downed_log.age(years);
            prop_assert!(downed_log.density_fraction() <= density && downed_log.decay_class() >= class);
            (density, class) = (downed_log.density_fraction(), downed_log.decay_class());
            prop_assert!((0.0..=1.0).contains(&density) && (1..=5).contains(&class));
        }
        prop_assert_eq!(downed_log.is_gone(), density == 0.0);
    }
}

#[test]
fn trees_that_stand_in_a_canopy_live_where_they_stand() {
    let starved = |forest: &mut Forest| {
        live(forest, &[], 6);
        let died = |e: &&LifeEvent| e.kind == LifeEventKind::Died && e.cause == Cause::Competition;
        forest.history().iter().filter(died).filter(|e| e.plant_id < 600).count()
    };
    // pines of the open beneath beeches
    let mut acclimated = stand(3, &["mountain-pine", BEECH], 600);
    let mut plain = acclimated.clone();
    plain.community.acclimation.fill(0.0);
    assert!(acclimated.community.acclimation.iter().any(|bonus| *bonus > 0.0));
    let [acclimated, plain] = [&mut acclimated, &mut plain].map(starved);
    assert!(plain > 20 && 5 * acclimated < plain, "{acclimated} and {plain}");
}
