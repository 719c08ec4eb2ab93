//! Grids of samples in space.

mod bricks;
mod probe;

pub use bricks::FACES;
pub use bricks::{
    BRICK, BRICK_NODES, Bricks, NodeMask, SparseGrid, is_set, mask_of, neighbour, node_of, offset,
};
pub(crate) use bricks::{MAX_BRICK, bricks_in_boxes, masks_of};
pub(crate) use probe::Probe;
