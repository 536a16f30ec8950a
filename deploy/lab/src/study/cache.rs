//! What a study has measured, on disk: a study that was interrupted goes on where it stopped.
//!
//! One file for each field, scene and sample plan, one line for each trial and for each time it was timed again, each with its
//! checksum. A damaged line is left out and what it held measured again.

use anyhow::Context;
use lamina::in_process::{RecordedTrial, SpentTime, TrialStore};
use lamina_model::Cost;
use lamina_model::{GenerationParams, ParamsKey, Quality, SamplePlan, Scene, ViewError, Volume};
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::collections::HashMap;
use std::fmt::Write as _;
use std::fs::{self, File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Goes into the key: raised when what is measured changes its meaning.
const VERSION: u32 = 7;

/// A trial as a line of the file.
#[derive(Serialize, Deserialize)]
struct CacheLine {
    params: GenerationParams,
    size_bytes: u64,
    supersegments: u64,
    generation_ns: u64,
    encode_ns: u64,
    timed: u32,
    spent: SpentTime,
    angles_deg: Vec<f64>,
    batch_mse: Vec<Vec<f64>>,
    /// Of each view, where every pixel was compared.
    #[serde(default)]
    ssim: Vec<Option<f64>>,
}

impl From<&RecordedTrial> for CacheLine {
    fn from(t: &RecordedTrial) -> Self {
        Self {
            params: t.params,
            size_bytes: t.cost.size_bytes,
            supersegments: t.cost.elements,
            generation_ns: t.cost.generation.as_nanos() as u64,
            encode_ns: t.cost.encode.as_nanos() as u64,
            timed: t.timed,
            spent: t.spent,
            angles_deg: t.quality.views.iter().map(|v| v.angle_deg).collect(),
            batch_mse: t.quality.views.iter().map(|v| v.batch_mse.clone()).collect(),
            ssim: t.quality.views.iter().map(|v| v.ssim).collect(),
        }
    }
}

impl From<CacheLine> for RecordedTrial {
    fn from(l: CacheLine) -> Self {
        let cost = Cost {
            size_bytes: l.size_bytes,
            elements: l.supersegments,
            generation: Duration::from_nanos(l.generation_ns),
            encode: Duration::from_nanos(l.encode_ns),
        };
        let similarities = l.ssim.into_iter().chain(std::iter::repeat(None));
        let view = |((angle_deg, batch_mse), ssim)| ViewError { angle_deg, batch_mse, ssim };
        let views = l.angles_deg.into_iter().zip(l.batch_mse).zip(similarities).map(view).collect();
        Self { params: l.params, cost, timed: l.timed, quality: Quality { views }, spent: l.spent }
    }
}

/// Trials by their parameters, each a line of a file.
#[derive(Debug)]
pub(super) struct Cache {
    path: PathBuf,
    file: File,
    trials: HashMap<ParamsKey, RecordedTrial>,
}

/// What the trials of one file have in common, as 16 hexadecimal digits.
pub(super) fn fingerprint(volume: &Volume, scene: &Scene, plan: &SamplePlan, kernel: &str) -> anyhow::Result<String> {
    let mut hash = Sha256::new();
    hash.update(VERSION.to_le_bytes());
    let grid = volume.grid();
    // Plane by plane, so that no copy of the volume is made.
    let plane = grid.dims()[0] * grid.dims()[1];
    for voxels in std::iter::once(volume.voxels()).chain(volume.color_field().map(|(_, voxels)| voxels)) {
        for z in 0..grid.dims()[2] {
            hash.update(voxels.to_le_bytes(z * plane..(z + 1) * plane));
        }
    }
    hash.update(serde_json::to_vec(&(grid.dims(), grid.spacing(), grid.origin(), scene, plan, kernel))?);
    let mut name = String::new();
    for byte in &hash.finalize()[..8] {
        write!(name, "{byte:02x}")?;
    }
    Ok(name)
}

impl Cache {
    /// The cache at `path`, which need not exist; says what of it was damaged.
    ///
    /// # Errors
    /// If the file cannot be read or written.
    pub(super) fn open(path: &Path) -> anyhow::Result<Self> {
        let text = match fs::read(path) {
            Ok(bytes) => String::from_utf8_lossy(&bytes).into_owned(),
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => String::new(),
            Err(e) => return Err(e).with_context(|| format!("{}: cannot be read", path.display())),
        };
        let (good, bad): (Vec<&str>, Vec<&str>) = text.lines().partition(|line| parse(line).is_some());
        let unable = || format!("{}: cannot be written", path.display());
        if !bad.is_empty() || (!text.is_empty() && !text.ends_with('\n')) {
            eprintln!(
                "warning: {}: {} of {} lines are damaged; what they hold is measured again",
                path.display(),
                bad.len(),
                good.len() + bad.len()
            );
            let whole: String = good.iter().flat_map(|line| [line, "\n"]).collect();
            let fresh = path.with_extension("new");
            fs::write(&fresh, whole).and_then(|()| fs::rename(&fresh, path)).with_context(unable)?;
        }
        if let Some(folder) = path.parent() {
            fs::create_dir_all(folder).with_context(unable)?;
        }
        let file = OpenOptions::new().create(true).append(true).open(path).with_context(unable)?;
        let trials = good.iter().filter_map(|line| parse(line)).map(|t| (t.params.key(), t)).collect();
        Ok(Self { path: path.to_owned(), file, trials })
    }
}

impl TrialStore for Cache {
    fn get(&self, params: &GenerationParams) -> Option<&RecordedTrial> {
        self.trials.get(&params.key())
    }

    fn put(&mut self, trial: RecordedTrial) -> anyhow::Result<()> {
        let json = serde_json::to_string(&CacheLine::from(&trial))?;
        let line = format!("{:08x} {json}\n", crc32fast::hash(json.as_bytes()));
        self.file.write_all(line.as_bytes()).with_context(|| format!("{}: cannot be written", self.path.display()))?;
        self.trials.insert(trial.params.key(), trial);
        Ok(())
    }
}

fn parse(line: &str) -> Option<RecordedTrial> {
    let (checksum, json) = line.split_once(' ')?;
    let stated = u32::from_str_radix(checksum, 16).ok()?;
    if stated != crc32fast::hash(json.as_bytes()) {
        return None;
    }
    let line: CacheLine = serde_json::from_str(json).ok()?;
    (line.angles_deg.len() == line.batch_mse.len()).then(|| line.into())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn trial(resolution: u32) -> RecordedTrial {
        let quality =
            Quality { views: vec![ViewError { angle_deg: 10.0, batch_mse: vec![1e-3, 0.1 + 0.2], ssim: None }] };
        let cost = Cost { size_bytes: 7, elements: 3, ..Cost::default() };
        let params = GenerationParams::vdi(resolution, 0.013).unwrap();
        RecordedTrial { params, cost, timed: 1, quality, spent: SpentTime::default() }
    }

    #[test]
    fn a_cut_or_damaged_file_loses_only_the_trials_it_hit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("deep/cache.jsonl");
        let mut cache = Cache::open(&path).unwrap();
        for r in [10, 20, 30] {
            cache.put(trial(r)).unwrap();
        }
        drop(cache);
        let whole = fs::read_to_string(&path).unwrap();
        let again = Cache::open(&path).unwrap();
        assert_eq!(again.trials.len(), 3);
        assert_eq!(again.get(&trial(20).params).unwrap().quality, trial(20).quality, "to the last bit");

        fs::write(&path, whole.replacen("20", "21", 1)).unwrap();
        let again = Cache::open(&path).unwrap();
        assert!(again.get(&trial(20).params).is_none() && again.get(&trial(21).params).is_none());
        assert_eq!(again.trials.len(), 2);
        assert_eq!(fs::read_to_string(&path).unwrap().lines().count(), 2, "the file is whole again");

        fs::write(&path, &whole[..whole.len() - 9]).unwrap();
        let mut again = Cache::open(&path).unwrap();
        assert_eq!(again.trials.len(), 2);
        again.put(trial(30)).unwrap();
        assert_eq!(Cache::open(&path).unwrap().trials.len(), 3);
        fs::write(&path, [0xff, 0xfe, 0x00]).unwrap();
        assert_eq!(Cache::open(&path).unwrap().trials.len(), 0);
    }
}
