//! `wildwood grow` from end to end: what is redone, and what is said of canopies that do not fit.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use wildwood::io::geotiff::{Band, CogBands, CogOptions, StoredBands, write_cog};
use wildwood::raster::{Crs, Frame, GeoTransform, Mask};

const SIDE: usize = 120;

fn wildwood(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_wildwood")).args(arguments).output().unwrap()
}

fn write_tiff(path: &Path, crs: u32, west_m: f64, value: impl Fn(usize, usize) -> Option<f32>) {
    let transform = GeoTransform { west_m, north_m: 4_100_000.0, cell_m: 1.0 };
    let frame = Frame { rows: SIDE, cols: SIDE, transform, crs: Crs::Epsg(crs) };
    let values: Vec<Option<f32>> = (0..frame.len()).map(|i| value(i / SIDE, i % SIDE)).collect();
    let mask = Mask::new(values.iter().map(Option::is_some).collect());
    let values: Vec<f32> = values.into_iter().map(Option::unwrap_or_default).collect();
    let bands = [Band { name: "height".to_owned(), unit: "m".to_owned() }];
    let source = StoredBands::new(&frame, vec![&values]);
    let image = CogBands { frame: &frame, mask: &mask, bands: &bands, source: &source };
    write_cog(&mut fs::File::create(path).unwrap(), &image, &CogOptions::default()).unwrap();
}

/// Domes 10 m apart, 12 m high.
fn domes(row: usize, col: usize) -> f32 {
    let from_middle = |at: usize| (at % 10) as f32 - 5.0;
    (12.0 - 0.4 * (from_middle(row).powi(2) + from_middle(col).powi(2))).max(0.0)
}

/// A folder with a terrain, and the paths of terrain, canopy and scene.
fn home(canopy: impl Fn(&Path)) -> (tempfile::TempDir, [PathBuf; 3]) {
    let home = tempfile::tempdir().unwrap();
    let [dem, chm, forest] = ["dem.tif", "chm.tif", "forest"].map(|name| home.path().join(name));
    write_tiff(&dem, 32611, 500_000.0, |row, col| Some(100.0 + 0.1 * (row + col) as f32));
    canopy(&chm);
    (home, [dem, chm, forest])
}

fn grow(paths: &[PathBuf; 3], options: &[&str]) -> Output {
    let [dem, chm, forest] = paths.each_ref().map(|path| path.to_str().unwrap());
    let mut arguments = vec!["grow", dem, "--chm", chm, "-o", forest, "--json", "--gpu", "off"];
    arguments.extend(options);
    wildwood(&arguments)
}

fn told(output: &Output) -> String {
    let text = [&output.stdout[..], &output.stderr[..]].concat();
    String::from_utf8(text).unwrap()
}

fn stage(folder: &Path, name: &str) -> toml::Table {
    let text = fs::read_to_string(folder.join("scene.toml")).unwrap();
    let scene: toml::Table = text.parse().unwrap();
    scene["stages"][name].as_table().unwrap().clone()
}

fn figures(folder: &Path) -> toml::Table {
    stage(folder, "canopy")["figures"].as_table().unwrap().clone()
}

#[test]
fn a_changed_share_redoes_the_trees_alone_and_nothing_changed_nothing() {
    let (_home, paths) = home(|chm| write_tiff(chm, 32611, 500_000.0, |r, c| Some(domes(r, c))));
    let ran = |output: &Output, stage: &str| {
        assert!(output.status.success(), "{}", told(output));
        told(output).contains(&format!("\"stage\":\"{stage}\""))
    };
    let first = grow(&paths, &[]);
    assert!(ran(&first, "sunlight") && ran(&first, "placement"));
    let trees = figures(&paths[2])["trees"].as_integer().unwrap();
    assert!((144..700).contains(&trees), "{trees} trees for 144 domes");
    let again = grow(&paths, &[]);
    assert!(!ran(&again, "sunlight") && !ran(&again, "placement"));
    let shares = grow(&paths, &["--shares", "coast-live-oak=1"]);
    assert!(!ran(&shares, "sunlight") && ran(&shares, "placement"));
    let by_species = figures(&paths[2])["trees_by_species"].clone();
    assert_eq!(by_species.as_table().unwrap().keys().collect::<Vec<_>>(), ["coast-live-oak"]);
    // the scene folder itself serves too
    let [_, chm, forest] = paths.each_ref().map(|path| path.to_str().unwrap());
    let in_place = wildwood(&["grow", forest, "--chm", chm, "--table", "csv", "--json"]);
    assert!(!ran(&in_place, "sunlight") && ran(&in_place, "placement"));
    assert!(paths[2].join("plants.csv").exists() && paths[2].join("plants.parquet").exists());
    // and importing again finds terrain and maps as they were
    let dem = paths[0].to_str().unwrap();
    let import = wildwood(&["import", dem, "-o", forest, "--json"]);
    assert!(!ran(&import, "sunlight") && paths[2].join("plants.csv").exists());
}

#[test]
fn undergrowth_is_grown_refined_and_left_out() {
    let (_home, paths) = home(|chm| write_tiff(chm, 32611, 500_000.0, |r, c| Some(domes(r, c))));
    let undergrowth = || stage(&paths[2], "undergrowth")["figures"].clone();
    let done = |options: &[&str]| {
        let output = grow(&paths, options);
        assert!(output.status.success(), "{}", told(&output));
        told(&output)
    };
    done(&[]);
    let plants = undergrowth()["plants"].as_integer().unwrap();
    assert!(plants > 500, "{plants} plants");
    assert!(paths[2].join("grass.tif").exists() && paths[2].join("litterfall.tif").exists());
    let sampled = fs::read(paths[2].join("plants.parquet")).unwrap();

    let outside = grow(&paths, &["--refine-area", "100,100,50"]);
    assert_eq!(outside.status.code(), Some(2), "{}", told(&outside));
    assert!(told(&outside).contains("--refine-area"), "{}", told(&outside));
    assert_eq!(fs::read(paths[2].join("plants.parquet")).unwrap(), sampled);

    assert!(done(&["--refine"]).contains("refinement"));
    assert_eq!(undergrowth()["plants"].as_integer(), Some(plants));
    assert_ne!(fs::read(paths[2].join("plants.parquet")).unwrap(), sampled);
    assert!(!done(&["--refine"]).contains("refinement"), "nothing has changed");

    done(&["--no-undergrowth"]);
    assert_eq!(undergrowth()["plants"].as_integer(), Some(0));
    done(&[]);
    assert_eq!(fs::read(paths[2].join("plants.parquet")).unwrap(), sampled);
}

#[test]
fn a_canopy_half_a_cell_off_is_resampled() {
    let (_home, paths) = home(|chm| write_tiff(chm, 32611, 500_000.5, |r, c| Some(domes(r, c))));
    let output = grow(&paths, &[]);
    assert!(output.status.success(), "{}", told(&output));
    assert!(figures(&paths[2])["coverage_fraction"].as_float().unwrap() > 0.95);
}

#[test]
fn a_canopy_without_trees_is_told_of() {
    let (_home, paths) = home(|chm| write_tiff(chm, 32611, 500_000.0, |_, _| Some(0.0)));
    let output = grow(&paths, &[]);
    assert!(output.status.success() && told(&output).contains("no trees"), "{}", told(&output));
    assert_eq!(figures(&paths[2])["trees"].as_integer(), Some(0));
}

#[test]
fn canopies_that_cannot_be_used_are_refused() {
    let refused = |canopy: &dyn Fn(&Path), options: &[&str], words: &[&str]| {
        let (_home, paths) = home(canopy);
        let output = grow(&paths, options);
        let told = told(&output);
        assert_eq!(output.status.code(), Some(2), "{told}");
        assert!(words.iter().all(|word| told.contains(word)), "{told}");
        assert!(!paths[2].join("plants.parquet").exists());
    };
    let good = |chm: &Path| write_tiff(chm, 32611, 500_000.0, |r, c| Some(domes(r, c)));
    refused(&|chm| write_tiff(chm, 32611, 500_000.0, |_, _| None), &[], &["chm.tif"]);
    refused(&|chm| write_tiff(chm, 32611, 600_000.0, |_, _| Some(9.0)), &[], &["overlap"]);
    refused(&|chm| write_tiff(chm, 32618, 500_000.0, |_, _| Some(9.0)), &[], &["overlap"]);
    refused(&|chm| write_tiff(chm, 32611, 500_000.0, |_, _| Some(412.0)), &[], &["above ground"]);
    refused(&|chm| fs::write(chm, "no raster").unwrap(), &[], &["chm.tif"]);
    refused(&good, &["--shares", "redwood=0.7,douglas-fir=0.6"], &["1.3"]);
    refused(&good, &["--shares", "baobab=0.7"], &["baobab", "redwood"]);
    refused(&good, &["--exclude", "nowhere.geojson"], &["nowhere.geojson"]);
    refused(&good, &["--min-height", "0"], &["--min-height"]);
}

#[test]
fn what_is_wrong_is_told_before_a_grown_scene_is_touched() {
    let (home, paths) = home(|chm| write_tiff(chm, 32611, 500_000.0, |r, c| Some(domes(r, c))));
    assert!(grow(&paths, &[]).status.success());
    let trees = fs::read(paths[2].join("plants.parquet")).unwrap();
    let missing = home.path().join("missing.tif");
    let text = home.path().join("text.tif");
    fs::write(&text, "no raster").unwrap();
    let with_chm = |chm: &Path| {
        let [dem, forest] = [&paths[0], &paths[2]].map(|path| path.to_str().unwrap());
        wildwood(&["grow", dem, "--chm", chm.to_str().unwrap(), "-o", forest, "--cell", "2"])
    };
    for failed in [
        with_chm(&missing),
        with_chm(&text),
        grow(&paths, &["--cell", "2", "--shares", "redwod=1"]),
        grow(&paths, &["--cell", "2", "--exclude", missing.to_str().unwrap()]),
        grow(&paths, &["--cell", "2", "--min-height", "150"]),
    ] {
        assert_eq!(failed.status.code(), Some(2), "{}", told(&failed));
        assert_eq!(fs::read(paths[2].join("plants.parquet")).unwrap(), trees);
    }
}

#[test]
fn importing_with_another_biome_takes_the_trees_and_keeps_their_canopy() {
    let (_home, paths) = home(|chm| write_tiff(chm, 32611, 500_000.0, |r, c| Some(domes(r, c))));
    assert!(grow(&paths, &[]).status.success());
    let [dem, _, forest] = paths.each_ref().map(|path| path.to_str().unwrap());
    let import = wildwood(&["import", dem, "-o", forest, "--biome", "pyrenees"]);
    assert!(told(&import).contains("trees grown here"), "{}", told(&import));
    assert!(!paths[2].join("plants.parquet").exists() && paths[2].join("preview.png").exists());
    assert!(!paths[2].join("grass.tif").exists() && !paths[2].join("litterfall.tif").exists());
    let regrown = wildwood(&["grow", forest, "--json"]);
    assert!(regrown.status.success(), "{}", told(&regrown));
    assert!(paths[2].join("plants.parquet").exists());
}

#[test]
fn a_canopy_that_looks_like_a_surface_model_or_covers_a_part_is_told_of() {
    let (_home, paths) =
        home(|chm| write_tiff(chm, 32611, 500_000.0, |r, c| Some(40.0 + domes(r, c))));
    assert!(told(&grow(&paths, &[])).contains("surface model"));
    let (_home, paths) = home(|chm| {
        write_tiff(chm, 32611, 500_000.0, |r, c| (c < SIDE / 2).then(|| domes(r, c)));
    });
    assert!(told(&grow(&paths, &[])).contains("50 % of the land has no canopy height"));
}
