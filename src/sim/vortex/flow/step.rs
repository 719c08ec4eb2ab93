//! One substep, and a frame of them.
//!
//! *Method*: [williamson80]'s third-order Runge–Kutta scheme in two copies of the state, case 7: for each of three stages
//! q ← a q + dt · rate, y ← y + b q.

use super::super::{Gradient, Kernel, OutOfRange, Vortons, vortons::check_points};
use super::{
    Flow, FlowParams, FlowReport, Medium, Moment, Outside, Rates, Relaxation, StepReport, ViscousScheme,
    rates::Largest, relaxation::relax,
};
use crate::{
    math::Vec3,
    par,
    sim::{Diverged, Stop, Watch},
};

/// What is kept of q, what is taken of it, and when the rates are found, in substeps: a, b, c.
const STAGES: [(f32, f32, f64); 3] =
    [(0.0, 1.0 / 3.0, 0.0), (-5.0 / 9.0, 15.0 / 16.0, 1.0 / 3.0), (-153.0 / 128.0, 8.0 / 15.0, 0.75)];

/// How far a vorton may spin by itself in a substep [rad], before its strength is cut. Steps that keep the limits are
/// several times below; only where `max_substeps` forbids those is anything cut, and strengths are then bounded whatever
/// stretches them. Larger, and a burst throws vortons farther before it ends; smaller, and steps that were fine are cut.
const SPIN: f32 = 2.0;

/// A substep that is wanted.
#[derive(Clone, Copy, Debug)]
pub struct Span {
    /// What is left of the frame [s] (> 0): the substep divides it evenly.
    pub longest: f64,
    /// The shortest that is allowed [s].
    pub shortest: f64,
    /// Its number in the frame, from 1, for messages.
    pub number: u32,
}

impl Flow {
    /// Advances by one substep, and `passengers` with it.
    ///
    /// # Errors
    /// [`Diverged`] if anything left the numbers that mean something; the state is then good only to look at.
    pub fn step(
        &mut self,
        span: Span,
        passengers: &mut [Vec3],
        outside: &mut dyn Outside,
    ) -> Result<StepReport, Diverged> {
        self.vortons.check().map_err(|error| self.diverged(&error, span.number))?;
        let mut report = StepReport::default();
        let (mut held, mut caps) = (Held::new(self.vortons.len(), passengers.len()), Vec::new());
        for (stage, (a, b, c)) in STAGES.into_iter().enumerate() {
            // Rates of the stage, the first of which tell how long the substep is.
            let now = Moment {
                seconds: c * report.seconds,
                vortons: &self.vortons,
                volume: &self.volume,
                passengers,
            };
            let mut rates =
                Rates::at(now, &self.params, outside).map_err(|error| self.diverged(&error, span.number))?;
            rates.stretch(&self.vortons);
            if stage == 0 {
                let largest = rates.largest(&self.vortons, middle(self.params.kernel));
                (report.gradient, report.cores) = (largest.gradient, largest.cores);
                (report.seconds, report.capped) = self.length(span, largest, outside.longest());
                caps = self.caps(report.seconds);
            }

            // The stage itself.
            let dt = report.seconds as f32;
            advance(&mut self.vortons.position, &mut held.position, &rates.velocity, a, b, dt);
            advance(&mut self.vortons.strength, &mut held.strength, &rates.strength, a, b, dt);
            advance(passengers, &mut held.passengers, &rates.passengers, a, b, dt);
            report.clamped += cut(&mut self.vortons.strength, &caps);
            held.gradient = rates.gradient;
        }
        self.strained += report.seconds * f64::from(report.gradient);
        self.diffuse(&mut report, &held.gradient, span.number)?;
        let fit = self.vortons.check().and_then(|()| check_points(passengers));
        fit.map_err(|error| self.diverged(&error, span.number))?;
        Ok(report)
    }

    /// What follows motion at fixed positions: viscosity, and relaxation by the gradients of the last stage.
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
                ViscousScheme::Spreading => self.spread(&nu, report.seconds),
            }
        }
        if let Some(Relaxation { time }) = self.params.relaxation {
            let f = -(-report.seconds / f64::from(time)).exp_m1();
            relax(&mut self.vortons.strength, gradient, f as f32);
        }
        Ok(())
    }

    /// Advances by a frame of `seconds` [s] (> 0) in as many substeps as it takes, and remeshes, in air without solids, if that is
    /// called for.
    ///
    /// # Errors
    /// [`Stop`]: as of [`Flow::step`], or if the watch says so.
    pub fn advance(
        &mut self,
        seconds: f64,
        passengers: &mut [Vec3],
        outside: &mut dyn Outside,
        watch: &mut dyn Watch,
    ) -> Result<FlowReport, Stop> {
        let mut report = FlowReport::default();
        let shortest = seconds / f64::from(self.params.max_substeps);
        let mut left = seconds;
        // The last substep ends the frame but for rounding.
        while left > 1e-9 * seconds {
            if !watch.keep_going() {
                return Err(Stop::Interrupted);
            }
            let span = Span { longest: left, shortest, number: report.substeps + 1 };
            let step = self.step(span, passengers, outside)?;
            left -= step.seconds;
            report.add(&step, self.tend(report.substeps + 1, &|_| Medium::Air)?);
            watch.substep(1.0 - left / seconds);
        }
        Ok(report)
    }

    /// How long a substep is [s], and whether that is longer than the limits ask for.
    fn length(&self, span: Span, largest: Largest, outside: f64) -> (f64, bool) {
        let FlowParams { strain, displacement, .. } = self.params;
        let limits = f64::from(strain / largest.gradient)
            .min(f64::from(displacement / largest.cores))
            .min(f64::from(strain / largest.spin_up).sqrt())
            .min(outside);
        let allowed = limits.max(span.shortest);
        // Rates of zero allow any length.
        let parts = (span.longest / allowed * (1.0 - 1e-9)).ceil().max(1.0);
        let seconds = span.longest / parts;
        (seconds, limits < seconds * (1.0 - 1e-6))
    }

    /// The largest strength that each vorton may have after a substep [m³/s]: what it has, or what spins it by [`SPIN`].
    fn caps(&self, seconds: f64) -> Vec<f32> {
        let unit = SPIN * 4.0 * std::f32::consts::PI / (middle(self.params.kernel) * seconds as f32);
        let Vortons { strength, core, .. } = &self.vortons;
        let mut caps = vec![0.0; core.len()];
        par::fill(&mut caps, |i| strength[i].norm().max(unit * core[i].powi(3)));
        caps
    }

    /// The message about what the sums cannot hold.
    fn diverged(&self, error: &OutOfRange, substep: u32) -> Diverged {
        let limits = "a smaller strain limit, more max_substeps or a larger core";
        error.diverged(substep, &self.id, "tracers", limits)
    }
}

/// K(0) σ³: the middle of a core turns by itself at Γ K(0)/4π.
fn middle(kernel: Kernel) -> f32 {
    match kernel {
        Kernel::Ball | Kernel::RosenheadMoore => 1.0,
        Kernel::WinckelmansLeonard => 2.5,
        Kernel::Gaussian => 0.265_961_5, // √(2/π)/3
    }
}

/// The second copy: q of everything, and the gradients of the last stage.
struct Held {
    position: Vec<Vec3>,
    strength: Vec<Vec3>,
    passengers: Vec<Vec3>,
    gradient: Vec<Gradient>,
}

impl Held {
    fn new(vortons: usize, passengers: usize) -> Self {
        Self {
            position: vec![Vec3::zeros(); vortons],
            strength: vec![Vec3::zeros(); vortons],
            passengers: vec![Vec3::zeros(); passengers],
            gradient: Vec::new(),
        }
    }
}

/// A stage of one property: q ← a q + dt · rate, y ← y + b q.
fn advance(y: &mut [Vec3], q: &mut [Vec3], rate: &[Vec3], a: f32, b: f32, dt: f32) {
    par::update(q, |i, q| *q = *q * a + rate[i] * dt);
    let q = &*q;
    par::update(y, |i, y| *y += q[i] * b);
}

/// Cuts strengths to `caps` and counts them. What is no number stays, to be found.
fn cut(strength: &mut [Vec3], caps: &[f32]) -> u32 {
    let counts = par::map_chunks_mut([strength], par::CHUNK, |first, [part]| {
        let mut count = 0;
        for (strength, &cap) in part.iter_mut().zip(&caps[first..]) {
            let size = strength.norm();
            // A rounding above what it had is no growth.
            if size > cap * (1.0 + 1e-6) {
                *strength *= cap / size;
                count += 1;
            }
        }
        count
    });
    counts.into_iter().sum()
}
