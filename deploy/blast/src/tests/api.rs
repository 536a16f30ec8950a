//! What a caller sees.

use crate::{Config, ConfigError, Simulation};

fn small() -> Config {
    Config { cells: 24, ..Config::default() }
}

#[test]
fn absurd_configurations_are_refused_by_name() {
    for cells in [0, 7, 1025, usize::MAX] {
        let refused = Simulation::new(Config { cells, ..Config::default() }).err();
        assert_eq!(refused, Some(ConfigError::Cells(cells)));
    }
    assert_eq!(Config { clumps: 1001, ..small() }.check(), Err(ConfigError::Clumps(1001)));
    for value in [f64::NAN, f64::INFINITY, 0.0, -1.0, 1e9] {
        for (name, config) in [
            ("gamma", Config { gamma: value, ..small() }),
            ("interval", Config { interval: value, ..small() }),
            ("courant", Config { courant: value, ..small() }),
        ] {
            let message = config.check().unwrap_err().to_string();
            assert!(message.starts_with(name), "{message}");
        }
    }
    assert_eq!(Config::default().check(), Ok(()));
}

#[test]
fn slabs_make_up_the_whole() {
    let mut simulation = Simulation::new(small()).unwrap();
    simulation.advance();
    let mut joined = simulation.density_slab(0..5);
    joined.extend(simulation.density_slab(5..5));
    joined.extend(simulation.density_slab(5..24));
    assert_eq!(joined, simulation.density());
    assert_eq!(joined.len(), 24 * 24 * 24);
}

#[test]
fn cells_lie_in_the_box_of_edge_2() {
    let simulation = Simulation::new(small()).unwrap();
    let last = simulation.origin() + 23.0 * simulation.spacing();
    assert!((simulation.origin() + last).abs() < 1e-12);
    assert!((last + 0.5 * simulation.spacing() - 1.0).abs() < 1e-12);
}

#[test]
fn output_steps_have_equal_length() {
    let mut simulation = Simulation::new(Config { interval: 0.0125, ..small() }).unwrap();
    assert_eq!((simulation.step(), simulation.time()), (0, 0.0));
    for _ in 0..4 {
        simulation.advance();
    }
    assert_eq!(simulation.step(), 4);
    assert!((simulation.time() - 0.05).abs() < 1e-12 && simulation.cycles() > 4);
}

#[test]
fn seeds_give_other_scenes_and_equal_seeds_equal_ones() {
    let density = |config: &Config| Simulation::new(*config).unwrap().density();
    let first = density(&small());
    assert_eq!(first, density(&small()));
    assert_ne!(first, density(&small().reseeded()));
    assert_eq!(Config { seed: u64::MAX, ..small() }.reseeded().seed, 0);
}

#[test]
fn a_run_finishes_and_survives_being_left_alone() {
    for seed in 1..3 {
        let mut simulation = Simulation::new(Config { cells: 16, seed, ..Config::default() }).unwrap();
        assert!(!simulation.finished());
        let mut finished_at = None;
        for _ in 0..1200 {
            simulation.advance();
            if simulation.finished() && finished_at.is_none() {
                finished_at = Some(simulation.step());
            }
        }
        assert!(finished_at.is_some_and(|step| (100..400).contains(&step)), "finished at {finished_at:?}");
        assert!(simulation.finished());
        assert!(simulation.density().iter().all(|rho| rho.is_finite() && *rho > 0.0));
    }
}
