//! Writes trees of one's own as a table of plants, once for each coordinate reference system that is named:
//! `plants_table FOLDER CRS…` makes `FOLDER/0.parquet`, `FOLDER/0.csv`, `FOLDER/1.parquet` and so on.
//! Beside them lie `FOLDER/0.snags.parquet`, `FOLDER/0.downed_logs.parquet` and so on: every eighth tree died, and of
//! those every other one fell. `FOLDER/history.parquet`, `timeline` and `growth` tell how it came to that.

use std::error::Error;
use std::fs::File;
use std::path::Path;

use wildwood::plants::deadwood::{
    Cause, DownedLogKind, DownedLogs, GrowthRecord, LifeEvent, LifeEventKind, Snags, TimelineRow,
};
use wildwood::plants::downed_logs_table::write_downed_logs;
use wildwood::plants::history_tables::{write_growth, write_history, write_timeline};
use wildwood::plants::snags_table::write_snags;
use wildwood::plants::table::{self, TableFormat};
use wildwood::plants::{Layer, Plants};
use wildwood::raster::{Crs, Frame, GeoTransform};
use wildwood::species::Biome;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (folder, systems) = arguments.split_first().ok_or("usage: plants_table FOLDER CRS…")?;
    let biome = Biome::builtin("sonoma")?;
    let plants = avenue(&biome);
    let (snags, logs) = deadwood(&plants);
    let create = |name: String| File::create(Path::new(folder).join(name));
    for (index, system) in systems.iter().enumerate() {
        let transform = GeoTransform { west_m: 500_000.5, north_m: 4_100_200.25, cell_m: 2.0 };
        let frame = Frame { rows: 100, cols: 1000, transform, crs: Crs::parse(system)? };
        for format in [TableFormat::Parquet, TableFormat::Csv] {
            let ending = format.name();
            let file = create(format!("{index}.{ending}"))?;
            table::write(file, &plants, &biome, &frame, format)?;
            let file = create(format!("{index}.snags.{ending}"))?;
            write_snags(file, &snags, &biome, &frame, format)?;
            let file = create(format!("{index}.downed_logs.{ending}"))?;
            write_downed_logs(file, &logs, &biome, &frame, format)?;
        }
    }
    for format in [TableFormat::Parquet, TableFormat::Csv] {
        let ending = format.name();
        write_history(create(format!("history.{ending}"))?, &history(&plants), format)?;
        write_timeline(create(format!("timeline.{ending}"))?, &timeline(), &biome, format)?;
        write_growth(create(format!("growth.{ending}"))?, &growth(&plants), format)?;
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

/// Every eighth tree as a snag or, every other one of them, as a trunk beside its stump.
fn deadwood(plants: &Plants) -> (Snags, DownedLogs) {
    let (mut snags, mut logs) = (Snags::default(), DownedLogs::default());
    for tree in (0..plants.len()).step_by(8) {
        let cause = Cause::ALL[tree / 8 % 6];
        let decay_class = 1 + (tree / 8 % 5) as u8; // below 6
        let has_fallen = tree % 16 == 0;
        snags.id.push(plants.id[tree]);
        snags.species.push(plants.species[tree]);
        snags.east_m.push(plants.east_m[tree]);
        snags.north_m.push(plants.north_m[tree]);
        snags.z_m.push(plants.z_m[tree]);
        snags.height_m.push(if has_fallen { 0.4 } else { 0.8 * plants.height_m[tree] });
        snags.height_at_death_m.push(plants.height_m[tree]);
        snags.dbh_m.push(plants.dbh_m[tree]);
        snags.years_dead.push(3.25 * f32::from(decay_class));
        snags.decay_class.push(decay_class);
        snags.density_fraction.push(1.0 - 0.15 * f32::from(decay_class));
        snags.branch_fraction.push(0.5);
        snags.cause.push(cause);
        if has_fallen {
            logs.id.push(logs.id.len() as u64);
            logs.parent_id.push(plants.id[tree]);
            logs.species.push(plants.species[tree]);
            logs.kind.push(DownedLogKind::ALL[tree / 16 % 4]);
            logs.east_m.push(plants.east_m[tree]);
            logs.north_m.push(plants.north_m[tree]);
            logs.z_m.push(plants.z_m[tree]);
            logs.length_m.push(plants.height_m[tree] - 0.25);
            logs.diameter_base_m.push(1.1 * plants.dbh_m[tree]);
            logs.diameter_tip_m.push(0.01);
            logs.azimuth_rad.push(tree as f32 * 0.037 % std::f32::consts::TAU); // 1000 at most
            logs.years_down.push(f32::from(decay_class));
            logs.decay_class.push(decay_class);
            logs.density_fraction.push(1.0 - 0.15 * f32::from(decay_class));
            logs.cause.push(Cause::Decay);
        }
    }
    (snags, logs)
}

/// Every tree sprouted; every eighth died; every sixteenth fell. In the order of time, as simulations have it.
fn history(plants: &Plants) -> Vec<LifeEvent> {
    let of_every = |step: usize, year: u16, kind, cause: fn(usize) -> Cause| {
        plants.id.iter().enumerate().step_by(step).map(move |(index, id)| LifeEvent {
            plant_id: *id,
            year,
            month: 1 + (index % 12) as u8, // 12 at most
            kind,
            severity: 0.125,
            cause: cause(index),
        })
    };
    of_every(1, 1, LifeEventKind::Sprouted, |_| Cause::Age)
        .chain(of_every(8, 40, LifeEventKind::Died, |index| Cause::ALL[index / 8 % 6]))
        .chain(of_every(16, 55, LifeEventKind::SnagFell, |_| Cause::Decay))
        .collect()
}

/// Three species over twenty years, one more plant of each every year.
fn timeline() -> Vec<TimelineRow> {
    let row = |year: u16, species: u16| TimelineRow {
        year,
        species,
        live: 100 * u32::from(species) + u32::from(year),
        live_trees: 100 * u32::from(species),
        sprouted: 1,
        live_m2_ha: 20.0 + 0.5 * f32::from(year),
        deaths: [0, 1, 2, 3, 4, 5, 0, 0],
        ..TimelineRow::default()
    };
    (0..3).flat_map(|species| (0..20).map(move |year| row(year, species))).collect()
}

/// Ten years of the first trees, year by year.
fn growth(plants: &Plants) -> Vec<GrowthRecord> {
    let record = |year: u16, tree: usize| GrowthRecord {
        plant_id: plants.id[tree],
        year,
        height_m: 0.3 * f32::from(year),
        crown_radius_m: 0.05 * f32::from(year),
        dbh_m: 0.008 * f32::from(year),
        vigor: plants.vigor[tree],
        carbon_pool: 1.0,
    };
    (0..10).flat_map(|year| (0..5).map(move |tree| record(year, tree))).collect()
}
