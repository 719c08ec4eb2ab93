//! The kernel of a particle in the density, over a ball or an ellipsoid.

use super::{kernel::kernel, scaled::Scales, sorted_particles::SortedParticles};
use crate::{
    math::{Vec3, symmetric::Symmetric},
    par,
};

/// One particle's kernel: φ += `weight` K(√(dᵀ M d)) with d from `center`.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ParticleKernel {
    /// x̄ [m].
    pub(super) center: Vec3,
    /// M = GᵀG [1/m²].
    pub(super) matrix: Symmetric,
    /// Half the edges of the box around the ellipsoid dᵀ M d = 1 [m].
    pub(super) extents: Vec3,
    /// V W(0, h) det(h G) [–].
    pub(super) weight: f32,
}

impl ParticleKernel {
    /// A ball of radius `h` [m].
    pub(super) fn isotropic(center: Vec3, weight: f32, h: f32) -> Self {
        let m = 1.0 / (h * h);
        Self { center, matrix: [m, m, m, 0.0, 0.0, 0.0], extents: Vec3::repeat(h), weight }
    }

    /// The kernel's value at `x` [m].
    pub(super) fn value(&self, x: Vec3) -> f32 {
        let d = x - self.center;
        let [xx, yy, zz, xy, xz, yz] = self.matrix;
        let mixed = xy * d.x * d.y + xz * d.x * d.z + yz * d.y * d.z;
        let q2 = xx * d.x * d.x + yy * d.y * d.y + zz * d.z * d.z + 2.0 * mixed;
        self.weight * kernel(q2.max(0.0).sqrt())
    }
}

/// The kernels of all particles, in the cells' order.
#[derive(Debug)]
pub(super) enum ParticleKernels {
    /// Isotropic kernels of one radius [m].
    Isotropic { radius: f32, weights: Vec<f32> },
    /// Anisotropic kernels, no centre further than `reach` [m] less its extents from its particle.
    Ellipsoids { kernels: Vec<ParticleKernel>, reach: f32 },
}

impl ParticleKernels {
    /// Isotropic kernels of the given weights, of `radius` [m] times the particles' scales.
    pub(super) fn isotropic(
        particles: &SortedParticles,
        radius: f32,
        weights: Vec<f32>,
        scales: Option<&Scales>,
    ) -> Self {
        let Some(scales) = scales else { return Self::Isotropic { radius, weights } };
        let mut kernels = vec![ParticleKernel::default(); weights.len()];
        par::fill(&mut kernels, |place| {
            ParticleKernel::isotropic(particles.at(place), weights[place], radius * scales.at(place))
        });
        Self::Ellipsoids { kernels, reach: radius * scales.largest }
    }

    /// The same kernels, each with a shape of its own.
    pub(super) fn into_ellipsoids(self, particles: &SortedParticles) -> Self {
        let Self::Isotropic { radius, weights } = self else { return self };
        let mut kernels = vec![ParticleKernel::default(); weights.len()];
        par::fill(&mut kernels, |place| {
            ParticleKernel::isotropic(particles.at(place), weights[place], radius)
        });
        Self::Ellipsoids { kernels, reach: radius }
    }

    /// The kernel of the particle at a place of the order.
    #[inline(always)]
    pub(super) fn at(&self, particles: &SortedParticles, place: usize) -> ParticleKernel {
        match self {
            Self::Isotropic { radius, weights } => {
                let m = 1.0 / (radius * radius);
                ParticleKernel {
                    center: particles.at(place),
                    matrix: [m, m, m, 0.0, 0.0, 0.0],
                    extents: Vec3::new(*radius, *radius, *radius),
                    weight: weights[place],
                }
            }
            Self::Ellipsoids { kernels, .. } => kernels[place],
        }
    }

    /// Largest distance from a particle at which its kernel is not zero [m].
    pub(super) fn reach(&self) -> f32 {
        match self {
            Self::Isotropic { radius, .. } => *radius,
            Self::Ellipsoids { reach, .. } => *reach,
        }
    }
}
