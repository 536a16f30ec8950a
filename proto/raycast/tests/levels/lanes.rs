//! Eight rays at a time: near the oracle, and to the bit the same at every level, in any number of threads, and for many
//! gammas at once.

use crate::agreement::{compare, compare_pictures};
use crate::fields::{field, fields, values};
use lamina_model::composite::TRANSMITTANCE_FLOOR;
use lamina_model::{Image, Scale, Segmentation, VdiParams, Voxels};
use lamina_raycast::simd::{self, Level, Shot};
use lamina_raycast::{Backend, Field, reference};

const SIZE: [u32; 2] = [61, 47];

fn shot(field: &Field) -> Shot<'_> {
    Shot { camera: &field.scene().camera, size: SIZE, floor: TRANSMITTANCE_FLOOR as f32 }
}

/// The fields that lanes march; the one layer is the oracle's.
fn marched() -> Vec<(&'static str, Field)> {
    let mut fields = fields();
    fields.retain(|(_, field)| simd::fits(field));
    assert_eq!(fields.len(), 8);
    fields
}

#[test]
fn pictures_equal_the_oracles() {
    for (name, field) in marched() {
        let oracle = reference::raycast(&field, &field.scene().camera, SIZE[0], SIZE[1]).unwrap();
        for level in Level::available() {
            let ours = Image::new(SIZE[0], SIZE[1], simd::raycast(level, &field, &shot(&field))).unwrap();
            compare_pictures(&format!("{name}, {level:?}"), &ours, &oracle);
        }
    }
}

#[test]
fn all_levels_agree_to_the_bit_and_so_do_lists_of_pixels() {
    for (name, field) in marched() {
        let whole = simd::raycast(Level::Portable, &field, &shot(&field));
        let some: Vec<(u32, u32)> = (0..203).map(|n| (n * 7 % SIZE[0], n * 11 % SIZE[1])).collect();
        let params = VdiParams::new(45, 0.02).unwrap().with_step_voxels(0.43).unwrap();
        let vdi = simd::generate(Level::Portable, &field, &params, Segmentation::Greedy).unwrap();
        for level in Level::available() {
            assert!(simd::raycast(level, &field, &shot(&field)) == whole, "{name}, {level:?}");
            let listed = simd::raycast_pixels(level, &field, &shot(&field), &some);
            let picked = some.iter().map(|&(i, j)| whole[(j * SIZE[0] + i) as usize]);
            assert!(listed.into_iter().eq(picked), "{name}, {level:?}");
            assert!(simd::generate(level, &field, &params, Segmentation::Greedy).unwrap() == vdi, "{name}, {level:?}");
        }
    }
}

#[test]
fn vdis_equal_the_oracles() {
    for (name, field) in marched() {
        for (gamma, cutoff) in [(0.0, 1.0), (0.02, 1.0), (1.0, 1.0), (0.05, 0.5)] {
            let params = VdiParams::new(45, gamma).unwrap().with_step_voxels(0.43).unwrap();
            let params = params.with_opacity_cutoff(cutoff).unwrap();
            let ours = simd::generate(Level::detect(), &field, &params, Segmentation::Greedy).unwrap();
            compare(
                &format!("{name}, gamma {gamma}"),
                &ours,
                &reference::generate(&field, &params, Segmentation::Greedy).unwrap(),
            );
            let fitted = simd::generate(Level::detect(), &field, &params, Segmentation::Fitted).unwrap();
            let oracle = reference::generate(&field, &params, Segmentation::Fitted).unwrap();
            compare(&format!("{name}, fitted, gamma {gamma}"), &fitted, &oracle);
        }
    }
}

#[test]
fn many_gammas_from_one_march_are_those_of_one_march_each() {
    let backend = Backend::cpu();
    // Unsorted, with a double, and more than share one march.
    let mut gammas = vec![0.3, 0.02, 0.02, 0.0, 5.0];
    gammas.extend((0..140).map(|n| 0.001 + 0.002 * f64::from(n)));
    for (name, field) in marched() {
        for cutoff in [1.0, 0.7] {
            let params = VdiParams::new(23, 0.5).unwrap().with_opacity_cutoff(cutoff).unwrap();
            let all = backend.generate_all(&field, &params, &gammas, Segmentation::Greedy).unwrap();
            assert_eq!(all.len(), gammas.len());
            for (vdi, &gamma) in all.iter().zip(&gammas) {
                let one = backend.generate(&field, &params.with_gamma(gamma).unwrap(), Segmentation::Greedy).unwrap().0;
                assert!(*vdi == one, "{name}, gamma {gamma}");
            }
        }
    }
    assert!(
        backend.generate_all(&fields()[0].1, &VdiParams::new(9, 0.1).unwrap(), &[-1.0], Segmentation::Greedy).is_err()
    );
}

#[test]
fn the_number_of_threads_changes_nothing() {
    let (_, field) = fields().swap_remove(0);
    let params = VdiParams::new(67, 0.01).unwrap();
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            (
                simd::generate(Level::detect(), &field, &params, Segmentation::Greedy).unwrap(),
                simd::raycast(Level::detect(), &field, &shot(&field)),
            )
        })
    };
    assert!(run(1) == run(5));
}

#[test]
fn a_backend_serves_what_lanes_cannot() {
    let slice = [33, 17, 1];
    let voxels = Voxels::F32(values(slice).iter().map(|&x| x as f32).collect());
    let field = field(slice, voxels, 1.0, Scale::Linear, 1.3);
    assert!(!simd::fits(&field));
    let params = VdiParams::new(31, 0.02).unwrap();
    assert!(
        Backend::cpu().generate(&field, &params, Segmentation::Greedy).unwrap().0
            == reference::generate(&field, &params, Segmentation::Greedy).unwrap()
    );
}
