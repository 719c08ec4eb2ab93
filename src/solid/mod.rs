//! Colliders: what the systems cannot enter, as signed distances and outward normals, and how it moves.

mod collider;
mod contact;
mod deformation;
mod measures;
mod mesh;
mod motion;
mod rigid_body;
mod round;
mod shape;
mod surface_velocity;

pub use collider::{Collider, Look, Solid};
pub use contact::ShapeError;
pub(crate) use deformation::Deformation;
pub use mesh::{Axis, MeshShape};
pub use motion::{Interpolation, Keyframe, Motion, Pose};
pub(crate) use rigid_body::{BodyState, BodySurface, MassProperties, RigidBody, body_poses, filled_cells};
pub use shape::Shape;
#[cfg(test)]
pub(crate) use shape::sampled_mesh;
pub(crate) use surface_velocity::{SurfaceVelocity, angular_velocity};
