//! Friction and restitution of a solid's surface; the law is in `friction.rs`.

use crate::solid::Solid;

/// Friction and restitution of a surface.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Surface {
    /// Coulomb's μ and e [1].
    pub(super) friction: f32,
    pub(super) restitution: f32,
}

impl Surface {
    pub(super) fn of(solid: &Solid) -> Self {
        Self { friction: solid.friction, restitution: solid.restitution }
    }

    /// Whether it changes anything.
    pub(super) fn acts(&self) -> bool {
        self.friction > 0.0 || self.restitution > 0.0
    }
}
