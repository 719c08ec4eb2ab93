//! What can be wrong with a reconstruction.

use crate::frame::Columns;

/// Errors of a reconstruction.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SurfaceError {
    /// The caller interrupted the reconstruction.
    #[error("interrupted during surface reconstruction")]
    Interrupted,
    /// The stream has no vectors named `position`.
    #[error("the particles have no channel of vectors named `position`; expected one to make a surface of")]
    NoPositions,
    /// A position is infinite or NaN.
    #[error(
        "the position of particle {particle} is not finite; simulate the frame again or check its source"
    )]
    NotFinite {
        /// Index of the particle in the stream.
        particle: usize,
    },
    /// The particles have no radius.
    #[error(
        "the particles have no attribute `radius` or `pscale` of one number; export one, or leave surface.radius out"
    )]
    NoRadius,
    /// The particles lack a channel for the vertex attributes or the mask of smoothing.
    #[error(
        "the particles have no channel `{name}` for the vertices; they have {existing}: change surface.attributes or \
         surface.smoothing.mask"
    )]
    NoChannel {
        /// The requested name.
        name: String,
        /// The existing names.
        existing: String,
    },
}

impl SurfaceError {
    /// The error that lists the existing channels.
    pub(super) fn no_channel(name: String, particles: &Columns) -> Self {
        let names: Vec<&str> = particles.columns().iter().map(|&(name, _)| name).collect();
        Self::NoChannel { name, existing: names.join(", ") }
    }
}
