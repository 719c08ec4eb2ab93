//! The kernels, scaled so that the seeding lattice is at rest.
//!
//! *Method*: density by Poly6, gradients by Spiky, as [pbf] section 3 takes from [mcg03] (Eqs. 20–21).
//! *Departs from the paper*: the particle mass is calibrated so that C = 0 on the filled cubic lattice, instead
//! of being dropped; the softening ε is relative to Σ|∇C|² there, so that it keeps its meaning at any spacing.
//!
//! Symbols: h → `support` [m]; m W(0, h)/ρ₀ → `density_scale` [1]; m |∇W(0, h)|/ρ₀ → `gradient_scale` [1/m].
//! Everything is a function of q = r/h, so that no power of h leaves the range of single precision.

/// The calibrated kernels.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rest {
    /// Distance between particles at rest [m].
    pub(super) spacing: f32,
    /// Kernel support h [m].
    pub(super) support: f32,
    /// 1/h [1/m].
    pub(super) inv_support: f32,
    /// The share of ρ₀ that a particle contributes at its own centre.
    pub(super) density_scale: f32,
    /// |∇C| per particle at distance zero [1/m].
    pub(super) gradient_scale: f32,
    /// Σ_k |∇_k C|² on the filled lattice [1/m²].
    pub(super) lattice_gradient2: f32,
    /// What to add to a distance before asking for the solid's share, so that the first layer, half a
    /// spacing from a wall, is at rest [m].
    pub(super) wall_shift: f32,
}

impl Rest {
    /// Calibrates on the cubic lattice of `spacing` [m] with a support of `radius` spacings.
    pub(super) fn new(spacing: f32, radius: f32) -> Self {
        let (mut full, mut half, mut gradient2) = (0.0, 0.0, 0.0);
        let reach = radius.ceil() as i32;
        for z in -reach..=reach {
            for (y, x) in (-reach..=reach).flat_map(|y| (-reach..=reach).map(move |x| (y, x))) {
                let q = f64::from(x * x + y * y + z * z).sqrt() / f64::from(radius);
                if q < 1.0 {
                    full += poly6(q);
                    half += if z >= 0 { poly6(q) } else { 0.0 };
                    gradient2 += if q > 0.0 { (1.0 - q).powi(4) } else { 0.0 };
                }
            }
        }
        // The unnormalised kernels at the centre are 1; Spiky's gradient there is 45·64/315 of Poly6's value over h.
        let h = f64::from(spacing) * f64::from(radius);
        let density_scale = 1.0 / full;
        let gradient_scale = density_scale * 64.0 / 7.0 / h;
        Self {
            spacing,
            support: h as f32,
            inv_support: (1.0 / h) as f32,
            density_scale: density_scale as f32,
            gradient_scale: gradient_scale as f32,
            lattice_gradient2: (gradient_scale * gradient_scale * gradient2) as f32,
            wall_shift: (wall_shift(1.0 - half / full, 0.5 / f64::from(radius)) * h) as f32,
        }
    }
}

/// Poly6 over its value at the centre.
fn poly6(q: f64) -> f64 {
    (1.0 - q * q).max(0.0).powi(3) // [mcg03] Eq. 20
}

/// What to add to q so that the planar solid's share there is `deficit`, by bisection.
fn wall_shift(deficit: f64, q: f64) -> f64 {
    let (mut low, mut high) = (-1.0, 1.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if f64::from(solid_share(middle as f32)) > deficit {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high) - q
}

/// The share of ρ₀ that a planar solid contributes at distance q·h: Poly6 integrated over the solid.
pub(super) fn solid_share(q: f32) -> f32 {
    let a = q.abs().min(1.0);
    let a2 = a * a;
    let odd = a * (1.0 + a2 * (-4.0 / 3.0 + a2 * (6.0 / 5.0 + a2 * (-4.0 / 7.0 + a2 / 9.0))));
    let share = (315.0 / 256.0 * (128.0 / 315.0 - odd)).max(0.0);
    if q < 0.0 { 1.0 - share } else { share }
}

/// h times the slope with which the planar solid's share falls off: Spiky's gradient integrated over the solid.
pub(super) fn solid_slope(q: f32) -> f32 {
    let a = q.abs().min(1.0);
    45.0 * (1.0 / 30.0 + a * a * (-1.0 / 3.0 + a * (2.0 / 3.0 + a * (-0.5 + a * (2.0 / 15.0))))).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::{
        Vec3,
        kernel::{Poly6, SpikyGradient},
    };

    #[test]
    fn scales_agree_with_the_kernels_they_stand_for() {
        for (spacing, radius) in [(0.02, 2.0), (1.0, 2.6), (1e-3, 1.7)] {
            let rest = Rest::new(spacing, radius);
            let mass = rest.density_scale / Poly6::new(rest.support).value(0.0);
            let volume = spacing.powi(3);
            assert!((mass / volume - 1.0).abs() < 0.06, "mass {mass} of {volume}");
            let near = Vec3::new(rest.support * 1e-3, 0.0, 0.0);
            let slope = mass * SpikyGradient::new(rest.support).value(near).norm();
            assert!((slope / (rest.gradient_scale * 0.999_f32.powi(2)) - 1.0).abs() < 1e-4);
        }
    }

    #[test]
    fn the_first_layer_at_a_wall_is_at_rest_and_the_others_nearly() {
        for (radius, bound) in [(1.6_f32, 1e-3), (2.0, 3e-3), (2.5, 0.012), (3.0, 0.01)] {
            let rest = Rest::new(1.0, radius);
            for layer in 0..3_i32 {
                let mut c = -1.0;
                for z in -layer..=4 {
                    for (y, x) in (-4..=4).flat_map(|y| (-4..=4).map(move |x| (y, x))) {
                        let q = f64::from(x * x + y * y + z * z).sqrt() / f64::from(radius);
                        c += rest.density_scale * poly6(q) as f32;
                    }
                }
                c += solid_share((layer as f32 + 0.5 + rest.wall_shift) / radius);
                let allowed = if layer == 0 { 1e-4 } else { bound };
                assert!(c.abs() < allowed, "radius {radius}, layer {layer}: C = {c}");
            }
        }
    }

    #[test]
    fn the_solid_fills_half_of_a_point_on_its_surface() {
        assert!((solid_share(0.0) - 0.5).abs() < 1e-6 && solid_share(1.0) < 1e-6);
        assert!((solid_share(-1.0) - 1.0).abs() < 1e-6 && solid_slope(1.0) < 1e-5);
        assert!((solid_slope(0.0) - 1.5).abs() < 1e-6);
    }
}
