//! Steps of whitewater between two cached frames of the liquid.
//!
//! *Method*: kinds follow from the number of neighbours in the liquid ([ihmsen12] §3.2): fewer than 6 is spray, more than 20 a bubble.
//! The motion is the exact solution of v̇ = k (u − v) + a with a constant velocity u of the surrounding liquid (spray: air, which is at
//! rest where no drag of the preset moves it) and a constant acceleration a, so that steps do not limit the drag.
//! Forces on the liquid act on spray: their accelerations as they are, a drag K (U − v) with its own rate and as the air at U.
//! *Departs from the paper*: the lives of all kinds end, each in its own time; a drop that enters the liquid within a step stays
//! where it enters it.
//!
//! Symbols: k → drag, τ = (1 − e^(−k dt))/k.

use super::{
    emission::{Birth, births, expected},
    liquid::{Cloud, LiquidInterval},
    params::{Kind, KindParams, WhitewaterParams},
    state::{Particle, Whitewater, WhitewaterRecord},
    walls::{Contact, Mover, StepSolids, Walls},
};
use crate::{
    control::CancelToken,
    math::{Vec3, elementary::exp},
    par,
    sim::force::Snapshot,
};
use std::ops::ControlFlow;

/// Neighbours in the liquid below which a particle is spray, and above which it is a bubble.
const SPRAY_BELOW: u32 = 6;
const BUBBLE_ABOVE: u32 = 20;

/// Most places at which the path of a drop is tested for liquid in a step.
const MAX_ENTRY_TESTS: usize = 32;

/// Distance that particles keep from solids, in spacings of the liquid: less, and foam gets behind the liquid's surface at walls.
const CLEARANCE: f32 = 0.1;

/// Births of an interval before thinning by kind, over the largest number of particles.
const MAX_BIRTHS_PER_PARTICLE: f64 = 2.0;

/// Ids are below.
const MAX_IDS: u64 = u32::MAX as u64;

/// An upper bound of the particles that the liquid is expected to emit between two frames.
pub(crate) fn births_bound(liquid: &LiquidInterval, params: &WhitewaterParams) -> f64 {
    expected(liquid, params.largest_amount()).min(max_births(params))
}

/// Moves the particles from one frame of the liquid to a later one, and emits new ones; `Break` if it was cancelled.
pub(crate) fn advance(
    state: &mut Whitewater,
    liquid: &LiquidInterval,
    params: &WhitewaterParams,
    walls: &Walls,
    domain: Option<[Vec3; 2]>,
    cancel: &CancelToken,
) -> ControlFlow<()> {
    state.record = WhitewaterRecord { left_out: liquid.left_out, ..WhitewaterRecord::default() };
    let amount = affordable_amount(liquid, params, &mut state.record);
    let steps = params.substeps;
    let part = |step: u32| f64::from(step) / f64::from(steps);
    for step in 0..steps {
        if cancel.is_cancelled() {
            return ControlFlow::Break(());
        }
        let (from, to) = (part(step), part(step + 1));
        let start = liquid.cloud(from, to);
        let end = liquid.cloud(to, to);
        let mut movers: Vec<(Particle, f64)> =
            state.particles.drain(..).map(|particle| (particle, from)).collect();
        let born = births(liquid, params, amount, from, to);
        let time = |part: f64| liquid.time[0] + part * liquid.seconds();
        let places =
            Places { liquid, params, start: &start, solids: walls.step(time(from), time(from)), from };
        emit(state, &places, &born, &mut movers);
        let forces = walls.forces.as_ref().map(|forces| forces.at(time(from)));
        let motion = StepMotion { start, end, params, walls, forces, domain, seconds: liquid.seconds(), to };
        // Poses of solids are evaluated once a step; who is emitted in between moves from their pose at its start.
        let solids = walls.step(time(from), time(to));
        let fates = par::map_chunks(movers.len(), par::CHUNK, |range| {
            movers[range]
                .iter()
                .map(|&(particle, at)| motion.moved(particle, at, &solids))
                .collect::<Vec<_>>()
        });
        for (particle, fate) in fates.into_iter().flatten() {
            let record = &mut state.record;
            record.contacts += u64::from(particle.touched);
            match fate {
                Fate::Moved => state.particles.push(particle.particle),
                Fate::Expired => record.expired += 1,
                Fate::LeftDomain => record.left_domain += 1,
                Fate::Stuck => record.stuck += 1,
            }
        }
    }
    for particle in &state.particles {
        state.record.kinds[particle.kind as usize] += 1;
    }
    ControlFlow::Continue(())
}

/// The largest amount whose particles are likely to fit into memory before they are thinned by kind; what it leaves out is counted.
fn affordable_amount(
    liquid: &LiquidInterval,
    params: &WhitewaterParams,
    record: &mut WhitewaterRecord,
) -> f32 {
    let wanted = params.largest_amount();
    let (count, limit) = (expected(liquid, wanted), max_births(params));
    if count <= limit {
        return wanted;
    }
    record.over_limit += (count - limit) as u64;
    (f64::from(wanted) * limit / count) as f32
}

/// Births of an interval above which a smaller amount is drawn: kinds of a smaller amount, which are known only where a particle is
/// born, may leave few of them.
fn max_births(params: &WhitewaterParams) -> f64 {
    MAX_BIRTHS_PER_PARTICLE * f64::from(params.max_particles)
}

/// Adds the particles that are born in a step, as far as the limit allows.
fn emit(state: &mut Whitewater, places: &Places<'_>, born: &[Birth], movers: &mut Vec<(Particle, f64)>) {
    let params = places.params;
    let made = par::map_chunks(born.len(), par::CHUNK, |range| {
        let states = born[range].iter().map(|birth| places.first_state(birth));
        states.filter(|(particle, _)| particle.threshold < params.simulated_amount()).collect::<Vec<_>>()
    });
    let mut made: Vec<(Particle, f64)> = made.into_iter().flatten().collect();
    let free = u64::from(params.max_particles).saturating_sub(movers.len() as u64);
    let free = free.min(MAX_IDS.saturating_sub(state.emitted));
    if made.len() as u64 > free {
        // Those of the smallest amounts, as a smaller amount would leave.
        let threshold = |i: u32| made[i as usize].0.threshold;
        let mut order: Vec<u32> = (0..made.len() as u32).collect();
        order.sort_by(|&i, &j| threshold(i).total_cmp(&threshold(j)).then(i.cmp(&j)));
        order.truncate(free as usize);
        order.sort_unstable();
        state.record.over_limit += made.len() as u64 - free;
        made = order.into_iter().map(|i| made[i as usize]).collect();
    }
    for (mut particle, at) in made {
        particle.id = state.emitted as u32;
        state.emitted += 1;
        state.record.emitted[particle.kind as usize] += 1;
        movers.push((particle, at));
    }
}

/// Where particles are born in a step.
struct Places<'a> {
    liquid: &'a LiquidInterval,
    params: &'a WhitewaterParams,
    /// The liquid at the start of the step, and its part of the interval.
    start: &'a Cloud,
    from: f64,
    /// Poses of the solids at the start of the step.
    solids: StepSolids<'a>,
}

impl Places<'_> {
    /// A particle where it is born, and the part of the interval from which it moves by itself.
    fn first_state(&self, birth: &Birth) -> (Particle, f64) {
        let track = &self.liquid.tracks[birth.track as usize];
        let seconds = self.liquid.seconds();
        // The liquid is known at the start of the step, so the kind is that of the same place next to the emitter there.
        let (before, _) = track.at(self.from, seconds);
        let kind = kind_of(self.start.count(before + birth.offset));
        let (x, v) = track.at(birth.part, seconds);
        let (x, v, at) = match kind {
            Kind::Spray => {
                let divergence = birth.divergence * (self.params.divergence * v.norm());
                (self.displaced(x, birth.offset), v + divergence, birth.part)
            }
            Kind::Foam | Kind::Bubble => (self.displaced(before, birth.offset), v, self.from),
        };
        let threshold = birth.mark / self.params.kind(kind).amount;
        let Birth { radius, life, .. } = *birth;
        (Particle { x, v, id: 0, kind, age: 0.0, life, radius, threshold }, at)
    }

    /// The place at an offset from an emitter, as far as no solid is between them.
    fn displaced(&self, x: Vec3, offset: Vec3) -> Vec3 {
        let mut mover = Mover { x, v: Vec3::zeros(), radius: CLEARANCE * self.liquid.spacing };
        Walls::advance(&self.solids, &mut mover, x + offset);
        mover.x
    }
}

fn kind_of(neighbours: u32) -> Kind {
    match neighbours {
        _ if neighbours < SPRAY_BELOW => Kind::Spray,
        _ if neighbours > BUBBLE_ABOVE => Kind::Bubble,
        _ => Kind::Foam,
    }
}

/// What became of a particle in a step.
enum Fate {
    Moved,
    Expired,
    LeftDomain,
    Stuck,
}

/// A particle after a step.
struct Moved {
    particle: Particle,
    touched: bool,
}

/// What particles move in during a step.
struct StepMotion<'a> {
    /// The liquid at both ends of the step.
    start: Cloud,
    end: Cloud,
    params: &'a WhitewaterParams,
    walls: &'a Walls,
    /// The forces at the start of the step.
    forces: Option<Snapshot<'a>>,
    domain: Option<[Vec3; 2]>,
    /// Length of the interval between the frames [s].
    seconds: f64,
    /// Part of the interval at which the step ends.
    to: f64,
}

impl StepMotion<'_> {
    /// A particle that moves from the part `at` of the interval to the end of the step.
    fn moved(&self, mut particle: Particle, at: f64, solids: &StepSolids) -> (Moved, Fate) {
        let dt = ((self.to - at) * self.seconds) as f32;
        let kind = self.params.kind(particle.kind);
        let (u, a, k) = match particle.kind {
            Kind::Spray => self.in_air(particle.x, &kind),
            Kind::Foam | Kind::Bubble => {
                (self.start.velocity(particle.x), -self.walls.gravity * kind.buoyancy, kind.drag)
            }
        };
        let (target, v) = relaxed(particle.x, particle.v, u, a, k, dt);
        let radius = CLEARANCE * self.start.spacing();
        let mut mover = Mover { x: particle.x, v, radius };
        let contact = Walls::advance(solids, &mut mover, target);
        if particle.kind == Kind::Spray {
            mover.x = self.entry(particle.x, mover.x);
        }
        particle.x = mover.x;
        particle.v = mover.v;
        particle.age += dt;
        particle.life -= dt / kind.lifetime;
        let is_finite = particle.x.iter().chain(particle.v.iter()).all(|c| c.is_finite());
        particle.kind = if is_finite { kind_of(self.end.count(particle.x)) } else { particle.kind };
        let is_inside =
            |[min, max]: [Vec3; 2]| (0..3).all(|axis| (min[axis]..=max[axis]).contains(&particle.x[axis]));
        let fate = match contact {
            _ if !is_finite || !self.domain.is_none_or(is_inside) => Fate::LeftDomain,
            Contact::Stuck => Fate::Stuck,
            _ if particle.life <= 0.0 => Fate::Expired,
            _ => Fate::Moved,
        };
        (Moved { particle, touched: contact != Contact::None }, fate)
    }

    /// Velocity that a drop at `x` relaxes to, its acceleration besides, and the rate.
    fn in_air(&self, x: Vec3, kind: &KindParams) -> (Vec3, Vec3, f32) {
        let gravity = self.walls.gravity * (1.0 - kind.buoyancy);
        let Some(forces) = &self.forces else { return (Vec3::zeros(), gravity, kind.drag) };
        let sample = forces.sample(x);
        let rate = kind.drag + sample.rate;
        let pull = sample.air_velocity() * kind.drag + sample.pull;
        let velocity = if rate > 0.0 { pull / rate } else { Vec3::zeros() };
        (velocity, gravity + forces.uniform + sample.acceleration, rate)
    }

    /// The first place in the liquid on the path of a drop; its end if there is none, or the liquid has reached its start.
    fn entry(&self, from: Vec3, to: Vec3) -> Vec3 {
        let is_in_liquid = |x: Vec3| self.end.count(x) >= SPRAY_BELOW;
        if !is_in_liquid(to) || is_in_liquid(from) {
            return to;
        }
        let length = (to - from).norm();
        let tests = ((length / self.start.spacing()) as usize).clamp(1, MAX_ENTRY_TESTS);
        let place = |test: usize| from + (to - from) * (test as f32 / tests as f32);
        (1..tests).map(place).find(|&x| is_in_liquid(x)).unwrap_or(to)
    }
}

/// Place and velocity after `dt` seconds of v̇ = k (u − v) + a.
fn relaxed(x: Vec3, v: Vec3, u: Vec3, a: Vec3, k: f32, dt: f32) -> (Vec3, Vec3) {
    let kt = k * dt;
    // τ, and (dt − τ)/k, whose terms cancel for small k dt.
    let (tau, rest) = if kt < 1e-2 {
        let tau = dt * (1.0 - kt * (0.5 - kt / 6.0));
        (tau, dt * dt * (0.5 - kt * (1.0 / 6.0 - kt / 24.0)))
    } else {
        let tau = (1.0 - exp(-kt)) / k;
        (tau, (dt - tau) / k)
    };
    let x = x + u * dt + (v - u) * tau + a * rest;
    (x, u + (v - u) * exp(-kt) + a * tau)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn motion_solves_its_equation_for_any_drag() {
        let (x, v) = (Vec3::new(1.0, 2.0, 3.0), Vec3::new(4.0, -1.0, 0.5));
        let (u, a) = (Vec3::new(0.3, 0.2, -0.1), Vec3::new(0.0, 0.0, -9.81));
        for k in [0.0, 1e-3, 0.05, 0.8, 10.0, 100.0_f32] {
            let dt = 1.0 / 24.0;
            let (mut y, mut w) = (x.map(f64::from), v.map(f64::from));
            let (n, k64) = (200_000, f64::from(k));
            let h = f64::from(dt) / f64::from(n);
            for _ in 0..n {
                // The midpoint rule.
                let force = |w: nalgebra::Vector3<f64>| (u.map(f64::from) - w) * k64 + a.map(f64::from);
                let middle = w + force(w) * (0.5 * h);
                y += middle * h;
                w += force(middle) * h;
            }
            let (found_x, found_v) = relaxed(x, v, u, a, k, dt);
            let errors = [(found_x.map(f64::from) - y).norm(), (found_v.map(f64::from) - w).norm()];
            assert!(errors[0] < 1e-6 && errors[1] < 4e-6, "{k}: {errors:?}");
        }
    }
}
