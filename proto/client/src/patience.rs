//! How long a push waits for a node that has answered before: a few times as long as it usually takes.

use std::collections::VecDeque;
use std::time::Duration;

/// Pushes looked back at.
const PUSHES: usize = 8;
/// How many times as long as the middle one of them.
const TIMES: u32 = 8;
/// No push is given up earlier: the machine may be busy, or the network.
const LEAST: Duration = Duration::from_millis(250);

/// What the last pushes took.
#[derive(Debug, Default)]
pub(crate) struct Patience(VecDeque<Duration>);

impl Patience {
    /// A push was answered after so long.
    pub(crate) fn answered(&mut self, took: Duration) {
        self.0.truncate(PUSHES - 1);
        self.0.push_front(took);
    }

    /// How long the next one may take; `None` where nothing is known yet.
    pub(crate) fn limit(&self) -> Option<Duration> {
        let mut took: Vec<Duration> = self.0.iter().copied().collect();
        took.sort();
        took.get(took.len() / 2).map(|&middle| (TIMES * middle).max(LEAST))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_some_times_the_middle_of_the_last_pushes() {
        let mut patience = Patience::default();
        assert_eq!(patience.limit(), None);
        patience.answered(Duration::from_millis(1));
        assert_eq!(patience.limit(), Some(LEAST));
        (0..PUSHES).for_each(|n| patience.answered(Duration::from_millis(100 + n as u64)));
        assert_eq!(patience.limit(), Some(Duration::from_millis(8 * 104)));
        patience.answered(Duration::from_secs(3));
        assert!(patience.limit() < Some(Duration::from_secs(1)), "one that was held up counts no more than others");
    }
}
