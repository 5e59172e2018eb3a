//! Validation on Gresolet: what centuries bring about on the paper's own terrain, beside what the paper and the inventory say.
//!
//! # Reference
//! Peytavie et al. 2024, section 7.2, Figs. 13, 21, 27, doi:10.1145/3641816; PAPER_NOTES §10.

use std::fs;
use std::path::{Path, PathBuf};

use super::Error;
use super::age::Ground;
use super::age_files;
use super::import::{self, ImportRequest};
use crate::export::{preview, timeline};
use crate::plants::deadwood::{LifeEvent, LifeEventKind, TimelineRow};
use crate::progress::Reporter;
use crate::raster::MONTHS;
use crate::simulation::Parameters;
use crate::simulation::deadwood::DecayParameters;
use crate::simulation::disturbance::schedule;
use crate::simulation::disturbance::{Disturbance, Event};
use crate::simulation::ecology::Finding;
use crate::simulation::forest::Forest;
use crate::simulation::plot::GroundCell;
use crate::species::Biome;

/// Terrain in the folder.
pub const TERRAIN_FILE: &str = "heightfield.elv";
/// Script in the folder.
pub const SCRIPT_FILE: &str = "scriptedEvents_full.txt";
/// Years simulated. Peytavie et al. 2024, section 7.2.
const YEARS: u16 = 800;
/// Year from which a forest is mature (there).
const MATURE_YEAR: u16 = 500;
const SEED: u64 = 1;

/// All findings; pictures of both timelines go to a folder, if one is given.
///
/// # Errors
/// Missing data, a full disk, a cancelled run.
pub fn run(
    data: &Path,
    pictures: Option<&PathBuf>,
    reporter: &Reporter,
) -> Result<Vec<Finding>, Error> {
    // told now, not after minutes
    if let Some(file) = pictures.filter(|path| path.exists() && !path.is_dir()) {
        let what = format!("{}: is a file; name a folder with --pictures", file.display());
        return Err(Error::Usage { what });
    }
    let biome = Biome::builtin("pyrenees")?;
    let request = ImportRequest {
        biome: biome.key.clone(),
        ..ImportRequest::new(vec![data.join(TERRAIN_FILE)], PathBuf::new())
    };
    let terrain = import::read_terrain(&request, reporter)?.terrain;
    let ground = Ground::of(terrain, biome, reporter)?;
    let biome = &ground.biome;
    let path = data.join(SCRIPT_FILE);
    let text = fs::read_to_string(&path)
        .map_err(|e| Error::Usage { what: format!("{}: {e}", path.display()) })?;
    let keys: Vec<String> = biome.species.iter().map(|species| species.key.clone()).collect();
    let script = schedule::parse_within(&text, &keys, YEARS)
        .map_err(|e| Error::Usage { what: format!("{}: {e}", path.display()) })?;
    let scripted = schedule::drawn(&script, YEARS, SEED);

    let bare =
        ground.bare_forest(Parameters::forest(biome), DecayParameters::peytavie2024(), SEED)?;
    let stage = reporter.stage("Gresolet", u64::from(YEARS) * 2);
    let advance = |years: u16| stage.advance(u64::from(years));
    let live = |forest: &mut Forest, events: &[Event], to: u16| {
        ground.live(forest, events, to, reporter, &mut |_| {
            advance(1);
            Ok(reporter.check_cancelled()?)
        })
    };
    let (drought, fire) = drought_and_fire(&scripted)?;
    let mut undisturbed = bare.clone();
    live(&mut undisturbed, &[], fire.year.saturating_sub(3))?;
    // the same forest burns, once after a drought
    let burnt_m2 = [vec![fire.clone()], vec![drought, fire.clone()]].map(|events| {
        let mut forest = undisturbed.clone();
        let lived = ground.live(&mut forest, &events, fire.year, reporter, &mut |_| Ok(()));
        lived.map(|()| forest.burnt_m2().last().map_or(0.0, |(_, m2)| f64::from(*m2)))
    });
    let [plain_m2, dry_m2] = burnt_m2;
    live(&mut undisturbed, &[], YEARS)?;
    let mut disturbed = bare;
    live(&mut disturbed, &scripted, YEARS)?;

    if let Some(folder) = pictures {
        fs::create_dir_all(folder)
            .map_err(|e| Error::Failed { what: format!("{}: {e}", folder.display()) })?;
        for (name, forest, events) in [
            ("timeline_undisturbed.png", &undisturbed, &[][..]),
            ("timeline_scripted.png", &disturbed, &scripted[..]),
        ] {
            let picture =
                timeline::timeline(forest.timeline(), biome, &age_files::marks(events, biome));
            let png =
                preview::encode_png(&picture).map_err(|e| Error::Failed { what: e.to_string() })?;
            crate::scene::write_beside(&folder.join(name), &png)?;
        }
    }
    let mut findings = of_undisturbed(&undisturbed, biome);
    findings.extend(by_place(&undisturbed, biome));
    findings.extend(of_storms(&disturbed, &scripted));
    findings.extend(of_disease(&disturbed, &scripted));
    findings.push(Finding {
        name: "Gresolet, fire: area burnt after a drought over the like without (paper: 41 against 11 ha)",
        value: dry_m2? / plain_m2?.max(1.0),
        low: 2.0,
        high: f64::INFINITY,
    });
    Ok(findings)
}

/// The script's drought that ends in a fire, and that fire.
fn drought_and_fire(events: &[Event]) -> Result<(Event, Event), Error> {
    let fire = events.iter().find(|event| matches!(event.what, Disturbance::Wildfire(_)));
    let drought = fire.and_then(|fire| {
        let is_before = |event: &&Event| {
            matches!(event.what, Disturbance::Drought(_))
                && (fire.year.saturating_sub(2)..=fire.year).contains(&event.year)
        };
        events.iter().find(is_before)
    });
    match (drought, fire) {
        (Some(drought), Some(fire)) => Ok((drought.clone(), fire.clone())),
        _ => Err(Error::Usage {
            what: format!("{SCRIPT_FILE}: has no fire within two years of a drought"),
        }),
    }
}

/// Sum of a measure over a year's rows.
fn sum(forest: &Forest, year: u16, of: impl Fn(&TimelineRow) -> f32) -> f64 {
    forest.timeline().iter().filter(|row| row.year == year).map(|row| f64::from(of(row))).sum()
}

fn of_species(forest: &Forest, biome: &Biome, key: &str, year: u16) -> f64 {
    let species = biome.species_index(key);
    sum(
        forest,
        year,
        |row| {
            if Some(usize::from(row.species)) == species { row.live_m2_ha } else { 0.0 }
        },
    )
}

/// Basal areas, deadwood and succession without disturbance.
fn of_undisturbed(forest: &Forest, biome: &Biome) -> Vec<Finding> {
    let finding = |name, value, low, high| Finding { name, value, low, high };
    let mean = |of: &dyn Fn(u16) -> f64| {
        let years = MATURE_YEAR..=YEARS;
        let count = f64::from(YEARS - MATURE_YEAR + 1);
        years.map(of).sum::<f64>() / count
    };
    let [live, snags, downed_logs]: [&dyn Fn(u16) -> f64; 3] = [
        &|year| sum(forest, year, |row| row.live_m2_ha),
        &|year| sum(forest, year, |row| row.snag_m2_ha),
        &|year| sum(forest, year, |row| row.downed_log_m2_ha),
    ];
    let of = |key: &str, year: u16| of_species(forest, biome, key, year);
    let ratio = |a: f64, b: f64| a / b.max(1e-9);
    vec![
        finding(
            "Gresolet: snags' share of standing basal area, years 500–800 (paper: 0.112)",
            mean(&|year| ratio(snags(year), snags(year) + live(year))),
            0.08,
            0.12,
        ),
        finding(
            "Gresolet: snags' share of deadwood, years 500–800 (paper: 0.25)",
            mean(&|year| ratio(snags(year), snags(year) + downed_logs(year))),
            0.2,
            0.4,
        ),
        finding(
            "Gresolet: live basal area in year 800, m²/ha (paper: 35.8, inventory: 41.7)",
            live(YEARS),
            25.0,
            45.0,
        ),
        finding(
            "Gresolet: pine over beech in year 800 (paper: 12.7 over 12.3)",
            ratio(of("mountain-pine", YEARS), of("european-beech", YEARS)),
            0.67,
            1.5,
        ),
        finding(
            "Gresolet: beech over fir in year 800 (paper: 12.3 over 6.4)",
            ratio(of("european-beech", YEARS), of("silver-fir", YEARS)),
            1.33,
            3.0,
        ),
        finding(
            "Gresolet, succession: fir over beech in year 100",
            ratio(of("silver-fir", 100), of("european-beech", 100)),
            1.0,
            f64::INFINITY,
        ),
        finding(
            "Gresolet, succession: beech over pine in year 200",
            ratio(of("european-beech", 200), of("mountain-pine", 200)),
            1.0,
            f64::INFINITY,
        ),
        finding(
            "Gresolet, succession: pine over beech in years 700–800",
            (700..=800).map(|year| of("mountain-pine", year)).sum::<f64>()
                / (700..=800).map(|year| of("european-beech", year)).sum::<f64>(),
            1.0,
            f64::INFINITY,
        ),
    ]
}

/// Where species stand (Fig. 21): beech in the moist valley, pine on the slopes.
fn by_place(forest: &Forest, biome: &Biome) -> Vec<Finding> {
    let community = forest.community();
    let plot = community.plot();
    let mean = |key: &str, of: fn(&GroundCell) -> f64| {
        let species = biome.species_index(key);
        let (mut total, mut weight) = (0.0, 0.0);
        for plant in 0..community.len() {
            if Some(usize::from(community.species[plant])) == species {
                let area = f64::from(community.dbh_m[plant]) * f64::from(community.dbh_m[plant]);
                total +=
                    area * of(plot.ground_at(community.east_m[plant], community.south_m[plant]));
                weight += area;
            }
        }
        total / f64::max(weight, 1e-9)
    };
    let moisture_mm =
        |ground: &GroundCell| f64::from(ground.moisture_mm.iter().sum::<f32>()) / MONTHS as f64;
    let slope = |ground: &GroundCell| f64::from(ground.slope_rad);
    vec![
        Finding {
            name: "Gresolet, places: soil water under beech over that under pine, by basal area (Fig. 21)",
            value: mean("european-beech", moisture_mm) / mean("mountain-pine", moisture_mm),
            low: 1.2,
            high: f64::INFINITY,
        },
        Finding {
            name: "Gresolet, places: slope under pine over that under beech, by basal area (Fig. 21)",
            value: mean("mountain-pine", slope) / mean("european-beech", slope),
            low: 1.05,
            high: f64::INFINITY,
        },
    ]
}

/// Deadwood after the script's storms: much at once, and again as what was left standing falls.
fn of_storms(forest: &Forest, events: &[Event]) -> Vec<Finding> {
    let storms = events.iter().filter(|event| matches!(event.what, Disturbance::WindStorm(_)));
    let storms: Vec<u16> = storms.map(|event| event.year).collect();
    let downed = |year: u16| sum(forest, year, |row| row.downed_log_m2_ha);
    let mean = |of: &dyn Fn(u16) -> f64| {
        storms.iter().map(|year| of(*year)).sum::<f64>() / storms.len().max(1) as f64
    };
    vec![
        Finding {
            name: "Gresolet, storms: downed logs after over before, mean of three",
            value: mean(&|year| downed(year) / downed(year - 1)),
            low: 1.3,
            high: f64::INFINITY,
        },
        Finding {
            name: "Gresolet, storms: downed logs at their most 5–12 years after over 2 years after, mean of three",
            value: mean(&|year| {
                (year + 5..=year + 12).map(downed).fold(0.0, f64::max) / downed(year + 2)
            }),
            low: 1.02,
            high: f64::INFINITY,
        },
    ]
}

/// The script's disease: a first wave, smaller ones, a level.
fn of_disease(forest: &Forest, events: &[Event]) -> Vec<Finding> {
    let first = events.iter().find(|event| matches!(event.what, Disturbance::Disease(_)));
    let Some(first) = first.map(|event| event.year) else { return Vec::new() };
    let infected = |years: std::ops::Range<u16>| {
        let of = |event: &&LifeEvent| {
            event.kind == LifeEventKind::Infected && years.contains(&event.year)
        };
        forest.history().iter().filter(of).count() as f64 / years.len() as f64
    };
    let wave = infected(first..first + 1);
    let late: Vec<f64> = (first + 50..first + 90).map(|year| infected(year..year + 1)).collect();
    let level = late.iter().sum::<f64>() / late.len() as f64;
    let swing = late.iter().map(|year| (year - level).abs()).sum::<f64>() / late.len() as f64;
    vec![
        Finding {
            name: "Gresolet, disease: infections a year, 50–90 years after the outbreak, over the first year's",
            value: level / wave.max(1.0),
            low: 0.05,
            high: 0.8,
        },
        Finding {
            name: "Gresolet, disease: mean swing of those years about their level (Fig. 13: waves damp)",
            value: swing / level.max(1e-9),
            low: 0.0,
            high: 0.3,
        },
    ]
}
