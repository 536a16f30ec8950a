//! The little of XML that the VTK formats need: attributes by name, values as numbers, errors with the file's name.

use crate::ReadError;
use quick_xml::XmlVersion;
use quick_xml::events::BytesStart;
use std::path::Path;
use std::str::FromStr;

/// What a parser complains of.
pub(crate) fn broken(path: &Path, error: impl std::fmt::Display) -> ReadError {
    ReadError::damaged(path, format!("XML: {error}"))
}

/// One opening tag with its attributes.
pub(crate) struct Tag<'a> {
    path: &'a Path,
    name: String,
    attributes: Vec<(String, String)>,
}

impl<'a> Tag<'a> {
    pub(crate) fn of(path: &'a Path, start: &BytesStart) -> Result<Self, ReadError> {
        let mut attributes = Vec::new();
        for attribute in start.attributes() {
            let attribute = attribute.map_err(|e| broken(path, e))?;
            let value = attribute.normalized_value(XmlVersion::Implicit1_0).map_err(|e| broken(path, e))?;
            attributes.push((attribute.key.into_inner().to_owned(), value.into_owned()));
        }
        Ok(Self { path, name: start.name().into_inner().to_owned(), attributes })
    }

    pub(crate) fn name(&self) -> &str {
        &self.name
    }

    pub(crate) fn get(&self, attribute: &str) -> Option<&str> {
        self.attributes.iter().find(|(name, _)| name == attribute).map(|(_, value)| value.as_str())
    }

    pub(crate) fn require(&self, attribute: &str) -> Result<&str, ReadError> {
        self.get(attribute)
            .ok_or_else(|| ReadError::damaged(self.path, format!("<{}> has no attribute {attribute}", self.name)))
    }

    /// The attribute as exactly `N` numbers, if it is there.
    pub(crate) fn numbers<T: FromStr + Copy + Default, const N: usize>(
        &self,
        attribute: &str,
    ) -> Result<Option<[T; N]>, ReadError> {
        let Some(text) = self.get(attribute) else { return Ok(None) };
        let mut numbers = [T::default(); N];
        let mut words = text.split_whitespace();
        let all = numbers.iter_mut().all(|n| words.next().and_then(|w| w.parse().ok()).map(|v| *n = v).is_some());
        if all && words.next().is_none() {
            return Ok(Some(numbers));
        }
        let reason = format!("<{} {attribute}=\"{text}\"> needs {N} numbers of the right kind", self.name);
        Err(ReadError::damaged(self.path, reason))
    }

    /// The attribute as one number, if it is there.
    pub(crate) fn number<T: FromStr + Copy + Default>(&self, attribute: &str) -> Result<Option<T>, ReadError> {
        Ok(self.numbers::<T, 1>(attribute)?.map(|[n]| n))
    }
}
