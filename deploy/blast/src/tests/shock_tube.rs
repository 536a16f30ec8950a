//! Shock tubes along each axis, against the exact solution.

use super::exact::{Riemann, Side};
use super::{config, density_error, run_until};
use crate::config::Boundary;
use crate::gas::Gas;

struct Tube {
    left: Side,
    right: Side,
    /// Time at which the waves have spread but not left a tube of length 2.
    end: f64,
}

const SOD: Tube =
    Tube { left: Side { rho: 1.0, u: 0.0, p: 1.0 }, right: Side { rho: 0.125, u: 0.0, p: 0.1 }, end: 0.4 };
/// Toro's test 2: two rarefactions that leave nearly nothing between them.
const NEAR_VACUUM: Tube =
    Tube { left: Side { rho: 1.0, u: -2.0, p: 0.4 }, right: Side { rho: 1.0, u: 2.0, p: 0.4 }, end: 0.3 };
/// Toro's test 3: a pressure ratio of 100 000.
const STRONG: Tube =
    Tube { left: Side { rho: 1.0, u: 0.0, p: 1000.0 }, right: Side { rho: 1.0, u: 0.0, p: 0.01 }, end: 0.024 };

/// The solver and the L1 error of its density, for a tube of `cells` cells along `axis`.
fn run(tube: &Tube, axis: usize, cells: usize) -> (Gas, f64) {
    let config = config(cells, 1.4, Boundary::Outflow);
    let mut shape = [3, 3, 3];
    shape[axis] = cells;
    let mut gas = Gas::new(shape, &config, |position| {
        let side = if position[axis] < 0.0 { tube.left } else { tube.right };
        let mut primitive = [side.rho, 0.0, 0.0, 0.0, side.p];
        primitive[1 + axis] = side.u;
        primitive
    });
    run_until(&mut gas, tube.end);
    let exact = Riemann::new(tube.left, tube.right, 1.4);
    let error = density_error(&gas, &config, |position| exact.at(position[axis] / tube.end).rho);
    (gas, error)
}

#[test]
fn sod_converges_at_about_first_order_along_each_axis() {
    for axis in 0..3 {
        let errors = [64, 128, 256].map(|cells| run(&SOD, axis, cells).1);
        assert!(errors[2] < 3e-3, "axis {axis}: L1 {errors:?}");
        // A contact smears like h^(2/3) and a shock like h, so less than 1 is right; a wrong wave would not converge.
        let order = (errors[0] / errors[2]).log2() / 2.0;
        assert!((0.75..1.2).contains(&order), "axis {axis}: order {order}, L1 {errors:?}");
    }
}

#[test]
fn hard_tubes_converge_too() {
    for (tube, most) in [(NEAR_VACUUM, 0.015), (STRONG, 0.12)] {
        let errors = [100, 400].map(|cells| run(&tube, 0, cells).1);
        assert!(errors[1] < most && errors[1] < 0.5 * errors[0], "L1 {errors:?}");
    }
}

#[test]
fn a_vacuum_is_survived_and_the_repairs_are_counted() {
    // So fast apart that the exact solution has no gas in the middle.
    let apart = |u| Side { rho: 1.0, u, p: 1e-3 };
    let tube = Tube { left: apart(-20.0), right: apart(20.0), end: 0.05 };
    let config = config(64, 1.4, Boundary::Outflow);
    let mut gas = Gas::new([64, 4, 4], &config, |[x, ..]| {
        let side = if x < 0.0 { tube.left } else { tube.right };
        [side.rho, side.u, 0.0, 0.0, side.p]
    });
    run_until(&mut gas, tube.end);
    assert!(gas.state().values().iter().all(|value| value.is_finite()));
    assert!(gas.state().component(0, 0..4).iter().all(|&rho| rho > 0.0));
    let repairs = gas.repairs();
    assert!(repairs.first_order > 0, "{repairs:?}");
}

#[test]
fn axes_differ_by_name_only() {
    // The same tube along x, y and z, walked by different code paths: equal to the bit.
    let lines = [0, 1, 2].map(|axis| {
        let (gas, _) = run(&SOD, axis, 64);
        let [nx, ny, nz] = gas.state().shape();
        let density = gas.state().component(0, 0..nz);
        let stride = [1, nx, nx * ny][axis];
        density.into_iter().step_by(stride).take(64).collect::<Vec<f32>>()
    });
    assert!(lines[0] == lines[1] && lines[1] == lines[2]);
}
