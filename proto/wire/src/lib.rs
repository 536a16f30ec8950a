//! The gRPC contracts, their conversions to model types, and the VDI codec.

pub mod codec;
