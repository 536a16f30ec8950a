//! Lanes in AVX2 registers.
//!
//! Soundness: values of these types are only created inside kernels compiled for [`Avx2`], which are entered through
//! [`super::Level::Avx2`] alone, and that level is only offered after the processor was found to have AVX2 and F16C. Loads
//! are unchecked; their callers have clamped the indices.

#![expect(unsafe_code, reason = "processor instructions; see above")]

use super::{Lanes, Pair, ScalarKind, SimdF32, SimdI32, SimdMask, WIDTH, row};
use std::arch::x86_64::*;
use std::ops::{Add, BitAnd, BitOr, Mul, Not, Sub};

/// The instruction set AVX2 with F16C.
#[derive(Debug, Clone, Copy)]
pub struct Avx2;

/// Eight floats.
#[derive(Debug, Clone, Copy)]
pub struct AvxF32(__m256);
/// Eight integers.
#[derive(Debug, Clone, Copy)]
pub struct AvxI32(__m256i);
/// Eight booleans: all bits of a lane set, or none.
#[derive(Debug, Clone, Copy)]
pub struct AvxMask(__m256);

impl Lanes for Avx2 {
    type F = AvxF32;
    type I = AvxI32;
    type M = AvxMask;

    #[inline(always)]
    unsafe fn pairs<V: Pair>(voxels: &[V], index: &[usize; WIDTH]) -> (AvxF32, AvxF32) {
        // SAFETY: the caller keeps every index + 1 inside `voxels`; V is the type that KIND names.
        unsafe {
            match V::KIND {
                ScalarKind::F32 => {
                    let even = four_pairs(voxels, [index[0], index[1], index[4], index[5]]);
                    let odd = four_pairs(voxels, [index[2], index[3], index[6], index[7]]);
                    (AvxF32(_mm256_shuffle_ps::<0x88>(even, odd)), AvxF32(_mm256_shuffle_ps::<0xdd>(even, odd)))
                }
                ScalarKind::U8 => {
                    let mut both = _mm_cvtsi32_si128(two_bytes(voxels, index[0]));
                    both = _mm_insert_epi16::<1>(both, two_bytes(voxels, index[1]));
                    both = _mm_insert_epi16::<2>(both, two_bytes(voxels, index[2]));
                    both = _mm_insert_epi16::<3>(both, two_bytes(voxels, index[3]));
                    both = _mm_insert_epi16::<4>(both, two_bytes(voxels, index[4]));
                    both = _mm_insert_epi16::<5>(both, two_bytes(voxels, index[5]));
                    both = _mm_insert_epi16::<6>(both, two_bytes(voxels, index[6]));
                    both = _mm_insert_epi16::<7>(both, two_bytes(voxels, index[7]));
                    let wide = _mm256_cvtepu16_epi32(both);
                    let first = _mm256_and_si256(wide, _mm256_set1_epi32(0xff));
                    (AvxF32(_mm256_cvtepi32_ps(first)), AvxF32(_mm256_cvtepi32_ps(_mm256_srli_epi32::<8>(wide))))
                }
                ScalarKind::U16 | ScalarKind::F16 => {
                    let low = four(voxels, [index[0], index[1], index[2], index[3]]);
                    let high = four(voxels, [index[4], index[5], index[6], index[7]]);
                    let both = _mm256_set_m128i(high, low);
                    let first = _mm256_and_si256(both, _mm256_set1_epi32(0xffff));
                    let second = _mm256_srli_epi32::<16>(both);
                    if V::KIND == ScalarKind::U16 {
                        return (AvxF32(_mm256_cvtepi32_ps(first)), AvxF32(_mm256_cvtepi32_ps(second)));
                    }
                    let packed = _mm256_permute4x64_epi64::<0b11_01_10_00>(_mm256_packus_epi32(first, second));
                    (
                        AvxF32(_mm256_cvtph_ps(_mm256_castsi256_si128(packed))),
                        AvxF32(_mm256_cvtph_ps(_mm256_extracti128_si256::<1>(packed))),
                    )
                }
            }
        }
    }

    #[inline(always)]
    fn rows4(table: &[[f32; 4]], at: AvxF32) -> [AvxF32; 4] {
        assert!(table.len() >= 2);
        let (row, weight) = row::<Self>(at, table.len());
        let row = row.to_indices();
        // SAFETY: positions are clamped so that each and the next one lie inside the table.
        unsafe {
            let (w, t) = (weight.0, table.as_ptr());
            let r0 = short_rows(t, row[0], row[4], _mm256_shuffle_ps::<0x00>(w, w));
            let r1 = short_rows(t, row[1], row[5], _mm256_shuffle_ps::<0x55>(w, w));
            let r2 = short_rows(t, row[2], row[6], _mm256_shuffle_ps::<0xaa>(w, w));
            let r3 = short_rows(t, row[3], row[7], _mm256_shuffle_ps::<0xff>(w, w));
            transposed(r0, r1, r2, r3).map(AvxF32)
        }
    }

    #[inline(always)]
    fn rows6(table: &[[f32; 8]], at: AvxF32) -> [AvxF32; 6] {
        assert!(table.len() >= 2);
        let (row, weight) = row::<Self>(at, table.len());
        let row = row.to_indices();
        // SAFETY: positions are clamped so that each and the next one lie inside the table.
        unsafe {
            let (w, t) = (weight.to_array(), table.as_ptr());
            let (i0, i4) = (long_row(t, row[0], w[0]), long_row(t, row[4], w[4]));
            let (i1, i5) = (long_row(t, row[1], w[1]), long_row(t, row[5], w[5]));
            let (i2, i6) = (long_row(t, row[2], w[2]), long_row(t, row[6], w[6]));
            let (i3, i7) = (long_row(t, row[3], w[3]), long_row(t, row[7], w[7]));
            let [c0, c1, c2, c3] = transposed(
                _mm256_permute2f128_ps::<0x20>(i0, i4),
                _mm256_permute2f128_ps::<0x20>(i1, i5),
                _mm256_permute2f128_ps::<0x20>(i2, i6),
                _mm256_permute2f128_ps::<0x20>(i3, i7),
            );
            let [c4, c5, _, _] = transposed(
                _mm256_permute2f128_ps::<0x31>(i0, i4),
                _mm256_permute2f128_ps::<0x31>(i1, i5),
                _mm256_permute2f128_ps::<0x31>(i2, i6),
                _mm256_permute2f128_ps::<0x31>(i3, i7),
            );
            [AvxF32(c0), AvxF32(c1), AvxF32(c2), AvxF32(c3), AvxF32(c4), AvxF32(c5)]
        }
    }
}

/// Loads four pairs of floats by broadcasts and blends, which leaves the choice of shuffles to the compiler.
#[inline(always)]
unsafe fn four_pairs<V>(voxels: &[V], index: [usize; 4]) -> __m256 {
    // SAFETY: the caller's indices are inside, and V is f32.
    unsafe {
        let start = voxels.as_ptr();
        let a = _mm256_castpd_ps(_mm256_broadcast_sd(&*start.add(index[0]).cast()));
        let b = _mm256_castpd_ps(_mm256_broadcast_sd(&*start.add(index[1]).cast()));
        let c = _mm256_castpd_ps(_mm256_broadcast_sd(&*start.add(index[2]).cast()));
        let d = _mm256_castpd_ps(_mm256_broadcast_sd(&*start.add(index[3]).cast()));
        let (low, high) = (_mm256_blend_ps::<0b0000_1100>(a, b), _mm256_blend_ps::<0b1100_0000>(c, d));
        _mm256_blend_ps::<0b1111_0000>(low, high)
    }
}

/// Loads a pair of bytes.
#[inline(always)]
unsafe fn two_bytes<V>(voxels: &[V], a: usize) -> i32 {
    // SAFETY: the caller's indices are inside, and V is one byte.
    i32::from(unsafe { voxels.as_ptr().add(a).cast::<u16>().read_unaligned() })
}

/// Loads four pairs of 16-bit scalars.
#[inline(always)]
unsafe fn four<V>(voxels: &[V], index: [usize; 4]) -> __m128i {
    // SAFETY: the caller's indices are inside, and V is two bytes.
    unsafe {
        let start = voxels.as_ptr();
        let mut x = _mm_cvtsi32_si128(start.add(index[0]).cast::<i32>().read_unaligned());
        x = _mm_insert_epi32::<1>(x, start.add(index[1]).cast::<i32>().read_unaligned());
        x = _mm_insert_epi32::<2>(x, start.add(index[2]).cast::<i32>().read_unaligned());
        _mm_insert_epi32::<3>(x, start.add(index[3]).cast::<i32>().read_unaligned())
    }
}

/// Rows `a` and `b`, each interpolated with its next row, in the lower and the upper half of a register.
#[inline(always)]
unsafe fn short_rows(table: *const [f32; 4], a: usize, b: usize, w: __m256) -> __m256 {
    // SAFETY: both rows and the ones after them lie inside the table; a row and the next are one load.
    unsafe {
        let a = _mm256_loadu_ps(table.add(a).cast());
        let b = _mm256_loadu_ps(table.add(b).cast());
        let (this, next) = (_mm256_permute2f128_ps::<0x20>(a, b), _mm256_permute2f128_ps::<0x31>(a, b));
        _mm256_add_ps(this, _mm256_mul_ps(w, _mm256_sub_ps(next, this)))
    }
}

/// Row `a` interpolated with the next one.
#[inline(always)]
unsafe fn long_row(table: *const [f32; 8], a: usize, w: f32) -> __m256 {
    // SAFETY: the row and the one after it lie inside the table.
    unsafe {
        let row = table.add(a).cast::<f32>();
        let (this, next) = (_mm256_loadu_ps(row), _mm256_loadu_ps(row.add(8)));
        _mm256_add_ps(this, _mm256_mul_ps(_mm256_set1_ps(w), _mm256_sub_ps(next, this)))
    }
}

/// Transposes the 4 x 4 matrices in both halves of the registers.
#[inline(always)]
unsafe fn transposed(r0: __m256, r1: __m256, r2: __m256, r3: __m256) -> [__m256; 4] {
    // SAFETY: the processor has AVX.
    unsafe {
        let (t0, t1) = (_mm256_unpacklo_ps(r0, r1), _mm256_unpackhi_ps(r0, r1));
        let (t2, t3) = (_mm256_unpacklo_ps(r2, r3), _mm256_unpackhi_ps(r2, r3));
        [
            _mm256_shuffle_ps::<0x44>(t0, t2),
            _mm256_shuffle_ps::<0xee>(t0, t2),
            _mm256_shuffle_ps::<0x44>(t1, t3),
            _mm256_shuffle_ps::<0xee>(t1, t3),
        ]
    }
}

/// Implements an operator of two operands by an instruction.
macro_rules! instruction {
    ($($lanes:ident $op:ident $method:ident $instruction:ident;)*) => {$(
        impl $op for $lanes {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                // SAFETY: the processor has AVX2.
                Self(unsafe { $instruction(self.0, other.0) })
            }
        }
    )*};
}
instruction! {
    AvxF32 Add add _mm256_add_ps;
    AvxF32 Sub sub _mm256_sub_ps;
    AvxF32 Mul mul _mm256_mul_ps;
    AvxI32 Add add _mm256_add_epi32;
    AvxI32 Sub sub _mm256_sub_epi32;
    AvxI32 Mul mul _mm256_mullo_epi32;
    AvxMask BitAnd bitand _mm256_and_ps;
    AvxMask BitOr bitor _mm256_or_ps;
}

impl Not for AvxMask {
    type Output = Self;
    #[inline(always)]
    fn not(self) -> Self {
        // SAFETY: the processor has AVX2.
        Self(unsafe { _mm256_xor_ps(self.0, _mm256_castsi256_ps(_mm256_set1_epi32(-1))) })
    }
}

impl From<AvxI32> for AvxF32 {
    #[inline(always)]
    fn from(i: AvxI32) -> Self {
        // SAFETY: the processor has AVX2.
        Self(unsafe { _mm256_cvtepi32_ps(i.0) })
    }
}

// SAFETY of all below: the processor has AVX2.
impl SimdF32 for AvxF32 {
    type M = AvxMask;
    type I = AvxI32;
    #[inline(always)]
    fn splat(x: f32) -> Self {
        Self(unsafe { _mm256_set1_ps(x) })
    }
    #[inline(always)]
    fn from_array(x: [f32; WIDTH]) -> Self {
        Self(unsafe { _mm256_loadu_ps(x.as_ptr()) })
    }
    #[inline(always)]
    fn to_array(self) -> [f32; WIDTH] {
        let mut x = [0.0; WIDTH];
        unsafe { _mm256_storeu_ps(x.as_mut_ptr(), self.0) };
        x
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self(unsafe { _mm256_min_ps(self.0, other.0) })
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self(unsafe { _mm256_max_ps(self.0, other.0) })
    }
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        Self(unsafe { _mm256_div_ps(self.0, other.0) })
    }
    #[inline(always)]
    fn lt(self, other: Self) -> AvxMask {
        AvxMask(unsafe { _mm256_cmp_ps::<_CMP_LT_OQ>(self.0, other.0) })
    }
    #[inline(always)]
    fn le(self, other: Self) -> AvxMask {
        AvxMask(unsafe { _mm256_cmp_ps::<_CMP_LE_OQ>(self.0, other.0) })
    }
    #[inline(always)]
    fn select(mask: AvxMask, a: Self, b: Self) -> Self {
        Self(unsafe { _mm256_blendv_ps(b.0, a.0, mask.0) })
    }
    #[inline(always)]
    fn zero_unless(self, mask: AvxMask) -> Self {
        Self(unsafe { _mm256_and_ps(self.0, mask.0) })
    }
    #[inline(always)]
    fn to_int(self) -> AvxI32 {
        AvxI32(unsafe { _mm256_cvttps_epi32(self.0) })
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(unsafe { _mm256_sqrt_ps(self.0) })
    }
    #[inline(always)]
    fn abs(self) -> Self {
        Self(unsafe { _mm256_andnot_ps(_mm256_set1_ps(-0.0), self.0) })
    }
    #[inline(always)]
    fn range_where(low: Self, high: Self, mask: AvxMask) -> [i32; 2] {
        unsafe {
            let none = _mm256_set1_ps(f32::INFINITY);
            let low = _mm256_blendv_ps(none, low.0, mask.0);
            let high = _mm256_blendv_ps(none, _mm256_xor_ps(high.0, _mm256_set1_ps(-0.0)), mask.0);
            // Reduce the minimum of `low` in one half and the minimum of -`high` in the other.
            let x = _mm256_min_ps(_mm256_permute2f128_ps::<0x20>(low, high), _mm256_permute2f128_ps::<0x31>(low, high));
            let x = _mm256_min_ps(x, _mm256_shuffle_ps::<0b01_00_11_10>(x, x));
            let x = _mm256_min_ps(x, _mm256_movehdup_ps(x));
            let high = _mm_cvttss_si32(_mm256_extractf128_ps::<1>(x));
            [_mm_cvttss_si32(_mm256_castps256_ps128(x)), high.wrapping_neg()]
        }
    }
    #[inline(always)]
    fn exp2_int(n: AvxI32) -> Self {
        let bits = (n + AvxI32::splat(127)).shl::<23>();
        Self(unsafe { _mm256_castsi256_ps(bits.0) })
    }
}

impl SimdI32 for AvxI32 {
    type M = AvxMask;
    #[inline(always)]
    fn splat(x: i32) -> Self {
        Self(unsafe { _mm256_set1_epi32(x) })
    }
    #[inline(always)]
    fn from_array(x: [i32; WIDTH]) -> Self {
        Self(unsafe { _mm256_loadu_si256(x.as_ptr().cast()) })
    }
    #[inline(always)]
    fn to_array(self) -> [i32; WIDTH] {
        let mut x = [0; WIDTH];
        unsafe { _mm256_storeu_si256(x.as_mut_ptr().cast(), self.0) };
        x
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self(unsafe { _mm256_min_epi32(self.0, other.0) })
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self(unsafe { _mm256_max_epi32(self.0, other.0) })
    }
    #[inline(always)]
    fn gt(self, other: Self) -> AvxMask {
        AvxMask(unsafe { _mm256_castsi256_ps(_mm256_cmpgt_epi32(self.0, other.0)) })
    }
    #[inline(always)]
    fn eq(self, other: Self) -> AvxMask {
        AvxMask(unsafe { _mm256_castsi256_ps(_mm256_cmpeq_epi32(self.0, other.0)) })
    }
    #[inline(always)]
    fn select(mask: AvxMask, a: Self, b: Self) -> Self {
        Self(unsafe { _mm256_blendv_epi8(b.0, a.0, _mm256_castps_si256(mask.0)) })
    }
    #[inline(always)]
    fn from_bytes(x: u64) -> Self {
        Self(unsafe { _mm256_cvtepu8_epi32(_mm_cvtsi64_si128(x as i64)) })
    }
    #[inline(always)]
    fn to_indices(self) -> [usize; WIDTH] {
        // Through memory: one store and eight loads cost less than taking eight lanes out one by one, which is what the
        // compiler would make of it.
        let x = self.to_array();
        std::array::from_fn(|l| unsafe { std::ptr::read_volatile(&raw const x[l]) } as usize)
    }
    #[inline(always)]
    fn max_lane(self) -> i32 {
        unsafe {
            let x = _mm_max_epi32(_mm256_castsi256_si128(self.0), _mm256_extracti128_si256::<1>(self.0));
            let x = _mm_max_epi32(x, _mm_shuffle_epi32::<0b01_00_11_10>(x));
            _mm_cvtsi128_si32(_mm_max_epi32(x, _mm_shuffle_epi32::<0b10_11_00_01>(x)))
        }
    }
    #[inline(always)]
    fn shr<const N: i32>(self) -> Self {
        Self(unsafe { _mm256_srai_epi32::<N>(self.0) })
    }
    #[inline(always)]
    fn shl<const N: i32>(self) -> Self {
        Self(unsafe { _mm256_slli_epi32::<N>(self.0) })
    }
}

impl SimdMask for AvxMask {
    #[inline(always)]
    fn bits(self) -> u32 {
        (unsafe { _mm256_movemask_ps(self.0) }) as u32
    }
}
