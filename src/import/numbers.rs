//! Blocks of binary numbers, of any type and byte order, as the values of an attribute.

use super::gather::Values;

/// The type of a block's numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Kind {
    /// Bytes of a number: 4 or 8 for floats, 1, 2, 4 or 8 for integers.
    pub(super) size: usize,
    pub(super) number: Number,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Number {
    Float,
    Signed,
    Unsigned,
}

/// The numbers of `block`, whose length is a multiple of their size; `big`: big-endian.
pub(super) fn values(block: &[u8], kind: Kind, big: bool) -> Values {
    match (kind.number, kind.size) {
        (Number::Float, 4) => {
            let read = if big { f32::from_be_bytes } else { f32::from_le_bytes };
            Values::Float(block.as_chunks().0.iter().map(|&bytes| read(bytes)).collect())
        }
        (Number::Float, _) => {
            let read = if big { f64::from_be_bytes } else { f64::from_le_bytes };
            Values::Float(block.as_chunks().0.iter().map(|&bytes| read(bytes) as f32).collect())
        }
        (number, size) => {
            Values::Int(block.chunks_exact(size).map(|bytes| integer(bytes, number, big)).collect())
        }
    }
}

/// An integer; beyond the range the largest that fits.
fn integer(bytes: &[u8], number: Number, big: bool) -> i64 {
    let high_byte = if big { bytes[0] } else { bytes[bytes.len() - 1] };
    let mut wide = [if number == Number::Signed && high_byte >= 128 { 0xff } else { 0 }; 16];
    let wide = if big {
        wide[16 - bytes.len()..].copy_from_slice(bytes);
        i128::from_be_bytes(wide)
    } else {
        wide[..bytes.len()].copy_from_slice(bytes);
        i128::from_le_bytes(wide)
    };
    i64::try_from(wide).unwrap_or(i64::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn integers_of_every_size_and_order() {
        let kind = |size, number| Kind { size, number };
        for (size, number, bytes, expected) in [
            (1, Number::Unsigned, &[0xff][..], 255),
            (1, Number::Signed, &[0xff], -1),
            (2, Number::Signed, &[0xff, 0xfe], -2),
            (4, Number::Unsigned, &[0xff, 0xff, 0xff, 0xff], 4_294_967_295),
            (8, Number::Signed, &[0x80, 0, 0, 0, 0, 0, 0, 0], i64::MIN),
            (8, Number::Unsigned, &[0xff; 8], i64::MAX),
        ] {
            assert_eq!(values(bytes, kind(size, number), true), Values::Int(vec![expected]));
            let reversed: Vec<u8> = bytes.iter().rev().copied().collect();
            assert_eq!(values(&reversed, kind(size, number), false), Values::Int(vec![expected]));
        }
    }
}
