//! Cartesian Taylor expansions of the kernel, and their translations: moments (multipole expansions) of
//! source cells, and local expansions of target cells.
//!
//! *Method*: [dehnen02], with vectors for masses and any kernel for 1/r. Sources at x_q = c_B + b, targets at
//! x = c_A + a, d = c_A − c_B, and D_γ = ∂^γ G(|d|):
//!
//! ```text
//! A(x) = Σ_β L_β a^β/β!      L_β = Σ_α D_(α+β) M_α      M_α = Σ_q Γ_q (−b)^α/α!
//! ```
//!
//! An expansion of order p keeps |α| + |β| ≤ p: its first omitted term is ((a − b)·∇)^(p+1) G, one order less
//! for the velocity. No coefficient uses that 1/r is harmonic, so the core is expanded too. The D follow from
//! the chain of the kernel (`kernels.rs`) by D_(α+e)⁽ⁿ⁾ = d_e D_α⁽ⁿ⁺¹⁾ + α_e D_(α−e)⁽ⁿ⁺¹⁾, D_0⁽ⁿ⁾ = Gₙ
//! [mcmurchie78].
//!
//! All coefficients are dimensionless, so that no power of a length overflows single precision: M_α is stored
//! over radius^|α| of its cell, L_β times unit^|β| of its own, and d, D for a distance of 1.
//!
//! The coefficients of a vector are x, y, z in sequence.

use super::{
    index::{ADD, MAX_COEFS, MAX_ORDER, STEPS, before, coefs},
    kernels::{Derivatives, RadialKernel},
};
use crate::simd::{LANES, Lanes, splat};

/// The length of an expansion of `order` in an array, padded to a multiple of eight.
pub(super) fn stride(order: usize) -> usize {
    (3 * coefs(order)).next_multiple_of(LANES)
}

/// Eight expansions, with padding.
pub(super) type Expansions<L> = [L; 3 * MAX_COEFS + LANES];

/// The derivatives D of eight pairs of cells, for two steps of the recurrence. An index is a `u8`, so that
/// none is bounds-checked.
pub(super) type CellDerivatives<L> = [[L; 256]; 2];

/// x^α/α! of every multi-index up to `order`.
#[inline(always)]
pub(super) fn monomials<L: Lanes>(x: [L; 3], order: usize, out: &mut [L; MAX_COEFS]) {
    out[0] = splat(1.0);
    for a in 1..coefs(order) {
        let step = STEPS[a];
        let factor = splat::<L>(1.0 / (f32::from(step.exponent) + 1.0));
        out[a] = (out[usize::from(step.parent)] * x[usize::from(step.axis)]) * factor;
    }
}

/// x^α/α! of every multi-index up to `order`, for one point.
fn monomials_of_one(x: [f32; 3], order: usize) -> [f32; MAX_COEFS] {
    let mut out = [1.0; MAX_COEFS];
    for a in 1..coefs(order) {
        let step = STEPS[a];
        out[a] = out[usize::from(step.parent)] * x[usize::from(step.axis)] / (f32::from(step.exponent) + 1.0);
    }
    out
}

/// Multipole-to-multipole translation (M2M): adds the moments of a child to those of its parent. `shift` is
/// the offset of the centre of the child, `ratio` its radius, both over the radius of the parent.
pub(super) fn add_moments_to_parent(
    child: &[f32],
    shift: [f32; 3],
    ratio: f32,
    order: usize,
    parent: &mut [f32],
) {
    let powers = monomials_of_one(shift.map(|t| -t), order);
    let mut scale = 1.0;
    for degree in 0..=order {
        for a in before(degree)..coefs(degree) {
            let m: [f32; 3] = std::array::from_fn(|k| child[3 * a + k] * scale);
            for (&place, power) in ADD[a].iter().zip(&powers).take(coefs(order - degree)) {
                let to = &mut parent[3 * usize::from(place)..][..3];
                for k in 0..3 {
                    to[k] += m[k] * power;
                }
            }
        }
        scale *= ratio;
    }
}

/// Local-to-local translation (L2L): writes the local expansion of a child from that of its parent. `shift`
/// is the offset of the centre of the child, `ratio` its unit, both over the unit of the parent.
pub(super) fn local_of_child(parent: &[f32], shift: [f32; 3], ratio: f32, order: usize, child: &mut [f32]) {
    let powers = monomials_of_one(shift, order);
    let mut scale = 1.0;
    for degree in 0..=order {
        for b in before(degree)..coefs(degree) {
            let mut sum = [0.0; 3];
            for (&place, power) in ADD[b].iter().zip(&powers).take(coefs(order - degree)) {
                let from = &parent[3 * usize::from(place)..][..3];
                for k in 0..3 {
                    sum[k] += from[k] * power;
                }
            }
            for k in 0..3 {
                child[3 * b + k] = sum[k] * scale;
            }
        }
        scale *= ratio;
    }
}

/// Eight source cells of one target cell.
pub(super) struct SourceCells<L> {
    /// The offset of the centre of the targets from theirs [m].
    pub(super) d: [L; 3],
    /// Squared cores [m²].
    pub(super) s2: L,
    /// Radii [m].
    pub(super) radius: L,
}

/// Multipole-to-local translation (M2L): adds eight source cells to a local expansion of `unit` [m], from
/// degree `from` on. `moments` is scaled in place. Every D_γ of |γ| ≤ `order` is computed once.
#[inline(always)]
pub(super) fn add_moments_to_local<L: Lanes, K: RadialKernel>(
    cells: &SourceCells<L>,
    moments: &mut Expansions<L>,
    unit: f32,
    order: usize,
    from: usize,
    derivatives: &mut CellDerivatives<L>,
    local: &mut Expansions<L>,
) {
    let d = cells.d;
    let inverse = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).inverse_sqrt();
    let d = [d[0] * inverse, d[1] * inverse, d[2] * inverse];
    derive::<L, K>(d, cells.s2 * (inverse * inverse), order, derivatives);

    // Moments in units of the distance.
    let ratio = cells.radius * inverse;
    let mut scale = ratio;
    for degree in 1..=order {
        for m in &mut moments[3 * before(degree)..3 * coefs(degree)] {
            *m = *m * scale;
        }
        scale = scale * ratio;
    }

    // L_β = Σ_α D_(α+β) M_α, for two β of a degree at once, which share the moments.
    let ratio = splat::<L>(unit) * inverse;
    let mut scale = if from == 0 { inverse } else { inverse * ratio };
    for degree in from..=order {
        let terms = coefs(order - degree);
        let moments = &moments[..3 * terms];
        let mut b = before(degree);
        while b + 1 < coefs(degree) {
            contract([&ADD[b], &ADD[b + 1]], moments, &derivatives[0], scale, &mut local[3 * b..]);
            b += 2;
        }
        if b < coefs(degree) {
            contract([&ADD[b]], moments, &derivatives[0], scale, &mut local[3 * b..]);
        }
        scale = scale * ratio;
    }
}

/// Adds `scale` Σ_α D_(α+β) M_α to `local`, for `N` consecutive β, whose sums with every α are in `add`.
#[inline(always)]
fn contract<L: Lanes, const N: usize>(
    add: [&[u8; MAX_COEFS]; N],
    moments: &[L],
    derivatives: &[L; 256],
    scale: L,
    local: &mut [L],
) {
    let mut sums = [[splat::<L>(0.0); 3]; N];
    let add = add.map(|add| &add[..moments.len() / 3]);
    for (a, m) in moments.chunks_exact(3).enumerate() {
        for n in 0..N {
            let d = derivatives[usize::from(add[n][a])];
            for k in 0..3 {
                sums[n][k] += m[k] * d;
            }
        }
    }
    for n in 0..N {
        for k in 0..3 {
            local[3 * n + k] += sums[n][k] * scale;
        }
    }
}

/// Writes every D_γ of |γ| ≤ `order` at `d`, of length 1, to the first of `derivatives`.
#[inline(always)]
fn derive<L: Lanes, K: RadialKernel>(d: [L; 3], s2: L, order: usize, derivatives: &mut CellDerivatives<L>) {
    let mut radial: Derivatives<L> = [splat(0.0); MAX_ORDER + 1];
    K::derivatives(splat(1.0), s2, order, &mut radial);
    let [even, odd] = derivatives;
    for n in (0..=order).rev() {
        let (now, last) = if n % 2 == 0 { (&mut *even, &*odd) } else { (&mut *odd, &*even) };
        now[0] = radial[n];
        for a in 1..coefs(order - n) {
            let step = STEPS[a];
            let mut value = d[usize::from(step.axis)] * last[usize::from(step.parent)];
            if step.exponent != 0 {
                value += splat::<L>(f32::from(step.exponent)) * last[usize::from(step.grandparent)];
            }
            now[a] = value;
        }
    }
}
