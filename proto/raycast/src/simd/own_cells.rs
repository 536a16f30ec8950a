//! Which steps of a ray are those of a part of a grid: the ones whose samples lie in its own cells.

use crate::GridPart;
use lamina_compute::simd::WIDTH;
use lamina_model::Grid;
use std::ops::Range;

/// The cells of a part of a grid.
pub(super) struct OwnCells {
    /// First cell and the one behind the last, per axis.
    cells: [[i32; 2]; 3],
    /// Largest position in the whole grid, per axis.
    last: [f32; 3],
}

impl OwnCells {
    /// Those of `part` of `grid`; `None` if it is the whole grid.
    pub(super) fn of(grid: &Grid, part: &GridPart) -> Option<Self> {
        (!part.is_whole()).then(|| Self {
            cells: part.cells().clone().map(|own| [own.start as i32, own.end as i32]),
            last: grid.dims().map(|n| ((n - 1) as f32).next_down()),
        })
    }

    /// Leaves of the steps of eight rays, from `first` to `steps`, those whose samples lie in the cells.
    pub(super) fn restrict(
        &self,
        entry: &[[f32; WIDTH]; 3],
        delta: &[[f32; WIDTH]; 3],
        last_at: &[f32; WIDTH],
        (first, steps): (&mut [i32; WIDTH], &mut [i32; WIDTH]),
    ) {
        for l in 0..WIDTH {
            let mut range = first[l]..steps[l];
            for a in 0..3 {
                range = self.range(a, range, [entry[a][l], delta[a][l], last_at[l]]);
            }
            (first[l], steps[l]) = (range.start, range.end);
        }
    }

    /// The steps of `range` whose samples lie between the cells of axis `a`, on a ray given by its entry, its change per step and
    /// the place of its last sample. Cells rise or fall along a ray, also as rounded.
    fn range(&self, a: usize, range: Range<i32>, [entry, delta, last_at]: [f32; 3]) -> Range<i32> {
        if range.is_empty() {
            return range;
        }
        let [low, high] = self.cells[a];
        // As `RayPacket::position` and `VolumeSampler::cell` compute it.
        let cell = |n: i32| (entry + (n as f32 + 0.5).min(last_at) * delta).max(0.0).min(self.last[a]) as i32;
        let ends = [cell(range.start), cell(range.end - 1)];
        if ends.iter().all(|c| (low..high).contains(c)) {
            return range;
        }
        if ends.iter().all(|&c| c < low) || ends.iter().all(|&c| c >= high) {
            return range.start..range.start;
        }
        // The first step of the range at which `reached` holds, near the one that crosses `edge`.
        let first = |edge: i32, reached: &dyn Fn(i32) -> bool| {
            let mut n = (((edge as f32 - entry) / delta - 0.5) as i32).clamp(range.start, range.end);
            while n < range.end && !reached(n) {
                n += 1;
            }
            while n > range.start && reached(n - 1) {
                n -= 1;
            }
            n
        };
        if ends[0] <= ends[1] {
            first(low, &|n| cell(n) >= low)..first(high, &|n| cell(n) >= high)
        } else {
            first(high, &|n| cell(n) < high)..first(low, &|n| cell(n) < low)
        }
    }
}
