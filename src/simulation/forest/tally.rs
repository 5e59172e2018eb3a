//! Figures of a forest's year: counts, basal areas and deaths by species.

use crate::plants::deadwood::{Cause, DownedLogKind, TimelineRow};
use crate::simulation::Community;
use crate::simulation::deadwood::Stock;
use crate::simulation::deadwood::snag::STUMP_M;
use crate::species::Biome;

/// Least stem that counts in basal areas. Peytavie et al. 2024, section 7.2: 7.5 cm.
pub const LEAST_DBH_M: f32 = 0.075;

/// Least height of live plants whose histories and growth are recorded: breast height.
pub const RECORDED_HEIGHT_M: f32 = 1.3;

/// Plants that came and went since a simulation began: what lives is the difference.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Tally {
    /// Plants that it began with.
    pub present: u64,
    /// Seedlings since.
    pub sprouted: u64,
    /// Deaths since.
    pub died: u64,
}

/// Seedlings and deaths of a year by species.
#[derive(Clone, Debug, Default)]
pub struct YearTally {
    pub sprouted: Vec<u32>,
    pub deaths: Vec<[u32; Cause::ALL.len()]>,
    /// Of trees alone.
    pub tree_deaths: Vec<[u32; Cause::ALL.len()]>,
}

impl YearTally {
    pub fn new(species: usize) -> Self {
        let none = vec![[0; Cause::ALL.len()]; species];
        Self { sprouted: vec![0; species], deaths: none.clone(), tree_deaths: none }
    }
}

/// The rows of a year, one a species.
pub fn rows(
    community: &Community,
    stock: &Stock,
    biome: &Biome,
    year: &YearTally,
) -> Vec<TimelineRow> {
    let hectares = f64::from(community.plot().area_m2()) / 10_000.0;
    let species = biome.species.len();
    let mut rows: Vec<TimelineRow> = (0..species)
        .map(|species| TimelineRow {
            year: community.year(),
            species: species as u16, // biomes have some dozens
            sprouted: year.sprouted[species],
            deaths: year.deaths[species],
            tree_deaths: year.tree_deaths[species],
            ..TimelineRow::default()
        })
        .collect();
    let mut areas_m2 = vec![[0.0_f64; 3]; species];
    let cross_section_m2 = |diameter_m: f32| {
        0.25 * std::f64::consts::PI * f64::from(diameter_m) * f64::from(diameter_m)
    };
    for (species, dbh_m) in community.species.iter().zip(&community.dbh_m) {
        let species = usize::from(*species);
        rows[species].live += 1;
        if *dbh_m >= LEAST_DBH_M {
            rows[species].live_trees += 1;
            areas_m2[species][0] += cross_section_m2(*dbh_m);
        }
    }
    for snag in &stock.snags {
        let species = usize::from(snag.species);
        rows[species].snags += 1;
        if snag.dbh_m >= LEAST_DBH_M && snag.height_m > STUMP_M {
            areas_m2[species][1] += cross_section_m2(snag.dbh_m);
        }
    }
    for downed_log in &stock.downed_logs {
        let species = usize::from(downed_log.species);
        rows[species].downed_logs += 1;
        if downed_log.kind != DownedLogKind::Branch && downed_log.diameter_base_m >= LEAST_DBH_M {
            areas_m2[species][2] += cross_section_m2(downed_log.diameter_base_m);
        }
    }
    for (row, areas_m2) in rows.iter_mut().zip(areas_m2) {
        [row.live_m2_ha, row.snag_m2_ha, row.downed_log_m2_ha] =
            areas_m2.map(|area_m2| (area_m2 / hectares) as f32);
    }
    rows
}
