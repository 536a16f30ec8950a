//! Clip planes of a VDI's visible region, and their selection for a tile of the picture.
//!
//! Along the ray through picture position (x, y) a plane's signed distance is a + b t, with b linear in x and y. So over a tile
//! b lies between its values at the corners, and so does the position -a/b where rays meet the plane. A plane that all rays of
//! the tile enter before they surely enter another one, or leave after another one, clips none of them and is left out. The
//! other planes give every ray the same entry and exit as all planes do.

use lamina_compute::simd::WIDTH;

/// The most planes: six of the box, four sides of the occupied rectangle, two of depth.
pub(super) const PLANES: usize = 12;

/// Relative difference from which on the order of two positions is certain.
const SURELY: f64 = 1e-9;

/// A half space a + b t >= 0.
#[derive(Clone, Copy, Default)]
pub(super) struct Plane {
    /// Signed distance of the rays' origin.
    pub a: f64,
    /// Its change along the ray through picture position (0, 0), and the change of that per pixel to the right and down.
    pub b: [f64; 3],
}

impl Plane {
    #[inline(always)]
    fn b(&self, x: f64, y: f64) -> f64 {
        self.b[0] + x * self.b[1] + y * self.b[2]
    }
}

/// Up to [`PLANES`] planes.
#[derive(Clone, Copy, Default)]
pub(super) struct ClipPlanes {
    planes: [Plane; PLANES],
    count: usize,
}

impl ClipPlanes {
    /// Adds a plane.
    pub(super) fn push(&mut self, plane: Plane) {
        self.planes[self.count] = plane;
        self.count += 1;
    }

    fn planes(&self) -> &[Plane] {
        &self.planes[..self.count]
    }

    /// Entry and exit of the rays through picture positions (`x`, `y`); the exit is before the entry if a ray misses the region.
    /// Without branches, so that the compiler vectorizes it.
    #[inline(always)]
    pub(super) fn spans(&self, x: &[f64; WIDTH], y: &[f64; WIDTH]) -> ([f64; WIDTH], [f64; WIDTH]) {
        let (mut enter, mut leave) = ([0.0; WIDTH], [f64::INFINITY; WIDTH]);
        for plane in self.planes() {
            for l in 0..WIDTH {
                let b = plane.b(x[l], y[l]);
                let t = -plane.a / b;
                enter[l] = if b > 0.0 && t > enter[l] { t } else { enter[l] };
                leave[l] = if b < 0.0 && t < leave[l] { t } else { leave[l] };
                leave[l] = if b == 0.0 && plane.a < 0.0 { -1.0 } else { leave[l] };
            }
        }
        (enter, leave)
    }

    /// The planes that clip any ray with x and y between two corners; `None` if all these rays miss the region.
    pub(super) fn of_tile(&self, x: [f64; 2], y: [f64; 2]) -> Option<Self> {
        let places = |plane: &Plane| {
            let b = [plane.b(x[0], y[0]), plane.b(x[1], y[0]), plane.b(x[0], y[1]), plane.b(x[1], y[1])];
            let least = b.into_iter().fold(f64::INFINITY, f64::min);
            let most = b.into_iter().fold(f64::NEG_INFINITY, f64::max);
            // Nothing is known of a plane to which some rays of the tile are parallel.
            let known = least > 0.0 || most < 0.0;
            let (p, q) = (-plane.a / least, -plane.a / most);
            known.then(|| (least > 0.0, p.min(q), p.max(q)))
        };
        // Every ray enters at `enter` or later and leaves at `leave` or earlier.
        let (mut enter, mut leave) = (0.0_f64, f64::INFINITY);
        for (entered, first, last) in self.planes().iter().filter_map(places) {
            if entered {
                enter = enter.max(first);
            } else {
                leave = leave.min(last);
            }
        }
        if enter * (1.0 - SURELY) > leave * (1.0 + SURELY) || leave < 0.0 {
            return None;
        }
        let matters = |plane: &&Plane| match places(plane) {
            Some((true, _, last)) => last >= enter * (1.0 - SURELY),
            Some((false, first, _)) => first <= leave * (1.0 + SURELY),
            None => true,
        };
        let mut tile = Self::default();
        self.planes().iter().filter(matters).for_each(|plane| tile.push(*plane));
        Some(tile)
    }
}
