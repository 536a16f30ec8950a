//! The session against the renderers and against what is not a step.

use super::*;
use lamina_codec::volume::encode_after;
use lamina_codec::{EncodeOptions, ErrorMeasure, decode_any, encode_any, sequence};
use lamina_model::{GenerationParams, Grid, Intermediate, Segmentation, Volume, Voxels, suggest::suggest};
use lamina_raycast::Field;
use lamina_vdi_render::Backend;

fn encoded(params: &GenerationParams) -> Vec<u8> {
    let grid = Grid::new([12, 10, 8], DVec3::ONE, DVec3::ZERO).expect("a grid");
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
            // More than one part.
            session.begin(handle, &pose, [300, 240], detail).expect("begun");
            let drawn = loop {
                let message = session.advance().expect("drawn");
                if !message.0.is_empty() {
                    break message;
                }
            };
            let camera = shown.camera().orbit(25.0, -10.0, 1.5).expect("a camera");
            let image = Backend::default().render(&shown, &camera, 300, 240, detail).expect("a picture");
            let (size, pixels) = content(&drawn);
            assert_eq!(size, serde_json::json!([300, 240]));
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
        let (step, view) = (
            session.bindings(handle).expect("bindings"),
            session.view(handle, &Pose::default(), [9, 9], Detail::Cubic, [0, 9]),
        );
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
    assert!(session.view(second, &Pose::default(), [9, 9], Detail::Cubic, [0, 9]).is_err(), "its bindings come first");
    let colorless = Appearance { points: Some(Vec::new()), effects: None };
    assert!(
        session.with_appearance(first, &colorless).is_err() && session.with_appearance(second, &colorless).is_err()
    );
    let far = Pose { zoom: f64::NAN, ..Pose::default() };
    assert!(session.begin(first, &far, [9, 9], Detail::Nearest).is_err());
    assert!(session.begin(first, &Pose::default(), [0, 9], Detail::Nearest).is_err());
    session.begin(first, &Pose::default(), [9, 9], Detail::Nearest).expect("begun");
    session.close(first);
    assert!(session.advance().is_err() && session.bindings(first).is_err() && session.bindings(77).is_err());
    let (again, _) = session.open(&vdi, 1 << 30).expect("a step");
    assert_eq!(again, first, "the place is used again");
}

#[test]
fn a_slice_has_the_values_of_the_plane() {
    let [vdi, volume] = both();
    let mut session = Session::default();
    let (handle, _) = session.open(&volume, 1 << 30).expect("a step");
    let Drawable::Volume(field) = Drawable::new(decode_any(&volume, &DecodeLimits::default()).expect("a step")) else {
        panic!("a VDI")
    };
    // On a plane of points, and half way between two.
    for (axis, at, size, plane) in [(2, 1.0, [12, 10], 7.0), (1, 0.5, [12, 8], 4.5), (0, 0.0, [10, 8], 0.0)] {
        let message = session.slice(handle, axis, at).expect("a slice");
        let (json, bytes) = content(&message);
        assert_eq!(json, serde_json::json!(size));
        let units: Vec<f32> = bytes.as_chunks().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
        assert_eq!(units.len(), size[0] * size[1]);
        let (column, row) = (3, 5);
        let mut index = DVec3::splat(plane);
        let others: Vec<usize> = (0..3).filter(|a| *a != axis).collect();
        (index[others[0]], index[others[1]]) = (column as f64, row as f64);
        assert_eq!(units[row * size[0] + column], field.sample(index));
    }
    let (handle_of_vdi, _) = session.open(&vdi, 1 << 30).expect("a step");
    assert!(session.slice(handle_of_vdi, 0, 0.5).is_err() && session.slice(handle, 3, 0.5).is_err());
    assert!(session.slice(handle, 0, 1.5).is_err() && session.slice(handle, 0, f64::NAN).is_err());
    assert!(session.slice(99, 0, 0.5).is_err());
}

#[test]
fn a_step_coded_after_one_that_is_kept_is_decoded_and_after_none_refused() {
    let first = encoded(&GenerationParams::volume(12, 0.01).expect("parameters"));
    let limits = DecodeLimits::default();
    let decoded = |bytes: &[u8]| match decode_any(bytes, &limits).expect("a step") {
        Intermediate::Volume(volume) => *volume,
        Intermediate::Vdi(_) => unreachable!("volumes alone"),
    };
    let before = decoded(&first);
    // The same once more: nothing resembles it more.
    let reference = ReferenceVolume::new(&first, &before);
    let (second, _) = encode_after(&before, ErrorMeasure::Maximum, Some(&reference));
    let expected = decoded(&sequence(&[&first, &second]));
    let mut session = Session::default();
    let refused = session.open(&second, 1 << 30).expect_err("the one before is not kept");
    assert!(matches!(refused, CodecError::NeedsReference { .. }), "{refused}");
    let (kept, _) = session.open(&first, 1 << 30).expect("a key frame");
    let (handle, _) = session.open(&second, 1 << 30).expect("coded after it");
    session.close(kept);
    assert!(session.open(&second, 1 << 30).is_err(), "it is no longer kept");
    let units = session.get(handle).expect("kept").drawable.units().expect("a volume").1;
    assert!(units == expected.units());
}

#[test]
fn bands_decoded_apart_make_the_same_vdi() {
    // Enough supersegments for three bands: white noise merges into few.
    let grid = Grid::new([96; 3], DVec3::ONE, DVec3::ZERO).expect("a grid");
    let voxels = (0..96_u32.pow(3)).map(|n| (n.wrapping_mul(0x9E37_79B1) ^ n.wrapping_mul(0x85EB_CA6B) >> 7) >> 24);
    let voxels = voxels.map(|n| n as u8).collect();
    let volume = Volume::new(grid, Voxels::U8(voxels)).expect("a volume");
    let field = Field::new(volume.clone(), &suggest(&[&volume]).expect("a scene"));
    let params = GenerationParams::vdi(128, 0.001).expect("parameters");
    let (made, _) =
        lamina_raycast::Backend::cpu().represent(&field, &params, Segmentation::Fitted).expect("it is made");
    let bytes = encode_any(&made, &EncodeOptions::default()).expect("it is encoded");
    let sizes =
        |bytes: &[u8]| serde_json::from_value::<Vec<usize>>(content(&band_sizes(bytes, 1 << 30)).0).expect("sizes");
    let count = sizes(&bytes).len();
    assert!(count > 2, "{count} bands of {} supersegments", made.elements());
    let [mut first, mut second] = [Session::default(), Session::default()];
    let mut band = |k| {
        first.begin_geometry(&bytes, k, 1 << 30).expect("a band");
        second.begin_colors(&bytes, k, 1 << 30).expect("a band");
        loop {
            let Message(slice) = first.geometry().expect("a slice");
            if slice.is_empty() {
                return second.end_colors().0;
            }
            second.color(&slice).expect("its colors");
        }
    };
    let bands: Vec<u8> = (0..count).flat_map(&mut band).collect();
    let mut session = Session::default();
    let (apart, said) = session.join(&bytes, &bands, 1 << 30).expect("joined");
    let (at_once, same) = session.open(&bytes, 1 << 30).expect("opened");
    assert_eq!(said, same);
    let vdi = |handle| match &session.get(handle).expect("held").drawable {
        Drawable::Vdi(vdi) => vdi.vdi().clone(),
        Drawable::Volume(_) => unreachable!("a VDI"),
    };
    assert_eq!(vdi(apart), vdi(at_once));
    for wrong in [&bands[..bands.len() - 1], &bands[..4], &[], &[&bands[..], &bands].concat()[..]] {
        assert!(session.join(&bytes, wrong, 1 << 30).is_err(), "{} bytes", wrong.len());
    }
    assert!(session.begin_geometry(&bytes, count, 1 << 30).is_err(), "no such band");
    let [small, volume] = both();
    assert_eq!((sizes(&small).len(), sizes(&volume).len()), (1, 0));
    assert!(session.begin_colors(&volume, 0, 1 << 30).is_err(), "no VDI");
    session.begin_colors(&small, 0, 1 << 30).expect("a band");
    assert!(session.color(&bands[..7]).is_err(), "no slice");
    assert!(session.color(&VdiBand::default().to_bytes()).is_ok(), "nothing");
}
