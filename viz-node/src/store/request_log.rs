//! `requests.csv` of a run's folder: what people at the page asked for, who, and when.

use std::fs::OpenOptions;
use std::path::Path;
use std::time::{SystemTime, UNIX_EPOCH};

/// Appends a request, made while `step` was the newest.
///
/// # Errors
/// If the file cannot be written.
pub(super) fn append(folder: &Path, step: Option<u64>, asked_by: &str, request: &str) -> Result<(), csv::Error> {
    let file = OpenOptions::new().create(true).append(true).open(folder.join("requests.csv"))?;
    let is_new = file.metadata()?.len() == 0;
    let mut csv = csv::Writer::from_writer(file);
    if is_new {
        csv.write_record(["unix_time_secs", "newest_step", "asked_by", "request"])?;
    }
    let time = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |since| since.as_secs_f64());
    let step = step.map_or_else(String::new, |step| step.to_string());
    csv.write_record([&format!("{time:.3}"), &step, asked_by, request])?;
    Ok(csv.flush()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn requests_are_appended_and_read_back_whatever_their_words() {
        let folder = tempfile::tempdir().unwrap();
        let words = "contract: size <= 9kB, \"maximise\" psnr\n=cmd()";
        append(folder.path(), None, "browser at ::1", "pause").unwrap();
        append(folder.path(), Some(7), "a, b", words).unwrap();
        let mut csv = csv::Reader::from_path(folder.path().join("requests.csv")).unwrap();
        let rows: Vec<(f64, Option<u64>, String, String)> = csv.deserialize().map(Result::unwrap).collect();
        assert_eq!((rows[0].1, &*rows[0].3), (None, "pause"));
        assert_eq!((rows[1].1, &*rows[1].2, &*rows[1].3), (Some(7), "a, b", words));
        assert!(rows[1].0 >= rows[0].0 && rows[0].0 > 1.7e9);
    }
}
