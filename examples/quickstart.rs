//! A forest from nothing, stage by stage, with no file read: terrain, what the site offers, canopy, trees, undergrowth,
//! then a table and a picture. Every stage is a function of its arguments, so each can be left out or replaced.
//!
//! `cargo run --release --example quickstart [FOLDER] [CELLS]`, say `quickstart my-forest 256`.

use std::error::Error;
use std::fs::{self, File};
use std::path::PathBuf;

use wildwood::canopy::generate::GenerateParams as CanopyParams;
use wildwood::canopy::{shares::Shares, site::Site};
use wildwood::export::preview::{self, CanopyLayer, PreviewMaps, PreviewOptions};
use wildwood::forest_floor::grass::{self, GrassParams};
use wildwood::pipeline::grow::{self, CanopyInput, CanopyRequest};
use wildwood::pipeline::undergrowth::{self, UndergrowthInput};
use wildwood::plants::table::{self, TableFormat};
use wildwood::progress::Reporter;
use wildwood::species::Biome;
use wildwood::terrain::generate::{self, GenerateParams};
use wildwood::undergrowth::Statistics;
use wildwood::{abiotics, canopy};

const SEED: u64 = 7; // another seed, another forest

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let folder = PathBuf::from(arguments.next().unwrap_or_else(|| "quickstart-forest".to_owned()));
    let cells: usize = arguments.next().as_deref().unwrap_or("160").parse()?;
    let reporter = Reporter::silent(); // hears of progress and warnings, and can cancel a run
    let biome = Biome::builtin("sonoma")?; // the climate, and what each species needs

    // 1. Bare ground: cells of 2 m. `pipeline::import::read_terrain` reads a real tile instead.
    let (rows, cols, relief_m) = (cells, cells, 0.4 * cells as f32); // hills, not mountains
    let landscape = GenerateParams { rows, cols, relief_m, seed: SEED, ..Default::default() };
    let terrain = generate::generate(&landscape, &reporter)?;

    // 2. What the site offers: light, soil water and warmth by month, slope, running water.
    let maps = abiotics::run(&terrain, &biome.climate, &Default::default(), &reporter)?;
    let site = Site::of(&maps); // the means of the year, which trees go by

    // 3. How high the canopy is, cell by cell. A measured one, or networks with a sketch, would do.
    let params = CanopyParams { seed: SEED, ..Default::default() };
    let chm_m = canopy::generate::generate(&terrain, &site, &params, &reporter)?;

    // 4. The trees that make up that canopy, some of them asked for, the rest as suits the site.
    let input = CanopyInput::made_up(&terrain, &site, &chm_m, &biome);
    let shares = Shares::parse("redwood=0.3,douglas-fir=0.2,coast-live-oak=0.2", &biome)?;
    let trees = grow::grow(&input, shares, SEED, &CanopyRequest::default(), &reporter)?;

    // 5. What grows beneath them, from statistics of simulated undergrowth, and grass and litter.
    let grass = grass::suitability(&maps, &biome.forest_floor, &GrassParams::default());
    let beneath = UndergrowthInput {
        terrain: &terrain,
        site: &site,
        grass_suitability: &maps.slope_rad.with_values(grass),
        discharge_m3_s: &maps.discharge_m3_s,
        allowed: terrain.elevation_m.mask(),
        biome: &biome,
        canopy: &trees.plants,
    };
    let statistics = Statistics::builtin(&biome)?;
    let grown = undergrowth::grow(&beneath, Some(&statistics), None, SEED, &reporter)?;

    // 6. All plants as a table, a row each, and a map of them.
    fs::create_dir_all(&folder)?;
    let (plants, frame) = (&grown.plants, terrain.elevation_m.frame());
    let file = File::create(folder.join("plants.csv"))?;
    table::write(file, plants, &biome, frame, TableFormat::Csv)?;
    let species = &trees.species.map;
    let canopy = CanopyLayer { plants, biome: &biome, chm_m: &chm_m, species, deadwood: None };
    let moisture_mm = Some(site.moisture_mm.clone());
    let shown = PreviewMaps { canopy: Some(canopy), moisture_mm, ..Default::default() };
    let options = PreviewOptions { title: "Quick start".to_owned(), climate: None };
    preview::preview(&terrain, &shown, &options).save(folder.join("map.png"))?;

    let (trees, all) = (trees.plants.len(), plants.len());
    println!("{trees} trees, {} plants beneath them: see {}", all - trees, folder.display());
    Ok(())
}
