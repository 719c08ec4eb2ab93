//! Axes and units of a stage.

use crate::math::Vec3;
use serde::{Deserialize, Serialize};
use std::ops::{Neg, RangeInclusive};

/// Range of the scale of a stage [units/m].
pub const SCALE_RANGE: RangeInclusive<f64> = 1e-4..=1e4;

/// The axis of a stage that points up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum UpAxis {
    /// As in shots and in Blender.
    #[default]
    Z,
    /// As in Houdini and Maya: x stays, y becomes z and z becomes -y.
    Y,
}

impl UpAxis {
    /// Every axis.
    pub const ALL: [Self; 2] = [Self::Z, Self::Y];

    /// Name of the axis in arguments.
    pub fn name(self) -> &'static str {
        match self {
            Self::Z => "z",
            Self::Y => "y",
        }
    }

    /// The token of a stage.
    pub(crate) fn token(self) -> &'static str {
        match self {
            Self::Z => "Z",
            Self::Y => "Y",
        }
    }

    /// A vector of the shot in the axes of the stage.
    pub(crate) fn turned<T: Neg<Output = T>>(self, [x, y, z]: [T; 3]) -> [T; 3] {
        match self {
            Self::Z => [x, y, z],
            Self::Y => [x, z, -y],
        }
    }
}

/// Axes and units of a stage: coordinates themselves are turned and scaled, no transform is added.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct StageSpace {
    /// The axis that points up.
    pub up: UpAxis,
    /// Units of the stage in a metre [units/m], in [`SCALE_RANGE`]: 100 for centimetres.
    pub scale: f64,
}

impl Default for StageSpace {
    fn default() -> Self {
        Self { up: UpAxis::Z, scale: 1.0 }
    }
}

impl StageSpace {
    /// Metres in a unit of the stage [m].
    pub fn meters_per_unit(self) -> f64 {
        1.0 / self.scale
    }

    /// A length [m] in units of the stage, rounded once.
    pub(crate) fn length(self, metres: f32) -> f32 {
        (f64::from(metres) * self.scale) as f32
    }

    /// Positions [m] or velocities [m/s] in axes and units of the stage.
    pub(crate) fn lengths(self, vectors: &[Vec3]) -> Vec<[f32; 3]> {
        vectors.iter().map(|&v| self.up.turned(<[f32; 3]>::from(v).map(|c| self.length(c)))).collect()
    }

    /// Vectors in axes of the stage.
    pub(crate) fn directions(self, vectors: &[Vec3]) -> Vec<[f32; 3]> {
        vectors.iter().map(|&v| self.up.turned(v.into())).collect()
    }

    /// A position [m] in axes and units of the stage.
    pub(crate) fn position(self, metres: [f64; 3]) -> [f64; 3] {
        self.up.turned(metres).map(|c| c * self.scale)
    }

    /// A rotation w, x, y, z in axes of the stage.
    pub(crate) fn rotation(self, [w, x, y, z]: [f32; 4]) -> [f32; 4] {
        let [x, y, z] = self.up.turned([x, y, z]);
        [w, x, y, z]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn up_becomes_up_and_the_frame_stays_right_handed() {
        let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(|axis| UpAxis::Y.turned(axis));
        assert_eq!(axes[2], [0.0, 1.0, 0.0]);
        let cross = |a: [f64; 3], b: [f64; 3]| {
            [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
        };
        assert_eq!(cross(axes[0], axes[1]), axes[2]);
        let space = StageSpace { up: UpAxis::Y, scale: 100.0 };
        assert_eq!(space.lengths(&[Vec3::new(1.0, 2.0, 3.0)]), [[100.0, 300.0, -200.0]]);
        assert_eq!(space.directions(&[Vec3::new(1.0, 2.0, 3.0)]), [[1.0, 3.0, -2.0]]);
        assert_eq!(space.meters_per_unit(), 0.01);
    }
}
