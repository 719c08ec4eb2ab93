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
    /// Vortons that pushes and shedding made.
    pub made: u64,
    /// Vortons and tracers that slipped into solids and were put back to their surfaces, over all steps.
    pub returned_vortons: u64,
    /// See `returned_vortons`.
    pub returned_tracers: u64,
    /// What is left of the flow through the panels of solids, as a part of what there would be; `None` without solids.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unsolved: Option<f64>,
    /// The same between the panels, where nothing was asked to vanish, of the solid where that is most. Solids at which the air
    /// hardly moves do not count.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub through_flow: Option<f64>,
    /// Which solid that is, from 0 in the order of the preset.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub leakiest: Option<u32>,
    /// What motion keeps, and the sampled error of the velocity, at the frame's end.
    #[serde(flatten)]
    pub account: Account,
}
