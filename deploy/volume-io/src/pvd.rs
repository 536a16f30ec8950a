//! ParaView collections: which file holds which time. What is in the files is not looked at here.

use crate::ReadError;
use crate::xml::{Tag, broken};
use quick_xml::Reader;
use quick_xml::events::Event;
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

/// One step of a collection.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Entry {
    pub(crate) time: f64,
    pub(crate) file: PathBuf,
}

/// The steps that the collection lists; relative names are those of files beside it.
pub(crate) fn read_collection(path: &Path) -> Result<Vec<Entry>, ReadError> {
    let file = File::open(path).map_err(|e| ReadError::while_reading(path, e))?;
    let mut xml = Reader::from_reader(BufReader::new(file));
    let folder = path.parent().unwrap_or(Path::new(""));
    let (mut entries, mut buffer) = (Vec::new(), Vec::new());
    loop {
        buffer.clear();
        match xml.read_event_into(&mut buffer).map_err(|e| broken(path, e))? {
            Event::Start(start) | Event::Empty(start) => {
                let tag = Tag::of(path, &start)?;
                match tag.name() {
                    "VTKFile" => check_type(path, &tag)?,
                    "DataSet" => entries.push(entry(path, folder, &tag)?),
                    _ => {}
                }
            }
            Event::Eof => break,
            _ => {}
        }
    }
    let times: Vec<_> = entries.iter().map(|e: &Entry| (e.time, e.file.display().to_string())).collect();
    check_order(path, &times)?;
    Ok(entries)
}

/// Refuses what cannot be played back: no step at all, or steps that are not each later than the one before.
pub(crate) fn check_order(path: &Path, steps: &[(f64, String)]) -> Result<(), ReadError> {
    let refuse = |reason| Err(ReadError::Collection { path: path.into(), reason });
    if steps.is_empty() {
        return refuse("lists no step (no <DataSet>)".into());
    }
    if let Some((time, file)) = steps.iter().find(|(time, _)| !time.is_finite()) {
        return refuse(format!("{file} has the time {time}"));
    }
    for pair in steps.windows(2) {
        let ((before, first), (time, second)) = (&pair[0], &pair[1]);
        if time == before {
            return refuse(format!("{first} and {second} both have the time {time}"));
        }
        if time < before {
            return refuse(format!("{second} at time {time} comes after {first} at time {before}"));
        }
    }
    Ok(())
}

fn check_type(path: &Path, tag: &Tag) -> Result<(), ReadError> {
    match tag.get("type") {
        Some("Collection") => Ok(()),
        other => {
            let what = format!("VTK data of type \"{}\" under the name of a collection", other.unwrap_or_default());
            Err(ReadError::unsupported(path, what, "give the file the ending of its type"))
        }
    }
}

fn entry(path: &Path, folder: &Path, tag: &Tag) -> Result<Entry, ReadError> {
    let file = tag.require("file")?;
    let part = tag.get("part").unwrap_or("0");
    if part.trim() != "0" {
        let what = format!("part {part} of a step ({file})");
        return Err(ReadError::unsupported(path, what, "merge the parts of each step into one .vti"));
    }
    tag.require("timestep")?;
    let time = tag.number("timestep")?.unwrap_or(f64::NAN);
    Ok(Entry { time, file: folder.join(file) })
}
