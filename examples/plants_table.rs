//! Writes trees of one's own as a table of plants, once for each coordinate reference system that is named:
//! `plants_table FOLDER CRS…` makes `FOLDER/0.parquet`, `FOLDER/0.csv`, `FOLDER/1.parquet` and so on.

use std::error::Error;
use std::fs::File;
use std::path::Path;

use wildwood::plants::table::{self, TableFormat};
use wildwood::plants::{Layer, Plants};
use wildwood::raster::{Crs, Frame, GeoTransform};
use wildwood::species::Biome;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (folder, systems) = arguments.split_first().ok_or("usage: plants_table FOLDER CRS…")?;
    let biome = Biome::builtin("sonoma")?;
    let plants = avenue(&biome);
    for (index, system) in systems.iter().enumerate() {
        let transform = GeoTransform { west_m: 500_000.5, north_m: 4_100_200.25, cell_m: 2.0 };
        let frame = Frame { rows: 100, cols: 1000, transform, crs: Crs::parse(system)? };
        for format in [TableFormat::Parquet, TableFormat::Csv] {
            let name = format!("{index}.{}", format.name());
            let file = File::create(Path::new(folder).join(name))?;
            table::write(file, &plants, &biome, &frame, format)?;
        }
    }
    Ok(())
}

/// Trees in two rows, each a little older than the one before.
fn avenue(biome: &Biome) -> Plants {
    let mut plants = Plants::default();
    for place in 0..500_u16 {
        for row in 0..2_u16 {
            let age_years = 1.0 + f32::from(place) / 4.0;
            plants.id.push(u64::from(place) * 2 + u64::from(row));
            plants.species.push((place + row) % biome.species.len() as u16);
            plants.layer.push(Layer::ALL[usize::from(row)]);
            plants.east_m.push(f32::from(place) * 3.7 + 0.3);
            plants.north_m.push(60.0 + 80.0 * f32::from(row));
            plants.z_m.push(12.0 + f32::from(place) * 0.01);
            plants.height_m.push(age_years * 0.3);
            plants.crown_radius_m.push(age_years * 0.05);
            plants.dbh_m.push(age_years * 0.008);
            plants.age_years.push(age_years);
            plants.vigor.push(0.9);
        }
    }
    plants
}
