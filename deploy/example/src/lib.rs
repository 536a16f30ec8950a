//! The example simulation: 3-D compressible Euler equations, a blast into clumps.
