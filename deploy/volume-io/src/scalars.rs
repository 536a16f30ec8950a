//! Scalars as files store them, of any width and byte order, and the voxels they become without loss.

use crate::ascii::Words;
use crate::error::invalid;
use half::f16;
use lamina_model::Voxels;
use std::io::{self, BufRead, Read};

/// Bytes decoded at a time: small beside a volume, large beside a call.
const CHUNK_BYTES: usize = 1 << 16;

/// Deflate never shrinks to less than a 1032nd, so a longer promise is a lie told before memory is set aside.
const DEFLATE_MAX_RATIO: u64 = 1032;

/// True if `packed` bytes can unpack to `want`.
pub(crate) fn can_inflate(packed: u64, want: u64) -> bool {
    want <= packed.saturating_mul(DEFLATE_MAX_RATIO)
}

/// Order of the bytes of one scalar.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum ByteOrder {
    Little,
    Big,
}

/// The type of a scalar in a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum ScalarType {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F16,
    F32,
    F64,
}

/// Runs `$body` with `$T` naming the Rust type of `$scalar`.
macro_rules! with_type {
    ($scalar:expr, $T:ident => $body:expr) => {
        match $scalar {
            ScalarType::I8 => with_type!(@ $T i8 $body),
            ScalarType::U8 => with_type!(@ $T u8 $body),
            ScalarType::I16 => with_type!(@ $T i16 $body),
            ScalarType::U16 => with_type!(@ $T u16 $body),
            ScalarType::I32 => with_type!(@ $T i32 $body),
            ScalarType::U32 => with_type!(@ $T u32 $body),
            ScalarType::I64 => with_type!(@ $T i64 $body),
            ScalarType::U64 => with_type!(@ $T u64 $body),
            ScalarType::F16 => with_type!(@ $T f16 $body),
            ScalarType::F32 => with_type!(@ $T f32 $body),
            ScalarType::F64 => with_type!(@ $T f64 $body),
        }
    };
    (@ $T:ident $t:ident $body:expr) => {{
        type $T = $t;
        $body
    }};
}

impl ScalarType {
    pub(crate) fn size_bytes(self) -> u64 {
        with_type!(self, T => size_of::<T>() as u64)
    }

    /// Takes exactly `count` scalars from `source`. The caller has made sure that `count` is not a lie.
    pub(crate) fn decode(self, source: &mut dyn Read, order: ByteOrder, count: usize) -> io::Result<Voxels> {
        with_type!(self, T => decode::<T>(source, order, count))
    }

    /// Room for `count` values, all of them `fill`, of which the caller has made sure that they fit into memory.
    pub(crate) fn filled(self, count: usize, fill: f64) -> io::Result<Voxels> {
        with_type!(self, T => {
            let mut kept = room_for(count)?;
            kept.resize(count, T::of_f64(fill));
            Ok(T::voxels(kept))
        })
    }

    /// Decodes `bytes` into the values from place `at` on. `voxels` are of the kind that this type is kept as.
    pub(crate) fn decode_at(self, voxels: &mut Voxels, at: usize, bytes: &[u8], order: ByteOrder) -> io::Result<()> {
        with_type!(self, T => {
            let Some(kept) = T::kept(voxels) else { return Err(invalid("values of another type")) };
            for (kept, scalar) in kept[at..].iter_mut().zip(bytes.chunks_exact(size_of::<T>())) {
                *kept = exactly(T::of_bytes(scalar, order))?;
            }
            Ok(())
        })
    }

    /// Takes exactly `count` scalars written as words. The caller has made sure that `count` is not a lie.
    pub(crate) fn parse(self, text: &mut dyn BufRead, count: usize) -> io::Result<Voxels> {
        with_type!(self, T => parse::<T>(text, count))
    }
}

/// One scalar in a file, and what a volume keeps of it.
trait Stored: Copy + std::str::FromStr + std::fmt::Display {
    type Kept: Clone;
    /// `bytes` are as many as the type has.
    fn of_bytes(bytes: &[u8], order: ByteOrder) -> Self;
    /// The kept value, if it is the same number.
    fn keep(self) -> Option<Self::Kept>;
    fn voxels(kept: Vec<Self::Kept>) -> Voxels;
    /// The values of voxels that keep this type.
    fn kept(voxels: &mut Voxels) -> Option<&mut [Self::Kept]>;
    /// The nearest value to a number.
    fn of_f64(value: f64) -> Self::Kept;
}

/// A number of a type, the nearest to `$value`.
macro_rules! nearest {
    (f16, $value:ident) => {
        f16::from_f64($value)
    };
    ($T:ident, $value:ident) => {
        $value as $T
    };
}

/// `stored => kept`, the voxels that hold it, and how one becomes the other.
macro_rules! stored {
    ($($stored:ident => $kept:ident, $voxels:ident, $keep:expr;)*) => {$(
        impl Stored for $stored {
            type Kept = $kept;
            fn of_bytes(bytes: &[u8], order: ByteOrder) -> Self {
                let mut own = [0; size_of::<$stored>()];
                own.copy_from_slice(bytes);
                match order {
                    ByteOrder::Little => Self::from_le_bytes(own),
                    ByteOrder::Big => Self::from_be_bytes(own),
                }
            }
            fn keep(self) -> Option<$kept> {
                let keep: fn($stored) -> Option<$kept> = $keep;
                keep(self)
            }
            fn voxels(kept: Vec<$kept>) -> Voxels {
                Voxels::$voxels(kept)
            }
            fn kept(voxels: &mut Voxels) -> Option<&mut [$kept]> {
                match voxels {
                    Voxels::$voxels(kept) => Some(kept),
                    _ => None,
                }
            }
            fn of_f64(value: f64) -> $kept {
                nearest!($kept, value)
            }
        }
    )*};
}

stored! {
    i8 => i16, I16, |v| Some(v.into());
    u8 => u8, U8, Some;
    i16 => i16, I16, Some;
    u16 => u16, U16, Some;
    i32 => f64, F64, |v| Some(v.into());
    u32 => f64, F64, |v| Some(v.into());
    i64 => f64, F64, |v| (v.unsigned_abs() <= EXACT_IN_F64 || v == i64::MIN).then_some(v as f64);
    u64 => f64, F64, |v| (v <= EXACT_IN_F64).then_some(v as f64);
    f16 => f16, F16, Some;
    f32 => f32, F32, Some;
    f64 => f64, F64, Some;
}

/// Every whole number up to here has a double of its own.
const EXACT_IN_F64: u64 = 1 << 53;

fn decode<T: Stored>(source: &mut dyn Read, order: ByteOrder, count: usize) -> io::Result<Voxels> {
    let size = size_of::<T>();
    let mut kept = room_for(count)?;
    let mut chunk = vec![0u8; CHUNK_BYTES.min(count * size)];
    while kept.len() < count {
        let bytes = CHUNK_BYTES.min((count - kept.len()) * size);
        source.read_exact(&mut chunk[..bytes])?;
        for scalar in chunk[..bytes].chunks_exact(size) {
            kept.push(exactly(T::of_bytes(scalar, order))?);
        }
    }
    Ok(T::voxels(kept))
}

fn parse<T: Stored>(text: &mut dyn BufRead, count: usize) -> io::Result<Voxels> {
    let mut kept = room_for(count)?;
    let mut words = Words::of(text);
    while kept.len() < count {
        let word = words.next()?.ok_or_else(|| invalid(format!("{} of {count} values are there", kept.len())))?;
        let value: T = word.parse().map_err(|_| invalid(format!("\"{word}\" is no value of the array's type")))?;
        kept.push(exactly(value)?);
    }
    if let Some(word) = words.next()? {
        return Err(invalid(format!("\"{word}\" follows the last of {count} values")));
    }
    Ok(T::voxels(kept))
}

fn exactly<T: Stored>(value: T) -> io::Result<T::Kept> {
    value.keep().ok_or_else(|| invalid(format!("the value {value} has no double of its own")))
}

/// An honest volume may still be larger than the memory: that is an error, not the end of the process.
fn room_for<T>(count: usize) -> io::Result<Vec<T>> {
    let mut room = Vec::new();
    room.try_reserve_exact(count).map_err(|e| io::Error::new(io::ErrorKind::OutOfMemory, e))?;
    Ok(room)
}
