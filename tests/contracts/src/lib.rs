//! The Rust code of the gRPC contracts is what their .proto files say. It is kept in the tree, so that a build needs no compiler of
//! contracts. After a change of `proto/lamina/v1`: `UPDATE=1 cargo test --release -p lamina-contracts`.

#![cfg(test)]
#![allow(clippy::unwrap_used, reason = "a failure is a panic here")]

use std::path::{Path, PathBuf};

/// Messages of `lamina-message`, which the contracts take from there.
const SCENE_MESSAGES: [&str; 15] = [
    "Vec3",
    "VoxelType",
    "Grid",
    "Camera",
    "ControlPoint",
    "TransferFunction",
    "Scene",
    "Effects",
    "Shading",
    "Isosurface",
    "ClipPlane",
    "ClipBox",
    "ColorField",
    "ColorPoint",
    "DepthCue",
];

fn proto(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../proto").join(path)
}

fn descriptors(names: &[&str]) -> prost_types::FileDescriptorSet {
    let files = names.iter().map(|name| proto(&format!("lamina/v1/{name}.proto")));
    protox::compile(files, [proto("")]).unwrap()
}

/// Holds `crate_name`'s generated file to what was generated into `folder`.
fn compare(crate_name: &str, folder: &Path) {
    let kept = proto(crate_name).join("src/generated.rs");
    let generated = std::fs::read_to_string(folder.join("lamina.v1.rs")).unwrap();
    if std::env::var_os("UPDATE").is_some() {
        std::fs::write(&kept, &generated).unwrap();
    }
    let is_same = std::fs::read_to_string(&kept).is_ok_and(|text| text == generated);
    assert!(is_same, "{} is not what proto/lamina/v1 says: run this test with UPDATE=1", kept.display());
}

#[test]
fn messages_of_scenes_are_those_of_their_contracts() {
    let folder = tempfile::tempdir().unwrap();
    let mut config = prost_build::Config::new();
    config.out_dir(folder.path()).compile_fds(descriptors(&["scene", "volume_header"])).unwrap();
    compare("message", folder.path());
}

#[test]
fn services_are_those_of_their_contracts() {
    let folder = tempfile::tempdir().unwrap();
    let external = |config: tonic_prost_build::Builder, name: &&str| {
        config.extern_path(format!(".lamina.v1.{name}"), format!("::lamina_message::v1::{name}"))
    };
    SCENE_MESSAGES
        .iter()
        .fold(tonic_prost_build::configure(), external)
        .btree_map(".")
        .bytes(".lamina.v1.PushPart.chunk")
        .bytes(".lamina.v1.Delivery.chunk")
        .out_dir(folder.path())
        .compile_fds(descriptors(&["scene", "vdi", "tuning", "nodes", "steering", "group"]))
        .unwrap();
    compare("rpc", folder.path());
}
