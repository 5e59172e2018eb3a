//! Holds the code to its own map: imports look down only, stages stay pure, ARCHITECTURE.md lists `src/`.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

/// Layers from the bottom; a module may use its own layer's modules below it in this list, and itself.
const LAYERS: &[&[&str]] = &[
    &["math", "rng", "progress"],
    &["raster"],
    &["io", "gpu", "inference", "species", "plants"],
    &["terrain"],
    &["abiotics"],
    &["canopy"],
    &["simulation"],
    &["undergrowth"],
    &["forest_floor"],
    &["tree"],
    &["scene"],
    &["export"],
    &["pipeline"],
    &["cli", "studio", "python"],
];

/// Stages are functions of their arguments: none of these may appear in their folders.
const STAGES: &[&str] =
    &["terrain", "abiotics", "canopy", "simulation", "undergrowth", "forest_floor", "tree"];
const IMPURE_STD: &[&str] = &["fs", "env", "time", "net", "process", "thread"];
const IMPURE: &[&str] = &["File::open", "current_num_threads", "available_parallelism"];

struct Source {
    path: String,
    text: String,
}

fn layer(module: &str) -> Option<usize> {
    LAYERS.iter().position(|modules| modules.contains(&module))
}

/// `src/raster/grid.rs` → `raster`; `src/math.rs` → `math`; the crate's roots belong to no layer.
fn module_of(path: &str) -> Option<&str> {
    let inner = path.strip_prefix("src/")?;
    let first = inner.split('/').next()?;
    let module = first.strip_suffix(".rs").unwrap_or(first);
    (!matches!(module, "lib" | "main")).then_some(module)
}

/// The code before the test module, without comments.
fn production_code(text: &str) -> String {
    let body = text.split("#[cfg(test)]\nmod tests").next().unwrap_or(text);
    body.lines().filter(|line| !line.trim_start().starts_with("//")).collect::<Vec<_>>().join("\n")
}

/// Names that a text puts right behind `root::`, alone or in braces: `root::a::b` and `root::{a::b, c}` give a and c.
fn names_behind(root: &str, code: &str) -> BTreeSet<String> {
    let mut names = BTreeSet::new();
    let is_name = |c: char| c.is_alphanumeric() || c == '_';
    for (at, found) in code.match_indices(&format!("{root}::")) {
        if code[..at].ends_with(is_name) {
            continue; // the end of a longer name
        }
        let rest = &code[at + found.len()..];
        let Some(group) = rest.strip_prefix('{') else {
            names.insert(rest.chars().take_while(|c| is_name(*c)).collect());
            continue;
        };
        let mut depth = 0;
        let mut flat = String::new();
        for c in group.chars() {
            match c {
                '{' => depth += 1,
                '}' if depth == 0 => break,
                '}' => depth -= 1,
                _ if depth == 0 => flat.push(c),
                _ => {}
            }
        }
        for item in flat.split(',') {
            names.insert(item.trim().split("::").next().unwrap_or("").to_owned());
        }
    }
    names
}

/// Top-level modules a file's code names, be it from `crate::` or by climbing there with `super::`.
fn used_modules(path: &str, code: &str) -> BTreeSet<String> {
    let module = path.trim_start_matches("src/").trim_end_matches(".rs").trim_end_matches("/mod");
    let to_root = "super::".repeat(module.split('/').count());
    names_behind("crate", &code.replace(&to_root, "crate::"))
}

fn violations(sources: &[Source]) -> Vec<String> {
    let mut found = Vec::new();
    for Source { path, text } in sources {
        let Some(module) = module_of(path) else { continue };
        let Some(own) = layer(module) else {
            found.push(format!("{path}: module `{module}` has no layer"));
            continue;
        };
        let code = production_code(text);
        for used in used_modules(path, &code) {
            if let Some(other) = layer(&used)
                && used != module
                && other >= own
                // within the foundation layer math < rng < progress, read in the list's order
                && !(other == own && position(&used) < position(module))
            {
                found.push(format!("{path}: `{module}` looks up to `{used}`"));
            }
        }
        if STAGES.contains(&module) {
            for name in names_behind("std", &code) {
                if IMPURE_STD.contains(&name.as_str()) {
                    found.push(format!("{path}: a stage uses std::{name}"));
                }
            }
            for impure in IMPURE {
                if code.contains(impure) {
                    found.push(format!("{path}: a stage uses {impure}"));
                }
            }
        }
        if path.ends_with("/mod.rs") && path != "src/cli/mod.rs" && code.lines().count() > 250 {
            found.push(format!("{path}: a mod.rs holds params, run and reading order, no more"));
        }
        let lines = text.lines().count();
        if lines > 800 {
            found.push(format!("{path}: {lines} lines, split at 800"));
        }
    }
    found
}

fn position(module: &str) -> usize {
    LAYERS.iter().flat_map(|l| l.iter()).position(|m| *m == module).unwrap_or(usize::MAX)
}

/// Paths in the ```` ```map ```` block of ARCHITECTURE.md: the first word of each line.
fn mapped_paths(architecture: &str) -> BTreeSet<String> {
    let block = architecture.split("```map").nth(1).and_then(|rest| rest.split("```").next());
    block
        .unwrap_or("")
        .lines()
        .filter_map(|l| l.split_whitespace().next())
        .map(str::to_owned)
        .collect()
}

fn map_drift(architecture: &str, sources: &[Source]) -> Vec<String> {
    let mapped = mapped_paths(architecture);
    let real: BTreeSet<String> = sources.iter().map(|s| s.path.clone()).collect();
    let missing = real.difference(&mapped).map(|p| format!("ARCHITECTURE.md does not list {p}"));
    let stale =
        mapped.difference(&real).map(|p| format!("ARCHITECTURE.md lists {p}, which is gone"));
    missing.chain(stale).collect()
}

fn read_sources() -> Vec<Source> {
    fn walk(root: &Path, folder: &Path, into: &mut Vec<Source>) {
        let mut entries: Vec<_> =
            fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
        entries.sort();
        for path in entries {
            if path.is_dir() {
                walk(root, &path, into);
            } else if path.extension().is_some_and(|e| e == "rs") {
                let text = fs::read_to_string(&path).unwrap();
                let path = path.strip_prefix(root).unwrap().to_string_lossy().replace('\\', "/");
                into.push(Source { path, text });
            }
        }
    }
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut sources = Vec::new();
    walk(root, &root.join("src"), &mut sources);
    sources
}

fn planted(path: &str, text: &str) -> Vec<Source> {
    vec![Source { path: path.to_owned(), text: text.to_owned() }]
}

#[test]
fn imports_look_down_only_and_stages_stay_pure() {
    let found = violations(&read_sources());
    assert!(found.is_empty(), "{}", found.join("\n"));
}

#[test]
fn architecture_map_equals_src() {
    let text =
        fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("ARCHITECTURE.md")).unwrap();
    let drift = map_drift(&text, &read_sources());
    assert!(drift.is_empty(), "{}", drift.join("\n"));
}

#[test]
fn planted_violations_are_caught() {
    let upward = [
        "use crate::pipeline::run;",
        "use crate::{math, pipeline::run};",
        "use crate::{raster::{Grid, Mask}, scene};",
        "fn f() { crate::cli::main(); }",
        "use super::super::pipeline;",
        "use super::super::{math, scene::Manifest};",
    ];
    for text in upward {
        assert_eq!(violations(&planted("src/abiotics/slope.rs", text)).len(), 1, "{text}");
    }
    assert_eq!(violations(&planted("src/math.rs", "use crate::rng::words;")).len(), 1);
    assert_eq!(violations(&planted("src/terrain/mod.rs", "use super::scene;")).len(), 1);
    for impure in [
        "use std::fs::read;",
        "use std::{env, sync::Arc};",
        "let t = std::time::Instant::now();",
        "let n = rayon::current_num_threads();",
    ] {
        assert_eq!(violations(&planted("src/terrain/mod.rs", impure)).len(), 1, "{impure}");
    }
    assert_eq!(violations(&planted("src/utils.rs", "")).len(), 1);
    assert_eq!(violations(&planted("src/raster/grid.rs", &"\n".repeat(801))).len(), 1);
    // what is allowed stays allowed
    assert!(violations(&planted("src/abiotics/slope.rs", "use crate::raster::Grid;")).is_empty());
    assert!(violations(&planted("src/progress.rs", "use crate::rng::words;")).is_empty());
    assert!(violations(&planted("src/abiotics/slope.rs", "use super::solar;")).is_empty());
}

#[test]
fn planted_map_drift_is_caught() {
    let map = "```map\nsrc/a.rs  one\nsrc/b.rs  two\n```";
    let mut sources = planted("src/a.rs", "");
    assert_eq!(map_drift(map, &sources), ["ARCHITECTURE.md lists src/b.rs, which is gone"]);
    sources.extend(planted("src/b.rs", ""));
    assert!(map_drift(map, &sources).is_empty());
    sources.extend(planted("src/c.rs", ""));
    assert_eq!(map_drift(map, &sources), ["ARCHITECTURE.md does not list src/c.rs"]);
}
