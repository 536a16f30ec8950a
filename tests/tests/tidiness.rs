//! What the README and the layout promise of the tree itself.

#![allow(clippy::unwrap_used)]

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
        ("proto/compute", &[]),
        ("proto/raycast", &["model", "compute"]),
        ("proto/vdi-render", &["model", "compute", "raycast"]),
        ("deploy/blast", &[]),
        ("deploy/volume-io", &["model"]),
        ("proto/client", &["model", "rpc"]),
        ("proto/client/c", &["model", "client"]),
        ("generator-node", &["model", "compute", "raycast", "codec", "rpc"]),
        ("viz-node", &["model", "compute", "raycast", "vdi-render", "codec", "rpc"]),
        ("tuner", &["model", "rpc"]),
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
    ] {
        let text = std::fs::read_to_string(root().join(folder).join("Cargo.toml")).unwrap();
        let manifest: toml::Table = text.parse().unwrap();
        let table = manifest["dependencies"].as_table().unwrap();
        assert!(!table.contains_key("wgpu"), "{folder} takes wgpu from lamina-compute");
    }
}

#[test]
fn every_path_the_readme_names_exists() {
    let readme = std::fs::read_to_string(root().join("README.md")).unwrap();
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
