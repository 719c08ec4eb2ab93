//! Images of particles in rigid bodies: the density that a body contributes to the liquid, and the forces that follow from it.
//!
//! *Method*: the method of images for a smooth wall. Particles at the distances d_i and d_j from a plane are r apart, and the image of
//! one behind it is r' = √(r² + 4 d_i d_j) from the other, which is exact at planes, and the same for both, so that density and
//! forces derive from one energy: momentum is exact, and a body that comes to rest leaves the liquid at rest. An image moves along the surface with its particle.
//! The density of a solid that does not change where the liquid at it thins out holds the first layer of particles together, and this moves along with
//! the body (docs/decisions/048). Weights c_i c_j with c² the density of the body over that of a half space as near account for curvature,
//! edges and thin parts (`walls/rigid.rs`).
//! The sums of a particle run over eight images at a time.
//! *Departs from* mirrored ghost particles ([schechter12]): none are made.
//!
//! The displacement of particle i by its images splits into one along x_i − x_j, which is opposite to that of j, and one along the normal
//! and the slope of the weight, which the body takes up at x_i.
//! Symbols: r'/h → q; m W(r')/ρ₀ → `density` [1]; m |∇W|/(r' ρ₀) → `slope` [1/m] for offsets over h; c → `weight`.

use super::{
    calibration::RestState,
    lanes,
    pair::{Pair, kernel_and_slope},
    pass::{self, NeighbourPass},
    rigid_pairs::{ImageLists, ImageNodeLanes, ImageNodes, NO_PAIR, RigidPair, range_of},
    setup::SolverSetup,
    walls::{Mirror, Walls},
};
use crate::{math::Vec3, par, simd::Lanes};

/// Cosine between the normals of two particles below which they are on opposite sides of a thin body, where neither has an image for the other.
/// It is off 0 and −0.5, which the normals at faces of boxes and prisms have: with 0 as the limit liquid at rest around a floating box takes 27 to
/// 40 iterations a substep in place of 18.
const OPPOSITE: f32 = -0.65;

/// Distances from a body, over h, between which the share of the normal gradient that is due to a gap falls from 1 to 0: half a spacing and one
/// at `kernel_radius = 2`.
const GAP_FADE: [f32; 2] = [0.25, 0.5];

/// Results of an iteration at a [`RigidPair`].
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct PairSample {
    /// Density of the colliders there over ρ₀, and its gradient [1/m].
    pub(super) colliders: (f32, Vec3),
    /// Density of the particle's images there.
    pub(super) image: ImageDensity,
    /// Displacement of the particle by its images in the last correction.
    pub(super) push: ImagePush,
    /// What the body yields along the gradient of that density.
    pub(super) gives: f32,
}

/// The particles near rigid bodies, with the surfaces that they see.
#[derive(Clone, Copy)]
pub(super) struct BodySamples<'a> {
    /// Index of the first pair of each particle, or `NO_PAIR`; empty where nothing is sampled.
    pub(super) first_pair: &'a [u32],
    pub(super) pairs: &'a [RigidPair],
    /// One for each pair.
    pub(super) samples: &'a [PairSample],
}

/// Eight images at a particle.
#[derive(Clone, Copy)]
struct ImageLanes<L> {
    /// x_i − x_j over h, and its square.
    offset: ([L; 3], L),
    /// Density without the weights.
    w: L,
    /// Slope with both weights.
    s: L,
}

impl<L: Lanes> ImageLanes<L> {
    #[inline(always)]
    fn of<P: Pair>(rest: &RestState, own: ImageNodeLanes<L>, other: ImageNodeLanes<L>) -> Self {
        let ([_, _, _, own_distance], [_, _, _, other_distance]) = (own.place, other.place);
        let offset = lanes::offset(own.place, other.place);
        let q2 = offset.1 + L::splat(4.0) * own_distance * other_distance;
        let q = q2.sqrt();
        let [a, b] = [own.face, other.face];
        let is_opposite = (a[0] * b[0] + a[1] * b[1] + a[2] * b[2]).less(L::splat(OPPOSITE));
        let shown = L::select(is_opposite, L::splat(0.0), L::splat(1.0));
        let w = P::density(q2, q) * (L::splat(rest.density_scale) * shown);
        let s = P::slope(q) * (L::splat(rest.gradient_scale) * shown) * (a[3] * b[3]);
        Self { offset, w, s }
    }
}

/// Density of the images at a particle.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct ImageDensity {
    /// Over ρ₀.
    pub(super) density: f32,
    /// Gradient with the particle's position [1/m].
    pub(super) gradient: Vec3,
    /// What images add to the sum over neighbours of the squared gradients with their positions [1/m²].
    pub(super) others2: f32,
    /// Negative gradient with the position of the body [1/m], and its moment about the particle.
    pub(super) of_body: [Vec3; 2],
}

/// Displacement of a particle by its images [m].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct ImagePush {
    /// The part that neighbours take up.
    pub(super) by_neighbours: Vec3,
    /// The part that the body takes up.
    pub(super) by_body: Vec3,
}

impl<'a> BodySamples<'a> {
    /// Samples at the pairs of particle `i`.
    #[inline]
    pub(super) fn of(self, i: usize) -> &'a [PairSample] {
        &self.samples[range_of(self.first_pair, self.pairs, i)]
    }

    /// The gradient of the density at particle `i` without what a gap between a body and the particle contributes: the part along the normal, at
    /// the distance of the first layer.
    ///
    /// Images leave the first layer free to thin out and to come closer, which is no surface of air. With the part along the normal its deficit
    /// ([`super::density`]) changes from substep to substep and does work: water at rest moves at 0.2 m/s at a ball (docs/decisions/049).
    /// Between two bodies whose normals are neither parallel nor at right angles, a part along the first stays.
    #[inline(always)]
    pub(super) fn without_gaps(self, i: usize, mut gradient: Vec3) -> Vec3 {
        for RigidPair { mirror, .. } in &self.pairs[range_of(self.first_pair, self.pairs, i)] {
            let [all, none] = GAP_FADE;
            let gap_share = ((none - mirror.distance) / (none - all)).clamp(0.0, 1.0);
            gradient -= mirror.normal * (gap_share * gradient.dot(&mirror.normal));
        }
        gradient
    }

    /// Whether particle `i`, which is near a rigid body, stays clear of all solids in a move of `length` [m]. `displacement2` is that since the
    /// lists were built, squared [m²].
    #[inline]
    pub(super) fn excludes_contact(
        self,
        i: usize,
        setup: &SolverSetup<'_>,
        length: f32,
        displacement2: f32,
    ) -> bool {
        let pairs = &self.pairs[range_of(self.first_pair, self.pairs, i)];
        let Some(first) = pairs.first() else { return false };
        // Bodies without a pair are farther away than the density of solids reaches.
        let others = first.collider_distance.min(setup.boundary_reach());
        let is_clear = |&RigidPair { body, x, ref mirror, .. }: &RigidPair| {
            setup.walls.excludes_rigid_contact(body as usize, x, mirror, length)
        };
        !setup.is_near_solid(others, displacement2) && pairs.iter().all(is_clear)
    }

    /// Density of the solids without images at particle `i`, which is at `x`, and its gradient [1/m].
    #[inline(always)]
    pub(super) fn boundary_density(self, i: usize, x: Vec3, walls: &Walls) -> (f32, Vec3) {
        let Some(&first) = self.first_pair.get(i) else { return walls.boundary_density(x) };
        match self.samples.get(first as usize) {
            Some(sample) => sample.colliders,
            None => walls.collider_density(x),
        }
    }

    /// End of the path of particle `i` from `from` to `to` while the solids do not move, and whether it is still in contact.
    #[inline(always)]
    pub(super) fn collide(self, i: usize, [from, to]: [Vec3; 2], walls: &Walls) -> (Vec3, bool) {
        match self.first_pair.get(i) {
            Some(&NO_PAIR) => walls.collide_with_colliders(from, to),
            _ => walls.collide(from, to),
        }
    }
}

/// The particles near rigid bodies and their images, in an iteration.
#[derive(Clone, Copy)]
pub(super) struct Images<'a> {
    pub(super) rest: &'a RestState,
    pub(super) pairs: &'a [RigidPair],
    pub(super) lists: &'a ImageLists,
    pub(super) nodes: &'a ImageNodes,
}

impl Images<'_> {
    /// Evaluates the densities of the images at the particles of all pairs.
    pub(super) fn find_densities(self, samples: &mut [PairSample]) {
        self.evaluate::<false>(samples);
    }

    /// Evaluates the displacements of the particles of all pairs by their images, with the λ of the nodes.
    pub(super) fn find_pushes(self, samples: &mut [PairSample]) {
        self.evaluate::<true>(samples);
    }

    fn evaluate<const PUSHES: bool>(self, samples: &mut [PairSample]) {
        par::for_chunks(samples, par::CHUNK, |start, samples| {
            pass::run(self.rest.kernel, ImagePass::<PUSHES> { at: self, start, samples });
        });
    }

    /// Density of the images at the particle of pair `k`.
    #[inline(always)]
    fn density<L: Lanes, P: Pair>(self, k: usize) -> ImageDensity {
        let zero = L::splat(0.0);
        let (own, gradient_scale) = (self.nodes.spread::<L>(k), L::splat(self.rest.gradient_scale));
        // Of the image of j: w c_j and s d_j, s (x_i − x_j), its gradient with the mirror of j, and the moment of that.
        let (mut weights, mut distances, mut others2) = (zero, zero, zero);
        let (mut along, mut of_others, mut moment) = ([zero; 3], [zero; 3], [zero; 3]);
        let mut rows = self.lists.rows::<L>(k, self.pairs.len());
        while let Some(index) = rows.next() {
            let other = self.nodes.gather::<L>(index);
            let ImageLanes { offset: (offset, r2), w, s } = ImageLanes::of::<P>(self.rest, own, other);
            weights += w * other.face[3];
            distances += s * other.place[3];
            let (of_slope, of_normal) = (w * own.face[3], L::splat(-2.0) * s * own.place[3]);
            let by_itself = gradient_scale * P::slope(r2.sqrt());
            let mut dot = zero;
            let mut of_other = [zero; 3];
            for axis in 0..3 {
                let pushed = offset[axis] * s;
                of_other[axis] = other.slope[axis] * of_slope + other.face[axis] * of_normal;
                let by_image = of_other[axis] + pushed;
                dot += by_image * (by_image + L::splat(2.0) * by_itself * offset[axis]);
                along[axis] += pushed;
                of_others[axis] += of_other[axis];
            }
            others2 += dot;
            let turned = lanes::cross(offset, of_other);
            for axis in 0..3 {
                moment[axis] += turned[axis];
            }
        }
        let [x, y, z] = along;
        let [weights, distances, others2, x, y, z, ..] =
            L::sums(&[weights, distances, others2, x, y, z, zero, zero]);
        let [along, others] = [Vec3::new(x, y, z), lanes::total(of_others)];
        let mirror = &self.pairs[k].mirror;
        let mut sum = self.own_density(k);
        let of_own = mirror.slope * weights - mirror.normal * (2.0 * distances);
        sum.density += mirror.weight * weights;
        sum.gradient += of_own - along;
        sum.others2 = others2;
        sum.of_body[0] += of_own + others;
        // The body acts on the neighbour where that is.
        sum.of_body[1] = lanes::total(moment) * -self.rest.support;
        sum
    }

    /// Density of the own image of the particle of pair `k`, and what the body has in a hollow.
    #[inline(always)]
    fn own_density(self, k: usize) -> ImageDensity {
        let (pair, mut sum) = (&self.pairs[k], ImageDensity::default());
        let own = &pair.mirror;
        if let Some((w, s)) = own_image(self.rest, pair) {
            sum.density = w * own.weight * own.weight;
            sum.gradient = own.slope * (2.0 * own.weight * w) - own.normal * s;
        }
        sum.density += own.excess.0;
        sum.gradient += own.excess.1;
        sum.of_body[0] = sum.gradient;
        sum
    }

    /// Displacement of the particle of pair `k` by its images.
    #[inline(always)]
    fn push<L: Lanes, P: Pair>(self, k: usize) -> ImagePush {
        let zero = L::splat(0.0);
        let own = self.nodes.spread::<L>(k);
        let (mut weights, mut distances, mut along) = (zero, zero, [zero; 3]);
        let mut rows = self.lists.rows::<L>(k, self.pairs.len());
        while let Some(index) = rows.next() {
            let other = self.nodes.gather::<L>(index);
            let ImageLanes { offset: (offset, _), w, s } = ImageLanes::of::<P>(self.rest, own, other);
            let both = own.slope[3] + other.slope[3];
            weights += w * other.face[3] * both;
            distances += s * other.place[3] * both;
            along = lanes::plus(along, offset, s * both);
        }
        let [x, y, z] = along;
        let [weights, distances, x, y, z, ..] = L::sums(&[weights, distances, x, y, z, zero, zero, zero]);
        let mirror = &self.pairs[k].mirror;
        let by_own_image = self.own_density(k).gradient * self.nodes.lambda(k);
        ImagePush {
            by_neighbours: -Vec3::new(x, y, z),
            by_body: by_own_image + mirror.slope * weights - mirror.normal * (2.0 * distances),
        }
    }
}

/// Evaluation of a chunk of pairs: of [`Images::push`] if `PUSHES`, else of [`Images::density`].
struct ImagePass<'a, const PUSHES: bool> {
    at: Images<'a>,
    start: usize,
    samples: &'a mut [PairSample],
}

impl<const PUSHES: bool> NeighbourPass for ImagePass<'_, PUSHES> {
    type Out = ();

    #[inline(always)]
    fn run<L: Lanes, P: Pair>(self) {
        for (k, sample) in (self.start..).zip(self.samples) {
            if PUSHES {
                sample.push = self.at.push::<L, P>(k);
            } else {
                sample.image = self.at.density::<L, P>(k);
            }
        }
    }
}

/// Whether a particle's own image is within the kernel's support.
#[inline(always)]
pub(super) fn own_image_is_near(mirror: &Mirror) -> bool {
    2.0 * mirror.distance < 1.0
}

/// Density of a particle's own image, without the weight, and the slope of the weighted one with the distance [1/m].
#[inline(always)]
fn own_image(rest: &RestState, pair: &RigidPair) -> Option<(f32, f32)> {
    if !own_image_is_near(&pair.mirror) {
        return None;
    }
    let q = 2.0 * pair.mirror.distance;
    let (w, s) = kernel_and_slope(rest.kernel, q * q);
    let squared = pair.mirror.weight * pair.mirror.weight;
    Some((w * rest.density_scale, 2.0 * q * s * rest.gradient_scale * squared))
}

#[cfg(test)]
mod tests;
