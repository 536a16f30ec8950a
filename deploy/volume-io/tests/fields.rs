//! Several arrays of a file: vectors, expressions, and what cannot be computed of them.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use lamina_model::Voxels;
use lamina_volume_io::{Options, Series};
use std::path::{Path, PathBuf};

/// A vector, a scalar of points and one of cells, on 3 x 2 x 1 points.
fn file(folder: &Path) -> PathBuf {
    let array = |name: &str, kind: &str, components: u8, values: &str| {
        format!(
            "<DataArray Name='{name}' type='{kind}' NumberOfComponents='{components}' format='ascii'>{values}</DataArray>"
        )
    };
    let vector = array("v", "Float32", 3, "3 4 0 0 5 12 6 8 0 0 0 1 1 2 2 -4 3 0");
    let scalars = array("rho", "UInt8", 1, "1 2 4 8 16 32") + &array("names", "String", 1, "");
    let image = format!(
        "<VTKFile type='ImageData'><ImageData WholeExtent='0 2 0 1 0 0' Spacing='0.5 1 1'><Piece Extent='0 2 0 1 0 0'>\
         <PointData>{vector}{scalars}</PointData><CellData>{}</CellData></Piece></ImageData></VTKFile>",
        array("cell", "Float32", 1, "1 2")
    );
    let path = folder.join("fields.vti");
    std::fs::write(&path, image).unwrap();
    path
}

fn open(path: &Path, field: Option<&str>) -> Result<Series, String> {
    let options = Options { field: field.map(str::to_owned), ..Options::default() };
    Series::open(path, &options).map_err(|e| e.to_string())
}

fn values(path: &Path, field: &str) -> Vec<f64> {
    let volume = open(path, Some(field)).unwrap().read(0).unwrap();
    (0..volume.voxels().len()).map(|n| volume.voxels().get(n)).collect()
}

#[test]
fn an_expression_is_computed_of_the_arrays_of_a_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = file(folder.path());
    assert_eq!(open(&path, None).unwrap().field(), "rho", "the first scalar");
    assert_eq!(values(&path, "v.y"), [4.0, 5.0, 8.0, 0.0, 2.0, 3.0]);
    assert_eq!(values(&path, "magnitude(v)"), [5.0, 13.0, 10.0, 1.0, 3.0, 5.0]);
    assert_eq!(values(&path, "gradient(rho).x"), [2.0, 3.0, 4.0, 16.0, 24.0, 32.0]);
    assert_eq!(values(&path, "rho * 2 - v.z"), [2.0, -8.0, 8.0, 15.0, 30.0, 64.0]);
    let series = open(&path, Some("magnitude(v)")).unwrap();
    assert_eq!(series.field(), "magnitude(v)");
    let colored = series.with_color_field(0, "v.x / 2", series.read(0).unwrap()).unwrap();
    assert_eq!(colored.color_field().unwrap().1, &Voxels::F32(vec![1.5, 0.0, 3.0, 0.0, 0.5, -2.0]));
    // A missing value is missing in what is computed of it.
    let options = Options { field: Some("rho + 1".into()), missing: Some(4.0), ..Options::default() };
    let volume = Series::open(&path, &options).unwrap().read(0).unwrap();
    assert!(volume.voxels().get(2).is_nan() && volume.voxels().get(3) == 9.0);
}

#[test]
fn what_cannot_be_computed_is_said_with_what_there_is() {
    let folder = tempfile::tempdir().unwrap();
    let path = file(folder.path());
    for (field, words) in [
        ("v", "3 components"),
        ("pressure", "there is no array \"pressure\""),
        ("magnitude(u)", "there is no field \"u\""),
        ("curl(v)", "is a vector"),
        ("names", "names"),
    ] {
        let said = open(&path, Some(field)).and_then(|s| s.read(0).map_err(|e| e.to_string())).unwrap_err();
        assert!(said.contains(words) && said.contains("v.x"), "{field}: {said}");
    }
    let mixed = open(&path, Some("rho + cell")).unwrap().read(0).unwrap_err().to_string();
    assert!(mixed.contains("on other points"), "{mixed}");
    assert!(open(&path, Some("2 + 3")).unwrap().read(0).unwrap_err().to_string().contains("without a field"));
}

#[test]
fn the_array_of_a_raw_file_is_called_scalar_in_expressions_and_takes_any_other_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("ramp_3x1x1_uint8.raw");
    std::fs::write(&path, [1, 3, 9]).unwrap();
    assert_eq!(values(&path, "magnitude(gradient(scalar))"), [2.0, 4.0, 6.0]);
    for name in ["Density (kg/m3)", "a-b", "scalar"] {
        let series = open(&path, Some(name)).unwrap();
        assert_eq!((series.field(), series.read(0).unwrap().voxels()), (name, &Voxels::U8(vec![1, 3, 9])));
    }
}
