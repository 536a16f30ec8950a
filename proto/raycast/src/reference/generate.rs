//! R: one march per ray, its samples clustered into supersegments by the interrupt parameter gamma.

use super::march::{March, Sample};
use crate::Field;
use crate::vdi::assemble::{Band, Join, header, in_order};
use crate::vdi::segmentation::Fit;
use lamina_model::composite::opacity_from_optical_depth;
use lamina_model::{GenerationParams, Invalid, Ray, Segmentation, Supersegment, Vdi};
use std::ops::ControlFlow;

/// The VDI of `field` from the scene's camera with `segmentation`. The paper's R.
///
/// Rays do not end where they become opaque, unless `params` says so: what is hidden now is seen from the side.
///
/// # Errors
/// If the step is so short that rays would have too many of them, or the VDI too many supersegments (2^32).
#[doc(alias = "R")]
pub fn generate(field: &Field, params: &GenerationParams, segmentation: Segmentation) -> Result<Vdi, Invalid> {
    let header = header(field, params)?;
    let fit = Fit::new(&header, segmentation, field.unit_length());
    let params = &params.with_gamma(fit.finer(params.gamma()))?;
    let march = March::new(field, header.step_length);
    let r = params.resolution();
    let row = |j: usize| {
        let mut band = Band::default();
        for i in 0..r {
            let before = band.segments.len();
            cluster_ray(&march, params, &header.camera.pixel_ray(i, j as u32, r, r), &mut band.segments);
            band.counts.push((band.segments.len() - before) as u32);
        }
        fit.rows(j as u32, band)
    };
    let mut join = Join::new(r as usize * r as usize);
    in_order(r as usize, row, |band| join.add(band));
    join.finish(header)
}

/// The supersegment that samples are being added to.
struct Open {
    start: u32,
    end: u32,
    length: f64,
    color: [f64; 3],
    optical_depth: f64,
}

impl Open {
    fn new(s: &Sample) -> Self {
        let optical_depth = s.classified.extinction * s.length;
        Self { start: s.step, end: s.step + 1, length: s.length, color: s.classified.color, optical_depth }
    }

    /// Largest channel difference between the premultiplied RGBA of this supersegment and of a sample, both at the unit
    /// length: so gamma means the same at every step length.
    fn difference(&self, s: &Sample, unit_length: f64) -> f64 {
        let opacity = opacity_from_optical_depth(self.optical_depth * (unit_length / self.length));
        let c = &s.classified;
        (0..3)
            .map(|i| (self.color[i] * opacity - c.color[i] * c.opacity).abs())
            .fold((opacity - c.opacity).abs(), f64::max)
    }

    /// Composites a sample behind; the straight colour stays a mean of sample colours, weighted by what each shows.
    fn add(&mut self, s: &Sample) {
        let optical_depth = s.classified.extinction * s.length;
        let (before, this) =
            (opacity_from_optical_depth(self.optical_depth), opacity_from_optical_depth(optical_depth));
        self.optical_depth += optical_depth;
        let shown = (1.0 - before) * this;
        let all = before + shown;
        if all > 0.0 {
            for (mean, c) in self.color.iter_mut().zip(s.classified.color) {
                *mean += (c - *mean) * (shown / all);
            }
        }
        self.length += s.length;
        self.end = s.step + 1;
    }

    fn close(&self) -> Supersegment {
        Supersegment {
            start: self.start,
            end: self.end,
            color: self.color.map(|c| (c as f32).clamp(0.0, 1.0)),
            optical_depth: self.optical_depth as f32,
        }
    }
}

fn cluster_ray(march: &March, params: &GenerationParams, ray: &Ray, out: &mut Vec<Supersegment>) {
    let mut open: Option<Open> = None;
    let mut optical_depth = 0.0;
    let cutoff = params.opacity_cutoff();
    march.samples(ray, |s| {
        match &mut open {
            // Transparent steps are not visited: a gap ends a supersegment.
            Some(o) if o.end == s.step && o.difference(&s, march.unit_length()) < params.gamma() => o.add(&s),
            _ => out.extend(open.replace(Open::new(&s)).map(|o| o.close())),
        }
        optical_depth += s.classified.extinction * s.length;
        if cutoff < 1.0 && opacity_from_optical_depth(optical_depth) >= cutoff {
            return ControlFlow::Break(());
        }
        ControlFlow::Continue(())
    });
    out.extend(open.map(|o| o.close()));
}
