//! Compositing what a stretch of a ray meets in one pixel's list.

use super::TRANSMITTANCE_FLOOR;
use super::absorb::opacity;
use super::frame::Frame;
use super::line::{Line, Point};
use lamina_model::Supersegment;
use std::ops::ControlFlow::{self, Break, Continue};

/// Pieces met before their opacities are computed, so that the compiler does several at a time.
const PIECES: usize = 8;

/// What a ray has gathered so far, front to back.
pub struct Light {
    color: [f32; 3],
    transmittance: f32,
    optical_depths: [f32; PIECES],
    colors: [[f32; 3]; PIECES],
    pieces: usize,
}

impl Default for Light {
    fn default() -> Self {
        let (optical_depths, colors) = ([0.0; PIECES], [[0.0; 3]; PIECES]);
        Self { color: [0.0; 3], transmittance: 1.0, optical_depths, colors, pieces: 0 }
    }
}

/// A stretch of a ray in steps of one pixel's ray.
struct Stretch {
    near: f64,
    far: f64,
    last: f64,
    /// Step lengths covered per step of depth.
    per_step: f64,
}

impl Light {
    /// Adds what lies between two points in `pixel`, near to far or far to near as the ray runs; breaks when
    /// nothing behind can be seen. `hint` is the place in the list where the previous pixel's search ended.
    #[inline(always)]
    pub fn gather(
        &mut self,
        frame: &Frame,
        line: &Line,
        pixel: [i32; 2],
        from: Point,
        to: Point,
        hint: &mut usize,
    ) -> ControlFlow<()> {
        let [i, j] = pixel.map(|k| k as u32);
        let [corner_i, corner_j] = frame.index.corner;
        let list = frame.vdi.list(corner_i + i, corner_j + j);
        let span = frame.index.span(j as usize * frame.index.size[0] as usize + i as usize);
        let steps_at = |point: Point| line.depth(point) * span.scale - span.offset;
        let (a, b) = (steps_at(from), steps_at(to));
        let Some(per_depth) = line.steps_per_depth else {
            return self.gather_flat(list, a.min(b), a.max(b), line.steps(from, to), span.last);
        };
        let stretch = Stretch { near: a.min(b), far: a.max(b), last: span.last, per_step: per_depth * span.per_scale };
        // Ends are integers: end > near says end > floor(near), and start < far says start < ceil(far).
        let (floor, ceil) = (stretch.near as u32, ceil(stretch.far));
        if b >= a {
            let mut k = first_met(list, floor, *hint);
            *hint = k;
            while let Some(s) = list.get(k)
                && s.start < ceil
            {
                self.add_overlap(s, &stretch)?;
                k += 1;
            }
        } else {
            let mut k = past_met(list, ceil, *hint);
            *hint = k;
            while let Some(s) = list.get(k.wrapping_sub(1))
                && s.end > floor
            {
                self.add_overlap(s, &stretch)?;
                k -= 1;
            }
        }
        Continue(())
    }

    /// Along a depth plane a supersegment has all of the stretch, `steps` long, or nothing.
    #[cold]
    fn gather_flat(&mut self, list: &[Supersegment], near: f64, far: f64, steps: f64, last: f64) -> ControlFlow<()> {
        let first = first_met(list, near as u32, 0);
        for s in list[first..].iter().take_while(|s| f64::from(s.start) <= far) {
            let whole = f64::from(s.end).min(last) - f64::from(s.start);
            if whole > 0.0 {
                self.add(s.optical_depth * (steps as f32 / whole as f32), s.color, true)?;
            }
        }
        Continue(())
    }

    #[inline(always)]
    fn add_overlap(&mut self, s: &Supersegment, stretch: &Stretch) -> ControlFlow<()> {
        let (start, end) = (f64::from(s.start), f64::from(s.end).min(stretch.last));
        let overlap = end.min(stretch.far) - start.max(stretch.near);
        let share = (overlap * stretch.per_step) as f32 / (end - start) as f32;
        // Written in any case and counted only if it overlaps: a branch here would be guessed wrongly too often.
        self.add(s.optical_depth * share, s.color, overlap > 0.0)
    }

    #[inline(always)]
    fn add(&mut self, optical_depth: f32, color: [f32; 3], counts: bool) -> ControlFlow<()> {
        let slot = self.pieces % PIECES;
        self.optical_depths[slot] = optical_depth;
        self.colors[slot] = color;
        self.pieces = slot + usize::from(counts);
        if self.pieces == PIECES { self.composite() } else { Continue(()) }
    }

    /// Composites the pieces met since the last time.
    fn composite(&mut self) -> ControlFlow<()> {
        let opacities = self.optical_depths.map(opacity);
        for (opacity, color) in opacities.iter().zip(&self.colors).take(self.pieces) {
            let weight = self.transmittance * opacity;
            for (sum, c) in self.color.iter_mut().zip(color) {
                *sum += weight * c;
            }
            self.transmittance -= weight;
            if self.transmittance < TRANSMITTANCE_FLOOR as f32 {
                self.pieces = 0;
                return Break(());
            }
        }
        self.pieces = 0;
        Continue(())
    }

    /// The colour seen in front of `background`, when all is gathered.
    pub fn over(mut self, background: [f32; 3]) -> [f32; 3] {
        // Broken or not, nothing more comes.
        let _ = self.composite();
        std::array::from_fn(|c| self.color[c] + self.transmittance * background[c])
    }
}

/// The least integer not below `x`, for x below 2^32; 0 for what is negative.
#[inline(always)]
fn ceil(x: f64) -> u32 {
    let floor = x as u32;
    floor + u32::from(f64::from(floor) < x)
}

/// The first supersegment of `list` that ends beyond `near`, looked for from place `hint` on: neighbours' lists are
/// alike.
#[inline(always)]
fn first_met(list: &[Supersegment], near: u32, hint: usize) -> usize {
    let mut k = hint.min(list.len());
    while k > 0 && list[k - 1].end > near {
        k -= 1;
    }
    while k < list.len() && list[k].end <= near {
        k += 1;
    }
    k
}

/// One past the last supersegment of `list` that starts before `far`, likewise.
#[inline(always)]
fn past_met(list: &[Supersegment], far: u32, hint: usize) -> usize {
    let mut k = hint.min(list.len());
    while k < list.len() && list[k].start < far {
        k += 1;
    }
    while k > 0 && list[k - 1].start >= far {
        k -= 1;
    }
    k
}
