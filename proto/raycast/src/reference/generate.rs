//! VDI generation: one march per ray, whose samples are clustered into supersegments by the interrupt parameter gamma.

use super::march::{RayMarcher, RaySample};
use crate::Field;
use crate::vdi::assemble::{RowBand, VdiBuilder, header, in_order};
use crate::vdi::segmentation::Segmenter;
use lamina_model::composite::opacity_from_optical_depth;
use lamina_model::{Invalid, Ray, Segmentation, Supersegment, Vdi, VdiParams};
use std::ops::ControlFlow;

/// Generates the VDI of `field` from the scene's camera with `segmentation`. The paper's R.
///
/// Rays do not end where they become opaque, unless `params` sets a cutoff: what is hidden now is seen from other angles.
///
/// # Errors
/// If the step is so short that rays would have too many of them, or the VDI has 2^32 supersegments or more.
#[doc(alias = "R")]
pub fn generate(field: &Field, params: &VdiParams, segmentation: Segmentation) -> Result<Vdi, Invalid> {
    let header = header(field.grid(), field.scene(), params)?;
    let fit = Segmenter::new(&header, segmentation, field.unit_length());
    let params = &params.with_gamma(fit.initial_gamma(params.gamma()))?;
    let march = RayMarcher::new(field, header.step_length);
    let r = params.resolution();
    let row = |j: usize| {
        let mut band = RowBand::default();
        for i in 0..r {
            let before = band.segments.len();
            cluster_ray(&march, params, &header.camera.pixel_ray(i, j as u32, r, r), &mut band.segments);
            band.counts.push((band.segments.len() - before) as u32);
        }
        fit.rows(j as u32, band)
    };
    let mut join = VdiBuilder::new(r as usize * r as usize);
    in_order(r as usize, row, |band| join.add(band));
    join.finish(header)
}

/// The supersegment that samples are being added to.
struct OpenSegment {
    start: u32,
    end: u32,
    length: f64,
    color: [f64; 3],
    optical_depth: f64,
}

impl OpenSegment {
    fn new(s: &RaySample) -> Self {
        let optical_depth = s.classified.extinction * s.length;
        Self { start: s.step, end: s.step + 1, length: s.length, color: s.classified.color, optical_depth }
    }

    /// Largest channel difference between the premultiplied RGBA of this supersegment and of a sample, both at the unit length,
    /// so that the meaning of gamma does not depend on the step length.
    fn difference(&self, s: &RaySample, unit_length: f64) -> f64 {
        let opacity = opacity_from_optical_depth(self.optical_depth * (unit_length / self.length));
        let c = &s.classified;
        (0..3)
            .map(|i| (self.color[i] * opacity - c.color[i] * c.opacity).abs())
            .fold((opacity - c.opacity).abs(), f64::max)
    }

    /// Composites a sample behind; the straight color stays the mean of sample colors, weighted by their visible opacity.
    fn add(&mut self, s: &RaySample) {
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

fn cluster_ray(march: &RayMarcher, params: &VdiParams, ray: &Ray, out: &mut Vec<Supersegment>) {
    let mut open: Option<OpenSegment> = None;
    let mut optical_depth = 0.0;
    let cutoff = params.opacity_cutoff();
    march.samples(ray, |s| {
        match &mut open {
            // Transparent steps are not passed to the closure: a gap ends a supersegment.
            Some(o) if o.end == s.step && o.difference(&s, march.unit_length()) < params.gamma() => o.add(&s),
            _ => out.extend(open.replace(OpenSegment::new(&s)).map(|o| o.close())),
        }
        optical_depth += s.classified.extinction * s.length;
        if cutoff < 1.0 && opacity_from_optical_depth(optical_depth) >= cutoff {
            return ControlFlow::Break(());
        }
        ControlFlow::Continue(())
    });
    out.extend(open.map(|o| o.close()));
}
