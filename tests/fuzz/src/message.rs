//! Messages of the nodes, decoded and converted; the first byte chooses.
#![no_main]

use lamina_model::{Frame, GenerationParams, Quality, RunInfo, Scene, Setting, StepReport, Steerable, Steering};
use lamina_rpc::v1;
use libfuzzer_sys::fuzz_target;
use prost::Message;

fuzz_target!(|data: &[u8]| {
    let Some((kind, bytes)) = data.split_first() else { return };
    /// Decodes `$message` and converts it.
    macro_rules! converted {
        ($message:ty, $model:ty) => {
            if let Ok(message) = <$message>::decode(bytes) {
                let _ = <$model>::try_from(message);
            }
        };
    }
    match kind % 9 {
        0 => converted!(v1::Scene, Scene),
        1 => converted!(v1::GenerationParams, GenerationParams),
        2 => converted!(v1::QualityReply, Quality),
        3 => converted!(v1::StepReport, StepReport),
        4 => converted!(v1::SetParametersRequest, Setting),
        5 => converted!(v1::Frame, Frame),
        6 => converted!(v1::Run, RunInfo),
        7 => converted!(v1::Steering, Steering),
        _ => converted!(v1::Steerable, Steerable),
    }
});
