//! Lives through years of undergrowth on a window of a scene, and prints a line of comma-separated counts a year:
//! `undergrowth_years DEM SCENE EAST SOUTH SIZE YEARS` with the window's place in metres from the north-west corner.

use std::error::Error;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use wildwood::abiotics;
use wildwood::pipeline::biome_file;
use wildwood::pipeline::import::{self, ImportRequest};
use wildwood::plants::table;
use wildwood::progress::Reporter;
use wildwood::scene::Manifest;
use wildwood::simulation::{CellWindow, Community, Parameters, Plot};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [dem, scene, east, south, size, years] = arguments.as_slice() else {
        return Err("usage: undergrowth_years DEM SCENE EAST SOUTH SIZE YEARS".into());
    };
    let reporter = Reporter::silent();
    let manifest = Manifest::read(Path::new(scene))?.ok_or("no scene")?;
    let biome = biome_file::of_scene(Path::new(scene), &manifest)?;
    let request = ImportRequest {
        biome: manifest.scene.biome.clone(),
        ..ImportRequest::new(vec![PathBuf::from(dem)], PathBuf::from(scene))
    };
    let terrain = import::read_terrain(&request, &reporter)?.terrain;
    let maps = abiotics::run(&terrain, &biome.climate, &request.abiotics, &reporter)?;
    let frame = terrain.elevation_m.frame();
    let file = Arc::<[u8]>::from(std::fs::read(Path::new(scene).join("plants.parquet"))?);
    let trees = table::read(file, &biome, frame, table::MAX_PLANTS)?;

    let cell = |m: &str| m.parse::<f32>().map(|m| (m / frame.cell_m()) as usize);
    let (col, row, cells) = (cell(east)?, cell(south)?, cell(size)?);
    let window = CellWindow { rows: row..row + cells, cols: col..col + cells };
    let parameters = Parameters::undergrowth(&biome);
    let plot = Plot::of(&maps, &trees, &biome, &parameters, &window);
    let mut community = Community::new(plot, &biome, parameters, 1);
    let keys: Vec<&str> = biome.species.iter().map(|s| s.key.as_str()).collect();
    println!("year,plants,deaths,sprouted,{}", keys.join(","));
    for _ in 0..years.parse()? {
        let figures = community.live_a_year();
        let mut counts = vec![0; biome.species.len()];
        community.species.iter().for_each(|species| counts[usize::from(*species)] += 1);
        let counts: Vec<String> = counts.iter().map(ToString::to_string).collect();
        let (year, plants) = (community.year(), community.len());
        println!("{year},{plants},{},{},{}", figures.deaths, figures.sprouted, counts.join(","));
    }
    for (index, key) in keys.iter().enumerate() {
        let of: Vec<usize> =
            (0..community.len()).filter(|p| usize::from(community.species[*p]) == index).collect();
        if of.is_empty() {
            continue;
        }
        let mut heights: Vec<f32> = of.iter().map(|p| community.height_m[*p]).collect();
        heights.sort_by(f32::total_cmp);
        let at = |share: f64| heights[((heights.len() - 1) as f64 * share) as usize];
        let area_m2: f32 =
            of.iter().map(|p| community.crown_radius_m[*p].powi(2) * std::f32::consts::PI).sum();
        let cover = 100.0 * area_m2 / community.plot().area_m2();
        eprintln!(
            "{key:24} {:7} heights 10 % {:.2} 50 % {:.2} 90 % {:.2} 99 % {:.2} cover {cover:.1} %",
            of.len(),
            at(0.1),
            at(0.5),
            at(0.9),
            at(0.99)
        );
    }
    Ok(())
}
