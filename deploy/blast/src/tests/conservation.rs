//! Mass, momentum and energy.

use super::{config, run_until};
use crate::config::Boundary;
use crate::gas::Gas;
use crate::setup::InitialState;
use crate::state::QUANTITIES;

/// The change of each total of the blast after `time`, as a share of mass or energy, or of the momentum's magnitude that
/// the blast could at most have.
fn drift(boundary: Boundary, time: f64) -> [f64; QUANTITIES] {
    let config = config(40, 5.0 / 3.0, boundary);
    let scene = InitialState::new(&config);
    let mut gas = Gas::new([40; 3], &config, |position| scene.at(position));
    let before: [f64; QUANTITIES] = std::array::from_fn(|q| gas.total(q));
    run_until(&mut gas, time);
    assert_eq!(gas.repairs().floored, 0);
    let (mass, energy) = (before[0], before[4]);
    let momentum = (2.0 * mass * energy).sqrt();
    let scale = [mass, momentum, momentum, momentum, energy];
    std::array::from_fn(|q| (gas.total(q) - before[q]).abs() / scale[q])
}

#[test]
fn nothing_is_lost_before_the_blast_meets_the_boundary() {
    let drift = drift(Boundary::Outflow, 0.1);
    // Rounding of single-precision cells, summed in double precision.
    assert!(drift.iter().all(|&d| d < 2e-7), "{drift:?}");
}

#[test]
fn nothing_is_ever_lost_in_a_periodic_box() {
    let drift = drift(Boundary::Periodic, 0.4);
    assert!(drift.iter().all(|&d| d < 5e-7), "{drift:?}");
}

#[test]
fn an_open_box_empties() {
    let config = config(24, 5.0 / 3.0, Boundary::Outflow);
    let scene = InitialState::new(&config);
    let mut gas = Gas::new([24; 3], &config, |position| scene.at(position));
    let initial_energy = gas.total(4);
    let mut totals = [gas.total(0), initial_energy];
    for _ in 0..20 {
        run_until(&mut gas, 0.1);
        let now = [gas.total(0), gas.total(4)];
        // Ghost cells never push inwards, so that neither mass nor energy can come in.
        assert!(now[0] <= totals[0] * (1.0 + 1e-6) && now[1] <= totals[1] * (1.0 + 1e-6), "{totals:?} to {now:?}");
        totals = now;
    }
    assert!(totals[1] < 0.1 * initial_energy);
}
