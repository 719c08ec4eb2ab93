//! The memory that reading a file may take.
//!
//! What a file merely states takes no memory: every count is compared with the bytes that are left. So reading takes at
//! most 64 bytes for each byte of the file's content, in every format (a test in `tests/damaged.rs` measures it). Compressed
//! content is bounded by [`MAX_EXPANSION`], and all of it by the user's limit, if there is one.

use super::ImportError;
use std::{cell::Cell, io::Read, path::Path};

/// How often compressed content may be as long as the whole file. Deflate can reach 1032. A million particles at rest on
/// a grid, with thirty more numbers each that are zero, were measured at 44 times. Smaller, and first frames are refused;
/// larger, and a small file can fill a machine.
pub(super) const MAX_EXPANSION: u64 = 128;

/// Length of content that is unpacked from a file however short it is [bytes].
const MIN_UNPACKED: u64 = 256 << 20;

/// Counts the memory of a file that is being read.
pub(super) struct MemoryBudget<'a> {
    path: &'a Path,
    /// The user's limit [bytes].
    allowed: Option<u64>,
    /// Counted so far [bytes].
    taken: Cell<u64>,
    /// Bytes that content may still unpack to: parts of a file may share their bytes.
    unpacked_left: Cell<u64>,
}

impl<'a> MemoryBudget<'a> {
    /// The budget of a file of `length` bytes, which are counted first.
    ///
    /// # Errors
    /// [`ImportError::OverMemory`] if they are more than `allowed`.
    pub(super) fn new(path: &'a Path, length: u64, allowed: Option<u64>) -> Result<Self, ImportError> {
        let unpacked_left = Cell::new(length.saturating_mul(MAX_EXPANSION).max(MIN_UNPACKED));
        let budget = Self { path, allowed, taken: Cell::new(0), unpacked_left };
        budget.take(length)?;
        Ok(budget)
    }

    /// Lets content take no more bytes than a file of `length`, whose content is not compressed.
    pub(super) fn expect_plain(&self, length: usize) {
        self.unpacked_left.set(length as u64);
    }

    /// Counts memory before it is taken.
    ///
    /// # Errors
    /// [`ImportError::OverMemory`] if it is more than the user allows.
    pub(super) fn take(&self, bytes: u64) -> Result<(), ImportError> {
        self.afford(bytes)?;
        self.taken.set(self.taken.get() + bytes);
        Ok(())
    }

    /// Compares memory that will be counted later.
    ///
    /// # Errors
    /// As [`MemoryBudget::take`].
    pub(super) fn afford(&self, bytes: u64) -> Result<(), ImportError> {
        let needed = self.taken.get().saturating_add(bytes);
        match self.allowed.filter(|&allowed| needed > allowed) {
            Some(allowed) => Err(ImportError::OverMemory { path: self.path.into(), needed, allowed }),
            None => Ok(()),
        }
    }

    /// Counts the memory of so many numbers.
    ///
    /// # Errors
    /// As [`MemoryBudget::take`].
    pub(super) fn take_numbers<T>(&self, count: usize) -> Result<(), ImportError> {
        self.take((count as u64).saturating_mul(size_of::<T>() as u64))
    }

    /// Counts content of `length` bytes before it is unpacked.
    ///
    /// # Errors
    /// As [`MemoryBudget::take`]; [`ImportError::Malformed`] beyond [`MAX_EXPANSION`].
    pub(super) fn take_unpacked(&self, length: u64, place: &str) -> Result<(), ImportError> {
        self.take(length)?;
        match self.unpacked_left.get().checked_sub(length) {
            Some(left) => self.unpacked_left.set(left),
            None => return Err(self.expands(place)),
        }
        Ok(())
    }

    /// Unpacks content whose length is not known, at most as much as is allowed. `fault` makes an error of one that is met after so
    /// many bytes.
    ///
    /// # Errors
    /// As [`MemoryBudget::take_unpacked`], and those of `fault`.
    pub(super) fn unpack(
        &self,
        packed: impl Read,
        place: &str,
        fault: impl FnOnce(usize, std::io::Error) -> ImportError,
    ) -> Result<Vec<u8>, ImportError> {
        let affordable = self.allowed.map_or(u64::MAX, |allowed| allowed - self.taken.get());
        let limit = affordable.min(self.unpacked_left.get());
        let mut content = Vec::new();
        let read = packed.take(limit.saturating_add(1)).read_to_end(&mut content);
        // The limits come first: a fault behind them was not reached.
        self.take_unpacked(content.len() as u64, place)?;
        read.map_err(|error| fault(content.len(), error))?;
        Ok(content)
    }

    fn expands(&self, place: &str) -> ImportError {
        let found = "more than the bytes of the file can hold";
        let expected = format!(
            "arrays that do not overlap, and content of at most {MAX_EXPANSION} times the file's length ({} MiB in a short file)",
            MIN_UNPACKED >> 20
        );
        ImportError::malformed(self.path, place, found, expected)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What unpacking so many zeros from a file of `length` bytes comes to.
    fn unpack(zeros: u64, length: u64, allowed: Option<u64>) -> Result<usize, ImportError> {
        let budget = MemoryBudget::new(Path::new("a.bgeo"), length, allowed)?;
        let fault = |_, error| panic!("zeros can be read: {error}");
        budget.unpack(std::io::repeat(0).take(zeros), "content", fault).map(|content| content.len())
    }

    #[test]
    fn content_is_unpacked_as_far_as_file_and_user_allow() {
        assert_eq!(unpack(1000, 10, Some(1010)).unwrap(), 1000);
        let refused = unpack(1001, 10, Some(1010));
        assert!(
            matches!(refused, Err(ImportError::OverMemory { needed: 1011, allowed: 1010, .. })),
            "{refused:?}"
        );
        let refused = unpack(1 << 40, 10, Some(1010));
        assert!(
            matches!(refused, Err(ImportError::OverMemory { needed: 1011, allowed: 1010, .. })),
            "{refused:?}"
        );
        let refused = unpack(0, 1011, Some(1010));
        assert!(matches!(refused, Err(ImportError::OverMemory { needed: 1011, .. })), "{refused:?}");
        assert_eq!(unpack(MIN_UNPACKED, 10, None).unwrap() as u64, MIN_UNPACKED);
        let refused = unpack(1 << 40, 10, None).unwrap_err().to_string();
        assert!(refused.contains("more than the bytes of the file can hold"), "{refused}");
    }
}
