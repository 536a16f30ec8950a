//! What is sent for a step: the first of several parameters that keeps the size limit.

use crate::prepared::Prepared;
use crate::schedule::Setting;
use lamina_model::{GenerationParams, Invalid, Representation};
use lamina_wire::codec::EncodeOptions;
use lamina_wire::v1;

/// What stands for a step: how it was made, its bytes, what they cost.
pub type Generated = (GenerationParams, Vec<u8>, v1::Cost);

/// The step with the setting's parameters, or with the first fallback that keeps the size limit. Where none of them can be
/// used, as volumes cannot where voxels are missing, or there are no fallbacks yet, a VDI as the node starts with (`start`), or
/// the first that keeps the limit of ever coarser ones.
pub fn generate_within(
    prepared: &Prepared,
    setting: &Setting,
    start: &GenerationParams,
    options: &EncodeOptions,
) -> Result<Generated, Invalid> {
    let limit = setting.limits.size_bytes;
    let mut attempts = Attempts { prepared, options, limit, spent_ns: [0; 2], best: Err(None) };
    attempts.until_one_fits(std::iter::once(setting.params).chain(setting.fallbacks.iter().copied()));
    // Before the first study there are no fallbacks; those of a study go as far down as it has found worth sending.
    if attempts.best.is_err() || (setting.fallbacks.is_empty() && !attempts.fits()) {
        attempts.until_one_fits(last_resort(start).filter(|p| *p != setting.params));
    }
    // The step's cost is that of all attempts.
    let [generation_ns, encode_ns] = attempts.spent_ns;
    let none = || Invalid::new("params", "none to generate with");
    let (params, bytes, cost) = attempts.best.map_err(|why| why.unwrap_or_else(none))?;
    Ok((params, bytes, v1::Cost { generation_ns, encode_ns, ..cost }))
}

/// VDIs as the node starts with, then ever coarser ones.
fn last_resort(start: &GenerationParams) -> impl Iterator<Item = GenerationParams> {
    let start = start.with_representation(Representation::Vdi);
    (0..12).filter_map(move |k| {
        let resolution = (f64::from(start.resolution()) * 0.8_f64.powi(k)).round().max(1.0) as u32;
        start.with_resolution(resolution).ok()?.with_gamma(start.gamma() * 1.25_f64.powi(k)).ok()
    })
}

/// Attempts at one step.
struct Attempts<'a> {
    prepared: &'a Prepared,
    options: &'a EncodeOptions,
    limit: Option<u64>,
    /// Generating and encoding.
    spent_ns: [u64; 2],
    /// The smallest so far; why there is none.
    best: Result<Generated, Option<Invalid>>,
}

impl Attempts<'_> {
    /// True if one of them keeps the limit.
    fn fits(&self) -> bool {
        let kept = |cost: &v1::Cost| self.limit.is_none_or(|limit| cost.size_bytes <= limit);
        self.best.as_ref().is_ok_and(|(_, _, cost)| kept(cost))
    }

    fn until_one_fits(&mut self, all: impl Iterator<Item = GenerationParams>) {
        let step = self.prepared.step;
        for params in all {
            let (bytes, cost) = match self.prepared.measure(&params, self.options) {
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
