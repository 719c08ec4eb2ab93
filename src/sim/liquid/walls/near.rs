//! Bodies near a particle or its path, from the grid over them (`body_grid.rs`). A few colliders without rigid bodies are compared one by one.

use super::{MovingSolid, Walls};
use crate::{math::Vec3, solid::Pose};

/// Number of colliders up to which all are near everything.
const MAX_COLLIDERS_WITHOUT_CELLS: usize = 4;

impl MovingSolid {
    /// Upper bound of how far any of its points is from where it was at `pose` [m].
    pub(super) fn displacement_since(&self, pose: &Pose) -> f32 {
        let Self { now, center, reach, .. } = self;
        let shift = (now.to_world(*center) - pose.to_world(*center)).norm();
        shift + (now.rotation - pose.rotation).norm() * reach
    }
}

impl Walls {
    /// Distance [m] within which [`Walls::near`] finds all bodies: collisions look as far ahead as the density reaches.
    pub(in crate::sim::liquid) fn near_reach(&self) -> f32 {
        2.0 * self.support
    }

    /// Distance that solids may move before the grid is built again [m].
    fn near_skin(&self) -> f32 {
        0.25 * self.support
    }

    /// Indices of the bodies that may be closer to `x` than `reach` [m], at most [`Walls::near_reach`], ascending.
    #[inline(always)]
    pub(super) fn near(&self, x: Vec3, reach: f32) -> impl Iterator<Item = usize> + '_ {
        self.near_of_first(self.bodies.len(), x, reach)
    }

    /// As [`Walls::near`], of the first `count` bodies alone.
    #[inline(always)]
    pub(super) fn near_of_first(
        &self,
        count: usize,
        x: Vec3,
        reach: f32,
    ) -> impl Iterator<Item = usize> + '_ {
        self.closer_than(self.listed(count, x), 0..0, x, reach)
    }

    /// Those of the first `count` bodies that are listed where `x` is.
    #[inline(always)]
    fn listed(&self, count: usize, x: Vec3) -> &[u32] {
        if count == 0 {
            return &[];
        }
        let all = self.grid.cell(x);
        if count == self.bodies.len() {
            return all;
        }
        &all[..all.partition_point(|&body| (body as usize) < count)]
    }

    /// Whether a rigid body may be closer to `x` than [`Walls::near_reach`].
    #[inline]
    pub(in crate::sim::liquid) fn may_be_near_rigid_body(&self, x: Vec3) -> bool {
        let first = self.bodies.len() - self.rigid_bodies();
        self.grid.cell(x).last().is_some_and(|&last| last as usize >= first)
    }

    /// Those of the `listed` bodies, and of `others`, whose bounding balls are closer to `x` than `reach` [m].
    #[inline(always)]
    fn closer_than<'a>(
        &'a self,
        listed: &'a [u32],
        others: std::ops::Range<usize>,
        x: Vec3,
        reach: f32,
    ) -> impl Iterator<Item = usize> + 'a {
        let all = listed.iter().map(|&body| body as usize).chain(others);
        let has_cells = !self.grid.starts.is_empty();
        all.filter(move |&body| {
            let (center, radius) = self.grid.balls[body];
            let reach = radius + reach;
            !has_cells || (x - center).norm_squared() <= reach * reach
        })
    }

    /// Indices of those of the first `count` bodies that a particle may meet on its path from `from` to `to`, while solids move through the substep.
    #[inline]
    pub(super) fn near_path(&self, count: usize, from: Vec3, to: Vec3) -> impl Iterator<Item = usize> + '_ {
        let length = (to - from).norm() + 2.0 * self.largest_displacement + self.support / 2.0;
        let is_short = self.grid.starts.is_empty() || length <= self.near_reach();
        let (near, all) = if is_short { (self.listed(count, from), 0..0) } else { (&[][..], 0..count) };
        self.closer_than(near, all, from, length)
    }

    /// Builds the grid of bodies, unless it holds for their poses.
    pub(super) fn refresh_near(&mut self) {
        let moved = |mover: &MovingSolid, pose: &Pose| mover.displacement_since(pose);
        self.largest_displacement =
            self.movers.iter().map(|mover| moved(mover, &mover.before)).fold(0.0, f32::max);
        let ball = |body: &super::Body| {
            let center = body.mover.map_or(body.center, |mover| self.movers[mover].now.to_world(body.center));
            // Rounding must not exclude a body.
            (center, body.reach * 1.0001 + 1e-3 * self.support)
        };
        self.grid.balls.clear();
        self.grid.balls.extend(self.bodies.iter().map(ball));
        let built = &self.grid.built_at;
        let since = self.movers.iter().zip(built).map(|(mover, pose)| moved(mover, pose));
        let is_built = self.grid.members.len() >= self.bodies.len() && built.len() == self.movers.len();
        if is_built && (self.grid.starts.is_empty() || since.fold(0.0, f32::max) <= self.near_skin()) {
            return;
        }
        let pad = Vec3::repeat(self.near_reach() + self.near_skin());
        let bounds = |body: &super::Body| {
            let half = body.half_extent;
            let pose = body.mover.map_or_else(Pose::identity, |mover| self.movers[mover].now);
            let (center, half) = (pose.to_world(body.center), pose.rotation.abs() * half + pad);
            (center - half, center + half)
        };
        let boxes: Vec<(Vec3, Vec3)> = self.bodies.iter().map(bounds).collect();
        let poses = self.movers.iter().map(|mover| mover.now).collect();
        self.grid.built_at = poses;
        let has_cells = boxes.len() > MAX_COLLIDERS_WITHOUT_CELLS || self.rigid_bodies() > 0;
        self.grid.rebuild(&boxes, has_cells);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        sim::liquid::{Kernel, calibration::RestState},
        solid::{Shape, Solid},
    };

    #[test]
    fn every_body_within_reach_is_found_and_few_others() {
        let rest = RestState::new(Kernel::Wendland, 0.1, 2.0);
        let place = |k: u32, prime: u32| f32::from((k * prime % 101) as u16) / 10.1;
        let ball = |k: u32| Shape::Sphere {
            center: [place(k, 7), place(k, 31), place(k, 57)],
            radius: 0.1 + 0.02 * f32::from((k % 11) as u16),
        };
        for count in [3, 60] {
            let solids: Vec<Solid> = (0..count).map(|k| Solid::fixed(ball(k))).collect();
            let walls = Walls::new(&solids, &rest);
            let mut found = 0;
            for k in 0..2000_u32 {
                let x = Vec3::new(place(k, 13), place(k, 37), place(k + 5, 71)) * 1.2 - Vec3::repeat(1.0);
                let near: Vec<usize> = walls.near(x, walls.near_reach()).collect();
                assert!(near.is_sorted());
                found += near.len();
                for (index, body) in walls.bodies.iter().enumerate() {
                    let is_near = walls.body_distance(body, x) < walls.near_reach();
                    assert!(!is_near || near.contains(&index), "{index} at {x}");
                }
            }
            assert!(count == 3 || found < 2000 * 3, "{found}");
        }
    }

    #[test]
    fn rigid_bodies_that_move_are_found_where_they_are() {
        let rest = RestState::new(Kernel::Wendland, 0.1, 2.0);
        let bar = Shape::Box { min: [-0.3, -0.1, -0.1], max: [0.3, 0.1, 0.1] };
        let mut walls = Walls::new(&[], &rest);
        let bars: Vec<Solid> = (0..12).map(|_| Solid::fixed(bar.clone())).collect();
        walls.add_rigid_bodies(&bars, |_| 1.0);
        // Slower than the grid is built anew in a step, faster, and back.
        for step in [0.0_f32, 0.04, 0.08, 0.5, 0.46, 3.0, 0.0] {
            let pose = |k: u8| Pose {
                position: Vec3::new(f32::from(k) + step, f32::from(k % 3) - step, step),
                ..Pose::identity()
            };
            walls.set_rigid_bodies((0..12).map(|k| [pose(k); 2]));
            for k in 0..3000_u16 {
                let part = |prime: u16| f32::from((u32::from(k) * u32::from(prime) % 2999) as u16) / 2999.0;
                let x = Vec3::new(16.0 * part(37) - 1.0, 7.0 * part(73) - 4.0, 5.0 * part(151) - 1.0);
                let near: Vec<usize> = walls.rigid_bodies_near(x, walls.near_reach()).collect();
                for (index, body) in walls.bodies.iter().enumerate() {
                    let is_near = walls.body_distance(body, x) < walls.near_reach();
                    assert_eq!(is_near, near.contains(&index), "{index} at {x}");
                }
            }
        }
    }
}
