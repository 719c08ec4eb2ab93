//! Previews: shaded pictures of frames, a contact sheet and a loop. docs/preview.md shows them.

mod colours;
mod contact;
mod content;
mod files;
mod looped;
mod props;
mod settings;
mod stage;
mod writer;

pub(crate) use settings::{ParticleLook, PreviewParams};
pub(super) use writer::Preview;

/// Places from the first to the last of `count`, at most `maximum`, at equal distances.
fn evenly(count: usize, maximum: usize) -> Vec<usize> {
    let chosen = maximum.min(count);
    (0..chosen).map(|i| (i * (count - 1) + (chosen - 1) / 2) / (chosen - 1).max(1)).collect()
}
