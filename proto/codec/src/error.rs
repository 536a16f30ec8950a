//! What can go wrong with an encoded VDI, told apart by what the caller can do about it.

use lamina_model::Invalid;

/// Why a VDI could not be encoded or decoded.
#[derive(Debug, thiserror::Error)]
pub enum CodecError {
    /// Something else was handed in.
    #[error(
        "not a VDI, nor a reduced volume: it begins neither with \"LVDI\" nor \"LVOL\"; check that this is the right file"
    )]
    NotAVdi,
    /// Written by a later program.
    #[error("VDI format version {found} is newer than {newest}, the last one known here; update Lamina to read it")]
    NewerVersion {
        /// The version it states.
        found: u16,
        /// The newest version this program reads.
        newest: u16,
    },
    /// Cut short or changed on its way.
    #[error("damaged: {0}; fetch it again")]
    Damaged(String),
    /// Larger than the reader allows.
    #[error("{needed_bytes} bytes decoded, limit {limit_bytes}; raise max_decoded_bytes to accept it")]
    TooLarge {
        /// What its lists would occupy.
        needed_bytes: u64,
        /// What the limits allow.
        limit_bytes: u64,
    },
    /// Intact (its checksum is right) but it contradicts itself: the writer is at fault.
    #[error("invalid VDI, {0}; report this to whoever wrote it")]
    Invalid(#[from] Invalid),
    /// A value the chosen layout has no room for.
    #[error("{0}; encode with Layout::Columns instead")]
    Unrepresentable(String),
    /// The compressor or the header's serialiser refused.
    #[error("compressing a VDI failed: {0}")]
    Compress(std::io::Error),
}

impl From<CodecError> for Invalid {
    fn from(error: CodecError) -> Self {
        match error {
            CodecError::Invalid(invalid) => invalid,
            other => Self::new("coding", other.to_string()),
        }
    }
}

/// The error for content that contradicts itself.
pub(super) fn invalid(reason: impl Into<String>) -> CodecError {
    CodecError::Invalid(Invalid::new("vdi", reason))
}
