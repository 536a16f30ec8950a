//! The VDI codec.
