//! Large payloads in pieces: gRPC messages stay small whatever a VDI or a brick weighs.

use crate::v1::{self, delivery::Part};
use prost::bytes::Bytes;
use tonic::Status;

/// Bytes per chunk: large enough to fill a connection, small enough to share it.
pub const CHUNK_BYTES: usize = 1 << 20;

/// An announcement and its payload as messages in order.
pub fn deliver(announcement: Part, payload: &Bytes) -> impl Iterator<Item = v1::Delivery> + use<> {
    let payload = payload.clone();
    let chunk = move |start: usize| payload.slice(start..payload.len().min(start + CHUNK_BYTES));
    let starts = (0..payload_len(&announcement)).step_by(CHUNK_BYTES);
    std::iter::once(announcement)
        .chain(starts.map(move |start| Part::Chunk(chunk(start))))
        .map(|part| v1::Delivery { part: Some(part) })
}

fn payload_len(announcement: &Part) -> usize {
    match announcement {
        Part::Reference(r) => r.bytes as usize,
        Part::Frame(f) => f.bytes as usize,
        Part::Run(_) | Part::Chunk(_) => 0,
    }
}

/// Puts announcements and chunks together again, never holding more than `max_bytes` of a payload.
#[derive(Debug)]
pub struct Assembler {
    max_bytes: u64,
    open: Option<(Part, Vec<u8>, u64)>,
    /// Bytes still to come of a payload that was refused.
    skip: u64,
}

impl Assembler {
    /// Refuses payloads above `max_bytes`.
    pub fn new(max_bytes: u64) -> Self {
        Self { max_bytes, open: None, skip: 0 }
    }

    /// Takes one message; gives an announcement with its payload when that is whole.
    ///
    /// # Errors
    /// `ResourceExhausted` if more than `max_bytes` are announced: those are passed over, and the next announcement is taken
    /// again. Anything else if the messages are out of order.
    pub fn push(&mut self, delivery: v1::Delivery) -> Result<Option<(Part, Vec<u8>)>, Status> {
        let part = delivery.part.ok_or_else(|| Status::invalid_argument("delivery: empty message"))?;
        if let Part::Chunk(chunk) = &part {
            if self.skip > 0 {
                self.skip = self.skip.saturating_sub(chunk.len() as u64);
                return Ok(None);
            }
            let Some((_, payload, bytes)) = &mut self.open else {
                return Err(Status::invalid_argument("delivery: a chunk without an announcement"));
            };
            if payload.len() as u64 + chunk.len() as u64 > *bytes {
                return Err(Status::invalid_argument(format!(
                    "delivery: more chunks than the {bytes} bytes announced"
                )));
            }
            payload.extend_from_slice(chunk);
        } else {
            if self.open.is_some() {
                return Err(Status::invalid_argument(
                    "delivery: an announcement before the last one's bytes were all in",
                ));
            }
            let bytes = payload_len(&part) as u64;
            if bytes > self.max_bytes {
                let max = self.max_bytes;
                self.skip = bytes;
                return Err(Status::resource_exhausted(format!(
                    "delivery: {bytes} bytes announced, the limit is {max}"
                )));
            }
            self.open = Some((part, Vec::new(), bytes));
        }
        Ok(self
            .open
            .take_if(|(_, payload, bytes)| payload.len() as u64 == *bytes)
            .map(|(part, payload, _)| (part, payload)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(bytes: u64) -> Part {
        Part::Frame(v1::Frame { bytes, ..Default::default() })
    }

    #[test]
    fn what_is_cut_up_comes_back_whole() {
        for len in [0, 1, CHUNK_BYTES, 2 * CHUNK_BYTES + 7] {
            let payload = Bytes::from((0..len).map(|i| i as u8).collect::<Vec<_>>());
            let mut assembler = Assembler::new(1 << 30);
            let whole: Vec<_> =
                deliver(frame(len as u64), &payload).filter_map(|d| assembler.push(d).unwrap()).collect();
            assert_eq!(whole.len(), 1);
            assert_eq!(whole[0].1, payload);
        }
    }

    #[test]
    fn lies_about_sizes_and_order_are_refused() {
        let say = |part| v1::Delivery { part: Some(part) };
        let chunk = |n: usize| say(Part::Chunk(Bytes::from(vec![0; n])));
        assert!(Assembler::new(10).push(say(frame(11))).is_err());
        assert!(Assembler::new(10).push(chunk(1)).is_err());
        assert!(Assembler::new(10).push(v1::Delivery { part: None }).is_err());
        let mut a = Assembler::new(10);
        assert_eq!(a.push(say(frame(12))).unwrap_err().code(), tonic::Code::ResourceExhausted);
        assert!(a.push(chunk(7)).unwrap().is_none() && a.push(chunk(5)).unwrap().is_none(), "passed over");
        assert!(a.push(say(frame(1))).unwrap().is_none() && a.push(chunk(1)).unwrap().is_some(), "the next one fits");
        assert!(a.push(say(frame(4))).unwrap().is_none());
        assert!(a.push(chunk(5)).is_err());
        assert!(a.push(say(frame(4))).is_err());
    }
}
