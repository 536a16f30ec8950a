//! The WGSL kernels and all that they read, as bytes: for this crate's host code ([`crate::gpu`]) and for devices opened elsewhere,
//! as a browser's ([`VolumeKernel`]).

pub(crate) mod effects;
pub(crate) mod field;
pub(crate) mod layout;
pub(crate) mod view;

use crate::Field;
use crate::volume::transfer_lut::PreintegrationTable;
use bytemuck::cast_slice;
use effects::EffectSet;
use field::TableFacts;
use lamina_compute::kernel::{Binding, TexelFormat};
use lamina_model::Camera;
use lamina_model::composite::TRANSMITTANCE_FLOOR;
use layout::{PictureUniforms, ViewUniforms};

/// The source of a kernel that marches.
macro_rules! march {
    ($($kernel:literal),+) => {
        concat!(
            include_str!("layout.wgsl"),
            include_str!("leaf.wgsl"),
            include_str!("march.wgsl"),
            include_str!("effects.wgsl"),
            $(include_str!($kernel)),+
        )
    };
}

pub(crate) const RAYCAST: &str = march!("raycast.wgsl", "../../../compute/src/gpu/color_pass.wgsl");
pub(crate) const GENERATE: &str = march!("generate.wgsl");
pub(crate) const SCAN: &str = concat!(include_str!("layout.wgsl"), include_str!("scan.wgsl"));

/// Pictures of one field, cast by a device that the caller drives.
///
/// [`Self::SOURCE`] has the entry point `color_rows` in workgroups of 8 x 8 pixels. Groups 0 and 2 are what [`Self::new`] and
/// [`Self::view`] give; group 1 is [`Self::band`], a storage buffer of at least one word that is not read, and the colors that
/// are written: red, green and blue of each pixel of the band, single precision.
#[derive(Debug)]
pub struct VolumeKernel {
    tables: TableFacts,
    integral: Option<PreintegrationTable>,
}

impl VolumeKernel {
    /// WGSL.
    pub const SOURCE: &'static str = RAYCAST;

    /// The kernel of `field`, and the resources that no camera changes.
    pub fn new(field: &Field) -> (Self, Vec<Binding<'_>>) {
        let step_length = field.scene().step_length(field.grid());
        let (tables, table) = field::tables(field, step_length);
        let integral = effects::integral(field, step_length);
        let (_, format, voxels) = field::voxels_of(field);
        let (color_dims, colors) = field::colors(field);
        let bindings = vec![
            Binding::uniform(0, 0, &field::volume(field)),
            Binding::texture(0, 2, field::dims(field), format, voxels),
            Binding::storage(0, 3, field::distances(field)),
            Binding::storage(0, 4, cast_slice(&table.step).to_vec()),
            Binding::storage(0, 5, cast_slice(&table.unit).to_vec()),
            Binding::storage(2, 1, cast_slice(&effects::sums(integral.as_ref())).to_vec()),
            Binding::storage(2, 2, cast_slice(&effects::light(field)).to_vec()),
            Binding::texture(2, 3, color_dims, TexelFormat::R32Uint, cast_slice(&colors).to_vec()),
        ];
        (Self { tables, integral }, bindings)
    }

    /// The values of the source's override constants.
    pub fn constants(field: &Field) -> Vec<(&'static str, f64)> {
        let (kind, _, _) = field::voxels_of(field);
        std::iter::once(("KIND", f64::from(kind as u32))).chain(EffectSet::of(field).constants()).collect()
    }

    /// The resources that a picture from `camera`, `width` x `height` pixels, takes besides.
    pub fn view(&self, field: &Field, camera: &Camera, width: u32, height: u32) -> [Binding<'static>; 2] {
        let effects = effects::uniform(field, self.integral.as_ref(), camera, self.tables.step_length);
        let view = ViewUniforms::new(field, camera, width, height, &self.tables);
        [Binding::uniform(0, 1, &view), Binding::uniform(2, 0, &effects)]
    }

    /// The band of `rows` rows from row `first` on.
    pub fn band(field: &Field, first: u32, rows: u32) -> Binding<'static> {
        Binding::uniform(1, 0, &picture_uniforms(field, first, rows))
    }
}

/// `count` rows from row `first` on, or `count` listed pixels.
pub(crate) fn picture_uniforms(field: &Field, first: u32, count: u32) -> PictureUniforms {
    let (background, floor) = (field.scene().background, TRANSMITTANCE_FLOOR as f32);
    PictureUniforms { background, floor, first, count, pad0: [0; 2] }
}
