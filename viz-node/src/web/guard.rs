//! Who may see the page: processes of the node's user, owners of a certificate, and browsers that came in with the token.

use axum::extract::{ConnectInfo, Request, State};
use axum::http::{HeaderMap, HeaderValue, StatusCode, Uri, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use lamina_model::Invalid;
use lamina_rpc::credentials::Role;
use lamina_rpc::daemon::{Connections, Identity, Peer, random};
use parking_lot::Mutex;
use std::collections::HashSet;
use std::net::IpAddr;
use std::sync::Arc;

/// The most browsers that are let in by a token; then the node has to be restarted.
const MOST_SESSIONS: usize = 1024;
/// The session's cookie.
const COOKIE: &str = "lamina-session";

/// Decides about requests to the page.
pub(crate) struct Guard {
    /// Names of this host that browsers may use, lower case. Others are of a site that has its name resolved to this address (DNS
    /// rebinding).
    hosts: Vec<String>,
    /// Address of the page without a path.
    origin: String,
    /// The next token that lets a browser in, and the sessions of those that are.
    secrets: Mutex<(String, HashSet<String>)>,
}

impl Guard {
    /// For a page at `origin` that is also reached by the names `hosts`.
    ///
    /// # Errors
    /// If the system gives no random numbers.
    pub(crate) fn new(origin: String, hosts: &[String]) -> Result<Self, Invalid> {
        let own = ["localhost".to_owned(), lamina_rpc::connect::host_name()];
        let hosts = hosts.iter().cloned().chain(own).map(|host| host.to_ascii_lowercase()).collect();
        Ok(Self { hosts, origin, secrets: Mutex::new((random()?, HashSet::new())) })
    }

    /// Where a browser comes in, once.
    pub(crate) fn entrance(&self) -> String {
        format!("{}/?token={}", self.origin, self.secrets.lock().0)
    }

    fn knows_host(&self, headers: &HeaderMap, uri: &Uri) -> bool {
        let stated = headers.get(header::HOST).and_then(|host| host.to_str().ok());
        let Some(authority) = stated.or_else(|| uri.authority().map(|a| a.as_str())) else { return false };
        let Ok(authority) = authority.parse::<axum::http::uri::Authority>() else { return false };
        let host = authority.host().trim_start_matches('[').trim_end_matches(']').to_ascii_lowercase();
        host.parse::<IpAddr>().is_ok() || self.hosts.contains(&host)
    }

    fn has_session(&self, headers: &HeaderMap) -> bool {
        let cookies = headers.get_all(header::COOKIE).iter().filter_map(|value| value.to_str().ok());
        let mut pairs = cookies.flat_map(|value| value.split(';')).filter_map(|pair| pair.trim().split_once('='));
        pairs.any(|(name, value)| name == COOKIE && self.secrets.lock().1.contains(value))
    }

    /// Lets a browser in that shows the token, which nobody can use again.
    fn enter(&self, uri: &Uri) -> Option<Response> {
        let token = uri.query()?.split('&').find_map(|pair| pair.strip_prefix("token="))?;
        let (session, next) = (random().ok()?, random().ok()?);
        {
            let mut secrets = self.secrets.lock();
            if token != secrets.0 || secrets.1.len() >= MOST_SESSIONS {
                return None;
            }
            secrets.0 = next;
            secrets.1.insert(session.clone());
        }
        tracing::info!("a browser has entered; another may at {}", self.entrance());
        let secure = if self.origin.starts_with("https") { "; Secure" } else { "" };
        let cookie = HeaderValue::from_str(&format!("{COOKIE}={session}; Path=/; HttpOnly; SameSite=Strict{secure}"));
        // Not a redirection: browsers do not send a strict cookie along one that another site has begun.
        let mut response = "welcome\n".into_response();
        response.headers_mut().insert(header::SET_COOKIE, cookie.ok()?);
        response.headers_mut().insert(header::REFRESH, HeaderValue::from_static("0; url=/"));
        response.headers_mut().insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
        Some(response)
    }

    /// What a request gets instead of an answer, if it is not to get one.
    fn refusal(&self, peer: Peer, headers: &HeaderMap, uri: &Uri) -> Option<Response> {
        let refuse = |status: StatusCode, words: String| Some((status, words + "\n").into_response());
        if !self.knows_host(headers, uri) {
            let words = "this host has no such name; add it to `hosts` in the viz-node's configuration";
            return refuse(StatusCode::MISDIRECTED_REQUEST, words.to_owned());
        }
        let site = headers.get("sec-fetch-site").and_then(|site| site.to_str().ok());
        let navigates = headers.get("sec-fetch-mode").is_some_and(|mode| mode == "navigate") && uri.path() == "/";
        if matches!(site, Some("cross-site" | "same-site")) && !navigates {
            return refuse(StatusCode::FORBIDDEN, "asked for by another site".to_owned());
        }
        if peer.identity == Identity::Unknown {
            let words = "open the address with the token that the viz-node printed; each token lets in one browser";
            let enter = || self.enter(uri).or_else(|| refuse(StatusCode::UNAUTHORIZED, words.to_owned()));
            return if self.has_session(headers) { None } else { enter() };
        }
        peer.check(&[Role::Viewer]).err().and_then(|reason| refuse(StatusCode::FORBIDDEN, reason))
    }
}

/// Lets requests for the page through that [`Guard`] allows; calls of gRPC are checked by their services.
pub(crate) async fn guard(
    State(guard): State<Arc<Guard>>,
    ConnectInfo(PagePeer(peer)): ConnectInfo<PagePeer>,
    mut request: Request,
    next: Next,
) -> Response {
    request.extensions_mut().insert(peer);
    let kind = request.headers().get(header::CONTENT_TYPE).and_then(|kind| kind.to_str().ok());
    let is_grpc = kind.is_some_and(|kind| kind.starts_with("application/grpc"));
    let refusal = if is_grpc { None } else { guard.refusal(peer, request.headers(), request.uri()) };
    match refusal {
        Some(refusal) => refusal,
        None => next.run(request).await,
    }
}

/// The other end of a connection, as the page's server hands it to requests.
#[derive(Clone, Copy)]
pub(crate) struct PagePeer(Peer);

/// Connections for the page's server.
pub(crate) struct PageListener(pub Connections);

impl axum::serve::Listener for PageListener {
    type Io = lamina_rpc::daemon::Connection;
    type Addr = Peer;

    async fn accept(&mut self) -> (Self::Io, Peer) {
        let connection = self.0.next().await;
        let peer = connection.peer();
        (connection, peer)
    }

    fn local_addr(&self) -> std::io::Result<Peer> {
        Ok(Peer { address: self.0.address(), identity: Identity::Trusted })
    }
}

impl axum::extract::connect_info::Connected<axum::serve::IncomingStream<'_, PageListener>> for PagePeer {
    fn connect_info(stream: axum::serve::IncomingStream<'_, PageListener>) -> Self {
        Self(*stream.remote_addr())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn status(guard: &Guard, identity: Identity, uri: &str, headers: &[(&'static str, &str)]) -> Result<(), u16> {
        let peer = Peer { address: "10.0.0.9:1".parse().unwrap(), identity };
        let headers = headers.iter().map(|(name, value)| ((*name).parse().unwrap(), value.parse().unwrap())).collect();
        guard.refusal(peer, &headers, &uri.parse().unwrap()).map_or(Ok(()), |response| Err(response.status().as_u16()))
    }

    #[test]
    fn names_that_are_not_this_hosts_and_other_sites_are_refused() {
        let guard = Guard::new("http://127.0.0.1:7102".to_owned(), &["viz.example.org".to_owned()]).unwrap();
        let ask = |headers: &[(&'static str, &str)]| status(&guard, Identity::Trusted, "/api/state", headers);
        for host in ["127.0.0.1:7102", "localhost:9", "[::1]:7102", "LOCALHOST", "viz.example.org", "192.168.0.4:80"] {
            assert_eq!(ask(&[("host", host)]), Ok(()), "{host}");
        }
        for host in ["evil.example:7102", "127.0.0.1.evil.example", "", "localhost.evil.example:7102"] {
            assert_eq!(ask(&[("host", host)]), Err(421), "{host}");
        }
        assert_eq!(ask(&[]), Err(421));
        let from = |site, mode, uri| {
            let headers = [("host", "localhost"), ("sec-fetch-site", site), ("sec-fetch-mode", mode)];
            status(&guard, Identity::Trusted, uri, &headers)
        };
        assert_eq!(from("cross-site", "no-cors", "/api/image?step=newest"), Err(403));
        assert_eq!(from("same-site", "cors", "/api/state"), Err(403));
        assert_eq!(from("cross-site", "navigate", "/api/state"), Err(403));
        assert_eq!(from("cross-site", "navigate", "/"), Ok(()), "a link to the page");
        assert_eq!(from("same-origin", "cors", "/api/state"), Ok(()));
    }

    #[test]
    fn a_token_lets_one_browser_in() {
        let guard = Guard::new("https://viz:7102".to_owned(), &[]).unwrap();
        let unknown = |uri: &str, cookie: &str| {
            status(&guard, Identity::Unknown, uri, &[("host", "localhost"), ("cookie", cookie)])
        };
        assert_eq!(unknown("/api/state", ""), Err(401));
        assert_eq!(unknown("/?token=guess", ""), Err(401));
        let entrance = guard.entrance().strip_prefix("https://viz:7102").unwrap().to_owned();
        let peer = Peer { address: "10.0.0.9:1".parse().unwrap(), identity: Identity::Unknown };
        let headers = [(header::HOST, HeaderValue::from_static("localhost"))].into_iter().collect();
        let entered = guard.refusal(peer, &headers, &entrance.parse().unwrap()).unwrap();
        assert_eq!(entered.status(), 200);
        let cookie = entered.headers()[header::SET_COOKIE].to_str().unwrap().to_owned();
        for flag in ["HttpOnly", "SameSite=Strict", "Secure"] {
            assert!(cookie.contains(flag), "{cookie}");
        }
        let session = cookie.split(';').next().unwrap();
        assert_eq!(unknown("/api/state", session), Ok(()));
        assert_eq!(unknown("/api/state", &format!("other=1; {session}")), Ok(()));
        assert_eq!(unknown(&entrance, ""), Err(401), "a token is used up");
        assert_eq!(unknown("/api/state", &format!("{session}0")), Err(401));
    }

    #[test]
    fn a_viewers_certificate_serves_and_a_simulations_does_not() {
        let guard = Guard::new("https://viz:7102".to_owned(), &[]).unwrap();
        let as_role = |role| status(&guard, Identity::Certified(role), "/metrics", &[("host", "localhost")]);
        assert_eq!((as_role(Role::Viewer), as_role(Role::Admin)), (Ok(()), Ok(())));
        assert_eq!((as_role(Role::Simulation), as_role(Role::Tuner)), (Err(403), Err(403)));
        assert_eq!(status(&guard, Identity::OtherUser(7), "/", &[("host", "localhost")]), Err(403));
    }
}
