//! Bad input gets one clear error that names the file and what to do, the right exit code, and leaves nothing behind.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn wildwood(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_wildwood")).args(arguments).output().unwrap()
}

fn import(inputs: &[&Path], folder: &Path, options: &[&str]) -> Output {
    let mut arguments = vec!["import"];
    arguments.extend(inputs.iter().map(|path| path.to_str().unwrap()));
    arguments.extend(["-o", folder.to_str().unwrap(), "--quiet"]);
    arguments.extend(options);
    wildwood(&arguments)
}

/// One error on one line, with the exit code; gives the line.
fn told(output: &Output, exit_code: i32) -> String {
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(exit_code), "{told}");
    assert_eq!(told.trim().lines().count(), 1, "one error, not: {told}");
    assert!(told.starts_with("error: ") && !told.contains("panicked"), "{told}");
    told
}

/// A classic little-endian TIFF: tags with their values as bytes, and one strip.
struct Tiff {
    entries: Vec<(u16, u16, Vec<u8>)>,
    strip: Vec<u8>,
}

const SHORT: u16 = 3;
const LONG: u16 = 4;
const DOUBLE: u16 = 12;
const WIDTH: u16 = 256;
const BITS: u16 = 258;
const PHOTOMETRIC: u16 = 262;
const STRIP_OFFSETS: u16 = 273;
const SAMPLES: u16 = 277;
const SAMPLE_FORMAT: u16 = 339;
const PIXEL_SCALE: u16 = 33550;
const TIE_POINT: u16 = 33922;
const GEO_KEYS: u16 = 34735;
const NODATA: u16 = 42113;

impl Tiff {
    /// Float heights on a local metric grid of 2 m cells, without a CRS.
    fn new(rows: u32, cols: u32, heights: impl IntoIterator<Item = f32>) -> Self {
        let strip: Vec<u8> = heights.into_iter().flat_map(f32::to_le_bytes).collect();
        let made = Self { entries: Vec::new(), strip };
        made.long(WIDTH, cols)
            .long(257, rows)
            .shorts(BITS, &[32])
            .shorts(259, &[1])
            .shorts(PHOTOMETRIC, &[1])
            .long(STRIP_OFFSETS, 0) // set when written
            .shorts(SAMPLES, &[1])
            .long(278, rows)
            .long(279, rows.wrapping_mul(cols).wrapping_mul(4))
            .shorts(SAMPLE_FORMAT, &[3])
            .doubles(PIXEL_SCALE, &[2.0, 2.0, 0.0])
            .doubles(TIE_POINT, &[0.0, 0.0, 0.0, 1000.0, 2000.0, 0.0])
    }

    fn with(mut self, tag: u16, kind: u16, value: Vec<u8>) -> Self {
        self.entries.retain(|(t, ..)| *t != tag);
        self.entries.push((tag, kind, value));
        self.entries.sort_by_key(|(tag, ..)| *tag);
        self
    }

    fn long(self, tag: u16, value: u32) -> Self {
        self.with(tag, LONG, value.to_le_bytes().to_vec())
    }

    fn shorts(self, tag: u16, values: &[u16]) -> Self {
        self.with(tag, SHORT, values.iter().flat_map(|v| v.to_le_bytes()).collect())
    }

    fn doubles(self, tag: u16, values: &[f64]) -> Self {
        self.with(tag, DOUBLE, values.iter().flat_map(|v| v.to_le_bytes()).collect())
    }

    fn nodata(self, text: &str) -> Self {
        self.with(NODATA, 2, format!("{text}\0").into_bytes())
    }

    fn without_position(mut self) -> Self {
        self.entries.retain(|(tag, ..)| ![PIXEL_SCALE, TIE_POINT].contains(tag));
        self
    }

    /// The same cells in degrees, in EPSG:4326.
    fn in_degrees(self) -> Self {
        self.doubles(PIXEL_SCALE, &[0.001, 0.001, 0.0])
            .doubles(TIE_POINT, &[0.0, 0.0, 0.0, -122.0, 38.0, 0.0])
            .shorts(GEO_KEYS, &[1, 1, 0, 2, 1024, 0, 1, 2, 2048, 0, 1, 4326])
    }

    fn bytes(&self) -> Vec<u8> {
        let mut bytes = vec![b'I', b'I', 42, 0, 8, 0, 0, 0];
        bytes.extend((self.entries.len() as u16).to_le_bytes());
        let after = bytes.len() + 12 * self.entries.len() + 4;
        let outside = |value: &[u8]| if value.len() > 4 { value.len() } else { 0 };
        let strip_start = after + self.entries.iter().map(|(.., v)| outside(v)).sum::<usize>();
        let mut payload: Vec<u8> = Vec::new();
        for (tag, kind, value) in &self.entries {
            let size = match *kind {
                SHORT => 2,
                LONG => 4,
                DOUBLE => 8,
                _ => 1,
            };
            bytes.extend(tag.to_le_bytes());
            bytes.extend(kind.to_le_bytes());
            bytes.extend(((value.len() / size) as u32).to_le_bytes());
            let mut inline = match *tag {
                STRIP_OFFSETS => (strip_start as u32).to_le_bytes().to_vec(),
                _ if outside(value) > 0 => {
                    let start = (after + payload.len()) as u32;
                    payload.extend(value);
                    start.to_le_bytes().to_vec()
                }
                _ => value.clone(),
            };
            inline.resize(4, 0);
            bytes.extend(inline);
        }
        bytes.extend([0; 4]);
        bytes.extend(payload);
        bytes.extend(&self.strip);
        bytes
    }
}

/// 8 × 8 cells that make terrain.
fn good() -> Tiff {
    Tiff::new(8, 8, (0..64).map(|i| i as f32))
}

/// LAS 1.2 of point format 0: (x, y, z) in metres and the class of each.
fn las(points: &[([f64; 3], u8)]) -> Vec<u8> {
    let mut bytes = vec![0; 227];
    let mut put = |at: usize, value: &[u8]| bytes[at..at + value.len()].copy_from_slice(value);
    put(0, b"LASF");
    put(24, &[1, 2]);
    put(94, &227_u16.to_le_bytes());
    put(96, &227_u32.to_le_bytes());
    put(105, &20_u16.to_le_bytes());
    put(107, &(points.len() as u32).to_le_bytes());
    for axis in 0..3 {
        put(131 + 8 * axis, &0.01_f64.to_le_bytes());
    }
    for (position, class) in points {
        for coordinate in position {
            bytes.extend(((coordinate / 0.01).round() as i32).to_le_bytes());
        }
        bytes.extend([0, 0, 0b001_001, *class, 0, 0, 0, 0]);
    }
    bytes
}

struct Case {
    name: &'static str,
    file: &'static str,
    content: Vec<u8>,
    options: &'static [&'static str],
    says: &'static [&'static str],
}

fn case(
    name: &'static str,
    file: &'static str,
    content: impl Into<Vec<u8>>,
    says: &'static [&'static str],
) -> Case {
    Case { name, file, content: content.into(), options: &[], says }
}

fn raster_cases() -> Vec<Case> {
    let asc = |body: &str| format!("ncols 8\nnrows 8\nxllcorner 0\nyllcorner 0\n{body}");
    let rows = |value: &str| format!("{value} ").repeat(64);
    let filled = |value: f32| Tiff::new(8, 8, [value; 64]).bytes();
    let picture = Tiff { strip: vec![90; 192], ..good() }
        .shorts(BITS, &[8, 8, 8])
        .shorts(PHOTOMETRIC, &[2])
        .shorts(SAMPLES, &[3])
        .shorts(SAMPLE_FORMAT, &[1, 1, 1]);
    let holes = |nodata: &str| {
        Tiff::new(8, 8, (0..64).map(|i| if i % 2 == 0 { -32_768.0 } else { i as f32 }))
            .nodata(nodata)
            .bytes()
    };
    let cut = &good().bytes()[..300];
    let text = "Dear reader, there is no terrain in here.\n".repeat(20);
    let png = [b"\x89PNG\r\n\x1a\n".as_slice(), &[0; 200]].concat();
    vec![
        case("truncated", "cut.tif", cut, &["cut short", "download it again"]),
        case("header only", "head.tif", *b"II*\0", &["download it again"]),
        case("wrong type", "holiday.jpg", *b"\xff\xd8\xff\xe0 no", &["gdal_translate"]),
        case("a text named .tif", "text.tif", text.as_str(), &["format is not known", "GeoTIFF"]),
        case("a text named .asc", "text.asc", text.as_str(), &["line 1", "ncols"]),
        case("a PNG named .tif", "png.tif", png, &["format is not known", "GeoTIFF"]),
        case("an RGB picture", "photo.tif", picture.bytes(), &["picture", "elevation raster"]),
        case("empty file", "empty.tif", [], &["empty", "download it again"]),
        case("empty grid", "empty.asc", [], &["empty", "download it again"]),
        case("absurd size", "huge.tif", huge_tiff(), &["40"]),
        case("no cells", "none.tif", Tiff::new(0, 8, []).bytes(), &[]),
        case("three cells", "tiny.tif", Tiff::new(1, 3, [1.0; 3]).bytes(), &["too few", "larger"]),
        case("nowhere", "bare.tif", good().without_position().bytes(), &["position", "-a_ullr"]),
        case(
            "cells without area",
            "flat.tif",
            good().doubles(PIXEL_SCALE, &[0.0, 0.0, 0.0]).bytes(),
            &["gdal_translate -a_ullr"],
        ),
        case(
            "NaN for a place",
            "lost.tif",
            good().doubles(TIE_POINT, &[0.0, 0.0, 0.0, f64::NAN, 0.0, 0.0]).bytes(),
            &["gdal_translate -a_ullr"],
        ),
        case(
            "degrees off the globe",
            "pole.tif",
            good().in_degrees().doubles(PIXEL_SCALE, &[20.0, 20.0, 0.0]).bytes(),
            &["EPSG:4326", "CRS right"],
        ),
        case("all NaN", "nan.tif", filled(f32::NAN), &["nodata"]),
        case("all infinite", "inf.tif", filled(f32::INFINITY), &["nodata"]),
        case("a mark of no kind", "void.tif", filled(-22_222.0), &["-22222", "undeclared"]),
        case("nodata is a word", "word.tif", holes("none"), &["nodata"]),
        case("nodata is two numbers", "two.tif", holes("-32768 -9999"), &["nodata"]),
        case("centimetres", "cm.tif", filled(45_000.0), &["45000", "--vertical-unit"]),
        case("zero cell", "zero.asc", asc(&format!("cellsize 0\n{}", rows("5"))), &["cell"]),
        case("negative cell", "neg.asc", asc(&format!("cellsize -2\n{}", rows("5"))), &["cell"]),
        case(
            "all nodata",
            "void.asc",
            asc(&format!("cellsize 1\nNODATA_value -9999\n{}", rows("-9999"))),
            &["nodata"],
        ),
        case("no number", "word.asc", asc(&format!("cellsize 1\n5 cow {}", rows("5"))), &["cow"]),
        case("too few numbers", "short.asc", asc("cellsize 1\n5 5 5"), &["8 rows"]),
        case(
            "absurd ascii",
            "big.asc",
            "ncols 90000\nnrows 90000\nxllcorner 0\nyllcorner 0\ncellsize 1\n1",
            &["90"],
        ),
        case("elv without rows", "short.elv", "256 256 2.0 42.5\n1 2 3", &["256 rows"]),
        case(
            "elv beyond the pole",
            "north.elv",
            format!("8 8 2.0 99.0\n{}", rows("5")),
            &["latitude"],
        ),
    ]
}

fn cloud_cases() -> Vec<Case> {
    let canopy: Vec<_> =
        (0..900).map(|i| ([f64::from(i % 30), f64::from(i / 30), 12.0], 5)).collect();
    let lone = [([0.0, 0.0, 5.0], 2), ([500.0, 500.0, 6.0], 2)];
    let noise: Vec<_> = canopy.iter().map(|(at, _)| (*at, 7)).collect();
    let whole = las(&canopy);
    let cut = &whole[..whole.len() / 2];
    let overdone = {
        let mut bytes = whole.clone();
        bytes[107..111].copy_from_slice(&u32::MAX.to_le_bytes());
        bytes
    };
    vec![
        case("broken cloud", "cut.laz", *b"LASF\0\0\0\0", &["download it again"]),
        case("half a cloud", "half.las", cut, &["download it again"]),
        case("absurd cloud", "many.las", overdone, &["4294967295"]),
        case("no points", "none.las", las(&[]), &["no points", "another cloud"]),
        case("only noise", "noise.las", las(&noise), &["noise", "another cloud"]),
        case("no ground", "canopy.las", whole.as_slice(), &["ground", "pdal"]),
        case("named as a raster", "canopy.tif", whole.as_slice(), &["ground", "pdal"]),
        case("two points", "lone.las", las(&lone), &["from the others", "--bbox"]),
        case("a raster named .laz", "raster.laz", good().bytes(), &["no LAS or LAZ"]),
    ]
}

fn option_cases() -> Vec<Case> {
    let with =
        |name, options, says| Case { name, file: "a.tif", content: good().bytes(), options, says };
    vec![
        with("zero --cell", &["--cell", "0"], &["cell width 0", "give metres"]),
        with("negative --cell", &["--cell=-1"], &["cell width -1", "give metres"]),
        with("NaN --cell", &["--cell", "NaN"], &["cell width NaN", "give metres"]),
        with("wide --cell", &["--cell", "500"], &["a.tif", "too few"]),
        with("unknown --crs", &["--crs", "EPSG:999999"], &["EPSG:999999"]),
        with("--crs is prose", &["--crs", "the usual"], &["the usual", "EPSG:n"]),
        with("wrong --crs", &["--crs", "EPSG:4326"], &["a.tif", "EPSG:4326", "CRS right"]),
        with("unknown --biome", &["--biome", "mars"], &["mars", "sonoma"]),
        with(
            "--bbox elsewhere",
            &["--bbox", "9000,9000,9100,9100"],
            &["a.tif", "window", "1000,1984,1016,2000"],
        ),
        with("--bbox back to front", &["--bbox", "1010,1990,1000,2000"], &["--bbox", "WEST"]),
        with("three for --bbox", &["--bbox", "1,2,3"], &["--bbox", "four"]),
        with("NaN in --bbox", &["--bbox", "NaN,1,2,3"], &["--bbox", "WEST"]),
        with("NaN --latitude", &["--latitude", "NaN"], &["latitude NaN", "give degrees"]),
        with("far --latitude", &["--latitude", "-91"], &["latitude -91", "give degrees"]),
        with("NaN --fill-holes", &["--fill-holes", "NaN"], &["NaN", "give an area"]),
        with("no climate", &["--climate", "nowhere.toml"], &["nowhere.toml", "check the path"]),
    ]
}

#[test]
fn each_bad_input_is_told_and_leaves_nothing() {
    for cases in [raster_cases(), cloud_cases(), option_cases()] {
        for case in cases {
            let home = tempfile::tempdir().unwrap();
            let input = home.path().join(case.file);
            fs::write(&input, &case.content).unwrap();
            let output = import(&[&input], &home.path().join("out/forest"), case.options);
            eprintln!("{}", case.name); // shown if it fails
            let told = told(&output, 2);
            if case.options.is_empty() {
                assert!(told.contains(case.file), "{}: no file in: {told}", case.name);
            }
            for word in case.says {
                assert!(told.contains(word), "{}: `{word}` is not in: {told}", case.name);
            }
            let left = fs::read_dir(home.path()).unwrap().count();
            assert_eq!(left, 1, "{}: something was left behind", case.name);
        }
    }
}

/// What is odd and still says what it means is read.
#[test]
fn odd_input_is_no_bad_input() {
    let spotted =
        |hole: f32| Tiff::new(16, 16, (0..256).map(move |i| if i == 87 { hole } else { i as f32 }));
    let rasters = [
        ("nan declared", spotted(f32::NAN).nodata("nan")),
        ("NaN undeclared", spotted(f32::NAN)),
        ("lowest float declared", spotted(f32::MIN).nodata("-3.4028234663852886e+38")),
        ("with spaces", spotted(-9999.0).nodata(" -9999 ")),
        ("another mark than declared", spotted(-32_768.0).nodata("-9999")),
        ("nothing declared", spotted(-9999.0)),
        ("one stray height", spotted(-22_222.0)),
    ];
    for (name, tiff) in rasters {
        let home = tempfile::tempdir().unwrap();
        let (input, forest) = (home.path().join("a.tif"), home.path().join("forest"));
        fs::write(&input, tiff.bytes()).unwrap();
        let output = import(&[&input], &forest, &["--fill-holes", "0"]);
        let errors = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{name}: {errors}");
        let scene = fs::read_to_string(forest.join("scene.toml")).unwrap();
        assert!(scene.contains("masked_cells = 1\n"), "{name}: {scene}");
    }
}

#[test]
fn a_bad_climate_is_told_with_its_place() {
    let home = tempfile::tempdir().unwrap();
    let (input, climate) = (home.path().join("a.tif"), home.path().join("climate.toml"));
    fs::write(&input, good().bytes()).unwrap();
    let valid =
        fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("species/sonoma.toml"))
            .unwrap();
    let start = valid.find("[climate]").unwrap();
    let end = valid[start + 1..].find("\n[").map_or(valid.len(), |at| start + 1 + at);
    let valid = &valid[start..end];
    let latitude = valid.lines().find(|line| line.starts_with("latitude_deg")).unwrap();
    let rain = valid.lines().find(|line| line.starts_with("rain_mm")).unwrap();
    let forest = home.path().join("forest");
    let options = ["--climate", climate.to_str().unwrap()];
    fs::write(&climate, valid).unwrap();
    assert!(import(&[&input], &home.path().join("fine"), &options).status.success());
    let wrong = [
        (b"".to_vec(), "climate"),
        (b"hello".to_vec(), "line 1"),
        (vec![0xff, 0xfe, 0, 1], "no text"),
        (valid.replace(latitude, "latitude_deg = 95.0").into(), "latitude_deg = 95"),
        (valid.replace(latitude, "latitude_deg = nan").into(), "latitude_deg = NaN"),
        (valid.replace(latitude, "latitude_deg = \"north\"").into(), "line 2"),
        (valid.replace(latitude, "").into(), "latitude_deg"),
        (valid.replace(rain, "rain_mm = [1.0]").into(), "rain_mm"),
        (valid.replace("rain_mm", "rain_cm").into(), "rain_cm"),
    ];
    for (content, says) in wrong {
        fs::write(&climate, &content).unwrap();
        let told = told(&import(&[&input], &forest, &options), 2);
        assert!(told.contains("climate.toml") && told.contains(says), "{says}: {told}");
        assert!(!forest.exists());
    }
}

#[test]
fn a_missing_file_is_bad_input_and_a_folder_or_device_is_too() {
    let home = tempfile::tempdir().unwrap();
    let forest = home.path().join("forest");
    let mut inputs = vec![home.path().join("gone.tif"), home.path().join("gone.laz")];
    inputs.push(home.path().to_path_buf());
    if cfg!(unix) {
        inputs.push(PathBuf::from("/dev/zero")); // would be read for ever
    }
    for input in inputs {
        let told = told(&import(&[&input], &forest, &[]), 2);
        assert!(told.contains(input.to_str().unwrap()), "{told}");
        assert!(!forest.exists());
    }
}

#[test]
fn inputs_that_do_not_go_together_are_named() {
    let home = tempfile::tempdir().unwrap();
    let forest = home.path().join("forest");
    let moved = good().doubles(TIE_POINT, &[0.0, 0.0, 0.0, 9e5, 9e5, 0.0]);
    let ground: Vec<_> =
        (0..900).map(|i| ([f64::from(i % 30), f64::from(i / 30), 1.0], 2)).collect();
    let files = [
        ("plain.tif", good().bytes()),
        ("copy.tif", good().bytes()),
        ("geo.tif", good().in_degrees().bytes()),
        ("far.tif", moved.bytes()),
        ("cloud.las", las(&ground)),
    ];
    for (name, content) in &files {
        fs::write(home.path().join(name), content).unwrap();
    }
    let pairs = [
        (["plain.tif", "geo.tif"], "reproject"),
        (["plain.tif", "far.tif"], "one by one"),
        (["plain.tif", "copy.tif"], "once"),
        (["plain.tif", "plain.tif"], "once"),
        (["cloud.las", "cloud.las"], "once"),
        (["plain.tif", "cloud.las"], "either"),
    ];
    for (names, says) in pairs {
        let [first, second] = names.map(|name| home.path().join(name));
        let told = told(&import(&[&first, &second], &forest, &[]), 2);
        assert!(names.iter().all(|name| told.contains(name)), "{names:?}: {told}");
        assert!(told.contains(says), "{names:?}: {told}");
        assert!(!forest.exists());
    }
}

#[test]
fn what_is_no_scene_is_not_touched() {
    let home = tempfile::tempdir().unwrap();
    let input = home.path().join("a.tif");
    fs::write(&input, good().bytes()).unwrap();
    let thesis = home.path().join("thesis");
    fs::create_dir(&thesis).unwrap();
    fs::write(thesis.join("chapter1.txt"), "years of work").unwrap();
    let chapter = thesis.join("chapter1.txt");
    for folder in [&thesis, &chapter, &chapter.join("forest")] {
        let told = told(&import(&[&input], folder, &[]), 2);
        assert!(told.contains(folder.to_str().unwrap()) && told.contains("-o"), "{told}");
        assert_eq!(fs::read_dir(&thesis).unwrap().count(), 1);
        assert_eq!(fs::read_to_string(&chapter).unwrap(), "years of work");
    }
    // scenes of a newer wildwood, and damaged ones
    for manifest in ["[scene]\nformat = 999\n", "no toml", "\u{1}"] {
        let folder = home.path().join("scene");
        fs::create_dir_all(&folder).unwrap();
        fs::write(folder.join("scene.toml"), manifest).unwrap();
        let told = told(&import(&[&input], &folder, &[]), 2);
        assert!(told.contains("scene.toml") && told.contains("new folder"), "{told}");
        assert_eq!(fs::read_to_string(folder.join("scene.toml")).unwrap(), manifest);
    }
}

#[test]
fn usage_errors_exit_with_two() {
    let wrong: &[&[&str]] = &[
        &["import"],
        &["plant"],
        &["import", "a.tif"],
        &["import", "a.tif", "-o", "x", "--threads", "0"],
        &["import", "a.tif", "-o", "x", "--threads", "many"],
        &["import", "a.tif", "-o", "x", "--threads", "99999"],
        &["import", "a.tif", "-o", "x", "--seed", "-0.5"],
        &["import", "a.tif", "-o", "x", "--cell", "wide"],
        &["import", "a.tif", "-o", "x", "--vertical-unit", "cubit"],
        &["demo", "--size", "1"],
        &["demo", "--biome", "mars", "-o", "/nowhere/x"],
    ];
    for arguments in wrong {
        let output = wildwood(arguments);
        let told = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {told}");
        assert!(!told.contains("panicked"), "{told}");
        assert!(!Path::new("x").exists());
    }
}

#[test]
fn machines_get_the_error_as_json() {
    let output = wildwood(&["import", "gone.tif", "-o", "x", "--json"]);
    assert_eq!(output.status.code(), Some(2));
    let last = String::from_utf8(output.stdout).unwrap();
    let error: serde_json::Value = serde_json::from_str(last.lines().last().unwrap()).unwrap();
    assert_eq!((&error["event"], &error["exit_code"]), (&"error".into(), &2.into()));
    assert!(error["message"].as_str().unwrap().contains("gone.tif"), "{error}");
}

/// A header of 1.6 billion cells over 800 bytes.
fn huge_tiff() -> Vec<u8> {
    Tiff::new(40_000, 40_000, [0.0; 200]).bytes()
}

/// Runs a shell command with a small address space, where the system has one.
#[cfg(target_os = "linux")]
#[test]
fn a_huge_header_in_a_small_file_allocates_little() {
    let home = tempfile::tempdir().unwrap();
    let input = home.path().join("huge.tif");
    fs::write(&input, huge_tiff()).unwrap();
    assert!(fs::metadata(&input).unwrap().len() < 2048);
    let limited = format!(
        "ulimit -v 600000; exec {} import {} -o {} --threads 1 --quiet",
        env!("CARGO_BIN_EXE_wildwood"),
        input.display(),
        home.path().join("forest").display()
    );
    let output = Command::new("sh").args(["-c", &limited]).output().unwrap();
    assert!(told(&output, 2).contains("huge.tif"));
}

/// The machine's failures are exit code 1. The output's home is a file system of 200 KiB where one can be
/// mounted, else the case is skipped aloud.
#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_told_and_leaves_nothing() {
    let home = tempfile::tempdir().unwrap();
    let input = home.path().join("a.tif");
    let size = 200_u32;
    let hills = (0..size * size).map(|i| (i % 77) as f32 + (i / size % 31) as f32);
    fs::write(&input, Tiff::new(size, size, hills).bytes()).unwrap();
    let Some(disk) = SmallDisk::mount(home.path()) else {
        eprintln!("skipped: no small file system can be mounted here");
        return;
    };
    let told = told(&import(&[&input], &disk.path.join("forest"), &[]), 1);
    assert!(told.contains("forest") && told.contains("free space"), "{told}");
    assert_eq!(fs::read_dir(&disk.path).unwrap().count(), 0, "something was left behind");
    disk.make_read_only();
    let told = self::told(&import(&[&input], &disk.path.join("forest"), &[]), 1);
    assert!(told.contains("forest") && told.contains("permissions"), "{told}");
}

#[cfg(target_os = "linux")]
#[test]
fn no_permission_is_told_and_leaves_nothing() {
    let home = tempfile::tempdir().unwrap();
    let input = home.path().join("a.tif");
    fs::write(&input, good().bytes()).unwrap();
    // nobody may make folders here, root included
    let told = told(&import(&[&input], Path::new("/proc/forest"), &[]), 1);
    assert!(told.contains("/proc/forest") && told.contains("permission"), "{told}");
}

/// A file system in memory, gone when dropped.
#[cfg(target_os = "linux")]
struct SmallDisk {
    path: PathBuf,
}

#[cfg(target_os = "linux")]
impl SmallDisk {
    fn mount(home: &Path) -> Option<Self> {
        let path = home.join("disk");
        fs::create_dir(&path).ok()?;
        let mounted = Command::new("mount")
            .args(["-t", "tmpfs", "-o", "size=200k", "tmpfs"])
            .arg(&path)
            .output()
            .is_ok_and(|o| o.status.success());
        mounted.then_some(Self { path })
    }

    fn make_read_only(&self) {
        let remounted = Command::new("mount").args(["-o", "remount,ro"]).arg(&self.path).status();
        assert!(remounted.unwrap().success());
    }
}

#[cfg(target_os = "linux")]
impl Drop for SmallDisk {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg(&self.path).status();
    }
}
