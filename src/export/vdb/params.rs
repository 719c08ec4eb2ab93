//! Parameters of volumes in a preset.

use serde::{Deserialize, Serialize};

/// How frames become volumes.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub struct VolumeParams {
    /// How numbers are stored.
    pub precision: Precision,
    /// How they are packed.
    pub compression: Compression,
}

/// How many digits a stored number has.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Precision {
    /// 16 bits, about three digits, up to 65504: what renderers need, in half the space.
    #[default]
    Half,
    /// 32 bits: what the tool itself computes with.
    Float,
}

/// How stored numbers are packed. Numbers of nodes where nothing is are left out in any case.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Compression {
    /// Blosc with LZ4: fast to write and read.
    #[default]
    Blosc,
    /// zlib: slower, and a little smaller in half floats only.
    Zip,
    /// As they are: for readers that know neither.
    None,
}

/// A grid of a volume file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum VolumeGrid {
    /// Fog: 1 in filled space, 0 outside; of smoke, the density that its tracers carry.
    Density,
    /// Signed distance to the surface, in metres, in a narrow band.
    Surface,
    /// Velocity, in metres a second, wherever there is density; of smoke, as far beyond as it moves in a frame.
    Velocity,
    /// Of smoke, the temperature above that of the air, in kelvins.
    Temperature,
    /// Of smoke, the vector potential of the vorticity, in square metres a second, where there is velocity. Its curl is the
    /// velocity of the air without the wind and the flow around solids.
    VectorPotential,
}

impl VolumeGrid {
    /// Every grid, in the order written.
    pub const ALL: [Self; 5] =
        [Self::Density, Self::Surface, Self::Velocity, Self::Temperature, Self::VectorPotential];

    /// The grids that are written where none are named: not the vector potential, which takes as long as the velocity.
    pub const DEFAULT: [Self; 4] = [Self::Density, Self::Surface, Self::Velocity, Self::Temperature];

    /// The grids of particles.
    pub const OF_PARTICLES: [Self; 3] = [Self::Density, Self::Surface, Self::Velocity];

    /// The grids of tracers.
    pub const OF_TRACERS: [Self; 4] =
        [Self::Density, Self::Velocity, Self::Temperature, Self::VectorPotential];

    /// Name of the grid in a file.
    pub fn name(self) -> &'static str {
        match self {
            Self::Density => "density",
            Self::Surface => "surface",
            Self::Velocity => "velocity",
            Self::Temperature => "temperature",
            Self::VectorPotential => "vector_potential",
        }
    }

    /// The grid of that name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|grid| grid.name() == name)
    }

    /// Whether the grid is a field of the air, which the vortons of a frame determine.
    pub(crate) fn is_of_air(self) -> bool {
        matches!(self, Self::Velocity | Self::VectorPotential)
    }
}

impl Precision {
    /// Bytes of a number.
    pub(super) fn width(self) -> usize {
        match self {
            Self::Half => 2,
            Self::Float => 4,
        }
    }
}
