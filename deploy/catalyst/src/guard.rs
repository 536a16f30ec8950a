//! What the calls of all interfaces have in common: nothing that goes wrong reaches the simulation; it is on standard error.

use crate::conduit::{Conduit, ConduitNode, Node};
use std::panic::{AssertUnwindSafe, catch_unwind};

/// Runs `work` on the node that a simulation hands over. What fails is said, once in a row.
pub(crate) fn guarded(said: &mut String, node: *const ConduitNode, work: impl FnOnce(Node) -> Result<(), String>) {
    let outcome = catch_unwind(AssertUnwindSafe(|| match Conduit::of_process() {
        Ok(conduit) => work(conduit.node(node)).err(),
        Err(missing) => Some(missing),
    }));
    match outcome {
        Ok(Some(error)) if error != *said => {
            eprintln!("lamina: {error}");
            *said = error;
        }
        Ok(_) => {}
        Err(_) => {
            eprintln!("lamina: a fault in the library; its message is above. The simulation goes on unwatched");
        }
    }
}

/// What `work` gives; an error where it panics.
pub(crate) fn caught<T>(work: impl FnOnce() -> Result<T, String>) -> Result<T, String> {
    catch_unwind(AssertUnwindSafe(work))
        .unwrap_or_else(|_| Err("a fault in the library; its message is above".to_owned()))
}
