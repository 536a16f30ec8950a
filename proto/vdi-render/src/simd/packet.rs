//! Eight rays, clipped to where the VDI may show something, as straight lines in the VDI's image.
//!
//! Between entry and exit, columns and rows are linear in a parameter mu in [0, 1], and so is 1/Z. With Z0 and Z1 the
//! depths at both ends, the part of the way that lies before mu is mu Z0 / (mu Z0 + (1 - mu) Z1). Lines are made in double
//! precision and kept in single: depths count from a plane through the middle of what is stored, so that their numbers are
//! as small as the volume.

use super::acceleration_grid::Slabs;
use super::clip::Clip;
use super::ray_setup::Frame;
use lamina_compute::simd::{Floats, Ints, Lanes, Masks, WIDTH};

/// How much of the ray is left out at both ends, relative: at the tip of the pyramid image positions are not defined.
const HAIR: f64 = 1e-9;

/// Stands for one over no change: any boundary but that under the ray is then far beyond its ends.
const FAR: f32 = 1e30;

/// By how many pixels or slabs single precision may misplace a point, relative to how many there are.
const ROUNDING: f32 = 1e-6;

/// See the file's head.
pub struct Packet<L: Lanes> {
    /// Which lanes have a ray that may meet something.
    pub live: L::M,
    /// Column and row at mu = 0, and the same split into the pixel and the place in it, which keeps more digits.
    start: [L::F; 2],
    first: [L::I; 2],
    inside: [L::F; 2],
    /// Their change from mu = 0 to 1.
    change: [L::F; 2],
    /// One over it.
    per_change: [L::F; 2],
    /// Depth at mu = 0, and its change.
    depth: L::F,
    /// Which lanes come nearer to the generation camera.
    depth_change: L::F,
    /// Z0 / Z1.
    ratio: L::F,
    /// Place on the scale of slabs at mu = 0, and its change.
    slabs: [L::F; 2],
    /// How many slabs places may be off.
    slab_margin: L::F,
    /// How many pixels places may be off.
    pub pixel_margin: L::F,
    /// Length of the whole in step lengths.
    steps: L::F,
}

/// What the rays of a group have in common: the sense in which they run.
#[derive(Clone, Copy)]
pub struct Heading {
    /// Whether columns and rows grow.
    pub forward: [bool; 2],
    /// Whether depth grows.
    pub receding: bool,
    /// Whether they run along rows (0) or columns (1), rather than across.
    pub along: usize,
}

impl Heading {
    /// From a pixel to the next one.
    #[inline(always)]
    pub fn step(self, axis: usize) -> i32 {
        if self.forward[axis] { 1 } else { -1 }
    }

    /// From a pixel to the boundary behind it.
    #[inline(always)]
    pub fn far_side(self, axis: usize) -> i32 {
        i32::from(self.forward[axis])
    }
}

impl<L: Lanes> Packet<L> {
    /// The rays through the centres of one to eight `pixels`, of which `clip` is known to hold the planes that matter.
    #[inline(always)]
    pub fn new(frame: &Frame, clip: &Clip, pixels: &[(u32, u32)]) -> Self {
        let (mut x, mut y) = ([0.0; WIDTH], [0.0; WIDTH]);
        for l in 0..WIDTH {
            let (i, j) = pixels[l.min(pixels.len() - 1)];
            (x[l], y[l]) = (f64::from(i) + 0.5, f64::from(j) + 0.5);
        }
        let (enter, leave) = clip.spans(&x, &y);
        let (origin, image, world) = (frame.image.origin, &frame.image, &frame.world);
        let [w, h] = frame.index.size.map(f64::from);
        let slabs = frame.index.slabs;
        let per_step = 1.0 / frame.vdi.header().step_length;
        let mut lines = [[0.0_f32; WIDTH]; 12];
        let mut first = [[0_i32; WIDTH]; 2];
        for l in 0..WIDTH {
            let hair = HAIR * (leave[l] - enter[l]);
            let (from, to) = (enter[l] + hair, leave[l] - hair);
            let direction = image.direction(x[l], y[l]);
            let (a, b) = (origin + from * direction, origin + to * direction);
            let (inverse0, inverse1) = (1.0 / a.z, 1.0 / b.z);
            // What rounding pushes over the rim is pulled back.
            let start = [(a.x * inverse0).max(0.0).min(w), (a.y * inverse0).max(0.0).min(h)];
            let end = [(b.x * inverse1).max(0.0).min(w), (b.y * inverse1).max(0.0).min(h)];
            let length = (to - from) * world.direction(x[l], y[l]).length();
            // Also refuses what is NaN.
            let live = enter[l] < leave[l] && leave[l] < f64::INFINITY && a.z > 0.0 && b.z > 0.0;
            let line = [
                start[0],
                start[1],
                end[0] - start[0],
                end[1] - start[1],
                a.z - frame.index.middle,
                b.z - a.z,
                a.z * inverse1,
                (inverse0 - slabs.far) * slabs.per_inverse_depth,
                (inverse1 - inverse0) * slabs.per_inverse_depth,
                length * per_step,
                start[0].fract(),
                start[1].fract(),
            ];
            (first[0][l], first[1][l]) = (start[0] as i32, start[1] as i32);
            for (n, number) in line.into_iter().enumerate() {
                lines[n][l] = number as f32;
            }
            // A line of no length says that there is none.
            if !live || l >= pixels.len() {
                lines[9][l] = -1.0;
            }
        }
        let [columns, rows] = [L::F::from_array(lines[2]), L::F::from_array(lines[3])];
        let (slab_change, steps) = (L::F::from_array(lines[8]), L::F::from_array(lines[9]));
        let zero = L::F::splat(0.0);
        let live = zero.le(steps);
        Self {
            live,
            start: [L::F::from_array(lines[0]), L::F::from_array(lines[1])],
            first: [L::I::from_array(first[0]), L::I::from_array(first[1])],
            inside: [L::F::from_array(lines[10]), L::F::from_array(lines[11])],
            change: [columns, rows],
            per_change: [per_change::<L>(columns), per_change::<L>(rows)],
            depth: L::F::from_array(lines[4]),
            depth_change: L::F::from_array(lines[5]),
            ratio: L::F::from_array(lines[6]),
            slabs: [L::F::from_array(lines[7]), slab_change],
            slab_margin: slab_change.abs() * L::F::splat(ROUNDING),
            pixel_margin: L::F::splat(ROUNDING * w.max(h) as f32),
            steps,
        }
    }

    /// The first ray of `left` and those that run in the same sense.
    #[inline(always)]
    pub fn group(&self, left: L::M) -> (L::M, Heading) {
        let (zero, first) = (L::F::splat(0.0), left.bits().trailing_zeros());
        let (mut group, mut grows) = (left, [true; 3]);
        for (grows, change) in grows.iter_mut().zip([self.change[0], self.change[1], self.depth_change]) {
            let falls = change.lt(zero);
            *grows = falls.bits() >> first & 1 == 0;
            group = group & if *grows { !falls } else { falls };
        }
        let steep = self.change[0].abs().lt(self.change[1].abs());
        let along = (steep.bits() >> first & 1) as usize;
        (group, Heading { forward: [grows[0], grows[1]], receding: grows[2], along })
    }

    /// Column or row at `mu`.
    #[inline(always)]
    pub fn place(&self, axis: usize, mu: L::F) -> L::F {
        self.start[axis] + self.change[axis] * mu
    }

    /// Where the boundary before pixel `k` is met.
    #[inline(always)]
    pub fn boundary(&self, axis: usize, k: i32) -> L::F {
        (L::F::from(L::I::splat(k) - self.first[axis]) - self.inside[axis]) * self.per_change[axis]
    }

    /// The slabs, counted from the farthest, that the lines `met` pass between two places.
    #[inline(always)]
    pub fn slabs(&self, heading: Heading, from: L::F, to: L::F, met: L::M) -> u64 {
        let (a, b) = (self.slabs[0] + self.slabs[1] * from, self.slabs[0] + self.slabs[1] * to);
        let (low, high) = if heading.receding { (b, a) } else { (a, b) };
        // Beyond the first and the last slab all is theirs.
        let (zero, last) = (L::F::splat(0.0), L::F::splat(63.0));
        let low = (low - self.slab_margin).min(last).max(zero);
        let high = (high + self.slab_margin).min(last).max(zero);
        let [low, high] = L::F::ends(low, high, met);
        Slabs::bits(low as u32, high as u32)
    }

    /// Which part of the way lies before `mu`.
    #[inline(always)]
    pub fn way(&self, mu: L::F) -> L::F {
        let part = mu * self.ratio;
        part.div(part + (L::F::splat(1.0) - mu))
    }

    /// Depth from the middle plane, where `way` lies before.
    #[inline(always)]
    pub fn depth(&self, way: L::F) -> L::F {
        self.depth + way * self.depth_change
    }

    /// Length of a part of the way in step lengths.
    #[inline(always)]
    pub fn steps(&self, part: L::F) -> L::F {
        part * self.steps
    }
}

#[inline(always)]
fn per_change<L: Lanes>(change: L::F) -> L::F {
    let zero = L::F::splat(0.0);
    let far = L::F::select(change.lt(zero), L::F::splat(-FAR), L::F::splat(FAR));
    L::F::select(change.abs().lt(L::F::splat(1.0 / FAR)), far, L::F::splat(1.0).div(change))
}
