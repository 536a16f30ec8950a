//! The steps that a page holds decoded, and what it asks of them.

use crate::camera::Pose;
use crate::message::Message;
use glam::DVec3;
use lamina_codec::volume::{ReferenceVolume, checksum};
use lamina_codec::{CodecError, ColorDecoder, DecodeLimits, GeometryDecoder, VdiBand, decode_any_after};
use lamina_compute::kernel::Binding;
use lamina_model::{Appearance, Camera, Effects, Image, Intermediate, Invalid, TransferFunction};
use lamina_raycast::kernel::VolumeKernel;
use lamina_vdi_render::kernel::VdiKernel;
use lamina_vdi_render::{Detail, Drawable};
use serde::Serialize;

/// What is known of a decoded step.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Description {
    /// `vdi` or `volume`.
    pub representation: &'static str,
    /// The recorded camera.
    pub camera: Camera,
    /// Least and greatest corner of the volume's box, world units.
    pub bounds: [[f64; 3]; 2],
    /// Supersegments, or sample points.
    pub elements: usize,
    /// Values of the kernel's override constants.
    pub constants: Vec<(&'static str, f64)>,
    /// The transfer function of a volume.
    pub transfer: Option<TransferFunction>,
    /// The effects of a volume.
    pub effects: Option<Effects>,
    /// Positions in the range whose values were not recorded, since nothing shows there.
    pub unrecorded: Vec<[f32; 2]>,
    /// Of a volume: how many of its points lie in each of [`BINS`] equal parts of the range.
    pub histogram: Vec<u32>,
    /// Color behind everything.
    pub background: [f32; 3],
    /// False if no picture shows anything: then there is nothing to bind.
    pub visible: bool,
}

/// Parts of the range that the histogram counts.
pub const BINS: usize = 64;

/// A step, and its kernel if it is a volume.
#[derive(Debug)]
struct Shown {
    drawable: Drawable,
    volume: Option<VolumeKernel>,
    elements: usize,
    histogram: Vec<u32>,
    /// The CRC-32 that its bytes end with.
    checksum: u32,
}

/// A picture that is drawn in parts.
#[derive(Debug)]
struct Painting {
    handle: usize,
    camera: Camera,
    size: [u32; 2],
    detail: Detail,
    /// The upper rows.
    colors: Vec<[f32; 3]>,
}

/// Pixels of a volume's picture, or a VDI's still one, that are drawn at a time.
const BAND_PIXELS: u32 = 1 << 16;

/// Columns and rows of the tiles whose pixels are cast one after the other: neighboring rays meet the same voxels.
const TILE: [u32; 2] = [4, 2];

/// The pixels of rows `first` to before `end`, tile by tile.
fn tiled(width: u32, first: u32, end: u32) -> Vec<(u32, u32)> {
    let mut pixels = Vec::with_capacity(((end - first) * width) as usize);
    for top in (first..end).step_by(TILE[1] as usize) {
        for left in (0..width).step_by(TILE[0] as usize) {
            let rows = top..end.min(top + TILE[1]);
            pixels.extend(rows.flat_map(|j| (left..width.min(left + TILE[0])).map(move |i| (i, j))));
        }
    }
    pixels
}

/// The bytes of each band of a recorded step whose geometry and colors can be decoded apart; none if there are none.
pub(crate) fn band_sizes(bytes: &[u8], max_decoded_bytes: u64) -> Message {
    Message::json(&lamina_codec::band_sizes(bytes, &DecodeLimits { max_decoded_bytes }).unwrap_or_default())
}

/// All decoded steps, by handle, and the picture that is being drawn.
#[derive(Debug, Default)]
pub struct Session {
    shown: Vec<Option<Shown>>,
    painting: Option<Painting>,
    geometry: Option<GeometryDecoder>,
    colors: Option<ColorDecoder>,
}

impl Session {
    /// Decodes a recorded step of at most `max_decoded_bytes` and keeps it; its handle, and its [`Description`]. It may be coded after one that
    /// is kept.
    ///
    /// # Errors
    /// If the bytes are no step, coded after one that is not kept, damaged or too large.
    pub fn open(&mut self, bytes: &[u8], max_decoded_bytes: u64) -> Result<(usize, Message), CodecError> {
        let decoded = decode_any_after(bytes, &DecodeLimits { max_decoded_bytes }, |before| self.reference(before))?;
        Ok(self.take(bytes, decoded))
    }

    /// As [`Self::open`], of a VDI whose bands were decoded in stages, maybe by other workers: `bands` holds all of them, one behind the other.
    ///
    /// # Errors
    /// If the bytes are no VDI, damaged or too large, or `bands` are not its bands.
    pub fn join(
        &mut self,
        bytes: &[u8],
        mut bands: &[u8],
        max_decoded_bytes: u64,
    ) -> Result<(usize, Message), CodecError> {
        let mut decoded = Vec::new();
        while !bands.is_empty() {
            decoded.push(VdiBand::read(&mut bands)?);
        }
        let vdi = lamina_codec::join_bands(bytes, &decoded, &DecodeLimits { max_decoded_bytes })?;
        Ok(self.take(bytes, Intermediate::Vdi(Box::new(vdi))))
    }

    /// Begins to decode the geometry of band `band` of a VDI.
    ///
    /// # Errors
    /// If the bytes are no VDI in bands, damaged or too large, or there is no such band.
    pub fn begin_geometry(&mut self, bytes: &[u8], band: usize, max_decoded_bytes: u64) -> Result<Message, CodecError> {
        self.geometry = Some(GeometryDecoder::new(bytes, band, &DecodeLimits { max_decoded_bytes })?);
        Ok(Message::default())
    }

    /// The next slice of it, for [`Self::color`]; empty behind the last.
    ///
    /// # Errors
    /// If the bytes are damaged.
    pub fn geometry(&mut self) -> Result<Message, CodecError> {
        let slice = self.geometry.as_mut().map(GeometryDecoder::slice).transpose()?.flatten();
        Ok(slice.map(|slice| Message(slice.to_bytes())).unwrap_or_default())
    }

    /// Begins to decode the colors of band `band` of a VDI.
    ///
    /// # Errors
    /// As [`Self::begin_geometry`].
    pub fn begin_colors(&mut self, bytes: &[u8], band: usize, max_decoded_bytes: u64) -> Result<Message, CodecError> {
        self.colors = Some(ColorDecoder::new(bytes, band, &DecodeLimits { max_decoded_bytes })?);
        Ok(Message::default())
    }

    /// Decodes the colors of the next slice.
    ///
    /// # Errors
    /// If the bytes are damaged or `slice` is none.
    pub fn color(&mut self, mut slice: &[u8]) -> Result<Message, CodecError> {
        let slice = VdiBand::read(&mut slice)?;
        self.colors.as_mut().map(|colors| colors.take(&slice)).transpose()?;
        Ok(Message::default())
    }

    /// Ends the band begun: what [`Self::join`] takes of it.
    pub fn end_colors(&mut self) -> Message {
        Message(self.colors.take().map(|colors| colors.finish().to_bytes()).unwrap_or_default())
    }

    /// Keeps a step that was decoded from `bytes`.
    fn take(&mut self, bytes: &[u8], decoded: Intermediate) -> (usize, Message) {
        let (elements, histogram) = (decoded.elements() as usize, histogram(&decoded));
        let (drawable, checksum) = (Drawable::new(decoded), checksum(bytes));
        self.keep(Shown { drawable, volume: None, elements, histogram, checksum })
    }

    fn reference(&self, wanted: u32) -> Option<ReferenceVolume> {
        let shown = self.shown.iter().flatten().find(|shown| shown.checksum == wanted)?;
        shown.drawable.units().map(|(dims, units)| ReferenceVolume::of(wanted, dims, units))
    }

    /// Keeps the volume `handle` with another appearance; the new handle, and its [`Description`].
    ///
    /// # Errors
    /// If there is no such volume, or it cannot look so.
    pub fn with_appearance(&mut self, handle: usize, asked: &Appearance) -> Result<(usize, Message), Invalid> {
        let Shown { drawable, elements, histogram, checksum, .. } = self.get(handle)?;
        let (elements, histogram, checksum) = (*elements, histogram.clone(), *checksum);
        let drawable = drawable.with_appearance(asked)?;
        Ok(self.keep(Shown { drawable, volume: None, elements, histogram, checksum }))
    }

    fn keep(&mut self, shown: Shown) -> (usize, Message) {
        let description = describe(&shown);
        let free = self.shown.iter().position(Option::is_none).unwrap_or(self.shown.len());
        self.shown.resize_with(self.shown.len().max(free + 1), || None);
        self.shown[free] = Some(shown);
        (free, Message::json(&description))
    }

    /// Forgets a step.
    pub fn close(&mut self, handle: usize) {
        if let Some(slot) = self.shown.get_mut(handle) {
            *slot = None;
        }
    }

    fn get(&self, handle: usize) -> Result<&Shown, Invalid> {
        let shown = self.shown.get(handle).and_then(Option::as_ref);
        shown.ok_or_else(|| Invalid::new("handle", format!("no step is held as {handle}")))
    }

    /// What the kernel reads of the step, whatever the camera.
    ///
    /// # Errors
    /// If there is no such step.
    pub fn bindings(&mut self, handle: usize) -> Result<Message, Invalid> {
        self.get(handle)?;
        let Some(Shown { drawable, volume, .. }) = &mut self.shown[handle] else { unreachable!("it is held") };
        let bindings = match drawable {
            Drawable::Vdi(vdi) => VdiKernel::arrays(vdi),
            Drawable::Volume(field) => {
                let (kernel, bindings) = VolumeKernel::new(field);
                *volume = Some(kernel);
                bindings
            }
        };
        Ok(Message::bindings(&bindings))
    }

    /// What the kernel reads for some rows, `count` from row `first` on, of a picture of `size` (width, height) from `pose`.
    ///
    /// # Errors
    /// If there is no such step, its bindings were not asked for, or the pose is absurd.
    pub fn view(
        &self,
        handle: usize,
        pose: &Pose,
        size: [u32; 2],
        detail: Detail,
        [first, count]: [u32; 2],
    ) -> Result<Message, Invalid> {
        let shown = self.get(handle)?;
        let camera = pose.camera(shown.drawable.camera())?;
        let [width, height] = size;
        let bindings: Vec<Binding<'static>> = match (&shown.drawable, &shown.volume) {
            (Drawable::Vdi(vdi), _) => {
                vec![VdiKernel::view(vdi, &camera, width, height, detail), VdiKernel::band(first, count)]
            }
            (Drawable::Volume(field), Some(kernel)) => {
                let [view, effects] = kernel.view(field, &camera, width, height);
                vec![view, effects, VolumeKernel::band(field, first, count)]
            }
            _ => return Err(Invalid::new("view", "the step's bindings come first")),
        };
        Ok(Message::bindings(&bindings))
    }

    /// A volume's values on the plane across `axis` (0, 1, 2) at `at` (0 to 1) of its box, at its own sample points: JSON of their numbers
    /// along the lower and the higher of the other axes, then positions in the range, single precision; NaN where there is none.
    ///
    /// # Errors
    /// If there is no such volume, axis or place.
    pub fn slice(&self, handle: usize, axis: usize, at: f64) -> Result<Message, Invalid> {
        let Drawable::Volume(field) = &self.get(handle)?.drawable else {
            return Err(Invalid::new("slice", "a VDI holds colors, not values"));
        };
        let [right, up] = match axis {
            0 => [1, 2],
            1 => [0, 2],
            2 => [0, 1],
            _ => return Err(Invalid::new("slice.axis", format!("{axis} is none of 0, 1, 2"))),
        };
        if !(0.0..=1.0).contains(&at) {
            return Err(Invalid::new("slice.at", format!("{at} must lie in 0..1")));
        }
        let dims = field.grid().dims();
        let mut index = DVec3::ZERO;
        index[axis] = at * (dims[axis] - 1) as f64;
        let mut units = Vec::with_capacity(4 * dims[right] * dims[up]);
        for (row, column) in (0..dims[up]).flat_map(|row| (0..dims[right]).map(move |column| (row, column))) {
            (index[right], index[up]) = (column as f64, row as f64);
            units.extend_from_slice(&field.sample(index).to_le_bytes());
        }
        Ok(Message::with_bytes(&[dims[right], dims[up]], &[&units]))
    }

    /// Begins a picture that is drawn here; [`Self::advance`] draws it. Takes the place of one begun before.
    ///
    /// # Errors
    /// If there is no such step, or pose or size are absurd.
    pub fn begin(&mut self, handle: usize, pose: &Pose, size: [u32; 2], detail: Detail) -> Result<Message, Invalid> {
        Image::check_size(size[0], size[1])?;
        let camera = pose.camera(self.get(handle)?.drawable.camera())?;
        self.painting = Some(Painting { handle, camera, size, detail, colors: Vec::new() });
        Ok(Message::default())
    }

    /// Draws the next part of the picture begun. Empty while it is not whole; then its size, and red, green, blue and 255 per pixel.
    ///
    /// # Errors
    /// If none is begun, or its step is no longer held.
    pub fn advance(&mut self) -> Result<Message, Invalid> {
        let Some(mut painting) = self.painting.take() else { return Err(Invalid::new("picture", "none is begun")) };
        let Painting { camera, size, detail, ref mut colors, .. } = painting;
        let [width, height] = size;
        let first = colors.len() as u32 / width;
        let band = first..height.min(first + (BAND_PIXELS / width).max(1).next_multiple_of(TILE[1]));
        match &self.get(painting.handle)?.drawable {
            Drawable::Vdi(vdi) if detail == Detail::Nearest => *colors = vdi.rows(&camera, size, 0..height, detail),
            Drawable::Vdi(vdi) => colors.extend(vdi.rows(&camera, size, band, detail)),
            Drawable::Volume(field) => {
                let caster = lamina_raycast::Backend::cpu();
                if width * height <= BAND_PIXELS {
                    *colors = caster.raycast(field, &camera, width, height)?.pixels().to_vec();
                } else {
                    let pixels = tiled(width, band.start, band.end);
                    let cast = caster.raycast_pixels(field, &camera, width, height, &pixels)?;
                    colors.resize(colors.len() + pixels.len(), [0.0; 3]);
                    for ((i, j), color) in pixels.into_iter().zip(cast) {
                        colors[(j * width + i) as usize] = color;
                    }
                }
            }
        }
        if colors.len() < width as usize * height as usize {
            self.painting = Some(painting);
            return Ok(Message::default());
        }
        let rgb = Image::new(width, height, painting.colors)?.to_rgb8();
        let pixels: Vec<u8> = rgb.chunks_exact(3).flat_map(|p| [p[0], p[1], p[2], 255]).collect();
        Ok(Message::with_bytes(&[width, height], &[&pixels]))
    }
}

/// Of the values of a volume; empty for a VDI.
fn histogram(decoded: &Intermediate) -> Vec<u32> {
    let Intermediate::Volume(volume) = decoded else { return Vec::new() };
    let mut counts = vec![0; BINS];
    for unit in volume.units().iter().filter(|u| !u.is_nan()) {
        counts[((unit.clamp(0.0, 1.0) * BINS as f32) as usize).min(BINS - 1)] += 1;
    }
    counts
}

fn describe(Shown { drawable, elements, histogram, .. }: &Shown) -> Description {
    let (representation, bounds, background, effects, constants, visible) = match drawable {
        Drawable::Vdi(vdi) => {
            let header = vdi.vdi().header();
            ("vdi", header.bounds, header.background, None, Vec::new(), VdiKernel::is_visible(vdi))
        }
        Drawable::Volume(field) => {
            let (bounds, scene) = (field.grid().bounds(), field.scene());
            let effects = Some(scene.effects.clone());
            ("volume", bounds, scene.background, effects, VolumeKernel::constants(field), true)
        }
    };
    let transfer = drawable.transfer().cloned();
    let parts = transfer.iter().flat_map(TransferFunction::transparent_parts);
    Description {
        representation,
        camera: *drawable.camera(),
        bounds: [bounds.min.to_array(), bounds.max.to_array()],
        elements: *elements,
        constants,
        effects,
        unrecorded: parts.map(|part| part.map(|end| end.clamp(0.0, 1.0))).collect(),
        transfer,
        histogram: histogram.clone(),
        background,
        visible,
    }
}

#[cfg(test)]
mod tests;
