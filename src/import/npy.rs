//! NPY: one numpy array, N × 3 floats.

use super::gather::{Gather, Values};
use super::numbers::{self, Kind, Number};
use super::{ImportError, Imported, MemoryBudget};
use std::path::Path;

/// The first bytes of a file.
pub(super) const MAGIC: &[u8] = b"\x93NUMPY";

/// The header of an array.
#[derive(Debug, PartialEq)]
pub(super) struct Header {
    /// Lengths of the axes, the slowest first.
    pub(super) shape: Vec<usize>,
    /// numpy's name of the type, such as `<f4`.
    descr: String,
    /// Whether the first axis runs fastest in the file.
    fortran: bool,
    /// Where the numbers start.
    start: usize,
}

impl Header {
    /// Entries along the first axis, and numbers of each; `None` for no axis, or more than two.
    pub(super) fn table(&self) -> Option<(usize, usize)> {
        match self.shape[..] {
            [count] => Some((count, 1)),
            [count, components] => Some((count, components)),
            _ => None,
        }
    }

    /// Why [`values`] cannot read this array, if so.
    pub(super) fn unread(&self) -> Option<String> {
        if self.table().is_none() {
            return Some(format!("{} axes", self.shape.len()));
        }
        self.kind().is_none().then(|| format!("type {}", self.descr))
    }

    /// Type of the numbers, and whether they are big-endian.
    fn kind(&self) -> Option<(Kind, bool)> {
        let (order, kind) = self.descr.split_at_checked(1)?;
        let big = match order {
            "<" | "|" => false,
            ">" => true,
            _ => return None,
        };
        let (letter, size) = kind.split_at_checked(1)?;
        let (number, sizes): (_, &[usize]) = match letter {
            "f" => (Number::Float, &[4, 8]),
            "i" => (Number::Signed, &[1, 2, 4, 8]),
            "u" => (Number::Unsigned, &[1, 2, 4, 8]),
            "b" => (Number::Unsigned, &[1]),
            _ => return None,
        };
        let size = size.parse().ok().filter(|size| sizes.contains(size))?;
        Some((Kind { size, number }, big))
    }
}

pub(super) fn read(path: &Path, bytes: &[u8], budget: &MemoryBudget) -> Result<Imported, ImportError> {
    let header = header(path, "", bytes)?;
    let unsupported = |found| ImportError::unsupported(path, found, "an array of N × 3 floats");
    if let Some(why) = header.unread() {
        return Err(unsupported(format!("an array of {why}")));
    }
    if header.shape.get(1) != Some(&3) {
        return Err(unsupported(format!("an array of shape {:?}", header.shape)));
    }
    match values(path, "", bytes, &header, budget)? {
        Values::Float(positions) => Ok(Gather::new(path, budget, &positions)?.finish()),
        Values::Int(_) => Err(unsupported(format!("integers ({})", header.descr))),
    }
}

/// Reads the header of an array; `member` is its place in the file for messages.
pub(super) fn header(path: &Path, member: &str, bytes: &[u8]) -> Result<Header, ImportError> {
    let malformed = |found: &str, expected: &str| {
        Err(ImportError::malformed(path, format!("{member}header"), found, expected))
    };
    if !bytes.starts_with(MAGIC) {
        return malformed("another start", "the mark \\x93NUMPY of an array");
    }
    let (length, text) = match bytes[MAGIC.len()..] {
        [1, _, a, b, ref rest @ ..] => (usize::from(u16::from_le_bytes([a, b])), rest),
        [2 | 3, _, a, b, c, d, ref rest @ ..] => (u32::from_le_bytes([a, b, c, d]) as usize, rest),
        [1..=3, ..] | [] => return malformed("the end of the file", "the length of the header"),
        [version, ..] => return malformed(&format!("version {version}"), "version 1, 2 or 3"),
    };
    let Some(text) = text.get(..length) else {
        return malformed(&format!("{} bytes", text.len()), &format!("{length} bytes of header"));
    };
    let start = text.as_ptr() as usize - bytes.as_ptr() as usize + length;
    let text = String::from_utf8_lossy(text);
    let descr = entry(&text, "descr").and_then(quoted);
    let fortran = entry(&text, "fortran_order").and_then(|value| {
        if value.starts_with("True") { Some(true) } else { value.starts_with("False").then_some(false) }
    });
    let shape = entry(&text, "shape").and_then(tuple);
    match (descr, fortran, shape) {
        (Some(descr), Some(fortran), Some(shape)) => Ok(Header { shape, descr, fortran, start }),
        _ => malformed(&format!("{text:?}"), "{'descr': '<f4', 'fortran_order': False, 'shape': (N, 3)}"),
    }
}

/// The text behind a key.
fn entry<'a>(text: &'a str, key: &str) -> Option<&'a str> {
    let quotes = [format!("'{key}'"), format!("\"{key}\"")];
    let (_, rest) = quotes.iter().find_map(|quoted| text.split_once(quoted.as_str()))?;
    rest.trim_start().strip_prefix(':').map(str::trim_start)
}

/// The text in quotes; a list, which numpy writes for records, is taken as it is and then not known as a type.
fn quoted(value: &str) -> Option<String> {
    if value.starts_with('[') {
        return Some("of records".into());
    }
    let quote = value.chars().next().filter(|c| ['\'', '"'].contains(c))?;
    Some(value[1..].split_once(quote)?.0.into())
}

/// The numbers in round brackets.
fn tuple(value: &str) -> Option<Vec<usize>> {
    let inside = value.strip_prefix('(')?.split_once(')')?.0.trim().trim_end_matches(',');
    if inside.is_empty() {
        return Some(Vec::new());
    }
    // Python 2 marks long integers with an L.
    inside.split(',').map(|length| length.trim().trim_end_matches('L').parse().ok()).collect()
}

/// Reads the numbers of an array that is not [`Header::unread`], entry by entry.
pub(super) fn values(
    path: &Path,
    member: &str,
    bytes: &[u8],
    header: &Header,
    budget: &MemoryBudget,
) -> Result<Values, ImportError> {
    let (kind, big) = header.kind().expect("the type was found readable");
    let (count, components) = header.table().expect("the shape was found readable");
    let block = &bytes[header.start..];
    let expected = count.checked_mul(components).and_then(|numbers| numbers.checked_mul(kind.size));
    if expected != Some(block.len()) {
        let (place, found) = (format!("{member}byte {}", header.start), format!("{} bytes", block.len()));
        let expected = format!("{count} × {components} numbers of {} bytes", kind.size);
        return Err(ImportError::malformed(path, place, found, expected));
    }
    let is_float = kind.number == Number::Float;
    Values::take(budget, is_float, count * components)?;
    let values = numbers::values(block, kind, big);
    if !header.fortran || components < 2 {
        return Ok(values);
    }
    Values::take(budget, is_float, count * components)?;
    Ok(match values {
        Values::Float(values) => Values::Float(by_entry(&values, count, components)),
        Values::Int(values) => Values::Int(by_entry(&values, count, components)),
    })
}

/// Component by component in, entry by entry out.
fn by_entry<T: Copy>(values: &[T], count: usize, components: usize) -> Vec<T> {
    (0..count)
        .flat_map(|entry| (0..components).map(move |component| values[component * count + entry]))
        .collect()
}
