//! Record of the forces on one system over a frame.

use super::field::Kick;
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
    /// Index in the preset of the force that contributes most to the largest limited acceleration; absent: none was limited.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub strongest: Option<u32>,
}

impl ForceRecord {
    /// Adds the largest acceleration of each chunk of a substep. `strongest` finds the force that contributes most at a point.
    pub(in crate::sim) fn add(&mut self, chunks: Vec<ChunkMaximum>, strongest: impl Fn(usize) -> u32) {
        let mut largest = ChunkMaximum::default();
        for chunk in chunks {
            self.limited += chunk.limited;
            let is_larger = chunk.acceleration > largest.acceleration;
            largest = if is_larger { chunk } else { largest };
        }
        let acceleration = f64::from(largest.acceleration);
        if largest.limited > 0 && (self.strongest.is_none() || acceleration > self.max_acceleration) {
            self.strongest = Some(strongest(largest.point));
        }
        self.max_acceleration = self.max_acceleration.max(acceleration);
    }

    /// Adds a later record.
    pub(in crate::sim) fn unite(&mut self, later: &Self) {
        let Self { work, max_acceleration, limited, strongest } = *later;
        if strongest.is_some() && (self.strongest.is_none() || max_acceleration > self.max_acceleration) {
            self.strongest = strongest;
        }
        self.work += work;
        self.limited += limited;
        self.max_acceleration = self.max_acceleration.max(max_acceleration);
    }
}

/// The largest acceleration in a chunk of points.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::sim) struct ChunkMaximum {
    /// Limited accelerations of the chunk.
    limited: u64,
    /// Before any limit [m/s²].
    acceleration: f32,
    point: usize,
}

impl ChunkMaximum {
    /// Counts what forces add to the velocity of a point.
    pub(in crate::sim) fn add(&mut self, kick: &Kick, point: usize) {
        self.limited += u64::from(kick.is_limited);
        if kick.acceleration > self.acceleration {
            (self.acceleration, self.point) = (kick.acceleration, point);
        }
    }
}
