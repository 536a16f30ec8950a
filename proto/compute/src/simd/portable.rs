//! Lanes as plain arrays: the level of every processor, and the meaning of all others.

use super::{Floats, Ints, Lanes, Masks, Pair, WIDTH, row};
use std::array::from_fn;
use std::ops::{Add, BitAnd, BitOr, Mul, Not, Sub};

/// Plain arrays.
#[derive(Debug, Clone, Copy)]
pub struct Portable;

/// Eight floats.
#[derive(Debug, Clone, Copy)]
pub struct F([f32; WIDTH]);
/// Eight whole numbers.
#[derive(Debug, Clone, Copy)]
pub struct I([i32; WIDTH]);
/// Eight truth values.
#[derive(Debug, Clone, Copy)]
pub struct M([bool; WIDTH]);

impl Lanes for Portable {
    type F = F;
    type I = I;
    type M = M;

    #[inline(always)]
    #[expect(unsafe_code, reason = "the trait's; nothing here is unchecked")]
    unsafe fn pairs<V: Pair>(voxels: &[V], index: &[usize; WIDTH]) -> (F, F) {
        (F(from_fn(|l| voxels[index[l]].into())), F(from_fn(|l| voxels[index[l] + 1].into())))
    }

    #[inline(always)]
    fn rows4(table: &[[f32; 4]], at: F) -> [F; 4] {
        let (rows, weight) = row::<Self>(at, table.len());
        let rows = rows.to_indices();
        from_fn(|c| F(from_fn(|l| lerp(table[rows[l]][c], table[rows[l] + 1][c], weight.0[l]))))
    }

    #[inline(always)]
    fn rows6(table: &[[f32; 8]], at: F) -> [F; 6] {
        let (rows, weight) = row::<Self>(at, table.len());
        let rows = rows.to_indices();
        from_fn(|c| F(from_fn(|l| lerp(table[rows[l]][c], table[rows[l] + 1][c], weight.0[l]))))
    }
}

#[inline(always)]
fn lerp(a: f32, b: f32, w: f32) -> f32 {
    a + w * (b - a)
}

macro_rules! lanewise {
    ($lanes:ident: $($op:ident $method:ident $body:expr),*) => {$(
        impl $op for $lanes {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self(from_fn(|l| $body(self.0[l], other.0[l])))
            }
        }
    )*};
}
lanewise!(F: Add add |a, b| a + b, Sub sub |a, b| a - b, Mul mul |a, b| a * b);
lanewise!(I: Add add i32::wrapping_add, Sub sub i32::wrapping_sub, Mul mul i32::wrapping_mul);
lanewise!(M: BitAnd bitand |a, b| a & b, BitOr bitor |a, b| a | b);

impl Not for M {
    type Output = Self;
    #[inline(always)]
    fn not(self) -> Self {
        Self(self.0.map(|a| !a))
    }
}

impl From<I> for F {
    #[inline(always)]
    fn from(i: I) -> Self {
        Self(i.0.map(|x| x as f32))
    }
}

impl Floats for F {
    type M = M;
    type I = I;
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
        Self(from_fn(|l| if self.0[l] < other.0[l] { self.0[l] } else { other.0[l] }))
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self(from_fn(|l| if self.0[l] > other.0[l] { self.0[l] } else { other.0[l] }))
    }
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        Self(from_fn(|l| self.0[l] / other.0[l]))
    }
    #[inline(always)]
    fn lt(self, other: Self) -> M {
        M(from_fn(|l| self.0[l] < other.0[l]))
    }
    #[inline(always)]
    fn le(self, other: Self) -> M {
        M(from_fn(|l| self.0[l] <= other.0[l]))
    }
    #[inline(always)]
    fn select(mask: M, a: Self, b: Self) -> Self {
        Self(from_fn(|l| if mask.0[l] { a.0[l] } else { b.0[l] }))
    }
    #[inline(always)]
    fn only(self, mask: M) -> Self {
        Self(from_fn(|l| if mask.0[l] { self.0[l] } else { 0.0 }))
    }
    #[inline(always)]
    fn to_int(self) -> I {
        // As the instruction does: what does not fit becomes the least number.
        let int = |x: f32| if x.abs() < 2_147_483_648.0 { x as i32 } else { i32::MIN };
        I(self.0.map(int))
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(self.0.map(f32::sqrt))
    }
    #[inline(always)]
    fn abs(self) -> Self {
        Self(self.0.map(f32::abs))
    }
    #[inline(always)]
    fn ends(low: Self, high: Self, mask: M) -> [i32; 2] {
        let mut ends = [f32::INFINITY, f32::NEG_INFINITY];
        for l in 0..WIDTH {
            if mask.0[l] {
                ends = [ends[0].min(low.0[l]), ends[1].max(high.0[l])];
            }
        }
        ends.map(|x| x as i32)
    }
    #[inline(always)]
    fn exp2_int(n: I) -> Self {
        Self(n.0.map(|n| f32::from_bits((n.wrapping_add(127) as u32) << 23)))
    }
}

impl Ints for I {
    type M = M;
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
        Self(from_fn(|l| self.0[l].min(other.0[l])))
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self(from_fn(|l| self.0[l].max(other.0[l])))
    }
    #[inline(always)]
    fn gt(self, other: Self) -> M {
        M(from_fn(|l| self.0[l] > other.0[l]))
    }
    #[inline(always)]
    fn eq(self, other: Self) -> M {
        M(from_fn(|l| self.0[l] == other.0[l]))
    }
    #[inline(always)]
    fn select(mask: M, a: Self, b: Self) -> Self {
        Self(from_fn(|l| if mask.0[l] { a.0[l] } else { b.0[l] }))
    }
    #[inline(always)]
    fn from_bytes(x: u64) -> Self {
        Self(x.to_le_bytes().map(i32::from))
    }
    #[inline(always)]
    fn to_indices(self) -> [usize; WIDTH] {
        self.0.map(|x| x as usize)
    }
    #[inline(always)]
    fn greatest(self) -> i32 {
        self.0.into_iter().fold(i32::MIN, i32::max)
    }
    #[inline(always)]
    fn shr<const N: i32>(self) -> Self {
        Self(self.0.map(|x| x >> N))
    }
    #[inline(always)]
    fn shl<const N: i32>(self) -> Self {
        Self(self.0.map(|x| x << N))
    }
}

impl Masks for M {
    #[inline(always)]
    fn bits(self) -> u32 {
        (0..WIDTH).map(|l| u32::from(self.0[l]) << l).sum()
    }
}
