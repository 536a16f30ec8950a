//! What people write: contracts, scenes, control points, expressions over fields; the first byte chooses.
#![no_main]

use lamina_field_expression::FieldExpression;
use lamina_model::{ControlPoint, Grid, Scene, Voxels};
use lamina_tuner::Contract;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    let Some((kind, bytes)) = data.split_first() else { return };
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    match kind % 4 {
        0 => {
            // What is read is written so that it is read again as the same.
            if let Ok(contract) = text.parse::<Contract>() {
                let again = contract.to_string().parse::<Contract>().expect("what it writes, it reads");
                assert_eq!(contract.to_string(), again.to_string());
            }
        }
        1 => drop(toml::from_str::<Scene>(text).map(Scene::check)),
        2 => drop(serde_json::from_str::<Vec<ControlPoint>>(text)),
        _ => {
            if let Ok(expression) = FieldExpression::new(text, &["a", "v.x", "v.y", "v.z"]) {
                let grid = Grid::new([3, 2, 2], glam::DVec3::ONE, glam::DVec3::ZERO).expect("a grid");
                let field = |n: u8| Some(Voxels::F32((0..12).map(|k| f32::from(k * n % 7) - 3.0).collect()));
                let values = expression.evaluate(&grid, &[1, 2, 3, 5].map(field)).expect("its fields are there");
                assert_eq!(values.len(), 12);
            }
        }
    }
});
