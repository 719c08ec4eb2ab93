//! Friction and restitution of solids in a substep, and their energy.
//!
//! *Method*: see `walls/friction.rs`, which has the law for one particle. The displacements by solids are accumulated from the
//! prediction to the last correction. The work of moving solids raises the bound of the energy. What friction
//! dissipates is reported, but does not lower that bound: a density solve that jitters makes energy that friction removes again, and
//! the sum would freeze liquid at rest in the end.
//! *Limits*: particles that a coupled system moves into a solid are projected out of it without friction.

use super::{Liquid, LiquidRecord, Partners, rigid::RigidContact, walls::PushedParticle};
use crate::{math::Vec3, par};

impl Liquid {
    /// Starts the sums of displacements by solids with those of the prediction over `dt` [s].
    pub(super) fn start_contacts(&mut self, dt: f32) {
        if let Some(v_before) = &mut self.v_before {
            v_before.clone_from(&self.v);
        }
        self.solver.wall_push.clear();
        self.solver.wall_push.resize(self.x.len(), Vec3::zeros());
        self.add_predicted_push(dt);
    }

    /// Adds the displacements by solids of a prediction over `dt` [s].
    pub(super) fn add_predicted_push(&mut self, dt: f32) {
        let (x, v, p) = (&self.x, &self.v, &self.solver.p);
        par::update(&mut self.solver.wall_push, |i, push| *push += p[i] - (x[i] + v[i] * dt));
    }

    /// Applies friction and restitution to velocities and predicted positions after the density solve over `dt` [s].
    pub(super) fn apply_friction(&mut self, dt: f32, partners: &mut Partners<'_>, record: &mut LiquidRecord) {
        let Some(v_before) = &self.v_before else { return };
        let (walls, gravity, wall_push) = (&self.walls, self.steady_acceleration(), &self.solver.wall_push);
        let columns = [self.v.as_mut_slice(), self.solver.p.as_mut_slice()];
        let partials = par::map_chunks_mut(columns, par::CHUNK, |start, [v, p]| {
            let (mut work, mut dissipated, mut on_bodies) = (0.0, 0.0, Vec::new());
            for (k, (v, p)) in v.iter_mut().zip(p).enumerate() {
                let push = wall_push[start + k];
                if push == Vec3::zeros() {
                    continue;
                }
                let particle = PushedParticle { p: *p, v: *v, v_before: v_before[start + k], push };
                let impulse = walls.contact_impulse(particle, gravity, dt);
                *v += impulse.change;
                let contact = |(body, change): (usize, Vec3)| {
                    let normal = change.try_normalize(f32::MIN_POSITIVE)?;
                    Some(RigidContact {
                        particle: (start + k) as u32,
                        body: body as u32,
                        x: *p,
                        normal,
                        push: change,
                    })
                };
                on_bodies.extend(impulse.by_bodies.into_iter().flatten().filter_map(contact));
                *p += impulse.displacement;
                work += impulse.work;
                // At rest on a slope, the potential energy that the displacement restores balances the kinetic.
                dissipated += (impulse.dissipated + f64::from(gravity.dot(&impulse.displacement))).max(0.0);
            }
            ([work, dissipated], on_bodies)
        });
        let [work, dissipated] =
            partials.iter().fold([0.0; 2], |[work, lost], (part, _)| [work + part[0], lost + part[1]]);
        if let Some(bodies) = &mut partners.bodies {
            let contacts: Vec<RigidContact> =
                partials.iter().flat_map(|(_, on_bodies)| on_bodies).copied().collect();
            let (v, units) = (&mut self.v, [self.mass; 2]);
            self.solver.rigid.exchange(&contacts, bodies.bodies_mut(), units, |i, less| v[i] += less);
        }
        self.first_energy += self.mass * work;
        record.solid_work += self.mass * work;
        record.friction_dissipation += self.mass * dissipated;
        self.solver.check_skin(&self.rest);
    }
}
