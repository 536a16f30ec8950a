//! Codecs for Volumetric Depth Images and reduced volumes: versioned, documented byte formats.
//!
//! `proto/formats` defines the formats. Decoders accept untrusted bytes: every size stated in them is checked against the
//! limits and against the other sizes before memory is allocated for it.

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
pub use volume::ErrorMeasure;
