//! A grid of a volume file, as a caller gives it.

use crate::{
    grid::{Bricks, NodeMask},
    math::Vec3,
};

/// A grid of a volume file.
#[derive(Clone, Copy, Debug)]
pub struct Grid<'a> {
    /// Name of the grid, unique in a file.
    pub name: &'a str,
    /// Meaning of the values.
    pub class: Class<'a>,
    /// Distance between nodes [m]; node (0, 0, 0) is at the origin.
    pub voxel: f32,
    /// Which nodes are stored.
    pub bricks: &'a Bricks,
    /// The nodes whose values count, a mask a brick. The others are background.
    pub active: &'a [NodeMask],
}

/// What a grid means, and its values: 512 a brick.
#[derive(Clone, Copy, Debug)]
pub enum Class<'a> {
    /// How much is there; background 0.
    FogVolume(&'a [f32]),
    /// Signed distance to a surface [m].
    LevelSet {
        /// The distances; those of inactive nodes give a sign only.
        values: &'a [f32],
        /// The largest distance stored, and the background [m].
        half_width: f32,
        /// Bricks without values that lie inside: coordinates, none of them among the grid's own.
        inside: &'a [[i32; 3]],
    },
    /// Vectors that move and turn with the space they are in, such as velocities; background 0.
    Vector(&'a [Vec3]),
}

impl Class<'_> {
    /// How many values there are.
    pub(super) fn len(&self) -> usize {
        match self {
            Self::FogVolume(values) | Self::LevelSet { values, .. } => values.len(),
            Self::Vector(values) => values.len(),
        }
    }

    /// How many numbers a value has.
    pub(super) fn width(&self) -> usize {
        match self {
            Self::FogVolume(_) | Self::LevelSet { .. } => 1,
            Self::Vector(_) => 3,
        }
    }

    /// The numbers of value `index`; those it has not are `None`.
    pub(super) fn components(&self, index: usize) -> [Option<f32>; 3] {
        match self {
            Self::FogVolume(values) | Self::LevelSet { values, .. } => [Some(values[index]), None, None],
            Self::Vector(values) => [0, 1, 2].map(|axis| Some(values[index][axis])),
        }
    }

    /// Whether an inactive value is minus the background: a level set's inside.
    pub(super) fn is_inside(&self, index: usize) -> bool {
        matches!(self, Self::LevelSet { values, .. } if values[index].is_sign_negative())
    }

    /// The value where no node is [grid's unit].
    pub(super) fn background(&self) -> f32 {
        match self {
            Self::LevelSet { half_width, .. } => *half_width,
            Self::FogVolume(_) | Self::Vector(_) => 0.0,
        }
    }
}
