//! The stages of a case: how far each is from what is expected.
//!
//! - `raycast`: pictures of the volume; greatest difference of a channel.
//! - `generate`: what comes through up to every start and end of a supersegment; greatest difference.
//! - `depth`: a ray's optical depth, over the greatest that is finite; greatest difference.
//! - `color`: colors of supersegments, where there is one; greatest difference of a channel.
//! - `composite`: a list's color, composited by `model::composite`; greatest difference of a channel. Of fitted lists too,
//!   and so `depth`.
//! - `encode`: supersegments that come back with other depths, or are not stored the same when encoded once more.
//! - `decode`: as `composite`, after encoding and decoding.
//! - `render`: pictures of the VDI against the exact light of that VDI; greatest difference of a channel.
//! - `own view`: the picture from the scene's camera against the volume's; greatest difference of a channel.
//! - `novel`: pictures from elsewhere against the volume's; root of the mean square.

use crate::backends::{Caster, Drawer};
use crate::case::{Case, Reference};
use crate::expected::{Lights, View, of_vdi, of_volume, views};
use crate::table::Table;
use lamina_codec::{Codec, DecodeLimits, EncodeOptions, Layout, decode, encode};
use lamina_model::composite::Accumulator;
use lamina_model::{Segmentation, Supersegment, Vdi};
use lamina_raycast::Field;
use lamina_tests::reference::Light;

/// What a case may have a tolerance for.
pub(crate) const STAGES: [&str; 10] =
    ["raycast", "generate", "depth", "color", "composite", "encode", "decode", "render", "own view", "novel"];

const CODECS: [(&str, Codec, Layout); 5] = [
    ("columns bzip2", Codec::Bzip2, Layout::Columns),
    ("columns zstd", Codec::Zstd, Layout::Columns),
    ("columns context-mixing", Codec::ContextMixing, Layout::Columns),
    ("plain bzip2", Codec::Bzip2, Layout::Plain),
    ("plain zstd", Codec::Zstd, Layout::Plain),
];

/// Runs all stages of `case`.
pub(crate) fn run(case: &Case, casters: &[Caster], drawers: &[Drawer], table: &mut Table) {
    let volume = case.volume.volume().unwrap();
    let field = Field::new(volume.clone(), &case.scene.clone().check().unwrap());
    let views = views(case);
    let seen: Vec<_> = views.iter().map(|view| of_volume(case, &volume, view)).collect();
    let shows = seen[0].iter().any(|rays| rays[0].last() != Some(&Light::CLEAR));
    assert_eq!(case.clear, !shows, "{} is said to show something or not, wrongly", case.name);
    if !case.clear && !case.faint {
        telling(case, &views, &seen, table);
    }
    for caster in casters {
        let report = &mut Report { case, backend: caster.name(), table };
        cast(report, caster, &field, &views, &seen);
        let vdi = match caster.generate(&field, &case.params(), Segmentation::Greedy) {
            Ok(vdi) => vdi,
            Err(reason) => {
                report.pass_over("generate", &reason);
                continue;
            }
        };
        lists(report, &vdi, &views[0], &seen[0]);
        let fitted = caster.generate(&field, &case.params(), Segmentation::Fitted).unwrap();
        let report = &mut Report { case, backend: format!("{} fitted", caster.name()), table };
        rays(report, &fitted, &views[0], &seen[0]);
        for (name, codec, layout) in CODECS {
            let report = &mut Report { case, backend: format!("{} {name}", caster.kind()), table };
            encoded(report, &vdi, &EncodeOptions { codec, layout, ..EncodeOptions::BZIP2 }, &views[0], &seen[0]);
        }
        // The oracle's VDI is drawn by all, the others' by their own kind. From where they were generated these differ from
        // the volume by what they were allowed there.
        let exact: Vec<_> = views.iter().map(|view| of_vdi(case, &vdi, view)).collect();
        let oracle = matches!(caster, Caster::Scalar);
        for drawer in drawers.iter().filter(|d| oracle || d.kind() == caster.kind()) {
            let backend = if oracle { drawer.name() } else { format!("R {}", drawer.name()) };
            let generated = if oracle { None } else { case.tolerance("composite", &caster.kind()) };
            let report = &mut Report { case, backend, table };
            drawn(report, drawer, &vdi, &views, [&exact, &seen], generated.unwrap_or(0.0));
        }
    }
}

/// What the case allows in each stage must be less than half of what a picture of nothing would be off.
fn telling(case: &Case, views: &[View], seen: &[Vec<Vec<Lights>>], table: &mut Table) {
    let background = case.scene.background;
    let blank = |n: usize| {
        let nothing = vec![background; views[n].pixels.len()];
        errors(&nothing, &seen[n], background).collect::<Vec<f64>>()
    };
    let own = blank(0).into_iter().fold(0.0, greater);
    let novel: Vec<f64> = (1..views.len()).flat_map(blank).collect();
    let through = seen[0].iter().map(|rays| 1.0 - rays[0][rays[0].len() - 1].transmittance).fold(0.0, greater);
    for (stage, tolerance) in &case.tolerance {
        let nothing = match stage.as_str() {
            "raycast" | "composite" | "decode" | "render" | "own view" => own,
            "generate" => through,
            "novel" => (novel.iter().map(|e| e * e).sum::<f64>() / novel.len() as f64).sqrt(),
            _ => continue,
        };
        table.add(&case.name, stage, "nothing, half", tolerance.greatest(), 0.5 * nothing);
    }
}

/// Rows of one backend.
struct Report<'a> {
    case: &'a Case,
    backend: String,
    table: &'a mut Table,
}

impl Report<'_> {
    fn add(&mut self, stage: &str, error: f64) {
        self.add_after(0.0, stage, error);
    }

    /// After a stage that was allowed an error of `before`.
    fn add_after(&mut self, before: f64, stage: &str, error: f64) {
        if let Some(tolerance) = self.case.tolerance(stage, &self.backend) {
            self.table.add(&self.case.name, stage, &self.backend, error, before + tolerance);
        }
    }

    fn pass_over(&self, stage: &str, reason: &str) {
        self.table.pass_over(&self.case.name, stage, &self.backend, reason);
    }
}

fn cast(report: &mut Report, caster: &Caster, field: &Field, views: &[View], seen: &[Vec<Vec<Lights>>]) {
    let mut worst = 0.0;
    for (view, seen) in views.iter().zip(seen) {
        match caster.raycast(field, &view.shown()) {
            Ok(colors) => worst = greater(worst, worst_channel(&colors, seen, field.scene().background)),
            Err(reason) => return report.pass_over("raycast", &reason),
        }
    }
    report.add("raycast", worst);
}

/// The stages `generate` and `composite`.
fn lists(report: &mut Report, vdi: &Vdi, view: &View, seen: &[Vec<Lights>]) {
    let (mut through, mut longest) = (0.0, 0);
    for (&(i, j), lights) in view.pixels.iter().zip(seen) {
        let list = vdi.list(i, j);
        let errors = lights.iter().map(|lights| worst_passage(list, lights));
        through = greater(through, errors.fold(f64::NAN, f64::min));
        longest = longest.max(list.len());
    }
    report.add("generate", through);
    if let Some(expected) = report.case.longest_list {
        report.table.add(&report.case.name, "lists", &report.backend, longest.abs_diff(expected) as f64, 0.0);
    }
    if let Reference::Slab { color, .. } = report.case.reference {
        let of = |s: &Supersegment| (0..3).map(|c| (f64::from(s.color[c]) - color[c]).abs()).fold(0.0, f64::max);
        report.add("color", vdi.segments().iter().map(of).fold(0.0, f64::max));
    }
    rays(report, vdi, view, seen);
}

/// The stages `depth` and `composite`: what whole rays come to.
fn rays(report: &mut Report, vdi: &Vdi, view: &View, seen: &[Vec<Lights>]) {
    let depth = |lights: &Lights| -lights[lights.len() - 1].transmittance.ln();
    let finite = seen.iter().map(|rays| depth(&rays[0])).filter(|d| d.is_finite());
    let greatest = finite.fold(0.0, f64::max);
    let off = |(&(i, j), rays): (&(u32, u32), &Vec<Lights>)| {
        let found: f64 = vdi.list(i, j).iter().map(|s| f64::from(s.optical_depth)).sum();
        let expected = rays.iter().map(depth).filter(|d| d.is_finite());
        // A ray that lets nothing through has no depth to compare with.
        let least = |a: f64, b: f64| if a.is_nan() { a } else { a.min(b) };
        expected.map(|d| (found - d).abs() / greatest.max(f64::MIN_POSITIVE)).reduce(least)
    };
    report.add("depth", view.pixels.iter().zip(seen).filter_map(off).fold(0.0, greater));
    report.add("composite", worst_channel(&composited(vdi, view), seen, vdi.header().background));
}

/// The greatest difference of what comes through up to the supersegments' ends.
fn worst_passage(list: &[Supersegment], lights: &Lights) -> f64 {
    let (mut depth, mut worst) = (0.0_f64, 0.0);
    let expected = |step: u32| lights[lights.len().min(step as usize + 1) - 1].transmittance;
    for s in list {
        let before = (-depth).exp();
        depth += f64::from(s.optical_depth);
        worst = greater(worst, (before - expected(s.start)).abs());
        worst = greater(worst, ((-depth).exp() - expected(s.end)).abs());
    }
    greater(worst, ((-depth).exp() - expected(u32::MAX - 1)).abs())
}

fn composited(vdi: &Vdi, view: &View) -> Vec<[f32; 3]> {
    let color = |&(i, j): &(u32, u32)| {
        let mut light = Accumulator::default();
        vdi.list(i, j).iter().for_each(|s| light.add(s.color.map(f64::from), s.optical_depth.into()));
        light.over(vdi.header().background)
    };
    view.pixels.iter().map(color).collect()
}

/// The stages `encode` and `decode`.
fn encoded(report: &mut Report, vdi: &Vdi, options: &EncodeOptions, view: &View, seen: &[Vec<Lights>]) {
    let bytes = match encode(vdi, options) {
        Ok(bytes) => bytes,
        Err(error) => return report.pass_over("encode", &error.to_string()),
    };
    let back = decode(&bytes, &DecodeLimits::default()).unwrap();
    let ends = |v: &Vdi| v.segments().iter().map(|s| (s.start, s.end)).collect::<Vec<_>>();
    let other = ends(vdi).iter().zip(ends(&back)).filter(|(a, b)| **a != *b).count();
    let whole = back.header() == vdi.header() && back.offsets() == vdi.offsets();
    let same = encode(&back, options).unwrap() == bytes;
    report.add("encode", if whole && same { other as f64 } else { f64::INFINITY });
    if options.layout == Layout::Columns {
        report.add("decode", worst_channel(&composited(&back, view), seen, vdi.header().background));
    }
}

/// The stages `render`, `own view` and `novel`, of a VDI whose generation was allowed the error `generated`.
fn drawn(
    report: &mut Report,
    drawer: &Drawer,
    vdi: &Vdi,
    views: &[View],
    [exact, seen]: [&[Vec<Vec<Lights>>]; 2],
    generated: f64,
) {
    let (prepared, background) = (drawer.prepare(vdi), vdi.header().background);
    let (mut worst, mut own, mut squares) = (0.0, f64::NAN, Vec::new());
    for (n, view) in views.iter().enumerate() {
        let colors = match drawer.render(vdi, &prepared, &view.shown()) {
            Ok(colors) => colors,
            Err(reason) => return report.pass_over("render", &reason),
        };
        worst = greater(worst, worst_channel(&colors, &exact[n], background));
        if n == 0 {
            own = worst_channel(&colors, &seen[n], background);
        } else {
            squares.extend(errors(&colors, &seen[n], background).map(|e| e * e));
        }
    }
    report.add("render", worst);
    report.add_after(generated, "own view", own);
    report.add("novel", (squares.iter().sum::<f64>() / squares.len() as f64).sqrt());
}

fn worst_channel(colors: &[[f32; 3]], lights: &[Vec<Lights>], background: [f32; 3]) -> f64 {
    assert_eq!(colors.len(), lights.len());
    errors(colors, lights, background).fold(0.0, greater)
}

/// Per pixel, the greatest difference of a channel from the likeliest of its rays; NaN if it is no color.
fn errors(colors: &[[f32; 3]], lights: &[Vec<Lights>], background: [f32; 3]) -> impl Iterator<Item = f64> {
    colors.iter().zip(lights).map(move |(color, rays)| {
        if !color.iter().all(|c| (0.0..=1.0).contains(c)) {
            return f64::NAN;
        }
        let difference = |light: &Light| {
            let expected = light.over(background);
            (0..3).map(|c| (f64::from(color[c]) - expected[c]).abs()).fold(0.0, f64::max)
        };
        rays.iter().map(|lights| difference(&lights[lights.len() - 1])).fold(f64::NAN, f64::min)
    })
}

/// The greater; NaN if either is, so that it is not lost.
fn greater(a: f64, b: f64) -> f64 {
    if a.is_nan() || b.is_nan() { f64::NAN } else { a.max(b) }
}
