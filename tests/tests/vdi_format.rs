//! The VDI format page against the codec: `read_vdi.py`, written from the page alone and with Python's standard library
//! alone, must read every supersegment that the codec writes.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use glam::DVec3;
use lamina_codec::{Codec, DecodeLimits, EncodeOptions, Layout, decode, encode};
use lamina_model::{Aabb, Camera, Supersegment, Vdi, VdiHeader, VdiParams};
use serde_json::{Value, json};
use std::path::Path;
use std::process::{Command, Output};

fn read_vdi(bytes: &[u8]) -> Output {
    let file = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(file.path(), bytes).unwrap();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("read_vdi.py");
    let reader = Command::new("python3").arg(script).arg(file.path()).arg("--segments").output();
    reader.expect("python3 must be installed: it reads VDI files independently of the codec")
}

/// Forty by forty rays: empty ones, opaque and invisible pieces, pieces of every length, gaps, and one of 2^22 steps. So many
/// that sizes in the format which go by their number are not the least.
fn assorted() -> Vdi {
    let resolution = 40;
    let header = VdiHeader {
        camera: Camera::new(DVec3::new(1.5, -2.0, 9.0), DVec3::new(0.25, 0.0, 0.0), DVec3::Y, 35.0).unwrap(),
        bounds: Aabb::new(DVec3::new(-2.0, -1.0, -3.0), DVec3::splat(2.0)).unwrap(),
        step_length: 0.0078125,
        params: VdiParams::new(resolution, 0.125).unwrap().with_opacity_cutoff(0.75).unwrap(),
        transfer_id: u64::MAX - 7,
        background: [0.0, 0.5, 1.0],
    };
    let (mut offsets, mut segments) = (vec![0], Vec::new());
    for ray in 0..resolution * resolution {
        let mut depth = 3 * (ray % 5);
        for k in 0..(ray * ray) % 7 {
            let mixed = ray.wrapping_mul(2_654_435_761).wrapping_add(k.wrapping_mul(40_503)) >> 8;
            let start = depth + [0, 0, 1, 260][(mixed % 4) as usize];
            depth = start + [1, 2, 255, 256, 257, 70_000][(mixed % 6) as usize];
            let color = [mixed % 97, mixed % 89, mixed % 101].map(|c| c as f32 / 100.0 % 1.0);
            let optical_depth = [f32::INFINITY, 0.0, 1e-9, 0.01, 0.0153, 0.3, 2.5, 9.0][(mixed % 8) as usize];
            segments.push(Supersegment { start, end: depth, color, optical_depth });
        }
        offsets.push(segments.len() as u32);
    }
    let deepest = Supersegment { start: 1 << 20, end: 1 << 22, color: [1.0, 0.0, 0.5], optical_depth: 1.0 };
    segments.push(deepest);
    offsets[(resolution * resolution) as usize] += 1;
    Vdi::new(header, offsets, segments).unwrap()
}

/// The rows that the reader should print for a decoded VDI.
fn rows(vdi: &Vdi, layout: Layout) -> Vec<Value> {
    let code = |x: f64| (255.0 * x).round() as u32;
    let opacity_code = |s: &Supersegment| match layout {
        Layout::Columns => code((1.0 - (-0.5 * f64::from(s.optical_depth)).exp()).sqrt()),
        Layout::Plain => code(s.opacity()),
    };
    let list = |(ray, w): (usize, &[u32])| {
        let row = move |s: &Supersegment| {
            let [r, g, b] = s.color.map(|c| code(f64::from(c)));
            json!([ray, s.start, s.end, r, g, b, opacity_code(s)])
        };
        vdi.segments()[w[0] as usize..w[1] as usize].iter().map(row).collect::<Vec<_>>()
    };
    vdi.offsets().windows(2).enumerate().flat_map(list).collect()
}

#[test]
fn the_independent_reader_finds_every_header_field_and_supersegment() {
    let original = assorted();
    let options =
        [(Codec::Bzip2, Layout::Columns), (Codec::Bzip2, Layout::Plain), (Codec::ContextMixing, Layout::Columns)];
    for (codec, layout) in options {
        let bytes = encode(&original, &EncodeOptions { codec, layout, ..EncodeOptions::BZIP2 }).unwrap();
        let output = read_vdi(&bytes);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let mut found: Value = serde_json::from_slice(&output.stdout).unwrap();
        let list = found["list"].take();
        let decoded = decode(&bytes, &DecodeLimits::default()).unwrap();
        assert_eq!(list.as_array().unwrap(), &rows(&decoded, layout));
        assert_eq!(list.as_array().unwrap().len(), original.segments().len());
        assert_eq!(found["camera"]["position"], json!([1.5, -2.0, 9.0]));
        assert_eq!(found["camera"]["target"], json!([0.25, 0.0, 0.0]));
        assert_eq!(found["camera"]["up"], json!([0.0, 1.0, 0.0]));
        assert_eq!(found["camera"]["fov_y_deg"], json!(35.0));
        assert_eq!(found["box"], json!({ "min": [-2.0, -1.0, -3.0], "max": [2.0, 2.0, 2.0] }));
        assert_eq!(found["step_length"], json!(0.0078125));
        let params = json!({ "resolution": 40, "gamma": 0.125, "opacity_cutoff": 0.75, "step_voxels": 0.5 });
        assert_eq!(found["params"], params);
        assert_eq!(found["transfer_id"], json!(u64::MAX - 7));
        assert_eq!(found["background"], json!([0.0, 0.5, 1.0]));
        assert_eq!(found["segments"], json!(original.segments().len()));
        assert_eq!(found["codec"], json!(if codec == Codec::ContextMixing { "context-mixing" } else { "bzip2" }));
    }
}

#[test]
fn the_independent_reader_refuses_damage_and_names_what_it_cannot_do() {
    let complaint = |bytes: &[u8]| {
        let output = read_vdi(bytes);
        assert!(!output.status.success());
        String::from_utf8_lossy(&output.stderr).into_owned()
    };
    let zstd =
        encode(&assorted(), &EncodeOptions { codec: Codec::Zstd, layout: Layout::Columns, ..EncodeOptions::BZIP2 })
            .unwrap();
    assert!(complaint(&zstd).contains("codec zstd"));
    let mut bytes = encode(&assorted(), &EncodeOptions::default()).unwrap();
    bytes[300] ^= 1;
    assert!(complaint(&bytes).contains("damaged"));
    assert!(complaint(b"P6 12 12 255").contains("not a VDI"));
}
