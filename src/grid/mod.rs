//! Grids of samples in space.

mod bricks;
mod dense;
mod probe;

pub use bricks::{
    BRICK, BRICK_NODES, Bricks, FACES, MAX_BRICK, NodeMask, SparseGrid, is_set, mask_of, neighbour, node_of,
    offset,
};
pub use dense::DenseGrid;
pub use probe::Probe;
