//! Records of a simulation, system by system: its start, and every frame.

use super::{
    clock::Seconds,
    coupling::CouplingRecord,
    liquid::{LiquidRecord, LiquidSeeds},
    rigid::{BodyRecord, BodySeeds},
    sheet::{SheetRecord, SheetSeeds},
    smoke::{SmokeRecord, SmokeSeeds},
};
use serde::{Deserialize, Serialize};

/// Report of the seeding, for each system that is present.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct SeedReport {
    /// The liquid.
    pub liquid: Option<LiquidSeeds>,
    /// The smoke.
    pub smoke: Option<SmokeSeeds>,
    /// The sheets.
    pub sheets: Option<SheetSeeds>,
    /// The rigid bodies.
    pub bodies: Option<BodySeeds>,
}

/// Record of a frame, for each system that is present. Everything except for `seconds` is the same on every run and for any
/// thread count.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
#[non_exhaustive]
pub struct FrameRecord {
    /// The liquid.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub liquid: Option<LiquidRecord>,
    /// The smoke.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub smoke: Option<SmokeRecord>,
    /// The sheets.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sheets: Option<SheetRecord>,
    /// The rigid bodies.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bodies: Option<BodyRecord>,
    /// The couplings.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub coupling: Option<CouplingRecord>,
    /// Wall-clock time of every pass [s], in order of the passes. Rebuilding lists between iterations counts as "solve".
    pub seconds: Seconds,
}

impl FrameRecord {
    /// Wall-clock time of all passes [s].
    pub fn total_seconds(&self) -> f64 {
        self.seconds.iter().map(|(_, seconds)| seconds).sum()
    }
}
