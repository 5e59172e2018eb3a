//! Lives through years of a whole forest on a terrain from bare ground, and prints its figures:
//! `forest_years DEM BIOME YEARS [EVENTS]`; BIOME is a name or a file like those of `species/`.

use std::error::Error;
use std::path::PathBuf;
use std::time::Instant;

use wildwood::abiotics;
use wildwood::pipeline::import::{self, ImportRequest};
use wildwood::progress::Reporter;
use wildwood::simulation::deadwood::DecayParameters;
use wildwood::simulation::disturbance::schedule;
use wildwood::simulation::forest::{Forest, Site};
use wildwood::simulation::{Parameters, Plot};
use wildwood::species::Biome;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (dem, biome, years) = match arguments.as_slice() {
        [dem, biome, years, ..] => (dem, biome, years.parse::<u16>()?),
        _ => return Err("usage: forest_years DEM BIOME YEARS [EVENTS]".into()),
    };
    let reporter = Reporter::silent();
    let biome = if biome.ends_with(".toml") {
        Biome::from_toml(&std::fs::read_to_string(biome)?)?
    } else {
        Biome::builtin(biome)?
    };
    let request = ImportRequest {
        biome: biome.key.clone(),
        ..ImportRequest::new(vec![PathBuf::from(dem)], PathBuf::from("unused"))
    };
    let terrain = import::read_terrain(&request, &reporter)?.terrain;
    let maps = abiotics::run(&terrain, &biome.climate, &request.abiotics, &reporter)?;
    let keys: Vec<String> = biome.species.iter().map(|s| s.key.clone()).collect();
    let events = match arguments.get(3) {
        Some(path) => {
            let script = schedule::parse_within(&std::fs::read_to_string(path)?, &keys, years)?;
            schedule::drawn(&script, years, 1)
        }
        None => Vec::new(),
    };
    let parameters = Parameters::forest(&biome);
    let barren = maps.river.values().to_vec();
    let plot = Plot::open(&maps, &barren, &biome, &parameters);
    println!("{} cells, {} bytes a cell", plot.cells(), plot.bytes() as f64 / plot.cells() as f64);
    let site = Site { plot, elevation_m: &terrain.elevation_m, biome: &biome };
    let env = |name: &str, default: f32| {
        std::env::var(name).ok().and_then(|v| v.parse::<f32>().ok()).unwrap_or(default)
    };
    let mut decay = DecayParameters::peytavie2024();
    decay.snag_years_per_year = env("SNAG", decay.snag_years_per_year);
    decay.downed_log_years_per_year = env("LOG", decay.downed_log_years_per_year);
    let mut parameters = parameters;
    parameters.survivors_fraction = env("SURV", parameters.survivors_fraction);
    let mut forest = Forest::new(site, parameters, decay, 1);
    let start = Instant::now();
    let mut lap = Instant::now();
    println!(
        "year live trees>7.5 snags logs | m2/ha live snag log | snag/standing snag/dead | {}",
        keys.join(" ")
    );
    let mut rain = vec![1.0_f32; 12 * usize::from(years) + 2400];
    for event in &events {
        if let wildwood::simulation::disturbance::Disturbance::Drought(drought) = &event.what {
            let first = 12 * (usize::from(event.year) - 1) + usize::from(event.month) - 1;
            for (month, f) in (first..).zip(&drought.rain_fractions) {
                rain[month] = *f;
            }
        }
    }
    let mut weather = [1.0; 12];
    for year in 1..=years {
        let of_rain: [f32; 12] = std::array::from_fn(|m| rain[12 * (usize::from(year) - 1) + m]);
        if of_rain != weather {
            let mut climate = biome.climate.clone();
            climate.rain_mm.iter_mut().zip(of_rain).for_each(|(mm, f)| *mm *= f);
            let moisture =
                abiotics::moisture_of(&terrain, &maps, &climate, &request.abiotics, &reporter)?;
            forest.set_moisture(terrain.elevation_m.frame(), &moisture, of_rain);
            weather = of_rain;
        }
        let of_year: Vec<_> = events.iter().filter(|e| e.year == year).cloned().collect();
        forest.live_a_year(&of_year);
        if year % 25 == 0 || year == years || !of_year.is_empty() {
            let rows: Vec<_> = forest.timeline().iter().filter(|r| r.year == year).collect();
            let sum = |f: fn(&wildwood::plants::deadwood::TimelineRow) -> f32| {
                rows.iter().map(|r| f(r)).sum::<f32>()
            };
            let (live, snag, log) =
                (sum(|r| r.live_m2_ha), sum(|r| r.snag_m2_ha), sum(|r| r.downed_log_m2_ha));
            let by: Vec<String> =
                rows.iter().map(|r| format!("{:.1}/{}", r.live_m2_ha, r.live)).collect();
            let deaths: Vec<u32> = (0..8).map(|c| rows.iter().map(|r| r.deaths[c]).sum()).collect();
            println!(
                "{year} {} {} {} {} | {live:.1} {snag:.1} {log:.1} | {:.3} {:.3} | {} | {deaths:?} {:.3}s/yr",
                forest.community().len(),
                sum(|r| r.live_trees as f32),
                forest.stock().snags.len(),
                forest.stock().downed_logs.len(),
                snag / (snag + live),
                snag / (snag + log),
                by.join(" "),
                lap.elapsed().as_secs_f64() / 25.0,
            );
            lap = Instant::now();
        }
    }
    let mut ill = vec![0; usize::from(years) + 1];
    for event in forest.history() {
        if event.kind == wildwood::plants::deadwood::LifeEventKind::Infected {
            ill[usize::from(event.year)] += 1;
        }
    }
    println!("infected {:?}", ill.iter().enumerate().filter(|(_, n)| **n > 0).collect::<Vec<_>>());
    println!("{:?} burnt {:?}", start.elapsed(), forest.burnt_m2());
    println!(
        "{:?}, plant bytes {}",
        forest.tally(),
        forest.community().plant_bytes() / forest.community().len().max(1)
    );
    Ok(())
}
