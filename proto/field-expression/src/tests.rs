//! Expressions against closed forms and NumPy, and what is refused.

use super::*;
use glam::DVec3;

const DIMS: [usize; 3] = [7, 5, 6];

fn grid() -> Grid {
    Grid::new(DIMS, DVec3::new(0.5, 0.25, 2.0), DVec3::new(-1.0, 0.0, 3.0)).unwrap()
}

/// `f` at each sample point.
fn field(f: impl Fn(f64, f64, f64) -> f64) -> Option<Voxels> {
    let (grid, [nx, ny, _]) = (grid(), DIMS);
    let at = |n: usize| {
        let [x, y, z] = [n % nx, n / nx % ny, n / (nx * ny)].map(|n| n as f64);
        let p = grid.origin() + grid.spacing() * DVec3::new(x, y, z);
        f(p.x, p.y, p.z)
    };
    Some(Voxels::F64((0..grid.voxels()).map(at).collect()))
}

/// A linear velocity, whose differences are exact at every point, and a density.
const NAMES: [&str; 5] = ["rho", "v.x", "v.y", "v.z", "odd name-1"];

fn fields() -> Vec<Option<Voxels>> {
    vec![
        field(|x, y, z| 2.0 + x * x + y - z),
        field(|x, y, z| 1.0 * x + 2.0 * y + 3.0 * z),
        field(|x, y, z| 4.0 * x - 5.0 * y + 6.0 * z),
        field(|x, y, z| 7.0 * x - 8.0 * y + 9.0 * z),
        Some(Voxels::U8(vec![9; grid().voxels()])),
    ]
}

fn values(text: &str) -> Vec<f32> {
    FieldExpression::new(text, &NAMES).unwrap().evaluate(&grid(), &fields()).unwrap()
}

fn constant(text: &str) -> f32 {
    let values = values(text);
    assert!(values.iter().all(|v| (v - values[0]).abs() < 1e-4), "{text}: {values:?}");
    values[0]
}

#[test]
fn derivatives_of_a_linear_field_are_its_matrix() {
    for (text, expected) in [
        ("curl(v).x", -8.0 - 6.0),
        ("curl(v).y", 3.0 - 7.0),
        ("curl(v).z", 4.0 - 2.0),
        ("divergence(v)", 1.0 - 5.0 + 9.0),
        ("magnitude(curl(v))", (14.0_f64 * 14.0 + 16.0 + 4.0).sqrt()),
        ("gradient(v.y).z", 6.0),
        // -1/2 (J_xx^2 + J_yy^2 + J_zz^2) - J_xy J_yx - J_xz J_zx - J_yz J_zy
        ("q_criterion(v)", -0.5 * (1.0 + 25.0 + 81.0) - 8.0 - 21.0 + 48.0),
        // Eigenvalues of (J^2 + (J^T)^2) / 2 by numpy.linalg.eigvalsh.
        ("lambda2(v)", 3.454_117_8),
        ("dot(gradient(2 * rho / 2), vector(0, 1, 0))", 1.0),
        ("divergence(cross(v, vector(0, 0, 1)))", 4.0 - 2.0),
        ("gradient(3).x + min(2, 1) * max(2, 1)", 2.0),
        ("\"odd name-1\" ^ 0.5 - -2 ^ 2", 7.0),
        ("odd name-1", 9.0),
    ] {
        assert!((f64::from(constant(text)) - expected).abs() < 1e-4, "{text}: {} {expected}", constant(text));
    }
}

#[test]
fn arithmetic_is_that_of_each_point() {
    let (rho, vx) = (fields().swap_remove(0).unwrap(), fields().swap_remove(1).unwrap());
    let computed = values("sqrt(abs(v.x)) * 2 - rho / (1e1 + exp(-rho)) + log10(rho * rho + 1)");
    for (n, value) in computed.iter().enumerate() {
        let (rho, vx) = (rho.get(n), vx.get(n));
        let expected = vx.abs().sqrt() * 2.0 - rho / (10.0 + (-rho).exp()) + (rho * rho + 1.0).log10();
        assert!((f64::from(*value) - expected).abs() < 1e-5, "{n}: {value} {expected}");
    }
}

#[test]
fn a_missing_value_is_missing_in_what_depends_on_it_and_nowhere_else() {
    let mut fields = fields();
    let Some(Voxels::F64(rho)) = &mut fields[0] else { panic!("another type") };
    rho[0] = f64::NAN;
    let empty = |text: &str| {
        let values = FieldExpression::new(text, &NAMES).unwrap().evaluate(&grid(), &fields).unwrap();
        values.iter().enumerate().filter(|(_, v)| v.is_nan()).map(|(n, _)| n).collect::<Vec<_>>()
    };
    assert_eq!(empty("rho + 1"), [0]);
    assert_eq!(empty("max(rho, 0) + min(0, rho)"), [0]);
    assert_eq!(empty("gradient(rho).x"), [0, 1]);
    assert_eq!(empty("magnitude(v)"), [0; 0]);
}

#[test]
fn reach_sources_and_plain_fields_are_told() {
    let of = |text: &str| {
        let e = FieldExpression::new(text, &NAMES).unwrap();
        (e.reach(), e.sources().into_iter().collect::<Vec<_>>(), e.plain(), e.kept())
    };
    assert_eq!(of(" rho "), (0, vec![0], Some(0), 0));
    assert_eq!(of("v.z"), (0, vec![3], Some(3), 0));
    assert_eq!(of("magnitude(v)"), (0, vec![1, 2, 3], None, 0));
    assert_eq!(of("lambda2(v * rho)"), (1, vec![0, 1, 2, 3], None, 3));
    assert_eq!(of("divergence(curl(v))"), (2, vec![1, 2, 3], None, 3));
    assert_eq!(of("magnitude(curl(v))").3, 0);
}

#[test]
fn what_is_no_scalar_expression_is_refused_with_what_there_is() {
    let why = |text: &str| FieldExpression::new(text, &NAMES).unwrap_err().reason;
    for (text, words) in [
        ("", "it ends"),
        ("rho +", "it ends"),
        ("rho rho", "\"rho\" is not expected"),
        ("rho)", "')' is not expected"),
        ("(rho", "it ends where ')'"),
        ("1e999", "no number"),
        ("pressure", "no field \"pressure\". Fields: rho, v.x"),
        ("v", "is a vector where a scalar"),
        ("curl(rho)", "is a scalar where a vector"),
        ("sqrt(v)", "is a vector where a scalar"),
        ("v * v", "dot(a, b)"),
        ("magnitude(v + 1)", "cannot be joined"),
        ("sin(rho)", "sin of one argument is not known"),
        ("min(rho)", "min of one argument"),
        ("rho % 2", "'%' has no meaning"),
        ("\"rho", "not closed"),
        ("curl(v).w", "x, y or z"),
    ] {
        assert!(why(text).contains(words), "{text}: {}", why(text));
    }
    assert!(why(&"(".repeat(500)).contains("nested"));
    assert!(why(&format!("{}rho", "-2^".repeat(200))).contains("nested"));
    assert!(why(&"x".repeat(2000)).contains("2000 bytes"));
    assert!(why(&"curl(".repeat(60)).contains("it ends"));
    let turned = |n| format!("{}v{}.x", "curl(".repeat(n), ")".repeat(n));
    assert!(FieldExpression::new(&turned(3), &NAMES).is_ok());
    assert!(why(&turned(50)).contains("derivatives of"));
}

#[test]
fn a_slice_has_no_derivative_across_and_a_plain_field_keeps_its_type() {
    let grid = Grid::new([3, 1, 2], DVec3::ONE, DVec3::ZERO).unwrap();
    let fields = vec![Some(Voxels::U16(vec![1, 3, 9, 2, 4, 8]))];
    let of = |text: &str| FieldExpression::new(text, &["f"]).unwrap().evaluate(&grid, &fields).unwrap();
    assert_eq!(of("gradient(f).y"), [0.0; 6]);
    assert_eq!(of("gradient(f).x"), [2.0, 4.0, 6.0, 2.0, 3.0, 4.0]);
    assert_eq!(of("gradient(f).z"), [1.0, 1.0, -1.0, 1.0, 1.0, -1.0]);
    let shown = ShownFields::new("f", Some("f / 2"), &["f"]).unwrap();
    let volume = shown.volume(grid, fields.clone()).unwrap();
    assert_eq!((volume.voxels(), shown.is_derived()), (fields[0].as_ref().unwrap(), true));
    assert_eq!(volume.color_field().unwrap(), ("f / 2", &Voxels::F32(vec![0.5, 1.5, 4.5, 1.0, 2.0, 4.0])));
    assert!(FieldExpression::new("f", &["f"]).unwrap().evaluate(&grid, &[]).is_err());
}
