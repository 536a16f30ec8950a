//! One self-contained HTML page for a finished run: facts, plots over steps, trials, picture pairs, a table.
//!
//! Opened offline, printed or sent by mail: style sheet, drawings and pictures are inside, and no script is needed. It takes
//! plain numbers and finished PNGs; it must not know nodes, VDIs, clocks or files.

pub(crate) mod html;
pub(crate) mod numbers;
pub(crate) mod panel;
mod plots;
pub(crate) mod svg;
pub(crate) mod trials;

/// What a finished run has to say.
#[derive(Debug, Clone, Default)]
pub struct Report {
    /// Heading of the page.
    pub title: String,
    /// What ran: the simulation, its field and grid.
    pub source: String,
    /// Where it ran.
    pub machine: String,
    /// The command line that repeats it.
    pub command: String,
    /// One row a published step, in order.
    pub steps: Vec<StepRow>,
    /// What the tuner measured, in any order.
    pub trials: Vec<TrialRow>,
    /// VDI and reference of some steps and views.
    pub pictures: Vec<PicturePair>,
    /// What a step was allowed to cost.
    pub limit: Limit,
}

/// One published step.
#[derive(Debug, Clone, Default)]
pub struct StepRow {
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
    /// Whether size and time stayed within the limit.
    pub limit_kept: bool,
    /// What the step was turned into.
    pub representation: &'static str,
}

/// One measurement of generation parameters by the tuner.
#[derive(Debug, Clone, Default)]
pub struct TrialRow {
    /// The step it was measured on.
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
    /// Whether the tuner took it.
    pub chosen: bool,
    /// What the step was turned into.
    pub representation: &'static str,
}

/// The same view of a step, from the VDI and ray cast.
#[derive(Debug, Clone, Default)]
pub struct PicturePair {
    /// The step shown.
    pub step: u64,
    /// The view's angle.
    pub angle_deg: f64,
    /// PSNR between the two; may be infinite.
    pub psnr_db: f64,
    /// The picture the viewer shows, PNG.
    pub shown_png: Vec<u8>,
    /// The reference image, PNG.
    pub reference_png: Vec<u8>,
}

/// What a step may cost; `None` means no limit.
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

/// The page as one HTML document.
pub fn render(report: &Report) -> String {
    html::document(
        &report.title,
        include_str!("report.css"),
        &[
            html::heading(report),
            html::facts(report),
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

    fn row(step: u64, psnr_db: Option<f64>) -> StepRow {
        let views = psnr_db.map(|q| vec![(10.0, q), (20.0, q - 1.0)]).unwrap_or_default();
        let size_bytes = 200_000 + step;
        StepRow {
            step,
            resolution: 64,
            gamma: 0.01,
            size_bytes,
            psnr_db,
            views,
            limit_kept: true,
            ..StepRow::default()
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
            TrialRow { psnr_db: f64::INFINITY, gamma: 0.0, resolution: 8, size_bytes: 9, ..TrialRow::default() };
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
