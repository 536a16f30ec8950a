//! A spherical blast into uniform gas: symmetry, and the radius of Sedov and Taylor.

use super::{at_rest, config, run_until};
use crate::config::{Boundary, Config};
use crate::gas::Gas;

const GAMMA: f64 = 5.0 / 3.0;

/// A point-like explosion in the middle of cold gas of density 1.
fn explosion(cells: usize) -> (Config, Gas) {
    let config = config(cells, GAMMA, Boundary::Outflow);
    let radius = 3.5 * config.spacing();
    let gas = Gas::new([cells; 3], &config, |[x, y, z]| {
        let inside = x * x + y * y + z * z < radius * radius;
        at_rest(1.0, if inside { 500.0 } else { 1e-4 })
    });
    (config, gas)
}

/// The radius at which the mean density over all directions last passes half of its peak above ambient.
fn shock_radius(density: &[f32], cells: usize, spacing: f64) -> f64 {
    // Bins of half a cell.
    let (mut sums, mut counts) = (vec![0.0; 2 * cells], vec![0.0; 2 * cells]);
    let offset = |i: usize| (i as f64 + 0.5) - 0.5 * cells as f64;
    for (cell, &rho) in density.iter().enumerate() {
        let (x, y, z) = (offset(cell % cells), offset(cell / cells % cells), offset(cell / (cells * cells)));
        let bin = (2.0 * (x * x + y * y + z * z).sqrt()) as usize;
        sums[bin] += f64::from(rho);
        counts[bin] += 1.0;
    }
    let means: Vec<f64> = sums.iter().zip(&counts).map(|(s, n)| s / f64::max(*n, 1.0)).collect();
    let half = 0.5 * (1.0 + means[..cells].iter().copied().fold(0.0, f64::max));
    let bin = means[..cells].iter().rposition(|&mean| mean > half).unwrap();
    (bin as f64 + 1.0) * 0.5 * spacing
}

#[test]
fn the_shock_has_the_radius_of_sedov_and_taylor() {
    let cells = 60;
    let (config, mut gas) = explosion(cells);
    let ambient = 1e-4 / (GAMMA - 1.0) * 8.0;
    let energy = gas.total(4) - ambient;
    // R = xi (E t^2 / rho)^(1/5), xi = 1.152 for gamma = 5/3 (Sedov 1959; Landau and Lifshitz, section 106).
    let time_at = |radius: f64| ((radius / 1.152).powi(5) / energy).sqrt();
    let mut last = 0.0;
    for radius in [0.5, 0.65, 0.8] {
        run_until(&mut gas, time_at(radius) - last);
        last = time_at(radius);
        let measured = shock_radius(&gas.state().component(0, 0..cells), cells, config.spacing());
        assert!((measured / radius - 1.0).abs() < 0.05, "radius {measured} instead of {radius}");
    }
    assert_eq!(gas.repairs().floored, 0);
}

/// How far a sphere's density, after the time of 40 usual cycles, is from its mirror images and from itself with axes
/// exchanged: mean differences as a share of the mean departure from ambient.
fn asymmetry(cells: usize, cycles_per_usual_one: u32) -> (f64, f64) {
    let n = cells;
    let (_, mut gas) = explosion(n);
    for _ in 0..40 {
        let dt = gas.stable_dt() / f64::from(cycles_per_usual_one);
        (0..cycles_per_usual_one).for_each(|_| gas.cycle(dt));
    }
    let density = gas.state().component(0, 0..n);
    let at = |x: usize, y: usize, z: usize| f64::from(density[(z * n + y) * n + x]);
    let (mut mirrored, mut exchanged, mut total) = (0.0, 0.0, 0.0);
    for (x, y, z) in (0..n * n * n).map(|cell| (cell % n, cell / n % n, cell / (n * n))) {
        let here = at(x, y, z);
        total += (here - 1.0).abs();
        mirrored += (here - at(n - 1 - x, y, z)).abs().max((here - at(x, y, n - 1 - z)).abs());
        exchanged += (here - at(y, x, z)).abs().max((here - at(y, z, x)).abs());
    }
    (mirrored / total, exchanged / total)
}

#[test]
fn a_sphere_stays_symmetric() {
    let (mirrored, exchanged) = asymmetry(32, 1);
    // Mirror images differ by rounding. Exchanged axes differ by the order of sweeps too, which vanishes with the time step.
    assert!(mirrored < 1e-5, "mirrored {mirrored}");
    assert!(exchanged < 0.04, "exchanged {exchanged}");
    let (_, finer) = asymmetry(32, 4);
    assert!(finer < 0.2 * exchanged, "exchanged {exchanged}, with a quarter of the time step {finer}");
}
