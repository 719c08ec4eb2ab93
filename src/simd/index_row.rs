//! Eight indices that vector code may gather by.

use super::LANES;

/// Eight indices below a bound.
#[derive(Clone, Copy)]
pub struct IndexRow<'a> {
    row: &'a [u32; LANES],
    /// Upper bound of every index, exclusive.
    bound: usize,
}

impl<'a> IndexRow<'a> {
    /// Eight indices of a list whose indices are all below `bound`; the caller has checked that.
    #[inline(always)]
    pub(super) fn new(row: &'a [u32; LANES], bound: usize) -> Self {
        Self { row, bound }
    }

    /// The indices, after a check that each is below `len`.
    #[inline(always)]
    pub(super) fn within(self, len: usize) -> &'a [u32; LANES] {
        assert!(self.bound <= len, "indices lie within the table");
        self.row
    }
}
