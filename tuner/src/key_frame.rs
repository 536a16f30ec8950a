//! Sizes of live steps as trials have them, which are coded alone: those of key frames.

use lamina_model::StepReport;

/// The key frame reported last.
#[derive(Debug, Default)]
pub(crate) struct KeyFrame(Option<StepReport>);

impl KeyFrame {
    /// A step as it can be compared with trials: one that was coded after another with what its key frame was made with and took.
    pub(crate) fn compared(&mut self, report: StepReport) -> StepReport {
        match &self.0 {
            Some(key) if report.is_after_another && key.run_id == report.run_id => {
                StepReport { params: key.params, cost: key.cost, fell_back: key.fell_back, ..report }
            }
            _ => {
                self.0 = Some(report.clone()).filter(|report| !report.is_after_another);
                report
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lamina_model::{Cost, GenerationParams};

    #[test]
    fn steps_coded_after_others_count_as_their_key_frame_of_the_same_run() {
        let report = |run: &str, step, size_bytes, is_after_another| StepReport {
            run_id: run.to_owned(),
            step,
            time: 0.0,
            params: GenerationParams::default(),
            cost: Cost { size_bytes, ..Cost::default() },
            fell_back: false,
            has_reference: true,
            is_after_another,
        };
        let mut key = KeyFrame::default();
        let mut size = |report: StepReport| key.compared(report).cost.size_bytes;
        assert_eq!(size(report("a", 0, 40, true)), 40, "no key frame was seen");
        assert_eq!(size(report("a", 1, 100, false)), 100);
        assert_eq!(size(report("a", 2, 60, true)), 100);
        assert_eq!(size(report("b", 3, 70, true)), 70);
        assert_eq!(size(report("b", 4, 120, false)), 120);
        assert_eq!(size(report("b", 5, 50, true)), 120);
    }
}
