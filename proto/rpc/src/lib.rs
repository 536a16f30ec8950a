//! The gRPC contracts, their conversions to model types, and what every daemon does around its services.

pub mod chunks;
pub mod connect;
pub mod convert;
pub mod credentials;
#[cfg(feature = "daemon")]
pub mod daemon;
pub mod launcher;
pub mod protocol;
pub mod reference;
pub mod steering;
pub mod triggers;

pub use lamina_message::required;
pub use tonic::codegen::Bytes;

/// Generated from `proto/lamina/v1`: see `tests/contracts`.
#[allow(
    missing_docs,
    clippy::all,
    clippy::allow_attributes_without_reason,
    clippy::too_many_lines,
    unused_qualifications,
    reason = "generated code"
)]
pub mod v1 {
    pub use lamina_message::v1::*;
    include!("generated.rs");
}

use tonic::{Code, Status};

/// The most bytes of one gRPC message: a chunk and its frame.
pub const MAX_MESSAGE_BYTES: usize = 8 << 20;

/// A refusal that says which value is wrong.
pub fn invalid(error: &lamina_model::Invalid) -> Status {
    Status::new(Code::InvalidArgument, error.to_string())
}
