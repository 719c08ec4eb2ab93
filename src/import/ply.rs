//! PLY: element `vertex`, ASCII or binary of either byte order.

use super::gather::{Gather, Values};
use super::ply_numbers::{Fault, Numbers};
use super::{ImportError, Imported, MemoryBudget};
use crate::{frame::COLOR, math::srgb};
use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{DefaultElement, ElementDef, Encoding, Header, PropertyType, ScalarType};
use std::path::Path;

/// The scalars of the vertices, vertex by vertex in the order of the header; lists are passed over. Doubles hold every scalar
/// type of the format exactly.
struct Rows {
    /// Scalars of a vertex.
    width: usize,
    values: Vec<f64>,
}

impl Rows {
    /// The values of a scalar property.
    fn column(&self, index: usize) -> impl Iterator<Item = f64> {
        self.values.chunks_exact(self.width).map(move |row| row[index])
    }
}

/// A scalar property of the vertices and its place in [`Rows`].
struct Column<'a> {
    name: &'a str,
    is_float: bool,
    is_byte: bool,
    index: usize,
}

/// Three properties that make a vector: their names and the channel's.
const VECTORS: [([&str; 3], &str); 3] =
    [(["x", "y", "z"], "position"), (["vx", "vy", "vz"], "velocity"), (["nx", "ny", "nz"], "normal")];

/// Bytes that make colours in sRGB.
pub(super) const COLORS: [&str; 3] = ["red", "green", "blue"];

pub(super) fn read(path: &Path, bytes: &[u8], budget: &MemoryBudget) -> Result<Imported, ImportError> {
    let mut reader = Reader::new(bytes);
    let header = Parser::<DefaultElement>::new().read_header(&mut reader).map_err(|error| {
        let place = format!("header, line {}", error.line().unwrap_or(reader.line()));
        ImportError::malformed(path, place, one_line(&error.to_string()), "a PLY header")
    })?;
    let Some(vertex) = header.elements.get("vertex") else {
        let found = format!("the elements {:?}", header.elements.keys().collect::<Vec<_>>());
        return Err(ImportError::malformed(path, "header", found, "an element vertex"));
    };
    let rows = vertices(path, &mut reader, &header, budget)?;
    let columns = columns(vertex);
    let triple = |names: [&str; 3]| -> Option<Vec<&Column>> {
        names.iter().map(|name| columns.iter().find(|column| column.name == *name)).collect()
    };
    let Some(position) = triple(VECTORS[0].0) else {
        let found = format!("the properties {:?}", vertex.properties.keys().collect::<Vec<_>>());
        return Err(ImportError::malformed(path, "header, element vertex", found, "x, y and z"));
    };

    let floats = |columns: &[&Column]| -> Result<Vec<f32>, ImportError> {
        let indices: Vec<usize> = columns.iter().map(|column| column.index).collect();
        budget.take_numbers::<f32>(rows.values.len() / rows.width * columns.len())?;
        let rows = rows.values.chunks_exact(rows.width);
        Ok(rows.flat_map(|row| indices.iter().map(|&index| row[index] as f32)).collect())
    };
    let mut gather = Gather::new(path, budget, &floats(&position)?)?;
    let mut used: Vec<&str> = VECTORS[0].0.to_vec();
    for (names, channel) in &VECTORS[1..] {
        if let Some(triple) = triple(*names) {
            gather.add(channel, 3, Values::Float(floats(&triple)?))?;
            used.extend(names);
        }
    }
    if let Some(parts) = triple(COLORS).filter(|parts| parts.iter().all(|part| part.is_byte)) {
        let mut values = floats(&parts)?;
        let light = srgb::linear_of_bytes();
        // Text may have any integer.
        if values.iter().all(|value| (0.0..=255.0).contains(value)) {
            values.iter_mut().for_each(|value| *value = light[*value as usize]);
            gather.add(COLOR, 3, Values::Float(values))?;
            used.extend(COLORS);
        }
    }
    for column in columns.iter().filter(|column| !used.contains(&column.name)) {
        let values = if column.is_float {
            Values::Float(floats(&[column])?)
        } else {
            budget.take_numbers::<i64>(rows.values.len() / rows.width)?;
            Values::Int(rows.column(column.index).map(|value| value as i64).collect())
        };
        gather.add(column.name, 1, values)?;
    }
    for (name, property) in &vertex.properties {
        if matches!(property.data_type, PropertyType::List(..)) {
            gather.ignore(name, "a list");
        }
    }
    for (name, element) in header.elements.iter().filter(|(name, _)| *name != "vertex") {
        gather.ignore(name, format!("{} entries that are no vertices", element.count));
    }
    Ok(gather.finish())
}

/// Reads the vertices; elements before them are passed over.
fn vertices(
    path: &Path,
    reader: &mut Reader<&[u8]>,
    header: &Header,
    budget: &MemoryBudget,
) -> Result<Rows, ImportError> {
    let mut line = reader.line() - 1;
    let mut numbers = Numbers { rest: reader.get_ref(), encoding: header.encoding };
    for (name, element) in &header.elements {
        let left = numbers.rest.len();
        let min = min_bytes(element, header.encoding);
        if min as u128 * element.count as u128 > left as u128 {
            let found = format!("{left} bytes");
            let expected = format!("at least {min} for each of {} entries", element.count);
            return Err(ImportError::malformed(path, format!("element {name}"), found, expected));
        }
        let scalars = |property: &PropertyType| matches!(property, PropertyType::Scalar(_));
        let width = element.properties.iter().filter(|(_, property)| scalars(&property.data_type)).count();
        let mut values = Vec::new();
        if name == "vertex" {
            // A scalar takes a byte at least, so this is in proportion to the file.
            budget.take_numbers::<f64>(element.count.saturating_mul(width))?;
            values.reserve_exact(element.count.saturating_mul(width));
        }
        // An entry without properties has no byte in a binary file, and there may be as many elements of such entries as lines.
        let is_empty = element.properties.is_empty() && header.encoding != Encoding::Ascii;
        for entry in 0..if is_empty { 0 } else { element.count } {
            line += 1;
            values.truncate(if name == "vertex" { values.len() } else { 0 });
            let is_text = header.encoding == Encoding::Ascii;
            let read = if is_text {
                ascii_row(&mut numbers.rest, element, &mut values)
            } else {
                binary_row(&mut numbers, element, &mut values)
            };
            read.map_err(|(found, expected)| {
                let place = if is_text { format!("line {line}") } else { format!("entry {entry}") };
                ImportError::malformed(path, format!("element {name}, {place}"), found, expected)
            })?;
        }
        if name == "vertex" {
            // Without scalars there is no row either.
            return Ok(Rows { width: width.max(1), values });
        }
    }
    Ok(Rows { width: 1, values: Vec::new() })
}

/// Reads an entry of a binary file.
fn binary_row(numbers: &mut Numbers, element: &ElementDef, row: &mut Vec<f64>) -> Result<(), Fault> {
    for (_, property) in &element.properties {
        match &property.data_type {
            PropertyType::Scalar(kind) => row.push(numbers.next(kind)?),
            PropertyType::List(count, kind) => {
                for _ in 0..numbers.next(count)? as usize {
                    numbers.next(kind)?;
                }
            }
        }
    }
    Ok(())
}

/// Reads the line of one entry. The parser's own reader of lines knows neither `nan` nor `inf`, which some solvers write and which
/// must be reported by particle.
fn ascii_row(rest: &mut &[u8], element: &ElementDef, row: &mut Vec<f64>) -> Result<(), Fault> {
    if rest.is_empty() {
        return Err(("the end of the file".into(), "a line for every entry"));
    }
    let end = rest.iter().position(|&byte| byte == b'\n').unwrap_or(rest.len());
    let line = String::from_utf8_lossy(&rest[..end]);
    *rest = &rest[(end + 1).min(rest.len())..];
    let mut words = line.split_whitespace();
    let mut number = |what| {
        let word = words.next().unwrap_or("the end of the line");
        word.parse::<f64>().map_err(|_| (word.to_owned(), what))
    };
    for (_, property) in &element.properties {
        match property.data_type {
            PropertyType::Scalar(ref kind) => {
                let value = number("a number for every property")?;
                if !is_float(kind) && value.fract() != 0.0 {
                    return Err((value.to_string(), "an integer"));
                }
                row.push(value);
            }
            PropertyType::List(..) => {
                // A count that is no count ends at the end of the line.
                for _ in 0..number("the length of a list")? as usize {
                    number("an item of a list")?;
                }
            }
        }
    }
    match words.next() {
        Some(word) => Err((word.to_owned(), "the end of the line")),
        None => Ok(()),
    }
}

/// Minimum size of an entry [bytes]; one at least, so that entries without properties cannot be counted forever.
fn min_bytes(element: &ElementDef, encoding: Encoding) -> usize {
    let min = |kind: &PropertyType| match (encoding, kind) {
        // A digit and the space or line end behind it, which the last line may lack.
        (Encoding::Ascii, _) => 1,
        (_, PropertyType::Scalar(scalar) | PropertyType::List(scalar, _)) => match scalar {
            ScalarType::Char | ScalarType::UChar => 1,
            ScalarType::Short | ScalarType::UShort => 2,
            ScalarType::Int | ScalarType::UInt | ScalarType::Float => 4,
            ScalarType::Double => 8,
        },
    };
    element.properties.iter().map(|(_, property)| min(&property.data_type)).sum::<usize>().max(1)
}

fn is_float(kind: &ScalarType) -> bool {
    matches!(kind, ScalarType::Float | ScalarType::Double)
}

fn columns<'a>(vertex: &'a ElementDef) -> Vec<Column<'a>> {
    let scalars = vertex.properties.iter().filter_map(|(name, property)| match &property.data_type {
        PropertyType::Scalar(kind) => Some((name, kind)),
        PropertyType::List(..) => None,
    });
    let column = |(index, (name, kind)): (usize, (&'a String, &ScalarType))| {
        let is_byte = matches!(kind, ScalarType::UChar);
        Column { name, is_float: is_float(kind), is_byte, index }
    };
    scalars.enumerate().map(column).collect()
}

/// The parser's message without its line ends.
fn one_line(message: &str) -> String {
    message.split_whitespace().collect::<Vec<_>>().join(" ")
}
