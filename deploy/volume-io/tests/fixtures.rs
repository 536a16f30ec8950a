//! Files that VTK, pynrrd and Python wrote (`fixtures/make_fixtures.py`) hold what their formula says.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use glam::DVec3;
use lamina_model::{Volume, VoxelType};
use lamina_volume_io::{Options, ReadError, Series};
use std::path::{Path, PathBuf};

const DIMS: [usize; 3] = [4, 3, 5];
const SPACING: DVec3 = DVec3::new(0.5, 0.25, 2.0);
const ORIGIN: DVec3 = DVec3::new(-1.0, 2.0, 0.5);

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures").join(name)
}

fn read_as(name: &str, field: Option<&str>) -> Result<Volume, ReadError> {
    let options = Options { field: field.map(str::to_owned), ..Options::default() };
    Series::open(&fixture(name), &options)?.read(0)
}

fn read(name: &str) -> Volume {
    read_as(name, None).unwrap_or_else(|e| panic!("{e}"))
}

/// The formula of the fixtures, `kept` being what the stored type makes of the whole number.
fn check(name: &str, volume: &Volume, dims: [usize; 3], kept: impl Fn(i64) -> f64) {
    assert_eq!(volume.grid().dims(), dims, "{name}");
    let mut index = 0;
    for z in 0..dims[2] {
        for y in 0..dims[1] {
            for x in 0..dims[0] {
                let want = kept((x + 10 * y + 100 * z) as i64);
                assert_eq!(volume.voxels().get(index), want, "{name} at {x} {y} {z}");
                index += 1;
            }
        }
    }
}

fn check_plain(name: &str) {
    let volume = read(name);
    check(name, &volume, DIMS, |v| v as f64);
    assert_eq!((volume.grid().spacing(), volume.grid().origin()), (SPACING, ORIGIN), "{name}");
    assert_eq!(volume.voxels().voxel_type(), VoxelType::F32, "{name}");
}

#[test]
fn every_way_in_which_vtk_writes_image_data_reads_the_same() {
    check_plain("inline_ascii.vti");
    for mode in ["appended_raw", "appended_base64", "inline_binary"] {
        for header in ["u32", "u64"] {
            for packing in ["none", "zlib"] {
                for order in ["le", "be"] {
                    check_plain(&format!("{mode}_{header}_{packing}_{order}.vti"));
                }
            }
        }
    }
}

#[test]
fn every_type_of_scalar_is_kept_or_widened_without_loss() {
    for (stored, kept) in [
        ("uint16", VoxelType::U16),
        ("int16", VoxelType::I16),
        ("float64", VoxelType::F64),
        ("int32", VoxelType::F64),
        ("uint32", VoxelType::F64),
        ("int64", VoxelType::F64),
    ] {
        let name = format!("type_{stored}.vti");
        let volume = read(&name);
        check(&name, &volume, DIMS, |v| v as f64);
        assert_eq!(volume.voxels().voxel_type(), kept, "{name}");
    }
    let bytes = read("type_uint8.vti");
    check("uint8", &bytes, DIMS, |v| (v as u8).into());
    assert_eq!(bytes.voxels().voxel_type(), VoxelType::U8);
    let signed = read("type_int8.vti");
    check("int8", &signed, DIMS, |v| (v as i8).into());
    assert_eq!(signed.voxels().voxel_type(), VoxelType::I16);
}

#[test]
fn an_extent_that_does_not_start_at_zero_moves_the_grid() {
    let volume = read("extent_start.vti");
    check("extent_start", &volume, DIMS, |v| v as f64);
    assert_eq!(volume.grid().origin(), ORIGIN + DVec3::new(2.0, -4.0, 10.0) * SPACING);
}

#[test]
fn cells_are_sampled_at_their_centers() {
    let volume = read("cell_data.vti");
    check("cell_data", &volume, [3, 2, 4], |v| v as f64);
    assert_eq!((volume.grid().origin(), volume.grid().spacing()), (ORIGIN + 0.5 * SPACING, SPACING));
}

#[test]
fn of_several_arrays_the_named_one_is_read_and_the_active_one_without_a_name() {
    check("active", &read("several_arrays.vti"), DIMS, |v| v as f64);
    check("named", &read_as("several_arrays.vti", Some("negative")).unwrap(), DIMS, |v| -v as f64);
    let vector = read_as("several_arrays.vti", Some("velocity")).unwrap_err().to_string();
    assert!(vector.contains("3 components") && vector.contains("negative, ramp"), "{vector}");
    let missing = read_as("several_arrays.vti", Some("rho")).unwrap_err().to_string();
    assert!(missing.contains("no array \"rho\"") && missing.contains("negative, ramp"), "{missing}");
    let series = Series::open(&fixture("several_arrays.vti"), &Options::default()).unwrap();
    assert_eq!((series.name(), series.field(), series.len(), series.time(0)), ("several_arrays", "ramp", 1, 0.0));
}

#[test]
fn nrrd_files_read_attached_and_detached() {
    let check_nrrd = |name: &str, voxel_type: VoxelType, spacing: DVec3, origin: DVec3| {
        let volume = read(name);
        assert_eq!(volume.voxels().voxel_type(), voxel_type, "{name}");
        assert_eq!((volume.grid().spacing(), volume.grid().origin()), (spacing, origin), "{name}");
        let narrow = voxel_type == VoxelType::U8;
        check(name, &volume, DIMS, |v| if narrow { (v as u8).into() } else { v as f64 });
    };
    check_nrrd("attached_raw.nrrd", VoxelType::I16, SPACING, DVec3::ZERO);
    check_nrrd("attached_gzip_be.nrrd", VoxelType::F32, SPACING, ORIGIN);
    check_nrrd("attached_ascii.nrrd", VoxelType::U16, DVec3::ONE, DVec3::ZERO);
    check_nrrd("detached_raw.nhdr", VoxelType::F64, SPACING, DVec3::ZERO);
    check_nrrd("detached_gzip.nhdr", VoxelType::U8, SPACING, DVec3::ZERO);
}

#[test]
fn a_raw_file_takes_its_shape_from_its_name() {
    let volume = read("ramp_4x3x5_uint16.raw.gz");
    check("raw", &volume, DIMS, |v| v as f64);
    assert_eq!(volume.voxels().voxel_type(), VoxelType::U16);
    let series = Series::open(&fixture("ramp_4x3x5_uint16.raw.gz"), &Options::default()).unwrap();
    assert_eq!((series.name(), series.field()), ("ramp_4x3x5_uint16", "scalar"));
}
