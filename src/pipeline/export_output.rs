//! Where an export goes: checked before anything is read, written beside, renamed when it is whole.

use std::fs;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use tempfile::TempDir;

use super::Error;
use super::export_format::{ExportFormat, OutputKind};
use crate::scene::{self, Manifest};

/// The file that says what an exported folder holds; a folder with it may be replaced.
pub const NOTE: &str = "export.json";

/// Bytes that tell what an existing file is.
const HEAD_BYTES: u64 = 128;

/// An export under way: it arrives as a whole, or not at all.
pub struct Output {
    path: PathBuf,
    kind: OutputKind,
    staging: TempDir,
}

impl Output {
    /// Checks a path, and makes room beside it.
    ///
    /// # Errors
    /// If its folder is missing, or something is there that is no export of the format.
    pub fn begin(path: &Path, format: ExportFormat) -> Result<Self, Error> {
        let kind = format.output_kind(path);
        check(path, format, kind)?;
        let fail = |source| write_error(path, source);
        let path = std::path::absolute(path).map_err(fail)?;
        let home = path.parent().unwrap_or(&path);
        let staging = scene::staging(home).map_err(fail)?;
        let output = Self { path, kind, staging };
        if kind == OutputKind::Folder {
            fs::create_dir(output.staged()).map_err(|source| write_error(&output.path, source))?;
        }
        Ok(output)
    }

    /// Where the file is to be written, or the folder to be filled. It has the name that it will have.
    pub fn staged(&self) -> PathBuf {
        self.staging.path().join(self.path.file_name().unwrap_or_default())
    }

    /// Puts what was written in its place, and that of a former export; gives its size in bytes.
    ///
    /// # Errors
    /// If it cannot be renamed; what was there is then as it was.
    pub fn commit(self) -> Result<u64, Error> {
        let staged = self.staged();
        let publish = || -> io::Result<u64> {
            let bytes = size(&staged)?;
            let former = self.staging.path().join(".former");
            // a file is replaced in one step, a folder is moved aside first
            let is_replaced = self.kind == OutputKind::Folder && self.path.exists();
            if is_replaced {
                fs::rename(&self.path, &former)?;
            }
            if let Err(error) = fs::rename(&staged, &self.path) {
                if is_replaced {
                    let _ = fs::rename(&former, &self.path); // back to how it was
                }
                return Err(error);
            }
            Ok(bytes)
        };
        publish().map_err(|source| write_error(&self.path, source))
    }
}

/// A failure to write an export.
pub fn write_error(path: &Path, source: io::Error) -> Error {
    crate::io::Error::Write { path: path.to_path_buf(), source }.into()
}

fn check(path: &Path, format: ExportFormat, kind: OutputKind) -> Result<(), Error> {
    let name = format.name();
    if kind == OutputKind::File {
        return check_file(path, name, |head| format.is_of_kind(head));
    }
    check_home(path)?;
    let Ok(found) = fs::metadata(path) else { return Ok(()) };
    let refuse = |why: String| refuse(path, &why);
    if !found.is_dir() {
        return refuse(format!("is a file where {name} is a folder; name a folder with -o"));
    }
    let note = fs::read_to_string(path.join(NOTE)).unwrap_or_default();
    let note: serde_json::Value = serde_json::from_str(&note).unwrap_or_default();
    let is_empty = fs::read_dir(path).is_ok_and(|mut entries| entries.next().is_none());
    if is_empty || note["format"] == name {
        return Ok(());
    }
    refuse(format!("exists and is no export to {name}; name a new folder with -o"))
}

/// Refuses a file to be written that has no folder, or in whose place something of another kind is.
///
/// # Errors
/// If it cannot be written there without losing something.
pub fn check_file(
    path: &Path,
    kind: &str,
    is_of_kind: impl Fn(&[u8]) -> bool,
) -> Result<(), Error> {
    check_home(path)?;
    let Ok(found) = fs::metadata(path) else { return Ok(()) };
    if found.is_dir() {
        return refuse(path, &format!("is a folder where {kind} is one file; name a file with -o"));
    }
    if !found.is_file() {
        return refuse(path, "is no regular file; name a file with -o");
    }
    let mut head = Vec::new();
    match fs::File::open(path).and_then(|file| file.take(HEAD_BYTES).read_to_end(&mut head)) {
        Ok(_) if head.is_empty() || is_of_kind(&head) => Ok(()),
        Ok(_) => refuse(path, &format!("exists and is no {kind}; name another file with -o")),
        Err(source) => Err(crate::io::Error::Read { path: path.to_path_buf(), source }.into()),
    }
}

/// Refuses to take the place of a file of a scene, of the scene itself, or of a folder that holds it.
///
/// # Errors
/// If the output belongs to the scene.
pub fn check_apart(output: &Path, folder: &Path, manifest: &Manifest) -> Result<(), Error> {
    let Ok(scene) = fs::canonicalize(folder) else { return Ok(()) };
    // what is not there yet may still be a file that the scene lost
    let Some(place) = fs::canonicalize(output).ok().or_else(|| {
        let absolute = std::path::absolute(output).ok()?;
        Some(fs::canonicalize(absolute.parent()?).ok()?.join(absolute.file_name()?))
    }) else {
        return Ok(());
    };
    let is_file_of = |file: &str| place == scene.join(file);
    if scene.starts_with(&place)
        || is_file_of(scene::MANIFEST)
        || manifest.files().any(|file| is_file_of(file))
    {
        return refuse(
            output,
            "belongs to the scene itself, or holds it; name another output with -o",
        );
    }
    Ok(())
}

fn check_home(path: &Path) -> Result<(), Error> {
    if path.file_name().is_none() {
        return refuse(path, "names no file or folder; name a new one with -o");
    }
    let home = path.parent().filter(|home| !home.as_os_str().is_empty()).unwrap_or(Path::new("."));
    if !home.is_dir() {
        let why = format!("its folder {} does not exist; make it first", home.display());
        return refuse(path, &why);
    }
    Ok(())
}

fn refuse(path: &Path, why: &str) -> Result<(), Error> {
    let what = format!("{}: {why}", path.display());
    Err(Error::Usage { what })
}

/// Bytes of a file, or of all files of a folder.
fn size(path: &Path) -> io::Result<u64> {
    let found = fs::metadata(path)?;
    if !found.is_dir() {
        return Ok(found.len());
    }
    fs::read_dir(path)?.map(|entry| size(&entry?.path())).sum()
}
