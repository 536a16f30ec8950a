//! A member's share of a VDI: the lists of its tile, composited of all members' parts, and bands of the image, which it codes.

use super::convert::tile;
use super::member::{Member, StepKey, key, missing};
use super::{Kind, lists, send};
use lamina_codec::{BandStatistics, VdiBand};
use lamina_model::{GenerationParams, Invalid, Segmentation, VdiParams};
use lamina_raycast::{Compositor, Field, RowBand};
use lamina_rpc::v1;
use prost::Message as _;
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::time::{Duration, Instant};

impl Member {
    /// Makes the lists of its boxes, and of all boxes those of its tile; where that is asked for, encodes them with the others, and adds
    /// the time this takes to `encode`.
    pub(super) fn generate(
        &mut self,
        sequence: u64,
        command: v1::GroupGenerate,
        encode: &mut Duration,
    ) -> Result<Vec<u8>, Invalid> {
        let GenerationParams::Vdi(params) = lamina_rpc::required(command.params, "params")?.try_into()? else {
            return Err(Invalid::new("representation", "a VDI is generated, a volume reduced"));
        };
        let segmentation = if command.greedy { Segmentation::Greedy } else { Segmentation::Fitted };
        let tile = self.composite(sequence, key(command.step), &params, segmentation)?;
        let begun = Instant::now();
        let coded = if command.encode { self.encode(sequence, &params, &tile)? } else { v1::GroupCoded::default() };
        *encode += begun.elapsed();
        Ok(coded.encode_to_vec())
    }

    /// The lists of its tile.
    fn composite(
        &mut self,
        sequence: u64,
        step: StepKey,
        params: &VdiParams,
        segmentation: Segmentation,
    ) -> Result<RowBand, Invalid> {
        let fields = self.fields.get(&step).ok_or_else(|| missing(&step))?;
        let compositor = Compositor::new(&fields.grid, &fields.scene, params, segmentation)?;
        let generate = |field: &Field| self.backend.generate(field, compositor.part_params(), Segmentation::Greedy);
        let made = fields.parts.iter().map(|f| Ok(generate(f)?.0)).collect::<Result<Vec<_>, Invalid>>()?;
        let (me, members) = (self.outbox.rank(), self.outbox.size());
        for other in self.others() {
            let rows = tile(params.resolution(), other, members);
            let mut bytes = Vec::new();
            let bands = made.iter().map(|vdi| RowBand::of_rows(vdi, &rows));
            // Nothing is sent of a box that no ray of the tile meets.
            bands.filter(|band| !band.segments.is_empty()).for_each(|band| lists::write(&band, &mut bytes));
            send(&self.outbox, other, sequence, Kind::Lists(bytes));
        }
        let rows = tile(params.resolution(), me, members);
        let mut bands: Vec<RowBand> = made.iter().map(|vdi| RowBand::of_rows(vdi, &rows)).collect();
        drop(made);
        for (_, bytes) in self.gather(sequence, self.others(), lists_of_tile)? {
            let mut rest = &bytes[..];
            while !rest.is_empty() {
                bands.push(lists::read(&mut rest)?);
            }
        }
        compositor.rows(&rows, &bands)
    }

    /// Codes its parts of the image, of which it has the rows of its `tile`.
    fn encode(&mut self, sequence: u64, params: &VdiParams, tile: &RowBand) -> Result<v1::GroupCoded, Invalid> {
        let (r, row) = (params.resolution(), params.resolution() as usize);
        let quantized = VdiBand::quantized(tile.lists(), params.gamma());
        let whole = self.statistics(sequence, BandStatistics::of(&quantized))?;
        let (me, members) = (self.outbox.rank() as usize, self.outbox.size() as usize);
        let bands = whole.bands(r);
        let own_rows = |band: usize| {
            let nth = rows_of(&bands[band], me, members);
            quantized.slice(nth.start * row..nth.end * row)
        };
        let bands_of = |member: usize| bands_of(member, members, bands.len());
        let has_rows = |member: usize, wanted: &BTreeSet<usize>| {
            wanted.iter().any(|band| !rows_of(&bands[*band], member, members).is_empty())
        };
        for other in self.others() {
            let wanted = bands_of(other as usize);
            if has_rows(me, &wanted) {
                let bytes = wanted.iter().flat_map(|band| own_rows(*band).to_bytes()).collect();
                send(&self.outbox, other, sequence, Kind::Rows(bytes));
            }
        }
        let wanted = bands_of(me);
        let owing = |other: &u32| has_rows(*other as usize, &wanted);
        let gathered = self.gather(sequence, self.others().into_iter().filter(owing).collect(), quantized_rows)?;
        let mut sent: Vec<(usize, &[u8])> = gathered.iter().map(|(from, bytes)| (*from as usize, &bytes[..])).collect();
        let mut whole_bands = BTreeMap::new();
        for band in wanted {
            let mut of_members = vec![VdiBand::default(); members];
            of_members[me] = own_rows(band);
            for (from, rest) in &mut sent {
                of_members[*from] = VdiBand::read(rest)?;
            }
            whole_bands.insert(band, interleaved(&bands[band], &of_members, row)?);
        }
        let part = |number: usize| {
            let band = &whole_bands[&(number % bands.len())];
            if number < bands.len() { whole.encode_geometry(r, band) } else { whole.encode_colors(r, band) }
        };
        let own_parts: Vec<usize> = parts_of(me, members, bands.len()).collect();
        let parts = own_parts.into_par_iter().map(part).collect::<Result<_, _>>()?;
        let statistics = if me == 0 { whole.to_bytes() } else { Vec::new() };
        Ok(v1::GroupCoded { statistics, parts })
    }

    /// What is to be known of the whole, by way of member 0.
    fn statistics(&mut self, sequence: u64, own: BandStatistics) -> Result<BandStatistics, Invalid> {
        if self.outbox.rank() > 0 {
            send(&self.outbox, 0, sequence, Kind::Statistics(own.to_bytes()));
            let whole = self.gather(sequence, vec![0], statistics)?;
            return Ok(BandStatistics::read(&whole[0].1)?);
        }
        let gathered = self.gather(sequence, self.others(), statistics)?;
        let others = gathered.iter().map(|(_, bytes)| BandStatistics::read(bytes));
        let parts = std::iter::once(Ok(own)).chain(others).collect::<Result<Vec<_>, _>>()?;
        let whole = BandStatistics::union(&parts);
        let bytes = whole.to_bytes();
        self.others()
            .into_iter()
            .for_each(|other| send(&self.outbox, other, sequence, Kind::Statistics(bytes.clone())));
        Ok(whole)
    }
}

/// Parts that a member codes of the geometry of all bands and then the colors of all.
fn parts_of(member: usize, members: usize, bands: usize) -> impl Iterator<Item = usize> {
    (member..2 * bands).step_by(members)
}

/// The bands of which a member codes a part.
fn bands_of(member: usize, members: usize, bands: usize) -> BTreeSet<usize> {
    parts_of(member, members, bands).map(|part| part % bands).collect()
}

/// Rows below `row` that are in the tile of member `member` of so many.
fn rows_before(row: usize, member: usize, members: usize) -> usize {
    row.saturating_sub(member).div_ceil(members)
}

/// Which rows of a member's tile are among `rows` of the image.
fn rows_of(rows: &Range<usize>, member: usize, members: usize) -> Range<usize> {
    rows_before(rows.start, member, members)..rows_before(rows.end, member, members)
}

/// The band of `rows`, of which each member has those of its tile.
fn interleaved(rows: &Range<usize>, of_members: &[VdiBand], row: usize) -> Result<VdiBand, Invalid> {
    let (members, mut band) = (of_members.len(), VdiBand::default());
    for n in rows.clone() {
        let [before, nth] = [rows.start, n].map(|n_rows| rows_before(n_rows, n % members, members));
        let of_member = &of_members[n % members];
        let rays = (nth - before) * row..(nth - before + 1) * row;
        if of_member.rays() < rays.end {
            return Err(Invalid::new("group", "rows of another member end early"));
        }
        band.append(&of_member.slice(rays));
    }
    Ok(band)
}

fn lists_of_tile(kind: &Kind) -> Option<&[u8]> {
    if let Kind::Lists(bytes) = kind { Some(bytes) } else { None }
}

fn statistics(kind: &Kind) -> Option<&[u8]> {
    if let Kind::Statistics(bytes) = kind { Some(bytes) } else { None }
}

fn quantized_rows(kind: &Kind) -> Option<&[u8]> {
    if let Kind::Rows(bytes) = kind { Some(bytes) } else { None }
}
