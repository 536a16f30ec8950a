//! R in lanes: the fast twin of `scalar::generate`.

use super::exp::opacity;
use super::march::{Packet, View, Visit};
use super::tile::Tile;
use super::{Floats, Ints, Job, Lanes, Level, Masks, Pair, WIDTH};
use crate::kernel::Field;
use crate::kernel::field::{Stored, for_stored};
use crate::kernel::rows::{Band, Join, header, in_order};
use crate::kernel::table::TransferTable;
use lamina_model::composite::optical_depth_from_opacity;
use lamina_model::{GenerationParams, Invalid, Supersegment, Vdi, VdiHeader};

/// The VDI of `field`, which [fits](super::march::fits).
///
/// # Errors
/// As [`crate::kernel::Backend::generate`].
pub fn generate(level: Level, field: &Field, params: &GenerationParams) -> Result<Vdi, Invalid> {
    let header = header(field, params)?;
    let table = TransferTable::new(&field.scene().transfer, field.unit_length(), header.step_length);
    let mut join = Join::new();
    for_stored!(field.stored(), v => {
        let view = View::new(field, v, &table, header.step_length);
        let rows = |band: usize| level.run(Rows { view: &view, header: &header, first_row: Tile::ROWS * band as u32 });
        in_order(header.params.resolution().div_ceil(Tile::ROWS) as usize, rows, |band| join.add(band));
    });
    join.finish(header)
}

/// Two rows of rays.
struct Rows<'a, V> {
    view: &'a View<'a, V>,
    header: &'a VdiHeader,
    first_row: u32,
}

impl<V: Pair> Job for Rows<'_, V> {
    type Output = Band;
    #[inline(always)]
    fn run<L: Lanes>(self) -> Band {
        let r = self.header.params.resolution();
        let mut rows = [Band::default(), Band::default()];
        let mut cluster = Cluster::<L>::new(self.view.table, self.header);
        for tile in Tile::across(r, self.first_row, Tile::ROWS.min(r - self.first_row)) {
            let packet = Packet::<L>::new(self.view, &self.header.camera, [r; 2], tile.pixels());
            self.view.march(&packet, &mut cluster);
            cluster.finish();
            for (&(_, j), list) in tile.pixels().iter().zip(&mut cluster.lists) {
                let row = &mut rows[(j - self.first_row) as usize];
                row.counts.push(list.len() as u32);
                row.segments.append(list);
            }
        }
        let [mut band, second] = rows;
        band.counts.extend(second.counts);
        band.segments.extend(second.segments);
        band
    }
}

/// Eight open supersegments, and the lists of closed ones.
struct Cluster<'a, L: Lanes> {
    table: &'a TransferTable,
    gamma: f32,
    /// Steps in a unit length.
    unit_steps: f32,
    /// Optical depth at which a ray ends.
    cutoff: f32,
    start: L::I,
    /// First step beyond the open supersegment; -1 if none is open.
    end: L::I,
    /// Length in steps.
    length: L::F,
    /// Accumulated opacity and premultiplied colour: sums of what each sample adds, so that faint ones keep their digits.
    opacity: L::F,
    color: [L::F; 3],
    optical_depth: L::F,
    /// Optical depth of the whole ray so far.
    ray_depth: L::F,
    lists: [Vec<Supersegment>; WIDTH],
}

impl<'a, L: Lanes> Cluster<'a, L> {
    #[inline(always)]
    fn new(table: &'a TransferTable, header: &VdiHeader) -> Self {
        let zero = L::F::splat(0.0);
        Self {
            table,
            gamma: header.params.gamma() as f32,
            unit_steps: table.unit_steps,
            cutoff: optical_depth_from_opacity(header.params.opacity_cutoff()) as f32,
            start: L::I::splat(0),
            end: L::I::splat(-1),
            length: L::F::splat(1.0),
            opacity: zero,
            color: [zero; 3],
            optical_depth: zero,
            ray_depth: zero,
            lists: Default::default(),
        }
    }

    /// Closes the open supersegments of `lanes`.
    #[inline(always)]
    fn close(&mut self, lanes: L::M) {
        let (start, end) = (self.start.to_array(), self.end.to_array());
        let (opacity, color) = (self.opacity.to_array(), self.color.map(L::F::to_array));
        let optical_depth = self.optical_depth.to_array();
        let mut bits = lanes.bits();
        while bits != 0 {
            let l = bits.trailing_zeros() as usize;
            bits &= bits - 1;
            self.lists[l].push(Supersegment {
                start: start[l] as u32,
                end: end[l] as u32,
                color: color.map(|c| (c[l] / opacity[l]).clamp(0.0, 1.0)),
                optical_depth: optical_depth[l],
            });
        }
    }

    /// Closes what is open and makes ready for the next rays.
    #[inline(always)]
    fn finish(&mut self) {
        self.close(self.end.gt(L::I::splat(0)));
        self.end = L::I::splat(-1);
        self.ray_depth = L::F::splat(0.0);
    }
}

impl<L: Lanes> Visit<L> for Cluster<'_, L> {
    #[inline(always)]
    fn visit(&mut self, packet: &Packet<L>, step: L::I, value: L::F, live: L::M) -> L::M {
        let (zero, one) = (L::F::splat(0.0), L::F::splat(1.0));
        let mut shown = live & self.table.shown::<L>(value);
        if !shown.any() {
            return live;
        }
        let (row, weight) = self.table.row::<L>(value);
        let [r, g, b, unit, mut depth, mut ratio] = L::rows6(&self.table.unit, row, weight);
        shown = shown & zero.lt(unit);
        let mut length = one;
        let last = shown & step.eq(packet.last);
        if last.any() {
            length = L::F::select(last, L::F::from_array(packet.last_length), one);
            depth = depth * length;
            ratio = L::F::select(last, opacity::<L>(depth).div(unit), ratio);
        }
        // The open supersegment at unit length, against the sample.
        let open = opacity::<L>(self.optical_depth * L::F::splat(self.unit_steps).div(self.length));
        let straight = open.div(self.opacity);
        let difference = (open - unit).abs();
        let difference = difference.max((self.color[0] * straight - r).abs());
        let difference = difference.max((self.color[1] * straight - g).abs());
        let difference = difference.max((self.color[2] * straight - b).abs());
        let adjoins = shown & self.end.eq(step);
        let joins = adjoins & difference.lt(L::F::splat(self.gamma));
        let closes = shown & self.end.gt(L::I::splat(0)) & !joins;
        if closes.any() {
            self.close(closes);
        }
        let before = L::F::select(joins, self.opacity, zero);
        let shows = (one - before) * ratio;
        self.color[0] = grown::<L>(shown, joins, self.color[0], shows * r);
        self.color[1] = grown::<L>(shown, joins, self.color[1], shows * g);
        self.color[2] = grown::<L>(shown, joins, self.color[2], shows * b);
        self.opacity = grown::<L>(shown, joins, self.opacity, shows * unit);
        self.length = grown::<L>(shown, joins, self.length, length);
        self.optical_depth = grown::<L>(shown, joins, self.optical_depth, depth);
        self.start = L::I::select(shown & !joins, step, self.start);
        self.end = L::I::select(shown, step + L::I::splat(1), self.end);
        self.ray_depth = grown::<L>(shown, shown, self.ray_depth, depth);
        live & self.ray_depth.lt(L::F::splat(self.cutoff))
    }
}

/// `sum` with `more` added where a sample joins, begun anew with it where one is shown and does not join.
#[inline(always)]
fn grown<L: Lanes>(shown: L::M, joins: L::M, sum: L::F, more: L::F) -> L::F {
    L::F::select(shown, L::F::select(joins, sum, L::F::splat(0.0)) + more, sum)
}
