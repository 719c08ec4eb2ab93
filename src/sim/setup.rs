//! Surroundings of a simulation, and errors of its setup.

use super::{coupling::CouplingError, sheet::SheetError, vortex::OutOfRange};
use crate::{math::Vec3, solid::Solid};
use serde::de::{DeserializeOwned, value::MapDeserializer};

/// Surroundings of the systems.
#[derive(Clone, Debug, PartialEq)]
pub struct World {
    /// Acceleration of gravity [m/s²].
    pub gravity: Vec3,
    /// Solid obstacles.
    pub solids: Vec<Solid>,
}

/// How frames count time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Timeline {
    /// Frames a second.
    pub fps: f64,
    /// The frame at time 0.
    pub first: u32,
}

impl Default for Timeline {
    fn default() -> Self {
        Self { fps: 24.0, first: 1 }
    }
}

impl Timeline {
    /// Time of a frame since the shot's start [s].
    pub fn time(&self, frame: u32) -> f64 {
        (f64::from(frame) - f64::from(self.first)) / self.fps
    }
}

/// Why a simulation cannot start.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SetupError {
    /// The preset names no system.
    #[error("nothing to simulate: the preset names no system")]
    NoSystem,
    /// The sources hold no particle outside the solids.
    #[error(
        "no particles: the sources are smaller than the spacing, or inside solids; enlarge a source or lower liquid.spacing"
    )]
    NoParticles,
    /// The nozzles of the emitters have too many columns.
    #[error(
        "the nozzles of the emitters are {count:.1e} particles wide, more than 4 million; make them smaller or raise liquid.spacing"
    )]
    TooManyColumns {
        /// Points of the grids over the nozzles.
        count: f64,
    },
    /// The sources hold more particles than the solver can index.
    #[error("the sources hold {count:.1e} particles, more than 2³¹; raise liquid.spacing")]
    TooMany {
        /// Points of the seeding lattices of all sources.
        count: f64,
    },
    /// There are no vortons, tracers or emitters.
    #[error(
        "no smoke: rings, tubes, turbulence and sources are empty or inside solids, and there is no emitter; enlarge one or \
         lower smoke.spacing"
    )]
    NoSmoke,
    /// Rings, sources and emitters need more vortons and tracers than the solver can index.
    #[error(
        "the smoke would have about {count:.1e} tracers and vortons, more than 2³¹; raise smoke.spacing or smoke.tracers, or \
         make the meshes smaller"
    )]
    TooMuchSmoke {
        /// Vortons and tracers at the end of the shot.
        count: f64,
    },
    /// The smoke's kernel is not that of its sum.
    #[error(
        "`smoke.flow.sum = \"multigrid\"` has Gaussian cores only; write `smoke.flow.kernel = \"gaussian\"`"
    )]
    MultigridKernel,
    /// A vorton of the start is out of range.
    #[error("the smoke cannot start: {0}; check the rings, tubes and the turbulence")]
    OutOfRange(#[from] OutOfRange),
    /// The sheets of the preset are invalid.
    #[error(transparent)]
    Sheets(#[from] SheetError),
    /// A body has no mass or inertia.
    #[error(
        "body {index} has no volume at the resolution of its samples; raise `resolution` of its mesh, or close the mesh"
    )]
    Body {
        /// Its number in the preset, from 0.
        index: usize,
    },
    /// Rigid bodies take their substeps from the liquid, which does not share them with the sheets.
    #[error("rigid bodies, liquid and sheets in one shot need a coupling of the liquid with a sheet")]
    BodiesBetween,
    /// A coupling is invalid.
    #[error(transparent)]
    Coupling(#[from] CouplingError),
    /// The frame to restore from is incomplete.
    #[error("the frame's stream '{stream}' has no '{what}'; simulate it again")]
    Missing {
        /// The stream's name.
        stream: &'static str,
        /// The channel or scalar, or "particles" if the stream itself is missing.
        what: &'static str,
    },
}

/// Parameters of which only the spacing [m] has no default.
pub(super) fn from_spacing<T: DeserializeOwned>(spacing: f32) -> T {
    let fields = MapDeserializer::<_, serde::de::value::Error>::new([("spacing", spacing)].into_iter());
    T::deserialize(fields).expect("all other parameters have defaults")
}

#[cfg(test)]
mod tests {
    use crate::sim::{liquid::LiquidParams, smoke::SmokeParams, vortex::flow::Remesh};

    #[test]
    fn parameters_of_a_spacing_have_the_defaults_of_presets() {
        let liquid = LiquidParams { density_dev: None, ..LiquidParams::new(0.1) };
        assert_eq!(liquid, crate::from_toml("spacing = 0.1"));
        assert_eq!(SmokeParams::new(0.1), crate::from_toml("spacing = 0.1"));
        assert_eq!(Remesh::of(0.1), crate::from_toml("spacing = 0.1"));
    }
}
