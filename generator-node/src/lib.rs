//! The generator-node: stands beside a simulation, takes its time steps in and gives Volumetric Depth Images out.
//!
//! Ingest -> cycle -> kernel -> publish, and control takes parameters in. No voxel leaves it but inside a VDI or as a
//! sampled reference colour.

pub mod kernel;
