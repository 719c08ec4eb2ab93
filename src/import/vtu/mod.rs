//! VTU and VTP: VTK's XML files of unstructured grids and poly data, of which the points and their data are taken.
//!
//! The structure is read first (this file), the numbers of each array after it (`block`): where appended data are raw,
//! only what stands in front of them is XML.

mod block;

use super::gather::{Gather, Values};
use super::{ImportError, Imported, MemoryBudget};
use block::{Array, Coding, Data};
use quick_xml::{Reader, XmlVersion, events::BytesStart, events::Event};
use std::{collections::HashMap, path::Path};

/// What introduces appended data.
const APPENDED: &[u8] = b"<AppendedData";

/// A part of the points with their data.
struct Piece<'a> {
    count: usize,
    points: Option<Array<'a>>,
    data: Vec<Array<'a>>,
}

/// To what the arrays that follow belong.
#[derive(Clone, Copy, PartialEq)]
enum Owner {
    Points,
    PointData,
    Other(&'static str),
    /// Cells, which every file has; nothing is reported of them.
    Cells,
}

impl Owner {
    fn named(element: &str) -> Option<Self> {
        Some(match element {
            "Points" => Self::Points,
            "PointData" => Self::PointData,
            "CellData" => Self::Other("of the cells, not of the points"),
            "FieldData" => Self::Other("of the whole dataset, not of the points"),
            "Cells" | "Verts" | "Lines" | "Strips" | "Polys" => Self::Cells,
            _ => return None,
        })
    }
}

/// What was read of the structure so far.
struct Document<'a> {
    path: &'a Path,
    coding: Coding<'a>,
    pieces: Vec<Piece<'a>>,
    owner: Owner,
    ignored: Vec<(String, &'static str)>,
}

pub(super) fn read(path: &Path, bytes: &[u8], budget: &MemoryBudget) -> Result<Imported, ImportError> {
    let document = structure(path, bytes)?;
    let Document { coding, pieces, ignored, .. } = &document;
    if !coding.zlib {
        budget.expect_plain(bytes.len());
    }
    let mut positions = Vec::new();
    for (index, piece) in pieces.iter().enumerate().filter(|(_, piece)| piece.count > 0) {
        let Some(points) = &piece.points else {
            let expected = "an array of points";
            return Err(ImportError::malformed(path, format!("piece {index}"), "no Points", expected));
        };
        match coding.values(path, budget, points, piece.count)? {
            Values::Float(values) if points.components == 3 => {
                budget.take_numbers::<f32>(values.len())?;
                positions.extend(values);
            }
            _ => {
                let found = format!("points of {} × {}", points.components, points.type_name);
                return Err(ImportError::unsupported(path, found, "points of 3 × Float32 or Float64"));
            }
        }
    }
    let mut gather = Gather::new(path, budget, &positions)?;
    drop(positions);
    // The first piece with points determines the attributes; those that another piece lacks are left out.
    let full: Vec<&Piece> = pieces.iter().filter(|piece| piece.count > 0).collect();
    let first = full.first().copied().or(pieces.first());
    let full: Vec<ArraysOfPiece> = full.into_iter().map(ArraysOfPiece::new).collect();
    for array in first.map_or(&[][..], |piece| &piece.data[..]) {
        match attribute(path, budget, coding, &full, array)? {
            Some(values) => gather.add(&array.name, array.components, values)?,
            None => gather.ignore(&array.name, "not in every piece"),
        }
    }
    for (name, why) in ignored {
        gather.ignore(name, why);
    }
    Ok(gather.finish())
}

/// A piece and its arrays by what pieces must agree on: name, components, whether they are floats. Pieces and arrays can be
/// many.
struct ArraysOfPiece<'a> {
    count: usize,
    arrays: HashMap<(&'a str, usize, bool), &'a Array<'a>>,
}

impl<'a> ArraysOfPiece<'a> {
    fn new(piece: &'a Piece<'a>) -> Self {
        let mut arrays = HashMap::new();
        for array in &piece.data {
            arrays.entry(identity(array)).or_insert(array);
        }
        Self { count: piece.count, arrays }
    }
}

fn identity<'a>(array: &'a Array) -> (&'a str, usize, bool) {
    (&array.name, array.components, array.type_name.starts_with("Float"))
}

/// The values of an attribute in every piece; `None` if one lacks it.
fn attribute(
    path: &Path,
    budget: &MemoryBudget,
    coding: &Coding,
    pieces: &[ArraysOfPiece],
    like: &Array,
) -> Result<Option<Values>, ImportError> {
    let (_, components, is_float) = identity(like);
    if pieces.iter().any(|piece| !piece.arrays.contains_key(&identity(like))) {
        return Ok(None);
    }
    let mut all = if is_float { Values::Float(Vec::new()) } else { Values::Int(Vec::new()) };
    for piece in pieces {
        let values = coding.values(path, budget, piece.arrays[&identity(like)], piece.count)?;
        Values::take(budget, is_float, piece.count.saturating_mul(components))?;
        match (&mut all, values) {
            (Values::Float(all), Values::Float(values)) => all.extend(values),
            (Values::Int(all), Values::Int(values)) => all.extend(values),
            _ => return Ok(None),
        }
    }
    Ok(Some(all))
}

/// Reads the XML.
fn structure<'a>(path: &'a Path, bytes: &'a [u8]) -> Result<Document<'a>, ImportError> {
    let appended = bytes.windows(APPENDED.len()).position(|window| window == APPENDED);
    let tag =
        appended.and_then(|start| Some(start + bytes[start..].iter().position(|&byte| byte == b'>')? + 1));
    let xml = std::str::from_utf8(&bytes[..tag.unwrap_or(bytes.len())]).map_err(|error| {
        ImportError::malformed(
            path,
            format!("byte {}", error.valid_up_to()),
            "bytes that are no text",
            "UTF-8",
        )
    })?;
    let mut reader = Reader::from_str(xml);
    let mut document = Document {
        path,
        coding: Coding::default(),
        pieces: Vec::new(),
        owner: Owner::Cells,
        ignored: Vec::new(),
    };
    let mut is_vtk = false;
    loop {
        let (from, event) = next(path, &mut reader)?;
        match event {
            Event::Start(tag) if tag.name().as_ref() == "DataArray" => {
                let text = content(path, &mut reader, xml)?;
                document.array(&tag, from, text)?;
            }
            Event::Empty(tag) if tag.name().as_ref() == "DataArray" => document.array(&tag, from, "")?,
            Event::Start(tag) | Event::Empty(tag) => {
                is_vtk |= tag.name().as_ref() == "VTKFile";
                document.element(&tag, from, &bytes[xml.len()..])?;
            }
            Event::End(tag) if Owner::named(tag.name().as_ref()).is_some() => document.owner = Owner::Cells,
            Event::Eof => break,
            _ => {}
        }
    }
    if !is_vtk {
        return Err(ImportError::unsupported(path, "XML without an element VTKFile", "a VTK XML file"));
    }
    if document.pieces.is_empty() {
        return Err(ImportError::malformed(path, "the whole file", "no element Piece", "at least one"));
    }
    Ok(document)
}

/// What comes next in the text, and where it begins.
fn next<'a>(path: &Path, reader: &mut Reader<&'a [u8]>) -> Result<(usize, Event<'a>), ImportError> {
    let from = reader.buffer_position() as usize;
    let event = reader.read_event().map_err(|error| {
        let place = format!("byte {}", reader.error_position());
        ImportError::malformed(path, place, error.to_string(), "well-formed XML")
    })?;
    Ok((from, event))
}

/// The text of an array, up to the array's end; other elements in it are passed over.
fn content<'a>(path: &Path, reader: &mut Reader<&'a [u8]>, xml: &'a str) -> Result<&'a str, ImportError> {
    let mut text = "";
    let mut depth = 1;
    while depth > 0 {
        let (from, event) = next(path, reader)?;
        match event {
            Event::Text(_) if depth == 1 && text.trim().is_empty() => {
                text = &xml[from..reader.buffer_position() as usize];
            }
            Event::Start(_) => depth += 1,
            Event::End(_) => depth -= 1,
            Event::Eof => {
                let place = format!("byte {from}");
                return Err(ImportError::malformed(
                    path,
                    place,
                    "the end of the file",
                    "the end of an array",
                ));
            }
            _ => {}
        }
    }
    Ok(text)
}

impl<'a> Document<'a> {
    /// Reads an element that is no array; `behind` is what follows the XML.
    fn element(&mut self, tag: &BytesStart, at: usize, behind: &'a [u8]) -> Result<(), ImportError> {
        let name = tag.name();
        match name.as_ref() {
            "VTKFile" => self.file(tag, at),
            "Piece" => {
                let count = self.count(tag, "NumberOfPoints", at)?;
                self.pieces.push(Piece { count, points: None, data: Vec::new() });
                Ok(())
            }
            "AppendedData" => {
                let encoding = self.attribute(tag, "encoding", at)?;
                let base64 = match encoding.as_deref() {
                    Some("raw") => false,
                    Some("base64") | None => true,
                    Some(other) => return Err(self.malformed(at, other, "encoding raw or base64")),
                };
                let mark = behind.iter().position(|byte| !byte.is_ascii_whitespace());
                match mark.filter(|&mark| behind[mark] == b'_') {
                    Some(mark) => self.coding.appended = Some((&behind[mark + 1..], base64)),
                    None => return Err(self.malformed(at, "no mark _", "_ in front of appended data")),
                }
                Ok(())
            }
            element => {
                self.owner = Owner::named(element).unwrap_or(self.owner);
                if element == "Array" {
                    let name = self.attribute(tag, "Name", at)?.unwrap_or_default();
                    self.ignored.push((name, "an array of strings"));
                }
                Ok(())
            }
        }
    }

    /// Reads how numbers are written.
    fn file(&mut self, tag: &BytesStart, at: usize) -> Result<(), ImportError> {
        let kind = self.attribute(tag, "type", at)?.unwrap_or_default();
        if !["UnstructuredGrid", "PolyData"].contains(&kind.as_str()) {
            let found = format!("a VTKFile of type {kind:?}");
            return Err(ImportError::unsupported(self.path, found, "UnstructuredGrid or PolyData"));
        }
        self.coding.big = match self.attribute(tag, "byte_order", at)?.as_deref() {
            Some("LittleEndian") | None => false,
            Some("BigEndian") => true,
            Some(other) => return Err(self.malformed(at, other, "byte_order LittleEndian or BigEndian")),
        };
        self.coding.word = match self.attribute(tag, "header_type", at)?.as_deref() {
            Some("UInt32") | None => 4,
            Some("UInt64") => 8,
            Some(other) => return Err(self.malformed(at, other, "header_type UInt32 or UInt64")),
        };
        self.coding.zlib = match self.attribute(tag, "compressor", at)?.as_deref() {
            None | Some("") => false,
            Some("vtkZLibDataCompressor") => true,
            Some(other) => {
                let found = format!("the compressor {other}");
                return Err(ImportError::unsupported(self.path, found, "vtkZLibDataCompressor, or none"));
            }
        };
        Ok(())
    }

    /// Keeps an array that belongs to points, and lists another.
    fn array(&mut self, tag: &BytesStart, at: usize, text: &'a str) -> Result<(), ImportError> {
        let name = self.attribute(tag, "Name", at)?.unwrap_or_default();
        match self.owner {
            Owner::Points | Owner::PointData => {}
            Owner::Cells => return Ok(()),
            Owner::Other(why) => {
                self.ignored.push((name, why));
                return Ok(());
            }
        }
        let data = match self.attribute(tag, "format", at)?.as_deref() {
            Some("ascii") => Data::Ascii(text),
            Some("binary") => Data::Base64(text),
            Some("appended") => Data::Appended(self.count(tag, "offset", at)?),
            other => {
                let found = format!("format {:?} of array {name}", other.unwrap_or_default());
                return Err(self.malformed(at, found, "ascii, binary or appended"));
            }
        };
        let type_name = self.attribute(tag, "type", at)?.unwrap_or_default();
        let Some(kind) = block::kind(&type_name) else {
            let found = format!("type {type_name:?} of array {name}");
            return Err(self.malformed(at, found, "Float32, Float64, Int8 … Int64 or UInt8 … UInt64"));
        };
        let components = match self.attribute(tag, "NumberOfComponents", at)? {
            Some(_) => self.count(tag, "NumberOfComponents", at)?,
            None => 1,
        };
        let array = Array { name, type_name, kind, components, at, data };
        let Some(piece) = self.pieces.last_mut() else {
            return Err(self.malformed(at, "an array outside of a Piece", "Piece before its arrays"));
        };
        match self.owner {
            Owner::Points if piece.points.is_none() => piece.points = Some(array),
            Owner::Points => return Err(self.malformed(at, "a second array of points", "the points once")),
            _ => piece.data.push(array),
        }
        Ok(())
    }

    /// An attribute of a tag.
    fn attribute(&self, tag: &BytesStart, name: &str, at: usize) -> Result<Option<String>, ImportError> {
        let value = tag.try_get_attribute(name).map_err(quick_xml::Error::from);
        let value = value.and_then(|found| {
            found.map(|value| value.normalized_value(XmlVersion::Implicit1_0).map(String::from)).transpose()
        });
        value.map_err(|error| self.malformed(at, error.to_string(), "well-formed attributes"))
    }

    /// An attribute of a tag that is a whole number.
    fn count(&self, tag: &BytesStart, name: &str, at: usize) -> Result<usize, ImportError> {
        let text = self.attribute(tag, name, at)?.unwrap_or_default();
        text.trim().parse().map_err(|_| self.malformed(at, format!("{name}={text:?}"), "a whole number"))
    }

    fn malformed(&self, at: usize, found: impl Into<String>, expected: &str) -> ImportError {
        ImportError::malformed(self.path, format!("byte {at}"), found, expected)
    }
}
