//! The daemon beside the simulation: volumes in, VDIs out.
