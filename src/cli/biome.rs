//! `wildwood biome`: what a biome holds; a built-in one as a file to start one's own from.

use std::path::PathBuf;

use clap::Args;
use serde_json::json;

use super::{Outcome, Shared, terminal};
use crate::pipeline::biome_file::{self, ChosenBiome};
use crate::pipeline::import::DEFAULT_BIOME;
use crate::species::{Biome, Form, Species};

/// What `wildwood biome` takes.
#[derive(Args)]
pub struct BiomeArguments {
    /// Built-in biome (sonoma, pyrenees), or a file of your own.
    #[arg(value_name = "NAME|FILE", default_value = DEFAULT_BIOME)]
    biome: String,
    /// New file to write the biome's text to, to be edited and given to --biome.
    #[arg(long, short, value_name = "FILE")]
    output: Option<PathBuf>,
}

pub fn run(arguments: &BiomeArguments, shared: &Shared) -> Outcome {
    let ChosenBiome { biome, own_text } = ChosenBiome::read(&arguments.biome)?;
    if let Some(path) = &arguments.output {
        let text = match &own_text {
            Some(text) => text,
            None => Biome::builtin_toml(&arguments.biome)?,
        };
        biome_file::write_new(path, text)?;
    }
    if shared.json {
        let species: Vec<_> =
            biome.species.iter().map(|species| as_json(&biome, species)).collect();
        terminal::line(&json!({
            "event": "done", "biome": biome.key, "name": biome.name, "species": species, "file": arguments.output,
        }));
    } else if !shared.quiet {
        let (species, sub_biomes) = (biome.species.len(), biome.sub_biomes.len());
        terminal::say(&format!(
            "{}: {}, {species} species in {sub_biomes} sub-biomes",
            biome.key, biome.name
        ));
        for species in &biome.species {
            terminal::say(&row(&biome, species));
        }
        if let Some(path) = &arguments.output {
            terminal::say(&format!("edit {0}, then give --biome {0}", path.display()));
        }
    }
    Ok(())
}

/// Names of the sub-biomes that a species grows in; a star where it forms the canopy.
fn sub_biomes(biome: &Biome, species: &Species) -> Vec<String> {
    let name = |index: &usize| {
        let star = if species.canopy_sub_biome == Some(*index) { "*" } else { "" };
        format!("{}{star}", biome.sub_biomes[*index].key)
    };
    species.sub_biomes.iter().map(name).collect()
}

fn form(species: &Species) -> &'static str {
    match species.form {
        Form::Herb => "herb",
        Form::Shrub => "shrub",
        Form::ShrubVine => "shrub-vine",
        Form::ShrubTree => "shrub-tree",
        Form::Tree => "tree",
    }
}

fn row(biome: &Biome, species: &Species) -> String {
    let (key, height_m, years) = (&species.key, species.max_height_m, species.max_age_years);
    let sub_biomes = sub_biomes(biome, species).join(", ");
    format!("  {key:<26}{:<12}{height_m:>6} m {years:>6} years  {sub_biomes}", form(species))
}

fn as_json(biome: &Biome, species: &Species) -> serde_json::Value {
    json!({
        "key": species.key, "common_name": species.common_name, "scientific_name": species.scientific_name,
        "form": form(species), "max_height_m": species.max_height_m, "max_age_years": species.max_age_years,
        "sub_biomes": species.sub_biomes.iter().map(|i| &biome.sub_biomes[*i].key).collect::<Vec<_>>(),
        "canopy_of": species.canopy_sub_biome.map(|i| &biome.sub_biomes[i].key),
    })
}
