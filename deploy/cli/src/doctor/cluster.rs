//! `lamina doctor --cluster`: whether the nodes of a cluster can be reached from here, and how.

use super::link::Link;
use crate::cli::ClusterNode;
use anyhow::bail;
use lamina_rpc::connect::{NodeAddress, connect};
use lamina_rpc::credentials::{Credentials, Role};
use std::net::{TcpStream, ToSocketAddrs};
use std::path::Path;
use std::time::{Duration, Instant};
use tokio::runtime::Runtime;

/// How long a host may take to answer.
const PATIENCE: Duration = Duration::from_secs(3);

/// Prints a line a node. Fails if one cannot be used.
pub(super) fn check(nodes: &[ClusterNode], credentials: Option<&Path>) -> anyhow::Result<()> {
    let folder = credentials.map(Path::to_owned).or_else(Credentials::folder_of_environment);
    let credentials = folder.map(Credentials::open).transpose()?;
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let mut unusable = 0;
    for ClusterNode { role, address } in nodes {
        match reach(*role, address, credentials.as_ref(), &runtime) {
            Ok(found) => say!("{role:10} {address}  {found}"),
            Err(reason) => {
                unusable += 1;
                say!("{role:10} {address}  UNUSABLE: {reason}");
            }
        }
    }
    if unusable > 0 {
        bail!("{unusable} of {} nodes cannot be used from here", nodes.len());
    }
    Ok(())
}

/// What is found of a node, or why it cannot be used and what to mend.
fn reach(role: Role, address: &str, credentials: Option<&Credentials>, runtime: &Runtime) -> Result<String, String> {
    let NodeAddress { host, port, secure } = NodeAddress::read("cluster", address).map_err(|e| e.to_string())?;
    let bare = host.trim_matches(['[', ']']);
    let known = (bare, port)
        .to_socket_addrs()
        .map_err(|e| format!("{host} has no address ({e}); name it in DNS or /etc/hosts"))?;
    let begun = Instant::now();
    let mut refusal = None;
    let open = known.into_iter().any(|place| match TcpStream::connect_timeout(&place, PATIENCE) {
        Ok(_) => true,
        Err(error) => {
            refusal = Some(format!("{place} does not answer ({error})"));
            false
        }
    });
    if !open {
        let why = refusal.unwrap_or_else(|| format!("{host} has no address"));
        return Err(format!(
            "{why}; is the {role} started with --listen 0.0.0.0:{port}, and the port open between the hosts?"
        ));
    }
    let connected = begun.elapsed();
    let link = runtime.block_on(async {
        let channel = connect(address, role, credentials).await.map_err(|reason| {
            let keys = if secure {
                "are both sides' keys of one `lamina keys`, and this node's those of its role?"
            } else {
                "has the node credentials? then it is https://"
            };
            format!("{reason}; {keys}")
        })?;
        Link::probe(channel).await
    })?;
    let tls = if secure { "TLS 1.3" } else { "no TLS" };
    Ok(format!("serves; {tls}, connected in {:.1} ms, {link}", connected.as_secs_f64() * 1e3))
}
