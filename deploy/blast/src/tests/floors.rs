//! Cells that arithmetic has spoiled become harmless, and are counted; all others stay as they are.

use crate::state::{ENERGY, GasLaw, LANES, LaneBlock, lane, primitives, raise_to_floors};

const LAW: GasLaw = GasLaw { gamma: 1.4, least_density: 1e-5, least_pressure: 1e-7 };

#[test]
fn only_spoiled_cells_are_changed() {
    let spoiled = [
        [-1.0, 1.0, 0.0, 0.0, 1.0],
        [0.0, 0.0, 0.0, 0.0, 1.0],
        [f32::NAN, 0.0, 0.0, 0.0, 1.0],
        [f32::INFINITY, 0.0, 0.0, 0.0, 1.0],
        [1.0, f32::NAN, 0.0, 0.0, 1.0],
        [1.0, 0.0, f32::INFINITY, 0.0, 1.0],
        [1.0, 0.0, 0.0, 0.0, f32::NAN],
        [1.0, 0.0, 0.0, 0.0, f32::INFINITY],
        [1.0, 0.0, 0.0, 0.0, -1.0],
        // Slower than its momentum says: no energy is left for pressure.
        [1.0, 2.0, 0.0, 0.0, 1.0],
    ];
    let good = [0.5, 1.0, -1.0, 0.25, 3.0];
    let mut cells: LaneBlock = good.map(|value| [value; LANES]);
    for (l, cell) in spoiled.iter().enumerate() {
        cell.iter().enumerate().for_each(|(q, &value)| cells[q][l] = value);
    }
    assert_eq!(raise_to_floors(&mut cells, &LAW) as usize, spoiled.len());
    assert!((spoiled.len()..LANES).all(|l| lane(&cells, l) == good));
    let mut w = cells;
    primitives(&cells, &LAW, &mut w);
    for l in 0..LANES {
        let [rho, .., p] = lane(&w, l);
        assert!(lane(&w, l).iter().all(|value| value.is_finite()), "lane {l}");
        assert!(rho >= LAW.least_density && p >= LAW.least_pressure, "lane {l}: density {rho}, pressure {p}");
    }
    // Momentum survives where only pressure had to be raised.
    assert_eq!(lane(&cells, 9)[1], 2.0);
    assert!(lane(&cells, 9)[ENERGY] >= 2.0);
}
