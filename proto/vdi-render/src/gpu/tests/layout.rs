//! WGSL's structs and their Rust twins lie in memory alike.

use crate::kernel::RENDER;
use crate::kernel::layout::{LinearForm, PictureUniforms, StoredVdi, ViewUniforms};
use crate::simd::DepthSteps;
use lamina_compute::gpu::layout::{parse, struct_layout};
use lamina_compute::layout_of;

#[test]
fn structs_equal_their_twins() {
    let module = parse(include_str!("../../kernel/layout.wgsl")).unwrap();
    let twins = [
        layout_of!(StoredVdi { size, first_masks, depth, far, depth_bins, margin }),
        layout_of!(LinearForm { start, pad0, change, pad1 }),
        layout_of!(ViewUniforms {
            column,
            row,
            depth,
            planes,
            background,
            floor,
            width,
            height,
            eye,
            slope,
            steps,
            sharpness,
            inner,
            outer,
            margin,
            pad0,
        }),
        layout_of!(PictureUniforms { first, count, pad0 }),
        layout_of!(DepthSteps { scale, offset, last, first }),
    ];
    let structs = module.types.iter().filter(|(_, ty)| ty.name.is_some()).count();
    assert_eq!(structs, twins.len(), "every struct of layout.wgsl has a twin");
    for (name, twin) in twins {
        assert_eq!(struct_layout(&module, name), Some(twin), "{name}");
    }
}

#[test]
fn every_kernel_is_valid_wgsl() {
    parse(RENDER).unwrap();
}
