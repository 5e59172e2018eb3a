//! The files of terrain and abiotic maps, as stages of a scene.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::path::Path;
use std::sync::Arc;

use super::Error;
use crate::abiotics::{AbioticMaps, MonthlyTemperature};
use crate::canopy::species_map::{NO_SPECIES, SpeciesMap};
use crate::export::preview::{self, PreviewMaps, PreviewOptions};
use crate::io;
use crate::io::geotiff::{
    self, Band, BandSource, CogBands, CogError, CogOptions, SharedFile, StoredBands,
};
use crate::plants::deadwood::Deadwood;
use crate::plants::table::{self, TableFormat};
use crate::plants::{Plants, downed_logs_table, snags_table};
use crate::progress::Reporter;
use crate::raster::{Frame, Grid, MONTHS, Mask, MonthlyGrid};
use crate::scene::{StageEntry, Transaction};
use crate::species::Biome;
use crate::terrain::Terrain;

const MONTH_NAMES: [&str; MONTHS] = [
    "January",
    "February",
    "March",
    "April",
    "May",
    "June",
    "July",
    "August",
    "September",
    "October",
    "November",
    "December",
];

/// Writes rasters of one stage and collects their hashes.
pub struct StageFiles<'a> {
    transaction: &'a mut Transaction,
    files: BTreeMap<String, String>,
}

impl<'a> StageFiles<'a> {
    pub fn new(transaction: &'a mut Transaction) -> Self {
        Self { transaction, files: BTreeMap::new() }
    }

    /// The stage's entry in the manifest.
    pub fn into_entry(
        self,
        key: String,
        parameters: toml::Table,
        figures: toml::Table,
    ) -> StageEntry {
        StageEntry { key, parameters, figures, files: self.files }
    }

    fn cog(&mut self, name: &str, image: &CogBands<'_>) -> Result<(), Error> {
        let hash = self.transaction.write(name, |file: &mut File| {
            let mut out = BufWriter::with_capacity(1 << 20, file);
            geotiff::write_cog(&mut out, image, &CogOptions::default()).map_err(|e| match e {
                CogError::Write(source) => source,
                other => std::io::Error::other(other),
            })?;
            std::io::Write::flush(&mut out)
        })?;
        self.files.insert(name.to_owned(), hash);
        Ok(())
    }

    fn single<T>(
        &mut self,
        file: &str,
        band: &str,
        unit: &str,
        grid: &Grid<T>,
        values: &[f32],
    ) -> Result<(), Error> {
        let bands = [Band { name: band.to_owned(), unit: unit.to_owned() }];
        let source = StoredBands::new(grid.frame(), vec![values]);
        self.cog(
            file,
            &CogBands { frame: grid.frame(), mask: grid.mask(), bands: &bands, source: &source },
        )
    }

    /// Writes a raster of one band.
    pub fn grid(
        &mut self,
        file: &str,
        band: &str,
        unit: &str,
        grid: &Grid<f32>,
    ) -> Result<(), Error> {
        self.single(file, band, unit, grid, grid.values())
    }

    fn monthly(&mut self, file: &str, unit: &str, monthly: &MonthlyGrid) -> Result<(), Error> {
        let months = (0..MONTHS).map(|m| monthly.month(m)).collect();
        let source = StoredBands::new(monthly.frame(), months);
        let (frame, mask) = (monthly.frame(), monthly.mask());
        self.cog(file, &CogBands { frame, mask, bands: &month_bands(unit), source: &source })
    }

    /// Writes the four abiotic maps and the discharge.
    pub fn abiotics(&mut self, maps: &AbioticMaps, reporter: &Reporter) -> Result<(), Error> {
        let stage = reporter.stage("write", 5);
        let slope_deg: Vec<f32> = maps.slope_rad.values().iter().map(|s| s.to_degrees()).collect();
        self.single("slope.tif", "slope", "°", &maps.slope_rad, &slope_deg)?;
        stage.advance(1);
        reporter.check_cancelled()?;
        self.monthly("sunlight.tif", "h/day", &maps.sunlight_h)?;
        stage.advance(1);
        reporter.check_cancelled()?;
        self.monthly("moisture.tif", "mm", &maps.moisture_mm)?;
        stage.advance(1);
        reporter.check_cancelled()?;
        let elevation = maps.temperature_c.elevation_m();
        let (frame, mask) = (elevation.frame(), elevation.mask());
        let source = Temperature(&maps.temperature_c);
        self.cog(
            "temperature.tif",
            &CogBands { frame, mask, bands: &month_bands("°C"), source: &source },
        )?;
        stage.advance(1);
        reporter.check_cancelled()?;
        self.grid("discharge.tif", "mean discharge", "m3/s", &maps.discharge_m3_s)?;
        stage.advance(1);
        Ok(())
    }

    /// Writes the table of plants: `plants.parquet` or `plants.csv`.
    pub fn plants(
        &mut self,
        plants: &Plants,
        biome: &Biome,
        frame: &Frame,
        format: TableFormat,
    ) -> Result<(), Error> {
        let name = format!("plants.{}", format.name());
        let hash = self
            .transaction
            .write(&name, |file: &mut File| table::write(file, plants, biome, frame, format))?;
        self.files.insert(name, hash);
        Ok(())
    }

    /// Writes a file that is no raster.
    pub fn file(
        &mut self,
        name: &str,
        write: impl FnOnce(&mut File) -> std::io::Result<()>,
    ) -> Result<(), Error> {
        let hash = self.transaction.write(name, write)?;
        self.files.insert(name.to_owned(), hash);
        Ok(())
    }

    /// Draws and writes `preview.png`.
    pub fn preview(
        &mut self,
        options: &PreviewOptions,
        terrain: &Terrain,
        maps: &AbioticMaps,
        reporter: &Reporter,
    ) -> Result<(), Error> {
        let stage = reporter.stage("preview", 1);
        let shown = PreviewMaps {
            sunlight_h: Some(maps.sunlight_h.yearly_mean()),
            moisture_mm: Some(maps.moisture_mm.yearly_mean()),
            temperature_c: Some(maps.temperature_c.yearly_mean()),
            slope_rad: Some(maps.slope_rad.clone()),
            discharge_m3_s: Some(maps.discharge_m3_s.clone()),
            river: Some(maps.river.values()),
            canopy: None,
        };
        self.picture(options, terrain, &shown)?;
        stage.advance(1);
        Ok(())
    }

    /// Draws and writes `preview.png` with the maps given.
    pub fn picture(
        &mut self,
        options: &PreviewOptions,
        terrain: &Terrain,
        maps: &PreviewMaps<'_>,
    ) -> Result<(), Error> {
        let picture = preview::preview(terrain, maps, options);
        let hash = self.transaction.write("preview.png", |file| {
            let png = preview::encode_png(&picture).map_err(std::io::Error::other)?;
            std::io::Write::write_all(file, &png)
        })?;
        self.files.insert("preview.png".to_owned(), hash);
        Ok(())
    }

    /// Writes a species map: a species' place in the biome file, from 0; the band's name lists the keys.
    pub fn species(&mut self, file: &str, map: &SpeciesMap, biome: &Biome) -> Result<(), Error> {
        let valid = map.values().iter().map(|species| *species != NO_SPECIES).collect();
        let mask = Arc::new(Mask::new(valid));
        let values: Vec<f32> = map.values().iter().map(|species| f32::from(*species)).collect();
        let grid = Grid::new(Arc::clone(map.frame()), mask, values);
        let keys = biome.species.iter().enumerate();
        let names: Vec<String> = keys.map(|(i, species)| format!("{i} {}", species.key)).collect();
        self.grid(file, &format!("species: {}", names.join(", ")), "", &grid)
    }
}

/// The plants of a scene folder, from its `plants.parquet`.
pub fn read_plants(folder: &Path, biome: &Biome, frame: &Frame) -> Result<Plants, Error> {
    let name = format!("plants.{}", TableFormat::Parquet.name());
    read_plants_of(&folder.join(name), biome, frame)
}

/// The plants of a GeoParquet file.
pub fn read_plants_of(path: &Path, biome: &Biome, frame: &Frame) -> Result<Plants, Error> {
    let file = SharedFile::open(path)
        .map_err(|source| io::Error::Read { path: path.to_path_buf(), source })?;
    Ok(table::read(Arc::new(file), biome, frame, table::MAX_PLANTS).map_err(|e| e.at(path))?)
}

/// Snags and downed logs of a scene folder; none if its forest has no history.
pub fn read_deadwood(
    folder: &Path,
    biome: &Biome,
    frame: &Frame,
) -> Result<Option<Deadwood>, Error> {
    let path = folder.join("snags.parquet");
    if !path.exists() {
        return Ok(None);
    }
    let open = |path: &Path| {
        let file = SharedFile::open(path);
        file.map(Arc::new).map_err(|source| io::Error::Read { path: path.to_path_buf(), source })
    };
    let most = table::MAX_PLANTS;
    let snags =
        snags_table::read_snags(open(&path)?, biome, frame, most).map_err(|e| e.at(&path))?;
    let path = folder.join("downed_logs.parquet");
    let downed_logs = downed_logs_table::read_downed_logs(open(&path)?, biome, frame, most)
        .map_err(|e| e.at(&path))?;
    Ok(Some(Deadwood { snags, downed_logs }))
}

struct Temperature<'a>(&'a MonthlyTemperature);

impl BandSource for Temperature<'_> {
    fn read(&self, band: usize, row: usize, first_col: usize, values: &mut [f32]) {
        let first = row * self.0.elevation_m().frame().cols + first_col;
        for (index, value) in (first..).zip(values) {
            *value = self.0.at(band, index);
        }
    }
}

fn month_bands(unit: &str) -> Vec<Band> {
    MONTH_NAMES
        .iter()
        .map(|name| Band { name: (*name).to_owned(), unit: unit.to_owned() })
        .collect()
}

/// Mean over valid cells.
pub fn mean(values: &[f32], mask: &Mask) -> f64 {
    let valid = values.iter().zip(mask.as_slice()).filter(|(_, valid)| **valid);
    let sum: f64 = valid.map(|(v, _)| f64::from(*v)).sum();
    sum / (mask.valid_count().max(1) as f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plants::Layer;

    #[test]
    fn plants_of_a_scene_read_back() {
        let home = tempfile::tempdir().unwrap();
        let mut transaction = Transaction::begin(home.path()).unwrap();
        let biome = Biome::builtin("sonoma").unwrap();
        let frame = Frame::local(100, 100, 1.0);
        let plants = Plants {
            id: vec![7],
            species: vec![2],
            layer: vec![Layer::Undergrowth],
            east_m: vec![12.5],
            north_m: vec![50.0],
            z_m: vec![-3.0],
            height_m: vec![1.5],
            crown_radius_m: vec![0.75],
            dbh_m: vec![0.0],
            age_years: vec![4.0],
            vigor: vec![-0.125],
        };
        let mut files = StageFiles::new(&mut transaction);
        for format in [TableFormat::Parquet, TableFormat::Csv] {
            files.plants(&plants, &biome, &frame, format).unwrap();
        }
        let names: Vec<&str> = files.files.keys().map(String::as_str).collect();
        assert_eq!(names, ["plants.csv", "plants.parquet"]);
        let staged = std::fs::read_dir(home.path()).unwrap().next().unwrap().unwrap().path();
        assert_eq!(read_plants(&staged, &biome, &frame).unwrap(), plants);
        let error = read_plants(home.path(), &biome, &frame).unwrap_err();
        assert!(error.is_bad_input() && error.to_string().contains("plants.parquet"), "{error}");
    }
}
