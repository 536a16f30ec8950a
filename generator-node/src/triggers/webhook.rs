//! Word of triggers that fired, posted to the one address that the node's configuration states.

use lamina_model::{Diagnostics, Invalid};
use serde::Serialize;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::time::Duration;
use ureq::Agent;
use ureq::http::Uri;
use ureq::tls::{Certificate, RootCerts, TlsConfig};

/// What is posted as JSON; chat services show `text`.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct Word {
    /// A sentence for people.
    pub text: String,
    /// The trigger's name.
    pub trigger: String,
    /// Its condition.
    pub when: String,
    /// The run's id.
    pub run: String,
    /// The field that is shown.
    pub field: String,
    /// The step.
    pub step: u64,
    /// Simulation time.
    pub time: f64,
    /// What the simulation told of the step.
    pub diagnostics: Diagnostics,
}

/// Words that wait while one is posted; more are left out.
const MOST_WAITING: usize = 16;

/// The longest that posting one may take.
const LONGEST: Duration = Duration::from_secs(10);

/// How often one is tried, and the pause before the second time; each further one is twice as long.
const TRIES: u32 = 3;
const FIRST_PAUSE: Duration = Duration::from_secs(1);

/// Posts words one after another, on a thread of its own. Dropped, it waits for those that are left.
#[derive(Debug)]
pub(crate) struct Webhook {
    /// None at the end.
    words: Option<SyncSender<Word>>,
    /// Hangs up when all are posted.
    posted: Receiver<()>,
}

impl Webhook {
    /// Passes an address that words can be posted to. It may hold a secret, and is not repeated.
    ///
    /// # Errors
    /// If it is none of http or https.
    pub(crate) fn check(url: &str) -> Result<(), Invalid> {
        let is_usable =
            |uri: &Uri| matches!(uri.scheme_str(), Some("http" | "https")) && uri.host().is_some_and(|h| !h.is_empty());
        if url.parse().is_ok_and(|uri: Uri| is_usable(&uri)) {
            return Ok(());
        }
        Err(Invalid::new("webhook", "must be an address such as https://HOST/PATH"))
    }

    /// For `url`, until it is dropped.
    pub(crate) fn start(url: String) -> Self {
        let ((words, queue), (running, posted)) = (sync_channel(MOST_WAITING), sync_channel(0));
        std::thread::spawn(move || {
            post_all(&url, &queue);
            drop(running);
        });
        Self { words: Some(words), posted }
    }

    /// Posts a word soon.
    pub(crate) fn send(&self, word: Word) {
        let Some(words) = &self.words else { return };
        if let Err(TrySendError::Full(word) | TrySendError::Disconnected(word)) = words.try_send(word) {
            tracing::warn!(
                trigger = word.trigger,
                step = word.step,
                "not told: {MOST_WAITING} words wait for the webhook"
            );
        }
    }
}

impl Drop for Webhook {
    fn drop(&mut self) {
        self.words = None;
        if self.posted.recv_timeout(LONGEST) == Err(RecvTimeoutError::Timeout) {
            tracing::error!("the webhook was not told of all triggers that fired");
        }
    }
}

fn post_all(url: &str, queue: &Receiver<Word>) {
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    // The authorities that the machine trusts.
    let trusted = rustls_native_certs::load_native_certs().certs;
    if trusted.is_empty() && url.starts_with("https") {
        tracing::warn!(
            "no certificate authorities are known here, and the webhook cannot be reached: install them (ca-certificates)"
        );
    }
    let trusted = trusted.iter().map(|certificate| Certificate::from_der(certificate).to_owned());
    let roots = RootCerts::Specific(Arc::new(trusted.collect()));
    let tls = TlsConfig::builder().root_certs(roots).unversioned_rustls_crypto_provider(provider);
    let agent: Agent = Agent::config_builder()
        .timeout_global(Some(LONGEST))
        // A redirect would lead to an address that nobody stated.
        .max_redirects(0)
        .tls_config(tls.build())
        .build()
        .into();
    for word in queue {
        let mut pause = FIRST_PAUSE;
        for n in 1..=TRIES {
            match agent.post(url).send_json(&word) {
                Ok(answer) if answer.status().is_success() => break,
                Ok(answer) if n == TRIES => not_told(&word, &format!("answered {}", answer.status())),
                Err(error) if n == TRIES => not_told(&word, &error.to_string()),
                _ => {
                    std::thread::sleep(pause);
                    pause *= 2;
                }
            }
        }
    }
}

fn not_told(word: &Word, reason: &str) {
    tracing::error!(trigger = word.trigger, step = word.step, reason, "not told: the webhook did not take it");
}
