//! Files and stores that h5py, netCDF, zarr, tifffile and openPMD-api wrote (`fixtures/make_array_fixtures.py`) hold what their formula
//! says.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use glam::DVec3;
use lamina_model::{Volume, VoxelType};
use lamina_volume_io::{Options, ReadError, Series};
use std::path::{Path, PathBuf};

const DIMS: [usize; 3] = [4, 3, 5];
const LARGE: [usize; 3] = [32, 16, 16];
const SPACING: DVec3 = DVec3::new(0.5, 0.25, 2.0);
const ORIGIN: DVec3 = DVec3::new(-1.0, 2.0, 0.5);

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/arrays").join(name)
}

fn open(name: &str, field: Option<&str>) -> Series {
    let options = Options { field: field.map(str::to_owned), ..Options::default() };
    Series::open(&fixture(name), &options).unwrap_or_else(|e| panic!("{e}"))
}

fn read(name: &str) -> Volume {
    open(name, None).read(0).unwrap_or_else(|e| panic!("{e}"))
}

fn failure(name: &str, field: Option<&str>) -> String {
    let options = Options { field: field.map(str::to_owned), ..Options::default() };
    let error = Series::open(&fixture(name), &options).and_then(|series| series.read(0)).unwrap_err().to_string();
    assert!(error.contains(name.split('/').next().unwrap()), "names the file: {error}");
    error
}

/// The formula of the fixtures, and `more`.
fn check(name: &str, volume: &Volume, dims: [usize; 3], more: f64) {
    assert_eq!(volume.grid().dims(), dims, "{name}");
    for (n, at) in (0..volume.grid().voxels()).map(|n| (n, [n % dims[0], n / dims[0] % dims[1], n / dims[0] / dims[1]]))
    {
        let want = (at[0] + 10 * at[1] + 100 * at[2]) as f64 + more;
        assert_eq!(volume.voxels().get(n), want, "{name} at {at:?}");
    }
}

fn check_place(name: &str, volume: &Volume, spacing: DVec3, origin: DVec3) {
    let near = |a: DVec3, b: DVec3| (a - b).abs().max_element() < 1e-12;
    let grid = volume.grid();
    assert!(near(grid.spacing(), spacing) && near(grid.origin(), origin), "{name}: {grid:?}");
}

#[test]
fn hdf5_of_any_layout_filter_and_type() {
    for (name, dims, kept) in [
        ("contiguous_f8be", DIMS, VoxelType::F64),
        ("contiguous_i2", DIMS, VoxelType::I16),
        ("contiguous_f2", DIMS, VoxelType::F16),
        ("chunked_u2", DIMS, VoxelType::U16),
        ("gzip_f4", DIMS, VoxelType::F32),
        ("lzf_i4", DIMS, VoxelType::F64),
        ("large_lzf_f4", LARGE, VoxelType::F32),
        ("zstd_f4", DIMS, VoxelType::F32),
        ("large_lz4_f4", LARGE, VoxelType::F32),
        ("large_blosc_f4", LARGE, VoxelType::F32),
        ("growing_f4", DIMS, VoxelType::F32),
    ] {
        for version in ["earliest", "latest"] {
            let name = format!("{name}_{version}.h5");
            let volume = read(&name);
            check(&name, &volume, dims, 0.0);
            check_place(&name, &volume, SPACING, DVec3::ZERO);
            assert_eq!(volume.voxels().voxel_type(), kept, "{name}");
        }
    }
    let said = failure("bzip2_f4_latest.h5", None);
    assert!(said.contains("307") && said.contains("h5repack"), "{said}");
    let said = failure("bomb.h5", None);
    assert!(said.contains("ramp") && said.contains("damaged"), "{said}");
    assert_eq!(open("circle.h5", Some("ramp")).field(), "a/b/ramp");
    check("circle.h5", &read("circle.h5"), DIMS, 0.0);
    assert!(failure("circle.h5", Some("rampe")).contains("a/b/ramp"));
}

#[test]
fn axes_of_arrays_without_names_are_in_the_order_stated() {
    let options = Options { axes: "xyz".parse().unwrap(), ..Options::default() };
    let series = Series::open(&fixture("xyz.h5"), &options).unwrap();
    check("xyz.h5", &series.read(0).unwrap(), DIMS, 0.0);
    assert_eq!(read("xyz.h5").grid().dims(), [5, 3, 4]);
    let series = open("series.h5", None);
    assert_eq!((series.len(), series.time(1)), (2, 1.0));
    check("series.h5", &series.read(1).unwrap(), DIMS, 1000.0);
}

#[test]
fn vectors_are_three_fields_wherever_their_components_lie() {
    for name in ["last", "first", "series"] {
        let of = |axis: &str| open("vectors.h5", Some(&format!("{name}.{axis}"))).read(0).unwrap();
        check(name, &of("x"), DIMS, 0.0);
        assert_eq!(of("y").voxels().get(59), -of("x").voxels().get(59));
        assert_eq!(of("z").voxels().get(59), 2.0 * of("x").voxels().get(59));
    }
    let length = open("vectors.h5", Some("magnitude(first)")).read(0).unwrap();
    assert!((length.voxels().get(59) - 6f64.sqrt() * 423.0).abs() < 1e-3);
}

#[test]
fn vtkhdf_image_data_with_vectors_cells_and_steps() {
    let image = read("image.vtkhdf");
    check("image", &image, DIMS, 0.0);
    check_place("image", &image, SPACING, ORIGIN);
    let twice = open("image.vtkhdf", Some("v.z")).read(0).unwrap();
    assert_eq!(twice.voxels().get(59), 2.0 * image.voxels().get(59));
    let magnitude = open("image.vtkhdf", Some("magnitude(v)")).read(0).unwrap();
    assert!((magnitude.voxels().get(59) - 6f64.sqrt() * image.voxels().get(59)).abs() < 1e-3);
    let cells = open("image.vtkhdf", Some("cell")).read(0).unwrap();
    check("cell", &cells, [3, 2, 4], 0.0);
    check_place("cell", &cells, SPACING, ORIGIN + 0.5 * SPACING);
    assert!(failure("turned.vtkhdf", None).contains("without rotation"));
    let series = open("steps.vtkhdf", None);
    assert_eq!((series.len(), series.time(0), series.time(1)), (2, 0.25, 0.5));
    check("steps", &series.read(1).unwrap(), DIMS, 1000.0);
}

#[test]
fn openpmd_of_either_order_in_its_units() {
    for name in ["openpmd_C.h5", "openpmd_F.h5"] {
        let series = open(name, Some("rho"));
        assert_eq!((series.len(), series.time(1)), (2, 1.0), "{name}");
        let volume = series.read(1).unwrap();
        check(name, &volume, DIMS, 1000.0);
        check_place(name, &volume, SPACING, ORIGIN);
        check(name, &open(name, Some("E/y")).read(0).unwrap(), DIMS, 0.0);
    }
}

#[test]
fn netcdf_of_every_form_with_its_coordinates_and_missing_values() {
    for name in ["netcdf3_classic.nc", "netcdf3_64bit_offset.nc", "netcdf3_64bit_data.nc", "netcdf4.nc"] {
        let series = open(name, Some("ramp"));
        assert_eq!((series.len(), series.time(0), series.time(1)), (2, 1.5, 2.5), "{name}");
        for (field, factor, offset) in [("ramp", 1.0, 0.0), ("packed", 0.5, 10.0)] {
            let volume = open(name, Some(field)).read(1).unwrap();
            check_place(name, &volume, SPACING, ORIGIN);
            assert!(volume.voxels().get(1).is_nan(), "{name}: {field}");
            for n in (0..60).filter(|&n| n != 1) {
                let stored = 1000 + n % 4 + 10 * (n / 4 % 3) + 100 * (n / 12);
                assert_eq!(volume.voxels().get(n), factor * stored as f64 + offset, "{name}: {field} at {n}");
            }
        }
        let still = open(name, Some("still"));
        check(name, &still.read(1).unwrap(), DIMS, 0.0);
        let unsigned = open(name, Some("unsigned")).read(0).unwrap();
        for n in 0..60 {
            let stored = (n % 4 + 10 * (n / 4 % 3) + 100 * (n / 12)) % 251;
            assert_eq!(unsigned.voxels().get(n), stored as f64, "{name} at {n}");
        }
        assert!(failure(name, Some("uneven")).contains("along z are not evenly spaced"));
    }
}

#[test]
fn zarr_of_both_versions_and_all_codecs() {
    for codec in ["blosc_lz4", "blosc_zstd", "blosc_zlib"] {
        let name = format!("large_v2_{codec}.zarr");
        check(&name, &read(&name), LARGE, 0.0);
    }
    let second = ["v2_bitshuffle", "v2_zlib", "v2_gzip", "v2_zstd", "v2_lz4", "v2_none"];
    let third = ["v3_zstd", "v3_gzip", "v3_blosc", "v3_transposed", "v3_big_endian", "v3_shards"];
    for name in second.iter().chain(&third).map(|name| format!("{name}.zarr")) {
        check(&name, &read(&name), DIMS, 0.0);
    }
    let said = failure("v2_bz2.zarr", None);
    assert!(said.contains("the codec \"bz2\"") && said.contains("Zstandard"), "{said}");
    let series = open("group.zarr", Some("ramp"));
    assert_eq!((series.field(), series.len(), series.time(1)), ("flow/ramp", 2, 4.0));
    check("group", &series.read(0).unwrap(), DIMS, 0.0);
    check_place("group", &series.read(0).unwrap(), SPACING, ORIGIN);
    assert!(series.read(1).unwrap().voxels().get(7).is_nan(), "a chunk that was never written");
}

#[test]
fn zarr_as_xarray_writes_it() {
    for name in ["xarray_v2.zarr", "xarray_v3.zarr"] {
        for field in ["ramp", "packed"] {
            let volume = open(name, Some(field)).read(0).unwrap();
            check_place(name, &volume, SPACING, ORIGIN);
            assert!(volume.voxels().get(1).is_nan(), "{name}: {field}");
            for n in (0..60).filter(|&n| n != 1) {
                let stored = n % 4 + 10 * (n / 4 % 3) + 100 * (n / 12);
                assert_eq!(volume.voxels().get(n), 2.0 * stored as f64 - 10.0, "{name}: {field} at {n}");
            }
        }
    }
    let empty = read("empty.zarr");
    assert!(empty.grid().dims() == [300; 3] && empty.voxels().get(26_999_999) == 7.0, "no chunk of it was written");
}

#[test]
fn tiff_stacks() {
    for (name, kept) in [
        ("plain_u2.tif", VoxelType::U16),
        ("deflate_f4.tif", VoxelType::F32),
        ("big_endian_i2.tif", VoxelType::I16),
        ("tiled_f8.tif", VoxelType::F64),
        ("imagej.tif", VoxelType::U16),
    ] {
        let volume = read(name);
        check(name, &volume, DIMS, 0.0);
        assert_eq!(volume.voxels().voxel_type(), kept, "{name}");
    }
    assert_eq!(read("imagej.tif").grid().spacing(), DVec3::new(1.0, 1.0, 2.0));
    let place = read("calibrated.tif").grid().spacing();
    assert!((place - DVec3::new(0.2, 0.25, 0.5)).abs().max_element() < 1e-6, "{place}");
    let series = open("frames.tif", None);
    assert_eq!(series.len(), 2);
    check("frames", &series.read(1).unwrap(), DIMS, 1000.0);
    assert!(failure("channels.tif", None).contains("2 channels"));
    assert!(failure("color.tif", None).contains("one value at a point"));
}

#[test]
fn plotfiles_on_a_level_with_coarser_values_where_it_has_no_box() {
    let series = open("plt00010", Some("ramp"));
    assert_eq!(series.time(0), 0.75);
    let fine = series.read(0).unwrap();
    assert_eq!(fine.grid().dims(), [8; 3]);
    check_place("plt", &fine, DVec3::splat(0.25), DVec3::splat(0.125));
    for n in 0..512 {
        let at = [n % 8, n / 8 % 8, n / 64];
        let ramp = |at: [usize; 3]| (at[0] + 10 * at[1] + 100 * at[2]) as f64;
        let inside = at.iter().all(|a| (2..6).contains(a));
        let want = if inside { 5000.0 + ramp(at.map(|a| a - 2)) } else { ramp(at.map(|a| a / 2)) };
        assert_eq!(fine.voxels().get(n), want, "{at:?}");
    }
    let options = Options { level: Some(0), field: Some("double".into()), ..Options::default() };
    let coarse = Series::open(&fixture("plt00010"), &options).unwrap().read(0).unwrap();
    assert_eq!((coarse.grid().dims(), coarse.voxels().get(63)), ([4; 3], 2.0 * 333.0));
}

#[test]
fn planes_are_those_of_the_whole() {
    for (name, field) in [
        ("gzip_f4_latest.h5", None),
        ("steps.vtkhdf", None),
        ("openpmd_F.h5", Some("rho")),
        ("netcdf3_classic.nc", Some("ramp")),
        ("netcdf4.nc", Some("packed")),
        ("v3_shards.zarr", None),
        ("v2_zlib.zarr", None),
        ("group.zarr", None),
        ("imagej.tif", None),
        ("plt00010", None),
    ] {
        let series = open(name, field);
        let whole = series.read(0).unwrap();
        let [nx, ny, nz] = whole.grid().dims();
        for planes in [0..1, 1..3, nz - 2..nz] {
            let slab = series.read_planes(0, planes.clone()).unwrap();
            assert_eq!(slab.grid().dims(), [nx, ny, planes.len()], "{name}");
            let start = planes.start as f64 * whole.grid().spacing().z;
            assert!((slab.grid().origin().z - whole.grid().origin().z - start).abs() < 1e-12, "{name}");
            for n in 0..slab.voxels().len() {
                let (a, b) = (slab.voxels().get(n), whole.voxels().get(planes.start * nx * ny + n));
                assert!(a == b || a.is_nan() && b.is_nan(), "{name} {planes:?} at {n}: {a}, {b}");
            }
        }
    }
}

#[test]
fn files_of_a_folder_or_pattern_come_by_their_numbers() {
    let folder = tempfile::tempdir().unwrap();
    let copy = |from: &str, to: &str| std::fs::copy(fixture(from), folder.path().join(to)).unwrap();
    copy("contiguous_i2_latest.h5", "step_9.h5");
    copy("gzip_f4_latest.h5", "step_10.h5");
    copy("plain_u2.tif", "step_11.tif");
    std::fs::write(folder.path().join("notes.txt"), "").unwrap();
    let series = Series::open(&folder.path().join("step_*.h5"), &Options::default()).unwrap();
    assert_eq!((series.len(), series.time(1)), (2, 1.0));
    let types = [0, 1].map(|n| series.read(n).unwrap().voxels().voxel_type());
    assert_eq!(types, [VoxelType::I16, VoxelType::F32]);
    let series = Series::open(folder.path(), &Options::default()).unwrap();
    assert_eq!(series.len(), 3);
    assert!(matches!(series.read(2), Err(ReadError::Field { .. })), "the stack has no such array");
    // A checkpoint of AMReX is no plotfile; times order files whose names do not.
    std::fs::create_dir_all(folder.path().join("chk00010/Level_0")).unwrap();
    std::fs::write(folder.path().join("chk00010/Header"), "Checkpoint version: 1\n").unwrap();
    assert_eq!(Series::open(folder.path(), &Options::default()).unwrap().len(), 3);
    let none = Series::open(&folder.path().join("*.nc"), &Options::default()).unwrap_err();
    assert!(none.to_string().contains("*.nc"), "{none}");
}
