//! Rates of change of vortons and tracers: by induced velocity, and by external effects.

use super::super::{Gradient, Induced, OutOfRange, Targets, Vortons, induced_both};
use super::FlowParams;
use crate::{math::Vec3, par};
use std::f32::consts::PI;

/// External effects on the flow, besides the induced velocity: solids, wind, buoyancy.
pub trait ExternalEffects {
    /// Adds the external contributions to `rates`, which contain the induced velocity. Called at every stage
    /// of a substep with the state of that stage, before the gradients are used for stretching.
    ///
    /// # Errors
    /// [`OutOfRange`] if an effect evaluates induced velocities and a vorton or point is out of range.
    fn add_rates(&mut self, stage: Stage<'_>, rates: &mut Rates) -> Result<(), OutOfRange>;

    /// The longest time step that resolves the effects [s].
    fn max_time_step(&self) -> f64 {
        f64::INFINITY
    }
}

/// No external effects.
#[derive(Clone, Copy, Debug, Default)]
pub struct NoExternalEffects;

impl ExternalEffects for NoExternalEffects {
    fn add_rates(&mut self, _: Stage<'_>, _: &mut Rates) -> Result<(), OutOfRange> {
        Ok(())
    }
}

/// The state at a stage of a substep.
#[derive(Clone, Copy, Debug)]
pub struct Stage<'a> {
    /// The time since the start of the substep [s].
    pub seconds: f64,
    /// The vortons.
    pub vortons: &'a Vortons,
    /// The volume of each vorton [m³].
    pub volume: &'a [f32],
    /// The positions of the tracers [m].
    pub tracers: &'a [Vec3],
}

/// Rates of change.
#[derive(Clone, Debug, Default)]
pub struct Rates {
    /// The velocity of every vorton [m/s].
    pub velocity: Vec<Vec3>,
    /// The velocity gradient at every vorton [1/s], including external velocities, for stretching.
    pub gradient: Vec<Gradient>,
    /// dΓ/dt of every vorton without stretching [m³/s²]: external contributions only.
    pub strength: Vec<Vec3>,
    /// The velocity of every tracer [m/s].
    pub tracers: Vec<Vec3>,
}

impl Rates {
    /// All rates at a stage, without stretching.
    pub(super) fn at(
        stage: Stage<'_>,
        params: &FlowParams,
        external: &mut dyn ExternalEffects,
    ) -> Result<Self, OutOfRange> {
        let (kernel, method) = (params.kernel, params.method());
        let (found, tracers) = induced_both(stage.vortons, Targets::Vortons, stage.tracers, kernel, method)?;
        let Induced { velocity, gradient, .. } = found;
        let mut rates =
            Self { velocity, gradient, strength: vec![Vec3::zeros(); stage.vortons.len()], tracers };
        external.add_rates(stage, &mut rates)?;
        Ok(rates)
    }

    /// Adds vortex stretching to the rates of strengths.
    ///
    /// The transpose form is used because two vortons then change each other's strengths by opposite amounts,
    /// which conserves ΣΓ.
    pub(super) fn add_stretching(&mut self, vortons: &Vortons) {
        let gradient = &self.gradient;
        par::update(&mut self.strength, |i, rate| {
            *rate += gradient[i].tr_mul(&vortons.strength[i]); // (∇u)ᵀ Γ, [winckelmans93]
        });
    }

    /// The largest rates, for a kernel whose K(0) σ³ is `center`.
    pub(super) fn max(&self, vortons: &Vortons, center: f32) -> MaxRates {
        let max = |f: &(dyn Fn(usize) -> f32 + Sync)| par::max(vortons.len(), f).map_or(0.0, |(_, max)| max);
        let core = &vortons.core;
        MaxRates {
            gradient: max(&|i| self.gradient[i].norm()),
            cores: max(&|i| self.velocity[i].norm() / core[i]),
            spin_up: center / (4.0 * PI) * max(&|i| self.strength[i].norm() / core[i].powi(3)),
        }
    }
}

/// The largest rates of all vortons, which limit the time step.
#[derive(Clone, Copy, Debug)]
pub(super) struct MaxRates {
    /// |∇u|, Frobenius norm [1/s].
    pub(super) gradient: f32,
    /// Velocity over core [1/s].
    pub(super) cores: f32,
    /// The angular acceleration of a core by itself [1/s²].
    pub(super) spin_up: f32,
}
