//! Supersegments where they serve best: of all ways to join a ray's finer ones, the way with the least error for its
//! number.
//!
//! What a supersegment stands for is one medium: premultiplied colour and opacity of a unit length, the same all along. Its
//! error is the square of the difference from that, summed over its length; a ray's cost is the errors of all its
//! supersegments and a price for each. The least cost is found exactly, from the front to the back, and beginnings that can
//! no longer be part of it are dropped on the way (R. Killick, P. Fearnhead and I. A. Eckley, "Optimal Detection of
//! Changepoints With a Linear Computational Cost", JASA 107, 2012). Joined ones keep the ray's light, as they do when
//! samples are joined one by one.

use crate::rows::{Band, Join, in_order};
use lamina_model::composite::opacity_from_optical_depth;
use lamina_model::{Invalid, Supersegment, Vdi, VdiHeader};

/// A supersegment costs as much as being off by so many gammas over one unit length.
const PRICE: f64 = 1.75;

/// Premultiplied red, green, blue, and opacity.
type Light = [f64; 4];

/// `fine` with its supersegments joined as `gamma` prices them; `unit_steps` is the transfer function's unit length.
///
/// # Errors
/// If gamma is negative or not finite.
pub fn fit(fine: &Vdi, gamma: f64, unit_steps: f64) -> Result<Vdi, Invalid> {
    let params = fine.header().params.with_gamma(gamma)?;
    let price = (PRICE * gamma).powi(2) * unit_steps;
    let r = fine.resolution();
    let row = |j: usize| {
        let (mut band, mut ray) = (Band::default(), Ray::default());
        for i in 0..r {
            let before = band.segments.len();
            let list = fine.list(i, j as u32);
            list.chunk_by(|a, b| a.end == b.start).for_each(|run| ray.join(run, unit_steps, price, &mut band.segments));
            band.counts.push((band.segments.len() - before) as u32);
        }
        band
    };
    let mut join = Join::new((r as usize).pow(2));
    in_order(r as usize, row, |band| join.add(band));
    join.finish(VdiHeader { params, ..*fine.header() })
}

/// Sums from the front of a run.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    length: f64,
    light: Light,
    squares: f64,
}

impl Sums {
    fn with(self, s: &Supersegment, unit_steps: f64) -> Self {
        let length = f64::from(s.end - s.start);
        let opacity = opacity_from_optical_depth(f64::from(s.optical_depth) * (unit_steps / length));
        let [r, g, b] = s.color.map(|c| f64::from(c) * opacity);
        let light = [r, g, b, opacity];
        Self {
            length: self.length + length,
            light: std::array::from_fn(|i| self.light[i] + length * light[i]),
            squares: self.squares + length * light.iter().map(|x| x * x).sum::<f64>(),
        }
    }

    /// Error of one supersegment from `before` to here.
    fn error_since(&self, before: &Self) -> f64 {
        let sum = (0..4).map(|i| (self.light[i] - before.light[i]).powi(2)).sum::<f64>();
        self.squares - before.squares - sum / (self.length - before.length)
    }
}

/// What the search along a ray keeps.
#[derive(Debug, Default)]
struct Ray {
    sums: Vec<Sums>,
    /// Least cost up to each place, and where the last supersegment begins then.
    least: Vec<(f64, usize)>,
    /// Places where a supersegment may still begin.
    begins: Vec<usize>,
    ends: Vec<usize>,
}

impl Ray {
    /// Joins a run without gaps.
    fn join(&mut self, run: &[Supersegment], unit_steps: f64, price: f64, out: &mut Vec<Supersegment>) {
        let Self { sums, least, begins, ends } = self;
        sums.clear();
        sums.push(Sums::default());
        least.clear();
        least.push((0.0, 0));
        begins.clear();
        for (n, s) in run.iter().enumerate() {
            begins.push(n);
            let here = sums[n].with(s, unit_steps);
            let cost = |&begin: &usize| least[begin].0 + here.error_since(&sums[begin]);
            let (lowest, begin) =
                begins.iter().map(|b| (cost(b), *b)).min_by(|a, b| a.0.total_cmp(&b.0)).expect("n is one");
            begins.retain(|b| cost(b) <= lowest + price);
            sums.push(here);
            least.push((lowest + price, begin));
        }
        ends.clear();
        let mut end = run.len();
        while end > 0 {
            ends.push(end);
            end = least[end].1;
        }
        for end in ends.drain(..).rev() {
            out.push(joined(&run[least[end].1..end]));
        }
    }
}

/// One supersegment for several: their light, and the mean of their colours by what each shows.
fn joined(run: &[Supersegment]) -> Supersegment {
    let [only] = run else {
        let (mut depth, mut color, mut opacity) = (0.0, [0.0; 3], 0.0);
        for s in run {
            let shown = (1.0 - opacity) * s.opacity();
            opacity += shown;
            depth += f64::from(s.optical_depth);
            color = std::array::from_fn(|i| color[i] + shown * f64::from(s.color[i]));
        }
        let color = if opacity > 0.0 { color.map(|c| ((c / opacity) as f32).clamp(0.0, 1.0)) } else { run[0].color };
        return Supersegment { start: run[0].start, end: run[run.len() - 1].end, color, optical_depth: depth as f32 };
    };
    *only
}
