//! The same bits from any number of threads.

use crate::{Config, Simulation};

#[test]
fn threads_do_not_change_a_bit() {
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut simulation = Simulation::new(Config { cells: 37, ..Config::default() }).unwrap();
            for _ in 0..10 {
                simulation.advance();
            }
            let energy = simulation.energy_left().to_bits();
            let bits: Vec<u32> = simulation.density().iter().map(|rho| rho.to_bits()).collect();
            (bits, simulation.cycles(), energy, simulation.repairs())
        })
    };
    let one = run(1);
    assert!(one == run(2) && one == run(5));
}
