//! What sheets do about contact within a substep.

use super::Moved;
use crate::sim::{
    record::Clock,
    sheet::{ContactRecord, SheetRecord, Sheets, solids},
};

impl Sheets {
    /// Edges that go through faces of sheets now; 0 without `[sheets.contact]`, where nobody looks.
    pub fn crossings(&self) -> u64 {
        self.contact.as_ref().map_or(0, |contact| contact.crossings(&self.x))
    }

    /// Begins a frame.
    pub(in crate::sim::sheet) fn begin_contact(&mut self, record: &mut SheetRecord) {
        if let Some(contact) = &mut self.contact {
            contact.begin(&self.x);
            record.contact = Some(ContactRecord::default());
        }
    }

    /// The longest substep that contact allows, of what is left of a frame [s], and a point that asks for it. `substep` is what it would be otherwise.
    pub(in crate::sim::sheet) fn contact_step(
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
        clock.time("sheet_search", || contact.longest(x, v, now, [substep, left], record))
    }

    /// Keeps apart what met in the substep from `now` [s] that was just made. Returns whether anything was moved.
    pub(in crate::sim::sheet) fn meet(
        &mut self,
        now: f64,
        dt: f64,
        clock: &mut Clock,
        record: &mut SheetRecord,
    ) -> bool {
        let Self { contact, x, v, inverse, solids, params, .. } = self;
        let (Some(contact), Some(record)) = (contact, &mut record.contact) else { return false };
        let placed = solids::placed(solids, params.common.off(), now, now + dt);
        let friction = f64::from(params.common.friction.unwrap_or(0.0));
        let mobility = inverse.as_flattened();
        let mut moved = Moved { x, v, mobility, solids: &placed, friction, now, dt };
        clock.time("sheet_search", || contact.look(&moved, record));
        clock.time("sheet_contact", || contact.resolve(&mut moved, record))
    }

    /// Tells contact which points joints draw together at a time [s].
    pub(in crate::sim::sheet) fn join_contact(&mut self, time: f64) {
        if let Some(contact) = &mut self.contact {
            let drawn = self.joined.iter().filter(|joint| joint.direction.is_none() && joint.holds(time));
            contact.join(&drawn.map(|joint| joint.ends).collect::<Vec<[u32; 2]>>());
        }
    }

    /// Ends a frame.
    pub(in crate::sim::sheet) fn end_contact(&mut self, clock: &mut Clock, record: &mut SheetRecord) {
        let Self { contact, x, .. } = self;
        if let (Some(contact), Some(record)) = (contact, &mut record.contact) {
            clock.time("sheet_search", || contact.end(x, record));
        }
    }
}
