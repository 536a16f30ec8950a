//! The coding of reduced volumes: error-bounded, by adaptive entropy coding.
pub mod volume;
