//! What a particle adds to the density: a kernel over an ellipsoid.

use super::{cloud::Cloud, kernel::kernel};
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

impl Blob {
    /// What it adds at `x` [m].
    pub(super) fn value(&self, x: Vec3) -> f32 {
        let d = x - self.center;
        let [xx, yy, zz, xy, xz, yz] = self.matrix;
        let beside = xy * d.x * d.y + xz * d.x * d.z + yz * d.y * d.z;
        let q2 = xx * d.x * d.x + yy * d.y * d.y + zz * d.z * d.z + 2.0 * beside;
        self.weight * kernel(q2.max(0.0).sqrt())
    }
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
