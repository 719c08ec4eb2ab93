//! Anisotropic kernels, shaped by the neighbourhoods of particles.
//!
//! *Method* [yu13] section 4: a weighted covariance of the neighbours gives the principal axes of a
//! particle's surroundings. The kernel is stretched along them, and its centre moves towards the neighbours'
//! mean. w = 1 − (r/R)³ within R = 2h.
//! *Departs from the paper*:
//! - At a surface all particles move inwards, by half a spacing and more, and the liquid shrinks. The mean
//!   shift of the neighbours at equal depth is therefore subtracted: only the disorder is smoothed.
//! - Half axes are proportional to standard deviations, not to variances: with variances the outermost layers
//!   are so thin that the density vanishes between them.
//! - With few neighbours the kernel keeps its radius, k_n = 1: with one half, filaments turn to beads.
//! - Every axis is long enough to bridge the gap between two layers: a sheet of two layers would become two
//!   sheets.
//! - k_s is that of the filled seeding lattice, so that no constant depends on units.
//! - Particles far from the surface keep the isotropic kernel, which they would have anyway up to the
//!   liquid's disorder.
//!
//! Symbols: C → covariance [R²]; Σ̃ → `scale` [–]; G = R Σ̃⁻¹ Rᵀ/h [1/m]; λ → `smoothing`; k_r → `ratio`.
//! Limits: particles with few neighbours, and thus filaments and droplets, have isotropic kernels.

use super::{
    Anisotropy, DensityParams,
    kernel::weights,
    particle_kernel::{ParticleKernel, ParticleKernels},
    scaled::{self, Scales},
    sorted_particles::{Moments, SortedParticles, Vectors, Weight},
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
const NEIGHBOURHOOD_RADIUS: f32 = 2.0;

/// N_ε: with this number of neighbours or fewer, a covariance is unreliable.
const MIN_NEIGHBOURS: f32 = 25.0;

/// Kernels further than this from a brick are not shaped for it [h]. They would be isotropic up to the
/// liquid's disorder, and hardly affect the brick. On a ball and on a splash roughness, normals and volume
/// are the same from 0.5 to 1.1; at 0.3 the splash lost 5·10⁻⁵ of its volume.
const SHAPED_DISTANCE: f32 = 0.5;

/// Smallest half axis of a kernel [spacings], if the isotropic radius is larger: layers a spacing apart stay
/// one.
const MIN_HALF_AXIS: f32 = 1.2;

/// Particles nearer than this to a plane are at the same depth [spacings]: one layer, and not the next.
const LAYER_HALF_THICKNESS: f32 = 0.75;

/// Shifts shorter than this are disorder only [layers]: no surface is near, and no mean shift has to be
/// subtracted.
const MIN_SHIFT: f32 = 0.2;

/// The weight of the covariance.
struct Cubic;

impl Weight for Cubic {
    #[inline(always)]
    fn of(q: f32) -> f32 {
        1.0 - q * q * q // [yu13] Eq. 11
    }
}

/// Parameters that turn a neighbourhood into a kernel.
#[derive(Clone, Copy)]
struct KernelShape {
    /// k_r.
    ratio: f32,
    /// The standard deviation of filled space [R].
    filled_deviation: f32,
    /// The smallest half axis [h].
    min_half_axis: f32,
}

impl KernelShape {
    /// The kernel of one particle at `x` with isotropic weight `weight` and support `h` [m], not displaced.
    fn shape(&self, x: Vec3, weight: f32, h: f32, moments: &Moments) -> ParticleKernel {
        let mean = moments.first / moments.zeroth;
        if moments.count <= MIN_NEIGHBOURS + 1.0 {
            return ParticleKernel::isotropic(x, weight, h); // [yu13] Eq. 15, k_n = 1
        }
        let mut covariance = moments.second;
        for (part, (a, b)) in covariance.iter_mut().zip([(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)]) {
            *part = *part / moments.zeroth - mean[a] * mean[b]; // C, [yu13] Eq. 9
        }
        let (sigma, axes) = symmetric::eigen(&covariance);
        let deviation = sigma.map(|s| s.max(0.0).sqrt());
        let smallest = deviation[0] / self.ratio;
        let scale = deviation.map(|s| (s.max(smallest) / self.filled_deviation).max(self.min_half_axis)); // Σ̃, [yu13] Eq. 15
        let mut matrix: Symmetric = [0.0; 6];
        let mut extents2 = Vec3::zeros();
        for (axis, scale) in axes.iter().zip(scale) {
            let m = 1.0 / (scale * h).powi(2);
            for (part, (a, b)) in matrix.iter_mut().zip([(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)]) {
                *part += m * axis[a] * axis[b]; // GᵀG, [yu13] Eq. 16
            }
            extents2 += axis.component_mul(axis) * (scale * h).powi(2);
        }
        let determinant = 1.0 / scale.iter().product::<f32>();
        ParticleKernel { center: x, matrix, extents: extents2.map(f32::sqrt), weight: weight * determinant }
    }
}

/// Turns isotropic kernels into ellipsoids.
pub(super) struct KernelShaper<'a> {
    shape_params: KernelShape,
    /// h of a particle of scale 1 [m].
    h: f32,
    /// The particles' scales, where these differ.
    scales: Option<&'a Scales>,
    /// λ.
    smoothing: f32,
    /// Which kernels are shaped, in the cells' order.
    shaped: Vec<bool>,
    /// Vector from every shaped particle to the mean of its neighbours [m].
    shifts: Vectors,
    /// Half the thickness of the layer in which shifts of particles of scale 1 are averaged [m].
    layer: f32,
}

impl<'a> KernelShaper<'a> {
    /// A shaper for the particles of `particles`.
    pub(super) fn new(
        particles: &SortedParticles,
        anisotropy: &Anisotropy,
        params: &DensityParams,
        scales: Option<&'a Scales>,
    ) -> Self {
        let h = params.kernel_radius * params.spacing;
        Self {
            shape_params: KernelShape {
                ratio: anisotropy.ratio,
                filled_deviation: filled_deviation_of(params.kernel_radius),
                min_half_axis: (MIN_HALF_AXIS / params.kernel_radius).min(1.0),
            },
            h,
            scales,
            smoothing: anisotropy.smoothing,
            shaped: vec![false; particles.len()],
            shifts: Vectors::new(particles),
            layer: LAYER_HALF_THICKNESS * params.spacing,
        }
    }

    /// Shapes the kernels of particles that are `near`, in the order of `particles`, and not shaped yet.
    pub(super) fn shape(
        &mut self,
        particles: &SortedParticles,
        kernels: &mut ParticleKernels,
        near: &[bool],
    ) {
        let ParticleKernels::Ellipsoids { kernels, reach } = kernels else {
            unreachable!("a shaper starts from ellipsoids")
        };
        let radius = NEIGHBOURHOOD_RADIUS * self.h;
        let scale = |place: usize| self.scales.map_or(1.0, |scales| scales.at(place));
        let is_due = |place: usize| near[place] && !self.shaped[place];
        let due =
            par::map_chunks(near.len(), par::CHUNK, |range| range.filter(|&p| is_due(p)).collect::<Vec<_>>());
        let due = due.concat();

        // Shape them, and compute the means of their neighbours.
        let shape = |place: usize, moments: &Moments| {
            let (x, weight, h) = (particles.at(place), kernels[place].weight, self.h * scale(place));
            let shape = self.shape_params.shape(x, weight, h, moments);
            (shape, moments.first / moments.zeroth * (radius * scale(place)))
        };
        let shapes = match self.scales {
            None => particles.moments::<Cubic, true, _>(radius, is_due, shape),
            Some(scales) => {
                let moments = scaled::moments::<Cubic>(particles, radius, scales, &due);
                due.iter().zip(&moments).map(|(&place, moments)| shape(place, moments)).collect()
            }
        };
        for (&place, (_, shift)) in due.iter().zip(&shapes) {
            self.shifts.set(place, *shift);
        }

        // Move them there, less the mean shift of their layer.
        let (shifts, min_shift) = (&self.shifts, MIN_SHIFT * self.layer);
        let is_long = |place: usize, shift: Vec3| shift.norm() > min_shift * scale(place);
        let is_shifted = |place: usize| is_due(place) && is_long(place, shifts.at(place));
        let common = match self.scales {
            None => particles.layer_means::<Cubic>(radius, self.layer, shifts, is_shifted),
            Some(scales) => {
                let places: Vec<usize> = due.iter().copied().filter(|&place| is_shifted(place)).collect();
                scaled::layer_means::<Cubic>(particles, radius, self.layer, scales, shifts, &places)
            }
        };
        let mut common = common.into_iter();
        for (place, (mut kernel, shift)) in due.into_iter().zip(shapes) {
            let common = if is_long(place, shift) {
                common.next().expect("one each that moves")
            } else {
                Vec3::zeros()
            };
            let own = (shift - common) * self.smoothing;
            kernel.center += own; // x̄, [yu13] Eq. 6
            *reach = reach.max(own.abs().max() + kernel.extents.max());
            kernels[place] = kernel;
            self.shaped[place] = true;
        }
    }
}

/// The particles, in the order of `particles`, so near to a brick of `bricks` that their kernels may affect
/// it.
pub(super) fn near(particles: &SortedParticles, bricks: &Bricks, voxel: f32, h: f32) -> Vec<bool> {
    let parts = par::map_chunks(particles.len(), par::CHUNK, |range| {
        let edge = f64::from(voxel) * BRICK as f64;
        let mut last = None;
        let mut is_near = false;
        range
            .map(|place| {
                let x = particles.at(place);
                let brick = |axis: usize, side: f32| {
                    ((f64::from(x[axis]) + f64::from(side * SHAPED_DISTANCE * h)) / edge).floor() as i32
                };
                let (low, high) =
                    ([0, 1, 2].map(|axis| brick(axis, -1.0)), [0, 1, 2].map(|axis| brick(axis, 1.0)));
                // Consecutive particles mostly have the same bricks.
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

/// The standard deviation of the filled cubic lattice along each axis [R]: 1/k_s.
fn filled_deviation_of(kernel_radius: f32) -> f32 {
    let radius = f64::from(NEIGHBOURHOOD_RADIUS * kernel_radius);
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
    // Kernels that reach the samples, the neighbours of those, and the neighbours that shape these.
    let reach = f64::from((1.5 + 2.0 * NEIGHBOURHOOD_RADIUS) * kernel_radius) + 5.0;
    let levels = PLANES.map(|plane| {
        let filled = plane.filled(reach);
        let positions: Vec<Vec3> = filled.into_iter().map(|j| Vec3::from(j.map(|v| v as f32))).collect();
        let particles = SortedParticles::new(&positions, kernel_radius);
        let near: Vec<bool> = (0..particles.len())
            .map(|place| particles.at(place).norm() < (1.5 + NEIGHBOURHOOD_RADIUS) * kernel_radius + 4.5)
            .collect();
        let mut shaper = KernelShaper::new(&particles, anisotropy, &params, None);
        let isotropic = weights(&particles, kernel_radius);
        let isotropic = ParticleKernels::isotropic(&particles, kernel_radius, isotropic, None);
        let mut kernels = isotropic.into_ellipsoids(&particles);
        shaper.shape(&particles, &mut kernels, &near);
        let samples = plane.samples();
        let reach = kernels.reach();
        let density = |i: usize| {
            let x = samples[i].cast::<f32>();
            let mut sum = 0.0;
            particles.cells.for_each_stretch(x.add_scalar(-reach), x.add_scalar(reach), |places| {
                sum += places.map(|place| f64::from(kernels.at(&particles, place).value(x))).sum::<f64>();
            });
            sum
        };
        par::sum(samples.len(), density) / samples.len() as f64
    });
    (levels.iter().sum::<f64>() / levels.len() as f64) as f32
}
