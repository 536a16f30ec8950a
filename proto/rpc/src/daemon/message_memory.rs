//! Bodies of gRPC's calls, read so that messages of which a part has come take no more memory than their address's share.
//!
//! Each message is led by a byte of flags and four of its length (<https://github.com/grpc/grpc/blob/master/doc/PROTOCOL-HTTP2.md>).
//! One that does not come in one piece is handed on once there is memory for all of it, so whoever holds memory needs no more to go
//! on. One of which nothing comes any more, or too slowly, ends its call.

use super::address_share::AddressShare;
use super::refusals::Refusals;
use axum::body::{Body, BodyDataStream, Bytes};
use std::io;
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::task::{Context, Poll, ready};
use std::time::Duration;
use tokio::sync::OwnedSemaphorePermit;
use tokio::time::{Instant, Sleep};
use tokio_stream::Stream;

/// How long nothing may come of a message that has begun.
const SILENCE: Duration = Duration::from_secs(30);
/// Bytes a second of a message that has memory: half of a link of 64 kbit/s.
const LEAST_RATE: f64 = 4096.0;

/// `body`, whose unfinished messages are counted in `share`.
pub(super) fn within_share(body: Body, share: Arc<AddressShare>, refusals: Arc<Refusals>) -> Body {
    let (sequence, permit) = (MessageSequence::default(), MessagePermit::None);
    let (chunks, held_back) = (body.into_data_stream(), None);
    Body::from_stream(Messages { chunks, share, refusals, sequence, held_back, permit, silence: None })
}

/// Where in the sequence of messages a stream of bytes is.
#[derive(Debug, Default)]
struct MessageSequence {
    /// Bytes of the prefix that have come, and what they say of the length so far.
    prefix: u8,
    length: u32,
    /// Bytes of the message that have not come.
    missing: u32,
}

impl MessageSequence {
    const PREFIX: u8 = 5;

    /// Passes `bytes`; gives how many of them end whole messages.
    fn advance(&mut self, bytes: &[u8]) -> usize {
        let (mut rest, mut whole) = (bytes, 0);
        while let Some((first, behind)) = rest.split_first() {
            if self.prefix < Self::PREFIX {
                self.length = if self.prefix == 0 { 0 } else { self.length << 8 | u32::from(*first) };
                (self.prefix, self.missing, rest) = (self.prefix + 1, self.length, behind);
            } else {
                let taken = rest.len().min(self.missing as usize);
                (self.missing, rest) = (self.missing - taken as u32, &rest[taken..]);
            }
            if self.prefix == Self::PREFIX && self.missing == 0 {
                (self.prefix, whole) = (0, bytes.len() - rest.len());
            }
        }
        whole
    }

    /// True within a message, its prefix included.
    fn is_within(&self) -> bool {
        self.prefix > 0
    }

    /// The length of the message that is not whole, once it is known.
    fn unfinished(&self) -> Option<u32> {
        (self.prefix == Self::PREFIX).then_some(self.length)
    }
}

type Granted = Pin<Box<dyn Future<Output = Option<OwnedSemaphorePermit>> + Send>>;

/// Memory for the message that is not whole.
enum MessagePermit {
    None,
    Waiting(Granted),
    /// Given back when it is dropped; the message has to be whole by then.
    Held(#[expect(dead_code, reason = "its drop counts")] OwnedSemaphorePermit, Instant),
}

struct Messages {
    chunks: BodyDataStream,
    share: Arc<AddressShare>,
    refusals: Arc<Refusals>,
    sequence: MessageSequence,
    /// The beginning of a message, until there is memory for it.
    held_back: Option<Bytes>,
    permit: MessagePermit,
    silence: Option<Pin<Box<Sleep>>>,
}

impl Messages {
    /// Ready with memory for a message of `length` bytes, or with why there will be none.
    fn poll_permit(&mut self, length: u32, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        if matches!(self.permit, MessagePermit::None) {
            if self.share.is_short_of(length) {
                self.refusals.waited.fetch_add(1, Ordering::Relaxed);
            }
            self.permit = MessagePermit::Waiting(Box::pin(self.share.clone().message(length)));
        }
        if let MessagePermit::Waiting(granted) = &mut self.permit {
            let Some(permit) = ready!(granted.as_mut().poll(cx)) else {
                let words = "too many messages of this address wait for memory";
                return Poll::Ready(Err(io::Error::other(words)));
            };
            let until = Instant::now() + SILENCE + Duration::from_secs_f64(f64::from(length) / LEAST_RATE);
            self.permit = MessagePermit::Held(permit, until);
        }
        Poll::Ready(Ok(()))
    }

    /// A message does not come in time.
    fn too_slow(&self) -> io::Error {
        self.refusals.slow.fetch_add(1, Ordering::Relaxed);
        let words =
            format!("a message that had begun did not come: nothing for {} s, or too slowly", SILENCE.as_secs());
        io::Error::new(io::ErrorKind::TimedOut, words)
    }
}

impl Stream for Messages {
    type Item = Result<Bytes, axum::Error>;

    fn poll_next(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Option<Self::Item>> {
        loop {
            if let (Some(_), Some(length)) = (&self.held_back, self.sequence.unfinished()) {
                let granted = ready!(self.poll_permit(length, cx));
                let held_back = self.held_back.take().map(|bytes| granted.map(|()| bytes));
                return Poll::Ready(held_back.map(|bytes| bytes.map_err(axum::Error::new)));
            }
            match Pin::new(&mut self.chunks).poll_next(cx) {
                Poll::Ready(Some(Ok(mut bytes))) => {
                    self.silence = None;
                    let whole = self.sequence.advance(&bytes);
                    if whole > 0 {
                        self.permit = MessagePermit::None;
                    }
                    if let MessagePermit::Held(_, until) = self.permit {
                        let is_late = Instant::now() > until;
                        return Poll::Ready(Some(if is_late {
                            Err(axum::Error::new(self.too_slow()))
                        } else {
                            Ok(bytes)
                        }));
                    }
                    if self.sequence.unfinished().is_some() {
                        // What is whole goes first: nobody is to hold memory while it is worked on.
                        let begun = bytes.split_off(whole);
                        self.held_back = Some(begun);
                        if whole == 0 {
                            continue;
                        }
                    }
                    return Poll::Ready(Some(Ok(bytes)));
                }
                Poll::Pending if self.sequence.is_within() => {
                    let silence = self.silence.get_or_insert_with(|| Box::pin(tokio::time::sleep(SILENCE)));
                    ready!(silence.as_mut().poll(cx));
                    return Poll::Ready(Some(Err(axum::Error::new(self.too_slow()))));
                }
                other => return other,
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tokio_stream::StreamExt as _;

    fn message(length: u32) -> Vec<u8> {
        [&[0][..], &length.to_be_bytes(), &vec![7; length as usize]].concat()
    }

    #[test]
    fn the_place_in_the_messages_does_not_depend_on_how_they_are_cut() {
        let all = [message(3), message(0), message(70_000), message(1)].concat();
        // Where the messages end.
        let ends = [8, 13, 70_018, 70_024];
        for size in [1, 2, 4, 5, 7, 1000, all.len()] {
            let mut sequence = MessageSequence::default();
            for (k, piece) in all.chunks(size).enumerate() {
                let whole = sequence.advance(piece);
                let come = k * size + piece.len();
                let last = ends.iter().rfind(|end| (k * size + 1..=come).contains(*end));
                assert_eq!(whole, last.map_or(0, |end| end - k * size));
                assert_eq!(sequence.unfinished() == Some(70_000), (18..70_018).contains(&come), "{size}: {come}");
            }
            assert!(!sequence.is_within());
        }
    }

    #[tokio::test]
    async fn messages_come_as_they_were_and_one_waits_for_the_memory_of_another() {
        let (share, refusals) = (Arc::new(AddressShare::default()), Arc::new(Refusals::default()));
        let all = [message(3), message(200_000), message(0), message(5_000_000)].concat();
        let pieces = |bytes: &[u8]| {
            let pieces: Vec<_> = bytes.chunks(16_384).map(|piece| Ok::<_, io::Error>(piece.to_vec())).collect();
            Body::from_stream(tokio_stream::iter(pieces).chain(tokio_stream::pending()))
        };
        let mut body = within_share(pieces(&all), share.clone(), refusals.clone()).into_data_stream();
        let mut come = Vec::new();
        while come.len() < all.len() {
            come.extend(body.next().await.unwrap().unwrap());
        }
        assert!(come == all && refusals.waited.load(Ordering::Relaxed) == 0);
        // All of the address's memory is another's: the short message comes, and nothing of the long one behind it.
        let others: Vec<_> =
            tokio_stream::iter(0..8).then(|_| share.clone().message(8 << 20)).collect::<Vec<_>>().await;
        assert!(others.iter().all(Option::is_some));
        let two = [message(3), message(200_000)].concat();
        let mut body = within_share(pieces(&two), share, refusals.clone()).into_data_stream();
        assert_eq!(body.next().await.unwrap().unwrap(), &two[..8]);
        let soon = |body: &mut BodyDataStream| {
            let waker = std::task::Waker::noop();
            Pin::new(body).poll_next(&mut Context::from_waker(waker))
        };
        assert!(soon(&mut body).is_pending() && refusals.waited.load(Ordering::Relaxed) == 1);
        drop(others);
        assert_eq!(body.next().await.unwrap().unwrap(), &two[8..16_384]);
    }
}
