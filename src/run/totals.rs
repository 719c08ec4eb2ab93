//! What a shot's log tells of its sheets and of what is coupled to them, over all frames.

use super::{RunError, ShotFolder};
use crate::frame::FrameIndex;
use serde::{Deserialize, Serialize};
use std::{collections::BTreeMap, io::ErrorKind};

/// Sums and extremes over the logged frames of a shot; what it has not got is absent.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Totals {
    /// Of its sheets.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sheets: Option<SheetTotals>,
    /// Between liquid and sheets.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub liquid_on_sheets: Option<LiquidTotals>,
    /// Between smoke and sheets.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub smoke_on_sheets: Option<SmokeTotals>,
}

/// Over the frames of sheets.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct SheetTotals {
    /// Frames that the log tells of; a shot's first has no line.
    pub frames: u32,
    /// Largest strain of a spring at the end of any, in parts of its rest length.
    pub strain_max: f64,
    /// Most points within a solid at the end of any.
    pub inside_solids: u64,
    /// Most faces cut into solids at the end of any; absent if no line tells: those of older logs do not.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cut_faces: Option<u64>,
}

/// Over the frames of a liquid with sheets.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct LiquidTotals {
    /// Frames that the log tells of.
    pub frames: u32,
    /// Particles that got to the other side of a sheet, through a face.
    pub crossed: u64,
    /// Particles that were put back to their side alone.
    pub put_back: u64,
    /// Rounds of contact that ended by their number.
    pub unfinished: u64,
}

/// Over the frames of smoke with sheets.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct SmokeTotals {
    /// Frames that the log tells of.
    pub frames: u32,
    /// The fastest air at a face [m/s].
    pub fastest: f64,
    /// Times a face's drag was cut.
    pub cut: u64,
}

/// The part of a line that is summed.
#[derive(Deserialize)]
struct Line {
    frame: FrameIndex,
    sheets: Option<Sheets>,
    coupling: Option<Coupling>,
}

#[derive(Deserialize)]
struct Sheets {
    strain_max: f64,
    inside_solids: u64,
    cut_faces: Option<u64>,
}

#[derive(Deserialize)]
struct Coupling {
    liquid: Option<OnLiquid>,
    smoke: Option<OnSmoke>,
}

#[derive(Deserialize)]
struct OnLiquid {
    crossed: u64,
    put_back: u64,
    unfinished: u64,
}

#[derive(Deserialize)]
struct OnSmoke {
    fastest: f64,
    cut: u64,
}

/// What the log tells of the frames that `there` names, by the last line about each; nothing if there is no log. A line that a crash cut
/// short is passed over, and its frame not counted.
pub(super) fn read(folder: &ShotFolder, there: impl Fn(FrameIndex) -> bool) -> Result<Totals, RunError> {
    let text = match std::fs::read_to_string(folder.log()) {
        Err(absent) if absent.kind() == ErrorKind::NotFound => return Ok(Totals::default()),
        read => read.map_err(|source| RunError::File {
            path: folder.log(),
            source,
            next: "check that the folder can be read",
        })?,
    };
    Ok(of(&text, there))
}

fn of(text: &str, there: impl Fn(FrameIndex) -> bool) -> Totals {
    let lines = text.lines().filter_map(|line| serde_json::from_str::<Line>(line).ok());
    let last: BTreeMap<FrameIndex, Line> =
        lines.filter(|line| there(line.frame)).map(|line| (line.frame, line)).collect();
    let mut sums = Totals::default();
    for Line { sheets, coupling, .. } in last.into_values() {
        if let Some(Sheets { strain_max, inside_solids, cut_faces }) = sheets {
            let sum = sums.sheets.get_or_insert_default();
            sum.frames += 1;
            sum.strain_max = sum.strain_max.max(strain_max);
            sum.inside_solids = sum.inside_solids.max(inside_solids);
            sum.cut_faces = sum.cut_faces.max(cut_faces);
        }
        let Some(Coupling { liquid, smoke }) = coupling else { continue };
        if let Some(OnLiquid { crossed, put_back, unfinished }) = liquid {
            let sum = sums.liquid_on_sheets.get_or_insert_default();
            sum.frames += 1;
            sum.crossed += crossed;
            sum.put_back += put_back;
            sum.unfinished += unfinished;
        }
        if let Some(OnSmoke { fastest, cut }) = smoke {
            let sum = sums.smoke_on_sheets.get_or_insert_default();
            sum.frames += 1;
            sum.fastest = sum.fastest.max(fastest);
            sum.cut += cut;
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_line_about_each_frame_that_is_there_counts() {
        let line = |frame: u32, strain: f64, crossed: u64, cut: u64| {
            format!(
                "{{\"frame\":{frame},\"sheets\":{{\"strain_max\":{strain},\"inside_solids\":{frame},\"cut_faces\":{crossed}}},\"coupling\":{{\
                 \"liquid\":{{\"crossed\":{crossed},\"put_back\":2,\"unfinished\":3}},\
                 \"smoke\":{{\"fastest\":{strain},\"cut\":{cut}}}}}}}\n"
            )
        };
        let text = line(2, 9.0, 90, 0) + &line(3, 0.5, 4, 1) + &line(2, 0.25, 1, 10) + &line(7, 8.0, 800, 0);
        let cut_short = text + "{\"frame\":4,\"shee";
        let found = of(&cut_short, |frame| frame.0 < 7);
        let sheets = SheetTotals { frames: 2, strain_max: 0.5, inside_solids: 3, cut_faces: Some(4) };
        let liquid = LiquidTotals { frames: 2, crossed: 5, put_back: 4, unfinished: 6 };
        let smoke = SmokeTotals { frames: 2, fastest: 0.5, cut: 11 };
        let all =
            Totals { sheets: Some(sheets), liquid_on_sheets: Some(liquid), smoke_on_sheets: Some(smoke) };
        assert_eq!(found, all);
        let older = of(&line(2, 0.5, 1, 0).replace(",\"cut_faces\":1", ""), |_| true);
        assert_eq!(
            older.sheets,
            Some(SheetTotals { frames: 1, strain_max: 0.5, inside_solids: 2, cut_faces: None })
        );
        assert_eq!(of("{\"frame\":2,\"substeps\":8}\n", |_| true), Totals::default(), "a liquid alone");
    }
}
