//! Counters of expensive lookups in kernels, compiled into the crate's own tests only.

#[cfg(test)]
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// Values, gradients, shadows, occlusion, colors.
#[cfg(test)]
static COUNTS: [AtomicU64; 5] = [const { AtomicU64::new(0) }; 5];

macro_rules! counter {
    ($(#[$doc:meta])* $name:ident, $n:literal) => {
        $(#[$doc])*
        #[inline(always)]
        pub(crate) fn $name() {
            #[cfg(test)]
            COUNTS[$n].fetch_add(1, Relaxed);
        }
    };
}

counter!(
    /// Interpolation of the field for an effect: at the end of a step, at a surface, or in the middle of a clipped step.
    value,
    0
);
counter!(
    /// Evaluation of a gradient.
    gradient,
    1
);
counter!(
    /// Lookup of the light volume for shadows.
    shadow,
    2
);
counter!(
    /// Lookup of the light volume for ambient occlusion.
    occlusion,
    3
);
counter!(
    /// Lookup of the color field.
    color,
    4
);

/// Counts since the last call.
#[cfg(test)]
pub(crate) fn take() -> [u64; 5] {
    [0, 1, 2, 3, 4].map(|n| COUNTS[n].swap(0, Relaxed))
}

/// Test cases that the kernels of every level share.
#[cfg(test)]
pub(crate) mod cases {
    use crate::Field;
    use glam::DVec3;
    use lamina_model::effects::{ClipPlane, ColorField, DepthCue, Isosurface, Shading};
    use lamina_model::{
        Camera, ControlPoint, Effects, Grid, ScalarRange, Scale, Scene, TransferFunction, Volume, Voxels,
    };

    /// Effects, each with the counters that it must raise.
    pub(crate) fn asked() -> Vec<(Effects, [bool; 5])> {
        let light = Some(DVec3::new(1.0, 2.0, 3.0));
        let none = Effects::default;
        let surface = Isosurface { value: 0.4, color: [1.0; 3], opacity: 1.0 };
        let range = ScalarRange::new(0.0, 9.0, Scale::Linear).unwrap();
        let second = ColorField { name: "second".into(), range, points: ColorField::cool_to_warm() };
        let both = (Some(0.5), Some(0.5));
        let plane = ClipPlane { normal: DVec3::Z, offset: 5.2 };
        vec![
            (Effects { light, ..none() }, [false; 5]),
            (Effects { depth_cue: Some(DepthCue { color: [0.0; 3], strength: 0.5 }), ..none() }, [false; 5]),
            (Effects { clip_planes: vec![plane], ..none() }, [true, false, false, false, false]),
            (Effects { isosurfaces: vec![surface], ..none() }, [true, false, false, false, false]),
            (Effects { pre_integrated: true, ..none() }, [true, false, false, false, false]),
            (Effects { light, shading: Some(Shading::default()), ..none() }, [false, true, false, false, false]),
            (Effects { light, shadows: Some(0.5), ..none() }, [false, false, true, false, false]),
            (Effects { ambient_occlusion: Some(0.5), ..none() }, [false, false, false, true, false]),
            (
                Effects { light, shadows: both.0, ambient_occlusion: both.1, ..none() },
                [false, false, true, true, false],
            ),
            (Effects { color_field: Some(second), ..none() }, [false, false, false, false, true]),
        ]
    }

    /// A field whose values rise along x, and a camera that looks along z.
    pub(crate) fn field(effects: Effects) -> (Field, Camera) {
        let grid = Grid::new([8; 3], DVec3::ONE, DVec3::ZERO).unwrap();
        let voxels = Voxels::F32((0..512).map(|n| (n % 8) as f32 / 7.0).collect());
        let point = |at, opacity| ControlPoint { at, color: [0.5; 3], opacity };
        let range = ScalarRange::new(0.0, 1.0, Scale::Linear).unwrap();
        let transfer = TransferFunction::new(range, None, vec![point(0.0, 0.1), point(1.0, 0.2)]).unwrap();
        let camera = Camera::new(DVec3::new(3.5, 4.0, 30.0), DVec3::splat(3.5), DVec3::Y, 30.0).unwrap();
        let scene = Scene { transfer, camera, background: [0.0; 3], step_voxels: 0.5, effects };
        let volume = Volume::new(grid, voxels.clone()).unwrap().with_color_field("second", voxels).unwrap();
        (Field::new(volume, &scene), camera)
    }

    /// Panics unless the counters in `asked` are high and all others are zero.
    pub(crate) fn check(effects: &Effects, asked: [bool; 5], found: [u64; 5]) {
        let right = found.iter().zip(asked).all(|(&n, asked)| if asked { n > 100 } else { n == 0 });
        assert!(right, "{effects:?}: {found:?}");
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Backend;
    use lamina_model::{Effects, Segmentation, VdiParams};

    fn counts(effects: Effects) -> [u64; 5] {
        let (field, camera) = cases::field(effects);
        take();
        let lanes = Backend::cpu();
        lanes.raycast(&field, &camera, 16, 16).unwrap();
        lanes.generate(&field, &VdiParams::new(16, 0.05).unwrap(), Segmentation::Greedy).unwrap();
        crate::reference::raycast(&field, &camera, 16, 16).unwrap();
        take()
    }

    /// A single test, because the counters are global to the process.
    #[test]
    fn what_is_not_asked_for_is_not_looked_up() {
        for (effects, asked) in cases::asked() {
            cases::check(&effects, asked, counts(effects.clone()));
        }
    }
}
