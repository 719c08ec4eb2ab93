//! Spray, foam and bubbles of a cached liquid: PLY points in `whitewater/`, next to the frames from which the product continues.

mod chain;
mod folder;
mod points;
mod product;

pub(super) use folder::WhitewaterPoints;
