//! Rate control: the first of several parameters whose bytes keep the size limit, and what a run starts with.

use crate::key_frames::Predecessor;
use crate::step::Step;
use lamina_codec::volume::ReferenceVolume;
use lamina_codec::{EncodeOptions, EncodedStep, ErrorMeasure};
use lamina_compute::Laps;
use lamina_model::{Cost, GenerationParams, Invalid, Limits, Representation, Setting, VdiParams};
use std::time::Duration;

/// A step generated.
pub(crate) struct GeneratedStep {
    /// What it was made with.
    pub params: GenerationParams,
    /// Its bytes, and the cost of everything made for it.
    pub encoded: EncodedStep,
    /// With what was wanted it was too large, or could not be made.
    pub fell_back: bool,
}

/// Points a side and error bound of the reduced volume that an untuned run starts with.
const START_POINTS: u32 = 96;
const START_BOUND: f64 = 0.01;

/// What a run starts with where nobody states parameters: a reduced volume, which of all takes the least time to generate, decode
/// and measure, and is near the best one where the data has a hundred points a side; a VDI where no volume can stand for the step, or
/// `only_vdis` are wanted.
pub(crate) fn start_params(step: &Step, only_vdis: bool) -> GenerationParams {
    let side = step.longest_side();
    match GenerationParams::volume(side.clamp(1, START_POINTS), START_BOUND) {
        Ok(volume) if side > 1 && !only_vdis => volume,
        _ => GenerationParams::default(),
    }
}

/// Where on a setting's ladder the last step was: the next one begins there, since series change little from step to step.
#[derive(Debug, Default)]
struct Rung {
    first: Option<GenerationParams>,
    at: usize,
}

/// Those of key frames and of steps coded after others.
#[derive(Debug, Default)]
pub(crate) struct Rungs {
    key: Rung,
    after: Rung,
}

/// A step this far below the limit lets the next one begin a rung higher.
const ROOM: f64 = 0.88;

/// What coding a step after another one saves is spent in such parts: bounds this much narrower from rung to rung, which takes a tenth more bytes
/// or so.
const FINER: f64 = 0.85;
const FINER_RUNGS: i32 = 5;

impl Rung {
    /// Where a step whose ladder begins with `first` begins; at `wanted` if no other one was on it.
    fn start(&self, first: &GenerationParams, wanted: usize) -> usize {
        if self.first == Some(*first) { self.at } else { wanted }
    }

    /// It came to rest `at` a rung, with so large a share of the limit.
    fn rest(&mut self, first: GenerationParams, at: usize, share: f64) {
        let up = usize::from(at > 0 && share < ROOM);
        *self = Self { first: Some(first), at: at - up };
    }
}

/// The step with parameters `wanted`, or with the first of the setting's fallbacks that keeps the size limit; after them ever coarser
/// ones of the same representation, then VDIs, which can stand for any step. The smallest, where none keeps the limit. A volume is coded after
/// `before` if that saves bytes, and with narrower bounds where these fill the limit.
pub(crate) fn generate_within(
    step: &Step,
    wanted: GenerationParams,
    setting: &Setting,
    before: Option<&Predecessor<'_>>,
    options: &EncodeOptions,
    (laps, rungs): (&mut Laps, &mut Rungs),
) -> Result<GeneratedStep, Invalid> {
    let limit = setting.limits.size_bytes;
    let rung = if before.is_some() { &mut rungs.after } else { &mut rungs.key };
    let volume = before.map(|before| before.volume);
    let mut search = Search { step, options, limit, before: volume, spent: [Duration::ZERO; 2], best: Err(None), laps };
    let mut ladder = if before.is_some_and(|before| before.fills_limit) { finer(&wanted) } else { Vec::new() };
    let first_wanted = ladder.len();
    ladder.push(wanted);
    ladder.extend(&setting.fallbacks);
    // Data may grow far beyond what a study has seen.
    ladder.extend(coarser(setting.fallbacks.last().unwrap_or(&wanted)).skip(1));
    let first = ladder[0];
    let start = rung.start(&first, first_wanted).min(ladder.len() - 1);
    search.until_one_fits(ladder[start..].iter().copied());
    let [generation, encode] = search.spent;
    let none = || Invalid::new("params", "none to generate with");
    let (params, encoded) = search.best.map_err(|why| why.unwrap_or_else(none))?;
    let at = ladder.iter().position(|p| *p == params).unwrap_or(0);
    rung.rest(first, at, limit.map_or(0.0, |limit| encoded.cost.size_bytes as f64 / limit as f64));
    let encoded = EncodedStep { cost: Cost { generation, encode, ..encoded.cost }, ..encoded };
    Ok(GeneratedStep { params, encoded, fell_back: at > first_wanted })
}

/// Shares of the sample points a side and error bounds of a step's copy, by falling size.
const COPIES: [(f64, f64); 8] =
    [(1.0, 0.0005), (1.0, 0.002), (1.0, 0.008), (0.75, 0.01), (0.6, 0.015), (0.45, 0.02), (0.35, 0.03), (0.25, 0.04)];

/// The step as fine as fits `size_bytes`: a reduced volume of all its points, or one that is coarser, whose values are right also where
/// the scene shows nothing of them; a VDI where it can be none.
///
/// # Errors
/// If none is as small.
pub(crate) fn copy_within(
    step: &Step,
    size_bytes: u64,
    options: &EncodeOptions,
    laps: &mut Laps,
) -> Result<EncodedStep, Invalid> {
    let side = f64::from(step.longest_side().min(VdiParams::MAX_RESOLUTION));
    let copy = |(share, bound): (f64, f64)| GenerationParams::volume((share * side).round().max(1.0) as u32, bound);
    let fallbacks = COPIES.into_iter().map(copy).collect::<Result<Vec<_>, Invalid>>()?;
    let limits = Limits { size_bytes: Some(size_bytes), ..Limits::default() };
    let setting = Setting { limits, fallbacks, ..Setting::default() };
    let options = EncodeOptions { error: ErrorMeasure::Everywhere, ..*options };
    let rungs = &mut Rungs::default();
    let made = generate_within(step, setting.fallbacks[0], &setting, None, &options, (laps, rungs))?;
    let smallest = made.encoded.cost.size_bytes;
    if smallest > size_bytes {
        return Err(Invalid::new(
            "trigger.copy_kb",
            format!("the smallest copy takes {smallest} bytes; allow as many"),
        ));
    }
    Ok(made.encoded)
}

/// `wanted` with ever wider bounds, the narrowest first.
fn finer(wanted: &GenerationParams) -> Vec<GenerationParams> {
    let with = |k: i32| wanted.with_gamma(wanted.gamma() * FINER.powi(k)).ok();
    (1..=FINER_RUNGS).rev().filter_map(with).collect()
}

/// Ever coarser parameters from `start` on; after volumes VDIs, which can stand for any step.
fn coarser(start: &GenerationParams) -> impl Iterator<Item = GenerationParams> {
    let ladder = |start: GenerationParams, shrink: f64, grow: f64| {
        (0..12).filter_map(move |k| {
            let resolution = (f64::from(start.resolution()) * shrink.powi(k)).round().max(2.0) as u32;
            start.with_resolution(resolution).ok()?.with_gamma((start.gamma() * grow.powi(k)).min(0.3)).ok()
        })
    };
    let is_volume = start.representation() == Representation::Volume;
    let vdis = ladder(if is_volume { GenerationParams::default() } else { *start }, 0.8, 1.25);
    let volumes = is_volume.then(|| ladder(*start, 0.92, 1.5));
    volumes.into_iter().flatten().chain(vdis)
}

/// Generations of one step.
struct Search<'a> {
    step: &'a Step,
    options: &'a EncodeOptions,
    limit: Option<u64>,
    before: Option<&'a ReferenceVolume>,
    /// Generating and encoding.
    spent: [Duration; 2],
    /// The smallest so far; why there is none.
    best: Result<(GenerationParams, EncodedStep), Option<Invalid>>,
    laps: &'a mut Laps,
}

impl Search<'_> {
    fn until_one_fits(&mut self, all: impl Iterator<Item = GenerationParams>) {
        let step = self.step.step;
        for params in all {
            let encoded = match self.step.measure(&params, self.options, self.before, self.laps) {
                Ok(measured) => measured,
                Err(error) => {
                    if let Err(why) = &mut self.best {
                        // A step that no reduced volume can stand for refuses them all.
                        if why.as_ref().is_none_or(|before| before.to_string() != error.to_string()) {
                            tracing::warn!(step, %error, "trying other parameters");
                        }
                        *why = Some(error);
                    }
                    continue;
                }
            };
            let cost = encoded.cost;
            self.spent[0] += cost.generation;
            self.spent[1] += cost.encode;
            if !matches!(&self.best, Ok((_, smallest)) if smallest.bytes.len() <= encoded.bytes.len()) {
                self.best = Ok((params, encoded));
            }
            if self.limit.is_none_or(|limit| cost.size_bytes <= limit) {
                return;
            }
            tracing::info!(step, bytes = cost.size_bytes, "above the size limit; trying smaller parameters");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_begins_where_the_last_one_ended_and_goes_up_again_where_there_is_room() {
        let params = |resolution| GenerationParams::vdi(resolution, 0.02).unwrap();
        let mut rung = Rung::default();
        assert_eq!((rung.start(&params(64), 0), rung.start(&params(64), 5)), (0, 5));
        rung.rest(params(64), 3, 0.97);
        assert_eq!(
            (rung.start(&params(64), 0), rung.start(&params(65), 0)),
            (3, 0),
            "another setting begins at its own"
        );
        rung.rest(params(64), 3, 0.8);
        assert_eq!(rung.start(&params(64), 0), 2);
        rung.rest(params(64), 0, 0.1);
        assert_eq!(rung.start(&params(64), 5), 0);
    }

    #[test]
    fn finer_parameters_narrow_the_bound_alone() {
        let volume = GenerationParams::volume(96, 0.01).unwrap();
        let all = finer(&volume);
        assert_eq!(all.len(), FINER_RUNGS as usize);
        assert!(all.iter().all(|p| p.resolution() == 96));
        assert!(all.windows(2).all(|w| w[0].gamma() < w[1].gamma()) && all[4].gamma() < 0.01);
    }

    #[test]
    fn coarser_parameters_fall_in_size_and_end_with_vdis() {
        let volume = GenerationParams::volume(96, 0.01).unwrap();
        let all: Vec<GenerationParams> = coarser(&volume).collect();
        let volumes = all.iter().take_while(|p| p.representation() == Representation::Volume).count();
        assert_eq!((volumes, all.len()), (12, 24));
        assert!(all[..12].windows(2).all(|w| w[1].resolution() < w[0].resolution() && w[1].gamma() >= w[0].gamma()));
        assert!(all[12..].windows(2).all(|w| w[1].resolution() < w[0].resolution() && w[1].gamma() > w[0].gamma()));
        assert_eq!(coarser(&GenerationParams::default()).count(), 12);
    }
}
