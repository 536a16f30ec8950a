//! Values that might hurt: at and beyond bounds, not numbers, words with meaning elsewhere.

use fastrand::Rng;

/// Arbitrary values, the same for one seed.
pub(crate) struct Values(Rng);

const NUMBERS: [u64; 16] = [
    0,
    0,
    1,
    1,
    2,
    3,
    8,
    16,
    63,
    64,
    1 << 16,
    1 << 20,
    u32::MAX as u64,
    u32::MAX as u64 + 1,
    i64::MAX as u64,
    u64::MAX,
];
const REALS: [f64; 14] = [
    0.0,
    -0.0,
    0.02,
    0.5,
    1.0,
    30.0,
    -1.0,
    5e-324,
    1e-300,
    1e308,
    f64::NAN,
    f64::INFINITY,
    f64::NEG_INFINITY,
    f64::MIN_POSITIVE,
];
const WORDS: [&str; 18] = [
    "",
    "density",
    "newest",
    "0",
    "-1",
    "1e999",
    "../../etc/passwd",
    "%2e%2e%2f%00",
    "a\0b",
    "magnitude(curl(",
    "density / 0",
    "size <= 100kB",
    "psnr >= NaN",
    "http://127.0.0.1:1",
    "http://[::]:0",
    "<script>",
    "=1+1",
    "\u{202e}\u{1f4a5}",
];
const PATHS: [&str; 15] = [
    "/",
    "/api/state",
    "/api/trials",
    "/api/step/0",
    "/api/step/2",
    "/api/step/99999999999999999999",
    "/api/image",
    "/api/transfer",
    "/api/contract",
    "/api/steer",
    "/api/show",
    "/api/trigger",
    "/metrics",
    "/lamina.v1.Quality/Measure",
    "/../../etc/passwd",
];
const KEYS: [&str; 11] =
    ["step", "run", "alone", "azimuth", "elevation", "zoom", "size", "draft", "appearance", "token", "contract"];
const BODIES: [&str; 10] = [
    "",
    "{}",
    "null",
    "[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[",
    "{\"contract\":\"size <= 0kB\"}",
    "{\"contract\":\"maximise q - 1e308 * sigma ^ 9999\"}",
    "{\"field\":\"magnitude(\",\"camera\":{\"position\":[1e999,0,0]}}",
    "{\"set\":{\"name\":\"a\",\"when\":\"max > ((((((((((((((((((((((\",\"do\":[]}}",
    "{\"remove\":\"\\u0000\"}",
    "{\"request\":\"pause\",\"number\":{\"name\":\"cfl\",\"value\":1e999}}",
];

impl Values {
    pub(crate) fn new(seed: u64) -> Self {
        Self(Rng::with_seed(seed))
    }

    /// One of `choices`.
    pub(crate) fn of<T: Clone>(&mut self, choices: &[T]) -> T {
        choices[self.0.usize(..choices.len())].clone()
    }

    pub(crate) fn below(&mut self, end: usize) -> usize {
        self.0.usize(..end)
    }

    /// True once in `n` times.
    pub(crate) fn rarely(&mut self, n: usize) -> bool {
        self.below(n) == 0
    }

    pub(crate) fn number(&mut self) -> u64 {
        self.of(&NUMBERS)
    }

    pub(crate) fn small(&mut self) -> u32 {
        if self.rarely(8) { self.number() as u32 } else { self.0.u32(..4) }
    }

    pub(crate) fn real(&mut self) -> f64 {
        self.of(&REALS)
    }

    pub(crate) fn word(&mut self) -> String {
        if self.rarely(40) { "x".repeat(100_000) } else { self.of(&WORDS).to_owned() }
    }

    pub(crate) fn bytes(&mut self, most: usize) -> Vec<u8> {
        (0..self.below(most)).map(|_| self.0.u8(..)).collect()
    }

    /// A request of HTTP/1.1, more or less, and whether it ends before the length that it states.
    pub(crate) fn http_request(&mut self) -> (Vec<u8>, bool) {
        let method =
            self.of(&["GET", "GET", "GET", "POST", "POST", "PUT", "DELETE", "HEAD", "OPTIONS", "PRI", "G\u{e9}T"]);
        let mut target = self.of(&PATHS).to_owned();
        for n in 0..self.below(5) {
            let value = match self.below(4) {
                0 => self.number().to_string(),
                1 => self.real().to_string(),
                2 => self.word(),
                _ => self
                    .of(&[
                        "newest",
                        "0",
                        "2",
                        "true",
                        "64",
                        "128",
                        "{\"points\":[]}",
                        "{\"effects\":{\"isosurfaces\":[]}}",
                    ])
                    .to_owned(),
            };
            // Mostly as a browser would write it.
            let written =
                if self.rarely(6) { value } else { value.bytes().map(|byte| format!("%{byte:02x}")).collect() };
            target += &format!("{}{}={written}", if n == 0 { '?' } else { '&' }, self.of(&KEYS));
        }
        let body = if self.rarely(5) { self.bytes(300) } else { self.of(&BODIES).as_bytes().to_vec() };
        let length = if self.rarely(12) { self.number() } else { body.len() as u64 };
        let kind = self.of(&[
            "application/json",
            "application/json",
            "text/plain",
            "application/grpc",
            "application/grpc+proto",
        ]);
        let host = if self.rarely(15) { self.word() } else { "127.0.0.1".to_owned() };
        let mut request = format!(
            "{method} {target} HTTP/1.1\r\nHost: {host}\r\nContent-Type: {kind}\r\nContent-Length: {length}\r\n"
        );
        if self.rarely(10) {
            request += &format!("Cookie: lamina-session={}\r\nSec-Fetch-Site: {}\r\n", self.word(), self.word());
        }
        let mut request = (request + "\r\n").into_bytes();
        let is_short = length > body.len() as u64;
        request.extend(body);
        (request, is_short)
    }
}
