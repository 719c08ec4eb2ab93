//! The tree above the bricks: a root, nodes of 32³ places of 128³ voxels, nodes of 16³ places of 8³ voxels.

use super::{
    Class, Grid, VolumeParams,
    leaf::{self, Inactive, mask_bytes, write_values},
    params::Precision,
};
use crate::{
    grid::{BRICK, BRICK_NODES, Bricks, is_set, node_of},
    par,
};

/// Powers of two: places along an edge of a lower and of an upper inner node.
const LOWER: u32 = 4;
const UPPER: u32 = 5;

/// A grid's bricks in the order of a file.
pub(super) struct Tree {
    places: Vec<Place>,
    /// The lowest and highest active node; the other way round if there are none.
    pub(super) bounds: [[i32; 3]; 2],
    /// How many nodes are active.
    pub(super) active: u64,
}

/// Path of a brick in the tree. The order is that of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Place {
    /// The upper node's coordinate, in upper nodes.
    upper: [i32; 3],
    /// Index of the lower node in the upper node.
    lower: usize,
    /// Index of the brick in the lower node.
    slot: usize,
    /// The brick, or `None` for one that is inside as a whole.
    brick: Option<usize>,
}

impl Place {
    fn new(coord: [i32; 3], brick: Option<usize>) -> Self {
        let lower = coord.map(|v| v >> LOWER);
        Self {
            upper: lower.map(|v| v >> UPPER),
            lower: index_in(lower, UPPER),
            slot: index_in(coord, LOWER),
            brick,
        }
    }
}

/// The place of child `coord` in its parent of `2^log2` places along an edge: z runs fastest, then y, then x.
fn index_in(coord: [i32; 3], log2: u32) -> usize {
    coord.iter().fold(0, |index, v| index << log2 | (v & ((1 << log2) - 1)) as usize)
}

impl Tree {
    /// Sorts a grid's bricks into a tree. Bricks without an active node are left out, if outside, or become a tile.
    pub(super) fn new(grid: &Grid) -> Self {
        let coords = grid.bricks.coords();
        let mut places = par::map_chunks(coords.len(), 256, |range| {
            range
                .filter_map(|brick| match Kind::of(grid, brick) {
                    Kind::Leaf => Some(Place::new(coords[brick], Some(brick))),
                    Kind::Inside => Some(Place::new(coords[brick], None)),
                    Kind::Outside => None,
                })
                .collect::<Vec<_>>()
        })
        .concat();
        if let Class::LevelSet { inside, .. } = grid.class {
            assert!(disjoint(inside, grid.bricks), "bricks with values are not listed as inside");
            places.extend(inside.iter().map(|&coord| Place::new(coord, None)));
        }
        par::sort_by_key(&mut places, |place| *place);
        places.dedup();
        let (bounds, active) = extent(grid);
        Self { places, bounds, active }
    }

    /// Appends everything about a tree but its values: the background, every inner node, every leaf's mask.
    pub(super) fn write_topology(&self, grid: &Grid, params: &VolumeParams, out: &mut Vec<u8>) {
        out.extend(1_i32.to_le_bytes()); // buffers a leaf
        for _ in 0..grid.class.width() {
            out.extend(stored_background(grid, params.precision).to_le_bytes());
        }
        let uppers: Vec<&[Place]> = self.places.chunk_by(|a, b| a.upper == b.upper).collect();
        out.extend(0_u32.to_le_bytes()); // tiles of the root
        out.extend((uppers.len() as u32).to_le_bytes());
        for upper in uppers {
            let voxels = BRICK as i32 * (1 << (LOWER + UPPER));
            out.extend(upper[0].upper.iter().flat_map(|v| (v * voxels).to_le_bytes()));
            let lowers: Vec<&[Place]> = upper.chunk_by(|a, b| a.lower == b.lower).collect();
            let children = lowers.iter().map(|lower| lower[0].lower);
            write_inner(UPPER, children, std::iter::empty(), params, out);
            for lower in lowers {
                let of = |leaf: bool| {
                    lower.iter().filter(move |place| place.brick.is_some() == leaf).map(|place| place.slot)
                };
                write_inner(LOWER, of(true), of(false), params, out);
                for brick in lower.iter().filter_map(|place| place.brick) {
                    out.extend(mask_bytes(&grid.active[brick]));
                }
            }
        }
    }

    /// The buffers of all leaves, in the order of a file.
    pub(super) fn encode_leaves(&self, grid: &Grid, params: &VolumeParams) -> Vec<Vec<u8>> {
        let leaves: Vec<usize> = self.places.iter().filter_map(|place| place.brick).collect();
        par::map_chunks(leaves.len(), 64, |range| {
            let mut out = Vec::new();
            for &brick in &leaves[range] {
                leaf::write(grid, brick, params, &mut out);
            }
            out
        })
    }
}

/// What a brick is in a tree.
enum Kind {
    Leaf,
    /// No node is active, all are minus the background.
    Inside,
    /// No node is active, all are the background.
    Outside,
}

impl Kind {
    fn of(grid: &Grid, brick: usize) -> Self {
        let first = brick * BRICK_NODES;
        if grid.active[brick].iter().any(|&word| word != 0) {
            return Self::Leaf;
        }
        match (0..BRICK_NODES).filter(|place| grid.class.is_inside(first + place)).count() {
            0 => Self::Outside,
            BRICK_NODES => Self::Inside,
            _ => Self::Leaf,
        }
    }
}

/// Appends an inner node: the children it has, the tiles that are minus the background; other places are background.
fn write_inner(
    log2: u32,
    children: impl Iterator<Item = usize>,
    minus: impl Iterator<Item = usize>,
    params: &VolumeParams,
    out: &mut Vec<u8>,
) {
    let places = 1_usize << (3 * log2);
    let mut child_mask = vec![0_u8; places / 8];
    let mut plus = vec![0xff_u8; places / 8];
    let (mut with_child, mut with_minus) = (0, 0);
    for place in children {
        child_mask[place / 8] |= 1 << (place % 8);
        plus[place / 8] &= !(1 << (place % 8));
        with_child += 1;
    }
    for place in minus {
        plus[place / 8] &= !(1 << (place % 8));
        with_minus += 1;
    }
    out.extend(&child_mask);
    out.extend(std::iter::repeat_n(0, places / 8)); // no tile is active
    let code = Inactive::of(with_child + with_minus < places, with_minus > 0);
    out.push(code as u8);
    if code == Inactive::Mask {
        out.extend(&plus);
    }
    write_values(&[], params, out);
}

/// The background as a file has it: in full size, with the digits that values have.
fn stored_background(grid: &Grid, precision: Precision) -> f32 {
    let background = grid.class.background();
    match precision {
        Precision::Half => half::f16::from_f32(background).to_f32(),
        Precision::Float => background,
    }
}

/// The box around the active nodes, and their number.
fn extent(grid: &Grid) -> ([[i32; 3]; 2], u64) {
    let nothing = ([[i32::MAX; 3], [i32::MIN; 3]], 0);
    let parts = par::map_chunks(grid.bricks.len(), 256, |range| {
        let (mut bounds, mut count) = nothing;
        for brick in range {
            let mask = &grid.active[brick];
            count += mask.iter().map(|word| u64::from(word.count_ones())).sum::<u64>();
            for place in (0..BRICK_NODES).filter(|&place| is_set(mask, place)) {
                let node = node_of(grid.bricks.coords()[brick], place);
                bounds = merge(bounds, [node, node]);
            }
        }
        (bounds, count)
    });
    parts.into_iter().fold(nothing, |(bounds, count), part| (merge(bounds, part.0), count + part.1))
}

/// The box around two boxes.
fn merge(a: [[i32; 3]; 2], b: [[i32; 3]; 2]) -> [[i32; 3]; 2] {
    let both = |f: fn(i32, i32) -> i32, side: usize| [0, 1, 2].map(|axis| f(a[side][axis], b[side][axis]));
    [both(i32::min, 0), both(i32::max, 1)]
}

/// Whether no coordinate is a brick.
fn disjoint(coords: &[[i32; 3]], bricks: &Bricks) -> bool {
    coords.iter().all(|&coord| bricks.find(coord).is_none())
}
