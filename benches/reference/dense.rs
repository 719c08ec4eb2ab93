//! Signed distance from a field on a dense grid, for comparison with the bricks of `meniscus::sdf`.
//!
//! *Method* [gourlay17], [zhao05]: the indicator ([`indicator`]) marks where the surface crosses. Nodes next
//! to it get immediate distances and are pinned ([`pin_surface`]; [`pin_band`] takes a known band). Fast
//! sweeping in eight orders propagates them, as a wavefront over blocks of any size; [`Order::Second`] then
//! gives every node a distance of second order. The sweeps and the second order are those of the library.
//!
//! Limits: memory follows the box, not the surface: 8 bytes per node at first order and 10 at second, besides
//! the field and the pins (9 bytes per node). Where the surface fills a small part of a box, bricks are the
//! better grid.

use meniscus::{
    math::Vec3,
    par,
    sdf::{
        Nodes, Order, SeedRule, Swept,
        dense::{BLOCK, Layout, sweep},
        refine,
    },
};

/// One number a node, in a box of nodes; x runs fastest, then y, then z.
///
/// Node (i, j, k) of the box is at (`first` + (i, j, k)) · voxel in world space, so a dense grid and bricks of the
/// same voxel share their nodes.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct DenseGrid {
    /// Distance between nodes [m].
    pub(crate) voxel: f32,
    /// The world's node that the box begins with.
    pub(crate) first: [i32; 3],
    /// Nodes along each axis.
    pub(crate) nodes: [usize; 3],
    /// One number a node.
    pub(crate) values: Vec<f32>,
}

impl DenseGrid {
    /// A grid with `value` at every node.
    pub(crate) fn new(voxel: f32, first: [i32; 3], nodes: [usize; 3], value: f32) -> Self {
        Self { voxel, first, nodes, values: vec![value; nodes.iter().product()] }
    }

    /// A grid with `f(position [m])` at every node.
    pub(crate) fn sample(
        voxel: f32,
        first: [i32; 3],
        nodes: [usize; 3],
        f: impl Fn(Vec3) -> f32 + Sync,
    ) -> Self {
        let mut grid = Self::new(voxel, first, nodes, 0.0);
        let mut values = std::mem::take(&mut grid.values);
        par::fill(&mut values, |i| f(grid.position(grid.node(i))));
        grid.values = values;
        grid
    }

    /// The place of a node of the box in `values`.
    #[allow(dead_code, reason = "tests use it, benches do not")]
    #[inline]
    pub(crate) fn index(&self, node: [usize; 3]) -> usize {
        node[0] + self.nodes[0] * (node[1] + self.nodes[1] * node[2])
    }

    /// The node of the box at a place in `values`.
    #[inline]
    pub(crate) fn node(&self, index: usize) -> [usize; 3] {
        let [nx, ny, _] = self.nodes;
        [index % nx, index / nx % ny, index / (nx * ny)]
    }

    /// Where a node of the box stands [m].
    pub(crate) fn position(&self, node: [usize; 3]) -> Vec3 {
        let at =
            |axis: usize| ((f64::from(self.first[axis]) + node[axis] as f64) * f64::from(self.voxel)) as f32;
        Vec3::new(at(0), at(1), at(2))
    }
}

/// How distance is found on a dense grid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct DenseParams {
    /// The order of the differences.
    pub(crate) order: Order,
    /// How far from the surface distances are found [voxels], above 0. Infinite: at every node.
    pub(crate) band: f32,
    /// Nodes of a block along each axis, at least 1. Changes the time, never the result.
    pub(crate) block: [usize; 3],
}

impl Default for DenseParams {
    fn default() -> Self {
        Self { order: Order::First, band: f32::INFINITY, block: BLOCK }
    }
}

/// Unsigned distances at all nodes from the pinned ones [voxels].
///
/// # Panics
/// If `pins` has another number of nodes, the band is not above zero or a block has no node.
pub(crate) fn solve(nodes: [usize; 3], pins: &Pins, params: &DenseParams) -> Swept {
    let DenseParams { order, band, block, .. } = *params;
    assert!(band > 0.0, "the band holds nodes");
    let swept = sweep(nodes, &pins.distance, order.reach(band), block);
    match order {
        Order::First => swept,
        Order::Second => refine(&Blocks(Layout::new(nodes, block)), swept, band, |i| pins.inside[i]),
    }
}

/// The smallest distance of a pinned node [voxels], as on bricks.
pub(crate) const MIN_PINNED_DISTANCE: f32 = 1e-6;

/// The nodes whose distance is known, and on which side every node lies.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Pins {
    /// One number per node [voxels]: pinned distances as negative numbers, ∞ at all other nodes.
    pub(crate) distance: Vec<f32>,
    /// The indicator.
    pub(crate) inside: Vec<bool>,
}

/// The indicator: whether the field is at or above the threshold. A NaN is outside.
pub(crate) fn indicator(field: &DenseGrid, threshold: f32) -> Vec<bool> {
    let mut inside = vec![false; field.values.len()];
    par::fill(&mut inside, |i| field.values[i] >= threshold);
    inside
}

/// Pins the nodes next to the surface where `field` crosses `threshold`, at their immediate distances by
/// `rule`. Outside the grid lies the side of its last nodes: no surface is found there.
pub(crate) fn pin_surface(field: &DenseGrid, threshold: f32, rule: SeedRule) -> Pins {
    let inside = indicator(field, threshold);
    let strides = [1, field.nodes[0], field.nodes[0] * field.nodes[1]];
    let mut distance = vec![f32::INFINITY; field.values.len()];
    par::for_chunks(&mut distance, field.nodes[0].max(1), |start, row| {
        let [_, y, z] = field.node(start);
        for (x, distance) in row.iter_mut().enumerate() {
            let (node, at) = ([x, y, z], start + x);
            // The neighbour beyond each face; outside the grid, the node itself.
            let neighbours: [usize; 6] = std::array::from_fn(|face| {
                let (axis, stride) = (face / 2, strides[face / 2]);
                match face % 2 {
                    0 if node[axis] > 0 => at - stride,
                    1 if node[axis] + 1 < field.nodes[axis] => at + stride,
                    _ => at,
                }
            });
            if neighbours.iter().any(|&other| inside[other] != inside[at]) {
                let pairs = neighbours.map(|other| (field.values[at], field.values[other]));
                *distance = -rule.distance(pairs, threshold).max(MIN_PINNED_DISTANCE);
            }
        }
    });
    Pins { distance, inside }
}

/// Pins the nodes within `width` [voxels] of the surface, where `level`, negative inside, holds the distance
/// [m]. A NaN is outside and not pinned.
pub(crate) fn pin_band(level: &DenseGrid, width: f32) -> Pins {
    let mut distance = vec![f32::INFINITY; level.values.len()];
    par::fill(&mut distance, |i| {
        let size = level.values[i].abs() / level.voxel;
        if size < width { -size.max(MIN_PINNED_DISTANCE) } else { f32::INFINITY }
    });
    let mut inside = vec![false; level.values.len()];
    par::fill(&mut inside, |i| level.values[i] < 0.0);
    Pins { distance, inside }
}

/// A box of nodes in blocks, for the second-order solve.
struct Blocks(Layout);

impl Nodes for Blocks {
    type At = (usize, [usize; 3]);

    fn blocks(&self) -> usize {
        self.0.block_count()
    }

    fn for_each_near(&self, block: usize, mut f: impl FnMut(usize)) {
        for (face, other) in self.0.around(block).into_iter().enumerate() {
            let Some(other) = other else { continue };
            f(other);
            if self.0.size(other)[face / 2] == 1
                && let Some(beyond) = self.0.around(other)[face]
            {
                f(beyond);
            }
        }
    }

    #[inline(always)]
    fn for_each(&self, block: usize, mut f: impl FnMut(Self::At)) {
        let (first, size, nodes) = (self.0.first(block), self.0.size(block), self.0.nodes);
        for z in first[2]..first[2] + size[2] {
            for y in first[1]..first[1] + size[1] {
                let start = nodes[0] * (y + nodes[1] * z);
                (first[0]..first[0] + size[0]).for_each(|x| f((start + x, [x, y, z])));
            }
        }
    }

    #[inline(always)]
    fn block_of(&self, slot: usize) -> usize {
        let [nx, ny, _] = self.0.nodes;
        self.0.block_of([slot % nx, slot / nx % ny, slot / (nx * ny)])
    }

    #[inline(always)]
    fn slot(&self, at: Self::At) -> usize {
        at.0
    }

    #[inline(always)]
    fn next(&self, (slot, mut node): Self::At, face: usize) -> Option<Self::At> {
        let axis = face / 2;
        if face.is_multiple_of(2) {
            if node[axis] == 0 {
                return None;
            }
            node[axis] -= 1;
        } else {
            node[axis] += 1;
            if node[axis] == self.0.nodes[axis] {
                return None;
            }
        }
        Some((self.step(slot, face), node))
    }

    #[inline(always)]
    fn step(&self, slot: usize, face: usize) -> usize {
        let stride = [1, self.0.nodes[0], self.0.nodes[0] * self.0.nodes[1]][face / 2];
        if face.is_multiple_of(2) { slot - stride } else { slot + stride }
    }
}
