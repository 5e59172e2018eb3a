//! The examples for newcomers run with nothing but a folder, and leave what they say.

use std::env;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Where cargo puts examples: beside the folder of this test.
fn example(name: &str) -> PathBuf {
    let test = env::current_exe().unwrap();
    let profile = test.parent().and_then(Path::parent).unwrap();
    let file = format!("{name}{}", env::consts::EXE_SUFFIX);
    let path = profile.join("examples").join(file);
    let path_shown = path.display();
    assert!(
        path.is_file(),
        "{path_shown}: not built; run `cargo test` or `cargo build --examples`"
    );
    path
}

/// Runs an example in an empty folder and gives what it says.
fn run(home: &Path, name: &str, arguments: &[&str]) -> String {
    let done = Command::new(example(name)).args(arguments).current_dir(home).output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    let (out, err) = (text(done.stdout), text(done.stderr));
    assert!(done.status.success(), "{name} {arguments:?} failed: {out}{err}");
    out
}

/// Width and height of a PNG that shows more than one colour.
fn picture(path: &Path) -> (u32, u32) {
    let picture = image::open(path).unwrap().into_rgb8();
    let first = picture.get_pixel(0, 0);
    assert!(picture.pixels().any(|pixel| pixel != first), "{}: one colour", path.display());
    picture.dimensions()
}

#[test]
fn quickstart_leaves_a_table_and_a_map() {
    let home = tempfile::tempdir().unwrap();
    let said = run(home.path(), "quickstart", &["forest", "64"]);
    let table = fs::read_to_string(home.path().join("forest/plants.csv")).unwrap();
    let said: Vec<usize> = said.split_whitespace().filter_map(|word| word.parse().ok()).collect();
    assert!(said.len() == 2 && said.iter().all(|count| *count > 50), "{said:?}");
    assert_eq!(table.lines().count(), 1 + said[0] + said[1]);
    assert!(picture(&home.path().join("forest/map.png")).0 > 1000);
}

#[test]
fn a_sketch_becomes_a_forest() {
    let home = tempfile::tempdir().unwrap();
    run(home.path(), "sketch_to_forest", &["woods"]);
    let glb = fs::read(home.path().join("woods/forest.glb")).unwrap();
    assert_eq!(&glb[..4], b"glTF");
    let scene = home.path().join("woods/scene");
    for file in ["scene.toml", "terrain.tif", "sketch.tif", "chm.tif", "plants.parquet"] {
        assert!(scene.join(file).is_file(), "{file} is missing");
    }
    // with files of one's own
    let given = ["mine", "woods/dtm.tif", "woods/sketch.png"];
    run(home.path(), "sketch_to_forest", &given);
    assert!(fs::read(home.path().join("mine/forest.glb")).unwrap().starts_with(b"glTF"));
    let half = Command::new(example("sketch_to_forest"))
        .args(["mine", "woods/dtm.tif"])
        .current_dir(home.path())
        .output()
        .unwrap();
    assert!(!half.status.success() && String::from_utf8_lossy(&half.stderr).contains("usage"));
}

#[test]
fn a_storm_leaves_downed_logs() {
    let home = tempfile::tempdir().unwrap();
    let said = run(home.path(), "ageing_with_a_storm", &["stormy", "8", "48"]);
    let row = said.lines().find(|line| line.starts_with("downed logs ")).unwrap();
    let counts: Vec<usize> = row.split_whitespace().filter_map(|word| word.parse().ok()).collect();
    assert!(counts[1] > 2 * counts[0].max(1), "{said}");
    assert_eq!(picture(&home.path().join("stormy/after_the_storm.png")), (800, 500));
}
