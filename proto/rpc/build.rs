//! Compiles the contracts without protoc.

/// Those of `lamina-message`.
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

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let contracts = ["scene", "vdi", "tuning", "nodes"].map(|n| format!("../lamina/v1/{n}.proto"));
    println!("cargo:rerun-if-changed=../lamina/v1");
    let descriptors = protox::compile(contracts, [".."])?;
    let with_scene = |config: tonic_prost_build::Builder, name: &&str| {
        config.extern_path(format!(".lamina.v1.{name}"), format!("::lamina_message::v1::{name}"))
    };
    SCENE_MESSAGES
        .iter()
        .fold(tonic_prost_build::configure(), with_scene)
        .bytes(".lamina.v1.PushPart.chunk")
        .bytes(".lamina.v1.Delivery.chunk")
        .compile_fds(descriptors)?;
    Ok(())
}
