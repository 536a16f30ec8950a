//! A daemon's configuration, log and exit code.

use super::NodeError;
use lamina_model::Invalid;
use serde::de::DeserializeOwned;
use std::path::Path;
use std::sync::OnceLock;
use tracing_subscriber::layer::{Layer as _, SubscriberExt as _};
use tracing_subscriber::reload::Handle;
use tracing_subscriber::util::SubscriberInitExt as _;
use tracing_subscriber::{EnvFilter, Registry};

/// The configuration in the TOML file at `path`, or the defaults without one.
///
/// # Errors
/// If the file cannot be read, or has a key or value its type does not know.
pub fn load_config<T: DeserializeOwned + Default>(path: Option<&Path>) -> Result<T, NodeError> {
    let Some(path) = path else { return Ok(T::default()) };
    let name = path.display().to_string();
    let text = std::fs::read_to_string(path).map_err(|reason| NodeError::Unreadable { path: name.clone(), reason })?;
    toml::from_str(&text).map_err(|e| NodeError::Config { path: name, reason: e.to_string().trim_end().to_owned() })
}

/// Changes what the subscriber passes; absent where RUST_LOG decides.
static FILTER: OnceLock<Handle<EnvFilter, Registry>> = OnceLock::new();

/// Log lines to standard error, `default_level` and above unless RUST_LOG says otherwise: text, or where LAMINA_LOG is `json` a JSON
/// object a line with `timestamp`, `level` and the event's `fields`.
pub fn log_to_stderr(default_level: &str) {
    let stated = EnvFilter::try_from_default_env().ok();
    let is_stated = stated.is_some();
    let filter = without_addresses(stated.unwrap_or_else(|| default_level.into()));
    let color = std::io::IsTerminal::is_terminal(&std::io::stderr());
    let (filter, handle) = tracing_subscriber::reload::Layer::new(filter);
    let lines = tracing_subscriber::fmt::layer().with_writer(std::io::stderr).with_target(false).with_ansi(color);
    let is_json = std::env::var_os("LAMINA_LOG").is_some_and(|format| format == "json");
    let lines = if is_json { lines.json().boxed() } else { lines.boxed() };
    // A second call, in a process with several nodes, keeps the first subscriber.
    let is_first = tracing_subscriber::registry().with(filter).with(lines).try_init().is_ok();
    if is_first && !is_stated {
        let _ = FILTER.set(handle);
    }
}

/// Passes what [`log_to_stderr`] can be told to log.
///
/// # Errors
/// Says what can be written.
pub fn check_log(directives: &str) -> Result<(), Invalid> {
    let parsed = EnvFilter::builder().parse(directives);
    parsed.map(drop).map_err(|error| {
        let words =
            format!("\"{directives}\" ({error}); write error, warn, info, debug or trace, or such a word by module");
        Invalid::new("log", words)
    })
}

/// Logs what `directives` say from now on, unless RUST_LOG says otherwise.
pub(super) fn set_log(directives: &str) {
    if let (Some(change), Ok(filter)) = (FILTER.get(), EnvFilter::builder().parse(directives)) {
        let _ = change.reload(without_addresses(filter));
    }
}

/// The same without what the HTTP client says of the addresses it calls, which may hold secrets.
fn without_addresses(filter: EnvFilter) -> EnvFilter {
    let quiet = ["ureq=warn", "ureq_proto=warn"].into_iter().filter_map(|directive| directive.parse().ok());
    quiet.fold(filter, EnvFilter::add_directive)
}

/// What a binary ends with: one line about the error, if there is one.
pub fn exit_code(outcome: Result<(), impl std::fmt::Display>) -> std::process::ExitCode {
    match outcome {
        Ok(()) => std::process::ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            std::process::ExitCode::FAILURE
        }
    }
}
