//! A biome of one's own, from the built-in one it starts from to the aged forest.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

fn wildwood(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_wildwood")).args(arguments).output().unwrap()
}

fn done(arguments: &[&str]) -> Output {
    let output = wildwood(arguments);
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{arguments:?}: {stderr}");
    output
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// A table of `[[species]]` with another key.
fn renamed(biome: &str, key: &str, new: &str) -> String {
    let tables: Vec<&str> = biome.split("\n[[species]]\n").collect();
    let table = tables.iter().find(|table| table.contains(&format!("key = \"{key}\""))).unwrap();
    format!("\n[[species]]\n{}", table.replacen(key, new, 1))
}

#[test]
fn a_species_is_added_and_grows() {
    let home = tempfile::tempdir().unwrap();
    let [file, terrain, scene, map] =
        ["my.toml", "dem.asc", "scene", "trees.csv"].map(|n| home.path().join(n));
    done(&["biome", "pyrenees", "-o", text(&file)]);
    let again = wildwood(&["biome", "pyrenees", "-o", text(&file)]);
    assert_eq!(again.status.code(), Some(2), "an edited file must not be overwritten");

    // a second beech, in the canopy as the first
    let mut biome = fs::read_to_string(&file).unwrap();
    biome.push_str(&renamed(&biome, "european-beech", "oriental-beech"));
    biome = biome
        .replace("\"european-beech\"] # their", "\"european-beech\", \"oriental-beech\"] # their");
    fs::write(&file, &biome).unwrap();
    let listed = done(&["biome", text(&file)]);
    assert!(String::from_utf8_lossy(&listed.stdout).contains("oriental-beech"));

    let mut dem = "ncols 48\nnrows 48\nxllcorner 0\nyllcorner 0\ncellsize 2\n".to_owned();
    for row in 0..48 {
        let line: Vec<String> = (0..48).map(|col| format!("{}", 1390 + row + col / 3)).collect();
        dem += &(line.join(" ") + "\n");
    }
    fs::write(&terrain, dem).unwrap();
    let shares = "oriental-beech=0.6";
    let grown = done(&[
        "grow",
        text(&terrain),
        "-o",
        text(&scene),
        "--density",
        "dense",
        "--biome",
        text(&file),
        "--shares",
        shares,
    ]);
    let warned = String::from_utf8_lossy(&grown.stderr);
    assert!(warned.contains("wildwood statistics --biome"), "{warned}");
    assert_eq!(fs::read_to_string(scene.join("biome.toml")).unwrap(), biome);

    // later commands read the scene's own copy
    fs::remove_file(&file).unwrap();
    done(&["age", text(&scene), "--years", "3"]);
    done(&["export", text(&scene), "-o", text(&map), "--to", "csv", "--layers", "canopy"]);
    let trees = fs::read_to_string(&map).unwrap();
    assert!(trees.matches("oriental-beech").count() > 20, "{}", trees.lines().count());
    fs::write(scene.join("biome.toml"), "no biome").unwrap();
    let damaged = wildwood(&["age", text(&scene), "--years", "4"]);
    let stderr = String::from_utf8_lossy(&damaged.stderr);
    assert!(damaged.status.code() == Some(2) && stderr.contains("biome.toml"), "{stderr}");
}

#[test]
fn another_biome_file_makes_the_maps_anew() {
    let home = tempfile::tempdir().unwrap();
    let [file, terrain, scene] = ["my.toml", "dem.asc", "scene"].map(|name| home.path().join(name));
    done(&["biome", "sonoma", "-o", text(&file)]);
    let rows = "1 2 3 4 5 6 7 8\n".repeat(8);
    fs::write(&terrain, format!("ncols 8\nnrows 8\nxllcorner 0\nyllcorner 0\ncellsize 5\n{rows}"))
        .unwrap();
    let import = ["import", text(&terrain), "-o", text(&scene), "--biome", text(&file)];
    done(&import);
    let of_wet = |scene: &Path| fs::read(scene.join("moisture.tif")).unwrap();
    let first = of_wet(&scene);
    done(&import);
    assert_eq!(of_wet(&scene), first);
    let biome = fs::read_to_string(&file).unwrap();
    fs::write(&file, biome.replace("rain_mm = [", "rain_mm = [1.0, ")).unwrap();
    let thirteen = wildwood(&import);
    let stderr = String::from_utf8_lossy(&thirteen.stderr);
    assert!(thirteen.status.code() == Some(2) && stderr.contains("rain_mm"), "{stderr}");
    fs::write(&file, biome.replace("soil_capacity_mm = 180.0", "soil_capacity_mm = 60.0")).unwrap();
    done(&import);
    assert_ne!(of_wet(&scene), first, "a changed biome changes the maps");
    done(&["import", text(&terrain), "-o", text(&scene)]);
    assert!(!scene.join("biome.toml").exists(), "a built-in biome needs no copy");
}
