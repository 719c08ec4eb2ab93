//! The payload of PLY files, number by number.

use ply_rs_bw::ply::{Encoding, ScalarType};

/// What was found, and what was expected.
pub(super) type Fault = (String, &'static str);

/// Numbers from the payload of a PLY file, in turn.
pub(super) struct Numbers<'a> {
    pub(super) rest: &'a [u8],
    pub(super) encoding: Encoding,
}

impl Numbers<'_> {
    /// The next number, which is of type `kind`.
    #[inline]
    pub(super) fn next(&mut self, kind: &ScalarType) -> Result<f64, Fault> {
        if self.encoding == Encoding::Ascii {
            let start = self.rest.iter().position(|byte| !byte.is_ascii_whitespace());
            let rest = &self.rest[start.unwrap_or(self.rest.len())..];
            let end = rest.iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len());
            let word = String::from_utf8_lossy(&rest[..end]);
            self.rest = &rest[end..];
            let found = if word.is_empty() { "the end of the file" } else { &*word };
            return found.parse().map_err(|_| (found.to_owned(), "a number"));
        }
        let big = self.encoding == Encoding::BinaryBigEndian;
        macro_rules! take {
            ($number:ty) => {{
                let Some((bytes, rest)) = self.rest.split_first_chunk() else {
                    return Err(("the end of the file".to_owned(), "another number"));
                };
                self.rest = rest;
                (if big { <$number>::from_be_bytes(*bytes) } else { <$number>::from_le_bytes(*bytes) }) as f64
            }};
        }
        Ok(match kind {
            ScalarType::Char => take!(i8),
            ScalarType::UChar => take!(u8),
            ScalarType::Short => take!(i16),
            ScalarType::UShort => take!(u16),
            ScalarType::Int => take!(i32),
            ScalarType::UInt => take!(u32),
            ScalarType::Float => take!(f32),
            ScalarType::Double => take!(f64),
        })
    }
}
