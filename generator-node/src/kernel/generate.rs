//! R: one march per ray, its samples clustered into supersegments by the interrupt parameter gamma.

use super::{Field, march::March, march::Sample};
use lamina_model::composite::opacity_from_optical_depth;
use lamina_model::{GenerationParams, Invalid, Ray, Scene, Supersegment, Vdi, VdiHeader};
use rayon::prelude::*;
use std::ops::ControlFlow;

/// The VDI of `field` from the scene's camera. The paper's R.
///
/// Rays do not end where they become opaque, unless `params` says so: what is hidden now is seen from the side.
///
/// # Errors
/// If the step is so short that rays would have too many of them, or the VDI too many supersegments (2^32).
#[doc(alias = "R")]
pub fn generate(field: &Field, scene: &Scene, params: &GenerationParams) -> Result<Vdi, Invalid> {
    let header = VdiHeader {
        camera: scene.camera,
        bounds: field.grid().bounds(),
        step_length: params.step_voxels() * field.grid().voxel_length(),
        params: *params,
        transfer_id: scene.transfer.id(),
        background: scene.background,
    }
    .check()?;
    let march = March::new(field, &scene.transfer, header.step_length);
    let r = params.resolution();
    let rows: Vec<(Vec<u32>, Vec<Supersegment>)> = (0..r)
        .into_par_iter()
        .map(|j| {
            let mut row = Vec::new();
            let ends = (0..r).map(|i| {
                cluster_ray(&march, params, &scene.camera.pixel_ray(i, j, r, r), &mut row);
                row.len() as u32
            });
            (ends.collect(), row)
        })
        .collect();
    join_rows(header, rows)
}

fn join_rows(header: VdiHeader, rows: Vec<(Vec<u32>, Vec<Supersegment>)>) -> Result<Vdi, Invalid> {
    let total: usize = rows.iter().map(|(_, row)| row.len()).sum();
    if u32::try_from(total).is_err() {
        return Err(Invalid::new("vdi", format!("{total} supersegments; raise gamma or lower the resolution")));
    }
    let mut offsets = vec![0];
    let mut segments = Vec::with_capacity(total);
    for (ends, row) in rows {
        let base = segments.len() as u32;
        offsets.extend(ends.iter().map(|end| base + end));
        segments.extend(row);
    }
    Vdi::new(header, offsets, segments)
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
