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
    /// Largest acceleration that was limited [m/s²], which `strongest` is about.
    #[serde(skip)]
    pub(in crate::sim) max_limited: f64,
    /// Index in the preset of the force that contributes most to the largest limited acceleration; absent: none was limited.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub strongest: Option<u32>,
}

impl ForceRecord {
    /// Adds the largest acceleration of each chunk of a substep. `strongest` finds the force that contributes most at a point.
    pub(in crate::sim) fn add(&mut self, chunks: Vec<ChunkMaximum>, strongest: impl Fn(usize) -> u32) {
        for chunk in chunks {
            self.limited += chunk.limited;
            self.max_acceleration = self.max_acceleration.max(f64::from(chunk.acceleration));
            if f64::from(chunk.max_limited) > self.max_limited {
                (self.max_limited, self.strongest) = (chunk.max_limited.into(), Some(strongest(chunk.point)));
            }
        }
    }

    /// Adds a later record.
    pub(in crate::sim) fn unite(&mut self, later: &Self) {
        let Self { work, max_acceleration, limited, max_limited, strongest } = *later;
        if strongest.is_some() && (self.strongest.is_none() || max_limited > self.max_limited) {
            (self.max_limited, self.strongest) = (max_limited, strongest);
        }
        self.work += work;
        self.limited += limited;
        self.max_acceleration = self.max_acceleration.max(max_acceleration);
    }
}

/// The largest accelerations in a chunk of points.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::sim) struct ChunkMaximum {
    /// Limited accelerations of the chunk.
    limited: u64,
    /// Before any limit [m/s²].
    acceleration: f32,
    /// The largest that was limited, before that [m/s²], and its point.
    max_limited: f32,
    point: usize,
}

impl ChunkMaximum {
    /// Counts what forces add to the velocity of a point.
    pub(in crate::sim) fn add(&mut self, kick: &Kick, point: usize) {
        self.acceleration = self.acceleration.max(kick.acceleration);
        if kick.is_limited {
            self.limited += 1;
            if kick.acceleration > self.max_limited {
                (self.max_limited, self.point) = (kick.acceleration, point);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Vec3;

    #[test]
    fn the_strongest_force_is_that_of_the_largest_limited_acceleration() {
        let kick =
            |acceleration: f32, is_limited: bool| Kick { change: Vec3::zeros(), is_limited, acceleration };
        let chunk = |kicks: &[Kick], first: usize| {
            let mut largest = ChunkMaximum::default();
            kicks.iter().enumerate().for_each(|(i, kick)| largest.add(kick, first + i));
            largest
        };
        // The largest is not limited; the largest limited one is in the chunk after it.
        let chunks = vec![chunk(&[kick(9.0, false), kick(2.0, true)], 0), chunk(&[kick(3.0, true)], 7)];
        let mut record = ForceRecord::default();
        record.add(chunks, |point| point as u32);
        assert_eq!((record.limited, record.strongest, record.max_acceleration), (2, Some(7), 9.0));
        record.unite(&ForceRecord {
            limited: 1,
            max_limited: 2.5,
            strongest: Some(1),
            ..ForceRecord::default()
        });
        assert_eq!((record.limited, record.strongest), (3, Some(7)));
    }
}
