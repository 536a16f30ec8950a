//! Who may connect to a node, and which services a peer may call.

use super::NodeError;
use super::server_tls::ServerTls;
use crate::connect::{NodeAddress, host_name};
use crate::credentials::{Credentials, Role};
use crate::protocol::check_user_agent;
use std::net::{IpAddr, SocketAddr};
use std::path::Path;
use std::sync::Arc;
use std::time::SystemTime;
use tonic::{Request, Status};

/// Whom a node lets in.
#[derive(Debug, Clone)]
pub enum Access {
    /// Processes of this host that belong to the node's own user or to root.
    SameUser,
    /// Who shows a certificate of the same authority; each role may call its own services.
    Certificates(Arc<ServerTls>),
    /// Everybody.
    Anybody,
}

impl Access {
    /// The access of a node that listens on `address`, and its credentials: by those in `folder` where one is named, else by user on
    /// loopback. Anybody is let in only if `insecure`.
    ///
    /// # Errors
    /// If others could reach the node and nothing says who may, or the credentials cannot be used.
    pub fn of(
        address: SocketAddr,
        folder: Option<&Path>,
        insecure: bool,
    ) -> Result<(Self, Option<Credentials>), NodeError> {
        if let Some(folder) = folder {
            let credentials = Credentials::open(folder)?;
            return Ok((Self::Certificates(Arc::new(ServerTls::open(credentials.clone())?)), Some(credentials)));
        }
        if insecure {
            tracing::warn!(%address, "insecure: whoever reaches this address may use the node");
            return Ok((Self::Anybody, None));
        }
        if address.ip().is_loopback() { Ok((Self::SameUser, None)) } else { Err(NodeError::Open { address }) }
    }

    /// When the node's certificate expires, if it has one.
    pub fn certificate_end(&self) -> Option<SystemTime> {
        match self {
            Self::Certificates(tls) => Some(tls.valid_until()),
            Self::SameUser | Self::Anybody => None,
        }
    }

    /// Whether connections are secured by TLS.
    pub fn is_secure(&self) -> bool {
        matches!(self, Self::Certificates(_))
    }

    /// Where others reach a node with this access that listens on `address`: on this host's name where it is on all addresses.
    pub fn reached_at(&self, address: SocketAddr) -> NodeAddress {
        let host = match address.ip() {
            ip if ip.is_unspecified() => host_name(),
            IpAddr::V4(ip) => ip.to_string(),
            IpAddr::V6(ip) => format!("[{ip}]"),
        };
        NodeAddress { secure: self.is_secure(), host, port: address.port() }
    }
}

/// Who is at the other end of a connection.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Identity {
    /// Somebody who needs no certificate here.
    Trusted,
    /// The owner of a certificate.
    Certified(Role),
    /// Nobody that is known: without a certificate, or with one that states no role.
    Unknown,
    /// A process of another user of this host.
    OtherUser(u32),
}

/// The other end of a connection.
#[derive(Debug, Clone, Copy)]
pub struct Peer {
    /// Where it is.
    pub address: SocketAddr,
    /// Who it is.
    pub identity: Identity,
}

impl Peer {
    /// Checks that it may do what is for `roles`; admins may do everything.
    ///
    /// # Errors
    /// Says why not.
    pub fn check(&self, roles: &[Role]) -> Result<(), String> {
        match self.identity {
            Identity::Trusted | Identity::Certified(Role::Admin) => Ok(()),
            Identity::Certified(role) if roles.contains(&role) => Ok(()),
            Identity::Certified(role) => {
                let names: Vec<&str> = roles.iter().map(|role| role.name()).collect();
                Err(format!("a {role}'s certificate does not serve here; use one of: {}, admin", names.join(", ")))
            }
            Identity::Unknown => Err("no certificate that states a role; `lamina keys` makes them".to_owned()),
            Identity::OtherUser(user) => Err(format!(
                "this node is for processes of its own user, not of user {user}; start it with --credentials for others"
            )),
        }
    }
}

/// Refuses calls of peers that none of its roles allows, or that speak another version of the contracts.
#[derive(Debug, Clone, Copy)]
pub struct AllowRoles(pub &'static [Role]);

impl tonic::service::Interceptor for AllowRoles {
    fn call(&mut self, request: Request<()>) -> Result<Request<()>, Status> {
        let peer = peer_of(&request).ok_or_else(|| Status::internal("a connection of unknown origin"))?;
        peer.check(self.0).map_err(Status::permission_denied)?;
        let agent = request.metadata().get("user-agent").and_then(|agent| agent.to_str().ok()).unwrap_or_default();
        check_user_agent(agent).map_err(Status::failed_precondition)?;
        Ok(request)
    }
}

/// Where a request comes from.
pub fn peer_of<T>(request: &Request<T>) -> Option<Peer> {
    request.extensions().get::<Peer>().copied()
}

/// The user that the process at `peer`, an address of this host, belongs to, by the kernel's table of TCP connections; `None` if
/// the connection is not in it.
pub(super) fn user_of(peer: SocketAddr, local: SocketAddr) -> Option<u32> {
    let both = [peer, local].map(|a| SocketAddr::new(a.ip().to_canonical(), a.port()));
    let of_table = |path: &str| {
        let table = std::fs::read_to_string(path).ok()?;
        table.lines().skip(1).find_map(|line| {
            let mut fields = line.split_ascii_whitespace().skip(1);
            let ends = [table_address(fields.next()?)?, table_address(fields.next()?)?];
            // State 1 is an established connection; a socket that its process has left shows user 0.
            let established = fields.next()? == "01";
            (established && ends == both).then(|| fields.nth(3)?.parse().ok())?
        })
    };
    of_table("/proc/net/tcp").or_else(|| of_table("/proc/net/tcp6"))
}

/// `0100007F:1BBD` of the kernel's table: words of 32 bits in the machine's byte order.
fn table_address(text: &str) -> Option<SocketAddr> {
    let (ip, port) = text.split_once(':')?;
    let words = (0..ip.len() / 8).map(|n| Some(u32::from_str_radix(ip.get(8 * n..8 * n + 8)?, 16).ok()?.to_ne_bytes()));
    let bytes = words.collect::<Option<Vec<_>>>()?.concat();
    let ip = match <[u8; 4]>::try_from(&bytes[..]) {
        Ok(v4) => IpAddr::from(v4),
        Err(_) => IpAddr::from(<[u8; 16]>::try_from(&bytes[..]).ok()?).to_canonical(),
    };
    Some(SocketAddr::new(ip, u16::from_str_radix(port, 16).ok()?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::{TcpListener, TcpStream};

    #[test]
    fn addresses_of_the_kernels_table_are_read() {
        // From the documentation of /proc/net/tcp (Documentation/networking/proc_net_tcp.rst).
        assert_eq!(table_address("3500000A:0019"), Some("10.0.0.53:25".parse().unwrap()));
        let mapped = table_address("0000000000000000FFFF00000100007F:1BBD");
        assert_eq!(mapped, Some("127.0.0.1:7101".parse().unwrap()));
        assert_eq!(table_address("zz"), None);
    }

    #[test]
    fn a_connection_of_this_process_belongs_to_its_user() {
        use std::os::unix::fs::MetadataExt as _;
        for host in ["127.0.0.1:0", "[::1]:0"] {
            let Ok(listener) = TcpListener::bind(host) else { continue };
            let local = listener.local_addr().unwrap();
            let client = TcpStream::connect(local).unwrap();
            let peer = client.local_addr().unwrap();
            let own = std::fs::metadata("/proc/self").unwrap().uid();
            assert_eq!(user_of(peer, local), Some(own));
            drop(client);
            assert_eq!(user_of(peer, local), None, "a socket that its process has left is nobody's");
        }
    }

    #[test]
    fn a_role_may_do_what_is_its_own_and_an_admin_everything() {
        let peer = |identity| Peer { address: "10.0.0.1:1".parse().unwrap(), identity };
        for role in Role::ALL {
            let allowed = peer(Identity::Certified(role)).check(&[Role::Tuner]).is_ok();
            assert_eq!(allowed, matches!(role, Role::Tuner | Role::Admin), "{role}");
        }
        assert!(peer(Identity::Trusted).check(&[]).is_ok());
        for nobody in [Identity::Unknown, Identity::OtherUser(7)] {
            assert!(peer(nobody).check(&Role::ALL).is_err());
        }
    }

    #[test]
    fn a_node_that_others_could_reach_wants_credentials() {
        let on =
            |address: &str, insecure| Access::of(address.parse().unwrap(), None, insecure).map(|(access, _)| access);
        assert!(matches!(on("127.0.0.1:1", false), Ok(Access::SameUser)));
        assert!(matches!(on("[::1]:1", false), Ok(Access::SameUser)));
        assert!(matches!(on("0.0.0.0:1", true), Ok(Access::Anybody)));
        for open in ["0.0.0.0:1", "10.0.0.1:1", "[::]:1"] {
            let refused = on(open, false).unwrap_err().to_string();
            assert!(refused.contains("--credentials") && refused.contains("--insecure"), "{refused}");
        }
    }
}
