//! `lamina-lab bench`: what this machine takes for the user's own data.
//!
//! Everything is measured once a round, round after round, so that whatever else the machine does meets all alike. A
//! first round warms up and is not counted. A volume is taken through both nodes' kernels, a VDI through the viewer's.

mod devices;
mod effects;

use crate::cli;
use anyhow::{Context, ensure};
use glam::DVec3;
use lamina::offline::{open, prepare};
use lamina::process::{self, ProcessorTime};
use lamina::say;
use lamina_codec::{DecodeLimits, EncodeOptions};
use lamina_model::{Grid, Image, Scene, Segmentation, Supersegment, Vdi, VdiParams, Volume, Voxels, suggest};
use lamina_raycast::simd::{self, Shot};
use lamina_raycast::{Backend, Field};
use lamina_vdi_render::{self as viz, Detail, PreparedVdi};
use serde::Serialize;
use std::path::Path;
use std::time::Instant;

/// From how far beside the generation camera VDIs are looked at, degrees.
const NOVEL_ANGLE_DEG: f64 = 30.0;

/// The paper's: 0.001 to 0.257.
const PAPER_GAMMAS: u32 = 65;

/// `lamina-lab bench`.
pub(crate) fn bench(arguments: &cli::BenchArguments) -> anyhow::Result<()> {
    for &size in &arguments.size {
        Image::check_size(size, size)?;
    }
    let path = &arguments.input.input;
    let is_vdi = path.extension().is_some_and(|e| e == "vdi");
    if arguments.effects {
        ensure!(!is_vdi, "--effects needs a volume: a VDI holds them already");
        return effects::print(arguments);
    }
    if arguments.devices {
        ensure!(!is_vdi, "--devices needs a volume");
        return devices::print(arguments);
    }
    if arguments.memory {
        let memory = if is_vdi { viewer_memory(arguments)? } else { generator_memory(arguments)? };
        return memory.print(arguments.json);
    }
    let mut clock = Clock::default();
    if is_vdi {
        let bytes = read_vdi(path)?;
        clock.rounds(arguments.rounds, |clock| viewer_round(clock, &bytes, &arguments.size))?;
    } else {
        let (volume, scene) = open(&arguments.input)?;
        let backend = Backend::open(arguments.input.backend)?;
        clock.rounds(arguments.rounds, |clock| {
            let bytes = generator_round(clock, &backend, &volume, &scene, arguments)?;
            viewer_round(clock, &bytes, &arguments.size)
        })?;
    }
    clock.print(arguments.json)
}

fn read_vdi(path: &Path) -> anyhow::Result<Vec<u8>> {
    std::fs::read(path).with_context(|| format!("{}: cannot be read", path.display()))
}

fn params(arguments: &cli::BenchArguments, resolution: u32, scene: &Scene) -> anyhow::Result<VdiParams> {
    Ok(VdiParams::new(resolution, arguments.gamma)?.with_step_voxels(scene.step_voxels)?)
}

/// The generator-node's kernels; the VDI encoded.
fn generator_round(
    clock: &mut Clock,
    backend: &Backend,
    volume: &Volume,
    scene: &Scene,
    arguments: &cli::BenchArguments,
) -> anyhow::Result<Vec<u8>> {
    let copy = volume.clone();
    let field = clock.time("prepare volume".to_owned(), || Field::new(copy, scene));
    raycast_round(clock, backend, &field, &arguments.size)?;
    let (r, side) = (arguments.resolution, arguments.size[0]);
    if side != r {
        let same_rays = params(arguments, side, scene)?;
        clock.time(format!("generate {side}"), || backend.generate(&field, &same_rays, Segmentation::Greedy))?;
    }
    let params = params(arguments, r, scene)?;
    let (vdi, _) = clock.time(format!("generate {r}"), || backend.generate(&field, &params, Segmentation::Greedy))?;
    if arguments.gammas {
        let gammas: Vec<f64> = (0..PAPER_GAMMAS).map(|n| 0.001 + 0.004 * f64::from(n)).collect();
        let name = format!("generate {r}, {PAPER_GAMMAS} gammas");
        clock.time(name, || backend.generate_all(&field, &params, &gammas, Segmentation::Greedy))?;
    }
    Ok(clock.time(format!("encode {r}"), || lamina_codec::encode(&vdi, &EncodeOptions::default()))?)
}

/// Pictures of the volume itself; the first size also from aside, and without an end for rays that can gather no more.
fn raycast_round(clock: &mut Clock, backend: &Backend, field: &Field, sizes: &[u32]) -> anyhow::Result<()> {
    let camera = &field.scene().camera;
    for &size in sizes {
        clock.time(format!("raycast {size}"), || backend.raycast(field, camera, size, size))?;
    }
    let side = sizes[0];
    let novel = camera.rotated_about_y(NOVEL_ANGLE_DEG)?;
    clock.time(format!("raycast {side} from aside"), || backend.raycast(field, &novel, side, side))?;
    if let (Backend::Cpu(level), true) = (backend, simd::fits(field)) {
        let whole = Shot { camera, size: [side; 2], floor: 0.0 };
        clock.time(format!("raycast {side} to the end"), || simd::raycast(*level, field, &whole));
    }
    Ok(())
}

/// The viz-node's kernels.
fn viewer_round(clock: &mut Clock, bytes: &[u8], sizes: &[u32]) -> anyhow::Result<()> {
    let r = lamina_codec::peek(bytes)?.header.params.resolution();
    let vdi = clock.time(format!("decode {r}"), || lamina_codec::decode(bytes, &DecodeLimits::default()))?;
    let prepared = clock.time(format!("prepare VDI {r}"), || PreparedVdi::new(&vdi));
    let (camera, viewer) = (vdi.header().camera.rotated_about_y(NOVEL_ANGLE_DEG)?, viz::Backend::default());
    for &size in sizes {
        clock.time(format!("render {r} at {size}"), || prepared.render(&camera, size, size))?;
        let blended = || viewer.render_vdi(&prepared, &camera, size, size, Detail::Cubic);
        clock.time(format!("blend {r} at {size}"), blended)?;
    }
    Ok(())
}

/// Milliseconds of everything measured, in the order it was first met.
#[derive(Default)]
struct Clock {
    warm: bool,
    measured: Vec<Timings>,
}

struct Timings {
    name: String,
    wall_ms: Vec<f64>,
    cpu_ms: Vec<f64>,
}

impl Clock {
    fn rounds(&mut self, count: u32, mut round: impl FnMut(&mut Self) -> anyhow::Result<()>) -> anyhow::Result<()> {
        for n in 0..=count {
            self.warm = n > 0;
            round(self)?;
        }
        Ok(())
    }

    /// Runs `work`; what it returns is dropped by the caller, out of the measured time.
    fn time<T>(&mut self, name: String, work: impl FnOnce() -> T) -> T {
        let (cpu, wall) = (ProcessorTime::now(), Instant::now());
        let made = work();
        let (wall, used) = (wall.elapsed(), cpu.secs());
        if self.warm {
            let at = self.measured.iter().position(|m| m.name == name).unwrap_or_else(|| {
                self.measured.push(Timings { name, wall_ms: Vec::new(), cpu_ms: Vec::new() });
                self.measured.len() - 1
            });
            self.measured[at].wall_ms.push(1e3 * wall.as_secs_f64());
            self.measured[at].cpu_ms.extend(used.map(|secs| 1e3 * secs));
        }
        made
    }

    fn print(&self, json: bool) -> anyhow::Result<()> {
        #[derive(Serialize)]
        struct BenchLine<'a> {
            name: &'a str,
            wall_ms: f64,
            least_wall_ms: f64,
            cpu_ms: Option<f64>,
            rounds: usize,
        }
        if !json {
            say!("{:<24}{:>12}{:>12}{:>12}", "median of rounds", "wall ms", "CPU ms", "least wall");
        }
        for m in &self.measured {
            let least_wall_ms = m.wall_ms.iter().copied().fold(f64::INFINITY, f64::min);
            let (wall_ms, cpu_ms) = (median(&m.wall_ms).context("no round")?, median(&m.cpu_ms));
            if json {
                let line = BenchLine { name: &m.name, wall_ms, least_wall_ms, cpu_ms, rounds: m.wall_ms.len() };
                say!("{}", serde_json::to_string(&line)?);
            } else {
                let cpu = cpu_ms.map_or_else(|| "-".to_owned(), |ms| format!("{ms:.2}"));
                say!("{:<24}{wall_ms:>12.2}{cpu:>12}{least_wall_ms:>12.2}", m.name);
            }
        }
        Ok(())
    }
}

fn median(values: &[f64]) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let (low, high) = (sorted.get(sorted.len().checked_sub(1)? / 2)?, sorted.get(sorted.len() / 2)?);
    Some(0.5 * (low + high))
}

/// The most memory that was in use at once, beyond that of a process that has done the same with next to nothing.
#[derive(Serialize)]
struct Memory {
    name: String,
    peak_bytes: u64,
    /// In use before the measured part began.
    before_bytes: u64,
    /// Voxels as kept; 0 where there are none.
    volume_bytes: u64,
    /// The VDI in memory.
    vdi_bytes: u64,
}

impl Memory {
    fn print(&self, json: bool) -> anyhow::Result<()> {
        if json {
            say!("{}", serde_json::to_string(self)?);
        } else {
            let (peak, before) = (self.peak_bytes, self.before_bytes);
            for (what, bytes) in
                [("peak", peak), ("before", before), ("volume", self.volume_bytes), ("VDI", self.vdi_bytes)]
            {
                say!("{:<24}{what:<8}{:>12.2} MB", self.name, bytes as f64 / 1e6);
            }
        }
        Ok(())
    }
}

/// Memory in use by a process that has done all there is with two voxels a side and one ray: code, threads, tables.
fn memory_at_first(backend: &Backend) -> anyhow::Result<u64> {
    let grid = Grid::new([2; 3], DVec3::ONE, DVec3::ZERO)?;
    let volume = Volume::new(grid, Voxels::F32((0..8_u8).map(f32::from).collect()))?;
    let scene = suggest::suggest(&[&volume])?;
    let (vdi, _) = backend.generate(&Field::new(volume, &scene), &VdiParams::new(1, 0.0)?, Segmentation::Greedy)?;
    let vdi = lamina_codec::decode(&lamina_codec::encode(&vdi, &EncodeOptions::default())?, &DecodeLimits::default())?;
    PreparedVdi::new(&vdi).render(&scene.camera, 1, 1)?;
    Ok(process::memory()?.0)
}

/// While a VDI is generated. Reading the file took more for a moment; that is over and is not counted.
fn generator_memory(arguments: &cli::BenchArguments) -> anyhow::Result<Memory> {
    let backend = Backend::open(arguments.input.backend)?;
    let first = memory_at_first(&backend)?;
    let (volume, scene) = open(&arguments.input)?;
    let volume_bytes = volume.size_bytes() as u64;
    let field = prepare(volume, &scene);
    let params = params(arguments, arguments.resolution, &scene)?;
    process::forget_peak()?;
    let before_bytes = process::memory()?.0.saturating_sub(first);
    let (vdi, _) = backend.generate(&field, &params, Segmentation::Greedy)?;
    let peak_bytes = process::memory()?.1.saturating_sub(first);
    let name = format!("generate {}", arguments.resolution);
    Ok(Memory { name, peak_bytes, before_bytes, volume_bytes, vdi_bytes: vdi_bytes(&vdi) })
}

/// While a VDI is read, decoded, prepared and drawn.
fn viewer_memory(arguments: &cli::BenchArguments) -> anyhow::Result<Memory> {
    let first = memory_at_first(&Backend::cpu())?;
    process::forget_peak()?;
    let bytes = read_vdi(&arguments.input.input)?;
    let vdi = lamina_codec::decode(&bytes, &DecodeLimits::default())?;
    drop(bytes);
    let (camera, size) = (vdi.header().camera.rotated_about_y(NOVEL_ANGLE_DEG)?, arguments.size[0]);
    let prepared = PreparedVdi::new(&vdi);
    let image = prepared.render(&camera, size, size)?;
    let peak_bytes = process::memory()?.1.saturating_sub(first);
    ensure!(image.width() == size, "a picture of another size");
    let name = format!("render {} at {size}", vdi.resolution());
    Ok(Memory { name, peak_bytes, before_bytes: 0, volume_bytes: 0, vdi_bytes: vdi_bytes(&vdi) })
}

fn vdi_bytes(vdi: &Vdi) -> u64 {
    (size_of_val::<[Supersegment]>(vdi.segments()) + size_of_val::<[u32]>(vdi.offsets())) as u64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn medians_lie_in_the_middle() {
        assert_eq!(median(&[]), None);
        assert_eq!(median(&[3.0]), Some(3.0));
        assert_eq!(median(&[9.0, 1.0, 2.0]), Some(2.0));
        assert_eq!(median(&[9.0, 1.0, 2.0, 4.0]), Some(3.0));
    }

    #[test]
    fn the_round_that_warms_up_is_not_counted() {
        let (mut clock, mut runs) = (Clock::default(), 0);
        let round = |clock: &mut Clock| {
            runs += 1;
            clock.time("work".to_owned(), || ());
            Ok(())
        };
        clock.rounds(3, round).unwrap();
        assert_eq!((runs, clock.measured.len(), clock.measured[0].wall_ms.len()), (4, 1, 3));
    }
}
