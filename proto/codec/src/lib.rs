//! Codecs for Volumetric Depth Images and reduced volumes: versioned, documented byte formats.
//!
//! `proto/formats` defines the formats. Decoders accept untrusted bytes: every size stated in them is checked against the
//! limits and against the other sizes before memory is allocated for it.

mod entropy;
mod envelope;
mod error;
mod intermediate;
mod limits;
mod sequence;
mod vdi;
pub mod volume;

pub use error::CodecError;
pub use intermediate::{EncodedStep, check_any, decode_any, decode_any_after, encode_any, encode_timed};
pub use limits::DecodeLimits;
pub use sequence::sequence;
pub use vdi::{
    BandStatistics, Codec, ColorDecoder, EncodeOptions, EncodedHeader, GeometryDecoder, Layout, VdiBand, band_sizes,
    decode, encode, join_bands, peek, quantize,
};
pub use volume::ErrorMeasure;
