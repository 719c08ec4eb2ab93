//! Small mathematics that several modules share.

pub(crate) mod elementary;
mod gmres;
mod json;
mod random;
pub(crate) mod rotation;
pub(crate) mod srgb;
pub mod symmetric;

pub(crate) use gmres::{dot, gmres};
pub(crate) use json::nan_if_null;
pub use random::Random;

/// A point or vector in space, single precision, world axes (Z up).
pub type Vec3 = nalgebra::Vector3<f32>;
