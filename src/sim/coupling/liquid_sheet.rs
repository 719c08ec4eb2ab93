//! Two-way coupling of a liquid and sheets by contact constraints.
//!
//! *Method*: when a substep begins, let q = Σ w x be the point of a face nearest to a particle, and n the direction from q to the
//! particle. The contact constraint is n·(x − q) ≥ d. It is projected within the liquid's iteration, after every correction of the
//! density ([pbf] Algorithm 1, line 14), so that the pressure reaches the sheet and the sheet's answer reaches the pressure. Both
//! sides move according to their masses, the sheet by its whole matrix (`sheet/face_contacts.rs`). Velocities follow from positions. At
//! the end of a substep, continuous collision detection follows the particles relative to the moving faces. A particle that crossed
//! a face is projected back, first together with the face, and at last alone. Rigid bodies that push the sheets are solved with them after each
//! such projection (`body_sheet.rs`), so that all three share the substep.
//! *Departs from the paper*: [pbf] section 8 mentions two-way interaction with position based cloth without formulas; its cloth has
//! no forces.
//!
//! Symbols: d → `distance` [m], half a spacing as at solids; λ → impulse by Δt [kg·m].
//! Limits: the sheet has no share in the density, so the layer of particles next to it packs closer. Liquid on one side of a sheet
//! interacts with liquid on the other.

use super::{
    BODY_PASSES, BodySheetRecord,
    body_sheet::BodySheetStep,
    contact::{self, CandidatePair, Face, ParticleContact, Trajectories},
    record::LiquidSheetRecord,
    triangle::{blend, closest_point, crossing, normal},
};
use crate::{
    math::Vec3,
    par,
    sim::{
        Diverged,
        clock::Clock,
        liquid::{CoupledBodies, CoupledSystem, Pushed, SubstepParticles},
        sheet::{CoupledSubstep, FaceContact, FaceContacts, SheetRecord, Sheets},
    },
    solid::RigidBody,
};

/// Search margin beyond the contact distance, in spacings: corrections may move particles this far.
const SEARCH_MARGIN: f32 = 0.5;

/// Largest speed at which a penetrating pair separates, as a fraction of √(g₀ · spacing). Without this limit the whole penetration
/// would become velocity in one substep: 0.1 mm in half a millisecond is 0.2 m/s, and water at rest on a sheet boils.
const MAX_SEPARATION_SPEED: f32 = 0.1;

/// g₀ [m/s²].
const STANDARD_GRAVITY: f32 = 9.81;

/// Penetration below this fraction of the contact distance is ignored: rounding and unconverged iterations leave it. At 0.01 it
/// becomes velocity, as above.
const PENETRATION_TOLERANCE: f32 = 1e-4;

/// Most iterations over the contacts at the end of a substep; one or two are usual.
const MAX_FINAL_ITERATIONS: u32 = 4;

/// Most iterations that project crossings back together with the sheet, and then as many without it.
const MAX_CROSSING_ITERATIONS: u32 = 4;

/// The sheets that a liquid is coupled with, and the parameters of the contact.
#[derive(Debug)]
pub(in crate::sim) struct LiquidSheetCoupling {
    faces: Vec<Face>,
    /// Coefficient of friction of each face.
    friction: Vec<Option<f32>>,
    /// Mass of a particle [kg].
    mass: f32,
    spacing: f32,
}

impl LiquidSheetCoupling {
    /// Sheets by number, with their friction, and a liquid of this spacing [m] and density [kg/m³].
    pub(in crate::sim) fn new(
        sheets: &Sheets,
        coupled: &[(usize, Option<f32>)],
        spacing: f32,
        density: f32,
    ) -> Self {
        let (mut faces, mut friction) = (Vec::new(), Vec::new());
        for &(sheet, coefficient) in coupled {
            faces.extend(sheets.triangles(sheet));
            friction.resize(faces.len(), coefficient);
        }
        Self { faces, friction, mass: density * spacing.powi(3), spacing }
    }
}

/// External forces on sheets.
pub(in crate::sim) trait ExternalForces {
    /// Sets the external forces for the substep from `now` [s] of `dt` [s].
    ///
    /// # Errors
    /// If they cannot be computed.
    fn apply(&mut self, sheets: &mut Sheets, now: f64, dt: f64, clock: &mut Clock) -> Result<(), Diverged>;
}

/// Sheets that share a liquid's substeps.
pub(in crate::sim) struct CoupledSheets<'a> {
    pub(in crate::sim) coupling: &'a LiquidSheetCoupling,
    pub(in crate::sim) sheets: &'a mut Sheets,
    pub(in crate::sim) external: Option<&'a mut dyn ExternalForces>,
    pub(in crate::sim) sheet_record: SheetRecord,
    pub(in crate::sim) record: LiquidSheetRecord,
    /// Contact with bodies, if there are some.
    pub(in crate::sim) body_record: Option<BodySheetRecord>,
    step: Option<SubstepState>,
}

/// State of the current substep.
struct SubstepState {
    dt: f64,
    coupled: CoupledSubstep,
    /// Points of sheets at the start of the substep [m].
    before: Vec<Vec3>,
    /// Predicted particles and points for which the candidate pairs were found [m].
    predicted: [Vec<Vec3>; 2],
    pairs: Vec<CandidatePair>,
    contacts: Vec<ParticleContact>,
    face_contacts: FaceContacts,
    /// Accumulated λ of each contact [kg·m].
    lambda: Vec<f32>,
    /// Contact with bodies, and that of the substep before.
    bodies: Option<BodySheetStep>,
    last_bodies: Option<BodySheetStep>,
}

impl<'a> CoupledSheets<'a> {
    pub(in crate::sim) fn new(
        coupling: &'a LiquidSheetCoupling,
        sheets: &'a mut Sheets,
        external: Option<&'a mut dyn ExternalForces>,
    ) -> Self {
        let (sheet_record, record) = (sheets.begin_frame(), LiquidSheetRecord::default());
        Self { coupling, sheets, external, sheet_record, record, body_record: None, step: None }
    }

    fn contact_distance(&self) -> f32 {
        0.5 * self.coupling.spacing
    }

    /// One iteration over contacts. Returns λ of each contact; `None` if none is violated.
    fn project_once(
        &mut self,
        step: &mut SubstepState,
        contacts: &ContactSet<'_>,
        particles: &mut SubstepParticles<'_>,
    ) -> Option<Vec<f32>> {
        let (sheets, distance) = (&*self.sheets, self.contact_distance());
        let penetration = |k: usize| {
            let (contact, face_contact) = (&contacts.list[k], &contacts.face_contacts.list[k]);
            let offset = particles.predicted[contact.particle as usize]
                - face_contact.contact_point(|i| sheets.point(i)[0]);
            let depth = contact.distance - contact.normal.dot(&offset);
            if depth > PENETRATION_TOLERANCE * distance { depth } else { 0.0 }
        };
        let mut depths = vec![0.0; contacts.list.len()];
        par::fill(&mut depths, penetration);
        if depths.iter().all(|&depth| depth == 0.0) {
            return None;
        }
        let lambda = self.sheets.solve_face_contacts(&mut step.coupled, contacts.face_contacts, &depths);
        self.record.unconverged += std::mem::take(&mut step.coupled.unconverged);
        let mut first = 0;
        while first < contacts.list.len() {
            let i = contacts.list[first].particle as usize;
            let end = first + contacts.list[first..].iter().take_while(|c| c.particle as usize == i).count();
            if lambda[first..end].iter().any(|&l| l > 0.0) {
                let push: Vec3 = (first..end).map(|k| contacts.list[k].normal * lambda[k]).sum();
                particles.move_to(i, particles.predicted[i] + push / self.coupling.mass);
            }
            first = end;
        }
        Some(lambda)
    }

    /// Adds the impulses of contacts to the record and returns their work; `v_before` are the particles' velocities without
    /// contacts and pressure [m/s].
    fn account_impulses(
        &mut self,
        step: &SubstepState,
        contacts: &ContactSet<'_>,
        lambda: &[f32],
        particles: &SubstepParticles<'_>,
        v_before: &[Vec3],
    ) -> ContactWork {
        let mut work = ContactWork::default();
        let all = contacts.list.iter().zip(&contacts.face_contacts.list).zip(lambda);
        for ((contact, face_contact), &l) in all.filter(|(_, l)| **l > 0.0) {
            let (n, i) = (contact.normal, contact.particle as usize);
            let end = face_contact.contact_point(|i| self.sheets.point(i)[0] - step.before[i]);
            let free = face_contact.contact_point(|i| step.predicted[1][i] - step.before[i]);
            let own = particles.predicted[i] - particles.start[i] + v_before[i] * step.dt as f32;
            let work_along =
                |displacement: Vec3| f64::from(l) * f64::from(n.dot(&displacement)) / step.dt.powi(2);
            work.at_end += work_along(end);
            work.of_sheets += work_along((end + free) * 0.5);
            work.on_liquid += work_along(own * 0.5);
            for axis in 0..3 {
                self.record.impulse[axis] -= f64::from(l * n[axis]) / step.dt;
            }
        }
        work
    }

    /// The first crossing of every particle that crossed a face, as a contact.
    fn find_crossings(&self, step: &SubstepState, particles: &SubstepParticles<'_>) -> Vec<ParticleContact> {
        let points = self.sheets.positions();
        let trajectories = trajectories(particles, [&step.before, &points]);
        let (faces, distance) = (&self.coupling.faces, 0.5 * self.contact_distance());
        let parts = par::map_chunks(step.pairs.len(), par::CHUNK, |range| {
            let mut found = Vec::new();
            for pair in &step.pairs[range] {
                let face = faces[pair.face as usize];
                let corners = [0, 1].map(|end| trajectories.corners(end, face));
                let i = pair.particle as usize;
                let path = [particles.start[i], particles.predicted[i]];
                if let Some(through) = crossing(path, corners) {
                    found.push(ParticleContact {
                        particle: pair.particle,
                        face: pair.face,
                        weights: through.weights,
                        normal: normal(corners[1]) * through.side,
                        distance,
                        count: 1,
                    });
                }
            }
            found
        });
        let mut all = parts.concat();
        all.dedup_by_key(|contact| contact.particle);
        all
    }

    fn face_contacts(&self, contacts: &[ParticleContact]) -> FaceContacts {
        let face_contact = |contact: &ParticleContact| FaceContact {
            points: self.coupling.faces[contact.face as usize],
            weights: contact.weights,
            normal: contact.normal,
            mass: self.coupling.mass / contact.count as f32,
        };
        FaceContacts::new(contacts.iter().map(face_contact).collect(), self.sheets.len())
    }

    /// Projects particles that crossed faces back, and adds the work of the contacts to `work`. Returns whether they pushed the sheets.
    fn resolve_crossings(
        &mut self,
        step: &mut SubstepState,
        particles: &mut SubstepParticles<'_>,
        v_before: &[Vec3],
        work: &mut ContactWork,
        clock: &mut Clock,
    ) -> bool {
        let mut has_pushed = false;
        for _ in 0..MAX_CROSSING_ITERATIONS {
            let through = self.find_crossings(step, particles);
            if through.is_empty() {
                return has_pushed;
            }
            let face_contacts = self.face_contacts(&through);
            let contacts = ContactSet { list: &through, face_contacts: &face_contacts };
            step.coupled.restart_from(self.sheets);
            if let Some(lambda) = self.project_once(step, &contacts, particles) {
                self.sheets.end_coupled_substep(&mut step.coupled, clock, &mut self.sheet_record);
                work.add(self.account_impulses(step, &contacts, &lambda, particles, v_before));
                has_pushed = true;
            }
        }
        for _ in 0..MAX_CROSSING_ITERATIONS {
            let through = self.find_crossings(step, particles);
            if through.is_empty() {
                return has_pushed;
            }
            self.record.projected_back += through.len() as u64;
            for contact in through {
                let corners =
                    self.coupling.faces[contact.face as usize].map(|i| self.sheets.point(i as usize)[0]);
                let i = contact.particle as usize;
                let from = particles.predicted[i];
                let weights = closest_point(from, corners);
                particles.move_to(i, blend(weights, corners) + contact.normal * contact.distance);
            }
        }
        self.record.crossed += self.find_crossings(step, particles).len() as u64;
        has_pushed
    }
}

/// Work of the contacts of a substep on the liquid, each impulse times three displacements [J].
#[derive(Clone, Copy, Debug, Default)]
struct ContactWork {
    /// With that of the face: an inelastic contact, after which the particle has the face's velocity.
    at_end: f64,
    /// With the mean of the face's with and without contacts: what the sheets lose.
    of_sheets: f64,
    /// With the mean of the particle's with and without contacts: what the liquid gains.
    on_liquid: f64,
}

impl ContactWork {
    fn add(&mut self, other: Self) {
        self.at_end += other.at_end;
        self.of_sheets += other.of_sheets;
        self.on_liquid += other.on_liquid;
    }

    /// Energy that the liquid may have more, or has less [J]. In inelastic contact `at_end` is the larger, and leaves the loss to
    /// the solver. But an impulse is a sum over iterations, after which a face may have moved farther than the particle:
    /// liquid on a face that yields loses no more than `on_liquid`, or it would freeze in mid-air. It gains no more than the
    /// sheets lose.
    fn exchanged(self) -> f64 {
        self.at_end.max(self.on_liquid.min(self.of_sheets.max(0.0)))
    }
}

/// Contacts, and the same as masses that face_contact the sheets.
struct ContactSet<'a> {
    list: &'a [ParticleContact],
    face_contacts: &'a FaceContacts,
}

fn trajectories<'a>(particles: &'a SubstepParticles<'_>, points: [&'a [Vec3]; 2]) -> Trajectories<'a> {
    Trajectories {
        particles: [particles.start, &*particles.predicted],
        points,
        grid: particles.grid,
        sorted_at: particles.sorted_at,
    }
}

impl CoupledSystem for CoupledSheets<'_> {
    fn max_speed(&self) -> f64 {
        self.sheets.max_speed()
    }

    fn substeps_left(&mut self, now: f64, left: f64, seconds: f64, done: u32) -> Result<u32, Diverged> {
        self.sheets.substeps_left(now, left, seconds, done)
    }

    fn advance_uncoupled(&mut self, now: f64, dt: f64, clock: &mut Clock) -> Result<(), Diverged> {
        self.sheets.update_pins_and_joints(now);
        if let Some(external) = &mut self.external {
            external.apply(self.sheets, now, dt, clock)?;
        }
        let before = self.sheets.positions();
        let mut coupled = self.sheets.begin_coupled_substep(now, dt, clock, &mut self.sheet_record)?;
        if let Some(last) = &mut self.step {
            coupled.warm_start(&mut last.coupled);
        }
        self.step = Some(SubstepState {
            dt,
            coupled,
            before,
            predicted: [Vec::new(), Vec::new()],
            pairs: Vec::new(),
            contacts: Vec::new(),
            face_contacts: FaceContacts::default(),
            lambda: Vec::new(),
            bodies: None,
            last_bodies: self.step.take().and_then(|step| step.bodies),
        });
        Ok(())
    }

    fn detect_contacts(
        &mut self,
        particles: &SubstepParticles<'_>,
        bodies: Option<&dyn CoupledBodies>,
        clock: &mut Clock,
    ) {
        let Some(mut step) = self.step.take() else { return };
        if let Some(bodies) = bodies {
            clock.time(BODY_PASSES[1], || step.find_bodies(self.sheets, bodies));
        }
        clock.time("coupling_search", || {
            let points = self.sheets.positions();
            let trajectories = trajectories(particles, [&step.before, &points]);
            let distance = self.contact_distance();
            step.pairs = contact::candidate_pairs(
                &trajectories,
                &self.coupling.faces,
                distance + SEARCH_MARGIN * self.coupling.spacing,
            );
            let speed = MAX_SEPARATION_SPEED * (STANDARD_GRAVITY * self.coupling.spacing).sqrt();
            let separation = speed * step.dt as f32;
            step.contacts = contact::particle_contacts(
                &trajectories,
                &self.coupling.faces,
                &step.pairs,
                distance,
                separation.min(0.2 * distance),
            );
            step.face_contacts = self.face_contacts(&step.contacts);
            step.lambda = vec![0.0; step.contacts.len()];
            step.predicted = [particles.predicted.to_vec(), points];
        });
        self.step = Some(step);
    }

    fn project_contacts(
        &mut self,
        particles: &mut SubstepParticles<'_>,
        bodies: Option<&mut dyn CoupledBodies>,
        clock: &mut Clock,
    ) -> Pushed {
        let Some(mut step) = self.step.take() else { return Pushed::default() };
        let particles = clock.time("coupling", || self.project_all(&mut step, particles));
        let SubstepState { bodies: contact, coupled, .. } = &mut step;
        let bodies = bodies.zip(contact.as_mut()).is_some_and(|(bodies, contact)| {
            clock.time(BODY_PASSES[1], || contact.solve(self.sheets, coupled, bodies));
            contact.is_pushing()
        });
        self.step = Some(step);
        Pushed { particles, bodies }
    }

    fn end_without_liquid(&mut self, bodies: &mut dyn CoupledBodies, clock: &mut Clock) {
        let Some(mut step) = self.step.take() else { return };
        clock.time(BODY_PASSES[1], || {
            step.find_bodies(self.sheets, bodies);
            step.solve_bodies(self.sheets, bodies);
        });
        if step.bodies.as_ref().is_some_and(BodySheetStep::is_pushing) {
            self.sheets.end_coupled_substep(&mut step.coupled, clock, &mut self.sheet_record);
        }
        self.end_bodies(&mut step, bodies, None, clock);
        self.step = Some(step);
    }

    fn end_substep(
        &mut self,
        particles: &mut SubstepParticles<'_>,
        mut bodies: Option<&mut dyn CoupledBodies>,
        v_before: &[Vec3],
        clock: &mut Clock,
    ) -> f64 {
        let Some(mut step) = self.step.take() else { return 0.0 };
        let work = clock.around("coupling", |clock| {
            for _ in 0..MAX_FINAL_ITERATIONS {
                if let Some(bodies) = &mut bodies {
                    clock.time(BODY_PASSES[1], || step.solve_bodies(self.sheets, *bodies));
                }
                if !self.project_all(&mut step, particles) {
                    break;
                }
            }
            self.sheets.end_coupled_substep(&mut step.coupled, clock, &mut self.sheet_record);
            // The candidate pairs hold for the predicted positions; if the substep ends elsewhere, they are found again.
            let points = self.sheets.positions();
            let margin = 0.5 * SEARCH_MARGIN * self.coupling.spacing;
            let off = |a: &[Vec3], b: &[Vec3]| {
                par::max(a.len(), |i| (a[i] - b[i]).norm_squared())
                    .is_some_and(|(_, far)| far > margin * margin)
            };
            if off(&step.predicted[0], particles.predicted) || off(&step.predicted[1], &points) {
                let trajectories = trajectories(particles, [&step.before, &points]);
                step.pairs = contact::candidate_pairs(&trajectories, &self.coupling.faces, margin);
            }
            let (contacts, face_contacts, lambda) = (
                std::mem::take(&mut step.contacts),
                std::mem::take(&mut step.face_contacts),
                std::mem::take(&mut step.lambda),
            );
            let set = ContactSet { list: &contacts, face_contacts: &face_contacts };
            let mut work = self.account_impulses(&step, &set, &lambda, particles, v_before);
            let has_pushed = self.resolve_crossings(&mut step, particles, v_before, &mut work, clock);
            self.record.contacts = lambda.iter().filter(|&&l| l > 0.0).count() as u64;
            (step.contacts, step.face_contacts, step.lambda) = (contacts, face_contacts, lambda);
            let pushing = (self.record.contacts > 0 || has_pushed).then_some([0.0; 2]);
            match bodies {
                Some(bodies) => self.end_bodies(&mut step, bodies, pushing, clock),
                None => self.sheets.account_energy(&step.coupled, pushing, &mut self.sheet_record),
            }
            work.exchanged()
        });
        self.record.work += work;
        self.step = Some(step);
        work
    }

    fn apply_friction(&mut self, v: &mut [Vec3], clock: &mut Clock) -> f64 {
        let Self { coupling, sheets, step, .. } = self;
        let Some(step) = step.as_ref().filter(|_| coupling.friction.iter().any(Option::is_some)) else {
            return 0.0;
        };
        let work = clock.time("coupling", || {
            let mut work = 0.0;
            let touching = step.contacts.iter().zip(&step.lambda).filter(|(_, l)| **l > 0.0);
            for (contact, &l) in touching {
                let Some(friction) = coupling.friction[contact.face as usize] else { continue };
                let face = coupling.faces[contact.face as usize].map(|i| i as usize);
                let i = contact.particle as usize;
                let face_velocity: Vec3 = (0..3).map(|k| sheets.point(face[k])[1] * contact.weights[k]).sum();
                let slip = v[i] - face_velocity;
                let slip = slip - contact.normal * contact.normal.dot(&slip);
                let speed = slip.norm();
                let mobility: f32 =
                    (0..3).map(|k| contact.weights[k].powi(2) * sheets.mobility(face[k])).sum();
                let sticking = speed / (1.0 / coupling.mass + mobility);
                let impulse = (friction * l / step.dt as f32).min(sticking);
                if impulse > 0.0 {
                    let change = slip * (impulse / speed);
                    v[i] -= change / coupling.mass;
                    work -= f64::from(change.dot(&face_velocity));
                    for (&corner, weight) in face.iter().zip(contact.weights) {
                        sheets.add_velocity(corner, change * (weight * sheets.mobility(corner)));
                    }
                }
            }
            work
        });
        self.record.work += work;
        work
    }
}

impl SubstepState {
    /// Finds the contacts with bodies.
    fn find_bodies(&mut self, sheets: &Sheets, bodies: &dyn CoupledBodies) {
        let momenta = bodies.bodies().iter().map(RigidBody::momenta).collect();
        self.bodies =
            Some(BodySheetStep::new(sheets, &self.coupled, bodies, momenta, self.last_bodies.take()));
    }

    /// Solves the contacts with bodies until nothing changes.
    fn solve_bodies(&mut self, sheets: &mut Sheets, bodies: &mut dyn CoupledBodies) {
        if let Some(step) = &mut self.bodies {
            step.solve_all(sheets, &mut self.coupled, bodies);
        }
    }
}

impl CoupledSheets<'_> {
    /// Ends a substep with bodies, after the velocities of the sheets; `pushing` is that of the liquid.
    fn end_bodies(
        &mut self,
        step: &mut SubstepState,
        bodies: &dyn CoupledBodies,
        pushing: Option<[f64; 2]>,
        clock: &mut Clock,
    ) {
        let Some(contact) = &step.bodies else { return };
        let pushing = contact.energies(bodies).or(pushing);
        self.sheets.account_energy(&step.coupled, pushing, &mut self.sheet_record);
        let record = self.body_record.get_or_insert_default();
        clock.time(BODY_PASSES[1], || contact.end(self.sheets, &step.coupled, bodies, record));
    }

    /// One iteration over the contacts of the substep. Returns whether any was violated.
    fn project_all(&mut self, step: &mut SubstepState, particles: &mut SubstepParticles<'_>) -> bool {
        let (contacts, face_contacts) =
            (std::mem::take(&mut step.contacts), std::mem::take(&mut step.face_contacts));
        let set = ContactSet { list: &contacts, face_contacts: &face_contacts };
        let found = self.project_once(step, &set, particles);
        if let Some(lambda) = &found {
            step.lambda.iter_mut().zip(lambda).for_each(|(sum, l)| *sum += l);
        }
        (step.contacts, step.face_contacts) = (contacts, face_contacts);
        found.is_some()
    }
}
