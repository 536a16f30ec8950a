//! Encoded Volumetric Depth Images and reduced volumes: bytes that any version reads, small by context mixing.
//!
//! Formats are defined in `proto/formats`. Decoders take bytes from anyone: every claim is checked against the limits and the
//! other claims before memory is set aside for it.

mod entropy;
mod envelope;
mod error;
mod intermediate;
mod limits;
mod vdi;
pub mod volume;

pub use error::CodecError;
pub use intermediate::{check_any, decode_any, encode_any, encode_timed};
pub use limits::DecodeLimits;
pub use vdi::{Codec, EncodeOptions, EncodedHeader, Layout, decode, encode, peek, quantize};
