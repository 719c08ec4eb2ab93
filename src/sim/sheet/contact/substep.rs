//! Contact within the time step of sheets.

use super::IntegratedStep;
use crate::sim::{
    clock::Clock,
    sheet::{ContactRecord, SheetRecord, Sheets, solids},
};

impl Sheets {
    /// Number of edges that go through faces of sheets now; 0 without `[sheets.contact]`, when nothing is
    /// tested.
    pub fn crossings(&self) -> u64 {
        self.contact.as_ref().map_or(0, |contact| contact.crossings(&self.x))
    }

    /// Begins the contact of a frame.
    pub(in crate::sim::sheet) fn begin_contact(&mut self, record: &mut SheetRecord) {
        if let Some(contact) = &mut self.contact {
            contact.begin_frame(&self.x);
            record.contact = Some(ContactRecord::default());
        }
    }

    /// The longest substep that contact allows [s], and a point that limits it. `substep` is its length
    /// without contact, `left` the rest of the frame.
    pub(in crate::sim::sheet) fn max_contact_substep(
        &mut self,
        now: f64,
        [substep, left]: [f64; 2],
        clock: &mut Clock,
        record: &mut SheetRecord,
    ) -> (f64, usize) {
        let Self { contact, x, v, .. } = self;
        let (Some(contact), Some(record)) = (contact, &mut record.contact) else {
            return (f64::INFINITY, 0);
        };
        clock.time("sheet_search", || contact.max_substep(x, v, now, [substep, left], record))
    }

    /// Detects and resolves contacts of the substep from `now` [s]. Returns whether it moved any point.
    pub(in crate::sim::sheet) fn resolve_contact(
        &mut self,
        now: f64,
        dt: f64,
        clock: &mut Clock,
        record: &mut SheetRecord,
    ) -> bool {
        let Self { contact, x, v, inverse, solids, params, .. } = self;
        let (Some(contact), Some(record)) = (contact, &mut record.contact) else { return false };
        let placed = solids::place_solids(solids, params.common.solid_clearance(), now, now + dt);
        let friction = f64::from(params.common.friction.unwrap_or(0.0));
        let mobility = inverse.as_flattened();
        let mut step = IntegratedStep { x, v, mobility, solids: &placed, friction, now, dt };
        clock.time("sheet_search", || contact.update_candidates(&step, record));
        clock.time("sheet_contact", || contact.resolve(&mut step, record))
    }

    /// Sets which points joints hold together at a time [s].
    pub(in crate::sim::sheet) fn set_contact_seams(&mut self, time: f64) {
        if let Some(contact) = &mut self.contact {
            let held = self.joints.iter().filter(|joint| joint.direction.is_none() && joint.holds(time));
            contact.set_seams(&held.map(|joint| joint.ends).collect::<Vec<[u32; 2]>>());
        }
    }

    /// Ends the contact of a frame.
    pub(in crate::sim::sheet) fn end_contact(&mut self, clock: &mut Clock, record: &mut SheetRecord) {
        let Self { contact, x, .. } = self;
        if let (Some(contact), Some(record)) = (contact, &mut record.contact) {
            clock.time("sheet_search", || contact.end_frame(x, record));
        }
    }
}
