//! A grid of cubic cells, and vectors at its nodes.

use crate::{math::Vec3, par};

/// Rows are padded to a multiple of this many nodes: two times eight lanes, one cache line.
pub(super) const ROW_MULTIPLE: usize = 16;

/// Nodes at equal distances along the axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UniformGrid {
    /// The first node [m].
    pub low: Vec3,
    /// h: the distance between neighbouring nodes [m].
    pub spacing: f32,
    /// Cells along each axis, at least 2. There is one node more than cells.
    pub cells: [usize; 3],
}

impl UniformGrid {
    /// The position of a node [m].
    pub fn node(&self, at: [usize; 3]) -> Vec3 {
        self.low + Vec3::from_fn(|k, _| at[k] as f32) * self.spacing
    }

    /// The index of a node in the arrays of a [`VectorField`]. Nodes along x are adjacent.
    pub fn index(&self, at: [usize; 3]) -> usize {
        at[0] + self.row() * (at[1] + (self.cells[1] + 1) * at[2])
    }

    /// The number of nodes.
    pub fn nodes(&self) -> usize {
        self.cells.iter().map(|cells| cells + 1).product()
    }

    /// The length of a row along x in the arrays, padding included.
    pub fn row(&self) -> usize {
        (self.cells[0] + 1).next_multiple_of(ROW_MULTIPLE)
    }

    /// The length of a plane of constant z in the arrays.
    pub fn plane(&self) -> usize {
        self.row() * (self.cells[1] + 1)
    }

    /// The lowest node of the cell that contains a point, and the position within the cell, 0..1.
    pub(in crate::sim::vortex) fn cell(&self, x: Vec3) -> ([usize; 3], [f32; 3]) {
        let t = (x - self.low) / self.spacing;
        let at: [usize; 3] = std::array::from_fn(|k| t[k].max(0.0) as usize);
        (at, std::array::from_fn(|k| t[k] - at[k] as f32))
    }

    /// Whether a point is at least `margin` cells from the boundary.
    pub(in crate::sim::vortex) fn contains(&self, x: Vec3, margin: usize) -> bool {
        let (t, margin) = ((x - self.low) / self.spacing, margin as f32);
        (0..3).all(|k| t[k] >= margin && t[k] < self.cells[k] as f32 - margin)
    }
}

/// A vector at every node of a grid.
#[derive(Clone, Debug, PartialEq)]
pub struct VectorField {
    /// The nodes.
    pub grid: UniformGrid,
    /// The components, indexed by [`UniformGrid::index`]. The padding of rows has no meaning.
    pub values: [Vec<f32>; 3],
}

impl VectorField {
    /// Zero everywhere.
    pub fn new(grid: UniformGrid) -> Self {
        let count = grid.plane() * (grid.cells[2] + 1);
        Self { grid, values: std::array::from_fn(|_| par::repeated(0.0, count)) }
    }

    /// The vector at a node.
    pub fn at(&self, node: [usize; 3]) -> Vec3 {
        let index = self.grid.index(node);
        Vec3::from_fn(|k, _| self.values[k][index])
    }

    /// Sets the vector at a node.
    pub fn set(&mut self, node: [usize; 3], vector: Vec3) {
        let index = self.grid.index(node);
        for k in 0..3 {
            self.values[k][index] = vector[k];
        }
    }
}
