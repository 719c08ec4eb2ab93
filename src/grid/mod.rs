//! Grids of samples in space.

mod bricks;

pub use bricks::{BRICK, BRICK_NODES, Bricks, SparseGrid, offset};
