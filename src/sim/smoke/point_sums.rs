//! Sums over point sources: eight targets at a time with one source after the other.
//!
//! *Method*: u = Σ q d/r³ and ∇u = Σ q (1/r³ − 3 d dᵀ/r⁵), d from the source. Sums over [`BLOCK`] sources are in single precision, sums
//! of blocks in double precision. A solid of 1600 panels has as many sources, and every point feels each: these sums take most of
//! the time of smoke with solids.

use crate::{
    math::Vec3,
    par,
    sim::vortex::{Gradient, columns},
    simd::{self, LANES, Lanes, Pass, splat},
};

/// Targets of a task.
const TARGETS: usize = 64;

/// Sources that are summed in single precision.
const BLOCK: usize = 512;

/// The velocity's components, or xx, yy, xy, xz and yz of its gradient, which is symmetric and has no trace.
const VELOCITY: usize = 3;
const GRADIENT: usize = 5;

/// Adds the velocity [m/s] that sources at points [m], q/4π [m³/s] each, induce at `points`.
pub(super) fn add_velocity(sources: &[(Vec3, f32)], points: &[Vec3], velocity: &mut [Vec3]) {
    add::<VELOCITY, _>(sources, points, velocity, |v, [x, y, z]| *v += Vec3::new(x, y, z));
}

/// Adds the gradient of that velocity [1/s].
pub(super) fn add_gradient(sources: &[(Vec3, f32)], points: &[Vec3], gradient: &mut [Gradient]) {
    add::<GRADIENT, _>(sources, points, gradient, |gradient, [xx, yy, xy, xz, yz]| {
        *gradient += Gradient::new(xx, xy, xz, xy, yy, yz, xz, yz, -xx - yy);
    });
}

fn add<const N: usize, T: Send>(
    sources: &[(Vec3, f32)],
    points: &[Vec3],
    out: &mut [T],
    add: impl Fn(&mut T, [f32; N]) + Sync,
) {
    if sources.is_empty() {
        return;
    }
    par::for_chunks(out, TARGETS, |first, out| {
        let points = &points[first..first + out.len()];
        let mut sums = [[0.0; N]; TARGETS];
        simd::dispatch(PointSums { sources, points, sums: &mut sums });
        for (out, sums) in out.iter_mut().zip(sums) {
            add(out, sums);
        }
    });
}

struct PointSums<'a, const N: usize> {
    sources: &'a [(Vec3, f32)],
    points: &'a [Vec3],
    sums: &'a mut [[f32; N]; TARGETS],
}

impl<const N: usize> Pass for PointSums<'_, N> {
    type Out = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        for (points, out) in self.points.chunks(LANES).zip(self.sums.chunks_mut(LANES)) {
            let x = columns::<L>(|lane| points[lane.min(points.len() - 1)]);
            let mut totals = [[0.0_f64; LANES]; N];
            for sources in self.sources.chunks(BLOCK) {
                let mut sums: [L; N] = [splat(0.0); N];
                for (source, q) in sources {
                    add_source(x, source, *q, &mut sums);
                }
                for k in 0..N {
                    let row = sums[k].to_array();
                    for lane in 0..LANES {
                        totals[k][lane] += f64::from(row[lane]);
                    }
                }
            }
            for (lane, out) in out.iter_mut().enumerate() {
                for k in 0..N {
                    out[k] = totals[k][lane] as f32;
                }
            }
        }
    }
}

/// Adds what a source induces at `x` to the sums of the velocity or of its gradient.
#[inline(always)]
fn add_source<L: Lanes, const N: usize>(x: [L; 3], source: &Vec3, q: f32, sums: &mut [L; N]) {
    let d = [x[0] - splat(source.x), x[1] - splat(source.y), x[2] - splat(source.z)];
    let r2 = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
    let along: L = splat::<L>(q) / (r2 * r2.sqrt());
    if N == VELOCITY {
        for k in 0..VELOCITY {
            sums[k] += d[k] * along;
        }
    } else {
        let across = splat::<L>(3.0) / r2 * along;
        for (k, (i, j)) in [(0, 0), (1, 1), (0, 1), (0, 2), (1, 2)].into_iter().enumerate() {
            sums[k] = sums[k] - d[i] * d[j] * across;
        }
        sums[0] += along;
        sums[1] += along;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{sim::smoke::tiles::point_strain, simd::tests::in_both_forms};

    #[test]
    fn sums_are_those_of_pairs_with_the_same_bits_in_both_forms_of_lanes() {
        let at = |i: usize, scale: f32| {
            Vec3::new((1.7 * i as f32).sin(), (2.3 * i as f32).cos(), (0.9 * i as f32).sin()) * scale
        };
        let sources: Vec<(Vec3, f32)> = (0..1100).map(|i| (at(i, 0.5), 0.3 - (i % 5) as f32 * 0.1)).collect();
        let points: Vec<Vec3> = (0..77).map(|i| at(i + 3, 2.0) + Vec3::new(0.0, 0.0, 1.5)).collect();
        let [scalar, fastest] = in_both_forms(|| {
            let mut velocity = vec![Vec3::new(1.0, 0.0, 0.0); points.len()];
            let mut gradient = vec![Gradient::zeros(); points.len()];
            add_velocity(&sources, &points, &mut velocity);
            add_gradient(&sources, &points, &mut gradient);
            (velocity, gradient)
        });
        assert_eq!(scalar, fastest);
        for (i, &x) in points.iter().enumerate() {
            let mut exact = nalgebra::Vector3::new(1.0_f64, 0.0, 0.0);
            let (mut strain, mut speed, mut slope) = (Gradient::zeros(), 0.0, 0.0);
            for (y, q) in &sources {
                let d = (x - y).cast::<f64>();
                exact += d * (f64::from(*q) / d.norm().powi(3));
                strain += point_strain(x - y) * *q;
                speed += f64::from(q.abs()) / d.norm_squared();
                slope += f64::from(q.abs()) / d.norm().powi(3);
            }
            assert!(
                (scalar.0[i].cast::<f64>() - exact).norm() < 1e-5 * speed,
                "{i}: {} for {exact}",
                scalar.0[i]
            );
            assert!((scalar.1[i] - strain).norm() < 1e-5 * slope as f32, "{i}");
        }
    }
}
