//! Two-way contact of rigid bodies with sheets: both share their substeps.
//!
//! *Method*: both take a substep without contact, then their common step is solved (`sheet/body_contacts`), with the contacts of bodies with
//! colliders and each other after each solve.
//! Limits: first order in time.

use super::{BODY_PASSES, BodySheetRecord};
use crate::{
    control::Stop,
    sim::{
        Watch,
        clock::{Clock, Seconds},
        liquid::CoupledBodies,
        rigid::{BodyRecord, RigidBodies},
        sheet::{MAX_SOLVES, SheetRecord, Sheets},
        substep::advance_frame,
    },
    solid::{BodySurface, Pose, RigidBody},
};

/// What a frame of both sides did.
pub(in crate::sim) struct BodySheetFrame {
    pub(in crate::sim) sheets: SheetRecord,
    pub(in crate::sim) bodies: BodyRecord,
    pub(in crate::sim) contact: BodySheetRecord,
    pub(in crate::sim) seconds: Seconds,
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
        let mut found = clock.time(BODY_PASSES[1], || {
            let (surfaces, states) = bodies.surfaces();
            sheets.find_body_contacts(&substep, (&surfaces, states))
        });
        if let Some((contacts, before)) = last.take() {
            found.warm_start(contacts, before, dt);
        }
        clock.time(BODY_PASSES[1], || {
            for _ in 0..MAX_SOLVES {
                let is_changing = sheets.solve_body_contacts(&mut substep, &mut found, bodies.bodies_mut());
                bodies.resolve_contacts();
                if !is_changing {
                    break;
                }
            }
        });
        if found.is_pushing() {
            sheets.end_coupled_substep(&mut substep, &mut clock, &mut record);
        }
        clock.time("sheet_account", || {
            sheets.account_energy(&substep, found.energies(bodies.bodies(), &momenta), &mut record);
        });
        clock.time(BODY_PASSES[0], || bodies.end_substep());
        let depth = clock.time(BODY_PASSES[1], || {
            let (surfaces, states) = bodies.surfaces();
            sheets.leave_bodies(&found, (&surfaces, states), now + dt)
        });
        contact.contacts = contact.contacts.max(found.touching());
        contact.unconverged += substep.unconverged;
        contact.penetration = contact.penetration.max(f64::from(depth));
        last = Some((found, dt));
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
