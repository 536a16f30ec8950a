//! Sort-last compositing: the lists of the parts of a grid, merged to those of the whole.
//!
//! Each part is clustered by itself ([`Compositor::part_params`]); its supersegments lie on the steps of the whole grid's rays, so
//! lists of different parts interleave by depth. Where the face of a part alone has cut a supersegment, the two sides pass the
//! test that their samples would have passed, and are joined. The whole ray is segmented afterwards, as without parts.

use super::assemble::{RowBand, VdiBuilder, header};
use super::segmentation::{Segmenter, joined};
use lamina_model::composite::opacity_from_optical_depth;
use lamina_model::{Grid, Invalid, Scene, Segmentation, Supersegment, Vdi, VdiHeader, VdiParams};

/// Makes one VDI of the lists of parts.
#[derive(Debug)]
pub struct Compositor {
    header: VdiHeader,
    segmentation: Segmentation,
    /// World length that opacities refer to.
    unit_length: f64,
    part_params: VdiParams,
}

/// A supersegment and the part it comes from.
type Piece = (Supersegment, usize);

impl Compositor {
    /// For the VDI of a field on `grid` under `scene` with `params` and `segmentation`.
    ///
    /// # Errors
    /// If the step is so short that rays would have too many of them.
    pub fn new(grid: &Grid, scene: &Scene, params: &VdiParams, segmentation: Segmentation) -> Result<Self, Invalid> {
        let (header, unit_length) = (header(grid, scene, params)?, scene.transfer.unit_length(grid));
        let gamma = Segmenter::new(&header, segmentation, unit_length).initial_gamma(params.gamma());
        Ok(Self { part_params: params.with_gamma(gamma)?, header, segmentation, unit_length })
    }

    /// What parts are to be generated with, clustered greedily.
    pub fn part_params(&self) -> &VdiParams {
        &self.part_params
    }

    /// The header of the VDI.
    pub fn header(&self) -> &VdiHeader {
        &self.header
    }

    /// Rays per side.
    pub fn resolution(&self) -> u32 {
        self.header.params.resolution()
    }

    /// The lists of rows `rows`, of those that `parts` have for them.
    ///
    /// # Errors
    /// If a part has lists for another number of rays, or two parts have the same steps of one.
    pub fn rows(&self, rows: &[u32], parts: &[RowBand]) -> Result<RowBand, Invalid> {
        let rays = rows.len() * self.resolution() as usize;
        let rays_of = |part: &RowBand| part.counts.len();
        if let Some(other) = parts.iter().map(rays_of).find(|&have| have != rays) {
            return Err(Invalid::new("parts", format!("lists for {other} rays where there are {rays}")));
        }
        let (mut fine, mut ray): (RowBand, Vec<Piece>) = (RowBand::default(), Vec::new());
        let mut next = vec![0; parts.len()];
        for n in 0..rays {
            ray.clear();
            for (number, (part, next)) in parts.iter().zip(&mut next).enumerate() {
                let end = *next + part.counts[n] as usize;
                let list = part.segments.get(*next..end);
                let short = || Invalid::new("parts", "a list ends early");
                ray.extend(list.ok_or_else(short)?.iter().map(|s| (*s, number)));
                *next = end;
            }
            ray.sort_by_key(|(s, _)| s.start);
            if let Some(pair) = ray.windows(2).find(|pair| pair[0].0.end > pair[1].0.start) {
                let [a, b] = [pair[0].1, pair[1].1];
                return Err(Invalid::new("parts", format!("parts {a} and {b} have the same step of a ray")));
            }
            let before = fine.segments.len();
            let r = self.resolution() as usize;
            let (i, j) = ((n % r) as u32, rows[n / r]);
            self.join(i, j, &ray, &mut fine.segments);
            fine.counts.push((fine.segments.len() - before) as u32);
        }
        Ok(Segmenter::new(&self.header, self.segmentation, self.unit_length).some_rows(rows.iter().copied(), fine))
    }

    /// Joins what only a face has cut on ray (`i`, `j`).
    fn join(&self, i: u32, j: u32, ray: &[Piece], out: &mut Vec<Supersegment>) {
        let Some((t_in, t_out)) = self.header.ray_span(i, j) else { return };
        let length = (t_out - t_in) / self.header.step_length;
        let mut last: Option<Piece> = None;
        for &(piece, part) in ray {
            let cut = last.filter(|(open, of)| *of != part && open.end == piece.start);
            last = match cut.filter(|(open, _)| self.are_alike(open, &piece, length)) {
                Some((open, _)) => Some((joined(&[open, piece]), part)),
                None => {
                    out.extend(last.map(|(open, _)| open));
                    Some((piece, part))
                }
            };
        }
        out.extend(last.map(|(open, _)| open));
    }

    /// True if no channel of premultiplied RGBA at the unit length differs by gamma, on a ray of `length` steps.
    fn are_alike(&self, a: &Supersegment, b: &Supersegment, length: f64) -> bool {
        let unit = |s: &Supersegment| {
            let steps = (f64::from(s.end).min(length) - f64::from(s.start)).max(f64::MIN_POSITIVE);
            let opacity = opacity_from_optical_depth(
                f64::from(s.optical_depth) * self.unit_length / (steps * self.header.step_length),
            );
            let [r, g, b] = s.color.map(|c| f64::from(c) * opacity);
            [r, g, b, opacity]
        };
        let (one, other) = (unit(a), unit(b));
        let difference = one.iter().zip(other).map(|(x, y)| (x - y).abs()).fold(0.0, f64::max);
        a.optical_depth.is_finite() == b.optical_depth.is_finite() && difference < self.part_params.gamma()
    }

    /// The VDI whose rows are `bands`, from the first one on.
    ///
    /// # Errors
    /// If they are not all its rows, or it has 2^32 supersegments or more.
    pub fn finish(&self, bands: impl IntoIterator<Item = RowBand>) -> Result<Vdi, Invalid> {
        let mut builder = VdiBuilder::new((self.resolution() as usize).pow(2));
        bands.into_iter().for_each(|band| builder.add(band));
        builder.finish(self.header)
    }
}

impl RowBand {
    /// The supersegments of each ray.
    pub fn lists(&self) -> impl Iterator<Item = &[Supersegment]> {
        let mut rest = &self.segments[..];
        self.counts.iter().map(move |&n| {
            let (list, others) = rest.split_at(rest.len().min(n as usize));
            rest = others;
            list
        })
    }

    /// Rows `rows` of a VDI.
    pub fn of_rows(vdi: &Vdi, rows: &[u32]) -> Self {
        let (r, mut band) = (vdi.resolution() as usize, Self::default());
        for &row in rows {
            let offsets = &vdi.offsets()[row as usize * r..=(row as usize + 1) * r];
            band.counts.extend(offsets.windows(2).map(|w| w[1] - w[0]));
            band.segments.extend_from_slice(&vdi.segments()[offsets[0] as usize..offsets[r] as usize]);
        }
        band
    }

    /// Its rows of `resolution` rays, each a band of its own.
    pub fn into_rows(self, resolution: u32) -> impl Iterator<Item = Self> {
        let mut from = 0;
        let Self { counts, segments } = self;
        let rows: Vec<Self> = counts
            .chunks(resolution as usize)
            .map(|counts| {
                let end = segments.len().min(from + counts.iter().map(|&n| n as usize).sum::<usize>());
                let row = Self { counts: counts.to_vec(), segments: segments[from..end].to_vec() };
                from = end;
                row
            })
            .collect();
        rows.into_iter()
    }
}
