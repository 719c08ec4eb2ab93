//! Colliders: what the systems cannot enter, as signed distances and outward normals.

mod shape;

pub use shape::{Collider, Shape};
