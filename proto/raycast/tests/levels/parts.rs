//! Fields in parts: their lists, merged, are those of the whole, however it is cut.

use crate::fields::{DIMS, camera, transfer, values};
use glam::DVec3;
use lamina_model::effects::{ClipPlane, Isosurface, Shading};
use lamina_model::{
    Effects, Grid, Scale, Scene, Segmentation, Supersegment, Vdi, VdiParams, Volume, Voxels, composite::Accumulator,
};
use lamina_raycast::{Backend, Compositor, Field, GridPart, PartSums, RowBand, reference};

type PointBox = ([usize; 3], [usize; 3]);

/// Boxes that make up `dims`, cut at `cuts` on each axis.
fn blocks(dims: [usize; 3], cuts: [&[usize]; 3]) -> Vec<PointBox> {
    let spans = |a: usize| {
        let mut ends = cuts[a].to_vec();
        ends.push(dims[a]);
        let starts = [0].into_iter().chain(cuts[a].iter().copied());
        starts.zip(ends).map(|(s, e)| (s, e - s)).collect::<Vec<_>>()
    };
    let (xs, ys, zs) = (spans(0), spans(1), spans(2));
    let mut all = Vec::new();
    for &(z, nz) in &zs {
        for &(y, ny) in &ys {
            all.extend(xs.iter().map(|&(x, nx)| ([x, y, z], [nx, ny, nz])));
        }
    }
    all
}

/// Ways to cut a grid of [`DIMS`].
fn cuts() -> Vec<(&'static str, Vec<PointBox>)> {
    vec![
        ("whole", blocks(DIMS, [&[], &[], &[]])),
        ("halves", blocks(DIMS, [&[], &[16], &[]])),
        ("uneven slabs, the last of one plane", blocks(DIMS, [&[2, 16], &[], &[]])),
        ("27 blocks", blocks(DIMS, [&[5, 11], &[11, 22], &[3, 6]])),
        // Two boxes around a third.
        ("L", vec![([0, 0, 0], [17, 20, 9]), ([0, 20, 0], [6, 13, 9]), ([6, 20, 0], [11, 13, 9])]),
    ]
}

fn value_f32(n: usize, x: f64) -> f32 {
    if n % 97 == 5 { f32::NAN } else { x as f32 }
}

struct World {
    grid: Grid,
    values: Vec<f32>,
    scene: Scene,
}

impl World {
    fn new(scale: Scale, effects: Effects) -> Self {
        let grid = Grid::new(DIMS, DVec3::new(1.0, 0.6, 2.3), DVec3::new(-3.0, 100.0, 7.0)).unwrap();
        let scene = Scene {
            transfer: transfer(1.0, scale),
            camera: camera(&grid, 1.3),
            background: [0.1, 0.2, 0.4],
            step_voxels: 0.37,
            effects,
        };
        let values = values(DIMS).into_iter().enumerate().map(|(n, x)| value_f32(n, x)).collect();
        Self { grid, values, scene }
    }

    fn whole(&self) -> Field {
        Field::new(Volume::new(self.grid, Voxels::F32(self.values.clone())).unwrap(), &self.scene)
    }

    /// The field of a box of points with `ghost` layers, which holds those and no other.
    fn part(&self, (start, dims): PointBox, ghost: usize) -> Option<Field> {
        let part = GridPart::of_points(&self.grid, start, dims, ghost).unwrap()?;
        let ([x0, y0, z0], [nx, ny, nz]) = (part.start(), part.dims());
        let rows = (z0..z0 + nz).flat_map(|z| (y0..y0 + ny).map(move |y| (y, z)));
        let row = |(y, z): (usize, usize)| {
            let first = (z * DIMS[1] + y) * DIMS[0] + x0;
            self.values[first..first + nx].to_vec()
        };
        let stored = Grid::new(part.dims(), self.grid.spacing(), self.grid.origin()).unwrap();
        let volume = Volume::new(stored, Voxels::F32(rows.flat_map(row).collect())).unwrap();
        Some(Field::part(volume, (self.grid, part), &self.scene).unwrap())
    }

    /// The VDI of all boxes together, rows in three tiles, and how many boxes each ray meets.
    fn together(
        &self,
        boxes: &[PointBox],
        ghost: usize,
        params: &VdiParams,
        segmentation: Segmentation,
        generate: impl Fn(&Field, &VdiParams) -> Vdi,
    ) -> (Vdi, Vec<usize>) {
        let compositor = Compositor::new(&self.grid, &self.scene, params, segmentation).unwrap();
        let parts: Vec<Field> = boxes.iter().filter_map(|b| self.part(*b, ghost)).collect();
        let sums: Vec<PartSums> = parts.iter().filter_map(Field::extinction_sums).collect();
        let lit = Field::lit(parts, &sums).unwrap();
        let lists: Vec<Vdi> = lit.iter().map(|field| generate(field, compositor.part_params())).collect();
        let r = params.resolution();
        // Every third row.
        let tile = |n: u32| {
            let rows: Vec<u32> = (n..r).step_by(3).collect();
            let bands: Vec<RowBand> = lists.iter().map(|vdi| RowBand::of_rows(vdi, &rows)).collect();
            compositor.rows(&rows, &bands).unwrap().into_rows(r)
        };
        let mut tiles = [0, 1, 2].map(tile);
        let rows: Vec<RowBand> = (0..r).filter_map(|row| tiles[row as usize % 3].next()).collect();
        let met = |ray: u32| lists.iter().filter(|vdi| !vdi.list(ray % r, ray / r).is_empty()).count();
        (compositor.finish(rows).unwrap(), (0..r * r).map(met).collect())
    }
}

fn light(list: &[Supersegment]) -> [f32; 3] {
    let mut light = Accumulator::default();
    list.iter().for_each(|s| light.add(s.color.map(f64::from), f64::from(s.optical_depth)));
    light.over([0.1, 0.2, 0.4])
}

fn on_the_processor(field: &Field, params: &VdiParams) -> Vdi {
    Backend::cpu().generate(field, params, Segmentation::Greedy).unwrap().0
}

fn by_the_oracle(field: &Field, params: &VdiParams) -> Vdi {
    reference::generate(field, params, Segmentation::Greedy).unwrap()
}

#[test]
fn every_sample_is_taken_once_and_with_the_same_bits() {
    // Nothing is joined: each supersegment is one sample.
    let params = VdiParams::new(40, 0.0).unwrap().with_step_voxels(0.37).unwrap();
    for scale in [Scale::Linear, Scale::Log10] {
        let world = World::new(scale, Effects::default());
        for generate in [on_the_processor, by_the_oracle] {
            let whole = generate(&world.whole(), &params);
            assert!(whole.segments().len() > 5000);
            for (name, boxes) in cuts() {
                let (together, _) = world.together(&boxes, 1, &params, Segmentation::Fitted, generate);
                assert!(together == whole, "{name}");
            }
        }
    }
}

#[test]
fn rays_that_no_face_cuts_are_equal_and_others_keep_their_light() {
    let params = VdiParams::new(40, 0.03).unwrap().with_step_voxels(0.37).unwrap();
    let world = World::new(Scale::Linear, Effects::default());
    for segmentation in [Segmentation::Greedy, Segmentation::Fitted] {
        let (whole, _) = Backend::cpu().generate(&world.whole(), &params, segmentation).unwrap();
        for (name, boxes) in cuts() {
            let (together, met) = world.together(&boxes, 1, &params, segmentation, on_the_processor);
            let mut cut = 0;
            for (ray, met) in (0..).zip(met) {
                let (one, other) = (whole.list(ray % 40, ray / 40), together.list(ray % 40, ray / 40));
                cut += usize::from(met > 1);
                assert!(met > 1 || one == other, "{name}: ray {ray}");
                let (a, b) = (light(one), light(other));
                assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-5), "{name}: ray {ray}: {a:?} {b:?}");
            }
            assert!(cut > 10 || boxes.len() == 1, "{name}: {cut} rays are cut");
            let (a, b) = (whole.segments().len() as f64, together.segments().len() as f64);
            assert!((b / a - 1.0).abs() < 0.02, "{name}: {a} and {b} supersegments");
        }
    }
}

#[test]
fn effects_that_look_beside_a_sample_need_more_ghost_layers_and_then_are_exact() {
    let effects = Effects {
        light: Some(DVec3::new(1.0, 2.0, 0.5)),
        shading: Some(Shading { ambient: 0.3, diffuse: 0.7, specular: 0.2, shininess: 20 }),
        isosurfaces: vec![Isosurface { value: 0.5, color: [0.9, 0.8, 0.2], opacity: 0.6 }],
        clip_planes: vec![ClipPlane { normal: DVec3::new(1.0, 1.0, 0.0), offset: 110.0 }],
        pre_integrated: true,
        ..Effects::default()
    };
    let params = VdiParams::new(40, 0.0).unwrap().with_step_voxels(0.37).unwrap();
    let world = World::new(Scale::Linear, effects);
    for generate in [on_the_processor, by_the_oracle] {
        let whole = generate(&world.whole(), &params);
        assert!(whole.segments().len() > 1000);
        for (name, boxes) in cuts() {
            let (together, _) = world.together(&boxes, 3, &params, Segmentation::Greedy, generate);
            assert!(together == whole, "{name}");
        }
    }
}

#[test]
fn light_passes_from_part_to_part() {
    let lit = |shadows, ambient_occlusion| Effects {
        light: Some(DVec3::new(1.0, 2.0, 0.5)),
        shadows,
        ambient_occlusion,
        clip_planes: vec![ClipPlane { normal: DVec3::new(1.0, 1.0, 0.0), offset: 110.0 }],
        ..Effects::default()
    };
    let params = VdiParams::new(40, 0.0).unwrap().with_step_voxels(0.37).unwrap();
    let unlit = on_the_processor(&World::new(Scale::Linear, lit(None, None)).whole(), &params);
    for effects in [lit(Some(0.9), None), lit(None, Some(0.9)), lit(Some(0.6), Some(0.8))] {
        let world = World::new(Scale::Linear, effects);
        let whole = on_the_processor(&world.whole(), &params);
        let farthest = |a: &Vdi, b: &Vdi| {
            let of_pair = |(a, b): (&Supersegment, &Supersegment)| {
                assert_eq!((a.start, a.end, a.optical_depth), (b.start, b.end, b.optical_depth));
                a.color.iter().zip(b.color).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
            };
            a.segments().iter().zip(b.segments()).map(of_pair).fold(0.0, f32::max)
        };
        assert!(farthest(&whole, &unlit) > 0.2, "nothing is dark");
        for (name, boxes) in cuts() {
            let (together, _) = world.together(&boxes, 3, &params, Segmentation::Greedy, on_the_processor);
            // Sums of several parts are rounded otherwise than those of one.
            let off = farthest(&whole, &together);
            assert!(off < if boxes.len() == 1 { f32::MIN_POSITIVE } else { 1e-5 }, "{name}: {off}");
        }
    }
}

#[test]
fn parts_that_cannot_be_are_refused_by_name() {
    let world = World::new(Scale::Linear, Effects::default());
    let compositor = Compositor::new(&world.grid, &world.scene, &VdiParams::new(4, 0.1).unwrap(), Segmentation::Greedy);
    let compositor = compositor.unwrap();
    let segment = |start, end| Supersegment { start, end, color: [0.5; 3], optical_depth: 0.1 };
    let band = |list: &[Supersegment], rays: usize| {
        let mut counts = vec![0; rays];
        counts[2] = list.len() as u32;
        RowBand { counts, segments: list.to_vec() }
    };
    let [one, other] = [band(&[segment(3, 6)], 4), band(&[segment(5, 7)], 4)];
    let both = compositor.rows(&[1], &[one.clone(), other.clone()]).unwrap_err();
    assert!(both.reason.contains("parts 0 and 1 have the same step"), "{both}");
    let rays = compositor.rows(&[1, 2], std::slice::from_ref(&one)).unwrap_err();
    assert!(rays.reason.contains("4 rays where there are 8"), "{rays}");
    let short = RowBand { segments: vec![], ..one };
    assert!(compositor.rows(&[1], &[short]).unwrap_err().reason.contains("ends early"));
    assert!(compositor.finish([RowBand::default()]).is_err(), "rows are missing");

    let part = GridPart::of_points(&world.grid, [0; 3], [17, 16, 9], 1).unwrap().unwrap();
    let stored = |dims| {
        let grid = Grid::new(dims, DVec3::ONE, DVec3::ZERO).unwrap();
        Volume::new(grid, Voxels::U8(vec![0; dims.iter().product()])).unwrap()
    };
    let shadows = Effects { light: Some(DVec3::X), shadows: Some(0.5), ..Effects::default() };
    let shadowed = World::new(Scale::Linear, shadows).part(([0; 3], [17, 16, 9]), 3).unwrap();
    let elsewhere = PartSums { start: [8, 0, 0], dims: [2, 1, 1], sums: vec![0.0; 2], shares: Vec::new() };
    assert!(Field::lit(vec![shadowed], &[elsewhere]).unwrap_err().reason.contains("other points"));
    let refused = Field::part(stored([17, 16, 9]), (world.grid, part), &world.scene).unwrap_err();
    assert!(refused.reason.contains("[17, 16, 9]") && refused.reason.contains("[17, 17, 9]"), "{refused}");
}
