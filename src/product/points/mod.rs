//! Point files: tracers as points with a radius and a velocity.

mod writer;

pub(super) use writer::TracerPoints;
