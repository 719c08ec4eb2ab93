//! The kernels as the lattice knows them: the transform of their vorticity, and how far two cores differ.
//!
//! *Method*: a kernel's vorticity ζ has a transform ζ̂ of x = kσ alone. Rosenhead and Moore's potential is that of
//! (r² + σ²)^-½, whose transform has Bessel's K₁: ζ̂ = x K₁(x). Winckelmans and Leonard's adds ½σ² (r² + σ²)^-3/2, hence
//! ζ̂ = x K₁ + ½x² K₀ = ½x² K₂(x). The Gaussian has e^(−x²/2). K_ν(x) = ∫ e^(−x cosh t) cosh νt dt over t > 0, by trapezoids
//! [abramowitz72] 9.6.24.

use crate::sim::vortex::chain::{Ball, Chain, Gaussian, RosenheadMoore, WinckelmansLeonard};

/// A kernel, and the one whose vorticity a lattice carries for it.
pub(in crate::sim::vortex) trait Spread: Chain {
    /// What is left to pairs is the difference to this kernel. A ball's transform falls too slowly for a lattice.
    type Smooth: Smooth;

    /// How far the difference of two velocities has to be summed [m] for an `error`: that of this kernel of core `core` and
    /// of [`Spread::Smooth`] of core `smooth` [m].
    fn reach(core: f32, smooth: f32, error: f32) -> f32;

    /// Nanoseconds of the difference of a pair, as the choice of a lattice weighs them.
    const PAIR: f64;

    /// Whether a lattice carries the kernel itself.
    const ITSELF: bool;

    /// Errors of the velocity, falling, and cores per spacing at which the lattice keeps them. Set by the worst of the four
    /// clouds of `benches/vortex.rs`, which is the one of dense blobs; a ring of even strengths misses a tenth of that. Fewer
    /// miss what is asked for, more cost their third power.
    const RATIOS: &'static [[f32; 2]];

    /// Cores from the vortons to the boundary. What a kernel spreads beyond it is reflected there.
    const ROOM: f32;
}

/// Of the Gaussian, which falls faster than the others, so that a lattice of its own spacing carries it.
const GAUSSIAN: &[[f32; 2]] =
    &[[0.1, 1.0], [0.03, 1.1], [0.01, 1.4], [3e-3, 1.8], [1e-3, 2.2], [3e-4, 2.8], [1e-4, 3.6]];

/// A kernel with a smooth vorticity.
pub(in crate::sim::vortex) trait Smooth: Chain {
    /// ζ̂(x).
    fn transform(x: f64) -> f64;
}

/// Beyond this many cores, of the larger, two Gaussians or a ball and a Gaussian differ by less than `error`.
fn gaussian_reach(core: f32, smooth: f32, error: f32) -> f32 {
    core.max(smooth) * ((-2.0 * error.ln()).sqrt() + 0.5)
}

impl Spread for Ball {
    type Smooth = Gaussian;
    const PAIR: f64 = 1.9;
    const ITSELF: bool = false;
    const RATIOS: &'static [[f32; 2]] = GAUSSIAN;
    const ROOM: f32 = 3.0;

    fn reach(core: f32, smooth: f32, error: f32) -> f32 {
        core.max(gaussian_reach(0.0, smooth, error))
    }
}

impl Spread for Gaussian {
    type Smooth = Self;
    const PAIR: f64 = 2.8;
    const ITSELF: bool = true;
    const RATIOS: &'static [[f32; 2]] = GAUSSIAN;
    const ROOM: f32 = 3.0;

    fn reach(core: f32, smooth: f32, error: f32) -> f32 {
        gaussian_reach(core, smooth, error)
    }
}

impl Spread for RosenheadMoore {
    type Smooth = Self;
    const PAIR: f64 = 0.9;
    const ITSELF: bool = true;
    const RATIOS: &'static [[f32; 2]] = &[[0.1, 1.6], [0.03, 2.3], [0.01, 3.0], [3e-3, 4.2]];
    // At 6 cores what is reflected leaves 1e-3 of the velocity.
    const ROOM: f32 = 6.0;

    fn reach(core: f32, smooth: f32, error: f32) -> f32 {
        let (low, high) = (core.min(smooth), core.max(smooth));
        // Inside the cores two kernels differ however slowly they come to agree outside.
        // What is left out falls as slowly as the squared distance, and has one sign: twice what single cells of mixed cores leave.
        if high - low < 0.1 * error * high { 0.0 } else { Self::gap(low, high, 0.5 * error).max(2.0 * high) }
    }
}

impl Spread for WinckelmansLeonard {
    type Smooth = Self;
    const PAIR: f64 = 0.9;
    const ITSELF: bool = true;
    const RATIOS: &'static [[f32; 2]] =
        &[[0.1, 1.9], [0.03, 2.7], [0.01, 3.4], [3e-3, 4.3], [1e-3, 5.1], [3e-4, 6.3], [1e-4, 7.6]];
    const ROOM: f32 = 3.0;

    fn reach(core: f32, smooth: f32, error: f32) -> f32 {
        let (low, high) = (core.min(smooth), core.max(smooth));
        // Inside the cores two kernels differ however slowly they come to agree outside.
        if high - low < 0.1 * error * high { 0.0 } else { Self::gap(low, high, error).max(2.0 * high) }
    }
}

impl Smooth for Gaussian {
    fn transform(x: f64) -> f64 {
        (-x * x / 2.0).exp()
    }
}

impl Smooth for RosenheadMoore {
    fn transform(x: f64) -> f64 {
        x * bessel(1, x)
    }
}

impl Smooth for WinckelmansLeonard {
    fn transform(x: f64) -> f64 {
        x * x / 2.0 * bessel(2, x)
    }
}

/// K_ν(x), x > 0.
fn bessel(order: u32, x: f64) -> f64 {
    const STEP: f64 = 0.1;
    let term = |i: u32| {
        let t = STEP * f64::from(i);
        (-x * t.cosh()).exp() * (f64::from(order) * t).cosh()
    };
    let mut sum = term(0) / 2.0;
    for i in 1..200 {
        let next = term(i);
        sum += next;
        // Past its peak the integrand falls faster than any power.
        if next < 1e-12 * sum && x * (STEP * f64::from(i)).cosh() > f64::from(order) {
            break;
        }
    }
    STEP * sum
}

/// ζ̂ by a table over x.
#[derive(Clone, Debug)]
pub(super) struct Table(Vec<f32>);

/// Entries per unit of x: their straight connections miss 1e-5.
const FINE: f32 = 100.0;

/// Beyond, ζ̂ is below 1e-6 of every kernel.
const LAST: usize = 24;

impl Table {
    pub(super) fn new<S: Smooth>() -> Self {
        let entry = |i: usize| if i == 0 { 1.0 } else { S::transform(i as f64 / f64::from(FINE)) as f32 };
        Self((0..=LAST * FINE as usize).map(entry).collect())
    }

    /// ζ̂(x).
    #[inline]
    pub(super) fn at(&self, x: f32) -> f32 {
        let t = x * FINE;
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

    /// ζ̂(x) = 4π ∫ ζ(r) sin(xr)/(xr) r² dr, against the vorticity as books have it.
    fn check<S: Smooth>(vorticity: fn(f64) -> f64) {
        let table = Table::new::<S>();
        for x in [0.05, 0.4, 1.0, 2.7, 6.0] {
            // By Simpson's rule, until the vorticity has faded.
            let (last, n) = (60.0, 60_000);
            let f = |i: usize| {
                let r = last * i as f64 / n as f64;
                let wave = if r == 0.0 { 1.0 } else { (x * r).sin() / (x * r) };
                4.0 * PI * vorticity(r) * wave * r * r * if i % 2 == 1 { 4.0 } else { 2.0 }
            };
            let whole = (1..n).map(f).sum::<f64>() * last / n as f64 / 3.0;
            let found = S::transform(x);
            // Rosenhead and Moore's tail beyond 60 cores holds 4e-4 of the whole.
            assert!((found - whole).abs() < 5e-4, "{x}: {found} {whole}");
            assert!((f64::from(table.at(x as f32)) - found).abs() < 2e-5, "{x}");
        }
        assert!((table.at(0.003) - 1.0).abs() < 1e-4 && table.at(1e9) == 0.0);
    }

    #[test]
    fn transforms_are_those_of_the_vorticity() {
        check::<Gaussian>(|r| (2.0 * PI).powf(-1.5) * (-r * r / 2.0).exp());
        check::<RosenheadMoore>(|r| 3.0 / (4.0 * PI) * (r * r + 1.0).powf(-2.5));
        check::<WinckelmansLeonard>(|r| 15.0 / (8.0 * PI) * (r * r + 1.0).powf(-3.5));
    }
}
