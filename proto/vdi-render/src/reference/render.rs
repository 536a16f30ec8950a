//! VDI rendering from any camera: outside the volume, inside it, or behind the generation camera.
//!
//! In each pixel of the VDI that a ray crosses, the supersegments whose depth range it meets are composited with their optical
//! depth in proportion to the length crossed. Depth planes are parallel to the generation image.

use super::frustum::{FrustumWalk, PixelCrossing};
use crate::reconstruction::{reconstruct, sharpness};
use crate::simd::magnification;
use crate::{Detail, Displacement};
use lamina_model::composite::{Accumulator, HalfDepth, TRANSMITTANCE_FLOOR};
use lamina_model::{Camera, Image, Invalid, Ray, Supersegment, Vdi};
use rayon::prelude::*;
use std::convert::Infallible;
use std::ops::ControlFlow;

/// Renders `vdi` from `camera`. The paper's I.
///
/// # Errors
/// If the picture's size is out of bounds.
#[doc(alias = "I")]
pub fn render(vdi: &Vdi, camera: &Camera, width: u32, height: u32) -> Result<Image, Invalid> {
    Image::check_size(width, height)?;
    let pixels: Vec<(u32, u32)> = (0..height).flat_map(|j| (0..width).map(move |i| (i, j))).collect();
    Image::new(width, height, render_pixels(vdi, camera, width, height, &pixels))
}

/// Renders some `pixels` (column, row) of that picture; returns their colors in order.
pub fn render_pixels(vdi: &Vdi, camera: &Camera, width: u32, height: u32, pixels: &[(u32, u32)]) -> Vec<[f32; 3]> {
    displaced_pixels(vdi, camera, [width, height], pixels, [0.0; 2])
}

/// Renders some pixels with [`Detail::Cubic`].
pub fn cubic_pixels(vdi: &Vdi, camera: &Camera, size: [u32; 2], pixels: &[(u32, u32)]) -> Vec<[f32; 3]> {
    let sharpness = sharpness(Detail::Cubic, magnification(vdi, camera, size[1])).unwrap_or_default();
    let draw = |by| Ok::<_, Infallible>(displaced_pixels(vdi, camera, size, pixels, by));
    match reconstruct(sharpness, draw) {
        Ok(colors) => colors,
        Err(never) => match never {},
    }
}

/// Renders some pixels with the VDI's image displaced.
pub fn displaced_pixels(
    vdi: &Vdi,
    camera: &Camera,
    [width, height]: [u32; 2],
    pixels: &[(u32, u32)],
    by: Displacement,
) -> Vec<[f32; 3]> {
    let depth_steps = depth_steps(vdi);
    let background = vdi.header().background;
    let color =
        |&(i, j): &(u32, u32)| trace(vdi, &depth_steps, &camera.pixel_ray(i, j, width, height), by).over(background);
    pixels.par_iter().with_min_len(64).map(color).collect()
}

/// Conversion of depth along the view to steps on one pixel's ray: `scale * depth - offset`, up to `last`.
#[derive(Clone, Copy, Default)]
struct RayDepthSteps {
    scale: f64,
    offset: f64,
    last: f64,
}

/// The conversion for every pixel that has a list.
fn depth_steps(vdi: &Vdi) -> Vec<RayDepthSteps> {
    let (header, r) = (vdi.header(), vdi.resolution());
    let steps = |n: usize| {
        let (i, j) = (n as u32 % r, n as u32 / r);
        let occupied = vdi.offsets()[n] < vdi.offsets()[n + 1];
        let Some((t_in, t_out)) = occupied.then(|| header.ray_span(i, j)).flatten() else {
            return RayDepthSteps::default();
        };
        // Depth along the view times the slant is distance along the pixel's own ray.
        let slant = header.camera.direction(f64::from(i) + 0.5, f64::from(j) + 0.5, r, r).length();
        let per_step = 1.0 / header.step_length;
        RayDepthSteps { scale: slant * per_step, offset: t_in * per_step, last: (t_out - t_in) * per_step }
    };
    (0..r as usize * r as usize).into_par_iter().with_min_len(1024).map(steps).collect()
}

/// Depth along the view of `camera` (world units) at which half of the light from behind is gone, of each pixel of a picture, row by row;
/// infinite where more comes through.
///
/// # Errors
/// If the picture's size is out of bounds.
pub fn half_depths(vdi: &Vdi, camera: &Camera, width: u32, height: u32) -> Result<Vec<f32>, Invalid> {
    Image::check_size(width, height)?;
    let depth_steps = depth_steps(vdi);
    let depth = |n: usize| {
        let ray = camera.pixel_ray(n as u32 % width, n as u32 / width, width, height);
        let mut half = HalfDepth::default();
        pieces(vdi, &depth_steps, &ray, [0.0; 2], |_, optical_depth, piece| half.add(optical_depth, piece));
        (half.distance * camera.view_from_world_direction(ray.direction).z) as f32
    };
    Ok((0..width as usize * height as usize).into_par_iter().with_min_len(64).map(depth).collect())
}

fn trace(vdi: &Vdi, depth_steps: &[RayDepthSteps], ray: &Ray, by: Displacement) -> Accumulator {
    let mut light = Accumulator::default();
    pieces(vdi, depth_steps, ray, by, |s, optical_depth, _| {
        light.add(s.color.map(f64::from), optical_depth);
        if light.transmittance < TRANSMITTANCE_FLOOR { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    });
    light
}

/// Passes what a ray meets to `visit`, front to back until it breaks: a supersegment, the optical depth of the part of it that is met,
/// and the distances between which that lies.
fn pieces(
    vdi: &Vdi,
    depth_steps: &[RayDepthSteps],
    ray: &Ray,
    by: Displacement,
    mut visit: impl FnMut(&Supersegment, f64, [f64; 2]) -> ControlFlow<()>,
) {
    if let Some(walk) = FrustumWalk::new(vdi.header(), ray, by) {
        walk.pixels(|crossing| {
            let list = vdi.list(crossing.i, crossing.j);
            if list.is_empty() {
                return ControlFlow::Continue(());
            }
            let steps = depth_steps[crossing.j as usize * vdi.resolution() as usize + crossing.i as usize];
            pieces_of_list(vdi.header().step_length, &walk, &crossing, steps, list, &mut visit)
        });
    }
}

/// The same of the part of a ray inside one pixel's frustum, which meets the pixel's list.
fn pieces_of_list(
    step_length: f64,
    walk: &FrustumWalk,
    crossing: &PixelCrossing,
    steps: RayDepthSteps,
    list: &[Supersegment],
    visit: &mut impl FnMut(&Supersegment, f64, [f64; 2]) -> ControlFlow<()>,
) -> ControlFlow<()> {
    let steps_at = |s: f64| walk.depth(s) * steps.scale - steps.offset;
    let (a, b) = (steps_at(crossing.from), steps_at(crossing.to));
    let (near, far) = (a.min(b), a.max(b));
    // A part along a depth plane lies in one supersegment as a whole.
    let flat = far - near <= 1e-12 * far.abs();
    let first = list.partition_point(|s| f64::from(s.end) <= near);
    let is_met = |s: &Supersegment| if flat { f64::from(s.start) <= far } else { f64::from(s.start) < far };
    let met = &list[first..first + list[first..].partition_point(is_met)];
    let mut add = |s: &Supersegment| {
        // The last step of a ray is cut at the box.
        let (start, end) = (f64::from(s.start), f64::from(s.end).min(steps.last));
        let share = if flat { 1.0 } else { (end.min(far) - start.max(near)).max(0.0) / (far - near) };
        let length = share * (crossing.to - crossing.from);
        let whole = (end - start) * step_length;
        if length <= 0.0 || whole <= 0.0 {
            return ControlFlow::Continue(());
        }
        // From where its nearer end is met.
        let met = if b >= a { start.max(near) } else { end.min(far) };
        let before = if flat { 0.0 } else { (met - a) / (b - a) * (crossing.to - crossing.from) };
        let from = crossing.from + before;
        visit(s, f64::from(s.optical_depth) * (length / whole), [from, from + length])
    };
    if b >= a { met.iter().try_for_each(&mut add) } else { met.iter().rev().try_for_each(&mut add) }
}
