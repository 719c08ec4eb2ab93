//! Grids of samples in space.

mod bricks;

pub use bricks::{BRICK, BRICK_NODES, Bricks, FACES, MAX_BRICK, SparseGrid, node_of, offset};
