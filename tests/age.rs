//! `wildwood age` from end to end: runs that were stopped, made longer or repeated end in the same bits.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::thread::sleep;
use std::time::Duration;

use tempfile::TempDir;
use wildwood::pipeline::age::{self, AgeRequest, Script};
use wildwood::pipeline::demo;
use wildwood::progress::Reporter;
use wildwood::scene::Manifest;
use wildwood::terrain::generate::GenerateParams;

const CHECKPOINT: &str = "age_checkpoint.bin";
/// Trouble of all kinds.
const SCRIPT: &str = r#"
[[event]]
type = "disease"
year = 4
species = "silver-fir"
[[event]]
type = "wind-storm"
year = 12
speed_m_s = 30
[[event]]
type = "drought"
year = 17
rain_fractions = [0.4, 0.4, 0.3, 0.2, 0.3]
[[event]]
type = "wildfire"
year = 31
wind_m_s = 5
"#;

/// A wood of 80 m in its own folder, called as all others are: pictures show the name.
struct Wood {
    home: TempDir,
}

impl Wood {
    fn new() -> Self {
        let home = tempfile::tempdir().unwrap();
        let terrain = GenerateParams {
            rows: 40,
            cols: 40,
            relief_m: 15.0,
            lowest_m: 1250.0,
            ..GenerateParams::default()
        };
        let folder = home.path().join("wood");
        demo::run(folder, "pyrenees", &terrain, &Reporter::silent()).unwrap();
        fs::write(home.path().join("events.toml"), SCRIPT).unwrap();
        Self { home }
    }

    fn copy(&self) -> Self {
        let home = tempfile::tempdir().unwrap();
        fs::create_dir(home.path().join("wood")).unwrap();
        for (name, content) in self.files() {
            fs::write(home.path().join("wood").join(name), content).unwrap();
        }
        fs::copy(self.events(), home.path().join("events.toml")).unwrap();
        Self { home }
    }

    fn folder(&self) -> PathBuf {
        self.home.path().join("wood")
    }

    fn events(&self) -> PathBuf {
        self.home.path().join("events.toml")
    }

    /// Everything in the folder, by name.
    fn files(&self) -> BTreeMap<String, Vec<u8>> {
        let entries = fs::read_dir(self.folder()).unwrap().map(|entry| entry.unwrap().path());
        let name = |path: &Path| path.file_name().unwrap().to_str().unwrap().to_owned();
        entries.map(|path| (name(&path), fs::read(&path).unwrap_or_default())).collect()
    }

    fn manifest(&self) -> Manifest {
        Manifest::read(&self.folder()).unwrap().unwrap()
    }

    /// Hashes of what was aged, as the manifest has them, checked against the files.
    fn hashes(&self) -> BTreeMap<String, String> {
        let manifest = self.manifest();
        let of = |stage: &str| manifest.stages[stage].files.clone();
        let hashes: BTreeMap<String, String> =
            [of(age::STAGE), of("forest_floor")].into_iter().flatten().collect();
        for (file, hash) in &hashes {
            let bytes = fs::read(self.folder().join(file)).unwrap();
            assert_eq!(&blake3::hash(&bytes).to_hex().to_string(), hash, "{file}");
        }
        hashes
    }

    fn request(&self, years: u16) -> AgeRequest {
        AgeRequest { events: Script::File(self.events()), ..AgeRequest::new(self.folder(), years) }
    }

    fn age(&self, years: u16) {
        age::run(&self.request(years), &Reporter::silent()).unwrap();
    }

    fn command(&self, options: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_wildwood"));
        command.arg("age").arg(self.folder()).arg("--events").arg(self.events()).args(options);
        command
    }
}

fn told(output: &Output) -> String {
    String::from_utf8([&output.stdout[..], &output.stderr[..]].concat()).unwrap()
}

#[test]
fn a_run_that_was_killed_ends_as_one_that_was_not() {
    let wood = Wood::new();
    let killed = wood.copy();
    wood.age(40);
    let mut kills = 0;
    for pause_ms in [0, 7, 29, 3, 53] {
        let mut run = killed
            .command(&["--years", "40", "--checkpoint", "5", "--quiet"])
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        while !killed.folder().join(CHECKPOINT).exists() && run.try_wait().unwrap().is_none() {
            sleep(Duration::from_millis(1));
        }
        sleep(Duration::from_millis(pause_ms));
        run.kill().unwrap(); // SIGKILL
        run.wait().unwrap();
        if killed.manifest().stages.contains_key(age::STAGE) {
            break; // done before the kill
        }
        kills += 1;
        assert!(killed.folder().join(CHECKPOINT).exists());
    }
    assert!(kills > 0, "no run could be killed");
    killed.age(40);
    assert_eq!(killed.hashes(), wood.hashes());
    // nothing of the killed runs is left
    assert_eq!(killed.files().keys().collect::<Vec<_>>(), wood.files().keys().collect::<Vec<_>>());
}

#[test]
fn a_damaged_checkpoint_costs_time_but_changes_nothing() {
    let wood = Wood::new();
    let other = wood.copy();
    wood.age(40);
    for damage in [&b"wildwood state 2"[..], &[7; 300], b""] {
        let other = other.copy();
        fs::write(other.folder().join(CHECKPOINT), damage).unwrap();
        other.age(40);
        assert_eq!(other.hashes(), wood.hashes());
    }
}

#[test]
fn a_longer_run_goes_on_and_a_finished_one_does_nothing() {
    let wood = Wood::new();
    let in_two = wood.copy();
    wood.age(40);
    // a script may not reach beyond the end, and a longer run with the same events is the same run
    let early = SCRIPT.split("[[event]]\ntype = \"wildfire\"").next().unwrap();
    for wood in [&wood, &in_two] {
        fs::write(wood.events(), early).unwrap();
    }
    let at_once = in_two.copy();
    at_once.age(40);
    in_two.age(20);
    let at_20 = in_two.hashes();
    in_two.age(40);
    assert_ne!(at_20, in_two.hashes());
    assert_eq!(in_two.hashes(), at_once.hashes());
    // other events, another forest: from the same start
    let with_fire = wood.hashes();
    assert_ne!(with_fire["plants.parquet"], at_once.hashes()["plants.parquet"]);
    assert_eq!(with_fire[age::START_FILE], at_once.hashes()[age::START_FILE]);
    fs::write(in_two.events(), SCRIPT).unwrap();
    in_two.age(40);
    assert_eq!(in_two.hashes(), with_fire);
    // and again: nothing is written
    let modified =
        || fs::metadata(in_two.folder().join("history.parquet")).unwrap().modified().unwrap();
    let (before, files) = (modified(), in_two.files());
    sleep(Duration::from_millis(20));
    in_two.age(40);
    assert_eq!(modified(), before);
    assert!(files == in_two.files());
    // fewer years are lived from the start
    fs::write(in_two.events(), early).unwrap();
    in_two.age(20);
    assert_eq!(in_two.hashes(), at_20);
}

#[test]
fn an_output_folder_gets_a_copy_and_the_scene_stays() {
    let wood = Wood::new();
    let before = wood.files();
    let output = wood.home.path().join("aged").join("wood");
    let request = AgeRequest { output: Some(output.clone()), ..wood.request(40) };
    let (manifest, folder) = age::run(&request, &Reporter::silent()).unwrap();
    assert!(wood.files() == before);
    assert_eq!((folder.as_path(), manifest.scene.name.as_str()), (output.as_path(), "wood"));
    // the copy is the scene's own, aged in place
    wood.age(40);
    assert_eq!(manifest.stages[age::STAGE].files, wood.manifest().stages[age::STAGE].files);
    // another scene's folder is not taken
    let other = tempfile::tempdir().unwrap();
    let terrain = GenerateParams { rows: 20, cols: 20, ..GenerateParams::default() };
    demo::run(other.path().join("wood"), "sonoma", &terrain, &Reporter::silent()).unwrap();
    let taken = AgeRequest { output: Some(other.path().join("wood")), ..wood.request(40) };
    let error = age::run(&taken, &Reporter::silent()).unwrap_err();
    assert!(error.is_bad_input() && error.to_string().contains("holds another scene"), "{error}");
}

#[test]
fn bad_scripts_are_told_with_line_and_key_and_nothing_is_written() {
    let wood = Wood::new();
    let before = wood.files();
    let output = wood.home.path().join("aged");
    let out = output.to_str().unwrap();
    let cases = [
        ("\"wildfire\"", "\"flood\"", "line 15: type = flood"),
        ("year = 31", "year = 0", "line 16: year = 0"),
        ("year = 31", "year = 41", "line 16: year"),
        (
            "year = 31",
            "year = 31\nignitions = [{ east_fraction = 0, north_fraction = 0, radius_m = -3 }]",
            "line 17: ignitions[1].radius_m = -3",
        ),
        ("\"silver-fir\"", "\"baobab\"", "line 5: species = baobab"),
        ("[0.4, 0.4,", "[0.4, 1.4,", "line 13: rain_fractions[2] = 1.4"),
    ];
    for (old, new, words) in cases {
        fs::write(wood.events(), SCRIPT.replacen(old, new, 1)).unwrap();
        for options in [&["--years", "40"][..], &["--years", "40", "-o", out]] {
            let refused = wood.command(options).output().unwrap();
            assert_eq!(refused.status.code(), Some(2), "{new}: {}", told(&refused));
            let told = told(&refused);
            assert!(told.contains(words) && told.contains("events.toml"), "{new}: {told}");
            assert!(wood.files() == before && !output.exists(), "{new}");
        }
    }
    fs::remove_file(wood.events()).unwrap();
    let missing = wood.command(&["--years", "40"]).output().unwrap();
    assert_eq!(missing.status.code(), Some(2), "{}", told(&missing));
    for options in
        [&["--years", "0"][..], &["--years", "10001"], &["--years", "4", "--checkpoint", "0"]]
    {
        let refused = wood.command(options).output().unwrap();
        assert_eq!(refused.status.code(), Some(2), "{options:?}: {}", told(&refused));
    }
    assert!(wood.files() == before);
}

#[test]
fn growing_anew_ends_the_aged_forest() {
    let wood = Wood::new();
    wood.age(40);
    assert!(wood.folder().join("snags.parquet").exists());
    let grown = Command::new(env!("CARGO_BIN_EXE_wildwood"))
        .args(["grow", wood.folder().to_str().unwrap(), "--gpu", "off", "--quiet"])
        .args(["--shares", "silver-fir=1"])
        .output()
        .unwrap();
    assert!(grown.status.success(), "{}", told(&grown));
    assert!(!wood.manifest().stages.contains_key(age::STAGE));
    let left = wood.files();
    for name in ["snags", "downed_logs", "history", "timeline", "plants_at_start"] {
        assert!(!left.contains_key(&format!("{name}.parquet")), "{name}");
    }
    assert!(left.contains_key("plants.parquet") && !left.contains_key("age_state.bin"));
}

#[test]
fn histories_of_plants_that_never_lived_are_told() {
    let wood = Wood::new();
    let aged = wood.command(&["--years", "31", "--history", "1,999999999"]).output().unwrap();
    let stderr = told(&aged);
    assert!(aged.status.success() && stderr.contains("no plant of id 999999999"), "{stderr}");
    assert!(wood.files().contains_key("growth.parquet"), "plant 1 did live");
}

#[test]
fn any_number_of_threads_gives_the_same_files() {
    let wood = Wood::new();
    let other = wood.copy();
    for (wood, threads) in [(&wood, "1"), (&other, "2")] {
        let options = ["--years", "40", "--threads", threads, "--history", "full", "--quiet"];
        let aged = wood.command(&options).output().unwrap();
        assert!(aged.status.success(), "{}", told(&aged));
    }
    let hashes = wood.hashes();
    assert_eq!(hashes, other.hashes());
    for name in ["plants", "snags", "downed_logs", "history", "timeline", "growth"] {
        assert!(hashes.contains_key(&format!("{name}.parquet")), "{name}");
    }
}
