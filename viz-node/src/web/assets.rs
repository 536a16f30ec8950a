//! The viewer's files, built from `viz-node/viewer` and part of this binary, and the headers that every answer of the page carries.

use axum::http::{HeaderValue, header};
use axum::response::Response;
use axum::{Router, routing::get};

/// What the page may do: run its own code and WebAssembly, and ask nobody but this server.
const POLICY: &str = "default-src 'self'; script-src 'self' 'wasm-unsafe-eval'; style-src 'self'; img-src 'self' data: blob:; \
    worker-src 'self'; connect-src 'self'; object-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// The script that turns a step inside a document: classic, for elements `turntable` (a canvas), `lamina-engine` ([`ENGINE`]) and
/// `lamina-step` (the encoded step), both in base64.
pub const EMBED: &str = include_str!("../../viewer/dist/embed.js");
/// The engine that it calls: WebAssembly, compressed by gzip.
pub const ENGINE: &[u8] = include_bytes!("../../viewer/dist/engine.wasm.gz");

/// A file of the viewer.
struct Asset {
    path: &'static str,
    mime: &'static str,
    bytes: &'static [u8],
    /// Compressed by gzip as it is.
    packed: bool,
}

macro_rules! asset {
    ($path:literal, $file:literal, $mime:literal, $packed:literal) => {
        Asset { path: $path, mime: $mime, bytes: include_bytes!(concat!("../../viewer/dist/", $file)), packed: $packed }
    };
}

const ASSETS: [Asset; 7] = [
    asset!("/", "index.html", "text/html; charset=utf-8", false),
    asset!("/icon.svg", "icon.svg", "image/svg+xml", false),
    asset!("/viewer.css", "viewer.css", "text/css; charset=utf-8", false),
    asset!("/viewer.js", "viewer.js", "text/javascript; charset=utf-8", false),
    asset!("/draft_size.js", "draft_size.js", "text/javascript; charset=utf-8", false),
    asset!("/worker.js", "worker.js", "text/javascript; charset=utf-8", false),
    // Every browser with WebAssembly unpacks gzip.
    asset!("/engine.wasm", "engine.wasm.gz", "application/wasm", true),
];

/// A route for each file.
pub(super) fn router<S: Clone + Send + Sync + 'static>() -> Router<S> {
    ASSETS.into_iter().fold(Router::new(), |router, Asset { path, mime, bytes, packed }| {
        let answer = move || async move {
            let mut response = Response::new(axum::body::Body::from(bytes));
            let headers = response.headers_mut();
            headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(mime));
            // Another version of this binary may answer next time.
            headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-cache"));
            if packed {
                headers.insert(header::CONTENT_ENCODING, HeaderValue::from_static("gzip"));
            }
            response
        };
        router.route(path, get(answer))
    })
}

/// Adds the headers by which a browser guards the page.
pub(super) async fn guarded(mut response: Response) -> Response {
    let headers = response.headers_mut();
    headers.insert(header::CONTENT_SECURITY_POLICY, HeaderValue::from_static(POLICY));
    headers.insert(header::X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));
    headers.insert(header::REFERRER_POLICY, HeaderValue::from_static("no-referrer"));
    response
}
