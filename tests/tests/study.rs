//! `lamina-lab study` and `lamina tune` as a user runs them, on the recorded blast.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use lamina_tests::processes::{recorded_series, run};
use std::fs;
use std::path::Path;

/// Standard output and error of a command that succeeds.
fn lamina(arguments: &[&str]) -> (String, String) {
    let program = if arguments[0] == "study" { "lamina-lab" } else { "lamina" };
    let output = run(program, arguments);
    let [out, err] = [&output.stdout, &output.stderr].map(|bytes| String::from_utf8_lossy(bytes).into_owned());
    assert!(output.status.success(), "{arguments:?}: {err}");
    (out, err)
}

/// The fields of every line but the first.
fn table(path: &Path) -> Vec<Vec<String>> {
    let text = fs::read_to_string(path).unwrap();
    text.lines().skip(1).map(|l| l.split(',').map(str::to_owned).collect()).collect()
}

fn number(field: &str) -> f64 {
    field.parse().unwrap()
}

#[test]
fn a_study_measures_once_chooses_right_and_survives_a_damaged_cache() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("study");
    let series = recorded_series();
    let arguments = [
        "study",
        series.to_str().unwrap(),
        "--steps",
        "3,6",
        "--grid",
        "32:96:32,0.01:0.05:0.02",
        "--size-limits",
        "1B,12kB,30kB",
        "--out",
        out.to_str().unwrap(),
    ];
    let (said, _) = lamina(&arguments);
    assert!(said.contains("0 broke a limit"), "{said}");
    let header = "scene,step,resolution,gamma,size_bytes,generation_ms,encode_ms,psnr_db,psnr_db_10,psnr_db_20,";
    assert!(fs::read_to_string(out.join("measurements.csv")).unwrap().starts_with(header));
    let measured = table(&out.join("measurements.csv"));
    assert_eq!(measured.len(), 2 * 3 * 3);

    // The choice under each limit is the best of the measured, by exhaustion.
    for row in table(&out.join("best_size.csv")) {
        let limit = number(&row[2]);
        let kept = measured.iter().filter(|m| m[1] == row[1] && number(&m[4]) <= limit);
        match kept.max_by(|a, b| number(&a[7]).total_cmp(&number(&b[7]))) {
            Some(best) => assert_eq!(row[3..6], best[2..5], "under {limit}"),
            None => assert!(row[3].is_empty(), "{row:?}"),
        }
    }
    // Transfers between the two steps, both ways, under every limit that something keeps.
    let cross = table(&out.join("cross.csv"));
    assert!(cross.iter().any(|r| r[1] == "3" && r[2] == "6") && cross.iter().any(|r| r[1] == "6" && r[2] == "3"));
    assert!(table(&out.join("search.csv")).len() >= 2 * 3);
    let report = fs::read_to_string(out.join("report.html")).unwrap();
    for part in ["Fig. 3 to 6", "Fig. 7", "Fig. 8", "Fig. 9", "Table 1", "<svg", "data:image/png;base64,"] {
        assert!(report.contains(part), "{part}");
    }
    // Pictures are letters too, and some of them may spell anything.
    let words: String =
        report.split("base64,").map(|part| part.split_once('"').map_or(part, |(_, rest)| rest)).collect();
    for leak in ["src=\"http", "<script", "<link", "NaN"] {
        assert!(!words.contains(leak), "{leak}");
    }

    // Again: nothing is measured. With a damaged line: that trial is, and gives the same bytes and decibels.
    let figures = |rows: &[Vec<String>]| rows.iter().map(|r| (r[..5].to_vec(), r[7..].to_vec())).collect::<Vec<_>>();
    let (_, err) = lamina(&arguments);
    assert!(!err.contains("damaged"), "{err}");
    assert_eq!(table(&out.join("measurements.csv")), measured, "times too: all from the cache");
    let cache = fs::read_dir(out.join("cache")).unwrap().next().unwrap().unwrap().path();
    // Measured, then timed twice more: three rounds over the grid. One trial loses all of its lines, another one of them.
    let text = fs::read_to_string(&cache).unwrap();
    let lost = [4, 13, 22, 18 + 7];
    let damaged =
        |(n, line): (usize, &str)| if lost.contains(&n) { line.replacen(' ', "7 ", 1) } else { line.to_owned() };
    let lines: Vec<String> = text.lines().enumerate().map(damaged).collect();
    assert_eq!(lines.len(), 27);
    fs::write(&cache, lines.join("\n") + "\n").unwrap();
    let (_, err) = lamina(&arguments);
    assert!(err.contains("4 of 27 lines are damaged") && err.contains("measured again"), "{err}");
    assert_eq!(figures(&table(&out.join("measurements.csv"))), figures(&measured));
    let text = fs::read_to_string(&cache).unwrap();
    let timed = text.lines().filter(|l| l.contains("\"timed\":3")).count();
    assert_eq!((timed, text.lines().count()), (9, 27), "every trial was timed three times");

    // Fitted VDIs are others; the greedy ones stay measured.
    lamina(&[&arguments[..], &["--segmentation", "fitted"]].concat());
    assert_ne!(figures(&table(&out.join("measurements.csv"))), figures(&measured));
    assert_eq!(fs::read_dir(out.join("cache")).unwrap().count(), 4);
    assert_eq!(fs::read_to_string(&cache).unwrap(), text);
}

#[test]
fn a_contract_is_kept_or_said_to_be_impossible() {
    let series = recorded_series();
    let run_tune = |contract: &str| {
        let input = ["tune", series.to_str().unwrap(), "--time-step", "6", "--contract", contract];
        run("lamina", &[&input[..], &["--grid", "32:128:16,0.005:0.1:0.005"]].concat())
    };
    let output = run_tune("size <= 25kB");
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{said}");
    let best = said.lines().find(|l| l.starts_with("best")).unwrap();
    let kilobytes = best.split(" kB").next().unwrap().rsplit(' ').next().unwrap();
    assert!(number(kilobytes) <= 25.0 && number(kilobytes) > 15.0, "{best}");
    assert!(said.contains("sure ") && said.contains("front "), "{said}");

    let output = run_tune("size <= 25kB, psnr >= 90dB");
    let (said, error) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(!output.status.success() && error.contains("nothing tried keeps this contract"), "{error}");
    assert!(said.contains("nearest") && said.contains("(limit 90 dB)"), "{said}");
}
