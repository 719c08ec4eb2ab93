//! Seeding and emission of tracers: sources at the start, emitters while the shot runs.
//!
//! *Method*: an emitter samples points in the box around its shape, evenly in space and time, and keeps those inside the shape.
//! The samples depend on the time alone, so a resumed shot emits the same.
//!
//! Symbols: t → time since the shot's start [s].

use super::{
    params::{Emitter, SmokeSource},
    tracers::Seeds,
};
use crate::{
    math::{Random, Vec3},
    solid::{Motion, Shape},
};

/// Fills a source with tracers `spacing` [m] apart, each moved by up to half a spacing; `key` is its number.
pub(super) fn fill(source: &SmokeSource, spacing: f32, key: u32, out: &mut Seeds) {
    let Some((low, high)) = source.shape.bounds() else { return };
    let random = Random::new([key, 3, 0]);
    let counts = (high - low).map(|side| (side / spacing).ceil().max(1.0) as u64);
    for n in 0..counts.x * counts.y * counts.z {
        let cell = Vec3::new(
            (n % counts.x) as f32,
            (n / counts.x % counts.y) as f32,
            (n / (counts.x * counts.y)) as f32,
        );
        let x = low + (cell + random.vector(n)) * spacing;
        if source.shape.signed_distance(x) < 0.0 {
            out.add(x, [source.density, source.temperature]);
        }
    }
}

/// Points that fill the box around a shape; 0 if it has none.
pub(super) fn points(shape: &Shape, spacing: f32) -> f64 {
    shape.bounds().map_or(0.0, |(low, high)| {
        let sides = high - low;
        f64::from(sides.x) * f64::from(sides.y) * f64::from(sides.z) / f64::from(spacing).powi(3)
    })
}

/// An emitter with its motion and rate.
#[derive(Debug)]
pub(super) struct Source {
    params: Emitter,
    motion: Option<Motion>,
    /// Start and end of the emission [s].
    span: [f64; 2],
    /// Points sampled a second [1/s].
    rate: f64,
    key: u32,
}

/// Tracers emitted in a step.
#[derive(Debug, Default)]
pub(super) struct Emitted {
    pub(super) seeds: Seeds,
    /// Velocity of emission [m/s], if it drags the air along.
    pub(super) velocity: Vec<Option<Vec3>>,
}

impl Emitted {
    /// Keeps those whose positions `keep` accepts; returns how many were rejected.
    pub(super) fn retain(&mut self, keep: impl Fn(Vec3) -> bool) -> u32 {
        let mut places = self.seeds.position.iter();
        self.velocity.retain(|_| keep(*places.next().expect("a place each")));
        self.seeds.retain(keep)
    }
}

impl Source {
    /// The emitter of number `key` in a shot of `fps` frames a second, whose frame `first` is at time 0; tracers are `spacing`
    /// [m] apart.
    pub(super) fn new(params: &Emitter, key: u32, spacing: f32, fps: f64, first: u32) -> Self {
        let time = |frame: u32| (f64::from(frame) - f64::from(first)) / fps;
        let motion = Motion::new(&params.keyframes, params.interpolation, fps, first);
        let span = [params.start.map_or(0.0, time).max(0.0), params.end.map_or(f64::INFINITY, time)];
        let rate = f64::from(params.rate) * points(&params.shape, spacing);
        Self { params: params.clone(), motion, span, rate, key }
    }

    /// Adds the tracers emitted from `from` to `to` [s].
    pub(super) fn emit(&self, from: f64, to: f64, out: &mut Emitted) {
        let [start, end] = self.span;
        let Some((low, high)) = self.params.shape.bounds().filter(|_| end > start && self.rate > 0.0) else {
            return;
        };
        let [from, to] = [from, to].map(|t| t.clamp(start, end));
        let thrown = |t: f64| ((t - start) * self.rate).floor() as u64;
        let random = Random::new([self.key, 4, self.params.seed]);
        for n in thrown(from)..thrown(to) {
            let local = low + (high - low).component_mul(&random.vector(n));
            if self.params.shape.signed_distance(local) >= 0.0 {
                continue;
            }
            let t = (start + (n as f64 + 1.0) / self.rate).min(to);
            let mut x = self.place(local, t);
            let velocity = self.params.velocity.map(|v| Vec3::from(v) + self.speed(local, t));
            // It has drifted since it was emitted.
            x += velocity.unwrap_or_default() * (to - t) as f32;
            out.seeds.add(x, [self.params.density, self.params.temperature]);
            out.velocity.push(velocity);
        }
    }

    /// Position of the shape's point `local` at time `t` [m].
    fn place(&self, local: Vec3, t: f64) -> Vec3 {
        self.motion.as_ref().map_or(local, |motion| motion.pose(t).to_world(local))
    }

    /// Velocity of the shape's point `local` at time `t` [m/s].
    fn speed(&self, local: Vec3, t: f64) -> Vec3 {
        (self.place(local, t + VELOCITY_TIME_STEP) - self.place(local, t - VELOCITY_TIME_STEP))
            / (2.0 * VELOCITY_TIME_STEP) as f32
    }
}

/// Time step of the central differences that give velocities of shapes [s]. Shorter, and single precision shows; longer, and a
/// velocity is a mean over a frame.
pub(super) const VELOCITY_TIME_STEP: f64 = 2e-3;
