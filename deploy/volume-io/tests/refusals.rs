//! Every way to be wrong names the file, what is wrong with it, and what to do about it.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use flate2::Compression;
use flate2::write::GzEncoder;
use lamina_model::VoxelType;
use lamina_volume_io::{Options, RawSpec, ReadError, Series, write_pvd};
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

fn failure(path: &Path, options: &Options) -> String {
    let error = Series::open(path, options).and_then(|series| series.read(0)).unwrap_err().to_string();
    assert!(error.contains(&path.file_name().unwrap().to_string_lossy().into_owned()), "names the file: {error}");
    error
}

/// Writes `content` as `name` and expects all of `words` in the complaint.
fn refused(name: &str, content: impl AsRef<[u8]>, words: &[&str]) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    fs::write(&path, content).unwrap();
    let error = failure(&path, &Options::default());
    for word in words {
        assert!(error.contains(word), "no \"{word}\" in: {error}");
    }
}

fn image(file: &str, image: &str, piece: &str, array: &str) -> String {
    format!(
        "<VTKFile type=\"ImageData\" {file}><ImageData {image}><Piece {piece}><PointData>{array}</PointData>\
         </Piece></ImageData></VTKFile>"
    )
}

const EXTENT: &str = r#"WholeExtent="0 1 0 1 0 0""#;
const FOUR: &str = r#"<DataArray type="UInt8" Name="v" format="ascii">1 2 3 4</DataArray>"#;

#[test]
fn unknown_endings_and_missing_files() {
    refused("a.vtu", "", &[".pvd .vti .nrrd .nhdr .raw .raw.gz"]);
    refused("a.gz", "", &[".raw.gz"]);
    refused("none", "", &[".pvd"]);
    let folder = tempfile::tempdir().unwrap();
    for name in ["a.pvd", "a.vti", "a.nrrd", "a_2x2x2_uint8.raw"] {
        assert!(failure(&folder.path().join(name), &Options::default()).contains("check that it exists"));
    }
    fs::create_dir(folder.path().join("folder.vti")).unwrap();
    assert!(failure(&folder.path().join("folder.vti"), &Options::default()).contains("cannot be read"));
}

#[test]
fn image_data_that_this_reader_leaves_out_is_named() {
    let plain = image("", EXTENT, "", FOUR);
    refused("a.vti", plain.replace("ImageData", "RectilinearGrid"), &["RectilinearGrid", "resample"]);
    refused("a.vti", plain.replace("</Piece>", "</Piece><Piece></Piece>"), &["several Pieces", "one Piece"]);
    refused("a.vti", image("", EXTENT, r#"Extent="0 0 0 1 0 0""#, FOUR), &["not the whole"]);
    refused("a.vti", image(r#"byte_order="Middle""#, EXTENT, "", FOUR), &["byte_order Middle", "BigEndian"]);
    refused("a.vti", image(r#"header_type="UInt8""#, EXTENT, "", FOUR), &["header_type UInt8", "UInt64"]);
    let turned = format!(r#"{EXTENT} Direction="0 1 0 -1 0 0 0 0 1""#);
    refused("a.vti", image("", &turned, "", FOUR), &["Direction", "without rotation"]);
    let packed = FOUR.replace("ascii", "binary");
    let lz4 = image(r#"compressor="vtkLZ4DataCompressor""#, EXTENT, "", &packed);
    refused("a.vti", lz4, &["vtkLZ4DataCompressor", "vtkZLibDataCompressor"]);
    refused("a.vti", image("", EXTENT, "", &FOUR.replace("ascii", "odd")), &["format odd", "appended"]);
    refused("a.vti", image("", EXTENT, "", &FOUR.replace("Name", "TimeStep='0' Name")), &["several time steps"]);
}

#[test]
fn image_data_that_is_broken_is_refused() {
    refused("a.vti", "", &["no <VTKFile>"]);
    refused("a.vti", "<VTKFile type='ImageData'>", &["no <Piece>"]);
    refused("a.vti", "<VTKFile type='ImageData'", &["XML"]);
    refused("a.vti", image("", EXTENT, "", ""), &["no scalar array", "none"]);
    refused("a.vti", image("", "", "", FOUR), &["no attribute WholeExtent"]);
    refused("a.vti", image("", r#"WholeExtent="0 1 0 1""#, "", FOUR), &["needs 6 numbers"]);
    refused("a.vti", image("", r#"WholeExtent="0 1 0 -1 0 0""#, "", FOUR), &["no points"]);
    let endless = r#"WholeExtent="-9223372036854775808 9223372036854775807 0 1 0 0""#;
    refused("a.vti", image("", endless, "", FOUR), &["no points"]);
    refused("a.vti", image("", r#"WholeExtent="0 99999 0 99999 0 99999""#, "", FOUR), &["exceeds"]);
    refused("a.vti", image("", r#"WholeExtent="0 999 0 999 0 999""#, "", FOUR), &["cannot hold 1000000000"]);
    refused("a.vti", image("", &format!(r#"{EXTENT} Spacing="1 0 1""#), "", FOUR), &["grid.spacing", "header"]);
    refused("a.vti", image("", EXTENT, "", &FOUR.replace("3 4", "3")), &["cannot hold 4"]);
    refused("a.vti", image("", EXTENT, "", &FOUR.replace("3 4", "300")), &["\"300\" is no value"]);
    refused("a.vti", image("", EXTENT, "", &FOUR.replace("3 4", "3 4 5")), &["follows the last"]);
    refused("a.vti", image("", EXTENT, "", &FOUR.replace("ascii", "appended")), &["appended data", "missing"]);
    refused("a.vti", image("", EXTENT, "", &FOUR.replace("ascii", "binary").replace("1 2 3 4", "")), &["missing"]);
    let five = FOUR.replace("ascii", "binary").replace("1 2 3 4", "BQAAAAECAwQF");
    refused("a.vti", image("", EXTENT, "", &five), &["array of 5 bytes", "needs 4"]);
    let large = FOUR.replace("UInt8", "Int64").replace("4<", "9007199254740993<");
    refused("a.vti", image("", EXTENT, "", &large), &["9007199254740993 has no double"]);
}

#[test]
fn collections_in_disorder() {
    let pvd = |entries: &str| format!("<VTKFile type=\"Collection\"><Collection>{entries}</Collection></VTKFile>");
    let entry = |time: &str, file: &str| format!("<DataSet timestep=\"{time}\" part=\"0\" file=\"{file}\"/>");
    refused("a.pvd", pvd(""), &["lists no step"]);
    refused("a.pvd", "<VTKFile type='ImageData'/>", &["ImageData", "ending"]);
    refused("a.pvd", pvd(&(entry("1", "x.vti") + &entry("1.0", "y.vti"))), &["x.vti", "y.vti", "both have the time 1"]);
    refused("a.pvd", pvd(&(entry("2", "x.vti") + &entry("1", "y.vti"))), &["y.vti at time 1 comes after"]);
    refused("a.pvd", pvd(&entry("nan", "x.vti")), &["x.vti has the time NaN"]);
    refused("a.pvd", pvd(&entry("soon", "x.vti")), &["timestep", "soon"]);
    refused("a.pvd", pvd("<DataSet file='x.vti'/>"), &["no attribute timestep"]);
    refused("a.pvd", pvd("<DataSet timestep='0'/>"), &["no attribute file"]);
    refused("a.pvd", pvd(&entry("0", "x.vti").replace("part=\"0\"", "part=\"3\"")), &["part 3", "x.vti", "merge"]);
    refused("a.pvd", pvd(&entry("0", "x.vtu")), &["x.vtu", "convert"]);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("b.pvd");
    fs::write(&path, pvd(&entry("0", "gone.vti"))).unwrap();
    let error = Series::open(&path, &Options::default()).unwrap_err();
    assert!(matches!(&error, ReadError::Io { path, .. } if path.ends_with("gone.vti")), "{error}");
    assert!(matches!(write_pvd(&path, &[]), Err(ReadError::Collection { .. })));
    assert!(write_pvd(&path, &[(1.0, "x".into()), (1.0, "y".into())]).is_err());
    assert!(matches!(write_pvd(folder.path(), &[(1.0, "x".into())]), Err(ReadError::Write { .. })));
}

#[test]
fn raw_files_of_unknown_or_wrong_shape() {
    let remedy = "--dims 256x256x128 --dtype uint8";
    refused("a.raw", "", &["dims and voxel type", remedy]);
    refused("a_2x2x2.raw", "", &["its voxel type", remedy]);
    refused("a_uint8.raw.gz", "", &["its dims", remedy]);
    refused("a_2x2x2_uint8.raw", "1234567", &["holds 7 bytes", "2x2x2 voxels of uint8 are 8"]);
    refused("a_2x2x2_uint8.raw", "123456789", &["holds 9 bytes"]);
    refused("a_2x0x2_uint8.raw", "", &["grid.dims", "0 voxels"]);
    let gzipped = |bytes: usize| {
        let mut gzip = GzEncoder::new(Vec::new(), Compression::best());
        gzip.write_all(&vec![0; bytes]).unwrap();
        gzip.finish().unwrap()
    };
    refused("a_2x2x2_uint8.raw.gz", gzipped(7), &["holds fewer bytes"]);
    refused("a_2x2x2_uint8.raw.gz", gzipped(1 << 24), &["holds more bytes"]);
    refused("a_4096x4096x4096_float64.raw.gz", gzipped(1 << 20), &["holds fewer bytes"]);
    let mut broken = gzipped(8);
    let crc = broken.len() - 6;
    broken[crc] ^= 1;
    refused("a_2x2x2_uint8.raw.gz", broken, &["damaged"]);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.raw");
    fs::write(&path, "12345678").unwrap();
    let raw = RawSpec { dims: Some([2, 2, 2]), voxel_type: Some(VoxelType::U16), spacing: None };
    assert!(failure(&path, &Options { raw, ..Options::default() }).contains("are 16"));
}

#[test]
fn nrrd_files_that_are_left_out_or_broken() {
    let header = "NRRD0004\ntype: uchar\ndimension: 3\nsizes: 2 2 1\nencoding: raw\n";
    let with = |from: &str, to: &str| format!("{}\n1234", header.replace(from, to));
    refused("a.nrrd", "P5\n", &["does not begin"]);
    refused("a.nrrd", header, &["data file"]);
    refused("a.nrrd", vec![b'\n'; 4], &["does not begin"]);
    refused("a.nrrd", [b"NRRD0004\n".to_vec(), vec![b'#'; 2 << 20]].concat(), &["does not end"]);
    refused("a.nrrd", with("type: uchar\n", ""), &["no field \"type\""]);
    refused("a.nrrd", with("uchar", "block"), &["type block", "float or double"]);
    refused("a.nrrd", with("uchar", "float"), &["endian"]);
    refused("a.nrrd", with("raw", "bzip2"), &["encoding bzip2", "gzip"]);
    refused("a.nrrd", with("2 2 1", "2 2"), &["does not go with 2 sizes"]);
    refused("a.nrrd", with("2 2 1", "2 2 2"), &["ends too early"]);
    refused("a.nrrd", with("2 2 1", "2 2 0"), &["grid.dims"]);
    refused("a.nrrd", with("2 2 1", "2 -2 1"), &["not a list"]);
    refused("a.nrrd", with("2 2 1", "4096 4096 4096"), &["ends too early"]);
    refused("a.nrrd", with("raw\n", "raw\nbyte skip: 9223372036854775807\n"), &["ends too early"]);
    refused("a.nrrd", with("raw\n", "raw\nline skip: 3\n"), &["ends too early"]);
    refused("a.nrrd", with("raw\n", "raw\nbyte skip: -2\n"), &["byte skip -2"]);
    refused("a.nrrd", with("raw\n", "gzip\nbyte skip: -1\n"), &["byte skip -1"]);
    refused("a.nrrd", with("raw\n", "raw\ndata file: LIST\n"), &["several files", "join"]);
    refused("a.nrrd", with("raw\n", "raw\nspace origin: (1,2)\n"), &["space origin", "3 numbers"]);
    refused("a.nrrd", with("raw\n", "raw\nspacings: 1 1\n"), &["names 2 axes of 3"]);
    refused("a.nrrd", with("raw\n", "raw\nnonsense\n"), &["no field", "nonsense"]);
}

/// A Zarr array of version 2 on 60 points in one chunk, packed by gzip.
fn zarr(folder: &Path, more: &str, chunk: &[u8]) -> PathBuf {
    let store = folder.join("a.zarr");
    fs::create_dir_all(&store).unwrap();
    let meta = r#"{"zarr_format":2,"shape":[5,3,4],"chunks":[5,3,4],"dtype":"<f4","fill_value":0,"order":"C","filters":null,
                   "compressor":{"id":"gzip","level":5}}"#;
    let meta = if more.is_empty() { meta.to_owned() } else { more.to_owned() };
    fs::write(store.join(".zarray"), meta).unwrap();
    fs::write(store.join("0.0.0"), chunk).unwrap();
    store
}

#[test]
fn stores_that_claim_more_than_they_hold_or_hold_more_than_they_claim() {
    let folder = tempfile::tempdir().unwrap();
    let packed = |bytes: usize| {
        let mut gzip = GzEncoder::new(Vec::new(), Compression::best());
        gzip.write_all(&vec![0; bytes]).unwrap();
        gzip.finish().unwrap()
    };
    let said = |more: &str, chunk: &[u8]| {
        let error = Series::open(&zarr(folder.path(), more, chunk), &Options::default()).and_then(|s| s.read(0));
        error.map(|_| String::new()).unwrap_or_else(|e| e.to_string())
    };
    assert_eq!(said("", &packed(240)), "");
    let bomb = said("", &packed(64 << 20));
    assert!(bomb.contains("0.0.0") && bomb.contains("unpacks to more than 244 bytes"), "{bomb}");
    assert!(said("", &packed(239)).contains("a chunk of 239 bytes, which its shape makes 240"));
    assert!(said("", b"text").contains("gzip"));
    let shape = |shape: &str| {
        let codec = r#""dtype":"<f4","fill_value":0,"order":"C","filters":null,"compressor":null"#;
        said(&format!(r#"{{"zarr_format":2,"shape":{shape},"chunks":[5,3,4],{codec}}}"#), b"")
    };
    let large = shape("[40000,30000,100]");
    assert!(large.contains("\"scalar\" takes") && large.contains("memory"), "{large}");
    assert!(shape("[5,3,-4]").contains("no list of lengths") && shape("[]").contains("chunks"));
    assert!(shape("[5,0,4]").contains("grid.dims"));
    let chunks = r#"{"zarr_format":2,"shape":[5,3,4],"chunks":[99999,99999,99999],"dtype":"<f4"}"#;
    assert!(said(chunks, b"").contains("too many"));
    assert!(said("{", b"").contains("JSON"));
    assert!(said(&"[".repeat(100_000), b"").contains("JSON"));
    let other = r#"{"zarr_format":2,"shape":[5,3,4],"chunks":[5,3,4],"dtype":"|S4"}"#;
    assert!(said(other, b"").contains("|S4"));
}

#[test]
fn files_of_arrays_that_are_none() {
    refused("a.h5", "", &["HDF5"]);
    refused("a.h5", "P5", &["HDF5"]);
    refused("a.nc", "CDF", &["HDF5"]);
    refused("a.nc", "CDF\x01", &["damaged"]);
    refused("a.tif", "II*\0", &["damaged"]);
    refused("a.zarr", "", &["no folder", "unpack"]);
    let folder = tempfile::tempdir().unwrap();
    let plot = folder.path().join("plt0");
    fs::create_dir_all(plot.join("Level_0")).unwrap();
    for (header, word) in [
        ("", "plotfile"),
        ("HyperCLaw-V1.1\nmany", "number of components"),
        ("HyperCLaw-V1.1\n99999999999\nrho", "component is missing"),
        ("HyperCLaw-V1.1\n1\nrho\n2\n", "three dimensions"),
        (
            "HyperCLaw-V1.1\n1\nrho\n3\n0\n0\n0 0 0\n1 1 1\n\n((0,0,0) (1,1,1) (0,0,0))\n../../x/Level_0/Cell\n",
            "levels",
        ),
        ("HyperCLaw-V1.1\n1\nrho\n3\n0\n0\n0 0 0\n1 1 1\n\n((0,0,0) (1,1,1) (0,0,0))\nLevel_0/../../Cell\n", "outside"),
    ] {
        fs::write(plot.join("Header"), header).unwrap();
        let error = Series::open(&plot, &Options::default()).unwrap_err().to_string();
        assert!(error.contains(word), "no \"{word}\" in: {error}");
    }
}
