//! A table and its plot as files: CSV for spreadsheets, SVG for documents, HTML to look at.

use super::{
    Compared, Line, Spread, Table,
    plot::{self, Entry, Panel, escaped},
};
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

/// How to read a plot, as HTML; `what` says what was compared, `uncertainty` how far the reference is from its refinement, if
/// anything is known of that.
pub(super) fn introduction(what: &str, uncertainty: &str) -> String {
    let uncertainty = if uncertainty.is_empty() { "an unknown amount" } else { uncertainty };
    format!(
        "{what}. Every point is a setting; lower is more exact, left is faster. Nothing beats the green ones. After the ringed \
         one, more time buys little. What lies in the tinted band cannot be told from the reference, which differs from its \
         own refinement by {uncertainty}. An error or a time of exactly 0 has no place on these axes: such settings stand in \
         the table alone."
    )
}

/// The lines of a table to look at: each setting, numbered and marked as the knee or on the front, and last the reference.
/// `cells` makes them of number, line and mark.
pub fn rows<C: Compared>(
    table: &Table<C>,
    cells: impl Fn(&str, &Line<C>, &str) -> Vec<String>,
) -> Vec<(&'static str, Vec<String>)> {
    let numbered = table.lines.iter().enumerate().map(|(place, line)| {
        let mark = match (table.knee == Some(place), line.front) {
            (true, _) => "knee",
            (false, true) => "front",
            _ => "",
        };
        (mark, cells(&(place + 1).to_string(), line, mark))
    });
    let reference = ("reference", cells("", &table.reference, "reference"));
    numbered.chain([reference]).collect()
}

/// How the plot shows an error.
pub(super) struct Shown<By> {
    pub(super) by: By,
    /// What it is, and its unit.
    pub(super) title: String,
    /// What the seconds are.
    pub(super) below: &'static str,
    /// The error's unit over that of the plot.
    pub(super) scale: f64,
}

/// The plot: a panel an error, without those that no line has.
pub(super) fn panels<C: Compared>(
    table: &Table<C>,
    shown: impl IntoIterator<Item = Shown<C::By>>,
) -> Vec<Panel> {
    let panel = |Shown { by, title, below, scale }: Shown<C::By>| {
        let entry = |(place, line): (usize, &Line<C>)| {
            let spread = C::seconds(by, line)?;
            let error = C::error(by, &line.told, &line.apart);
            let diverged = line.diverged.as_ref().map(|why| format!("diverged, {why}"));
            let lost = || C::INCOMPARABLE.filter(|_| error.is_none()).map(String::from);
            Some(Entry {
                place,
                label: line.label.clone(),
                seconds: [spread.min, spread.median, spread.max],
                error: error.map(|error| scale * error),
                lost: diverged.or_else(lost),
                knee: table.knee == Some(place) && table.by == by,
            })
        };
        let entries = table.lines.iter().enumerate().filter_map(entry).collect();
        Panel::new(title, below, entries, &table.front(by), scale * table.floor(by).unwrap_or(0.0))
    };
    shown.into_iter().filter_map(panel).collect()
}

/// The table in full: its head, each setting, the reference and its refinement; SI units, errors as fractions, empty where there is
/// no value. `own` names what a run alone tells and the distances, which `fields` makes of a line.
pub(super) fn csv<C: Compared>(
    table: &Table<C>,
    own: impl IntoIterator<Item = String>,
    fields: impl Fn(&Line<C>) -> Vec<String>,
) -> Vec<Vec<String>> {
    let split = |names: &str| names.split(',').map(String::from).collect::<Vec<_>>();
    let cost = split("setting,seconds_median,seconds_min,seconds_max,cpu_seconds,shot_seconds");
    let end = split("on_front,knee,diverged");
    let head = cost.into_iter().chain(own).chain(end).collect();
    let row = |line: &Line<C>, is_knee: bool| {
        let Spread { median, min, max } = line.seconds;
        let mut row = vec![line.label.clone()];
        row.extend([median, min, max].map(|seconds| seconds.to_string()));
        row.extend([maybe(line.cpu_seconds.map(|spread| spread.median)), line.shot_seconds.to_string()]);
        row.extend(fields(line));
        row.extend([line.front.to_string(), is_knee.to_string()]);
        row.push(line.diverged.clone().unwrap_or_default());
        row
    };
    let numbered = table.lines.iter().enumerate().map(|(place, line)| row(line, table.knee == Some(place)));
    let references = [&table.reference, &table.refined].map(|line| row(line, false));
    [head].into_iter().chain(numbered).chain(references).collect()
}
