//! Force fields on rigid bodies.
//!
//! *Method*: the forces at points that fill a body, each with its share of the mass. A point gets the change of velocity that a free particle of its velocity would
//! get (`sim/force`), and the body the sum of the impulses and of their moments. As the motion of a rigid body is a projection of that of
//! its points, drag of any rate only slows it.
//! Limits: the points resolve a shape by [`CELLS`] cells. First order in time.

use super::obstacle::Obstacle;
use crate::{
    math::Vec3,
    sim::force::{ChunkMaximum, ForceRecord, Forces, KickedSubstep},
    solid::{RigidBody, Shape, filled_cells},
};
use nalgebra::Vector3;

/// Cells along the longest side of a body.
const CELLS: f32 = 6.0;

/// The forces and the points at which they act.
#[derive(Clone, Debug)]
pub(super) struct BodyForces {
    forces: Forces,
    /// From the centre of mass of each body to points in its own axes [m], and their shares of the mass.
    points: Vec<Vec<(Vec3, f64)>>,
    /// What they did in the frame.
    pub(super) record: ForceRecord,
}

/// Points that fill a shape, from their mean, and their shares.
fn filling_points(shape: &Shape) -> Vec<(Vec3, f64)> {
    let (mut points, _) = filled_cells(shape, CELLS).unwrap_or_default();
    points.retain(|(_, share)| *share > 0.0);
    let whole: f64 = points.iter().map(|(_, share)| share).sum();
    let mean: Vector3<f64> = points.iter().map(|(x, share)| x.cast::<f64>() * (share / whole)).sum();
    points.iter().map(|(x, share)| (x - mean.cast::<f32>(), share / whole)).collect()
}

impl BodyForces {
    pub(super) fn new(forces: Forces, obstacles: &[Obstacle]) -> Self {
        let points = obstacles.iter().map(|body| filling_points(&body.shape)).collect();
        Self { forces, points, record: ForceRecord::default() }
    }

    /// Rate of substeps from `now` [s] in which forces and `gravity` move no body farther than its largest motion [1/s].
    pub(super) fn rate(
        &self,
        now: f64,
        (bodies, obstacles): (&[RigidBody], &[Obstacle]),
        gravity: &Vector3<f64>,
    ) -> f64 {
        let snapshot = self.forces.at(now);
        let rates = bodies.iter().zip(obstacles).map(|(body, obstacle)| {
            let sample = snapshot.sample(body.position().cast());
            let v: Vec3 = body.velocity().cast();
            let slip = sample.target().map_or(0.0, |target| f64::from((target - v).norm()));
            let steady = gravity.cast() + snapshot.uniform;
            sample.substep_rate(v, steady, obstacle.largest_motion(), [body.velocity().norm(), slip])
        });
        rates.fold(0.0, f64::max)
    }

    /// Impulse and its moment about the centre of mass on each body in the substep from `now` of `dt` [s], without those of `gravity`.
    pub(super) fn impulses(
        &mut self,
        [now, dt]: [f64; 2],
        (bodies, obstacles): (&[RigidBody], &[Obstacle]),
        gravity: &Vector3<f64>,
    ) -> Vec<[Vector3<f64>; 2]> {
        let Self { forces, points, record } = self;
        let snapshot = forces.at(now);
        let (mut all, mut largest) = (Vec::new(), Vec::new());
        for ((body, obstacle), points) in bodies.iter().zip(obstacles).zip(&*points) {
            let substep = KickedSubstep {
                uniform: snapshot.uniform,
                gravity: gravity.cast(),
                dt: dt as f32,
                longest: obstacle.largest_motion() as f32,
            };
            let turn = body.pose().rotation.cast::<f64>();
            let (mut sum, mut maximum) = ([Vector3::zeros(); 2], ChunkMaximum::default());
            for &(point, share) in points {
                let arm = turn * point.cast::<f64>();
                let v = body.velocity() + body.angular_velocity().cross(&arm);
                let kick = snapshot.sample((body.position() + arm).cast()).kick(v.cast(), &substep);
                let impulse = kick.change.cast::<f64>() * (body.mass() * share);
                sum[0] += impulse;
                sum[1] += arm.cross(&impulse);
                maximum.add(&kick, all.len());
            }
            all.push(sum);
            largest.push(maximum);
        }
        let strongest = |k: usize| {
            let body: &RigidBody = &bodies[k];
            forces.strongest(now, body.position().cast(), body.velocity().cast())
        };
        record.add(largest, strongest);
        all
    }

    /// Applies these impulses, and adds their work to the record.
    pub(super) fn apply(&mut self, impulses: &[[Vector3<f64>; 2]], bodies: &mut [RigidBody]) {
        for (body, [linear, angular]) in bodies.iter_mut().zip(impulses) {
            let before = [body.velocity(), body.angular_velocity()];
            body.apply(*linear, *angular);
            body.advance();
            let [v, omega] = [before[0] + body.velocity(), before[1] + body.angular_velocity()];
            self.record.work += 0.5 * (linear.dot(&v) + angular.dot(&omega));
        }
    }
}
