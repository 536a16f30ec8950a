//! Turns every knob, one at a time, around the base setting.

use super::curve::{ErrorCurve, Parameter, Point};
use super::error::Error;
use super::integrator::{Integrator, Method};
use super::kernels_under_test::{KernelsUnderTest, TimedPicture, median_ms, timed};
use super::requantize;
use super::scalars::{Interpolation, Scalars};
use super::sweeps;
use super::views::Views;
use lamina_model::{Ray, VdiParams, Volume};
use lamina_vdi_render::{Detail, PreparedVdi};

/// Points with what they add by themselves, against the last, the finest.
fn curve<A: Copy + Into<f64>>(knob: Parameter, shots: Vec<(Point, Vec<[A; 3]>)>) -> ErrorCurve {
    let last = shots.len().saturating_sub(1);
    let alone = |n: usize| (n < last).then(|| Error::between(&shots[n].1, &shots[last].1));
    let points = shots.iter().enumerate().map(|(n, (point, _))| Point { alone: alone(n), ..point.clone() }).collect();
    ErrorCurve { knob, points }
}

/// The product's ray caster by its step, which takes `values`.
pub(super) fn raycast(
    product: &KernelsUnderTest,
    volume: &Volume,
    knob: Parameter,
    values: &[f64],
) -> anyhow::Result<ErrorCurve> {
    let shots = values.iter().map(|&step| product.raycast(volume, step));
    Ok(curve(knob, shots.collect::<anyhow::Result<Vec<TimedPicture>>>()?))
}

/// One generation parameter, of which rounds have been measured.
pub(super) fn generation(
    product: &KernelsUnderTest,
    base: &VdiParams,
    turned: &sweeps::ParameterSweep,
) -> anyhow::Result<ErrorCurve> {
    let shot = |&v: &f64| Ok(product.vdi(v, &(turned.set)(*base, v)?));
    let shots = turned.values.iter().map(shot).collect::<anyhow::Result<Vec<Option<TimedPicture>>>>()?;
    Ok(curve(turned.knob, shots.into_iter().flatten().collect()))
}

/// The base's VDI with fewer bits of color, and with fewer of depth; generation is the base's.
pub(super) fn bits(product: &KernelsUnderTest, base: &VdiParams) -> anyhow::Result<[ErrorCurve; 2]> {
    let vdi = product.generate(base)?;
    let time_ms = product.vdi(0.0, base).map_or(f64::NAN, |(point, _)| point.time_ms);
    let of_base = |(point, seen): TimedPicture| (Point { time_ms, params: Some(*base), ..point }, seen);
    let color = sweeps::COLOR_BITS.iter().map(|&bits| Ok(of_base(product.with_color_bits(&vdi, bits)?)));
    let color = color.collect::<anyhow::Result<Vec<TimedPicture>>>()?;
    let most = requantize::depth_bits(vdi.header());
    let depth = (sweeps::FEWEST_DEPTH_BITS.min(most)..=most)
        .map(|bits| Ok(of_base(product.encoded(bits.into(), &requantize::with_depth_bits(&vdi, bits)?)?)));
    Ok([curve(sweeps::COLOR, color), curve(sweeps::DEPTH, depth.collect::<anyhow::Result<Vec<TimedPicture>>>()?)])
}

/// The base's VDI, drawn by the nearest of its rays and by those around, blended.
pub(super) fn blended(product: &KernelsUnderTest, base: &VdiParams) -> anyhow::Result<ErrorCurve> {
    let vdi = product.generate(base)?;
    let vdi = PreparedVdi::new(&vdi);
    let shot = |(rays, detail)| {
        let (point, seen) = product.drawn(rays, &vdi, detail)?;
        Ok((Point { params: Some(*base), ..point }, seen))
    };
    let shots = [(1.0, Detail::Nearest), (12.0, Detail::Cubic)].map(shot).into_iter();
    Ok(curve(sweeps::BLENDED, shots.collect::<anyhow::Result<Vec<TimedPicture>>>()?))
}

/// The plain integrator on the sampled rays.
pub(super) struct Plain<'a> {
    /// The volume under the scene.
    pub integrator: Integrator<'a>,
    /// Its voxels.
    pub scalars: &'a Scalars,
    /// What is sampled.
    pub rays: &'a [Ray],
    /// Against what.
    pub reference: &'a [[f64; 3]],
    /// Whole pictures that as many rays would fill.
    pub pictures: f64,
}

impl Plain<'_> {
    fn shot(&self, with: &Integrator, value: f64, method: &Method) -> anyhow::Result<(Point, Vec<[f64; 3]>)> {
        let (seen, ms) = median_ms(|| timed(|| Ok(with.colors(self.rays, method))))?;
        let error = Error::between(&seen, self.reference);
        Ok((Point::new(value, error, ms / self.pictures), seen))
    }

    /// Midpoint in double and in single precision, and pre-integration, by the step; and how far apart the first two are.
    pub(super) fn steps(&self, base: &VdiParams) -> anyhow::Result<([ErrorCurve; 3], Error)> {
        let sweep = |single, preintegrated| {
            let method = |v| Method { single, preintegrated, ..Method::midpoint(v) };
            let shots = sweeps::steps(base).into_iter().map(|v| self.shot(&self.integrator, v, &method(v)));
            shots.collect::<anyhow::Result<Vec<_>>>()
        };
        let (double, single, preintegrated) = (sweep(false, false)?, sweep(true, false)?, sweep(false, true)?);
        let apart = double.iter().zip(&single).map(|(a, b)| Error::between(&a.1, &b.1));
        let apart = apart.max_by(|a, b| a.rms.total_cmp(&b.rms)).unwrap_or(Error { rms: 0.0, max: 0.0 });
        let curves = [
            curve(sweeps::MIDPOINT, double),
            curve(sweeps::MIDPOINT_SINGLE, single),
            curve(sweeps::PREINTEGRATED, preintegrated),
        ];
        Ok((curves, apart))
    }

    /// Interpolations, of all voxels and of every second, fourth and eighth.
    pub(super) fn interpolations(&self, base: &VdiParams, tricubic: bool) -> anyhow::Result<Vec<ErrorCurve>> {
        let how = [
            (sweeps::NEAREST, Interpolation::Nearest),
            (sweeps::TRILINEAR, Interpolation::Trilinear),
            (sweeps::TRICUBIC, Interpolation::Tricubic),
        ];
        let mut shots: Vec<Vec<(Point, Vec<[f64; 3]>)>> = vec![Vec::new(); if tricubic { 3 } else { 2 }];
        let dims = self.scalars.grid().dims();
        for every in sweeps::SPACINGS {
            // Four sample points an axis, or it is no field.
            if every > 1 && dims.iter().any(|&d| d > 1 && d < 4 * every) {
                continue;
            }
            let thinned = self.scalars.thinned(every)?;
            let with = self.integrator.with(if every == 1 { self.scalars } else { &thinned });
            for ((_, interpolation), shots) in how.iter().zip(&mut shots) {
                let method = Method { interpolation: *interpolation, ..Method::midpoint(base.step_voxels()) };
                shots.push(self.shot(&with, every as f64, &method)?);
            }
        }
        Ok(how.iter().zip(shots).map(|((knob, _), shots)| curve(*knob, shots)).collect())
    }
}

/// Whole pictures of smaller sides: how far the RMS error that they tell is from that of pictures of the full side.
pub(super) fn sample(product: &KernelsUnderTest, views: &Views, base: &VdiParams) -> anyhow::Result<ErrorCurve> {
    let vdi = product.generate(base)?;
    let vdi = PreparedVdi::new(&vdi);
    let (whole, _) = product.whole_pictures(&vdi, views.size())?;
    let mut points = Vec::new();
    for side in [16, 8, 4, 2].map(|share| views.size() / share).into_iter().filter(|&side| side >= 8) {
        let (told, time_ms) = product.whole_pictures(&vdi, side)?;
        let error = Error { rms: (told.rms - whole.rms).abs(), max: (told.max - whole.max).abs() };
        points.push(Point { params: Some(*base), ..Point::new(side.into(), error, time_ms) });
    }
    Ok(ErrorCurve { knob: sweeps::SAMPLE, points })
}
