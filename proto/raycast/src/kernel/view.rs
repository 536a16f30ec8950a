//! View uniforms: rays that start on the plane through the box's nearest corner, in units of sample points and steps.
//!
//! A distant camera has coordinates so large that single precision would shift its rays by a voxel; on that plane they are as
//! small as the box. Computed once per picture, in double precision.

use super::field::TableFacts;
use super::layout::ViewUniforms;
use crate::Field;
use glam::DVec3;
use lamina_model::Camera;

/// Depth, along the camera's axis, of the plane on which rays start: that of the box's nearest corner.
pub(crate) fn nearest_depth(field: &Field, camera: &Camera) -> f64 {
    let corners = field.grid().bounds().corners();
    corners.map(|c| camera.view_from_world(c).z).into_iter().fold(f64::INFINITY, f64::min).max(0.0)
}

impl ViewUniforms {
    /// The rays of `camera` through a `width` x `height` picture of `field`, sampled with the step length of `tables`.
    pub(crate) fn new(field: &Field, camera: &Camera, width: u32, height: u32, tables: &TableFacts) -> Self {
        let step_length = tables.step_length;
        let near = nearest_depth(field, camera);
        let (center_x, center_y) = (0.5 * f64::from(width), 0.5 * f64::from(height));
        let forward = camera.direction(center_x, center_y, width, height);
        // Change per half pixel, from a span as long as the picture is high, to limit cancellation.
        let half_height = f64::from(height);
        let right = (camera.direction(center_x + 0.5 * half_height, center_y, width, height) - forward) / half_height;
        let up = (camera.direction(center_x, center_y - 0.5 * half_height, width, height) - forward) / half_height;
        let step = |world: DVec3| (world * (step_length / field.grid().spacing())).as_vec3().to_array();
        let shift = |world: DVec3| (world * (near / field.grid().spacing())).as_vec3().to_array();
        Self {
            base: field.index_from_world(camera.position() + near * forward).as_vec3().to_array(),
            width,
            base_right: shift(right),
            height,
            base_up: shift(up),
            slope: (camera.tan_half_fov() / half_height) as f32,
            forward: step(forward),
            unit_steps: (field.unit_length() / step_length) as f32,
            right: step(right),
            bins: tables.bins,
            up: step(up),
            below: tables.below,
            visible: tables.visible,
            near: (near / step_length) as f32,
            pad0: 0,
        }
    }
}
