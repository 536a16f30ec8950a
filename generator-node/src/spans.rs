//! What the node's spans in traces say.

use lamina_model::{Cost, GenerationParams};
use lamina_rpc::daemon::Attributes;

/// Of a span over generation and encoding: what was made, and what it cost.
pub(crate) fn of_generated(params: &GenerationParams, cost: &Cost) -> Attributes<6> {
    let ms = |time: std::time::Duration| time.as_secs_f64() * 1e3;
    [
        ("lamina.representation", params.representation().name().into()),
        ("lamina.resolution", i64::from(params.resolution()).into()),
        ("lamina.gamma", params.gamma().into()),
        ("lamina.size_bytes", (cost.size_bytes as i64).into()),
        ("lamina.generation_ms", ms(cost.generation).into()),
        ("lamina.encode_ms", ms(cost.encode).into()),
    ]
}
