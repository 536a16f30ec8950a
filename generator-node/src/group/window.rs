//! The points that a field of one box needs: the box and its ghost points, copied from the boxes that have them.

use crate::ingest::GridBox;
use lamina_model::{Grid, Invalid, Voxels};
use std::ops::Range;

/// Boxes with their bytes.
pub(super) type Bricks<'a> = [(GridBox, &'a [u8])];

/// Where the row of `region` at (y, z) begins among the points of a box.
fn offset(of: &GridBox, region: &GridBox, (y, z): (usize, usize)) -> usize {
    let ([x0, y0, z0], [nx, ny, _]) = (of.start(), of.dims());
    ((z - z0) * ny + (y - y0)) * nx + region.start()[0] - x0
}

fn rows(region: &GridBox) -> impl Iterator<Item = (usize, usize)> + use<> {
    let ([_, y0, z0], [_, ny, nz]) = (region.start(), region.dims());
    (z0..z0 + nz).flat_map(move |z| (y0..y0 + ny).map(move |y| (y, z)))
}

/// Where the rows of `region`, which lies in `of`, begin among the points of that.
pub(super) fn row_starts(of: &GridBox, region: &GridBox) -> impl Iterator<Item = usize> {
    rows(region).map(move |row| offset(of, region, row))
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

/// The points of the run's grid that a window is made from: all combinations of some along each axis.
pub(super) struct SourcePoints {
    bounds: GridBox,
    /// Along x, y and z their ascending indexes; `None` for all of the bounds.
    axes: [Option<Vec<usize>>; 3],
}

impl SourcePoints {
    /// Those of `window` itself, but along the axes that `axes` gives.
    ///
    /// # Errors
    /// If they are not of `grid`.
    pub(super) fn new(window: &GridBox, axes: [Option<Vec<usize>>; 3], grid: &Grid) -> Result<Self, Invalid> {
        let mut ranges = window.ranges();
        for (range, of_axis) in ranges.iter_mut().zip(&axes) {
            if let Some([first, ..]) = of_axis.as_deref() {
                *range = *first..of_axis.iter().flatten().last().map_or(*first, |last| last + 1);
            }
        }
        let [start, dims] = [ranges.clone().map(|r| r.start as u64), ranges.map(|r| r.len() as u64)];
        Ok(Self { bounds: GridBox::new(start, dims, grid)?, axes })
    }

    fn dims(&self) -> [usize; 3] {
        std::array::from_fn(|a| self.axes[a].as_ref().map_or(self.bounds.dims()[a], Vec::len))
    }

    /// How many they are.
    pub(super) fn voxels(&self) -> usize {
        self.dims().iter().product()
    }

    /// Which of them, counted along each axis, lie in `brick`.
    fn within(&self, brick: &GridBox) -> [Range<usize>; 3] {
        if !self.bounds.overlaps(brick) {
            return [0..0, 0..0, 0..0];
        }
        let (of_brick, bounds) = (brick.ranges(), self.bounds.ranges());
        std::array::from_fn(|a| {
            let before = |index: usize| match &self.axes[a] {
                Some(indexes) => indexes.partition_point(|of| *of < index),
                None => index.clamp(bounds[a].start, bounds[a].end) - bounds[a].start,
            };
            before(of_brick[a].start)..before(of_brick[a].end)
        })
    }

    /// How many of them lie in `brick`.
    pub(super) fn shared(&self, brick: &GridBox) -> usize {
        self.within(brick).iter().map(ExactSizeIterator::len).product()
    }

    /// Goes through the runs of points that they have in common with `brick`, in order: where each begins among those of the brick, where
    /// among these, and its length.
    fn each_run(&self, brick: &GridBox, mut run: impl FnMut(usize, usize, usize)) {
        let within = self.within(brick);
        let in_brick = |a: usize, n: usize| {
            self.axes[a].as_ref().map_or(self.bounds.start()[a] + n, |indexes| indexes[n]) - brick.start()[a]
        };
        let mut along_x: Vec<(usize, usize, usize)> = Vec::new();
        for n in within[0].clone() {
            let x = in_brick(0, n);
            match along_x.last_mut() {
                Some((first, _, length)) if *first + *length == x => *length += 1,
                _ => along_x.push((x, n, 1)),
            }
        }
        let ([brick_x, brick_y, _], [points_x, points_y, _]) = (brick.dims(), self.dims());
        for z in within[2].clone() {
            for y in within[1].clone() {
                let of_brick = (in_brick(2, z) * brick_y + in_brick(1, y)) * brick_x;
                let here = (z * points_y + y) * points_x;
                along_x.iter().for_each(|&(x, n, length)| run(of_brick + x, here + n, length));
            }
        }
    }
}

/// What `windows` need of `bricks`, of points of `size` bytes, in the order that [`fill`] takes it.
pub(super) fn ghosts(windows: &[SourcePoints], bricks: &Bricks, size: usize) -> Vec<u8> {
    let mut out = Vec::new();
    for window in windows {
        for (brick, bytes) in bricks {
            window.each_run(brick, |at, _, length| out.extend_from_slice(&bytes[at * size..(at + length) * size]));
        }
    }
    out
}

/// Puts what the owner of `boxes` sent for `windows` where it belongs, in the bytes of each. False if it is not as much as that.
pub(super) fn fill(
    windows: &[SourcePoints],
    bytes: &mut [Vec<u8>],
    boxes: &[GridBox],
    size: usize,
    mut from: &[u8],
) -> bool {
    let points: usize = windows.iter().flat_map(|w| boxes.iter().map(|b| w.shared(b))).sum();
    if from.len() != points * size {
        return false;
    }
    for (window, bytes) in windows.iter().zip(bytes) {
        for brick in boxes {
            window.each_run(brick, |_, at, length| {
                let (points, rest) = from.split_at(length * size);
                bytes[at * size..(at + length) * size].copy_from_slice(points);
                from = rest;
            });
        }
    }
    true
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
        let window = |place: &GridBox| SourcePoints::new(place, [None, None, None], &grid).unwrap();
        let windows: Vec<SourcePoints> = wanted.iter().map(|(place, _)| window(place)).collect();
        let filled = filled(&windows, &owners);
        assert!(filled.iter().zip(&wanted).all(|(bytes, (_, of_grid))| bytes == of_grid));
    }

    /// What the windows are once all owners have sent their points.
    fn filled(windows: &[SourcePoints], owners: &[Vec<(GridBox, Vec<u8>)>]) -> Vec<Vec<u8>> {
        let mut filled: Vec<Vec<u8>> = windows.iter().map(|w| vec![0xff; 2 * w.voxels()]).collect();
        for owner in owners {
            let bricks: Vec<_> = owner.iter().map(|(b, bytes)| (*b, &bytes[..])).collect();
            let sent = ghosts(windows, &bricks, 2);
            let boxes: Vec<GridBox> = owner.iter().map(|(b, _)| *b).collect();
            let shared = |w: &SourcePoints| boxes.iter().map(|b| w.shared(b)).sum::<usize>();
            assert_eq!(windows.iter().map(shared).sum::<usize>() * 2, sent.len());
            assert!(!fill(windows, &mut filled.clone(), &boxes, 2, &sent[..sent.len() - 1]), "one byte is missing");
            assert!(fill(windows, &mut filled, &boxes, 2, &sent));
        }
        filled
    }

    #[test]
    fn of_uneven_axes_only_the_points_that_are_needed_are_sent() {
        let grid = Grid::new([7, 3, 5], DVec3::ONE, DVec3::ZERO).unwrap();
        let owners = [vec![brick(&grid, [0, 0, 0], [3, 3, 5])], vec![brick(&grid, [3, 0, 0], [4, 3, 5])]];
        let window = GridBox::new([1, 1, 2], [4, 2, 3], &grid).unwrap();
        let (xs, zs) = (vec![0, 2, 3, 6], vec![0, 4]);
        let points = SourcePoints::new(&window, [Some(xs.clone()), None, Some(zs.clone())], &grid).unwrap();
        let number = |x: usize, y: usize, z: usize| ((z * 3 + y) * 7 + x) as u16;
        let rows = zs.iter().flat_map(|z| [1, 2].map(|y| (y, *z)));
        let wanted: Vec<u8> =
            rows.flat_map(|(y, z)| xs.iter().flat_map(move |x| number(*x, y, z).to_le_bytes())).collect();
        assert_eq!(filled(&[points], &owners), [wanted]);
        let outside = SourcePoints::new(&window, [Some(vec![5, 7]), None, None], &grid);
        assert!(outside.is_err(), "beyond the grid");
    }
}
