//! What the reference of a case says.

use crate::backends::Shown;
use crate::case::{Case, Reference};
use crate::closed::{Slab, Wedge};
use lamina_model::{Camera, Ray, Vdi, Volume};
use lamina_tests::reference::{Lens, Light, Medium, bounds};
use lamina_tests::vdi_reference;
use rayon::prelude::*;

/// Light after 0, 1, 2 .. steps of a ray.
pub(crate) type Lights = Vec<Light>;

/// Pixels of one camera's picture.
pub(crate) struct View {
    pub camera: Camera,
    pub size: [u32; 2],
    pub pixels: Vec<(u32, u32)>,
}

impl View {
    pub(crate) fn shown(&self) -> Shown<'_> {
        Shown { camera: &self.camera, size: self.size, pixels: &self.pixels }
    }
}

/// The scene's view first, as many pixels as rays, then the novel ones.
pub(crate) fn views(case: &Case) -> Vec<View> {
    let r = case.resolution;
    let [left, top, right, bottom] = case.window.unwrap_or([0, 0, r, r]);
    let pixels = |[left, top, right, bottom]: [u32; 4]| {
        (top..bottom).flat_map(|j| (left..right).map(move |i| (i, j))).collect::<Vec<_>>()
    };
    let own = View { camera: case.scene.camera, size: [r, r], pixels: pixels([left, top, right, bottom]) };
    let [w, h] = case.picture;
    let novel = case.novel.iter().map(|&camera| View { camera, size: [w, h], pixels: pixels([0, 0, w, h]) });
    [own].into_iter().chain(novel).collect()
}

/// Rays that one pixel's may be taken for: its own, and where the case says so those beside it.
fn rays(case: &Case, view: &View, (i, j): (u32, u32)) -> Vec<Ray> {
    let lens = Lens::new(&view.camera, view.size[0], view.size[1]);
    let (x, y, d) = (f64::from(i) + 0.5, f64::from(j) + 0.5, case.displaced);
    let beside = [(d, d), (d, -d), (-d, d), (-d, -d), (d, 0.0), (-d, 0.0), (0.0, d), (0.0, -d)];
    let places = [(0.0, 0.0)].into_iter().chain(beside.into_iter().filter(|_| d > 0.0));
    places.map(|(a, b)| lens.ray(x + a, y + b)).collect()
}

/// Per pixel of `view`, what each of its rays sees of the volume.
pub(crate) fn of_volume(case: &Case, volume: &Volume, view: &View) -> Vec<Vec<Lights>> {
    let step = case.scene.step_length(volume.grid());
    let unit_length = case.scene.transfer.unit_length(volume.grid());
    let outside = bounds(volume);
    let size = outside[1] - outside[0];
    let of: Box<dyn Fn(&Ray) -> Lights + Sync> = match case.reference {
        Reference::March {} | Reference::Fine(_) => {
            let medium = Medium::new(volume, &case.scene);
            let parts = if let Reference::Fine(parts) = case.reference { parts } else { 1 };
            Box::new(move |ray| medium.lights(ray, step, parts))
        }
        Reference::Slab { color, opacity, low, high } => {
            let inside = [low, high].map(|share| outside[0] + size * glam::DVec3::from(share));
            let kappa = -(-opacity).ln_1p() / unit_length;
            let slab = Slab { bounds: outside, inside, color, kappa };
            Box::new(move |ray| slab.lights(ray, step))
        }
        Reference::Wedge { color, opacity, axis } => {
            let wedge = Wedge { bounds: outside, axis, color, opacity, unit_length };
            Box::new(move |ray| wedge.lights(ray, step))
        }
    };
    view.pixels.par_iter().map(|&pixel| rays(case, view, pixel).iter().map(&of).collect()).collect()
}

/// Per pixel of `view`, what each of its rays sees of the VDI.
pub(crate) fn of_vdi(case: &Case, vdi: &Vdi, view: &View) -> Vec<Vec<Lights>> {
    let of = |ray: Ray| vec![vdi_reference::light(vdi, &ray)];
    view.pixels.par_iter().map(|&pixel| rays(case, view, pixel).into_iter().map(of).collect()).collect()
}
