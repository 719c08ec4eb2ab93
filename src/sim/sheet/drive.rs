//! Sheets whose substeps are driven from outside, together with those of another system.

use super::{SheetRecord, Sheets};
use crate::{
    math::Vec3,
    par,
    sim::{Diverged, record::Clock},
};

impl Sheets {
    /// Begins a frame.
    pub(in crate::sim) fn begin(&mut self) -> SheetRecord {
        // A frame holds the whole state: what rounding took is not carried over.
        self.low.clear();
        let mut record = SheetRecord { points: self.len() as u64, ..SheetRecord::default() };
        self.begin_contact(&mut record);
        record
    }

    /// How many equal substeps the sheets ask for in the rest of a frame of `seconds`: `left` [s], from `now` [s] on.
    ///
    /// # Errors
    /// If they are more than are allowed, `done` counted.
    pub(in crate::sim) fn substeps_left(
        &mut self,
        now: f64,
        left: f64,
        seconds: f64,
        done: u32,
    ) -> Result<u32, Diverged> {
        self.settle(now);
        // The search of a frame's first list is nobody's.
        let mut clock = Clock::new(&self.passes());
        let contact = self.contact.is_some().then(Default::default);
        let mut record = SheetRecord { substeps: done, contact, ..SheetRecord::default() };
        Ok((left / self.substep_length(now, left, seconds, &mut clock, &mut record)?).round() as u32)
    }

    /// The speed of the fastest point [m/s].
    pub(in crate::sim) fn fastest(&self) -> f64 {
        par::max(self.len(), |i| self.v.get(i).norm_squared())
            .map_or(0.0, |(_, square)| f64::from(square).sqrt())
    }

    /// Holds the points that are held at `now` [s].
    pub(in crate::sim) fn hold_still(&mut self, now: f64) {
        self.settle(now);
    }

    /// A substep from `now` [s] of `dt` [s].
    ///
    /// # Errors
    /// If a point leaves what can be computed.
    pub(in crate::sim) fn go(
        &mut self,
        now: f64,
        dt: f64,
        clock: &mut Clock,
        record: &mut SheetRecord,
    ) -> Result<(), Diverged> {
        record.substeps += 1;
        self.substep(now, dt, clock, record)
    }

    /// The names of the sheets, by number.
    pub(in crate::sim) fn names(&self) -> Vec<&str> {
        self.params.sheet.iter().map(|sheet| sheet.name.as_str()).collect()
    }

    /// What the record tells of the end of a frame, at `time` [s].
    pub(in crate::sim) fn end(&mut self, time: f64, record: &mut SheetRecord) {
        self.end_contact(&mut Clock::new(&self.passes()), record);
        self.account(time, record);
    }

    /// The faces of a sheet as triangles of points of all sheets; quads are cut from their first corner.
    pub(in crate::sim) fn triangles(&self, sheet: usize) -> Vec<[u32; 3]> {
        let start = self.ranges[sheet].start as u32;
        let cut = |&[a, b, c, d]: &[u32; 4]| {
            let second = (c != d).then_some([a, c, d]);
            [Some([a, b, c]), second].into_iter().flatten()
        };
        self.faces[sheet].iter().flat_map(cut).map(|face| face.map(|i| i + start)).collect()
    }

    /// Position and velocity of a point [m], [m/s].
    pub(in crate::sim) fn point(&self, i: usize) -> [Vec3; 2] {
        [self.x.get(i), self.v.get(i)]
    }

    /// 1/mass of a point [1/kg]; zero where it is held exactly.
    pub(in crate::sim) fn mobility(&self, i: usize) -> f32 {
        self.inverse.as_flattened()[i]
    }

    /// Adds to a velocity [m/s].
    pub(in crate::sim) fn kick(&mut self, i: usize, change: Vec3) {
        self.v.add(i, change);
    }
}
