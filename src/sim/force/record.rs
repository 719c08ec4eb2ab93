//! Record of the forces on one system over a frame.

use serde::{Deserialize, Serialize};

/// What forces did to a system in a frame. It is the same on every run and for any thread count.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
#[non_exhaustive]
pub struct ForceRecord {
    /// Work of the forces during the frame [J]; negative where they slow the motion. The system's energy may rise by it.
    pub work: f64,
    /// Largest acceleration by forces of a particle or point in the frame, before any limit [m/s²].
    pub max_acceleration: f64,
    /// Accelerations of particles or points that were limited to a displacement of one CFL length in a substep, over all substeps.
    pub limited: u64,
}

impl ForceRecord {
    /// Adds a chunk of points or a substep: its count of limited accelerations and its largest one [m/s²].
    pub(in crate::sim) fn add(&mut self, limited: u64, max_acceleration: f64) {
        self.limited += limited;
        self.max_acceleration = self.max_acceleration.max(max_acceleration);
    }
}
