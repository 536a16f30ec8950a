//! What handing over a step of 128 MiB takes: handover SHARED_URL SENT_URL SECURE_URL, generator-nodes on this host; the last
//! two share no memory, and the last has credentials. `tests/bench/handover` starts them.
//!
//! This is rank 0 of two, and rank 1 never comes: no step is ever complete, and the nodes compute nothing meanwhile. All ways
//! are taken in turn, round after round; printed are medians.

use lamina_client::{Brick, Client, FullPolicy, RunOptions};
use lamina_model::{Grid, VoxelType};
use std::time::{Duration, Instant};

const DIMS: [usize; 3] = [512, 256, 256];
const VOXELS: usize = DIMS[0] * DIMS[1] * DIMS[2];
const ROUNDS: u64 = 15;

fn connect(url: &str) -> Result<Client, Box<dyn std::error::Error>> {
    let grid = Grid::new([DIMS[0], DIMS[1], 2 * DIMS[2]], glam::DVec3::ONE, glam::DVec3::ZERO)?;
    let options = RunOptions::new(url, "handover", "density", grid, VoxelType::F32);
    let deadline = Duration::from_secs(60);
    Ok(Client::connect(RunOptions { ranks: 2, full_policy: FullPolicy::DropOldest, deadline, ..options })?)
}

fn timed<T>(work: impl FnOnce() -> T) -> (f64, T) {
    let start = Instant::now();
    let done = work();
    (1e3 * start.elapsed().as_secs_f64(), done)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let urls: Vec<String> = std::env::args().skip(1).collect();
    let [shared, sent, secure] = urls.as_slice() else {
        return Err("usage: handover SHARED_URL SENT_URL SECURE_URL".into());
    };
    let (mut shared, mut sent, mut secure) = (connect(shared)?, connect(sent)?, connect(secure)?);
    if !shared.shares_memory() || sent.shares_memory() || secure.shares_memory() {
        return Err("the first node is to share memory, the others are not (shared_memory = false)".into());
    }
    let field: Vec<f32> = (0..VOXELS).map(|n| n as f32).collect();
    let brick = Brick::new([0; 3], DIMS, &field);
    let mut copy = field.clone();
    let names = [
        "sent over gRPC",
        "sent over gRPC with TLS",
        "copied to shared memory",
        "computed in shared memory",
        "copy within the process",
    ];
    let mut times = [const { Vec::new() }; 5];
    for round in 0..=ROUNDS {
        let (by_grpc, pushed) = timed(|| sent.push(round, 0.0, &brick));
        pushed?;
        let (by_tls, pushed) = timed(|| secure.push(round, 0.0, &brick));
        pushed?;
        let (by_copy, pushed) = timed(|| shared.push(2 * round, 0.0, &brick));
        pushed?;
        let buffer = shared.buffer([0; 3], DIMS)?;
        let (in_place, pushed) = timed(|| shared.push_buffer(2 * round + 1, 0.0, buffer));
        pushed?;
        let (copying, ()) = timed(|| std::hint::black_box(&mut copy).copy_from_slice(std::hint::black_box(&field)));
        // The first one maps memory and opens windows.
        if round > 0 {
            times.iter_mut().zip([by_grpc, by_tls, by_copy, in_place, copying]).for_each(|(all, ms)| all.push(ms));
        }
    }
    let medians = times.map(|mut all: Vec<f64>| {
        all.sort_by(f64::total_cmp);
        all[all.len() / 2]
    });
    for (name, ms) in names.iter().zip(medians) {
        println!("{name:28} {ms:8.2} ms  {:6.3} of gRPC  {:6.2} of a copy", ms / medians[0], ms / medians[4]);
    }
    Ok(())
}
