//! Where ONNX Runtime's library may lie.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// What is asked for ONNX Runtime's library, the first place that has it wins.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct LibrarySearch {
    /// A file the user named; nothing else is looked at then.
    pub named: Option<PathBuf>,
    /// `ORT_DYLIB_PATH`; nothing else is looked at then.
    pub variable: Option<PathBuf>,
    /// Folders in order, with what they are called.
    pub folders: Vec<(String, PathBuf)>,
}

/// File names of the library, without a version that follows.
const NAMES: [&str; 3] = ["libonnxruntime.so", "libonnxruntime.dylib", "onnxruntime.dll"];

impl LibrarySearch {
    /// The places of this machine: beside the program, a Python environment's `onnxruntime/capi`, the system's folders.
    /// `variable` gives the value of an environment variable.
    pub fn of_machine(
        named: Option<PathBuf>,
        program: Option<&Path>,
        variable: impl Fn(&str) -> Option<OsString>,
    ) -> Self {
        let mut folders = Vec::new();
        if let Some(beside) = program.and_then(Path::parent) {
            folders.push(("beside the program".to_owned(), beside.to_owned()));
        }
        for environment in ["VIRTUAL_ENV", "CONDA_PREFIX"] {
            if let Some(root) = variable(environment).filter(|root| !root.is_empty()) {
                for folder in python_packages(Path::new(&root)) {
                    folders.push((format!("${environment}"), folder.join("onnxruntime/capi")));
                }
            }
        }
        for name in ["LD_LIBRARY_PATH", "DYLD_LIBRARY_PATH"] {
            let paths = variable(name).unwrap_or_default();
            for folder in std::env::split_paths(&paths).filter(|f| !f.as_os_str().is_empty()) {
                folders.push((format!("${name}"), folder));
            }
        }
        let system = [
            "/usr/local/lib",
            "/usr/lib",
            "/usr/lib64",
            "/usr/lib/x86_64-linux-gnu",
            "/usr/lib/aarch64-linux-gnu",
            "/opt/homebrew/lib",
        ];
        folders.extend(system.map(|folder| (folder.to_owned(), PathBuf::from(folder))));
        let variable =
            variable("ORT_DYLIB_PATH").filter(|path| !path.is_empty()).map(PathBuf::from);
        Self { named, variable, folders }
    }

    /// The library to load; `Err` lists where it was looked for.
    pub fn find(&self) -> Result<PathBuf, Vec<String>> {
        if let Some(path) = self.named.as_ref().or(self.variable.as_ref()) {
            return Ok(path.clone());
        }
        let found = self.folders.iter().find_map(|(_, folder)| library_in(folder));
        found.ok_or_else(|| {
            let mut looked: Vec<String> =
                self.folders.iter().map(|(name, _)| name.clone()).collect();
            looked.dedup();
            looked
        })
    }

    /// Whether the user said which library to take.
    pub fn is_named(&self) -> bool {
        self.named.is_some() || self.variable.is_some()
    }
}

/// The library in a folder: the plain name, or the greatest that goes on with a version.
fn library_in(folder: &Path) -> Option<PathBuf> {
    let entries = std::fs::read_dir(folder).ok()?;
    let names = entries.flatten().filter_map(|entry| entry.file_name().into_string().ok());
    let found = names.filter_map(|name| Some((version_of(&name)?, name))).max()?;
    Some(folder.join(found.1))
}

/// What a library's name says of its version, the plain name greatest; `None` for other files.
fn version_of(name: &str) -> Option<Vec<u64>> {
    if NAMES.contains(&name) {
        return Some(vec![u64::MAX]);
    }
    let linux = name.strip_prefix("libonnxruntime.so.");
    let mac = name.strip_prefix("libonnxruntime.").and_then(|rest| rest.strip_suffix(".dylib"));
    linux.or(mac)?.split('.').map(|part| part.parse().ok()).collect()
}

/// `site-packages` folders of a Python environment.
fn python_packages(root: &Path) -> Vec<PathBuf> {
    let versions = std::fs::read_dir(root.join("lib")).into_iter().flatten().flatten();
    let mut folders: Vec<PathBuf> = versions
        .filter(|entry| entry.file_name().to_string_lossy().starts_with("python"))
        .map(|entry| entry.path().join("site-packages"))
        .collect();
    folders.sort_unstable();
    folders.push(root.join("Lib/site-packages"));
    folders
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_come_in_order_and_a_named_file_before_all() {
        let home = tempfile::tempdir().unwrap();
        let capi = home.path().join("venv/lib/python3.11/site-packages/onnxruntime/capi");
        std::fs::create_dir_all(&capi).unwrap();
        std::fs::write(capi.join("libonnxruntime.so.1.31.1"), b"").unwrap();
        std::fs::write(capi.join("libonnxruntime_providers_shared.so"), b"").unwrap();
        let program = home.path().join("bin/wildwood");
        std::fs::create_dir_all(home.path().join("bin")).unwrap();
        let variable = |name: &str| match name {
            "VIRTUAL_ENV" => Some(home.path().join("venv").into_os_string()),
            _ => None,
        };
        let search = LibrarySearch::of_machine(None, Some(&program), variable);
        assert_eq!(search.find().unwrap(), capi.join("libonnxruntime.so.1.31.1"));
        std::fs::write(home.path().join("bin/libonnxruntime.so"), b"").unwrap();
        assert_eq!(search.find().unwrap(), home.path().join("bin/libonnxruntime.so"));
        let named = LibrarySearch { named: Some("x.so".into()), ..search };
        assert_eq!(named.find().unwrap(), PathBuf::from("x.so"));
        let nowhere = LibrarySearch {
            folders: vec![("here".to_owned(), home.path().to_owned())],
            ..LibrarySearch::default()
        };
        assert_eq!(nowhere.find().unwrap_err(), ["here"]);
    }

    #[test]
    fn versions_are_numbers_and_the_plain_name_comes_first() {
        let home = tempfile::tempdir().unwrap();
        let add = |name: &str| std::fs::write(home.path().join(name), b"").unwrap();
        add("libonnxruntime.so.1.9.0");
        add("libonnxruntime.so.1.31.1");
        add("libonnxruntime.so.1.40.0.bak");
        let found = || library_in(home.path()).unwrap();
        assert_eq!(found(), home.path().join("libonnxruntime.so.1.31.1"));
        add("libonnxruntime.so");
        assert_eq!(found(), home.path().join("libonnxruntime.so"));
    }
}
