//! The head and the end of the frame container (`docs/formats/cache.md`): writing, parsing, limits.

use super::error::Damage;
use crate::frame::{ChannelData, Frame, FrameIndex, StreamKind};
use serde::{Serialize, Serializer};
use std::collections::HashSet;
use xxhash_rust::xxh3::xxh3_64;

/// The version of the container that this build writes. It reads version 1 as well.
pub const FORMAT_VERSION: u32 = 2;

/// The first bytes of every frame. The high bit and the line ends reveal transfers that treat it as text.
pub(super) const MAGIC: [u8; 8] = *b"\x89MCF\r\n\x1a\n";
/// The last bytes of every frame.
pub(super) const END: [u8; 8] = *b"MCF-END\n";
/// Magic, version, length of the header, checksum.
pub(super) const PROLOGUE: usize = 24;
/// Length of the file, seal, end mark.
pub(super) const TRAILER: usize = 24;
/// Stored length and checksum, before each chunk.
pub(super) const CHUNK_HEAD: usize = 12;
/// Entries a chunk holds. Measured on a jittered seeding lattice of 10⁶ particles: 0.626 of raw at 4 Ki, 0.594 at 64 Ki,
/// 0.590 at 1 Mi. Larger chunks leave threads idle on columns of a million entries, and a flipped bit condemns more.
pub(super) const CHUNK_ENTRIES: u32 = 1 << 16;
/// The largest chunk that a reader takes, so that a chunk never needs more than 12 MiB.
const MAX_CHUNK_ENTRIES: u32 = 1 << 20;
/// Streams that a frame has at most; a sheet has two.
const MAX_STREAMS: u32 = 1 << 16;
/// Channels, and scalars, that a stream has at most, of which solvers write a few dozen. They are searched one by one wherever
/// they are used, so that time would grow with the square of their number.
const MAX_CHANNELS: u32 = 4096;
/// No zstd frame is shorter than this.
pub(super) const MIN_STORED: usize = 9;

/// The header of a frame, read without its columns.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct FrameInfo {
    /// The frame's number.
    pub index: FrameIndex,
    /// Time since the start of the shot \[s\].
    pub time: f64,
    /// Hash of everything that decided the content; 16 hexadecimal digits where serialised.
    #[serde(serialize_with = "hex")]
    pub key: u64,
    /// Version of the container.
    pub version: u32,
    /// Version of the tool that wrote the file.
    pub tool: String,
    /// Size of the file \[bytes\].
    pub bytes: u64,
    /// The streams of every system, in the order of the file.
    pub streams: Vec<StreamInfo>,
}

impl FrameInfo {
    /// The memory that the columns take when they are read [bytes]. It can be a thousand times the file's length, if numbers are equal.
    pub fn unpacked_bytes(&self) -> u64 {
        let words = |stream: &StreamInfo| {
            stream.channels.iter().map(|channel| channel.kind.words() as u64).sum::<u64>()
        };
        let bytes = |stream: &StreamInfo| stream.len.saturating_mul(4).saturating_mul(words(stream));
        self.streams.iter().map(bytes).fold(0, u64::saturating_add)
    }
}

/// One stream of a frame's header.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct StreamInfo {
    /// Name of the stream, which starts with the system's.
    pub name: String,
    /// Kind of the entries.
    pub kind: StreamKind,
    /// Entries (particles).
    pub len: u64,
    /// The columns, in the order of the file.
    pub channels: Vec<ChannelInfo>,
    /// Named numbers of the whole stream.
    pub scalars: Vec<(String, f64)>,
}

/// One column of a frame's header.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[non_exhaustive]
pub struct ChannelInfo {
    /// The column's name.
    pub name: String,
    /// The type of its entries.
    pub kind: ChannelKind,
}

/// The type of a column's entries.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum ChannelKind {
    /// One single-precision number.
    F32,
    /// Three single-precision numbers.
    Vec3,
    /// One unsigned 32-bit integer.
    U32,
}

impl ChannelKind {
    /// The type of `data`.
    pub fn of(data: &ChannelData) -> Self {
        match data {
            ChannelData::F32(_) => Self::F32,
            ChannelData::Vec3(_) => Self::Vec3,
            ChannelData::U32(_) => Self::U32,
        }
    }

    /// 32-bit words in an entry.
    pub fn words(self) -> usize {
        match self {
            Self::F32 | Self::U32 => 1,
            Self::Vec3 => 3,
        }
    }

    fn code(self) -> u8 {
        match self {
            Self::F32 => 1,
            Self::Vec3 => 2,
            Self::U32 => 3,
        }
    }

    fn from_code(code: u8) -> Option<Self> {
        [Self::F32, Self::Vec3, Self::U32].into_iter().find(|kind| kind.code() == code)
    }
}

/// A frame's header and what a reader needs to find the columns.
pub(super) struct Head {
    pub(super) info: FrameInfo,
    /// Entries in a chunk.
    pub(super) chunk: u32,
    /// Checksum of prologue and header; the seal starts with it.
    pub(super) checksum: u64,
    /// Byte at which the first chunk's head starts.
    pub(super) columns: u64,
}

impl Head {
    /// Chunks in a column of `len` entries.
    pub(super) fn chunks(&self, len: u64) -> u64 {
        len.div_ceil(u64::from(self.chunk))
    }

    /// The minimum of bytes that columns of the header's lengths can take, each chunk at its shortest.
    pub(super) fn min_bytes(&self) -> u128 {
        let smallest = (CHUNK_HEAD + MIN_STORED) as u128;
        let columns = |stream: &StreamInfo| {
            u128::from(self.chunks(stream.len)) * stream.channels.len() as u128 * smallest
        };
        self.info.streams.iter().map(columns).sum()
    }
}

/// Prologue and header of a frame, and their checksum.
///
/// # Panics
/// If two streams share a name.
pub(super) fn head_bytes(frame: &Frame, key: u64) -> (Vec<u8>, u64) {
    for (i, stream) in frame.streams.iter().enumerate() {
        let twice = frame.streams[..i].iter().any(|other| other.name == stream.name);
        assert!(!twice, "each stream has a name of its own, but {} is the name of two", stream.name);
    }
    let mut header = Vec::new();
    header.extend(key.to_le_bytes());
    header.extend(frame.index.0.to_le_bytes());
    header.extend(frame.time.to_bits().to_le_bytes());
    put_text(&mut header, env!("CARGO_PKG_VERSION"));
    header.extend(CHUNK_ENTRIES.to_le_bytes());
    put_count(&mut header, frame.streams.len());
    for stream in &frame.streams {
        put_text(&mut header, &stream.name);
        header.push(kind_code(stream.kind));
        header.extend((stream.len() as u64).to_le_bytes());
        put_count(&mut header, stream.channels().len());
        for channel in stream.channels() {
            put_text(&mut header, &channel.name);
            header.push(ChannelKind::of(&channel.data).code());
        }
        put_count(&mut header, stream.scalars.len());
        for (name, value) in &stream.scalars {
            put_text(&mut header, name);
            header.extend(value.to_bits().to_le_bytes());
        }
    }

    let mut bytes = MAGIC.to_vec();
    bytes.extend(FORMAT_VERSION.to_le_bytes());
    put_count(&mut bytes, header.len());
    let checksum = head_checksum(&bytes, &header);
    bytes.extend(checksum.to_le_bytes());
    bytes.extend(header);
    (bytes, checksum)
}

/// Checksum of the prologue's first 16 bytes and the header.
pub(super) fn head_checksum(prologue: &[u8], header: &[u8]) -> u64 {
    xxh3_64(&[&prologue[..16], header].concat())
}

/// The trailer of a file of `length` bytes whose checksums are sealed by `seal`.
pub(super) fn trailer_bytes(length: u64, seal: u64) -> [u8; TRAILER] {
    let mut bytes = [0; TRAILER];
    bytes[..8].copy_from_slice(&length.to_le_bytes());
    bytes[8..16].copy_from_slice(&seal.to_le_bytes());
    bytes[16..].copy_from_slice(&END);
    bytes
}

/// The number of a stream's kind in a header.
fn kind_code(kind: StreamKind) -> u8 {
    match kind {
        StreamKind::Unknown => 0,
        StreamKind::Particles => 1,
        StreamKind::Tracers => 2,
        StreamKind::Vortons => 3,
        StreamKind::MeshPoints => 4,
        StreamKind::MeshFaces => 5,
        StreamKind::RigidBodies => 6,
    }
}

/// The kind of that number. Other numbers are of kinds that a later build added.
fn kind_of_code(code: u8) -> StreamKind {
    use StreamKind::{MeshFaces, MeshPoints, Particles, RigidBodies, Tracers, Vortons};
    let known = [Particles, Tracers, Vortons, MeshPoints, MeshFaces, RigidBodies];
    known.into_iter().find(|&kind| kind_code(kind) == code).unwrap_or_default()
}

/// The kind of a stream of that name in a header of version 1, which stores none. These are all names that builds
/// of that version wrote.
fn kind_in_version_1(name: &str) -> StreamKind {
    match name {
        "liquid" => StreamKind::Particles,
        "smoke" => StreamKind::Vortons,
        "smoke_tracers" => StreamKind::Tracers,
        _ if !name.starts_with("sheet.") => StreamKind::Unknown,
        _ if name.ends_with(".faces") => StreamKind::MeshFaces,
        _ => StreamKind::MeshPoints,
    }
}

/// Reads the header of a file of `version` and of `bytes` bytes, its checksum already compared.
pub(super) fn parse_header(header: &[u8], version: u32, checksum: u64, bytes: u64) -> Result<Head, Damage> {
    let mut fields = Fields { rest: header, length: header.len() };
    let key = fields.u64("simulation key")?;
    let index = FrameIndex(fields.u32("frame number")?);
    let time = f64::from_bits(fields.u64("time")?);
    let tool = fields.text("tool version")?;
    let chunk = fields.u32("entries in a chunk")?;
    if !(1..=MAX_CHUNK_ENTRIES).contains(&chunk) {
        let expected = format!("1 to {MAX_CHUNK_ENTRIES}");
        return Err(Damage::new("header, entries in a chunk", chunk.to_string(), expected));
    }
    let (mut streams, mut names) = (Vec::new(), HashSet::new());
    for _ in 0..fields.count("number of streams", MAX_STREAMS)? {
        let stream = parse_stream(&mut fields, version)?;
        if !names.insert(stream.name.clone()) {
            let found = format!("a second stream \"{}\"", stream.name);
            return Err(Damage::new("header, name of a stream", found, "each name once"));
        }
        streams.push(stream);
    }
    if !fields.rest.is_empty() {
        let found = format!("{} more bytes", fields.rest.len());
        return Err(Damage::new("header, after the last stream", found, "the end of the header"));
    }
    let columns = (PROLOGUE + header.len()) as u64;
    let info = FrameInfo { index, time, key, version, tool, bytes, streams };
    Ok(Head { info, chunk, checksum, columns })
}

fn parse_stream(fields: &mut Fields, version: u32) -> Result<StreamInfo, Damage> {
    let name = fields.text("name of a stream")?;
    let kind = match version {
        1 => kind_in_version_1(&name),
        _ => kind_of_code(fields.take("kind of a stream", 1)?[0]),
    };
    let len = fields.u64("length of a stream")?;
    let (mut channels, mut names) = (Vec::new(), HashSet::new());
    for _ in 0..fields.count("number of channels", MAX_CHANNELS)? {
        let channel = fields.text("name of a channel")?;
        let code = fields.take("type of a channel", 1)?[0];
        let Some(kind) = ChannelKind::from_code(code) else {
            let place = format!("header, type of {name}.{channel}");
            return Err(Damage::new(place, code.to_string(), "1 (f32), 2 (vec3) or 3 (u32)"));
        };
        if !names.insert(channel.clone()) {
            let found = format!("a second channel \"{channel}\"");
            return Err(Damage::new(format!("header, stream {name}"), found, "each name once"));
        }
        channels.push(ChannelInfo { name: channel, kind });
    }
    let mut scalars = Vec::new();
    for _ in 0..fields.count("number of scalars", MAX_CHANNELS)? {
        let scalar = fields.text("name of a scalar")?;
        scalars.push((scalar, f64::from_bits(fields.u64("value of a scalar")?)));
    }
    Ok(StreamInfo { name, kind, len, channels, scalars })
}

/// The fields of a header, in order.
struct Fields<'a> {
    rest: &'a [u8],
    length: usize,
}

impl<'a> Fields<'a> {
    fn take(&mut self, what: &str, count: usize) -> Result<&'a [u8], Damage> {
        let Some((field, rest)) = self.rest.split_at_checked(count) else {
            let place = format!("header, {what} at byte {}", PROLOGUE + self.length - self.rest.len());
            return Err(Damage::new(
                place,
                format!("{} bytes left", self.rest.len()),
                format!("{count} bytes"),
            ));
        };
        self.rest = rest;
        Ok(field)
    }

    fn u32(&mut self, what: &str) -> Result<u32, Damage> {
        Ok(u32::from_le_bytes(self.take(what, 4)?.try_into().expect("four bytes were taken")))
    }

    /// A number of things of which a frame has at most `max`.
    fn count(&mut self, what: &str, max: u32) -> Result<u32, Damage> {
        match self.u32(what)? {
            count if count <= max => Ok(count),
            count => Err(Damage::new(format!("header, {what}"), count.to_string(), format!("at most {max}"))),
        }
    }

    fn u64(&mut self, what: &str) -> Result<u64, Damage> {
        Ok(u64::from_le_bytes(self.take(what, 8)?.try_into().expect("eight bytes were taken")))
    }

    fn text(&mut self, what: &str) -> Result<String, Damage> {
        let length = self.u32(what)?;
        let bytes = self.take(what, usize::try_from(length).unwrap_or(usize::MAX))?;
        match std::str::from_utf8(bytes) {
            Ok(text) => Ok(text.to_owned()),
            Err(_) => Err(Damage::new(format!("header, {what}"), "bytes that are no text", "UTF-8")),
        }
    }
}

fn put_count(out: &mut Vec<u8>, count: usize) {
    let count = u32::try_from(count).expect("a header holds fewer than 2³² names and bytes");
    out.extend(count.to_le_bytes());
}

fn put_text(out: &mut Vec<u8>, text: &str) {
    put_count(out, text.len());
    out.extend(text.as_bytes());
}

/// Serialises a key as 16 hexadecimal digits: readers of JSON lose the low bits of large integers.
fn hex<S: Serializer>(key: &u64, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(&format_args!("{key:016x}"))
}
