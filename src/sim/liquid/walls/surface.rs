//! What a solid's surface does to the liquid: friction and restitution (`friction.rs`), and wetting (`wetting.rs`).

use crate::solid::Solid;

/// Friction, restitution and contact angle of a surface.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Surface {
    /// Coulomb's μ and e [1].
    pub(super) friction: f32,
    pub(super) restitution: f32,
    /// Contact angle [°]; `None`: that of the liquid.
    pub(super) contact_angle: Option<f32>,
}

impl Surface {
    pub(super) fn of(solid: &Solid) -> Self {
        let &Solid { friction, restitution, contact_angle, .. } = solid;
        Self { friction, restitution, contact_angle }
    }

    /// Whether it has friction or restitution.
    pub(super) fn acts(&self) -> bool {
        self.friction > 0.0 || self.restitution > 0.0
    }
}
