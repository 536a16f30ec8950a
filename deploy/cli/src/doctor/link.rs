//! How well a node is reached: round trip, clock, version, bytes a second.

use futures::{StreamExt as _, stream};
use lamina_rpc::protocol::user_agent;
use lamina_rpc::v1::{ProbeRequest, diagnosis_client::DiagnosisClient};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};
use tonic::Code;
use tonic::transport::Channel;

/// How long an answer may take.
const PATIENCE: Duration = Duration::from_secs(3);
/// Questions whose least time is the round trip.
const ROUNDS: usize = 9;
/// Payload of a reply where bytes are timed, and how many replies may be under way.
const PAYLOAD: u32 = 1 << 20;
const AT_ONCE: usize = 8;
/// Bytes are timed for so long.
const TIMED: Duration = Duration::from_millis(300);
/// Clocks that differ by more are told of: logs and records of the nodes do not agree, and certificates may seem expired.
const CLOCK: f64 = 1.0;

/// What is found of a link.
pub(super) struct Link {
    first: Duration,
    round_trip: Duration,
    /// By how much the node's clock is ahead of this one, seconds; known to half a round trip.
    clock_ahead: f64,
    agent: String,
    bytes_per_second: f64,
}

impl Link {
    /// Probes the node at the other end of `channel`.
    ///
    /// # Errors
    /// Says what is wrong with it.
    pub(super) async fn probe(channel: Channel) -> Result<Self, String> {
        let mut node = DiagnosisClient::new(channel).max_decoding_message_size(2 * PAYLOAD as usize);
        let (mut first, mut best, mut agent) = (None, None, String::new());
        for _ in 0..ROUNDS {
            let (asked, before) = (Instant::now(), now());
            let answer = tokio::time::timeout(PATIENCE, node.probe(ProbeRequest { reply_bytes: 0 })).await;
            let answer = answer.map_err(|_| format!("no answer within {PATIENCE:?}; does the node hang?"))?;
            let reply = answer.map_err(|status| words(&status))?.into_inner();
            let took = asked.elapsed();
            first = first.or(Some(took));
            if best.is_none_or(|(least, _)| took < least) {
                best = Some((took, reply.clock_ns as f64 / 1e9 - before - took.as_secs_f64() / 2.0));
            }
            agent = reply.agent;
        }
        let (round_trip, clock_ahead) = best.unwrap_or_default();
        let bytes_per_second = throughput(&node).await?;
        Ok(Self { first: first.unwrap_or_default(), round_trip, clock_ahead, agent, bytes_per_second })
    }
}

/// Seconds since 1970.
fn now() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs_f64()
}

/// Bytes a second from the node to here.
async fn throughput(node: &DiagnosisClient<Channel>) -> Result<f64, String> {
    let probe = |reply_bytes| {
        let mut node = node.clone();
        async move { node.probe(ProbeRequest { reply_bytes }).await.map_err(|status| words(&status)) }
    };
    // A slow link is not asked for megabytes.
    for reply_bytes in [PAYLOAD / 64, PAYLOAD / 8] {
        let begun = Instant::now();
        probe(reply_bytes).await?;
        if begun.elapsed() > TIMED {
            return Ok(f64::from(reply_bytes) / begun.elapsed().as_secs_f64());
        }
    }
    let begun = Instant::now();
    let asked = stream::iter(0_u32..).take_while(|_| std::future::ready(begun.elapsed() < TIMED));
    let mut replies = asked.map(|_| probe(PAYLOAD)).buffer_unordered(AT_ONCE);
    let mut bytes = 0;
    while let Some(reply) = replies.next().await {
        bytes += reply?.into_inner().payload.len();
    }
    Ok(bytes as f64 / begun.elapsed().as_secs_f64())
}

fn words(status: &tonic::Status) -> String {
    match status.code() {
        Code::Unimplemented | Code::Unknown | Code::Internal => {
            let reason = status.message();
            format!(
                "something else than a node of this version answers there ({reason}); has it credentials? then it is https://"
            )
        }
        _ => status.message().to_owned(),
    }
}

impl std::fmt::Display for Link {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let ms = |time: Duration| time.as_secs_f64() * 1e3;
        let (first, round_trip) = (ms(self.first), ms(self.round_trip));
        let rate = self.bytes_per_second / 1e6;
        write!(f, "first answer {first:.1} ms, round trip {round_trip:.2} ms, {rate:.1} MB/s")?;
        let ahead = self.clock_ahead;
        if ahead.abs() > CLOCK {
            write!(
                f,
                "; its clock is {:.1} s {}: run NTP on both hosts",
                ahead.abs(),
                if ahead > 0.0 { "ahead" } else { "behind" }
            )?;
        } else {
            write!(f, ", clock {:+.1} ms", ahead * 1e3)?;
        }
        if self.agent != user_agent() {
            write!(f, "; it is {}, this is {}: install one version on both", self.agent, user_agent())?;
        }
        Ok(())
    }
}
