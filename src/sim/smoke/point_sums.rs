//! Sums over point sources: eight targets at a time with one source after the other.
//!
//! *Method*: u = Σ q d/r³ and ∇u = Σ q (1/r³ − 3 d dᵀ/r⁵), d from the source. Sums over [`BLOCK`] sources are in single precision, sums
//! of blocks in double precision. A solid of 1600 panels has as many sources, and every point feels each: these sums take most of
//! the time of smoke with solids. A source may be a point from some distance on alone; what is nearer is added one by one.

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

/// A source that is a point from some distance on.
#[derive(Clone, Copy, Debug)]
pub(super) struct PointSource {
    /// Where it is [m].
    pub(super) at: Vec3,
    /// q/4π [m³/s].
    pub(super) strength: f32,
    /// Square of that distance [m²].
    pub(super) reach2: f32,
}

/// Adds the velocity [m/s] that `sources` induce at `points`; `near` is that of a source at a point within its distance.
pub(super) fn add_velocity(
    sources: &[PointSource],
    points: &[Vec3],
    velocity: &mut [Vec3],
    near: impl Fn(usize, Vec3) -> Vec3 + Sync,
) {
    let add_sums = |v: &mut Vec3, [x, y, z]: [f32; VELOCITY]| *v += Vec3::new(x, y, z);
    add(sources, points, velocity, add_sums, |v, source, x| *v += near(source, x));
}

/// Adds the gradient of that velocity [1/s].
pub(super) fn add_gradient(
    sources: &[PointSource],
    points: &[Vec3],
    gradient: &mut [Gradient],
    near: impl Fn(usize, Vec3) -> Gradient + Sync,
) {
    let add_sums = |gradient: &mut Gradient, [xx, yy, xy, xz, yz]: [f32; GRADIENT]| {
        *gradient += Gradient::new(xx, xy, xz, xy, yy, yz, xz, yz, -xx - yy);
    };
    add(sources, points, gradient, add_sums, |gradient, source, x| *gradient += near(source, x));
}

fn add<const N: usize, T: Send>(
    sources: &[PointSource],
    points: &[Vec3],
    out: &mut [T],
    add_sums: impl Fn(&mut T, [f32; N]) + Sync,
    add_near: impl Fn(&mut T, usize, Vec3) + Sync,
) {
    if sources.is_empty() {
        return;
    }
    par::for_chunks(out, TARGETS, |first, out| {
        let points = &points[first..first + out.len()];
        let (mut sums, mut near) = ([[0.0; N]; TARGETS], Vec::new());
        simd::dispatch(PointSums { sources, points, sums: &mut sums, near: &mut near });
        for (out, sums) in out.iter_mut().zip(sums) {
            add_sums(out, sums);
        }
        for (target, source) in near {
            add_near(&mut out[target], source, points[target]);
        }
    });
}

struct PointSums<'a, const N: usize> {
    sources: &'a [PointSource],
    points: &'a [Vec3],
    sums: &'a mut [[f32; N]; TARGETS],
    /// Targets and sources that are too near to each other.
    near: &'a mut Vec<(usize, usize)>,
}

impl<const N: usize> Pass for PointSums<'_, N> {
    type Out = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        for (number, (points, out)) in self.points.chunks(LANES).zip(self.sums.chunks_mut(LANES)).enumerate()
        {
            let x = columns::<L>(|lane| points[lane.min(points.len() - 1)]);
            let mut totals = [[0.0_f64; LANES]; N];
            for (block, sources) in self.sources.chunks(BLOCK).enumerate() {
                let mut sums: [L; N] = [splat(0.0); N];
                for (place, source) in sources.iter().enumerate() {
                    let near = add_source(x, source, &mut sums);
                    if near != 0 {
                        let lanes = (0..points.len()).filter(|lane| near >> lane & 1 == 1);
                        self.near.extend(lanes.map(|lane| (number * LANES + lane, block * BLOCK + place)));
                    }
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

/// Adds what a source induces at `x` to the sums of the velocity or of its gradient. Returns the lanes that are too near to it, to which
/// nothing was added.
#[inline(always)]
fn add_source<L: Lanes, const N: usize>(x: [L; 3], source: &PointSource, sums: &mut [L; N]) -> u8 {
    let PointSource { at, strength, reach2 } = source;
    let d = [x[0] - splat(at.x), x[1] - splat(at.y), x[2] - splat(at.z)];
    let r2 = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
    let near = r2.less(splat(*reach2));
    let r2 = L::select(near, splat(1.0), r2);
    let along: L = L::select(near, splat(0.0), splat::<L>(*strength) / (r2 * r2.sqrt()));
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
    L::bits(near)
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
        let source = |i: usize| {
            let reach2 = if i.is_multiple_of(3) { 2.0 } else { 0.0 };
            PointSource { at: at(i, 0.5), strength: 0.3 - (i % 5) as f32 * 0.1, reach2 }
        };
        let sources: Vec<PointSource> = (0..1100).map(source).collect();
        let points: Vec<Vec3> = (0..77).map(|i| at(i + 3, 2.0) + Vec3::new(0.0, 0.0, 1.5)).collect();
        let [scalar, fastest] = in_both_forms(|| {
            let mut velocity = vec![Vec3::new(1.0, 0.0, 0.0); points.len()];
            let mut gradient = vec![Gradient::zeros(); points.len()];
            let near = std::sync::atomic::AtomicUsize::new(0);
            let counted = |source: usize, x: Vec3| {
                near.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
                assert!((x - sources[source].at).norm_squared() < 2.0 && source.is_multiple_of(3));
                x - sources[source].at
            };
            // Near sources are twice as strong.
            let flow = |d: Vec3, source: usize| d * (2.0 * sources[source].strength / d.norm().powi(3));
            add_velocity(&sources, &points, &mut velocity, |source, x| flow(counted(source, x), source));
            add_gradient(&sources, &points, &mut gradient, |source, x| {
                point_strain(counted(source, x)) * (2.0 * sources[source].strength)
            });
            assert!((1000..2 * 77 * 1100 / 3).contains(&near.into_inner()));
            (velocity, gradient)
        });
        assert_eq!(scalar, fastest);
        for (i, &x) in points.iter().enumerate() {
            let mut exact = nalgebra::Vector3::new(1.0_f64, 0.0, 0.0);
            let (mut strain, mut speed, mut slope) = (Gradient::zeros(), 0.0, 0.0);
            for PointSource { at: y, strength, reach2 } in &sources {
                let d = (x - y).cast::<f64>();
                let q = strength * if (x - y).norm_squared() < *reach2 { 2.0 } else { 1.0 };
                exact += d * (f64::from(q) / d.norm().powi(3));
                strain += point_strain(x - y) * q;
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
