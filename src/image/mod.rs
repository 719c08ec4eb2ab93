//! Pictures of frames: an orthographic view of particles and sheets, labels, PNG files.
//!
//! Pictures show what a setting does, at a glance; they are no rendering. Their bytes are the same for any number of threads.

mod canvas;
mod font;
mod view;

pub(crate) use canvas::{Canvas, text_lines};
pub(crate) use view::{View, draw, extent};
