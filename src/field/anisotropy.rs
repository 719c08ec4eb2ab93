//! Kernels that follow their neighbourhoods.
//!
//! *Method* [yu13] section 4: a weighted covariance of the neighbours tells along which axes a particle's surroundings
//! stretch; the kernel is stretched alike, and its centre moved towards their mean. w = 1 − (r/R)³ within R = 2h.
//! *Departs from the paper*:
//! - Particles at a surface all move inwards, half a spacing and more, and the liquid shrinks. What the particles beside
//!   one move by in common, as far as they are as deep, is taken back: only the disorder is smoothed.
//! - Half axes go with standard deviations, not with variances: along variances the outermost layers are so thin that the
//!   density falls between them.
//! - With few neighbours the ball keeps its radius, k_n = 1: at one half, filaments turn to beads.
//! - No axis is shorter than bridges the gap between two layers: a sheet of two would be two sheets.
//! - k_s is the filled lattice's own, so that no constant depends on units.
//! - Particles with no surface near keep the ball, which they would get up to the liquid's disorder.
//!
//! Symbols: C → covariance [R²]; Σ̃ → `scale` [–]; G = R Σ̃⁻¹ Rᵀ/h [1/m]; λ → `smoothing`; k_r → `ratio`.
//! Limits: particles with few neighbours, and thus filaments and droplets, are as without.

use super::{
    Anisotropy, DensityParams,
    blob::{Blob, Blobs},
    cloud::{Cloud, Moments, Vectors, Weight},
    kernel::weights,
    threshold::PLANES,
};
use crate::{
    grid::{BRICK, Bricks},
    math::{
        Vec3,
        symmetric::{self, Symmetric},
    },
    par,
};

/// R/h.
const REACH: f32 = 2.0;

/// N_ε: with as many neighbours or fewer, a covariance means little.
const FEW: f32 = 25.0;

/// Kernels further than this from a brick are not shaped for it [h]. They would be balls up to the liquid's disorder, and show
/// little in the brick: on a ball and on a splash roughness, normals and volume are the same from 0.5 to 1.1; at 0.3 the
/// splash lost 5·10⁻⁵ of its volume.
const NEAR: f32 = 0.5;

/// The least half axis of a kernel [spacings], where the ball is larger: layers a spacing apart stay one.
const BRIDGE: f32 = 1.2;

/// Particles nearer than this to a plane are as deep [spacings]: a layer, and not the next.
const LAYER: f32 = 0.75;

/// Shifts shorter than this are of disorder alone [layers]: no surface is near, and none needs to be compared.
const CALM: f32 = 0.2;

/// The weight of the covariance.
struct Cubic;

impl Weight for Cubic {
    #[inline(always)]
    fn of(q: f32) -> f32 {
        1.0 - q * q * q // [yu13] Eq. 11
    }
}

/// How a neighbourhood becomes a kernel.
#[derive(Clone, Copy)]
struct Rule {
    /// k_r.
    ratio: f32,
    /// h [m].
    h: f32,
    /// The standard deviation of filled space [R].
    lattice: f32,
    /// The least half axis [h].
    bridge: f32,
}

impl Rule {
    /// The kernel of one particle at `x` with isotropic weight `weight`, not moved.
    fn shape(&self, x: Vec3, weight: f32, moments: &Moments) -> Blob {
        let mean = moments.first / moments.zeroth;
        if moments.count <= FEW + 1.0 {
            return ball(x, weight, self.h); // [yu13] Eq. 15, k_n = 1
        }
        let mut covariance = moments.second;
        for (part, (a, b)) in covariance.iter_mut().zip([(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)]) {
            *part = *part / moments.zeroth - mean[a] * mean[b]; // C, [yu13] Eq. 9
        }
        let (sigma, axes) = symmetric::eigen(&covariance);
        let deviation = sigma.map(|s| s.max(0.0).sqrt());
        let least = deviation[0] / self.ratio;
        let scale = deviation.map(|s| (s.max(least) / self.lattice).max(self.bridge)); // Σ̃, [yu13] Eq. 15
        let mut matrix: Symmetric = [0.0; 6];
        let mut extents2 = Vec3::zeros();
        for (axis, scale) in axes.iter().zip(scale) {
            let m = 1.0 / (scale * self.h).powi(2);
            for (part, (a, b)) in matrix.iter_mut().zip([(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)]) {
                *part += m * axis[a] * axis[b]; // GᵀG, [yu13] Eq. 16
            }
            extents2 += axis.component_mul(axis) * (scale * self.h).powi(2);
        }
        let determinant = 1.0 / scale.iter().product::<f32>();
        Blob { center: x, matrix, extents: extents2.map(f32::sqrt), weight: weight * determinant }
    }
}

/// Makes ellipsoids of balls.
pub(super) struct Shaper {
    rule: Rule,
    /// λ.
    smoothing: f32,
    /// Which kernels are shaped, in the cells' order.
    shaped: Vec<bool>,
    /// From every shaped particle to the mean of its neighbours [m].
    shifts: Vectors,
    /// How thick the layer is in which shifts are compared, on either side [m].
    layer: f32,
}

impl Shaper {
    /// For the particles of `cloud`.
    pub(super) fn new(cloud: &Cloud, anisotropy: &Anisotropy, params: &DensityParams) -> Self {
        let h = params.kernel_radius * params.spacing;
        Self {
            rule: Rule {
                ratio: anisotropy.ratio,
                h,
                lattice: lattice_deviation(params.kernel_radius),
                bridge: (BRIDGE / params.kernel_radius).min(1.0),
            },
            smoothing: anisotropy.smoothing,
            shaped: vec![false; cloud.len()],
            shifts: Vectors::new(cloud),
            layer: LAYER * params.spacing,
        }
    }

    /// The kernels with which to begin: balls of the given weights, in the order of `cloud`.
    pub(super) fn balls(&self, cloud: &Cloud, weights: &[f32]) -> Blobs {
        let mut blobs = vec![Blob::default(); weights.len()];
        par::fill(&mut blobs, |place| ball(cloud.at(place), weights[place], self.rule.h));
        Blobs::Ellipsoids { blobs, reach: self.rule.h }
    }

    /// Shapes the kernels of particles that are `near`, in the order of `cloud`, and not shaped yet.
    pub(super) fn shape(&mut self, cloud: &Cloud, kernels: &mut Blobs, near: &[bool]) {
        let Blobs::Ellipsoids { blobs, reach } = kernels else {
            unreachable!("balls of their own have no shape")
        };
        let radius = REACH * self.rule.h;
        let is_due = |place: usize| near[place] && !self.shaped[place];
        let due =
            par::map_chunks(near.len(), par::CHUNK, |range| range.filter(|&p| is_due(p)).collect::<Vec<_>>());
        let due = due.concat();

        // Shape them, and see where their neighbours are.
        let made = cloud.moments::<Cubic, true, _>(radius, is_due, |place, moments| {
            let shape = self.rule.shape(cloud.at(place), blobs[place].weight, moments);
            (shape, moments.first / moments.zeroth * radius)
        });
        for (&place, (_, shift)) in due.iter().zip(&made) {
            self.shifts.set(place, *shift);
        }

        // Move them there, as far as those beside them do not.
        let (shifts, calm) = (&self.shifts, CALM * self.layer);
        let moves = |place: usize| is_due(place) && shifts.at(place).norm() > calm;
        let mut common = cloud.means_across::<Cubic>(radius, self.layer, shifts, moves).into_iter();
        for (place, (mut blob, shift)) in due.into_iter().zip(made) {
            let common =
                if shift.norm() > calm { common.next().expect("one each that moves") } else { Vec3::zeros() };
            let own = (shift - common) * self.smoothing;
            blob.center += own; // x̄, [yu13] Eq. 6
            *reach = reach.max(own.abs().max() + blob.extents.max());
            blobs[place] = blob;
            self.shaped[place] = true;
        }
    }
}

/// Which particles, in the order of `cloud`, are so near to a brick of `bricks` that their kernels may show in it.
pub(super) fn near(cloud: &Cloud, bricks: &Bricks, voxel: f32, h: f32) -> Vec<bool> {
    let parts = par::map_chunks(cloud.len(), par::CHUNK, |range| {
        let edge = f64::from(voxel) * BRICK as f64;
        let mut last = None;
        let mut is_near = false;
        range
            .map(|place| {
                let x = cloud.at(place);
                let brick = |axis: usize, side: f32| {
                    ((f64::from(x[axis]) + f64::from(side * NEAR * h)) / edge).floor() as i32
                };
                let (low, high) =
                    ([0, 1, 2].map(|axis| brick(axis, -1.0)), [0, 1, 2].map(|axis| brick(axis, 1.0)));
                // Neighbours mostly ask for the same bricks.
                if last.replace((low, high)) != Some((low, high)) {
                    is_near = (low[2]..=high[2]).any(|z| {
                        (low[1]..=high[1])
                            .any(|y| (low[0]..=high[0]).any(|x| bricks.find([x, y, z]).is_some()))
                    });
                }
                is_near
            })
            .collect::<Vec<_>>()
    });
    parts.concat()
}

/// A round kernel.
fn ball(center: Vec3, weight: f32, h: f32) -> Blob {
    let m = 1.0 / (h * h);
    Blob { center, matrix: [m, m, m, 0.0, 0.0, 0.0], extents: Vec3::repeat(h), weight }
}

/// The standard deviation of the filled lattice along each axis [R]: 1/k_s.
fn lattice_deviation(kernel_radius: f32) -> f32 {
    let radius = f64::from(REACH * kernel_radius);
    let n = radius.ceil() as i32;
    let (mut sum, mut second) = (0.0, 0.0);
    for place in 0..(2 * n + 1).pow(3) {
        let d = [0, 1, 2].map(|axis| f64::from(place / (2 * n + 1).pow(axis) % (2 * n + 1) - n) / radius);
        let q = d.iter().map(|d| d * d).sum::<f64>().sqrt();
        let w = (1.0 - q.powi(3)).max(0.0);
        sum += w;
        second += w * d[0] * d[0];
    }
    (second / sum).sqrt() as f32
}

/// The φ on the surface of filled space, see [`super::threshold`], with the kernels' stretch and smoothing.
pub(super) fn threshold(anisotropy: &Anisotropy, kernel_radius: f32) -> f32 {
    let params = DensityParams {
        spacing: 1.0,
        kernel_radius,
        voxel: 0.5,
        anisotropy: Some(*anisotropy),
        whole: false,
    };
    // Kernels that reach the samples, what is beside those, and what shapes that.
    let reach = f64::from((1.5 + 2.0 * REACH) * kernel_radius) + 5.0;
    let levels = PLANES.map(|plane| {
        let filled = plane.filled(reach);
        let positions: Vec<Vec3> = filled.into_iter().map(|j| Vec3::from(j.map(|v| v as f32))).collect();
        let cloud = Cloud::new(&positions, kernel_radius);
        let near: Vec<bool> = (0..cloud.len())
            .map(|place| cloud.at(place).norm() < (1.5 + REACH) * kernel_radius + 4.5)
            .collect();
        let mut shaper = Shaper::new(&cloud, anisotropy, &params);
        let mut blobs = shaper.balls(&cloud, &weights(&cloud, kernel_radius));
        shaper.shape(&cloud, &mut blobs, &near);
        let samples = plane.samples();
        let reach = blobs.reach();
        let density = |i: usize| {
            let x = samples[i].cast::<f32>();
            let mut sum = 0.0;
            cloud.cells.for_each_stretch(x.add_scalar(-reach), x.add_scalar(reach), |places| {
                sum += places.map(|place| f64::from(blobs.at(&cloud, place).value(x))).sum::<f64>();
            });
            sum
        };
        par::sum(samples.len(), density) / samples.len() as f64
    });
    (levels.iter().sum::<f64>() / levels.len() as f64) as f32
}
