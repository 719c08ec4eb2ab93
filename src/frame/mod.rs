//! One instant of a shot, as named columns: the waist of the tool.
//!
//! Simulation writes frames, the cache keeps them, and everything after reads nothing else. A [`Frame`] holds
//! the [`Stream`]s of all systems, a stream holds [`Channel`]s of equal length (one entry a particle) and
//! scalars. A stream's [`StreamKind`] defines its entries; its name, the system they belong to. Channel names in
//! use: `position` [m], `velocity` [m/s], `id` (stable over time), `age` [s], `source` (its number, from 0),
//! `density` [kg/m³], `color` (linear red, green and blue), `microrotation` [1/s].

mod columns;
mod kind;

pub use columns::{Column, Columns};
pub use kind::StreamKind;

use crate::math::Vec3;

/// Name of the channel of colours: linear red, green and blue from 0 to 1.
pub const COLOR: &str = "color";

/// The number of a frame, as the artist counts (frame 1 is usually the first).
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, serde::Serialize, serde::Deserialize,
)]
#[serde(transparent)]
pub struct FrameIndex(pub u32);

impl std::fmt::Display for FrameIndex {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{:04}", self.0)
    }
}

/// Distances between particles that grids can be made with [m]: cubes of them and of their inverses are far from the limits of
/// single precision.
pub const SPACING_RANGE: std::ops::RangeInclusive<f64> = 1e-6..=1e6;

/// One instant of every system in the shot.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Number of the frame.
    pub index: FrameIndex,
    /// Time since the start of the shot [s].
    pub time: f64,
    /// The streams of every system, in a fixed order.
    pub streams: Vec<Stream>,
}

impl Frame {
    /// The stream of that name.
    pub fn stream(&self, name: &str) -> Option<&Stream> {
        self.streams.iter().find(|stream| stream.name == name)
    }
}

/// The state of a system or a part of it: named columns of one length, and named numbers.
///
/// Invariant: every channel has `len` entries, and no two channels share a name.
#[derive(Clone, Debug, PartialEq)]
pub struct Stream {
    /// Name of the stream, which starts with the system's ("liquid").
    pub name: String,
    /// Kind of the entries.
    pub kind: StreamKind,
    len: usize,
    channels: Vec<Channel>,
    /// Named numbers of the whole stream, for example `density_dev_avg`; the order is kept.
    pub scalars: Vec<(String, f64)>,
}

impl Stream {
    /// A stream of `len` entries without channels yet.
    pub fn new(name: impl Into<String>, kind: StreamKind, len: usize) -> Self {
        Self { name: name.into(), kind, len, channels: Vec::new(), scalars: Vec::new() }
    }

    /// Adds a channel.
    ///
    /// # Panics
    /// If its length is not the stream's, or the name is taken.
    #[must_use]
    pub fn with(mut self, name: impl Into<String>, data: impl Into<ChannelData>) -> Self {
        let channel = Channel { name: name.into(), data: data.into() };
        assert_eq!(channel.data.len(), self.len, "channel {} has the stream's length", channel.name);
        assert!(self.channel(&channel.name).is_none(), "channel {} is added once", channel.name);
        self.channels.push(channel);
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

    /// Every channel, in the order added.
    pub fn channels(&self) -> &[Channel] {
        &self.channels
    }

    /// The channel of that name.
    pub fn channel(&self, name: &str) -> Option<&ChannelData> {
        self.channels.iter().find(|channel| channel.name == name).map(|channel| &channel.data)
    }

    /// The vectors of that name, if it is a vector channel.
    pub fn vec3(&self, name: &str) -> Option<&[Vec3]> {
        match self.channel(name) {
            Some(ChannelData::Vec3(values)) => Some(values),
            _ => None,
        }
    }

    /// The numbers of that name, if it is a number channel.
    pub fn f32(&self, name: &str) -> Option<&[f32]> {
        match self.channel(name) {
            Some(ChannelData::F32(values)) => Some(values),
            _ => None,
        }
    }

    /// The integers of that name, if it is an integer channel.
    pub fn u32(&self, name: &str) -> Option<&[u32]> {
        match self.channel(name) {
            Some(ChannelData::U32(values)) => Some(values),
            _ => None,
        }
    }

    /// The scalar `spacing` [m], if it is in [`SPACING_RANGE`].
    pub fn spacing(&self) -> Option<f32> {
        self.scalar("spacing").filter(|spacing| SPACING_RANGE.contains(spacing)).map(|spacing| spacing as f32)
    }

    /// The scalar of that name.
    pub fn scalar(&self, name: &str) -> Option<f64> {
        self.scalars.iter().find(|(key, _)| key == name).map(|&(_, value)| value)
    }
}

/// One named column.
#[derive(Clone, Debug, PartialEq)]
pub struct Channel {
    /// Name of the stream.
    pub name: String,
    /// Values, one an entry of the stream.
    pub data: ChannelData,
}

/// The values of a channel.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum ChannelData {
    /// Single-precision numbers.
    F32(Vec<f32>),
    /// Single-precision vectors.
    Vec3(Vec<Vec3>),
    /// Unsigned integers.
    U32(Vec<u32>),
}

impl ChannelData {
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
}

impl From<Vec<f32>> for ChannelData {
    fn from(values: Vec<f32>) -> Self {
        Self::F32(values)
    }
}

impl From<Vec<Vec3>> for ChannelData {
    fn from(values: Vec<Vec3>) -> Self {
        Self::Vec3(values)
    }
}

impl From<Vec<u32>> for ChannelData {
    fn from(values: Vec<u32>) -> Self {
        Self::U32(values)
    }
}
