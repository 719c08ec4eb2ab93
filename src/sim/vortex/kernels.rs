//! The kernels and their radial derivatives, which sums over pairs and expansions need.
//!
//! *Method*: with the chain G₀ = G, Gₙ₊₁ = Gₙ′/r, every derivative of G(|d|) is a polynomial in d over the
//! chain. Sums over pairs need K = −G₁ and H = −G₂; an expansion of order p needs p derivatives. For a point
//! Tₙ₊₁ = −(2n + 1) Tₙ/r², and for a core the same with r² + σ². The Winckelmans–Leonard kernel is T₀ + ½σ²
//! T₀³, whose chain is Tₙ − ½σ² Tₙ₊₁. The Gaussian's chain consists of Boys functions: Gₙ = (−1)ⁿ √(2/π)
//! σ^-(2n+1) Fₙ(ρ²/2), Fₙ(x) = ∫₀¹ t²ⁿ e^(−xt²) dt.

use super::index::MAX_ORDER;
use crate::math::elementary::powf;
use crate::simd::{Lanes, splat};

/// The radial derivatives Gₙ of a kernel, up to the highest order.
pub(super) type Derivatives<L> = [L; MAX_ORDER + 1];

/// A kernel as a function of the distance.
pub(super) trait RadialKernel: Copy + Send + Sync + 'static {
    /// Writes Gₙ of 0..=`order` at squared distances `r2` and squared cores `s2`.
    fn derivatives<L: Lanes>(r2: L, s2: L, order: usize, out: &mut Derivatives<L>);

    /// The power m of σ in the leading effect of the core at a distance. Vortons of different cores in a cell
    /// count as one with the mean σᵐ.
    const CORE_POWER: i32;

    /// The smallest distance from the vortons of a cell at which its expansion is valid [m], if their cores
    /// are between `low` and `high` [m], for an `error` of the velocity.
    fn min_gap(low: f32, high: f32, error: f32) -> f32;
}

/// The gap of smooth kernels: only the deviation of cores from their mean is omitted, which is `c` (σᵐ −
/// σ̄ᵐ)/rᵐ of the velocity.
fn gap_of_uneven_cores(c: f32, power: i32, low: f32, high: f32, error: f32) -> f32 {
    let ratio = low / high;
    high * powf((1.0 - ratio.powi(power)) * c / error, 1.0 / power as f32)
}

/// The kernel [`Kernel::RosenheadMoore`](super::Kernel::RosenheadMoore).
#[derive(Clone, Copy)]
pub(super) struct RosenheadMoore;

impl RadialKernel for RosenheadMoore {
    const CORE_POWER: i32 = 2;

    #[inline(always)]
    fn derivatives<L: Lanes>(r2: L, s2: L, order: usize, out: &mut Derivatives<L>) {
        point((r2 + s2).inverse_sqrt(), order, out);
    }

    fn min_gap(low: f32, high: f32, error: f32) -> f32 {
        gap_of_uneven_cores(0.05, Self::CORE_POWER, low, high, error)
    }
}

/// The chain of a point: Tₙ = (−1)ⁿ (2n − 1)!! s^(2n+1).
#[inline(always)]
fn point<L: Lanes>(s: L, order: usize, out: &mut Derivatives<L>) {
    let s2 = s * s;
    out[0] = s;
    for n in 0..order {
        out[n + 1] = splat::<L>(-((2 * n + 1) as f32)) * (s2 * out[n]);
    }
}

/// The kernel [`Kernel::WinckelmansLeonard`](super::Kernel::WinckelmansLeonard).
#[derive(Clone, Copy)]
pub(super) struct WinckelmansLeonard;

impl RadialKernel for WinckelmansLeonard {
    const CORE_POWER: i32 = 4;

    #[inline(always)]
    fn derivatives<L: Lanes>(r2: L, s2: L, order: usize, out: &mut Derivatives<L>) {
        let s = (r2 + s2).inverse_sqrt();
        let h = s2 * (s * s);
        point(s, order, out);
        for (n, g) in out.iter_mut().enumerate().take(order + 1) {
            // Tₙ − ½σ² Tₙ₊₁ = Tₙ (1 + (n + ½) σ² s²).
            *g = *g * (splat::<L>(1.0) + splat::<L>(n as f32 + 0.5) * h);
        }
    }

    fn min_gap(low: f32, high: f32, error: f32) -> f32 {
        gap_of_uneven_cores(0.3, Self::CORE_POWER, low, high, error)
    }
}

/// The kernel [`Kernel::Ball`](super::Kernel::Ball).
#[derive(Clone, Copy)]
pub(super) struct Ball;

impl RadialKernel for Ball {
    const CORE_POWER: i32 = 2;

    #[inline(always)]
    fn derivatives<L: Lanes>(r2: L, s2: L, order: usize, out: &mut Derivatives<L>) {
        let s = L::select(r2.less(s2), s2, r2).inverse_sqrt();
        let zero = splat::<L>(0.0);
        point(s, order, out);
        for (n, g) in out.iter_mut().enumerate().take(order + 1) {
            let inside = match n {
                0 => s * (splat::<L>(1.5) - splat::<L>(0.5) * (r2 * (s * s))),
                1 => -(s * (s * s)),
                _ => zero,
            };
            *g = L::select(r2.less(s2), inside, *g);
        }
    }

    /// Outside its core a ball is equivalent to a point.
    fn min_gap(_: f32, high: f32, _: f32) -> f32 {
        high
    }
}

/// The kernel [`Kernel::Gaussian`](super::Kernel::Gaussian).
#[derive(Clone, Copy)]
pub(super) struct Gaussian;

/// √(2/π).
const ROOT: f32 = 0.797_884_6;

impl RadialKernel for Gaussian {
    const CORE_POWER: i32 = 2;

    #[inline(always)]
    fn derivatives<L: Lanes>(r2: L, s2: L, order: usize, out: &mut Derivatives<L>) {
        let one = splat::<L>(1.0);
        let is = s2.inverse_sqrt();
        let is2 = is * is;
        let rho2 = r2 * is2;
        let e = (splat::<L>(-0.5) * rho2).exp();

        // For ρ < 1: the series of the highest function, and downward recurrence.
        let twice = L::select(rho2.less(one), rho2, one);
        let mut boys = splat::<L>(0.0);
        for k in (0..7).rev() {
            boys = (one + twice * boys) * splat::<L>(1.0 / (2 * order + 2 * k + 1) as f32);
        }
        let mut boys = boys * e;
        let mut near = [splat::<L>(0.0); MAX_ORDER + 1];
        for n in (0..=order).rev() {
            near[n] = boys;
            if n > 0 {
                boys = (twice * boys + e) * splat::<L>(1.0 / (2 * n - 1) as f32);
            }
        }

        // For ρ ≥ 1: upward recurrence from the error function, [abramowitz72] 7.1.26, to 1.5e-7.
        let far = L::select(r2.less(s2), s2, r2);
        let i = far.inverse_sqrt();
        let rho = (far * i) * is;
        let t = one / (one + splat::<L>(0.327_591_1 * std::f32::consts::FRAC_1_SQRT_2) * rho);
        let mut p = splat::<L>(1.061_405_4);
        for c in [-1.453_152, 1.421_413_7, -0.284_496_74, 0.254_829_6] {
            p = p * t + splat::<L>(c);
        }
        let mut g = (one - (p * t) * e) * i;
        let mut scale = splat::<L>(ROOT) * is;
        // Its own recurrence, because the scale overflows where e^(−ρ²/2) is 0.
        let mut tail = scale * e;
        for n in 0..=order {
            out[n] = L::select(r2.less(s2), scale * near[n], g);
            // Gₙ₊₁ = −[(2n + 1) Gₙ − (−1)ⁿ √(2/π) σ^-(2n+1) e^(−ρ²/2)]/r².
            g = -(splat::<L>((2 * n + 1) as f32) * g - tail) * (i * i);
            (scale, tail) = (-(scale * is2), -(tail * is2));
        }
    }

    /// Below three cores derivatives of high order cancel. Where cores differ, the difference has to have
    /// decayed.
    fn min_gap(low: f32, high: f32, _: f32) -> f32 {
        if low == high { 3.0 * high } else { 5.0 * high }
    }
}
