//! A tradeoff's table in words.

use crate::{
    cli::{args::TradeoffArgs, plan::duration},
    run::{
        RunError,
        tradeoff::{Compared, Line, Spread, Table, rows},
    },
};
use std::path::{Path, PathBuf};

/// How a table of what is compared is told.
pub(super) trait Tell: Compared {
    /// What made it, as on the command line.
    const COMMAND: &'static str;
    /// What a time limit is for.
    const WHOLE: &'static str;
    /// What settings that give the same have in common.
    const SAME: &'static str;

    /// The frames, and what else to know of the particles in them.
    fn about(&self) -> String;
    /// The name of the error that decides.
    fn decides(table: &Table<Self>) -> &'static str;
    /// The columns, without those that every table has: number and setting before them, the mark after them.
    fn head(table: &Table<Self>) -> Vec<&'static str>;
    /// What is in them; `is_repeated` if settings were timed several times.
    fn cells(table: &Table<Self>, line: &Line<Self>, is_repeated: bool) -> Vec<String>;
    /// What the columns mean, a line each, and how far the reference is certain.
    fn legend(table: &Table<Self>) -> String;
    /// What else there is to say of a line.
    fn notes(line: &Line<Self>) -> Vec<String>;
    /// What a setting is that keeps a limit.
    fn kept(most: f64) -> String;
    /// What the setting does to the shot and what it takes, for the preset that is written of it.
    fn reason(table: &Table<Self>, line: &Line<Self>) -> String;
    /// Writes the table to the folder as files.
    fn write(table: &Table<Self>, folder: &Path) -> Result<[PathBuf; 3], RunError>;
}

/// What people read: a line a setting, then how to read it.
pub(super) fn describe<C: Tell>(table: &Table<C>) -> String {
    let mut head = vec!["", "setting"];
    head.extend(C::head(table));
    head.push("");
    let is_repeated = table.lines.iter().any(|line| line.seconds.min < line.seconds.max);
    let rows = rows(table, |number, line, mark| {
        let mut cells = vec![number.into(), line.label.clone()];
        cells.extend(C::cells(table, line, is_repeated));
        cells.push(if line.diverged.is_some() { "diverged".into() } else { mark.into() });
        cells
    });
    let Table { title, threads, .. } = table;
    let mut text = format!("{title}, {}, {threads} threads\n\n{}\n", table.about.about(), drawn(&head, rows));
    text += &format!(
        "front       settings that no other beats in both time and {}; knee: after it, more time buys little\n{}",
        C::decides(table),
        C::legend(table)
    );
    text + &notes(table)
}

/// What there is to say of lines.
fn notes<C: Tell>(table: &Table<C>) -> String {
    let mut text = String::new();
    let failed = [("reference", &table.reference), ("refined reference", &table.refined)];
    for (name, why) in failed.iter().filter_map(|(name, line)| Some((name, line.diverged.as_ref()?))) {
        text += &format!("\nnote        the {name} diverged, so what is compared with it is left out: {why}");
    }
    for first in 0..table.lines.len() {
        let lines = table.lines.iter().enumerate().filter(|(_, line)| line.same_as == Some(first));
        let same: Vec<String> = lines.map(|(place, _)| (place + 1).to_string()).collect();
        if !same.is_empty() {
            text += &format!("\nsame        {} {}: {}", C::SAME, first + 1, same.join(", "));
        }
    }
    for (place, line) in table.lines.iter().enumerate() {
        if let Some(why) = &line.diverged {
            text += &format!("\ndiverged    {}: {why}", place + 1);
        }
        for note in C::notes(line) {
            text += &format!("\nnote        {}: {note}", place + 1);
        }
    }
    text
}

/// The setting to use, and why.
pub(super) fn advice<C: Tell>(table: &Table<C>, place: usize, args: &TradeoffArgs, command: &str) -> String {
    let line = &table.lines[place];
    let why = match (args.time, args.dev) {
        (None, None) => "the knee: faster settings lose much, slower ones gain little".to_owned(),
        (time, None) => format!("the most exact within {} for {}", duration(time.unwrap_or(0.0)), C::WHOLE),
        (_, Some(dev)) => C::kept(dev),
    };
    let flags = flags(line.quality.as_ref(), &line.set);
    format!("\nuse         {}: {why}\n            meniscus {command} {flags}", place + 1)
}

/// Where the chosen preset comes from.
pub(super) fn comment<C: Tell>(table: &Table<C>, place: usize) -> String {
    let line = &table.lines[place];
    format!(
        "# {}: chosen by `{}` over {} among {} settings.\n# Setting: {}. {} on {} threads.",
        one_line(&table.title),
        C::COMMAND,
        table.about.about(),
        table.lines.len(),
        line.label,
        C::reason(table, line),
        table.threads,
    )
}

/// A table to look at: below its head the settings, and the reference.
fn drawn(head: &[&str], rows: Vec<(&'static str, Vec<String>)>) -> String {
    let head = head.iter().map(|&name| name.to_owned()).collect();
    aligned(&[head].into_iter().chain(rows.into_iter().map(|(_, cells)| cells)).collect::<Vec<_>>())
}

/// The median of times [s], and their range if settings were `repeated`.
pub(super) fn seconds(spread: &Spread, repeated: bool, digits: usize) -> String {
    let Spread { median, min, max } = spread;
    match repeated {
        true => format!("{median:.digits$} ({min:.digits$}-{max:.digits$})"),
        false => format!("{median:.digits$}"),
    }
}

/// Columns under each other: the setting to the left, figures to the right.
fn aligned(rows: &[Vec<String>]) -> String {
    let count = rows.first().map_or(0, Vec::len);
    let width = |column: usize| rows.iter().map(|row| row[column].chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = (0..count).map(width).collect();
    let line = |row: &Vec<String>| {
        let cells = row.iter().zip(&widths).enumerate().map(|(column, (cell, &width))| {
            if column == 1 || column + 1 == count {
                format!("{cell:<width$}")
            } else {
                format!("{cell:>width$}")
            }
        });
        cells.collect::<Vec<_>>().join("  ").trim_end().to_owned() + "\n"
    };
    rows.iter().map(line).collect()
}

/// How far the reference is certain, of its errors.
pub(super) fn certainty(errors: &[(&str, String)]) -> String {
    let errors: Vec<String> = errors.iter().map(|(name, error)| format!("{name} {error}")).collect();
    format!(
        "certainty   the reference differs from its own refinement by {}: smaller errors show as ≤",
        errors.join(", ")
    )
}

/// Bytes as MiB.
pub(super) fn mib(bytes: Option<u64>) -> String {
    maybe(bytes.map(|bytes| bytes as f64), &|bytes| format!("{:.0}", bytes / f64::from(1 << 20)))
}

/// A value in words; a dash where there is none.
pub(super) fn maybe(value: Option<f64>, say: &dyn Fn(f64) -> String) -> String {
    value.map_or_else(|| "-".into(), say)
}

/// An error in words, as far as the reference can tell: what is below `floor` shows as ≤.
pub(super) fn at_least(value: Option<f64>, floor: Option<f64>, say: &dyn Fn(f64) -> String) -> String {
    match (value, floor) {
        (Some(value), Some(floor)) if value < floor => format!("≤ {}", say(floor)),
        (value, _) => maybe(value, say),
    }
}

pub(super) fn percent(fraction: f64) -> String {
    format!("{} %", short(100.0 * fraction))
}

/// Two significant digits: what a table of errors is good for.
pub(super) fn short(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return value.to_string();
    }
    let digits = (1 - value.abs().log10().floor() as i32).clamp(0, 9) as usize;
    format!("{value:.digits$}")
}

/// A setting as arguments.
pub(super) fn flags(quality: Option<&String>, set: &[String]) -> String {
    let flags: Vec<String> = quality
        .iter()
        .map(|tier| format!("--quality {tier}"))
        .chain(set.iter().map(|set| format!("--set {}", for_a_shell(set))))
        .collect();
    if flags.is_empty() { "(as written)".into() } else { flags.join(" ") }
}

/// An argument that shells hand on as it is.
fn for_a_shell(text: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "._=%+-/".contains(c);
    if text.chars().all(plain) { text.into() } else { format!("'{}'", text.replace('\'', "'\\''")) }
}

fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arguments_survive_a_shell() {
        assert_eq!(for_a_shell("liquid.density_dev=0.3%"), "liquid.density_dev=0.3%");
        assert_eq!(for_a_shell("a=[0, 1]"), "'a=[0, 1]'");
        assert_eq!(for_a_shell("a=it's"), r"'a=it'\''s'");
    }

    #[test]
    fn columns_stand_under_each_other() {
        let rows = [["", "setting", "s"], ["1", "a", "10"]].map(|row| row.map(String::from).to_vec());
        assert_eq!(aligned(&rows), "   setting  s\n1  a        10\n");
        assert_eq!([0.0, 0.01234, 1.26, 130.0].map(short), ["0", "0.012", "1.3", "130"]);
    }
}
