//! Where a moving solid is: poses between keyframes.
//!
//! *Method*: position and rotation are interpolated key by key. Angles are interpolated one by one, as animation
//! programs do, so that 0 to 720 degrees is two turns; quaternions by slerp along the shorter arc.
//!
//! Symbols: x_world = R x + p, with R → `rotation`, p → `position` [m]; t time since the shot's start [s].
//! Times and poses are double precision, so that a pose depends on the time alone and not on what came before.

use crate::math::{Vec3, rotation};
use nalgebra::{Matrix3, Quaternion, Unit, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// Where a collider is at a frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Keyframe {
    /// The frame, as `frames` counts. Keyframes ascend.
    pub frame: u32,
    /// Where the shape's own origin then is [m].
    #[serde(default)]
    pub position: [f32; 3],
    /// Turns about the world's X, then Y, then Z axis through the shape's own origin [deg] (Euler XYZ, as Blender).
    /// Each angle is interpolated by itself: from 0 to 720 the shape turns twice.
    #[serde(default)]
    pub rotation: [f32; 3],
    /// The turn as a quaternion (w, x, y, z), in place of `rotation`; any length but zero. Interpolated by slerp along the
    /// shorter arc. If one keyframe of a collider has it, all have.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub quaternion: Option<[f32; 4]>,
    /// Size of a collider over that in `shape`, about the shape's own origin. Range: 0.001 to 1000.
    #[serde(default = "one", skip_serializing_if = "is_one")]
    pub scale: f32,
}

fn one() -> f32 {
    1.0
}

fn is_one(scale: &f32) -> bool {
    *scale == 1.0
}

/// How a collider moves from one keyframe to the next.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Interpolation {
    /// At constant speed. Baked animation, a keyframe every frame, wants this.
    #[default]
    Linear,
    /// At rest at every keyframe, with ease out of the one and into the next.
    Smooth,
}

/// A place and a turn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Where the solid's own origin is [m].
    pub position: Vec3,
    /// From the solid's own axes to the world's.
    pub rotation: Matrix3<f32>,
}

impl Pose {
    /// The pose of what stands still.
    pub fn identity() -> Self {
        Self { position: Vec3::zeros(), rotation: Matrix3::identity() }
    }

    /// From the solid's own axes to the world's.
    #[inline]
    pub fn to_world(&self, x: Vec3) -> Vec3 {
        self.rotation * x + self.position
    }

    /// From the world's axes to the solid's own.
    #[inline]
    pub fn to_local(&self, x: Vec3) -> Vec3 {
        self.rotation.tr_mul(&(x - self.position))
    }
}

/// A rigid motion over time.
#[derive(Clone, Debug, PartialEq)]
pub struct Motion {
    keys: Vec<Key>,
    interpolation: Interpolation,
    /// Smallest and largest size over that of the shape as written.
    scales: [f32; 2],
}

/// A keyframe in seconds.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Key {
    time: f64,
    position: Vector3<f64>,
    turn: Turn,
    scale: f64,
}

/// A rotation in the form in which it is interpolated.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Turn {
    /// Angles about X, Y, Z [rad].
    Angles(Vector3<f64>),
    Quaternion(UnitQuaternion<f64>),
}

impl Motion {
    /// The motion through `keyframes`, in ascending order, at `fps` frames a second; frame `first` is at time 0.
    /// `None` without a keyframe. Before the first and after the last the solid stands still.
    pub fn new(keyframes: &[Keyframe], interpolation: Interpolation, fps: f64, first: u32) -> Option<Self> {
        let keys: Vec<Key> = keyframes
            .iter()
            .map(|key| Key {
                time: (f64::from(key.frame) - f64::from(first)) / fps,
                position: Vector3::from(key.position.map(f64::from)),
                scale: f64::from(key.scale),
                turn: match key.quaternion {
                    Some([w, x, y, z]) => {
                        let [w, x, y, z] = [w, x, y, z].map(f64::from);
                        Turn::Quaternion(Unit::new_normalize(Quaternion::new(w, x, y, z)))
                    }
                    None => {
                        Turn::Angles(Vector3::from(key.rotation.map(|angle| f64::from(angle).to_radians())))
                    }
                },
            })
            .collect();
        let scales = keyframes
            .iter()
            .fold([f32::INFINITY, 0.0_f32], |[low, high], key| [low.min(key.scale), high.max(key.scale)]);
        (!keys.is_empty()).then_some(Self { keys, interpolation, scales })
    }

    /// That of what stands still at the world's origin.
    pub(crate) fn still() -> Self {
        let turn = Turn::Angles(Vector3::zeros());
        Self {
            keys: vec![Key { time: 0.0, position: Vector3::zeros(), turn, scale: 1.0 }],
            interpolation: Interpolation::Linear,
            scales: [1.0; 2],
        }
    }

    /// The pose at time `t` [s].
    pub fn pose(&self, t: f64) -> Pose {
        self.key(t).pose()
    }

    /// Size over that of the shape as written, at time `t` [s].
    pub fn scale(&self, t: f64) -> f32 {
        self.key(t).scale as f32
    }

    /// Smallest and largest size over that of the shape as written.
    pub(crate) fn scales(&self) -> [f32; 2] {
        self.scales
    }

    /// Whether the size ever differs from that of the shape as written.
    pub(crate) fn is_scaling(&self) -> bool {
        self.scales != [1.0; 2]
    }

    /// The interpolated keyframe at time `t` [s].
    fn key(&self, t: f64) -> Key {
        let after = self.keys.partition_point(|key| key.time <= t);
        let (Some(a), Some(b)) = (self.keys[..after].last(), self.keys.get(after)) else {
            return if after == 0 { self.keys[0] } else { self.keys[after - 1] };
        };
        let part = (t - a.time) / (b.time - a.time);
        let part = match self.interpolation {
            Interpolation::Linear => part,
            Interpolation::Smooth => part * part * (3.0 - 2.0 * part),
        };
        let turn = match (a.turn, b.turn) {
            (Turn::Angles(a), Turn::Angles(b)) => Turn::Angles(a + (b - a) * part),
            (Turn::Quaternion(a), Turn::Quaternion(b)) => {
                // Half a turn has no shorter arc; the positive one is chosen.
                Turn::Quaternion(rotation::slerp(&a, &b, part).unwrap_or(if part < 0.5 { a } else { b }))
            }
            (_, turn) => turn,
        };
        let position = a.position + (b.position - a.position) * part;
        Key { time: t, position, turn, scale: a.scale + (b.scale - a.scale) * part }
    }

    /// The largest speed of any point of the shape, within `reach` [m] of its own origin as written, between times `from` and `to`
    /// [m/s], or a bound of it.
    pub fn fastest(&self, from: f64, to: f64, reach: f32) -> f64 {
        // The steepest slope of the smooth step is 3/2.
        let steepest = match self.interpolation {
            Interpolation::Linear => 1.0,
            Interpolation::Smooth => 1.5,
        };
        let pairs = self.keys.iter().zip(self.keys.iter().skip(1));
        let reached = pairs.filter(|(a, b)| a.time < to && from < b.time);
        reached
            .map(|(a, b)| {
                let angle = match (a.turn, b.turn) {
                    (Turn::Angles(a), Turn::Angles(b)) => (b - a).abs().sum(),
                    (Turn::Quaternion(a), Turn::Quaternion(b)) => rotation::angle_between(&a, &b),
                    _ => 0.0,
                };
                let shift = (b.position - a.position).norm();
                // A reach may be infinite.
                let by = |factor: f64| if factor > 0.0 { factor * f64::from(reach) } else { 0.0 };
                let turned = by(angle * a.scale.max(b.scale));
                steepest * (shift + turned + by((b.scale - a.scale).abs())) / (b.time - a.time)
            })
            .fold(0.0, f64::max)
    }
}

impl Key {
    fn pose(&self) -> Pose {
        let rotation = match self.turn {
            Turn::Angles(angles) => rotation::from_euler_angles(angles),
            Turn::Quaternion(turn) => turn,
        };
        Pose { position: self.position.cast(), rotation: rotation.to_rotation_matrix().matrix().cast() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key(frame: u32, position: [f32; 3], rotation: [f32; 3]) -> Keyframe {
        Keyframe { frame, position, rotation, quaternion: None, scale: 1.0 }
    }

    #[test]
    fn sizes_are_interpolated_and_bound_speeds() {
        let sized = |frame: u32, scale: f32| Keyframe { scale, ..key(frame, [0.0; 3], [0.0; 3]) };
        let motion = Motion::new(&[sized(0, 1.0), sized(2, 3.0)], Interpolation::Linear, 1.0, 0).unwrap();
        assert_eq!([-1.0, 0.5, 1.0, 9.0].map(|t| motion.scale(t)), [1.0, 1.5, 2.0, 3.0]);
        assert_eq!((motion.scales(), motion.is_scaling()), ([1.0, 3.0], true));
        assert_eq!(motion.fastest(0.0, 1.0, 0.5), 0.5);
        assert_eq!(motion.fastest(2.0, 3.0, 0.5), 0.0);
        assert!(!Motion::still().is_scaling() && Motion::still().fastest(0.0, 1.0, f32::INFINITY) == 0.0);
    }

    #[test]
    fn poses_pass_through_the_keys_and_hold_at_both_ends() {
        let keys = [key(1, [0.0; 3], [0.0; 3]), key(25, [2.4, 0.0, 0.0], [0.0, 0.0, 90.0])];
        for interpolation in [Interpolation::Linear, Interpolation::Smooth] {
            let motion = Motion::new(&keys, interpolation, 24.0, 1).unwrap();
            let x = |t: f64| motion.pose(t).to_world(Vec3::new(1.0, 0.0, 0.0));
            for t in [-1.0, 0.0] {
                assert!((x(t) - Vec3::x()).norm() < 1e-6);
            }
            for t in [1.0, 7.0] {
                assert!((x(t) - Vec3::new(2.4, 1.0, 0.0)).norm() < 1e-6);
            }
            assert!((motion.pose(0.5).position.x - 1.2).abs() < 1e-6, "half way at half time");
            let quarter = if interpolation == Interpolation::Linear { 0.6 } else { 0.375 };
            assert!((motion.pose(0.25).position.x - quarter).abs() < 1e-6);
            let back = motion.pose(0.3).to_local(x(0.3));
            assert!((back - Vec3::x()).norm() < 1e-6);
        }
        assert!(Motion::new(&[], Interpolation::Linear, 24.0, 1).is_none());
    }

    #[test]
    fn angles_keep_full_turns_and_quaternions_take_the_shorter_arc() {
        let spin = [key(0, [0.0; 3], [0.0; 3]), key(8, [0.0; 3], [0.0, 0.0, 720.0])];
        let motion = Motion::new(&spin, Interpolation::Linear, 1.0, 0).unwrap();
        assert!((motion.pose(1.0).to_world(Vec3::x()) - Vec3::y()).norm() < 1e-5);
        assert!((motion.fastest(0.0, 1.0, 2.0) - std::f64::consts::PI).abs() < 1e-6);
        let half = std::f32::consts::FRAC_1_SQRT_2;
        let mut turn = spin.clone();
        turn[0].quaternion = Some([2.0, 0.0, 0.0, 0.0]);
        turn[1].quaternion = Some([-half, 0.0, 0.0, -half]); // a quarter turn about Z, on the other side of the sphere
        let motion = Motion::new(&turn, Interpolation::Linear, 1.0, 0).unwrap();
        let expected = Vec3::new(half, half, 0.0);
        assert!((motion.pose(4.0).to_world(Vec3::x()) - expected).norm() < 1e-6);
    }

    #[test]
    fn no_point_is_faster_than_the_bound() {
        let keys = [key(0, [0.0; 3], [10.0, 0.0, 0.0]), key(3, [1.0, 2.0, 0.0], [80.0, -40.0, 200.0])];
        for interpolation in [Interpolation::Linear, Interpolation::Smooth] {
            let motion = Motion::new(&keys, interpolation, 1.0, 0).unwrap();
            let bound = motion.fastest(0.0, 3.0, 1.5) as f32;
            for step in 0..300 {
                let (a, b) = (motion.pose(f64::from(step) * 0.01), motion.pose(f64::from(step + 1) * 0.01));
                let x = Vec3::new(0.0, 1.5, 0.0);
                assert!((b.to_world(x) - a.to_world(x)).norm() < bound * 0.01 * 1.001);
            }
            assert_eq!(motion.fastest(3.0, 9.0, 1.5), 0.0);
        }
    }
}
