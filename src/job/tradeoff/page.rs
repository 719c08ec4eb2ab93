//! A table and its plot as files: CSV for spreadsheets, SVG for documents, HTML to look at.

use super::{
    column::Shown,
    plot::{self, escaped},
    table::Table,
};
use crate::job::{RunError, ShotFolder};
use std::path::{Path, PathBuf};

/// Significant digits on the page.
const DIGITS: i32 = 3;

/// Writes `tradeoff.csv`, `tradeoff.svg` and `tradeoff.html` into `folder` and returns their paths.
///
/// # Errors
/// If one cannot be written.
pub(crate) fn write(table: &Table, folder: &Path) -> Result<[PathBuf; 3], RunError> {
    let paths = ["csv", "svg", "html"].map(|ending| folder.join(format!("tradeoff.{ending}")));
    for (path, text) in paths.iter().zip([csv(table), plot::svg(table), html(table)]) {
        ShotFolder::write(path.clone(), &text)?;
    }
    Ok(paths)
}

fn csv(table: &Table) -> String {
    table.csv().iter().map(|fields| csv_line(fields)).collect()
}

/// A line of a CSV file.
pub(crate) fn csv_line(fields: &[String]) -> String {
    let quoted = |field: &String| {
        let is_plain = !field.contains([',', '"', '\n', '\r']);
        if is_plain { field.clone() } else { format!("\"{}\"", field.replace('"', "\"\"")) }
    };
    fields.iter().map(quoted).collect::<Vec<_>>().join(",") + "\n"
}

/// The plot and the table as one page that needs no other file.
fn html(table: &Table) -> String {
    let title = escaped(&table.about.title);
    let row = |(mark, cells): (&str, Vec<String>), tag: &str| {
        let cells: String = cells.iter().map(|cell| format!("<{tag}>{}", escaped(cell))).collect();
        format!("<tr class=\"{mark}\">{cells}</tr>")
    };
    let mut lines = table.lines(Shown::Page, DIGITS).into_iter();
    let head: String = lines.next().map(|head| row(head, "th")).into_iter().collect();
    let rows: String = lines.map(|line| row(line, "td")).collect();
    let meaning = |(heading, text): (&str, String)| format!("<dt>{}<dd>{}", escaped(heading), escaped(&text));
    let legend: String = table.legend(Shown::Page, DIGITS).into_iter().map(meaning).collect();
    format!(
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><title>{title}: time against error</title><style>\
         body{{font:15px/1.5 system-ui,sans-serif;margin:2em;color:#222}}svg{{max-width:100%;height:auto}}\
         table{{border-collapse:collapse}}td,th{{padding:.2em .8em;text-align:right;border-bottom:1px solid #ddd}}\
         td:nth-child(2),th:nth-child(2){{text-align:left}}.knee{{background:#fff0e0}}.front{{background:#eafaf2}}\
         .reference,.outside{{color:#777}}p,dl{{max-width:60em}}dt{{font-weight:600}}</style><h1>{title}</h1>\
         <p>{}, {} threads. Every point is a setting; lower is more exact, left is faster. No other setting is both faster and \
         more exact than a green one. After the ringed one, more time buys little. Errors in the tinted band cannot be distinguished \
         from the reference, which differs from its own refinement by {}. A setting with an error or a time of exactly 0 \
         has no place on these axes and stands in the table alone.</p>{}<table>{head}{rows}</table><dl>{legend}</dl></html>\n",
        capitalised(&escaped(&table.about.frames)),
        table.threads,
        table.uncertainty(DIGITS),
        plot::svg(table),
    )
}

fn capitalised(text: &str) -> String {
    let mut letters = text.chars();
    letters
        .next()
        .map_or_else(String::new, |first| first.to_uppercase().collect::<String>() + letters.as_str())
}
