//! What smoke reports of its seeding and of a frame.

use crate::sim::vortex::flow::{Account, FlowReport};
use serde::{Deserialize, Serialize};

/// What seeding smoke did.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SmokeSeeds {
    /// Vortons.
    pub vortons: u32,
    /// Tracers.
    pub tracers: u32,
    /// Tracers left out because they lay in a solid.
    pub skipped_in_solids: u32,
    /// The part of the wind that blows at a plane and was left out [m/s].
    pub wind_across: f32,
    /// The solids of the world, by number, that are too small for the smoke's spacing to keep air out.
    pub sourceless: Vec<usize>,
}

/// What happened to the smoke in a frame. The same on every run and for any thread count.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
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
