//! What casts rays, and what draws: the oracles, all levels of lanes, the GPU where there is one.

use lamina_compute::gpu::{Gpu, testing};
use lamina_model::composite::TRANSMITTANCE_FLOOR;
use lamina_model::{Camera, Segmentation, Vdi, VdiParams};
use lamina_raycast::gpu::{GpuError as CastError, GpuKernels as CastKernels};
use lamina_raycast::simd::{self, Level, Shot};
use lamina_raycast::{Field, reference};
use lamina_vdi_render::gpu::{GpuError as DrawError, GpuKernels as DrawKernels};
use lamina_vdi_render::{Detail, PreparedVdi, reference as drawn};

/// Colors of pixels, or why there are none.
pub(crate) type Colors = Result<Vec<[f32; 3]>, String>;

/// Pixels of a picture from a camera.
pub(crate) struct Shown<'a> {
    pub camera: &'a Camera,
    pub size: [u32; 2],
    pub pixels: &'a [(u32, u32)],
}

/// What runs: an oracle, a level of lanes, or a GPU with its kernels.
pub(crate) enum Backend<Kernels> {
    Scalar,
    Lanes(Level),
    Gpu(Kernels),
}

/// Casts rays through volumes.
pub(crate) type Caster = Backend<CastKernels>;

/// Draws VDIs.
pub(crate) type Drawer = Backend<DrawKernels>;

pub(crate) fn casters() -> Vec<Caster> {
    Backend::all(|gpu| CastKernels::new(gpu).unwrap())
}

pub(crate) fn drawers() -> Vec<Drawer> {
    Backend::all(|gpu| DrawKernels::new(gpu).unwrap())
}

impl<Kernels> Backend<Kernels> {
    /// All that this machine has.
    fn all(kernels: impl FnOnce(Gpu) -> Kernels) -> Vec<Self> {
        let gpu = testing::gpu().map(|gpu| Self::Gpu(kernels(gpu)));
        let lanes = Level::available().into_iter().map(Self::Lanes);
        [Self::Scalar].into_iter().chain(lanes).chain(gpu).collect()
    }

    pub(crate) fn kind(&self) -> String {
        match self {
            Self::Scalar => "scalar".to_owned(),
            Self::Lanes(level) => format!("lanes {level:?}"),
            Self::Gpu(_) => "gpu".to_owned(),
        }
    }
}

impl Caster {
    /// As its rows are called: "R" and its kind.
    pub(crate) fn name(&self) -> String {
        format!("R {}", self.kind())
    }

    /// The colors of some pixels, by the path for whole pictures where all are asked for.
    pub(crate) fn raycast(&self, field: &Field, shown: &Shown) -> Colors {
        let Shown { camera, size: [w, h], pixels } = *shown;
        let whole = pixels.len() == w as usize * h as usize;
        match self {
            Self::Scalar if whole => Ok(reference::raycast(field, camera, w, h).unwrap().pixels().to_vec()),
            Self::Scalar => Ok(reference::raycast_pixels(field, camera, w, h, pixels)),
            Self::Lanes(level) => {
                fits(field)?;
                let shot = Shot { camera, size: [w, h], floor: TRANSMITTANCE_FLOOR as f32 };
                Ok(if whole {
                    simd::raycast(*level, field, &shot)
                } else {
                    simd::raycast_pixels(*level, field, &shot, pixels)
                })
            }
            Self::Gpu(gpu) if whole => {
                gpu.raycast(field, camera, w, h).map(|image| image.pixels().to_vec()).map_err(too_large)
            }
            Self::Gpu(gpu) => gpu.raycast_pixels(field, camera, w, h, pixels).map_err(too_large),
        }
    }

    pub(crate) fn generate(
        &self,
        field: &Field,
        params: &VdiParams,
        segmentation: Segmentation,
    ) -> Result<Vdi, String> {
        match self {
            Self::Scalar => Ok(reference::generate(field, params, segmentation).unwrap()),
            Self::Lanes(level) => {
                fits(field)?;
                Ok(simd::generate(*level, field, params, segmentation).unwrap())
            }
            Self::Gpu(gpu) => gpu.generate(field, params, segmentation).map(|(vdi, _)| vdi).map_err(too_large),
        }
    }
}

fn fits(field: &Field) -> Result<(), String> {
    if simd::fits(field) { Ok(()) } else { Err("lanes need two sample points on every axis".to_owned()) }
}

fn too_large(error: CastError) -> String {
    assert!(matches!(error, CastError::TooLarge { .. }), "{error}");
    error.to_string()
}

impl Drawer {
    /// As its rows are called: "I" and its kind.
    pub(crate) fn name(&self) -> String {
        format!("I {}", self.kind())
    }

    /// The colors of some pixels, by the path for whole pictures where all are asked for.
    pub(crate) fn render(&self, vdi: &Vdi, prepared: &PreparedVdi<&Vdi>, shown: &Shown) -> Colors {
        let Shown { camera, size: [w, h], pixels } = *shown;
        let whole = pixels.len() == w as usize * h as usize;
        match self {
            Self::Scalar if whole => Ok(drawn::render(vdi, camera, w, h).unwrap().pixels().to_vec()),
            Self::Scalar => Ok(drawn::render_pixels(vdi, camera, w, h, pixels)),
            Self::Lanes(_) if whole => Ok(prepared.render(camera, w, h).unwrap().pixels().to_vec()),
            Self::Lanes(_) => Ok(prepared.pixels(camera, [w, h], pixels, Detail::Nearest)),
            Self::Gpu(gpu) if whole => {
                gpu.picture(prepared, camera, [w, h], Detail::Nearest).map_err(too_large_to_draw)
            }
            Self::Gpu(gpu) => gpu.pixels(prepared, camera, [w, h], pixels, Detail::Nearest).map_err(too_large_to_draw),
        }
    }

    /// What drawing needs, prepared for this backend.
    pub(crate) fn prepare<'a>(&self, vdi: &'a Vdi) -> PreparedVdi<&'a Vdi> {
        let prepared = PreparedVdi::new(vdi);
        if let Self::Lanes(level) = self { prepared.at_level(*level) } else { prepared }
    }
}

fn too_large_to_draw(error: DrawError) -> String {
    assert!(matches!(error, DrawError::TooLarge { .. }), "{error}");
    error.to_string()
}
