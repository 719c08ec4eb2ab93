//! XYZ: lines of text, or raw triples of floats.

use super::gather::{Gather, Values, is_integer};
use super::{ImportError, Imported, MemoryBudget};
use std::path::Path;

/// Number of bytes by which text is distinguished from raw floats.
const PROBE: usize = 1 << 16;

pub(super) fn read(path: &Path, bytes: &[u8], budget: &MemoryBudget) -> Result<Imported, ImportError> {
    // Text holds no control characters but white space; floats hold a byte below 32 soon, in exponents or zeros. Those of
    // one or two particles may hold none, and then no end of a line, and they are no characters either.
    let is_text = |&byte: &u8| byte >= 32 && byte != 127 || matches!(byte, b'\t' | b'\n' | b'\r');
    let printable = bytes[..bytes.len().min(PROBE)].iter().all(is_text);
    let has_lines = || bytes.contains(&b'\n') || std::str::from_utf8(bytes).is_ok();
    if printable && has_lines() { text(path, bytes, budget) } else { raw(path, bytes, budget) }
}

/// Triples of little-endian single-precision floats, without a header.
fn raw(path: &Path, bytes: &[u8], budget: &MemoryBudget) -> Result<Imported, ImportError> {
    if !bytes.len().is_multiple_of(12) {
        let (place, found) =
            (format!("byte {}", bytes.len() / 12 * 12), format!("{} bytes", bytes.len() % 12));
        return Err(ImportError::malformed(path, place, found, "three floats of 4 bytes for each particle"));
    }
    let float = |bytes: &[u8]| f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
    budget.take(bytes.len() as u64)?;
    let positions: Vec<f32> = bytes.chunks_exact(4).map(float).collect();
    Ok(Gather::new(path, budget, &positions)?.finish())
}

/// Lines `x y z` with further columns; an optional count, comments, an optional line of column names.
fn text(path: &Path, bytes: &[u8], budget: &MemoryBudget) -> Result<Imported, ImportError> {
    let Ok(text) = std::str::from_utf8(bytes) else {
        return Err(ImportError::malformed(path, "text", "bytes that are no text", "UTF-8"));
    };
    // The lines are counted first and kept never: a list of their words would take many times the memory of the text.
    let mut lines = Lines::new(text);
    let first = lines.next();
    let count = usize::from(first.is_some()) + lines.by_ref().count();
    let names = lines.names;
    let heading = first.map_or(Ok(0), |first| heading(path, first, count))?;
    let rows = || Lines::new(text).skip(heading).enumerate();
    // Without a particle, the line of names alone determines the columns.
    let columns = rows().next().map_or(names.len().max(3), |(_, (_, line))| fields(line).count());
    // A number takes two bytes, but for the last.
    let numbers = (count - heading).saturating_mul(columns).min(text.len() / 2 + 1);
    budget.take_numbers::<f64>(numbers)?;
    let mut values = Vec::with_capacity(numbers);
    let mut integral = vec![true; columns];
    for (particle, (line, text)) in rows() {
        let found = fields(text).count();
        if found != columns || columns < 3 {
            let place = format!("line {line}, particle {particle}");
            let expected = if columns < 3 { "x y z".into() } else { format!("{columns}, as before") };
            return Err(ImportError::malformed(path, place, format!("{found} columns"), expected));
        }
        for (column, field) in fields(text).enumerate() {
            let Ok(value) = field.parse::<f64>() else {
                let place = format!("line {line}, particle {particle}, column {}", column + 1);
                return Err(ImportError::malformed(path, place, format!("{field:?}"), "a number"));
            };
            integral[column] &= field.parse::<i64>().is_ok();
            values.push(value);
        }
    }
    gather(path, budget, &Table { columns, values, integral }, &names)
}

/// The fields of a line of numbers or names.
fn fields(line: &str) -> impl Iterator<Item = &str> {
    line.split([' ', '\t', ',']).filter(|field| !field.is_empty())
}

/// The lines of counts and particles with their numbers, from 1.
struct Lines<'a> {
    lines: std::iter::Enumerate<std::str::Lines<'a>>,
    /// The names of the columns, as far as lines were read.
    names: Vec<&'a str>,
    /// Whether nothing but counts was read.
    only_counts: bool,
}

impl<'a> Lines<'a> {
    fn new(text: &'a str) -> Self {
        Self { lines: text.lines().enumerate(), names: Vec::new(), only_counts: true }
    }
}

impl<'a> Iterator for Lines<'a> {
    type Item = (usize, &'a str);

    fn next(&mut self) -> Option<Self::Item> {
        for (number, line) in self.lines.by_ref() {
            let comment = line.trim_start().strip_prefix('#');
            let text = comment.unwrap_or(line);
            if self.only_counts && is_names(text) {
                self.names = fields(text).collect();
            } else if comment.is_none() && fields(text).next().is_some() {
                self.only_counts &= fields(text).nth(1).is_none();
                return Some((number + 1, text));
            }
        }
        None
    }
}

/// Whether a line names the columns.
fn is_names(line: &str) -> bool {
    let mut fields = fields(line);
    ["x", "y", "z"].iter().all(|name| fields.next().is_some_and(|field| field.eq_ignore_ascii_case(name)))
}

/// The number of lines before the first particle, of `count`: a count, which is compared, and the comment behind it.
fn heading(path: &Path, (line, text): (usize, &str), count: usize) -> Result<usize, ImportError> {
    let mut words = fields(text);
    let (Some(field), None) = (words.next(), words.next()) else { return Ok(0) };
    let Ok(stated) = field.parse::<usize>() else { return Ok(0) };
    let rest = count - 1;
    if rest == stated {
        Ok(1)
    } else if Some(rest) == stated.checked_add(1) {
        Ok(2)
    } else {
        let (place, found) = (format!("line {line}"), format!("a count of {field}"));
        Err(ImportError::malformed(path, place, found, format!("{rest} lines of particles")))
    }
}

/// The numbers of all particles.
struct Table {
    columns: usize,
    /// Particle by particle; doubles hold integers of 32 bits.
    values: Vec<f64>,
    /// Whether all numbers of a column are written as integers.
    integral: Vec<bool>,
}

impl Table {
    /// `width` columns from `first` on, particle by particle.
    fn numbers(&self, first: usize, width: usize) -> impl Iterator<Item = f64> {
        self.values.chunks_exact(self.columns).flat_map(move |row| row[first..first + width].iter().copied())
    }

    /// These columns in single precision.
    fn floats(&self, budget: &MemoryBudget, first: usize, width: usize) -> Result<Vec<f32>, ImportError> {
        budget.take_numbers::<f32>(self.values.len() / self.columns * width)?;
        Ok(self.numbers(first, width).map(|value| value as f32).collect())
    }
}

/// Names the columns and takes those that a line of names explains.
fn gather(
    path: &Path,
    budget: &MemoryBudget,
    table: &Table,
    names: &[&str],
) -> Result<Imported, ImportError> {
    let mut gather = Gather::new(path, budget, &table.floats(budget, 0, 3)?)?;
    if names.len() != table.columns {
        for column in 3..table.columns {
            gather
                .ignore(&format!("column {}", column + 1), "no line names the columns (# x y z vx vy vz …)");
        }
        return Ok(gather.finish());
    }
    let mut column = 3;
    while column < names.len() {
        let triple = names.get(column..column + 3).map(|names| names.join(" ").to_ascii_lowercase());
        let vector = match triple.as_deref() {
            Some("vx vy vz") => Some("velocity"),
            Some("nx ny nz") => Some("normal"),
            _ => None,
        };
        if let Some(name) = vector {
            gather.add(name, 3, Values::Float(table.floats(budget, column, 3)?))?;
            column += 3;
            continue;
        }
        let values = if table.integral[column] && is_integer(names[column]) {
            budget.take_numbers::<i64>(table.values.len() / table.columns)?;
            Values::Int(table.numbers(column, 1).map(|value| value as i64).collect())
        } else {
            Values::Float(table.floats(budget, column, 1)?)
        };
        gather.add(names[column], 1, values)?;
        column += 1;
    }
    Ok(gather.finish())
}
