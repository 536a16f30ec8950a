//! Whose a slot is: a word that sender and receiver share. Every change of hands orders what was written before it with what is read after.

use std::sync::atomic::{AtomicU32, Ordering};

/// Nobody uses the slot.
const FREE: u32 = 0;
/// The sender writes.
const LEASED: u32 = 1;
/// The sender has written, and no more.
const HANDED_OVER: u32 = 2;
/// The receiver reads.
const KEPT: u32 = 3;

/// A word of two processes; in the tests one of a model, which tries all orders of their steps.
pub(crate) trait SharedWord {
    fn store(&self, value: u32, order: Ordering);
    /// True if it was `from`, and is `to` now; a change has `order`, none has no order.
    fn change(&self, from: u32, to: u32, order: Ordering) -> bool;
}

impl SharedWord for AtomicU32 {
    fn store(&self, value: u32, order: Ordering) {
        self.store(value, order);
    }

    fn change(&self, from: u32, to: u32, order: Ordering) -> bool {
        self.compare_exchange(from, to, order, Ordering::Relaxed).is_ok()
    }
}

/// The state that a word holds.
#[derive(Debug)]
pub(crate) struct SlotState<'a, W>(pub &'a W);

impl<W: SharedWord> SlotState<'_, W> {
    /// A new slot is its maker's, who has told nobody of it yet.
    pub(crate) fn begin(&self) {
        self.0.store(LEASED, Ordering::Relaxed);
    }

    /// Leases a free slot to the sender; false if it is not free.
    pub(crate) fn lease(&self) -> bool {
        self.0.change(FREE, LEASED, Ordering::AcqRel)
    }

    /// Hands the sender's lease over.
    pub(crate) fn hand_over(&self) {
        self.0.change(LEASED, HANDED_OVER, Ordering::AcqRel);
    }

    /// The receiver keeps what was handed over, once; false if nothing was.
    pub(crate) fn keep(&self) -> bool {
        self.0.change(HANDED_OVER, KEPT, Ordering::AcqRel)
    }

    /// Gives it back, whoever has it.
    pub(crate) fn free(&self) {
        self.0.store(FREE, Ordering::Release);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use loom::cell::UnsafeCell;
    use loom::sync::Arc;
    use loom::sync::atomic::AtomicU32 as ModelWord;
    use loom::thread;

    impl SharedWord for ModelWord {
        fn store(&self, value: u32, order: Ordering) {
            self.store(value, order);
        }

        fn change(&self, from: u32, to: u32, order: Ordering) -> bool {
            self.compare_exchange(from, to, order, Ordering::Relaxed).is_ok()
        }
    }

    /// A slot's word, and its data, of which the model tells every access that is ordered with no other.
    struct Slot {
        word: ModelWord,
        data: UnsafeCell<u32>,
    }

    impl Slot {
        fn new() -> Arc<Self> {
            let slot = Self { word: ModelWord::new(FREE), data: UnsafeCell::new(0) };
            slot.state().begin();
            Arc::new(slot)
        }

        fn state(&self) -> SlotState<'_, ModelWord> {
            SlotState(&self.word)
        }

        #[allow(unsafe_code, reason = "the model checks that nobody else has the data")]
        fn write(&self, value: u32) {
            // SAFETY: the writer holds the lease.
            self.data.with_mut(|data| unsafe { *data = value });
        }

        #[allow(unsafe_code, reason = "the model checks that nobody else writes the data")]
        fn read(&self) -> u32 {
            // SAFETY: the reader has kept the slot.
            self.data.with(|data| unsafe { *data })
        }
    }

    #[test]
    fn in_every_order_the_receiver_reads_what_was_handed_over_and_the_sender_overwrites_nothing_kept() {
        loom::model(|| {
            let slot = Slot::new();
            let receiver = {
                let slot = slot.clone();
                thread::spawn(move || {
                    for value in 1..=2 {
                        while !slot.state().keep() {
                            thread::yield_now();
                        }
                        assert_eq!(slot.read(), value);
                        slot.state().free();
                    }
                })
            };
            slot.write(1);
            slot.state().hand_over();
            while !slot.state().lease() {
                thread::yield_now();
            }
            slot.write(2);
            slot.state().hand_over();
            receiver.join().unwrap();
        });
    }

    #[test]
    fn what_was_handed_over_once_is_kept_once() {
        loom::model(|| {
            let slot = Slot::new();
            slot.write(1);
            slot.state().hand_over();
            let other = {
                let slot = slot.clone();
                thread::spawn(move || slot.state().keep())
            };
            let kept = [slot.state().keep(), other.join().unwrap()];
            assert!(kept[0] != kept[1]);
            assert!(!slot.state().lease(), "it is not given back yet");
        });
    }
}
