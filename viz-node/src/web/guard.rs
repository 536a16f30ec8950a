//! Who may see the page, and who may change the run from it: processes of the node's user, owners of a certificate, and browsers
//! that came in with a token.

use axum::Extension;
use axum::extract::{Request, State};
use axum::http::{HeaderMap, HeaderValue, StatusCode, Uri, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use lamina_model::Invalid;
use lamina_rpc::credentials::Role;
use lamina_rpc::daemon::{Identity, Peer, random};
use parking_lot::{Mutex, RwLock};
use std::collections::HashMap;
use std::net::IpAddr;
use std::sync::Arc;
use std::time::Duration;

/// The most browsers that are let in by a token; then the node has to be restarted.
const MOST_SESSIONS: usize = 1024;
/// The most of a refused request that is read.
const DRAINED: usize = 1 << 16;
/// The session's cookie.
const COOKIE: &str = "lamina-session";

/// What somebody may do at the page.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Rights {
    /// See it.
    Watch,
    /// Change the contract and steer the simulation, too.
    Steer,
}

/// Tokens and sessions.
struct Secrets {
    /// Let the next browser in, each to its rights.
    tokens: [(String, Rights); 2],
    sessions: HashMap<String, Rights>,
}

/// `hosts` and the names that this host has anyway, lower case.
fn with_own(hosts: &[String]) -> Vec<String> {
    let own = ["localhost".to_owned(), lamina_rpc::connect::host_name()];
    hosts.iter().cloned().chain(own).map(|host| host.to_ascii_lowercase()).collect()
}

/// Decides about requests to the page.
pub(crate) struct Guard {
    /// Names of this host that browsers may use, lower case. Others are of a site that has its name resolved to this address (DNS
    /// rebinding).
    hosts: RwLock<Vec<String>>,
    /// Address of the page without a path.
    origin: String,
    secrets: Mutex<Secrets>,
}

impl Guard {
    /// For a page at `origin` that is also reached by the names `hosts`.
    ///
    /// # Errors
    /// If the system gives no random numbers.
    pub(crate) fn new(origin: String, hosts: &[String]) -> Result<Self, Invalid> {
        let hosts = RwLock::new(with_own(hosts));
        let tokens = [(random()?, Rights::Watch), (random()?, Rights::Steer)];
        Ok(Self { hosts, origin, secrets: Mutex::new(Secrets { tokens, sessions: HashMap::new() }) })
    }

    /// Other names than before.
    pub(crate) fn set_hosts(&self, hosts: &[String]) {
        *self.hosts.write() = with_own(hosts);
    }

    /// Where the next browser comes in to `rights`, once.
    pub(crate) fn entrance(&self, rights: Rights) -> String {
        let secrets = self.secrets.lock();
        let token = secrets.tokens.iter().find(|(_, of)| *of == rights).map_or("", |(token, _)| token);
        format!("{}/?token={token}", self.origin)
    }

    fn knows_host(&self, headers: &HeaderMap, uri: &Uri) -> bool {
        let stated = headers.get(header::HOST).and_then(|host| host.to_str().ok());
        let Some(authority) = stated.or_else(|| uri.authority().map(|a| a.as_str())) else { return false };
        let Ok(authority) = authority.parse::<axum::http::uri::Authority>() else { return false };
        let host = authority.host().trim_start_matches('[').trim_end_matches(']').to_ascii_lowercase();
        host.parse::<IpAddr>().is_ok() || self.hosts.read().contains(&host)
    }

    fn session(&self, headers: &HeaderMap) -> Option<Rights> {
        let cookies = headers.get_all(header::COOKIE).iter().filter_map(|value| value.to_str().ok());
        let mut pairs = cookies.flat_map(|value| value.split(';')).filter_map(|pair| pair.trim().split_once('='));
        pairs.find_map(|(name, value)| self.secrets.lock().sessions.get(value).copied().filter(|_| name == COOKIE))
    }

    /// Lets a browser in that shows the token, which nobody can use again.
    fn enter(&self, uri: &Uri) -> Option<Response> {
        let token = uri.query()?.split('&').find_map(|pair| pair.strip_prefix("token="))?;
        let (session, next) = (random().ok()?, random().ok()?);
        let rights = {
            let mut secrets = self.secrets.lock();
            let full = secrets.sessions.len() >= MOST_SESSIONS;
            let (known, rights) = secrets.tokens.iter_mut().find(|(known, _)| token == known).filter(|_| !full)?;
            *known = next;
            let rights = *rights;
            secrets.sessions.insert(session.clone(), rights);
            rights
        };
        tracing::info!(?rights, "a browser has entered; another may at {}", self.entrance(rights));
        let secure = if self.origin.starts_with("https") { "; Secure" } else { "" };
        let cookie = HeaderValue::from_str(&format!("{COOKIE}={session}; Path=/; HttpOnly; SameSite=Strict{secure}"));
        // Not a redirection: browsers do not send a strict cookie along one that another site has begun.
        let mut response = "welcome\n".into_response();
        response.headers_mut().insert(header::SET_COOKIE, cookie.ok()?);
        response.headers_mut().insert(header::REFRESH, HeaderValue::from_static("0; url=/"));
        response.headers_mut().insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
        Some(response)
    }

    /// What the sender of a request may do.
    ///
    /// # Errors
    /// With what it gets instead of an answer.
    #[expect(clippy::result_large_err, reason = "it is the answer")]
    fn admit(&self, peer: Peer, headers: &HeaderMap, uri: &Uri) -> Result<Rights, Response> {
        let refuse = |status: StatusCode, words: String| Err((status, words + "\n").into_response());
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
            return match (self.session(headers), self.enter(uri)) {
                (Some(rights), _) => Ok(rights),
                (None, Some(welcome)) => Err(welcome),
                (None, None) => refuse(StatusCode::UNAUTHORIZED, words.to_owned()),
            };
        }
        match peer.check(&[Role::Viewer]) {
            Ok(()) if peer.identity == Identity::Certified(Role::Viewer) => Ok(Rights::Watch),
            Ok(()) => Ok(Rights::Steer),
            Err(reason) => refuse(StatusCode::FORBIDDEN, reason),
        }
    }
}

/// Lets requests through that [`Guard`] allows.
pub(crate) async fn guard(
    State(guard): State<Arc<Guard>>,
    Extension(peer): Extension<Peer>,
    mut request: Request,
    next: Next,
) -> Response {
    match guard.admit(peer, request.headers(), request.uri()) {
        Ok(rights) => request.extensions_mut().insert(rights),
        Err(refusal) => {
            // A client that is still sending would take the end of the stream for a fault.
            let drained = axum::body::to_bytes(request.into_body(), DRAINED);
            let _ = tokio::time::timeout(Duration::from_secs(1), drained).await;
            return refusal;
        }
    };
    next.run(request).await
}

#[cfg(test)]
mod tests {
    use super::*;

    fn status(guard: &Guard, identity: Identity, uri: &str, headers: &[(&'static str, &str)]) -> Result<Rights, u16> {
        let peer = Peer { address: "10.0.0.9:1".parse().unwrap(), identity };
        let headers = headers.iter().map(|(name, value)| ((*name).parse().unwrap(), value.parse().unwrap())).collect();
        guard.admit(peer, &headers, &uri.parse().unwrap()).map_err(|response| response.status().as_u16())
    }

    #[test]
    fn names_that_are_not_this_hosts_and_other_sites_are_refused() {
        let guard = Guard::new("http://127.0.0.1:7102".to_owned(), &["viz.example.org".to_owned()]).unwrap();
        let ask = |headers: &[(&'static str, &str)]| status(&guard, Identity::Trusted, "/api/state", headers);
        for host in ["127.0.0.1:7102", "localhost:9", "[::1]:7102", "LOCALHOST", "viz.example.org", "192.168.0.4:80"] {
            assert_eq!(ask(&[("host", host)]), Ok(Rights::Steer), "{host}");
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
        assert_eq!(from("cross-site", "navigate", "/"), Ok(Rights::Steer), "a link to the page");
        assert_eq!(from("same-origin", "cors", "/api/state"), Ok(Rights::Steer));
    }

    #[test]
    fn a_token_lets_one_browser_in_to_its_rights() {
        let guard = Guard::new("https://viz:7102".to_owned(), &[]).unwrap();
        let unknown = |uri: &str, cookie: &str| {
            status(&guard, Identity::Unknown, uri, &[("host", "localhost"), ("cookie", cookie)])
        };
        assert_eq!(unknown("/api/state", ""), Err(401));
        assert_eq!(unknown("/?token=guess", ""), Err(401));
        for rights in [Rights::Watch, Rights::Steer] {
            let entrance = guard.entrance(rights).strip_prefix("https://viz:7102").unwrap().to_owned();
            let peer = Peer { address: "10.0.0.9:1".parse().unwrap(), identity: Identity::Unknown };
            let headers = [(header::HOST, HeaderValue::from_static("localhost"))].into_iter().collect();
            let entered = guard.admit(peer, &headers, &entrance.parse().unwrap()).unwrap_err();
            assert_eq!(entered.status(), 200);
            let cookie = entered.headers()[header::SET_COOKIE].to_str().unwrap().to_owned();
            for flag in ["HttpOnly", "SameSite=Strict", "Secure"] {
                assert!(cookie.contains(flag), "{cookie}");
            }
            let session = cookie.split(';').next().unwrap();
            assert_eq!(unknown("/api/state", session), Ok(rights));
            assert_eq!(unknown("/api/state", &format!("other=1; {session}")), Ok(rights));
            assert_eq!(unknown(&entrance, ""), Err(401), "a token is used up");
            assert_eq!(unknown("/api/state", &format!("{session}0")), Err(401));
        }
    }

    #[test]
    fn a_viewers_certificate_serves_and_a_simulations_does_not() {
        let guard = Guard::new("https://viz:7102".to_owned(), &[]).unwrap();
        let as_role = |role| status(&guard, Identity::Certified(role), "/metrics", &[("host", "localhost")]);
        assert_eq!((as_role(Role::Viewer), as_role(Role::Admin)), (Ok(Rights::Watch), Ok(Rights::Steer)));
        assert_eq!((as_role(Role::Simulation), as_role(Role::Tuner)), (Err(403), Err(403)));
        assert_eq!(status(&guard, Identity::OtherUser(7), "/", &[("host", "localhost")]), Err(403));
    }
}
