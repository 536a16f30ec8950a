//! Nanoseconds a point that expressions take on a grid of `SIDE` points a side: `derived [SIDE]`. Fields: `rho`, `v.x`, `v.y`, `v.z`,
//! single precision.

use lamina_field_expression::FieldExpression;
use lamina_model::{Grid, Voxels};
use std::time::Instant;

const EXPRESSIONS: [&str; 7] = [
    "magnitude(v)",
    "0.5 * rho * dot(v, v)",
    "magnitude(gradient(rho))",
    "magnitude(curl(v))",
    "q_criterion(v)",
    "lambda2(v)",
    "magnitude(curl(v / rho))",
];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let side = std::env::args().nth(1).map_or(Ok(128), |side| side.parse())?;
    let grid = Grid::new([side; 3], glam::DVec3::ONE, glam::DVec3::ZERO)?;
    let wave = |k: f32| Some(Voxels::F32((0..grid.voxels()).map(|n| 2.0 + (k * n as f32).sin()).collect()));
    let fields = [0.11, 0.23, 0.37, 0.59].map(wave);
    for text in EXPRESSIONS {
        let expression = FieldExpression::new(text, &["rho", "v.x", "v.y", "v.z"])?;
        let time = || {
            let begun = Instant::now();
            expression.evaluate(&grid, &fields).map(|_| begun.elapsed().as_secs_f64())
        };
        let times = (0..5).map(|_| time()).collect::<Result<Vec<_>, _>>()?;
        let best = times.into_iter().fold(f64::INFINITY, f64::min);
        println!("{text}: {:.1}", 1e9 * best / grid.voxels() as f64);
    }
    Ok(())
}
