//! Pictures of frames: shaded ones (`render/`), an orthographic view of particles and sheets for comparisons, labels, PNG and WebP files, terminals.
//!
//! Pictures show what a setting does, at a glance. Their bytes are the same for any number of threads.

mod canvas;
mod font;
pub(crate) mod render;
mod terminal;
mod view;
mod webp;

pub(crate) use canvas::{Canvas, text_lines};
pub(crate) use terminal::TerminalPictures;
pub(crate) use view::{View, draw, extent};
pub(crate) use webp::{LoopFrame, animation};
