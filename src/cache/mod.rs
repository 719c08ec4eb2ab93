//! Frames on disk.

mod atomic;

pub use atomic::{remove_temporaries, write_atomically};
