//! What people write: contracts, scenes, control points; the first byte chooses.
#![no_main]

use lamina_model::{ControlPoint, Scene};
use lamina_tuner::Contract;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    let Some((kind, bytes)) = data.split_first() else { return };
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    match kind % 3 {
        0 => {
            // What is read is written so that it is read again as the same.
            if let Ok(contract) = text.parse::<Contract>() {
                let again = contract.to_string().parse::<Contract>().expect("what it writes, it reads");
                assert_eq!(contract.to_string(), again.to_string());
            }
        }
        1 => drop(toml::from_str::<Scene>(text).map(Scene::check)),
        _ => drop(serde_json::from_str::<Vec<ControlPoint>>(text)),
    }
});
