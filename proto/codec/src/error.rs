//! Errors of encoding and decoding, told apart by what the caller can do about them.

use lamina_model::Invalid;

/// Why a VDI or reduced volume could not be encoded or decoded.
#[derive(Debug, thiserror::Error)]
pub enum CodecError {
    /// The bytes begin with the magic of neither format.
    #[error(
        "not a VDI, nor a reduced volume: it begins neither with \"LVDI\" nor \"LVOL\"; check that this is the right file"
    )]
    NotAVdi,
    /// A later version of Lamina wrote the bytes.
    #[error("VDI format version {found} is newer than {newest}, the last one known here; update Lamina to read it")]
    NewerVersion {
        /// The version that the bytes state.
        found: u16,
        /// The newest version this program reads.
        newest: u16,
    },
    /// The bytes were cut short or changed in transit.
    #[error("damaged: {0}; fetch it again")]
    Damaged(String),
    /// The bytes are a reduced volume that was coded after another one.
    #[error("it is coded after the reduced volume with the checksum {checksum:08x}; decode that one before it")]
    NeedsReference {
        /// The CRC-32 that the other one's bytes end with.
        checksum: u32,
    },
    /// The decoded content would exceed the reader's limit.
    #[error("{needed_bytes} bytes decoded, limit {limit_bytes}; raise max_decoded_bytes to accept it")]
    TooLarge {
        /// Bytes that the decoded content would occupy.
        needed_bytes: u64,
        /// Bytes that the limits allow.
        limit_bytes: u64,
    },
    /// The bytes are intact (the checksum is right) but contradict themselves: the writer is at fault.
    #[error("invalid VDI, {0}; report this to whoever wrote it")]
    Invalid(#[from] Invalid),
    /// The chosen layout cannot represent a value.
    #[error("{0}; encode with Layout::Columns instead")]
    Unrepresentable(String),
    /// The byte compressor or the serializer of the header failed.
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

/// The error for intact content that contradicts itself.
pub(super) fn invalid(reason: impl Into<String>) -> CodecError {
    CodecError::Invalid(Invalid::new("vdi", reason))
}
