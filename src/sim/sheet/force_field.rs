//! The force fields on the points of sheets in a substep.

use super::vectors::Vectors;
use crate::{
    math::Vec3,
    par,
    sim::force::{ChunkMaximum, ForceRecord, Forces, KickedSubstep, Sample},
};

/// Forces and what they do in the current substep.
#[derive(Debug)]
pub(super) struct ForceField {
    forces: Forces,
    /// Mean accelerations of the points over the substep [m/s²].
    pub(super) mean: Vec<Vec3>,
    /// Velocities of the points before the substep [m/s], and its length [s].
    before: (Vec<Vec3>, f32),
    /// Counts of the substep.
    pub(super) record: ForceRecord,
}

/// The points in a substep.
pub(super) struct Points<'a> {
    /// Positions [m].
    pub(super) x: &'a Vectors,
    /// Velocities [m/s].
    pub(super) v: &'a Vectors,
    /// Area of each point [m²]. Its root is the length that forces may move a point in a substep.
    pub(super) area: &'a [f32],
    pub(super) gravity: Vec3,
}

impl ForceField {
    pub(super) fn new(forces: Forces) -> Self {
        Self { forces, mean: Vec::new(), before: (Vec::new(), 0.0), record: ForceRecord::default() }
    }

    /// The longest substep from `now` [s] in which forces move no point by more than its length [s].
    pub(super) fn longest_substep(&self, points: &Points<'_>, now: f64) -> f64 {
        let snapshot = self.forces.at(now);
        let rate = |i: usize| {
            let (sample, v) = (snapshot.sample(points.x.get(i)), points.v.get(i));
            let slip = sample.target().map_or(0.0, |target| f64::from((target - v).norm()));
            let length = f64::from(points.area[i]).sqrt();
            // A drag reduces what gravity adds, too.
            let gravity = sample.target().map_or(Vec3::zeros(), |_| points.gravity);
            sample.substep_rate(v, gravity + snapshot.uniform, length, [0.0, slip]) as f32
        };
        1.0 / par::max(points.x.len(), rate).map_or(0.0, |(_, rate)| f64::from(rate))
    }

    /// Finds the mean accelerations over a substep from `now` of `dt` [s].
    pub(super) fn evaluate(&mut self, points: &Points<'_>, now: f64, dt: f64) {
        let snapshot = self.forces.at(now);
        self.mean.resize(points.x.len(), Vec3::zeros());
        self.before.0.resize(points.x.len(), Vec3::zeros());
        par::fill(&mut self.before.0, |i| points.v.get(i));
        self.before.1 = dt as f32;
        let parts = par::map_chunks_mut([&mut self.mean[..]], par::CHUNK, |start, [mean]| {
            let mut largest = ChunkMaximum::default();
            for (k, mean) in mean.iter_mut().enumerate() {
                let i = start + k;
                let sample: Sample = snapshot.sample(points.x.get(i));
                let substep = KickedSubstep {
                    uniform: snapshot.uniform,
                    gravity: points.gravity,
                    dt: dt as f32,
                    longest: points.area[i].sqrt(),
                };
                let kick = sample.kick(points.v.get(i), &substep);
                *mean = kick.change / dt as f32;
                largest.add(&kick, i);
            }
            largest
        });
        let forces = &self.forces;
        self.record.add(parts, |i| forces.strongest(now, points.x.get(i), points.v.get(i)));
    }

    /// Adds the counts of the substep, and the work on points of these masses [kg] and mobilities that moved from `before` to `after`,
    /// to the record of the frame.
    pub(super) fn account(
        &mut self,
        [before, after]: [&Vectors; 2],
        [mass, mobility]: [&[f32]; 2],
        record: &mut ForceRecord,
    ) {
        let (mean, (velocity, dt)) = (&self.mean, &self.before);
        // By the mean of the velocities before and over the substep, as for the liquid.
        let work = |i: usize| {
            let moved = (after.get(i) - before.get(i) + velocity[i] * *dt).cast::<f64>() * 0.5;
            if mobility[i] > 0.0 { f64::from(mass[i]) * mean[i].cast::<f64>().dot(&moved) } else { 0.0 }
        };
        record.work += par::sum(mean.len(), work);
        record.unite(&std::mem::take(&mut self.record));
    }
}
