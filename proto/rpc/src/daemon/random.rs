//! Secrets.

use lamina_model::Invalid;
use std::fmt::Write as _;
use tokio_rustls::rustls::crypto::ring;

/// 128 random bits that cannot be guessed, in hexadecimal.
///
/// # Errors
/// If the system gives none.
pub fn random() -> Result<String, Invalid> {
    let mut bytes = [0; 16];
    let filled = ring::default_provider().secure_random.fill(&mut bytes);
    filled.map_err(|_| Invalid::new("system", "gives no random numbers"))?;
    Ok(bytes.iter().fold(String::new(), |mut text, byte| {
        let _ = write!(text, "{byte:02x}");
        text
    }))
}
