//! The liquid of cached frames, and between them.
//!
//! *Method*: particles of two frames are matched by id and move on the cubic through positions and velocities of both. A particle
//! that only one of the frames has moves with its velocity there through the half of the interval next to it.

use super::potentials::{Rates, SUPPORT};
use crate::{frame::Stream, math::Vec3, par, space::CellGrid};

/// Particles of the liquid in a cached frame, in the order of their ids, with what they emit.
#[derive(Clone, Debug, Default)]
pub(crate) struct LiquidFrame {
    /// Time since the shot's start [s].
    pub(crate) time: f64,
    /// Distance between particles at rest [m].
    pub(crate) spacing: f32,
    pub(super) id: Vec<u32>,
    pub(super) position: Vec<Vec3>,
    pub(super) velocity: Vec<Vec3>,
    /// Emission of each particle at amount 1 [1/s].
    pub(super) rate: Vec<f32>,
    /// Particles left out: without a finite place and velocity, or with the id of another.
    pub(crate) left_out: u64,
}

impl LiquidFrame {
    /// The liquid of a stream at a time since the shot's start [s]; `None` if a channel or the spacing is missing.
    pub(crate) fn new(stream: &Stream, time: f64, rates: &Rates<'_>) -> Option<Self> {
        let (position, velocity) = (stream.vec3("position")?, stream.vec3("velocity")?);
        let (id, spacing) = (stream.u32("id")?, stream.spacing()?);
        let is_finite = |i: usize| position[i].iter().chain(velocity[i].iter()).all(|c| c.is_finite());
        let mut order: Vec<u32> = (0..id.len() as u32).filter(|&i| is_finite(i as usize)).collect();
        par::sort_by_key(&mut order, |&i| (id[i as usize], i));
        order.dedup_by_key(|i| id[*i as usize]);
        let sorted = |values: &[Vec3]| -> Vec<Vec3> { order.iter().map(|&i| values[i as usize]).collect() };
        let (x, v) = (sorted(position), sorted(velocity));
        let rate = rates.of(&x, &v, spacing, time);
        Some(Self {
            time,
            spacing,
            left_out: (id.len() - order.len()) as u64,
            id: order.iter().map(|&i| id[i as usize]).collect(),
            position: x,
            velocity: v,
            rate,
        })
    }

    /// The number of particles.
    pub(crate) fn len(&self) -> usize {
        self.id.len()
    }
}

/// Path of a particle of the liquid between two frames.
#[derive(Clone, Copy, Debug)]
pub(super) struct Track {
    pub(super) id: u32,
    x: [Vec3; 2],
    v: [Vec3; 2],
    /// Emission at both ends at amount 1 [1/s].
    rate: [f32; 2],
    /// Part of the interval in which the particle exists.
    span: [f64; 2],
}

/// The liquid between two cached frames.
#[derive(Debug)]
pub(crate) struct LiquidInterval {
    /// Times of both frames [s].
    pub(super) time: [f64; 2],
    /// Particles left out of the later frame.
    pub(super) left_out: u64,
    pub(super) spacing: f32,
    /// Paths in the order of ids.
    pub(super) tracks: Vec<Track>,
}

impl Track {
    /// Place and velocity at a part of an interval of `seconds`.
    pub(super) fn at(&self, part: f64, seconds: f64) -> (Vec3, Vec3) {
        let (s, dt) = (part as f32, seconds as f32);
        let [x0, x1] = self.x;
        let [v0, v1] = self.v.map(|v| v * dt);
        let (s2, s3) = (s * s, s * s * s);
        let x = x0 * (2.0 * s3 - 3.0 * s2 + 1.0)
            + v0 * (s3 - 2.0 * s2 + s)
            + x1 * (3.0 * s2 - 2.0 * s3)
            + v1 * (s3 - s2);
        let v = (x1 - x0) * (6.0 * (s - s2)) + v0 * (3.0 * s2 - 4.0 * s + 1.0) + v1 * (3.0 * s2 - 2.0 * s);
        (x, v / dt)
    }

    /// Whether the particle exists at a part of the interval.
    pub(super) fn exists(&self, part: f64) -> bool {
        (self.span[0]..=self.span[1]).contains(&part)
    }

    /// Emission at a part of the interval at amount 1 [1/s].
    pub(super) fn rate(&self, part: f64) -> f32 {
        if !self.exists(part) {
            return 0.0;
        }
        self.rate[0] + (self.rate[1] - self.rate[0]) * part as f32
    }

    /// Largest emission in the interval at amount 1 [1/s].
    pub(super) fn max_rate(&self) -> f32 {
        self.rate[0].max(self.rate[1])
    }
}

impl LiquidInterval {
    /// The interval between two frames, of which the second is later.
    pub(crate) fn new(a: &LiquidFrame, b: &LiquidFrame) -> Self {
        let dt = (b.time - a.time) as f32;
        let track = |i: usize, j: usize| Track {
            id: a.id[i],
            x: [a.position[i], b.position[j]],
            v: [a.velocity[i], b.velocity[j]],
            rate: [a.rate[i], b.rate[j]],
            span: [0.0, 1.0],
        };
        let ending = |i: usize| Track {
            id: a.id[i],
            x: [a.position[i], a.position[i] + a.velocity[i] * dt],
            v: [a.velocity[i]; 2],
            rate: [a.rate[i]; 2],
            span: [0.0, 0.5],
        };
        let beginning = |j: usize| Track {
            id: b.id[j],
            x: [b.position[j] - b.velocity[j] * dt, b.position[j]],
            v: [b.velocity[j]; 2],
            rate: [b.rate[j]; 2],
            span: [0.5, 1.0],
        };
        let (mut i, mut j, mut tracks) = (0, 0, Vec::with_capacity(a.len().max(b.len())));
        while i < a.len() || j < b.len() {
            match (a.id.get(i), b.id.get(j)) {
                (Some(p), Some(q)) if p == q => {
                    tracks.push(track(i, j));
                    (i, j) = (i + 1, j + 1);
                }
                (Some(p), q) if q.is_none_or(|q| p < q) => {
                    tracks.push(ending(i));
                    i += 1;
                }
                _ => {
                    tracks.push(beginning(j));
                    j += 1;
                }
            }
        }
        Self { time: [a.time, b.time], left_out: b.left_out, spacing: a.spacing, tracks }
    }

    /// Length of the interval [s].
    pub(super) fn seconds(&self) -> f64 {
        self.time[1] - self.time[0]
    }

    /// The liquid at a part of the interval, with its mean velocity from there to the part `end`.
    pub(super) fn cloud(&self, part: f64, end: f64) -> Cloud {
        let dt = self.seconds();
        let present: Vec<&Track> = self.tracks.iter().filter(|track| track.exists(part)).collect();
        let mut cloud = Cloud {
            x: par::repeated(Vec3::zeros(), present.len()),
            u: par::repeated(Vec3::zeros(), present.len()),
            grid: CellGrid::default(),
            radius: SUPPORT * self.spacing,
        };
        par::fill(&mut cloud.x, |i| present[i].at(part, dt).0);
        let radius = cloud.radius;
        cloud.grid.rebuild(&cloud.x, radius);
        let order = cloud.grid.order().to_vec();
        par::fill(&mut cloud.u, |place| {
            let track = present[order[place] as usize];
            let (x, v) = track.at(part, dt);
            if end > part { (track.at(end, dt).0 - x) / ((end - part) * dt) as f32 } else { v }
        });
        let x = std::mem::take(&mut cloud.x);
        cloud.x = par::repeated(Vec3::zeros(), x.len());
        par::fill(&mut cloud.x, |place| x[order[place] as usize]);
        cloud.grid.settle();
        cloud
    }
}

/// The liquid at a time, sorted into cells.
#[derive(Debug)]
pub(super) struct Cloud {
    x: Vec<Vec3>,
    /// Mean velocity of each particle over the step that follows [m/s].
    u: Vec<Vec3>,
    grid: CellGrid,
    /// Radius within which neighbours count [m].
    radius: f32,
}

impl Cloud {
    /// Distance between particles at rest [m].
    pub(super) fn spacing(&self) -> f32 {
        self.radius / SUPPORT
    }

    /// The number of neighbours of a place.
    pub(super) fn count(&self, x: Vec3) -> u32 {
        let mut count = 0;
        self.grid.for_each_within(&self.x, x, self.radius, |_, _| count += 1);
        count
    }

    /// The mean velocity of the liquid around a place over the step that follows [m/s]; zero without neighbours.
    pub(super) fn velocity(&self, x: Vec3) -> Vec3 {
        let (mut sum, mut weights) = (Vec3::zeros(), 0.0);
        let inverse = 1.0 / (self.radius * self.radius);
        self.grid.for_each_within(&self.x, x, self.radius, |j, r2| {
            let w = 1.0 - r2 * inverse;
            sum += self.u[j] * (w * w);
            weights += w * w;
        });
        if weights > 0.0 { sum / weights } else { Vec3::zeros() }
    }
}
