//! Sheets as streams of a frame, and back.

use super::{NAME, SheetError, Sheets, Shot};
use crate::{frame::Stream, math::Vec3, sim::World};

impl Sheets {
    /// The state: a stream `sheet.NAME` a sheet with `position` [m] and `velocity` [m/s], in the order of its points.
    pub fn streams(&self) -> Vec<Stream> {
        let sheets = self.params.sheet.iter().zip(&self.ranges);
        sheets
            .map(|(sheet, range)| {
                let of =
                    |from: &super::lanes::Vectors| range.clone().map(|i| from.get(i)).collect::<Vec<Vec3>>();
                Stream::new(format!("{NAME}.{}", sheet.name), range.len())
                    .with("position", of(&self.x))
                    .with("velocity", of(&self.v))
            })
            .collect()
    }

    /// Takes the state from the streams of a frame at `time` [s]. What follows has the same bits as in the run that gave it.
    ///
    /// # Errors
    /// If the parameters have no meaning or the frame lacks a part.
    pub fn restore(shot: Shot, world: &World, streams: &[Stream], time: f64) -> Result<Self, SheetError> {
        let mut sheets = Self::new(shot, world)?;
        for (sheet, range) in sheets.params.sheet.iter().zip(&sheets.ranges) {
            let name = format!("{NAME}.{}", sheet.name);
            let missing = |what| SheetError::Missing { stream: name.clone(), what, count: range.len() };
            let stream = streams.iter().find(|stream| stream.name == name).ok_or(missing("points"))?;
            for (what, to) in [("position", &mut sheets.x), ("velocity", &mut sheets.v)] {
                let values = stream.vec3(what).filter(|v| v.len() == range.len()).ok_or(missing(what))?;
                range.clone().zip(values).for_each(|(i, v)| to.set(i, *v));
            }
        }
        sheets.settle(time);
        Ok(sheets)
    }
}
