//! Sparse grids: cubes of 8³ nodes, stored only where something is.
//!
//! Node (i, j, k) is at (i, j, k) · voxel in world space, in every frame, so that surfaces do not crawl.
//! Brick (a, b, c) holds the nodes 8a..8a+8, 8b..8b+8, 8c..8c+8; inside a brick x runs fastest, then y, then z.

use crate::{math::Vec3, par};
use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

/// Nodes along a brick's edge.
pub const BRICK: usize = 8;

/// Nodes in a brick.
pub const BRICK_NODES: usize = BRICK * BRICK * BRICK;

/// The largest brick coordinate in use, either sign: sums of node coordinates stay far from overflow.
pub(crate) const MAX_BRICK: i32 = 1 << 27;

/// The offsets to a brick's six face neighbours: −x, +x, −y, +y, −z, +z.
pub const FACES: [[i32; 3]; 6] = [[-1, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, -1], [0, 0, 1]];

/// One bit a node of a brick: the node at `place` has bit `place` % 64 of word `place` / 64.
pub type NodeMask = [u64; BRICK_NODES / 64];

/// Which bricks exist, in ascending (z, y, x) order: the layout does not depend on how it was built.
#[derive(Clone, Debug, Default)]
pub struct Bricks {
    coords: Vec<[i32; 3]>,
    index: HashMap<[i32; 3], u32, BuildHasherDefault<CoordHasher>>,
}

impl Bricks {
    /// A set of bricks from their coordinates (x, y, z), in any order, repeats allowed.
    pub fn new(mut coords: Vec<[i32; 3]>) -> Self {
        par::sort_by_key(&mut coords, |c| [c[2], c[1], c[0]]);
        coords.dedup();
        let index = coords.iter().enumerate().map(|(i, &c)| (c, i as u32)).collect();
        Self { coords, index }
    }

    /// How many bricks there are.
    pub fn len(&self) -> usize {
        self.coords.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.coords.is_empty()
    }

    /// The coordinates of every brick.
    pub fn coords(&self) -> &[[i32; 3]] {
        &self.coords
    }

    /// The place of the brick at `coord`, if it exists.
    pub fn find(&self, coord: [i32; 3]) -> Option<usize> {
        self.index.get(&coord).map(|&i| i as usize)
    }

    /// The places of the six face neighbours of the brick at `coord`, which need not exist itself, in the order
    /// of [`FACES`].
    pub fn around(&self, coord: [i32; 3]) -> [Option<usize>; 6] {
        FACES.map(|d| self.find(std::array::from_fn(|axis| coord[axis] + d[axis])))
    }

    /// [`Bricks::around`] for every brick.
    pub fn neighbours(&self) -> Vec<[Option<u32>; 6]> {
        let mut table = vec![[None; 6]; self.len()];
        par::fill(&mut table, |brick| self.around(self.coords[brick]).map(|face| face.map(|i| i as u32)));
        table
    }
}

/// A hash for brick coordinates: a multiplication and a rotation a word.
///
/// The standard library's hash guards against chosen keys, which brick coordinates are not, and costs more.
#[derive(Clone, Debug, Default)]
struct CoordHasher(u64);

impl Hasher for CoordHasher {
    fn finish(&self) -> u64 {
        // The table takes its place from the low bits and its tag from the high ones: both must be mixed.
        self.0 ^ (self.0 >> 32)
    }

    fn write(&mut self, bytes: &[u8]) {
        for part in bytes.chunks(4) {
            let mut word = [0; 4];
            word[..part.len()].copy_from_slice(part);
            self.add(u64::from(u32::from_le_bytes(word)));
        }
    }

    fn write_usize(&mut self, word: usize) {
        self.add(word as u64);
    }
}

impl CoordHasher {
    fn add(&mut self, word: u64) {
        self.0 = (self.0.rotate_left(26) ^ word).wrapping_mul(0x9e37_79b9_7f4a_7c15); // 2⁶⁴ / golden ratio
    }
}

/// Bricks that are listed before duplicates are removed. Larger, and the list takes more memory than it estimates;
/// smaller, and it is sorted more often.
const LIST_CAPACITY: usize = 1 << 20;

/// The coordinates of the bricks in some boxes, each from its first to its last brick: ascending, each once.
pub(crate) fn bricks_in_boxes(mut boxes: Vec<[[i32; 3]; 2]>) -> Vec<[i32; 3]> {
    boxes.sort_unstable();
    boxes.dedup();
    let (mut bricks, mut full) = (Vec::new(), LIST_CAPACITY);
    for [low, high] in boxes {
        for z in low[2]..=high[2] {
            for y in low[1]..=high[1] {
                bricks.extend((low[0]..=high[0]).map(|x| [x, y, z]));
            }
        }
        // Large boxes next to each other have the same bricks.
        if bricks.len() > full {
            bricks.sort_unstable();
            bricks.dedup();
            full = bricks.len().max(LIST_CAPACITY) + LIST_CAPACITY;
        }
    }
    bricks.sort_unstable();
    bricks.dedup();
    bricks
}

/// One number a node, on bricks.
#[derive(Clone, Debug)]
pub struct SparseGrid {
    /// Distance between nodes [m].
    pub voxel: f32,
    /// The bricks that exist.
    pub bricks: Bricks,
    /// 512 numbers a brick, in the bricks' order.
    pub values: Vec<f32>,
    /// Other bricks, where every node stands for the number 1. Nodes of bricks that are in neither stand for zero.
    pub filled: Bricks,
}

impl SparseGrid {
    /// A grid with `value` at every node of `bricks`.
    pub fn new(voxel: f32, bricks: Bricks, value: f32) -> Self {
        let values = vec![value; bricks.len() * BRICK_NODES];
        Self::of(voxel, bricks, values)
    }

    /// A grid with these numbers, 512 a brick.
    ///
    /// # Panics
    /// If there are more or fewer numbers.
    pub fn of(voxel: f32, bricks: Bricks, values: Vec<f32>) -> Self {
        assert_eq!(values.len(), bricks.len() * BRICK_NODES, "512 numbers a brick");
        Self { voxel, bricks, values, filled: Bricks::default() }
    }

    /// A grid with `f(position)` at every node of the bricks that cover the box from `min` to `max` [m].
    pub fn sample(voxel: f32, min: Vec3, max: Vec3, f: impl Fn(Vec3) -> f32 + Sync) -> Self {
        let brick = |v: f32| (f64::from(v) / f64::from(voxel)).floor().div_euclid(BRICK as f64) as i32;
        let mut coords = Vec::new();
        for z in brick(min.z)..=brick(max.z) {
            for y in brick(min.y)..=brick(max.y) {
                coords.extend((brick(min.x)..=brick(max.x)).map(|x| [x, y, z]));
            }
        }
        let mut grid = Self::new(voxel, Bricks::new(coords), 0.0);
        let mut values = std::mem::take(&mut grid.values);
        par::for_chunks(&mut values, BRICK_NODES, |start, chunk| {
            let coord = grid.bricks.coords[start / BRICK_NODES];
            for (place, value) in chunk.iter_mut().enumerate() {
                *value = f(grid.position(node_of(coord, place)));
            }
        });
        grid.values = values;
        grid
    }

    /// The number at node (i, j, k), if its brick exists.
    pub fn get(&self, node: [i32; 3]) -> Option<f32> {
        let coord = node.map(|v| v.div_euclid(BRICK as i32));
        let brick = self.bricks.find(coord)?;
        Some(self.values[brick * BRICK_NODES + offset(node.map(|v| v.rem_euclid(BRICK as i32) as usize))])
    }

    /// Adds bricks at `coords`, none of them there yet and none twice, with `value` at every node.
    pub fn insert(&mut self, coords: &[[i32; 3]], value: f32) {
        let old = std::mem::take(&mut self.bricks);
        self.bricks = Bricks::new(old.coords.iter().chain(coords).copied().collect());
        let mut left = old.len();
        assert_eq!(self.bricks.len(), left + coords.len(), "new bricks");
        self.values.reserve_exact(coords.len() * BRICK_NODES);
        self.values.resize(self.bricks.len() * BRICK_NODES, value);
        // From the last brick on, so that none is overwritten before it has moved.
        for (to, coord) in self.bricks.coords.iter().enumerate().rev() {
            let target = to * BRICK_NODES..(to + 1) * BRICK_NODES;
            if left > 0 && old.coords[left - 1] == *coord {
                left -= 1;
                self.values.copy_within(left * BRICK_NODES..(left + 1) * BRICK_NODES, target.start);
            } else {
                self.values[target].fill(value);
            }
        }
    }

    /// The number that node (i, j, k) has or stands for.
    pub fn value(&self, node: [i32; 3]) -> f32 {
        let is_filled = || self.filled.find(node.map(|v| v.div_euclid(BRICK as i32))).is_some();
        self.get(node).unwrap_or_else(|| f32::from(u8::from(is_filled())))
    }

    /// The number at `x` [m], linear between the eight nodes around it.
    pub fn trilinear(&self, x: Vec3) -> f32 {
        let at = [0, 1, 2].map(|axis| f64::from(x[axis]) / f64::from(self.voxel));
        let node = at.map(|v| v.floor() as i32);
        let t = [0, 1, 2].map(|axis| (at[axis] - at[axis].floor()) as f32);
        let coord = node.map(|i| i.div_euclid(BRICK as i32));
        let local = node.map(|i| i.rem_euclid(BRICK as i32) as usize);
        let inner = local.iter().all(|&i| i + 1 < BRICK);
        let brick = self.bricks.find(coord).filter(|_| inner);
        (0..8).fold(0.0, |sum, corner| {
            let offset_of = |axis: usize| corner >> axis & 1;
            let weight: f32 =
                [0, 1, 2].map(|d| if offset_of(d) == 1 { t[d] } else { 1.0 - t[d] }).iter().product();
            let value = match brick {
                Some(brick) => {
                    self.values[brick * BRICK_NODES + offset([0, 1, 2].map(|d| local[d] + offset_of(d)))]
                }
                None => self.value([0, 1, 2].map(|d| node[d].saturating_add(offset_of(d) as i32))),
            };
            sum + weight * value
        })
    }

    /// The 512 numbers of a brick.
    pub fn brick(&self, brick: usize) -> &[f32] {
        &self.values[brick * BRICK_NODES..(brick + 1) * BRICK_NODES]
    }

    /// Where the node of a number, by its place in `values`, stands [m].
    pub fn position_of(&self, slot: usize) -> Vec3 {
        self.position(node_of(self.bricks.coords[slot / BRICK_NODES], slot % BRICK_NODES))
    }

    /// Where node (i, j, k) stands [m].
    pub fn position(&self, node: [i32; 3]) -> Vec3 {
        let at = |i: i32| (f64::from(i) * f64::from(self.voxel)) as f32;
        Vec3::new(at(node[0]), at(node[1]), at(node[2]))
    }
}

/// The place of a node inside its brick; every coordinate is in 0..8.
pub fn offset(local: [usize; 3]) -> usize {
    local[0] + BRICK * (local[1] + BRICK * local[2])
}

/// The node at `place` (0..512) of the brick at `coord`.
pub fn node_of(coord: [i32; 3], place: usize) -> [i32; 3] {
    let local = [place % BRICK, place / BRICK % BRICK, place / (BRICK * BRICK)];
    std::array::from_fn(|axis| coord[axis] * BRICK as i32 + local[axis] as i32)
}

/// The neighbour of the node at `place` (0..512) across `face`, as numbered in [`FACES`]: its own place, and whether that
/// is in the neighbouring brick.
#[inline]
pub fn neighbour(place: usize, face: usize) -> (usize, bool) {
    let stride = [1, BRICK, BRICK * BRICK][face / 2];
    match (face % 2, place / stride % BRICK) {
        (0, 0) => (place + (BRICK - 1) * stride, true),
        (0, _) => (place - stride, false),
        (_, at) if at + 1 == BRICK => (place - (BRICK - 1) * stride, true),
        _ => (place + stride, false),
    }
}

/// Whether the node at `place` (0..512) is in a mask.
pub fn is_set(mask: &NodeMask, place: usize) -> bool {
    mask[place / 64] >> (place % 64) & 1 == 1
}

/// The mask of the nodes whose value, of 512, `belongs`.
pub fn mask_of<T>(values: &[T], belongs: impl Fn(&T) -> bool) -> NodeMask {
    let mut mask = [0; BRICK_NODES / 64];
    for (word, values) in mask.iter_mut().zip(values.chunks(64)) {
        let rows = values.as_chunks::<BRICK>().0.iter().map(|row| {
            let bit = |(x, value): (usize, &T)| u64::from(belongs(value)) << x;
            row.iter().enumerate().map(bit).fold(0, |bits, bit| bits | bit)
        });
        *word = rows.rev().fold(0, |word, row| word << BRICK | row);
    }
    mask
}

/// The nodes whose value `belongs`, a mask a brick.
pub(crate) fn masks_of(values: &[f32], belongs: impl Fn(&f32) -> bool + Sync) -> Vec<NodeMask> {
    let mut masks = vec![NodeMask::default(); values.len() / BRICK_NODES];
    par::fill(&mut masks, |brick| mask_of(&values[brick * BRICK_NODES..][..BRICK_NODES], &belongs));
    masks
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_layout_does_not_depend_on_the_order_given() {
        let coords = vec![[5, -3, 2], [0, 0, 0], [-7, 9, 2], [0, 0, 0], [5, -3, -2]];
        let mut turned = coords.clone();
        turned.reverse();
        let bricks = Bricks::new(coords);
        assert_eq!(bricks.coords(), [[5, -3, -2], [0, 0, 0], [5, -3, 2], [-7, 9, 2]]);
        assert_eq!(bricks.coords(), Bricks::new(turned).coords());
        for (place, &coord) in bricks.coords().iter().enumerate() {
            assert_eq!(bricks.find(coord), Some(place));
        }
        assert_eq!(bricks.find([1, 1, 1]), None);
    }

    #[test]
    fn neighbours_are_mutual_and_right() {
        let mut coords = Vec::new();
        for i in 0..400_i32 {
            coords.push([i * 7 % 11 - 5, i * 5 % 13 - 6, i % 7 - 3]);
        }
        let bricks = Bricks::new(coords);
        let table = bricks.neighbours();
        for (brick, faces) in table.iter().enumerate() {
            for (face, neighbour) in faces.iter().enumerate() {
                let there: [i32; 3] =
                    std::array::from_fn(|axis| bricks.coords()[brick][axis] + FACES[face][axis]);
                assert_eq!(neighbour.is_some(), bricks.coords().contains(&there));
                if let Some(neighbour) = neighbour {
                    assert_eq!(bricks.coords()[*neighbour as usize], there);
                    assert_eq!(table[*neighbour as usize][face ^ 1], Some(brick as u32));
                }
            }
        }
    }

    #[test]
    fn between_nodes_values_are_linear() {
        let (low, high) = (Vec3::new(-3.0, -1.0, 0.0), Vec3::new(1.0, 1.0, 1.0));
        let grid = SparseGrid::sample(0.25, low, high, |x| x.x + 10.0 * x.y - 3.0 * x.z);
        for x in [Vec3::new(-2.9, -0.03, 0.4), Vec3::new(0.61, 0.99, 0.02), Vec3::new(-2.01, 0.0, 0.25)] {
            assert!((grid.trilinear(x) - (x.x + 10.0 * x.y - 3.0 * x.z)).abs() < 1e-4, "{x}");
        }
        assert_eq!(grid.trilinear(Vec3::new(1e9, 0.0, f32::MAX)), 0.0);
    }

    #[test]
    fn bricks_added_stand_between_those_that_were_there() {
        let all: Vec<[i32; 3]> = (0..27).map(|i| [i % 3 - 1, i / 3 % 3, i / 9]).collect();
        let (old, new): (Vec<_>, Vec<_>) = all.iter().partition(|c| (c[0] * 7 + c[1] * 5 + c[2]) % 3 != 0);
        let mut grid = SparseGrid::new(1.0, Bricks::new(old), 0.0);
        let number = |coord: [i32; 3], place: usize| {
            (place as i32 + 1000 * (coord[0] + 3 * (coord[1] + 3 * coord[2]))) as f32
        };
        let fresh = grid.bricks.clone();
        for (brick, coord) in fresh.coords().iter().enumerate() {
            for place in 0..BRICK_NODES {
                grid.values[brick * BRICK_NODES + place] = number(*coord, place);
            }
        }
        grid.insert(&new, -0.5);
        assert_eq!(grid.bricks.coords(), Bricks::new(all).coords());
        for (brick, coord) in grid.bricks.coords().iter().enumerate() {
            for (place, value) in grid.brick(brick).iter().enumerate() {
                let expected = if new.contains(coord) { -0.5 } else { number(*coord, place) };
                assert_eq!(*value, expected, "{coord:?}");
            }
        }
    }

    #[test]
    fn neighbouring_nodes_are_one_step_away() {
        for place in 0..BRICK_NODES {
            for (face, step) in FACES.into_iter().enumerate() {
                let (other, is_beyond) = neighbour(place, face);
                let coord = if is_beyond { step } else { [0; 3] };
                let expected: [i32; 3] = std::array::from_fn(|d| node_of([0; 3], place)[d] + step[d]);
                assert_eq!(node_of(coord, other), expected);
            }
        }
    }

    #[test]
    fn masks_hold_the_nodes_that_belong() {
        let values: Vec<usize> = (0..BRICK_NODES).collect();
        let mask = mask_of(&values, |v| v % 7 == 3);
        assert!(values.iter().all(|&place| is_set(&mask, place) == (place % 7 == 3)));
    }

    #[test]
    fn nodes_are_found_where_they_were_written() {
        let grid = SparseGrid::sample(0.25, Vec3::new(-3.0, -1.0, 0.0), Vec3::new(1.0, 1.0, 1.0), |x| {
            x.x + 100.0 * x.y + 10_000.0 * x.z
        });
        for node in [[-12, -4, 0], [4, 4, 4], [-1, 3, 2], [0, 0, 0]] {
            let x = grid.position(node);
            assert_eq!(grid.get(node), Some(x.x + 100.0 * x.y + 10_000.0 * x.z));
        }
        assert_eq!(grid.get([100, 0, 0]), None);
    }
}
