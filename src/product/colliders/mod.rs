//! Colliders: a mesh of each in its own axes, and its pose in every frame. docs/formats/shot.md has the files.

mod bodies;
mod check;
mod deforming;
mod motion;
mod outputs;
mod tessellate;
mod writer;

pub(super) use outputs::are_listed;
pub(super) use tessellate::shown_mesh;
pub(super) use writer::{COLLIDER_VERSION, ColliderMeshes};
