//! Pinhole cameras, rays and boxes.

use crate::Invalid;
use glam::DVec3;
use serde::{Deserialize, Serialize};

/// A half line from `origin` along the unit vector `direction`, in world units.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray {
    /// Where it starts.
    pub origin: DVec3,
    /// Where it goes; length 1.
    pub direction: DVec3,
}

impl Ray {
    /// The point at distance `t`.
    pub fn at(&self, t: f64) -> DVec3 {
        self.origin + t * self.direction
    }
}

/// An axis-aligned box in world units, closed, with `min <= max` on every axis.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Aabb {
    /// Lower corner.
    pub min: DVec3,
    /// Upper corner.
    pub max: DVec3,
}

impl Aabb {
    /// The box between two corners.
    ///
    /// # Errors
    /// If a corner is not finite or `min` exceeds `max` on an axis.
    pub fn new(min: DVec3, max: DVec3) -> Result<Self, Invalid> {
        if !(min.is_finite() && max.is_finite()) || min.cmpgt(max).any() {
            return Err(Invalid::new("box", format!("corners {min} and {max} must be finite, the lower one first")));
        }
        Ok(Self { min, max })
    }

    /// The center.
    pub fn center(&self) -> DVec3 {
        0.5 * (self.min + self.max)
    }

    /// All eight.
    pub fn corners(&self) -> [DVec3; 8] {
        std::array::from_fn(|n| {
            DVec3::from_array([0, 1, 2].map(|a| if n >> a & 1 == 0 { self.min } else { self.max }[a]))
        })
    }

    /// Edge lengths.
    pub fn size(&self) -> DVec3 {
        self.max - self.min
    }

    /// The distances at which `ray` enters and leaves the box, not before its origin; `None` if it misses or only touches.
    ///
    /// Slab test. A ray that lies in a slab's plane direction (component 0) is inside that slab or misses it, so no
    /// product of 0 and infinity is ever formed.
    #[inline]
    pub fn clip(&self, ray: &Ray) -> Option<(f64, f64)> {
        let (mut t_in, mut t_out) = (0.0_f64, f64::INFINITY);
        for axis in 0..3 {
            let (o, d) = (ray.origin[axis], ray.direction[axis]);
            if d == 0.0 {
                if o < self.min[axis] || o > self.max[axis] {
                    return None;
                }
                continue;
            }
            let (a, b) = ((self.min[axis] - o) / d, (self.max[axis] - o) / d);
            t_in = t_in.max(a.min(b));
            t_out = t_out.min(a.max(b));
        }
        (t_in < t_out && t_out.is_finite()).then_some((t_in, t_out))
    }
}

/// A pinhole camera. The paper's P_A (generation) and P_I (novel view).
#[doc(alias = "P_A")]
#[doc(alias = "P_I")]
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "CameraFields", into = "CameraFields")]
pub struct Camera {
    position: DVec3,
    target: DVec3,
    up: DVec3,
    fov_y_deg: f64,
    right: DVec3,
    true_up: DVec3,
    forward: DVec3,
    tan_half: f64,
}

/// A camera as written in files and on the wire.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraFields {
    /// The eye, world units.
    pub position: DVec3,
    /// The point looked at, world units.
    pub target: DVec3,
    /// A vector that shows upwards in the image; any length.
    pub up: DVec3,
    /// Full vertical opening angle, degrees.
    pub fov_y_deg: f64,
}

impl TryFrom<CameraFields> for Camera {
    type Error = Invalid;
    fn try_from(f: CameraFields) -> Result<Self, Invalid> {
        Self::new(f.position, f.target, f.up, f.fov_y_deg)
    }
}

impl From<Camera> for CameraFields {
    fn from(c: Camera) -> Self {
        Self { position: c.position, target: c.target, up: c.up, fov_y_deg: c.fov_y_deg }
    }
}

impl Camera {
    /// A camera at `position` that looks at `target`; `fov_y_deg` is the full vertical angle in degrees.
    ///
    /// # Errors
    /// If a number is not finite, the eye is the target, up is parallel to the view, or the angle is outside (0, 180).
    pub fn new(position: DVec3, target: DVec3, up: DVec3, fov_y_deg: f64) -> Result<Self, Invalid> {
        if !(position.is_finite() && target.is_finite() && up.is_finite()) {
            return Err(Invalid::new("camera", "position, target and up must be finite numbers"));
        }
        let view = target - position;
        let scale = position.abs().max_element().max(target.abs().max_element());
        if view.length() <= scale * 1e-12 {
            return Err(Invalid::new("camera.position", format!("equals camera.target ({target}); move one of them")));
        }
        let forward = view.normalize();
        let side = forward.cross(up.normalize_or_zero());
        if side.length() < 1e-9 {
            return Err(Invalid::new("camera.up", format!("{up} is zero or parallel to the view direction {forward}")));
        }
        if !(fov_y_deg > 0.0 && fov_y_deg < 180.0) {
            return Err(Invalid::new("camera.fov_y_deg", format!("{fov_y_deg} must lie between 0 and 180 degrees")));
        }
        let right = side.normalize();
        let tan_half = (0.5 * fov_y_deg.to_radians()).tan();
        Ok(Self { position, target, up, fov_y_deg, right, true_up: right.cross(forward), forward, tan_half })
    }

    /// The eye, world units.
    pub fn position(&self) -> DVec3 {
        self.position
    }
    /// The point looked at, world units.
    pub fn target(&self) -> DVec3 {
        self.target
    }
    /// Full vertical opening angle, degrees.
    pub fn fov_y_deg(&self) -> f64 {
        self.fov_y_deg
    }
    /// Tangent of half the vertical opening angle.
    #[inline]
    pub fn tan_half_fov(&self) -> f64 {
        self.tan_half
    }

    /// `point` in this camera's frame: x to the right, y up, z along the view.
    pub fn view_from_world(&self, point: DVec3) -> DVec3 {
        self.view_from_world_direction(point - self.position)
    }

    /// A direction in this camera's frame.
    #[inline]
    pub fn view_from_world_direction(&self, d: DVec3) -> DVec3 {
        DVec3::new(d.dot(self.right), d.dot(self.true_up), d.dot(self.forward))
    }

    /// The direction, with component 1 along the view, through image position (`x`, `y`) in pixels from the upper left
    /// of a `width` x `height` image. Pixel (i, j) has its center at (i + 0.5, j + 0.5).
    #[inline]
    pub fn direction(&self, x: f64, y: f64, width: u32, height: u32) -> DVec3 {
        let (w, h) = (f64::from(width), f64::from(height));
        let sx = self.tan_half * (2.0 * x - w) / h;
        let sy = self.tan_half * (h - 2.0 * y) / h;
        self.forward + sx * self.right + sy * self.true_up
    }

    /// The ray through the center of pixel (`i`, `j`).
    #[inline]
    pub fn pixel_ray(&self, i: u32, j: u32, width: u32, height: u32) -> Ray {
        let direction = self.direction(f64::from(i) + 0.5, f64::from(j) + 0.5, width, height).normalize();
        Ray { origin: self.position, direction }
    }

    /// This camera turned by `angle_deg` about the world's +y axis through its target.
    ///
    /// # Errors
    /// If the angle is not finite.
    pub fn rotated_about_y(&self, angle_deg: f64) -> Result<Self, Invalid> {
        let turn = glam::DQuat::from_rotation_y(angle_deg.to_radians());
        Self::new(self.target + turn * (self.position - self.target), self.target, turn * self.up, self.fov_y_deg)
    }

    /// This camera moved on a sphere about its target: `azimuth_deg` to the right about its up vector, `elevation_deg`
    /// upwards (kept within 89 degrees of the start), its distance divided by `zoom`.
    ///
    /// # Errors
    /// If a number is not finite or `zoom` is not positive.
    pub fn orbit(&self, azimuth_deg: f64, elevation_deg: f64, zoom: f64) -> Result<Self, Invalid> {
        if !(zoom.is_finite() && zoom > 0.0) {
            return Err(Invalid::new("zoom", format!("{zoom} must be a positive number")));
        }
        let lift = glam::DQuat::from_axis_angle(self.right, -elevation_deg.clamp(-89.0, 89.0).to_radians());
        let turn = glam::DQuat::from_axis_angle(self.true_up, azimuth_deg.to_radians());
        let arm = turn * (lift * (self.position - self.target)) / zoom;
        Self::new(self.target + arm, self.target, turn * (lift * self.true_up), self.fov_y_deg)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn front() -> Camera {
        Camera::new(DVec3::new(0.0, 0.0, 5.0), DVec3::ZERO, DVec3::Y, 90.0).unwrap()
    }

    #[test]
    fn the_corner_pixels_lie_on_the_edges_of_the_field_of_view() {
        // fov 90 degrees: the image's upper left corner is the direction (-1, 1, -1).
        assert!((front().direction(0.0, 0.0, 8, 8) - DVec3::new(-1.0, 1.0, -1.0)).length() < 1e-12);
        assert!((front().direction(16.0, 8.0, 16, 8) - DVec3::new(2.0, -1.0, -1.0)).length() < 1e-12);
    }

    #[test]
    fn degenerate_cameras_are_refused_by_name() {
        let e = |p, t, u, f| Camera::new(p, t, u, f).unwrap_err().thing;
        assert_eq!(e(DVec3::ONE, DVec3::ONE, DVec3::Y, 30.0), "camera.position");
        assert_eq!(e(DVec3::Y, DVec3::ZERO, DVec3::Y, 30.0), "camera.up");
        assert_eq!(e(DVec3::Z, DVec3::ZERO, DVec3::Y, 180.0), "camera.fov_y_deg");
        assert_eq!(e(DVec3::Z, DVec3::ZERO, DVec3::Y, f64::NAN), "camera.fov_y_deg");
        assert_eq!(e(DVec3::NAN, DVec3::ZERO, DVec3::Y, 30.0), "camera");
    }

    #[test]
    fn a_turn_of_ninety_degrees_about_y_moves_the_eye_from_z_to_x() {
        let c = front().rotated_about_y(90.0).unwrap();
        assert!((c.position() - DVec3::new(5.0, 0.0, 0.0)).length() < 1e-12);
        let o = front().orbit(90.0, 0.0, 2.0).unwrap();
        assert!((o.position() - DVec3::new(2.5, 0.0, 0.0)).length() < 1e-12);
        assert!(front().orbit(0.0, 30.0, 1.0).unwrap().position().y > 2.0);
    }

    #[test]
    fn clipping_handles_grazing_parallel_and_inside_rays() {
        let b = Aabb::new(DVec3::ZERO, DVec3::ONE).unwrap();
        let ray = |o: [f64; 3], d: [f64; 3]| Ray { origin: o.into(), direction: DVec3::from(d).normalize() };
        assert_eq!(b.clip(&ray([0.5, 0.5, -1.0], [0.0, 0.0, 1.0])), Some((1.0, 2.0)));
        assert_eq!(b.clip(&ray([0.5, 0.5, 0.5], [0.0, 0.0, 1.0])), Some((0.0, 0.5)));
        assert_eq!(b.clip(&ray([0.5, 0.5, 2.0], [0.0, 0.0, 1.0])), None);
        assert_eq!(b.clip(&ray([0.0, 0.0, -1.0], [0.0, 0.0, 1.0])), Some((1.0, 2.0)));
        assert_eq!(b.clip(&ray([-0.1, 0.0, -1.0], [0.0, 0.0, 1.0])), None);
        assert_eq!(b.clip(&ray([-1.0, 1.0, 0.5], [1.0, -1.0, 0.0])), b.clip(&ray([-1.0, 1.0, 0.5], [1.0, -1.0, 0.0])));
    }
}
