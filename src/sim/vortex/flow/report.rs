//! Reports on a substep and on a frame.

use super::super::Invariants;
use super::RemeshReport;
use serde::{Deserialize, Serialize};

/// The report on a substep.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
#[non_exhaustive]
pub struct StepReport {
    /// The time step [s].
    pub seconds: f64,
    /// The largest velocity gradient at a vorton at the start of the substep [1/s].
    pub gradient: f32,
    /// The largest velocity of a vorton at the start of the substep, in cores [1/s].
    pub cores: f32,
    /// Whether the limits required a shorter time step than was allowed.
    pub capped: bool,
    /// Strengths that were clamped because their vortons would have rotated farther in the substep than it
    /// resolves.
    pub clamped: u32,
    /// Steps of particle strength exchange.
    pub exchanges: u32,
}

/// The report on a frame. It is the same on every run and for any number of threads.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
#[non_exhaustive]
pub struct FlowReport {
    /// Substeps taken.
    pub substeps: u32,
    /// The largest velocity gradient at a vorton at the start of a substep [1/s].
    pub gradient: f32,
    /// Substeps longer than the limits require, because of `max_substeps`.
    pub capped: u32,
    /// Strengths clamped, over all substeps.
    pub clamped: u64,
    /// Steps of particle strength exchange.
    pub exchanges: u32,
    /// The number of remeshings.
    pub remeshed: u32,
    /// The report on all remeshings: vortons before the first and after the last, the largest `divergence`
    /// and `impulse_scale`, and the sums of the other numbers.
    pub remesh: Option<RemeshReport>,
}

impl FlowReport {
    /// Adds a substep, and the remeshing after it.
    pub fn add(&mut self, step: &StepReport, remesh: Option<RemeshReport>) {
        self.add_remeshing(remesh);
        self.substeps += 1;
        self.gradient = self.gradient.max(step.gradient);
        self.capped += u32::from(step.capped);
        self.clamped += u64::from(step.clamped);
        self.exchanges += step.exchanges;
    }

    /// Adds the report of [`Flow::remesh_if_needed`](super::Flow::remesh_if_needed).
    pub fn add_remeshing(&mut self, remesh: Option<RemeshReport>) {
        let Some(now) = remesh else { return };
        self.remeshed += 1;
        self.remesh = Some(self.remesh.map_or(now, |sum| RemeshReport {
            before: sum.before,
            after: now.after,
            removed: sum.removed.saturating_add(now.removed),
            redistributed: sum.redistributed + now.redistributed,
            lost_impulse: sum.lost_impulse + now.lost_impulse,
            divergence: sum.divergence.max(now.divergence),
            wide: sum.wide.saturating_add(now.wide),
            impulse_change_at_solids: sum.impulse_change_at_solids + now.impulse_change_at_solids,
            unconverged: sum.unconverged + now.unconverged,
            impulse_scale: sum.impulse_scale.max(now.impulse_scale),
        }));
    }
}

/// The invariants of the flow, and the error of its velocity.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Account {
    /// The invariants.
    pub invariants: Invariants,
    /// The relative L2 error of the velocity compared with the sum over all pairs, if it was sampled.
    pub error: Option<f64>,
    /// The requested error, with a sampled one of a method other than the sum over all pairs.
    pub tolerance: Option<f64>,
}
