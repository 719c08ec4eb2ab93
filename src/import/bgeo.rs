//! BGEO: the classic binary geometry of version 5, plain or gzipped. All numbers are big-endian.

use super::gather::{Gather, Values};
use super::{ImportError, Imported, MemoryBudget};
use std::path::Path;

/// The first bytes of a plain file.
pub(super) const MAGIC: &[u8] = b"Bgeo";
/// The first bytes of a gzipped file.
const GZIP: &[u8] = b"\x1f\x8b";

/// Whether the bytes are gzip: the mark, and deflate, the only method there is.
pub(super) fn is_gzip(bytes: &[u8]) -> bool {
    bytes.starts_with(GZIP) && bytes.get(2).is_none_or(|&method| method == 8)
}

/// An attribute of the points: name, 32-bit words a point, type.
struct Attribute {
    name: String,
    size: usize,
    kind: Kind,
}

#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Float,
    Int,
    Index,
    Vector,
}

pub(super) fn read(path: &Path, bytes: &[u8], budget: &MemoryBudget) -> Result<Imported, ImportError> {
    if !bytes.starts_with(GZIP) {
        return points(path, bytes, budget);
    }
    let packed = flate2::read::MultiGzDecoder::new(bytes);
    let plain = budget.unpack(packed, "gzip, content", |length, error| {
        let place = format!("gzip, after {length} bytes of content");
        ImportError::malformed(path, place, error.to_string(), "a whole gzip stream")
    })?;
    points(path, &plain, budget)
}

/// Reads header, attribute definitions and point records; primitives and groups behind them are left alone.
fn points(path: &Path, bytes: &[u8], budget: &MemoryBudget) -> Result<Imported, ImportError> {
    let mut scan = Scan { path, bytes, at: 0 };
    let magic = scan.take(5, "the magic BgeoV")?;
    if magic != b"BgeoV" {
        let found = format!("{:?}", String::from_utf8_lossy(magic));
        return Err(ImportError::unsupported(path, found, "the magic BgeoV of classic BGEO"));
    }
    let version = scan.u32("the version")?;
    if version != 5 {
        return Err(ImportError::unsupported(path, format!("BGEO version {version}"), "version 5"));
    }
    let count = scan.u32("the number of points")? as usize;
    let [primitives, _, _, attributes] = scan.counts("the numbers of primitives, groups and attributes")?;
    let [on_vertices, on_primitives, on_detail] = scan.counts("the numbers of attributes")?;
    let attributes: Vec<Attribute> = (0..attributes).map(|_| scan.attribute()).collect::<Result<_, _>>()?;

    let record = 4 * (4 + attributes.iter().map(|attribute| attribute.size).sum::<usize>());
    let left = bytes.len() - scan.at;
    if (count as u128) * (record as u128) > left as u128 {
        let (found, expected) = (format!("{left} bytes"), format!("{count} points of {record} bytes"));
        return Err(ImportError::malformed(path, format!("byte {}", scan.at), found, expected));
    }
    let records = &bytes[scan.at..scan.at + count * record];
    budget.take_numbers::<f32>(3 * count)?;
    let positions = floats(records, record, 0, 3).collect::<Vec<f32>>();
    let mut gather = Gather::new(path, budget, &positions)?;
    let weighted = floats(records, record, 12, 1).filter(|&weight| weight != 1.0).count();
    if weighted > 0 {
        gather.ignore(
            "w",
            format!("{weighted} points have a weight other than 1, positions are taken undivided"),
        );
    }
    let mut offset = 16;
    for Attribute { name, size, kind } in &attributes {
        match kind {
            // They would be sought in every record.
            _ if *size == 0 => gather.ignore(name, "no components"),
            Kind::Float | Kind::Vector => {
                Values::take(budget, true, count * size)?;
                let values = floats(records, record, offset, *size).collect();
                gather.add(name, *size, Values::Float(values))?;
            }
            Kind::Int => {
                Values::take(budget, false, count * size)?;
                let values = words(records, record, offset, *size);
                let values = values.map(|word| i64::from(i32::from_be_bytes(word))).collect();
                gather.add(name, *size, Values::Int(values))?;
            }
            Kind::Index => gather.ignore(name, "indices into a table of names"),
        }
        offset += 4 * size;
    }
    for (what, count) in [
        ("primitives", primitives),
        ("vertex attributes", on_vertices),
        ("primitive attributes", on_primitives),
        ("detail attributes", on_detail),
    ] {
        if count > 0 {
            gather.ignore(what, format!("{count}, not of the points"));
        }
    }
    Ok(gather.finish())
}

/// `size` words at `offset` of each record.
fn words(records: &[u8], record: usize, offset: usize, size: usize) -> impl Iterator<Item = [u8; 4]> {
    records.chunks_exact(record).flat_map(move |bytes| {
        bytes[offset..offset + 4 * size].chunks_exact(4).map(|word| [word[0], word[1], word[2], word[3]])
    })
}

/// `size` floats at `offset` of each record.
fn floats(records: &[u8], record: usize, offset: usize, size: usize) -> impl Iterator<Item = f32> {
    words(records, record, offset, size).map(f32::from_be_bytes)
}

/// Bytes of the file and the position of the reader.
struct Scan<'a> {
    path: &'a Path,
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Scan<'a> {
    fn take(&mut self, length: usize, what: &str) -> Result<&'a [u8], ImportError> {
        let left = &self.bytes[self.at..];
        let Some(taken) = left.get(..length) else {
            let found = format!("{} bytes left", left.len());
            return Err(ImportError::malformed(self.path, format!("byte {}", self.at), found, what));
        };
        self.at += length;
        Ok(taken)
    }

    fn u16(&mut self, what: &str) -> Result<usize, ImportError> {
        let bytes = self.take(2, what)?;
        Ok(usize::from(u16::from_be_bytes([bytes[0], bytes[1]])))
    }

    fn u32(&mut self, what: &str) -> Result<u32, ImportError> {
        let bytes = self.take(4, what)?;
        Ok(u32::from_be_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]))
    }

    fn counts<const N: usize>(&mut self, what: &str) -> Result<[u32; N], ImportError> {
        let mut counts = [0; N];
        for count in &mut counts {
            *count = self.u32(what)?;
        }
        Ok(counts)
    }

    fn text(&mut self, what: &str) -> Result<String, ImportError> {
        let length = self.u16(what)?;
        Ok(String::from_utf8_lossy(self.take(length, what)?).into_owned())
    }

    /// Reads the definition of an attribute and passes over its default values or its table of names.
    fn attribute(&mut self) -> Result<Attribute, ImportError> {
        let name = self.text("the name of an attribute")?;
        let size = self.u16("the size of an attribute")?;
        let at = self.at;
        let kind = match self.u32("the type of an attribute")? {
            0 => Kind::Float,
            1 => Kind::Int,
            4 => Kind::Index,
            5 => Kind::Vector,
            other => {
                let (place, found) = (format!("byte {at}, attribute {name}"), format!("type {other}"));
                return Err(ImportError::malformed(
                    self.path,
                    place,
                    found,
                    "0 float, 1 int, 4 index or 5 vector",
                ));
            }
        };
        if kind == Kind::Index {
            for _ in 0..self.u32("the number of names")? {
                self.text("a name")?;
            }
        } else {
            self.take(4 * size, "the default values of an attribute")?;
        }
        Ok(Attribute { name, size, kind })
    }
}
