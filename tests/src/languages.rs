//! Simulations in other languages, compiled against the client.

use crate::processes::binary;
use std::path::{Path, PathBuf};
use std::process::Command;

/// A file of the source tree.
pub fn source(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap_or(Path::new("..")).join(path)
}

/// The client's library.
pub fn library() -> PathBuf {
    binary(&format!("{}lamina_c{}", std::env::consts::DLL_PREFIX, std::env::consts::DLL_SUFFIX))
}

/// Compiles with warnings as errors against the library; the program.
///
/// # Panics
/// If the compiler is missing or refuses.
pub fn compile(compiler: &[&str], sources: &[&str], folder: &Path) -> PathBuf {
    let (program, library) = (folder.join(sources[sources.len() - 1].replace(['/', '.'], "_")), library());
    let beside = library.parent().unwrap_or(Path::new(".")).display().to_string();
    let made = Command::new(compiler[0])
        .current_dir(folder)
        .args(&compiler[1..])
        .args(["-Wall", "-Wextra", "-Werror", "-O2", "-ffp-contract=off"])
        .args(sources.iter().map(|s| source(s)))
        .arg("-I")
        .arg(source("proto/client/c"))
        .args([&format!("-L{beside}"), "-llamina_c", &format!("-Wl,-rpath,{beside}"), "-o"])
        .arg(&program)
        .output();
    let made = made.unwrap_or_else(|e| panic!("{compiler:?} is needed: {e}"));
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    program
}

/// A Python that has `module`: the user's, or the system's.
///
/// # Panics
/// If none has.
pub fn python_with(module: &str) -> &'static str {
    let import = format!("import {module}");
    let has = |python: &&str| Command::new(python).args(["-c", &import]).output().is_ok_and(|o| o.status.success());
    ["python3", "/usr/bin/python3"].into_iter().find(has).unwrap_or_else(|| panic!("no Python has {module}"))
}
