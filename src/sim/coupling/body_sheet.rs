//! Two-way contact of rigid bodies with sheets: both share their substeps.
//!
//! *Method*: both take a substep without contact, then their common step is solved (`sheet/body_contacts`), with the contacts of bodies with
//! colliders and each other after each solve. Where a liquid drives the substeps (`liquid_sheet.rs`), a solve follows each correction of it.
//! Limits: first order in time.

use super::{BODY_PASSES, BodySheetRecord};
use crate::{
    control::Stop,
    sim::{
        Watch,
        clock::{Clock, Seconds},
        liquid::CoupledBodies,
        rigid::{BodyRecord, RigidBodies},
        sheet::{BodyContacts, CoupledSubstep, MAX_SOLVES, SheetRecord, Sheets},
        substep::advance_frame,
    },
    solid::{BodySurface, Pose, RigidBody},
};
use nalgebra::Vector3;

/// What a frame of both sides did.
pub(in crate::sim) struct BodySheetFrame {
    pub(in crate::sim) sheets: SheetRecord,
    pub(in crate::sim) bodies: BodyRecord,
    pub(in crate::sim) contact: BodySheetRecord,
    pub(in crate::sim) seconds: Seconds,
}

/// Contact of sheets with bodies in a substep.
#[derive(Debug)]
pub(super) struct BodySheetStep {
    found: BodyContacts,
    /// Linear and angular momenta of the bodies before.
    momenta: Vec<[Vector3<f64>; 2]>,
    dt: f64,
    /// Solves that reached their limit of iterations.
    unconverged: u64,
}

impl BodySheetStep {
    /// Finds the contacts of a substep that both sides have taken without contact. The solution of the `last` one is the first guess.
    pub(super) fn new(
        sheets: &Sheets,
        substep: &CoupledSubstep,
        bodies: &dyn CoupledBodies,
        momenta: Vec<[Vector3<f64>; 2]>,
        last: Option<Self>,
    ) -> Self {
        let (surfaces, states) = bodies.surfaces();
        let mut found = sheets.find_body_contacts(substep, (&surfaces, states));
        if let Some(last) = last {
            found.warm_start(last.found, last.dt, substep.dt());
        }
        Self { found, momenta, dt: substep.dt(), unconverged: 0 }
    }

    /// Solves once. Returns whether another solve would change anything.
    pub(super) fn solve(
        &mut self,
        sheets: &mut Sheets,
        substep: &mut CoupledSubstep,
        bodies: &mut dyn CoupledBodies,
    ) -> bool {
        let others = std::mem::take(&mut substep.unconverged);
        let is_changing = sheets.solve_body_contacts(substep, &mut self.found, bodies.bodies_mut());
        self.unconverged += std::mem::replace(&mut substep.unconverged, others);
        is_changing
    }

    /// Solves until nothing changes, with the contacts of bodies with colliders and each other.
    pub(super) fn solve_all(
        &mut self,
        sheets: &mut Sheets,
        substep: &mut CoupledSubstep,
        bodies: &mut dyn CoupledBodies,
    ) {
        for _ in 0..MAX_SOLVES {
            let is_changing = self.solve(sheets, substep, bodies);
            bodies.resolve_contacts();
            if !is_changing {
                break;
            }
        }
    }

    /// Whether there are impulses.
    pub(super) fn is_pushing(&self) -> bool {
        self.found.is_pushing()
    }

    /// Energies of the bodies that sheets push, as [`Sheets::account_energy`] takes them.
    pub(super) fn energies(&self, bodies: &dyn CoupledBodies) -> Option<[f64; 2]> {
        self.found.energies(bodies.bodies(), &self.momenta)
    }

    /// Moves points that are still inside bodies out of them, at the end of the substep, and counts.
    pub(super) fn end(
        &self,
        sheets: &mut Sheets,
        substep: &CoupledSubstep,
        bodies: &dyn CoupledBodies,
        record: &mut BodySheetRecord,
    ) {
        let (surfaces, states) = bodies.surfaces();
        let depth = sheets.leave_bodies(&self.found, (&surfaces, states), substep.end());
        record.contacts = record.contacts.max(self.found.touching());
        record.unconverged += self.unconverged;
        record.penetration = record.penetration.max(f64::from(depth));
    }
}

/// Advances sheets and bodies by a frame; `start` and `seconds` are its time and length [s].
///
/// # Errors
/// [`Stop`].
pub(in crate::sim) fn advance_bodies_and_sheets(
    sheets: &mut Sheets,
    bodies: &mut RigidBodies,
    [start, seconds]: [f64; 2],
    watch: &mut dyn Watch,
) -> Result<BodySheetFrame, Stop> {
    let mut clock = Clock::new(&[sheets.passes(), BODY_PASSES.to_vec()].concat());
    let mut record = sheets.begin_frame();
    let mut contact = BodySheetRecord::default();
    // A frame stores the whole state: its first substep starts from nothing.
    let mut last = None;
    advance_frame([start, seconds], watch, |progress, _| {
        let (now, left) = (progress.now(), progress.left);
        // The bodies may need more than `sheets.solver.max_substeps`.
        let own = sheets.substeps_left(now, left, seconds, 0)?;
        let count = bodies.substeps_left([now, left], (sheets.max_speed(), own));
        let dt = left / f64::from(count);
        let momenta: Vec<_> = bodies.bodies().iter().map(RigidBody::momenta).collect();
        clock.time(BODY_PASSES[0], || bodies.start_substep(now, dt));
        let mut substep = sheets.begin_coupled_substep(now, dt, &mut clock, &mut record)?;
        let step = clock.time(BODY_PASSES[1], || {
            let mut step = BodySheetStep::new(sheets, &substep, bodies, momenta, last.take());
            step.solve_all(sheets, &mut substep, bodies);
            step
        });
        if step.is_pushing() {
            sheets.end_coupled_substep(&mut substep, &mut clock, &mut record);
        }
        clock.time("sheet_account", || {
            sheets.account_energy(&substep, step.energies(bodies), &mut record);
        });
        clock.time(BODY_PASSES[0], || bodies.end_substep());
        clock.time(BODY_PASSES[1], || step.end(sheets, &substep, bodies, &mut contact));
        last = Some(step);
        Ok(dt)
    })?;
    let end = start + seconds;
    let (body_record, placed) = clock.time(BODY_PASSES[0], || {
        let record = bodies.end_frame(end)?;
        let (surfaces, states) = bodies.surfaces();
        let poses = states.iter().map(|body| body.pose());
        Ok::<_, Stop>((record, surfaces.into_iter().zip(poses).collect::<Vec<(BodySurface<'_>, Pose)>>()))
    })?;
    clock.time("sheet_account", || sheets.end_frame(end, &placed, &mut record));
    Ok(BodySheetFrame { sheets: record, bodies: body_record, contact, seconds: clock.into_totals() })
}
