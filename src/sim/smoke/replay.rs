//! Smoke between cached frames, and other tracers in the air of cached frames, without simulating.
//!
//! *Method*: a vorton that both frames contain moves on the cubic Hermite interpolant of its positions and velocities, and its
//! strength and core change linearly. One of the first frame only moves with its velocity there and fades out; one of the second
//! only fades in. Tracers are advected in the air of these vortons by the midpoint rule, from their positions in a cached frame or
//! at the shot's start; emission and fading go on meanwhile. The step suits the fastest air and the fastest solid. The vorticity of
//! solids that turn and shed cross-fades as what they shed does. At a cached frame everything is as in that frame.
//!
//! Symbols: s → `part`, 0 at the first frame and 1 at the second.
//! Limits: second order in the distance of frames. Where vortons were remeshed in between, the two sets cross-fade. The own vorticity
//! of a solid that turns while it grows is balanced at cached frames alone, and in a simulation at the end of each step.

use super::{
    FrameAir, NAME, ShotAir, Smoke, System, TRACERS,
    emit::{Emitted, Source},
    state::{self, find},
    tracers::Tracers,
    walls::Spun,
};
use crate::{
    frame::Stream,
    math::Vec3,
    sim::{SetupError, Watch, World, vortex::Vortons},
};
use std::{collections::HashMap, ops::ControlFlow};

/// Largest displacement of a tracer in a step, in cores.
const MAX_DISPLACEMENT: f32 = 0.5;

/// Limit of steps between two frames; the record counts steps that were longer than they should be.
const MAX_STEPS: f64 = 256.0;

/// A shot's smoke between its cached frames.
#[derive(Debug)]
pub(crate) struct Replay {
    smoke: Smoke,
    air: ShotAir,
    emitters: Vec<Source>,
    /// The solids, and the shot's start.
    start: System,
}

/// Vortons of a cached frame, with their ids and velocities.
#[derive(Debug)]
pub(crate) struct KeyedAir {
    /// Time since the shot's start [s].
    pub time: f64,
    vortons: Vortons,
    id: Vec<u32>,
    velocity: Vec<Vec3>,
}

/// Tracers at a time of the replay.
#[derive(Clone, Debug)]
pub(crate) struct Drifting {
    /// Time since the shot's start [s].
    pub time: f64,
    tracers: Tracers,
    spacing: f32,
    /// What happened since it was last taken.
    pub report: DriftReport,
}

/// Record of the advection of tracers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub(crate) struct DriftReport {
    /// Steps.
    pub steps: u64,
    /// Steps in which the air or a solid moved farther than it should.
    pub capped: u64,
    /// Tracers projected out of solids, over all steps.
    pub returned: u64,
    /// Tracers rejected because they would have been emitted inside a solid.
    pub rejected: u64,
}

impl Drifting {
    /// The columns that a cached frame has.
    pub(crate) fn stream(&self) -> Stream {
        self.tracers.stream(self.spacing)
    }
}

impl Replay {
    /// The replay of a shot with this `smoke` in its `world`; its tracer spacing may differ from the cache's.
    ///
    /// # Errors
    /// If the shot could not start.
    pub(crate) fn new(smoke: Smoke, world: World) -> Result<Self, SetupError> {
        let spacing = smoke.params.tracer_spacing();
        let emitters = smoke.params.emitter.iter().enumerate();
        let emitters = emitters
            .map(|(key, emitter)| Source::new(emitter, key as u32, spacing, smoke.fps, smoke.first))
            .collect();
        let start = System::seed(smoke.clone(), &world)?;
        Ok(Self { smoke, air: ShotAir::of(&start.air), emitters, start })
    }

    /// The vortons of a frame with these streams at `time` [s].
    ///
    /// # Errors
    /// If the frame lacks a stream or column, or cannot be computed.
    pub(crate) fn keyed(&self, streams: &[Stream], time: f64) -> Result<KeyedAir, SetupError> {
        let stream = find(streams, NAME)?;
        let vortons = state::vortons_of(stream)?;
        let missing = SetupError::Missing { stream: NAME, what: "id" };
        let id = stream.u32("id").ok_or(missing)?.to_vec();
        let air = self.air.around(vortons.clone(), time, Spun::at(time))?;
        let velocity = air.velocity(&vortons.position)?;
        Ok(KeyedAir { time, vortons, id, velocity })
    }

    /// The tracers of a frame with these streams at `time` [s].
    ///
    /// # Errors
    /// If the frame lacks the stream or a column.
    pub(crate) fn cached(&self, streams: &[Stream], time: f64) -> Result<Drifting, SetupError> {
        Ok(self.drifting(Tracers::restore(find(streams, TRACERS)?)?, time))
    }

    /// The tracers that the shot starts with.
    pub(crate) fn seeded(&self) -> Drifting {
        self.drifting(self.start.tracers.clone(), 0.0)
    }

    fn drifting(&self, tracers: Tracers, time: f64) -> Drifting {
        let spacing = self.smoke.params.tracer_spacing();
        Drifting { time, tracers, spacing, report: DriftReport::default() }
    }

    /// The air at `time` [s], which is between `a` and `b`.
    ///
    /// # Errors
    /// If it cannot be computed.
    pub(crate) fn air(&self, a: &KeyedAir, b: &KeyedAir, time: f64) -> Result<FrameAir, SetupError> {
        // The solids' own vorticity fades in as what they shed does.
        let spun = Spun { times: [a.time, b.time], part: fraction(a, b, time) };
        self.air.around(between(a, b, time), time, spun)
    }

    /// Advects tracers to the time `to` [s]; both times are between `a` and `b`. If `watch` stops it, the tracers are consistent at the time
    /// they have reached, and can go on.
    ///
    /// # Errors
    /// If the air cannot be computed.
    pub(crate) fn drift(
        &self,
        a: &KeyedAir,
        b: &KeyedAir,
        drifting: &mut Drifting,
        to: f64,
        watch: &mut dyn Watch,
    ) -> Result<ControlFlow<()>, SetupError> {
        let span = to - drifting.time;
        if span <= 0.0 {
            return Ok(ControlFlow::Continue(()));
        }
        let wind = self.smoke.params.wind.map_or(0.0, |wind| Vec3::from(wind).norm());
        let fastest = a.velocity.iter().chain(&b.velocity).map(|v| v.norm()).fold(wind, f32::max);
        let by_air = f64::from(MAX_DISPLACEMENT * self.smoke.params.core()) / f64::from(fastest);
        let longest = by_air.min(self.air.max_step_for_solids([drifting.time, to]));
        let wanted = (span / longest).ceil().max(1.0);
        let strides = wanted.min(MAX_STEPS);
        let (from, dt) = (drifting.time, span / strides);
        for step in 0..strides as u32 {
            if watch.is_cancelled() {
                return Ok(ControlFlow::Break(()));
            }
            let now = from + f64::from(step) * dt;
            self.stride(a, b, drifting, now, now + dt)?;
            drifting.time = now + dt;
            drifting.report.steps += 1;
            drifting.report.capped += u64::from(wanted > strides);
            watch.substep(f64::from(step + 1) / strides);
        }
        drifting.time = to;
        Ok(ControlFlow::Continue(()))
    }

    /// One step of the midpoint rule, with emission and fading.
    fn stride(
        &self,
        a: &KeyedAir,
        b: &KeyedAir,
        drifting: &mut Drifting,
        now: f64,
        then: f64,
    ) -> Result<(), SetupError> {
        let Drifting { tracers, report, .. } = drifting;
        let dt = (then - now) as f32;
        let moved = |from: &[Vec3], v: &[Vec3], dt: f32| -> Vec<Vec3> {
            from.iter().zip(v).map(|(x, v)| x + v * dt).collect()
        };
        let first = self.air(a, b, now)?.velocity(&tracers.position)?;
        let middle = moved(&tracers.position, &first, 0.5 * dt);
        let second = self.air(a, b, 0.5 * (now + then))?.velocity(&middle)?;
        tracers.position = moved(&tracers.position, &second, dt);
        let mut emitted = Emitted::default();
        self.emitters.iter().for_each(|emitter| emitter.emit(now, then, &mut emitted));
        report.rejected += u64::from(emitted.retain(self.start.air.outside_solids(then)));
        tracers.add(emitted.seeds);
        report.returned += self.start.project_tracers_out(&mut tracers.position, then);
        let params = &self.smoke.params;
        tracers.fade(params.dissolve, params.cooling, then - now);
        Ok(())
    }
}

/// Where `time` [s] is between `a` and `b`: 0 at the first, 1 at the second.
fn fraction(a: &KeyedAir, b: &KeyedAir, time: f64) -> f32 {
    let span = b.time - a.time;
    if span <= 0.0 { 0.0 } else { ((time - a.time) / span).clamp(0.0, 1.0) as f32 }
}

/// The vortons at `time` [s], which is between `a` and `b`.
fn between(a: &KeyedAir, b: &KeyedAir, time: f64) -> Vortons {
    let part = fraction(a, b, time);
    if part == 0.0 {
        return a.vortons.clone();
    }
    if part == 1.0 {
        return b.vortons.clone();
    }
    let (span, rest) = ((b.time - a.time) as f32, 1.0 - part);
    let place: HashMap<u32, usize> = b.id.iter().enumerate().map(|(j, &id)| (id, j)).collect();
    let mut shared = vec![false; b.id.len()];
    let mut out = Vortons::default();
    let mut add = |x: Vec3, strength: Vec3, core: f32| {
        out.position.push(x);
        out.strength.push(strength);
        out.core.push(core);
    };
    for (i, id) in a.id.iter().enumerate() {
        let (x, v, strength, core) =
            (a.vortons.position[i], a.velocity[i], a.vortons.strength[i], a.vortons.core[i]);
        let Some(&j) = place.get(id) else {
            add(x + v * (part * span), strength * rest, core);
            continue;
        };
        shared[j] = true;
        // Hermite's cubic.
        let (s2, s3) = (part * part, part * part * part);
        let end = 3.0 * s2 - 2.0 * s3;
        let x = x * (1.0 - end)
            + v * (span * (s3 - 2.0 * s2 + part))
            + b.vortons.position[j] * end
            + b.velocity[j] * (span * (s3 - s2));
        let mean = |from: f32, to: f32| from * rest + to * part;
        add(x, strength * rest + b.vortons.strength[j] * part, mean(core, b.vortons.core[j]));
    }
    for j in (0..b.id.len()).filter(|&j| !shared[j]) {
        let x = b.vortons.position[j] - b.velocity[j] * (rest * span);
        add(x, b.vortons.strength[j] * part, b.vortons.core[j]);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        sim::{CancelToken, Simulation, Systems, Unwatched},
        solid::{Interpolation, Keyframe, Motion, Shape, Solid},
    };

    fn ring() -> Smoke {
        let text =
            "spacing = 0.05\n[[ring]]\ncenter = [0, 0, 0]\nradius = 0.3\nthickness = 0.1\ncirculation = 1";
        Smoke { params: crate::from_toml(text), fps: 24.0, first: 1 }
    }

    fn still() -> World {
        World { gravity: Vec3::zeros(), solids: Vec::new() }
    }

    fn drift(replay: &Replay, [a, b]: [&KeyedAir; 2], drifting: &mut Drifting, to: f64) {
        assert!(replay.drift(a, b, drifting, to, &mut Unwatched).unwrap().is_continue());
    }

    /// The frames 1 … `count` of a shot with so many frames a second.
    fn frames(fps: f64, count: u32) -> Vec<crate::frame::Frame> {
        let systems = Systems { smoke: Some(ring()), ..Systems::default() };
        let mut simulation = Simulation::new(still(), systems).unwrap();
        (1..=count)
            .map(|index| {
                if index > 1 {
                    simulation.advance(1.0 / fps, &mut Unwatched).unwrap();
                }
                simulation.frame(crate::frame::FrameIndex(index))
            })
            .collect()
    }

    #[test]
    fn between_frames_vortons_and_tracers_are_as_if_simulated() {
        let replay = Replay::new(ring(), still()).unwrap();
        let (coarse, fine) = (frames(24.0, 3), frames(48.0, 4));
        let keyed: Vec<KeyedAir> =
            coarse.iter().map(|frame| replay.keyed(&frame.streams, frame.time).unwrap()).collect();
        let mut drifting = replay.cached(&coarse[1].streams, coarse[1].time).unwrap();
        drift(&replay, [&keyed[1], &keyed[2]], &mut drifting, fine[3].time);
        let between = between(&keyed[1], &keyed[2], fine[3].time);
        let moved = |name: &str| fine[3].stream(name).unwrap().vec3("position").unwrap().to_vec();
        let off = |found: &[Vec3], name: &str| {
            found.iter().zip(moved(name)).map(|(a, b)| (a - b).norm()).fold(0.0, f32::max)
        };
        // In half a frame the core turns by 0.3 radians; a vorton there moves 20 mm.
        let (vortons, tracers) = (off(&between.position, NAME), off(&drifting.tracers.position, TRACERS));
        assert!(vortons < 1e-3 && tracers < 2e-3, "{vortons} {tracers}");

        // At a cached frame nothing is interpolated.
        assert!(super::between(&keyed[1], &keyed[2], keyed[1].time) == keyed[1].vortons);
        assert!(super::between(&keyed[1], &keyed[2], keyed[2].time) == keyed[2].vortons);
    }

    #[test]
    fn a_solid_that_is_fast_between_frames_displaces_tracers() {
        let text = "spacing = 0.08\ntracers = 0.5\n[[source]]\nshape = { box = { min = [-0.06, -0.06, -0.06], max = [0.06, 0.06, 0.06] } }";
        let smoke = Smoke { params: crate::from_toml(text), fps: 24.0, first: 1 };
        let key = |frame: u32, x: f32| Keyframe {
            frame,
            position: [x, 0.0, 0.0],
            rotation: [0.0; 3],
            quaternion: None,
            scale: 1.0,
        };
        let motion = Motion::new(&[key(1, -1.0), key(2, 1.0)], Interpolation::Linear, 24.0, 1);
        let shape = Shape::Sphere { center: [0.0; 3], radius: 0.1 };
        let world = World { gravity: Vec3::zeros(), solids: vec![Solid { motion, ..Solid::fixed(shape) }] };
        let replay = Replay::new(smoke, world).unwrap();
        let empty =
            |time: f64| KeyedAir { time, vortons: Vortons::default(), id: Vec::new(), velocity: Vec::new() };
        let mut drifting = replay.seeded();
        let count = drifting.tracers.len();
        drift(&replay, [&empty(0.0), &empty(1.0 / 24.0)], &mut drifting, 1.0 / 24.0);
        let DriftReport { steps, capped, .. } = drifting.report;
        assert!(steps >= 25 && capped == 0, "{:?}", drifting.report);
        let drift = drifting.tracers.position.iter().map(|x| x.x).sum::<f32>() / count as f32;
        assert!((0.03..0.25).contains(&drift), "Darwin's drift: {drift} m");
    }

    #[test]
    fn a_solid_that_begins_to_turn_does_not_turn_the_air_between_frames() {
        // Also while it grows, by which it gains vorticity: of 1.3³ times the volume.
        [0.0, 0.3].into_iter().for_each(turn_and_grow);
    }

    /// A ball that turns from the start and grows by a part of its size each frame.
    fn turn_and_grow(growth: f32) {
        let text = "spacing = 0.1\n[shedding]\n[[source]]\nshape = { sphere = { center = [0, 0, 0], radius = 0.6 } }";
        let smoke = Smoke { params: crate::from_toml(text), fps: 24.0, first: 1 };
        let key = |frame: u32| Keyframe {
            frame,
            position: [0.0; 3],
            rotation: [0.0, 0.0, 20.0 * frame as f32],
            quaternion: None,
            scale: 1.0 + growth * (frame - 1) as f32,
        };
        let keys: Vec<Keyframe> = (1..4).map(key).collect();
        let motion = Motion::new(&keys, Interpolation::Linear, 24.0, 1);
        let shape = Shape::Sphere { center: [0.0; 3], radius: 0.4 };
        let world = World { gravity: Vec3::zeros(), solids: vec![Solid { motion, ..Solid::fixed(shape) }] };
        let systems = Systems { smoke: Some(smoke.clone()), ..Systems::default() };
        let mut simulation = Simulation::new(world.clone(), systems).unwrap();
        let replay = Replay::new(smoke, world).unwrap();
        let [a, b] = [1, 2].map(|index| {
            if index > 1 {
                simulation.advance(1.0 / 24.0, &mut Unwatched).unwrap();
            }
            let frame = simulation.frame(crate::frame::FrameIndex(index));
            replay.keyed(&frame.streams, frame.time).unwrap()
        });
        // Its own vorticity alone, 2Ω, would induce two thirds R³/r² Ω = 0.56 m/s a radius off.
        let around = |part: f64| {
            let air = replay.air(&a, &b, part * b.time).unwrap();
            air.velocity(&[Vec3::new(0.8, 0.0, 0.0)]).unwrap()[0].y
        };
        // Between frames the volume of what grows does not fade as what it sheds does; at the first nothing turns.
        let parts: &[f64] = if growth == 0.0 { &[0.0, 0.25, 0.5, 0.75, 0.99, 1.0] } else { &[1.0] };
        for &part in parts {
            assert!(around(part).abs() < 0.05, "{growth} {part}: {}", around(part));
        }
    }

    /// Cancels after so many steps.
    struct After(u32, CancelToken);

    impl Watch for After {
        fn token(&self) -> Option<&CancelToken> {
            Some(&self.1)
        }

        fn substep(&mut self, done: f64) {
            assert!(done > 0.0 && done <= 1.0, "{done}");
            self.0 -= 1;
            if self.0 == 0 {
                self.1.cancel();
            }
        }
    }

    #[test]
    fn an_interrupted_drift_is_consistent_and_goes_on() {
        let replay = Replay::new(ring(), still()).unwrap();
        let frames = frames(6.0, 2);
        let [a, b] = [0, 1].map(|i| replay.keyed(&frames[i].streams, frames[i].time).unwrap());
        let mut drifting = replay.seeded();
        assert!(
            replay
                .drift(&a, &b, &mut drifting, b.time, &mut After(3, CancelToken::new()))
                .unwrap()
                .is_break()
        );
        assert!(drifting.report.steps == 3 && 0.0 < drifting.time && drifting.time < b.time);
        drift(&replay, [&a, &b], &mut drifting, b.time);
        let mut whole = replay.seeded();
        drift(&replay, [&a, &b], &mut whole, b.time);
        assert_eq!((drifting.time, drifting.report.steps), (whole.time, whole.report.steps));
        for (x, y) in drifting.tracers.position.iter().zip(&whole.tracers.position) {
            assert!((x - y).norm() < 1e-5, "{x} {y}");
        }
    }

    #[test]
    fn vortons_that_one_frame_has_come_and_go() {
        let air = |id: u32, x: f32, time: f64| KeyedAir {
            time,
            vortons: Vortons {
                position: vec![Vec3::new(x, 0.0, 0.0)],
                strength: vec![Vec3::z()],
                core: vec![0.1],
            },
            id: vec![id],
            velocity: vec![Vec3::x()],
        };
        let found = super::between(&air(1, 0.0, 0.0), &air(2, 1.0, 1.0), 0.25);
        assert_eq!(found.position, [Vec3::new(0.25, 0.0, 0.0); 2]);
        assert_eq!(found.strength, [Vec3::z() * 0.75, Vec3::z() * 0.25]);
    }
}
