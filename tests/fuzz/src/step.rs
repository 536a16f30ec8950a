//! Recorded steps: VDIs in every layout and codec, reduced volumes. Checksums are made right, so that what is behind them is met.
#![no_main]

use lamina_codec::{DecodeLimits, decode_any};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    let mut bytes = data.to_vec();
    if bytes.len() > 8 {
        let body = bytes.len() - 4;
        let sum = crc32fast::hash(&bytes[..body]).to_le_bytes();
        bytes[body..].copy_from_slice(&sum);
    }
    let _ = decode_any(&bytes, &DecodeLimits { max_decoded_bytes: 1 << 20 });
});
