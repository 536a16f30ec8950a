//! Who can measure trials: the subscribers that say where their Quality service is, and the trials on their way to each.

use crate::delivery::Delivery;
use lamina_model::Invalid;
use lamina_rpc::connect::NodeAddress;
use lamina_rpc::v1;
use std::collections::VecDeque;
use std::net::IpAddr;
use tokio::sync::watch;

/// Bytes of trials that wait for one viewer; then the oldest VDI goes.
const WAITING_BYTES: u64 = 128 << 20;

/// The viewers present, in the order they joined.
#[derive(Default)]
pub(crate) struct Subscribers {
    joined: u64,
    present: Vec<Subscriber>,
    list: watch::Sender<v1::ViewerList>,
}

struct Subscriber {
    viewer: v1::Viewer,
    waiting: VecDeque<Delivery>,
}

impl Subscribers {
    /// Adds one whose Quality service is at `address`; gives the name it has until it [leaves](Self::leave).
    pub(crate) fn join(&mut self, address: String) -> String {
        self.joined += 1;
        let viewer = self.joined.to_string();
        self.present
            .push(Subscriber { viewer: v1::Viewer { viewer: viewer.clone(), address }, waiting: VecDeque::new() });
        self.announce();
        viewer
    }

    /// Forgets it and what waits for it.
    pub(crate) fn leave(&mut self, viewer: &str) {
        self.present.retain(|m| m.viewer.viewer != viewer);
        self.announce();
    }

    fn announce(&self) {
        self.list.send_replace(v1::ViewerList { viewers: self.present.iter().map(|m| m.viewer.clone()).collect() });
    }

    /// The list now and at every change.
    pub(crate) fn list(&self) -> watch::Receiver<v1::ViewerList> {
        self.list.subscribe()
    }

    /// How many are present.
    pub(crate) fn count(&self) -> usize {
        self.present.len()
    }

    /// What waits for `viewer`, the oldest first; `None` if it is not there.
    pub(crate) fn waiting(&mut self, viewer: &str) -> Option<&mut VecDeque<Delivery>> {
        self.present.iter_mut().find(|m| m.viewer.viewer == viewer).map(|m| &mut m.waiting)
    }
}

/// Makes room: drops the oldest VDIs, but the newest item and what they are compared with.
pub(crate) fn trim(waiting: &mut VecDeque<Delivery>) {
    let mut bytes: u64 = waiting.iter().map(Delivery::bytes).sum();
    while bytes > WAITING_BYTES {
        let Some(oldest) = waiting.iter().position(Delivery::is_frame) else { return };
        if oldest + 1 == waiting.len() {
            return;
        }
        bytes -= waiting.remove(oldest).map_or(0, |d| d.bytes());
    }
}

/// Where a subscriber's Quality service is, as others reach it: a host that means "any" becomes `peer`'s.
///
/// # Errors
/// If `address` is none.
pub(crate) fn reachable(address: &str, peer: Option<IpAddr>) -> Result<String, Invalid> {
    let given = NodeAddress::read("quality_address", address)?;
    let ip: Result<IpAddr, _> = given.host.trim_start_matches('[').trim_end_matches(']').parse();
    if !ip.is_ok_and(|ip| ip.is_unspecified()) {
        return Ok(given.to_string());
    }
    let unknown = || {
        let why = "stands for an address that is not known here; write http://HOST:PORT, such as http://10.0.0.7:7102";
        Invalid::new("quality_address", format!("\"{address}\" {why}"))
    };
    let host = match peer.ok_or_else(unknown)?.to_canonical() {
        IpAddr::V4(ip) => ip.to_string(),
        IpAddr::V6(ip) => format!("[{ip}]"),
    };
    Ok(NodeAddress { host, ..given }.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_passed_completed_or_refused_by_name() {
        let v4: IpAddr = "10.0.0.7".parse().unwrap();
        let mapped: IpAddr = "::ffff:10.0.0.7".parse().unwrap();
        let v6: IpAddr = "fe80::7".parse().unwrap();
        for (given, peer, expected) in [
            ("http://viz:7102", None, "http://viz:7102"),
            ("http://[::1]:7102", Some(v4), "http://[::1]:7102"),
            ("https://0.0.0.0:7102", Some(v4), "https://10.0.0.7:7102"),
            ("http://0.0.0.0:7102", Some(mapped), "http://10.0.0.7:7102"),
            ("http://[::]:7102", Some(v6), "http://[fe80::7]:7102"),
        ] {
            assert_eq!(reachable(given, peer).unwrap(), expected);
        }
        for (bad, peer) in [
            ("viz:7102", Some(v4)),
            ("http://viz", Some(v4)),
            ("http://:7102", Some(v4)),
            ("http://viz:0", Some(v4)),
            ("http://viz:99999", Some(v4)),
            ("http://viz:7102/x", Some(v4)),
            ("http://me@viz:7102", Some(v4)),
            ("http://", Some(v4)),
            ("http://0.0.0.0:7102", None),
        ] {
            let error = reachable(bad, peer).unwrap_err().to_string();
            assert!(error.contains("quality_address") && error.contains("http://HOST:PORT"), "{bad}: {error}");
        }
    }
}
