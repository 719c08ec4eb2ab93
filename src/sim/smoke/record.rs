//! What smoke tells of a frame.

use crate::sim::vortex::flow::{Account, FlowReport};
use serde::Serialize;

/// What happened to the smoke in a frame. The same on every run and for any thread count.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct SmokeRecord {
    /// How the vortons moved.
    #[serde(flatten)]
    pub flow: FlowReport,
    /// Vortons at the frame's end.
    pub vortons: u64,
    /// Tracers at the frame's end.
    pub tracers: u64,
    /// Tracers given off.
    pub emitted: u64,
    /// Tracers that were to be given off inside a solid, and were not.
    pub smothered: u64,
    /// Vortons that pushes made.
    pub made: u64,
    /// What motion keeps, and the sampled error of the velocity, at the frame's end.
    #[serde(flatten)]
    pub account: Account,
}
