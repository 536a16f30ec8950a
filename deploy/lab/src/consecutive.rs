//! `lamina-lab consecutive`: what coding each reduced volume after the one before saves, on a recorded series.

use crate::cli;
use anyhow::ensure;
use lamina::cli::Input;
use lamina::offline::prepare;
use lamina::say;
use lamina::scene_file::scene_for;
use lamina::source::read_options;
use lamina_codec::volume::{ReferenceVolume, decode_after, encode_after};
use lamina_codec::{DecodeLimits, ErrorMeasure};
use lamina_model::{ReducedVolume, VolumeParams};
use lamina_volume_io::Series;
use std::time::Instant;

/// Sums over the steps coded in one way.
#[derive(Default)]
struct Sums {
    bytes: usize,
    encode_ms: f64,
    decode_ms: f64,
    squares: f64,
}

impl Sums {
    /// Encodes and decodes `volume`; what a later step may be coded after.
    fn add(
        &mut self,
        volume: &ReducedVolume,
        reference: Option<&ReferenceVolume>,
    ) -> anyhow::Result<(usize, ReferenceVolume)> {
        let start = Instant::now();
        let (bytes, next) = encode_after(volume, ErrorMeasure::MeanSquare, reference);
        let encoded = Instant::now();
        let decoded = decode_after(&bytes, &DecodeLimits::default(), reference)?;
        self.decode_ms += encoded.elapsed().as_secs_f64() * 1e3;
        self.encode_ms += (encoded - start).as_secs_f64() * 1e3;
        self.bytes += bytes.len();
        let off = |(a, b): (&f32, &f32)| if a.is_nan() { 0.0 } else { f64::from(a - b).powi(2) };
        self.squares += volume.units().iter().zip(decoded.units()).map(off).sum::<f64>() / volume.units().len() as f64;
        Ok((bytes.len(), next))
    }
}

/// `lamina-lab consecutive`.
pub(crate) fn consecutive(arguments: &cli::Consecutive) -> anyhow::Result<()> {
    let Input { input, raw, scene, time_step, .. } = &arguments.input;
    let series = Series::open(input, &read_options(raw))?;
    let last = time_step + arguments.steps as usize;
    ensure!(
        last < series.len(),
        "--time-step {time_step} --steps {}: {} has {} steps, and the first is coded alone",
        arguments.steps,
        input.display(),
        series.len()
    );
    let first = series.read(*time_step)?;
    let scene = scene_for(scene.as_deref(), &[&first])?;
    for &gamma in &arguments.gammas {
        let params = VolumeParams::new(arguments.resolution, gamma)?;
        let reduced = |n: usize| -> anyhow::Result<ReducedVolume> {
            Ok(lamina_raycast::reduce(&prepare(series.read(n)?, &scene), &params)?)
        };
        let (mut alone, mut after) = (Sums::default(), Sums::default());
        let (_, mut reference) = Sums::default().add(&reduced(*time_step)?, None)?;
        for n in time_step + 1..=last {
            let volume = reduced(n)?;
            let (whole, _) = alone.add(&volume, None)?;
            let (bytes, next) = after.add(&volume, Some(&reference))?;
            reference = next;
            say!("step {n}  gamma {gamma}  alone {whole}  after {bytes}  {:+.1} %", 100.0 * ratio(bytes, whole));
        }
        let steps = f64::from(arguments.steps);
        let decibels = |sums: &Sums| -10.0 * (sums.squares / steps).log10();
        say!(
            "gamma {gamma}  bytes {:+.1} %  encode {:.1} ms alone, {:.2} x after  decode {:.1} ms alone, {:.2} x after  of values {:.2} dB alone, {:.2} after",
            100.0 * ratio(after.bytes, alone.bytes),
            alone.encode_ms / steps,
            after.encode_ms / alone.encode_ms,
            alone.decode_ms / steps,
            after.decode_ms / alone.decode_ms,
            decibels(&alone),
            decibels(&after)
        );
    }
    Ok(())
}

/// By how much `now` is more than `before`, as a share of it.
fn ratio(now: usize, before: usize) -> f64 {
    now as f64 / before as f64 - 1.0
}
