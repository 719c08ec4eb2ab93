//! The scalar field and the level whose isosurface is extracted.

use crate::{field::Density, grid::SparseGrid};

/// An isosurface of a field on bricks: its level, and which side of it is inside.
#[derive(Clone, Copy, Debug)]
pub struct Contour<'a> {
    /// The values.
    pub grid: &'a SparseGrid,
    /// The value on the surface.
    pub level: f32,
    /// The side of the surface that is inside.
    pub inside: Side,
    /// How the crossing of an edge is found.
    pub interpolation: Interpolation,
}

/// How the place where the level crosses an edge is found from the values at nodes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Interpolation {
    /// By the values at the ends of the edge. A signed distance that was solved from linear crossings has its surface there.
    Linear,
    /// By the cubic through four nodes in a row; linear where one of these is missing.
    Cubic,
}

/// A side of a level.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// Values below the level; the level itself is outside. Signed distances use this side.
    Below,
    /// Values above the level; the level itself is inside. Densities use this side.
    Above,
}

impl Contour<'_> {
    /// Whether a node with this value is inside. NaN is outside.
    #[inline(always)]
    pub(super) fn is_inside(&self, value: f32) -> bool {
        match self.inside {
            Side::Below => value < self.level,
            Side::Above => value >= self.level,
        }
    }

    /// The sign of the outward derivative.
    pub(super) fn outward(&self) -> f32 {
        match self.inside {
            Side::Below => 1.0,
            Side::Above => -1.0,
        }
    }
}

/// A grid alone holds signed distances, whose surface is the level set of zero by linear interpolation.
impl<'a> From<&'a SparseGrid> for Contour<'a> {
    fn from(grid: &'a SparseGrid) -> Self {
        Self { grid, level: 0.0, inside: Side::Below, interpolation: Interpolation::Linear }
    }
}

impl<'a> From<&'a Density> for Contour<'a> {
    fn from(density: &'a Density) -> Self {
        Self {
            grid: &density.grid,
            level: density.threshold,
            inside: Side::Above,
            interpolation: Interpolation::Cubic,
        }
    }
}
