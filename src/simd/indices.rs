//! Lists of indices that are checked once, when they are made, so that vector code may gather by them
//! unchecked.

use super::{IndexRow, LANES, Lanes, Pass, dispatch};
use std::ops::Range;

/// Indices that are all below a bound.
#[derive(Debug, Default)]
pub(crate) struct IndexList {
    list: Vec<u32>,
    /// Upper bound of every index, exclusive.
    bound: usize,
}

impl IndexList {
    /// Makes a list of indices below `bound`.
    ///
    /// # Panics
    /// If an index is not below the bound.
    pub(crate) fn new(list: Vec<u32>, bound: usize) -> Self {
        assert!(
            dispatch(Largest(&list)).is_none_or(|index| (index as usize) < bound),
            "indices are below {bound}"
        );
        Self { list, bound }
    }

    /// The memory of the list, to be reused.
    pub(crate) fn into_vec(self) -> Vec<u32> {
        self.list
    }

    /// The indices.
    #[inline]
    pub(crate) fn as_slice(&self) -> &[u32] {
        &self.list
    }

    /// How many indices the list has memory for.
    #[cfg(test)]
    pub(crate) fn capacity(&self) -> usize {
        self.list.capacity()
    }

    /// The indices of a range by eights; the last eight are filled up with `fill`.
    ///
    /// # Panics
    /// If the list does not contain the range, or `fill` is not below the bound.
    #[inline(always)]
    pub(crate) fn rows<L: Lanes>(&self, range: Range<usize>, fill: usize) -> IndexRows<'_> {
        assert!(fill < self.bound, "an index is below the bound");
        let list = &self.list[range];
        let last = L::padded(&list[list.len() / LANES * LANES..], fill as u32);
        IndexRows { list, next: 0, last, bound: self.bound }
    }
}

/// The largest of some numbers; `None` without any.
struct Largest<'a>(&'a [u32]);

impl Pass for Largest<'_> {
    type Out = Option<u32>;

    #[inline(always)]
    fn run<L: Lanes>(self) -> Option<u32> {
        self.0.iter().copied().reduce(u32::max)
    }
}

/// A range of an [`IndexList`] by eights.
///
/// A loop over it stays in the function that it is written in. A closure would be a function of its own,
/// compiled without the form's instructions, and 5 times slower.
pub struct IndexRows<'a> {
    list: &'a [u32],
    next: usize,
    /// The eight that begin where less than eight are left.
    last: [u32; LANES],
    /// Upper bound of every index, exclusive.
    bound: usize,
}

impl IndexRows<'_> {
    /// How many of the last eight fill it up.
    #[inline(always)]
    pub fn padding(&self) -> usize {
        self.list.len().next_multiple_of(LANES) - self.list.len()
    }

    /// The next eight. They are borrowed, so that each index is read from memory where it is used: copied,
    /// eight of them become one register that they have to be taken out of again, at twice the instructions.
    #[inline(always)]
    pub fn next(&mut self) -> Option<IndexRow<'_>> {
        if self.next >= self.list.len() {
            return None;
        }
        let row = self.list[self.next..].first_chunk().unwrap_or(&self.last);
        self.next += LANES;
        Some(IndexRow::new(row, self.bound))
    }
}
