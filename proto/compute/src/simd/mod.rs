//! Portable SIMD: types of eight lanes, in which the CPU kernels for ray casting and VDI rendering are written.
//!
//! A kernel is generic over [`Lanes`] and compiled once per instruction set ([`Level`]); [`Level::detect`] picks one at run
//! time. No level fuses multiplication and addition, and `min` and `max` return the second operand if either is NaN, so all
//! levels agree to the bit. Everything that a kernel calls must be inlined into the function that enables the instruction
//! set: `#[inline(always)]` throughout, and no closures, which the compiler may fail to inline.

#[cfg(target_arch = "x86_64")]
mod avx2;
mod exp;
mod portable;

#[cfg(target_arch = "x86_64")]
pub use avx2::Avx2;
pub use exp::{SMALL_OPTICAL_DEPTH, opacity, small_opacity};
pub use portable::Portable;

use half::f16;
use std::ops::{Add, BitAnd, BitOr, Mul, Not, Sub};

/// Number of lanes.
pub const WIDTH: usize = 8;

/// The vector types of one instruction set.
pub trait Lanes: Copy + Send + Sync + 'static {
    /// Eight single-precision numbers.
    type F: SimdF32<M = Self::M, I = Self::I> + From<Self::I>;
    /// Eight 32-bit integers.
    type I: SimdI32<M = Self::M>;
    /// Eight booleans.
    type M: SimdMask;

    /// Loads `voxels[i]` and `voxels[i + 1]` for the index i of every lane, converted to `f32`.
    ///
    /// # Safety
    /// Every `index + 1` must lie inside `voxels`.
    #[expect(unsafe_code, reason = "an unchecked load; the caller has clamped all indices at once")]
    unsafe fn pairs<V: Pair>(voxels: &[V], index: &[usize; WIDTH]) -> (Self::F, Self::F);

    /// Interpolates a table of rows linearly at position `at` (0 is the first row, 1 the second), each column into one
    /// vector. The position is clamped into the table, which needs two rows or more; NaN counts as 0.
    fn rows4(table: &[[f32; 4]], at: Self::F) -> [Self::F; 4];
    /// As [`Self::rows4`] for rows of eight columns, of which the first six are returned.
    fn rows6(table: &[[f32; 8]], at: Self::F) -> [Self::F; 6];
}

/// A scalar type of voxels, which kernels load in pairs of neighbors along x.
pub trait Pair: Copy + Send + Sync + Into<f32> + 'static {
    /// The type, as a constant to branch on at compile time.
    const KIND: ScalarKind;
}
/// Scalar types of voxels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[expect(missing_docs, reason = "named like the types")]
pub enum ScalarKind {
    U8,
    U16,
    F16,
    F32,
}
impl Pair for u8 {
    const KIND: ScalarKind = ScalarKind::U8;
}
impl Pair for u16 {
    const KIND: ScalarKind = ScalarKind::U16;
}
impl Pair for f16 {
    const KIND: ScalarKind = ScalarKind::F16;
}
impl Pair for f32 {
    const KIND: ScalarKind = ScalarKind::F32;
}

/// Eight single-precision numbers.
pub trait SimdF32: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> {
    /// The mask type of comparisons.
    type M: SimdMask;
    /// The integer type of conversions.
    type I: SimdI32<M = Self::M>;
    /// `x` in all lanes.
    fn splat(x: f32) -> Self;
    /// One number per lane.
    fn from_array(x: [f32; WIDTH]) -> Self;
    /// One number per lane.
    fn to_array(self) -> [f32; WIDTH];
    /// The lesser; `other` if either is NaN.
    fn min(self, other: Self) -> Self;
    /// The greater; `other` if either is NaN.
    fn max(self, other: Self) -> Self;
    /// The quotient.
    fn div(self, other: Self) -> Self;
    /// Less than; false for NaN.
    fn lt(self, other: Self) -> Self::M;
    /// At most; false for NaN.
    fn le(self, other: Self) -> Self::M;
    /// `a` where `mask` holds, else `b`.
    fn select(mask: Self::M, a: Self, b: Self) -> Self;
    /// `self` where `mask` holds, else 0.
    fn zero_unless(self, mask: Self::M) -> Self;
    /// Converted to integers, rounding towards zero. Numbers that do not fit 32 bits give `i32::MIN`.
    fn to_int(self) -> Self::I;
    /// The square root.
    fn sqrt(self) -> Self;
    /// The magnitude.
    fn abs(self) -> Self;
    /// The minimum of `low` and the maximum of `high` over the lanes where `mask` holds, rounded towards zero. Both must fit
    /// 32 bits, and `mask` must hold in at least one lane.
    fn range_where(low: Self, high: Self, mask: Self::M) -> [i32; 2];
    /// 2^n for integers n in -126..=127.
    fn exp2_int(n: Self::I) -> Self;
}

/// Eight 32-bit integers, with wrapping arithmetic.
pub trait SimdI32: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> {
    /// The mask type of comparisons.
    type M: SimdMask;
    /// `x` in all lanes.
    fn splat(x: i32) -> Self;
    /// One number per lane.
    fn from_array(x: [i32; WIDTH]) -> Self;
    /// One number per lane.
    fn to_array(self) -> [i32; WIDTH];
    /// The lesser.
    fn min(self, other: Self) -> Self;
    /// The greater.
    fn max(self, other: Self) -> Self;
    /// Greater than.
    fn gt(self, other: Self) -> Self::M;
    /// Equal.
    fn eq(self, other: Self) -> Self::M;
    /// `a` where `mask` holds, else `b`.
    fn select(mask: Self::M, a: Self, b: Self) -> Self;
    /// The bytes of `x`, one per lane, the lowest byte in the first lane.
    fn from_bytes(x: u64) -> Self;
    /// The lanes as indices; none may be negative.
    fn to_indices(self) -> [usize; WIDTH];
    /// The maximum over all lanes.
    fn max_lane(self) -> i32;
    /// Arithmetic shift right by `N` bits.
    fn shr<const N: i32>(self) -> Self;
    /// Shifted left by `N` bits.
    fn shl<const N: i32>(self) -> Self;
}

/// Eight booleans.
pub trait SimdMask: Copy + BitAnd<Output = Self> + BitOr<Output = Self> + Not<Output = Self> {
    /// The lanes as bits; bit n is lane n.
    fn bits(self) -> u32;
    /// True if any lane is.
    #[inline(always)]
    fn any(self) -> bool {
        self.bits() != 0
    }
}

/// Splits a position in a table of `len` rows into the index of the row before it, at most `len` - 2, and the weight of the
/// next row.
#[inline(always)]
fn row<L: Lanes>(at: L::F, len: usize) -> (L::I, L::F) {
    let at = at.max(L::F::splat(0.0)).min(L::F::splat(((len - 1) as f32).next_down()));
    let row = at.to_int();
    (row, at - L::F::from(row))
}

/// A kernel that is compiled for each level.
pub trait SimdKernel {
    /// The result of [`Self::run`].
    type Output;
    /// Runs the kernel. Must be inlined, with all it calls, into the function that enables the instruction set.
    fn run<L: Lanes>(self) -> Self::Output;
}

/// An instruction set of the processor.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Level {
    /// Plain arrays, which the compiler vectorizes for the target's baseline.
    Portable,
    /// AVX2 and F16C.
    #[cfg(target_arch = "x86_64")]
    Avx2,
}

impl Level {
    /// The best level of this processor.
    pub fn detect() -> Self {
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("f16c") {
            return Self::Avx2;
        }
        Self::Portable
    }

    /// Runs `kernel` at this level.
    #[inline]
    pub fn run<J: SimdKernel>(self, kernel: J) -> J::Output {
        match self {
            Self::Portable => kernel.run::<Portable>(),
            #[cfg(target_arch = "x86_64")]
            // SAFETY: this level exists only where the processor was found to have both.
            #[expect(unsafe_code, reason = "the processor was asked")]
            Self::Avx2 => unsafe { with_avx2(kernel) },
        }
    }

    /// All levels that this processor can run.
    pub fn available() -> Vec<Self> {
        let best = Self::detect();
        if best == Self::Portable { vec![best] } else { vec![Self::Portable, best] }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,f16c")]
fn with_avx2<J: SimdKernel>(kernel: J) -> J::Output {
    kernel.run::<Avx2>()
}
