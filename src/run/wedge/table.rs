//! The wedges as a table: CSV for spreadsheets, a page to look at.

use super::{
    faults::{self, Fault},
    list::WedgeList,
};
use crate::{
    cache::{self, CacheError},
    job::{
        Control, FailedFrame, Failure, RunError, ShotFolder, log,
        tradeoff::{csv_line, escaped},
    },
    run::info,
    sim::FrameRecord,
};
use serde_json::Value;
use std::path::{Path, PathBuf};

/// What is known of a wedge.
#[derive(Clone, Debug)]
pub(crate) struct WedgeRow {
    /// Folder of the wedge.
    pub(crate) folder: String,
    /// The values of the keys that differ.
    values: Vec<String>,
    /// Frames that are there, and frames that were requested.
    pub(crate) frames: [u64; 2],
    /// What is wrong with it, if anything is.
    pub(crate) fault: Option<FailedFrame>,
    /// Time of the passes of all frames [s].
    seconds: f64,
    /// Particles of the last frame.
    particles: u64,
    /// Figures of the systems over all frames, by their JSON keys.
    figures: Vec<(String, f64)>,
    /// The figures in words.
    lines: Vec<String>,
}

/// What the folders of a list hold, and what is wrong with each. Of the frames only the headers are read.
///
/// # Errors
/// If a folder is a link that leads out; if cancelled.
pub(crate) fn rows(root: &Path, list: &WedgeList, control: Control) -> Result<Vec<WedgeRow>, RunError> {
    let shots = list.shots(root)?;
    let row = |(place, shot): (usize, &ShotFolder)| match control.cancel.is_cancelled() {
        true => Err(RunError::Interrupted),
        false => Ok(row(shot, list, place)),
    };
    shots.iter().enumerate().map(row).collect()
}

fn row(shot: &ShotFolder, list: &WedgeList, place: usize) -> WedgeRow {
    let wedge = &list.wedges[place];
    let mut row = WedgeRow {
        folder: wedge.folder.clone(),
        values: wedge.values.clone(),
        frames: [0, 0],
        fault: None,
        seconds: 0.0,
        particles: 0,
        figures: Vec::new(),
        lines: Vec::new(),
    };
    let fault = match cache::list(&shot.cache()) {
        Err(CacheError::NotFound { .. }) => Some((Failure::Other, "not simulated".to_owned())),
        Err(why) => Some((Failure::of(&why), why.to_string())),
        // Figures of another shot would be under the wrong values.
        Ok(_) => match faults::of_values(shot, list, wedge) {
            Some(foreign) => Some(foreign),
            None => fill(&mut row, shot).unwrap_or_else(|why| match why {
                RunError::Cache(why) => Some((Failure::of(&why), why.to_string())),
                why => Some((Failure::Other, why.to_string())),
            }),
        },
    };
    row.fault = fault.map(|fault| faults::named(list, place, fault));
    row
}

/// Adds what is known of a shot, and returns the gravest fault of its frames.
fn fill(row: &mut WedgeRow, shot: &ShotFolder) -> Result<Option<Fault>, RunError> {
    let found = info::info(shot)?;
    let sound = found.frames.iter().filter(|frame| frame.fault.is_none());
    row.frames = [sound.count() as u64, found.frames.len() as u64 + found.missing_count];
    row.particles = found.frames.last().map_or(0, |frame| frame.particles);
    row.lines = found.total_lines().collect();
    for total in &found.totals {
        numbers(total.key, &total.value, &mut row.figures);
    }
    let log = log::read::<FrameRecord>(shot)?;
    row.seconds = log.values().flat_map(|line| &line.record.seconds).map(|(_, seconds)| seconds).sum();
    faults::of_frames(shot, &found)
}

/// The numbers in a JSON value by their dotted keys.
fn numbers(key: &str, value: &Value, found: &mut Vec<(String, f64)>) {
    match value {
        Value::Number(number) => found.extend(number.as_f64().map(|number| (key.to_owned(), number))),
        Value::Object(map) => {
            map.iter().for_each(|(name, value)| numbers(&format!("{key}.{name}"), value, found))
        }
        _ => {}
    }
}

impl WedgeRow {
    /// How far it is.
    fn state(&self) -> String {
        if let Some(fault) = &self.fault {
            return fault.why.clone();
        }
        match self.frames {
            [present, all] if present < all => format!("{present} of {all} frames"),
            [all, _] => format!("{all} frames"),
        }
    }
}

/// Writes `wedges.csv` and `wedges.html`, which shows the contact sheet, and returns their paths.
///
/// # Errors
/// If one cannot be written.
pub(crate) fn write(root: &Path, list: &WedgeList, rows: &[WedgeRow]) -> Result<[PathBuf; 2], RunError> {
    let paths = ["csv", "html"].map(|ending| root.join(format!("wedges.{ending}")));
    for (path, text) in paths.iter().zip([csv(list, rows), html(list, rows)]) {
        ShotFolder::write(path.clone(), &text)?;
    }
    Ok(paths)
}

fn csv(list: &WedgeList, rows: &[WedgeRow]) -> String {
    let mut figures: Vec<&String> = Vec::new();
    for (key, _) in rows.iter().flat_map(|row| &row.figures) {
        if !figures.contains(&key) {
            figures.push(key);
        }
    }
    let own = ["frames", "requested_frames", "seconds", "particles", "state"].map(str::to_owned);
    let head: Vec<String> = ["number", "folder"]
        .map(str::to_owned)
        .into_iter()
        .chain(list.keys.iter().cloned())
        .chain(own)
        .chain(figures.iter().map(|key| (*key).clone()))
        .collect();
    let line = |(place, row): (usize, &WedgeRow)| {
        let mut fields = vec![(place + 1).to_string(), row.folder.clone()];
        fields.extend(row.values.iter().cloned());
        fields.extend(row.frames.map(|count| count.to_string()));
        fields.extend([format!("{:.3}", row.seconds), row.particles.to_string(), row.state()]);
        let figure = |key: &&String| {
            let found = row.figures.iter().find(|(other, _)| other == *key);
            found.map_or_else(String::new, |(_, number)| number.to_string())
        };
        fields.extend(figures.iter().map(figure));
        csv_line(&fields)
    };
    csv_line(&head) + &rows.iter().enumerate().map(line).collect::<String>()
}

fn html(list: &WedgeList, rows: &[WedgeRow]) -> String {
    let title = escaped(&list.title);
    let cells = |tag: &str, cells: Vec<String>| -> String {
        let cells: String = cells.iter().map(|cell| format!("<{tag}>{}", escaped(cell))).collect();
        format!("<tr>{cells}</tr>\n")
    };
    let words = |texts: &[&str]| texts.iter().map(|text| (*text).to_owned()).collect::<Vec<_>>();
    let head =
        [words(&["#"]), list.keys.clone(), words(&["state", "seconds", "particles", "figures", "folder"])]
            .concat();
    let row = |(place, row): (usize, &WedgeRow)| {
        let own = vec![
            row.state(),
            format!("{:.1}", row.seconds),
            row.particles.to_string(),
            row.lines.join("\n"),
            row.folder.clone(),
        ];
        cells("td", [vec![(place + 1).to_string()], row.values.clone(), own].concat())
    };
    let body: String = rows.iter().enumerate().map(row).collect();
    format!(
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><title>{title}: wedges</title><style>\
         body{{font:15px/1.5 system-ui,sans-serif;margin:2em;color:#222}}img{{max-width:100%;height:auto}}\
         table{{border-collapse:collapse;margin-top:1em}}td,th{{padding:.2em .8em;text-align:left;vertical-align:top;\
         border-bottom:1px solid #ddd;white-space:pre-line}}</style>\n<h1>{title}</h1>\n\
         <a href=\"contact-sheet.png\"><img src=\"contact-sheet.png\" alt=\"The wedges by their numbers\"></a>\n\
         <table>{}{body}</table></html>\n",
        cells("th", head)
    )
}

#[cfg(test)]
mod tests {
    use super::super::list::Wedge;
    use super::*;
    use crate::{control::CancelToken, job::Silent};

    #[test]
    fn tables_hold_what_the_folders_have_and_quote_it() {
        let dir = tempfile::tempdir().unwrap();
        let wedge = Wedge { folder: "a".into(), values: vec!["[0, 1]".into()] };
        let list = WedgeList::new("<b>Dam</b>", vec!["world.x".into()], vec![wedge]);
        let mut rows = rows(dir.path(), &list, Control::new(&Silent, &CancelToken::new())).unwrap();
        assert_eq!(
            csv(&list, &rows),
            "number,folder,world.x,frames,requested_frames,seconds,particles,state\n1,a,\"[0, 1]\",0,0,0.000,0,not simulated\n"
        );
        assert!(html(&list, &rows).contains("<td>not simulated") && !html(&list, &rows).contains("<b>"));
        rows[0].fault = None;
        let value = serde_json::json!({ "max": 0.5, "in": { "deep": 2 }, "text": "x" });
        numbers("liquid", &value, &mut rows[0].figures);
        rows[0].frames = [3, 5];
        assert!(csv(&list, &rows).contains("particles,state,liquid.max,liquid.in.deep\n"));
        assert!(csv(&list, &rows).ends_with(",3 of 5 frames,0.5,2\n"));
        assert!(html(&list, &rows).contains("3 of 5 frames"));
    }
}
