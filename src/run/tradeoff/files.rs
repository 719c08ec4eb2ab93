//! The table as files: CSV for spreadsheets, SVG for documents, HTML to look at.

use super::{Line, Table, plot};
use crate::run::{RunError, ShotFolder};
use std::{
    fmt::Write as _,
    path::{Path, PathBuf},
};

/// Writes `tradeoff.csv`, `tradeoff.svg` and `tradeoff.html` into `folder` and returns their paths.
///
/// # Errors
/// If one cannot be written.
pub fn write(table: &Table, folder: &Path) -> Result<[PathBuf; 3], RunError> {
    let paths = ["csv", "svg", "html"].map(|ending| folder.join(format!("tradeoff.{ending}")));
    let texts = [csv(table), plot::svg(table), plot::html(table)];
    for (path, text) in paths.iter().zip(texts) {
        ShotFolder::write(path.clone(), &text)?;
    }
    Ok(paths)
}

/// Every line, the reference and its refinement; SI units, deviations as fractions, empty where there is no value.
fn csv(table: &Table) -> String {
    let mut out = String::from(
        "setting,seconds_median,seconds_min,seconds_max,cpu_seconds,shot_seconds,particles,substeps_a_frame,\
         iterations_a_frame,unconverged_substeps,density_dev_avg,density_dev_max_mean,density_dev_largest,\
         volume_change,energy_apart,observable_apart,position_apart,on_front,knee,diverged\n",
    );
    let maybe = |value: Option<f64>| value.map_or_else(String::new, |value| value.to_string());
    let mut put = |line: &Line, knee: bool| {
        let fields = [
            quoted(&line.label),
            line.seconds.median.to_string(),
            line.seconds.min.to_string(),
            line.seconds.max.to_string(),
            maybe(line.cpu_seconds.map(|spread| spread.median)),
            line.shot_seconds.to_string(),
            line.particles.to_string(),
            line.substeps.to_string(),
            line.iterations.to_string(),
            line.unconverged.to_string(),
            line.density_dev_avg.to_string(),
            line.density_dev_max.to_string(),
            line.density_dev_largest.to_string(),
            maybe(line.volume_change),
            maybe(line.apart.energy),
            maybe(line.apart.observable),
            maybe(line.apart.position),
            line.front.to_string(),
            knee.to_string(),
            quoted(line.diverged.as_deref().unwrap_or("")),
        ];
        let _ = writeln!(out, "{}", fields.join(","));
    };
    for (place, line) in table.lines.iter().enumerate() {
        put(line, table.knee == Some(place));
    }
    put(&table.reference, false);
    // The refinement's distance from the reference is what the reference's own errors are judged by.
    put(&Line { apart: table.uncertainty, ..table.refined.clone() }, false);
    out
}

/// A text as one field.
fn quoted(text: &str) -> String {
    if text.contains([',', '"', '\n']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text.into() }
}
