//! Records the series that the suites replay: `cargo run --release -p lamina-tests --example record -- tests/data`.

use glam::DVec3;
use lamina_blast::{Config, Simulation};
use lamina_model::{Grid, Volume, Voxels};
use lamina_volume_io::{write_pvd, write_vti};
use std::path::PathBuf;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let dir = PathBuf::from(std::env::args().nth(1).ok_or("name a folder")?);
    let mut simulation = Simulation::new(Config { cells: 32, ..Config::default() })?;
    let mut entries = Vec::new();
    for step in 0..8 {
        let grid = Grid::new([32; 3], DVec3::splat(simulation.spacing()), DVec3::splat(simulation.origin()))?;
        let name = format!("blast_{step}.vti");
        write_vti(&dir.join(&name), &Volume::new(grid, Voxels::F32(simulation.density()))?, "density")?;
        entries.push((simulation.time(), name));
        for _ in 0..8 {
            simulation.advance();
        }
    }
    write_pvd(&dir.join("blast.pvd"), &entries)?;
    Ok(())
}
