//! What a ray through a VDI sees, in plain double precision: no walk, no skipping. All places where the ray crosses a
//! boundary of the image's columns and rows are computed and sorted; between two of them it is in one pixel.

use crate::reference::{Lens, Light, span};
use lamina_model::{Ray, Supersegment, Vdi};

/// Stretches shorter than this, relative to the whole way, are rounding.
const HAIR: f64 = 1e-12;

/// What `ray` gathers in `vdi`: each supersegment's optical depth in proportion to the length crossed, between depth
/// planes parallel to the generation image, in the pyramid of its pixel.
pub fn light(vdi: &Vdi, ray: &Ray) -> Light {
    let (header, r) = (vdi.header(), vdi.resolution());
    let lens = Lens::new(&header.camera, r, r);
    let Some([enter, leave]) = span(ray, header.bounds.min, header.bounds.max) else { return Light::CLEAR };
    let (o, d, h) = (lens.seen(ray.origin), lens.turned(ray.direction), lens.tan_half());
    let mut places = vec![enter, leave, -o.z / d.z];
    for k in 0..=r {
        let f = h * (2.0 * f64::from(k) / f64::from(r) - 1.0);
        places.extend([(f * o.z - o.x) / (d.x - f * d.z), (f * o.z - o.y) / (d.y - f * d.z)]);
    }
    places.retain(|s| enter <= *s && *s <= leave);
    places.sort_by(f64::total_cmp);
    let mut light = Light::CLEAR;
    for stretch in places.windows(2) {
        let (from, to) = (stretch[0], stretch[1]);
        if to - from <= HAIR * (leave - enter) {
            continue;
        }
        let middle = o + 0.5 * (from + to) * d;
        let [column, row] = [middle.x, -middle.y].map(|x| (0.5 * (x / (h * middle.z) + 1.0) * f64::from(r)).floor());
        let inside = |k: f64| 0.0 <= k && k < f64::from(r);
        if middle.z > 0.0 && inside(column) && inside(row) {
            let stretch = Stretch { from, to, z: [o.z, d.z] };
            light = in_pixel(vdi, &lens, [column as u32, row as u32], &stretch, light);
        }
    }
    light
}

/// A part of a ray, whose depth at distance s is `z[0] + s z[1]`.
struct Stretch {
    from: f64,
    to: f64,
    z: [f64; 2],
}

fn in_pixel(vdi: &Vdi, lens: &Lens, [i, j]: [u32; 2], stretch: &Stretch, before: Light) -> Light {
    let (list, step) = (vdi.list(i, j), vdi.header().step_length);
    let own = lens.ray(f64::from(i) + 0.5, f64::from(j) + 0.5);
    let Some([enter, leave]) = span(&own, vdi.header().bounds.min, vdi.header().bounds.max) else { return before };
    // Steps on the pixel's own ray at distance s: depth over the share of its direction that points ahead.
    let ahead = lens.turned(own.direction).z;
    let steps = |s: f64| ((stretch.z[0] + s * stretch.z[1]) / ahead - enter) / step;
    let (a, b) = (steps(stretch.from), steps(stretch.to));
    let (near, far) = (a.min(b), a.max(b));
    let flat = far - near <= HAIR * far.abs().max(1.0);
    let piece = |light: Light, s: &Supersegment| {
        let (start, end) = (f64::from(s.start), f64::from(s.end).min((leave - enter) / step));
        let share = match flat {
            true => f64::from(u8::from(start <= near && near < end)),
            false => (end.min(far) - start.max(near)).max(0.0) / (far - near),
        };
        let met = share * (stretch.to - stretch.from);
        let whole = (end - start) * step;
        if met <= 0.0 || whole <= 0.0 {
            return light;
        }
        light.then(s.color.map(f64::from), f64::from(s.optical_depth) * (met / whole))
    };
    if stretch.z[1] >= 0.0 { list.iter().fold(before, piece) } else { list.iter().rev().fold(before, piece) }
}
