//! Rate control: the first of several parameters whose bytes keep the size limit, and what a run starts with.

use crate::schedule::Setting;
use crate::step::Step;
use lamina_compute::Laps;
use lamina_model::{GenerationParams, Invalid, Representation};
use lamina_wire::codec::EncodeOptions;
use lamina_wire::v1;

/// A step generated: its parameters, its bytes, what they cost.
pub type Generated = (GenerationParams, Vec<u8>, v1::Cost);

/// Points a side and error bound of the reduced volume that an untuned run starts with.
const START_POINTS: u32 = 96;
const START_BOUND: f64 = 0.01;

/// What a run starts with where nobody states parameters: a reduced volume, which of all takes the least time to generate, decode
/// and measure, and is near the best one where the data has a hundred points a side; a VDI where no volume can stand for the step, or
/// `only_vdis` are wanted.
pub fn start_params(step: &Step, only_vdis: bool) -> GenerationParams {
    let (vdi, side) = (GenerationParams::default(), step.longest_side());
    let volume = vdi.with_resolution(side.clamp(1, START_POINTS)).and_then(|p| p.with_gamma(START_BOUND));
    match volume {
        Ok(volume) if side > 1 && !only_vdis => volume.with_representation(Representation::Volume),
        _ => vdi,
    }
}

/// The step with parameters `first`, or with the first of the setting's fallbacks that keeps the size limit. Where none of them can be
/// used, as volumes cannot where voxels are missing, or there are no fallbacks yet, the first that keeps the limit of ever coarser
/// ones of the same representation, then of VDIs.
pub fn generate_within(
    step: &Step,
    first: GenerationParams,
    setting: &Setting,
    options: &EncodeOptions,
    laps: &mut Laps,
) -> Result<Generated, Invalid> {
    let limit = setting.limits.size_bytes;
    let mut search = Search { step, options, limit, spent_ns: [0; 2], best: Err(None), laps };
    search.until_one_fits(std::iter::once(first).chain(setting.fallbacks.iter().copied()));
    // Before the first study there are no fallbacks; those of a study go as far down as it has found worth sending.
    if search.best.is_err() || (setting.fallbacks.is_empty() && !search.fits()) {
        search.until_one_fits(coarser(&first).filter(|p| *p != first));
    }
    // The step's cost is that of everything generated for it.
    let [generation_ns, encode_ns] = search.spent_ns;
    let none = || Invalid::new("params", "none to generate with");
    let (params, bytes, cost) = search.best.map_err(|why| why.unwrap_or_else(none))?;
    Ok((params, bytes, v1::Cost { generation_ns, encode_ns, ..cost }))
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
    /// Generating and encoding.
    spent_ns: [u64; 2],
    /// The smallest so far; why there is none.
    best: Result<Generated, Option<Invalid>>,
    laps: &'a mut Laps,
}

impl Search<'_> {
    /// True if one of them keeps the limit.
    fn fits(&self) -> bool {
        let kept = |cost: &v1::Cost| self.limit.is_none_or(|limit| cost.size_bytes <= limit);
        self.best.as_ref().is_ok_and(|(_, _, cost)| kept(cost))
    }

    fn until_one_fits(&mut self, all: impl Iterator<Item = GenerationParams>) {
        let step = self.step.step;
        for params in all {
            let (bytes, cost) = match self.step.measure(&params, self.options, self.laps) {
                Ok(measured) => measured,
                Err(error) => {
                    tracing::warn!(step, %error, "trying other parameters");
                    if let Err(why) = &mut self.best {
                        *why = Some(error);
                    }
                    continue;
                }
            };
            self.spent_ns[0] += cost.generation_ns;
            self.spent_ns[1] += cost.encode_ns;
            if !matches!(&self.best, Ok((_, smallest, _)) if smallest.len() <= bytes.len()) {
                self.best = Ok((params, bytes, cost));
            }
            if self.limit.is_none_or(|limit| cost.size_bytes <= limit) {
                return;
            }
            tracing::info!(step, bytes = cost.size_bytes, "above the size limit; trying smaller parameters");
        }
    }
}
