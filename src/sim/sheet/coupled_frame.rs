//! Frames of sheets whose substeps another system drives.

use super::{SheetRecord, Sheets};
use crate::{
    math::Vec3,
    par,
    sim::{Diverged, clock::Clock},
    solid::{BodySurface, Pose},
};

impl Sheets {
    /// Begins a frame.
    pub(in crate::sim) fn begin_frame(&mut self) -> SheetRecord {
        // A frame stores the whole state: rounding errors do not continue into the next.
        self.low.clear();
        let mut record = SheetRecord { points: self.len() as u64, ..SheetRecord::default() };
        self.begin_contact(&mut record);
        record
    }

    /// Number of equal substeps that the sheets need for the rest of a frame of `seconds`: `left` [s], from
    /// `now` [s] on.
    ///
    /// # Errors
    /// If, with `done` substeps, they exceed the limit.
    pub(in crate::sim) fn substeps_left(
        &mut self,
        now: f64,
        left: f64,
        seconds: f64,
        done: u32,
    ) -> Result<u32, Diverged> {
        self.update_holds(now);
        // The time of a frame's first search counts for no pass.
        let mut clock = Clock::new(&self.passes());
        let contact = self.contact.is_some().then(Default::default);
        let mut record = SheetRecord { substeps: done, contact, ..SheetRecord::default() };
        Ok((left / self.next_substep(now, left, seconds, &mut clock, &mut record)?).round() as u32)
    }

    /// The speed of the fastest point [m/s].
    pub(in crate::sim) fn max_speed(&self) -> f64 {
        par::max(self.len(), |i| self.v.get(i).norm_squared())
            .map_or(0.0, |(_, square)| f64::from(square).sqrt())
    }

    /// Updates which points are held at `now` [s].
    pub(in crate::sim) fn update_pins_and_joints(&mut self, now: f64) {
        self.update_holds(now);
    }

    /// Advances by a substep from `now` [s] of `dt` [s].
    ///
    /// # Errors
    /// If a point diverges.
    pub(in crate::sim) fn advance_substep(
        &mut self,
        now: f64,
        dt: f64,
        clock: &mut Clock,
        record: &mut SheetRecord,
    ) -> Result<(), Diverged> {
        record.substeps += 1;
        self.substep(now, dt, clock, record)?.count(record);
        Ok(())
    }

    /// The names of the sheets, in their order.
    pub(in crate::sim) fn names(&self) -> Vec<&str> {
        self.params.sheet.iter().map(|sheet| sheet.name.as_str()).collect()
    }

    /// Completes the record of the frame that ends at `time` [s] with rigid bodies there.
    pub(in crate::sim) fn end_frame(
        &mut self,
        time: f64,
        bodies: &[(BodySurface<'_>, Pose)],
        record: &mut SheetRecord,
    ) {
        self.end_contact(&mut Clock::new(&self.passes()), record);
        self.complete_record(time, bodies, record);
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

    /// Changes a velocity [m/s].
    pub(in crate::sim) fn add_velocity(&mut self, i: usize, change: Vec3) {
        self.v.add(i, change);
    }
}
