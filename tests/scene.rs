//! A scene folder from end to end: what is in it, what is redone, and that threads change no bit.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::{Command, Output};

fn wildwood(arguments: &[&str]) -> Output {
    let output = Command::new(env!("CARGO_BIN_EXE_wildwood")).args(arguments).output().unwrap();
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    output
}

fn contents(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap())
        .map(|entry| {
            (entry.file_name().to_string_lossy().into_owned(), fs::read(entry.path()).unwrap())
        })
        .collect()
}

fn demo(folder: &Path, options: &[&str]) {
    let mut arguments =
        vec!["demo", "--no-pictures", "-o", folder.to_str().unwrap(), "--size", "160"];
    arguments.extend(options);
    wildwood(&arguments);
}

#[test]
fn a_scene_has_the_files_it_promises() {
    let home = tempfile::tempdir().unwrap();
    let folder = home.path().join("forest");
    demo(&folder, &[]);
    let names: Vec<String> = contents(&folder).into_keys().collect();
    let promised = [
        "age_state.bin",
        "chm.tif",
        "discharge.tif",
        "downed_logs.parquet",
        "grass.tif",
        "history.parquet",
        "litterfall.tif",
        "moisture.tif",
        "plants.parquet",
        "plants_at_start.parquet",
        "preview.png",
        "scene.toml",
        "slope.tif",
        "snags.parquet",
        "species.tif",
        "sunlight.tif",
        "temperature.tif",
        "terrain.tif",
        "timeline.parquet",
        "timeline.png",
    ];
    assert_eq!(names, promised);
    assert_eq!(fs::read_dir(home.path()).unwrap().count(), 1, "nothing else is left");
}

#[test]
fn same_seed_same_bits_for_one_and_two_threads_and_other_seeds_differ() {
    let home = tempfile::tempdir().unwrap();
    let folder = |name: &str| home.path().join(name).join("forest");
    demo(&folder("one"), &["--threads", "1", "--seed", "5"]);
    demo(&folder("two"), &["--threads", "2", "--seed", "5"]);
    demo(&folder("other"), &["--threads", "2", "--seed", "6"]);
    assert!(contents(&folder("one")) == contents(&folder("two")), "threads changed a file");
    assert!(contents(&folder("one"))["terrain.tif"] != contents(&folder("other"))["terrain.tif"]);
}

#[test]
fn an_unchanged_import_runs_nothing_and_a_changed_climate_only_what_depends_on_it() {
    let home = tempfile::tempdir().unwrap();
    let (demo_folder, forest) = (home.path().join("demo"), home.path().join("forest"));
    demo(&demo_folder, &[]);
    let dem = demo_folder.join("terrain.tif"); // local metres: the climate tells the latitude unless the user does
    let import = |options: &[&str]| {
        let mut arguments = vec![
            "import",
            dem.to_str().unwrap(),
            "-o",
            forest.to_str().unwrap(),
            "--json",
            "--latitude",
            "40",
        ];
        arguments.extend(options);
        String::from_utf8(wildwood(&arguments).stdout).unwrap()
    };
    let ran = |told: &str, stage: &str| told.contains(&format!("\"stage\":\"{stage}\""));
    let first = import(&[]);
    assert!(ran(&first, "read") && ran(&first, "sunlight"), "{first}");
    let before = contents(&forest);
    let again = import(&[]);
    assert!(!ran(&again, "read") && !ran(&again, "sunlight"), "{again}");
    assert!(before == contents(&forest), "an unchanged import changed a file");
    let other_climate = import(&["--biome", "pyrenees"]);
    assert!(ran(&other_climate, "sunlight") && !ran(&other_climate, "read"), "{other_climate}");
    assert!(before["terrain.tif"] == contents(&forest)["terrain.tif"]);
    assert!(before["sunlight.tif"] != contents(&forest)["sunlight.tif"]);
    // the seed is recorded, nothing is made anew
    let other_seed = import(&["--biome", "pyrenees", "--seed", "9"]);
    assert!(!ran(&other_seed, "read") && !ran(&other_seed, "sunlight"), "{other_seed}");
    assert!(fs::read_to_string(forest.join("scene.toml")).unwrap().contains("seed = 9\n"));
    // a file somebody changed or removed is made again
    fs::write(forest.join("slope.tif"), b"edited").unwrap();
    import(&["--biome", "pyrenees"]);
    assert!(before["slope.tif"] == contents(&forest)["slope.tif"]);
    fs::remove_file(forest.join("terrain.tif")).unwrap();
    import(&["--biome", "pyrenees"]);
    assert!(before["terrain.tif"] == contents(&forest)["terrain.tif"]);
}

#[test]
fn the_climate_counts_for_terrain_only_where_it_tells_the_latitude() {
    let home = tempfile::tempdir().unwrap();
    let (demo_folder, forest) = (home.path().join("demo"), home.path().join("forest"));
    demo(&demo_folder, &[]);
    let dem = demo_folder.join("terrain.tif");
    let latitude = |options: &[&str]| {
        let mut arguments = vec!["import", dem.to_str().unwrap(), "-o", forest.to_str().unwrap()];
        arguments.extend(options);
        wildwood(&arguments);
        let manifest = fs::read_to_string(forest.join("scene.toml")).unwrap();
        let line = manifest.lines().find(|line| line.starts_with("latitude_rad")).unwrap();
        line.split(" = ").nth(1).unwrap().parse::<f64>().unwrap().to_degrees()
    };
    let close = |a: f64, b: f64| (a - b).abs() < 1e-3;
    assert!(close(latitude(&["--biome", "sonoma"]), 38.578));
    assert!(close(latitude(&["--biome", "pyrenees"]), 42.5));
    assert!(close(latitude(&["--biome", "pyrenees", "--latitude", "-7"]), -7.0));
}

#[test]
fn json_lines_are_json_and_end_with_the_result() {
    let home = tempfile::tempdir().unwrap();
    let folder = home.path().join("forest");
    let output = wildwood(&[
        "demo",
        "--no-pictures",
        "-o",
        folder.to_str().unwrap(),
        "--size",
        "64",
        "--json",
    ]);
    let text = String::from_utf8(output.stdout).unwrap();
    let lines: Vec<serde_json::Value> =
        text.lines().map(|l| serde_json::from_str(l).unwrap()).collect();
    assert_eq!(lines.last().unwrap()["event"], "done");
    assert!(lines.iter().any(|l| l["event"] == "stage" && l["peak_memory_mib"].is_number()));
}

#[test]
fn quiet_says_nothing() {
    let home = tempfile::tempdir().unwrap();
    let folder = home.path().join("forest");
    let output = wildwood(&[
        "demo",
        "--no-pictures",
        "-o",
        folder.to_str().unwrap(),
        "--size",
        "64",
        "--quiet",
    ]);
    assert!(output.stdout.is_empty() && output.stderr.is_empty());
}

/// Wherever the run is when it is stopped, its folder is as it was: here, not there.
#[cfg(unix)]
#[test]
fn a_stopped_run_says_so_and_leaves_nothing() {
    use std::io::{BufRead, BufReader};
    use std::process::Stdio;
    let home = tempfile::tempdir().unwrap();
    let folder = home.path().join("out/forest");
    let mut running = Command::new(env!("CARGO_BIN_EXE_wildwood"))
        .args(["demo", "--no-pictures", "-o", folder.to_str().unwrap(), "--size", "1024"])
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(running.stderr.take().unwrap()).lines();
    let first = lines.next().unwrap().unwrap(); // a stage has ended: work is under way
    let interrupt = Command::new("kill").args(["-INT", &running.id().to_string()]).status();
    assert!(interrupt.unwrap().success());
    let rest: Vec<String> = lines.map(Result::unwrap).collect();
    assert_eq!(running.wait().unwrap().code(), Some(1), "{first} {rest:?}");
    assert!(rest.last().is_some_and(|line| line.starts_with("error: cancelled")), "{rest:?}");
    assert_eq!(fs::read_dir(home.path()).unwrap().count(), 0, "something was left behind");
}

#[test]
fn doctor_and_bench_speak_json() {
    let doctor = wildwood(&["doctor", "--json", "--threads", "3"]).stdout;
    let doctor: serde_json::Value = serde_json::from_slice(&doctor).unwrap();
    assert_eq!(
        (&doctor["threads"], &doctor["version"]),
        (&3.into(), &env!("CARGO_PKG_VERSION").into())
    );
    let bench = wildwood(&["bench", "abiotics-512", "--repeat", "1"]).stdout;
    let bench: serde_json::Value = serde_json::from_slice(&bench).unwrap();
    assert_eq!((&bench["workload"], &bench["runs"]), (&"abiotics-512".into(), &1.into()));
    assert!(bench["fastest_s"].as_f64().unwrap() > 0.0 && bench["peak_memory_mib"].is_number());
}
