//! Kernels that follow their neighbourhoods.
//!
//! *Method* [yu13] section 4: a weighted covariance of the neighbours tells along which axes a particle's surroundings
//! stretch; the kernel is stretched alike, and its centre moved towards their mean. w = 1 − (r/R)³ within R = 2h.
//! *Departs from the paper*: k_s is the filled lattice's own, so that no constant depends on units; particles with no
//! surface near keep the ball, which they would get up to the liquid's disorder.
//!
//! Symbols: C → covariance [R²]; Σ̃ → `scale` [–]; G = R Σ̃⁻¹ Rᵀ/h [1/m]; λ → `smoothing`; k_r → `ratio`.
//! Limits: a lone particle, or one with few neighbours, is a ball of half the radius.

use super::{
    DensityParams,
    blob::{Blob, Blobs},
    cloud::{Cloud, Moments, Weight},
    density::{Shell, kernel, shells},
};
use crate::{
    math::{
        Vec3,
        symmetric::{self, Symmetric},
    },
    par,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How kernels follow their neighbourhoods.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Anisotropy {
    /// How far kernels move from their particle to the mean of its neighbours: 0 not at all, 1 all the way. More is
    /// smoother, and rounds edges.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub smoothing: f32,
    /// The longest axis of a kernel over its shortest. More makes flat sheets flatter.
    #[schemars(range(min = 1.0, max = 16.0))]
    pub ratio: f32,
}

impl Default for Anisotropy {
    fn default() -> Self {
        Self { smoothing: 0.9, ratio: 4.0 }
    }
}

/// R/h.
const REACH: f32 = 2.0;

/// N_ε: with as many neighbours or fewer, a covariance means little.
const FEW: f32 = 25.0;

/// k_n: the radius of a particle with [`FEW`] neighbours [h].
const LONE: f32 = 0.5;

/// The weight of the covariance.
struct Cubic;

impl Weight for Cubic {
    #[inline(always)]
    fn of(q: f32) -> f32 {
        1.0 - q * q * q // [yu13] Eq. 11
    }
}

/// The kernels of all particles, in the order of `cloud`.
pub(super) fn ellipsoids(
    positions: &[Vec3],
    cloud: &Cloud,
    shells: &[Shell],
    anisotropy: &Anisotropy,
    params: &DensityParams,
) -> Blobs {
    let h = params.kernel_radius * params.spacing;
    let wide = Cloud::new(positions, REACH * h);
    // What cloud knows by its order is needed by the other's.
    let mut by_index = vec![Shell::default(); positions.len()];
    for (&index, &shell) in cloud.cells.order().iter().zip(shells) {
        by_index[index as usize] = shell;
    }
    let order = wide.cells.order();
    let open: Vec<bool> = order.iter().map(|&index| by_index[index as usize].open).collect();
    let near_surface = |stretches: &[[u32; 2]; 9]| {
        stretches.iter().any(|&[from, to]| open[from as usize..to as usize].contains(&true))
    };
    let lattice = lattice_variance(params.kernel_radius);
    let blobs = wide.moments::<Cubic, true, _>(REACH * h, near_surface, |place, moments| {
        let weight = by_index[order[place] as usize].weight;
        blob(wide.at(place), weight, moments, anisotropy, h, lattice)
    });
    let mut sorted = vec![Blob::default(); blobs.len()];
    let mut place_of = vec![0; blobs.len()];
    for (place, &index) in order.iter().enumerate() {
        place_of[index as usize] = place;
    }
    par::fill(&mut sorted, |place| blobs[place_of[cloud.cells.order()[place] as usize]]);
    let reach = par::max(sorted.len(), |place| {
        (sorted[place].center - cloud.at(place)).abs().max() + sorted[place].extents.max()
    });
    Blobs::Ellipsoids { blobs: sorted, reach: reach.map_or(h, |(_, reach)| reach) }
}

/// The kernel of one particle at `x` with isotropic weight `weight`; `lattice` is the covariance of filled space.
fn blob(x: Vec3, weight: f32, moments: &Moments, anisotropy: &Anisotropy, h: f32, lattice: f32) -> Blob {
    if moments.count == 0.0 {
        return ball(x, weight, h, 1.0);
    }
    let mean = moments.first / moments.zeroth;
    let center = x + mean * (anisotropy.smoothing * REACH * h); // x̄, [yu13] Eq. 6
    if moments.count <= FEW + 1.0 {
        return ball(center, weight, h, LONE); // [yu13] Eq. 15
    }
    let mut covariance = moments.second;
    for (part, (a, b)) in covariance.iter_mut().zip([(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)]) {
        *part = *part / moments.zeroth - mean[a] * mean[b]; // C, [yu13] Eq. 9
    }
    let (sigma, axes) = symmetric::eigen(&covariance);
    let least = sigma[0] / anisotropy.ratio;
    let scale = sigma.map(|s| s.max(least) / lattice); // Σ̃, [yu13] Eq. 15
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
    Blob { center, matrix, extents: extents2.map(f32::sqrt), weight: weight * determinant }
}

/// A round kernel of radius `scale` h.
fn ball(center: Vec3, weight: f32, h: f32, scale: f32) -> Blob {
    let m = 1.0 / (scale * h).powi(2);
    let extents = Vec3::repeat(scale * h);
    Blob { center, matrix: [m, m, m, 0.0, 0.0, 0.0], extents, weight: weight / scale.powi(3) }
}

/// The covariance of the filled lattice along each axis [R²]: 1/k_s.
fn lattice_variance(kernel_radius: f32) -> f32 {
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
    (second / sum) as f32
}

/// The mean φ half a spacing beyond a filled half-space of the cubic lattice: the surface of the filled volume, whatever
/// the kernels' stretch and smoothing did to it.
pub(super) fn threshold(anisotropy: &Anisotropy, kernel_radius: f32) -> f32 {
    let params = DensityParams {
        spacing: 1.0,
        kernel_radius,
        voxel: 0.5,
        anisotropy: Some(*anisotropy),
        whole: false,
    };
    // As wide as the kernels that reach the middle see, as deep as the surface is felt.
    let reach = ((1.5 + REACH) * kernel_radius).ceil() as i32 + 1;
    let depth = (REACH * kernel_radius).ceil() as i32 + 2;
    let mut positions = Vec::new();
    for z in -depth..=0 {
        for y in -reach..=reach {
            positions.extend((-reach..=reach).map(|x| Vec3::new(x as f32, y as f32, z as f32)));
        }
    }
    let cloud = Cloud::new(&positions, kernel_radius);
    let shells = shells(&cloud, kernel_radius, &params);
    let blobs = ellipsoids(&positions, &cloud, &shells, anisotropy, &params);
    let samples = 8;
    let mut sum = 0.0;
    for sample in 0..samples * samples {
        let at = |i: i32| (i as f32 + 0.5) / samples as f32;
        let x = Vec3::new(at(sample % samples), at(sample / samples), 0.5);
        for place in 0..cloud.len() {
            let blob = blobs.at(&cloud, place);
            let d = x - blob.center;
            let [xx, yy, zz, xy, xz, yz] = blob.matrix;
            let q2 = xx * d.x * d.x
                + yy * d.y * d.y
                + zz * d.z * d.z
                + 2.0 * (xy * d.x * d.y + xz * d.x * d.z + yz * d.y * d.z);
            sum += f64::from(blob.weight * kernel(q2.max(0.0).sqrt()));
        }
    }
    (sum / f64::from(samples * samples)) as f32
}
