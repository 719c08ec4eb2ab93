//! What a simulation starts from, and why it cannot start.

use super::{coupling::CouplingError, sheet::SheetError, vortex::OutOfRange};
use crate::{job::RunError, math::Vec3, solid::Solid};

/// What surrounds the systems.
#[derive(Clone, Debug, PartialEq)]
pub struct World {
    /// Acceleration on everything [m/s²].
    pub gravity: Vec3,
    /// What keeps the systems out.
    pub solids: Vec<Solid>,
}

/// Why a simulation cannot start.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SetupError {
    /// The preset names no system.
    #[error("nothing to simulate: the preset names no system")]
    NoSystem,
    /// The sources hold no particle outside the solids.
    #[error(
        "no particles: the sources are smaller than the spacing, or inside solids; enlarge a source or lower liquid.spacing"
    )]
    NoParticles,
    /// The sources ask for more particles than can be counted.
    #[error("the sources ask for {asked:.1e} particles, more than 2³¹; raise liquid.spacing")]
    TooMany {
        /// Lattice points in all sources.
        asked: f64,
    },
    /// There is neither a vorton nor a tracer, and nothing that would give off any.
    #[error(
        "no smoke: rings, tubes, turbulence and sources are empty or inside solids, and there is no emitter; enlarge one or \
         lower smoke.spacing"
    )]
    NoSmoke,
    /// Rings, sources and emitters ask for more vortons and tracers than can be counted.
    #[error(
        "the smoke would have about {asked:.1e} tracers and vortons, more than 2³¹; raise smoke.spacing or smoke.tracers, or \
         make the meshes smaller"
    )]
    TooMuchSmoke {
        /// Vortons and tracers at the end of the shot.
        asked: f64,
    },
    /// Vortons at the start are outside what can be computed.
    #[error("the smoke cannot start: {0}; check the rings, tubes and the turbulence")]
    OutOfRange(#[from] OutOfRange),
    /// The sheets cannot be what the preset says.
    #[error(transparent)]
    Sheets(#[from] SheetError),
    /// A coupling has no meaning.
    #[error(transparent)]
    Coupling(#[from] CouplingError),
    /// The frame to restore from lacks a part.
    #[error("the frame's stream '{stream}' has no '{what}'; simulate it again")]
    Missing {
        /// The stream's name.
        stream: &'static str,
        /// The channel or scalar, or "particles" if the stream itself is missing.
        what: &'static str,
    },
}

impl From<SetupError> for RunError {
    fn from(why: SetupError) -> Self {
        Self::Setup(Box::new(why))
    }
}
