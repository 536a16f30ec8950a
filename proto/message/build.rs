//! Compiles the messages without protoc.

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let files = ["scene", "volume_header"].map(|n| format!("../lamina/v1/{n}.proto"));
    println!("cargo:rerun-if-changed=../lamina/v1");
    prost_build::Config::new().compile_fds(protox::compile(files, [".."])?)?;
    Ok(())
}
