//! An implementation of ParaView Catalyst 2, `libcatalyst-lamina.so`: a simulation that is instrumented for Catalyst loads it by
//! `CATALYST_IMPLEMENTATION_NAME=lamina` and `CATALYST_IMPLEMENTATION_PATHS`, and its code does not change.
//!
//! `catalyst_initialize` reads options, `catalyst_execute` turns the channel's mesh into bricks and pushes them, `catalyst_results` gives
//! what people who watch ask for. Nothing is linked: Conduit's and MPI's functions are those that the process has. Whatever goes wrong
//! here, the simulation is told that all is well, and the reason is on standard error, once.

mod adaptor;
mod ascent;
mod cell_mesh;
mod cells;
mod conduit;
mod guard;
mod lattice_run;
mod mesh;
mod options;
mod partition;
mod ranks;
mod resample;
mod resampled_run;
mod strided_grid;
mod symbols;
mod target;

use adaptor::{Adaptor, StepState};
use conduit::{ConduitNode, Node};
use guard::guarded;
use std::ffi::c_int;
use std::sync::Mutex;

type Call = unsafe extern "C" fn(*const ConduitNode) -> c_int;
type Fill = unsafe extern "C" fn(*mut ConduitNode) -> c_int;

/// `struct catalyst_impl` of libcatalyst, version 1 of its interface.
#[repr(C)]
pub struct CatalystImpl {
    version: c_int,
    initialize: Call,
    execute: Call,
    finalize: Call,
    about: Fill,
    results: Fill,
}

/// What libcatalyst looks up after it has opened the library.
#[unsafe(no_mangle)]
#[allow(non_upper_case_globals, reason = "the name that libcatalyst looks for")]
pub static catalyst_api_impl: CatalystImpl = CatalystImpl { version: 1, initialize, execute, finalize, about, results };

/// `catalyst_status_ok`: no other status is returned, for a simulation may abort at any other.
const OK: c_int = 0;

/// The run, and the sentence that was said last.
static STATE: Mutex<(Option<Adaptor>, String)> = Mutex::new((None, String::new()));

/// Runs `work` on the run, which it may replace.
fn on_run(node: *const ConduitNode, work: impl FnOnce(&mut Option<Adaptor>, Node) -> Result<(), String>) -> c_int {
    // A lock is poisoned where a panic was caught, here.
    let mut state = STATE.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
    let (run, said) = &mut *state;
    guarded(said, node, |node| work(run, node));
    OK
}

unsafe extern "C" fn initialize(params: *const ConduitNode) -> c_int {
    on_run(params, |run, params| {
        *run = Some(Adaptor::new(params.at("catalyst/lamina"), params.number("catalyst/mpi_comm"))?);
        Ok(())
    })
}

unsafe extern "C" fn execute(params: *const ConduitNode) -> c_int {
    on_run(params, |run, params| {
        let adaptor = run.as_mut().ok_or("catalyst_initialize was not called, or failed; no step is shown")?;
        let channels = params.at("catalyst/channels").map(|node| node.children()).unwrap_or_default();
        let domains = |wanted: Option<&str>, field: Option<&str>| match channels
            .iter()
            .find(|(name, _)| wanted.is_none_or(|wanted| name == wanted))
        {
            Some((name, node)) => mesh::domains(node, name, field),
            None => {
                let names = channels.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>().join(", ");
                Err(format!("no channel {}; there are: {names}", wanted.unwrap_or("at all")))
            }
        };
        let number = |node: conduit::Node| node.array()?.get(0);
        let state = StepState::read(params.at("catalyst/state"), ["timestep", "cycle"], number);
        adaptor.push(&state, &domains)
    })
}

unsafe extern "C" fn finalize(params: *const ConduitNode) -> c_int {
    on_run(params, |run, _| run.take().map_or(Ok(()), Adaptor::finish))
}

unsafe extern "C" fn about(params: *mut ConduitNode) -> c_int {
    on_run(params, |_, params| {
        params.set_text("catalyst/version", env!("CARGO_PKG_VERSION"));
        params.set_text("catalyst/implementation", "lamina");
        Ok(())
    })
}

unsafe extern "C" fn results(params: *mut ConduitNode) -> c_int {
    on_run(params, |run, params| {
        if let Some(adaptor) = run {
            adaptor.results(&params);
        }
        Ok(())
    })
}
