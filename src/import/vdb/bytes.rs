//! A file's bytes, read from front to back and never past the end.

use super::super::ImportError;
use std::path::Path;

/// Reads numbers and strings and names the place where the file ends too early.
#[derive(Clone, Copy)]
pub(super) struct Bytes<'a> {
    pub(super) path: &'a Path,
    pub(super) all: &'a [u8],
    pub(super) at: usize,
}

impl<'a> Bytes<'a> {
    /// The next `count` bytes, which are `what`.
    pub(super) fn take(&mut self, count: usize, what: &str) -> Result<&'a [u8], ImportError> {
        let rest = &self.all[self.at..];
        if rest.len() < count {
            let found = format!("the end of the file after {} bytes", rest.len());
            return Err(self.malformed(found, format!("{count} bytes of {what}")));
        }
        self.at += count;
        Ok(&rest[..count])
    }

    fn array<const N: usize>(&mut self, what: &str) -> Result<[u8; N], ImportError> {
        self.take(N, what).map(|bytes| bytes.try_into().expect("as many as requested"))
    }

    pub(super) fn u32(&mut self, what: &str) -> Result<u32, ImportError> {
        self.array(what).map(u32::from_le_bytes)
    }

    pub(super) fn i64(&mut self, what: &str) -> Result<i64, ImportError> {
        self.array(what).map(i64::from_le_bytes)
    }

    pub(super) fn f32(&mut self, what: &str) -> Result<f32, ImportError> {
        self.array(what).map(f32::from_le_bytes)
    }

    /// Three numbers of 32 bits.
    pub(super) fn node(&mut self, what: &str) -> Result<[i32; 3], ImportError> {
        let bytes: [u8; 12] = self.array(what)?;
        Ok([0, 4, 8].map(|at| i32::from_le_bytes(bytes[at..at + 4].try_into().expect("four bytes"))))
    }

    /// Three doubles.
    pub(super) fn vector(&mut self, what: &str) -> Result<[f64; 3], ImportError> {
        let bytes: [u8; 24] = self.array(what)?;
        Ok([0, 8, 16].map(|at| f64::from_le_bytes(bytes[at..at + 8].try_into().expect("eight bytes"))))
    }

    /// A text after its length, a character a byte, as `vdb-rs` has it.
    pub(super) fn text(&mut self, what: &str) -> Result<String, ImportError> {
        let length = self.u32(what)? as usize;
        self.take(length, what).map(|bytes| bytes.iter().map(|&byte| byte as char).collect())
    }

    /// Goes to a place that the file names.
    pub(super) fn seek(&mut self, place: i64, what: &str) -> Result<(), ImportError> {
        match usize::try_from(place).ok().filter(|&place| place <= self.all.len()) {
            Some(place) => {
                self.at = place;
                Ok(())
            }
            None => {
                let expected = format!("a place in the {} bytes of the file", self.all.len());
                Err(self.malformed(format!("{what} at byte {place}"), expected))
            }
        }
    }

    /// An error at this place.
    pub(super) fn malformed(&self, found: impl Into<String>, expected: impl Into<String>) -> ImportError {
        ImportError::malformed(self.path, format!("byte {}", self.at), found, expected)
    }
}
