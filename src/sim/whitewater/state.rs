//! The particles of whitewater, and their stream in a stored frame, which is their whole state.

use super::params::Kind;
use crate::{
    frame::{Stream, StreamKind},
    math::Vec3,
};

/// Name of the stream.
pub(crate) const STREAM: &str = "whitewater";

/// A particle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Particle {
    pub(super) x: Vec3,
    pub(super) v: Vec3,
    pub(super) id: u32,
    pub(super) kind: Kind,
    /// Time since its emission [s].
    pub(super) age: f32,
    /// What is left of its life, in mean lifetimes [1].
    pub(super) life: f32,
    /// Radius [m].
    pub(super) radius: f32,
    /// Smallest amount with which it is there [1].
    pub(super) threshold: f32,
}

/// All particles at a time.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Whitewater {
    pub(super) particles: Vec<Particle>,
    /// Particles emitted since the start of the shot.
    pub(super) emitted: u64,
    pub(crate) record: WhitewaterRecord,
}

/// Record of an interval between two frames.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub(crate) struct WhitewaterRecord {
    /// Particles of each kind at its end: spray, foam, bubbles.
    pub(crate) kinds: [u64; 3],
    /// Particles emitted as each kind.
    pub(crate) emitted: [u64; 3],
    /// Particles removed because their life ended.
    pub(crate) expired: u64,
    /// Particles removed outside of the liquid's domain.
    pub(crate) left_domain: u64,
    /// Particles removed because solids left no place for them.
    pub(crate) stuck: u64,
    /// Particles that were not emitted because there were `max_particles`.
    pub(crate) over_limit: u64,
    /// Contacts with solids.
    pub(crate) contacts: u64,
    /// Particles of the liquid that were left out: of no finite place, or of equal ids.
    pub(crate) left_out: u64,
}

impl WhitewaterRecord {
    /// Names and values of its numbers, in a fixed order.
    pub(crate) fn numbers(&self) -> [(&'static str, u64); 12] {
        let Self { kinds, emitted, .. } = self;
        [
            ("spray", kinds[0]),
            ("foam", kinds[1]),
            ("bubbles", kinds[2]),
            ("emitted_spray", emitted[0]),
            ("emitted_foam", emitted[1]),
            ("emitted_bubbles", emitted[2]),
            ("expired", self.expired),
            ("left_domain", self.left_domain),
            ("stuck", self.stuck),
            ("over_limit", self.over_limit),
            ("contacts", self.contacts),
            ("left_out", self.left_out),
        ]
    }
}

impl Whitewater {
    /// The number of particles.
    pub(crate) fn len(&self) -> usize {
        self.particles.len()
    }

    /// The particles as the stream of a stored frame.
    pub(crate) fn stream(&self, spacing: f32) -> Stream {
        self.selected(spacing, f32::INFINITY)
    }

    /// The particles that are there with an `amount`, as a stream.
    pub(crate) fn selected(&self, spacing: f32, amount: f32) -> Stream {
        let chosen: Vec<&Particle> = self.particles.iter().filter(|p| p.threshold < amount).collect();
        let vectors = |of: fn(&Particle) -> Vec3| -> Vec<Vec3> { chosen.iter().map(|p| of(p)).collect() };
        let numbers = |of: fn(&Particle) -> f32| -> Vec<f32> { chosen.iter().map(|p| of(p)).collect() };
        let integers = |of: fn(&Particle) -> u32| -> Vec<u32> { chosen.iter().map(|p| of(p)).collect() };
        let mut stream = Stream::new(STREAM, StreamKind::Unknown, chosen.len())
            .with("position", vectors(|p| p.x))
            .with("velocity", vectors(|p| p.v))
            .with("id", integers(|p| p.id))
            .with("kind", integers(|p| p.kind as u32))
            .with("age", numbers(|p| p.age))
            .with("life", numbers(|p| p.life))
            .with("radius", numbers(|p| p.radius))
            .with("threshold", numbers(|p| p.threshold));
        stream.scalars = vec![("spacing".into(), f64::from(spacing)), (EMITTED.into(), self.emitted as f64)];
        let numbers = self.record.numbers().into_iter();
        stream.scalars.extend(numbers.map(|(name, value)| (name.to_owned(), value as f64)));
        stream
    }

    /// The particles of a stored frame's stream; `None` if it lacks a column or has values that none is written with.
    pub(crate) fn restore(stream: &Stream) -> Option<Self> {
        let (x, v) = (stream.vec3("position")?, stream.vec3("velocity")?);
        let (id, kind) = (stream.u32("id")?, stream.u32("kind")?);
        let [age, life] = [stream.f32("age")?, stream.f32("life")?];
        let [radius, threshold] = [stream.f32("radius")?, stream.f32("threshold")?];
        let particle = |i: usize| {
            let kind = *Kind::ALL.get(kind[i] as usize)?;
            let finite = x[i].iter().chain(v[i].iter()).chain([&age[i], &life[i], &radius[i], &threshold[i]]);
            let is_sound = finite.copied().all(f32::is_finite) && radius[i] > 0.0;
            is_sound.then_some(Particle {
                x: x[i],
                v: v[i],
                id: id[i],
                kind,
                age: age[i],
                life: life[i],
                radius: radius[i],
                threshold: threshold[i],
            })
        };
        let particles: Option<Vec<Particle>> = (0..stream.len()).map(particle).collect();
        let whole = |name: &str, limit: f64| {
            let number = stream.scalar(name)?;
            ((0.0..limit).contains(&number) && number.fract() == 0.0).then_some(number as u64)
        };
        let number = |name: &str| whole(name, MAX_EXACT);
        let record = WhitewaterRecord {
            kinds: [number("spray")?, number("foam")?, number("bubbles")?],
            emitted: [number("emitted_spray")?, number("emitted_foam")?, number("emitted_bubbles")?],
            expired: number("expired")?,
            left_domain: number("left_domain")?,
            stuck: number("stuck")?,
            over_limit: number("over_limit")?,
            contacts: number("contacts")?,
            left_out: number("left_out")?,
        };
        Some(Self { particles: particles?, emitted: whole(EMITTED, MAX_IDS)?, record })
    }
}

/// Scalar with the number of particles emitted since the start of the shot.
const EMITTED: &str = "emitted";

/// Ids are below.
const MAX_IDS: f64 = 4_294_967_296.0;

/// Whole numbers below are exact in double precision.
const MAX_EXACT: f64 = 9_007_199_254_740_992.0;
