//! The forces on the liquid's particles in a substep.
//!
//! *Method*: see `sim/force/`. The particles are sampled where they are when a substep begins, which gives its length and the velocities
//! that forces add.

use crate::{
    math::Vec3,
    par,
    sim::force::{ChunkMaximum, ForceRecord, Forces, KickedSubstep, Sample},
};

/// Forces and what they do in the current substep.
#[derive(Debug)]
pub(super) struct ForceField {
    forces: Forces,
    /// Time of the samples [s].
    now: f64,
    /// Acceleration that is the same everywhere [m/s²].
    uniform: Vec3,
    /// RMS of the accelerations, gravity included, over the particles [m/s²].
    magnitude: f32,
    /// What else acts on each particle; empty: nothing.
    samples: Vec<Sample>,
    /// Changes of the velocities by forces in the substep [m/s].
    pub(super) change: Vec<Vec3>,
    /// Sum over the particles of their changes times the velocities before [m²/s²].
    along_velocities: f64,
    pub(super) record: ForceRecord,
}

impl ForceField {
    pub(super) fn new(forces: Forces) -> Self {
        Self {
            forces,
            now: 0.0,
            uniform: Vec3::zeros(),
            magnitude: 0.0,
            samples: Vec::new(),
            change: Vec::new(),
            along_velocities: 0.0,
            record: ForceRecord::default(),
        }
    }

    /// Acceleration that is the same everywhere [m/s²].
    pub(super) fn uniform(&self) -> Vec3 {
        self.uniform
    }

    /// RMS of the accelerations, gravity included [m/s²].
    pub(super) fn magnitude(&self) -> f32 {
        self.magnitude
    }

    /// Samples the particles at `x` [m] at the time `now` [s].
    pub(super) fn sample(&mut self, x: &[Vec3], now: f64, gravity: Vec3) {
        let snapshot = self.forces.at(now);
        (self.uniform, self.now) = (snapshot.uniform, now);
        self.samples.clear();
        let steady = gravity + self.uniform;
        self.magnitude = steady.norm();
        if snapshot.is_local() && !x.is_empty() {
            self.samples.resize(x.len(), Sample::default());
            par::fill(&mut self.samples, |i| snapshot.sample(x[i]));
            let samples = &self.samples;
            let square = |i: usize| f64::from((steady + samples[i].acceleration).norm_squared());
            self.magnitude = (par::sum(x.len(), square) / x.len() as f64).sqrt() as f32;
        }
    }

    /// Samples the particles that entered after the others.
    pub(super) fn sample_entered(&mut self, x: &[Vec3], now: f64) {
        let snapshot = self.forces.at(now);
        if snapshot.is_local() {
            let known = self.samples.len();
            self.samples.extend(x.iter().skip(known).map(|&x| snapshot.sample(x)));
        }
    }

    /// Rate of substeps that the CFL rule wants for displacements of at most `longest` [m], next to others of speed `other` [m/s].
    pub(super) fn substep_rate(&self, v: &[Vec3], gravity: Vec3, longest: f64, other: f64) -> f64 {
        let steady = gravity + self.uniform;
        let rate = |i: usize| {
            let sample = &self.samples[i];
            let speed = f64::from(v[i].norm());
            let slip = sample.target().map_or(0.0, |target| f64::from((target - v[i]).norm()));
            let speeds = [speed, speed.max(slip)].map(|speed| speed + other);
            sample.substep_rate(v[i], steady, longest, speeds) as f32
        };
        par::max(self.samples.len(), rate).map_or(0.0, |(_, rate)| f64::from(rate))
    }

    /// Adds to the velocities of particles at `x` [m] what forces change in `dt` [s], at most `longest` [m] over `dt`.
    pub(super) fn kick(&mut self, x: &[Vec3], v: &mut [Vec3], gravity: Vec3, [dt, longest]: [f32; 2]) {
        let substep = KickedSubstep { uniform: self.uniform, gravity, dt, longest };
        self.change.resize(v.len(), Vec3::zeros());
        let samples = &self.samples;
        let parts = par::map_chunks_mut([&mut *v, &mut self.change], par::CHUNK, |start, [v, change]| {
            let mut largest = ChunkMaximum::default();
            for (k, (v, change)) in v.iter_mut().zip(change).enumerate() {
                let kick = samples.get(start + k).copied().unwrap_or_default().kick(*v, &substep);
                *change = kick.change;
                *v += kick.change;
                largest.add(&kick, start + k);
            }
            largest
        });
        let (forces, change, now) = (&self.forces, &self.change, self.now);
        self.record.add(parts, |i| forces.strongest(now, x[i], v[i] - change[i]));
    }

    /// Keeps what the work depends on of the velocities `v` that forces have changed [m/s].
    pub(super) fn keep_velocities(&mut self, v: &[Vec3]) {
        let change = &self.change;
        let along = |i: usize| change[i].cast::<f64>().dot(&(v[i] - change[i]).cast());
        self.along_velocities = par::sum(change.len().min(v.len()), along);
    }

    /// Work of the forces on particles of `mass` [kg] that moved from `x` to `p` [m] in `dt` [s] [J]: by the mean of the velocities before
    /// and over the substep, which makes it the change of the kinetic energy of a free particle.
    pub(super) fn add_work(&mut self, x: &[Vec3], p: &[Vec3], mass: f64, dt: f32) -> f64 {
        let change = &self.change;
        let along = |i: usize| change[i].cast::<f64>().dot(&(p[i] - x[i]).cast());
        let along_displacements = par::sum(change.len().min(p.len()), along) / f64::from(dt);
        let work = 0.5 * mass * (self.along_velocities + along_displacements);
        self.record.work += work;
        work
    }
}
