//! The tree itself, held to its layout: crate arrows, where messages are seen, sizes of files, names, documents.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod modules;
mod viewer;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().to_owned()
}

/// `lamina-*` crates that the manifest in `folder` depends on, outside of tests.
fn dependencies(folder: &str) -> Vec<String> {
    let text = std::fs::read_to_string(root().join(folder).join("Cargo.toml")).unwrap();
    let manifest: toml::Table = text.parse().unwrap();
    let table = manifest["dependencies"].as_table().unwrap();
    table.keys().filter_map(|k| k.strip_prefix("lamina-")).map(str::to_owned).collect()
}

#[test]
fn crates_point_only_where_the_layout_says() {
    let allowed: BTreeMap<&str, &[&str]> = BTreeMap::from([
        ("proto/model", &[][..]),
        ("proto/message", &["model"]),
        ("proto/codec", &["model", "message"]),
        ("proto/rpc", &["model", "message"]),
        ("proto/field-expression", &["model"]),
        ("proto/compute", &[]),
        ("proto/raycast", &["model", "compute"]),
        ("proto/vdi-render", &["model", "compute", "raycast"]),
        ("deploy/blast", &[]),
        ("deploy/volume-io", &["model", "field-expression", "codec"]),
        ("deploy/report", &[]),
        ("proto/shared-memory", &[]),
        ("proto/mpi", &[]),
        ("proto/client", &["model", "rpc", "shared-memory"]),
        ("proto/client/c", &["model", "client"]),
        (
            "generator-node",
            &["model", "field-expression", "compute", "raycast", "codec", "rpc", "shared-memory", "mpi"],
        ),
        ("viz-node", &["model", "compute", "raycast", "vdi-render", "codec", "rpc"]),
        ("tuner", &["model", "rpc"]),
        ("deploy/catalyst", &["model", "client"]),
        ("deploy/python/native", &["model", "raycast", "vdi-render", "codec", "volume-io"]),
        ("viz-node/viewer/engine", &["model", "compute", "raycast", "vdi-render", "codec"]),
    ]);
    for (folder, allowed) in allowed {
        for dependency in dependencies(folder) {
            assert!(allowed.contains(&dependency.as_str()), "{folder} must not know {dependency}");
        }
    }
}

#[test]
fn one_crate_alone_opens_a_gpu() {
    for folder in [
        "proto/model",
        "proto/message",
        "proto/codec",
        "proto/rpc",
        "proto/raycast",
        "proto/vdi-render",
        "proto/client",
        "generator-node",
        "viz-node",
        "tuner",
        "deploy/cli",
        "deploy/lab",
    ] {
        let text = std::fs::read_to_string(root().join(folder).join("Cargo.toml")).unwrap();
        let manifest: toml::Table = text.parse().unwrap();
        let table = manifest["dependencies"].as_table().unwrap();
        assert!(!table.contains_key("wgpu"), "{folder} takes wgpu from lamina-compute");
    }
}

/// Rust files of the tree with their text, but generated ones.
fn rust_files() -> Vec<(PathBuf, String)> {
    let (mut files, mut folders) = (Vec::new(), Vec::new());
    folders.extend(["proto", "generator-node", "viz-node", "tuner", "deploy", "tests"].map(|top| root().join(top)));
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| e == "rs") && path.file_name().unwrap() != "generated.rs" {
                let text = std::fs::read_to_string(&path).unwrap();
                files.push((path.strip_prefix(root()).unwrap().to_owned(), text));
            }
        }
    }
    assert!(files.len() > 300, "{} files", files.len());
    files
}

#[test]
fn files_are_short_and_begin_with_what_they_are() {
    for (path, text) in rust_files() {
        let path = path.display();
        assert!(text.lines().count() <= 400, "{path} has {} lines; 400 are allowed", text.lines().count());
        let head = text.lines().find(|line| !line.trim().is_empty()).unwrap_or_default();
        assert!(head.starts_with("//!"), "{path} does not begin with //!");
        for (n, line) in text.lines().enumerate() {
            // Comments may run on; code is what fmt makes of it.
            let is_long = line.chars().count() > 120
                && !line.trim_start().starts_with("//")
                && !line.contains('"')
                && !line.ends_with('\\');
            assert!(!is_long, "{path}:{} has {} columns; 120 are allowed", n + 1, line.chars().count());
        }
    }
}

/// Files of the nodes that name messages and tonic; no other may.
const MESSAGE_FILES: &[&str] = &[
    "generator-node/src/lib.rs",
    "generator-node/src/control.rs",
    "generator-node/src/delivery.rs",
    "generator-node/src/group/",
    "generator-node/src/ingest/service.rs",
    "generator-node/src/publish.rs",
    "generator-node/src/subscribers.rs",
    "generator-node/src/trials.rs",
    "viz-node/src/lib.rs",
    "viz-node/src/quality_service.rs",
    "viz-node/src/steering.rs",
    "viz-node/src/subscribe.rs",
    "viz-node/src/intake.rs",
    "viz-node/src/negotiation.rs",
    "tuner/src/lib.rs",
    "tuner/src/live.rs",
    "tuner/src/push.rs",
    "tuner/src/remote.rs",
    "tuner/src/remote/",
    "tuner/src/status.rs",
    "viz-node/src/trials.rs",
    "viz-node/src/web/mod.rs",
    "viz-node/src/web/requests.rs",
    "tuner/src/control_loop.rs",
    "tuner/src/provisional.rs",
    "deploy/cli/src/doctor/cluster.rs",
    "deploy/cli/src/doctor/link.rs",
    "deploy/cli/src/nodes.rs",
    "deploy/cli/src/run_folder.rs",
];

/// Identifiers and prose are spelled the American way; the contract's grammar takes both spellings of its verbs.
#[test]
fn spelling_is_one() {
    let british =
        ["colo_ur", "neighbo_ur", "behavio_ur", "cent_re", "quanti_se", "optimi_se", "normali_se", "initiali_se"];
    // A misspelled key, to be refused.
    let meant = ["tests/tests/command_line.rs"];
    for (path, text) in rust_files() {
        let path = path.display().to_string();
        for word in british.map(|w| w.replace('_', "")) {
            let found = text.to_lowercase().lines().position(|line| line.contains(&word));
            assert!(found.is_none() || meant.contains(&&*path), "{path}: \"{word}\" in line {}", found.unwrap() + 1);
        }
    }
}

#[test]
fn messages_are_seen_where_nodes_speak() {
    for (path, text) in rust_files() {
        let path = path.display().to_string();
        let inside = path.starts_with("proto/") || path.starts_with("tests/") || path.contains("/tests/");
        let known = MESSAGE_FILES.iter().any(|file| path.starts_with(file));
        let speaks = text.contains("v1::") || text.contains("tonic::");
        assert!(inside || known || !speaks, "{path} names messages; convert them in rpc, or in a service");
    }
    for (path, text) in rust_files() {
        let path = path.display().to_string();
        let kernel = ["proto/model", "proto/codec", "proto/raycast", "proto/vdi-render", "proto/compute"];
        let speaks = text.contains("tonic") || text.contains("lamina_rpc");
        assert!(!kernel.iter().any(|k| path.starts_with(k)) || !speaks, "{path} knows nothing of gRPC");
    }
}

#[test]
fn every_option_of_lamina_that_a_readme_names_exists() {
    let mut count = 0;
    for readme in ["README.md", "deploy/cli/README.md"] {
        let text = std::fs::read_to_string(root().join(readme)).unwrap();
        for line in text.lines() {
            for (program, code) in line.split('`').skip(1).step_by(2).filter_map(|code| {
                let name = if code.starts_with("lamina-lab ") { "lamina-lab" } else { "lamina" };
                code.strip_prefix(name).filter(|rest| rest.starts_with(' ')).map(|rest| (name, rest))
            }) {
                let words: Vec<&str> = code.split_whitespace().collect();
                let help = std::process::Command::new(lamina_tests::processes::binary(program))
                    .args([words[0], "--help"])
                    .output()
                    .unwrap();
                let help = String::from_utf8(help.stdout).unwrap();
                assert!(help.contains("Usage:"), "{readme} names `{program} {}`", words[0]);
                for option in words.iter().filter(|w| w.starts_with("--")) {
                    assert!(help.contains(*option), "{readme} names {option} of `{program} {}`", words[0]);
                    count += 1;
                }
            }
        }
    }
    assert!(count > 20, "{count} options named");
}

#[test]
fn every_path_the_readme_names_exists() {
    let readme = std::fs::read_to_string(root().join("README.md")).unwrap();
    assert!(readme.lines().count() <= 170, "{} lines", readme.lines().count());
    let named = readme.split(['`', '(', ')', ' ', '\n']).filter(|w| {
        let tops = ["proto/", "generator-node/", "viz-node/", "tuner/", "tests/", "deploy/"];
        tops.iter().any(|t| w.starts_with(t)) && !w.contains(['*', '<', '{'])
    });
    let mut count = 0;
    for path in named {
        let path = path.trim_end_matches([',', '.', ':', ';']);
        assert!(root().join(path).exists(), "README names {path}, which is not there");
        count += 1;
    }
    assert!(count > 20, "{count} paths named");
}

#[test]
fn configuration_files_of_the_deployment_are_the_defaults() {
    let read = |name: &str| std::fs::read_to_string(root().join("deploy/config").join(name)).unwrap();
    let generator: lamina_generator_node::Config = toml::from_str(&read("generator-node.toml")).unwrap();
    assert_eq!(generator.check().unwrap(), lamina_generator_node::Config::default());
    let viz: lamina_viz_node::Config = toml::from_str(&read("viz-node.toml")).unwrap();
    assert_eq!(viz.check().unwrap(), lamina_viz_node::Config::default());
    let tuner: lamina_tuner::Config = toml::from_str(&read("tuner.toml")).unwrap();
    tuner.base().unwrap();
    assert_eq!(tuner, lamina_tuner::Config::default());
}

#[test]
fn every_attack_names_the_test_that_holds_it() {
    let table = std::fs::read_to_string(root().join("tests/ATTACKS.md")).unwrap();
    let rows: Vec<&str> = table.lines().filter(|line| line.starts_with("| ") && line.ends_with("` |")).collect();
    assert!(rows.len() >= 40, "{} attacks", rows.len());
    let sources: Vec<String> = rust_files().into_iter().map(|(_, text)| text).collect();
    for row in rows {
        let test = row.trim_end_matches("` |").rsplit('`').next().unwrap();
        let is_there = sources.iter().any(|text| text.contains(&format!("fn {test}(")));
        assert!(is_there, "there is no test `{test}`");
    }
}
