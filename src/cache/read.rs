//! Reading and verifying a frame.
//!
//! Order of trust: magic, version, header checksum, trailer, then the heads of all chunks and the seal over
//! them; only then is memory taken for columns, and each chunk's checksum is compared before it is unpacked.

use super::CacheError;
use super::chunks::{Seal, max_stored, unpack, words_mut};
use super::error::Damage;
use super::folder::index_of;
use super::format::{
    CHUNK_HEAD, ChannelKind, END, FORMAT_VERSION, FrameInfo, Head, MAGIC, MIN_STORED, PROLOGUE, StreamInfo,
    TRAILER, head_checksum, parse_header,
};
use super::open::open_inside;
use crate::control::fallible;
use crate::frame::{ChannelData, Frame, Stream, StreamKind};
use crate::math::Vec3;
use crate::par;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::Path;
use xxhash_rust::xxh3::xxh3_64;

/// Chunks read and unpacked at once; bounds the memory in addition to that of the columns.
const BATCH: usize = 64;

/// Reads a frame and verifies every checksum.
///
/// # Errors
/// [`CacheError::NotFound`], [`CacheError::Corrupt`], [`CacheError::Version`] or [`CacheError::Io`].
pub fn read_frame(path: &Path) -> Result<(Frame, FrameInfo), CacheError> {
    read_frame_within(path, None)
}

/// Reads a frame as [`read_frame`] does, as far as its columns take at most `max_memory` \[bytes\].
///
/// Columns of equal numbers are stored in a thousandth of their memory, so that a short file of a stranger may unpack to gigabytes.
/// The header states the memory, which is compared before any of it is taken.
///
/// # Errors
/// As [`read_frame`]; [`CacheError::OverMemory`] if the columns take more.
pub fn read_frame_within(path: &Path, max_memory: Option<u64>) -> Result<(Frame, FrameInfo), CacheError> {
    Source::open(path)?.frame(max_memory, |_| true)
}

/// Reads the streams of a kind, and unpacks no others. Heads of chunks are verified in the whole frame, contents in these streams.
///
/// # Errors
/// As [`read_frame`].
pub(crate) fn read_streams(path: &Path, kind: StreamKind) -> Result<Frame, CacheError> {
    Ok(Source::open(path)?.frame(None, |info| info.kind == kind)?.0)
}

/// Reads a frame's header without its columns; verifies the header and that the file is complete.
///
/// # Errors
/// As [`read_frame`].
pub fn read_header(path: &Path) -> Result<FrameInfo, CacheError> {
    Ok(Source::open(path)?.head()?.info)
}

/// Verifies every checksum of a frame without unpacking it; the memory is that of a few chunks.
///
/// # Errors
/// As [`read_frame`].
pub fn verify_frame(path: &Path) -> Result<FrameInfo, CacheError> {
    Source::open(path)?.verify()
}

/// How often the columns may be as long as the file. The first frame of `dam-break` with 572 000 particles, at rest on the seeding
/// lattice, was measured at 372 times and that of `drop-in-pool` with 1.3 million at 326; a system with more columns of zeros
/// has more. Smaller, and first frames are refused; larger, and a small file can fill a machine.
const MAX_EXPANSION: u64 = 4096;

/// Memory that the columns may take however short the file is [bytes].
const MIN_UNPACKED: u64 = 256 << 20;

/// The byte at which a chunk is wrong, what was found and what was expected.
type ChunkFault = (u64, String, String);

/// Where a chunk lies and what it should be.
struct ChunkPlace {
    /// Byte at which the stored bytes start.
    start: u64,
    stored: usize,
    checksum: u64,
    entries: usize,
}

/// The chunks of one column.
struct ColumnPlace<'a> {
    stream: &'a StreamInfo,
    name: &'a str,
    kind: ChannelKind,
    chunks: Vec<ChunkPlace>,
}

impl ColumnPlace<'_> {
    fn place(&self, chunk: usize) -> String {
        format!("{}.{}, chunk {chunk} at byte {}", self.stream.name, self.name, self.chunks[chunk].start)
    }
}

/// A frame's bytes.
pub(super) struct Source<'a, R> {
    reader: R,
    path: &'a Path,
    bytes: u64,
}

impl<'a> Source<'a, File> {
    fn open(path: &'a Path) -> Result<Self, CacheError> {
        let failed = |error| CacheError::from_io(path, "open the frame", error);
        // `cache/frame_0001.mcf` in the folder of the shot.
        let shot = path.ancestors().nth(2).unwrap_or(Path::new(""));
        let (file, bytes) = open_inside(shot, path).map_err(failed)?;
        Ok(Self { reader: file, path, bytes })
    }
}

impl<'a, R: Read + Seek> Source<'a, R> {
    /// A frame of `bytes` bytes behind `reader`.
    #[cfg(any(test, feature = "fuzzing"))]
    pub(super) fn new(reader: R, path: &'a Path, bytes: u64) -> Self {
        Self { reader, path, bytes }
    }

    /// Reads the `wanted` streams of the frame, whose columns may take `max_memory` bytes.
    pub(super) fn frame(
        mut self,
        max_memory: Option<u64>,
        wanted: impl Fn(&StreamInfo) -> bool,
    ) -> Result<(Frame, FrameInfo), CacheError> {
        let head = self.head()?;
        head.info.expect_memory(self.path, max_memory)?;
        let mut columns = self.columns(&head)?.into_iter();
        let mut streams = Vec::new();
        for info in &head.info.streams {
            let own = columns.by_ref().take(info.channels.len());
            if !wanted(info) {
                own.for_each(drop);
                continue;
            }
            let mut stream = Stream::new(info.name.clone(), info.kind, self.entries(info)?);
            for column in own {
                stream = stream.with(column.name, self.column(&column, head.chunk)?);
            }
            stream.scalars.clone_from(&info.scalars);
            streams.push(stream);
        }
        Ok((Frame { index: head.info.index, time: head.info.time, streams }, head.info))
    }

    /// Compares the length of the columns with the entries that the header names.
    fn check_length(&self, head: &Head) -> Result<(), CacheError> {
        let there = self.bytes - TRAILER as u64 - head.columns;
        if head.min_bytes() > u128::from(there) {
            let expected = format!("at least {} for the entries that the header names", head.min_bytes());
            return Err(self.corrupt("length of the columns", format!("{there} bytes"), expected));
        }
        Ok(())
    }

    /// Compares the memory of the columns with the length of the file.
    fn check_expansion(&self, info: &FrameInfo) -> Result<(), CacheError> {
        let needed = info.unpacked_bytes();
        let max = self.bytes.saturating_mul(MAX_EXPANSION).max(MIN_UNPACKED);
        if needed > max {
            let expected = format!(
                "at most {max}: {MAX_EXPANSION} times the file's length, and {} MiB in a short file",
                MIN_UNPACKED >> 20
            );
            return Err(self.corrupt("header, memory of the columns", format!("{needed} bytes"), expected));
        }
        Ok(())
    }

    /// Compares every checksum.
    pub(super) fn verify(mut self) -> Result<FrameInfo, CacheError> {
        let head = self.head()?;
        for column in self.columns(&head)? {
            for first in (0..column.chunks.len()).step_by(BATCH) {
                let (span, bytes) = self.batch(&column, first)?;
                let sums = par::map(span.len(), |i| xxh3_64(stored(&bytes, &span[0], &span[i])));
                for (i, sum) in sums.into_iter().enumerate() {
                    self.compare(&column, first + i, sum)?;
                }
            }
        }
        Ok(head.info)
    }

    /// Reads prologue, header and trailer.
    pub(super) fn head(&mut self) -> Result<Head, CacheError> {
        let mut prologue = [0; PROLOGUE];
        let there = self.bytes.min(PROLOGUE as u64) as usize;
        self.read_at(0, &mut prologue[..there])?;
        if there < MAGIC.len() || prologue[..MAGIC.len()] != MAGIC {
            let found = format!("{:02x?}", &prologue[..there.min(MAGIC.len())]);
            return Err(self.corrupt("magic at byte 0", found, format!("{MAGIC:02x?} of a cache frame")));
        }
        let version = word(&prologue, 8);
        if there >= 12 && !(1..=FORMAT_VERSION).contains(&version) {
            let path = self.path.to_path_buf();
            return Err(CacheError::Version { path, found: version, expected: FORMAT_VERSION });
        }
        let length = u64::from(word(&prologue, 12));
        let min = (PROLOGUE + TRAILER) as u64 + length;
        if self.bytes < min {
            let expected = format!("at least {min}: the file was cut short");
            return Err(self.corrupt("length of the file", format!("{} bytes", self.bytes), expected));
        }

        let mut header = vec![0; length as usize];
        self.read_at(PROLOGUE as u64, &mut header)?;
        let (found, expected) = (head_checksum(&prologue, &header), long(&prologue, 16));
        if found != expected {
            return Err(self.corrupt("checksum of the header", hex(found), hex(expected)));
        }
        self.check_end()?;
        let head =
            parse_header(&header, version, found, self.bytes).map_err(|damage| damage.of(self.path))?;
        self.check_index(&head)?;
        // Here, so that listing, verifying and reading refuse the same frames.
        self.check_length(&head)?;
        self.check_expansion(&head.info)?;
        Ok(head)
    }

    /// Compares the end of the file with its length: a cut or lengthened file has neither.
    fn check_end(&mut self) -> Result<(), CacheError> {
        let trailer = self.trailer()?;
        if trailer[16..] != END {
            let found = format!("{:02x?}", &trailer[16..]);
            let expected = format!("{END:02x?}: the file was cut short or bytes were added");
            return Err(self.corrupt("end mark", found, expected));
        }
        let expected = long(&trailer, 0);
        if expected != self.bytes {
            let found = format!("{} bytes", self.bytes);
            return Err(self.corrupt(
                "length of the file",
                found,
                format!("{expected}, as its trailer states"),
            ));
        }
        Ok(())
    }

    /// Compares the header's frame number with the file's name, where the name is one of ours.
    fn check_index(&self, head: &Head) -> Result<(), CacheError> {
        match index_of(self.path) {
            Some(named) if named != head.info.index => Err(CacheError::Misplaced {
                path: self.path.to_path_buf(),
                found: head.info.index.0,
                expected: named.0,
            }),
            _ => Ok(()),
        }
    }

    /// Finds every chunk, and compares their heads with the seal.
    fn columns<'h>(&mut self, head: &'h Head) -> Result<Vec<ColumnPlace<'h>>, CacheError> {
        let end = self.bytes - TRAILER as u64;
        let mut at = head.columns;
        let mut seal = Seal::new(head.checksum);
        let mut columns = Vec::new();
        for stream in &head.info.streams {
            let entries = self.entries(stream)?;
            for channel in &stream.channels {
                let (name, kind) = (channel.name.as_str(), channel.kind);
                let mut chunks = Vec::new();
                for first in (0..entries).step_by(head.chunk as usize) {
                    let entries = (entries - first).min(head.chunk as usize);
                    // Names may be as long as the file, so they are only put together for an error.
                    let chunk = self.chunk_head(&mut at, end, (entries, kind), &mut seal)?;
                    chunks.push(chunk.map_err(|(at, found, expected)| {
                        let place = format!("{}.{name}, chunk {} at byte {at}", stream.name, chunks.len());
                        self.corrupt(place, found, expected)
                    })?);
                }
                columns.push(ColumnPlace { stream, name, kind, chunks });
            }
        }
        if at != end {
            let found = format!("{} more bytes", end - at);
            return Err(self.corrupt(format!("after the last chunk at byte {at}"), found, "the trailer"));
        }
        let (found, expected) = (seal.finish(), long(&self.trailer()?, 8));
        if found != expected {
            return Err(self.corrupt("seal over all chunks", hex(found), hex(expected)));
        }
        Ok(columns)
    }

    /// Reads the head of the chunk at `at` and moves `at` behind the chunk; else where the fault is, what was found and what was
    /// expected.
    fn chunk_head(
        &mut self,
        at: &mut u64,
        end: u64,
        (entries, kind): (usize, ChannelKind),
        seal: &mut Seal,
    ) -> Result<Result<ChunkPlace, ChunkFault>, CacheError> {
        if end - *at < CHUNK_HEAD as u64 {
            return Ok(Err((*at, format!("{} bytes left", end - *at), "the head of a chunk".into())));
        }
        let mut head = [0; CHUNK_HEAD];
        self.read_at(*at, &mut head)?;
        seal.add(&head);
        let stored = word(&head, 0) as usize;
        let start = *at + CHUNK_HEAD as u64;
        let max = (max_stored(entries * kind.words() * 4) as u64).min(end - start);
        if stored < MIN_STORED || stored as u64 > max {
            let expected = format!("{MIN_STORED} to {max} bytes");
            return Ok(Err((*at, format!("a stored length of {stored}"), expected)));
        }
        *at = start + stored as u64;
        Ok(Ok(ChunkPlace { start, stored, checksum: long(&head, 4), entries }))
    }

    /// Reads one column.
    fn column(&mut self, column: &ColumnPlace, chunk: u32) -> Result<ChannelData, CacheError> {
        let in_entry = column.kind.words();
        let entries = column.chunks.iter().map(|chunk| chunk.entries).sum();
        let mut data = allocate(column.kind, entries)
            .map_err(|error| CacheError::from_io(self.path, "take memory for a column", error))?;
        let mut outs = words_mut(&mut data).chunks_mut(chunk as usize * in_entry);
        for first in (0..column.chunks.len()).step_by(BATCH) {
            let (span, bytes) = self.batch(column, first)?;
            let mut jobs: Vec<_> = span.iter().zip(outs.by_ref()).map(|job| (job, Ok(0))).collect();
            par::for_chunks(&mut jobs, 1, |_, jobs| {
                for ((place, out), result) in jobs {
                    let stored = stored(&bytes, &span[0], place);
                    let sum = xxh3_64(stored);
                    let unpacked = if sum == place.checksum { unpack(stored, in_entry, out) } else { Ok(()) };
                    *result = unpacked.map(|()| sum);
                }
            });
            for (i, (_, result)) in jobs.into_iter().enumerate() {
                match result {
                    Ok(sum) => self.compare(column, first + i, sum)?,
                    Err(found) => {
                        let expected = format!("{} entries", span[i].entries);
                        return Err(self.corrupt(column.place(first + i), found, expected));
                    }
                }
            }
        }
        Ok(data)
    }

    /// Reads a batch of stored chunks in one go; the bytes start at the first chunk's.
    fn batch<'c>(
        &mut self,
        column: &'c ColumnPlace,
        first: usize,
    ) -> Result<(&'c [ChunkPlace], Vec<u8>), CacheError> {
        let span = &column.chunks[first..(first + BATCH).min(column.chunks.len())];
        let last = &span[span.len() - 1];
        let mut bytes = vec![0; (last.start - span[0].start) as usize + last.stored];
        self.read_at(span[0].start, &mut bytes)?;
        Ok((span, bytes))
    }

    /// Compares a chunk's checksum.
    fn compare(&self, column: &ColumnPlace, chunk: usize, found: u64) -> Result<(), CacheError> {
        let expected = column.chunks[chunk].checksum;
        if found == expected {
            return Ok(());
        }
        let (found, expected) = (format!("checksum {}", hex(found)), hex(expected));
        Err(self.corrupt(column.place(chunk), found, expected))
    }

    /// The length of a stream as this machine counts.
    fn entries(&self, stream: &StreamInfo) -> Result<usize, CacheError> {
        usize::try_from(stream.len).map_err(|_| {
            let expected = "a length that this machine can address";
            self.corrupt(format!("header, stream {}", stream.name), stream.len.to_string(), expected)
        })
    }

    fn trailer(&mut self) -> Result<[u8; TRAILER], CacheError> {
        let mut trailer = [0; TRAILER];
        self.read_at(self.bytes - TRAILER as u64, &mut trailer)?;
        Ok(trailer)
    }

    fn read_at(&mut self, at: u64, out: &mut [u8]) -> Result<(), CacheError> {
        let read = self.reader.seek(SeekFrom::Start(at)).and_then(|_| self.reader.read_exact(out));
        read.map_err(|error| CacheError::from_io(self.path, "read the frame", error))
    }

    fn corrupt(
        &self,
        place: impl Into<String>,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> CacheError {
        Damage::new(place, found, expected).of(self.path)
    }
}

/// The stored bytes of `chunk` in a batch that starts with `first`.
fn stored<'b>(batch: &'b [u8], first: &ChunkPlace, chunk: &ChunkPlace) -> &'b [u8] {
    &batch[(chunk.start - first.start) as usize..][..chunk.stored]
}

/// A column of zeros; refuses instead of aborting where there is no memory.
fn allocate(kind: ChannelKind, entries: usize) -> io::Result<ChannelData> {
    fn zeros<T: Clone>(entries: usize, zero: T) -> io::Result<Vec<T>> {
        let mut values = Vec::new();
        fallible(|| values.try_reserve_exact(entries))
            .map_err(|_| io::Error::from(io::ErrorKind::OutOfMemory))?;
        values.resize(entries, zero);
        Ok(values)
    }
    Ok(match kind {
        ChannelKind::F32 => ChannelData::F32(zeros(entries, 0.0)?),
        ChannelKind::Vec3 => ChannelData::Vec3(zeros(entries, Vec3::zeros())?),
        ChannelKind::U32 => ChannelData::U32(zeros(entries, 0)?),
    })
}

fn word(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(bytes[at..at + 4].try_into().expect("four bytes were cut"))
}

fn long(bytes: &[u8], at: usize) -> u64 {
    u64::from_le_bytes(bytes[at..at + 8].try_into().expect("eight bytes were cut"))
}

fn hex(value: u64) -> String {
    format!("{value:016x}")
}
