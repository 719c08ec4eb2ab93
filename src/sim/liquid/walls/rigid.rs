//! Rigid bodies among the solids: their poses, and what a particle near one pushes it with.
//!
//! Bodies come after all colliders, in the order of the bodies of the simulation, which sets their poses.

use super::{Body, CONTACT, MovingSolid, Plane, Walls};
use crate::{
    math::Vec3,
    solid::{Pose, Shape, Solid},
};

/// Contact distance between particles and rigid bodies [spacings]: the layer of particles is held by its images, and must be free to thin out.
const RIGID_CONTACT: f32 = 0.25;

/// Density over that of the liquid below which bodies have the contact distance of colliders. The pressure of images falls with the distance below
/// 0.4 spacings, from which on the inertia of a body must keep it: with
/// the distance above a ball of 1.5 spacings and 0.03 of the density jumps with 1.6 m/s at `kernel_radius = 2.5`, in place of 0.2; one of 0.045, and
/// larger ones, do not.
const LIGHT_BODY: f64 = 0.05;

/// Density below which the weights of images approach 1, where both that they are the quotient of vanish.
const SMALLEST_DENSITY: f32 = 0.02;

/// Upper bound of the gradient of distances that are interpolated between nodes, of which no two differ by more than their distance.
pub(in crate::sim::liquid) const STEEPEST_INTERPOLATED: f32 = 1.7321;

/// Part of a distance that rounding may amount to where contacts are excluded.
const ROUNDED_DISTANCE: f32 = 1e-3;

/// The surface of a rigid body as a particle near it sees it; see `images.rs`.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::sim::liquid) struct Mirror {
    /// Distance from the surface over h, at least 0.
    pub(in crate::sim::liquid) distance: f32,
    /// Unit normal out of the body.
    pub(in crate::sim::liquid) normal: Vec3,
    /// Weight of the particle's images [1], and its gradient [1/m].
    pub(in crate::sim::liquid) weight: f32,
    pub(in crate::sim::liquid) slope: Vec3,
    /// Density of the body that images lack in a hollow, over ρ₀, and its gradient [1/m].
    pub(in crate::sim::liquid) excess: (f32, Vec3),
}

impl Walls {
    /// Adds solids that are rigid bodies, which have bounded shapes. `density` is that of each over that of the liquid.
    pub(in crate::sim::liquid) fn add_rigid_bodies(
        &mut self,
        solids: &[Solid],
        density: impl Fn(usize) -> f64,
    ) {
        for (number, solid) in solids.iter().enumerate() {
            let is_light = density(number) < LIGHT_BODY;
            let contact = if is_light { CONTACT } else { RIGID_CONTACT } * self.rest.spacing;
            let (center, reach) = solid.shape.bounding_ball().unwrap_or_default();
            let body =
                Body { contact, center, reach, ..Body::new(solid, Some(self.movers.len()), &self.rest) };
            let (before, now) = (Pose::identity(), Pose::identity());
            self.movers.push(MovingSolid { motion: None, center, reach, before, now });
            self.bodies.push(body);
        }
        self.refresh_near();
    }

    /// Number of rigid bodies.
    #[inline]
    pub(in crate::sim::liquid) fn rigid_bodies(&self) -> usize {
        self.movers.len() - self.keyframed
    }

    /// Sets the poses of all rigid bodies at the start and at the end of the substep.
    pub(in crate::sim::liquid) fn set_rigid_bodies(&mut self, poses: impl Iterator<Item = [Pose; 2]>) {
        for (mover, [before, now]) in self.movers[self.keyframed..].iter_mut().zip(poses) {
            (mover.before, mover.now) = (before, now);
        }
        self.refresh_near();
    }

    /// The poses of the rigid bodies at the end of the substep.
    pub(in crate::sim::liquid) fn rigid_poses(&self) -> Vec<Pose> {
        self.movers[self.keyframed..].iter().map(|mover| mover.now).collect()
    }

    /// Upper bound of how far any point of a rigid body is from where it was at `pose` [m].
    pub(in crate::sim::liquid) fn rigid_displacement(&self, body: usize, pose: &Pose) -> f32 {
        self.movers[self.keyframed + body].displacement_since(pose)
    }

    /// Index among [`Self::bodies`] of a rigid body.
    pub(super) fn rigid_index(&self, body: usize) -> usize {
        self.bodies.len() - self.rigid_bodies() + body
    }

    /// The rigid bodies whose distance from `x` is below `reach` [m], at most twice the support; outside of a mesh's grid the distance is a
    /// lower bound.
    #[inline]
    pub(in crate::sim::liquid) fn rigid_bodies_near(
        &self,
        x: Vec3,
        reach: f32,
    ) -> impl Iterator<Item = usize> + '_ {
        let first = self.rigid_index(0);
        let near = self.near(x, reach).filter(move |&body| body >= first);
        near.filter(move |&body| self.body_distance(&self.bodies[body], x) < reach)
            .map(move |body| body - first)
    }

    /// The surface of a rigid body as a particle at `x` sees it. The weight is the square root of the density that the body contributes
    /// over that of a half space as near: 1 at a flat face, less at an edge. In a hollow, where images in one face are too few, it is 1, and the rest of
    /// the density is the body's own. Beyond the support the body has no density.
    pub(in crate::sim::liquid) fn mirror(&self, body: usize, x: Vec3) -> Mirror {
        let body = &self.bodies[self.rigid_index(body)];
        let own = self.own_position(body, x);
        let (d, own_normal) = body.shape.contact(own);
        let normal = self.turned(body, own_normal);
        let distance = d.max(0.0) * self.inv_support;
        let mut mirror = Mirror { distance, normal, weight: 1.0, ..Mirror::default() };
        if distance >= 1.0 {
            return mirror;
        }
        let density = |shift: f32| self.body_density_with(body, [x, own], || (d, own_normal), shift);
        let (share, falls) = density(0.0);
        let of_half_space = self.half_space_density(d, 0.0) + SMALLEST_DENSITY;
        let falls_of_half_space = normal * self.half_space_slope(d);
        let squared = (share + SMALLEST_DENSITY) / of_half_space;
        if squared < 1.0 {
            mirror.weight = squared.sqrt();
            mirror.slope = (falls_of_half_space * squared - falls) / (2.0 * mirror.weight * of_half_space);
        } else {
            let excess = density(self.shift).0 - self.half_space_density(d, self.shift);
            mirror.excess = (excess.max(0.0), falls_of_half_space - falls);
        }
        mirror
    }

    /// Whether the density of a rigid body may exceed that of a half space as near, as in a hollow of a mesh.
    pub(in crate::sim::liquid) fn has_hollows(&self, body: usize) -> bool {
        self.bodies[self.rigid_index(body)].density_map.is_some()
    }

    /// Lower bound of the distance of [`Walls::mirror`] of a particle at `x`, over h, after particle and body have come closer by up to `margin` [m].
    pub(in crate::sim::liquid) fn min_mirror_distance(&self, body: usize, x: Vec3, margin: f32) -> f32 {
        let body = &self.bodies[self.rigid_index(body)];
        let steepest = if matches!(body.shape, Shape::Mesh(_)) { STEEPEST_INTERPOLATED } else { 1.0 };
        (self.body_contact(body, x).0 - steepest * margin).max(0.0) * self.inv_support
    }

    /// Whether a particle at `x`, which sees a rigid body as `mirror`, stays out of contact with it in a move of `length` [m].
    #[inline]
    pub(in crate::sim::liquid) fn excludes_rigid_contact(
        &self,
        body: usize,
        x: Vec3,
        mirror: &Mirror,
        length: f32,
    ) -> bool {
        let body = &self.bodies[self.rigid_index(body)];
        // Outside of a mesh's grid the distance of a mirror is an upper bound.
        let distance = match body.shape {
            Shape::Mesh(_) => self.body_distance(body, x),
            _ => mirror.distance * self.support,
        };
        distance * (1.0 - ROUNDED_DISTANCE) > body.contact + STEEPEST_INTERPOLATED * length
    }

    /// Share of a rigid body in the gradient of [`Walls::boundary_density`] at `x` [1/m].
    pub(in crate::sim::liquid) fn rigid_gradient(&self, body: usize, x: Vec3) -> Vec3 {
        let own = self.rigid_index(body);
        let (mut others, mut slope_of_own) = (1.0_f32, Vec3::zeros());
        for plane in &self.planes {
            let d = plane.n.dot(&x) - plane.offset;
            if d < self.support {
                others *= 1.0 - self.half_space_density(d, self.shift);
            }
        }
        for index in self.near(x, self.support) {
            let body = &self.bodies[index];
            if self.body_distance(body, x) < self.support {
                if index == own {
                    slope_of_own = self.body_slope(body, x);
                } else {
                    others *= 1.0 - self.body_density(body, x, self.shift).0;
                }
            }
        }
        slope_of_own * -others
    }

    /// The rigid body that pushed a particle to `x` by a projection of `push`, with its normal; `None` if another solid did. Of
    /// several solids in contact, it is the one whose normal is closest to the projection, as for [`Walls::work`].
    pub(in crate::sim::liquid) fn rigid_contact(&self, x: Vec3, push: Vec3) -> Option<(usize, Vec3)> {
        let of_plane = |plane: &Plane| {
            let d = plane.n.dot(&x) - plane.offset;
            (d < 1.5 * self.contact).then_some((None, plane.n))
        };
        let planes = self.planes.iter().filter_map(of_plane);
        let first = self.bodies.len() - self.rigid_bodies();
        let bodies = self.near(x, self.support).filter_map(|index| {
            let body = &self.bodies[index];
            if self.body_distance(body, x) >= 1.5 * body.contact {
                return None;
            }
            let (d, n) = self.body_contact(body, x);
            (d < 1.5 * body.contact).then_some((index.checked_sub(first), n))
        });
        let touching = planes.chain(bodies).map(|(body, n)| (body, n, n.dot(&push)));
        let facing = touching.filter(|&(_, _, along)| along > 0.0);
        let best = facing.reduce(|a, b| if b.2 > a.2 { b } else { a });
        best.and_then(|(body, n, _)| Some((body?, n)))
    }
}
