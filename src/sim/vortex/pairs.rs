//! Sums over pairs: eight targets at a time with one vorton after the other.

use super::{
    Vortons,
    index::MAX_ORDER,
    kernels::{Derivatives, RadialKernel},
    quantities::{GRADIENT, POTENTIAL},
};
use crate::{
    math::Vec3,
    simd::{LANES, Lanes, splat},
};
use std::f64::consts::PI;

/// A vorton as a source: position [m], Γ/4π [m³/s], σ² [m²].
#[derive(Clone, Copy, Debug, Default)]
#[repr(C, align(32))]
pub(super) struct Source(pub(super) [f32; 8]);

impl Source {
    /// The source of vorton `i`.
    pub(super) fn new(vortons: &Vortons, i: usize) -> Self {
        let (x, s) = (vortons.position[i], vortons.core[i]);
        let g = vortons.strength[i] * (0.25 / PI) as f32;
        Self([x.x, x.y, x.z, g.x, g.y, g.z, s * s, 0.0])
    }

    /// Merges coincident sources of one core: the first gets the strength of all, the others none.
    pub(super) fn merge(coincident: &mut [Self]) {
        let sum = |k: usize| coincident.iter().map(|Self(q)| f64::from(q[k])).sum::<f64>() as f32;
        let sums = [3, 4, 5].map(sum);
        for Self(q) in coincident.iter_mut() {
            q[3..6].fill(0.0);
        }
        coincident[0].0[3..6].copy_from_slice(&sums);
    }
}

/// Numbers that are summed: a vector, and for the gradient Σ KΓ and Σ H (Γ × d) dᵀ except its last, which
/// follows from the trace.
pub(super) const SUMS: usize = 14;

/// The sums at eight targets.
pub(super) type Sums<L> = [L; SUMS];

/// Adds the sums over `sources` at `x` for the quantity `Q`.
#[inline(always)]
pub(super) fn add_pairs<L: Lanes, K: RadialKernel, const Q: usize>(
    x: [L; 3],
    sources: &[Source],
    sums: &mut Sums<L>,
) {
    let mut s = *sums;
    for Source(q) in sources {
        let d = [x[0] - splat(q[0]), x[1] - splat(q[1]), x[2] - splat(q[2])];
        let r2 = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
        let g: [L; 3] = [splat(q[3]), splat(q[4]), splat(q[5])];
        let mut derivatives: Derivatives<L> = [splat(0.0); MAX_ORDER + 1];
        K::derivatives(r2, splat(q[6]), Q, &mut derivatives);
        if Q == POTENTIAL {
            for k in 0..3 {
                s[k] += g[k] * derivatives[0];
            }
            continue;
        }

        // K Γ × d, K = −G₁.
        let c = [g[1] * d[2] - g[2] * d[1], g[2] * d[0] - g[0] * d[2], g[0] * d[1] - g[1] * d[0]];
        for k in 0..3 {
            s[k] = s[k] - derivatives[1] * c[k];
        }

        // K Γ, whose cross product with a direction is half of the gradient, and H (Γ × d) dᵀ, H = −G₂.
        if Q == GRADIENT {
            for k in 0..3 {
                s[3 + k] = s[3 + k] - derivatives[1] * g[k];
            }
            for i in 0..3 {
                let h = derivatives[2] * c[i];
                for j in 0..3 {
                    if 3 * i + j < 8 {
                        s[6 + 3 * i + j] = s[6 + 3 * i + j] - h * d[j];
                    }
                }
            }
        }
    }
    *sums = s;
}

/// The vectors of the sums at a target: A, u, or u and the rows of ∇u.
#[inline(always)]
pub(super) fn vectors<const Q: usize, const N: usize>(s: [f32; SUMS]) -> [Vec3; N] {
    let mut out = [Vec3::new(s[0], s[1], s[2]); N];
    if Q == GRADIENT {
        let w = [s[3], s[4], s[5]];
        out[1] = Vec3::new(s[6], s[7] - w[2], s[8] + w[1]);
        out[2] = Vec3::new(s[9] + w[2], s[10], s[11] - w[0]);
        out[3] = Vec3::new(s[12] - w[1], s[13] + w[0], -(s[6] + s[10]));
    }
    out
}

/// Eight positions as columns.
#[inline(always)]
pub(in crate::sim) fn columns<L: Lanes>(positions: impl Fn(usize) -> Vec3) -> [L; 3] {
    let (mut x, mut y, mut z) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
    for lane in 0..LANES {
        let at = positions(lane);
        (x[lane], y[lane], z[lane]) = (at.x, at.y, at.z);
    }
    [L::load(&x), L::load(&y), L::load(&z)]
}
