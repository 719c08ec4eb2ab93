//! A pinned point and two joined points, as the solvers hold them.

use crate::{math::Vec3, solid::Motion};

/// A pinned point.
#[derive(Clone, Debug)]
pub(super) struct PinnedPoint {
    pub(super) point: u32,
    /// `None`: exactly.
    pub(super) stiffness: Option<f32>,
    pub(super) place: Vec3,
    pub(super) motion: Option<Motion>,
    /// End of the pin [s].
    pub(super) until: f64,
}

/// Two joined points.
#[derive(Clone, Debug)]
pub(super) struct JointPair {
    pub(super) ends: [u32; 2],
    /// `None`: exactly, see `exact_joints.rs`.
    pub(super) stiffness: Option<f32>,
    /// Unit vector.
    pub(super) direction: Option<Vec3>,
    pub(super) until: f64,
}

impl PinnedPoint {
    /// Whether the pin still holds.
    pub(super) fn holds(&self, time: f64) -> bool {
        time < self.until
    }

    /// Where the pin holds the point.
    pub(super) fn place(&self, time: f64) -> Vec3 {
        self.motion.as_ref().map_or(self.place, |motion| motion.pose(time).to_world(self.place))
    }
}

impl JointPair {
    /// Whether the joint still holds.
    pub(super) fn holds(&self, time: f64) -> bool {
        time < self.until
    }
}
