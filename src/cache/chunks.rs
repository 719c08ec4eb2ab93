//! Columns as chunks: byte shuffle, zstd, checksum.
//!
//! A column is a sequence of 32-bit words, `words` of them an entry (a vector is x, y, z). The shuffle gathers the bytes of
//! equal significance of equal components, such as exponents, which makes floats compress at all. Measured on a jittered
//! seeding lattice of 10⁶ particles: 0.594 of raw with the shuffle, 0.829 without.

use crate::frame::ChannelData;
use bytemuck::{cast_slice, cast_slice_mut};
use xxhash_rust::xxh3::{Xxh3, xxh3_64};

/// zstd's compression level. Level 3 was measured at 0.580 instead of 0.594 of raw on a jittered seeding lattice, but at 0.673
/// instead of 0.671 on random positions, and slower on both.
const LEVEL: i32 = 1;

/// The words of a column.
pub(super) fn words(data: &ChannelData) -> &[u32] {
    match data {
        ChannelData::F32(values) => cast_slice(values),
        ChannelData::Vec3(values) => cast_slice(values),
        ChannelData::U32(values) => values,
    }
}

/// The words of a column, to be written.
pub(super) fn words_mut(data: &mut ChannelData) -> &mut [u32] {
    match data {
        ChannelData::F32(values) => cast_slice_mut(values),
        ChannelData::Vec3(values) => cast_slice_mut(values),
        ChannelData::U32(values) => values,
    }
}

/// A chunk as it lies in the file, and its checksum.
pub(super) fn pack(chunk: &[u32], words: usize) -> std::io::Result<(Vec<u8>, u64)> {
    let stored = zstd::bulk::compress(&shuffle(chunk, words), LEVEL)?;
    let checksum = xxh3_64(&stored);
    Ok((stored, checksum))
}

/// Unpacks a stored chunk, its checksum already compared, into `out`; the error describes what is wrong.
pub(super) fn unpack(stored: &[u8], words: usize, out: &mut [u32]) -> Result<(), String> {
    let length = size_of_val(out);
    let bytes = zstd::bulk::decompress(stored, length).map_err(|error| error.to_string())?;
    if bytes.len() != length {
        return Err(format!("{} bytes", bytes.len()));
    }
    unshuffle(&bytes, words, out);
    Ok(())
}

/// The largest stored length of a chunk of `length` bytes.
pub(super) fn max_stored(length: usize) -> usize {
    zstd::zstd_safe::compress_bound(length)
}

/// Byte b of word w of entry i goes to place (4w + b)·n + i.
fn shuffle(chunk: &[u32], words: usize) -> Vec<u8> {
    let entries = chunk.len() / words;
    let mut bytes = vec![0; size_of_val(chunk)];
    for (plane, out) in bytes.chunks_exact_mut(entries.max(1)).enumerate() {
        let (word, shift) = (plane / 4, 8 * (plane % 4));
        for (byte, entry) in out.iter_mut().zip(chunk.chunks_exact(words)) {
            *byte = (entry[word] >> shift) as u8;
        }
    }
    bytes
}

/// The inverse of [`shuffle`].
fn unshuffle(bytes: &[u8], words: usize, out: &mut [u32]) {
    let entries = out.len() / words;
    for word in 0..words {
        let plane = |byte: usize| &bytes[(4 * word + byte) * entries..][..entries];
        let [low, second, third, high] = [plane(0), plane(1), plane(2), plane(3)];
        for (i, entry) in out.chunks_exact_mut(words).enumerate() {
            entry[word] = u32::from_le_bytes([low[i], second[i], third[i], high[i]]);
        }
    }
}

/// The checksum over all checksums and lengths: what a chunk's own checksum cannot see is another chunk in its
/// place.
pub(super) struct Seal(Xxh3);

impl Seal {
    pub(super) fn new(head_checksum: u64) -> Self {
        let mut hash = Xxh3::new();
        hash.update(&head_checksum.to_le_bytes());
        Self(hash)
    }

    /// Adds a chunk's head, as it lies in the file.
    pub(super) fn add(&mut self, chunk_head: &[u8]) {
        self.0.update(chunk_head);
    }

    pub(super) fn finish(&self) -> u64 {
        self.0.digest()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shuffle_gathers_bytes_of_equal_significance() {
        let chunk = [0x0403_0201, 0x1413_1211, 0x2423_2221, 0x3433_3231];
        assert_eq!(
            shuffle(&chunk, 1),
            [1, 0x11, 0x21, 0x31, 2, 0x12, 0x22, 0x32, 3, 0x13, 0x23, 0x33, 4, 0x14, 0x24, 0x34]
        );
        let vectors = [1, 2, 3, 0x101, 0x102, 0x103];
        let bytes = shuffle(&vectors, 3);
        assert_eq!(bytes[..4], [1, 1, 0, 1]);
        assert_eq!(bytes[8..10], [2, 2]);
        let mut back = [0; 6];
        unshuffle(&bytes, 3, &mut back);
        assert_eq!(back, vectors);
    }

    #[test]
    fn the_seal_sees_order() {
        let seal = |chunks: [&[u8]; 2]| {
            let mut seal = Seal::new(7);
            for chunk in chunks {
                seal.add(chunk);
            }
            seal.finish()
        };
        assert_ne!(seal([b"first chunk.", b"other chunk."]), seal([b"other chunk.", b"first chunk."]));
    }
}
