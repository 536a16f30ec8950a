//! The points that a field of one box needs: the box and its ghost points, copied from the boxes that have them.

use crate::ingest::GridBox;
use lamina_model::Voxels;

/// Boxes with their bytes.
pub(super) type Bricks<'a> = [(GridBox, &'a [u8])];

/// Offset of the row of `region` at (y, z) in a box of points of `size` bytes.
fn offset(of: &GridBox, region: &GridBox, (y, z): (usize, usize), size: usize) -> usize {
    let ([x0, y0, z0], [nx, ny, _]) = (of.start(), of.dims());
    (((z - z0) * ny + (y - y0)) * nx + region.start()[0] - x0) * size
}

fn rows(region: &GridBox) -> impl Iterator<Item = (usize, usize)> + use<> {
    let ([_, y0, z0], [_, ny, nz]) = (region.start(), region.dims());
    (z0..z0 + nz).flat_map(move |z| (y0..y0 + ny).map(move |y| (y, z)))
}

/// Where the rows of `region`, which lies in `of`, begin among the points of that.
pub(super) fn row_starts(of: &GridBox, region: &GridBox) -> impl Iterator<Item = usize> {
    rows(region).map(move |row| offset(of, region, row, 1))
}

/// A member's own points of a box, among the voxels of a window around it.
pub(super) struct OwnPoints<'a> {
    pub own: GridBox,
    pub window: GridBox,
    pub voxels: &'a Voxels,
}

impl OwnPoints<'_> {
    /// Their values, x fastest.
    pub(super) fn values(&self) -> impl Iterator<Item = f64> {
        self.indexes(&self.window).map(|n| self.voxels.get(n))
    }

    /// Their indexes among the points of `of`, which has them all, in the order of the values.
    pub(super) fn indexes(&self, of: &GridBox) -> impl Iterator<Item = usize> {
        let row = self.own.dims()[0];
        row_starts(of, &self.own).flat_map(move |first| first..first + row)
    }
}

/// Appends the points of `region`, which lies in `of`, whose `bytes` are given.
pub(super) fn read_region(of: &GridBox, bytes: &[u8], region: &GridBox, size: usize, out: &mut Vec<u8>) {
    for row in rows(region) {
        let at = offset(of, region, row, size);
        out.extend_from_slice(&bytes[at..at + region.dims()[0] * size]);
    }
}

/// Takes the points of `region` off the front of `from` into `bytes`, those of a box that it lies in. False if they are too few.
pub(super) fn write_region(of: &GridBox, bytes: &mut [u8], region: &GridBox, size: usize, from: &mut &[u8]) -> bool {
    let length = region.dims()[0] * size;
    rows(region).all(|row| {
        let Some((points, rest)) = from.split_at_checked(length) else { return false };
        *from = rest;
        let at = offset(of, region, row, size);
        bytes[at..at + length].copy_from_slice(points);
        true
    })
}

/// What `windows` need of `bricks`, in the order that [`fill`] takes it.
pub(super) fn ghosts(windows: &[GridBox], bricks: &Bricks, size: usize) -> Vec<u8> {
    let mut out = Vec::new();
    for window in windows {
        for (brick, bytes) in bricks {
            if let Some(shared) = window.intersection(brick) {
                read_region(brick, bytes, &shared, size, &mut out);
            }
        }
    }
    out
}

/// Puts what the owner of `boxes` sent for `windows` where it belongs. False if it is not as much as that.
pub(super) fn fill(windows: &mut [(GridBox, Vec<u8>)], boxes: &[GridBox], size: usize, mut from: &[u8]) -> bool {
    let shared = windows.iter_mut().all(|(window, bytes)| {
        boxes
            .iter()
            .filter_map(|b| window.intersection(b))
            .all(|shared| write_region(window, bytes, &shared, size, &mut from))
    });
    shared && from.is_empty()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use lamina_model::Grid;

    /// A box whose points are their own numbers in the grid.
    fn brick(grid: &Grid, start: [u64; 3], dims: [u64; 3]) -> (GridBox, Vec<u8>) {
        let place = GridBox::new(start, dims, grid).unwrap();
        let number = |x, y, z| ((z * grid.dims()[1] + y) * grid.dims()[0] + x) as u16;
        let xs = place.start()[0]..place.start()[0] + place.dims()[0];
        let bytes =
            rows(&place).flat_map(|(y, z)| xs.clone().flat_map(move |x| number(x, y, z).to_le_bytes())).collect();
        (place, bytes)
    }

    #[test]
    fn windows_over_the_boxes_of_two_owners_are_those_of_the_grid() {
        let grid = Grid::new([5, 4, 6], DVec3::ONE, DVec3::ZERO).unwrap();
        let owners = [
            vec![brick(&grid, [0, 0, 0], [5, 4, 2]), brick(&grid, [3, 0, 2], [2, 4, 4])],
            vec![brick(&grid, [0, 0, 2], [3, 4, 4])],
        ];
        let places = [([0, 0, 1], [4, 4, 3]), ([2, 1, 0], [3, 3, 6])];
        let wanted = places.map(|(start, dims)| brick(&grid, start, dims));
        let windows = places.map(|(start, dims)| GridBox::new(start, dims, &grid).unwrap());
        let mut filled: Vec<_> = windows.iter().map(|w| (*w, vec![0xff; 2 * w.voxels()])).collect();
        for owner in &owners {
            let bricks: Vec<_> = owner.iter().map(|(b, bytes)| (*b, &bytes[..])).collect();
            let sent = ghosts(&windows, &bricks, 2);
            let boxes: Vec<GridBox> = owner.iter().map(|(b, _)| *b).collect();
            assert!(!fill(&mut filled.clone(), &boxes, 2, &sent[..sent.len() - 1]), "one byte is missing");
            assert!(fill(&mut filled, &boxes, 2, &sent));
        }
        assert_eq!(filled, wanted);
    }
}
