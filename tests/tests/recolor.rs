//! A recorded volume in other colors and effects than it was made for: what the page's editors ask for.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use glam::DVec3;
use lamina_codec::{DecodeLimits, EncodeOptions, decode_any, encode_any};
use lamina_model::effects::{ClipBox, Isosurface, Shading};
use lamina_model::{
    Appearance, ControlPoint, Effects, GenerationParams, Image, Representation, Scene, Segmentation, TransferFunction,
};
use lamina_raycast::{Backend, Field};
use lamina_tests::{clumps, clumps_transfer, front_scene, sampled_cube, transfer};
use lamina_vdi_render::{self as viz, Detail, Drawable};

const SIZE: u32 = 160;

/// What the viewer has of the clumps, made with error bound `bound`.
fn recorded(representation: Representation, bound: f64) -> Drawable {
    let field = Field::new(sampled_cube(48, clumps), &front_scene(clumps_transfer()));
    let params = match representation {
        Representation::Vdi => GenerationParams::vdi(48, bound).unwrap(),
        Representation::Volume => GenerationParams::volume(48, bound).unwrap(),
    };
    let (intermediate, _) = Backend::cpu().represent(&field, &params, Segmentation::Fitted).unwrap();
    let bytes = encode_any(&intermediate, &EncodeOptions::default()).unwrap();
    Drawable::new(decode_any(&bytes, &DecodeLimits::default()).unwrap())
}

fn picture(shown: &Drawable) -> Image {
    let camera = shown.camera().orbit(25.0, 15.0, 1.0).unwrap();
    viz::Backend::default().render(shown, &camera, SIZE, SIZE, Detail::Cubic).unwrap()
}

/// The data itself in `scene`, from the same place.
fn truth(scene: &Scene) -> Image {
    let camera = scene.camera.orbit(25.0, 15.0, 1.0).unwrap();
    Backend::cpu().raycast(&Field::new(sampled_cube(48, clumps), scene), &camera, SIZE, SIZE).unwrap()
}

fn psnr_db(a: &Image, b: &Image) -> f64 {
    let squares = a.pixels().iter().zip(b.pixels()).flat_map(|(a, b)| (0..3).map(|c| f64::from(a[c] - b[c]).powi(2)));
    -10.0 * (squares.sum::<f64>() / (3.0 * f64::from(SIZE * SIZE))).log10()
}

fn opacities(points: &[(f64, f64)]) -> Vec<ControlPoint> {
    let colored: Vec<_> = points.iter().map(|&(at, opacity)| (at, [at, 1.0 - at, 0.5], opacity)).collect();
    transfer(0.05, &colored).points().to_vec()
}

fn colors(points: Vec<ControlPoint>) -> Appearance {
    Appearance { points: Some(points), effects: None }
}

#[test]
fn other_colors_are_as_right_as_the_error_bound() {
    // A band in the middle, where the recorded function is a slope, and haze where it shows nothing.
    let wished = opacities(&[(0.0, 0.3), (0.2, 0.0), (0.45, 0.5), (0.6, 0.0), (1.0, 0.2)]);
    // Without what is transparent below 0.15 in `clumps_transfer`.
    let kept = opacities(&[(0.15, 0.0), (0.15, 0.075), (0.2, 0.0), (0.45, 0.5), (0.6, 0.0), (1.0, 0.2)]);
    let mut function = clumps_transfer();
    function = TransferFunction::new(*function.range(), function.stated_unit_length(), kept).unwrap();
    let truth = truth(&Scene { transfer: function, ..front_scene(clumps_transfer()) });
    for (bound, least_db) in [(1e-4, 60.0), (0.003, 42.0)] {
        let shown = recorded(Representation::Volume, bound).with_appearance(&colors(wished.clone())).unwrap();
        let got = psnr_db(&picture(&shown), &truth);
        assert!(got > least_db, "bound {bound}: {got} dB");
    }
}

#[test]
fn what_was_not_recorded_stays_transparent() {
    let hidden = opacities(&[(0.0, 1.0), (0.14, 1.0), (0.14, 0.0), (1.0, 0.0)]);
    let picture = picture(&recorded(Representation::Volume, 0.01).with_appearance(&colors(hidden)).unwrap());
    assert!(picture.pixels().iter().all(|p| *p == [0.0; 3]));
}

#[test]
fn a_vdi_and_points_that_are_none_are_refused() {
    let any = opacities(&[(0.0, 0.5)]);
    assert_eq!(recorded(Representation::Vdi, 0.05).with_appearance(&colors(any)).err().unwrap().thing, "appearance");
    let volume = recorded(Representation::Volume, 0.05);
    for points in [vec![], vec![ControlPoint { at: 2.0, color: [0.0; 3], opacity: 0.5 }]] {
        assert_eq!(volume.with_appearance(&colors(points)).err().unwrap().thing, "transfer.points");
    }
}

/// Effects one by one, on the data and on what was recorded of it without any.
#[test]
fn other_effects_are_as_right_as_the_error_bound() {
    let light = Some(DVec3::new(0.5, 1.0, 1.0));
    let surface = Isosurface { value: 0.6, color: [0.9, 0.8, 0.7], opacity: 0.5 };
    let clip_box = ClipBox { min: DVec3::splat(-0.3), max: DVec3::splat(0.6) };
    let asked = [
        ("shading", Effects { light, shading: Some(Shading::default()), ..Effects::default() }),
        ("shadows", Effects { light, shadows: Some(0.7), ..Effects::default() }),
        ("occlusion", Effects { ambient_occlusion: Some(0.7), ..Effects::default() }),
        ("surfaces", Effects { isosurfaces: vec![surface], ..Effects::default() }),
        ("box", Effects { clip_box: Some(clip_box), ..Effects::default() }),
    ];
    let plain = truth(&front_scene(clumps_transfer()));
    for (name, effects) in asked {
        let truth = truth(&Scene { effects: effects.clone(), ..front_scene(clumps_transfer()) });
        assert!(psnr_db(&plain, &truth) < 35.0, "{name} is seen");
        for (bound, least_db) in [(1e-4, 60.0), (0.003, 40.0)] {
            let appearance = Appearance { points: None, effects: Some(effects.clone()) };
            let shown = recorded(Representation::Volume, bound).with_appearance(&appearance).unwrap();
            let got = psnr_db(&picture(&shown), &truth);
            assert!(got > least_db, "{name}, bound {bound}: {got} dB");
        }
    }
}
