//! The VDI codec.
#![allow(missing_docs)]
use lamina_model::Vdi;
pub enum Codec {
    Bzip2,
    Zstd,
}
pub enum Layout {
    Columns,
    Plain,
}
pub struct EncodeOptions {
    pub codec: Codec,
    pub layout: Layout,
}
pub struct DecodeLimits {
    pub max_decoded_bytes: u64,
}
impl Default for DecodeLimits {
    fn default() -> Self {
        Self { max_decoded_bytes: 1 << 30 }
    }
}
#[derive(Debug, thiserror::Error)]
#[error("codec")]
pub struct CodecError;
pub fn encode(_: &Vdi, _: &EncodeOptions) -> Vec<u8> {
    Vec::new()
}
pub fn decode(_: &[u8], _: &DecodeLimits) -> Result<Vdi, CodecError> {
    Err(CodecError)
}
