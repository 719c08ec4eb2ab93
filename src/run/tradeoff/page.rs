//! A table and its plot as files: CSV for spreadsheets, SVG for documents, HTML to look at.

use super::plot::{self, Panel, escaped};
use crate::run::{RunError, ShotFolder};
use std::path::{Path, PathBuf};

/// What the files of a tradeoff say.
pub(super) struct Page<'a> {
    /// The shot's name.
    pub(super) title: &'a str,
    /// How to read the plot, as HTML.
    pub(super) introduction: String,
    /// The plot.
    pub(super) panels: Vec<Panel>,
    /// The table's columns; the second is the setting.
    pub(super) head: Vec<String>,
    /// Its lines: how they are marked, and their cells.
    pub(super) rows: Vec<(&'static str, Vec<String>)>,
    /// What the columns mean, as HTML.
    pub(super) legend: String,
    /// The table in full, for spreadsheets: names, then values.
    pub(super) csv: Vec<Vec<String>>,
}

impl Page<'_> {
    /// Writes `tradeoff.csv`, `tradeoff.svg` and `tradeoff.html` into `folder` and returns their paths.
    ///
    /// # Errors
    /// If one cannot be written.
    pub(super) fn write(&self, folder: &Path) -> Result<[PathBuf; 3], RunError> {
        let paths = ["csv", "svg", "html"].map(|ending| folder.join(format!("tradeoff.{ending}")));
        let texts = [self.csv(), plot::svg(&self.panels), self.html()];
        for (path, text) in paths.iter().zip(texts) {
            ShotFolder::write(path.clone(), &text)?;
        }
        Ok(paths)
    }

    fn csv(&self) -> String {
        let line =
            |fields: &Vec<String>| fields.iter().map(|field| quoted(field)).collect::<Vec<_>>().join(",");
        self.csv.iter().map(|fields| line(fields) + "\n").collect()
    }

    /// The plot and the table as one page that needs nothing else.
    fn html(&self) -> String {
        let title = escaped(self.title);
        let head: String = self.head.iter().map(|name| format!("<th>{}", escaped(name))).collect();
        let cells = |cells: &Vec<String>| cells.iter().map(|cell| format!("<td>{}", escaped(cell))).collect();
        let row = |(class, row): &(&str, Vec<String>)| {
            let cells: String = cells(row);
            format!("<tr class=\"{class}\">{cells}</tr>")
        };
        let rows: String = self.rows.iter().map(row).collect();
        format!(
            "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><title>{title}: time against error</title><style>\
             body{{font:15px/1.5 system-ui,sans-serif;margin:2em;color:#222}}svg{{max-width:100%;height:auto}}\
             table{{border-collapse:collapse}}td,th{{padding:.2em .8em;text-align:right;border-bottom:1px solid #ddd}}\
             td:nth-child(2),th:nth-child(2){{text-align:left}}.knee{{background:#fff0e0}}.front{{background:#eafaf2}}\
             .reference{{color:#777}}p{{max-width:60em}}</style><h1>{title}</h1>\
             <p>{}</p>{}<table><tr>{head}</tr>{rows}</table><p>{}</p></html>\n",
            self.introduction,
            plot::svg(&self.panels),
            self.legend,
        )
    }
}

/// A text as one field.
fn quoted(text: &str) -> String {
    if text.contains([',', '"', '\n']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text.into() }
}

/// A value as a field; nothing where there is none.
pub(super) fn maybe(value: Option<f64>) -> String {
    value.map_or_else(String::new, |value| value.to_string())
}

/// How a line of the table is marked.
pub(super) fn mark(is_knee: bool, on_front: bool) -> &'static str {
    match (is_knee, on_front) {
        (true, _) => "knee",
        (false, true) => "front",
        _ => "",
    }
}
