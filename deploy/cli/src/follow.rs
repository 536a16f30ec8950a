//! `lamina watch`: the formats of others are read by their own libraries, in Python.

use crate::cli;
use anyhow::{Context, bail};
use std::process::Command;

const INSTALL: &str = "it needs the Python package: pip install deploy/python, in the source tree";

/// Runs `python3 -m lamina watch` with the same arguments, until it ends.
pub fn follow(arguments: &cli::Follow) -> anyhow::Result<()> {
    let python = || Command::new("python3");
    let found =
        python().args(["-c", "import lamina.follow"]).output().with_context(|| format!("python3: {INSTALL}"))?;
    if !found.status.success() {
        let reason = String::from_utf8_lossy(&found.stderr);
        bail!("{}: {INSTALL}", reason.lines().last().unwrap_or("import lamina.follow fails"));
    }
    let ended = python().args(["-m", "lamina", "watch"]).args(&arguments.arguments).status()?;
    // It has said why.
    std::process::exit(ended.code().unwrap_or(1))
}
