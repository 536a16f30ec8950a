//! Eight numbers at a time: the arithmetic that the fast CPU kernels of both nodes are written in.
//!
//! A kernel is generic over [`Lanes`] and instantiated once per level; [`Level::detect`] picks one at run time. No level
//! fuses multiplication and addition, and `min` and `max` pick the second operand when they cannot compare, so all levels
//! agree to the bit. Whatever a kernel calls must be inlined into the function that enables the level's instructions:
//! `#[inline(always)]` throughout, and no closures, which are not.

#[cfg(target_arch = "x86_64")]
mod avx2;
mod exp;
mod portable;

#[cfg(target_arch = "x86_64")]
pub use avx2::Avx2;
pub use exp::{SMALL, opacity, small_opacity};
pub use portable::Portable;

use half::f16;
use std::ops::{Add, BitAnd, BitOr, Mul, Not, Sub};

/// Number of lanes.
pub const WIDTH: usize = 8;

/// A set of lane types.
pub trait Lanes: Copy + Send + Sync + 'static {
    /// Single-precision numbers.
    type F: Floats<M = Self::M, I = Self::I> + From<Self::I>;
    /// 32-bit whole numbers.
    type I: Ints<M = Self::M>;
    /// Truth values.
    type M: Masks;

    /// The pair at `voxels[i]` and `voxels[i + 1]` of every lane.
    ///
    /// # Safety
    /// Every `index + 1` must lie inside `voxels`.
    #[expect(unsafe_code, reason = "an unchecked load; the caller has clamped all indices at once")]
    unsafe fn pairs<V: Pair>(voxels: &[V], index: &[usize; WIDTH]) -> (Self::F, Self::F);

    /// The rows of a table around position `at` (0 is the first row, 1 the second), interpolated. The position is clamped
    /// into the table, which needs two rows or more; NaN is its beginning.
    fn rows4(table: &[[f32; 4]], at: Self::F) -> [Self::F; 4];
    /// The same for rows of eight, of which six are used.
    fn rows6(table: &[[f32; 8]], at: Self::F) -> [Self::F; 6];
}

/// A scalar whose neighbours are loaded in pairs.
pub trait Pair: Copy + Send + Sync + Into<f32> + 'static {
    /// Which one it is.
    const KIND: Kind;
}
/// The stored scalars, as a constant that kernels are specialised for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[expect(missing_docs, reason = "named like the types")]
pub enum Kind {
    U8,
    U16,
    F16,
    F32,
}
impl Pair for u8 {
    const KIND: Kind = Kind::U8;
}
impl Pair for u16 {
    const KIND: Kind = Kind::U16;
}
impl Pair for f16 {
    const KIND: Kind = Kind::F16;
}
impl Pair for f32 {
    const KIND: Kind = Kind::F32;
}

/// Eight single-precision numbers.
pub trait Floats: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> {
    /// Their truth values.
    type M: Masks;
    /// Their whole numbers.
    type I: Ints<M = Self::M>;
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
    /// Itself where `mask` holds, else 0.
    fn only(self, mask: Self::M) -> Self;
    /// Towards zero; numbers must fit 32 bits.
    fn to_int(self) -> Self::I;
    /// The square root.
    fn sqrt(self) -> Self;
    /// The magnitude.
    fn abs(self) -> Self;
    /// The least of `low` and the greatest of `high` among the lanes of `mask`, towards zero; they must fit 32 bits, and
    /// `mask` must hold somewhere.
    fn ends(low: Self, high: Self, mask: Self::M) -> [i32; 2];
    /// 2^n for whole n in -126..=127.
    fn exp2_int(n: Self::I) -> Self;
}

/// Eight 32-bit whole numbers.
pub trait Ints: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> {
    /// Their truth values.
    type M: Masks;
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
    /// Small numbers, one byte per lane, the first lane lowest.
    fn from_bytes(x: u64) -> Self;
    /// As indices; no lane may be negative.
    fn to_indices(self) -> [usize; WIDTH];
    /// The greatest of all lanes.
    fn greatest(self) -> i32;
    /// Shifted right by `N` bits, the sign filling in.
    fn shr<const N: i32>(self) -> Self;
    /// Shifted left by `N` bits.
    fn shl<const N: i32>(self) -> Self;
}

/// Eight truth values.
pub trait Masks: Copy + BitAnd<Output = Self> + BitOr<Output = Self> + Not<Output = Self> {
    /// Bit n is lane n.
    fn bits(self) -> u32;
    /// True if any lane is.
    #[inline(always)]
    fn any(self) -> bool {
        self.bits() != 0
    }
}

/// The row before a position of a table of `len` rows and the way from it to the next row. The row is at most `len` - 2.
#[inline(always)]
fn row<L: Lanes>(at: L::F, len: usize) -> (L::I, L::F) {
    let at = at.max(L::F::splat(0.0)).min(L::F::splat(((len - 1) as f32).next_down()));
    let row = at.to_int();
    (row, at - L::F::from(row))
}

/// Work that is specialised for each level.
pub trait Job {
    /// What comes out.
    type Output;
    /// Does it. To be inlined, with all it calls, into the function that enables the level's instructions.
    fn run<L: Lanes>(self) -> Self::Output;
}

/// What the processor offers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Level {
    /// Plain arrays, which the compiler vectorises as the target allows.
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

    /// Runs `job` at this level.
    #[inline]
    pub fn run<J: Job>(self, job: J) -> J::Output {
        match self {
            Self::Portable => job.run::<Portable>(),
            #[cfg(target_arch = "x86_64")]
            // SAFETY: this level exists only where the processor was found to have both.
            #[expect(unsafe_code, reason = "the processor was asked")]
            Self::Avx2 => unsafe { with_avx2(job) },
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
fn with_avx2<J: Job>(job: J) -> J::Output {
    job.run::<Avx2>()
}
