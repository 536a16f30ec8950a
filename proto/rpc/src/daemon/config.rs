//! A daemon's configuration, log and exit code.

use super::NodeError;
use serde::de::DeserializeOwned;
use std::path::Path;

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

/// Log lines to standard error, `default_level` and above unless RUST_LOG says otherwise: text, or where LAMINA_LOG is `json` a JSON
/// object a line with `timestamp`, `level` and the event's `fields`.
pub fn log_to_stderr(default_level: &str) {
    let filter = tracing_subscriber::EnvFilter::try_from_default_env().unwrap_or_else(|_| default_level.into());
    // A second call, in a process with several nodes, keeps the first subscriber.
    let color = std::io::IsTerminal::is_terminal(&std::io::stderr());
    let log = tracing_subscriber::fmt().with_env_filter(filter).with_writer(std::io::stderr);
    let log = log.with_target(false).with_ansi(color);
    let _ = if std::env::var_os("LAMINA_LOG").is_some_and(|format| format == "json") {
        log.json().try_init()
    } else {
        log.try_init()
    };
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
