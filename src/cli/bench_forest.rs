//! Workloads of whole forests: a year of them, young, old, and on larger ground.

use std::path::{Path, PathBuf};
use std::time::Instant;

use serde_json::{Value, json};

use crate::abiotics;
use crate::pipeline::Error;
use crate::pipeline::import::{self, ImportRequest};
use crate::plants::Plants;
use crate::progress::Reporter;
use crate::raster::{Frame, Grid, Mask};
use crate::simulation::deadwood::DecayParameters;
use crate::simulation::forest::{Forest, Site};
use crate::simulation::{Parameters, Plot};
use crate::species::Biome;
use crate::terrain::Terrain;
use crate::terrain::generate::{self as landscape, GenerateParams};

/// Seedlings of the young stand over the usual, so that it has the 130,000 to 145,000 plants at 5 m²/ha that the authors' program
/// was timed with.
const YOUNG_SEEDLINGS: f32 = 2.0;
/// Basal area of the young stand, m²/ha.
const YOUNG_M2_HA: f32 = 5.0;
/// Years until a forest counts as old.
const OLD_YEARS: u16 = 300;
/// Years that copies of a forest live beside each other before they are timed.
const SETTLING_YEARS: u16 = 5;
/// Most years that a young stand is waited for.
const MOST_YOUNG_YEARS: u16 = 150;

/// A forest to time, on so many copies of its ground along a side.
pub fn prepare(
    dem: Option<&PathBuf>,
    is_young: bool,
    side: usize,
    reporter: &Reporter,
) -> Result<Forest, Error> {
    let biome = Biome::builtin("pyrenees")?;
    let terrain = terrain(dem.map(PathBuf::as_path), &reporter.silenced())?;
    let mut parameters = Parameters::forest(&biome);
    if is_young {
        parameters.seed_chance_per_year *= YOUNG_SEEDLINGS;
    }
    let mut forest = bare(&terrain, &biome, parameters, &reporter.silenced())?;
    let live_m2_ha = |forest: &Forest| -> f32 {
        let rows = forest.timeline().iter().filter(|row| row.year == forest.year());
        rows.map(|row| row.live_m2_ha).sum()
    };
    while if is_young {
        live_m2_ha(&forest) < YOUNG_M2_HA && forest.year() < MOST_YOUNG_YEARS
    } else {
        forest.year() < OLD_YEARS
    } {
        reporter.check_cancelled()?;
        forest.live_a_year(&[]);
    }
    if side == 1 {
        return Ok(forest);
    }
    let plants = forest.plants(&terrain.elevation_m);
    let larger = beside(&terrain, side);
    let frame = larger.elevation_m.frame();
    let plants = copies(&plants, terrain.elevation_m.frame(), side);
    let mut forest =
        bare(&larger, &biome, parameters, &reporter.silenced())?.with_plants(&plants, frame);
    for _ in 0..SETTLING_YEARS {
        forest.live_a_year(&[]);
    }
    Ok(forest)
}

fn terrain(dem: Option<&Path>, reporter: &Reporter) -> Result<Terrain, Error> {
    let Some(dem) = dem else {
        let params = GenerateParams { rows: 256, cols: 256, ..GenerateParams::default() };
        return Ok(landscape::generate(&params, reporter)?);
    };
    let request = ImportRequest {
        biome: "pyrenees".to_owned(),
        ..ImportRequest::new(vec![dem.to_path_buf()], PathBuf::new())
    };
    Ok(import::read_terrain(&request, reporter)?.terrain)
}

fn bare(
    terrain: &Terrain,
    biome: &Biome,
    parameters: Parameters,
    reporter: &Reporter,
) -> Result<Forest, Error> {
    let maps = abiotics::run(terrain, &biome.climate, &abiotics::Params::default(), reporter)?;
    let plot = Plot::open(&maps, maps.river.values(), biome, &parameters);
    let site = Site { plot, elevation_m: &terrain.elevation_m, biome };
    Ok(Forest::new(site, parameters, DecayParameters::peytavie2024(), 1))
}

/// Copies of terrain beside each other, every other one mirrored so that they meet.
fn beside(terrain: &Terrain, side: usize) -> Terrain {
    let ground = &terrain.elevation_m;
    let Frame { rows, cols, .. } = **ground.frame();
    let line = |at: usize, cells: usize| {
        let within = at % cells;
        if (at / cells).is_multiple_of(2) { within } else { cells - 1 - within }
    };
    let frame = Frame { rows: rows * side, cols: cols * side, ..(**ground.frame()).clone() };
    let source = |index: usize| {
        let (row, col) = (index / (cols * side), index % (cols * side));
        line(row, rows) * cols + line(col, cols)
    };
    let cells = 0..frame.rows * frame.cols;
    let values = cells.clone().map(|index| ground.values()[source(index)]).collect();
    let valid = cells.map(|index| ground.mask().is_valid(source(index))).collect();
    Terrain {
        elevation_m: Grid::new(frame.into(), Mask::new(valid).into(), values),
        ..terrain.clone()
    }
}

/// Copies of plants on such terrain.
fn copies(plants: &Plants, frame: &Frame, side: usize) -> Plants {
    let size_m = [frame.cols, frame.rows].map(|cells| cells as f32 * frame.cell_m());
    let place = |at_m: f32, copy: usize, size_m: f32| {
        let within_m = if copy.is_multiple_of(2) { at_m } else { size_m - at_m };
        copy as f32 * size_m + within_m
    };
    let mut all = Plants::default();
    for row in 0..side {
        for col in 0..side {
            let mut copy = plants.clone();
            let first_id = all.len() as u64;
            copy.id = (first_id..first_id + plants.len() as u64).collect();
            copy.east_m.iter_mut().for_each(|at_m| *at_m = place(*at_m, col, size_m[0]));
            // rows count from the north, places from the south
            let from_south = side - 1 - row;
            let parity = usize::from(row % 2 == 1);
            copy.north_m.iter_mut().for_each(|at_m| {
                *at_m = from_south as f32 * size_m[1] + place(*at_m, parity, size_m[1])
                    - parity as f32 * size_m[1];
            });
            all.append(copy);
        }
    }
    all
}

/// The year after, the same one each time.
pub fn year(forest: &Forest) -> Value {
    let mut forest = forest.clone();
    let plants = forest.community().len();
    let started = Instant::now();
    forest.live_a_year(&[]);
    let seconds = started.elapsed().as_secs_f64();
    let cells = forest.community().plot().cells();
    let rows = forest.timeline().iter().filter(|row| row.year == forest.year());
    let live_m2_ha: f32 = rows.map(|row| row.live_m2_ha).sum();
    json!({
        "seconds": seconds, "plants": plants, "live_m2_ha": live_m2_ha,
        "snags": forest.stock().snags.len(), "downed_logs": forest.stock().downed_logs.len(),
        "year": forest.year(), "ns_per_plant": seconds * 1e9 / plants.max(1) as f64,
        "cells": cells,
        "bytes_per_plant": forest.community().plant_bytes() as f64 / plants.max(1) as f64,
        "bytes_per_cell": forest.cell_bytes() as f64 / cells as f64,
    })
}
