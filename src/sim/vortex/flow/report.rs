//! What a substep and a frame tell of themselves.

use super::super::Invariants;
use super::RemeshReport;
use serde::{Deserialize, Serialize};

/// What happened in a substep.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct StepReport {
    /// Its length [s].
    pub seconds: f64,
    /// The largest velocity gradient at a vorton at its start [1/s].
    pub gradient: f32,
    /// The most cores a second that a vorton moved at its start [1/s].
    pub cores: f32,
    /// Whether the limits asked for a shorter one than was allowed.
    pub capped: bool,
    /// Strengths that were cut because their vortons would have spun farther in the substep than it can resolve.
    pub clamped: u32,
    /// Rounds of particle strength exchange.
    pub exchanges: u32,
}

/// What happened in a frame. The same on every run and for any number of threads.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct FlowReport {
    /// Substeps taken.
    pub substeps: u32,
    /// The largest velocity gradient at a vorton at a substep's start [1/s].
    pub gradient: f32,
    /// Substeps longer than the limits ask for, because of `max_substeps`.
    pub capped: u32,
    /// Strengths cut, over all substeps.
    pub clamped: u64,
    /// Rounds of particle strength exchange.
    pub exchanges: u32,
    /// Times that the vortons were put onto the lattice.
    pub remeshed: u32,
    /// What that did in all: how many vortons there were before the first time and after the last, the largest part of divergence and
    /// the largest `reach`, and sums of the rest.
    pub remesh: Option<RemeshReport>,
}

impl FlowReport {
    /// Books a substep and what [`Flow::tend`](super::Flow::tend) did after it.
    pub fn add(&mut self, step: &StepReport, remesh: Option<RemeshReport>) {
        self.tended(remesh);
        self.substeps += 1;
        self.gradient = self.gradient.max(step.gradient);
        self.capped += u32::from(step.capped);
        self.clamped += u64::from(step.clamped);
        self.exchanges += step.exchanges;
    }

    /// Books what [`Flow::tend`](super::Flow::tend) did.
    pub fn tended(&mut self, remesh: Option<RemeshReport>) {
        let Some(now) = remesh else { return };
        self.remeshed += 1;
        self.remesh = Some(self.remesh.map_or(now, |sum| RemeshReport {
            before: sum.before,
            after: now.after,
            dropped: sum.dropped.saturating_add(now.dropped),
            handed: sum.handed + now.handed,
            lost: sum.lost + now.lost,
            divergence: sum.divergence.max(now.divergence),
            wide: sum.wide.saturating_add(now.wide),
            turned: sum.turned + now.turned,
            unsolved: sum.unsolved + now.unsolved,
            reach: sum.reach.max(now.reach),
        }));
    }
}

/// What the flow holds, and how exactly it is known.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Account {
    /// The invariants.
    pub invariants: Invariants,
    /// The relative L2 error of the evaluator's velocity against the sum over all pairs, where it was sampled.
    pub error: Option<f64>,
}
