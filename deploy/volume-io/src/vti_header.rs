//! The XML in front of VTK image data: what arrays there are and where in the file their bytes lie.
//!
//! Only positions of data are noted, never data: the parser stops before appended bytes, which need not be XML.

use crate::ReadError;
use crate::scalars::{ByteOrder, ScalarType};
use crate::xml::{Tag, broken};
use quick_xml::Reader;
use quick_xml::events::Event;
use std::fs::File;
use std::io::{self, BufRead, BufReader};
use std::ops::Range;
use std::path::Path;

/// What the XML says.
#[derive(Debug)]
pub(crate) struct Header {
    pub(crate) order: ByteOrder,
    /// True if the numbers in front of data have 64 bits, else 32.
    pub(crate) wide: bool,
    pub(crate) compressor: Option<String>,
    pub(crate) extent: [i64; 6],
    pub(crate) origin: [f64; 3],
    pub(crate) spacing: [f64; 3],
    pub(crate) points: HeaderSection,
    pub(crate) cells: HeaderSection,
    pub(crate) appended: Option<Appended>,
}

/// The arrays of the points or of the cells.
#[derive(Debug, Default)]
pub(crate) struct HeaderSection {
    pub(crate) scalars: Option<String>,
    pub(crate) arrays: Vec<Array>,
}

/// One array. What it is stays text until somebody asks for it: an odd array beside the wanted one does no harm.
#[derive(Debug)]
pub(crate) struct Array {
    pub(crate) name: Option<String>,
    pub(crate) type_name: String,
    pub(crate) components: String,
    pub(crate) format: String,
    pub(crate) offset: Option<u64>,
    /// Where in the file an inline array's text is.
    pub(crate) text: Option<Range<u64>>,
}

impl Array {
    pub(crate) fn scalar(&self) -> Option<ScalarType> {
        Some(match self.type_name.as_str() {
            "Int8" => ScalarType::I8,
            "UInt8" => ScalarType::U8,
            "Int16" => ScalarType::I16,
            "UInt16" => ScalarType::U16,
            "Int32" => ScalarType::I32,
            "UInt32" => ScalarType::U32,
            "Int64" => ScalarType::I64,
            "UInt64" => ScalarType::U64,
            "Float32" => ScalarType::F32,
            "Float64" => ScalarType::F64,
            _ => return None,
        })
    }
}

/// Where appended data begins, behind its underscore.
#[derive(Debug)]
pub(crate) struct Appended {
    pub(crate) start: u64,
    pub(crate) base64: bool,
}

#[derive(Clone, Copy)]
enum Kind {
    Points,
    Cells,
}

/// The state while tags go by.
struct Parser<'a> {
    path: &'a Path,
    header: Option<Header>,
    pieces: usize,
    section: Option<Kind>,
    /// Tags open at and below an array's; 0 outside of arrays.
    array_depth: usize,
}

impl Header {
    /// Parses the header of `path`.
    pub(crate) fn read(path: &Path) -> Result<Self, ReadError> {
        let system = |e| ReadError::while_reading(path, e);
        let mut file = BufReader::new(File::open(path).map_err(system)?);
        // Stripped here because the parser strips it too, but does not count it in its positions.
        let mark = if file.fill_buf().map_err(system)?.starts_with(b"\xEF\xBB\xBF") { 3 } else { 0 };
        file.consume(mark);
        let mark = mark as u64;
        let mut xml = Reader::from_reader(file);
        let mut parser = Parser { path, header: None, pieces: 0, section: None, array_depth: 0 };
        let mut buffer = Vec::new();
        loop {
            buffer.clear();
            let start = mark + xml.buffer_position();
            let event = xml.read_event_into(&mut buffer).map_err(|e| broken(path, e))?;
            match event {
                Event::Start(tag) => {
                    let tag = Tag::of(path, &tag)?;
                    if tag.name() == "AppendedData" {
                        let base64 = parser.appended_base64(&tag)?;
                        let data = mark + xml.buffer_position();
                        let start = data + to_underscore(&mut xml.into_inner()).map_err(system)?;
                        return parser.finish(Some(Appended { start, base64 }));
                    }
                    parser.open(&tag)?;
                }
                Event::Empty(tag) => {
                    let tag = Tag::of(path, &tag)?;
                    parser.open(&tag)?;
                    parser.close(tag.name());
                }
                Event::End(tag) => parser.close(tag.name().into_inner()),
                Event::Text(text) if !text.trim().is_empty() => parser.text(start..mark + xml.buffer_position()),
                Event::Eof => return parser.finish(None),
                _ => {}
            }
        }
    }
}

/// Bytes up to and including the underscore that opens appended data.
fn to_underscore(file: &mut BufReader<File>) -> io::Result<u64> {
    let mut passed = 0;
    loop {
        let Some(&byte) = file.fill_buf()?.first() else { return Err(io::ErrorKind::UnexpectedEof.into()) };
        file.consume(1);
        passed += 1;
        match byte {
            b'_' => return Ok(passed),
            b if b.is_ascii_whitespace() => {}
            _ => return Err(crate::error::invalid("the appended data does not begin with an underscore")),
        }
    }
}

impl Parser<'_> {
    fn open(&mut self, tag: &Tag) -> Result<(), ReadError> {
        if self.array_depth > 0 {
            self.array_depth += 1;
            return Ok(());
        }
        match tag.name() {
            "VTKFile" => self.header = Some(self.file(tag)?),
            "ImageData" => self.image(tag)?,
            "Piece" => self.piece(tag)?,
            "PointData" => self.begin(Kind::Points, tag),
            "CellData" => self.begin(Kind::Cells, tag),
            "DataArray" => self.array(tag)?,
            _ => {}
        }
        Ok(())
    }

    fn close(&mut self, name: &str) {
        if self.array_depth > 0 {
            self.array_depth -= 1;
        } else if matches!(name, "PointData" | "CellData") {
            self.section = None;
        }
    }

    fn file(&self, tag: &Tag) -> Result<Header, ReadError> {
        let refuse = |what, remedy| Err(ReadError::unsupported(self.path, what, remedy));
        let kind = tag.require("type")?;
        if kind != "ImageData" {
            return refuse(format!("VTK data of type {kind}"), "resample it to ImageData");
        }
        let order = match tag.get("byte_order").unwrap_or("LittleEndian") {
            "LittleEndian" => ByteOrder::Little,
            "BigEndian" => ByteOrder::Big,
            other => return refuse(format!("byte_order {other}"), "LittleEndian and BigEndian are understood"),
        };
        let wide = match tag.get("header_type").unwrap_or("UInt32") {
            "UInt32" => false,
            "UInt64" => true,
            other => return refuse(format!("header_type {other}"), "UInt32 and UInt64 are understood"),
        };
        Ok(Header {
            order,
            wide,
            compressor: tag.get("compressor").filter(|name| !name.is_empty()).map(str::to_owned),
            extent: [0; 6],
            origin: [0.0; 3],
            spacing: [1.0; 3],
            points: HeaderSection::default(),
            cells: HeaderSection::default(),
            appended: None,
        })
    }

    fn image(&mut self, tag: &Tag) -> Result<(), ReadError> {
        let Some(header) = &mut self.header else { return Ok(()) };
        tag.require("WholeExtent")?;
        header.extent = tag.numbers("WholeExtent")?.unwrap_or(header.extent);
        header.origin = tag.numbers("Origin")?.unwrap_or(header.origin);
        header.spacing = tag.numbers("Spacing")?.unwrap_or(header.spacing);
        let upright = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
        match tag.numbers::<f64, 9>("Direction")? {
            Some(direction) if direction != upright => {
                let what = format!("a grid turned by Direction {direction:?}");
                Err(ReadError::unsupported(self.path, what, "resample it to axes without rotation"))
            }
            _ => Ok(()),
        }
    }

    fn piece(&mut self, tag: &Tag) -> Result<(), ReadError> {
        self.pieces += 1;
        if self.pieces > 1 {
            return Err(ReadError::unsupported(self.path, "a grid in several Pieces", "write it as one Piece"));
        }
        let Some(header) = &self.header else { return Ok(()) };
        match tag.numbers::<i64, 6>("Extent")? {
            Some(extent) if extent != header.extent => {
                let what = format!("a Piece {extent:?} that is not the whole of {:?}", header.extent);
                Err(ReadError::unsupported(self.path, what, "write the grid as one Piece"))
            }
            _ => Ok(()),
        }
    }

    fn begin(&mut self, kind: Kind, tag: &Tag) {
        self.section = Some(kind);
        if let Some(section) = self.current() {
            section.scalars = tag.get("Scalars").map(str::to_owned);
        }
    }

    fn current(&mut self) -> Option<&mut HeaderSection> {
        let header = self.header.as_mut()?;
        Some(match self.section? {
            Kind::Points => &mut header.points,
            Kind::Cells => &mut header.cells,
        })
    }

    fn array(&mut self, tag: &Tag) -> Result<(), ReadError> {
        self.array_depth = 1;
        let path = self.path;
        let Some(section) = self.current() else { return Ok(()) };
        if tag.get("TimeStep").is_some() {
            let remedy = "write one file per step and a .pvd that lists them";
            return Err(ReadError::unsupported(path, "several time steps in one file", remedy));
        }
        section.arrays.push(Array {
            name: tag.get("Name").filter(|name| !name.is_empty()).map(str::to_owned),
            type_name: tag.require("type")?.to_owned(),
            components: tag.get("NumberOfComponents").unwrap_or("1").to_owned(),
            format: tag.get("format").unwrap_or("ascii").to_owned(),
            offset: tag.number("offset")?,
            text: None,
        });
        Ok(())
    }

    /// Text outside of arrays, and within the metadata below an array, is none of ours.
    fn text(&mut self, at: Range<u64>) {
        if self.array_depth == 1
            && let Some(array) = self.current().and_then(|section| section.arrays.last_mut())
            && array.text.is_none()
        {
            array.text = Some(at);
        }
    }

    fn appended_base64(&self, tag: &Tag) -> Result<bool, ReadError> {
        match tag.get("encoding").unwrap_or("base64") {
            "raw" => Ok(false),
            "base64" => Ok(true),
            other => {
                let what = format!("appended data in encoding {other}");
                Err(ReadError::unsupported(self.path, what, "raw and base64 are understood"))
            }
        }
    }

    fn finish(self, appended: Option<Appended>) -> Result<Header, ReadError> {
        match self.header {
            Some(header) if self.pieces == 1 => Ok(Header { appended, ..header }),
            Some(_) => Err(ReadError::damaged(self.path, "there is no <Piece> of ImageData in it")),
            None => Err(ReadError::damaged(self.path, "there is no <VTKFile> in it")),
        }
    }
}
