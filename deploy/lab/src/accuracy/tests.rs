//! Orders of convergence against closed forms.

use super::closed_forms;
use super::curve::{ErrorCurve, ErrorSource, Parameter, Point};
use super::error::Error;
use super::integrator::{Integrator, Method};
use super::optics::Optics;
use super::scalars::{Interpolation, Scalars};
use glam::DVec3;
use lamina_model::{ControlPoint, Grid, Ray, ScalarRange, Scale, TransferFunction, Volume, Voxels, suggest};

fn order(errors: &[(f64, Error)]) -> f64 {
    let knob = Parameter {
        key: "h",
        title: "",
        unit: "",
        source: ErrorSource::Plain,
        coarseness: |h| h,
        plotted: |h| h,
        priced: false,
    };
    let points = errors.iter().map(|&(h, error)| Point::new(h, error, 0.0)).collect();
    ErrorCurve { knob, points }.convergence(0.0).order.unwrap()
}

#[test]
fn the_reference_meets_its_closed_forms() {
    let met = closed_forms::check().unwrap();
    assert!(met.len() == 3 && met[0].error.rms < 1e-14, "a uniform medium is exact");
}

#[test]
fn midpoint_and_preintegration_are_of_second_order_or_better() {
    let [uniform, opacity, color] = closed_forms::all().unwrap();
    let errors = |form: &closed_forms::ClosedForm, preintegrated| {
        let at = |step: f64| {
            let method = Method { preintegrated, ..Method::midpoint(step) };
            (step, form.error(|integrator, rays| integrator.colors(rays, &method)))
        };
        [2.0, 1.0, 0.5, 0.25].map(at)
    };
    assert!(errors(&uniform, false)[0].1.max < 1e-14);
    for form in [&opacity, &color] {
        let found = order(&errors(form, false));
        assert!((found - 2.0).abs() < 0.2, "midpoint: order {found}");
    }
    // The scalar is linear here, so pre-integration knows the optical depth exactly, whatever the step.
    let (midpoint, preintegrated) = (errors(&opacity, false)[0].1, errors(&opacity, true)[0].1);
    assert!(preintegrated.max < 1e-6 && midpoint.max > 1e-4, "{midpoint:?} {preintegrated:?}");
    let found = order(&errors(&color, true));
    assert!((found - 2.0).abs() < 0.2, "pre-integration, whose own light is not taken from: order {found}");
}

/// Light of parallel rays along z through a unit box of `cells` cells whose field is `f(x)`, against its closed form.
fn across(cells: usize, interpolation: Interpolation, f: fn(f64) -> f64) -> Error {
    let grid = Grid::new([cells + 1, 5, 5], DVec3::new(1.0 / cells as f64, 0.25, 0.25), DVec3::ZERO).unwrap();
    let voxels = (0..grid.voxels()).map(|n| f((n % (cells + 1)) as f64 / cells as f64)).collect();
    let volume = Volume::new(grid, Voxels::F64(voxels)).unwrap();
    let point = |at, opacity| ControlPoint { at, color: [1.0; 3], opacity };
    let range = ScalarRange::new(0.0, 1.0, Scale::Linear).unwrap();
    let transfer = TransferFunction::new(range, Some(1.0), vec![point(0.0, 0.0), point(1.0, 0.8)]).unwrap();
    let scene = suggest::suggest(&[&volume]).unwrap();
    let optics = Optics::new(&transfer, 1.0);
    let scalars = Scalars::new(volume, &range);
    // Away from the walls, where a cubic has no neighbor beyond.
    let xs: Vec<f64> = (0..400).map(|n| 0.3 + 0.4 * (f64::from(n) + 0.37) / 400.0).collect();
    let ray = |&x: &f64| Ray { origin: DVec3::new(x, 0.5, -1.0), direction: DVec3::Z };
    let rays: Vec<Ray> = xs.iter().map(ray).collect();
    // The field does not change along a ray, so alpha is the transfer function's own: 0.8 f(x) of one length.
    let exact: Vec<[f64; 3]> = xs.iter().map(|&x| [0.8 * f(x); 3]).collect();
    let method = Method { interpolation, ..Method::midpoint(1.0) };
    Error::between(&Integrator::new(&scalars, &optics, &scene).colors(&rays, &method), &exact)
}

#[test]
fn interpolations_converge_with_their_orders() {
    let found = |how| {
        let at = |cells: usize| (1.0 / cells as f64, across(cells, how, |x| 0.5 + 0.4 * (5.0 * x).sin()));
        order(&[8, 16, 32, 64].map(at))
    };
    let (nearest, trilinear, tricubic) =
        (found(Interpolation::Nearest), found(Interpolation::Trilinear), found(Interpolation::Tricubic));
    assert!((nearest - 1.0).abs() < 0.15, "nearest: order {nearest}");
    assert!((trilinear - 2.0).abs() < 0.2, "trilinear: order {trilinear}");
    assert!(tricubic > 2.7, "tricubic: order {tricubic}");
}

#[test]
fn sums_in_single_precision_keep_seven_digits() {
    let [_, opacity, _] = closed_forms::all().unwrap();
    let seen = |single| {
        opacity.error(|integrator, rays| integrator.colors(rays, &Method { single, ..Method::midpoint(1.0 / 64.0) }))
    };
    let (single, double) = (seen(true), seen(false));
    assert!((single.rms - double.rms).abs() < 1e-6 && single != double, "{single:?} {double:?}");
}
