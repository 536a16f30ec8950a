//! HTML fragments: heading, headline figures, pictures and tables, and the escaping of text.

use super::numbers::{bytes, counted, decibels, fixed, grouped, kilobytes, median, significant};
use super::{Limit, PicturePair, Report, ReportStep, Turntable};
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;

/// `text` with the five characters replaced that HTML would interpret in an element or a quoted attribute.
pub fn escape(text: &str) -> String {
    let mut safe = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => safe.push_str("&amp;"),
            '<' => safe.push_str("&lt;"),
            '>' => safe.push_str("&gt;"),
            '"' => safe.push_str("&quot;"),
            '\'' => safe.push_str("&#39;"),
            other => safe.push(other),
        }
    }
    safe
}

/// A whole document: `style` is its style sheet, `parts` are markup.
pub fn document(title: &str, style: &str, parts: &[String]) -> String {
    let (title, body) = (escape(title), parts.concat());
    format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <title>{title}</title>\n<style>\n{style}</style>\n</head>\n<body>\n{body}</body>\n</html>\n"
    )
}

/// A section of a page under a heading; `content` is markup.
pub fn section(heading: &str, content: &str) -> String {
    format!("<section>\n<h2>{}</h2>\n{content}\n</section>\n", escape(heading))
}

/// The head of the page: title, data source, machine, command and limits.
pub(crate) fn heading(report: &Report) -> String {
    let entry = |name: &str, text: &str, tag: &str| {
        if text.is_empty() { String::new() } else { format!("<dt>{name}</dt><dd><{tag}>{}</{tag}></dd>", escape(text)) }
    };
    let origin = [
        entry("Source", &report.source, "span"),
        entry("Machine", &report.machine, "span"),
        entry("Command", &report.command, "code"),
        entry("Limit", &limit_words(&report.limit), "span"),
    ];
    format!("<header>\n<h1>{}</h1>\n<dl class=\"origin\">{}</dl>\n</header>\n", escape(&report.title), origin.concat())
}

fn limit_words(limit: &Limit) -> String {
    let size = limit.size_bytes.map(|most| bytes(most as f64));
    let time = limit.time_ms.map(|most| format!("{} ms", significant(most, 4)));
    match (size, time) {
        (None, None) => "none".into(),
        (Some(one), None) | (None, Some(one)) => format!("at most {one} a step"),
        (Some(size), Some(time)) => format!("at most {size} and {time} a step"),
    }
}

/// The headline figures: number of steps, median size, quality and time, and how often a limit was exceeded.
pub(crate) fn facts(report: &Report) -> String {
    let steps = &report.steps;
    if steps.is_empty() {
        return "<p class=\"empty\">No step was recorded.</p>\n".into();
    }
    let broken = steps.iter().filter(|row| !row.limit_kept).count();
    let measured: Vec<f64> = steps.iter().filter_map(|row| row.psnr_db).filter(|q| !q.is_nan()).collect();
    let lowest = measured.iter().copied().min_by(f64::total_cmp);
    let total: u64 = steps.iter().map(|row| row.size_bytes).fold(0, u64::saturating_add);
    let size = median(steps.iter().map(|row| row.size_bytes as f64)).map_or("–".into(), bytes);
    let time =
        median(steps.iter().map(|row| row.generation_ms)).map_or("–".into(), |t| format!("{} ms", fixed(t, 1)));
    let psnr = median(measured.iter().copied()).map_or("not measured".into(), decibels);
    let psnr_note = lowest
        .map_or(String::new(), |q| format!("lowest {}, {} measured", decibels(q), counted(measured.len(), "step")));
    let share = 100.0 * broken as f64 / steps.len() as f64;
    let broken_note = match (report.limit.size_bytes, report.limit.time_ms, broken) {
        (None, None, 0) => "no limit was set".into(),
        (_, _, 0) => "every step kept the limit".into(),
        _ => format!("{} % of all steps broke the limit", significant(share, 2)),
    };
    let tiles = [
        tile("Steps", &grouped(steps.len() as u64), &span_words(steps), false),
        tile("Median size", &size, &format!("{} in all", bytes(total as f64)), false),
        tile("Median PSNR", &psnr, &psnr_note, false),
        tile("Median generation time", &time, "without compression", false),
        tile("Violations", &grouped(broken as u64), &broken_note, broken > 0),
    ];
    format!("<dl class=\"facts\">{}</dl>\n", tiles.concat())
}

fn tile(name: &str, value: &str, note: &str, alarming: bool) -> String {
    let class = if alarming { " class=\"broken\"" } else { "" };
    format!("<div{class}><dt>{name}</dt><dd>{} <small>{}</small></dd></div>", escape(value), escape(note))
}

fn span_words(steps: &[ReportStep]) -> String {
    match steps {
        [] => String::new(),
        [only] => format!("step {}, time {}", only.step, significant(only.time, 4)),
        [first, .., last] => {
            format!(
                "{} to {}, time {} to {}",
                first.step,
                last.step,
                significant(first.time, 4),
                significant(last.time, 4)
            )
        }
    }
}

/// The angles of all test views, in the order of first occurrence.
pub(crate) fn angles(steps: &[ReportStep]) -> Vec<f64> {
    let mut angles = Vec::new();
    for (angle, _) in steps.iter().flat_map(|row| &row.views) {
        if !angles.contains(angle) {
            angles.push(*angle);
        }
    }
    angles
}

/// Picture pairs: rendered on the left, ray cast on the right, the PSNR between them below.
pub(crate) fn pictures(pairs: &[PicturePair]) -> String {
    if pairs.is_empty() {
        return String::new();
    }
    let shown: String = pairs.iter().map(pair).collect();
    section("Pictures", &format!("<div class=\"pairs\">{shown}</div>"))
}

fn pair(pair: &PicturePair) -> String {
    let angle = significant(pair.angle_deg, 4);
    let image = |png: &[u8], what: &str| {
        let data = STANDARD.encode(png);
        let alt = format!("Step {} at {angle} degrees, {what}", pair.step);
        format!("<div><img src=\"data:image/png;base64,{data}\" alt=\"{alt}\"><span>{what}</span></div>")
    };
    let same = if pair.psnr_db == f64::INFINITY { ", identical" } else { "" };
    let caption = format!("<b>Step {}, {angle}°</b> {}{same}", pair.step, decibels(pair.psnr_db));
    let images = image(&pair.shown_png, "as shown") + &image(&pair.reference_png, "ray cast");
    format!("<figure class=\"pair\">{images}<figcaption>{caption}</figcaption></figure>")
}

/// A step that can be turned.
pub(crate) fn turntable(Turntable { step, encoded, engine, script }: &Turntable) -> String {
    let data = |id: &str, bytes: &[u8]| {
        format!("<script type=\"application/octet-stream\" id=\"{id}\">{}</script>\n", STANDARD.encode(bytes))
    };
    let canvas = "<canvas id=\"turntable\" width=\"512\" height=\"512\" tabindex=\"0\" role=\"img\" \
        aria-label=\"The step, which can be turned\"></canvas>";
    let caption = "drag or arrow keys turn it, the wheel zooms, a double click goes back";
    let drawing = format!(
        "<figure class=\"turntable\">{canvas}<figcaption><b>Step {step}</b> {caption}</figcaption></figure>\n{}{}<script>{script}</script>\n",
        data("lamina-engine", engine),
        data("lamina-step", encoded),
    );
    section("The last step", &drawing)
}

/// A table of all steps with all their figures.
pub(crate) fn step_table(steps: &[ReportStep]) -> String {
    if steps.is_empty() {
        return String::new();
    }
    let angles = angles(steps);
    let fixed_head = [
        "step",
        "time",
        "as",
        "r",
        "gamma",
        "size kB",
        "generation ms",
        "encode ms",
        "supersegments or points",
        "PSNR dB",
    ];
    let mut head: Vec<String> = fixed_head.map(String::from).to_vec();
    head.extend(angles.iter().map(|angle| format!("{}°", significant(*angle, 3))));
    head.push("limit".into());
    let row = |row: &ReportStep| (step_cells(row, &angles), !row.limit_kept);
    section("Every step", &table("All steps", &head, steps.iter().map(row)))
}

fn step_cells(row: &ReportStep, angles: &[f64]) -> Vec<String> {
    let mut cells = vec![
        row.step.to_string(),
        significant(row.time, 6),
        row.representation.to_string(),
        row.resolution.to_string(),
        significant(row.gamma, 4),
        fixed(kilobytes(row.size_bytes), 1),
        fixed(row.generation_ms, 2),
        fixed(row.encode_ms, 2),
        grouped(row.supersegments),
        row.psnr_db.map_or("not measured".into(), |q| fixed(q, 2)),
    ];
    let view =
        |angle: &f64| row.views.iter().find(|view| view.0 == *angle).map_or("–".into(), |view| fixed(view.1, 2));
    cells.extend(angles.iter().map(view));
    cells.push(if row.limit_kept { "kept".into() } else { "broken".into() });
    cells
}

/// A figure: caption and note are text, `drawing` is markup.
pub fn figure(title: &str, note: &str, drawing: &str) -> String {
    let (title, note) = (escape(title), escape(note));
    format!("<figure><figcaption><b>{title}</b><span class=\"note\">{note}</span></figcaption>{drawing}</figure>")
}

/// A table behind a summary line that opens on a click; rows flagged `true` are emphasized.
pub fn table(name: &str, head: &[String], rows: impl ExactSizeIterator<Item = (Vec<String>, bool)>) -> String {
    let cell = |tag: &str, text: &String| format!("<{tag}>{}</{tag}>", escape(text));
    let summary = format!("{} ({})", escape(name), grouped(rows.len() as u64));
    let head: String = head.iter().map(|text| cell("th", text)).collect();
    let body: String = rows
        .map(|(cells, strong)| {
            let cells: String = cells.iter().map(|text| cell("td", text)).collect();
            format!("<tr{}>{cells}</tr>\n", if strong { " class=\"strong\"" } else { "" })
        })
        .collect();
    format!(
        "<details>\n<summary>{summary}</summary>\n<div class=\"scroll\" tabindex=\"0\"><table>\n\
         <thead><tr>{head}</tr></thead>\n<tbody>\n{body}</tbody>\n</table></div>\n</details>"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn escaping_covers_all_five_characters_and_leaves_the_rest() {
        assert_eq!(
            escape("<a href=\"x\">'&'</a> γ 30°"),
            "&lt;a href=&quot;x&quot;&gt;&#39;&amp;&#39;&lt;/a&gt; γ 30°"
        );
    }

    #[test]
    fn limits_are_stated_in_words() {
        assert_eq!(
            limit_words(&Limit { size_bytes: Some(300_000), time_ms: Some(40.0) }),
            "at most 300 kB and 40 ms a step"
        );
        assert_eq!(limit_words(&Limit { size_bytes: None, time_ms: Some(2.5) }), "at most 2.5 ms a step");
        assert_eq!(limit_words(&Limit::default()), "none");
    }

    #[test]
    fn views_that_only_some_steps_have_get_a_column_each() {
        let with = |views: &[(f64, f64)]| ReportStep { views: views.to_vec(), ..ReportStep::default() };
        let steps = [with(&[(10.0, 30.0)]), with(&[]), with(&[(10.0, 31.0), (20.0, 29.0)])];
        assert_eq!(angles(&steps), [10.0, 20.0]);
        assert_eq!(step_cells(&steps[1], &[10.0, 20.0])[10..12], ["–", "–"]);
    }
}
