//! How fast everything changes: by what the vortons induce, and by what acts from outside.

use super::super::{Gradient, Induced, OutOfRange, Targets, Vortons, induced_both};
use super::FlowParams;
use crate::{math::Vec3, par};
use std::f32::consts::PI;

/// What acts on the flow beside the vortons themselves: solids, wind, buoyancy.
pub trait Outside {
    /// Adds to `rates`, which hold what the vortons induce, what acts at this moment. It is asked at every stage of a
    /// substep, with the state of that stage, before stretching is made of the gradients.
    ///
    /// # Errors
    /// [`OutOfRange`] if it sums what vortons induce itself and cannot.
    fn act(&mut self, now: Moment<'_>, rates: &mut Rates) -> Result<(), OutOfRange>;

    /// The longest substep it can follow [s].
    fn longest(&self) -> f64 {
        f64::INFINITY
    }
}

/// Nothing acts from outside.
#[derive(Clone, Copy, Debug, Default)]
pub struct Still;

impl Outside for Still {
    fn act(&mut self, _: Moment<'_>, _: &mut Rates) -> Result<(), OutOfRange> {
        Ok(())
    }
}

/// A stage of a substep.
#[derive(Clone, Copy, Debug)]
pub struct Moment<'a> {
    /// Since the substep's start [s].
    pub seconds: f64,
    /// The vortons.
    pub vortons: &'a Vortons,
    /// The volume of each [m³].
    pub volume: &'a [f32],
    /// Points that drift along [m].
    pub passengers: &'a [Vec3],
}

/// How fast everything changes.
#[derive(Clone, Debug, Default)]
pub struct Rates {
    /// The velocity of every vorton [m/s].
    pub velocity: Vec<Vec3>,
    /// Its gradient there [1/s], that of what acts from outside included: it stretches.
    pub gradient: Vec<Gradient>,
    /// dΓ/dt of every vorton [m³/s²] beside stretching: from outside, 0 at first.
    pub strength: Vec<Vec3>,
    /// The velocity of every passenger [m/s].
    pub passengers: Vec<Vec3>,
}

impl Rates {
    /// All rates at this moment but that of stretching.
    pub(super) fn at(
        now: Moment<'_>,
        params: &FlowParams,
        outside: &mut dyn Outside,
    ) -> Result<Self, OutOfRange> {
        let (kernel, method) = (params.kernel, params.method());
        let (found, passengers) =
            induced_both(now.vortons, Targets::Vortons, now.passengers, kernel, method)?;
        let Induced { velocity, gradient, .. } = found;
        let mut rates =
            Self { velocity, gradient, strength: vec![Vec3::zeros(); now.vortons.len()], passengers };
        outside.act(now, &mut rates)?;
        Ok(rates)
    }

    /// Adds stretching to the rates of strengths.
    ///
    /// The transpose of the gradient and not the gradient itself: what two vortons give each other is then opposite, and ΣΓ
    /// stays.
    pub(super) fn stretch(&mut self, vortons: &Vortons) {
        let gradient = &self.gradient;
        par::update(&mut self.strength, |i, rate| {
            *rate += gradient[i].tr_mul(&vortons.strength[i]); // (∇u)ᵀ Γ, [winckelmans93]
        });
    }

    /// The largest rates, of a kernel whose K(0) σ³ is `middle`.
    pub(super) fn largest(&self, vortons: &Vortons, middle: f32) -> Largest {
        let most =
            |f: &(dyn Fn(usize) -> f32 + Sync)| par::max(vortons.len(), f).map_or(0.0, |(_, most)| most);
        let core = &vortons.core;
        Largest {
            gradient: most(&|i| self.gradient[i].norm()),
            cores: most(&|i| self.velocity[i].norm() / core[i]),
            spin_up: middle / (4.0 * PI) * most(&|i| self.strength[i].norm() / core[i].powi(3)),
        }
    }
}

/// The largest rates of all vortons: what the length of a substep depends on.
#[derive(Clone, Copy, Debug)]
pub(super) struct Largest {
    /// |∇u| [1/s], Frobenius' norm.
    pub(super) gradient: f32,
    /// Velocity over core [1/s].
    pub(super) cores: f32,
    /// How fast a vorton turns faster by itself [1/s²].
    pub(super) spin_up: f32,
}
