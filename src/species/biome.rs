//! A biome: its climate, its sub-biomes, its forest floor and its species, read from one TOML file.

use super::climate::Climate;
use super::format;
use super::niche::Trapezoid;
use super::species::Species;

/// Everything later stages know of a region's plants and weather.
#[derive(Clone, Debug, PartialEq)]
pub struct Biome {
    /// Stable name in files and flags, e.g. `sonoma`.
    pub key: String,
    /// Everyday name.
    pub name: String,
    /// Weather and soil.
    pub climate: Climate,
    /// Groups of plants that grow together, in file order.
    pub sub_biomes: Vec<SubBiome>,
    /// Grass and herbs too small to be single plants.
    pub forest_floor: ForestFloor,
    /// Most seedlings that sprout on a m² in a year, however many trees shed seeds on it.
    pub most_seedlings_per_m2_year: f32,
    /// The species, in file order; other stages refer to them by index.
    pub species: Vec<Species>,
}

/// A group of species that grow together under the canopy of some of them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SubBiome {
    /// Stable name in files and flags, e.g. `conifer`.
    pub key: String,
    /// Everyday name.
    pub name: String,
    /// Indices of the species that form its canopy.
    pub canopy: Vec<usize>,
    /// Indices of all species that grow in it, canopy species among them.
    pub members: Vec<usize>,
}

/// Where grass grows and how tall.
///
/// # Reference
/// Kapp et al. 2020, section 6.3, doi:10.1145/3414685.3417848.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ForestFloor {
    /// Height where everything suits.
    pub max_grass_height_m: f32,
    /// Suitability by soil water, mm a month.
    pub moisture_mm: Trapezoid,
    /// Suitability by temperature, °C.
    pub temperature_c: Trapezoid,
    /// Suitability by sunlight, hours a day.
    pub sun_h: Trapezoid,
}

impl ForestFloor {
    /// Suitability for grass in 0..=1: the least of the three.
    #[inline]
    pub fn suitability(&self, moisture_mm: f32, temperature_c: f32, sun_h: f32) -> f32 {
        self.moisture_mm
            .suitability(moisture_mm)
            .min(self.temperature_c.suitability(temperature_c))
            .min(self.sun_h.suitability(sun_h))
    }
}

const BUILTIN: [(&str, &str); 2] = [
    ("sonoma", include_str!("../../species/sonoma.toml")),
    ("pyrenees", include_str!("../../species/pyrenees.toml")),
];

impl Biome {
    /// Names that [`Biome::builtin`] knows.
    pub const BUILTIN_NAMES: [&'static str; 2] = [BUILTIN[0].0, BUILTIN[1].0];

    /// The biome of a TOML text.
    ///
    /// # Errors
    /// Text over 4 MiB, bad TOML, unknown or missing keys, values out of range, names used twice or not defined:
    /// the message names place, key, value and what is allowed.
    pub fn from_toml(text: &str) -> Result<Self, BiomeError> {
        format::parse_biome(text)
    }

    /// A biome that ships with the program.
    ///
    /// # Errors
    /// No such name; the message lists those there are.
    pub fn builtin(name: &str) -> Result<Self, BiomeError> {
        Self::from_toml(Self::builtin_toml(name)?)
    }

    /// The TOML text of a biome that ships with the program, to start one's own from.
    ///
    /// # Errors
    /// No such name; the message lists those there are.
    pub fn builtin_toml(name: &str) -> Result<&'static str, BiomeError> {
        let found = BUILTIN.iter().find(|(builtin, _)| *builtin == name);
        found.map(|(_, text)| *text).ok_or_else(|| BiomeError::UnknownBiome {
            name: name.to_owned(),
            known: Self::BUILTIN_NAMES.join(", "),
        })
    }

    /// Index of the species with this key.
    pub fn species_index(&self, key: &str) -> Option<usize> {
        self.species.iter().position(|species| species.key == key)
    }

    /// The species with this key.
    pub fn species_by_key(&self, key: &str) -> Option<&Species> {
        self.species.iter().find(|species| species.key == key)
    }

    /// Index of the sub-biome with this key.
    pub fn sub_biome_index(&self, key: &str) -> Option<usize> {
        self.sub_biomes.iter().position(|sub_biome| sub_biome.key == key)
    }

    /// Indices of all species that can stand in the canopy, in file order.
    pub fn canopy_species(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.species.len()).filter(|&index| self.species[index].can_be_canopy())
    }
}

/// What is wrong with a biome or climate file.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
#[allow(missing_docs, reason = "the message tells what the fields are")]
pub enum BiomeError {
    /// The text is longer than any sensible biome.
    #[error(
        "the text has {bytes} bytes; biome and climate files may have {limit}: is this the right file?"
    )]
    TooLarge { bytes: usize, limit: usize },
    /// Not TOML, or keys that are unknown, missing, or of the wrong type.
    #[error("{message}")]
    Syntax { message: String },
    /// A number outside its range.
    #[error("{place}: {key} = {value} is outside {low}..={high}")]
    OutOfRange { place: String, key: String, value: f64, low: f64, high: f64 },
    /// Numbers that must rise do not.
    #[error("{place}: {key} is out of order: {detail}")]
    OutOfOrder { place: String, key: String, detail: String },
    /// Not one value per month.
    #[error("{place}: {key} has {count} values; it needs twelve, January first")]
    NotTwelve { place: String, key: String, count: usize },
    /// A list that is empty or too long.
    #[error("{key} has {count} entries; allowed are {low} to {high}")]
    Count { key: String, count: usize, low: usize, high: usize },
    /// A text that does not fit its key.
    #[error("{place}: {key} = `{value}` {problem}")]
    BadText { place: String, key: String, value: String, problem: String },
    /// A name used twice.
    #[error("{place}: {key} `{value}` is used twice; names must differ")]
    Duplicate { place: String, key: String, value: String },
    /// A name that nothing defines.
    #[error("{place}: {key} names `{value}`, which is not defined; known are {known}")]
    UnknownReference { place: String, key: String, value: String, known: String },
    /// A canopy species that does not say it grows there.
    #[error(
        "sub-biome `{sub_biome}`: canopy names `{species}`, whose sub_biomes do not hold `{sub_biome}`; add it there"
    )]
    CanopyNotMember { sub_biome: String, species: String },
    /// A canopy species of two sub-biomes.
    #[error(
        "species `{species}` is canopy of both `{first}` and `{second}`; a species forms the canopy of one sub-biome"
    )]
    CanopyTwice { species: String, first: String, second: String },
    /// A file of another format version.
    #[error("biome: format_version = {found} is not supported; this program reads {supported}")]
    Version { found: u32, supported: u32 },
    /// A name that no shipped biome has.
    #[error(
        "no biome `{name}` ships with the program; there are {known}; give one of them, a TOML file of your own (`wildwood biome sonoma -o my_biome.toml` writes one to start from), or for the climate alone --climate FILE"
    )]
    UnknownBiome { name: String, known: String },
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sonoma_holds_what_the_paper_prints() {
        let sonoma = Biome::builtin("sonoma").unwrap();
        assert_eq!((sonoma.species.len(), sonoma.sub_biomes.len()), (16, 4));
        assert_eq!(sonoma.canopy_species().count(), 7);
        let oak = sonoma.species_by_key("coast-live-oak").unwrap();
        assert_eq!(oak.sub_biomes, [1, 2, 3]);
        assert_eq!(oak.canopy_sub_biome, Some(1));
        // full widths are printed: 88 mm means 44 on either side
        assert_eq!(oak.niche.moisture_mm.half_width, 44.0);
        assert_eq!(oak.niche.slope_rad.ideal, 0.0);
        assert!((oak.niche.slope_rad.half_width - 60f32.to_radians()).abs() < 1e-6);
        assert_eq!(sonoma.species_by_key("pacific-poison-oak").unwrap().max_height_m, 4.0);
        let conifer = &sonoma.sub_biomes[0];
        assert_eq!((conifer.canopy.len(), conifer.members.len()), (2, 9));
        assert_eq!(sonoma.climate.rain_mm[0], 201.3);
    }

    #[test]
    fn pyrenees_holds_what_the_paper_prints() {
        let pyrenees = Biome::builtin("pyrenees").unwrap();
        assert_eq!((pyrenees.species.len(), pyrenees.canopy_species().count()), (7, 5));
        let beech = pyrenees.species_by_key("european-beech").unwrap();
        assert_eq!(beech.wood.modulus_of_rupture_pa, 65e6);
        assert_eq!(beech.decay.log_seeding_multiplier, 0.3);
        // half widths are printed
        assert_eq!(beech.niche.sun_h.half_width, 6.25);
        assert_eq!(beech.growing_season.months(), 6);
        assert_eq!(pyrenees.climate.station_altitude_m, 1386.0);
    }

    /// Rows of a reference table, or nothing where it is missing.
    fn reference_rows(name: &str) -> Option<Vec<Vec<String>>> {
        let beside = || concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/data").into();
        let data = std::env::var_os("WILDWOOD_DATA").unwrap_or_else(beside);
        let path = std::path::Path::new(&data).join("../reference").join(name);
        let Ok(text) = std::fs::read_to_string(path) else {
            eprintln!("skipped: ../shared/reference is missing");
            return None;
        };
        let cells = |line: &str| line.split(',').map(str::to_owned).collect();
        Some(text.lines().skip(1).map(cells).collect())
    }

    fn number(cell: &str) -> f32 {
        cell.parse().unwrap()
    }

    fn close(a: f32, b: f32) -> bool {
        (a - b).abs() <= 1e-5 * b.abs().max(1.0)
    }

    #[test]
    fn sonoma_agrees_with_the_papers_table_row_by_row() {
        let Some(rows) = reference_rows("sonoma_species.csv") else { return };
        let sonoma = Biome::builtin("sonoma").unwrap();
        assert_eq!(rows.len(), sonoma.species.len());
        for (row, species) in rows.iter().zip(&sonoma.species) {
            // printed "Oxalis Oregano"
            let printed = row[1].to_lowercase().replace("oregano", "oregana");
            assert_eq!(printed, species.scientific_name.to_lowercase());
            assert_eq!(
                (number(&row[4]), number(&row[5])),
                (species.max_age_years, species.max_height_m)
            );
            assert_eq!(number(&row[6]), species.absorbed_light_fraction);
            let subs: Vec<usize> =
                row[2].split('+').map(|n| n.parse::<usize>().unwrap() - 1).collect();
            assert_eq!(subs, species.sub_biomes, "{}", species.key);
            let niche = &species.niche;
            for (at, tolerance) in
                [(7, niche.sun_h), (9, niche.moisture_mm), (11, niche.temperature_c)]
            {
                assert_eq!(number(&row[at]), tolerance.ideal, "{}", species.key);
                assert_eq!(number(&row[at + 1]) / 2.0, tolerance.half_width, "{}", species.key);
            }
            assert!(close(niche.slope_rad.half_width, number(&row[14]).to_radians()));
            let season = (species.growing_season.first_month, species.growing_season.last_month);
            assert_eq!(season, if row[15] == "S" { (12, 5) } else { (9, 5) });
            let (log_m, exponent) = match row[16].as_str() {
                "A" => (-0.584_012_6, 0.923_859_5),
                "B" => (-1.524_125, 0.976_098_6),
                "C" => (-1.8185, 1.1471),
                "D" => (-0.728_451_4, 0.656_991),
                _ => (1.386_294_4, 1.0),
            };
            let law = species.crown.radius.typical;
            assert!(close(law.log_m, log_m) && close(law.exponent, exponent), "{}", species.key);
        }
    }

    #[test]
    fn pyrenees_agrees_with_the_papers_table_row_by_row_but_where_it_is_calibrated() {
        // key, column, printed, calibrated: the file says why
        let calibrated = [
            ("mountain-pine", 16, 18.5, 17.5),
            ("silver-fir", 14, 3.0, 4.0),
            ("silver-fir", 16, 9.0, 14.0),
            ("european-beech", 16, 22.5, 27.0),
        ];
        let Some(rows) = reference_rows("pyrenees_species.csv") else { return };
        let pyrenees = Biome::builtin("pyrenees").unwrap();
        assert_eq!(rows.len(), pyrenees.species.len());
        for (row, species) in rows.iter().zip(&pyrenees.species) {
            assert_eq!(row[1], species.scientific_name);
            let niche = &species.niche;
            let pairs = [
                (3, species.max_age_years),
                (4, species.decay.deathspan_years),
                (5, species.max_height_m),
                (6, species.stem.max_trunk_diameter_m),
                (7, species.height_curve_q),
                (8, species.decay.log_seeding_multiplier),
                (9, species.absorbed_light_fraction),
                (10, species.wood.pulling_coefficient_nm_kg),
                (11, species.wood.modulus_of_rupture_pa / 1e6),
                (12, species.wood.density_kg_m3),
                (13, niche.sun_h.ideal),
                (14, niche.sun_h.half_width),
                (15, niche.moisture_mm.ideal),
                (16, niche.moisture_mm.half_width),
                (17, niche.temperature_c.ideal),
                (18, niche.temperature_c.half_width),
                (19, niche.slope_rad.ideal),
                (20, niche.slope_rad.half_width.to_degrees()),
            ];
            for (column, value) in pairs {
                let printed = number(&row[column]);
                let is_own =
                    |own: &&(&str, usize, f32, f32)| own.0 == species.key && own.1 == column;
                let expected = match calibrated.iter().find(is_own) {
                    Some((.., from, to)) => {
                        assert!(close(printed, *from), "{} column {column}", species.key);
                        *to
                    }
                    None => printed,
                };
                assert!(close(value, expected), "{} column {column}: {value}", species.key);
            }
        }
    }

    #[test]
    fn every_shipped_species_can_live_in_its_own_climate() {
        for name in Biome::BUILTIN_NAMES {
            let biome = Biome::builtin(name).unwrap();
            for species in &biome.species {
                let suited = (0..12).any(|month| {
                    let tolerance = species.niche.temperature_c;
                    species.growing_season.contains(month as u8 + 1)
                        && tolerance.adaptation(biome.climate.temperature_c[month]) > 0.0
                });
                assert!(suited, "{name}: {}", species.key);
            }
        }
    }

    #[test]
    fn an_unknown_builtin_lists_those_there_are() {
        let message = Biome::builtin("amazon").unwrap_err().to_string();
        assert!(message.contains("amazon") && message.contains("sonoma, pyrenees"), "{message}");
    }

    #[test]
    fn every_species_value_states_its_source() {
        for name in Biome::BUILTIN_NAMES {
            let text = Biome::builtin_toml(name).unwrap();
            let species = &text[text.find("[[species]]").unwrap()..];
            let values =
                species.lines().filter(|line| line.contains(" = ") && !line.starts_with("key"));
            for line in values {
                let source = line.split_once(" # ").map_or("", |(_, source)| source);
                assert!(source.len() > 4, "{name}: {line}");
            }
        }
    }

    #[test]
    fn colours_differ() {
        for name in Biome::BUILTIN_NAMES {
            let species = Biome::builtin(name).unwrap().species;
            for (i, a) in species.iter().enumerate() {
                for b in &species[..i] {
                    let distance: u32 =
                        (0..3).map(|c| u32::from(a.color_srgb[c].abs_diff(b.color_srgb[c]))).sum();
                    assert!(distance >= 40, "{} and {}", a.key, b.key);
                }
            }
        }
    }

    #[test]
    fn grass_takes_the_least_of_three() {
        let floor = Biome::builtin("pyrenees").unwrap().forest_floor;
        assert_eq!(floor.suitability(100.0, 18.0, 8.0), 1.0);
        assert_eq!(floor.suitability(40.0, 18.0, 8.0), 0.5);
        assert_eq!(floor.suitability(100.0, 18.0, 1.0), 0.0);
    }
}
