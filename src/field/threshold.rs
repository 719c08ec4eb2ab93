//! The density at the surface of filled space, which is the level of the isosurface.
//!
//! A liquid at rest fills its cells of spacing³. Points of a cubic lattice with centres below a plane
//! therefore fill the space below it, averaged over the plane's positions. The threshold is the mean density
//! on such planes, computed like [`density`](super::density), with the truncated neighbourhoods of the
//! particles at the surface. Two planes are used: one along the seeding lattice, half a spacing beyond its
//! last layer, as for a pool at rest, and one oblique to it, as for most of a splash. For a kernel of two
//! spacings the level of the first alone makes a ball 0.06 spacings too large, that of the second alone 0.04
//! too small.

use super::kernel::kernel;
use nalgebra::Vector3;
use std::f64::consts::FRAC_1_SQRT_2;

/// A plane with filled space below it.
pub(super) struct Plane {
    normal: [f64; 3],
    /// Distance from the point of the cubic lattice at the origin [spacings].
    offset: f64,
}

/// The planes whose levels are averaged.
pub(super) const PLANES: [Plane; 2] = [
    Plane { normal: [0.0, 0.0, 1.0], offset: 0.5 },
    // (1, √2, √3)/√6: no two points of the plane have the same surroundings.
    Plane { normal: [0.408_248_290_463_863, 0.577_350_269_189_625_8, FRAC_1_SQRT_2], offset: 0.0 },
];

/// Samples along an edge of the square over which the mean is taken, and the edge [spacings].
const SAMPLES: i32 = 12;
const EDGE: f64 = 6.0;

/// The density φ [–] on the surface of filled space, for a kernel of support `kernel_radius` [spacings].
///
/// # Panics
/// If `kernel_radius` is not above one half: the kernel would not reach the surface.
pub(crate) fn surface_threshold(kernel_radius: f32) -> f32 {
    assert!(kernel_radius > 0.5 && kernel_radius.is_finite(), "the kernel reaches the surface");
    let levels = PLANES.map(|plane| plane.level(f64::from(kernel_radius)));
    (levels.iter().sum::<f64>() / levels.len() as f64) as f32
}

impl Plane {
    /// The mean density on the plane, for a kernel of support `h` [spacings].
    fn level(&self, h: f64) -> f64 {
        let value = |j: [i32; 3], x: Vector3<f64>| f64::from(kernel(((vector(j) - x).norm() / h) as f32));
        let weight = |j: [i32; 3]| {
            let around = cube(h.ceil() as i32).map(|step| [0, 1, 2].map(|axis| j[axis] + step[axis]));
            let filled = around.filter(|&k| self.is_above(k));
            1.0 / filled.map(|k| value(k, vector(j))).sum::<f64>() // V_j W(0, h)
        };
        let weights: Vec<_> = self.filled(EDGE + h).into_iter().map(|j| (j, weight(j))).collect();
        let samples = self.samples();
        let density =
            |&x: &Vector3<f64>| weights.iter().map(|&(j, weight)| weight * value(j, x)).sum::<f64>();
        samples.iter().map(density).sum::<f64>() / samples.len() as f64
    }

    /// The points of the cubic lattice below the plane within `reach` [spacings] of the origin.
    pub(super) fn filled(&self, reach: f64) -> Vec<[i32; 3]> {
        cube(reach.ceil() as i32).filter(|&j| self.is_above(j) && vector(j).norm() <= reach).collect()
    }

    /// Sample points on the plane [spacings].
    pub(super) fn samples(&self) -> Vec<Vector3<f64>> {
        let normal = Vector3::from(self.normal);
        let first = normal.cross(&Vector3::x()).normalize();
        let second = normal.cross(&first);
        let at = |i: i32| EDGE * ((f64::from(i) + 0.5) / f64::from(SAMPLES) - 0.5);
        let place = |i: i32| first * at(i % SAMPLES) + second * at(i / SAMPLES) + normal * self.offset;
        (0..SAMPLES * SAMPLES).map(place).collect()
    }

    /// Whether the plane is above a point of the cubic lattice.
    fn is_above(&self, j: [i32; 3]) -> bool {
        vector(j).dot(&Vector3::from(self.normal)) <= self.offset
    }
}

/// All points of the cubic lattice up to `n` from the origin along each axis.
fn cube(n: i32) -> impl Iterator<Item = [i32; 3]> {
    (0..(2 * n + 1).pow(3)).map(move |i| [0, 1, 2].map(|axis| i / (2 * n + 1).pow(axis) % (2 * n + 1) - n))
}

fn vector(j: [i32; 3]) -> Vector3<f64> {
    Vector3::from(j).cast()
}
