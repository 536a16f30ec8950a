//! Compositing what a stretch of a ray meets in one pixel's list.

use super::TRANSMITTANCE_FLOOR;
use super::absorb::opacity;
use super::frame::Frame;
use super::index::Span;
use super::line::{Line, Point};
use lamina_model::Supersegment;
use std::ops::ControlFlow::{self, Break, Continue};

/// What a ray has gathered so far, front to back.
#[derive(Clone, Copy)]
pub struct Light {
    color: [f32; 3],
    transmittance: f32,
}

impl Default for Light {
    fn default() -> Self {
        Self { color: [0.0; 3], transmittance: 1.0 }
    }
}

/// A stretch of a ray in steps of one pixel's ray.
struct Stretch {
    near: f64,
    far: f64,
    /// World length per step in units of the step length: optical depth met per optical depth of a whole step.
    per_step: f64,
    /// The length as a whole, where depth does not change along it: a supersegment has all of it or nothing.
    flat: Option<f64>,
    last: f64,
}

impl Light {
    /// Adds what lies between two points in pixel number `pixel`, near to far or far to near as the ray runs; breaks when
    /// nothing behind can be seen. `hint` is the place in the list where the previous pixel's search ended.
    #[inline(always)]
    pub fn gather(
        &mut self,
        frame: &Frame,
        line: &Line,
        pixel: usize,
        from: Point,
        to: Point,
        hint: &mut usize,
    ) -> ControlFlow<()> {
        let (corner, [w, _]) = (frame.index.corner, frame.index.size);
        let list = frame.vdi.list(corner[0] + pixel as u32 % w, corner[1] + pixel as u32 / w);
        let span = &frame.index.spans[pixel];
        let steps = |point: Point| point.z * span.scale - span.offset;
        let (a, b) = (steps(from), steps(to));
        let stretch = Stretch::new(a.min(b), a.max(b), line.length(from, to), frame.vdi.header().step_length, span);
        if b >= a {
            let mut k = first_met(list, stretch.near, *hint);
            *hint = k;
            while k < list.len() && stretch.begins_within(&list[k]) {
                self.add(&list[k], &stretch);
                *hint = k;
                k += 1;
            }
        } else {
            let mut k = first_met(list, stretch.near, *hint);
            *hint = k;
            let first = k;
            while k < list.len() && stretch.begins_within(&list[k]) {
                k += 1;
            }
            for s in list[first..k].iter().rev() {
                self.add(s, &stretch);
            }
        }
        if self.transmittance < TRANSMITTANCE_FLOOR as f32 { Break(()) } else { Continue(()) }
    }

    #[inline(always)]
    fn add(&mut self, s: &Supersegment, stretch: &Stretch) {
        let (start, end) = (f64::from(s.start), f64::from(s.end).min(stretch.last));
        let steps = match stretch.flat {
            None => (end.min(stretch.far) - start.max(stretch.near)) * stretch.per_step,
            Some(length) => length,
        };
        let whole = end - start;
        if steps > 0.0 && whole > 0.0 {
            let weight = self.transmittance * opacity(s.optical_depth * (steps as f32 / whole as f32));
            for (sum, c) in self.color.iter_mut().zip(s.color) {
                *sum += weight * c;
            }
            self.transmittance -= weight;
        }
    }

    /// The colour seen in front of `background`.
    pub fn over(&self, background: [f32; 3]) -> [f32; 3] {
        std::array::from_fn(|c| self.color[c] + self.transmittance * background[c])
    }
}

impl Stretch {
    #[inline(always)]
    fn new(near: f64, far: f64, length: f64, step_length: f64, span: &Span) -> Self {
        let steps = length / step_length;
        let is_flat = far - near <= 1e-12 * far.abs();
        Self { near, far, per_step: steps / (far - near), flat: is_flat.then_some(steps), last: span.last }
    }

    #[inline(always)]
    fn begins_within(&self, s: &Supersegment) -> bool {
        if self.flat.is_some() { f64::from(s.start) <= self.far } else { f64::from(s.start) < self.far }
    }
}

/// The first supersegment of `list` that ends beyond `near`, looked for from place `hint` on: neighbours' lists are alike.
#[inline(always)]
fn first_met(list: &[Supersegment], near: f64, hint: usize) -> usize {
    let mut k = hint.min(list.len());
    while k > 0 && f64::from(list[k - 1].end) > near {
        k -= 1;
    }
    while k < list.len() && f64::from(list[k].end) <= near {
        k += 1;
    }
    k
}
