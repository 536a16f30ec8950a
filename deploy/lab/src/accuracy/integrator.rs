//! A plain integrator in double precision: emission and absorption along rays, nothing skipped, nothing tabulated but for
//! pre-integration. Slow: what others are compared with, and where variants of it are compared with each other.

use super::optics::Optics;
use super::scalars::{Interpolation, Scalars};
use glam::DVec3;
use lamina_model::composite::opacity_from_optical_depth;
use lamina_model::{Aabb, Ray, Scene, vdi};
use rayon::prelude::*;
use std::ops::{Add, Mul, Sub};

/// Rays end below this transmittance: 240 dB.
const FLOOR: f64 = 1e-12;

/// How a ray is integrated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Method {
    /// Sampling step in voxels.
    pub step_voxels: f64,
    /// Between sample points.
    pub interpolation: Interpolation,
    /// Steps by the integrals between their ends' values, instead of by the value in their middle.
    pub preintegrated: bool,
    /// Sums along the ray in single precision.
    pub single: bool,
}

impl Method {
    /// The midpoint rule on the trilinear field in double precision.
    pub(super) fn midpoint(step_voxels: f64) -> Self {
        Self { step_voxels, interpolation: Interpolation::Trilinear, preintegrated: false, single: false }
    }
}

/// A field seen under a scene.
pub(super) struct Integrator<'a> {
    scalars: &'a Scalars,
    optics: &'a Optics,
    bounds: Aabb,
    /// World length of one voxel of the volume.
    voxel_length: f64,
    background: [f64; 3],
}

impl<'a> Integrator<'a> {
    /// `scalars` under `scene`.
    pub(super) fn new(scalars: &'a Scalars, optics: &'a Optics, scene: &Scene) -> Self {
        let (bounds, voxel_length) = (scalars.grid().bounds(), scalars.grid().voxel_length());
        Self { scalars, optics, bounds, voxel_length, background: scene.background.map(f64::from) }
    }

    /// The same box and steps, filled by `scalars`.
    pub(super) fn with(&self, scalars: &'a Scalars) -> Self {
        Self { scalars, ..*self }
    }

    /// What is seen along each ray.
    pub(super) fn colors(&self, rays: &[Ray], method: &Method) -> Vec<[f64; 3]> {
        let color = |ray| if method.single { self.along::<f32>(ray, method) } else { self.along::<f64>(ray, method) };
        rays.par_iter().with_min_len(16).map(color).collect()
    }

    fn along<R: Real>(&self, ray: &Ray, method: &Method) -> [f64; 3] {
        let Some((t_in, t_out)) = self.bounds.clip(ray) else { return self.background };
        let grid = self.scalars.grid();
        let (origin, direction) = ((ray.origin - grid.origin()) / grid.spacing(), ray.direction / grid.spacing());
        let value = |t: f64| -> f64 {
            let index: DVec3 = origin + t * direction;
            self.scalars.at(index, method.interpolation)
        };
        let step_length = method.step_voxels * self.voxel_length;
        let mut light = Light { color: [R::of(0.0); 3], transmittance: R::of(1.0) };
        let mut front = if method.preintegrated { value(t_in) } else { 0.0 };
        for step in 0..vdi::steps(t_out - t_in, step_length) {
            let start = t_in + f64::from(step) * step_length;
            // The last step is cut at the box.
            let length = step_length.min(t_out - start);
            let (color, extinction) = if method.preintegrated {
                let back = value(start + length);
                self.optics.between(std::mem::replace(&mut front, back), back)
            } else {
                self.optics.at(value(start + 0.5 * length))
            };
            if extinction > 0.0 {
                light.add(color, extinction * length);
                if light.transmittance.wide() < FLOOR {
                    break;
                }
            }
        }
        let through = light.transmittance.wide();
        std::array::from_fn(|c| light.color[c].wide() + through * self.background[c])
    }
}

/// The numbers that a ray's sums are kept in.
trait Real: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> {
    fn of(value: f64) -> Self;
    fn wide(self) -> f64;
}

impl Real for f64 {
    fn of(value: f64) -> Self {
        value
    }
    fn wide(self) -> f64 {
        self
    }
}

impl Real for f32 {
    fn of(value: f64) -> Self {
        value as Self
    }
    fn wide(self) -> f64 {
        self.into()
    }
}

/// What a ray has gathered, front to back.
struct Light<R> {
    color: [R; 3],
    transmittance: R,
}

impl<R: Real> Light<R> {
    fn add(&mut self, color: [f64; 3], optical_depth: f64) {
        let opacity = R::of(opacity_from_optical_depth(optical_depth));
        let weight = self.transmittance * opacity;
        for (sum, c) in self.color.iter_mut().zip(color) {
            *sum = *sum + weight * R::of(c);
        }
        self.transmittance = self.transmittance * (R::of(1.0) - opacity);
    }
}
