//! Protobuf messages of grids, scenes and the header of a volume's bytes, with total conversions to and from model types.
//!
//! Both the codec of volumes and the gRPC contracts carry them; neither knows the other.

mod convert;
mod effects;

/// Generated from `proto/lamina/v1/scene.proto` and `volume_header.proto`: see `tests/contracts`.
#[allow(
    missing_docs,
    clippy::all,
    clippy::allow_attributes_without_reason,
    clippy::too_many_lines,
    unused_qualifications,
    reason = "generated code"
)]
pub mod v1 {
    include!("generated.rs");
}

/// The field's value, or a refusal that names it.
///
/// # Errors
/// If the sender left the field out.
pub fn required<T>(field: Option<T>, name: &'static str) -> Result<T, lamina_model::Invalid> {
    field.ok_or_else(|| lamina_model::Invalid::new(name, "is missing from the message"))
}
