//! Ghost points: what members tell each other of the points around their boxes.

use super::convert::Preparation;
use super::member::Member;
use super::window::SourcePoints;
use super::{Kind, send, window};
use crate::ingest::GridBox;
use lamina_model::{Invalid, VoxelType, Voxels};
use std::collections::BTreeSet;

/// A field's own bytes of each brick.
pub(super) type OwnBytes<'a> = Vec<(GridBox, &'a [u8])>;

impl Member {
    /// The voxels that this member's windows are made from, those of its own bricks and those of others: of each window the fields that are
    /// `sources`. `windows` are those of all members; `own` the bytes of each field, and `types` its voxels'.
    pub(super) fn exchange_ghosts(
        &mut self,
        sequence: u64,
        preparation: &Preparation,
        (windows, sources): (&[Vec<SourcePoints>], &BTreeSet<usize>),
        (own, types): (&[OwnBytes<'_>], &[VoxelType]),
    ) -> Result<Vec<Vec<Option<Voxels>>>, Invalid> {
        let (me, members) = (self.outbox.rank() as usize, preparation.members.len());
        let meet =
            |windows: &[SourcePoints], boxes: &[GridBox]| windows.iter().any(|w| boxes.iter().any(|b| w.shared(b) > 0));
        let mine = &preparation.members[me];
        for other in (0..members).filter(|&other| other != me && meet(&windows[other], mine)) {
            let of_fields = own.iter().zip(types).map(|(own, t)| window::ghosts(&windows[other], own, t.size_bytes()));
            let bytes: Vec<u8> = of_fields.flatten().collect();
            send(&self.outbox, other as u32, sequence, Kind::Ghost(bytes));
        }
        let owing = (0..members).filter(|&other| other != me && meet(&windows[me], &preparation.members[other]));
        let ghosts = self.gather(sequence, owing.map(|m| m as u32).collect(), ghost_points)?;
        let mut filled: Vec<Vec<Option<Voxels>>> = vec![vec![None; types.len()]; windows[me].len()];
        let mut consumed = vec![0; ghosts.len()];
        for &source in sources {
            let (own, voxel_type) = (&own[source], types[source]);
            let size = voxel_type.size_bytes();
            let mut of_field: Vec<Vec<u8>> = windows[me].iter().map(|w| vec![0; w.voxels() * size]).collect();
            let whole = window::ghosts(&windows[me], own, size);
            let mut complete = window::fill(&windows[me], &mut of_field, mine, size, &whole);
            for ((from, bytes), consumed) in ghosts.iter().zip(&mut consumed) {
                let boxes = &preparation.members[*from as usize];
                let points = windows[me].iter().flat_map(|w| boxes.iter().map(|b| w.shared(b)));
                let length = points.sum::<usize>() * size;
                let part = bytes.get(*consumed..*consumed + length).unwrap_or_default();
                complete &= window::fill(&windows[me], &mut of_field, boxes, size, part);
                *consumed += length;
            }
            if !complete {
                return Err(Invalid::new("group", "ghost points of another kind arrived"));
            }
            for (window, bytes) in filled.iter_mut().zip(of_field) {
                window[source] = Some(Voxels::from_le_bytes(voxel_type, &bytes));
            }
        }
        Ok(filled)
    }
}

fn ghost_points(kind: &Kind) -> Option<&[u8]> {
    if let Kind::Ghost(bytes) = kind { Some(bytes) } else { None }
}
