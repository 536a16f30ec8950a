//! WGSL's structs and their Rust twins lie in memory alike.

use crate::kernel::layout::{
    ClusteringUniforms, EffectUniforms, GpuSegment, PictureUniforms, ScanUniforms, ViewUniforms, VolumeUniforms,
};
use crate::kernel::{GENERATE, RAYCAST, SCAN};
use lamina_compute::gpu::layout::{parse, struct_layout};
use lamina_compute::layout_of;

#[test]
fn structs_equal_their_twins() {
    let module = parse(include_str!("../../kernel/layout.wgsl")).unwrap();
    let twins = [
        layout_of!(VolumeUniforms { last, pad0, bricks, pad1, low, scale, high, offset }),
        layout_of!(ViewUniforms {
            base,
            width,
            base_right,
            height,
            base_up,
            slope,
            forward,
            unit_steps,
            right,
            bins,
            up,
            below,
            visible,
            near,
            pad0,
        }),
        layout_of!(EffectUniforms {
            light,
            shadows,
            spacing,
            occlusion,
            gradient,
            ambient,
            light_scale,
            diffuse,
            light_offset,
            pad0,
            light_dims,
            specular,
            cue,
            cue_from,
            cue_per_step,
            cue_strength,
            planes,
            color_points,
            before,
            beyond,
            levels,
            surfaces,
            half_spaces,
            color_map,
        }),
        layout_of!(PictureUniforms { background, floor, first, count, pad0 }),
        layout_of!(ClusteringUniforms { gamma, cutoff, first_row, rows, first_ray, end_ray, first_segment, writing }),
        layout_of!(GpuSegment { start, end, red, green, blue, optical_depth }),
        layout_of!(ScanUniforms { count, blocks, pad0 }),
    ];
    let structs = module.types.iter().filter(|(_, ty)| ty.name.is_some()).count();
    assert_eq!(structs, twins.len(), "every struct of layout.wgsl has a twin");
    for (name, twin) in twins {
        assert_eq!(struct_layout(&module, name), Some(twin), "{name}");
    }
}

#[test]
fn every_kernel_is_valid_wgsl() {
    for source in [RAYCAST, GENERATE, SCAN] {
        parse(source).unwrap();
    }
}
