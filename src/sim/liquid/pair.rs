//! Kernel pairs: the density kernel, and the slope of the gradient kernel.
//!
//! *Method*: Poly6 with Spiky's gradient as [pbf] section 3 takes from [mcg03]; Wendland's C2 ([dehnen12] Table 1) with its
//! own gradient. Everything is a function of q = r/h, so that no power of h leaves the range of single precision, and W is
//! 1 at the centre.

use super::params::Kernel;
use crate::simd::Lanes;

/// A pair of kernels. `slope` is s(q) in ∇_i W(x_i − x_j) ∝ −s(q) (x_i − x_j)/h.
pub(super) trait Pair: Copy + Send + Sync {
    /// Density kernel W(q), given q² and q.
    fn density<L: Lanes>(q2: L, q: L) -> L;
    /// Slope s(q) of the gradient kernel.
    fn slope<L: Lanes>(q: L) -> L;
}

/// Poly6 with the gradient of Spiky.
#[derive(Clone, Copy, Debug)]
pub(super) struct Poly6Spiky;

impl Pair for Poly6Spiky {
    #[inline(always)]
    fn density<L: Lanes>(q2: L, _: L) -> L {
        let w = (L::splat(1.0) - q2).positive_part();
        w * w * w // [mcg03] Eq. 20
    }

    #[inline(always)]
    fn slope<L: Lanes>(q: L) -> L {
        let t = (L::splat(1.0) - q).positive_part();
        t * t / q.max(L::splat(1e-12)) // [mcg03] Eq. 21, differentiated
    }
}

/// Wendland's C2 with its own gradient.
#[derive(Clone, Copy, Debug)]
pub(super) struct Wendland;

impl Pair for Wendland {
    #[inline(always)]
    fn density<L: Lanes>(_: L, q: L) -> L {
        let t = (L::splat(1.0) - q).positive_part();
        let t2 = t * t;
        t2 * t2 * (L::splat(1.0) + L::splat(4.0) * q) // [dehnen12] Table 1, C2 in three dimensions
    }

    #[inline(always)]
    fn slope<L: Lanes>(q: L) -> L {
        let t = (L::splat(1.0) - q).positive_part();
        t * t * t
    }
}

/// Density kernel and slope of the gradient kernel at q < 1, given q², of one pair of particles.
#[inline(always)]
pub(super) fn kernel_and_slope(kernel: Kernel, q2: f32) -> (f32, f32) {
    let q = q2.sqrt();
    let t = 1.0 - q;
    match kernel {
        Kernel::Wendland => {
            let t2 = t * t;
            (t2 * t2 * (1.0 + 4.0 * q), t2 * t)
        }
        Kernel::Poly6Spiky => {
            let w = 1.0 - q2;
            (w * w * w, t * t / q.max(1e-12))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::ScalarLanes;

    #[test]
    fn one_pair_has_the_kernels_of_eight() {
        fn of<P: Pair>(q: f32) -> (f32, f32) {
            let [q, q2] = [q, q * q].map(ScalarLanes::splat);
            (P::density(q2, q).to_array()[0], P::slope(q).to_array()[0])
        }
        for q in [0.0, 0.1, 0.5, 0.9] {
            for (kernel, (w, s)) in
                [(Kernel::Wendland, of::<Wendland>(q)), (Kernel::Poly6Spiky, of::<Poly6Spiky>(q))]
            {
                let (density, slope) = kernel_and_slope(kernel, q * q);
                assert!((density - w).abs() < 1e-6 && (slope - s).abs() <= 1e-5 * s, "{kernel:?}, {q}");
            }
        }
    }
}
