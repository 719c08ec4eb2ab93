//! What the passes over neighbour lists share: particles as their neighbours read them, and vectors of eight numbers.

use crate::{
    math::Vec3,
    par,
    simd::{IndexRow, Lanes},
};
use bytemuck::{Pod, Zeroable};

/// A particle as its neighbours read it: x, y, z and one value, in one load.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C, align(16))]
pub(super) struct Node(pub(super) [f32; 4]);

impl Node {
    #[inline(always)]
    pub(super) fn new(v: Vec3, value: f32) -> Self {
        Self([v.x, v.y, v.z, value])
    }

    #[inline(always)]
    pub(super) fn vector(&self) -> Vec3 {
        Vec3::new(self.0[0], self.0[1], self.0[2])
    }

    #[inline(always)]
    pub(super) fn value(&self) -> f32 {
        self.0[3]
    }
}

/// Copies positions over h into the layout of neighbour sums, with the value 0.
pub(super) fn publish_positions(nodes: &mut Vec<Node>, x: &[Vec3], inv_h: f32) {
    nodes.resize(x.len(), Node::default());
    par::fill(nodes, |i| Node::new(x[i] * inv_h, 0.0));
}

/// The four components of eight nodes.
#[inline(always)]
pub(super) fn gather<L: Lanes>(nodes: &[Node], index: IndexRow<'_>) -> [L; 4] {
    L::gather(bytemuck::cast_slice(nodes), index)
}

/// A node's components in every lane.
#[inline(always)]
pub(super) fn spread<L: Lanes>(node: Node) -> [L; 4] {
    [L::splat(node.0[0]), L::splat(node.0[1]), L::splat(node.0[2]), L::splat(node.0[3])]
}

/// x_i − x_j, and the squared length of that.
#[inline(always)]
pub(super) fn offset<L: Lanes>(own: [L; 4], other: [L; 4]) -> ([L; 3], L) {
    let d = [own[0] - other[0], own[1] - other[1], own[2] - other[2]];
    (d, d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
}

/// `sum` + `v` `weight`.
#[inline(always)]
pub(super) fn plus<L: Lanes>(sum: [L; 3], v: [L; 3], weight: L) -> [L; 3] {
    [sum[0] + v[0] * weight, sum[1] + v[1] * weight, sum[2] + v[2] * weight]
}

/// Σ over lanes of a vector.
#[inline(always)]
pub(super) fn total<L: Lanes>(v: [L; 3]) -> Vec3 {
    Vec3::new(v[0].sum(), v[1].sum(), v[2].sum())
}

/// a × b.
#[inline(always)]
pub(super) fn cross<L: Lanes>(a: [L; 3], b: [L; 3]) -> [L; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}
