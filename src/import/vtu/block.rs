//! The numbers of an array: written out, in base64 or raw, in the file's text or appended to it, plain or zlib.
//!
//! A plain block is its length in bytes, then the bytes. A compressed one is the number of parts, the length of a whole
//! part and of the last one (0: whole too), the compressed length of each part, then the parts. In base64 the head of a
//! compressed block is encoded by itself, that of a plain one together with the bytes; some writers pad it there too, so
//! padding is taken anywhere.

use super::super::gather::Values;
use super::super::numbers::{self, Kind, Number};
use super::{ImportError, MemoryBudget};
use std::io::Read;
use std::path::Path;

/// An array that the XML names.
pub(super) struct Array<'a> {
    pub(super) name: String,
    pub(super) type_name: String,
    pub(super) kind: Kind,
    pub(super) components: usize,
    /// Where its tag is [byte].
    pub(super) at: usize,
    pub(super) data: Data<'a>,
}

/// Where an array's numbers are.
pub(super) enum Data<'a> {
    /// Written out.
    Ascii(&'a str),
    /// In base64, between the tags.
    Base64(&'a str),
    /// So many bytes behind the start of the appended data.
    Appended(usize),
}

/// How numbers are written.
#[derive(Default)]
pub(super) struct Coding<'a> {
    /// Whether numbers are big-endian.
    pub(super) big: bool,
    /// Bytes of a length, 4 or 8.
    pub(super) word: usize,
    pub(super) zlib: bool,
    /// The appended data, and whether they are base64.
    pub(super) appended: Option<(&'a [u8], bool)>,
}

/// The type of that name.
pub(super) fn kind(name: &str) -> Option<Kind> {
    let digits = name.find(|character: char| character.is_ascii_digit())?;
    let (number, sizes): (_, &[usize]) = match &name[..digits] {
        "Float" => (Number::Float, &[4, 8]),
        "Int" => (Number::Signed, &[1, 2, 4, 8]),
        "UInt" => (Number::Unsigned, &[1, 2, 4, 8]),
        _ => return None,
    };
    let bits: usize = name[digits..].parse().ok()?;
    sizes.contains(&(bits / 8)).then_some(Kind { size: bits / 8, number }).filter(|_| bits.is_multiple_of(8))
}

/// Why an array cannot be read.
enum Fault {
    /// What was found and what was expected there.
    Mismatch(Mismatch),
    /// What the budget refuses.
    Refused(ImportError),
}

/// What was found and what was expected.
type Mismatch = (String, String);

impl From<Mismatch> for Fault {
    fn from(mismatch: Mismatch) -> Self {
        Self::Mismatch(mismatch)
    }
}

impl From<ImportError> for Fault {
    fn from(error: ImportError) -> Self {
        Self::Refused(error)
    }
}

impl Coding<'_> {
    /// The numbers of an array with `count` entries.
    pub(super) fn values(
        &self,
        path: &Path,
        budget: &MemoryBudget,
        array: &Array,
        count: usize,
    ) -> Result<Values, ImportError> {
        let numbers =
            count.checked_mul(array.components).filter(|n| n.checked_mul(array.kind.size).is_some());
        let values = numbers.ok_or_else(|| {
            Fault::from((
                format!("{count} × {} numbers", array.components),
                "as many as a file can hold".to_owned(),
            ))
        });
        values.and_then(|numbers| self.read(budget, array, numbers)).map_err(|fault| match fault {
            Fault::Mismatch((found, expected)) => {
                let place = format!("array {} at byte {}", array.name, array.at);
                ImportError::malformed(path, place, found, expected)
            }
            Fault::Refused(error) => error,
        })
    }

    fn read(&self, budget: &MemoryBudget, array: &Array, count: usize) -> Result<Values, Fault> {
        let is_float = array.kind.number == Number::Float;
        let source = match array.data {
            Data::Ascii(text) => {
                may_hold(text, count)?;
                Values::take(budget, is_float, count)?;
                return Ok(words(text, array.kind, count)?);
            }
            // Writers leave the block of an empty array out, or write its length.
            _ if count == 0 => return Ok(numbers::values(&[], array.kind, self.big)),
            Data::Base64(text) => Source::Base64 { text: text.as_bytes(), held: Vec::new() },
            Data::Appended(offset) => {
                let Some((bytes, base64)) = self.appended else {
                    return Err(("no appended data".to_owned(), "an element AppendedData".to_owned()).into());
                };
                let Some(bytes) = bytes.get(offset..) else {
                    let found = format!("{} bytes of appended data", bytes.len());
                    return Err((found, format!("more than the offset {offset}")).into());
                };
                if base64 { Source::Base64 { text: bytes, held: Vec::new() } } else { Source::Raw(bytes) }
            }
        };
        let length = count * array.kind.size;
        // Arrays may share an offset, and all are kept. The lengths of the block's head are compared with this one.
        budget.take_unpacked(length as u64, &format!("array {} at byte {}", array.name, array.at))?;
        Values::take(budget, is_float, count)?;
        let block = if self.zlib { self.inflated(source, length)? } else { self.plain(source, length)? };
        Ok(numbers::values(&block, array.kind, self.big))
    }

    fn plain(&self, mut source: Source, length: usize) -> Result<Vec<u8>, Mismatch> {
        same_length(self.head(&mut source)?, length)?;
        source.take(length)
    }

    fn inflated(&self, mut source: Source, length: usize) -> Result<Vec<u8>, Mismatch> {
        let parts = self.head(&mut source)?;
        let [whole, last] = [self.head(&mut source)?, self.head(&mut source)?];
        let total = if last == 0 {
            parts.checked_mul(whole)
        } else {
            parts.checked_sub(1).and_then(|parts| parts.checked_mul(whole)?.checked_add(last))
        };
        same_length(total.unwrap_or(u64::MAX), length)?;
        if whole == 0 && parts > 1 {
            return Err((format!("{parts} parts of 0 bytes"), "parts that hold something".into()));
        }
        source.require(parts.saturating_mul(self.word as u64))?;
        let sizes = (0..parts).map(|_| self.head(&mut source)).collect::<Result<Vec<u64>, _>>()?;
        let mut block = Vec::new();
        for (part, size) in sizes.into_iter().enumerate() {
            let whole = if part as u64 + 1 == parts && last > 0 { last } else { whole };
            // Arrays may share their bytes: what each reads has to be in proportion to what it holds.
            let max = max_packed(whole);
            if size > max {
                return Err((format!("a part of {size} bytes"), format!("at most {max} for {whole} bytes")));
            }
            source.require(size)?;
            let packed = source.take(size as usize)?;
            let before = block.len();
            let unpacked =
                flate2::read::ZlibDecoder::new(&packed[..]).take(whole + 1).read_to_end(&mut block);
            let place = || format!("part {part} of {parts} with {whole} bytes");
            unpacked.map_err(|error| (error.to_string(), place()))?;
            let found = block.len() - before;
            if found as u64 != whole {
                return Err((format!("{found} bytes or more"), place()));
            }
        }
        Ok(block)
    }

    /// A length in front of data.
    fn head(&self, source: &mut Source) -> Result<u64, Mismatch> {
        let mut wide = [0; 8];
        let bytes = source.take(self.word)?;
        Ok(if self.big {
            wide[8 - self.word..].copy_from_slice(&bytes);
            u64::from_be_bytes(wide)
        } else {
            wide[..self.word].copy_from_slice(&bytes);
            u64::from_le_bytes(wide)
        })
    }
}

/// The largest length that zlib packs so many bytes to, with slack: stored blocks take 5 bytes each, head and checksum 6.
fn max_packed(length: u64) -> u64 {
    length.saturating_add(length / 8).saturating_add(256)
}

fn same_length(found: u64, expected: usize) -> Result<(), Mismatch> {
    if found == expected as u64 {
        return Ok(());
    }
    Err((format!("{found} bytes"), format!("{expected} bytes, for the number of points and components")))
}

/// Refuses more numbers than a text can hold: a digit each, and white space between them.
fn may_hold(text: &str, count: usize) -> Result<(), Mismatch> {
    if count.saturating_mul(2).saturating_sub(1) > text.len() {
        return Err((format!("{} bytes of text", text.len()), format!("{count} numbers")));
    }
    Ok(())
}

/// Reads numbers that are written out.
fn words(text: &str, kind: Kind, count: usize) -> Result<Values, Mismatch> {
    let mut words = text.split_ascii_whitespace();
    let (mut floats, mut integers) = (Vec::new(), Vec::new());
    for index in 0..count {
        let word = words.next().unwrap_or("");
        let read = match kind.number {
            Number::Float => word.parse::<f64>().map(|value| floats.push(value as f32)).is_ok(),
            _ => {
                let value = word.parse::<i128>();
                value.map(|value| integers.push(i64::try_from(value).unwrap_or(i64::MAX))).is_ok()
            }
        };
        if !read {
            return Err((format!("{word:?}"), format!("number {index} of {count}")));
        }
    }
    match words.next() {
        Some(word) => Err((format!("{word:?}"), format!("the end, after {count} numbers"))),
        None => Ok(if kind.number == Number::Float { Values::Float(floats) } else { Values::Int(integers) }),
    }
}

/// Bytes, read from the front.
enum Source<'a> {
    Raw(&'a [u8]),
    /// The text that is left, and bytes that are decoded but not taken: at most two.
    Base64 {
        text: &'a [u8],
        held: Vec<u8>,
    },
}

impl Source<'_> {
    /// Refuses if there cannot be as many bytes left.
    fn require(&self, length: u64) -> Result<(), Mismatch> {
        let left = match self {
            Self::Raw(bytes) => bytes.len(),
            Self::Base64 { text, held } => text.len().div_ceil(4) * 3 + held.len(),
        };
        if length > left as u64 {
            return Err((format!("at most {left} bytes left"), format!("{length} bytes")));
        }
        Ok(())
    }

    fn take(&mut self, length: usize) -> Result<Vec<u8>, Mismatch> {
        self.require(length as u64)?;
        match self {
            Self::Raw(bytes) => {
                let (taken, rest) = bytes.split_at(length);
                *bytes = rest;
                Ok(taken.to_vec())
            }
            Self::Base64 { text, held } => {
                let mut taken = Vec::with_capacity(length + 2);
                taken.append(held);
                while taken.len() < length {
                    four(text, &mut taken).map_err(|found| (found, format!("{length} bytes in base64")))?;
                }
                *held = taken.split_off(length);
                Ok(taken)
            }
        }
    }
}

/// Decodes the next four characters of base64 to one, two or three bytes.
fn four(text: &mut &[u8], out: &mut Vec<u8>) -> Result<(), String> {
    let mut sextets = [0_u32; 4];
    let mut padding = 0;
    for sextet in &mut sextets {
        let blank = text.iter().take_while(|byte| byte.is_ascii_whitespace()).count();
        let Some((&byte, rest)) = text[blank..].split_first() else {
            return Err("the end of the text".into());
        };
        *text = rest;
        *sextet = match byte {
            b'A'..=b'Z' => u32::from(byte - b'A'),
            b'a'..=b'z' => u32::from(byte - b'a') + 26,
            b'0'..=b'9' => u32::from(byte - b'0') + 52,
            b'+' => 62,
            b'/' => 63,
            b'=' => 0,
            other => return Err(format!("the character {:?}", char::from(other))),
        };
        if byte == b'=' {
            padding += 1;
        } else if padding > 0 {
            return Err("a character behind padding".into());
        }
    }
    if padding > 2 {
        return Err("nothing but padding".into());
    }
    let [_, bytes @ ..] = sextets.iter().fold(0, |all, sextet| all << 6 | sextet).to_be_bytes();
    out.extend(&bytes[..3 - padding]);
    Ok(())
}
