//! The forces on one system, evaluated at points.

use super::{ForceKind, ForceParams, turbulence::Turbulence};
use crate::{
    math::{
        Vec3,
        elementary::{exp_m1, powf},
    },
    sim::Timeline,
    solid::{Motion, Pose, Shape},
};

/// The forces that act on a system.
#[derive(Clone, Debug)]
pub(in crate::sim) struct Forces(Vec<Force>);

/// One force with its motion in seconds.
#[derive(Clone, Debug)]
struct Force {
    /// Index in the preset.
    index: u32,
    kind: ForceKind,
    /// The modes, if it is turbulence.
    turbulence: Option<Turbulence>,
    shape: Option<Shape>,
    falloff: f32,
    /// Times [s] and factors, ascending; empty: 1.
    factors: Vec<[f64; 2]>,
    motion: Option<Motion>,
}

/// The forces at one time.
#[derive(Clone, Debug)]
pub(in crate::sim) struct Snapshot<'a> {
    forces: Vec<PlacedForce<'a>>,
    /// Acceleration that is the same everywhere [m/s²].
    pub(in crate::sim) uniform: Vec3,
}

/// A force at one time.
#[derive(Clone, Debug)]
struct PlacedForce<'a> {
    force: &'a Force,
    factor: f32,
    pose: Option<Pose>,
    /// Phases of the modes of turbulence [turns].
    phases: Vec<f64>,
}

/// What forces do at a point, apart from [`Snapshot::uniform`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(in crate::sim) struct Sample {
    /// Acceleration whatever the velocity [m/s²].
    pub(in crate::sim) acceleration: Vec3,
    /// Sum of the rates of drags [1/s].
    pub(in crate::sim) rate: f32,
    /// Sum of the rates times their velocities [m/s²].
    pub(in crate::sim) pull: Vec3,
    /// Sum of the parts of drags that act here, whatever their rates: factor times window [1].
    part: f32,
    /// Sum of these parts times the velocities of the drags [m/s].
    wind: Vec3,
}

/// What is the same for all points in a substep.
#[derive(Clone, Copy, Debug)]
pub(in crate::sim) struct KickedSubstep {
    /// [`Snapshot::uniform`] [m/s²].
    pub(in crate::sim) uniform: Vec3,
    /// Gravity, which the system itself applies [m/s²].
    pub(in crate::sim) gravity: Vec3,
    /// Length of the substep [s].
    pub(in crate::sim) dt: f32,
    /// Largest displacement in the substep by what forces add [m].
    pub(in crate::sim) longest: f32,
}

/// What forces add to a velocity in a substep.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(in crate::sim) struct Kick {
    /// The change of the velocity, without that by gravity [m/s].
    pub(in crate::sim) change: Vec3,
    /// Whether it was limited.
    pub(in crate::sim) is_limited: bool,
    /// Its length over the substep before any limit [m/s²].
    pub(in crate::sim) acceleration: f32,
}

impl Forces {
    /// The forces on the system of this name; `None` if there is none.
    pub(in crate::sim) fn on(system: &str, all: &[ForceParams], timeline: Timeline) -> Option<Self> {
        let acts = |(_, params): &(u32, &ForceParams)| {
            params.systems.is_empty() || params.systems.iter().any(|name| name == system)
        };
        let numbered = (0..).zip(all);
        let forces: Vec<Force> =
            numbered.filter(acts).map(|(index, params)| Force::new(index, params, timeline)).collect();
        (!forces.is_empty()).then_some(Self(forces))
    }

    /// The forces at `time` [s].
    pub(in crate::sim) fn at(&self, time: f64) -> Snapshot<'_> {
        let (mut forces, mut uniform) = (Vec::new(), Vec3::zeros());
        for force in &self.0 {
            let placed = force.at(time);
            match (&force.kind, &force.shape) {
                (ForceKind::Uniform { acceleration }, None) => {
                    uniform += placed.to_world(Vec3::from(*acceleration)) * placed.factor;
                }
                _ if placed.factor > 0.0 => forces.push(placed),
                _ => {}
            }
        }
        Snapshot { forces, uniform }
    }

    /// Index in the preset of the force that accelerates most at `x` [m] and the velocity `v` [m/s] at `time` [s].
    pub(in crate::sim) fn strongest(&self, time: f64, x: Vec3, v: Vec3) -> u32 {
        let (mut strongest, mut largest) = (0, -1.0);
        for force in &self.0 {
            let mut sample = Sample::default();
            force.at(time).add(x, &mut sample);
            let acceleration = (sample.acceleration + sample.pull - v * sample.rate).norm();
            if acceleration > largest {
                (strongest, largest) = (force.index, acceleration);
            }
        }
        strongest
    }
}

impl Force {
    fn new(index: u32, params: &ForceParams, timeline: Timeline) -> Self {
        let turbulence = match params.kind {
            ForceKind::Turbulence { scale, period, seed, .. } => Some(Turbulence::new(seed, scale, period)),
            _ => None,
        };
        let factor = |key: &super::StrengthKeyframe| [timeline.time(key.frame), f64::from(key.factor)];
        Self {
            index,
            kind: params.kind.clone(),
            turbulence,
            shape: params.shape.clone(),
            falloff: params.falloff.unwrap_or(0.0),
            factors: params.strength_keyframes.iter().map(factor).collect(),
            motion: Motion::new(&params.keyframes, params.interpolation, timeline.fps, timeline.first),
        }
    }

    fn at(&self, time: f64) -> PlacedForce<'_> {
        PlacedForce {
            force: self,
            factor: self.factor(time) as f32,
            pose: self.motion.as_ref().map(|motion| motion.pose(time)),
            phases: self.turbulence.as_ref().map_or_else(Vec::new, |turbulence| turbulence.phases(time)),
        }
    }

    /// Factor of the strength at `time` [s].
    fn factor(&self, time: f64) -> f64 {
        let after = self.factors.partition_point(|key| key[0] <= time);
        match (after.checked_sub(1).map(|before| self.factors[before]), self.factors.get(after)) {
            (Some(a), Some(b)) => a[1] + (b[1] - a[1]) * ((time - a[0]) / (b[0] - a[0])),
            (Some(key), None) => key[1],
            (None, key) => key.map_or(1.0, |key| key[1]),
        }
    }

    /// The window of the shape at `x` in the force's own axes, and its gradient [1/m].
    fn window(&self, x: Vec3) -> (f32, Vec3) {
        let Some(shape) = &self.shape else { return (1.0, Vec3::zeros()) };
        if self.falloff <= 0.0 {
            return (if shape.signed_distance(x) <= 0.0 { 1.0 } else { 0.0 }, Vec3::zeros());
        }
        let (distance, normal) = shape.contact(x);
        let t = distance / self.falloff;
        if t <= 0.0 {
            (1.0, Vec3::zeros())
        } else if t < 1.0 {
            (1.0 - t * t * (3.0 - 2.0 * t), normal * (-6.0 * t * (1.0 - t) / self.falloff))
        } else {
            (0.0, Vec3::zeros())
        }
    }
}

impl PlacedForce<'_> {
    fn to_world(&self, v: Vec3) -> Vec3 {
        self.pose.as_ref().map_or(v, |pose| pose.rotation * v)
    }

    /// Adds what the force does at `x` [m].
    fn add(&self, x: Vec3, out: &mut Sample) {
        let x = self.pose.as_ref().map_or(x, |pose| pose.to_local(x));
        let (window, slope) = self.force.window(x);
        if window == 0.0 {
            return;
        }
        let weight = self.factor * window;
        match &self.force.kind {
            ForceKind::Uniform { acceleration } => {
                out.acceleration += self.to_world(Vec3::from(*acceleration)) * weight;
            }
            ForceKind::Point { center, strength, radius, power } => {
                let arm = x - Vec3::from(*center);
                out.acceleration -= self.to_world(arm) * (weight * radial(arm, *strength, *radius, *power));
            }
            ForceKind::Vortex { center, axis, strength, radius, power } => {
                let axis = Vec3::from(*axis);
                let axis = axis / axis.amax();
                let axis = axis / axis.norm();
                let arm = x - Vec3::from(*center);
                let arm = arm - axis * axis.dot(&arm);
                let around = axis.cross(&arm) * radial(arm, *strength, *radius, *power);
                out.acceleration += self.to_world(around) * weight;
            }
            ForceKind::Turbulence { strength, .. } => {
                if let Some(turbulence) = &self.force.turbulence {
                    let unit = turbulence.acceleration(x, &self.phases, (window, slope));
                    out.acceleration += self.to_world(unit) * (strength * self.factor);
                }
            }
            ForceKind::Drag { rate, velocity } => {
                let velocity = self.to_world(Vec3::from(*velocity));
                out.rate += rate * weight;
                out.pull += velocity * (rate * weight);
                out.part += weight;
                out.wind += velocity * weight;
            }
        }
    }
}

/// s (R/ρ)ᵖ/ρ with ρ² = r² + R²: the acceleration over the distance r [1/s²].
fn radial(arm: Vec3, strength: f32, radius: f32, power: f32) -> f32 {
    let rho = (arm.norm_squared() + radius * radius).sqrt();
    strength * powf(radius / rho, power) / rho
}

impl Snapshot<'_> {
    /// Whether anything acts that is not the same everywhere.
    pub(in crate::sim) fn is_local(&self) -> bool {
        !self.forces.is_empty()
    }

    /// What the forces do at `x` [m], apart from [`Self::uniform`].
    pub(in crate::sim) fn sample(&self, x: Vec3) -> Sample {
        let mut out = Sample::default();
        self.forces.iter().for_each(|force| force.add(x, &mut out));
        out
    }
}

impl Sample {
    /// What the forces add to the velocity `v` [m/s] in a substep in addition to gravity.
    pub(in crate::sim) fn kick(&self, v: Vec3, substep: &KickedSubstep) -> Kick {
        let &KickedSubstep { uniform, gravity, dt, longest } = substep;
        let accelerated = uniform + self.acceleration;
        let mut change = accelerated * dt;
        let decay = self.rate * dt;
        if decay > 0.0 {
            let mean = -exp_m1(-decay) / decay;
            let all = gravity + accelerated + self.pull - v * self.rate;
            change = all * (dt * mean) - gravity * dt;
        }
        let speed = change.norm();
        let is_limited = speed * dt > longest;
        if is_limited {
            change *= longest / (speed * dt);
        }
        Kick { change, is_limited, acceleration: speed / dt }
    }

    /// Velocity of the air, if drags are of air that moves [m/s]: that of a drag where it acts whole, their mean where several do.
    pub(in crate::sim) fn air_velocity(&self) -> Vec3 {
        self.wind / self.part.max(1.0)
    }

    /// The velocity towards which drags pull [m/s].
    pub(in crate::sim) fn target(&self) -> Option<Vec3> {
        (self.rate > 0.0).then(|| self.pull / self.rate)
    }

    /// Rate of substeps in which what moves at the first of `speeds` [m/s] goes at most `longest` [m], under an acceleration `steady`
    /// besides [1/s].
    ///
    /// A drag of a high rate adds no more than the second speed, whatever its acceleration at first.
    pub(in crate::sim) fn substep_rate(&self, v: Vec3, steady: Vec3, longest: f64, speeds: [f64; 2]) -> f64 {
        let rate = |speed: f64, acceleration: Vec3| {
            let acceleration = f64::from(acceleration.norm());
            (speed + (speed * speed + 4.0 * acceleration * longest).sqrt()) / (2.0 * longest)
        };
        let accelerated = steady + self.acceleration;
        if self.rate > 0.0 {
            let dragged = rate(speeds[0], accelerated + self.pull - v * self.rate);
            dragged.min(rate(speeds[1], accelerated))
        } else {
            rate(speeds[0], accelerated)
        }
    }
}
