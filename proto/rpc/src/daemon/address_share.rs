//! What all connections of one address may take of a node together: how many there are, and memory for messages that come in.

use crate::MAX_MESSAGE_BYTES;
use parking_lot::Mutex;
use std::collections::HashMap;
use std::net::{IpAddr, Ipv6Addr};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Weak};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

/// The most connections of an address: several for each process of a large host, and half of a node's.
const CONNECTIONS: usize = 2048;
/// Memory for messages of which a part has come, by address.
const MESSAGES: usize = 64 << 20;
/// How many such messages of an address may wait for memory. Of each a piece has come, of 16 KiB as a rule.
const WAITING: usize = 1024;
/// What memory is counted in.
const UNIT: usize = 1 << 10;

/// The shares of the addresses that have connections.
#[derive(Debug, Default)]
pub(super) struct AddressShares(Mutex<HashMap<IpAddr, Weak<AddressShare>>>);

/// What is left of an address's share.
#[derive(Debug)]
pub(super) struct AddressShare {
    connections: Arc<Semaphore>,
    messages: Arc<Semaphore>,
    waiting: Semaphore,
    told: AtomicBool,
}

/// Whose share a connection from `address` has: of IPv6 those of a network, which has as many addresses as it likes.
fn owner(address: IpAddr) -> IpAddr {
    match address.to_canonical() {
        IpAddr::V6(address) if !address.is_loopback() => {
            Ipv6Addr::from_bits(address.to_bits() & !u128::from(u64::MAX)).into()
        }
        other => other,
    }
}

impl AddressShares {
    /// The share of `address`. It is forgotten with its last connection.
    pub(super) fn of(&self, address: IpAddr) -> Arc<AddressShare> {
        let (mut shares, address) = (self.0.lock(), owner(address));
        if let Some(share) = shares.get(&address).and_then(Weak::upgrade) {
            return share;
        }
        shares.retain(|_, share| share.strong_count() > 0);
        // Behind this host's own address are tunnels, and other users who are refused by and by.
        let connections = if address.is_loopback() { Semaphore::MAX_PERMITS } else { CONNECTIONS };
        let share = AddressShare { connections: Arc::new(Semaphore::new(connections)), ..AddressShare::default() };
        let share = Arc::new(share);
        shares.insert(address, Arc::downgrade(&share));
        share
    }
}

impl Default for AddressShare {
    fn default() -> Self {
        Self {
            connections: Arc::new(Semaphore::new(CONNECTIONS)),
            messages: Arc::new(Semaphore::new(MESSAGES / UNIT)),
            waiting: Semaphore::new(WAITING),
            told: AtomicBool::new(false),
        }
    }
}

impl AddressShare {
    /// One more connection, until the permit is dropped; `None` if there are as many as may be, which is said once.
    pub(super) fn connection(&self, address: IpAddr) -> Option<OwnedSemaphorePermit> {
        let permit = self.connections.clone().try_acquire_owned().ok();
        if permit.is_none() && !self.told.swap(true, Ordering::Relaxed) {
            tracing::warn!(%address, "has {CONNECTIONS} connections; more are refused");
        }
        permit
    }

    /// Memory of `bytes` for a message once there is so much, of one that no decoder takes for [`MAX_MESSAGE_BYTES`]; `None` if too many wait.
    pub(super) async fn message(self: Arc<Self>, bytes: u32) -> Option<OwnedSemaphorePermit> {
        let _turn = self.waiting.try_acquire().ok()?;
        self.messages.clone().acquire_many_owned(units(bytes)).await.ok()
    }

    /// True if such a message would have to wait.
    pub(super) fn is_short_of(&self, bytes: u32) -> bool {
        self.messages.available_permits() < units(bytes) as usize
    }
}

fn units(bytes: u32) -> u32 {
    bytes.min(MAX_MESSAGE_BYTES as u32).div_ceil(UNIT as u32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_has_so_many_connections_and_others_have_theirs() {
        let shares = AddressShares::default();
        let [one, other, own] = ["10.0.0.1", "10.0.0.2", "::1"].map(|address| address.parse().unwrap());
        let held: Vec<_> =
            (0..CONNECTIONS).map(|_| (shares.of(one), shares.of(one).connection(one).unwrap())).collect();
        assert!(shares.of(one).connection(one).is_none());
        let mapped = "::ffff:10.0.0.1".parse().unwrap();
        assert!(shares.of(mapped).connection(mapped).is_none(), "the same address");
        assert!(shares.of(other).connection(other).is_some());
        let of_host: Vec<_> = (0..=CONNECTIONS).map(|_| shares.of(own).connection(own)).collect();
        assert!(of_host.iter().all(Option::is_some), "tunnels end there");
        drop((held, of_host));
        assert!(shares.of(one).connection(one).is_some());
        assert_eq!(shares.0.lock().len(), 1, "those without a connection are forgotten");
        let [a, b, c] = ["2001:db8::1", "2001:db8::2:0:0:9", "2001:db8:0:1::1"].map(|a| owner(a.parse().unwrap()));
        assert!(a == b && a != c, "of a network");
    }

    #[tokio::test]
    async fn so_many_messages_wait_and_more_are_refused() {
        let share = Arc::new(AddressShare::default());
        let mut held = Vec::new();
        for _ in 0..8 {
            held.push(share.clone().message(8 << 20).await.unwrap());
        }
        assert!(share.is_short_of(1));
        let waiting: Vec<_> = (0..WAITING).map(|_| tokio::spawn(share.clone().message(1))).collect();
        while share.waiting.available_permits() > 0 {
            tokio::task::yield_now().await;
        }
        assert!(share.clone().message(1).await.is_none());
        drop(held);
        for granted in waiting {
            assert!(granted.await.unwrap().is_some());
        }
    }
}
