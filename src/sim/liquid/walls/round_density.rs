//! Density that round solids contribute to the liquid near them.
//!
//! *Method*: the part of a ball in a spherical shell around the particle is a cap, so that the integral of a kernel over a ball
//! is one of polynomials over the shells. A curved surface contributes what a ball of the same mean curvature does: exact for
//! spheres, and to first order in the support times the curvature for every surface.
//! *Departs from the paper*: none is followed.
//!
//! Symbols, in units of h: d distance to the surface; κ mean curvature; D = (1 + κd)/κ distance to the ball's centre; r radius of
//! a shell.
//! Limits: cylinders are off by at most 0.004 of rest density down to a radius of h/2, and by 0.01 at h/4. Where the curvature
//! changes within h, as on the tips of ellipsoids, the value at the nearest point counts. Hollow sides are taken as flat.

use super::Walls;
use crate::{math::Vec3, sim::liquid::Kernel, solid::Shape};
use std::f64::consts::TAU;

/// A radial kernel with its value 1 at the centre.
struct RadialKernel {
    /// Integrals of r, r² and r³ times the kernel, as polynomials: coefficients of r^(power + 1) times the powers of r from 0.
    moments: [[f64; 7]; 3],
    /// Integral over space.
    whole: f64,
}

impl RadialKernel {
    /// The kernel with these coefficients of the powers of r, from 0.
    const fn new(coefficients: [f64; 7], whole: f64) -> Self {
        let mut moments = [coefficients; 3];
        let mut power = 1;
        while power <= 3 {
            let mut n = 0;
            while n < 7 {
                moments[power - 1][n] /= (n + power + 1) as f64;
                n += 1;
            }
            power += 1;
        }
        Self { moments, whole }
    }

    /// Integral of r^power times the kernel over radii from `low` to `high`.
    #[inline]
    fn moment(&self, power: usize, low: f64, high: f64) -> f64 {
        let up_to = |r: f64| {
            let sum = self.moments[power - 1].iter().rev().fold(0.0, |sum, c| sum * r + c);
            sum * r.powi(power as i32 + 1)
        };
        up_to(high) - up_to(low)
    }
}

const WENDLAND: RadialKernel = RadialKernel::new([1.0, 0.0, -10.0, 20.0, -15.0, 4.0, 0.0], TAU / 21.0);
const POLY6: RadialKernel = RadialKernel::new([1.0, 0.0, -3.0, 0.0, 3.0, 0.0, -1.0], 32.0 * TAU / 315.0);
const SPIKY: RadialKernel = RadialKernel::new([1.0, -3.0, 3.0, -1.0, 0.0, 0.0, 0.0], TAU / 30.0);

/// Smallest distance to the ball's centre, over its radius: particles are projected out of solids before they come close.
const MIN_CENTRE_DISTANCE: f64 = 0.05;

/// Largest mean curvature times h: smaller solids contribute next to nothing.
const MAX_CURVATURE: f64 = 1e3;

impl Walls {
    /// Density of a round solid at distance `d` [m] from a surface with the mean curvature `curvature` [1/m], which is moved inward by `shift` [m].
    #[inline]
    pub(super) fn round_density(&self, curvature: f32, d: f32, shift: f32) -> f32 {
        let inv_h = f64::from(self.inv_support);
        let curvature = self.bounded(curvature);
        let (d, shift) = (f64::from(d) * inv_h, f64::from(shift) * inv_h);
        // The offset moves the surface inward: the distance grows and the radius shrinks.
        let shrunk = (curvature / (1.0 - curvature * shift).max(1e-3)).min(MAX_CURVATURE);
        ball_density(self.rest.kernel, shrunk, d + shift) as f32
    }

    /// Slope with which the density of a round solid decreases at distance `d` [m] from a surface with the mean curvature `curvature` [1/m].
    #[inline]
    pub(super) fn round_slope(&self, curvature: f32, d: f32) -> f32 {
        let inv_h = f64::from(self.inv_support);
        (ball_slope(self.rest.kernel, self.bounded(curvature), f64::from(d) * inv_h) * inv_h) as f32
    }

    /// A curvature [1/m] over 1/h, as far as it counts.
    #[inline]
    fn bounded(&self, curvature: f32) -> f64 {
        (f64::from(curvature) / f64::from(self.inv_support)).clamp(0.0, MAX_CURVATURE)
    }
}

/// Mean curvature of a round shape [1/m] at the point nearest to `x`, where its normal is `n`, both in the shape's own
/// coordinates; `None` for other shapes. On a capsule it changes from that of the cylinder to that of the ends over `support` [m].
pub(super) fn mean_curvature(shape: &Shape, x: Vec3, n: Vec3, support: f32) -> Option<f32> {
    Some(match *shape {
        Shape::Sphere { radius, .. } => 1.0 / radius,
        Shape::Capsule { from, to, radius } => {
            let (from, axis) = (Vec3::from(from), Vec3::from(to) - Vec3::from(from));
            let length = axis.norm();
            let along = axis.dot(&(x - from)) / length;
            // Past both ends of a short capsule it is a ball; so is one without a length.
            let past = |beyond: f32| (beyond / support + 0.5).clamp(0.0, 1.0);
            let end = past(-along) + past(along - length);
            let end = if length > 0.0 { end.min(1.0) } else { 1.0 };
            0.5 * (1.0 + end * end * (3.0 - 2.0 * end)) / radius
        }
        Shape::Torus { center, axis, radius, tube } => {
            let axis = Vec3::from(axis).normalize();
            let p = x - Vec3::from(center);
            let radial = p - axis * axis.dot(&p);
            let across = n - axis * axis.dot(&n);
            let outward = if radial.dot(&across) < 0.0 { -across.norm() } else { across.norm() };
            0.5 * (1.0 / tube + outward / (radius + tube * outward))
        }
        // With the support function p = |a∘n|, |∇F| of F = Σ x²/a² is 2/p.
        Shape::Ellipsoid { radii, .. } => {
            let a = Vec3::from(radii);
            let inverse2 = a.map(|a| 1.0 / (a * a));
            0.5 * a.component_mul(&n).norm() * (inverse2.sum() - inverse2.dot(&n.component_mul(&n)))
        }
        _ => return None,
    })
}

/// Part of the kernel's integral that lies in a ball of curvature `k`, at distance `d` from its surface.
#[inline]
fn ball_density(kernel: Kernel, k: f64, d: f64) -> f64 {
    let w = match kernel {
        Kernel::Poly6Spiky => &POLY6,
        Kernel::Wendland => &WENDLAND,
    };
    let (near, far, to_centre) = shells(k, d);
    // The part of the shell of radius r is (1 - c)/2, with c = (D² - R²)/(2Dr) + r/(2D).
    let offset = 0.5 * d * (2.0 + k * d) / to_centre;
    let caps = w.moment(2, near, far)
        - offset * w.moment(1, near, far)
        - 0.5 * k / to_centre * w.moment(3, near, far);
    let inner = if d < 0.0 { 2.0 * w.moment(2, 0.0, near) } else { 0.0 };
    (TAU * (caps + inner) / w.whole).clamp(0.0, 1.0)
}

/// Slope with which the integral of the gradient kernel over the ball decreases.
#[inline]
fn ball_slope(kernel: Kernel, k: f64, d: f64) -> f64 {
    let w = match kernel {
        Kernel::Poly6Spiky => &SPIKY,
        Kernel::Wendland => &WENDLAND,
    };
    let (near, far, to_centre) = shells(k, d);
    let m2 = 1.0 / (to_centre * to_centre);
    let caps = (1.0 + m2) * w.moment(1, near, far) - k * k * m2 * w.moment(3, near, far);
    (0.5 * TAU * caps / w.whole).max(0.0)
}

/// Radii between which the shells cross the surface, and D/R.
#[inline]
fn shells(k: f64, d: f64) -> (f64, f64, f64) {
    let near = d.abs().min(1.0);
    let far = if k > 0.0 { (2.0 / k + d).min(1.0) } else { 1.0 };
    (near, far.max(near), (1.0 + k * d).max(MIN_CENTRE_DISTANCE))
}

#[cfg(test)]
mod tests {
    use super::super::tests::walls;
    use super::*;
    use crate::sim::liquid::calibration::RestState;

    const KERNELS: [Kernel; 2] = [Kernel::Poly6Spiky, Kernel::Wendland];

    #[test]
    fn a_ball_without_curvature_is_a_half_space() {
        for kernel in KERNELS {
            let rest = RestState::new(kernel, 1.0, 2.0);
            for q in [-0.7, -0.2, 0.0, 0.3, 0.9] {
                for curvature in [0.0, 1e-7] {
                    let share =
                        ball_density(kernel, curvature, q) - f64::from(rest.half_space_density(q as f32));
                    let slope = ball_slope(kernel, curvature, q) - f64::from(rest.half_space_slope(q as f32));
                    assert!(share.abs() < 1e-5 && slope.abs() < 1e-5, "{kernel:?} at {q}: {share}, {slope}");
                }
            }
        }
    }

    #[test]
    fn the_slope_is_the_derivative_of_the_density() {
        for (k, d) in [(0.5, 0.3), (1.0, 0.1), (2.0, 0.25), (4.0, 0.4), (2.0, -0.1), (8.0, 0.6)] {
            let density = |d: f64| ball_density(Kernel::Wendland, k, d);
            let difference = (density(d - 1e-5) - density(d + 1e-5)) / 2e-5;
            let slope = ball_slope(Kernel::Wendland, k, d);
            assert!((slope - difference).abs() < 1e-6, "curvature {k}, distance {d}: {slope}, {difference}");
        }
    }

    /// Integral of Wendland's kernel over a solid, which is moved inward by the calibrated offset, by midpoints in cells that the surface
    /// cuts linearly.
    fn integral(rest: &RestState, x: Vec3, distance: &dyn Fn(Vec3) -> f32) -> f32 {
        let n = 56;
        let (mut inside, mut all) = (0.0, 0.0);
        for k in 0..n * n * n {
            let at = |i: i32| 2.0 * (i as f32 + 0.5) / n as f32 - 1.0;
            let q = Vec3::new(at(k % n), at(k / n % n), at(k / n / n));
            let w = rest.kernel.density(f64::from(q.norm()).min(1.0));
            let depth = -(distance(x + q * rest.support) + rest.wall_shift) / (2.0 * rest.support / n as f32);
            (inside, all) = (inside + w * f64::from((depth + 0.5).clamp(0.0, 1.0)), all + w);
        }
        (inside / all) as f32
    }

    /// Spheres, capsules, rings and ellipsoids at contact and beyond, h = 0.2 m. As half spaces they would be off by up to 0.13.
    #[test]
    fn round_solids_contribute_the_kernels_integral() {
        let rest = RestState::new(Kernel::Wendland, 0.1, 2.0);
        let sphere = |radius: f32| Shape::Sphere { center: [0.0; 3], radius };
        let capsule =
            |half: f32, radius: f32| Shape::Capsule { from: [0.0, -half, 0.0], to: [0.0, half, 0.0], radius };
        let torus =
            |radius: f32, tube: f32| Shape::Torus { center: [0.0; 3], axis: [0.0, 1.0, 0.0], radius, tube };
        let ellipsoid = |radii: [f32; 3]| Shape::Ellipsoid { center: [0.0; 3], radii };
        let up = Vec3::z();
        let cases: [(&str, Shape, Vec3, Vec3, f32); 14] = [
            ("ball of 4 h", sphere(0.8), up * 0.8, up, 0.002),
            ("ball of h", sphere(0.2), up * 0.2, up, 0.002),
            ("ball of h/2", sphere(0.1), up * 0.1, up, 0.003),
            ("capsule of 2 h, side", capsule(0.5, 0.4), up * 0.4, up, 0.003),
            ("capsule of h/2, side", capsule(0.5, 0.1), up * 0.1, up, 0.006),
            ("capsule of h/4, side", capsule(0.5, 0.05), up * 0.05, up, 0.012),
            ("capsule of h, end", capsule(0.5, 0.2), Vec3::y() * 0.7, Vec3::y(), 0.003),
            ("capsule of h, where its end starts", capsule(0.5, 0.2), Vec3::new(0.0, 0.5, 0.2), up, 0.005),
            ("capsule of h, h/2 before", capsule(0.5, 0.2), Vec3::new(0.0, 0.4, 0.2), up, 0.005),
            ("capsule of h, h long", capsule(0.1, 0.2), up * 0.2, up, 0.01),
            ("ring of 2 h, outside", torus(0.4, 0.1), up * 0.5, up, 0.006),
            ("ring of 2 h, inside", torus(0.4, 0.1), up * 0.3, -up, 0.006),
            ("ellipsoid, side", ellipsoid([0.3, 0.5, 0.2]), up * 0.2, up, 0.006),
            ("ellipsoid, tip", ellipsoid([0.3, 0.5, 0.2]), Vec3::y() * 0.5, Vec3::y(), 0.015),
        ];
        for (name, shape, surface, n, bound) in cases {
            for d in [0.03, 0.05, 0.1, 0.15] {
                let x = surface + n * d;
                let (share, slope) = walls_of(&rest, &shape).boundary_density(x);
                let truth = integral(&rest, x, &|x| shape.signed_distance(x));
                println!("{name} at {d}: {share:.4}, integral {truth:.4}");
                assert!((share - truth).abs() < bound, "{name} at {d}: {share}, integral {truth}");
                assert!(slope.dot(&n) <= 0.0, "{name} at {d}: {slope:?}");
            }
        }
        assert_eq!(walls(&[sphere(0.2)]).boundary_density(up * 0.5).0, 0.0);
    }

    fn walls_of(rest: &RestState, shape: &Shape) -> Walls {
        Walls::new(&[crate::solid::Solid::fixed(shape.clone())], rest)
    }
}
