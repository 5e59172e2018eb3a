//! Over a hundred ways to get a command wrong: each gets one clear error that names the thing, the right exit code, and leaves
//! every file as it was.
//!
//! Files of terrain and clouds that are no good have a table of their own in `bad_input.rs`.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use parquet::arrow::ArrowWriter;
use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;
use rayon::prelude::*;
use tempfile::TempDir;

/// What is done to the files before the command runs; paths count from the row's own folder.
enum Harm {
    Write(&'static str, &'static str),
    /// Keeps a share of the file, in percent.
    Cut(&'static str, usize),
    Remove(&'static str),
    Folder(&'static str),
    /// Puts the second text in place of the first, wherever it stands in the file.
    Replace(&'static str, &'static str, &'static str),
    Copy(&'static str, &'static str),
    /// Turns one byte in the middle of a file around.
    Flip(&'static str),
    WithoutColumn(&'static str, &'static str),
}
use Harm::{Copy, Cut, Flip, Folder, Remove, Replace, WithoutColumn, Write};

/// A command that goes wrong. It runs where `forest` (aged), `other` (smaller, of another seed) and `bare` (no trees) are.
struct Row {
    command: &'static str,
    harm: &'static [Harm],
    exit_code: i32,
    says: &'static [&'static str],
}

const fn row(command: &'static str, says: &'static [&'static str]) -> Row {
    Row { command, harm: &[], exit_code: 2, says }
}

const fn harmed(
    command: &'static str,
    harm: &'static [Harm],
    says: &'static [&'static str],
) -> Row {
    Row { command, harm, exit_code: 2, says }
}

/// Flags and their values.
const FLAGS: &[Row] = &[
    row("demo -o new --size 8", &["--size", "16..=8192"]),
    row("demo -o new --size big", &["big", "--size"]),
    row("demo -o new --size 32 --age 5000", &["--age", "5000"]),
    row("demo -o new --size 32 --biome mars", &["mars", "sonoma"]),
    row("demo -o new --size 32 --seed x", &["--seed"]),
    row("demo new", &["new"]),
    row("import forest/terrain.tif", &["--output"]),
    row("import -o new", &["DEM"]),
    row("import forest/terrain.tif -o new --cell 0", &["cell width 0"]),
    row("import forest/terrain.tif -o new --cell -3", &["cell width -3"]),
    row("import forest/terrain.tif -o new --cell nan", &["cell width NaN"]),
    row("import forest/terrain.tif -o new --bbox 1,2,3", &["--bbox", "four"]),
    row("import forest/terrain.tif -o new --bbox 9,9,1,1", &["--bbox", "west"]),
    row("import forest/terrain.tif -o new --bbox 9e5,9e5,9.1e5,9.1e5", &["--bbox"]),
    row("import forest/terrain.tif -o new --latitude 95", &["latitude 95"]),
    row("import forest/terrain.tif -o new --biome mars", &["mars", "sonoma"]),
    row("import forest/terrain.tif -o new --crs EPSG:999999", &["999999"]),
    row("import forest/terrain.tif -o new --crs moon", &["moon"]),
    row("import forest/terrain.tif -o new --fill-holes -5", &["-5"]),
    row("import forest/terrain.tif -o new --climate no.toml", &["no.toml"]),
    row("grow bare", &["--density"]),
    row("grow bare --density thick", &["thick", "dense"]),
    row("grow bare --density dense --sketch a.png", &["--sketch", "--density"]),
    row("grow bare --sketch no.png", &["no.png"]),
    row("grow bare --chm no.tif", &["no.tif"]),
    row("grow bare --density dense --stand-height -4", &["--stand-height"]),
    row("grow bare --density dense --stand-height tall", &["tall"]),
    row("grow bare --density dense --shares redwood=2", &["share of `redwood`"]),
    row("grow bare --density dense --shares palm=0.5", &["palm", "redwood"]),
    row("grow bare --density dense --shares redwood", &["redwood"]),
    row("grow bare --density dense --exclude no.geojson", &["no.geojson"]),
    row("grow bare --density dense --brush no.tif", &["--brush-regions"]),
    row("grow bare --density dense --models no", &["no"]),
    row("grow bare --density dense --onnx tensorflow", &["tensorflow"]),
    row("grow bare --density dense --age 0", &["--age"]),
    row("grow bare --density dense --min-height nan", &["--min-height"]),
    row("grow bare --chm forest/chm.tif --undergrowth-statistics no.json", &["no.json"]),
    row("grow bare --chm forest/chm.tif --refine-area 1,2", &["--refine-area"]),
    row("grow forest --preview-area 1,2", &["--preview-area"]),
    row("grow forest --preview-area 9e5,9e5,50", &["--preview-area"]),
    row("grow no", &["no"]),
    row("age forest", &["--years"]),
    row("age forest --years 0", &["--years"]),
    row("age forest --years 20000", &["--years", "10000"]),
    row("age forest --years 9 --checkpoint 0", &["--checkpoint"]),
    row("age forest --years 9 --history oaks", &["--history", "full"]),
    row("age forest --years 9 --events no.toml", &["no.toml"]),
    row("age no --years 9", &["no", "wildwood grow"]),
    row("age forest --years 9 -o other", &["other", "another scene"]),
    row("export forest -o a.xyz", &["a.xyz", "--to"]),
    row("export forest -o a.gpkg --to tiff", &["tiff", "gpkg"]),
    row("export forest", &["--output"]),
    row("export forest -o a.gpkg --bbox 1,2,3", &["--bbox", "four"]),
    row("export forest -o a.gpkg --bbox 3,3,1,1", &["--bbox", "west"]),
    row("export forest -o a.gpkg --bbox 9e5,9e5,9.1e5,9.1e5", &["--bbox"]),
    row("export forest -o a.gpkg --bbox nan,0,1,1", &["--bbox"]),
    row("export forest -o a.gpkg --layers moss", &["moss", "canopy"]),
    row("export forest -o a.gpkg --min-height -1", &["--min-height"]),
    row("export forest -o a.gpkg --layers canopy --min-height 900", &["--min-height"]),
    row("export forest -o a.las --crowns", &["--crowns", "gpkg"]),
    row("export forest -o a.glb --lod closest", &["closest", "near"]),
    row("export forest -o a --to points --flavour maya", &["maya", "unreal"]),
    row("export forest -o a.csv", &["a.csv", "--layers"]),
    row("export forest -o a.geojson", &["a.geojson", "local"]),
    row("export forest -o a.csv --to iland --layers snags", &["snags", "iland"]),
    row("export bare -o a.gpkg", &["no plants", "wildwood grow"]),
    row("render forest -o view.jpg", &["view.jpg", ".png"]),
    row("render forest -o view.png --size 2x2", &["--size"]),
    row("render forest -o view.png --samples 9", &["--samples"]),
    row("render forest -o view.png --view inside", &["inside", "overview"]),
    row("render forest -o view.png --haze -1", &["--haze"]),
    row("render forest -o view.png --turntable 0", &["--turntable"]),
    row("render forest -o view.png --camera 1,2,nan,0,0", &["--camera"]),
    row("render no -o view.png", &["no", "wildwood grow"]),
    row("validate no", &["no", "wildwood grow"]),
    row("validate bare", &["bare", "no plants"]),
    row("validate forest --gresolet other", &["--gresolet"]),
    row("validate -o report.html", &["FOLDER"]),
    row("validate --gresolet no", &["no", "heightfield.elv"]),
    row("statistics -o a.json --biome mars", &["mars", "sonoma"]),
    row("statistics -o a.json --biome no.toml", &["no.toml"]),
    row("import forest/terrain.tif -o new --biome no.toml", &["no.toml"]),
    row("import forest/terrain.tif -o new --biome forest/terrain.tif", &["terrain.tif", "no text"]),
    row("import forest/terrain.tif -o new --biome forest/scene.toml", &["scene.toml", "biome"]),
    row("import forest/terrain.tif -o new --biome forest", &["forest"]),
    row("biome mars", &["mars", "sonoma"]),
    row("biome forest/scene.toml", &["scene.toml"]),
    row("biome sonoma -o forest/scene.toml", &["scene.toml", "exists"]),
    row("statistics -o a.json --years 3", &["--years", "60"]),
    row("statistics", &["--output"]),
    row("bench everything", &["everything", "abiotics-512"]),
    row("bench abiotics-512 --repeat 0", &["--repeat"]),
    row("bench import-dem --dem no.tif", &["no.tif"]),
    row("bench import-laz --laz no.laz", &["no.laz"]),
    row("bench learned-1km --onnx paper", &["paper"]),
    row("doctor --threads 0", &["--threads"]),
    row("doctor forest", &["forest"]),
];

const GARBAGE: &str = "All work and no play makes Jack a dull boy.\n";

/// Wrong kinds of file, folders in place of files and the reverse.
const FILES: &[Row] = &[
    harmed("import a.tif -o new", &[Folder("a.tif")], &["a.tif", "no file"]),
    harmed("import a.laz -o new", &[Folder("a.laz")], &["a.laz"]),
    harmed("import forest/plants.parquet -o new", &[], &["plants.parquet", "gdal_translate"]),
    harmed("import forest/preview.png -o new", &[], &["preview.png"]),
    harmed("import forest/terrain.tif -o new", &[Write("new", GARBAGE)], &["new", "-o"]),
    harmed("import forest/terrain.tif -o a.txt/new", &[Write("a.txt", "x")], &["a.txt/new"]),
    harmed("import forest/terrain.tif -o new --climate c", &[Folder("c")], &["c"]),
    harmed("demo --size 32 -o new", &[Write("new/thesis.txt", GARBAGE)], &["new", "-o"]),
    harmed("demo --size 32 -o bare", &[], &["bare", "real terrain"]),
    harmed("grow bare --chm forest/scene.toml", &[], &["scene.toml"]),
    harmed("grow bare --chm forest", &[], &["forest"]),
    harmed("grow bare --sketch a.png", &[Write("a.png", GARBAGE)], &["a.png"]),
    harmed("grow bare --sketch a.png", &[Folder("a.png")], &["a.png"]),
    harmed("grow bare --footprint forest/plants.parquet", &[], &["plants.parquet"]),
    harmed("grow bare --density dense --models m", &[Folder("m")], &["m"]),
    harmed(
        "grow bare --density dense --exclude a.geojson",
        &[Write("a.geojson", GARBAGE)],
        &["a.geojson"],
    ),
    harmed("grow bare --density dense --exclude a.shp", &[Write("a.shp", "")], &["a.shp"]),
    harmed(
        "grow bare --chm forest/chm.tif --undergrowth-statistics a.json",
        &[Write("a.json", "{}")],
        &["statistics"],
    ),
    harmed("grow bare --density dense -o other", &[], &["other"]),
    harmed(
        "age forest --years 9 --events e.toml",
        &[Write("e.toml", "[[event]]\ntype = \"flood\"\nyear = 2\n")],
        &["e.toml", "flood"],
    ),
    harmed("age forest --years 9 --events e.toml", &[Folder("e.toml")], &["e.toml"]),
    harmed("age forest --years 9 --events forest/plants.parquet", &[], &["plants.parquet"]),
    harmed("age forest --years 9 -o a.txt", &[Write("a.txt", GARBAGE)], &["a.txt"]),
    harmed("age forest --years 9 -o new", &[Write("new/thesis.txt", GARBAGE)], &["new", "-o"]),
    harmed("age a.txt --years 9", &[Write("a.txt", GARBAGE)], &["a.txt"]),
    harmed("export forest -o a.gpkg", &[Write("a.gpkg", GARBAGE)], &["a.gpkg", "-o"]),
    harmed("export forest -o a.gpkg", &[Folder("a.gpkg")], &["a.gpkg", "folder"]),
    harmed("export forest -o a --to 3dtiles", &[Write("a", GARBAGE)], &["a: ", "file"]),
    harmed("export forest -o a --to csv", &[Write("a/thesis.txt", GARBAGE)], &["a: ", "-o"]),
    row("export forest -o no/a.gpkg", &["no", "does not exist"]),
    harmed("export forest -o a.txt/a.gpkg", &[Write("a.txt", GARBAGE)], &["a.txt"]),
    row("export forest/terrain.tif -o a.gpkg", &["terrain.tif"]),
    row("export forest -o forest --to csv", &["forest", "the scene itself"]),
    row(
        "export forest -o forest/plants.parquet --layers canopy",
        &["plants.parquet", "the scene itself"],
    ),
    harmed(
        "export forest -o forest/snags.parquet --layers snags",
        &[Remove("forest/snags.parquet")],
        &["snags.parquet", "the scene itself"],
    ),
    row(
        "export forest -o forest/scene.toml --to csv --layers canopy",
        &["scene.toml", "the scene itself"],
    ),
    harmed(
        "export a/forest -o a --to csv",
        &[Copy("forest", "a/forest"), Write("a/export.json", "{\"format\": \"csv\"}")],
        &["a: ", "the scene"],
    ),
    row("render forest -o forest/preview.png", &["preview.png", "the scene itself"]),
    row("render forest -o forest/timeline.png --size 64x64", &["timeline.png", "the scene itself"]),
    row("render forest -o no/view.png", &["no", "does not exist"]),
    harmed("render forest -o view.png", &[Folder("view.png")], &["view.png", "folder"]),
    harmed("render forest -o view.png", &[Write("view.png", GARBAGE)], &["view.png", "no PNG"]),
    harmed(
        "render forest -o v.png --turntable 2",
        &[Write("v_001.png", GARBAGE)],
        &["v_001.png", "no PNG"],
    ),
    row("validate forest -o forest/plants.parquet", &["plants.parquet"]),
    row("validate forest -o no/report.html", &["no", "does not exist"]),
    harmed("validate forest -o r.html", &[Folder("r.html")], &["r.html", "folder"]),
    harmed(
        "validate forest -o thesis.doc",
        &[Write("thesis.doc", GARBAGE)],
        &["thesis.doc", "no report"],
    ),
    harmed("validate forest", &[Folder("forest/report.html")], &["report.html", "folder"]),
    harmed(
        "validate --gresolet d --pictures p",
        &[Folder("d"), Write("p", GARBAGE)],
        &["p: ", "folder"],
    ),
    harmed("validate --gresolet d", &[Write("d/heightfield.elv", GARBAGE)], &["heightfield.elv"]),
    row("statistics -o no/a.json", &["no/a.json"]),
    harmed("statistics -o a.json", &[Folder("a.json")], &["a.json"]),
    harmed(
        "statistics -o thesis.doc --work w",
        &[Write("thesis.doc", GARBAGE)],
        &["thesis.doc", "no statistics"],
    ),
    harmed("statistics -o a.json --work w", &[Write("w", GARBAGE)], &["w: ", "folder"]),
    harmed("bench import-dem --dem a.tif --repeat 1", &[Write("a.tif", GARBAGE)], &["a.tif"]),
    harmed("bench import-laz --laz a.laz --repeat 1", &[Write("a.laz", GARBAGE)], &["a.laz"]),
    harmed("bench age-512-young --dem d.tif --repeat 1", &[Folder("d.tif")], &["d.tif"]),
];

/// Scenes that somebody or something damaged.
const SCENES: &[Row] = &[
    harmed("export forest -o a.gpkg", &[Cut("forest/scene.toml", 50)], &["scene.toml"]),
    harmed("age forest --years 9", &[Cut("forest/scene.toml", 20)], &["scene.toml"]),
    harmed("render forest -o v.png", &[Write("forest/scene.toml", "")], &["scene.toml"]),
    harmed(
        "validate forest",
        &[Replace("forest/scene.toml", "format = 1", "format = 2")],
        &["scene.toml", "layout 2"],
    ),
    harmed(
        "grow bare --density dense",
        &[Replace("bare/scene.toml", "format = 1", "format = 7")],
        &["scene.toml", "layout 7"],
    ),
    harmed(
        "demo --size 32 -o forest",
        &[Flip("forest/scene.toml"), Cut("forest/scene.toml", 90)],
        &["scene.toml"],
    ),
    harmed("export forest -o a.gpkg", &[Remove("forest/scene.toml")], &["forest", "scene"]),
    harmed(
        "export forest -o a.gpkg",
        &[Remove("forest/scene.toml"), Folder("forest/scene.toml")],
        &["scene.toml"],
    ),
    harmed(
        "export forest -o a.gpkg",
        &[Replace("forest/scene.toml", "biome = \"sonoma\"", "biome = \"mars\"")],
        &["mars"],
    ),
    harmed(
        "export forest -o a.gpkg",
        &[Replace("forest/scene.toml", "rows = 48", "rows = 47")],
        &["scene.toml", "terrain.tif"],
    ),
    harmed(
        "render forest -o v.png",
        &[Replace("forest/scene.toml", "crs = \"local\"", "crs = \"EPSG:1\"")],
        &["scene.toml"],
    ),
    harmed(
        "age forest --years 9",
        &[Replace("forest/scene.toml", "[stages.abiotics", "[stages.abiotic")],
        &["abiotic"],
    ),
    harmed("export forest -o a.gpkg", &[Cut("forest/plants.parquet", 60)], &["plants.parquet"]),
    harmed("export forest -o a.gpkg", &[Cut("forest/plants.parquet", 0)], &["plants.parquet"]),
    harmed(
        "render forest -o v.png",
        &[Write("forest/plants.parquet", GARBAGE)],
        &["plants.parquet"],
    ),
    harmed(
        "export forest -o a.csv",
        &[WithoutColumn("forest/plants.parquet", "dbh_m")],
        &["plants.parquet", "dbh_m"],
    ),
    harmed(
        "render forest -o v.png",
        &[WithoutColumn("forest/plants.parquet", "species")],
        &["plants.parquet", "species"],
    ),
    harmed(
        "validate forest",
        &[WithoutColumn("forest/snags.parquet", "decay_class")],
        &["snags.parquet", "decay_class"],
    ),
    harmed(
        "export forest -o a.gpkg",
        &[Remove("forest/plants.parquet"), Folder("forest/plants.parquet")],
        &["plants.parquet"],
    ),
    harmed(
        "export forest -o a.gpkg",
        &[Remove("forest/plants.parquet")],
        &["plants.parquet", "gone"],
    ),
    harmed(
        "render forest -o v.png",
        &[Copy("forest/snags.parquet", "forest/plants.parquet")],
        &["plants.parquet"],
    ),
    harmed(
        "export forest -o a.gpkg",
        &[Remove("forest/downed_logs.parquet")],
        &["downed_logs.parquet"],
    ),
    harmed("render forest -o v.png", &[Remove("forest/snags.parquet")], &["snags.parquet", "gone"]),
    harmed("export forest -o a.gpkg", &[Cut("forest/terrain.tif", 0)], &["terrain.tif", "empty"]),
    harmed("render forest -o v.png", &[Cut("forest/terrain.tif", 40)], &["terrain.tif"]),
    harmed("validate forest", &[Remove("forest/terrain.tif")], &["terrain.tif"]),
    harmed("age forest --years 9", &[Write("forest/terrain.tif", GARBAGE)], &["terrain.tif"]),
    harmed(
        "export forest -o a.gpkg",
        &[Copy("other/terrain.tif", "forest/terrain.tif")],
        &["terrain.tif", "another size"],
    ),
    harmed("render forest -o v.png", &[Cut("forest/grass.tif", 30)], &["grass.tif"]),
    harmed(
        "render forest -o v.png",
        &[Copy("other/moisture.tif", "forest/moisture.tif")],
        &["moisture.tif"],
    ),
    harmed(
        "age forest --years 9",
        &[Cut("forest/plants_at_start.parquet", 50)],
        &["plants_at_start.parquet"],
    ),
    harmed(
        "age forest --years 9",
        &[Remove("forest/plants_at_start.parquet")],
        &["plants_at_start.parquet", "gone"],
    ),
    harmed("age forest --years 9 -o new", &[Remove("forest/chm.tif")], &["chm.tif"]),
    harmed("age forest --years 9 -o new", &[Cut("forest/terrain.tif", 50)], &["terrain.tif"]),
    harmed(
        "age forest --years 9 -o new",
        &[Cut("forest/plants_at_start.parquet", 50)],
        &["plants_at_start.parquet"],
    ),
    harmed("grow bare --density dense", &[Cut("bare/terrain.tif", 50)], &["terrain.tif"]),
    harmed("grow bare --density dense", &[Remove("bare/terrain.tif")], &["terrain.tif"]),
    harmed(
        "grow forest --preview-area 48,48,40",
        &[Cut("forest/plants.parquet", 50)],
        &["plants.parquet"],
    ),
];

/// How long a command may take that goes wrong, on a machine that is busy with other things.
const LONGEST: Duration = Duration::from_secs(60);

/// Scenes that rows work on, made once.
fn scenes() -> &'static Path {
    static HOME: OnceLock<TempDir> = OnceLock::new();
    let home = HOME.get_or_init(|| {
        let home = tempfile::tempdir().unwrap();
        let commands = [
            "demo -o forest --size 48 --age 5",
            "demo -o other --size 40 --age 5 --seed 5",
            "import forest/terrain.tif -o bare",
        ];
        for command in commands {
            let made = wildwood(home.path(), command);
            assert!(made.status.success(), "{command}: {}", told(&made));
        }
        home
    });
    home.path()
}

fn wildwood(home: &Path, command: &str) -> Output {
    ended(prepared(home, command))
}

fn prepared(home: &Path, command: &str) -> Command {
    let mut prepared = Command::new(env!("CARGO_BIN_EXE_wildwood"));
    prepared.current_dir(home).args(command.split(' ')).args(["--quiet", "--threads", "1"]);
    prepared
}

/// Runs a command to its end, or to that of a minute: bad input is told in no time.
fn ended(mut command: Command) -> Output {
    let mut running =
        command.stdout(Stdio::piped()).stderr(Stdio::piped()).stdin(Stdio::null()).spawn().unwrap();
    let started = Instant::now();
    while running.try_wait().unwrap().is_none() {
        if started.elapsed() > LONGEST {
            let _ = running.kill();
        }
        std::thread::sleep(Duration::from_millis(2));
    }
    running.wait_with_output().unwrap()
}

fn told(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// A folder with copies of the scenes that are named.
fn place(names: &str) -> TempDir {
    let home = tempfile::tempdir().unwrap();
    for scene in ["forest", "other", "bare"] {
        if names.contains(scene) {
            copy(&scenes().join(scene), &home.path().join(scene));
        }
    }
    home
}

fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let path = entry.unwrap().path();
        fs::copy(&path, to.join(path.file_name().unwrap())).unwrap();
    }
}

/// Hash of every file, and every folder, beneath one.
fn contents(home: &Path) -> BTreeMap<PathBuf, Option<blake3::Hash>> {
    let mut found = BTreeMap::new();
    for entry in fs::read_dir(home).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(contents(&path));
            found.insert(path, None);
        } else {
            let hash = blake3::hash(&fs::read(&path).unwrap());
            found.insert(path, Some(hash));
        }
    }
    found
}

impl Harm {
    fn names(&self) -> String {
        match self {
            Copy(from, to) => format!("{from} {to}"),
            Write(file, _) | Cut(file, _) | Replace(file, ..) | WithoutColumn(file, _) => {
                (*file).to_owned()
            }
            Remove(file) | Folder(file) | Flip(file) => (*file).to_owned(),
        }
    }

    fn inflict(&self, home: &Path) {
        let edit = |file: &str, change: &dyn Fn(&mut Vec<u8>)| {
            let mut bytes = fs::read(home.join(file)).unwrap();
            change(&mut bytes);
            fs::write(home.join(file), bytes).unwrap();
        };
        match *self {
            Write(file, text) => {
                fs::create_dir_all(home.join(file).parent().unwrap()).unwrap();
                fs::write(home.join(file), text).unwrap();
            }
            Cut(file, percent) => edit(file, &|bytes| bytes.truncate(bytes.len() * percent / 100)),
            Remove(file) => fs::remove_file(home.join(file)).unwrap(),
            Folder(file) => fs::create_dir(home.join(file)).unwrap(),
            Flip(file) => edit(file, &|bytes| {
                let middle = bytes.len() / 2;
                bytes[middle] ^= 0xff;
            }),
            Replace(file, old, new) => edit(file, &|bytes| {
                let text = String::from_utf8(bytes.clone()).unwrap();
                assert!(text.contains(old), "{file} has no {old}");
                *bytes = text.replace(old, new).into_bytes();
            }),
            Copy(from, to) if home.join(from).is_dir() => copy(&home.join(from), &home.join(to)),
            Copy(from, to) => drop(fs::copy(home.join(from), home.join(to)).unwrap()),
            WithoutColumn(file, column) => {
                let source = File::open(home.join(file)).unwrap();
                let reader = ParquetRecordBatchReaderBuilder::try_new(source).unwrap();
                let mut batches = Vec::new();
                for batch in reader.build().unwrap() {
                    let mut batch = batch.unwrap();
                    let at = batch.schema().index_of(column).unwrap();
                    batch.remove_column(at);
                    batches.push(batch);
                }
                let to = File::create(home.join(file)).unwrap();
                let mut writer = ArrowWriter::try_new(to, batches[0].schema(), None).unwrap();
                batches.iter().for_each(|batch| writer.write(batch).unwrap());
                writer.close().unwrap();
            }
        }
    }
}

/// What is wrong with how a row was answered.
fn complaint(row: &Row) -> Option<String> {
    let mut names = row.command.to_owned();
    row.harm.iter().for_each(|harm| names.push_str(&harm.names()));
    let home = place(&names);
    row.harm.iter().for_each(|harm| harm.inflict(home.path()));
    let before = contents(home.path());
    let output = wildwood(home.path(), row.command);
    let mut problems = misses(&output, row.exit_code, row.says);
    let after = contents(home.path());
    let mut changed: Vec<_> = after
        .iter()
        .filter(|(path, hash)| before.get(*path) != Some(hash))
        .map(|(path, _)| path)
        .collect();
    changed.extend(before.keys().filter(|path| !after.contains_key(*path)));
    if !changed.is_empty() {
        problems.push(format!("changed {changed:?}"));
    }
    let harm: Vec<String> = row.harm.iter().map(Harm::names).collect();
    let told = told(&output);
    (!problems.is_empty())
        .then(|| format!("{} {harm:?}: {}\n    told: {told}", row.command, problems.join("; ")))
}

/// What an answer lacks: its exit code, one error message and no more, words in it.
fn misses(output: &Output, exit_code: i32, says: &[&str]) -> Vec<String> {
    let told = told(output);
    let mut problems = Vec::new();
    if output.status.code() != Some(exit_code) {
        problems.push(format!("ended with {}, not {exit_code}", output.status));
    }
    // whoever got the usage wrong is also shown it
    let is_usage = told.trim_end().ends_with("For more information, try '--help'.");
    let errors = told.lines().filter(|line| line.contains("error: ")).count();
    if !told.starts_with("error: ")
        || errors != 1
        || (!is_usage && told.trim_end().lines().count() != 1)
    {
        problems.push("not one error message".to_owned());
    }
    if told.contains("panicked") || told.contains("backtrace") {
        problems.push("a panic".to_owned());
    }
    if !output.stdout.is_empty() {
        problems.push("something on standard output".to_owned());
    }
    let silent = says.iter().filter(|word| !told.contains(**word));
    problems.extend(silent.map(|word| format!("does not say `{word}`")));
    problems
}

fn check(rows: &[Row]) {
    scenes();
    let complaints: Vec<String> = rows.par_iter().filter_map(complaint).collect();
    let (bad, all) = (complaints.len(), rows.len());
    assert!(bad == 0, "{bad} of {all} rows:\n{}", complaints.join("\n"));
}

#[test]
fn wrong_flags_and_values_are_told() {
    check(FLAGS);
}

#[test]
fn wrong_files_and_folders_are_told_and_nothing_is_overwritten() {
    check(FILES);
}

#[test]
fn damaged_scenes_are_told_and_left_as_they_are() {
    check(SCENES);
}

/// Tables may be edited, so one that is not the scene's own is taken, and told.
#[test]
fn tables_of_another_making_are_told() {
    let harms = [
        ("plants.parquet", Flip("forest/plants.parquet")),
        ("snags.parquet", Copy("other/snags.parquet", "forest/snags.parquet")),
        ("downed_logs.parquet", Copy("other/downed_logs.parquet", "forest/downed_logs.parquet")),
    ];
    for (file, harm) in harms {
        let home = place("forest other");
        harm.inflict(home.path());
        let mut command = Command::new(env!("CARGO_BIN_EXE_wildwood"));
        command.current_dir(home.path()).args(["export", "forest", "-o", "a.gpkg"]);
        let told = told(&ended(command));
        let is_told = |line: &str| line.contains(file) && line.contains("of another scene");
        assert!(told.lines().any(is_told) && !told.contains("panicked"), "{file}: {told}");
    }
}

/// What can be made again is: a damaged state is lived again.
#[test]
fn a_damaged_state_is_lived_again() {
    let whole = place("forest");
    let damaged = place("forest");
    Flip("forest/age_state.bin").inflict(damaged.path());
    for home in [&whole, &damaged] {
        let output = wildwood(home.path(), "age forest --years 7");
        assert!(output.status.success(), "{}", told(&output));
    }
    let files = |home: &TempDir| -> Vec<_> {
        let hashes = contents(&home.path().join("forest"));
        let relative = |path: PathBuf| path.strip_prefix(home.path()).unwrap().to_owned();
        hashes.into_iter().map(|(path, hash)| (relative(path), hash)).collect()
    };
    assert_eq!(files(&whole), files(&damaged));
}

/// Nobody may write where the scene is, or where the output goes.
#[cfg(unix)]
#[test]
fn read_only_folders_are_told() {
    use std::os::unix::fs::PermissionsExt;
    let home = place("forest");
    let shut = home.path().join("shut");
    fs::create_dir(&shut).unwrap();
    let set = |path: &Path, mode| {
        fs::set_permissions(path, fs::Permissions::from_mode(mode)).unwrap();
    };
    set(&shut, 0o555);
    if fs::write(shut.join("a"), "").is_ok() {
        eprintln!("skipped: permissions do not hold for this user");
        return;
    }
    set(&home.path().join("forest"), 0o555);
    let before = contents(home.path());
    for (command, name) in [
        ("demo --size 32 --age 0 -o shut/new", "shut/new"),
        ("export forest -o shut/a.gpkg", "shut/a.gpkg"),
        ("render forest -o shut/v.png --size 64x64", "shut/v.png"),
        ("validate forest", "report.html"),
        ("age forest --years 9", "forest"),
        ("statistics -o a.json --work shut/w", "shut/w"),
    ] {
        let problems = misses(&wildwood(home.path(), command), 1, &[name, "permission"]);
        assert!(problems.is_empty(), "{command}: {problems:?}");
    }
    assert!(contents(home.path()) == before);
    set(&home.path().join("forest"), 0o755);
}

/// A full disk is the machine's failure, and leaves nothing on it.
#[cfg(target_os = "linux")]
#[test]
fn full_disks_are_told_and_left_empty() {
    let home = place("forest");
    let disk = home.path().join("disk");
    fs::create_dir(&disk).unwrap();
    let run = |program: &str, arguments: &[&str]| {
        let done = Command::new(program).args(arguments).arg(&disk).output();
        done.is_ok_and(|output| output.status.success())
    };
    if !run("mount", &["-t", "tmpfs", "-o", "size=16k", "tmpfs"]) {
        eprintln!("skipped: no small file system can be mounted here");
        return;
    }
    let commands = [
        "demo --size 32 --age 0 -o disk/new",
        "import forest/terrain.tif -o disk/new",
        "grow forest/terrain.tif --chm forest/chm.tif -o disk/new",
        "age forest --years 9 -o disk/new",
        "export forest -o disk/a.gpkg",
        "export forest -o disk/a.glb",
        "export forest -o disk/a.usda",
        "export forest -o disk/a --to 3dtiles",
        "export forest -o disk/a --to mitsuba",
        "export forest -o disk/a --to points",
        "export forest -o disk/a --to csv",
        "export forest -o disk/a --to parquet",
        "render forest -o disk/v.png --size 256x256",
        "validate forest -o disk/report.html",
    ];
    let before = contents(home.path());
    let complaints: Vec<String> = commands
        .iter()
        .filter_map(|command| {
            let output = wildwood(home.path(), command);
            let mut problems = misses(&output, 1, &["disk/", "free space"]);
            if contents(home.path()) != before {
                problems.push("something is left or lost".to_owned());
            }
            (!problems.is_empty())
                .then(|| format!("{command}: {problems:?}\n    {}", told(&output)))
        })
        .collect();
    let _ = run("umount", &[]);
    assert!(complaints.is_empty(), "{}", complaints.join("\n"));
}

const STAGING: &str = ".wildwood-partial-";

/// Staging folders that lie in a folder.
#[cfg(target_os = "linux")]
fn staged(folder: &Path) -> usize {
    let entries = fs::read_dir(folder).unwrap().flatten();
    entries.filter(|entry| entry.file_name().to_string_lossy().starts_with(STAGING)).count()
}

/// Killed wherever they are, runs leave nothing but what the next run sweeps away.
#[cfg(target_os = "linux")]
#[test]
fn killed_runs_leave_nothing_half_written() {
    // command, the folder it writes into, what it makes
    let rows: [(&str, &str, &str); 5] = [
        ("export forest -o a.gpkg", ".", "a.gpkg"),
        ("export forest -o a --to 3dtiles", ".", "a"),
        ("render forest -o v.png --size 320x200 --turntable 3", ".", "v_000.png"),
        ("grow bare --chm forest/chm.tif", "bare", "bare/plants.parquet"),
        ("validate forest", "forest", "forest/report.html"),
    ];
    scenes();
    rows.par_iter().for_each(|(command, folder, made)| {
        let home = place("forest bare");
        let folder = home.path().join(folder);
        // files by their paths from home, but those that are under way
        let of = |home: &Path| -> BTreeMap<PathBuf, Option<blake3::Hash>> {
            let all = contents(home).into_iter();
            let settled = all.filter(|(path, _)| !path.to_string_lossy().contains(STAGING));
            settled
                .map(|(path, hash)| (path.strip_prefix(home).unwrap().to_owned(), hash))
                .collect()
        };
        let undisturbed = place("forest bare");
        assert!(wildwood(undisturbed.path(), command).status.success(), "{command}");
        let finished = of(undisturbed.path());
        let before = of(home.path());
        // once as soon as its staging folder is there, then at some moments of its life
        let mut was_staged = 0;
        for wait_ms in [None, Some(5), Some(40), Some(160)] {
            let mut running = prepared(home.path(), command)
                .stdout(Stdio::null())
                .stderr(Stdio::null())
                .spawn()
                .unwrap();
            let started = Instant::now();
            let is_time = |running: &mut std::process::Child| match wait_ms {
                _ if running.try_wait().unwrap().is_some() => true,
                Some(ms) => started.elapsed() >= Duration::from_millis(ms),
                None => staged(&folder) > 0,
            };
            while !is_time(&mut running) {
                std::thread::sleep(Duration::from_millis(1));
            }
            let _ = running.kill();
            running.wait().unwrap();
            was_staged += staged(&folder);
            // each file is the former one or the finished one
            let now = of(home.path());
            let is_whole = |(path, hash): (&PathBuf, &Option<blake3::Hash>)| {
                before.get(path) == Some(hash) || finished.get(path) == Some(hash)
            };
            assert!(now.iter().all(is_whole), "{command}, killed after {wait_ms:?}");
            let is_lost = before.keys().any(|path| !now.contains_key(path));
            assert!(!is_lost, "{command}, killed after {wait_ms:?}, lost a file");
        }
        let output = wildwood(home.path(), command);
        assert!(output.status.success(), "{command}: {}", told(&output));
        assert!(home.path().join(made).exists(), "{command}");
        assert_eq!(staged(&folder), 0, "{command} leaves {was_staged} staging folders");
    });
}
