//! What the terminal is told of a run: a line a step, and when it was tuned first.

use crate::nodes::Nodes;
use crate::run_folder::RunFolder;
use indicatif::{ProgressBar, ProgressStyle};
use lamina_model::TuningState;
use lamina_tuner::units::show_bytes;
use lamina_viz_node::store::{QualityStatus, StepRow};
use std::time::Instant;

/// A bar towards `steps`, or a spinner.
pub(crate) fn progress(steps: Option<u64>, visible: bool) -> ProgressBar {
    let bar =
        if visible { steps.map_or_else(ProgressBar::new_spinner, ProgressBar::new) } else { ProgressBar::hidden() };
    let style = ProgressStyle::with_template("{bar:30} {pos}/{len} steps  {elapsed}  {eta} to go");
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    bar
}

fn line(row: &StepRow) -> String {
    let kept = if row.limit_kept { "" } else { "  contract broken" };
    format!(
        "step {:4}  time {:.4}  {}  {:.0} ms  {}{kept}",
        row.step,
        row.time,
        parameters(row),
        row.generation_ms,
        quality(row)
    )
}

/// Parameters and bytes.
fn parameters(row: &StepRow) -> String {
    let StepRow { representation, resolution, gamma, size_bytes, .. } = row;
    format!("{:6}  r {resolution}  gamma {gamma}  {}", representation.name(), show_bytes(*size_bytes))
}

/// Decibels, with their interval where they come from few pixels.
fn quality(row: &StepRow) -> String {
    let interval = row.half_width_db.filter(|w| *w >= 0.05).map_or_else(String::new, |w| format!(" +-{w:.1}"));
    let ssim = row.ssim.map_or_else(String::new, |ssim| format!("  ssim {ssim:.4}"));
    row.psnr_db.map_or_else(|| "not measured".to_owned(), |q| format!("{:.2}{interval} dB{ssim}", f64::from(q)))
}

/// What the terminal was told.
pub(crate) struct Shown {
    step: Option<u64>,
    begun: Instant,
    /// The line about the first pick was printed, or is not wanted.
    tuned: bool,
}

impl Shown {
    /// Of a run that begins after step `step`; `tuned`: no line says when it is tuned first.
    pub(crate) fn new(step: Option<u64>, tuned: bool) -> Self {
        Self { step, begun: Instant::now(), tuned }
    }

    /// Prints and writes the steps recorded since, up to one that waits to be measured.
    pub(crate) fn show_new(
        &mut self,
        nodes: &Nodes,
        bar: &ProgressBar,
        outputs: Option<&mut RunFolder>,
    ) -> anyhow::Result<()> {
        let new = nodes.store.rows_after(self.step);
        if let Some(first) = new.iter().find(|r| r.tuning != TuningState::None).filter(|_| !self.tuned) {
            self.tuned = true;
            let secs = self.begun.elapsed().as_secs_f64();
            let psnr_db = nodes.tuner_status(false)?.and_then(|status| status.chosen_psnr_db);
            let quality = psnr_db.map_or_else(String::new, |db| format!(", {db:.2} dB"));
            bar.suspend(|| say!("tuned after {secs:.1} s: {}{quality}", parameters(first)));
        }
        let rows: Vec<StepRow> = new.into_iter().take_while(|r| r.measured != QualityStatus::Pending).collect();
        for row in &rows {
            bar.suspend(|| say!("{}", line(row)));
        }
        if let Some(outputs) = outputs {
            outputs.add(&rows)?;
            // The end will tell again what is missing now.
            if let Err(error) = outputs.update(nodes) {
                tracing::warn!("trials.csv and report.html are not up to date: {error:#}");
            }
        }
        self.step = rows.last().map(|r| r.step).or(self.step);
        Ok(())
    }
}
