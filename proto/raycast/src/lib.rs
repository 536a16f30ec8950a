//! Volume ray casting: from a scalar field under a scene to a picture, to a Volumetric Depth Image, or to a reduced volume.
//!
//! One algorithm at three levels: [`mod@reference`] is the oracle in double precision, [`simd`] casts eight rays at a time on the
//! processor, [`gpu`] is its counterpart in WGSL. Programs call [`Backend`].
//!
//! **Agreement.** The oracle evaluates the transfer function itself. The fast levels work in single precision and look the
//! function up in a table (`transfer_lut`), which smooths kinks, and jumps between two points at one position, over 1/1024 of
//! the range or less. So a sample may classify slightly differently, and where its difference from the open supersegment is
//! within rounding of gamma, it may join where the oracle's does not. Tests require pictures above 80 dB (the GPU: 90) against
//! the oracle's, and equal lists on 99 rays of 100. The SIMD levels agree with each other to the bit: none fuses multiply and
//! add.
#![cfg_attr(
    not(feature = "gpu"),
    allow(dead_code, unused_imports, reason = "the kernels on a GPU alone read some of it")
)]

mod backend;
mod count;
#[cfg(feature = "gpu")]
pub mod gpu;
mod gpu_ray_caster;
pub mod kernel;
pub mod reference;
pub mod simd;
mod vdi;
mod volume;

pub use backend::Backend;
pub use gpu_ray_caster::{GpuError, GpuRayCaster};
pub use vdi::assemble::RowBand;
pub use vdi::compositing::Compositor;
pub use volume::downsample::{most_points, reduce};
pub use volume::field::Field;
pub use volume::part::GridPart;
pub use volume::part_reduction::PartReduction;
pub use volume::part_sums::PartSums;
