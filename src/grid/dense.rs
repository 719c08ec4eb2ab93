//! Dense grids: a box of nodes, every one stored.

use crate::{math::Vec3, par};

/// One number a node, in a box of nodes; x runs fastest, then y, then z.
///
/// Node (i, j, k) of the box is at (`first` + (i, j, k)) · voxel in world space, so a dense grid and bricks of the
/// same voxel share their nodes.
#[derive(Clone, Debug, PartialEq)]
pub struct DenseGrid {
    /// Distance between nodes [m].
    pub voxel: f32,
    /// The world's node that the box begins with.
    pub first: [i32; 3],
    /// Nodes along each axis.
    pub nodes: [usize; 3],
    /// One number a node.
    pub values: Vec<f32>,
}

impl DenseGrid {
    /// A grid with `value` at every node.
    pub fn new(voxel: f32, first: [i32; 3], nodes: [usize; 3], value: f32) -> Self {
        Self { voxel, first, nodes, values: vec![value; nodes.iter().product()] }
    }

    /// A grid with `f(position [m])` at every node.
    pub fn sample(voxel: f32, first: [i32; 3], nodes: [usize; 3], f: impl Fn(Vec3) -> f32 + Sync) -> Self {
        let mut grid = Self::new(voxel, first, nodes, 0.0);
        let mut values = std::mem::take(&mut grid.values);
        par::fill(&mut values, |i| f(grid.position(grid.node(i))));
        grid.values = values;
        grid
    }

    /// The place of a node of the box in `values`.
    #[inline]
    pub fn index(&self, node: [usize; 3]) -> usize {
        node[0] + self.nodes[0] * (node[1] + self.nodes[1] * node[2])
    }

    /// The node of the box at a place in `values`.
    #[inline]
    pub fn node(&self, index: usize) -> [usize; 3] {
        let [nx, ny, _] = self.nodes;
        [index % nx, index / nx % ny, index / (nx * ny)]
    }

    /// Where a node of the box stands [m].
    pub fn position(&self, node: [usize; 3]) -> Vec3 {
        let at =
            |axis: usize| ((f64::from(self.first[axis]) + node[axis] as f64) * f64::from(self.voxel)) as f32;
        Vec3::new(at(0), at(1), at(2))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::SparseGrid;

    #[test]
    fn nodes_are_those_of_bricks_of_the_same_voxel() {
        let f = |x: Vec3| x.x + 100.0 * x.y + 10_000.0 * x.z;
        let dense = DenseGrid::sample(0.3, [-5, 2, -9], [7, 3, 12], f);
        let sparse = SparseGrid::sample(0.3, Vec3::repeat(-3.0), Vec3::repeat(3.0), f);
        for (i, &value) in dense.values.iter().enumerate() {
            let node = dense.node(i);
            assert_eq!(dense.index(node), i);
            let world = std::array::from_fn(|axis| dense.first[axis] + node[axis] as i32);
            assert_eq!(sparse.get(world), Some(value));
        }
    }
}
