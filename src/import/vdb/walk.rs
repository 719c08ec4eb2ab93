//! The tree of a grid of floats, walked once before any other code reads it: every count, length and code is compared with the
//! bytes of the file. It also notes what the reader of values does not report: on which side inactive nodes are.

use super::super::ImportError;
use super::bytes::Bytes;
use super::header::{ACTIVE_MASK, BLOSC, Entry, ZIP};

/// Places of a leaf, and words of its masks.
const LEAF: usize = 512;

/// Nodes along an edge of a child of the root.
const ROOT: i32 = 4096;

/// A leaf of 8³ nodes. The order of its nodes is that of the file: z runs fastest, then y, then x.
#[derive(Clone, Debug)]
pub(super) struct Leaf {
    /// First node of the brick.
    pub(super) origin: [i32; 3],
    /// The nodes whose values count.
    pub(super) active: Vec<u8>,
    /// The inactive nodes that are inside; `None` if the values of inactive nodes are stored as well.
    pub(super) inside: Option<Vec<u8>>,
}

/// Whether bit `index` of a mask is set.
pub(super) fn is_set(mask: &[u8], index: usize) -> bool {
    mask[index / 8] >> (index % 8) & 1 == 1
}

/// The background and the leaves of a grid; `bytes` are at its tree.
pub(super) fn walk(bytes: &mut Bytes, entry: &Entry) -> Result<(f32, Vec<Leaf>), ImportError> {
    let buffers = bytes.u32("the number of buffers")?;
    if buffers != 1 {
        return Err(bytes.malformed(format!("{buffers} buffers a leaf"), "1"));
    }
    let background = bytes.f32("the background")?;
    if !(background.is_finite() && background > 0.0) {
        return Err(bytes.malformed(format!("the background {background}"), "a length above 0"));
    }
    let tiles = bytes.u32("the number of tiles")?;
    let roots = bytes.u32("the number of nodes")?;
    for _ in 0..tiles {
        bytes.take(12 + 4 + 1, "a tile")?;
    }
    let nodes = Nodes { compression: entry.compression, background };
    let mut leaves = Vec::new();
    for _ in 0..roots {
        let origin = bytes.node("a node's origin")?;
        if origin.iter().any(|v| v.unsigned_abs() > 1 << 30) {
            return Err(bytes.malformed(format!("a node at {origin:?}"), "nodes below 2³⁰ along each axis"));
        }
        if origin.iter().any(|v| v.rem_euclid(ROOT) != 0) {
            return Err(bytes.malformed(format!("a node at {origin:?}"), format!("multiples of {ROOT}")));
        }
        for (_, upper) in nodes.children(bytes, 5, 7, origin)? {
            for (_, origin) in nodes.children(bytes, 4, 3, upper)? {
                let active = bytes.take(LEAF / 8, "a leaf's mask")?.to_vec();
                leaves.push(Leaf { origin, active, inside: None });
            }
        }
    }
    bytes.seek(entry.blocks, "the values of a grid")?;
    for leaf in &mut leaves {
        if bytes.take(LEAF / 8, "a leaf's mask")? != leaf.active {
            return Err(
                bytes.malformed(format!("another mask of the leaf at {:?}", leaf.origin), "the same twice")
            );
        }
        leaf.inside = nodes.values(bytes, LEAF, &leaf.active)?;
    }
    Ok((background, leaves))
}

/// What all nodes of a grid share.
struct Nodes {
    compression: u32,
    background: f32,
}

impl Nodes {
    /// Passes over an inner node of 2^log2 places along an edge, each 2^size voxels wide; returns its children's
    /// places and origins.
    fn children(
        &self,
        bytes: &mut Bytes,
        log2: u32,
        size: u32,
        origin: [i32; 3],
    ) -> Result<Vec<(usize, [i32; 3])>, ImportError> {
        let places = 1_usize << (3 * log2);
        let children = bytes.take(places / 8, "a mask of children")?;
        let active = bytes.take(places / 8, "a mask of tiles")?;
        self.values(bytes, places, active)?;
        let local = |place: usize, axis: u32| (place >> (log2 * (2 - axis)) & ((1 << log2) - 1)) as i32;
        Ok((0..places)
            .filter(|&place| is_set(children, place))
            .map(|place| {
                (place, [0, 1, 2].map(|axis| origin[axis].wrapping_add(local(place, axis as u32) << size)))
            })
            .collect())
    }

    /// Passes over the values of a node with `count` places; returns which inactive ones are below zero, unless they
    /// are stored like the active ones.
    fn values(&self, bytes: &mut Bytes, count: usize, active: &[u8]) -> Result<Option<Vec<u8>>, ImportError> {
        let code = bytes.take(1, "a code for inactive values")?[0];
        let minus = -self.background;
        let (first, second) = match code {
            0 => (self.background, self.background),
            1 | 3 | 6 => (minus, self.background),
            2 | 4 => (bytes.f32("an inactive value")?, self.background),
            5 => (bytes.f32("an inactive value")?, bytes.f32("an inactive value")?),
            _ => return Err(bytes.malformed(format!("code {code} for inactive values"), "0 to 6")),
        };
        let select = match code {
            3..=5 => bytes.take(count / 8, "a mask of inactive values")?.to_vec(),
            _ => vec![0; count / 8],
        };
        let masked = self.compression & ACTIVE_MASK != 0 && code != 6;
        let on = active.iter().map(|byte| byte.count_ones() as usize).sum();
        self.data(bytes, 4 * if masked { on } else { count })?;
        let side = |place: usize| if is_set(&select, place) { second < 0.0 } else { first < 0.0 };
        let byte = |byte: usize| (0..8).fold(0, |bits, bit| bits | u8::from(side(8 * byte + bit)) << bit);
        Ok((masked && on < count).then(|| (0..count / 8).map(byte).collect()))
    }

    /// Passes over packed values that unpack to `size` bytes.
    fn data(&self, bytes: &mut Bytes, size: usize) -> Result<(), ImportError> {
        if self.compression & (BLOSC | ZIP) == 0 {
            return bytes.take(size, "values").map(|_| ());
        }
        let packed = bytes.i64("the length of packed values")?;
        if packed <= 0 {
            if packed.unsigned_abs() != size as u64 {
                return Err(
                    bytes.malformed(format!("{} bytes of values", packed.unsigned_abs()), size.to_string())
                );
            }
            return bytes.take(size, "values").map(|_| ());
        }
        let packed = bytes.take(usize::try_from(packed).unwrap_or(usize::MAX), "packed values")?;
        if self.compression & BLOSC != 0 && size > 0 {
            let word = |at: usize| {
                packed.get(at..at + 4).map(|word| u32::from_le_bytes(word.try_into().expect("four bytes")))
            };
            let lengths = (word(4), word(12));
            if lengths != (Some(size as u32), Some(packed.len() as u32)) {
                let found = format!("a Blosc frame of lengths {lengths:?}");
                return Err(bytes.malformed(found, format!("{size} bytes in {}", packed.len())));
            }
        }
        Ok(())
    }
}
