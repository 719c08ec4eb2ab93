//! Compressed integers and bytes of crate files.
//!
//! *Method*: integers are stored as differences of consecutive values. Two bits of each difference are its size: the most common
//! value, 8, 16 or 32 bits. Codes and differences are one LZ4 block after a byte that counts further blocks
//! (OpenUSD, `pxr/usd/sdf/integerCoding.h` and `pxr/base/tf/fastCompression.h`).

/// The largest input of an LZ4 block [bytes].
pub(super) const MAX_BLOCK: usize = 0x7E00_0000;

/// Differences that are candidates for the most common one: between neighbouring indices of a mesh. A common value beyond takes
/// 8 bits a difference instead of none.
const CANDIDATES: std::ops::Range<i32> = -64..64;

/// Bytes as an LZ4 block with its prefix.
///
/// # Panics
/// If there are more than [`MAX_BLOCK`]: callers refuse such arrays.
pub(super) fn compress(bytes: &[u8]) -> Vec<u8> {
    assert!(bytes.len() <= MAX_BLOCK, "arrays of this length are refused before they are encoded");
    // No further blocks.
    let mut block = vec![0];
    block.extend(lz4_flex::block::compress(bytes));
    block
}

/// The largest encoding of so many integers before it is compressed [bytes].
pub(super) fn max_encoded(count: usize) -> usize {
    count.saturating_mul(4).saturating_add(count.div_ceil(4)).saturating_add(4)
}

/// Integers as differences with codes, compressed.
pub(super) fn compress_integers(values: impl Iterator<Item = i32> + Clone) -> Vec<u8> {
    let differences = values.scan(0_i32, |before, value| {
        let difference = value.wrapping_sub(*before);
        *before = value;
        Some(difference)
    });
    let mut counts = vec![0_u64; CANDIDATES.len()];
    let mut length = 0;
    for difference in differences.clone() {
        length += 1;
        if CANDIDATES.contains(&difference) {
            counts[(difference - CANDIDATES.start) as usize] += 1;
        }
    }
    let candidate = (0..counts.len()).max_by_key(|&place| counts[place]).unwrap_or(0);
    let common = CANDIDATES.start + candidate as i32;
    let mut codes = vec![0_u8; usize::div_ceil(length, 4)];
    let mut numbers = Vec::new();
    for (place, difference) in differences.enumerate() {
        let code = if difference == common {
            0
        } else if let Ok(small) = i8::try_from(difference) {
            numbers.extend(small.to_le_bytes());
            1
        } else if let Ok(medium) = i16::try_from(difference) {
            numbers.extend(medium.to_le_bytes());
            2
        } else {
            numbers.extend(difference.to_le_bytes());
            3
        };
        codes[place / 4] |= code << (2 * (place % 4));
    }
    compress(&[common.to_le_bytes().as_slice(), &codes, &numbers].concat())
}

/// Integers from their compressed form, for tests: written from the description alone.
#[cfg(test)]
pub(super) fn decompress_integers(bytes: &[u8], count: usize) -> Vec<i32> {
    let encoded = decompress(bytes, max_encoded(count));
    let (common, rest) = encoded.split_at(4);
    let common = i32::from_le_bytes(common.try_into().unwrap());
    let (codes, mut numbers) = rest.split_at(count.div_ceil(4));
    let mut value = 0_i32;
    let mut take = |length: usize| {
        let (number, rest) = numbers.split_at(length);
        numbers = rest;
        number.to_vec()
    };
    let values = (0..count).map(|place| {
        value = value.wrapping_add(match codes[place / 4] >> (2 * (place % 4)) & 3 {
            0 => common,
            1 => i8::from_le_bytes(take(1).try_into().unwrap()).into(),
            2 => i16::from_le_bytes(take(2).try_into().unwrap()).into(),
            _ => i32::from_le_bytes(take(4).try_into().unwrap()),
        });
        value
    });
    values.collect()
}

/// Bytes from an LZ4 block with its prefix, for tests.
#[cfg(test)]
pub(super) fn decompress(bytes: &[u8], max: usize) -> Vec<u8> {
    assert_eq!(bytes[0], 0, "one block");
    lz4_flex::block::decompress(&bytes[1..], max).unwrap()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn counts_of_triangles_take_next_to_nothing() {
        let encoded = compress_integers(std::iter::repeat_n(3, 100_000));
        assert!(encoded.len() < 200, "{}", encoded.len());
        assert_eq!(decompress_integers(&encoded, 100_000), vec![3; 100_000]);
    }

    proptest! {
        #[test]
        fn integers_survive(values in prop::collection::vec(prop_oneof![any::<i32>(), -70_i32..70, Just(i32::MIN)], 0..300)) {
            prop_assert_eq!(decompress_integers(&compress_integers(values.iter().copied()), values.len()), values);
        }
    }
}
