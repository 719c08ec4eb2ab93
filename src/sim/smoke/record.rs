//! Records of the seeding of smoke and of a frame.

use crate::sim::vortex::flow::{Account, FlowReport};
use serde::{Deserialize, Serialize};

/// Record of the seeding.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct SmokeSeeds {
    /// Vortons.
    pub vortons: u32,
    /// Tracers.
    pub tracers: u32,
    /// Tracers left out because they lay in a solid.
    pub skipped_in_solids: u32,
    /// Component of the wind normal to a plane, which is removed [m/s].
    pub wind_across: f32,
    /// Rings and tubes whose cores are narrower than those of vortons.
    pub narrow_cores: u32,
    /// Indices of the solids that are too small for the smoke's spacing to keep air out.
    pub sourceless: Vec<usize>,
}

/// Record of a frame, the same on every run and for any thread count.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
#[non_exhaustive]
pub struct SmokeRecord {
    /// How the vortons moved.
    #[serde(flatten)]
    pub flow: FlowReport,
    /// Vortons at the frame's end.
    pub vortons: u64,
    /// Tracers at the frame's end.
    pub tracers: u64,
    /// Tracers emitted.
    pub emitted: u64,
    /// Tracers rejected because they would have been emitted inside a solid.
    #[serde(rename = "smothered")]
    pub rejected: u64,
    /// Vortons made by impulses and by shedding.
    pub made: u64,
    /// Vortons projected out of solids, over all steps.
    pub returned_vortons: u64,
    /// Tracers projected out of solids, over all steps.
    pub returned_tracers: u64,
    /// Residual of the normal flow at the panels of solids, relative to that without sources; `None` without solids.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unsolved: Option<f64>,
    /// Leakage between the panels, relative to the normal flow without sources: the largest of all solids. Solids with a small normal
    /// flow do not count.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub through_flow: Option<f64>,
    /// Index of that solid, in the order of the preset.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub leakiest: Option<u32>,
    /// Invariants of the motion, and the sampled error of the velocity, at the frame's end.
    #[serde(flatten)]
    pub account: Account,
}
