//! Compiles the contracts without protoc.

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let contracts = ["scene", "vdi", "tuning", "nodes"].map(|n| format!("../lamina/v1/{n}.proto"));
    println!("cargo:rerun-if-changed=../lamina/v1");
    let descriptors = protox::compile(contracts, [".."])?;
    tonic_prost_build::configure()
        .bytes(".lamina.v1.PushPart.chunk")
        .bytes(".lamina.v1.Delivery.chunk")
        .compile_fds(descriptors)?;
    Ok(())
}
