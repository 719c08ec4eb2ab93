//! Frames and samples as someone would craft them: any bytes, with checksums that are right.
//!
//! Whoever writes a file can compute its checksums, so that they protect from damage and not from malice. With them, random bytes
//! come past the first comparison.

use super::{
    CacheError, FrameInfo,
    chunks::Seal,
    format::{CHUNK_HEAD, MAGIC, PROLOGUE, TRAILER, head_checksum, parse_header, trailer_bytes},
    read::Source,
    samples,
};
use crate::{
    frame::Frame,
    sdf::{Sampled, SampledGrid},
};
use std::{io::Cursor, path::Path};
use xxhash_rust::xxh3::xxh3_64;

/// What errors call the bytes.
const NAME: &str = "crafted";

/// Reads a frame from its bytes, whose columns may take `max_memory` bytes.
///
/// # Errors
/// As [`super::read_frame_within`].
pub(crate) fn decode_frame(bytes: &[u8], max_memory: Option<u64>) -> Result<(Frame, FrameInfo), CacheError> {
    source(bytes).frame(max_memory, |_| true)
}

/// Verifies a frame's bytes.
///
/// # Errors
/// As [`super::verify_frame`].
pub(crate) fn verify_bytes(bytes: &[u8]) -> Result<FrameInfo, CacheError> {
    source(bytes).verify()
}

fn source(bytes: &[u8]) -> Source<'static, Cursor<&[u8]>> {
    Source::new(Cursor::new(bytes), Path::new(NAME), bytes.len() as u64)
}

/// Makes mark, checksums and trailer of a frame right, as far as its header and the heads of its chunks can be followed.
pub(crate) fn seal_frame(bytes: &mut [u8]) {
    let length = bytes.len();
    if length < PROLOGUE + TRAILER {
        return;
    }
    bytes[..MAGIC.len()].copy_from_slice(&MAGIC);
    let (version, header) = (word(bytes, 8), word(bytes, 12) as usize);
    let end = length - TRAILER;
    if header > end - PROLOGUE {
        return;
    }
    let checksum = head_checksum(&bytes[..PROLOGUE], &bytes[PROLOGUE..PROLOGUE + header]);
    bytes[16..24].copy_from_slice(&checksum.to_le_bytes());
    let head = parse_header(&bytes[PROLOGUE..PROLOGUE + header], version, checksum, length as u64);
    let mut seal = Seal::new(checksum);
    let mut at = PROLOGUE + header;
    if let Ok(head) = head {
        let columns = head.info.streams.iter();
        let chunks = columns.flat_map(|stream| stream.channels.iter().map(|_| head.chunks(stream.len)));
        for _ in chunks.flat_map(|chunks| 0..chunks) {
            let start = at + CHUNK_HEAD;
            if start > end || word(bytes, at) as usize > end - start {
                break;
            }
            let next = start + word(bytes, at) as usize;
            let sum = xxh3_64(&bytes[start..next]);
            bytes[at + 4..start].copy_from_slice(&sum.to_le_bytes());
            seal.add(&bytes[at..start]);
            at = next;
        }
    }
    bytes[end..].copy_from_slice(&trailer_bytes(length as u64, seal.finish()));
}

fn word(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(std::array::from_fn(|i| bytes[at + i]))
}

/// Reads samples of a mesh with this grid from their bytes.
///
/// # Errors
/// As [`super::read_samples`].
pub(crate) fn decode_samples(bytes: &[u8], key: u64, grid: &SampledGrid) -> Result<Sampled, CacheError> {
    samples::decode(bytes, key, grid).map_err(|damage| damage.of(Path::new(NAME)))
}

/// Makes the length and the checksum of samples right.
pub(crate) fn seal_samples(bytes: &mut [u8]) {
    let Some(end) = bytes.len().checked_sub(8).filter(|&end| end >= samples::HEAD) else { return };
    bytes[44..52].copy_from_slice(&((end - samples::HEAD) as u64).to_le_bytes());
    let sum = xxh3_64(&bytes[..end]);
    bytes[end..].copy_from_slice(&sum.to_le_bytes());
}

#[cfg(test)]
mod tests {
    use super::{
        super::{chunks::pack, format::FORMAT_VERSION, tests::frame, write::encode},
        *,
    };

    /// A frame of one stream with one vector, all zeros, in chunks of `chunk` entries.
    fn zeros(stream: &str, entries: u64, chunk: u32) -> Vec<u8> {
        let mut header = [&7_u64.to_le_bytes()[..], &1_u32.to_le_bytes(), &0_u64.to_le_bytes()].concat();
        let text = |header: &mut Vec<u8>, text: &str| {
            header.extend((text.len() as u32).to_le_bytes());
            header.extend(text.as_bytes());
        };
        text(&mut header, "0.1.0");
        header.extend([chunk, 1].iter().flat_map(|number| number.to_le_bytes()));
        text(&mut header, stream);
        header.push(1);
        header.extend(entries.to_le_bytes());
        header.extend(1_u32.to_le_bytes());
        text(&mut header, "a");
        header.push(2);
        header.extend(0_u32.to_le_bytes());
        let (packed, _) = pack(&vec![0; 3 * chunk as usize], 3).unwrap();
        let mut bytes = MAGIC.to_vec();
        bytes.extend([FORMAT_VERSION, header.len() as u32].iter().flat_map(|number| number.to_le_bytes()));
        bytes.extend([0; 8]);
        bytes.extend(header);
        for _ in 0..entries / u64::from(chunk) {
            bytes.extend((packed.len() as u32).to_le_bytes());
            bytes.extend([0; 8]);
            bytes.extend(&packed);
        }
        bytes.extend([0; TRAILER]);
        seal_frame(&mut bytes);
        bytes
    }

    #[test]
    fn a_short_frame_of_very_many_equal_numbers_is_refused_before_memory_is_taken() {
        let small = zeros("a", 4 << 20, 1 << 20);
        assert_eq!(decode_frame(&small, None).unwrap().0.streams[0].len(), 4 << 20);
        let large = zeros("a", 40 << 20, 1 << 20);
        assert!(large.len() < 100_000);
        let why = verify_bytes(&large).unwrap_err().to_string();
        assert!(
            why.contains("found 503316480 bytes"),
            "what reading refuses is not verified as valid: {why}"
        );
        let took = allocation_counter::measure(|| {
            let why = decode_frame(&large, None).unwrap_err().to_string();
            assert!(why.contains("found 503316480 bytes, expected at most 268435456"), "{why}");
            let why = decode_frame(&small, Some(50_000_000)).unwrap_err();
            assert!(matches!(why, CacheError::OverMemory { needed: 50_331_648, allowed: 50_000_000, .. }));
        });
        assert!(took.bytes_max < 64 << 10, "{} bytes", took.bytes_max);
    }

    #[test]
    fn the_name_of_a_stream_is_not_copied_for_each_of_its_chunks() {
        // 400 GB in all.
        let bytes = zeros(&"n".repeat(2 << 20), 200_000, 1);
        assert_eq!(verify_bytes(&bytes).unwrap().streams[0].len, 200_000);
    }

    #[test]
    fn a_frame_that_was_changed_and_sealed_again_is_read() {
        let mut bytes = Vec::new();
        encode(&mut bytes, &frame(1, 9), 5).unwrap();
        let good = bytes.clone();
        seal_frame(&mut bytes);
        assert_eq!(bytes, good, "the checksums of a good frame are right");
        // Bytes 32 to 36 are the frame's number.
        bytes[32] = 7;
        assert!(decode_frame(&bytes, None).is_err() && verify_bytes(&bytes).is_err());
        seal_frame(&mut bytes);
        assert_eq!(decode_frame(&bytes, None).unwrap().0.index.0, 7);
        assert_eq!(verify_bytes(&bytes).unwrap().index.0, 7);
    }
}
