//! Spray, foam and bubbles of a cached liquid: points and volumes in `whitewater/`, next to the frames from which the product continues.

mod chain;
mod folder;
mod log;
mod points;
mod product;
mod volume;

pub(super) use folder::WhitewaterPoints;
