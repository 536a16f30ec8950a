//! Stored voxels: the scalars of a volume in the narrowest type that holds them, mapped to the transfer function's range.
//!
//! Under a linear range, integers and half floats are stored as they are, and the range is applied after interpolation,
//! unless the range is too narrow for that in single precision. Single and double precision are mapped first and stored as
//! `f32` (in place, if `f32` came). Under a logarithmic range all types are mapped first: what is interpolated is the
//! logarithm, so that a steep front keeps its decades. Voxels that are not finite become NaN.

use half::f16;
use lamina_model::{ScalarRange, Scale, Voxels, for_voxels};
use rayon::prelude::*;

/// A scalar that voxels are stored as; both conversions are exact.
pub trait Scalar: Copy + Send + Sync + Into<f32> + Into<f64> {
    /// In double precision.
    #[inline(always)]
    fn wide(self) -> f64 {
        self.into()
    }
    /// In single precision.
    #[inline(always)]
    fn narrow(self) -> f32 {
        self.into()
    }
}

impl Scalar for u8 {}
impl Scalar for u16 {}
impl Scalar for f16 {}
impl Scalar for f32 {}

/// Scalars of a volume, x fastest.
#[derive(Debug)]
pub enum StoredVoxels {
    /// Unsigned 8 bits.
    U8(Vec<u8>),
    /// Unsigned 16 bits; signed ones are shifted by 32768.
    U16(Vec<u16>),
    /// Half precision.
    F16(Vec<f16>),
    /// Single precision, as positions in the range.
    F32(Vec<f32>),
}

/// Runs `$body` with `$v` bound to the typed vector inside `$stored`.
macro_rules! for_stored {
    ($stored:expr, $v:ident => $body:expr) => {
        match $stored {
            StoredVoxels::U8($v) => $body,
            StoredVoxels::U16($v) => $body,
            StoredVoxels::F16($v) => $body,
            StoredVoxels::F32($v) => $body,
        }
    };
}

pub(crate) use for_stored;

/// The stored form of `voxels` under `range`, whether signed integers were shifted, and the number of voxels not finite.
pub(crate) fn stored(voxels: Voxels, range: &ScalarRange) -> ((StoredVoxels, bool), u64) {
    let width = range.hi() - range.lo();
    // 65536 is the most values of voxels and rows of a table: positions in rows stay far below the largest `f32`.
    if range.scale() == Scale::Linear && (65536.0 + range.lo().abs()) / width < f64::from(ScalarRange::FARTHEST) {
        match voxels {
            Voxels::U8(v) => return ((StoredVoxels::U8(v), false), 0),
            Voxels::U16(v) => return ((StoredVoxels::U16(v), false), 0),
            Voxels::I16(v) => {
                return ((StoredVoxels::U16(v.into_iter().map(|x| (x as u16) ^ 0x8000).collect()), true), 0);
            }
            Voxels::F16(mut v) => {
                v.par_iter_mut().filter(|x| !x.is_finite()).for_each(|x| *x = f16::NAN);
                let empty = v.par_iter().filter(|x| x.is_nan()).count() as u64;
                return ((StoredVoxels::F16(v), false), empty);
            }
            Voxels::F32(_) | Voxels::F64(_) => {}
        }
    }
    let mapped = units(voxels, range);
    let empty = mapped.par_iter().filter(|x| x.is_nan()).count() as u64;
    ((StoredVoxels::F32(mapped), false), empty)
}

/// Positions of `voxels` in `range`; NaN where they are not finite. Single precision is mapped in place.
#[expect(clippy::useless_conversion, reason = "one body for all voxel types, f64 among them")]
pub(crate) fn units(voxels: Voxels, range: &ScalarRange) -> Vec<f32> {
    let width = range.hi() - range.lo();
    match voxels {
        Voxels::F32(mut v) if range.scale() == Scale::Linear && (1.0 / width).is_finite() => {
            let (lo, per_range, most) = (range.lo(), 1.0 / width, f64::from(ScalarRange::FARTHEST));
            v.par_chunks_mut(1 << 14).for_each(|chunk| {
                for x in chunk {
                    let unit = ((f64::from(*x) - lo) * per_range).clamp(-most, most) as f32;
                    *x = if x.is_finite() { unit } else { f32::NAN };
                }
            });
            v
        }
        Voxels::F32(mut v) => {
            v.par_iter_mut().for_each(|x| *x = range.unit_from_value((*x).into()));
            v
        }
        other if range.scale() == Scale::Linear => {
            let lo = range.lo();
            for_voxels!(&other, v => v.par_iter().map(|&x| ScalarRange::linear(x.into(), lo, width)).collect())
        }
        other => for_voxels!(&other, v => v.par_iter().map(|&x| range.unit_from_value(x.into())).collect()),
    }
}
