//! Coulomb friction and restitution of solids.
//!
//! *Method*: a solid pushes a particle with its boundary density or images, its share of the surface tension and by projection. The
//! sum of these displacements over a substep, along the solid's normal and over Δt, is the normal impulse per mass J. Friction removes at most μ J of the
//! tangential velocity relative to the surface, and never reverses it (Coulomb's law, with one coefficient at rest and in
//! motion). As in the position-based friction of [macklin14] the particle is moved back too, or it would creep down a slope with
//! g Δt, but only along its predicted motion: what the density solve moved stays, or the next solve would move it once more, and
//! a puddle at rest jitters. Restitution e gives a particle that hits a surface at least e times its speed of
//! impact (Newton's law).
//! *Departs from [macklin14]*: one pass after the density solve instead of one in every iteration, with the
//! impulse in place of the depth of the last projection; one coefficient; restitution.
//!
//! Symbols: μ → `friction`, e → `restitution` [1]; J → `impulse` [m/s].
//! Limits: of several solids that push one particle, each gets the part of the displacement along its normal, which is exact if
//! they are perpendicular. Impacts slower than two steps of gravity do not bounce.

use super::{Body, Walls, surface::Surface};
use crate::math::Vec3;

/// Speed below which an impact is resting contact, in speeds that gravity gives in a substep: a particle at rest arrives with
/// one. If larger, bounces end higher up. At 2, e = 0.5 still has its fourth bounce, of 2 mm after a fall of 0.5 m.
const RESTING_STEPS: f32 = 2.0;

/// Bound of the rounding errors of a displacement, relative to the coordinates: tracing the path to a body has some without a
/// contact.
pub(in crate::sim::liquid) const ROUNDING: f32 = 8.0 * f32::EPSILON;

/// A particle that solids pushed in a substep.
#[derive(Clone, Copy, Debug)]
pub(in crate::sim::liquid) struct PushedParticle {
    /// Position after the density solve [m].
    pub(in crate::sim::liquid) p: Vec3,
    /// Velocity after the density solve, and with gravity before it [m/s].
    pub(in crate::sim::liquid) v: Vec3,
    pub(in crate::sim::liquid) v_before: Vec3,
    /// Sum of the displacements by solids [m].
    pub(in crate::sim::liquid) push: Vec3,
}

/// Change of a particle by friction and restitution.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(in crate::sim::liquid) struct ContactImpulse {
    /// Change of velocity [m/s].
    pub(in crate::sim::liquid) change: Vec3,
    /// Displacement by friction [m].
    pub(in crate::sim::liquid) displacement: Vec3,
    /// Work of moving solids, per mass [J/kg].
    pub(in crate::sim::liquid) work: f64,
    /// Rigid bodies among the solids with their shares of the change of velocity [m/s].
    pub(in crate::sim::liquid) by_bodies: [Option<(usize, Vec3)>; 2],
    /// Energy that friction dissipates, per mass, without the change of potential energy [J/kg].
    pub(in crate::sim::liquid) dissipated: f64,
}

impl Walls {
    /// Whether any solid has friction or restitution.
    pub(in crate::sim::liquid) fn has_friction_or_restitution(&self) -> bool {
        self.planes.iter().any(|plane| plane.surface.acts())
            || self.bodies.iter().any(|body| body.surface.acts())
    }

    /// Friction and restitution of the solids on a particle, over a substep of `dt` [s].
    pub(in crate::sim::liquid) fn contact_impulse(
        &self,
        particle: PushedParticle,
        gravity: Vec3,
        dt: f32,
    ) -> ContactImpulse {
        let PushedParticle { p, v_before, mut push, .. } = particle;
        let mut v = particle.v;
        let mut out = ContactImpulse::default();
        let noise = ROUNDING * p.amax();
        let mut touch = |d: f32, n: Vec3, surface: Surface, mover: Option<usize>, body: Option<&Body>| {
            let pushed = push.dot(&n);
            if pushed <= noise {
                return;
            }
            push -= n * pushed; // a second solid with this normal did not push once more
            let u = mover.map_or(Vec3::zeros(), |mover| self.displacement(mover, body, p) / dt);
            let (before, work) = (out.change, out.work);
            let mut impulse = pushed / dt;
            let approach = (u - v_before).dot(&n);
            if surface.restitution > 0.0 && approach > RESTING_STEPS * gravity.norm() * dt {
                // Depth below the surface without the solid: gravity did not accelerate the particle along it.
                let depth = body.map_or(self.contact, |body| body.contact) - d + n.dot(&(v - v_before)) * dt;
                let impact2 = approach * approach + 2.0 * n.dot(&gravity) * depth;
                let gain = surface.restitution * impact2.max(0.0).sqrt() - n.dot(&(v - u));
                if depth > 0.0 && gain > 0.0 {
                    v += n * gain;
                    out.change += n * gain;
                    out.work += f64::from(gain) * f64::from(n.dot(&u));
                    impulse += gain;
                }
            }
            let slip = v - u - n * n.dot(&(v - u));
            let speed = slip.norm();
            if surface.friction > 0.0 && speed > 0.0 {
                let change = slip * -(surface.friction * impulse / speed).min(1.0);
                v += change;
                out.change += change;
                // Along the predicted motion, at most all of it.
                let predicted = v_before - u - n * n.dot(&(v_before - u));
                let undone = -change.dot(&predicted) / predicted.norm_squared();
                if undone > 0.0 {
                    out.displacement -= predicted * (undone.min(1.0) * dt);
                }
                out.work += f64::from(change.dot(&u));
                out.dissipated -= f64::from(change.dot(&(slip + change * 0.5)));
            }
            if let Some(body) = mover.and_then(|mover| mover.checked_sub(self.keyframed)) {
                out.work = work;
                // More than two bodies hardly touch one particle; the others are then as unmoved solids.
                if let Some(free) = out.by_bodies.iter_mut().find(|share| share.is_none()) {
                    *free = Some((body, out.change - before));
                }
            }
        };
        for plane in self.planes.iter().filter(|plane| plane.surface.acts()) {
            let d = plane.n.dot(&p) - plane.offset;
            if d < self.support {
                touch(d, plane.n, plane.surface, plane.mover, None);
            }
        }
        for body in
            self.near(p, self.support).map(|body| &self.bodies[body]).filter(|body| body.surface.acts())
        {
            if self.body_distance(body, p) < self.support {
                let (d, n) = self.body_contact(body, p);
                touch(d, n, body.surface, body.mover, Some(body));
            }
        }
        out
    }
}
