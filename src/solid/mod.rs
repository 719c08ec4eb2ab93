//! Colliders: what the systems cannot enter, as signed distances and outward normals.

mod contact;
mod shape;

pub use contact::ShapeError;
pub use shape::{Collider, Shape};
