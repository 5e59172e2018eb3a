//! Bad input gets one clear error that names the file and what to do, the right exit code, and leaves nothing behind.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn wildwood(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_wildwood")).args(arguments).output().unwrap()
}

/// A classic little-endian TIFF header and one directory of (tag, type, count, value) entries.
fn tiff(entries: &[(u16, u16, u32, u32)], payload: &[u8]) -> Vec<u8> {
    let mut bytes = vec![b'I', b'I', 42, 0, 8, 0, 0, 0];
    bytes.extend((entries.len() as u16).to_le_bytes());
    for (tag, kind, count, value) in entries {
        bytes.extend(tag.to_le_bytes());
        bytes.extend(kind.to_le_bytes());
        bytes.extend(count.to_le_bytes());
        bytes.extend(value.to_le_bytes());
    }
    bytes.extend([0; 4]);
    bytes.extend(payload);
    bytes
}

/// One strip of float32 heights, `rows` × `cols`, that claims to start right behind the directory.
fn float_tiff(rows: u32, cols: u32, payload: &[u8]) -> Vec<u8> {
    const ENTRIES: usize = 10;
    let start = 8 + 2 + 12 * ENTRIES as u32 + 4;
    tiff(
        &[
            (256, 4, 1, cols),
            (257, 4, 1, rows),
            (258, 3, 1, 32),
            (259, 3, 1, 1),
            (262, 3, 1, 1),
            (273, 4, 1, start),
            (277, 3, 1, 1),
            (278, 4, 1, rows),
            (279, 4, 1, rows.wrapping_mul(cols).wrapping_mul(4)),
            (339, 3, 1, 3),
        ],
        payload,
    )
}

fn heights(values: impl IntoIterator<Item = f32>) -> Vec<u8> {
    values.into_iter().flat_map(f32::to_le_bytes).collect()
}

struct Case {
    name: &'static str,
    file: &'static str,
    content: Vec<u8>,
    options: &'static [&'static str],
    says: &'static [&'static str],
}

fn cases() -> Vec<Case> {
    let good = || float_tiff(8, 8, &heights((0..64).map(|i| i as f32)));
    let asc =
        |body: &str| format!("ncols 8\nnrows 8\nxllcorner 0\nyllcorner 0\n{body}").into_bytes();
    let rows = |value: &str| format!("{value} ").repeat(64);
    let case = |name, file, content, options, says| Case { name, file, content, options, says };
    vec![
        case("truncated", "cut.tif", good()[..200].to_vec(), &[], &["cut.tif"]),
        case("header only", "head.tif", b"II*\0".to_vec(), &[], &["head.tif"]),
        case(
            "wrong type",
            "holiday.jpg",
            b"\xff\xd8\xff\xe0 not terrain".to_vec(),
            &[],
            &["holiday.jpg"],
        ),
        case("empty file", "empty.tif", Vec::new(), &[], &["empty.tif"]),
        case(
            "absurd size",
            "huge.tif",
            float_tiff(40_000, 40_000, &[0; 800]),
            &[],
            &["huge.tif", "40"],
        ),
        case("no cells", "none.tif", float_tiff(0, 8, &[]), &[], &["none.tif"]),
        case("all NaN", "nan.tif", float_tiff(8, 8, &heights([f32::NAN; 64])), &[], &["nan.tif"]),
        case(
            "zero cell",
            "zero.asc",
            asc(&format!("cellsize 0\n{}", rows("5"))),
            &[],
            &["zero.asc", "cell"],
        ),
        case(
            "negative cell",
            "neg.asc",
            asc(&format!("cellsize -2\n{}", rows("5"))),
            &[],
            &["neg.asc", "cell"],
        ),
        case(
            "all nodata",
            "void.asc",
            asc(&format!("cellsize 1\nNODATA_value -9999\n{}", rows("-9999"))),
            &[],
            &["void.asc"],
        ),
        case(
            "text in the middle",
            "word.asc",
            asc(&format!("cellsize 1\n{} cow", rows("5"))),
            &[],
            &["word.asc"],
        ),
        case(
            "absurd ascii",
            "big.asc",
            b"ncols 90000\nnrows 90000\nxllcorner 0\nyllcorner 0\ncellsize 1\n1".to_vec(),
            &[],
            &["big.asc"],
        ),
        case(
            "elv without rows",
            "short.elv",
            b"256 256 2.0 42.5\n1 2 3".to_vec(),
            &[],
            &["short.elv"],
        ),
        case("broken cloud", "cut.laz", b"LASF\0\0\0\0".to_vec(), &[], &["cut.laz"]),
        case("zero --cell", "a.tif", good(), &["--cell", "0"], &["cell"]),
        case("negative --cell", "a.tif", good(), &["--cell=-1"], &["cell"]),
        case("NaN --cell", "a.tif", good(), &["--cell", "NaN"], &["cell"]),
        case("unknown --crs", "a.tif", good(), &["--crs", "EPSG:999999"], &["EPSG:999999"]),
        case("unknown --biome", "a.tif", good(), &["--biome", "mars"], &["mars", "sonoma"]),
        case("--bbox elsewhere", "a.tif", good(), &["--bbox", "9000,9000,9100,9100"], &["bbox"]),
        case("missing climate", "a.tif", good(), &["--climate", "nowhere.toml"], &["nowhere.toml"]),
    ]
}

#[test]
fn each_bad_input_is_told_and_leaves_nothing() {
    for case in cases() {
        let home = tempfile::tempdir().unwrap();
        let input = home.path().join(case.file);
        fs::write(&input, &case.content).unwrap();
        let forest = home.path().join("out/forest");
        let mut arguments =
            vec!["import", input.to_str().unwrap(), "-o", forest.to_str().unwrap(), "--quiet"];
        arguments.extend(case.options);
        let output = wildwood(&arguments);
        let told = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{}: {told}", case.name);
        for word in case.says {
            assert!(told.contains(word), "{}: `{word}` is not in: {told}", case.name);
        }
        assert_eq!(told.trim().lines().count(), 1, "{}: one error, not {told}", case.name);
        assert!(!told.contains("panicked"), "{}: {told}", case.name);
        assert!(!home.path().join("out").exists(), "{}: a folder was left behind", case.name);
        assert_eq!(
            fs::read_dir(home.path()).unwrap().count(),
            1,
            "{}: files were left behind",
            case.name
        );
    }
}

#[test]
fn a_missing_file_is_bad_input_and_a_folder_is_too() {
    let home = tempfile::tempdir().unwrap();
    let forest = home.path().join("forest");
    for input in [home.path().join("gone.tif"), home.path().to_path_buf()] {
        let output = wildwood(&["import", input.to_str().unwrap(), "-o", forest.to_str().unwrap()]);
        let told = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{told}");
        assert!(told.contains(input.to_str().unwrap()), "{told}");
        assert!(!forest.exists());
    }
}

#[test]
fn mixed_crs_names_both_files() {
    let home = tempfile::tempdir().unwrap();
    let plain = home.path().join("plain.tif");
    fs::write(&plain, float_tiff(8, 8, &heights((0..64).map(|i| i as f32)))).unwrap();
    let geo = home.path().join("geo.tif");
    fs::write(&geo, geographic_tiff()).unwrap();
    let forest = home.path().join("forest");
    let output = wildwood(&[
        "import",
        plain.to_str().unwrap(),
        geo.to_str().unwrap(),
        "-o",
        forest.to_str().unwrap(),
    ]);
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{told}");
    assert!(told.contains("plain.tif") && told.contains("geo.tif"), "{told}");
    assert!(!forest.exists());
}

/// 8 × 8 heights in EPSG:4326 with scale and tiepoint.
fn geographic_tiff() -> Vec<u8> {
    const ENTRIES: u32 = 13;
    let start = 8 + 2 + 12 * ENTRIES + 4;
    let scale: Vec<u8> = [0.001_f64, 0.001, 0.0].into_iter().flat_map(f64::to_le_bytes).collect();
    let tie: Vec<u8> =
        [0.0_f64, 0.0, 0.0, -122.0, 38.0, 0.0].into_iter().flat_map(f64::to_le_bytes).collect();
    let keys: Vec<u8> = [1_u16, 1, 0, 2, 1024, 0, 1, 2, 2048, 0, 1, 4326]
        .into_iter()
        .flat_map(u16::to_le_bytes)
        .collect();
    let mut payload = scale.clone();
    payload.extend(&tie);
    payload.extend(&keys);
    let data = start + payload.len() as u32;
    payload.extend(heights((0..64).map(|i| i as f32)));
    tiff(
        &[
            (256, 4, 1, 8),
            (257, 4, 1, 8),
            (258, 3, 1, 32),
            (259, 3, 1, 1),
            (262, 3, 1, 1),
            (273, 4, 1, data),
            (277, 3, 1, 1),
            (278, 4, 1, 8),
            (279, 4, 1, 256),
            (339, 3, 1, 3),
            (33550, 12, 3, start),
            (33922, 12, 6, start + 24),
            (34735, 3, 12, start + 72),
        ],
        &payload,
    )
}

#[test]
fn a_folder_of_something_else_is_not_touched() {
    let home = tempfile::tempdir().unwrap();
    let input = home.path().join("a.tif");
    fs::write(&input, float_tiff(8, 8, &heights((0..64).map(|i| i as f32)))).unwrap();
    let folder = home.path().join("thesis");
    fs::create_dir(&folder).unwrap();
    fs::write(folder.join("chapter1.txt"), "years of work").unwrap();
    let output = wildwood(&["import", input.to_str().unwrap(), "-o", folder.to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(2));
    assert_eq!(fs::read_dir(&folder).unwrap().count(), 1);
}

#[test]
fn usage_errors_exit_with_two() {
    assert_eq!(wildwood(&["import"]).status.code(), Some(2));
    assert_eq!(wildwood(&["plant"]).status.code(), Some(2));
    assert_eq!(wildwood(&["import", "a.tif", "-o", "x", "--threads", "0"]).status.code(), Some(2));
}

/// Runs a shell command with a small address space, where the system has one.
#[cfg(target_os = "linux")]
#[test]
fn a_huge_header_in_a_small_file_allocates_little() {
    let home = tempfile::tempdir().unwrap();
    let input = home.path().join("huge.tif");
    fs::write(&input, float_tiff(40_000, 40_000, &[0; 800])).unwrap();
    assert!(fs::metadata(&input).unwrap().len() < 1024);
    let limited = format!(
        "ulimit -v 600000; exec {} import {} -o {} --threads 1",
        env!("CARGO_BIN_EXE_wildwood"),
        input.display(),
        home.path().join("forest").display()
    );
    let output = Command::new("sh").args(["-c", &limited]).output().unwrap();
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{told}");
    assert!(told.contains("huge.tif"), "{told}");
}

/// The machine's failures are exit code 1. `/dev/full` cannot hold a folder, so the output's home is a file system
/// of 200 KiB where one can be mounted, else the case is skipped aloud.
#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_told_and_leaves_nothing() {
    let home = tempfile::tempdir().unwrap();
    let input = home.path().join("a.tif");
    let size = 200_u32;
    let hills = (0..size * size).map(|i| (i % 77) as f32 + (i / size % 31) as f32);
    fs::write(&input, float_tiff(size, size, &heights(hills))).unwrap();
    let Some(disk) = SmallDisk::mount(home.path()) else {
        eprintln!("skipped: no small file system can be mounted here");
        return;
    };
    let forest = disk.path.join("forest");
    let output = wildwood(&["import", input.to_str().unwrap(), "-o", forest.to_str().unwrap()]);
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1), "{told}");
    assert!(told.contains("space"), "{told}");
    assert_eq!(fs::read_dir(&disk.path).unwrap().count(), 0, "something was left behind");
}

#[cfg(target_os = "linux")]
#[test]
fn no_permission_is_told_and_leaves_nothing() {
    let home = tempfile::tempdir().unwrap();
    let input = home.path().join("a.tif");
    fs::write(&input, float_tiff(8, 8, &heights((0..64).map(|i| i as f32)))).unwrap();
    // nobody may make folders here, root included
    let output = wildwood(&["import", input.to_str().unwrap(), "-o", "/proc/forest"]);
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1), "{told}");
    assert!(told.contains("/proc/forest") && told.contains("permission"), "{told}");
}

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
}

#[cfg(target_os = "linux")]
impl Drop for SmallDisk {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg(&self.path).status();
    }
}
