//! The steps that a page holds decoded, and what it asks of them.

use crate::camera::Pose;
use crate::message::Message;
use lamina_codec::{CodecError, DecodeLimits, decode_any};
use lamina_compute::kernel::Binding;
use lamina_model::{Camera, ControlPoint, Image, Invalid, TransferFunction};
use lamina_raycast::kernel::VolumeKernel;
use lamina_vdi_render::kernel::VdiKernel;
use lamina_vdi_render::{Detail, Drawable, Reconstruction};
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
    /// Positions in the range whose values were not recorded, since nothing shows there.
    pub unrecorded: Vec<[f32; 2]>,
    /// Color behind everything.
    pub background: [f32; 3],
    /// False if no picture shows anything: then there is nothing to bind.
    pub visible: bool,
}

/// A step, and its kernel if it is a volume.
#[derive(Debug)]
struct Shown {
    drawable: Drawable,
    volume: Option<VolumeKernel>,
}

/// A picture that is drawn in parts.
#[derive(Debug)]
struct Painting {
    handle: usize,
    camera: Camera,
    size: [u32; 2],
    progress: Progress,
}

#[derive(Debug)]
enum Progress {
    /// Displaced pictures of a VDI.
    Vdi(Reconstruction),
    /// The upper rows of a volume's picture.
    Volume(Vec<[f32; 3]>),
}

/// Pixels of a volume's picture that are cast at a time.
const BAND_PIXELS: u32 = 1 << 15;

/// All decoded steps, by handle, and the picture that is being drawn.
#[derive(Debug, Default)]
pub struct Session {
    shown: Vec<Option<Shown>>,
    painting: Option<Painting>,
}

impl Session {
    /// Decodes a recorded step of at most `max_decoded_bytes` and keeps it; its handle, and its [`Description`].
    ///
    /// # Errors
    /// If the bytes are no step, damaged or too large.
    pub fn open(&mut self, bytes: &[u8], max_decoded_bytes: u64) -> Result<(usize, Message), CodecError> {
        let decoded = decode_any(bytes, &DecodeLimits { max_decoded_bytes })?;
        let elements = decoded.elements() as usize;
        Ok(self.keep(Drawable::new(decoded), elements))
    }

    /// Keeps the volume `handle` under other control points; the new handle, and its [`Description`].
    ///
    /// # Errors
    /// If there is no such volume, or the points are invalid.
    pub fn recolor(&mut self, handle: usize, points: Vec<ControlPoint>) -> Result<(usize, Message), Invalid> {
        let shown = self.get(handle)?;
        let recolored = shown.drawable.with_points(points)?;
        let elements = match &recolored {
            Drawable::Volume(field) => field.grid().voxels(),
            Drawable::Vdi(vdi) => vdi.vdi().segments().len(),
        };
        Ok(self.keep(recolored, elements))
    }

    fn keep(&mut self, drawable: Drawable, elements: usize) -> (usize, Message) {
        let description = describe(&drawable, elements);
        let free = self.shown.iter().position(Option::is_none).unwrap_or(self.shown.len());
        self.shown.resize_with(self.shown.len().max(free + 1), || None);
        self.shown[free] = Some(Shown { drawable, volume: None });
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
        let Some(Shown { drawable, volume }) = &mut self.shown[handle] else { unreachable!("it is held") };
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

    /// What the kernel reads for a picture of `size` (width, height) from `pose`: with the VDI's image displaced `by`, and all rows in
    /// one band.
    ///
    /// # Errors
    /// If there is no such step, its bindings were not asked for, or the pose is absurd.
    pub fn view(&self, handle: usize, pose: &Pose, size: [u32; 2], by: [f64; 2]) -> Result<Message, Invalid> {
        let shown = self.get(handle)?;
        let camera = pose.camera(shown.drawable.camera())?;
        let [width, height] = size;
        let bindings: Vec<Binding<'static>> = match (&shown.drawable, &shown.volume) {
            (Drawable::Vdi(vdi), _) => {
                vec![VdiKernel::view(vdi, &camera, width, height, by), VdiKernel::band(0, height)]
            }
            (Drawable::Volume(field), Some(kernel)) => {
                let [view, effects] = kernel.view(field, &camera, width, height);
                vec![view, effects, VolumeKernel::band(field, 0, height)]
            }
            _ => return Err(Invalid::new("view", "the step's bindings come first")),
        };
        Ok(Message::bindings(&bindings))
    }

    /// How displaced pictures of a VDI make a still one, `height` pixels high: JSON of `around`, `difference` and `sharpness`; `null`
    /// for a volume.
    ///
    /// # Errors
    /// If there is no such step, or the pose is absurd.
    pub fn blend(&self, handle: usize, pose: &Pose, height: u32) -> Result<Message, Invalid> {
        #[derive(Serialize)]
        struct Blend {
            around: [[f64; 2]; 4],
            difference: Vec<([f64; 2], f32)>,
            sharpness: f32,
        }
        let shown = self.get(handle)?;
        let camera = pose.camera(shown.drawable.camera())?;
        let blend = match &shown.drawable {
            Drawable::Vdi(vdi) => Some(VdiKernel::blend(vdi, &camera, height)),
            Drawable::Volume(_) => None,
        };
        Ok(Message::json(&blend.map(|b| Blend { around: b.around, difference: b.difference, sharpness: b.sharpness })))
    }

    /// Begins a picture that is drawn here; [`Self::advance`] draws it. Takes the place of one begun before.
    ///
    /// # Errors
    /// If there is no such step, or pose or size are absurd.
    pub fn begin(&mut self, handle: usize, pose: &Pose, size: [u32; 2], detail: Detail) -> Result<Message, Invalid> {
        Image::check_size(size[0], size[1])?;
        let shown = self.get(handle)?;
        let camera = pose.camera(shown.drawable.camera())?;
        let progress = match &shown.drawable {
            Drawable::Vdi(vdi) => Progress::Vdi(vdi.reconstruction(&camera, size[1], detail)),
            Drawable::Volume(_) => Progress::Volume(Vec::new()),
        };
        self.painting = Some(Painting { handle, camera, size, progress });
        Ok(Message::default())
    }

    /// Draws the next part of the picture begun. Empty while it is not whole; then its size, and red, green, blue and 255 per pixel.
    ///
    /// # Errors
    /// If none is begun, or its step is no longer held.
    pub fn advance(&mut self) -> Result<Message, Invalid> {
        let Some(mut painting) = self.painting.take() else { return Err(Invalid::new("picture", "none is begun")) };
        let (camera, [width, height]) = (painting.camera, painting.size);
        let drawable = &self.get(painting.handle)?.drawable;
        match (&mut painting.progress, drawable) {
            (Progress::Vdi(pictures), Drawable::Vdi(vdi)) => {
                if let Some(by) = pictures.next() {
                    pictures.add(vdi.displaced(&camera, painting.size, by));
                }
            }
            (Progress::Volume(colors), Drawable::Volume(field)) => {
                let first = colors.len() as u32 / width;
                let rows = first..height.min(first + (BAND_PIXELS / width).max(8));
                let pixels: Vec<_> = rows.flat_map(|j| (0..width).map(move |i| (i, j))).collect();
                let caster = lamina_raycast::Backend::cpu();
                colors.extend(caster.raycast_pixels(field, &camera, width, height, &pixels)?);
            }
            _ => return Err(Invalid::new("picture", "its step is no longer held")),
        }
        let colors = match painting.progress {
            Progress::Vdi(pictures) if pictures.next().is_none() => pictures.finish(),
            Progress::Volume(colors) if colors.len() == width as usize * height as usize => colors,
            progress => {
                self.painting = Some(Painting { progress, ..painting });
                return Ok(Message::default());
            }
        };
        let rgb = Image::new(width, height, colors)?.to_rgb8();
        let pixels: Vec<u8> = rgb.chunks_exact(3).flat_map(|p| [p[0], p[1], p[2], 255]).collect();
        Ok(Message::with_bytes(&[width, height], &[&pixels]))
    }
}

fn describe(drawable: &Drawable, elements: usize) -> Description {
    let (representation, bounds, background, constants, visible) = match drawable {
        Drawable::Vdi(vdi) => {
            let header = vdi.vdi().header();
            ("vdi", header.bounds, header.background, Vec::new(), VdiKernel::is_visible(vdi))
        }
        Drawable::Volume(field) => {
            let (bounds, scene) = (field.grid().bounds(), field.scene());
            ("volume", bounds, scene.background, VolumeKernel::constants(field), true)
        }
    };
    let transfer = drawable.transfer().cloned();
    let parts = transfer.iter().flat_map(TransferFunction::transparent_parts);
    let unrecorded = parts.map(|part| part.map(|end| end.clamp(0.0, 1.0))).collect();
    let camera = *drawable.camera();
    let bounds = [bounds.min.to_array(), bounds.max.to_array()];
    Description { representation, camera, bounds, elements, constants, transfer, unrecorded, background, visible }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lamina_codec::{EncodeOptions, encode_any};
    use lamina_model::{GenerationParams, Grid, Segmentation, Volume, Voxels, suggest::suggest};
    use lamina_raycast::Field;
    use lamina_vdi_render::Backend;

    fn encoded(params: &GenerationParams) -> Vec<u8> {
        let grid = Grid::new([12, 10, 8], glam::DVec3::ONE, glam::DVec3::ZERO).expect("a grid");
        let voxels = (0..960_u32).map(|n| (n * n % 251) as u8).collect();
        let volume = Volume::new(grid, Voxels::U8(voxels)).expect("a volume");
        let field = Field::new(volume.clone(), &suggest(&[&volume]).expect("a scene"));
        let caster = lamina_raycast::Backend::cpu();
        let (made, _) = caster.represent(&field, params, Segmentation::Fitted).expect("it is made");
        encode_any(&made, &EncodeOptions::default()).expect("it is encoded")
    }

    fn both() -> [Vec<u8>; 2] {
        let vdi = GenerationParams::vdi(24, 0.01).expect("parameters");
        let volume = GenerationParams::volume(12, 0.001).expect("parameters");
        [encoded(&vdi), encoded(&volume)]
    }

    fn content(Message(bytes): &Message) -> (serde_json::Value, &[u8]) {
        let length = u32::from_le_bytes(bytes[..4].try_into().expect("four bytes")) as usize;
        let json = serde_json::from_slice(&bytes[4..4 + length]).expect("JSON");
        (json, bytes.get((4 + length).next_multiple_of(16)..).unwrap_or_default())
    }

    #[test]
    fn a_picture_in_parts_is_the_renderers() {
        for bytes in both() {
            let mut session = Session::default();
            let (handle, _) = session.open(&bytes, 1 << 30).expect("a step");
            let shown = Drawable::new(decode_any(&bytes, &DecodeLimits::default()).expect("a step"));
            let pose = Pose { azimuth: 25.0, elevation: -10.0, zoom: 1.5, ..Pose::default() };
            for detail in [Detail::Nearest, Detail::Cubic] {
                session.begin(handle, &pose, [50, 40], detail).expect("begun");
                let drawn = loop {
                    let message = session.advance().expect("drawn");
                    if !message.0.is_empty() {
                        break message;
                    }
                };
                let camera = shown.camera().orbit(25.0, -10.0, 1.5).expect("a camera");
                let image = Backend::default().render(&shown, &camera, 50, 40, detail).expect("a picture");
                let (size, pixels) = content(&drawn);
                assert_eq!(size, serde_json::json!([50, 40]));
                let rgb: Vec<u8> = pixels.chunks_exact(4).flat_map(|p| &p[..3]).copied().collect();
                assert_eq!(rgb, image.to_rgb8());
                assert!(rgb.iter().any(|&c| c > 0), "something is seen");
            }
            assert!(session.advance().is_err(), "none is begun");
        }
    }

    #[test]
    fn every_binding_of_the_kernels_is_there_once() {
        // Of the WGSL: group and binding of each resource but those that the device writes or that list pixels.
        let declared = |source: &str| {
            let places = source.split("@group(").skip(1).map(|rest| {
                let (group, rest) = rest.split_once(") @binding(").expect("a binding");
                let binding = rest.split_once(')').expect("a binding").0;
                (group.parse::<u32>().expect("a number"), binding.parse::<u32>().expect("a number"))
            });
            let mut places: Vec<_> = places.filter(|place| !matches!(place, (1, 1 | 2))).collect();
            places.sort_unstable();
            places
        };
        for (bytes, source) in both().iter().zip([VdiKernel::SOURCE, VolumeKernel::SOURCE]) {
            let mut session = Session::default();
            let (handle, _) = session.open(bytes, 1 << 30).expect("a step");
            let (step, view) =
                (session.bindings(handle).expect("bindings"), session.view(handle, &Pose::default(), [9, 9], [0.0; 2]));
            let mut given = Vec::new();
            for message in [step, view.expect("a view")] {
                let (entries, bytes) = content(&message);
                for entry in entries.as_array().expect("a list") {
                    let number = |name: &str| entry[name].as_u64().expect("a number");
                    given.push((number("group") as u32, number("binding") as u32));
                    let end = number("offset") + number("length");
                    assert!(number("offset") % 16 == 0 && number("length") > 0 && end <= bytes.len() as u64, "{entry}");
                }
            }
            given.sort_unstable();
            assert_eq!(given, declared(source));
        }
    }

    #[test]
    fn damaged_steps_and_absurd_requests_are_refused_and_the_rest_goes_on() {
        let mut session = Session::default();
        let [vdi, volume] = both();
        for length in 0..vdi.len() {
            assert!(session.open(&vdi[..length], 1 << 30).is_err(), "{length} bytes");
        }
        assert!(session.open(&vdi, 1000).is_err(), "more than allowed");
        let (first, _) = session.open(&vdi, 1 << 30).expect("a step");
        let (second, _) = session.open(&volume, 1 << 30).expect("a step");
        assert!(session.view(second, &Pose::default(), [9, 9], [0.0; 2]).is_err(), "its bindings come first");
        assert!(session.recolor(first, Vec::new()).is_err() && session.recolor(second, Vec::new()).is_err());
        let far = Pose { zoom: f64::NAN, ..Pose::default() };
        assert!(session.begin(first, &far, [9, 9], Detail::Nearest).is_err());
        assert!(session.begin(first, &Pose::default(), [0, 9], Detail::Nearest).is_err());
        session.begin(first, &Pose::default(), [9, 9], Detail::Nearest).expect("begun");
        session.close(first);
        assert!(session.advance().is_err() && session.bindings(first).is_err() && session.bindings(77).is_err());
        let (again, _) = session.open(&vdi, 1 << 30).expect("a step");
        assert_eq!(again, first, "the place is used again");
    }
}
