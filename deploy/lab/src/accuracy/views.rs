//! From where quality is looked at, and which pixels are sampled there.

use lamina_model::{Camera, Invalid, Ray, SamplePlan, Scene};

/// Blocks along each side of a picture that each give one pixel a batch.
const BLOCKS: u32 = 16;

/// The sampled pixels of the test views of a scene.
pub(super) struct Views {
    plan: SamplePlan,
    cameras: Vec<Camera>,
    pixels: Vec<Vec<(u32, u32)>>,
}

impl Views {
    /// Some 3000 pixels of pictures of side `size`, from the product's test views.
    ///
    /// # Errors
    /// If the size is out of bounds.
    pub(super) fn new(scene: &Scene, size: u32) -> Result<Self, Invalid> {
        let tile = size.div_ceil(BLOCKS).max(1);
        let batches = if tile == 1 { 1 } else { 2 };
        let plan = SamplePlan { image_size: size, tile, batches, ..SamplePlan::default() }.check()?;
        let cameras = plan.test_cameras(&scene.camera)?;
        let pixels = (0..cameras.len()).map(|v| (0..batches).flat_map(|b| plan.pixels(v, b)).collect()).collect();
        Ok(Self { plan, cameras, pixels })
    }

    /// Side of the pictures.
    pub(super) fn size(&self) -> u32 {
        self.plan.image_size
    }
    /// The test cameras.
    pub(super) fn cameras(&self) -> &[Camera] {
        &self.cameras
    }
    /// The camera that whole pictures are timed from.
    pub(super) fn middle(&self) -> &Camera {
        &self.cameras[self.cameras.len() / 2]
    }
    /// Whole pictures that as many rays as are sampled would fill.
    pub(super) fn pictures(&self) -> f64 {
        let rays: usize = self.pixels.iter().map(Vec::len).sum();
        rays as f64 / f64::from(self.size()).powi(2)
    }

    /// The rays of all sampled pixels, view by view.
    pub(super) fn rays(&self) -> Vec<Ray> {
        let of = |(camera, pixels): (&Camera, &Vec<(u32, u32)>)| -> Vec<Ray> {
            pixels.iter().map(|&(i, j)| camera.pixel_ray(i, j, self.size(), self.size())).collect()
        };
        self.cameras.iter().zip(&self.pixels).flat_map(of).collect()
    }

    /// What `see` gives for the sampled pixels of each view, in the order of [`Self::rays`].
    ///
    /// # Errors
    /// As `see` fails.
    pub(super) fn gather(
        &self,
        see: impl Fn(&Camera, &[(u32, u32)]) -> anyhow::Result<Vec<[f32; 3]>>,
    ) -> anyhow::Result<Vec<[f32; 3]>> {
        let mut colors = Vec::new();
        for (camera, pixels) in self.cameras.iter().zip(&self.pixels) {
            colors.extend(see(camera, pixels)?);
        }
        Ok(colors)
    }
}
