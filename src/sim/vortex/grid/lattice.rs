//! A lattice of cubic cells, and vectors at its nodes.

use crate::{math::Vec3, par};

/// Nodes that a row is filled up to a multiple of: two times eight lanes, a line of the cache.
pub(super) const ROW: usize = 16;

/// Nodes along the axes at equal distances.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lattice {
    /// The first node [m].
    pub low: Vec3,
    /// h: from node to node [m].
    pub spacing: f32,
    /// Cells along each axis, at least 2: nodes are one more.
    pub cells: [usize; 3],
}

impl Lattice {
    /// Where a node is [m].
    pub fn node(&self, at: [usize; 3]) -> Vec3 {
        self.low + Vec3::from_fn(|k, _| at[k] as f32) * self.spacing
    }

    /// The number of a node in the arrays of a [`Field`]. Along x nodes follow one another.
    pub fn place(&self, at: [usize; 3]) -> usize {
        at[0] + self.row() * (at[1] + (self.cells[1] + 1) * at[2])
    }

    /// All nodes.
    pub fn nodes(&self) -> usize {
        self.cells.iter().map(|cells| cells + 1).product()
    }

    /// Places of a row along x.
    pub fn row(&self) -> usize {
        (self.cells[0] + 1).next_multiple_of(ROW)
    }

    /// Places of a plane of constant z.
    pub fn plane(&self) -> usize {
        self.row() * (self.cells[1] + 1)
    }

    /// The lowest node of the cell that holds a point, and how far in it is, in cells.
    pub(super) fn cell(&self, x: Vec3) -> ([usize; 3], [f32; 3]) {
        let t = (x - self.low) / self.spacing;
        let at: [usize; 3] = std::array::from_fn(|k| t[k].max(0.0) as usize);
        (at, std::array::from_fn(|k| t[k] - at[k] as f32))
    }

    /// Whether a point is at least `margin` cells from the boundary.
    pub(super) fn holds(&self, x: Vec3, margin: usize) -> bool {
        let (t, margin) = ((x - self.low) / self.spacing, margin as f32);
        (0..3).all(|k| t[k] >= margin && t[k] < self.cells[k] as f32 - margin)
    }
}

/// A vector at every node.
#[derive(Clone, Debug, PartialEq)]
pub struct Field {
    /// The nodes.
    pub lattice: Lattice,
    /// Its components, at the places that [`Lattice::place`] gives; what fills up rows means nothing.
    pub values: [Vec<f32>; 3],
}

impl Field {
    /// Zero everywhere.
    pub fn new(lattice: Lattice) -> Self {
        let places = lattice.plane() * (lattice.cells[2] + 1);
        Self { lattice, values: std::array::from_fn(|_| par::repeated(0.0, places)) }
    }

    /// The vector at a node.
    pub fn at(&self, node: [usize; 3]) -> Vec3 {
        let place = self.lattice.place(node);
        Vec3::from_fn(|k, _| self.values[k][place])
    }

    /// Writes the vector at a node.
    pub fn set(&mut self, node: [usize; 3], vector: Vec3) {
        let place = self.lattice.place(node);
        for k in 0..3 {
            self.values[k][place] = vector[k];
        }
    }
}
