//! Small mathematics that several modules share.

pub mod kernel;
pub mod symmetric;
pub mod wide;

/// A point or vector in space, single precision, world axes (Z up).
pub type Vec3 = nalgebra::Vector3<f32>;
