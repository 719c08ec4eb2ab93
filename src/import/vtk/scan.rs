//! The bytes of a legacy VTK file: lines of keywords, and blocks of numbers.

use super::super::gather::Values;
use super::super::numbers::{self, Kind, Number};
use super::super::{ImportError, MemoryBudget};
use std::path::Path;

pub(super) const INT: Kind = Kind { size: 4, number: Number::Signed };
pub(super) const BYTE: Kind = Kind { size: 1, number: Number::Unsigned };
pub(super) const FLOAT: Kind = Kind { size: 4, number: Number::Float };
/// Eight numbers share a byte.
const BIT: Kind = Kind { size: 0, number: Number::Unsigned };

/// The type of that name; `long` is the 8 bytes of 64-bit Unix, which is where such files come from.
fn named(name: &str) -> Option<Kind> {
    let (size, number) = match name.to_ascii_lowercase().as_str() {
        "bit" => return Some(BIT),
        "unsigned_char" | "vtktypeuint8" => (1, Number::Unsigned),
        "char" | "signed_char" | "vtktypeint8" => (1, Number::Signed),
        "unsigned_short" | "vtktypeuint16" => (2, Number::Unsigned),
        "short" | "vtktypeint16" => (2, Number::Signed),
        "unsigned_int" | "vtktypeuint32" => (4, Number::Unsigned),
        // vtkIdType is written as 32-bit integers whatever its size in memory.
        "int" | "vtkidtype" | "vtktypeint32" => (4, Number::Signed),
        "unsigned_long" | "vtktypeuint64" => (8, Number::Unsigned),
        "long" | "vtktypeint64" => (8, Number::Signed),
        "float" | "vtktypefloat32" => (4, Number::Float),
        "double" | "vtktypefloat64" => (8, Number::Float),
        _ => return None,
    };
    Some(Kind { size, number })
}

/// Words of a line that are looked at; keywords have at most four more.
const MAX_WORDS: usize = 8;

/// A number in a text.
enum Written {
    Float(f32),
    Int(i64),
}

/// Bytes of the file and the position of the reader.
pub(super) struct Scan<'a> {
    pub(super) path: &'a Path,
    bytes: &'a [u8],
    budget: &'a MemoryBudget<'a>,
    at: usize,
    /// Where the line, block or word read last starts.
    mark: usize,
    /// Whether blocks are binary.
    pub(super) binary: bool,
}

impl<'a> Scan<'a> {
    pub(super) fn new(path: &'a Path, bytes: &'a [u8], budget: &'a MemoryBudget) -> Self {
        Self { path, bytes, budget, at: 0, mark: 0, binary: false }
    }

    /// The rest of the current line; the next one starts behind it.
    pub(super) fn line(&mut self) -> String {
        let rest = &self.bytes[self.at..];
        let end = rest.iter().position(|&byte| byte == b'\n').unwrap_or(rest.len());
        self.mark = self.at;
        self.at = (self.at + end + 1).min(self.bytes.len());
        String::from_utf8_lossy(&rest[..end]).into_owned()
    }

    /// The first words of the next line that is not blank; `None` at the end. There is at least one word.
    pub(super) fn keyword(&mut self) -> Option<Vec<String>> {
        while self.at < self.bytes.len() {
            let words: Vec<String> =
                self.line().split_whitespace().take(MAX_WORDS).map(str::to_owned).collect();
            if !words.is_empty() {
                return Some(words);
            }
        }
        None
    }

    /// Whether the next bytes are this text.
    pub(super) fn starts_with(&self, text: &str) -> bool {
        self.bytes[self.at..].starts_with(text.as_bytes())
    }

    /// The count in a line of words.
    pub(super) fn number(&self, words: &[String], index: usize, what: &str) -> Result<usize, ImportError> {
        words
            .get(index)
            .and_then(|word| word.parse().ok())
            .ok_or_else(|| self.malformed(words.join(" "), what))
    }

    /// The type in a line of words.
    pub(super) fn kind(&self, words: &[String], index: usize) -> Result<Kind, ImportError> {
        let kind = words.get(index).and_then(|word| named(word));
        kind.ok_or_else(|| self.malformed(words.join(" "), "a numeric type such as float or int"))
    }

    /// Reads a block of numbers.
    pub(super) fn values(&mut self, kind: Kind, count: usize) -> Result<Values, ImportError> {
        let is_float = kind.number == Number::Float;
        let block = self.block(kind, count)?;
        Values::take(self.budget, is_float, count)?;
        if let Some(block) = block {
            if kind == BIT {
                let bit = |i: usize| i64::from(block[i / 8] >> (7 - i % 8) & 1);
                return Ok(Values::Int((0..count).map(bit).collect()));
            }
            return Ok(numbers::values(block, kind, true));
        }
        let (mut floats, mut integers) = (Vec::new(), Vec::new());
        self.words(kind, count, |number| match number {
            Written::Float(value) => floats.push(value),
            Written::Int(value) => integers.push(value),
        })?;
        Ok(if is_float { Values::Float(floats) } else { Values::Int(integers) })
    }

    /// Passes over a block of numbers.
    pub(super) fn skip(&mut self, kind: Kind, count: usize) -> Result<(), ImportError> {
        if self.block(kind, count)?.is_none() {
            self.words(kind, count, |_| ())?;
        }
        Ok(())
    }

    /// The bytes of a binary block, behind which reading goes on. Of a block that is written out only the length is compared.
    fn block(&mut self, kind: Kind, count: usize) -> Result<Option<&'a [u8]>, ImportError> {
        self.mark = self.at;
        let left = self.bytes.len() - self.at;
        let min = match (self.binary, kind.size) {
            (true, 0) => count.div_ceil(8),
            (true, size) => count.saturating_mul(size),
            // A digit each, and white space between them.
            (false, _) => count.saturating_mul(2).saturating_sub(1),
        };
        if min > left {
            return Err(
                self.malformed(format!("{left} bytes left"), format!("{count} numbers in at min {min}"))
            );
        }
        if !self.binary {
            return Ok(None);
        }
        let block = &self.bytes[self.at..self.at + min];
        self.at += min;
        Ok(Some(block))
    }

    /// Passes numbers that are written out to `keep`.
    fn words(&mut self, kind: Kind, count: usize, mut keep: impl FnMut(Written)) -> Result<(), ImportError> {
        for index in 0..count {
            let word = self.word();
            let number = match kind.number {
                Number::Float => word.parse::<f64>().ok().map(|value| Written::Float(value as f32)),
                _ => {
                    let value = word.parse::<i128>().ok();
                    value.map(|value| Written::Int(i64::try_from(value).unwrap_or(i64::MAX)))
                }
            };
            if let Some(number) = number {
                keep(number);
            } else {
                let found = if word.is_empty() { "the end of the file".into() } else { format!("{word:?}") };
                return Err(self.malformed(found, format!("number {index} of {count}")));
            }
        }
        Ok(())
    }

    /// The next word, across lines.
    fn word(&mut self) -> String {
        let rest = &self.bytes[self.at..];
        let start = rest.iter().position(|byte| !byte.is_ascii_whitespace()).unwrap_or(rest.len());
        let length = rest[start..].iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len() - start);
        self.mark = self.at + start;
        self.at = self.mark + length;
        String::from_utf8_lossy(&rest[start..start + length]).into_owned()
    }

    /// An error at what was read last.
    pub(super) fn malformed(&self, found: impl Into<String>, expected: impl Into<String>) -> ImportError {
        let place = if self.binary {
            format!("byte {}", self.mark)
        } else {
            format!("line {}", 1 + self.bytes[..self.mark].iter().filter(|&&byte| byte == b'\n').count())
        };
        ImportError::malformed(self.path, place, found, expected)
    }
}
