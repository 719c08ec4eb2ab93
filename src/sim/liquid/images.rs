//! Images of particles in rigid bodies: the density that a body contributes to the liquid, and the forces that follow from it.
//!
//! *Method*: the method of images for a smooth wall. Particles at the distances d_i and d_j from a plane are r apart, and the image of
//! one behind it is r' = √(r² + 4 d_i d_j) from the other, which is exact at planes, and the same for both, so that density and
//! forces derive from one energy: momentum is exact, and a body that comes to rest leaves the liquid at rest. An image moves along the surface with its particle.
//! The density of a solid that does not change where the liquid at it thins out holds the first layer of particles together, and this moves along with
//! the body (docs/decisions/048). Weights c_i c_j with c² the density of the body over that of a half space as near account for curvature,
//! edges and thin parts (`walls/rigid.rs`).
//! *Departs from* mirrored ghost particles ([schechter12]): none are made.
//!
//! The displacement of particle i by its images splits into one along x_i − x_j, which is opposite to that of j, and one along the normal
//! and the slope of the weight, which the body takes up at x_i.
//! Symbols: r'/h → q; m W(r')/ρ₀ → `density` [1]; m |∇W|/(r' ρ₀) → `slope` [1/m] for offsets over h; c → `weight`.

use super::{calibration::RestState, pair::kernel_and_slope, walls::Mirror};
use crate::{math::Vec3, par, space::Neighbours};
use std::ops::Range;

/// Mark of a particle that is not near a body.
pub(super) const NO_PAIR: u32 = u32::MAX;

/// Cosine between the normals of two particles below which they are on opposite sides of a thin body, where neither has an image for the other.
/// It is off 0 and −0.5, which the normals at faces of boxes and prisms have: with 0 as the limit liquid at rest around a floating box takes 27 to
/// 40 iterations a substep in place of 18.
const OPPOSITE: f32 = -0.65;

/// Distances from a body, over h, between which the share of the normal gradient that is due to a gap falls from 1 to 0: half a spacing and one
/// at `kernel_radius = 2`.
const GAP_FADE: [f32; 2] = [0.25, 0.5];

/// A particle near a rigid body.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Pair {
    pub(super) particle: u32,
    pub(super) body: u32,
    /// Position in this iteration [m].
    pub(super) x: Vec3,
    /// The body's surface as the particle sees it.
    pub(super) mirror: Mirror,
}

/// Results of an iteration at a [`Pair`], stored separately because neighbours read only the geometry.
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
    /// Index of the first pair of each particle, or [`NO_PAIR`]; empty where nothing is sampled.
    pub(super) first_pair: &'a [u32],
    pub(super) pairs: &'a [Pair],
    /// One for each pair.
    pub(super) samples: &'a [PairSample],
}

/// For each pair, the pairs of its particle's neighbours with the same body whose images may come near before lists are built again.
#[derive(Debug, Default)]
pub(super) struct ImageLists(Vec<ImageChunk>);

/// The lists of up to [`par::CHUNK`] pairs.
#[derive(Debug)]
struct ImageChunk {
    /// The list of the chunk's pair k ends at `ends[k]`, and starts at the end of the one before.
    ends: Vec<u32>,
    list: Vec<u32>,
}

impl ImageLists {
    /// Finds the pairs among the neighbours. The pairs have their positions when the lists were built, and lower bounds of the distances from the
    /// body that they will have; `skin` is how much closer two particles may come, over h.
    pub(super) fn rebuild(
        &mut self,
        lists: &Neighbours,
        first_pair: &[u32],
        pairs: &[Pair],
        [inv_h, skin]: [f32; 2],
    ) {
        self.0 = par::map_chunks(pairs.len(), par::CHUNK, |range| {
            let (mut ends, mut list) = (Vec::with_capacity(range.len()), Vec::new());
            for own in &pairs[range] {
                let &Pair { particle, body, x, .. } = own;
                let may_come_near = |other: &Pair| {
                    let nearest = ((x - other.x).norm() * inv_h - skin).max(0.0);
                    nearest * nearest + 4.0 * own.mirror.distance * other.mirror.distance < 1.0
                };
                let of_body = |&j: &u32| {
                    let mut range = range_of(first_pair, pairs, j as usize);
                    let other = range.find(|&other| pairs[other].body == body)?;
                    may_come_near(&pairs[other]).then_some(other as u32)
                };
                list.extend(lists.of(particle as usize).iter().filter_map(of_body));
                ends.push(list.len() as u32);
            }
            list.shrink_to_fit();
            ImageChunk { ends, list }
        });
    }

    /// The list of pair `k`.
    #[inline]
    fn of(&self, k: usize) -> &[u32] {
        let ImageChunk { ends, list } = &self.0[k / par::CHUNK];
        let k = k % par::CHUNK;
        let start = if k == 0 { 0 } else { ends[k - 1] };
        &list[start as usize..ends[k] as usize]
    }
}

/// Indices of the pairs of particle `i`.
#[inline]
fn range_of(first_pair: &[u32], pairs: &[Pair], i: usize) -> Range<usize> {
    let Some(&first) = first_pair.get(i).filter(|&&first| first != NO_PAIR) else { return 0..0 };
    let first = first as usize;
    let count = pairs[first..].iter().take_while(|pair| pair.particle as usize == i).count();
    first..first + count
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

/// Slope of the kernel of a neighbour at `offset` over h.
#[inline]
fn real_slope(rest: &RestState, offset: Vec3) -> f32 {
    let q2 = offset.norm_squared();
    if q2 < 1.0 { kernel_and_slope(rest.kernel, q2).1 } else { 0.0 }
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
        for Pair { mirror, .. } in &self.pairs[range_of(self.first_pair, self.pairs, i)] {
            let [all, none] = GAP_FADE;
            let gap_share = ((none - mirror.distance) / (none - all)).clamp(0.0, 1.0);
            gradient -= mirror.normal * (gap_share * gradient.dot(&mirror.normal));
        }
        gradient
    }

    /// Density of all other solids at particle `i`, and its gradient [1/m], if it is near a rigid body.
    #[inline(always)]
    pub(super) fn of_colliders(self, i: usize) -> Option<(f32, Vec3)> {
        let &first = self.first_pair.get(i)?;
        self.samples.get(first as usize).map(|sample| sample.colliders)
    }
}

/// The particles near rigid bodies and their images, in an iteration.
#[derive(Clone, Copy)]
pub(super) struct Images<'a> {
    pub(super) rest: &'a RestState,
    pub(super) pairs: &'a [Pair],
    pub(super) lists: &'a ImageLists,
}

impl Images<'_> {
    /// Calls `term` with each neighbour whose image is near the particle of pair `k`: its pair, x_i − x_j over h, kernel, and slope.
    #[inline]
    fn for_each(self, k: usize, mut term: impl FnMut(&Pair, Vec3, f32, f32)) {
        let (rest, pair) = (self.rest, &self.pairs[k]);
        for &other in self.lists.of(k) {
            let other = &self.pairs[other as usize];
            if pair.mirror.normal.dot(&other.mirror.normal) < OPPOSITE {
                continue;
            }
            let offset = (pair.x - other.x) * rest.inv_support;
            let q2 = offset.norm_squared() + 4.0 * pair.mirror.distance * other.mirror.distance;
            if q2 < 1.0 {
                let (w, s) = kernel_and_slope(rest.kernel, q2);
                term(other, offset, w * rest.density_scale, s * rest.gradient_scale);
            }
        }
    }

    /// Density of the images at the particle of pair `k`.
    pub(super) fn density(self, k: usize) -> ImageDensity {
        let (rest, pair) = (self.rest, &self.pairs[k]);
        let own = &pair.mirror;
        let mut sum = ImageDensity::default();
        if let Some((w, s)) = own_image(rest, pair) {
            sum.density = w * own.weight * own.weight;
            sum.gradient = own.slope * (2.0 * own.weight * w) - own.normal * s;
            sum.of_body[0] = sum.gradient;
        }
        sum.density += own.excess.0;
        sum.gradient += own.excess.1;
        sum.of_body[0] += own.excess.1;
        self.for_each(k, |other, offset, w, s| {
            let other = &other.mirror;
            let s = own.weight * other.weight * s;
            sum.density += own.weight * other.weight * w;
            let of_own = own.slope * (other.weight * w) - own.normal * (2.0 * other.distance * s);
            let of_other = other.slope * (own.weight * w) - other.normal * (2.0 * own.distance * s);
            sum.gradient += of_own - offset * s;
            let by_image = of_other + offset * s;
            let by_itself = offset * (real_slope(rest, offset) * rest.gradient_scale);
            sum.others2 += by_image.dot(&(by_image + by_itself * 2.0));
            sum.of_body[0] += of_own + of_other;
            // The body acts on the neighbour where that is.
            sum.of_body[1] -= (offset * rest.support).cross(&of_other);
        });
        sum
    }

    /// Displacement of the particle of pair `k` by its images, with the changes of λ that `value` gives [m²].
    pub(super) fn push(self, k: usize, value: impl Fn(u32) -> f32) -> ImagePush {
        let pair = &self.pairs[k];
        let (own, lambda) = (&pair.mirror, value(pair.particle));
        let mut sum = ImagePush::default();
        if let Some((w, s)) = own_image(self.rest, pair).filter(|_| lambda != 0.0) {
            sum.by_body = (own.slope * (2.0 * own.weight * w) - own.normal * s) * lambda;
        }
        sum.by_body += own.excess.1 * lambda;
        self.for_each(k, |other, offset, w, s| {
            let both = lambda + value(other.particle);
            if both != 0.0 {
                let s = own.weight * other.mirror.weight * s;
                sum.by_neighbours -= offset * (s * both);
                let of_own =
                    own.slope * (other.mirror.weight * w) - own.normal * (2.0 * other.mirror.distance * s);
                sum.by_body += of_own * both;
            }
        });
        sum
    }
}

/// Density of a particle's own image, without the weight, and the slope of the weighted one with the distance [1/m].
#[inline]
fn own_image(rest: &RestState, pair: &Pair) -> Option<(f32, f32)> {
    let q = 2.0 * pair.mirror.distance;
    (q < 1.0).then(|| {
        let (w, s) = kernel_and_slope(rest.kernel, q * q);
        let squared = pair.mirror.weight * pair.mirror.weight;
        (w * rest.density_scale, 2.0 * q * s * rest.gradient_scale * squared)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        sim::liquid::{
            Constraint, Kernel,
            setup::{LIST_SKIN, SolverSetup},
            solve::Solver,
            walls::Walls,
        },
        solid::{Pose, Shape, Solid, sampled_mesh},
    };

    const SPACING: f32 = 0.02;

    /// A solver whose lists are those of `p`, and a rigid body at `place`.
    fn at_body(shape: Shape, pose: Pose, kernel: Kernel, p: Vec<Vec3>) -> (Solver, Walls, RestState) {
        let rest = RestState::new(kernel, SPACING, 2.5);
        let mut walls = Walls::new(&[], &rest);
        walls.add_rigid_bodies(&[Solid::fixed(shape)], |_| 1.0);
        walls.set_rigid_bodies([[pose, pose]].into_iter());
        let mut solver = Solver::default();
        solver.p = p;
        solver.find_cells(&rest).expect("no crowd");
        let setup =
            SolverSetup { rest: &rest, walls: &walls, constraint: Constraint::Equality, softening: 0.0 };
        solver.build_lists(&setup);
        solver.sample_rigid_pairs(&setup);
        (solver, walls, rest)
    }

    fn at(position: Vec3) -> Pose {
        Pose { position, ..Pose::identity() }
    }

    fn cuboid(half: f32) -> Shape {
        Shape::Box { min: [-half; 3], max: [half; 3] }
    }

    /// Particles on a cubic lattice above z = 0, the first layer at half a spacing from it.
    fn layers() -> Vec<Vec3> {
        let place = |k: u32| Vec3::new((k % 9) as f32 - 4.0, (k / 9 % 9) as f32 - 4.0, (k / 81) as f32 + 0.5);
        (0..729).map(|k| place(k) * SPACING).collect()
    }

    #[test]
    fn the_density_at_a_flat_face_is_that_inside_the_liquid() {
        for kernel in [Kernel::Wendland, Kernel::Poly6Spiky] {
            let half = 0.5;
            let (mut solver, walls, rest) = at_body(cuboid(half), at(Vec3::z() * -half), kernel, layers());
            let setup =
                SolverSetup { rest: &rest, walls: &walls, constraint: Constraint::Equality, softening: 0.0 };
            solver.measure(&setup);
            for layer in 0..3 {
                let ratio = solver.ratio[4 + 9 * 4 + 81 * layer];
                assert!((ratio - 1.0).abs() < 1e-3, "{kernel:?}, layer {layer}: {ratio}");
            }
        }
    }

    fn images<'a>(solver: &'a Solver, rest: &'a RestState) -> Images<'a> {
        Images { rest, pairs: &solver.rigid.pairs, lists: &solver.rigid.images }
    }

    /// Sum over the particles of λ_i times the density of their images.
    fn weighted_density(solver: &Solver, rest: &RestState, lambda: impl Fn(u32) -> f32) -> f64 {
        let images = images(solver, rest);
        let density = |k: usize| images.density(k).density;
        (0..images.pairs.len()).map(|k| f64::from(lambda(images.pairs[k].particle) * density(k))).sum()
    }

    /// A number from −0.5 to 0.5 for each `k`.
    fn noise(k: u32) -> f32 {
        (k.wrapping_mul(2_654_435_761) >> 16) as f32 / 65536.0 - 0.5
    }

    /// Disordered particles around a shape.
    fn cloud_around(shape: &Shape) -> Vec<Vec3> {
        let place = |k: u32| {
            let cell = Vec3::new((k % 11) as f32, (k / 11 % 11) as f32, (k / 121) as f32);
            let shift = Vec3::new(noise(3 * k), noise(3 * k + 1), noise(3 * k + 2)) * 0.4;
            (cell - Vec3::repeat(5.0) + shift) * SPACING
        };
        (0..1331).map(place).filter(|x| shape.signed_distance(*x) > 0.3 * SPACING).collect()
    }

    #[test]
    fn densities_at_edges_do_not_depend_on_rounding() {
        let (shape, kernel) = (cuboid(0.05), Kernel::Wendland);
        let cloud = cloud_around(&shape);
        let turned = |angle: f32| -> Vec<f32> {
            let rotation = *nalgebra::Rotation3::from_euler_angles(angle, 2.0 * angle, 3.0 * angle).matrix();
            let pose = Pose { rotation, ..Pose::identity() };
            let p = cloud.iter().map(|x| pose.to_world(*x)).collect();
            at_body(shape.clone(), pose, kernel, p).0.rigid.samples.iter().map(|s| s.image.density).collect()
        };
        let expected = turned(0.0);
        for angle in [0.1, 0.2, 0.3, 0.4] {
            for (density, expected) in turned(angle).iter().zip(&expected) {
                assert!((density - expected).abs() < 1e-3, "{density} turned by {angle}, {expected} else");
            }
        }
    }

    #[test]
    fn lists_hold_every_image_until_particles_or_bodies_have_moved_by_their_skins() {
        let torus = Shape::Torus { center: [0.0; 3], axis: [0.0, 0.0, 1.0], radius: 0.06, tube: 0.03 };
        let mesh = sampled_mesh(0.02, |x| x.abs().amax() - 0.05);
        for shape in [cuboid(0.05), Shape::Sphere { center: [0.0; 3], radius: 0.06 }, torus, mesh] {
            let cloud = cloud_around(&shape);
            let (mut solver, mut walls, rest) =
                at_body(shape.clone(), Pose::identity(), Kernel::Wendland, cloud.clone());
            let skin = LIST_SKIN * rest.support;
            // Each particle towards the body, which comes towards those on one side.
            let place = |x: &Vec3| x - x.normalize() * (0.499 * skin);
            let pose = at(Vec3::new(1.0, 1.0, 0.0).normalize() * (0.999 * skin));
            let moved: Vec<Vec3> = cloud.iter().map(place).collect();
            solver.p.clone_from(&moved);
            walls.set_rigid_bodies([[pose, pose]].into_iter());
            let setup =
                SolverSetup { rest: &rest, walls: &walls, constraint: Constraint::Equality, softening: 0.0 };
            solver.sample_rigid_pairs(&setup);
            let by_particle = |solver: &Solver| {
                let mut densities = vec![0.0; cloud.len()];
                for (pair, sample) in solver.rigid.pairs.iter().zip(&solver.rigid.samples) {
                    densities[pair.particle as usize] = sample.image.density;
                }
                densities
            };
            let found = by_particle(&solver);
            let expected = by_particle(&at_body(shape.clone(), pose, Kernel::Wendland, moved).0);
            for (i, (found, expected)) in found.iter().zip(&expected).enumerate() {
                assert!((found - expected).abs() < 1e-6, "{shape:?}, particle {i}: {found}, not {expected}");
            }
            // Most neighbours have no image as near.
            let listed: usize = (0..solver.rigid.pairs.len()).map(|k| solver.rigid.images.of(k).len()).sum();
            let neighbours: usize =
                solver.rigid.pairs.iter().map(|pair| solver.lists.of(pair.particle as usize).len()).sum();
            println!("{listed} of {neighbours}, {} pairs", solver.rigid.pairs.len());
            assert!(2 * listed < neighbours, "{shape:?}: {listed} of {neighbours}");
        }
    }

    #[test]
    fn gaps_between_a_body_and_its_first_layer_are_no_surface_of_air() {
        let pair = |distance: f32| Pair {
            mirror: Mirror { distance, normal: Vec3::z(), ..Mirror::default() },
            ..Pair::default()
        };
        let gradient = Vec3::new(3.0, 4.0, -5.0);
        let left = |pairs: &[Pair], first_pair: &[u32]| {
            BodySamples { first_pair, pairs, samples: &[] }.without_gaps(0, gradient)
        };
        for (distance, part) in [(0.0, 0.0), (0.25, 0.0), (0.4, 0.6), (0.5, 1.0), (0.9, 1.0)] {
            let found = left(&[pair(distance)], &[0]);
            let expected = Vec3::new(3.0, 4.0, -5.0 * part);
            assert!((found - expected).norm() < 1e-5, "{distance}: {found:?}");
        }
        assert_eq!(left(&[pair(0.1)], &[NO_PAIR]), gradient, "of another particle");
        let other = Pair { mirror: Mirror { normal: Vec3::x(), ..Mirror::default() }, ..Pair::default() };
        assert_eq!(left(&[pair(0.1), other], &[0]), Vec3::new(0.0, 4.0, 0.0), "in a wedge of two bodies");
    }

    #[test]
    fn pushes_are_the_gradients_of_the_density_and_bodies_take_up_the_rest() {
        let lambda = |i: u32| 1.0 + noise(7 * i);
        for shape in [cuboid(0.05), Shape::Sphere { center: [0.0; 3], radius: 0.06 }] {
            let cloud = cloud_around(&shape);
            let (solver, _, rest) = at_body(shape.clone(), Pose::identity(), Kernel::Wendland, cloud.clone());
            let images = images(&solver, &rest);
            let pairs = images.pairs;
            let push = |k: usize| images.push(k, lambda);
            let pushes: Vec<ImagePush> = (0..pairs.len()).map(push).collect();
            let size = pushes.iter().map(|push| push.by_body.norm()).fold(0.0, f32::max);
            let step = 2e-3 * SPACING;
            for k in (0..pushes.len()).step_by(pushes.len() / 12) {
                let i = pairs[k].particle as usize;
                for axis in 0..3 {
                    let moved = |by: f32| {
                        let mut p = cloud.clone();
                        p[i][axis] += by;
                        let (solver, _, rest) = at_body(shape.clone(), Pose::identity(), Kernel::Wendland, p);
                        weighted_density(&solver, &rest, lambda)
                    };
                    let slope = (moved(step) - moved(-step)) / f64::from(2.0 * step);
                    let push = (pushes[k].by_neighbours + pushes[k].by_body)[axis];
                    assert!(
                        (slope - f64::from(push)).abs() < 0.01 * f64::from(size),
                        "{shape:?} {i}: {slope}, {push}"
                    );
                }
            }
            // Neighbours exchange momentum, and the body takes up what changes the density as it moves.
            let sum = |part: fn(&ImagePush) -> Vec3| pushes.iter().map(part).sum::<Vec3>();
            assert!(sum(|push| push.by_neighbours).norm() < 1e-4 * size * pushes.len() as f32);
            let at_pairs = || pairs.iter().zip(&solver.rigid.samples);
            let of_body =
                at_pairs().map(|(pair, own)| own.image.of_body[0] * lambda(pair.particle)).sum::<Vec3>();
            assert!((of_body - sum(|push| push.by_body)).norm() < 1e-4 * size * pushes.len() as f32);
            let moment = |(pair, own): (&Pair, &PairSample)| {
                (pair.x.cross(&own.image.of_body[0]) + own.image.of_body[1]) * lambda(pair.particle)
            };
            let of_body_moment = at_pairs().map(moment).sum::<Vec3>();
            let moments =
                pairs.iter().zip(&pushes).map(|(pair, push)| pair.x.cross(&push.by_body)).sum::<Vec3>();
            assert!(
                (of_body_moment - moments).norm() < 1e-5 * size * pushes.len() as f32,
                "{of_body_moment}, {moments}"
            );
            let at = |x: f32| {
                let (solver, _, rest) =
                    at_body(shape.clone(), at(Vec3::x() * x), Kernel::Wendland, cloud.clone());
                weighted_density(&solver, &rest, lambda)
            };
            let slope = (at(-step) - at(step)) / f64::from(2.0 * step);
            let taken = f64::from(of_body.x);
            assert!(
                (slope - taken).abs() < 0.01 * f64::from(size) * (pushes.len() as f64).sqrt(),
                "{slope}, {taken}"
            );
        }
    }
}
