//! One field held by many members: what their number changes, and what it costs.
//!
//!     members cut INPUT [STEP]      the VDI of 1 to 27 members beside that of one node
//!     members scale INPUT [STEP]    64^3 points a member, 1 to 64 members: processor time and bytes of each
//!
//! Members are worked through one after the other on one thread, so that wall time is a member's own processor time. What they do is
//! what members of a group do (`generator-node/src/group`), without the messages.

use glam::DVec3;
use lamina_codec::{BandStatistics, EncodeOptions, VdiBand, encode};
use lamina_model::psnr::psnr;
use lamina_model::{
    Camera, Grid, Image, Intermediate, Scene, Segmentation, Vdi, VdiParams, Volume, Voxels, suggest::suggest,
};
use lamina_raycast::{Backend, Compositor, Field, GridPart, RowBand};
use lamina_vdi_render::{Backend as Viewer, Detail, Drawable};
use lamina_volume_io::{Options, Series};
use std::collections::BTreeSet;
use std::path::Path;
use std::time::Instant;

type Failure = Box<dyn std::error::Error + Send + Sync>;
type PointBox = ([usize; 3], [usize; 3]);

/// Interrupt parameter of all VDIs here.
const GAMMA: f64 = 0.01;
/// Angles at which pictures are compared, degrees.
const ANGLES: [f64; 2] = [0.0, 30.0];
/// Bytes a second of a member's network, for what is modeled: 10 Gbit/s.
const NETWORK: f64 = 1.25e9;
/// Seconds a message, for what is modeled.
const LATENCY: f64 = 5e-6;

fn main() -> Result<(), Failure> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let usage = "usage: members cut|scale INPUT [STEP]";
    let [what, input, ..] = arguments.as_slice() else { return Err(usage.into()) };
    let step = arguments.get(2).map_or(Ok(0), |step| step.parse())?;
    let volume = Series::open(Path::new(input), &Options::default())?.read(step)?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    pool.install(|| match what.as_str() {
        "cut" => cut(&volume),
        "scale" => scale(&volume),
        _ => Err(usage.into()),
    })
}

/// `count` spans of `n` points; uneven ones differ by up to a factor of 3.
fn spans(n: usize, count: usize, uneven: bool) -> Vec<(usize, usize)> {
    let weight = |k: usize| if uneven { [1.0, 3.0, 2.0][k % 3] } else { 1.0 };
    let all: f64 = (0..count).map(weight).sum();
    let end = |k: usize| ((0..k).map(weight).sum::<f64>() / all * n as f64).round() as usize;
    (0..count).map(|k| (end(k), end(k + 1) - end(k))).collect()
}

/// `counts` blocks an axis.
fn blocks(dims: [usize; 3], counts: [usize; 3], uneven: bool) -> Vec<PointBox> {
    let [xs, ys, zs] = [0, 1, 2].map(|a| spans(dims[a], counts[a], uneven));
    let rows = zs.iter().flat_map(|z| ys.iter().map(move |y| (*y, *z)));
    rows.flat_map(|(y, z)| xs.iter().map(move |x| ([x.0, y.0, z.0], [x.1, y.1, z.1]))).collect()
}

/// Blocks of so many members.
fn counts(members: usize) -> [usize; 3] {
    match members {
        1 => [1, 1, 1],
        2 => [1, 1, 2],
        3 => [1, 1, 3],
        4 => [1, 2, 2],
        8 => [2, 2, 2],
        16 => [2, 2, 4],
        27 => [3, 3, 3],
        _ => [4, 4, 4],
    }
}

/// Each member's boxes: blocks; or an L of two and blocks in its corner.
fn layout(dims: [usize; 3], members: usize, shape: &str) -> Vec<Vec<PointBox>> {
    if shape != "L" {
        return blocks(dims, counts(members), shape == "uneven").into_iter().map(|b| vec![b]).collect();
    }
    let [nx, ny, nz] = dims;
    let (x, y) = (nx / 3, ny / 3);
    let corner = blocks([nx - x, ny - y, nz], [1, 1, members - 1], false).into_iter();
    let l = vec![([0, 0, 0], [nx, y, nz]), ([0, y, 0], [x, ny - y, nz])];
    std::iter::once(l).chain(corner.map(|(s, d)| vec![([s[0] + x, s[1] + y, s[2]], d)])).collect()
}

/// The field of a box, of points alone that a member has or is sent.
fn part(volume: &Volume, scene: &Scene, (start, dims): PointBox) -> Result<Option<Field>, Failure> {
    let grid = volume.grid();
    let Some(part) = GridPart::of_points(grid, start, dims, 1)? else { return Ok(None) };
    let ([x0, y0, z0], [nx, ny, nz]) = (part.start(), part.dims());
    let rows = (z0..z0 + nz).flat_map(|z| (y0..y0 + ny).map(move |y| (y, z)));
    let first = |(y, z): (usize, usize)| (z * grid.dims()[1] + y) * grid.dims()[0] + x0;
    let Voxels::F32(values) = volume.voxels() else { return Err("single precision".into()) };
    let points = rows.flat_map(|row| values[first(row)..][..nx].to_vec()).collect();
    let stored = Volume::new(Grid::new(part.dims(), grid.spacing(), DVec3::ZERO)?, Voxels::F32(points))?;
    Ok(Some(Field::part(stored, (*grid, part), scene)?))
}

/// Voxels as [`part`] takes them.
fn narrow(volume: &Volume) -> Result<Volume, Failure> {
    let voxels = match volume.voxels() {
        Voxels::U8(v) => Voxels::F32(v.iter().map(|x| f32::from(*x)).collect()),
        Voxels::F32(v) => Voxels::F32(v.clone()),
        _ => return Err("voxels of one byte, or single precision".into()),
    };
    Ok(Volume::new(*volume.grid(), voxels)?)
}

/// What a VDI of members is, and what it cost.
struct Together {
    vdi: Vdi,
    /// Parts that each ray meets.
    met: Vec<usize>,
    /// Seconds of each member: generation, compositing.
    generation: Vec<f64>,
    compositing: Vec<f64>,
    /// Of encoding: quantization, what is to be known of the whole, and the bands that the member codes.
    encoding: Vec<f64>,
    /// Bytes that each member sends to others: lists of tiles, and quantized rows of bands.
    sent: Vec<f64>,
    /// Bytes of the VDI.
    coded: usize,
}

fn rows_of(resolution: u32, member: usize, members: usize) -> Vec<u32> {
    (member as u32..resolution).step_by(members).collect()
}

fn bytes_of(band: &RowBand) -> f64 {
    4.0 * band.counts.len() as f64 + 24.0 * band.segments.len() as f64
}

fn together(
    volume: &Volume,
    scene: &Scene,
    params: &VdiParams,
    members: &[Vec<PointBox>],
) -> Result<Together, Failure> {
    let compositor = Compositor::new(volume.grid(), scene, params, Segmentation::Fitted)?;
    let (r, count) = (params.resolution(), members.len());
    let (mut lists, mut generation) = (Vec::new(), Vec::new());
    for boxes in members {
        let fields = boxes.iter().filter_map(|b| part(volume, scene, *b).transpose()).collect::<Result<Vec<_>, _>>()?;
        let start = Instant::now();
        let made = fields
            .iter()
            .map(|field| Ok(Backend::cpu().generate(field, compositor.part_params(), Segmentation::Greedy)?.0));
        lists.push(made.collect::<Result<Vec<Vdi>, Failure>>()?);
        generation.push(start.elapsed().as_secs_f64());
    }
    let met = |ray: u32| lists.iter().flatten().filter(|vdi| !vdi.list(ray % r, ray / r).is_empty()).count();
    let met = (0..r * r).map(met).collect();
    let (mut tiles, mut compositing, mut sent) = (Vec::new(), Vec::new(), vec![0.0; count]);
    for owner in 0..count {
        let rows = rows_of(r, owner, count);
        let mut bands = Vec::new();
        for (member, made) in lists.iter().enumerate() {
            for vdi in made {
                let band = RowBand::of_rows(vdi, &rows);
                if band.segments.is_empty() {
                    continue;
                }
                sent[member] += if member == owner { 0.0 } else { bytes_of(&band) };
                bands.push(band);
            }
        }
        let start = Instant::now();
        tiles.push(compositor.rows(&rows, &bands)?);
        compositing.push(start.elapsed().as_secs_f64());
    }
    let gamma = params.gamma();
    let timed = |tile: &RowBand| {
        let start = Instant::now();
        let quantized = VdiBand::quantized(tile.lists(), gamma);
        let statistics = BandStatistics::of(&quantized);
        (quantized, statistics, start.elapsed().as_secs_f64())
    };
    let (mut quantized, mut statistics, mut encoding) = (Vec::new(), Vec::new(), Vec::new());
    for (band, of_band, seconds) in tiles.iter().map(timed) {
        quantized.push(band);
        statistics.push(of_band);
        encoding.push(seconds);
    }
    let start = Instant::now();
    let statistics = BandStatistics::union(&statistics);
    encoding[0] += start.elapsed().as_secs_f64();
    let (bands, row) = (statistics.bands(r), r as usize);
    let mut coded = vec![<[Vec<u8>; 2]>::default(); bands.len()];
    for (number, rows) in bands.iter().enumerate() {
        let owners = [number % count, (number + bands.len()) % count];
        let mut band = VdiBand::default();
        for n in rows.clone() {
            let (member, nth) = (n % count, n / count);
            let of_row = quantized[member].slice(nth * row..(nth + 1) * row);
            let receivers =
                owners.iter().collect::<BTreeSet<_>>().into_iter().filter(|owner| **owner != member).count();
            sent[member] += (of_row.to_bytes().len() * receivers) as f64;
            band.append(&of_row);
        }
        let start = Instant::now();
        coded[number][0] = statistics.encode_geometry(r, &band)?;
        encoding[owners[0]] += start.elapsed().as_secs_f64();
        let start = Instant::now();
        coded[number][1] = statistics.encode_colors(r, &band)?;
        encoding[owners[1]] += start.elapsed().as_secs_f64();
    }
    let coded = statistics.encoded(compositor.header(), &coded)?.len();
    let mut tiles: Vec<_> = tiles.into_iter().map(|tile| tile.into_rows(r)).collect();
    let rows = (0..r as usize).filter_map(|row| tiles[row % count].next());
    let vdi = compositor.finish(rows)?;
    Ok(Together { vdi, met, generation, compositing, encoding, sent, coded })
}

fn picture(vdi: &Vdi, camera: &Camera) -> Result<Image, Failure> {
    let drawable = Drawable::new(Intermediate::Vdi(Box::new(vdi.clone())));
    Ok(Viewer::default().render(&drawable, camera, 512, 512, Detail::Cubic)?)
}

fn cut(volume: &Volume) -> Result<(), Failure> {
    let (volume, params) = (narrow(volume)?, VdiParams::new(256, GAMMA)?);
    let scene = suggest(&[&volume])?;
    let whole = Field::new(volume.clone(), &scene);
    let alone = Backend::cpu().generate(&whole, &params, Segmentation::Fitted)?.0;
    let size = encode(&alone, &EncodeOptions::default())?.len();
    let cameras = ANGLES.map(|angle| scene.camera.rotated_about_y(angle));
    println!("one node: {} supersegments, {size} bytes", alone.segments().len());
    println!(
        "members shape    rays cut  lists equal, not cut | cut   supersegments     bytes   dB at 0, 30 deg   dB to the ray cast: one node, members"
    );
    let cast = |camera: &Camera| Backend::cpu().raycast(&whole, camera, 512, 512);
    for members in [1, 2, 3, 4, 8, 27] {
        for shape in ["even", "uneven", "L"].into_iter().filter(|shape| members > 1 || *shape == "even") {
            let Together { vdi, met, .. } =
                together(&volume, &scene, &params, &layout(volume.grid().dims(), members, shape))?;
            let (mut equal, mut all) = ([0; 2], [0; 2]);
            for (ray, met) in (0..).zip(&met).filter(|(_, met)| **met > 0) {
                let kind = usize::from(*met > 1);
                all[kind] += 1;
                equal[kind] += usize::from(vdi.list(ray % 256, ray / 256) == alone.list(ray % 256, ray / 256));
            }
            let share = |n: usize| 100.0 * equal[n] as f64 / f64::from(all[n].max(1) as u32);
            let [a, b] = [alone.segments().len(), vdi.segments().len()].map(|n| n as f64);
            let bytes = encode(&vdi, &EncodeOptions::default())?.len() as f64 / size as f64;
            let mut decibels = Vec::new();
            for camera in &cameras {
                let camera = camera.as_ref().map_err(Clone::clone)?;
                let (one, other, truth) = (picture(&alone, camera)?, picture(&vdi, camera)?, cast(camera)?);
                decibels.push([psnr(&one, &other)?, psnr(&one, &truth)?, psnr(&other, &truth)?]);
            }
            let [zero, thirty] = [decibels[0], decibels[1]];
            println!(
                "{members:7} {shape:8} {:6.1} %  {:8.2} % | {:6.2} %        {:+9.2} %  {:+7.2} %    {:6.1}  {:6.1}      {:5.2} {:5.2} | {:5.2} {:5.2}",
                100.0 * all[1] as f64 / (all[0] + all[1]) as f64,
                share(0),
                share(1),
                100.0 * (b / a - 1.0),
                100.0 * (bytes - 1.0),
                zero[0],
                thirty[0],
                zero[1],
                zero[2],
                thirty[1],
                thirty[2],
            );
        }
    }
    Ok(())
}

/// `volume` repeated over `blocks` of 64^3 points, turned over at every second so that it goes on smoothly.
fn repeated(volume: &Volume, blocks: [usize; 3]) -> Result<Volume, Failure> {
    let (n, dims) = (volume.grid().dims(), blocks.map(|b| 64 * b));
    let Voxels::F32(values) = volume.voxels() else { return Err("single precision".into()) };
    let mirrored = |x: usize, n: usize| if (x / n).is_multiple_of(2) { x % n } else { n - 1 - x % n };
    let at = |x, y, z| values[(mirrored(z, n[2]) * n[1] + mirrored(y, n[1])) * n[0] + mirrored(x, n[0])];
    let rows = (0..dims[2]).flat_map(|z| (0..dims[1]).map(move |y| (y, z)));
    let all = rows.flat_map(|(y, z)| (0..dims[0]).map(move |x| at(x, y, z))).collect();
    Ok(Volume::new(Grid::new(dims, DVec3::ONE, DVec3::ZERO)?, Voxels::F32(all))?)
}

/// The largest group measured, which larger ones are modeled from.
struct Measured {
    members: usize,
    /// Seconds of generation and compositing of the slowest member, bytes that one sends, seconds of encoding of the slowest one.
    work: f64,
    sent: f64,
    encoding: f64,
    /// Supersegments of the VDI.
    segments: f64,
    /// Seconds of generation and compositing of a single member.
    one: f64,
}

impl Measured {
    /// Prints what `members` would take: each has as many voxels, samples and supersegments as measured, so that messages are more, and
    /// bands larger, which have 16 rows or more. Radix-k sends lists on in rounds among k members; they do not become fewer by that.
    fn extrapolate(&self, members: usize) {
        let of_band = |members: usize| {
            let segments = self.segments * members as f64 / self.members as f64;
            segments / (segments / 131_072.0).min(128.0 * (members as f64).cbrt() / 16.0).max(1.0)
        };
        let encoding = self.encoding * of_band(members) / of_band(self.members);
        let direct = self.sent / NETWORK + (members - 1) as f64 * LATENCY;
        let radix = |k: f64| {
            let rounds = (members as f64).log(k).round();
            rounds * ((k - 1.0) / k * self.sent / NETWORK + (k - 1.0) * LATENCY)
        };
        println!(
            "{members:7} modeled: {:.1} ms of work, direct-send {:.1} ms, radix-8 {:.1} ms, radix-16 {:.1} ms; encoding {:.0} ms; efficiency with compositing and the network {:.2}",
            1e3 * self.work,
            1e3 * direct,
            1e3 * radix(8.0),
            1e3 * radix(16.0),
            1e3 * encoding,
            self.one / (self.work + direct),
        );
    }
}

fn scale(volume: &Volume) -> Result<(), Failure> {
    let volume = narrow(volume)?;
    let transfer = suggest(&[&volume])?.transfer;
    println!(
        "64^3 points a member, rays so that a member takes about as many samples as one alone; milliseconds of the slowest and of the mean member, kB that a member sends at most"
    );
    println!("members    rays  generation: slowest, mean  compositing  encoding: slowest, all, one node    sent   VDI");
    let (mut first, mut last) = (None, None);
    for members in [1, 2, 4, 8, 16, 27, 64] {
        let whole = repeated(&volume, counts(members))?;
        let scene = Scene { transfer: transfer.clone(), ..suggest(&[&whole])? };
        let rays = (128.0 * (members as f64).cbrt()).round() as u32;
        let params = VdiParams::new(rays, GAMMA)?;
        let made = together(&whole, &scene, &params, &layout(whole.grid().dims(), members, "even"))?;
        let most = |all: &[f64]| all.iter().copied().fold(0.0, f64::max);
        let (slowest, mean) = (most(&made.generation), made.generation.iter().sum::<f64>() / members as f64);
        let (compositing, sent) = (most(&made.compositing), most(&made.sent));
        let start = Instant::now();
        let alone = encode(&made.vdi, &EncodeOptions::default())?.len();
        let encoding = [most(&made.encoding), made.encoding.iter().sum(), start.elapsed().as_secs_f64()];
        assert_eq!(made.coded, alone, "members code the bytes of one node");
        let one = *first.get_or_insert([slowest, slowest + compositing]);
        let network = sent / NETWORK + (members - 1) as f64 * LATENCY;
        println!(
            "{members:7} {rays:5}^2 {:12.1} {:8.1} {:16.1} {:12.1} {:9.1} {:9.1} {:8.0} kB {:6.0} kB   efficiency {:.2} by itself, {:.2} with compositing and the network",
            1e3 * slowest,
            1e3 * mean,
            1e3 * compositing,
            1e3 * encoding[0],
            1e3 * encoding[1],
            1e3 * encoding[2],
            sent / 1e3,
            made.coded as f64 / 1e3,
            one[0] / slowest,
            one[1] / (slowest + compositing + network),
        );
        let segments = made.vdi.segments().len() as f64;
        last =
            Some(Measured { members, work: slowest + compositing, sent, encoding: encoding[0], segments, one: one[1] });
    }
    last.iter().for_each(|measured| [512, 4096].into_iter().for_each(|members| measured.extrapolate(members)));
    println!("modeled: the network at {NETWORK:e} bytes a second and {LATENCY:e} s a message; all else is measured");
    Ok(())
}
