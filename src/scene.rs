//! The scene folder: what a run leaves for GIS, 3D programs and later runs.
//!
//! Files are written beside and renamed, so a run that fails or is killed leaves the folder as it was.
//! `scene.toml` is renamed last and records the content hash of every stage file: a file that is not
//! the one recorded makes its stage run again.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use tempfile::TempDir;

use crate::raster::{Crs, CrsError, GeoTransform};
use crate::terrain::Terrain;

/// Version of the folder's layout; folders of another version are refused.
pub const FORMAT: u32 = 1;
/// What a scene folder says of itself.
pub const MANIFEST: &str = "scene.toml";
/// Files that users edit and give back: a run that does not make them leaves them where they are.
const EDITED: [&str; 2] = ["sketch.tif", "footprint.tif"];
/// How `scene.toml` calls [`Crs::Local`].
pub const LOCAL: &str = "local";
const STAGING_PREFIX: &str = ".wildwood-partial-";

/// Trouble with a scene folder.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
#[allow(missing_docs, reason = "the message tells what the fields are")]
pub enum Error {
    #[error("{path}: cannot write: {source}; check free space and permissions", path = path.display())]
    Write { path: PathBuf, source: io::Error },
    #[error("{path}: cannot read the scene: {source}; {hint}", path = path.display(), hint = reading_hint(source))]
    Read { path: PathBuf, source: io::Error },
    #[error("{path}: exists and is not a scene folder; name a new or empty folder with -o", path = path.display())]
    NotAScene { path: PathBuf },
    #[error("{path}: holds a scene of real terrain; name another folder with -o", path = path.display())]
    RealScene { path: PathBuf },
    #[error("{path}: {problem}; import the terrain again into a new folder", path = path.display())]
    Manifest { path: PathBuf, problem: String },
}

impl Error {
    /// Whether the machine failed (exit code 1) rather than the input (exit code 2).
    pub fn is_machine_failure(&self) -> bool {
        match self {
            Self::Write { .. } => true,
            Self::Read { source, .. } => !is_missing(source),
            _ => false,
        }
    }
}

/// Whether a file of the scene is not there, or something else is in its place: for the user to mend.
fn is_missing(source: &io::Error) -> bool {
    use io::ErrorKind::{IsADirectory, NotADirectory, NotFound};
    matches!(source.kind(), NotFound | IsADirectory | NotADirectory)
}

fn reading_hint(source: &io::Error) -> &'static str {
    if is_missing(source) {
        "put the file back, or make the scene again in a new folder"
    } else {
        "check the disk and permissions"
    }
}

/// What `scene.toml` says.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// Where and what the scene is.
    pub scene: SceneHead,
    /// The files the scene was made from.
    #[serde(default)]
    pub inputs: Vec<Input>,
    /// What each stage was given and gave, by stage name.
    #[serde(default)]
    pub stages: BTreeMap<String, StageEntry>,
}

/// Where and what a scene is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SceneHead {
    /// Layout version of the folder.
    pub format: u32,
    /// The wildwood that wrote it.
    pub wildwood_version: String,
    /// The scene's name: its folder's.
    pub name: String,
    /// `EPSG:n`, or `local` for metres of unknown place.
    pub crs: String,
    /// Map coordinates of the south-west corner; positions in the scene are metres east and north of it.
    pub south_west_m: [f64; 2],
    /// Width (west–east) and height (south–north).
    pub extent_m: [f64; 2],
    /// Cell width and height.
    pub cell_m: f64,
    /// Rows and columns of every raster.
    pub rows: usize,
    /// Columns of every raster.
    pub cols: usize,
    /// Latitude of the middle, north positive; radians, so that no digit is lost on the way back.
    pub latitude_rad: f64,
    /// Angle from true north to grid north, clockwise positive.
    pub grid_convergence_rad: f64,
    /// The biome whose climate and species the scene has.
    pub biome: String,
    /// The user's seed.
    pub seed: u64,
}

/// A file the scene was made from.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Input {
    /// The file's name, without its folder: scenes travel between machines.
    pub file: String,
    /// Length in bytes.
    pub bytes: u64,
    /// BLAKE3 of the content.
    pub blake3: String,
}

/// What a stage was given and gave.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StageEntry {
    /// Hash of everything the stage depends on; equal keys mean equal results.
    pub key: String,
    /// Parameters, as a user would name them.
    pub parameters: toml::Table,
    /// Measured figures of the result.
    pub figures: toml::Table,
    /// BLAKE3 of each file the stage wrote.
    pub files: BTreeMap<String, String>,
}

impl Manifest {
    /// The manifest of a scene folder, `None` if there is no folder or it is empty.
    ///
    /// # Errors
    /// [`Error::NotAScene`] for a folder with other content, [`Error::Manifest`] for a broken or newer manifest.
    pub fn read(folder: &Path) -> Result<Option<Self>, Error> {
        let path = folder.join(MANIFEST);
        let text = match fs::read_to_string(&path) {
            Ok(text) => text,
            Err(e)
                if matches!(e.kind(), io::ErrorKind::NotFound | io::ErrorKind::NotADirectory) =>
            {
                return if is_absent_or_empty(folder)? {
                    Ok(None)
                } else {
                    Err(Error::NotAScene { path: folder.to_path_buf() })
                };
            }
            Err(e) if e.kind() == io::ErrorKind::InvalidData => {
                return Err(Error::Manifest { path, problem: "it is no text".to_owned() });
            }
            Err(source) => return Err(Error::Read { path, source }),
        };
        Self::parse(&text).map(Some).map_err(|problem| Error::Manifest { path, problem })
    }

    /// A manifest from its text.
    ///
    /// # Errors
    /// What is wrong with the text, or that it is of a layout not known here.
    pub fn parse(text: &str) -> Result<Self, String> {
        let manifest: Self = toml::from_str(text).map_err(|e| e.message().to_owned())?;
        let format = manifest.scene.format;
        if format != FORMAT {
            return Err(format!("folder layout {format} where this wildwood knows {FORMAT}"));
        }
        Ok(manifest)
    }

    /// The files of all stages.
    pub fn files(&self) -> impl Iterator<Item = &String> {
        self.stages.values().flat_map(|stage| stage.files.keys())
    }

    /// Whether a stage was run with this key and its files still are what it wrote.
    ///
    /// # Errors
    /// [`Error::Read`] if a file cannot be read.
    pub fn is_current(&self, folder: &Path, stage: &str, key: &str) -> Result<bool, Error> {
        let Some(entry) = self.stages.get(stage).filter(|entry| entry.key == key) else {
            return Ok(false);
        };
        for (file, recorded) in &entry.files {
            let path = folder.join(file);
            match hash_file(&path) {
                Ok((hash, _)) if hash == *recorded => {}
                Ok(_) => return Ok(false),
                Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(false),
                Err(source) => return Err(Error::Read { path, source }),
            }
        }
        Ok(true)
    }
}

impl SceneHead {
    /// The head of a scene on a terrain.
    pub fn new(folder: &Path, terrain: &Terrain, biome: &str, seed: u64) -> Self {
        let frame = terrain.elevation_m.frame();
        let GeoTransform { west_m, north_m, cell_m } = frame.transform;
        let extent_m = [frame.cols as f64 * cell_m, frame.rows as f64 * cell_m];
        Self {
            format: FORMAT,
            wildwood_version: env!("CARGO_PKG_VERSION").to_owned(),
            name: folder_name(folder),
            crs: match &frame.crs {
                Crs::Local => LOCAL.to_owned(),
                crs => crs.to_string(),
            },
            south_west_m: [west_m, north_m - extent_m[1]],
            extent_m,
            cell_m,
            rows: frame.rows,
            cols: frame.cols,
            latitude_rad: terrain.latitude_rad,
            grid_convergence_rad: terrain.grid_convergence_rad,
            biome: biome.to_owned(),
            seed,
        }
    }

    /// The CRS of the scene's map coordinates.
    ///
    /// # Errors
    /// [`CrsError`] if it is not understood.
    pub fn crs(&self) -> Result<Crs, CrsError> {
        if self.crs == LOCAL { Ok(Crs::Local) } else { Crs::parse(&self.crs) }
    }
}

/// The last part of a folder's path, `scene` if it has none.
pub fn folder_name(folder: &Path) -> String {
    let absolute = std::path::absolute(folder).unwrap_or_else(|_| folder.to_path_buf());
    absolute.file_name().map_or_else(|| "scene".to_owned(), |n| n.to_string_lossy().into_owned())
}

/// BLAKE3 of a file's content in hexadecimal, and its length in bytes.
///
/// # Errors
/// Whatever reading gives.
pub fn hash_file(path: &Path) -> io::Result<(String, u64)> {
    const CHUNK_BYTES: usize = 8 << 20;
    let mut file = File::open(path)?;
    let mut hasher = blake3::Hasher::new();
    let mut buffer =
        vec![
            0;
            CHUNK_BYTES.min(usize::try_from(file.metadata()?.len()).unwrap_or(CHUNK_BYTES).max(1))
        ];
    let mut bytes = 0;
    loop {
        let n = io::Read::read(&mut file, &mut buffer)?;
        if n == 0 {
            return Ok((hasher.finalize().to_hex().to_string(), bytes));
        }
        hasher.update_rayon(&buffer[..n]);
        bytes += n as u64;
    }
}

fn is_absent_or_empty(folder: &Path) -> Result<bool, Error> {
    match fs::read_dir(folder) {
        Ok(mut entries) => Ok(entries.all(|entry| {
            entry.is_ok_and(|e| e.file_name().to_string_lossy().starts_with(STAGING_PREFIX))
        })),
        Err(e) if e.kind() == io::ErrorKind::NotFound => Ok(true),
        Err(e) if e.kind() == io::ErrorKind::NotADirectory => Ok(false),
        Err(source) => Err(Error::Read { path: folder.to_path_buf(), source }),
    }
}

/// Writes one file that no stage owns: beside first, then renamed.
///
/// # Errors
/// [`Error::Write`]; a former file of the name is then as it was.
pub fn write_beside(path: &Path, bytes: &[u8]) -> Result<(), Error> {
    let write = || {
        let path = std::path::absolute(path)?;
        let staging = staging(path.parent().unwrap_or(&path))?;
        let staged = staging.path().join(path.file_name().unwrap_or_default());
        fs::write(&staged, bytes)?;
        fs::rename(&staged, &path)
    };
    write().map_err(|source| Error::Write { path: path.to_path_buf(), source })
}

/// A folder beside files under way, gone when dropped; what runs that were killed left there is swept away.
///
/// # Errors
/// Whatever making it gives.
pub fn staging(home: &Path) -> io::Result<TempDir> {
    sweep(home);
    let prefix = format!("{STAGING_PREFIX}{}-", std::process::id());
    tempfile::Builder::new().prefix(&prefix).tempdir_in(home)
}

/// Files under way into a scene folder: all of them arrive, or none.
pub struct Transaction {
    folder: PathBuf,
    staging: TempDir,
    /// Folders above the scene's that this transaction made, innermost first.
    made_parents: Vec<PathBuf>,
    files: Vec<String>,
    committed: bool,
}

impl Transaction {
    /// Begins writing to `folder`, which need not exist yet.
    ///
    /// # Errors
    /// [`Error::Write`] where nothing can be written.
    pub fn begin(folder: &Path) -> Result<Self, Error> {
        let fail = |source| Error::Write { path: folder.to_path_buf(), source };
        let home = match folder.parent() {
            _ if folder.is_dir() => folder,
            Some(parent) if !parent.as_os_str().is_empty() => parent,
            _ => Path::new("."),
        };
        let missing = home.ancestors().take_while(|p| !p.as_os_str().is_empty() && !p.exists());
        let made_parents: Vec<PathBuf> = missing.map(Path::to_path_buf).collect();
        fs::create_dir_all(home).map_err(fail)?;
        let staging = staging(home).map_err(|e| {
            remove_empty(&made_parents);
            fail(e)
        })?;
        let folder = folder.to_path_buf();
        Ok(Self { folder, staging, made_parents, files: Vec::new(), committed: false })
    }

    /// Writes one file of the scene through `write`, in place of one that was written before, and gives its BLAKE3.
    ///
    /// # Errors
    /// [`Error::Write`], naming the file as it will be called.
    pub fn write(
        &mut self,
        name: &str,
        write: impl FnOnce(&mut File) -> io::Result<()>,
    ) -> Result<String, Error> {
        let path = self.staging.path().join(name);
        let fail = |source| Error::Write { path: self.folder.join(name), source };
        let mut file = File::options()
            .read(true)
            .write(true)
            .create(true)
            .truncate(true)
            .open(&path)
            .map_err(fail)?;
        write(&mut file).map_err(fail)?;
        let (hash, _) = hash_file(&path).map_err(fail)?;
        if self.files.iter().all(|file| file != name) {
            self.files.push(name.to_owned());
        }
        Ok(hash)
    }

    /// Publishes every file, the manifest last, and removes files that the scene's former manifest lists and this
    /// one does not.
    ///
    /// A run killed in the middle leaves files that `scene.toml` does not know by hash: the next run makes them again.
    ///
    /// # Errors
    /// [`Error::Write`]; the folder is then as it was.
    pub fn commit(mut self, manifest: &Manifest) -> Result<(), Error> {
        let text = toml::to_string(manifest).map_err(|e| Error::Manifest {
            path: self.folder.join(MANIFEST),
            problem: e.to_string(),
        })?;
        let former = Manifest::read(&self.folder)?;
        self.write(MANIFEST, |file| io::Write::write_all(file, text.as_bytes()))?;
        if self.folder.is_dir() {
            self.replace_files()?;
            for file in former.iter().flat_map(Manifest::files) {
                if manifest.files().all(|kept| kept != file) && !EDITED.contains(&file.as_str()) {
                    let _ = fs::remove_file(self.folder.join(file)); // gone already: so be it
                }
            }
        } else {
            let fail = |source| Error::Write { path: self.folder.clone(), source };
            make_visible(self.staging.path()).map_err(fail)?;
            fs::rename(self.staging.path(), &self.folder).map_err(fail)?;
        }
        self.committed = true;
        Ok(())
    }

    /// Renames the staged files over the folder's, or none of them.
    fn replace_files(&self) -> Result<(), Error> {
        let former = self.staging.path().join("former");
        let fail = |path: PathBuf| move |source| Error::Write { path, source };
        fs::create_dir(&former).map_err(fail(self.folder.clone()))?;
        for (done, name) in self.files.iter().enumerate() {
            let path = self.folder.join(name);
            let replaced = set_aside(&path, &former.join(name))
                .and_then(|()| fs::rename(self.staging.path().join(name), &path));
            if let Err(source) = replaced {
                for (at, name) in self.files[..=done].iter().enumerate() {
                    // back to how it was; what cannot be restored is made again by the next run
                    let (aside, path) = (former.join(name), self.folder.join(name));
                    if aside.exists() {
                        let _ = fs::rename(aside, path);
                    } else if at < done {
                        let _ = fs::remove_file(path); // there was none before
                    }
                }
                return Err(Error::Write { path, source });
            }
        }
        Ok(())
    }
}

/// Moves a file out of the way, if it is there.
fn set_aside(path: &Path, aside: &Path) -> io::Result<()> {
    match fs::symlink_metadata(path) {
        Ok(found) if found.is_dir() => Err(io::Error::from(io::ErrorKind::IsADirectory)),
        Ok(_) => fs::rename(path, aside),
        Err(e) if e.kind() == io::ErrorKind::NotFound => Ok(()),
        Err(e) => Err(e),
    }
}

/// Removes what runs that were killed left in `home`.
fn sweep(home: &Path) {
    let abandoned = |name: &str| {
        let process = name.strip_prefix(STAGING_PREFIX)?.split('-').next()?.parse::<u32>().ok()?;
        // elsewhere than on Linux nothing tells whether the process lives
        (Path::new("/proc/self").exists() && !Path::new("/proc").join(process.to_string()).exists())
            .then_some(())
    };
    for entry in fs::read_dir(home).into_iter().flatten().flatten() {
        if abandoned(&entry.file_name().to_string_lossy()).is_some() {
            let _ = fs::remove_dir_all(entry.path());
        }
    }
}

impl Drop for Transaction {
    fn drop(&mut self) {
        if !self.committed {
            // the staging folder lies in the innermost of these and must go first
            let _ = fs::remove_dir_all(self.staging.path());
            remove_empty(&self.made_parents);
        }
    }
}

fn remove_empty(folders: &[PathBuf]) {
    for folder in folders {
        let _ = fs::remove_dir(folder); // not empty: somebody else uses it now
    }
}

/// Temporary folders are private; a scene has the permissions any new folder would have.
#[cfg(unix)]
fn make_visible(folder: &Path) -> io::Result<()> {
    use std::os::unix::fs::PermissionsExt;
    let probe = folder.join(".permissions");
    fs::create_dir(&probe)?;
    let mode = fs::metadata(&probe)?.permissions().mode();
    fs::remove_dir(&probe)?;
    fs::set_permissions(folder, fs::Permissions::from_mode(mode))
}

#[cfg(not(unix))]
fn make_visible(_: &Path) -> io::Result<()> {
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::raster::Grid;
    use std::io::Write;

    fn manifest(folder: &Path, files: BTreeMap<String, String>) -> Manifest {
        let terrain = Terrain {
            elevation_m: Grid::from_fn(4, 5, 2.0, |_| 1.0),
            latitude_rad: 0.7,
            grid_convergence_rad: 0.0,
        };
        let entry = StageEntry {
            key: "k".to_owned(),
            parameters: toml::Table::new(),
            figures: toml::Table::new(),
            files,
        };
        Manifest {
            scene: SceneHead::new(folder, &terrain, "sonoma", 3),
            inputs: Vec::new(),
            stages: BTreeMap::from([("terrain".to_owned(), entry)]),
        }
    }

    fn write_scene(folder: &Path, content: &str) -> Manifest {
        let mut transaction = Transaction::begin(folder).unwrap();
        let hash = transaction.write("terrain.tif", |f| f.write_all(content.as_bytes())).unwrap();
        let manifest = manifest(folder, BTreeMap::from([("terrain.tif".to_owned(), hash)]));
        transaction.commit(&manifest).unwrap();
        manifest
    }

    #[test]
    fn a_scene_reads_back_as_written_and_can_be_written_again() {
        let home = tempfile::tempdir().unwrap();
        let folder = home.path().join("a/b/forest");
        assert_eq!(Manifest::read(&folder).unwrap(), None);
        for content in ["one", "two"] {
            let written = write_scene(&folder, content);
            assert_eq!(Manifest::read(&folder).unwrap(), Some(written));
            assert_eq!(fs::read_to_string(folder.join("terrain.tif")).unwrap(), content);
            assert_eq!(fs::read_dir(&folder).unwrap().count(), 2, "nothing but the files");
        }
    }

    #[test]
    fn a_dropped_transaction_leaves_nothing() {
        let home = tempfile::tempdir().unwrap();
        let mut transaction = Transaction::begin(&home.path().join("x/forest")).unwrap();
        transaction.write("terrain.tif", |f| f.write_all(b"half")).unwrap();
        drop(transaction);
        assert_eq!(fs::read_dir(home.path()).unwrap().count(), 0);
    }

    #[test]
    fn a_failed_commit_restores_the_folder() {
        let home = tempfile::tempdir().unwrap();
        let folder = home.path().join("forest");
        let written = write_scene(&folder, "one");
        fs::create_dir(folder.join("slope.tif")).unwrap(); // in the way of a file
        let mut transaction = Transaction::begin(&folder).unwrap();
        transaction.write("terrain.tif", |f| f.write_all(b"two")).unwrap();
        transaction.write("slope.tif", |f| f.write_all(b"two")).unwrap();
        let error = transaction.commit(&written).unwrap_err();
        assert!(error.to_string().contains("slope.tif"), "{error}");
        assert_eq!(fs::read_to_string(folder.join("terrain.tif")).unwrap(), "one");
        assert_eq!(fs::read_dir(&folder).unwrap().count(), 3, "staging is gone");
    }

    #[test]
    fn issue_2_a_failed_commit_takes_back_files_that_were_not_there() {
        let home = tempfile::tempdir().unwrap();
        let folder = home.path().join("forest");
        let written = write_scene(&folder, "one");
        fs::create_dir(folder.join("slope.tif")).unwrap(); // in the way of a file
        let mut transaction = Transaction::begin(&folder).unwrap();
        transaction.write("chm.tif", |f| f.write_all(b"new")).unwrap();
        transaction.write("slope.tif", |f| f.write_all(b"two")).unwrap();
        transaction.commit(&written).unwrap_err();
        assert!(!folder.join("chm.tif").exists(), "the folder is as it was");
        assert!(folder.join("slope.tif").is_dir());
    }

    #[test]
    fn files_of_dropped_stages_are_removed() {
        let home = tempfile::tempdir().unwrap();
        let folder = home.path().join("forest");
        let mut written = write_scene(&folder, "one");
        written.stages.clear();
        Transaction::begin(&folder).unwrap().commit(&written).unwrap();
        assert!(!folder.join("terrain.tif").exists());
    }

    #[test]
    fn what_a_killed_run_left_is_swept() {
        let home = tempfile::tempdir().unwrap();
        let process = 4_000_000; // above what Linux gives out
        let left = home.path().join(format!("{STAGING_PREFIX}{process}-x"));
        fs::create_dir(&left).unwrap();
        write_scene(&home.path().join("forest"), "one");
        assert_eq!(left.exists(), !Path::new("/proc/self").exists());
    }

    #[test]
    fn a_changed_file_makes_its_stage_stale() {
        let home = tempfile::tempdir().unwrap();
        let folder = home.path().join("forest");
        let manifest = write_scene(&folder, "one");
        assert!(manifest.is_current(&folder, "terrain", "k").unwrap());
        assert!(!manifest.is_current(&folder, "terrain", "other").unwrap());
        fs::write(folder.join("terrain.tif"), "edited").unwrap();
        assert!(!manifest.is_current(&folder, "terrain", "k").unwrap());
    }

    #[test]
    fn a_folder_of_something_else_is_refused() {
        let home = tempfile::tempdir().unwrap();
        fs::write(home.path().join("thesis.doc"), "years of work").unwrap();
        assert!(matches!(Manifest::read(home.path()), Err(Error::NotAScene { .. })));
    }
}
