//! The kernels on the grid: the Fourier transform of their vorticity, and how far two cores differ.
//!
//! *Method*: a kernel's vorticity ζ has a transform ζ̂ of x = kσ alone. Rosenhead and Moore's potential is
//! that of (r² + σ²)^-½, whose transform has Bessel's K₁: ζ̂ = x K₁(x). Winckelmans and Leonard's adds ½σ²
//! (r² + σ²)^-3/2, hence ζ̂ = x K₁ + ½x² K₀ = ½x² K₂(x). The Gaussian has e^(−x²/2). K_ν(x) = ∫ e^(−x cosh t)
//! cosh νt dt over t > 0, by trapezoids [abramowitz72] 9.6.24.

use crate::math::elementary::{cosh, exp, ln};
use crate::sim::vortex::kernels::{Ball, Gaussian, RadialKernel, RosenheadMoore, WinckelmansLeonard};

/// A kernel, and the one whose vorticity a grid represents for it.
pub(in crate::sim::vortex) trait GridKernel: RadialKernel {
    /// The kernel that the grid represents; pairs add the difference to it. The transform of a ball decays
    /// too slowly for a grid.
    type Smooth: SmoothKernel;

    /// The distance to which the difference of two velocities has to be summed for an `error` [m]: that of
    /// this kernel with `core` and that of [`GridKernel::Smooth`] with `grid_core` [m].
    fn reach(core: f32, grid_core: f32, error: f32) -> f32;

    /// The cost of the difference of a pair that the choice of a grid assumes [ns].
    const PAIR_NANOSECONDS: f64;

    /// Whether the grid represents the kernel itself.
    const IS_SMOOTH: bool;

    /// Errors of the velocity, descending, and the core in spacings with which the grid keeps them. Set by
    /// the worst of the four clouds of `benches/vortex.rs`, which is the one of dense blobs; a ring of even
    /// strengths has a tenth of its error. Smaller cores exceed the requested error, larger ones cost their
    /// third power.
    const CORE_IN_SPACINGS: &'static [[f32; 2]];

    /// The margin from the vortons to the boundary [cores]. The vorticity of a core beyond it is reflected
    /// there.
    const MARGIN: f32;
}

/// Cores in spacings for the Gaussian. Its transform decays fastest, so the spacing can be as large as the
/// core.
const GAUSSIAN_CORE_IN_SPACINGS: &[[f32; 2]] =
    &[[0.1, 1.0], [0.03, 1.1], [0.01, 1.4], [3e-3, 1.8], [1e-3, 2.2], [3e-4, 2.8], [1e-4, 3.6]];

/// A kernel with a smooth vorticity.
pub(in crate::sim::vortex) trait SmoothKernel: RadialKernel {
    /// ζ̂(x).
    fn transform(x: f64) -> f64;
}

/// The distance beyond which two Gaussians, or a ball and a Gaussian, differ by less than `error` [m].
fn gaussian_reach(core: f32, grid_core: f32, error: f32) -> f32 {
    core.max(grid_core) * ((-2.0 * ln(error)).sqrt() + 0.5)
}

impl GridKernel for Ball {
    type Smooth = Gaussian;
    const PAIR_NANOSECONDS: f64 = 1.9;
    const IS_SMOOTH: bool = false;
    const CORE_IN_SPACINGS: &'static [[f32; 2]] = GAUSSIAN_CORE_IN_SPACINGS;
    const MARGIN: f32 = 3.0;

    fn reach(core: f32, grid_core: f32, error: f32) -> f32 {
        core.max(gaussian_reach(0.0, grid_core, error))
    }
}

impl GridKernel for Gaussian {
    type Smooth = Self;
    const PAIR_NANOSECONDS: f64 = 2.8;
    const IS_SMOOTH: bool = true;
    const CORE_IN_SPACINGS: &'static [[f32; 2]] = GAUSSIAN_CORE_IN_SPACINGS;
    const MARGIN: f32 = 3.0;

    fn reach(core: f32, grid_core: f32, error: f32) -> f32 {
        gaussian_reach(core, grid_core, error)
    }
}

impl GridKernel for RosenheadMoore {
    type Smooth = Self;
    const PAIR_NANOSECONDS: f64 = 0.9;
    const IS_SMOOTH: bool = true;
    const CORE_IN_SPACINGS: &'static [[f32; 2]] = &[[0.1, 1.6], [0.03, 2.3], [0.01, 3.0], [3e-3, 4.2]];
    // At 6 cores the reflection is 1e-3 of the velocity.
    const MARGIN: f32 = 6.0;

    fn reach(core: f32, grid_core: f32, error: f32) -> f32 {
        let (low, high) = (core.min(grid_core), core.max(grid_core));
        // Inside the cores two kernels differ, no matter how soon they agree outside. The omitted difference
        // decays with the squared distance only, and has one sign: it is twice that of single cells of mixed
        // cores.
        if high - low < 0.1 * error * high {
            0.0
        } else {
            Self::min_gap(low, high, 0.5 * error).max(2.0 * high)
        }
    }
}

impl GridKernel for WinckelmansLeonard {
    type Smooth = Self;
    const PAIR_NANOSECONDS: f64 = 0.9;
    const IS_SMOOTH: bool = true;
    const CORE_IN_SPACINGS: &'static [[f32; 2]] =
        &[[0.1, 1.9], [0.03, 2.7], [0.01, 3.4], [3e-3, 4.3], [1e-3, 5.1], [3e-4, 6.3], [1e-4, 7.6]];
    const MARGIN: f32 = 3.0;

    fn reach(core: f32, grid_core: f32, error: f32) -> f32 {
        let (low, high) = (core.min(grid_core), core.max(grid_core));
        // Inside the cores two kernels differ, no matter how soon they agree outside.
        if high - low < 0.1 * error * high { 0.0 } else { Self::min_gap(low, high, error).max(2.0 * high) }
    }
}

impl SmoothKernel for Gaussian {
    fn transform(x: f64) -> f64 {
        exp(-x * x / 2.0)
    }
}

impl SmoothKernel for RosenheadMoore {
    fn transform(x: f64) -> f64 {
        x * bessel(1, x)
    }
}

impl SmoothKernel for WinckelmansLeonard {
    fn transform(x: f64) -> f64 {
        x * x / 2.0 * bessel(2, x)
    }
}

/// The modified Bessel function K_ν(x), x > 0.
fn bessel(order: u32, x: f64) -> f64 {
    const STEP: f64 = 0.1;
    let term = |i: u32| {
        let t = STEP * f64::from(i);
        exp(-x * cosh(t)) * cosh(f64::from(order) * t)
    };
    let mut sum = term(0) / 2.0;
    for i in 1..200 {
        let next = term(i);
        sum += next;
        // Past its peak the integrand falls faster than any power.
        if next < 1e-12 * sum && x * cosh(STEP * f64::from(i)) > f64::from(order) {
            break;
        }
    }
    STEP * sum
}

/// A table of ζ̂ over x.
#[derive(Clone, Debug)]
pub(super) struct TransformTable(Vec<f32>);

/// Entries per unit of x: linear interpolation between them has an error of 1e-5.
const ENTRIES_PER_UNIT: f32 = 100.0;

/// The end of the table. Beyond, ζ̂ of every kernel is below 1e-6.
const MAX_X: usize = 24;

impl TransformTable {
    pub(super) fn new<S: SmoothKernel>() -> Self {
        let x = |i: usize| i as f64 / f64::from(ENTRIES_PER_UNIT);
        let entry = |i: usize| if i == 0 { 1.0 } else { S::transform(x(i)) as f32 };
        Self((0..=MAX_X * ENTRIES_PER_UNIT as usize).map(entry).collect())
    }

    /// ζ̂(x).
    #[inline]
    pub(super) fn at(&self, x: f32) -> f32 {
        let t = x * ENTRIES_PER_UNIT;
        let i = t as usize;
        match self.0.get(i..i + 2) {
            Some(&[a, b]) => a + (t - i as f32) * (b - a),
            _ => 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    /// Checks ζ̂(x) = 4π ∫ ζ(r) sin(xr)/(xr) r² dr for the textbook's vorticity.
    fn check<S: SmoothKernel>(vorticity: fn(f64) -> f64) {
        let table = TransformTable::new::<S>();
        for x in [0.05, 0.4, 1.0, 2.7, 6.0] {
            // By Simpson's rule, to where the vorticity has decayed.
            let (last, n) = (60.0, 60_000);
            let f = |i: usize| {
                let r = last * i as f64 / n as f64;
                let wave = if r == 0.0 { 1.0 } else { (x * r).sin() / (x * r) };
                4.0 * PI * vorticity(r) * wave * r * r * if i % 2 == 1 { 4.0 } else { 2.0 }
            };
            let whole = (1..n).map(f).sum::<f64>() * last / n as f64 / 3.0;
            let found = S::transform(x);
            // The tail of the Rosenhead–Moore kernel beyond 60 cores is 4e-4 of the whole.
            assert!((found - whole).abs() < 5e-4, "{x}: {found} {whole}");
            assert!((f64::from(table.at(x as f32)) - found).abs() < 2e-5, "{x}");
        }
        assert!((table.at(0.003) - 1.0).abs() < 1e-4 && table.at(1e9) == 0.0);
    }

    #[test]
    fn transforms_match_integrals_of_the_vorticity() {
        check::<Gaussian>(|r| (2.0 * PI).powf(-1.5) * (-r * r / 2.0).exp());
        check::<RosenheadMoore>(|r| 3.0 / (4.0 * PI) * (r * r + 1.0).powf(-2.5));
        check::<WinckelmansLeonard>(|r| 15.0 / (8.0 * PI) * (r * r + 1.0).powf(-3.5));
    }
}
