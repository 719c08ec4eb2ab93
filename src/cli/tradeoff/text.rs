//! A tradeoff's table as text.

use crate::{
    cli::args::TradeoffArgs,
    control::shell_word,
    job::usage::duration,
    run::tradeoff::{Setting, Shown, Table},
};

/// Significant digits: what a table of errors is good for.
const DIGITS: i32 = 2;

/// A line per setting, then how to read them.
pub(super) fn describe(table: &Table) -> String {
    let lines: Vec<_> = table.lines(Shown::Everywhere, DIGITS).into_iter().map(|(_, cells)| cells).collect();
    let mut text = format!(
        "{}, {}, {} threads\n\n{}",
        table.about.title,
        table.about.frames,
        table.threads,
        aligned(&lines)
    );
    let mut add_line = |heading: &str, words: &str| text += &format!("\n{heading:<11} {words}");
    table.legend(Shown::Everywhere, DIGITS).iter().for_each(|(heading, words)| add_line(heading, words));
    for (name, row) in [("reference", &table.reference), ("refined reference", &table.refined)] {
        if let Some(why) = &row.diverged {
            add_line("note", &format!("the {name} diverged, so nothing is compared with it: {why}"));
        }
    }
    for (name, row) in (1..)
        .map(|place: usize| place.to_string())
        .zip(&table.rows)
        .chain([("the reference".into(), &table.reference)])
    {
        table
            .out_of_bounds(row, DIGITS)
            .iter()
            .for_each(|why| add_line("outside", &format!("{name}: {why}")));
    }
    for first in 0..table.rows.len() {
        let same = table.rows.iter().enumerate().filter(|(_, row)| row.same_as == Some(first));
        let same: Vec<String> = same.map(|(place, _)| (place + 1).to_string()).collect();
        if !same.is_empty() {
            add_line("same", &format!("{} {}: {}", table.wording.same, first + 1, same.join(", ")));
        }
    }
    for (place, row) in (1..).zip(&table.rows) {
        row.diverged.iter().for_each(|why| add_line("diverged", &format!("{place}: {why}")));
        table.incomparable(row).iter().for_each(|why| add_line("note", &format!("{place}: {why}")));
        for (info, cell) in table.columns.iter().zip(&row.cells).filter(|(info, _)| !info.remark.is_empty()) {
            let count = cell.map_or(0.0, |spread| spread.median);
            if count > 0.0 {
                add_line("note", &format!("{place}: {count} {}", info.remark));
            }
        }
    }
    text
}

/// The setting to use, and why.
pub(super) fn advice(table: &Table, place: usize, args: &TradeoffArgs, command: &str) -> String {
    let why = match (args.time, args.dev) {
        (None, None) => "the knee: faster settings lose much, slower ones gain little".to_owned(),
        (time, None) => {
            format!("the most exact within {} for {}", duration(time.unwrap_or(0.0)), table.wording.whole)
        }
        (_, Some(dev)) => format!("the cheapest with {}", table.limit(dev)),
    };
    let flags = flags(&table.rows[place].setting);
    format!("\nuse         {}: {why}\n            meniscus {command} {flags}", place + 1)
}

/// Why no setting is recommended, if none is within the bounds.
pub(super) fn no_advice(table: &Table) -> Option<String> {
    let bounds = table.bounds(DIGITS).filter(|_| table.are_all_outside())?;
    Some(format!(
        "\nuse         none: every setting is out of the bounds ({bounds}); `meniscus shot` names the parameter that most likely causes it"
    ))
}

/// Where the chosen preset comes from.
pub(super) fn comment(table: &Table, place: usize) -> String {
    let row = &table.rows[place];
    let title = table.about.title.split_whitespace().collect::<Vec<_>>().join(" ");
    let by = table.column(table.wording.criterion);
    format!(
        "# {title}: chosen by `meniscus tradeoff` over {} among {} settings.\n# Setting: {}. {} {}, {} for {} on {} threads.",
        table.about.frames,
        table.rows.len(),
        row.setting.label,
        table.columns[by].heading,
        table.cell(row, by, DIGITS),
        duration(table.shot_seconds(row)),
        table.wording.whole,
        table.threads,
    )
}

/// Columns under each other: the setting to the left, figures to the right.
fn aligned(rows: &[Vec<String>]) -> String {
    let count = rows.first().map_or(0, Vec::len);
    let width = |column: usize| rows.iter().map(|row| row[column].chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = (0..count).map(width).collect();
    let line = |row: &Vec<String>| {
        let cells = row.iter().zip(&widths).enumerate().map(|(column, (cell, &width))| {
            let is_text = column == 1 || column + 1 == count;
            if is_text { format!("{cell:<width$}") } else { format!("{cell:>width$}") }
        });
        cells.collect::<Vec<_>>().join("  ").trim_end().to_owned() + "\n"
    };
    rows.iter().map(line).collect()
}

/// A setting as arguments.
fn flags(setting: &Setting) -> String {
    let tier = setting.quality.iter().map(|tier| format!("--quality {tier}"));
    let flags: Vec<String> =
        tier.chain(setting.set.iter().map(|set| format!("--set {}", shell_word(set)))).collect();
    if flags.is_empty() { "(as written)".into() } else { flags.join(" ") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_aligned() {
        let rows = [["", "setting", "s"], ["1", "a", "10"]].map(|row| row.map(String::from).to_vec());
        assert_eq!(aligned(&rows), "   setting  s\n1  a        10\n");
    }
}
