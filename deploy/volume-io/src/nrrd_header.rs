//! The text in front of NRRD data: fields by name. What they mean is decided elsewhere.

use crate::ReadError;
use std::io::BufRead;
use std::path::Path;

/// Far more than any header needs; a binary file taken for one is noticed here.
const LONGEST_HEADER_BYTES: u64 = 1 << 20;

/// The fields of a header, and where it ends.
#[derive(Debug)]
pub(crate) struct Fields {
    /// Names in lower case without blanks, since "data file" and "datafile" are the same.
    fields: Vec<(String, String)>,
    /// Position behind the blank line that ends a header with data attached; none if the file ended first.
    pub(crate) end: Option<u64>,
}

impl Fields {
    /// Parses the header that `file` begins with.
    pub(crate) fn read(path: &Path, file: impl BufRead) -> Result<Self, ReadError> {
        let mut file = file.take(LONGEST_HEADER_BYTES);
        let (mut fields, mut line, mut position) = (Vec::new(), Vec::new(), 0);
        loop {
            line.clear();
            let bytes = file.read_until(b'\n', &mut line).map_err(|e| ReadError::while_reading(path, e))?;
            let first = position == 0;
            position += bytes as u64;
            let text = String::from_utf8_lossy(&line);
            let text = text.trim_end();
            if first {
                if !text.starts_with("NRRD000") {
                    return Err(ReadError::damaged(path, "it does not begin with \"NRRD000\""));
                }
            } else if bytes == 0 && file.limit() == 0 {
                return Err(ReadError::damaged(path, "its header does not end"));
            } else if bytes == 0 {
                return Ok(Self { fields, end: None });
            } else if text.is_empty() {
                return Ok(Self { fields, end: Some(position) });
            } else if let Some(field) = field(path, text)? {
                fields.push(field);
            }
        }
    }

    pub(crate) fn get(&self, name: &str) -> Option<&str> {
        self.fields.iter().find(|(field, _)| field == name).map(|(_, value)| value.as_str())
    }

    pub(crate) fn require(&self, path: &Path, name: &str) -> Result<&str, ReadError> {
        self.get(name).ok_or_else(|| ReadError::damaged(path, format!("its header has no field \"{name}\"")))
    }

    /// A field of one number, 0 if it is not there.
    pub(crate) fn number(&self, path: &Path, name: &str) -> Result<i64, ReadError> {
        let Some(text) = self.get(name) else { return Ok(0) };
        text.parse().map_err(|_| ReadError::damaged(path, format!("\"{name}: {text}\" is no whole number")))
    }
}

/// A field of one line; comments (`#`) and free keys (`key:=value`) say nothing of the grid.
fn field(path: &Path, line: &str) -> Result<Option<(String, String)>, ReadError> {
    if line.starts_with('#') {
        return Ok(None);
    }
    match line.split_once(':') {
        Some((_, value)) if value.starts_with('=') => Ok(None),
        Some((name, value)) => {
            let name = name.split_whitespace().collect::<String>().to_ascii_lowercase();
            Ok(Some((name, value.trim().to_owned())))
        }
        None => Err(ReadError::damaged(path, format!("its header has a line that is no field, {:?}", shortened(line)))),
    }
}

fn shortened(line: &str) -> String {
    line.chars().take(40).collect()
}
