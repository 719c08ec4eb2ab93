//! Calibration of the kernels, so that the seeding lattice is at rest density.
//!
//! *Method*: the pairs of `pair.rs`, and their integrals over a half space in closed form.
//! *Departs from the paper*: the particle mass is calibrated so that C = 0 on the filled seeding lattice, instead of being
//! dropped. The softening ε is relative to Σ|∇C|² there, so that its meaning does not depend on the spacing.
//!
//! Symbols: h → `support` [m]; m W(0, h)/ρ₀ → `density_scale` [1]; m |∇W(0, h)|/ρ₀ → `gradient_scale` [1/m].
//! Everything is a function of q = r/h, so that no power of h leaves the range of single precision.

use super::Kernel;

/// Kernels calibrated for the rest state.
#[derive(Clone, Copy, Debug)]
pub(super) struct RestState {
    /// The kernel pair.
    pub(super) kernel: Kernel,
    /// Distance between particles at rest [m].
    pub(super) spacing: f32,
    /// Kernel support h [m].
    pub(super) support: f32,
    /// 1/h [1/m].
    pub(super) inv_support: f32,
    /// Density that a particle contributes at its own centre, over ρ₀.
    pub(super) density_scale: f32,
    /// Factor from slopes times offsets over h to ∇C [1/m].
    pub(super) gradient_scale: f32,
    /// Σ_k |∇_k C|² on the filled seeding lattice [1/m²].
    pub(super) rest_gradient2: f32,
    /// Offset of the distance to a solid in its density, so that the first layer of particles, half a spacing from a wall,
    /// is at rest density [m].
    pub(super) wall_shift: f32,
    /// Density that the outermost layer of the seeding lattice lacks at a flat free surface, over ρ₀.
    pub(super) surface_deficit: f32,
    /// 1 over the deficit, or density of solids, from which a particle bears no tension [1].
    pub(super) inv_tension_free: f32,
    /// Factor from |∇_i C_i|² to the density that a particle lacks, until that is [`Self::surface_deficit`] [m²].
    pub(super) surface_deficit_scale: f32,
}

/// Density that a particle lacks at the free surface, or has from solids, over the former at a flat surface, from which it bears no
/// tension: surface particles do not pair, and liquid does not stick to solids.
const TENSION_FREE_RATIO: f64 = 0.3;

/// |∇_i C_i|² from which the deficit is that of a flat surface, over that of the outermost layer of the seeding lattice. The
/// deficit's own gradient is not part of the corrections, which therefore do work when it changes. With a constant deficit
/// about a flat surface, water at rest calms down; where the deficit grows up to 1.5 times that of a flat surface, the
/// topmost layer of a pool jitters at 5 cm/s forever. Edges and corners of a block lack more (1.9 and 2.7 times), and
/// round off by a fraction of a spacing.
const FLAT_SURFACE_GRADIENT2: f64 = 0.7;

/// Layers and distances over h of a particle of the filled seeding lattice and of its neighbours, with h of `radius` spacings.
pub(super) fn seeding_neighbours(radius: f64) -> impl Iterator<Item = (i32, f64)> {
    let reach = radius.ceil() as i32;
    let side = move || -reach..=reach;
    let all = side().flat_map(move |z| side().flat_map(move |y| side().map(move |x| [x, y, z])));
    all.map(move |[x, y, z]| (z, f64::from(x * x + y * y + z * z).sqrt() / radius)).filter(|&(_, q)| q < 1.0)
}

impl RestState {
    /// Calibrates on the seeding lattice of `spacing` [m], with a support of `radius` spacings.
    pub(super) fn new(kernel: Kernel, spacing: f32, radius: f32) -> Self {
        let (mut full, mut half, mut gradient2, mut surface_gradient) = (0.0, 0.0, 0.0, 0.0);
        for (z, q) in seeding_neighbours(f64::from(radius)) {
            full += kernel.density(q);
            half += if z >= 0 { kernel.density(q) } else { 0.0 };
            surface_gradient += if z > 0 { kernel.slope(q) * f64::from(z) / f64::from(radius) } else { 0.0 };
            gradient2 += if q > 0.0 { (kernel.slope(q) * q).powi(2) } else { 0.0 };
        }
        let h = f64::from(spacing) * f64::from(radius);
        let density_scale = 1.0 / full;
        let gradient_scale = density_scale * kernel.gradient_per_density() / h;
        let surface_deficit = 1.0 - half / full;
        let mut rest = Self {
            kernel,
            spacing,
            support: h as f32,
            inv_support: (1.0 / h) as f32,
            density_scale: density_scale as f32,
            gradient_scale: gradient_scale as f32,
            rest_gradient2: (gradient_scale * gradient_scale * gradient2) as f32,
            wall_shift: 0.0,
            surface_deficit: surface_deficit as f32,
            inv_tension_free: (1.0 / (TENSION_FREE_RATIO * surface_deficit)) as f32,
            surface_deficit_scale: (surface_deficit
                / (FLAT_SURFACE_GRADIENT2 * (gradient_scale * surface_gradient).powi(2)))
                as f32,
        };
        rest.wall_shift = (rest.shift_for(surface_deficit, 0.5 / f64::from(radius)) * h) as f32;
        rest
    }

    /// Offset of q with which the density of a half space is `deficit`, by bisection.
    fn shift_for(&self, deficit: f64, q: f64) -> f64 {
        let (mut low, mut high) = (-1.0, 1.0);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if f64::from(self.half_space_density(middle as f32)) > deficit {
                low = middle;
            } else {
                high = middle;
            }
        }
        0.5 * (low + high) - q
    }

    /// Density that a half space contributes at distance q·h, over ρ₀: the integral of W over the half space.
    pub(super) fn half_space_density(&self, q: f32) -> f32 {
        let a = q.abs().min(1.0);
        let a2 = a * a;
        let odd = match self.kernel {
            Kernel::Poly6Spiky => {
                315.0 / 256.0
                    * a
                    * (1.0 + a2 * (-4.0 / 3.0 + a2 * (6.0 / 5.0 + a2 * (-4.0 / 7.0 + a2 / 9.0))))
            }
            Kernel::Wendland => a * (1.5 + a2 * (-3.5 + a2 * (10.5 + a * (-14.0 + a * (7.5 + a * -1.5))))),
        };
        let share = (0.5 - odd).max(0.0);
        if q < 0.0 { 1.0 - share } else { share }
    }

    /// Slope with which the density of a half space decreases, times h: the integral of the gradient over the half space.
    pub(super) fn half_space_slope(&self, q: f32) -> f32 {
        let a = q.abs().min(1.0);
        let a2 = a * a;
        match self.kernel {
            Kernel::Poly6Spiky => {
                45.0 * (1.0 / 30.0 + a2 * (-1.0 / 3.0 + a * (2.0 / 3.0 + a * (-0.5 + a * (2.0 / 15.0)))))
            }
            Kernel::Wendland => 1.5 + a2 * (-10.5 + a2 * (52.5 + a * (-84.0 + a * (52.5 + a * -12.0)))),
        }
        .max(0.0)
    }
}

impl Kernel {
    /// W over its value at the centre; [`Pair::density`](super::pair::Pair::density) in double precision.
    pub(super) fn density(self, q: f64) -> f64 {
        match self {
            Self::Poly6Spiky => (1.0 - q * q).powi(3),
            Self::Wendland => (1.0 - q).powi(4) * (1.0 + 4.0 * q),
        }
    }

    /// Slope of the kernel; [`Pair::slope`](super::pair::Pair::slope) in double precision.
    pub(super) fn slope(self, q: f64) -> f64 {
        match self {
            Self::Poly6Spiky => (1.0 - q).powi(2) / q,
            Self::Wendland => (1.0 - q).powi(3),
        }
    }

    /// Gradient, times h, for a slope of 1 and a density of 1 at the centre: the ratio of the normalised kernels.
    fn gradient_per_density(self) -> f64 {
        match self {
            // Spiky's 45/π over Poly6's 315/64π.
            Self::Poly6Spiky => 64.0 / 7.0,
            // d/dq of (1 − q)⁴ (1 + 4q) is −20 q (1 − q)³.
            Self::Wendland => 20.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f32::consts::PI;

    const KERNELS: [Kernel; 2] = [Kernel::Poly6Spiky, Kernel::Wendland];

    #[test]
    fn scales_agree_with_the_kernels() {
        for (spacing, radius) in [(0.02_f32, 2.0), (1.0, 2.6), (1e-3, 1.7)] {
            let rest = RestState::new(Kernel::Poly6Spiky, spacing, radius);
            // Poly6 at the centre, [mcg03] Eq. 20, and the slope of Spiky next to it, Eq. 21.
            let mass = rest.density_scale * (64.0 * PI * rest.support.powi(3)) / 315.0;
            let volume = spacing.powi(3);
            assert!((mass / volume - 1.0).abs() < 0.06, "mass {mass} of {volume}");
            let slope = mass * 45.0 / (PI * rest.support.powi(6)) * (0.999 * rest.support).powi(2);
            assert!((slope / (rest.gradient_scale * 0.999_f32.powi(2)) - 1.0).abs() < 1e-4);
        }
    }

    #[test]
    fn wendlands_slope_is_that_of_its_density() {
        let (density, slope) = (|q| Kernel::Wendland.density(q), |q| Kernel::Wendland.slope(q));
        for q in [0.05, 0.3, 0.7, 0.95] {
            let difference = (density(q + 1e-6) - density(q - 1e-6)) / 2e-6;
            let expected = -Kernel::Wendland.gradient_per_density() * q * slope(q);
            assert!((difference / expected - 1.0).abs() < 1e-6, "{q}: {difference}, expected {expected}");
        }
    }

    #[test]
    fn half_spaces_are_the_kernels_integrals() {
        for kernel in KERNELS {
            let rest = RestState::new(kernel, 1.0, 2.0);
            // W over the plane at distance z, and over all of space: midpoint sums of 2πr W dr.
            let steps = 400;
            let at = |k: i32| (f64::from(k) + 0.5) / f64::from(steps);
            let plane = |z: f64| -> f64 {
                (0..steps)
                    .map(at)
                    .filter(|r| r * r + z * z < 1.0)
                    .map(|r| 2.0 * std::f64::consts::PI * r * kernel.density((r * r + z * z).sqrt()))
                    .sum::<f64>()
                    / f64::from(steps)
            };
            let beyond =
                |q: f64| (0..steps).map(at).filter(|&z| z > q).map(plane).sum::<f64>() / f64::from(steps);
            let whole = 2.0 * beyond(0.0);
            for q in [0.1, 0.25, 0.5, 0.8] {
                let share = f64::from(rest.half_space_density(q as f32));
                assert!((share - beyond(q) / whole).abs() < 4e-3, "{kernel:?} at {q}: {share}");
            }
            // The slope is that of the gradient kernel; Wendland's gradient is the derivative of its density.
            if kernel == Kernel::Wendland {
                let slope = (rest.half_space_density(0.401) - rest.half_space_density(0.399)) / -0.002;
                assert!((slope / rest.half_space_slope(0.4) - 1.0).abs() < 1e-3, "{slope}");
            }
        }
    }

    #[test]
    fn the_first_layer_at_a_wall_is_at_rest_and_the_others_nearly() {
        for (kernel, radius, bound) in [
            (Kernel::Poly6Spiky, 1.6_f32, 1e-3),
            (Kernel::Poly6Spiky, 2.0, 3e-3),
            (Kernel::Poly6Spiky, 2.5, 0.012),
            (Kernel::Poly6Spiky, 3.0, 0.01),
            (Kernel::Wendland, 1.6, 3e-3),
            (Kernel::Wendland, 2.0, 3e-3),
            (Kernel::Wendland, 2.5, 0.012),
            (Kernel::Wendland, 3.0, 0.01),
        ] {
            let rest = RestState::new(kernel, 1.0, radius);
            for layer in 0..3_i32 {
                let mut c = -1.0;
                for z in -layer..=4 {
                    for (y, x) in (-4..=4).flat_map(|y| (-4..=4).map(move |x| (y, x))) {
                        let q = f64::from(x * x + y * y + z * z).sqrt() / f64::from(radius);
                        c += rest.density_scale * kernel.density(q.min(1.0)) as f32;
                    }
                }
                c += rest.half_space_density((layer as f32 + 0.5 + rest.wall_shift) / radius);
                let allowed = if layer == 0 { 1e-4 } else { bound };
                assert!(c.abs() < allowed, "{kernel:?}, radius {radius}, layer {layer}: C = {c}");
            }
        }
    }

    #[test]
    fn a_half_space_contributes_half_the_density_on_its_surface() {
        for kernel in KERNELS {
            let rest = RestState::new(kernel, 1.0, 2.0);
            let (share, slope) = (|q| rest.half_space_density(q), |q| rest.half_space_slope(q));
            assert!((share(0.0) - 0.5).abs() < 1e-6 && share(1.0) < 1e-6);
            assert!((share(-1.0) - 1.0).abs() < 1e-6 && slope(1.0) < 1e-5);
            assert!((slope(0.0) - 1.5).abs() < 1e-6);
        }
    }
}
