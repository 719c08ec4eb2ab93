//! PLY: element `vertex`, ASCII or binary of either byte order.

use super::gather::{Gather, Values};
use super::{ImportError, Imported};
use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{
    ElementDef, Encoding, Header, Property, PropertyAccess, PropertyAccessResult, PropertyType, ScalarType,
};
use std::path::Path;

/// The scalars of one vertex, in the order of the header; lists are passed over. Doubles hold every scalar
/// type of the format exactly.
struct EntryValues(Vec<f64>);

impl PropertyAccess for EntryValues {
    fn new() -> Self {
        Self(Vec::new())
    }

    fn set_property(&mut self, _name: &str, property: Property) -> PropertyAccessResult {
        let value = match property {
            Property::Char(value) => f64::from(value),
            Property::UChar(value) => f64::from(value),
            Property::Short(value) => f64::from(value),
            Property::UShort(value) => f64::from(value),
            Property::Int(value) => f64::from(value),
            Property::UInt(value) => f64::from(value),
            Property::Float(value) => f64::from(value),
            Property::Double(value) => value,
            _ => return PropertyAccessResult::Ignored,
        };
        self.0.push(value);
        PropertyAccessResult::Set
    }
}

/// A scalar property of the vertices and its place in a [`EntryValues`].
struct Column<'a> {
    name: &'a str,
    is_float: bool,
    index: usize,
}

/// Three properties that make a vector: their names and the channel's.
const VECTORS: [([&str; 3], &str); 3] =
    [(["x", "y", "z"], "position"), (["vx", "vy", "vz"], "velocity"), (["nx", "ny", "nz"], "normal")];

pub(super) fn read(path: &Path, bytes: &[u8]) -> Result<Imported, ImportError> {
    let parser = Parser::<EntryValues>::new();
    let mut reader = Reader::new(bytes);
    let header = parser.read_header(&mut reader).map_err(|error| {
        let place = format!("header, line {}", error.line().unwrap_or(reader.line()));
        ImportError::malformed(path, place, one_line(&error.to_string()), "a PLY header")
    })?;
    let Some(vertex) = header.elements.get("vertex") else {
        let found = format!("the elements {:?}", header.elements.keys().collect::<Vec<_>>());
        return Err(ImportError::malformed(path, "header", found, "an element vertex"));
    };
    let rows = vertices(path, &parser, &mut reader, &header)?;
    let columns = columns(vertex);
    let triple = |names: [&str; 3]| -> Option<Vec<&Column>> {
        names.iter().map(|name| columns.iter().find(|column| column.name == *name)).collect()
    };
    let Some(position) = triple(VECTORS[0].0) else {
        let found = format!("the properties {:?}", vertex.properties.keys().collect::<Vec<_>>());
        return Err(ImportError::malformed(path, "header, element vertex", found, "x, y and z"));
    };

    let mut gather = Gather::new(path, &floats(&rows, &position))?;
    let mut used: Vec<&str> = VECTORS[0].0.to_vec();
    for (names, channel) in &VECTORS[1..] {
        if let Some(triple) = triple(*names) {
            gather.add(channel, 3, Values::Float(floats(&rows, &triple)))?;
            used.extend(names);
        }
    }
    for column in columns.iter().filter(|column| !used.contains(&column.name)) {
        let values = if column.is_float {
            Values::Float(floats(&rows, &[column]))
        } else {
            Values::Int(rows.iter().map(|row| row.0[column.index] as i64).collect())
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

/// Reads the vertices; elements before them are read and passed over.
fn vertices(
    path: &Path,
    parser: &Parser<EntryValues>,
    reader: &mut Reader<&[u8]>,
    header: &Header,
) -> Result<Vec<EntryValues>, ImportError> {
    let mut line = reader.line() - 1;
    for (name, element) in &header.elements {
        let left = reader.get_ref().len();
        let min = min_bytes(element, header.encoding);
        if min as u128 * element.count as u128 > left as u128 {
            let found = format!("{left} bytes");
            let expected = format!("at least {min} for each of {} entries", element.count);
            return Err(ImportError::malformed(path, format!("element {name}"), found, expected));
        }
        let rows = if header.encoding == Encoding::Ascii {
            let rows = (0..element.count).map(|_| {
                line += 1;
                ascii_row(reader.get_mut(), element).map_err(|(found, expected)| {
                    ImportError::malformed(path, format!("element {name}, line {line}"), found, expected)
                })
            });
            rows.collect::<Result<_, _>>()?
        } else {
            parser.read_payload_for_element(reader, element, header).map_err(|error| {
                let found = one_line(&error.to_string());
                ImportError::malformed(path, format!("element {name}"), found, "the properties of the header")
            })?
        };
        if name == "vertex" {
            return Ok(rows);
        }
    }
    Ok(Vec::new())
}

/// Reads the line of one entry; the error has what was found and what was expected. The parser's own reader of lines knows neither
/// `nan` nor `inf`, which some solvers write and which must be reported by particle.
fn ascii_row(rest: &mut &[u8], element: &ElementDef) -> Result<EntryValues, (String, &'static str)> {
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
    let mut row = EntryValues::new();
    for (_, property) in &element.properties {
        match property.data_type {
            PropertyType::Scalar(ref kind) => {
                let value = number("a number for every property")?;
                if !is_float(kind) && value.fract() != 0.0 {
                    return Err((value.to_string(), "an integer"));
                }
                row.0.push(value);
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
        None => Ok(row),
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

fn columns(vertex: &ElementDef) -> Vec<Column<'_>> {
    let scalars = vertex.properties.iter().filter_map(|(name, property)| match &property.data_type {
        PropertyType::Scalar(kind) => Some((name, is_float(kind))),
        PropertyType::List(..) => None,
    });
    scalars.enumerate().map(|(index, (name, is_float))| Column { name, is_float, index }).collect()
}

/// The values of some columns, vertex by vertex, in single precision.
fn floats(rows: &[EntryValues], columns: &[&Column]) -> Vec<f32> {
    rows.iter().flat_map(|row| columns.iter().map(|column| row.0[column.index] as f32)).collect()
}

/// The parser's message without its line ends.
fn one_line(message: &str) -> String {
    message.split_whitespace().collect::<Vec<_>>().join(" ")
}
