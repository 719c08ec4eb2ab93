//! Liquid and sheets push each other.
//!
//! *Method*: a particle and the place q = Σ w x of a face that is nearest to it when a substep begins keep n·(x − q) ≥ d, with n the direction
//! between them then. The constraint is one of the liquid's loop, after every correction of the density ([pbf] Algorithm 1, line 14), so
//! that pressure reaches the sheet and the sheet's answer the pressure. Both sides take the step that is theirs by their masses, the
//! sheet with its whole matrix (`sheet/face_contacts.rs`). Velocities follow from positions. When the substep ends, paths relative to moving faces
//! are followed: what went through a face is pushed back, both sides again, and in the end alone.
//! *Departs from the paper*: [pbf] section 8 tells of two-way interaction with position based cloth and has no formulas; its cloth has no forces.
//!
//! Symbols: d → `keep` [m], half a spacing as at solids; λ → impulse by Δt [kg·m].
//! Limits: the sheet has no share in densities: the layer at it packs closer. Liquid on both sides of a sheet feels itself through it.

use super::{
    meet::{self, Contact, Face, Pair, Ways},
    record::LiquidOnSheets,
    triangle::{blend, crossing, nearest, normal},
};
use crate::{
    math::Vec3,
    par,
    sim::{
        Diverged,
        liquid::{Company, Particles},
        record::Clock,
        sheet::{CoupledSubstep, FaceContact, FaceContacts, SheetRecord, Sheets},
    },
};

/// How far beyond the kept distance contacts are looked for, in spacings: what corrections may move particles.
const MARGIN: f32 = 0.5;

/// What is nearer than it should be parts at this part of √(g₀ · spacing). Parted at once, it would fly off with the whole way as its speed: in
/// substeps of half a millisecond a tenth of a millimetre is 0.2 m/s, and water at rest on a sheet boils.
const PARTING: f32 = 0.1;

/// g₀ [m/s²].
const STANDARD_GRAVITY: f32 = 9.81;

/// A gap that lacks less than this part of its distance is none: what rounding and unsolved rounds leave. At 0.01 it is speed, as above.
const SLACK: f32 = 1e-4;

/// Rounds that end a substep, at most: most need one or two.
const ROUNDS: u32 = 4;

/// Rounds in which what went through is pushed back by both sides, and then alone.
const BACK: u32 = 4;

/// Which sheets a liquid is coupled with, and how.
#[derive(Debug)]
pub(in crate::sim) struct Bound {
    faces: Vec<Face>,
    /// Of every face.
    friction: Vec<Option<f32>>,
    /// Of a particle [kg].
    mass: f32,
    spacing: f32,
}

impl Bound {
    /// Sheets by number, with their friction, and a liquid of this spacing [m] and density [kg/m³].
    pub(in crate::sim) fn new(
        sheets: &Sheets,
        coupled: &[(usize, Option<f32>)],
        spacing: f32,
        density: f32,
    ) -> Self {
        let (mut faces, mut friction) = (Vec::new(), Vec::new());
        for &(sheet, rubs) in coupled {
            faces.extend(sheets.triangles(sheet));
            friction.resize(faces.len(), rubs);
        }
        Self { faces, friction, mass: density * spacing.powi(3), spacing }
    }
}

/// What acts on sheets from outside in a substep.
pub(in crate::sim) trait Outside {
    /// Sets the forces from outside for the substep from `now` [s] of `dt` [s].
    ///
    /// # Errors
    /// If they cannot be computed.
    fn act(&mut self, sheets: &mut Sheets, now: f64, dt: f64, clock: &mut Clock) -> Result<(), Diverged>;
}

/// Sheets that share a liquid's substeps.
pub(in crate::sim) struct Together<'a> {
    pub(in crate::sim) bound: &'a Bound,
    pub(in crate::sim) sheets: &'a mut Sheets,
    pub(in crate::sim) outside: Option<&'a mut dyn Outside>,
    pub(in crate::sim) record: SheetRecord,
    pub(in crate::sim) told: LiquidOnSheets,
    step: Option<Step>,
}

/// A substep.
struct Step {
    dt: f64,
    leaning: CoupledSubstep,
    /// Points of sheets when it began [m].
    before: Vec<Vec3>,
    /// Particles and points where it was thought to lead when pairs were found [m].
    led: [Vec<Vec3>; 2],
    pairs: Vec<Pair>,
    contacts: Vec<Contact>,
    touches: FaceContacts,
    /// λ so far [kg·m].
    lambda: Vec<f32>,
}

impl<'a> Together<'a> {
    pub(in crate::sim) fn new(
        bound: &'a Bound,
        sheets: &'a mut Sheets,
        outside: Option<&'a mut dyn Outside>,
    ) -> Self {
        let record = sheets.begin_frame();
        Self { bound, sheets, outside, record, told: LiquidOnSheets::default(), step: None }
    }

    fn keep(&self) -> f32 {
        0.5 * self.bound.spacing
    }

    /// One round over contacts. Returns λ of each, and whether any pushed.
    fn round(
        &mut self,
        step: &mut Step,
        on: &Contacts<'_>,
        particles: &mut Particles<'_>,
    ) -> Option<Vec<f32>> {
        let (sheets, keep) = (&*self.sheets, self.keep());
        let way = |k: usize| {
            let (contact, touch) = (&on.list[k], &on.touches.list[k]);
            let apart = particles.to[contact.particle as usize] - touch.contact_point(|i| sheets.point(i)[0]);
            let lacks = contact.keep - contact.normal.dot(&apart);
            if lacks > SLACK * keep { lacks } else { 0.0 }
        };
        let mut ways = vec![0.0; on.list.len()];
        par::fill(&mut ways, way);
        if ways.iter().all(|&way| way == 0.0) {
            return None;
        }
        let lambda = self.sheets.solve_face_contacts(&mut step.leaning, on.touches, &ways);
        self.told.unfinished += std::mem::take(&mut step.leaning.unconverged);
        let mut first = 0;
        while first < on.list.len() {
            let i = on.list[first].particle as usize;
            let end = first + on.list[first..].iter().take_while(|c| c.particle as usize == i).count();
            if lambda[first..end].iter().any(|&l| l > 0.0) {
                let push: Vec3 = (first..end).map(|k| on.list[k].normal * lambda[k]).sum();
                let x = particles.to[i];
                particles.to[i] = (particles.free)(x, x + push / self.bound.mass);
            }
            first = end;
        }
        Some(lambda)
    }

    /// What contacts did, in the account.
    fn book(&mut self, step: &Step, list: &[Contact], touches: &FaceContacts, lambda: &[f32]) -> f64 {
        let mut work = 0.0;
        for ((contact, touch), &l) in list.iter().zip(&touches.list).zip(lambda).filter(|(_, l)| **l > 0.0) {
            let way = touch.contact_point(|i| self.sheets.point(i)[0] - step.before[i]);
            work += f64::from(l) * f64::from(contact.normal.dot(&way)) / step.dt.powi(2);
            for axis in 0..3 {
                self.told.impulse[axis] -= f64::from(l * contact.normal[axis]) / step.dt;
            }
        }
        work
    }

    /// The first crossing of every particle that went through a face, as a contact to be kept.
    fn crossings(&self, step: &Step, particles: &Particles<'_>) -> Vec<Contact> {
        let points = self.sheets.positions();
        let ways = ways(particles, [&step.before, &points]);
        let (faces, keep) = (&self.bound.faces, 0.5 * self.keep());
        let parts = par::map_chunks(step.pairs.len(), par::CHUNK, |range| {
            let mut found = Vec::new();
            for pair in &step.pairs[range] {
                let face = faces[pair.face as usize];
                let corners = [0, 1].map(|end| ways.corners(end, face));
                let i = pair.particle as usize;
                if let Some(through) = crossing([particles.from[i], particles.to[i]], corners) {
                    found.push(Contact {
                        particle: pair.particle,
                        face: pair.face,
                        weights: through.weights,
                        normal: normal(corners[1]) * through.side,
                        keep,
                        shared: 1,
                    });
                }
            }
            found
        });
        let mut all = parts.concat();
        all.dedup_by_key(|contact| contact.particle);
        all
    }

    fn touches(&self, contacts: &[Contact]) -> FaceContacts {
        let touch = |contact: &Contact| FaceContact {
            points: self.bound.faces[contact.face as usize],
            weights: contact.weights,
            normal: contact.normal,
            mass: self.bound.mass / contact.shared as f32,
        };
        FaceContacts::new(contacts.iter().map(touch).collect(), self.sheets.len())
    }

    /// Puts what went through faces back, and counts. Returns the work on the liquid [J].
    fn bring_back(&mut self, step: &mut Step, particles: &mut Particles<'_>, clock: &mut Clock) -> f64 {
        let mut work = 0.0;
        for _ in 0..BACK {
            let through = self.crossings(step, particles);
            if through.is_empty() {
                return work;
            }
            let touches = self.touches(&through);
            let on = Contacts { list: &through, touches: &touches };
            step.leaning.restart_from(self.sheets);
            if let Some(lambda) = self.round(step, &on, particles) {
                self.sheets.end_coupled_substep(&mut step.leaning, clock, &mut self.record);
                work += self.book(step, &through, &touches, &lambda);
            }
        }
        for _ in 0..BACK {
            let through = self.crossings(step, particles);
            if through.is_empty() {
                return work;
            }
            self.told.put_back += through.len() as u64;
            for contact in through {
                let corners =
                    self.bound.faces[contact.face as usize].map(|i| self.sheets.point(i as usize)[0]);
                let i = contact.particle as usize;
                let from = particles.to[i];
                let weights = nearest(from, corners);
                particles.to[i] =
                    (particles.free)(from, blend(weights, corners) + contact.normal * contact.keep);
            }
        }
        self.told.crossed += self.crossings(step, particles).len() as u64;
        work
    }
}

/// Contacts, and what they are for sheets.
struct Contacts<'a> {
    list: &'a [Contact],
    touches: &'a FaceContacts,
}

fn ways<'a>(particles: &'a Particles<'_>, points: [&'a [Vec3]; 2]) -> Ways<'a> {
    Ways {
        particles: [particles.from, &*particles.to],
        points,
        grid: particles.grid,
        sorted_at: particles.sorted_at,
    }
}

impl Company for Together<'_> {
    fn fastest(&self) -> f64 {
        self.sheets.max_speed()
    }

    fn substeps_left(&mut self, now: f64, left: f64, seconds: f64, done: u32) -> Result<u32, Diverged> {
        self.sheets.substeps_left(now, left, seconds, done)
    }

    fn advance_alone(&mut self, now: f64, dt: f64, clock: &mut Clock) -> Result<(), Diverged> {
        self.sheets.update_pins_and_joints(now);
        if let Some(outside) = &mut self.outside {
            outside.act(self.sheets, now, dt, clock)?;
        }
        let before = self.sheets.positions();
        let mut leaning = self.sheets.begin_coupled_substep(now, dt, clock, &mut self.record)?;
        if let Some(last) = &mut self.step {
            leaning.warm_start(&mut last.leaning);
        }
        let (led, touches) = ([Vec::new(), Vec::new()], FaceContacts::default());
        let (pairs, contacts, lambda) = (Vec::new(), Vec::new(), Vec::new());
        self.step = Some(Step { dt, leaning, before, led, pairs, contacts, touches, lambda });
        Ok(())
    }

    fn meet(&mut self, particles: &Particles<'_>, clock: &mut Clock) {
        let Some(mut step) = self.step.take() else { return };
        clock.time("coupling_search", || {
            let points = self.sheets.positions();
            let ways = ways(particles, [&step.before, &points]);
            let keep = self.keep();
            step.pairs = meet::pairs(&ways, &self.bound.faces, keep + MARGIN * self.bound.spacing);
            let parting = PARTING * (STANDARD_GRAVITY * self.bound.spacing).sqrt() * step.dt as f32;
            step.contacts =
                meet::contacts(&ways, &self.bound.faces, &step.pairs, keep, parting.min(0.2 * keep));
            step.touches = self.touches(&step.contacts);
            step.lambda = vec![0.0; step.contacts.len()];
            step.led = [particles.to.to_vec(), points];
        });
        self.step = Some(step);
    }

    fn press(&mut self, particles: &mut Particles<'_>, clock: &mut Clock) -> bool {
        let Some(mut step) = self.step.take() else { return false };
        let pushed = clock.time("coupling", || self.press_all(&mut step, particles));
        self.step = Some(step);
        pushed
    }

    fn part(&mut self, particles: &mut Particles<'_>, clock: &mut Clock) -> f64 {
        let Some(mut step) = self.step.take() else { return 0.0 };
        let work = clock.around("coupling", |clock| {
            for _ in 0..ROUNDS {
                if !self.press_all(&mut step, particles) {
                    break;
                }
            }
            self.sheets.end_coupled_substep(&mut step.leaning, clock, &mut self.record);
            // Pairs were found where the substep seemed to lead; if it led elsewhere, they are found again.
            let points = self.sheets.positions();
            let margin = 0.5 * MARGIN * self.bound.spacing;
            let off = |a: &[Vec3], b: &[Vec3]| {
                par::max(a.len(), |i| (a[i] - b[i]).norm_squared())
                    .is_some_and(|(_, far)| far > margin * margin)
            };
            if off(&step.led[0], particles.to) || off(&step.led[1], &points) {
                let ways = ways(particles, [&step.before, &points]);
                step.pairs = meet::pairs(&ways, &self.bound.faces, margin);
            }
            let (contacts, touches, lambda) = (
                std::mem::take(&mut step.contacts),
                std::mem::take(&mut step.touches),
                std::mem::take(&mut step.lambda),
            );
            let mut work = self.book(&step, &contacts, &touches, &lambda);
            work += self.bring_back(&mut step, particles, clock);
            self.told.contacts = lambda.iter().filter(|&&l| l > 0.0).count() as u64;
            (step.contacts, step.touches, step.lambda) = (contacts, touches, lambda);
            work
        });
        self.told.work += work;
        self.step = Some(step);
        work
    }

    fn rub(&mut self, v: &mut [Vec3], clock: &mut Clock) {
        let Self { bound, sheets, step, .. } = self;
        let Some(step) = step.as_ref().filter(|_| bound.friction.iter().any(Option::is_some)) else { return };
        clock.time("coupling", || {
            let touching = step.contacts.iter().zip(&step.lambda).filter(|(_, l)| **l > 0.0);
            for (contact, &l) in touching {
                let Some(friction) = bound.friction[contact.face as usize] else { continue };
                let face = bound.faces[contact.face as usize].map(|i| i as usize);
                let i = contact.particle as usize;
                let own: Vec3 = (0..3).map(|k| sheets.point(face[k])[1] * contact.weights[k]).sum();
                let slip = v[i] - own;
                let slip = slip - contact.normal * contact.normal.dot(&slip);
                let speed = slip.norm();
                let gives: f32 = (0..3).map(|k| contact.weights[k].powi(2) * sheets.mobility(face[k])).sum();
                let most = speed / (1.0 / bound.mass + gives);
                let impulse = (friction * l / step.dt as f32).min(most);
                if impulse > 0.0 {
                    let rub = slip * (impulse / speed);
                    v[i] -= rub / bound.mass;
                    for (&corner, weight) in face.iter().zip(contact.weights) {
                        sheets.add_velocity(corner, rub * (weight * sheets.mobility(corner)));
                    }
                }
            }
        });
    }
}

impl Together<'_> {
    /// One round over the contacts of the substep. Whether any pushed.
    fn press_all(&mut self, step: &mut Step, particles: &mut Particles<'_>) -> bool {
        let (contacts, touches) = (std::mem::take(&mut step.contacts), std::mem::take(&mut step.touches));
        let on = Contacts { list: &contacts, touches: &touches };
        let found = self.round(step, &on, particles);
        if let Some(lambda) = &found {
            step.lambda.iter_mut().zip(lambda).for_each(|(sum, l)| *sum += l);
        }
        (step.contacts, step.touches) = (contacts, touches);
        found.is_some()
    }
}
