//! What a ray through a volume sees, in plain double precision: nothing of the kernels is used, only the data itself.
//!
//! The medium is the one DESIGN and `kernel::field` describe: positions in the transfer function's range, interpolated
//! trilinearly, sampled at the midpoints of equal steps from the ray's entry into the box, a shorter last step for the rest.

use glam::DVec3;
use lamina_model::camera::CameraFields;
use lamina_model::{Camera, ControlPoint, Ray, Scale, Scene, Volume};

/// What has been gathered along a ray: premultiplied color, and the share of light from behind that comes through.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Light {
    /// Premultiplied red, green, blue.
    pub color: [f64; 3],
    /// What comes through.
    pub transmittance: f64,
}

impl Light {
    /// Nothing gathered.
    pub const CLEAR: Self = Self { color: [0.0; 3], transmittance: 1.0 };

    /// With a piece of straight `color` behind it.
    pub fn then(self, color: [f64; 3], optical_depth: f64) -> Self {
        let shown = self.transmittance * -(-optical_depth).exp_m1();
        Self {
            color: [0, 1, 2].map(|c| self.color[c] + shown * color[c]),
            transmittance: self.transmittance * (-optical_depth).exp(),
        }
    }

    /// The color in front of `background`.
    pub fn over(self, background: [f32; 3]) -> [f64; 3] {
        [0, 1, 2].map(|c| self.color[c] + self.transmittance * f64::from(background[c]))
    }
}

/// A pinhole camera and its picture, made from the camera's plain numbers.
#[derive(Debug)]
pub struct Lens {
    eye: DVec3,
    right: DVec3,
    up: DVec3,
    forward: DVec3,
    tan_half: f64,
    size: [f64; 2],
}

impl Lens {
    /// The picture of `camera`, `width` x `height` pixels.
    pub fn new(camera: &Camera, width: u32, height: u32) -> Self {
        let CameraFields { position, target, up, fov_y_deg } = (*camera).into();
        let forward = (target - position).normalize();
        let right = forward.cross(up).normalize();
        Self {
            eye: position,
            right,
            up: right.cross(forward),
            forward,
            tan_half: (fov_y_deg.to_radians() / 2.0).tan(),
            size: [width.into(), height.into()],
        }
    }

    /// The ray through picture position (`x`, `y`), pixels from the upper left.
    pub fn ray(&self, x: f64, y: f64) -> Ray {
        let per_pixel = 2.0 * self.tan_half / self.size[1];
        let (x, y) = ((x - 0.5 * self.size[0]) * per_pixel, (0.5 * self.size[1] - y) * per_pixel);
        Ray { origin: self.eye, direction: (self.forward + x * self.right + y * self.up).normalize() }
    }

    /// `p` of the world as distances to the right, up and ahead of the eye.
    pub fn seen(&self, p: DVec3) -> DVec3 {
        self.turned(p - self.eye)
    }

    /// A direction to the right, up and ahead.
    pub fn turned(&self, d: DVec3) -> DVec3 {
        DVec3::new(d.dot(self.right), d.dot(self.up), d.dot(self.forward))
    }

    /// Tangent of half the opening angle.
    pub fn tan_half(&self) -> f64 {
        self.tan_half
    }
}

/// Where `ray` is in the closed box from `low` to `high`, its origin at the earliest.
pub fn span(ray: &Ray, low: DVec3, high: DVec3) -> Option<[f64; 2]> {
    let mut span = [0.0_f64, f64::INFINITY];
    for a in 0..3 {
        let (o, d) = (ray.origin[a], ray.direction[a]);
        if d == 0.0 {
            if o < low[a] || high[a] < o {
                return None;
            }
            continue;
        }
        let ends = if d > 0.0 { [low[a], high[a]] } else { [high[a], low[a]] };
        span = [span[0].max((ends[0] - o) / d), span[1].min((ends[1] - o) / d)];
    }
    (span[0] < span[1]).then_some(span)
}

/// The box that is drawn: sample points, and half a spacing to both sides of a single layer.
pub fn bounds(volume: &Volume) -> [DVec3; 2] {
    let grid = volume.grid();
    let side = |a: usize, end: f64| {
        let n = grid.dims()[a];
        let index = if n == 1 { end - 0.5 } else { end * (n - 1) as f64 };
        grid.origin()[a] + index * grid.spacing()[a]
    };
    [0.0, 1.0].map(|end| DVec3::new(side(0, end), side(1, end), side(2, end)))
}

/// Steps of `step` that a length takes; a rest of a billionth is rounding.
pub fn steps(length: f64, step: f64) -> usize {
    (length / step - 1e-9).ceil().max(0.0) as usize
}

/// A volume under a scene.
#[derive(Debug)]
pub struct Medium {
    dims: [usize; 3],
    spacing: DVec3,
    origin: DVec3,
    bounds: [DVec3; 2],
    /// Positions in the transfer function's range; NaN is empty.
    positions: Vec<f64>,
    points: Vec<ControlPoint>,
    unit_length: f64,
}

impl Medium {
    /// `volume` as `scene` shows it.
    pub fn new(volume: &Volume, scene: &Scene) -> Self {
        let (grid, range) = (volume.grid(), scene.transfer.range());
        let position = |value: f64| match range.scale() {
            _ if !value.is_finite() => f64::NAN,
            Scale::Linear => (value - range.lo()) / (range.hi() - range.lo()),
            Scale::Log10 if value <= 0.0 => -1.0,
            Scale::Log10 => {
                let decades = |a: f64, b: f64| b.log10() - a.log10();
                (decades(range.lo(), value) / decades(range.lo(), range.hi())).max(-1.0)
            }
        };
        let least = grid.spacing().x.min(grid.spacing().y).min(grid.spacing().z);
        Self {
            dims: grid.dims(),
            spacing: grid.spacing(),
            origin: grid.origin(),
            bounds: bounds(volume),
            positions: (0..grid.voxels()).map(|n| position(volume.voxels().get(n))).collect(),
            points: scene.transfer.points().to_vec(),
            unit_length: scene.transfer.stated_unit_length().unwrap_or(least),
        }
    }

    /// What is gathered after 0, 1, 2 .. steps of `step` along `ray`, the last of which ends where it leaves the box. Each
    /// step is sampled `parts` times.
    pub fn lights(&self, ray: &Ray, step: f64, parts: usize) -> Vec<Light> {
        let mut lights = vec![Light::CLEAR];
        let Some([enter, leave]) = span(ray, self.bounds[0], self.bounds[1]) else { return lights };
        let mut light = Light::CLEAR;
        for n in 0..steps(leave - enter, step) {
            let from = enter + n as f64 * step;
            let part = step.min(leave - from) / parts as f64;
            for k in 0..parts {
                let point = ray.origin + (from + (k as f64 + 0.5) * part) * ray.direction;
                if let Some((color, opacity)) = self.looked_up(self.sampled(point)) {
                    light = light.then(color, -(-opacity).ln_1p() * (part / self.unit_length));
                }
            }
            lights.push(light);
        }
        lights
    }

    /// The trilinear value at a world point; NaN if one of the cell's eight corners is.
    fn sampled(&self, point: DVec3) -> f64 {
        let mut sides = [[(0, 0.0); 2]; 3];
        for (a, side) in sides.iter_mut().enumerate() {
            let last = self.dims[a] - 1;
            let x = ((point[a] - self.origin[a]) / self.spacing[a]).clamp(0.0, last as f64);
            let low = (x.floor() as usize).min(last.max(1) - 1);
            let w = x - low as f64;
            *side = [(low, 1.0 - w), ((low + 1).min(last), w)];
        }
        let [xs, ys, zs] = sides;
        let mut sum = 0.0;
        for (k, wz) in zs {
            for (j, wy) in ys {
                for (i, wx) in xs {
                    sum += wx * wy * wz * self.positions[(k * self.dims[1] + j) * self.dims[0] + i];
                }
            }
        }
        sum
    }

    /// Color and opacity of a unit length at position `u`; of two points at one position the later one counts there.
    fn looked_up(&self, u: f64) -> Option<([f64; 3], f64)> {
        if u.is_nan() {
            return None;
        }
        let ends = |p: &ControlPoint| (p.color, p.opacity);
        let before = self.points.iter().rev().find(|p| p.at <= u);
        let behind = self.points.iter().find(|p| p.at > u);
        let (color, opacity) = match (before, behind) {
            (Some(a), Some(b)) => {
                let w = (u - a.at) / (b.at - a.at);
                let mix = |x: f64, y: f64| (1.0 - w) * x + w * y;
                ([0, 1, 2].map(|c| mix(a.color[c], b.color[c])), mix(a.opacity, b.opacity))
            }
            (a, b) => ends(a.or(b)?),
        };
        (opacity > 0.0).then_some((color, opacity))
    }
}
