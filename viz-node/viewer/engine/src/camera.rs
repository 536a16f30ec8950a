//! Cameras as a person moves them: relative to the recorded one.

use glam::DQuat;
use lamina_model::{Camera, Invalid};
use serde::{Deserialize, Serialize};

/// A position relative to the recorded camera.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Pose {
    /// Turn about the up vector, degrees.
    pub azimuth: f64,
    /// Lift, degrees, at most 89 either way.
    pub elevation: f64,
    /// The distance is divided by this.
    pub zoom: f64,
    /// Shift of camera and target to the right, up and ahead, in heights of the picture at the target.
    pub shift: [f64; 3],
    /// Turn of the picture about its center, degrees, clockwise as seen.
    pub roll: f64,
}

impl Default for Pose {
    fn default() -> Self {
        Self { azimuth: 0.0, elevation: 0.0, zoom: 1.0, shift: [0.0; 3], roll: 0.0 }
    }
}

impl Pose {
    /// The camera there.
    ///
    /// # Errors
    /// If a number is not finite or the zoom is not positive.
    pub fn camera(&self, recorded: &Camera) -> Result<Camera, Invalid> {
        let camera = recorded.orbit(self.azimuth, self.elevation, self.zoom)?;
        if self.shift == [0.0; 3] && self.roll == 0.0 {
            return Ok(camera);
        }
        let (position, target) = (camera.position(), camera.target());
        let arm = target - position;
        let forward = arm.normalize();
        let middle = camera.direction(0.5, 0.5, 1, 1);
        let up = (camera.direction(0.5, 0.0, 1, 1) - middle).normalize();
        let right = forward.cross(up);
        let height = 2.0 * camera.tan_half_fov() * arm.length();
        let shift = (right * self.shift[0] + up * self.shift[1] + forward * self.shift[2]) * height;
        let roll = DQuat::from_axis_angle(forward, -self.roll.to_radians());
        Camera::new(position + shift, target + shift, roll * up, camera.fov_y_deg())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    fn front() -> Camera {
        Camera::new(DVec3::new(0.0, 0.0, 5.0), DVec3::ZERO, DVec3::Y, 90.0).expect("a camera")
    }

    #[test]
    fn no_movement_is_the_recorded_camera() {
        assert_eq!(Pose::default().camera(&front()).expect("a camera"), front());
    }

    #[test]
    fn a_shift_by_one_half_brings_the_rim_to_the_middle() {
        // At 90 degrees and distance 5, the picture is 10 high at the target.
        let moved = Pose { shift: [0.5, -0.25, 0.75], ..Pose::default() }.camera(&front()).expect("a camera");
        assert!((moved.target() - DVec3::new(5.0, -2.5, -7.5)).length() < 1e-12);
        assert!((moved.position() - DVec3::new(5.0, -2.5, -2.5)).length() < 1e-12);
    }

    #[test]
    fn a_quarter_roll_turns_the_picture_clockwise() {
        let rolled = Pose { roll: 90.0, ..Pose::default() }.camera(&front()).expect("a camera");
        // What was at the top is now at the right.
        let top = rolled.view_from_world_direction(DVec3::Y);
        assert!((top - DVec3::X).length() < 1e-12, "{top}");
    }

    #[test]
    fn absurd_numbers_are_refused() {
        for pose in [
            Pose { zoom: 0.0, ..Pose::default() },
            Pose { azimuth: f64::NAN, ..Pose::default() },
            Pose { shift: [f64::INFINITY, 0.0, 0.0], ..Pose::default() },
            Pose { roll: f64::NAN, ..Pose::default() },
        ] {
            assert!(pose.camera(&front()).is_err(), "{pose:?}");
        }
    }
}
