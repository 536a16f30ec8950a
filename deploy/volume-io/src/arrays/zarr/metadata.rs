//! What a store says of its arrays: `.zarray` and `.zattrs` of version 2, `zarr.json` of version 3.

use super::codecs::{ChunkCodec, CodecChain};
use crate::ReadError;
use crate::scalars::{ByteOrder, ScalarType};
use base64::prelude::{BASE64_STANDARD, Engine};
use serde_json::{Map, Value};
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// The longest metadata that is read, bytes.
const LONGEST: u64 = 64 << 20;

/// Axes of an array, at most.
const MOST_AXES: usize = 16;

/// What a folder of a store is.
pub(super) enum StoreNode {
    Group(Map<String, Value>),
    Array(Box<ZarrArray>),
}

/// An array whose metadata is understood.
#[derive(Debug, Clone)]
pub(super) struct ZarrArray {
    pub(super) folder: PathBuf,
    pub(super) shape: Vec<usize>,
    pub(super) chunk: Vec<usize>,
    pub(super) scalar: ScalarType,
    pub(super) fill: f64,
    pub(super) codecs: CodecChain,
    /// Before the first index in a chunk's name, and between indices.
    pub(super) prefix: &'static str,
    pub(super) separator: char,
    /// Names of the axes.
    pub(super) axes: Option<Vec<String>>,
    pub(super) attributes: Map<String, Value>,
}

/// A number as metadata writes it: infinities and NaN are words, and so are the bits of a number.
pub(super) fn number(value: &Value) -> Option<f64> {
    match value {
        Value::Number(number) => number.as_f64(),
        Value::Bool(is_true) => Some(f64::from(*is_true)),
        Value::String(word) => match (word.as_str(), word.strip_prefix("0x")) {
            ("NaN", _) => Some(f64::NAN),
            ("Infinity", _) => Some(f64::INFINITY),
            ("-Infinity", _) => Some(f64::NEG_INFINITY),
            (_, Some(bits)) if bits.len() == 16 => u64::from_str_radix(bits, 16).ok().map(f64::from_bits),
            (_, Some(bits)) if bits.len() == 8 => {
                u32::from_str_radix(bits, 16).ok().map(|bits| f64::from(f32::from_bits(bits)))
            }
            _ => None,
        },
        _ => None,
    }
}

/// A number as xarray writes `_FillValue` of floats into stores of version 3: the bytes of a double, in base 64.
pub(super) fn packed_double(word: &str) -> Option<f64> {
    let bytes = BASE64_STANDARD.decode(word).ok()?;
    bytes.try_into().ok().map(f64::from_le_bytes).or_else(|| number(&Value::String(word.to_owned())))
}

/// What stands where there is no chunk: 0, if nothing is stated.
fn fill(path: &Path, meta: &Map<String, Value>) -> Result<f64, ReadError> {
    match meta.get("fill_value") {
        None | Some(Value::Null) => Ok(0.0),
        Some(value) => number(value).ok_or_else(|| unknown(path, &format!("the fill value {value}"))),
    }
}

/// A JSON file, if it is there.
fn json(path: &Path) -> Result<Option<Map<String, Value>>, ReadError> {
    let system = |e| ReadError::while_reading(path, e);
    match fs::metadata(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(system(error)),
        Ok(of) if of.len() > LONGEST => {
            return Err(ReadError::damaged(path, format!("metadata of {} bytes", of.len())));
        }
        Ok(_) => (),
    }
    let text = fs::read(path).map_err(system)?;
    serde_json::from_slice(&text).map(Some).map_err(|error| ReadError::damaged(path, format!("JSON: {error}")))
}

impl StoreNode {
    /// What lies in `folder`, if it belongs to a store.
    pub(super) fn read(folder: &Path) -> Result<Option<Self>, ReadError> {
        let third = folder.join("zarr.json");
        if let Some(meta) = json(&third)? {
            let attributes = meta.get("attributes").and_then(Value::as_object).cloned().unwrap_or_default();
            return Ok(Some(match meta.get("node_type").and_then(Value::as_str) {
                Some("array") => Self::Array(Box::new(Version3(&third, &meta).array(folder, attributes)?)),
                Some("group") => Self::Group(attributes),
                _ => return Err(ReadError::damaged(&third, "its node_type is neither array nor group")),
            }));
        }
        let attributes = json(&folder.join(".zattrs"))?.unwrap_or_default();
        let second = folder.join(".zarray");
        if let Some(meta) = json(&second)? {
            return Ok(Some(Self::Array(Box::new(Version2(&second, &meta).array(folder, attributes)?))));
        }
        Ok(json(&folder.join(".zgroup"))?.map(|_| Self::Group(attributes)))
    }
}

/// Whole numbers of a list, as many as there are axes.
fn lengths(path: &Path, name: &str, value: Option<&Value>, axes: Option<usize>) -> Result<Vec<usize>, ReadError> {
    let of = |value: &Value| value.as_u64().and_then(|n| usize::try_from(n).ok());
    let list: Option<Vec<usize>> = value.and_then(Value::as_array).and_then(|list| list.iter().map(of).collect());
    let fits = |list: &Vec<usize>| list.len() <= MOST_AXES && axes.is_none_or(|axes| axes == list.len());
    let wrong = || ReadError::damaged(path, format!("\"{name}\" is no list of lengths, one for each axis"));
    list.filter(fits).ok_or_else(wrong)
}

fn words(value: Option<&Value>, axes: usize) -> Option<Vec<String>> {
    let list = value?.as_array()?;
    let words: Option<Vec<String>> = list.iter().map(|word| word.as_str().map(str::to_owned)).collect();
    words.filter(|words| words.len() == axes)
}

/// A chunk has points along each axis, and no more bytes than a gibibyte.
fn check_chunk(path: &Path, chunk: &[usize], scalar: ScalarType) -> Result<(), ReadError> {
    let points = chunk.iter().try_fold(scalar.size_bytes() as usize, |product, &n| product.checked_mul(n));
    match points {
        Some(1..=0x4000_0000) => Ok(()),
        _ => Err(ReadError::damaged(
            path,
            format!("chunks of {chunk:?} points, of which none or too many fit into memory"),
        )),
    }
}

struct Version2<'a>(&'a Path, &'a Map<String, Value>);

impl Version2<'_> {
    fn array(&self, folder: &Path, mut attributes: Map<String, Value>) -> Result<ZarrArray, ReadError> {
        let Self(path, meta) = *self;
        let shape = lengths(path, "shape", meta.get("shape"), None)?;
        let chunk = lengths(path, "chunks", meta.get("chunks"), Some(shape.len()))?;
        let (scalar, order) = self.scalar()?;
        check_chunk(path, &chunk, scalar)?;
        let mut steps = Vec::new();
        if meta.get("order").and_then(Value::as_str) == Some("F") {
            steps.push(ChunkCodec::Transpose((0..shape.len()).rev().collect()));
        }
        steps.push(ChunkCodec::Bytes(order));
        for filter in meta.get("filters").and_then(Value::as_array).into_iter().flatten() {
            steps.push(self.packing(filter)?);
        }
        if let Some(compressor) = meta.get("compressor").filter(|value| !value.is_null()) {
            steps.push(self.packing(compressor)?);
        }
        let separator = if meta.get("dimension_separator").and_then(Value::as_str) == Some("/") { '/' } else { '.' };
        let axes = words(attributes.get("_ARRAY_DIMENSIONS"), shape.len());
        let fill = fill(path, meta)?;
        // xarray keeps what says "missing" here alone.
        if let (Some(_), Some(value @ (Value::Number(_) | Value::String(_)))) = (&axes, meta.get("fill_value")) {
            attributes.entry("_FillValue").or_insert(value.clone());
        }
        let codecs = CodecChain(steps);
        Ok(ZarrArray {
            folder: folder.into(),
            shape,
            chunk,
            scalar,
            fill,
            codecs,
            prefix: "",
            separator,
            axes,
            attributes,
        })
    }

    /// Type strings of NumPy, such as `<f4`.
    fn scalar(&self) -> Result<(ScalarType, ByteOrder), ReadError> {
        let dtype = self.1.get("dtype").and_then(Value::as_str).unwrap_or_default();
        let order = if dtype.starts_with('>') { ByteOrder::Big } else { ByteOrder::Little };
        let scalar = match dtype.trim_start_matches(['<', '>', '|', '=']) {
            "i1" => ScalarType::I8,
            "u1" | "b1" => ScalarType::U8,
            "i2" => ScalarType::I16,
            "u2" => ScalarType::U16,
            "i4" => ScalarType::I32,
            "u4" => ScalarType::U32,
            "i8" => ScalarType::I64,
            "u8" => ScalarType::U64,
            "f2" => ScalarType::F16,
            "f4" => ScalarType::F32,
            "f8" => ScalarType::F64,
            _ => return Err(unknown(self.0, &format!("values of type \"{dtype}\""))),
        };
        Ok((scalar, order))
    }

    fn packing(&self, of: &Value) -> Result<ChunkCodec, ReadError> {
        let id = of.get("id").and_then(Value::as_str).unwrap_or_default();
        let width = of.get("elementsize").and_then(Value::as_u64).unwrap_or(4) as usize;
        Ok(match id {
            "blosc" => ChunkCodec::Blosc,
            "zlib" => ChunkCodec::Zlib,
            "gzip" => ChunkCodec::Gzip,
            "zstd" => ChunkCodec::Zstandard,
            "lz4" => ChunkCodec::Lz4,
            "shuffle" if width > 0 => ChunkCodec::Shuffle(width),
            "crc32" => ChunkCodec::LeadingChecksum,
            _ => return Err(unknown(self.0, &format!("the codec \"{id}\""))),
        })
    }
}

struct Version3<'a>(&'a Path, &'a Map<String, Value>);

impl Version3<'_> {
    fn array(&self, folder: &Path, attributes: Map<String, Value>) -> Result<ZarrArray, ReadError> {
        let Self(path, meta) = *self;
        let shape = lengths(path, "shape", meta.get("shape"), None)?;
        let configured = |name: &str| (name_of(meta.get(name)), configuration(meta.get(name)));
        let (grid, of_grid) = configured("chunk_grid");
        if grid != "regular" {
            return Err(unknown(path, &format!("the chunk grid \"{grid}\"")));
        }
        let chunk = lengths(path, "chunk_shape", of_grid.and_then(|of| of.get("chunk_shape")), Some(shape.len()))?;
        let scalar = match meta.get("data_type").and_then(Value::as_str).unwrap_or_default() {
            "int8" => ScalarType::I8,
            "uint8" | "bool" => ScalarType::U8,
            "int16" => ScalarType::I16,
            "uint16" => ScalarType::U16,
            "int32" => ScalarType::I32,
            "uint32" => ScalarType::U32,
            "int64" => ScalarType::I64,
            "uint64" => ScalarType::U64,
            "float16" => ScalarType::F16,
            "float32" => ScalarType::F32,
            "float64" => ScalarType::F64,
            other => return Err(unknown(path, &format!("values of type \"{other}\""))),
        };
        let (encoding, of_encoding) = configured("chunk_key_encoding");
        let stated = of_encoding.and_then(|of| of.get("separator")).and_then(Value::as_str);
        let (prefix, separator) = match (encoding.as_str(), stated) {
            ("default", Some(".")) => ("c.", '.'),
            ("default", _) => ("c/", '/'),
            ("v2", Some("/")) => ("", '/'),
            ("v2", _) => ("", '.'),
            _ => return Err(unknown(path, &format!("the chunk key encoding \"{encoding}\""))),
        };
        let axes = words(meta.get("dimension_names"), shape.len());
        let fill = fill(path, meta)?;
        let codecs = self.chain(meta.get("codecs"), &chunk, scalar, true)?;
        // A shard is never read as a whole.
        match codecs.0.first() {
            Some(ChunkCodec::Shards { .. }) => (),
            _ => check_chunk(path, &chunk, scalar)?,
        }
        Ok(ZarrArray { folder: folder.into(), shape, chunk, scalar, fill, codecs, prefix, separator, axes, attributes })
    }

    fn chain(
        &self,
        list: Option<&Value>,
        chunk: &[usize],
        scalar: ScalarType,
        shards: bool,
    ) -> Result<CodecChain, ReadError> {
        let path = self.0;
        let mut steps = Vec::new();
        for of in list.and_then(Value::as_array).into_iter().flatten() {
            let (name, configuration) = (name_of(Some(of)), configuration(Some(of)));
            let entry = |name: &str| configuration.and_then(|of| of.get(name));
            steps.push(match name.as_str() {
                "transpose" => {
                    let order = lengths(path, "order", entry("order"), Some(chunk.len()))?;
                    if !(0..chunk.len()).all(|axis| order.contains(&axis)) {
                        return Err(ReadError::damaged(path, format!("a transposition of axes {order:?}")));
                    }
                    ChunkCodec::Transpose(order)
                }
                "bytes" => match entry("endian").and_then(Value::as_str) {
                    Some("big") => ChunkCodec::Bytes(ByteOrder::Big),
                    _ => ChunkCodec::Bytes(ByteOrder::Little),
                },
                "blosc" => ChunkCodec::Blosc,
                "gzip" => ChunkCodec::Gzip,
                "zstd" => ChunkCodec::Zstandard,
                "numcodecs.zlib" => ChunkCodec::Zlib,
                "numcodecs.lz4" => ChunkCodec::Lz4,
                "crc32c" => ChunkCodec::TrailingChecksum,
                "sharding_indexed" if shards => {
                    let inner = lengths(path, "chunk_shape", entry("chunk_shape"), Some(chunk.len()))?;
                    check_chunk(path, &inner, scalar)?;
                    if chunk.iter().zip(&inner).any(|(&whole, &part)| whole == 0 || whole % part != 0) {
                        return Err(ReadError::damaged(
                            path,
                            format!("shards of {chunk:?} points in chunks of {inner:?}"),
                        ));
                    }
                    let codecs = self.chain(entry("codecs"), &inner, scalar, false)?;
                    let index = self.chain(entry("index_codecs"), &inner, ScalarType::U64, false)?;
                    let at_start = entry("index_location").and_then(Value::as_str) == Some("start");
                    ChunkCodec::Shards { chunk: inner, codecs, index, at_start }
                }
                _ => return Err(unknown(path, &format!("the codec \"{name}\""))),
            });
        }
        Ok(CodecChain(steps))
    }
}

/// A name, or an object with one.
fn name_of(value: Option<&Value>) -> String {
    let name = value.and_then(|value| value.as_str().or_else(|| value.get("name")?.as_str()));
    name.unwrap_or_default().to_owned()
}

fn configuration(value: Option<&Value>) -> Option<&Map<String, Value>> {
    value?.get("configuration")?.as_object()
}

fn unknown(path: &Path, what: &str) -> ReadError {
    let remedy =
        "write the array with numbers of 8 to 64 bits, packed by Blosc (LZ4, Zstandard), Zstandard, gzip or zlib";
    ReadError::unsupported(path, what, remedy)
}
