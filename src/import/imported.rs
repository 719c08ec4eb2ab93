//! What readers of particle files give.

use crate::frame::Stream;

/// Particles read from a file.
#[derive(Clone, Debug, PartialEq)]
pub struct Imported {
    /// The stream "particles": `position`, `velocity` and `id` where the file has them, and every other
    /// attribute of one or three floats, or of one integer that fits 32 bits without a sign.
    pub stream: Stream,
    /// Attributes that were not taken, and why.
    pub ignored: Vec<String>,
}
