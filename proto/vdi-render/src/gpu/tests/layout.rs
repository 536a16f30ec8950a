//! WGSL's structs and their Rust twins lie in memory alike.

use crate::gpu::layout::{Form, Picture, Stored, View};
use crate::gpu::pipelines::RENDER;
use crate::simd::Span;
use lamina_compute::gpu::layout::{parse, struct_layout};
use lamina_compute::layout_of;

#[test]
fn structs_equal_their_twins() {
    let module = parse(include_str!("../layout.wgsl")).unwrap();
    let twins = [
        layout_of!(Stored { size, first_masks, depth, far, slabs, margin }),
        layout_of!(Form { start, pad0, change, pad1 }),
        layout_of!(View {
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
            pad0,
            pad1,
        }),
        layout_of!(Picture { first, count, pad0 }),
        layout_of!(Span { scale, offset, last, first }),
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
