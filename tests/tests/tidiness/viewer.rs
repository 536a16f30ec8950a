//! The built viewer, held to what it was built from.

use crate::root;
use sha2::{Digest, Sha256};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

const VIEWER: &str = "viz-node/viewer";

fn files(path: PathBuf, into: &mut Vec<PathBuf>) {
    if path.is_dir() {
        std::fs::read_dir(path).unwrap().for_each(|entry| files(entry.unwrap().path(), into));
    } else {
        into.push(path);
    }
}

/// SHA-256 of the files in or at `paths`, which count from the viewer's folder, by those paths.
fn sums(paths: &[&str], is_source: impl Fn(&str) -> bool) -> BTreeMap<String, String> {
    let folder = root().join(VIEWER);
    let mut found = Vec::new();
    paths.iter().for_each(|path| files(folder.join(path), &mut found));
    let named = found.into_iter().map(|path| (path.strip_prefix(&folder).unwrap().display().to_string(), path));
    let sum = |path: &Path| Sha256::digest(std::fs::read(path).unwrap()).iter().map(|b| format!("{b:02x}")).collect();
    named.filter(|(name, _)| is_source(name)).map(|(name, path)| (name, sum(&path))).collect()
}

/// What `dist/FILE` states.
fn stated(file: &str) -> BTreeMap<String, String> {
    let text = std::fs::read_to_string(root().join(VIEWER).join("dist").join(file)).unwrap();
    text.lines().map(|line| line.split_once("  ").unwrap()).map(|(sum, name)| (name.into(), sum.into())).collect()
}

/// Holds `dist/FILE` to what lies there `now`; `command` builds it.
fn is_built_of(now: &BTreeMap<String, String>, file: &str, command: &str) {
    let then = stated(file);
    let names: BTreeSet<&String> = now.keys().chain(then.keys()).collect();
    let changed: Vec<_> = names.into_iter().filter(|&name| now.get(name) != then.get(name)).collect();
    assert!(changed.is_empty(), "run {VIEWER}/{command}; changed: {changed:?}");
}

#[test]
fn the_built_page_is_of_these_sources() {
    let configuration =
        ["package-lock.json", "tsconfig.json", "vite.config.ts", "vite.embed.config.ts", "vite.widget.config.ts"];
    let now = sums(&[&["src", "public", "index.html"], &configuration[..]].concat(), |_| true);
    is_built_of(&now, "viewer.sha256", "build");
}

#[test]
fn the_built_engine_is_of_these_sources() {
    let crates =
        ["model", "message", "codec", "compute", "raycast", "vdi-render"].map(|name| format!("../../proto/{name}"));
    let of = |folder: &str| [format!("{folder}/src"), format!("{folder}/Cargo.toml")];
    let paths: Vec<String> = crates.iter().map(String::as_str).chain(["engine"]).flat_map(of).collect();
    let paths: Vec<&str> = paths.iter().map(String::as_str).chain(["engine/examples"]).collect();
    let is_source = |name: &str| !name.contains("/tests/") && !name.ends_with("/tests.rs");
    is_built_of(&sums(&paths, is_source), "engine.sha256", "build engine");
}
