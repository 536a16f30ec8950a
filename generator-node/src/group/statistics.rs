//! Statistics of a step whose voxels are at several members, for triggers: those of one node that has them all.

use super::member::Member;
use super::window::OwnPoints;
use super::{Kind, send};
use crate::ingest::GridBox;
use crate::triggers::{Moments, Statistics, sample_stride};
use lamina_model::{Grid, Invalid};
use lamina_rpc::v1;
use prost::Message as _;

impl Member {
    /// What this member has to say of the whole: the moments of all members' values, and of its own points their histogram between
    /// the least and the largest value of all, and those at which steps are compared.
    pub(super) fn statistics_of(
        &mut self,
        sequence: u64,
        points: &[OwnPoints<'_>],
        grid: &Grid,
    ) -> Result<v1::GroupStatistics, Invalid> {
        let values = || points.iter().flat_map(OwnPoints::values);
        let own = message(&Moments::of(values())).encode_to_vec();
        let others = self.others();
        others.iter().for_each(|&other| send(&self.outbox, other, sequence, Kind::Moments(own.clone())));
        let mut gathered = self.gather(sequence, others, |kind| match kind {
            Kind::Moments(bytes) => Some(bytes),
            _ => None,
        })?;
        gathered.push((self.outbox.rank(), own));
        // In one order at all members, so that all have the same range.
        gathered.sort_by_key(|(from, _)| *from);
        let mut all = Moments::NONE;
        for (_, bytes) in gathered {
            all = all
                .and(moments(&v1::GroupMoments::decode(&bytes[..]).map_err(|e| Invalid::new("group", e.to_string()))?));
        }
        let (stride, whole) =
            (sample_stride(grid.voxels()), GridBox::new([0; 3], grid.dims().map(|n| n as u64), grid)?);
        let indexed = points.iter().flat_map(|points| points.indexes(&whole).zip(points.values()));
        let sampled = indexed.filter(|(index, _)| index.is_multiple_of(stride));
        let (indexes, samples) = sampled.map(|(index, sample)| (index as u64, sample)).unzip();
        Ok(v1::GroupStatistics { moments: Some(message(&all)), counts: all.histogram(values()), indexes, samples })
    }
}

/// The statistics of a step of `grid` of what all members say.
pub(super) fn of_all(answers: Vec<v1::GroupStatistics>, grid: &Grid) -> Option<Statistics> {
    let all = moments(answers.first()?.moments.as_ref()?);
    let stride = sample_stride(grid.voxels());
    let mut samples = vec![f64::NAN; grid.voxels().div_ceil(stride)];
    let mut counts: Vec<u64> = Vec::new();
    for of_member in answers {
        counts.resize(counts.len().max(of_member.counts.len()), 0);
        counts.iter_mut().zip(&of_member.counts).for_each(|(sum, count)| *sum += count);
        for (index, sample) in of_member.indexes.iter().zip(of_member.samples) {
            *samples.get_mut(*index as usize / stride)? = sample;
        }
    }
    Some(Statistics::new(&all, counts, samples))
}

fn message(&Moments { min, max, sum, count, missing }: &Moments) -> v1::GroupMoments {
    v1::GroupMoments { min, max, sum, count, missing }
}

fn moments(&v1::GroupMoments { min, max, sum, count, missing }: &v1::GroupMoments) -> Moments {
    Moments { min, max, sum, count, missing }
}
