//! Ascent's calls of C, as PyFR and codes in Fortran make them: `ascent_publish` hands a step over. Ascent's own actions are not run.
//!
//! Beside them `lamina_publish`, for a code that has a Conduit node and nothing else.

use crate::adaptor::{Adaptor, Found, StepState};
use crate::conduit::{ConduitNode, Node};
use crate::guard::guarded;
use crate::mesh::domains_of;
use std::sync::Mutex;

/// A run, and the sentence that was said last.
#[derive(Default)]
pub struct Ascent(Option<Adaptor>, String);

/// Hands over the domains of the mesh at `node`.
fn publish(adaptor: &mut Adaptor, node: Node) -> Result<(), String> {
    let meshes = [("mesh".to_owned(), node)];
    let first =
        if node.at("coordsets").is_some() { Some(node) } else { node.children().first().map(|(_, node)| *node) };
    let number = |node: Node| {
        // A number; PyFR has text at `data`.
        let text = || node.text().or_else(|| node.text_at("data"))?.trim().parse().ok();
        node.array().and_then(|array| array.get(0)).or_else(text)
    };
    let state = StepState::read(first.and_then(|node| node.at("state")), ["cycle", "timestep"], number);
    adaptor.push(&state, &|_, field| -> Found { domains_of(&meshes, field) })
}

/// A new run.
#[unsafe(no_mangle)]
pub extern "C" fn ascent_create() -> *mut Ascent {
    Box::into_raw(Box::default())
}

/// Reads options: `mpi_comm`, a Fortran handle, and those of the node `lamina`.
///
/// # Safety
/// `run` is of `ascent_create`, and `options` null or a node of Conduit.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ascent_open(run: *mut Ascent, options: *const ConduitNode) {
    // SAFETY: the caller's promise.
    let Some(Ascent(run, said)) = (unsafe { run.as_mut() }) else { return };
    guarded(said, options, |options| {
        *run = Some(Adaptor::new(options.at("lamina"), options.number("mpi_comm"))?);
        Ok(())
    });
}

/// Hands the step over.
///
/// # Safety
/// As for `ascent_open`; the arrays of `mesh` lie in memory until this returns.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ascent_publish(run: *mut Ascent, mesh: *const ConduitNode) {
    // SAFETY: the caller's promise.
    let Some(Ascent(run, said)) = (unsafe { run.as_mut() }) else { return };
    guarded(said, mesh, |mesh| match run {
        Some(adaptor) => publish(adaptor, mesh),
        None => Err("ascent_open was not called, or failed; no step is shown".to_owned()),
    });
}

/// Does nothing: what is shown is chosen where it is watched.
///
/// # Safety
/// None is needed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ascent_execute(_run: *mut Ascent, _actions: *const ConduitNode) {}

/// What people who watch ask for, at `lamina/steering`.
///
/// # Safety
/// As for `ascent_open`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ascent_info(run: *mut Ascent, info: *mut ConduitNode) {
    // SAFETY: the caller's promise.
    let Some(Ascent(Some(adaptor), said)) = (unsafe { run.as_mut() }) else { return };
    guarded(said, info, |info| {
        adaptor.results(&info);
        Ok(())
    });
}

/// Ends the run.
///
/// # Safety
/// As for `ascent_open`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ascent_close(run: *mut Ascent) {
    // SAFETY: the caller's promise.
    let Some(Ascent(run, said)) = (unsafe { run.as_mut() }) else { return };
    guarded(said, std::ptr::null(), |_| run.take().map_or(Ok(()), Adaptor::finish));
}

/// Frees what `ascent_create` made.
///
/// # Safety
/// `run` is of `ascent_create`, and not used again.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ascent_destroy(run: *mut Ascent) {
    if !run.is_null() {
        // SAFETY: the caller's promise.
        let mut run = unsafe { Box::from_raw(run) };
        // SAFETY: it is that run, for the length of the call.
        unsafe { ascent_close(&raw mut *run) };
    }
}

/// Names this implementation at `ascent`.
///
/// # Safety
/// `about` is null or a node of Conduit.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ascent_about(about: *mut ConduitNode) {
    guarded(&mut String::new(), about, |about| {
        about.set_text("version", env!("CARGO_PKG_VERSION"));
        about.set_text("implementation", "lamina");
        Ok(())
    });
}

/// The run of `lamina_publish`.
static PUBLISHED: Mutex<Ascent> = Mutex::new(Ascent(None, String::new()));

/// Hands a Blueprint mesh over; options are those of the environment, ranks those of the MPI world. Null ends the run.
///
/// # Safety
/// `mesh` is null or a node of Conduit, whose arrays lie in memory until this returns.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lamina_publish(mesh: *const ConduitNode) {
    // A lock is poisoned where a panic was caught, here.
    let mut state = PUBLISHED.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
    let Ascent(run, said) = &mut *state;
    guarded(said, mesh, |node| {
        if mesh.is_null() {
            return run.take().map_or(Ok(()), Adaptor::finish);
        }
        if run.is_none() {
            *run = Some(Adaptor::new(None, None)?);
        }
        run.as_mut().map_or(Ok(()), |adaptor| publish(adaptor, node))
    });
}
