//! Requests to a node's page.

use std::process::Command;

/// What curl answers: status, then headers and body.
///
/// # Panics
/// If there is no curl.
pub fn curl(url: &str, arguments: &[&str]) -> (String, String) {
    let output = Command::new("curl")
        .args([
            "--silent",
            "--show-error",
            "--include",
            "--insecure",
            "--max-time",
            "20",
            "--write-out",
            "\n%{http_code}",
        ])
        .args(arguments)
        .arg(url)
        .output()
        .expect("curl");
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let (body, status) = text.rsplit_once('\n').expect("a status");
    (status.to_owned(), body.to_owned())
}

/// The number that the node at `address` gives for `name` at `/metrics`.
///
/// # Panics
/// If there is no curl.
pub fn metric(address: &str, name: &str) -> Option<f64> {
    let (_, text) = curl(&format!("{address}/metrics"), &[]);
    text.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(' ')?.trim().parse().ok())
}
