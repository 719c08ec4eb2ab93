//! The values of one node of the tree: which are stored, and as what bytes.
//!
//! Only active values are stored. An inactive one is the background or minus it: a code states which, and a mask where both
//! occur.

use super::{Grid, VolumeParams, blosc, params::Precision};
use crate::grid::{BRICK, BRICK_NODES, NodeMask, is_set};

/// Codes for the inactive values of a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub(super) enum Inactive {
    /// All are the background.
    Background = 0,
    /// All are minus the background.
    Minus = 1,
    /// Stored with a mask, set where values are the background.
    Mask = 3,
}

impl Inactive {
    /// The code for values some of which may be background and some minus that.
    pub(super) fn of(some_plus: bool, some_minus: bool) -> Self {
        match (some_plus, some_minus) {
            (true, true) => Self::Mask,
            (false, true) => Self::Minus,
            (_, false) => Self::Background,
        }
    }
}

/// The place in a brick of the `index`th node in the order of a file: z runs fastest there, then y, then x.
pub(super) fn place(index: usize) -> usize {
    let [x, y, z] = [index / (BRICK * BRICK), index / BRICK % BRICK, index % BRICK];
    x + BRICK * (y + BRICK * z)
}

/// The bytes of a mask in the order of a file.
pub(super) fn mask_bytes(mask: &NodeMask) -> [u8; BRICK_NODES / 8] {
    std::array::from_fn(|byte| {
        (0..8).fold(0, |bits, bit| bits | u8::from(is_set(mask, place(8 * byte + bit))) << bit)
    })
}

/// Appends the buffer of the leaf that a brick is.
pub(super) fn write(grid: &Grid, brick: usize, params: &VolumeParams, out: &mut Vec<u8>) {
    let active = &grid.active[brick];
    let first = brick * BRICK_NODES;
    out.extend(mask_bytes(active));

    // Which side the inactive nodes are on.
    let inside: [bool; BRICK_NODES] = std::array::from_fn(|i| grid.class.is_inside(first + place(i)));
    let inactive = |i: &usize| !is_set(active, place(*i));
    let minus = (0..BRICK_NODES).filter(inactive).any(|i| inside[i]);
    let plus = (0..BRICK_NODES).filter(inactive).any(|i| !inside[i]);
    let code = Inactive::of(plus, minus);
    out.push(code as u8);
    if code == Inactive::Mask {
        let is_plus = |i: usize| inactive(&i) && !inside[i];
        out.extend(
            (0..BRICK_NODES / 8)
                .map(|byte| (0..8).fold(0, |bits, bit| bits | u8::from(is_plus(8 * byte + bit)) << bit)),
        );
    }

    // The active values, packed.
    let mut values = Vec::with_capacity(BRICK_NODES * grid.class.width() * params.precision.width());
    for at in (0..BRICK_NODES).map(place).filter(|&at| is_set(active, at)) {
        for number in grid.class.components(first + at).into_iter().flatten() {
            push(number, params.precision, &mut values);
        }
    }
    write_values(&values, params, out);
}

/// Appends packed values; half floats without any leave no trace at all, floats a length of zero.
pub(super) fn write_values(values: &[u8], params: &VolumeParams, out: &mut Vec<u8>) {
    if !(values.is_empty() && params.precision == Precision::Half) {
        blosc::pack(values, params.precision.width(), params.compression, out);
    }
}

/// Appends a number as it is stored.
fn push(number: f32, precision: Precision, out: &mut Vec<u8>) {
    match precision {
        Precision::Half => out.extend(half::f16::from_f32(number).to_le_bytes()),
        Precision::Float => out.extend(number.to_le_bytes()),
    }
}
