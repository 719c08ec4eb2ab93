//! Borrowed columns: the channels of a stream, or arrays that belong to a caller.

use super::{ChannelData, Stream};
use crate::math::Vec3;

/// Named columns of one length that belong to somebody else: a [`Stream`], or arrays that are not to be copied.
///
/// Invariant: every column has `len` entries, and no two share a name.
#[derive(Clone, Debug)]
pub struct Columns<'a> {
    len: usize,
    columns: Vec<(&'a str, Column<'a>)>,
}

/// The borrowed values of one column.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub enum Column<'a> {
    /// Single-precision numbers.
    F32(&'a [f32]),
    /// Single-precision vectors.
    Vec3(&'a [Vec3]),
    /// Unsigned integers.
    U32(&'a [u32]),
}

impl<'a> Columns<'a> {
    /// Columns of `len` entries, none yet.
    pub fn new(len: usize) -> Self {
        Self { len, columns: Vec::new() }
    }

    /// Adds a column.
    ///
    /// # Panics
    /// If its length is not that of the others, or the name is taken.
    #[must_use]
    pub fn with(mut self, name: &'a str, column: Column<'a>) -> Self {
        assert_eq!(column.len(), self.len, "column {name} has the length of the others");
        assert!(self.column(name).is_none(), "column {name} is added once");
        self.columns.push((name, column));
        self
    }

    /// The number of entries (particles).
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether there are no entries.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Every column with its name, in the order added.
    pub fn columns(&self) -> &[(&'a str, Column<'a>)] {
        &self.columns
    }

    /// The column of that name.
    pub fn column(&self, name: &str) -> Option<Column<'a>> {
        self.columns.iter().find(|(known, _)| *known == name).map(|&(_, column)| column)
    }

    /// The vectors of that name, if it is a column of vectors.
    pub fn vec3(&self, name: &str) -> Option<&'a [Vec3]> {
        match self.column(name) {
            Some(Column::Vec3(values)) => Some(values),
            _ => None,
        }
    }
}

impl Column<'_> {
    /// The number of entries.
    pub fn len(&self) -> usize {
        match self {
            Self::F32(values) => values.len(),
            Self::Vec3(values) => values.len(),
            Self::U32(values) => values.len(),
        }
    }

    /// Whether there are no entries.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// A copy of the values.
    pub fn to_data(&self) -> ChannelData {
        match *self {
            Self::F32(values) => values.to_vec().into(),
            Self::Vec3(values) => values.to_vec().into(),
            Self::U32(values) => values.to_vec().into(),
        }
    }
}

impl<'a> From<&'a ChannelData> for Column<'a> {
    fn from(data: &'a ChannelData) -> Self {
        match data {
            ChannelData::F32(values) => Self::F32(values),
            ChannelData::Vec3(values) => Self::Vec3(values),
            ChannelData::U32(values) => Self::U32(values),
        }
    }
}

impl<'a> From<&'a Stream> for Columns<'a> {
    fn from(stream: &'a Stream) -> Self {
        let columns =
            stream.channels().iter().map(|channel| (channel.name.as_str(), Column::from(&channel.data)));
        Self { len: stream.len(), columns: columns.collect() }
    }
}

impl<'a> From<&Columns<'a>> for Columns<'a> {
    fn from(columns: &Columns<'a>) -> Self {
        columns.clone()
    }
}
