//! The field and the level that a surface is cut from.

use crate::{field::Density, grid::SparseGrid};

/// A field on bricks, and which of its values are inside.
#[derive(Clone, Copy, Debug)]
pub struct Contour<'a> {
    /// The values.
    pub grid: &'a SparseGrid,
    /// The value on the surface.
    pub level: f32,
    /// Which side of the surface is inside.
    pub inside: Side,
}

/// A side of a level.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// Values below the level; the level itself is outside. Distances are so.
    Below,
    /// Values above the level; the level itself is inside. Densities are so.
    Above,
}

impl Contour<'_> {
    /// Whether a node with this value is inside. What is not a number is outside.
    #[inline(always)]
    pub(super) fn is_inside(&self, value: f32) -> bool {
        match self.inside {
            Side::Below => value < self.level,
            Side::Above => value >= self.level,
        }
    }

    /// The sign of the slope outwards.
    pub(super) fn outward(&self) -> f32 {
        match self.inside {
            Side::Below => 1.0,
            Side::Above => -1.0,
        }
    }
}

/// A grid alone holds signed distances.
impl<'a> From<&'a SparseGrid> for Contour<'a> {
    fn from(grid: &'a SparseGrid) -> Self {
        Self { grid, level: 0.0, inside: Side::Below }
    }
}

impl<'a> From<&'a Density> for Contour<'a> {
    fn from(density: &'a Density) -> Self {
        Self { grid: &density.grid, level: density.threshold, inside: Side::Above }
    }
}
