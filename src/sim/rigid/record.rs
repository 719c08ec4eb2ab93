//! Records of rigid bodies: of their start and of a frame.

use crate::sim::force::ForceRecord;
use serde::{Deserialize, Serialize};

/// Rigid bodies at the start of a shot.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct BodySeeds {
    /// Number of bodies.
    pub bodies: u32,
    /// Bodies that start inside a collider or another body by more than a tenth of the smaller inner radius.
    pub overlapping: u64,
}

/// What happened to the rigid bodies in a frame. The same on every run and for any thread count.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
#[non_exhaustive]
pub struct BodyRecord {
    /// Number of bodies.
    pub bodies: u32,
    /// Substeps taken.
    pub substeps: u32,
    /// Substeps that were longer than the motion allows, because a frame has 2000 at most; without a liquid.
    pub capped: u32,
    /// Kinetic energy at the frame's end [J].
    pub kinetic_energy: f64,
    /// −M g·x of the centres of mass at the frame's end [J].
    pub potential_energy: f64,
    /// Largest speed of a centre of mass at the frame's end [m/s].
    pub max_speed: f64,
    /// Most points in contact in a substep.
    pub contacts: u64,
    /// Largest depth of a body in a collider or another body at the frame's end, over the smaller inner radius.
    pub penetration: f64,
    /// Force fields; absent without any.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub forces: Option<ForceRecord>,
}
