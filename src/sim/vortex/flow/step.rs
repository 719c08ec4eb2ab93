//! Time integration: one substep, and a frame of them.
//!
//! *Method*: [williamson80]'s third-order Runge–Kutta scheme in two copies of the state, case 7: for each of
//! three stages q ← a q + dt · rate, y ← y + b q. The time step follows from the largest velocity gradient
//! and velocity.

use super::super::{Gradient, Kernel, OutOfRange, Vortons, vortons::check_points};
use super::{
    ExternalEffects, Flow, FlowParams, FlowReport, Medium, Rates, Relaxation, Stage, StepReport,
    ViscousScheme, rates::MaxRates, relaxation::relax,
};
use crate::math::elementary::exp_m1;
use crate::{
    math::Vec3,
    par,
    sim::{Diverged, Stop, Watch},
};

/// The coefficients a, b of the stages, and the times c at which their rates are evaluated, in substeps.
const STAGES: [(f32, f32, f64); 3] =
    [(0.0, 1.0 / 3.0, 0.0), (-5.0 / 9.0, 15.0 / 16.0, 1.0 / 3.0), (-153.0 / 128.0, 8.0 / 15.0, 0.75)];

/// The largest angle by which a vorton may rotate by itself in a substep [rad] before its strength is
/// clamped. Time steps within the limits are several times smaller: strengths are clamped only where
/// `max_substeps` prevents those, and are then bounded under any stretching. Larger, and an instability moves
/// vortons farther before it ends; smaller, and strengths are clamped without need.
const MAX_ROTATION: f32 = 2.0;

/// The limits of a substep.
#[derive(Clone, Copy, Debug)]
pub struct SubstepLimits {
    /// The remaining time of the frame [s] (> 0), which the time step divides evenly.
    pub remaining: f64,
    /// The shortest allowed time step [s].
    pub min_time_step: f64,
    /// The number of the substep in the frame, from 1, for messages.
    pub number: u32,
}

impl Flow {
    /// Advances by one substep, and advects `tracers` with it.
    ///
    /// # Errors
    /// [`Diverged`] if a value is out of range; the state is then of use for diagnosis only.
    pub fn step(
        &mut self,
        limits: SubstepLimits,
        tracers: &mut [Vec3],
        external: &mut dyn ExternalEffects,
    ) -> Result<StepReport, Diverged> {
        self.vortons.check().map_err(|error| self.diverged(&error, limits.number))?;
        let mut report = StepReport::default();
        let mut registers = Registers::new(self.vortons.len(), tracers.len());
        let mut max_strength = Vec::new();
        for (stage, (a, b, c)) in STAGES.into_iter().enumerate() {
            // Rates of the stage. The time step follows from those of the first.
            let state =
                Stage { seconds: c * report.seconds, vortons: &self.vortons, volume: &self.volume, tracers };
            let mut rates = Rates::at(state, &self.params, external)
                .map_err(|error| self.diverged(&error, limits.number))?;
            rates.add_stretching(&self.vortons);
            if stage == 0 {
                let max = rates.max(&self.vortons, center(self.params.kernel));
                (report.gradient, report.cores) = (max.gradient, max.cores);
                (report.seconds, report.capped) = self.time_step(limits, max, external.max_time_step());
                max_strength = self.max_strength(report.seconds);
            }

            // Advection, stretching and external effects.
            let dt = report.seconds as f32;
            advance(&mut self.vortons.position, &mut registers.position, &rates.velocity, a, b, dt);
            advance(&mut self.vortons.strength, &mut registers.strength, &rates.strength, a, b, dt);
            advance(tracers, &mut registers.tracers, &rates.tracers, a, b, dt);
            report.clamped += clamp(&mut self.vortons.strength, &max_strength);
            registers.gradient = rates.gradient;
        }
        self.strained += report.seconds * f64::from(report.gradient);
        self.diffuse(&mut report, &registers.gradient, limits.number)?;
        let checked = self.vortons.check().and_then(|()| check_points(tracers));
        checked.map_err(|error| self.diverged(&error, limits.number))?;
        Ok(report)
    }

    /// Diffusion, and relaxation by the gradients of the last stage, at fixed positions.
    fn diffuse(
        &mut self,
        report: &mut StepReport,
        gradient: &[Gradient],
        substep: u32,
    ) -> Result<(), Diverged> {
        if let Some(viscosity) = &self.params.viscosity {
            let nu = self.viscosities(viscosity, gradient);
            match viscosity.scheme {
                ViscousScheme::Exchange => report.exchanges = self.exchange(&nu, report.seconds, substep)?,
                ViscousScheme::Spreading => self.spread_cores(&nu, report.seconds),
            }
        }
        if let Some(Relaxation { time }) = self.params.relaxation {
            let f = -exp_m1(-report.seconds / f64::from(time));
            relax(&mut self.vortons.strength, gradient, f as f32);
        }
        Ok(())
    }

    /// Advances by a frame of `seconds` [s] (> 0) in as many substeps as necessary, and remeshes, in air
    /// without solids, when needed.
    ///
    /// # Errors
    /// [`Stop`]: as of [`Flow::step`], or if the watch cancels.
    pub fn advance(
        &mut self,
        seconds: f64,
        tracers: &mut [Vec3],
        external: &mut dyn ExternalEffects,
        watch: &mut dyn Watch,
    ) -> Result<FlowReport, Stop> {
        let mut report = FlowReport::default();
        let min_time_step = seconds / f64::from(self.params.max_substeps);
        let mut remaining = seconds;
        // The last substep ends the frame up to rounding.
        while remaining > 1e-9 * seconds {
            if watch.is_cancelled() {
                return Err(Stop::Interrupted);
            }
            let limits = SubstepLimits { remaining, min_time_step, number: report.substeps + 1 };
            let step = self.step(limits, tracers, external)?;
            remaining -= step.seconds;
            report.add(&step, self.remesh_if_needed(report.substeps + 1, &|_| Medium::Air)?);
            watch.substep(1.0 - remaining / seconds);
        }
        Ok(report)
    }

    /// The time step [s], and whether it is longer than the rates allow.
    fn time_step(&self, limits: SubstepLimits, max: MaxRates, external: f64) -> (f64, bool) {
        let FlowParams { strain, displacement, .. } = self.params;
        let wanted = f64::from(strain / max.gradient)
            .min(f64::from(displacement / max.cores))
            .min(f64::from(strain / max.spin_up).sqrt())
            .min(external);
        let allowed = wanted.max(limits.min_time_step);
        // Rates of zero allow any time step.
        let parts = (limits.remaining / allowed * (1.0 - 1e-9)).ceil().max(1.0);
        let seconds = limits.remaining / parts;
        (seconds, wanted < seconds * (1.0 - 1e-6))
    }

    /// The largest strength that each vorton may have after a substep [m³/s]: its own, or that which rotates
    /// it by [`MAX_ROTATION`].
    fn max_strength(&self, seconds: f64) -> Vec<f32> {
        let unit = MAX_ROTATION * 4.0 * std::f32::consts::PI / (center(self.params.kernel) * seconds as f32);
        let Vortons { strength, core, .. } = &self.vortons;
        let mut max = vec![0.0; core.len()];
        par::fill(&mut max, |i| strength[i].norm().max(unit * core[i].powi(3)));
        max
    }

    /// The error for a vorton or tracer that is out of range.
    fn diverged(&self, error: &OutOfRange, substep: u32) -> Diverged {
        let limits = "a smaller strain limit, more max_substeps or a larger core";
        error.diverged(substep, &self.id, "tracers", limits)
    }
}

/// K(0) σ³: the centre of a core rotates by itself at Γ K(0)/4π.
fn center(kernel: Kernel) -> f32 {
    match kernel {
        Kernel::Ball | Kernel::RosenheadMoore => 1.0,
        Kernel::WinckelmansLeonard => 2.5,
        Kernel::Gaussian => 0.265_961_5, // √(2/π)/3
    }
}

/// The registers q of the scheme, and the gradients of the last stage.
struct Registers {
    position: Vec<Vec3>,
    strength: Vec<Vec3>,
    tracers: Vec<Vec3>,
    gradient: Vec<Gradient>,
}

impl Registers {
    fn new(vortons: usize, tracers: usize) -> Self {
        Self {
            position: vec![Vec3::zeros(); vortons],
            strength: vec![Vec3::zeros(); vortons],
            tracers: vec![Vec3::zeros(); tracers],
            gradient: Vec::new(),
        }
    }
}

/// Advances one property by a stage: q ← a q + dt · rate, y ← y + b q.
fn advance(y: &mut [Vec3], q: &mut [Vec3], rate: &[Vec3], a: f32, b: f32, dt: f32) {
    par::update(q, |i, q| *q = *q * a + rate[i] * dt);
    let q = &*q;
    par::update(y, |i, y| *y += q[i] * b);
}

/// Clamps strengths to `max` and counts the changes. NaN stays, to be reported.
fn clamp(strength: &mut [Vec3], max: &[f32]) -> u32 {
    let counts = par::map_chunks_mut([strength], par::CHUNK, |first, [chunk]| {
        let mut count = 0;
        for (strength, &max) in chunk.iter_mut().zip(&max[first..]) {
            let size = strength.norm();
            // Rounding errors do not count as growth.
            if size > max * (1.0 + 1e-6) {
                *strength *= max / size;
                count += 1;
            }
        }
        count
    });
    counts.into_iter().sum()
}
