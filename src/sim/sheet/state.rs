//! State of sheets as streams of a frame, and back.

use super::{NAME, SheetError, Sheets, Shot};
use crate::{
    frame::{Stream, StreamKind},
    math::Vec3,
    sim::World,
};

/// Channels of the corners of faces.
pub(crate) const CORNER_CHANNELS: [&str; 4] = ["a", "b", "c", "d"];

/// The name of a sheet's stream.
pub fn stream(sheet: &str) -> String {
    format!("{NAME}.{sheet}")
}

/// The name of the stream with the faces of the sheet whose points are in the stream `points`.
pub(crate) fn faces_stream(points: &str) -> String {
    format!("{points}.faces")
}

/// The name of the sheet whose points are in the stream of this name; `None` if they are not a sheet's.
pub(crate) fn sheet_of(stream: &str) -> Option<&str> {
    stream.strip_prefix(NAME)?.strip_prefix('.').filter(|name| !name.contains('.'))
}

impl Sheets {
    /// The state as streams. Each sheet has a stream `sheet.NAME` with `position` [m] and `velocity` [m/s] in
    /// the order of its points; its `spacing` [m] is the edge of the square of the mean area of a point. A
    /// stream `sheet.NAME.faces` has the corners `a`, `b`, `c` and `d` of its faces; triangles repeat the
    /// last.
    pub fn streams(&self) -> Vec<Stream> {
        let sheets = self.params.sheet.iter().zip(&self.ranges).zip(&self.faces);
        sheets
            .flat_map(|((sheet, range), faces)| {
                let of = |from: &super::vectors::Vectors| {
                    range.clone().map(|i| from.get(i)).collect::<Vec<Vec3>>()
                };
                let area: f64 = range.clone().map(|i| f64::from(self.area[i])).sum();
                let name = stream(&sheet.name);
                let mut points = Stream::new(&name, StreamKind::MeshPoints, range.len())
                    .with("position", of(&self.x))
                    .with("velocity", of(&self.v));
                points.scalars = vec![("spacing".into(), (area / range.len() as f64).sqrt())];
                let corners = faces_stream(&name);
                let corner = |k: usize| faces.iter().map(|face| face[k]).collect::<Vec<u32>>();
                let corners = (0..4)
                    .zip(CORNER_CHANNELS)
                    .fold(Stream::new(corners, StreamKind::MeshFaces, faces.len()), |stream, (k, name)| {
                        stream.with(name, corner(k))
                    });
                [points, corners]
            })
            .collect()
    }

    /// Restores the state from the streams of a frame at `time` [s]. What follows has the same bits as in the
    /// run that wrote it.
    ///
    /// # Errors
    /// If parameters are out of range or the frame lacks a stream.
    pub fn restore(shot: Shot, world: &World, streams: &[Stream], time: f64) -> Result<Self, SheetError> {
        let mut sheets = Self::new(shot, world)?;
        for (sheet, range) in sheets.params.sheet.iter().zip(&sheets.ranges) {
            let name = stream(&sheet.name);
            let missing = |what| SheetError::Missing { stream: name.clone(), what, count: range.len() };
            let stream = streams.iter().find(|stream| stream.name == name).ok_or(missing("points"))?;
            for (what, to) in [("position", &mut sheets.x), ("velocity", &mut sheets.v)] {
                let values = stream.vec3(what).filter(|v| v.len() == range.len()).ok_or(missing(what))?;
                range.clone().zip(values).for_each(|(i, v)| to.set(i, *v));
            }
        }
        if let Some(contact) = &mut sheets.contact {
            contact.forget_tangles();
        }
        sheets.update_holds(time);
        Ok(sheets)
    }
}
