//! Smooth flow: the scheme's order.

use super::{config, density_error, run_until};
use crate::config::Boundary;
use crate::gas::Gas;
use std::f64::consts::PI;

/// A density wave across the diagonal, carried by a uniform velocity: after time 2 it has gone round on every axis.
fn error_after_one_round(cells: usize) -> f64 {
    let config = config(cells, 5.0 / 3.0, Boundary::Periodic);
    let density = |[x, y, z]: [f64; 3]| 1.0 + 0.2 * (PI * (x + y + z)).sin();
    let mut gas = Gas::new([cells; 3], &config, |position| [density(position), 1.0, -1.0, 1.0, 1.0]);
    run_until(&mut gas, 2.0);
    density_error(&gas, &config, density)
}

#[test]
fn a_density_wave_converges_at_second_order() {
    let errors = [12, 24, 48].map(error_after_one_round);
    let orders = [(errors[0] / errors[1]).log2(), (errors[1] / errors[2]).log2()];
    assert!(orders[1] > 1.8 && orders[1] < 2.6, "orders {orders:?}, L1 {errors:?}");
    assert!(errors[2] < 2e-3, "L1 {errors:?}");
}

/// A weak standing sound wave along the diagonal of x and y. It exercises what a density wave does not: pressure,
/// momentum, and the splitting. Linear theory: it returns after one period 2 pi / (k c); the amplitude's square and
/// single precision keep the relative error above some 1e-3 on any grid.
fn sound_error(cells: usize) -> f64 {
    let config = config(cells, 5.0 / 3.0, Boundary::Periodic);
    let amplitude = 1e-3;
    let (k, c) = (PI * 2.0_f64.sqrt(), (5.0_f64 / 3.0).sqrt());
    let density = |[x, y, _]: [f64; 3]| 1.0 + amplitude * (PI * (x + y)).sin();
    let mut gas = Gas::new([cells, cells, 3], &config, |position| {
        let rho = density(position);
        [rho, 0.0, 0.0, 0.0, rho.powf(5.0 / 3.0)]
    });
    run_until(&mut gas, 2.0 * PI / (k * c));
    density_error(&gas, &config, density) / amplitude
}

#[test]
fn a_sound_wave_returns_after_its_period() {
    let errors = [8, 16, 32].map(sound_error);
    assert!(errors[2] < 2e-3 && errors[2] < errors[1] / 3.0 && errors[1] < errors[0] / 3.0, "relative L1 {errors:?}");
}

#[test]
fn a_uniform_flow_stays_uniform() {
    let config = config(20, 1.4, Boundary::Periodic);
    let mut gas = Gas::new([20; 3], &config, |_| [2.0, 0.5, -0.25, 1.0, 0.5]);
    run_until(&mut gas, 1.0);
    assert!(density_error(&gas, &config, |_| 2.0) < 1e-6);
}
