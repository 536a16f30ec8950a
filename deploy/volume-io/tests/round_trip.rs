//! What the crate writes it reads back, and hand-written files with every liberty that the formats allow.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use flate2::Compression;
use flate2::write::GzEncoder;
use glam::DVec3;
use lamina_model::{Grid, Volume, VoxelType, Voxels};
use lamina_volume_io::{Options, RawSpec, Series, write_pvd, write_vti, write_vtkhdf};
use std::fs;
use std::io::Write;
use std::path::Path;

fn volume(dims: [usize; 3], voxels: Voxels) -> Volume {
    let grid = Grid::new(dims, DVec3::new(0.1, 1e-9, 3.0), DVec3::new(-1.5, 1e-7, 0.3)).unwrap();
    Volume::new(grid, voxels).unwrap()
}

fn open(path: &Path) -> Series {
    Series::open(path, &Options::default()).unwrap_or_else(|e| panic!("{e}"))
}

fn read(path: &Path) -> Volume {
    open(path).read(0).unwrap_or_else(|e| panic!("{e}"))
}

fn gzipped(bytes: &[u8]) -> Vec<u8> {
    let mut gzip = GzEncoder::new(Vec::new(), Compression::fast());
    gzip.write_all(bytes).unwrap();
    gzip.finish().unwrap()
}

#[test]
fn image_data_comes_back_bit_for_bit_in_every_type() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.vti");
    for voxels in [
        Voxels::U8((0..24).map(|n| n * 10).collect()),
        Voxels::U16((0..24).map(|n| n * 2000).collect()),
        Voxels::I16((0..24).map(|n| n * 1000 - 9000).collect()),
        Voxels::F32((0..24).map(|n| (n as f32).exp() - 5.0).collect()),
        Voxels::F64((0..24).map(|n| 0.1f64.powi(n)).collect()),
    ] {
        let written = volume([2, 3, 4], voxels);
        write_vti(&path, &written, "a <b> & \"c\"").unwrap();
        assert_eq!(read(&path), written);
        assert_eq!(open(&path).field(), "a <b> & \"c\"");
        let path = path.with_extension("vtkhdf");
        write_vtkhdf(&path, &written, "a <b> & \"c\"").unwrap();
        assert_eq!(read(&path), written);
        assert_eq!(open(&path).field(), "a <b> & \"c\"");
    }
    // In several chunks, with a second field.
    let path = folder.path().join("b.vtkhdf");
    let written = volume([130, 3, 70], Voxels::F32((0..27300).map(|n| (n as f32).sin()).collect()));
    let written = written.with_color_field("E/x", Voxels::U8((0..27300).map(|n| n as u8).collect())).unwrap();
    write_vtkhdf(&path, &written, "rho").unwrap();
    let options = Options { field: Some("rho".into()), ..Options::default() };
    let series = Series::open(&path, &options).unwrap();
    let first = series.read(0).unwrap();
    let second = series.with_color_field(0, "E.x", first.clone()).unwrap();
    assert_eq!(first.voxels(), written.voxels());
    assert_eq!(second.color_field().unwrap().1, written.color_field().unwrap().1);
}

#[test]
fn a_second_array_is_read_as_the_color_field_and_a_missing_one_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.vti");
    let written = volume([2, 3, 4], Voxels::U8((0..24).collect()));
    let written = written.with_color_field("T", Voxels::F64((0..24).map(|n| f64::from(n).sqrt()).collect())).unwrap();
    write_vti(&path, &written, "rho").unwrap();
    let series = open(&path);
    assert_eq!(series.field(), "rho");
    let first = series.read(0).unwrap();
    assert!(first.color_field().is_none(), "only where it is asked for");
    assert_eq!(series.with_color_field(0, "T", first.clone()).unwrap(), written);
    let missing = series.with_color_field(0, "p", first.clone()).unwrap_err().to_string();
    assert!(missing.contains("\"p\"") && missing.contains("rho, T"), "{missing}");
    let raw = folder.path().join("x_2x3x4_uint8.raw");
    fs::write(&raw, [7; 24]).unwrap();
    let alone = open(&raw).with_color_field(0, "T", first).unwrap_err().to_string();
    assert!(alone.contains("\"T\"") && alone.contains(".vti"), "{alone}");
    let itself = series.with_color_field(0, "rho", series.read(0).unwrap()).unwrap();
    assert_eq!(itself.color_field(), Some(("rho", itself.voxels())));
    let twice = write_vti(&path, &itself, "rho").unwrap_err();
    assert!(format!("{twice:?}").contains("rho"), "{twice:?}");
}

#[test]
fn image_data_of_many_blocks_comes_back_whether_or_not_the_last_is_full() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.vti");
    for depth in [64, 65] {
        let noise = (0..64 * 64 * depth).map(|n: u32| f32::from((n.wrapping_mul(2_654_435_761) >> 16) as u16));
        let written = volume([64, 64, depth as usize], Voxels::F32(noise.collect()));
        write_vti(&path, &written, "noise").unwrap();
        assert_eq!(read(&path), written);
    }
}

#[test]
fn a_collection_plays_its_steps_in_order() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.pvd");
    let step = |n: u8| volume([2, 1, 1], Voxels::U8(vec![n, n + 1]));
    let steps = [(-0.5, "a&b.vti"), (1e-3, "c.vti"), (1e20, "d.vti")];
    for (index, (_, file)) in steps.iter().enumerate() {
        write_vti(&folder.path().join(file), &step(index as u8), "rho").unwrap();
    }
    write_pvd(&path, &steps.map(|(time, file)| (time, file.to_owned()))).unwrap();
    let series = open(&path);
    assert_eq!((series.name(), series.field(), series.len(), series.is_empty()), ("run", "rho", 3, false));
    for (index, (time, _)) in steps.iter().enumerate() {
        assert_eq!(series.time(index), *time);
        assert_eq!(series.read(index).unwrap(), step(index as u8));
    }
    assert!(series.read(3).unwrap_err().to_string().contains("no step 3; its steps are numbered 0 to 2"));
}

#[test]
fn raw_files_read_with_a_shape_given_and_what_is_given_goes_before_the_name() {
    let folder = tempfile::tempdir().unwrap();
    let bytes: Vec<u8> = (0..24).collect();
    let raw =
        RawSpec { dims: Some([3, 2, 1]), voxel_type: Some(VoxelType::F32), spacing: Some(DVec3::new(1.0, 2.0, 0.5)) };
    for (name, content) in [("a_9x9x9_uint8.raw", bytes.clone()), ("b.RAW.GZ", gzipped(&bytes))] {
        let path = folder.path().join(name);
        fs::write(&path, content).unwrap();
        let options = Options { raw, field: Some("rho".into()), ..Options::default() };
        let series = Series::open(&path, &options).unwrap();
        let read = series.read(0).unwrap();
        assert_eq!(read.voxels(), &Voxels::from_le_bytes(VoxelType::F32, &bytes));
        assert_eq!((read.grid().dims(), read.grid().spacing()), ([3, 2, 1], DVec3::new(1.0, 2.0, 0.5)));
        assert_eq!(series.field(), "rho");
    }
}

#[test]
fn nrrd_data_is_found_behind_skipped_lines_and_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("data.bin");
    let header = folder.path().join("a.nhdr");
    let values = Voxels::U16(vec![1, 2, 300, 4, 5, 6]);
    let payload = values.to_le_bytes(0..6);
    let with = |skips: &str, encoding: &str, content: &[u8]| {
        fs::write(&data, content).unwrap();
        let text = format!(
            "NRRD0004\r\n# note\r\nkey:=v: w\r\ntype: unsigned short\r\nDimension: 3\r\nsizes: 3 2 1\r\nendian: little\r\n\
             encoding: {encoding}\r\n{skips}\r\ndatafile: data.bin\r\n"
        );
        fs::write(&header, text).unwrap();
        assert_eq!(read(&header).voxels(), &values, "{skips} {encoding}");
    };
    with("line skip: 2", "raw", &[b"one\ntwo\n", &payload[..]].concat());
    with("byteskip: 3", "raw", &[b"abc", &payload[..], b"rest"].concat());
    with("lineskip: 1\r\nbyte skip: 2", "raw", &[b"one\nab", &payload[..]].concat());
    with("byte skip: -1", "raw", &[b"any length", &payload[..]].concat());
    with("byte skip: 2", "gzip", &gzipped(&[b"ab", &payload[..]].concat()));
    with("line skip: 1\r\nbyte skip: 2", "gz", &[b"plain\n", &gzipped(&[b"ab", &payload[..]].concat())[..]].concat());
    with("line skip: 1", "text", b"values:\n1 2 300\n4 5 6\n");
}

/// Text that VTK itself would not write but reads: a byte order mark, an array's metadata, units padded apart.
#[test]
fn image_data_may_be_laid_out_freely() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.vti");
    let with = |format: &str, text: &str| {
        let xml = format!(
            "\u{feff}<?xml version='1.0'?><!-- note --><VTKFile type='ImageData'>\
             <ImageData WholeExtent='0 1 0 1 0 0'><FieldData><DataArray type='Float64' Name='t' format='ascii'>9</DataArray>\
             </FieldData><Piece Extent='0 1 0 1 0 0'><PointData><DataArray type='String' format='none'/>\
             <DataArray Name='v' type='UInt8' format='{format}'>{text}<InformationKey name='k'><Value>7</Value>\
             </InformationKey></DataArray></PointData></Piece></ImageData></VTKFile>"
        );
        fs::write(&path, xml).unwrap();
        assert_eq!(read(&path).voxels(), &Voxels::U8(vec![1, 2, 3, 4]), "{text}");
        assert_eq!(open(&path).field(), "v");
    };
    with("ascii", "1 2\n3\t4 ");
    with("binary", "BAAAAAECAwQ=");
    with("binary", " BAAA\nAA== AQID\nBA== ");
}
