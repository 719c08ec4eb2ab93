//! Kernels of particles of different radii.
//!
//! *Method*: as [`super::density`], with a support h_j of each particle's own, in proportion to its radius, and its own mass,
//! m_j ~ h_j³: V_j = m_j/ρ_j, ρ_j = Σ_k m_k W(x_j − x_k, h_j). Neighbourhoods of anisotropic kernels scale alike.
//!
//! Symbols: w_j = V_j W(0, h_j) = 1/Σ_k (m_k/m_j) K(r_jk/h_j) [–].
//!
//! Limits: every particle gathers by itself, without the groups of equal kernels: where all scales are 1, a surface takes
//! 1.6 times as long, and 2.4 times with anisotropic kernels and smoothing.
//! The time of a particle grows with the cube of its scale.

use super::{
    kernel::kernel,
    sorted_particles::{Moments, SortedParticles, Vectors, Weight},
};
use crate::{math::Vec3, par};

/// Support of each particle's kernel over that of a particle of half the spacing, in the cells' order.
pub(super) struct Scales {
    values: Vec<f32>,
    pub(super) largest: f32,
}

impl Scales {
    /// The scales in the cells' order, of those in the order of the positions.
    pub(super) fn new(particles: &SortedParticles, scales: &[f32]) -> Self {
        let order = particles.cells.order();
        let values: Vec<f32> = order.iter().map(|&i| scales[i as usize]).collect();
        // Without particles nothing is in reach.
        let largest = values.iter().copied().fold(0.0, f32::max);
        Self { values, largest }
    }

    /// The places of particles below a scale.
    pub(super) fn below(&self, scale: f32) -> Vec<usize> {
        (0..self.values.len()).filter(|&place| self.values[place] < scale).collect()
    }

    #[inline(always)]
    pub(super) fn at(&self, place: usize) -> f32 {
        self.values[place]
    }
}

/// Calls `f(other, vector to it over the radius, its length)` for all particles within `radius` [m] of one, itself included.
fn for_each_within(
    particles: &SortedParticles,
    place: usize,
    radius: f32,
    mut f: impl FnMut(usize, Vec3, f32),
) {
    let x = particles.at(place);
    let inverse = 1.0 / radius;
    particles.cells.for_each_stretch(x.add_scalar(-radius), x.add_scalar(radius), |places| {
        for other in places {
            let d = (particles.at(other) - x) * inverse;
            let q = d.norm();
            if q < 1.0 {
                f(other, d, q);
            }
        }
    });
}

/// V_j W(0, h_j) of every particle, in the cells' order; `radius` is the support of a particle of scale 1 [m].
pub(super) fn weights(particles: &SortedParticles, radius: f32, scales: &Scales) -> Vec<f32> {
    let mut weights = vec![0.0; particles.len()];
    par::fill(&mut weights, |place| {
        let own = scales.at(place);
        let mut sum = 0.0;
        for_each_within(particles, place, radius * own, |other, _, q| {
            sum += (scales.at(other) / own).powi(3) * kernel(q);
        });
        1.0 / sum
    });
    weights
}

/// Moments at each of `places`, within `radius` [m] times the particle's scale.
pub(super) fn moments<W: Weight>(
    particles: &SortedParticles,
    radius: f32,
    scales: &Scales,
    places: &[usize],
) -> Vec<Moments> {
    par::map(places.len(), |i| {
        let place = places[i];
        let mut moments = Moments::default();
        for_each_within(particles, place, radius * scales.at(place), |_, d, q| {
            let w = W::of(q);
            moments.zeroth += w;
            moments.first += d * w;
            let products = [d.x * d.x, d.y * d.y, d.z * d.z, d.x * d.y, d.x * d.z, d.y * d.z];
            for (part, product) in moments.second.iter_mut().zip(products) {
                *part += w * product;
            }
            moments.count += f32::from(u8::from(w > 0.0));
        });
        moments
    })
}

/// As [`SortedParticles::layer_means`], with lengths times each particle's scale.
pub(super) fn layer_means<W: Weight>(
    particles: &SortedParticles,
    radius: f32,
    half: f32,
    scales: &Scales,
    vectors: &Vectors,
    places: &[usize],
) -> Vec<Vec3> {
    par::map(places.len(), |i| {
        let place = places[i];
        let normal = vectors.at(place).try_normalize(0.0).unwrap_or_default() * (radius / half);
        let (mut sum, mut weight) = (Vec3::zeros(), 0.0);
        for_each_within(particles, place, radius * scales.at(place), |other, d, q| {
            let distance = d.dot(&normal);
            let w = W::of(q) * (1.0 - distance * distance).max(0.0);
            sum += vectors.at(other) * w;
            weight += w;
        });
        sum / weight
    })
}
