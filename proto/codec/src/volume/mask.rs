//! The mask: which sample points are missing. Blocks of points that are all missing or all there take one or two bits; in the others
//! each point is coded in the context of ten points before it.
use super::grid::Lattice;
use crate::entropy::logistic::{BitModel, code_bit};
use crate::entropy::range_coder::{Coder, Decoder, Encoder};

/// Points per side of a block.
const SIDE: usize = 8;

/// What a block's points are.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Block {
    Present,
    Missing,
    Mixed,
}

/// Encodes the mask of a volume of `dims` points, x fastest.
///
/// # Panics
/// If `dims` do not multiply to the number of points.
pub(super) fn encode(missing: &[bool], dims: [usize; 3]) -> Vec<u8> {
    let points = Lattice { dims };
    assert_eq!(points.count(), missing.len(), "a mask has as many bits as points");
    let mut coder = Encoder::default();
    let mut blocks = blocks_of(missing, points);
    code(&mut coder, &mut missing.to_vec(), points, &mut blocks);
    coder.finish()
}

/// Decodes the mask of a volume of `dims` points. Other bytes than an encoder's give another mask.
pub(super) fn decode(bytes: &[u8], dims: [usize; 3]) -> Vec<bool> {
    let points = Lattice { dims };
    let mut missing = vec![false; points.count()];
    let mut blocks = vec![Block::Present; blocks(points).count()];
    code(&mut Decoder::new(bytes), &mut missing, points, &mut blocks);
    missing
}

/// The lattice of blocks.
fn blocks(points: Lattice) -> Lattice {
    Lattice { dims: points.dims.map(|n| n.div_ceil(SIDE)) }
}

fn blocks_of(missing: &[bool], points: Lattice) -> Vec<Block> {
    let grid = blocks(points);
    let mut found: Vec<Option<Block>> = vec![None; grid.count()];
    for (y, z) in points.rows() {
        let from = points.row(y, z);
        let row = &mut found[grid.row(y / SIDE, z / SIDE)..][..grid.dims[0]];
        for (block, bits) in row.iter_mut().zip(missing[from..from + points.dims[0]].chunks(SIDE)) {
            for &bit in bits {
                let one = if bit { Block::Missing } else { Block::Present };
                *block = Some(block.map_or(one, |b| if b == one { b } else { Block::Mixed }));
            }
        }
    }
    found.into_iter().map(|b| b.unwrap_or(Block::Present)).collect()
}

/// Codes or reads blocks, then the points of the mixed ones.
fn code(coder: &mut impl Coder, missing: &mut [bool], points: Lattice, blocks_in: &mut [Block]) {
    let grid = blocks(points);
    let mut models = [[BitModel::default(); 2]; 27];
    for (y, z) in grid.rows() {
        for x in 0..grid.dims[0] {
            let at = x + grid.row(y, z);
            let state = |inside: bool, back: usize| if inside { blocks_in[at - back] as usize } else { 0 };
            let (row, plane) = (grid.dims[0], grid.dims[0] * grid.dims[1]);
            let context = state(x > 0, 1) + 3 * state(y > 0, row) + 9 * state(z > 0, plane);
            let [mixed, whole] = &mut models[context];
            let block = blocks_in[at];
            blocks_in[at] = if code_bit(coder, mixed, block == Block::Mixed) {
                Block::Mixed
            } else if code_bit(coder, whole, block == Block::Missing) {
                Block::Missing
            } else {
                Block::Present
            };
        }
    }
    let mut models = [BitModel::default(); 1024];
    for (y, z) in points.rows() {
        let from = points.row(y, z);
        for bx in 0..grid.dims[0] {
            let block = blocks_in[bx + grid.row(y / SIDE, z / SIDE)];
            for x in bx * SIDE..points.dims[0].min((bx + 1) * SIDE) {
                missing[from + x] = match block {
                    Block::Present => false,
                    Block::Missing => true,
                    Block::Mixed => {
                        let context = context(missing, points, [x, y, z]);
                        code_bit(coder, &mut models[context], missing[from + x])
                    }
                };
            }
        }
    }
}

/// Ten points before a point, one bit each; outside none is missing.
fn context(missing: &[bool], points: Lattice, [x, y, z]: [usize; 3]) -> usize {
    let [nx, ny, _] = points.dims;
    let (row, at) = (nx, x + points.row(y, z));
    let plane = nx * ny;
    let bit = |inside: bool, back: usize| usize::from(inside && missing[at - back]);
    [
        bit(x > 0, 1),
        bit(x > 1, 2),
        bit(y > 0, row),
        bit(y > 0 && x > 0, row + 1),
        bit(y > 0 && x + 1 < nx, row - 1),
        bit(z > 0, plane),
        bit(z > 0 && x > 0, plane + 1),
        bit(z > 0 && x + 1 < nx, plane - 1),
        bit(z > 0 && y > 0, plane + row),
        bit(z > 0 && y + 1 < ny, plane - row),
    ]
    .into_iter()
    .fold(0, |context, bit| 2 * context + bit)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn masks() -> Vec<([usize; 3], Vec<bool>)> {
        let mut random = fastrand::Rng::with_seed(5);
        let mut masks = Vec::new();
        for dims in [[1, 1, 1], [8, 8, 8], [9, 1, 17], [1, 30, 2], [40, 33, 21]] {
            let [nx, ny, _] = dims;
            let count: usize = dims.iter().product();
            let ball = |n: usize| {
                let p = [n % nx, n / nx % ny, n / nx / ny].map(|c| c as f64);
                p.iter().zip(&dims).map(|(c, &n)| (c - n as f64 / 2.0).powi(2)).sum::<f64>() < 90.0
            };
            masks.push((dims, vec![true; count]));
            masks.push((dims, vec![false; count]));
            masks.push((dims, (0..count).map(|_| random.bool()).collect()));
            masks.push((dims, (0..count).map(ball).collect()));
        }
        masks
    }

    #[test]
    fn masks_come_back() {
        for (dims, mask) in masks() {
            let bytes = encode(&mask, dims);
            assert_eq!(decode(&bytes, dims), mask, "{dims:?}");
            assert!(bytes.len() <= mask.len() / 7 + 24, "{dims:?}: {} bytes for {} bits", bytes.len(), mask.len());
        }
    }

    #[test]
    fn a_smooth_coast_costs_a_fraction_of_a_bit_a_point() {
        let dims = [64; 3];
        let coast = |n: usize| {
            (n / 4096) as f64 > 30.0 + 12.0 * ((n % 64) as f64 * 0.1).sin() * ((n / 64 % 64) as f64 * 0.08).cos()
        };
        let mask: Vec<bool> = (0..64 * 64 * 64).map(coast).collect();
        // 4,096 columns change once each: some two bits a column.
        let bytes = encode(&mask, dims);
        assert!(bytes.len() < 1100, "{} bytes", bytes.len());
    }

    #[test]
    fn any_bytes_are_a_mask() {
        let mut random = fastrand::Rng::with_seed(6);
        for _ in 0..200 {
            let bytes: Vec<u8> = (0..random.usize(..60)).map(|_| random.u8(..)).collect();
            assert_eq!(decode(&bytes, [13, 9, 11]).len(), 13 * 9 * 11);
        }
    }
}
