//! Contact of sheets with rigid bodies, which move each other.
//!
//! *Method*: a contact is a point of a sheet that comes near a body where both would be without contact, found once a substep. It keeps
//! n·w ≥ −gap, with w the displacement of the point relative to the body and n the body's normal (`impact.rs`), and Coulomb friction holds
//! the point while it can. Both sides take the step together (`solve.rs`): A Δx = Σ Λ and M Δq = −Σ Jᵀ Λ, with A the sheet's own matrix
//! for implicit Euler and its masses for symplectic Euler, and M the masses and inertias of the bodies. So neither side is unstable,
//! however light it is. Bodies resolve their contacts with colliders and each other between the solves.
//! *Departs from the paper*: [gudukbay97] has fixed solids alone.
//!
//! Symbols: Λ → `push`, the impulse on the point times Δt [kg·m]; w → `relative` in `contact.rs`; J → `arm`.
//! Limits: points keep out of bodies, as out of solids, but not the faces between them. Normals are constant in a substep. Contacts are
//! inelastic. `[sheets.repulsion]` is of colliders alone.

mod contact;
mod impact;
mod solve;

pub(in crate::sim) use contact::BodyContacts;
pub(in crate::sim) use solve::MAX_SOLVES;

use super::{
    Sheets,
    face_contacts::CoupledSubstep,
    solids::{PlacedSolid, SKIN_FRACTION, count_inside, place_solids},
};
use crate::{
    par,
    solid::{BodySurface, Pose, RigidBody},
};
use contact::BodyContact;
use impact::{Impact, MARGIN, Path};

impl Sheets {
    /// Coefficient of friction with a body: as between bodies, √(μ₁ μ₂).
    fn friction_with(&self, surface: &BodySurface<'_>) -> f32 {
        (self.params.common.friction.unwrap_or(0.0) * surface.friction).sqrt()
    }

    /// Finds the points near `bodies` at the end of a substep of `dt` [s], which both sides have taken without contact.
    pub(in crate::sim) fn find_body_contacts(
        &self,
        substep: &CoupledSubstep,
        (surfaces, bodies): (&[BodySurface<'_>], &[RigidBody]),
    ) -> BodyContacts {
        let (clearance, dt) = (self.params.common.solid_clearance(), substep.dt);
        let colliders = place_solids(&self.solids, clearance, substep.now, substep.now + dt);
        let poses: Vec<[Pose; 2]> = bodies.iter().map(|body| [body.start_pose(), body.pose()]).collect();
        let placed: Vec<_> = surfaces
            .iter()
            .zip(&poses)
            .map(|(surface, poses)| PlacedSolid::rigid(surface.shape, clearance, *poses))
            .collect();
        let found = par::map_chunks(self.len(), par::CHUNK, |range| {
            let mut found = Vec::new();
            for point in range {
                let first = found.len();
                let (before, x) = (substep.before.get(point), self.x.get(point));
                for (body, surface) in surfaces.iter().enumerate() {
                    let ends = [poses[body][0].to_local(before), poses[body][1].to_local(x)];
                    let path = Path { ends, radius: surface.inner_radius };
                    if !path.comes_near(surface.center, surface.reach + clearance) {
                        continue;
                    }
                    let Some(Impact { place, gap, normal }) =
                        path.impact(|place| placed[body].local_contact(place))
                    else {
                        continue;
                    };
                    let rigid = &bodies[body];
                    let arm = poses[body][1].to_world(place).cast() - rigid.position();
                    let velocity = rigid.velocity() + rigid.angular_velocity().cross(&arm);
                    let slip = (x - before) - (velocity * dt).cast::<f32>();
                    let normal = poses[body][1].rotation * normal;
                    found.push(BodyContact {
                        arm,
                        ..BodyContact::new(
                            point,
                            Some(body),
                            x,
                            (normal, gap, slip),
                            self.friction_with(surface),
                        )
                    });
                }
                // A collider behind the point bears what the body presses onto it.
                let is_touched = found.len() > first;
                for collider in colliders.iter().filter(|_| is_touched) {
                    let (gap, normal) = collider.contact(x, 1);
                    if gap < MARGIN * clearance.max(self.area[point].sqrt()) {
                        let kept = collider.contact(before, 0).0.min(0.0);
                        let slip = (x - before) - collider.displacement(x);
                        let friction = self.params.common.friction.unwrap_or(0.0);
                        found.push(BodyContact::new(point, None, x, (normal, gap - kept, slip), friction));
                    }
                }
            }
            found
        });
        let free = bodies.iter().map(|body| [body.position(), body.angular_velocity()]).collect();
        BodyContacts { list: found.concat(), free, first_change: None, guess: None, solution: None }
    }

    /// Number of points inside bodies.
    pub(in crate::sim) fn count_inside_bodies(
        &self,
        (surfaces, bodies): (&[BodySurface<'_>], &[RigidBody]),
    ) -> u64 {
        let placed: Vec<_> = surfaces
            .iter()
            .zip(bodies)
            .map(|(surface, body)| PlacedSolid::rigid(surface.shape, 0.0, [body.pose(); 2]))
            .collect();
        count_inside(&placed, &self.x, self.inverse.as_flattened())
    }

    /// Moves points that are still inside bodies to their surfaces, without a change of velocity and unless a collider is there.
    /// Returns the largest depth, over the body's inner radius.
    pub(in crate::sim) fn leave_bodies(
        &mut self,
        contacts: &BodyContacts,
        (surfaces, bodies): (&[BodySurface<'_>], &[RigidBody]),
        then: f64,
    ) -> f32 {
        let clearance = self.params.common.solid_clearance();
        let placed: Vec<_> = surfaces
            .iter()
            .zip(bodies)
            .map(|(surface, body)| {
                PlacedSolid::rigid(surface.shape, clearance, [body.start_pose(), body.pose()])
            })
            .collect();
        let solids = place_solids(&self.solids, clearance, then, then);
        let mut deepest = 0.0_f32;
        for (contact, body) in contacts.list.iter().filter_map(|contact| Some((contact, contact.body?))) {
            let x = self.x.get(contact.point);
            let (gap, normal) = placed[body].contact(x, 1);
            deepest = deepest.max(-gap / surfaces[body].inner_radius);
            let moved = x + normal * (SKIN_FRACTION * (1.0 + x.amax()) - gap);
            let is_free = self.mobility(contact.point) > 0.0
                && solids.iter().all(|solid| solid.contact(moved, 1).0 >= 0.0);
            if gap < 0.0 && is_free {
                self.x.set(contact.point, moved);
            }
        }
        deepest
    }
}
