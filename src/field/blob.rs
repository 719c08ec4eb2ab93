//! What a particle adds to the density: a kernel over an ellipsoid.

use super::cloud::Cloud;
use crate::math::{Vec3, symmetric::Symmetric};

/// One particle's kernel: φ += `weight` K(√(dᵀ M d)) with d from `center`.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Blob {
    /// x̄ [m].
    pub(super) center: Vec3,
    /// M = GᵀG [1/m²].
    pub(super) matrix: Symmetric,
    /// Half the edges of the box around the ellipsoid dᵀ M d = 1 [m].
    pub(super) extents: Vec3,
    /// V W(0, h) det(h G) [–].
    pub(super) weight: f32,
}

/// Every particle's, in the cells' order.
#[derive(Debug)]
pub(super) enum Blobs {
    /// Balls of one radius [m].
    Round { radius: f32, weights: Vec<f32> },
    /// Ellipsoids, no centre further than `reach` [m] less its extents from its particle.
    Ellipsoids { blobs: Vec<Blob>, reach: f32 },
}

impl Blobs {
    /// The particle at a place of the order.
    #[inline(always)]
    pub(super) fn at(&self, cloud: &Cloud, place: usize) -> Blob {
        match self {
            Self::Round { radius, weights } => {
                let m = 1.0 / (radius * radius);
                Blob {
                    center: cloud.at(place),
                    matrix: [m, m, m, 0.0, 0.0, 0.0],
                    extents: Vec3::new(*radius, *radius, *radius),
                    weight: weights[place],
                }
            }
            Self::Ellipsoids { blobs, .. } => blobs[place],
        }
    }

    /// How far from a particle it adds anything [m].
    pub(super) fn reach(&self) -> f32 {
        match self {
            Self::Round { radius, .. } => *radius,
            Self::Ellipsoids { reach, .. } => *reach,
        }
    }
}
