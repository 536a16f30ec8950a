//! Self-contained HTML pages of measurements, and the SVG plots on them.
//!
//! [`render`] writes the page of a watched run: headline figures, plots over time steps, the tuner's trials, pairs of
//! pictures and a table of all steps. The modules [`html`], [`svg`], [`panel`] and [`numbers`] are its parts; other programs
//! put pages of their own together from them.
//!
//! A page can be opened offline, printed or mailed: style sheet, drawings and pictures are embedded. It holds no script but that of a
//! step that can be turned.
//! The input is plain numbers and finished PNG files: this crate knows no node, VDI, clock or file system.

pub mod html;
pub mod numbers;
pub mod panel;
mod plots;
pub mod svg;
mod trials;

pub use trials::color_at;

/// The style sheet of every page.
pub const STYLE: &str = include_str!("report.css");

/// Everything that the page of a watched run shows.
#[derive(Debug, Clone, Default)]
pub struct Report {
    /// Heading of the page.
    pub title: String,
    /// The data source: simulation, field and grid.
    pub source: String,
    /// The machine that it ran on.
    pub machine: String,
    /// The command line that repeats it.
    pub command: String,
    /// One row for each published time step, in order.
    pub steps: Vec<ReportStep>,
    /// The tuner's measurements, in any order.
    pub trials: Vec<ReportTrial>,
    /// Pictures of some steps and views, each with its ray-cast reference.
    pub pictures: Vec<PicturePair>,
    /// The limits on the cost of a step.
    pub limit: Limit,
    /// A step that can be turned.
    pub turntable: Option<Turntable>,
}

/// A step that can be turned on the page.
#[derive(Debug, Clone)]
pub struct Turntable {
    /// The simulation's step number.
    pub step: u64,
    /// The encoded step.
    pub encoded: Vec<u8>,
    /// What decodes and draws it: WebAssembly, compressed by gzip.
    pub engine: &'static [u8],
    /// The script that calls it.
    pub script: &'static str,
}

/// One published time step.
#[derive(Debug, Clone, Default)]
pub struct ReportStep {
    /// The simulation's step number.
    pub step: u64,
    /// The simulation's time.
    pub time: f64,
    /// Rays along one side.
    pub resolution: u32,
    /// The interrupt parameter.
    pub gamma: f64,
    /// Size after compression.
    pub size_bytes: u64,
    /// Time to generate, without compression.
    pub generation_ms: f64,
    /// Time to compress.
    pub encode_ms: f64,
    /// Supersegments stored.
    pub supersegments: u64,
    /// PSNR pooled over all views; infinite if every picture is identical, `None` if not measured.
    pub psnr_db: Option<f64>,
    /// Angle in degrees and PSNR in dB of each test view.
    pub views: Vec<(f64, f64)>,
    /// Whether size and generation time stayed within the limits.
    pub limit_kept: bool,
    /// Name of the representation that the step was turned into: `vdi` or `volume`.
    pub representation: &'static str,
}

/// One measurement of generation parameters by the tuner.
#[derive(Debug, Clone, Default)]
pub struct ReportTrial {
    /// The time step that it was measured on.
    pub step: u64,
    /// Rays along one side.
    pub resolution: u32,
    /// The interrupt parameter.
    pub gamma: f64,
    /// Size after compression.
    pub size_bytes: u64,
    /// Time to generate, without compression.
    pub generation_ms: f64,
    /// Time to compress.
    pub encode_ms: f64,
    /// PSNR pooled over the views; may be infinite.
    pub psnr_db: f64,
    /// Whether the tuner chose these parameters.
    pub chosen: bool,
    /// Name of the representation that the step was turned into: `vdi` or `volume`.
    pub representation: &'static str,
}

/// One view of a step twice: rendered from the VDI or reduced volume, and ray cast from the original volume.
#[derive(Debug, Clone, Default)]
pub struct PicturePair {
    /// The step shown.
    pub step: u64,
    /// Rotation of the view away from the generation camera, degrees.
    pub angle_deg: f64,
    /// PSNR between the two pictures; may be infinite.
    pub psnr_db: f64,
    /// The rendered picture, PNG.
    pub shown_png: Vec<u8>,
    /// The ray-cast picture, PNG.
    pub reference_png: Vec<u8>,
}

/// Limits on the cost of a time step; `None` means no limit.
#[derive(Debug, Clone, Copy, Default)]
pub struct Limit {
    /// Largest size after compression.
    pub size_bytes: Option<u64>,
    /// Longest generation time.
    pub time_ms: Option<f64>,
}

impl Limit {
    fn holds(&self, size_bytes: u64, generation_ms: f64) -> bool {
        self.size_bytes.is_none_or(|most| size_bytes <= most) && self.time_ms.is_none_or(|most| generation_ms <= most)
    }
}

/// The page of a watched run as one HTML document.
pub fn render(report: &Report) -> String {
    html::document(
        &report.title,
        STYLE,
        &[
            html::heading(report),
            html::facts(report),
            report.turntable.as_ref().map_or_else(String::new, html::turntable),
            plots::section(&report.steps, &report.limit),
            trials::section(&report.trials, &report.limit),
            html::pictures(&report.pictures),
            html::step_table(&report.steps),
        ],
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(step: u64, psnr_db: Option<f64>) -> ReportStep {
        let views = psnr_db.map(|q| vec![(10.0, q), (20.0, q - 1.0)]).unwrap_or_default();
        let size_bytes = 200_000 + step;
        ReportStep {
            step,
            resolution: 64,
            gamma: 0.01,
            size_bytes,
            psnr_db,
            views,
            limit_kept: true,
            ..ReportStep::default()
        }
    }

    fn assert_whole(page: &str) {
        assert!(page.starts_with("<!doctype html>") && page.trim_end().ends_with("</html>"));
        assert!(!page.contains("NaN") && !page.contains("inf"), "a number leaked unformatted");
        for outside in ["http://", "https://", "<script", "<link"] {
            assert!(!page.replace("http://www.w3.org/2000/svg", "").contains(outside), "{outside}");
        }
        for tag in ["section", "figure", "svg", "table", "details", "dl", "text"] {
            let opened = page.matches(&format!("<{tag}>")).count() + page.matches(&format!("<{tag} ")).count();
            assert_eq!(opened, page.matches(&format!("</{tag}>")).count(), "unbalanced {tag}");
        }
    }

    #[test]
    fn an_empty_run_is_a_page_that_says_so() {
        let page = render(&Report { title: "Nothing".into(), ..Report::default() });
        assert_whole(&page);
        assert!(page.contains("No step was recorded."));
        assert!(!page.contains("<svg") && !page.contains("<table"));
    }

    #[test]
    fn one_step_is_drawn_in_the_middle_and_counted() {
        let page = render(&Report { steps: vec![row(7, Some(38.25))], ..Report::default() });
        assert_whole(&page);
        assert!(page.contains("38.25 dB") && page.contains("200 kB") && page.contains("<circle"));
    }

    #[test]
    fn infinite_psnr_is_written_and_drawn_as_such() {
        let steps = vec![row(0, Some(f64::INFINITY)), row(1, Some(30.0)), row(2, None)];
        let trial =
            ReportTrial { psnr_db: f64::INFINITY, gamma: 0.0, resolution: 8, size_bytes: 9, ..ReportTrial::default() };
        let pair = PicturePair { psnr_db: f64::INFINITY, ..PicturePair::default() };
        let page = render(&Report { steps, trials: vec![trial], pictures: vec![pair], ..Report::default() });
        assert_whole(&page);
        assert!(page.contains("∞ dB") && page.contains("not measured"));
    }

    #[test]
    fn every_text_is_escaped() {
        let evil = "<b onload=\"x\">&'".to_string();
        let report = Report {
            title: evil.clone(),
            source: evil.clone(),
            machine: evil.clone(),
            command: evil,
            ..Report::default()
        };
        let page = render(&report);
        assert!(!page.contains("<b onload"));
        // The title stands twice: in the head and as the heading.
        assert_eq!(page.matches("&lt;b onload=&quot;x&quot;&gt;&amp;&#39;").count(), 5);
    }

    #[test]
    fn a_step_that_can_be_turned_is_inside_the_page() {
        let turntable = Turntable { step: 7, encoded: vec![1, 2, 3], engine: &[4, 5], script: "void 0;" };
        let page = render(&Report { turntable: Some(turntable), ..Report::default() });
        for part in
            [">AQID</script>", ">BAU=</script>", "<script>void 0;</script>", "<canvas id=\"turntable\"", "Step 7"]
        {
            assert!(page.contains(part), "{part}");
        }
        assert!(!page.contains("src="), "nothing is fetched");
    }

    #[test]
    fn pictures_are_inside_the_page() {
        let pair = PicturePair { shown_png: b"vdi".to_vec(), reference_png: b"ref".to_vec(), ..PicturePair::default() };
        let page = render(&Report { pictures: vec![pair], ..Report::default() });
        assert!(page.contains("data:image/png;base64,dmRp") && page.contains("data:image/png;base64,cmVm"));
    }

    #[test]
    fn a_limit_holds_up_to_itself() {
        let limit = Limit { size_bytes: Some(10), time_ms: Some(2.0) };
        assert!(limit.holds(10, 2.0) && !limit.holds(11, 1.0) && !limit.holds(1, 2.5));
        assert!(Limit::default().holds(u64::MAX, f64::INFINITY));
    }
}
