//! Rigid bodies among the solids: their poses, and what a particle near one pushes it with.
//!
//! Bodies come after all colliders, in the order of the bodies of the simulation, which sets their poses.

use super::{Body, MovingSolid, Walls};
use crate::{
    math::Vec3,
    solid::{Pose, Solid},
};

/// Density of solids near a rigid body.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::sim::liquid) struct RigidDensity {
    /// Density of all solids over ρ₀, and its gradient [1/m].
    pub(in crate::sim::liquid) density: f32,
    pub(in crate::sim::liquid) gradient: Vec3,
    /// Share of the body in the gradient [1/m].
    pub(in crate::sim::liquid) own_gradient: Vec3,
}

impl Walls {
    /// Adds solids that are rigid bodies, which have bounded shapes.
    pub(in crate::sim::liquid) fn add_rigid_bodies(&mut self, solids: &[Solid]) {
        for solid in solids {
            let body = Body::new(solid, Some(self.movers.len()), &self.rest);
            let (center, reach) = (body.center, body.reach);
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

    /// Density of the solids at `x` over ρ₀ and its gradient, as [`Walls::boundary_density`], with the share of one rigid body.
    pub(in crate::sim::liquid) fn rigid_density(&self, body: usize, x: Vec3) -> RigidDensity {
        let own = self.rigid_index(body);
        let (mut open, mut open_gradient) = (1.0_f32, Vec3::zeros());
        let (mut others, mut slope_of_own) = (1.0_f32, Vec3::zeros());
        let mut add = |left: f32, slope: Vec3, is_own: bool| {
            open_gradient = open_gradient * left + slope * open;
            open *= left;
            if is_own {
                slope_of_own = slope;
            } else {
                others *= left;
            }
        };
        for plane in &self.planes {
            let d = plane.n.dot(&x) - plane.offset;
            if d < self.support {
                add(1.0 - self.half_space_density(d), plane.n * self.half_space_slope(d), false);
            }
        }
        for index in self.near(x, self.support) {
            let body = &self.bodies[index];
            if self.body_distance(body, x) < self.support {
                let (share, slope) = self.body_density(body, x);
                add(1.0 - share, slope, index == own);
            }
        }
        RigidDensity { density: 1.0 - open, gradient: -open_gradient, own_gradient: slope_of_own * -others }
    }

    /// The rigid body that pushed a particle to `x` by a projection of `push`, with its normal; `None` if another solid did. Of
    /// several solids in contact, it is the one whose normal is closest to the projection, as for [`Walls::work`].
    pub(in crate::sim::liquid) fn rigid_contact(&self, x: Vec3, push: Vec3) -> Option<(usize, Vec3)> {
        let planes = self.planes.iter().map(|plane| (None, plane.n.dot(&x) - plane.offset, plane.n));
        let first = self.bodies.len() - self.rigid_bodies();
        let bodies = self.near(x, self.support).filter_map(|index| {
            let body = &self.bodies[index];
            if self.body_distance(body, x) >= 1.5 * self.contact {
                return None;
            }
            let (d, n) = self.body_contact(body, x);
            Some((index.checked_sub(first), d, n))
        });
        let touching = planes.chain(bodies).filter(|&(_, d, _)| d < 1.5 * self.contact);
        let facing =
            touching.map(|(body, _, n)| (body, n, n.dot(&push))).filter(|&(_, _, along)| along > 0.0);
        let best = facing.reduce(|a, b| if b.2 > a.2 { b } else { a });
        best.and_then(|(body, n, _)| Some((body?, n)))
    }
}
