//! Lanes in plain arrays: runs on every processor, and defines the results that all other levels must give.

use super::{Lanes, Pair, SimdF32, SimdI32, SimdMask, WIDTH, row};
use std::array::from_fn;
use std::ops::{Add, BitAnd, BitOr, Mul, Not, Sub};

/// An array of the value for each lane, written out. `std::array::from_fn` takes the compiler nearly twice as long over a
/// kernel.
macro_rules! each {
    (|$l:ident| $value:expr) => {
        each!(@ $l $value; 0 1 2 3 4 5 6 7)
    };
    (@ $l:ident $value:expr; $($number:literal)*) => {
        [$({
            let $l: usize = $number;
            $value
        }),*]
    };
}

/// The portable level.
#[derive(Debug, Clone, Copy)]
pub struct Portable;

/// Eight floats.
#[derive(Debug, Clone, Copy)]
pub struct ArrayF32([f32; WIDTH]);
/// Eight integers.
#[derive(Debug, Clone, Copy)]
pub struct ArrayI32([i32; WIDTH]);
/// Eight booleans.
#[derive(Debug, Clone, Copy)]
pub struct ArrayMask([bool; WIDTH]);

impl Lanes for Portable {
    type F = ArrayF32;
    type I = ArrayI32;
    type M = ArrayMask;

    #[inline(always)]
    #[expect(unsafe_code, reason = "the trait's; nothing here is unchecked")]
    unsafe fn pairs<V: Pair>(voxels: &[V], index: &[usize; WIDTH]) -> (ArrayF32, ArrayF32) {
        (ArrayF32(from_fn(|l| voxels[index[l]].into())), ArrayF32(from_fn(|l| voxels[index[l] + 1].into())))
    }

    #[inline(always)]
    fn rows4(table: &[[f32; 4]], at: ArrayF32) -> [ArrayF32; 4] {
        let (rows, weight) = row::<Self>(at, table.len());
        let rows = rows.to_indices();
        let column = |c| ArrayF32(from_fn(|l| lerp(table[rows[l]][c], table[rows[l] + 1][c], weight.0[l])));
        [column(0), column(1), column(2), column(3)]
    }

    #[inline(always)]
    fn rows6(table: &[[f32; 8]], at: ArrayF32) -> [ArrayF32; 6] {
        let (rows, weight) = row::<Self>(at, table.len());
        let rows = rows.to_indices();
        let column = |c| ArrayF32(from_fn(|l| lerp(table[rows[l]][c], table[rows[l] + 1][c], weight.0[l])));
        [column(0), column(1), column(2), column(3), column(4), column(5)]
    }
}

#[inline(always)]
fn lerp(a: f32, b: f32, w: f32) -> f32 {
    a + w * (b - a)
}

macro_rules! lanewise {
    ($lanes:ident: $($op:ident $method:ident |$a:ident, $b:ident| $value:expr),*) => {$(
        impl $op for $lanes {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self(each!(|l| {
                    let ($a, $b) = (self.0[l], other.0[l]);
                    $value
                }))
            }
        }
    )*};
}
lanewise!(ArrayF32: Add add |a, b| a + b, Sub sub |a, b| a - b, Mul mul |a, b| a * b);
lanewise!(ArrayI32: Add add |a, b| a.wrapping_add(b), Sub sub |a, b| a.wrapping_sub(b),
    Mul mul |a, b| a.wrapping_mul(b));
lanewise!(ArrayMask: BitAnd bitand |a, b| a & b, BitOr bitor |a, b| a | b);

impl Not for ArrayMask {
    type Output = Self;
    #[inline(always)]
    fn not(self) -> Self {
        Self(each!(|l| !self.0[l]))
    }
}

impl From<ArrayI32> for ArrayF32 {
    #[inline(always)]
    fn from(i: ArrayI32) -> Self {
        Self(each!(|l| i.0[l] as f32))
    }
}

impl SimdF32 for ArrayF32 {
    type M = ArrayMask;
    type I = ArrayI32;
    #[inline(always)]
    fn splat(x: f32) -> Self {
        Self([x; WIDTH])
    }
    #[inline(always)]
    fn from_array(x: [f32; WIDTH]) -> Self {
        Self(x)
    }
    #[inline(always)]
    fn to_array(self) -> [f32; WIDTH] {
        self.0
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self(each!(|l| if self.0[l] < other.0[l] { self.0[l] } else { other.0[l] }))
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self(each!(|l| if self.0[l] > other.0[l] { self.0[l] } else { other.0[l] }))
    }
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        Self(each!(|l| self.0[l] / other.0[l]))
    }
    #[inline(always)]
    fn lt(self, other: Self) -> ArrayMask {
        ArrayMask(each!(|l| self.0[l] < other.0[l]))
    }
    #[inline(always)]
    fn le(self, other: Self) -> ArrayMask {
        ArrayMask(each!(|l| self.0[l] <= other.0[l]))
    }
    #[inline(always)]
    fn select(mask: ArrayMask, a: Self, b: Self) -> Self {
        Self(each!(|l| if mask.0[l] { a.0[l] } else { b.0[l] }))
    }
    #[inline(always)]
    fn zero_unless(self, mask: ArrayMask) -> Self {
        Self(each!(|l| if mask.0[l] { self.0[l] } else { 0.0 }))
    }
    #[inline(always)]
    fn to_int(self) -> ArrayI32 {
        // As `cvttps2dq` does: a number that does not fit becomes `i32::MIN`.
        let int = |x: f32| if x.abs() < 2_147_483_648.0 { x as i32 } else { i32::MIN };
        ArrayI32(each!(|l| int(self.0[l])))
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(each!(|l| self.0[l].sqrt()))
    }
    #[inline(always)]
    fn abs(self) -> Self {
        Self(each!(|l| self.0[l].abs()))
    }
    #[inline(always)]
    fn range_where(low: Self, high: Self, mask: ArrayMask) -> [i32; 2] {
        let mut ends = [f32::INFINITY, f32::NEG_INFINITY];
        for l in 0..WIDTH {
            if mask.0[l] {
                ends = [ends[0].min(low.0[l]), ends[1].max(high.0[l])];
            }
        }
        ends.map(|x| x as i32)
    }
    #[inline(always)]
    fn exp2_int(n: ArrayI32) -> Self {
        Self(each!(|l| f32::from_bits((n.0[l].wrapping_add(127) as u32) << 23)))
    }
}

impl SimdI32 for ArrayI32 {
    type M = ArrayMask;
    #[inline(always)]
    fn splat(x: i32) -> Self {
        Self([x; WIDTH])
    }
    #[inline(always)]
    fn from_array(x: [i32; WIDTH]) -> Self {
        Self(x)
    }
    #[inline(always)]
    fn to_array(self) -> [i32; WIDTH] {
        self.0
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self(each!(|l| self.0[l].min(other.0[l])))
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self(each!(|l| self.0[l].max(other.0[l])))
    }
    #[inline(always)]
    fn gt(self, other: Self) -> ArrayMask {
        ArrayMask(each!(|l| self.0[l] > other.0[l]))
    }
    #[inline(always)]
    fn eq(self, other: Self) -> ArrayMask {
        ArrayMask(each!(|l| self.0[l] == other.0[l]))
    }
    #[inline(always)]
    fn select(mask: ArrayMask, a: Self, b: Self) -> Self {
        Self(each!(|l| if mask.0[l] { a.0[l] } else { b.0[l] }))
    }
    #[inline(always)]
    fn from_bytes(x: u64) -> Self {
        Self(each!(|l| (x >> (8 * l)) as u8 as i32))
    }
    #[inline(always)]
    fn to_indices(self) -> [usize; WIDTH] {
        each!(|l| self.0[l] as usize)
    }
    #[inline(always)]
    fn max_lane(self) -> i32 {
        self.0.into_iter().fold(i32::MIN, i32::max)
    }
    #[inline(always)]
    fn shr<const N: i32>(self) -> Self {
        Self(each!(|l| self.0[l] >> N))
    }
    #[inline(always)]
    fn shl<const N: i32>(self) -> Self {
        Self(each!(|l| self.0[l] << N))
    }
}

impl SimdMask for ArrayMask {
    #[inline(always)]
    fn bits(self) -> u32 {
        each!(|l| (self.0[l] as u32) << l).into_iter().fold(0, |a, b| a | b)
    }
}
