//! The gRPC contracts, their conversions to model types, and the VDI codec.
//!
//! The only crate that names prost messages' fields: nodes call the conversions here and work with model types.

pub mod chunks;
pub mod codec;
pub mod convert;
mod effects;
pub mod node;
pub mod reference;

/// Generated from `proto/lamina/v1`.
#[allow(missing_docs, clippy::all, unused_qualifications)]
pub mod v1 {
    tonic::include_proto!("lamina.v1");
}

use tonic::{Code, Status};

/// The most bytes of one gRPC message: a chunk and its frame.
pub const MAX_MESSAGE_BYTES: usize = 8 << 20;

/// A refusal that says which value is wrong.
pub fn invalid(error: &lamina_model::Invalid) -> Status {
    Status::new(Code::InvalidArgument, error.to_string())
}

/// The field's value, or a refusal that names it.
///
/// # Errors
/// If the sender left the field out.
pub fn required<T>(field: Option<T>, name: &'static str) -> Result<T, lamina_model::Invalid> {
    field.ok_or_else(|| lamina_model::Invalid::new(name, "is missing from the message"))
}
