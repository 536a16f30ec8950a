//! Motion between two volumes of the same dimensions: a displacement for each of the control points, which are [`SPACING`] apart,
//! interpolated between them. An encoder finds it by matching; a decoder reads it.
//!
//! J. Sullivan and R. Baker, "Motion compensation for video compression using control grid interpolation", ICASSP 1991.
mod matching;

pub(super) use matching::estimate;

use super::grid::Lattice;
use crate::entropy::logistic::{BitModel, code_bit};
use crate::entropy::range_coder::{Coder, Decoder, Encoder};
use rayon::prelude::*;

/// Points between two control points along an axis.
const SPACING: usize = 16;
/// Displacements are multiples of 1 / this of the distance between points.
const PARTS: f32 = 4.0;

/// Displacements, in 1 / [`PARTS`] points, from a volume to the places in the volume before that look alike.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct MotionField {
    /// The lattice of control points.
    control: Lattice,
    vectors: Vec<[i8; 3]>,
}

impl MotionField {
    /// No motion in a volume of `dims` points.
    pub(super) fn still(dims: [usize; 3]) -> Self {
        let control = Lattice { dims: dims.map(|n| n.saturating_sub(1).div_ceil(SPACING) + 1) };
        Self { vectors: vec![[0; 3]; control.count()], control }
    }

    /// The displacement that a decoder expects at control point `n`.
    fn expected(&self, n: usize) -> [i8; 3] {
        let [nx, ny, _] = self.control.dims;
        expected(&self.vectors, self.control, [n % nx, n / nx % ny, n / nx / ny])
    }

    pub(super) fn encode(&self) -> Vec<u8> {
        let mut coder = Encoder::default();
        code(&mut coder, self.control, &mut self.vectors.clone());
        coder.finish()
    }

    /// The motion in a volume of `dims` points. Other bytes than an encoder's give another motion.
    pub(super) fn decode(bytes: &[u8], dims: [usize; 3]) -> Self {
        let mut motion = Self::still(dims);
        code(&mut Decoder::new(bytes), motion.control, &mut motion.vectors);
        motion
    }

    /// The displacement at each control point along x on row (`y`, `z`) of the volume, in points.
    fn row(&self, [y, z]: [usize; 2], to: &mut Vec<[f32; 3]>) {
        let [nx, ny, nz] = self.control.dims;
        let along = |i: usize, n: usize| {
            let near = (i / SPACING).min(n - 1);
            (near, (near + 1).min(n - 1), (i % SPACING) as f32 / SPACING as f32)
        };
        let ((y0, y1, wy), (z0, z1, wz)) = (along(y, ny), along(z, nz));
        to.clear();
        to.extend((0..nx).map(|x| {
            let at = |y, z| self.vectors[self.control.row(y, z) + x].map(|v| f32::from(v) / PARTS);
            let near = lerp(at(y0, z0), at(y1, z0), wy);
            let far = lerp(at(y0, z1), at(y1, z1), wy);
            lerp(near, far, wz)
        }));
    }

    /// The volume `before`, of `dims` points, moved: for each point, `before` at its displaced place.
    pub(super) fn moved(&self, before: &[f32], dims: [usize; 3]) -> Vec<f32> {
        let before = Sampler { values: before, points: Lattice { dims } };
        let mut values = vec![0.0; before.points.count()];
        let plane = (dims[0] * dims[1]).max(1);
        values.par_chunks_mut(plane).enumerate().for_each(|(z, plane)| {
            let mut control = Vec::new();
            for (y, row) in plane.chunks_mut(dims[0]).enumerate() {
                self.row([y, z], &mut control);
                for (x, value) in row.iter_mut().enumerate() {
                    let near = x / SPACING;
                    let far = (near + 1).min(control.len() - 1);
                    let by = lerp(control[near], control[far], (x % SPACING) as f32 / SPACING as f32);
                    *value = before.at([x as f32 + by[0], y as f32 + by[1], z as f32 + by[2]]);
                }
            }
        });
        values
    }
}

fn lerp(a: [f32; 3], b: [f32; 3], w: f32) -> [f32; 3] {
    std::array::from_fn(|axis| a[axis] + w * (b[axis] - a[axis]))
}

/// The displacement before that at `x`, `y`, `z` along x, else y, else z.
fn expected(vectors: &[[i8; 3]], control: Lattice, [x, y, z]: [usize; 3]) -> [i8; 3] {
    match (x, y, z) {
        (0, 0, 0) => [0; 3],
        (0, 0, _) => vectors[control.row(0, z - 1)],
        (0, ..) => vectors[control.row(y - 1, z)],
        _ => vectors[control.row(y, z) + x - 1],
    }
}

/// Codes or reads displacements, each as its difference from the expected one.
fn code(coder: &mut impl Coder, control: Lattice, vectors: &mut [[i8; 3]]) {
    let mut models = VectorModels::default();
    for (y, z) in control.rows() {
        for x in 0..control.dims[0] {
            let at = control.row(y, z) + x;
            let expected = expected(vectors, control, [x, y, z]);
            let mut changed = 0;
            for axis in 0..3 {
                let change = models.change(coder, axis, changed, vectors[at][axis].wrapping_sub(expected[axis]));
                vectors[at][axis] = expected[axis].wrapping_add(change);
                changed += usize::from(change != 0);
            }
        }
    }
}

/// Models of a change of a displacement along an axis.
#[derive(Debug, Default)]
struct VectorModels {
    /// Is there one; by axis, and how many axes before have one.
    any: [[BitModel; 3]; 3],
    negative: [BitModel; 3],
    /// Number of binary digits of its magnitude beyond the first.
    lengths: [[BitModel; 8]; 3],
}

impl VectorModels {
    fn change(&mut self, coder: &mut impl Coder, axis: usize, changed: usize, change: i8) -> i8 {
        if !code_bit(coder, &mut self.any[axis][changed], change != 0) {
            return 0;
        }
        let negative = code_bit(coder, &mut self.negative[axis], change < 0);
        let magnitude = u32::from(change.unsigned_abs()).max(1);
        let wanted = magnitude.ilog2();
        let mut length = 0;
        while length < 7 && code_bit(coder, &mut self.lengths[axis][length as usize], wanted > length) {
            length += 1;
        }
        let magnitude = 1 << length | coder.code_uniform(length, magnitude);
        if negative { (magnitude as u8).wrapping_neg() as i8 } else { magnitude as u8 as i8 }
    }
}

/// A volume between its points, by trilinear interpolation; beyond its sides, what is there.
pub(super) struct Sampler<'a> {
    pub values: &'a [f32],
    pub points: Lattice,
}

impl Sampler<'_> {
    /// The value at `place`, in points.
    #[inline(always)]
    pub(super) fn at(&self, place: [f32; 3]) -> f32 {
        let dims = self.points.dims;
        let (mut base, mut weight, mut next) = ([0; 3], [0.0; 3], [0; 3]);
        for axis in 0..3 {
            let last = dims[axis] - 1;
            let x = place[axis].clamp(0.0, last as f32);
            base[axis] = (x as usize).min(last.saturating_sub(1));
            weight[axis] = x - base[axis] as f32;
            next[axis] = usize::from(last > 0);
        }
        let [nx, ny, _] = dims;
        let (row, plane) = (next[1] * nx, next[2] * nx * ny);
        let at = self.points.row(base[1], base[2]) + base[0];
        let along = |at: usize| {
            let (a, b) = (self.values[at], self.values[at + next[0]]);
            a + weight[0] * (b - a)
        };
        let between = |at: usize| {
            let (a, b) = (along(at), along(at + row));
            a + weight[1] * (b - a)
        };
        let (a, b) = (between(at), between(at + plane));
        a + weight[2] * (b - a)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn motion_comes_back_and_any_bytes_are_one() {
        let mut random = fastrand::Rng::with_seed(9);
        for dims in [[1, 1, 1], [16, 17, 33], [100, 2, 40]] {
            let mut motion = MotionField::still(dims);
            assert_eq!(MotionField::decode(&motion.encode(), dims), motion);
            for vector in &mut motion.vectors {
                *vector = std::array::from_fn(|_| random.i8(..) >> random.u8(0..8));
            }
            assert_eq!(MotionField::decode(&motion.encode(), dims), motion, "{dims:?}");
            let bytes: Vec<u8> = (0..random.usize(..40)).map(|_| random.u8(..)).collect();
            let any = MotionField::decode(&bytes, dims);
            let values = vec![1.0; dims.iter().product()];
            assert_eq!(any.moved(&values, dims), values, "a constant stays so wherever it comes from");
        }
    }

    #[test]
    fn a_linear_field_is_moved_by_what_the_vectors_say() {
        let dims = [40, 30, 20];
        let mut motion = MotionField::still(dims);
        motion.vectors.fill([6, -3, 1]);
        let field = |x: f32, y: f32, z: f32| x + 10.0 * y + 100.0 * z;
        let values: Vec<f32> =
            (0..24_000).map(|n| field((n % 40) as f32, (n / 40 % 30) as f32, (n / 1200) as f32)).collect();
        let moved = motion.moved(&values, dims);
        let at = |x: usize, y: usize, z: usize| moved[(z * 30 + y) * 40 + x];
        assert_eq!(at(5, 7, 9), field(6.5, 6.25, 9.25));
        // What would come from outside is what is at the side.
        assert_eq!(at(39, 0, 9), field(39.0, 0.0, 9.25));
    }
}
