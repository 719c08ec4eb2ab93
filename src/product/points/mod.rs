//! Point files: tracers as points with a radius and a velocity.

mod writer;

pub use writer::points;
