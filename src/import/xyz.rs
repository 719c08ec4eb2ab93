//! XYZ: lines of text, or raw triples of floats.

use super::gather::{Gather, Values};
use super::{ImportError, Imported};
use std::path::Path;

/// Number of bytes by which text is distinguished from raw floats.
const PROBE: usize = 1 << 16;

pub(super) fn read(path: &Path, bytes: &[u8]) -> Result<Imported, ImportError> {
    // Text holds no control characters but white space; floats hold a byte below 32 soon, in exponents or zeros. Those of
    // one or two particles may hold none, and then no end of a line, and they are no characters either.
    let is_text = |&byte: &u8| byte >= 32 && byte != 127 || matches!(byte, b'\t' | b'\n' | b'\r');
    let printable = bytes[..bytes.len().min(PROBE)].iter().all(is_text);
    let has_lines = || bytes.contains(&b'\n') || std::str::from_utf8(bytes).is_ok();
    if printable && has_lines() { text(path, bytes) } else { raw(path, bytes) }
}

/// Triples of little-endian single-precision floats, without a header.
fn raw(path: &Path, bytes: &[u8]) -> Result<Imported, ImportError> {
    if !bytes.len().is_multiple_of(12) {
        let (place, found) =
            (format!("byte {}", bytes.len() / 12 * 12), format!("{} bytes", bytes.len() % 12));
        return Err(ImportError::malformed(path, place, found, "three floats of 4 bytes for each particle"));
    }
    let float = |bytes: &[u8]| f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
    let positions: Vec<f32> = bytes.chunks_exact(4).map(float).collect();
    Ok(Gather::new(path, &positions)?.finish())
}

/// Lines `x y z` with further columns; an optional count, comments, an optional line of column names.
fn text(path: &Path, bytes: &[u8]) -> Result<Imported, ImportError> {
    let Ok(text) = std::str::from_utf8(bytes) else {
        return Err(ImportError::malformed(path, "text", "bytes that are no text", "UTF-8"));
    };
    let mut lines: Vec<(usize, Vec<&str>)> = Vec::new();
    let mut names: Vec<&str> = Vec::new();
    // Whether nothing but counts was read.
    let mut only_counts = true;
    for (number, line) in text.lines().enumerate() {
        let comment = line.trim_start().strip_prefix('#');
        let fields: Vec<&str> =
            comment.unwrap_or(line).split([' ', '\t', ',']).filter(|field| !field.is_empty()).collect();
        if only_counts && is_names(&fields) {
            names = fields;
        } else if comment.is_none() && !fields.is_empty() {
            only_counts &= fields.len() == 1;
            lines.push((number + 1, fields));
        }
    }
    let rows = without_count(path, &mut lines)?;
    // Without a particle, the line of names alone determines the columns.
    let columns = rows.first().map_or(names.len().max(3), |(_, fields)| fields.len());
    let mut values = vec![Vec::with_capacity(rows.len()); columns];
    for (particle, (line, fields)) in rows.iter().enumerate() {
        if fields.len() != columns || columns < 3 {
            let place = format!("line {line}, particle {particle}");
            let expected = if columns < 3 { "x y z".into() } else { format!("{columns}, as before") };
            return Err(ImportError::malformed(path, place, format!("{} columns", fields.len()), expected));
        }
        for (column, field) in fields.iter().enumerate() {
            let Ok(value) = field.parse::<f64>() else {
                let place = format!("line {line}, particle {particle}, column {}", column + 1);
                return Err(ImportError::malformed(path, place, format!("{field:?}"), "a number"));
            };
            values[column].push(value as f32);
        }
    }
    gather(path, &values, &names, rows)
}

/// Whether a line names the columns.
fn is_names(fields: &[&str]) -> bool {
    fields.len() >= 3
        && ["x", "y", "z"].iter().zip(fields).all(|(name, field)| field.eq_ignore_ascii_case(name))
}

/// Drops a leading count and the comment behind it; compares the count.
fn without_count<'a, 'b>(
    path: &Path,
    lines: &'a mut [(usize, Vec<&'b str>)],
) -> Result<&'a [(usize, Vec<&'b str>)], ImportError> {
    let [(line, first), rest @ ..] = &*lines else { return Ok(lines) };
    let ([field], Ok(count)) = (&first[..], first[0].parse::<usize>()) else { return Ok(lines) };
    if rest.len() == count {
        Ok(rest)
    } else if Some(rest.len()) == count.checked_add(1) {
        Ok(&rest[1..])
    } else {
        let found = format!("a count of {field}");
        Err(ImportError::malformed(
            path,
            format!("line {line}"),
            found,
            format!("{} lines of particles", rest.len()),
        ))
    }
}

/// Names the columns and takes those that a line of names explains.
fn gather(
    path: &Path,
    values: &[Vec<f32>],
    names: &[&str],
    rows: &[(usize, Vec<&str>)],
) -> Result<Imported, ImportError> {
    let interleave = |first: usize| -> Vec<f32> {
        (0..rows.len()).flat_map(|i| (first..first + 3).map(move |column| values[column][i])).collect()
    };
    let mut gather = Gather::new(path, &interleave(0))?;
    if names.len() != values.len() {
        for column in 3..values.len() {
            gather
                .ignore(&format!("column {}", column + 1), "no line names the columns (# x y z vx vy vz …)");
        }
        return Ok(gather.finish());
    }
    let mut column = 3;
    while column < names.len() {
        let triple = names.get(column..column + 3).map(|names| names.join(" ").to_ascii_lowercase());
        match triple.as_deref() {
            Some("vx vy vz") => gather.add("velocity", 3, Values::Float(interleave(column)))?,
            Some("nx ny nz") => gather.add("normal", 3, Values::Float(interleave(column)))?,
            _ => {
                let integers: Option<Vec<i64>> =
                    rows.iter().map(|(_, fields)| fields[column].parse().ok()).collect();
                let values = integers.map_or_else(|| Values::Float(values[column].clone()), Values::Int);
                gather.add(names[column], 1, values)?;
                column += 1;
                continue;
            }
        }
        column += 3;
    }
    Ok(gather.finish())
}
