//! A blob that drifts, colored by its heat, pushed in slabs by 1 to 16 ranks: `blob URL RANK RANKS`. The fields lie inside of one
//! layer of ghost cells, and are read from there.

use glam::DVec3;
use lamina_client::{Brick, Client, ClientError, RunOptions};
use lamina_model::{Grid, VoxelType};

const DIMS: [usize; 3] = [24, 20, 16];
const STEPS: u64 = 3;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [url, rank, ranks] = &arguments[..] else { return Err("usage: blob URL RANK RANKS".into()) };
    let (rank, ranks): (usize, usize) = (rank.parse()?, ranks.parse()?);
    let [nx, ny, nz] = DIMS;
    let (first, beyond) = (nz * rank / ranks, nz * (rank + 1) / ranks);

    let grid = Grid::new(DIMS, DVec3::splat(0.1), DVec3::new(-1.2, -1.0, -0.8))?;
    let mut client = Client::connect(RunOptions {
        color_field: Some(("heat".into(), VoxelType::F64)),
        rank: rank as u32,
        ranks: ranks as u32,
        ..RunOptions::new(url, "blob", "density", grid, VoxelType::F64)
    })?;

    // x fastest; index 0 is a ghost cell.
    let strides = [1, nx + 2, (nx + 2) * (ny + 2)];
    let voxels = strides[2] * (beyond - first + 2);
    let (mut density, mut heat) = (vec![0.0_f64; voxels], vec![0.0_f64; voxels]);
    for step in 0..STEPS {
        for k in first..beyond {
            for (j, i) in (0..ny).flat_map(|j| (0..nx).map(move |i| (j, i))) {
                let x = 0.1 * i as f64 - 0.8 - 0.2 * step as f64;
                let (y, z) = (0.1 * j as f64 - 1.0, 0.1 * k as f64 - 0.8);
                let at = (i + 1) + (j + 1) * strides[1] + (k - first + 1) * strides[2];
                density[at] = 1.0 / (1.0 + 9.0 * (x * x + y * y + z * z));
                heat[at] = x + step as f64;
            }
        }
        let inside: usize = strides.iter().sum();
        let brick = Brick::new([0, 0, first], [nx, ny, beyond - first], &density[inside..]);
        let brick = brick.with_colors(&heat[inside..]).with_strides(strides);
        // Without a connection the simulation goes on, unseen.
        match client.push(step, 0.1 * step as f64, &brick) {
            Err(ClientError::Invalid(wrong)) => return Err(wrong.into()),
            Err(lost) => eprintln!("step {step} not shown: {lost}"),
            Ok(_) => {}
        }
    }
    let summary = client.close();
    println!("pushed {} dropped {} lost {}", summary.pushed, summary.dropped, summary.lost);
    Ok(())
}
