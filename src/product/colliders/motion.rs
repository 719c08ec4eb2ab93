//! Poses of a collider in whole frames, as the solvers evaluate them at the times of frames.

use crate::{
    job::{MAX_POSES, RunError},
    solid::{Collider, Look, Motion, Pose},
};
use nalgebra::{Rotation3, UnitQuaternion};
use serde::Serialize;
use std::ops::RangeInclusive;

/// The motion of a collider, as its file has it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(super) struct MotionFile {
    /// Always "meniscus-motion".
    format: &'static str,
    /// Version of this format.
    version: u32,
    /// Key of the shape in presets.
    shape: &'static str,
    /// How pictures show it.
    pub(super) look: Look,
    /// The frame of the first pose. Before it and after the last pose the collider is at rest.
    pub(super) first: u32,
    /// Position [m] and rotation as a unit quaternion (w, x, y, z) in each whole frame.
    pub(super) poses: Vec<[f32; 7]>,
    /// Size over that of the mesh in each of these frames, if it changes.
    #[serde(skip_serializing_if = "Option::is_none")]
    scales: Option<Vec<f32>>,
    /// First and last frame of the point cache of a mesh that deforms, with a sample in each frame.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) point_cache_frames: Option<[u32; 2]>,
}

impl MotionFile {
    /// The motion of a collider in the frames of a shot whose frame `start` is at time 0.
    ///
    /// # Errors
    /// [`RunError::Request`] if it moves in more than [`MAX_POSES`] frames.
    pub(super) fn new(
        collider: &Collider,
        look: Look,
        fps: f64,
        start: u32,
        frames: &RangeInclusive<u32>,
    ) -> Result<Self, RunError> {
        let (first, last) = moving_frames(collider, frames);
        let count = pose_count(collider, frames);
        if count > MAX_POSES {
            return Err(RunError::Request(format!(
                "found a collider that moves in {count} frames, expected at most {MAX_POSES}; bring its first and last keyframes \
                 closer, or select frames with --frames"
            )));
        }
        let motion = Motion::new(&collider.keyframes, collider.interpolation, fps, start);
        let mut poses: Vec<[f32; 7]> = Vec::with_capacity(count as usize);
        let mut scales = motion.as_ref().filter(|motion| motion.is_scaling()).map(|_| Vec::new());
        for frame in first..=last {
            let time = (f64::from(frame) - f64::from(start)) / fps;
            let pose = motion.as_ref().map_or_else(Pose::identity, |motion| motion.pose(time));
            poses.push(numbers(&pose, poses.last()));
            if let Some((scales, motion)) = scales.as_mut().zip(motion.as_ref()) {
                scales.push(motion.scale(time));
            }
        }
        let (format, shape) = ("meniscus-motion", collider.shape.name());
        Ok(Self { format, version: 1, shape, look, first, poses, scales, point_cache_frames: None })
    }

    /// The motion of a body of that shape that has these poses from frame `first` on.
    pub(super) fn of_poses(shape: &'static str, look: Look, first: u32, poses: Vec<[f32; 7]>) -> Self {
        let (scales, point_cache_frames) = (None, None);
        Self { format: "meniscus-motion", version: 1, shape, look, first, poses, scales, point_cache_frames }
    }

    /// The text of the file.
    pub(super) fn text(&self) -> String {
        serde_json::to_string(self).expect("a motion is plain data") + "\n"
    }
}

/// The first and last frame in which a collider moves; one frame if it is at rest.
fn moving_frames(collider: &Collider, frames: &RangeInclusive<u32>) -> (u32, u32) {
    let (start, end) = (*frames.start(), *frames.end());
    match &collider.keyframes[..] {
        [from, .., to] => {
            let first = from.frame.clamp(start, end);
            (first, to.frame.clamp(first, end))
        }
        _ => (start, start),
    }
}

/// The number of poses in the file of a collider.
pub(super) fn pose_count(collider: &Collider, frames: &RangeInclusive<u32>) -> u64 {
    let (first, last) = moving_frames(collider, frames);
    u64::from(last - first) + 1
}

/// Position and quaternion of a pose. Of the two quaternions of a rotation, the one nearer to that of the pose before is taken, so
/// that components can be interpolated.
fn numbers(pose: &Pose, before: Option<&[f32; 7]>) -> [f32; 7] {
    let matrix = Rotation3::from_matrix_unchecked(pose.rotation.cast::<f64>());
    let turn = UnitQuaternion::from_rotation_matrix(&matrix).into_inner().normalize();
    let turn = [turn.w, turn.i, turn.j, turn.k];
    let dot = before.map_or(turn[0], |before| (0..4).map(|i| f64::from(before[3 + i]) * turn[i]).sum());
    let sign = if dot < 0.0 { -1.0 } else { 1.0 };
    let [x, y, z] = pose.position.into();
    // Adding 0 turns −0 into 0.
    let [w, i, j, k] = turn.map(|part| (sign * part) as f32 + 0.0);
    [x, y, z, w, i, j, k]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        math::Vec3,
        solid::{Interpolation, Keyframe, Shape},
    };
    use nalgebra::Quaternion;

    fn spinning(keys: &[(u32, f32)]) -> Collider {
        let key = |&(frame, turn): &(u32, f32)| Keyframe {
            frame,
            position: [frame as f32 * 0.1, 0.5, -1.0],
            rotation: [20.0, 0.0, turn],
            quaternion: None,
            scale: 1.0,
        };
        Collider {
            shape: Shape::Sphere { center: [0.0; 3], radius: 0.5 },
            keyframes: keys.iter().map(key).collect(),
            interpolation: Interpolation::Smooth,
            friction: None,
            restitution: None,
            contact_angle: None,
            look: None,
        }
    }

    #[test]
    fn poses_are_those_of_the_solvers_at_the_times_of_frames() {
        let collider = spinning(&[(5, 0.0), (30, 720.0)]);
        let file = MotionFile::new(&collider, Look::Matte, 24.0, 3, &(3..=40)).unwrap();
        assert_eq!((file.first, file.poses.len()), (5, 26));
        let motion = collider.solid(24.0, 3).motion.unwrap();
        let mut time = 0.0;
        for frame in 3..=40_u32 {
            let place = (frame.clamp(5, 30) - 5) as usize;
            let [x, y, z, w, i, j, k] = file.poses[place];
            let turn = UnitQuaternion::new_normalize(Quaternion::new(w, i, j, k));
            let point = Vec3::new(0.3, -0.7, 0.2);
            let found = turn * point + Vec3::new(x, y, z);
            // As the simulation counts: frame by frame.
            let expected = motion.pose(time).to_world(point);
            assert!((found - expected).norm() < 1e-5, "frame {frame}: {found} instead of {expected}");
            time += 1.0 / 24.0;
        }
        for pair in file.poses.windows(2) {
            let dot: f32 = (3..7).map(|i| pair[0][i] * pair[1][i]).sum();
            assert!(dot > 0.0, "a quaternion changes its sign: {pair:?}");
        }
    }

    #[test]
    fn what_stands_still_has_one_pose_and_the_motion_ends_with_the_frames() {
        let poses = |keys: &[(u32, f32)], frames| {
            let file = MotionFile::new(&spinning(keys), Look::Glass, 24.0, 1, &frames).unwrap();
            (file.first, file.poses.len())
        };
        assert_eq!(poses(&[], 1..=96), (1, 1));
        assert_eq!(poses(&[(9, 40.0)], 1..=96), (1, 1));
        assert_eq!(poses(&[(1, 0.0), (300, 90.0)], 10..=12), (10, 3));
        assert_eq!(poses(&[(200, 0.0), (300, 90.0)], 10..=12), (12, 1));
        let still = MotionFile::new(&spinning(&[]), Look::Glass, 24.0, 1, &(1..=1)).unwrap();
        assert_eq!(
            still.text(),
            "{\"format\":\"meniscus-motion\",\"version\":1,\"shape\":\"sphere\",\"look\":\"glass\",\"first\":1,\
             \"poses\":[[0.0,0.0,0.0,1.0,0.0,0.0,0.0]]}\n"
        );
    }

    #[test]
    fn a_motion_of_too_many_frames_is_refused() {
        let long = spinning(&[(1, 0.0), (u32::MAX, 90.0)]);
        let made = MotionFile::new(&long, Look::Matte, 24.0, 1, &(0..=u32::MAX));
        assert!(made.unwrap_err().to_string().contains("expected at most 250000"));
        assert!(MotionFile::new(&long, Look::Matte, 24.0, 1, &(7..=900)).is_ok());
    }
}
