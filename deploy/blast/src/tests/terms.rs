//! Terms against closed forms, and against runs without them.

use super::run_until;
use crate::config::{Boundary, Config};
use crate::gas::Gas;
use crate::state::{DENSITY, ENERGY};
use crate::{ConfigError, Simulation};
use std::f64::consts::PI;

fn config() -> Config {
    Config { cells: 16, boundary: Boundary::Periodic, ..Config::default() }
}

#[test]
fn gas_falls_as_a_stone_does() {
    let mut gas = Gas::new([16; 3], &Config { gravity: [0.0, -3.0, 0.0], ..config() }, |_| [2.0, 0.0, 0.0, 0.0, 1.0]);
    run_until(&mut gas, 0.2);
    // In a box of volume 8: momentum rho g t, and the kinetic energy that goes with it.
    assert!((gas.total(2) / (8.0 * 2.0 * -0.6) - 1.0).abs() < 1e-5);
    assert!((gas.total(ENERGY) / (8.0 * (1.0 / (2.0 / 3.0) + 0.5 * 2.0 * 0.36)) - 1.0).abs() < 1e-5);
}

#[test]
fn gas_at_rest_cools_exponentially() {
    let mut gas = Gas::new([16; 3], &Config { cooling: 1.5, ..config() }, |_| [2.0, 0.0, 0.0, 0.0, 1.0]);
    run_until(&mut gas, 0.3);
    let exact = 8.0 * 1.5 * (-1.5 * 2.0 * 0.3_f64).exp();
    assert!((gas.total(ENERGY) / exact - 1.0).abs() < 1e-4, "{}", gas.total(ENERGY));
}

#[test]
fn a_shear_wave_decays_at_its_rate_and_totals_stay() {
    // u_y = a sin(pi x): nu k^2 = mu / rho pi^2. Slow against sound, so that nothing else happens.
    let wave = |[x, _, _]: [f64; 3]| [1.0, 0.0, 0.01 * (PI * x).sin(), 0.0, 1.0];
    let amplitude = |gas: &Gas| {
        let momentum = gas.state().component(2, 0..1);
        let sum: f64 = (0..32).map(|i| f64::from(momentum[i]) * (PI * ((i as f64 + 0.5) / 16.0 - 1.0)).sin()).sum();
        sum / 16.0
    };
    let decay = |viscosity: f64| {
        let config = Config { cells: 32, viscosity, ..config() };
        let mut gas = Gas::new([32; 3], &config, wave);
        let before = [gas.total(DENSITY), gas.total(ENERGY)];
        run_until(&mut gas, 0.5);
        assert!(
            (gas.total(DENSITY) / before[0] - 1.0).abs() < 1e-6 && (gas.total(ENERGY) / before[1] - 1.0).abs() < 1e-6
        );
        -(amplitude(&gas) / 0.01).ln() / 0.5
    };
    // What the scheme itself rubs off comes on top of both.
    let rate = decay(0.1) - decay(0.0);
    assert!((rate / (0.1 * PI * PI) - 1.0).abs() < 0.02, "{rate}");
}

#[test]
fn a_tracer_goes_with_the_gas_and_stays_a_share() {
    let mut gas = Gas::new([32; 3], &Config { cells: 32, ..config() }, |_| [1.0, 0.5, 0.0, 0.0, 1.0]);
    gas.follow(|[x, y, z]| (-(x * x + y * y + z * z) / 0.05).exp());
    // Its center along a periodic axis, by the phase of the first harmonic.
    let center = |gas: &Gas| {
        let values = gas.tracer().unwrap().values();
        let angle = |n: usize| PI * (((n % 32) as f64 + 0.5) / 16.0 - 1.0);
        let sum = |f: fn(f64) -> f64| values.iter().enumerate().map(|(n, v)| f64::from(*v) * f(angle(n))).sum::<f64>();
        sum(f64::sin).atan2(sum(f64::cos)) / PI
    };
    assert!(center(&gas).abs() < 1e-6);
    run_until(&mut gas, 0.4);
    // Upwind differences of a harmonic of 32 cells lag by at most (2 pi / 32)^2 / 6 of the way.
    assert!((center(&gas) - 0.2).abs() < 0.2 * 0.0065, "{}", center(&gas));
    assert!(gas.tracer().unwrap().values().iter().all(|v| (0.0..=1.0).contains(v)));
}

#[test]
fn a_tracer_changes_nothing_else_and_absurd_terms_are_refused() {
    let base = Config { cells: 16, ..Config::default() };
    let density = |config: Config| {
        let mut simulation = Simulation::new(config).unwrap();
        simulation.advance();
        assert_eq!(simulation.tracer().is_some(), config.tracer);
        simulation.density()
    };
    assert_eq!(density(base), density(Config { tracer: true, ..base }));
    for (name, bad) in [
        ("gravity", Config { gravity: [0.0, f64::NAN, 0.0], ..base }),
        ("cooling", Config { cooling: -1.0, ..base }),
        ("viscosity", Config { viscosity: 2.0, ..base }),
    ] {
        assert!(matches!(bad.check(), Err(ConfigError::Range { name: n, .. }) if n == name), "{name}");
    }
}
