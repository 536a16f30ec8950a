//! Reference pictures: emission-absorption ray casting of the field.

use super::march::RayMarcher;
use crate::Field;
use lamina_model::composite::{Accumulator, HalfDepth, TRANSMITTANCE_FLOOR};
use lamina_model::{Camera, Image, Invalid, Ray};
use rayon::prelude::*;
use std::ops::ControlFlow;

/// Casts a whole picture of `field`, `width` x `height` pixels.
///
/// # Errors
/// If the picture's size is out of bounds.
#[doc(alias = "reference image")]
pub fn raycast(field: &Field, camera: &Camera, width: u32, height: u32) -> Result<Image, Invalid> {
    Image::check_size(width, height)?;
    let pixels: Vec<(u32, u32)> = (0..height).flat_map(|j| (0..width).map(move |i| (i, j))).collect();
    Image::new(width, height, raycast_pixels(field, camera, width, height, &pixels))
}

/// Casts some `pixels` (column, row) of that picture; returns their colors in order.
pub fn raycast_pixels(field: &Field, camera: &Camera, width: u32, height: u32, pixels: &[(u32, u32)]) -> Vec<[f32; 3]> {
    let scene = field.scene();
    let march = RayMarcher::new(field, scene.step_length(field.grid()));
    let color = |&(i, j): &(u32, u32)| cast(&march, &camera.pixel_ray(i, j, width, height)).over(scene.background);
    pixels.par_iter().with_min_len(64).map(color).collect()
}

/// The same without a background: premultiplied color and transmittance of what the field has in its own cells.
pub fn raycast_layers(field: &Field, camera: &Camera, width: u32, height: u32, pixels: &[(u32, u32)]) -> Vec<[f32; 4]> {
    let march = RayMarcher::new(field, field.scene().step_length(field.grid()));
    let layer = |&(i, j): &(u32, u32)| {
        let light = cast(&march, &camera.pixel_ray(i, j, width, height));
        let [r, g, b] = light.over([0.0; 3]);
        [r, g, b, light.transmittance as f32]
    };
    pixels.par_iter().with_min_len(64).map(layer).collect()
}

/// Depth along the view (world units) at which half of the light from behind is gone, of each pixel of a picture, row by row; infinite
/// where more comes through.
///
/// # Errors
/// If the picture's size is out of bounds.
pub fn half_depths(field: &Field, camera: &Camera, width: u32, height: u32) -> Result<Vec<f32>, Invalid> {
    Image::check_size(width, height)?;
    let march = RayMarcher::new(field, field.scene().step_length(field.grid()));
    let depth = |n: usize| {
        let ray = camera.pixel_ray(n as u32 % width, n as u32 / width, width, height);
        let entry = march.bounds.clip(&ray).map_or(0.0, |(entry, _)| entry);
        let mut half = HalfDepth::default();
        march.samples(&ray, |s| {
            let from = entry + f64::from(s.step) * march.step_length;
            half.add(s.classified.extinction * s.length, [from, from + s.length])
        });
        (half.distance * camera.view_from_world_direction(ray.direction).z) as f32
    };
    Ok((0..width as usize * height as usize).into_par_iter().with_min_len(64).map(depth).collect())
}

fn cast(march: &RayMarcher, ray: &Ray) -> Accumulator {
    let mut light = Accumulator::default();
    march.samples(ray, |s| {
        light.add(s.classified.color, s.classified.extinction * s.length);
        if light.transmittance < TRANSMITTANCE_FLOOR { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    });
    light
}
