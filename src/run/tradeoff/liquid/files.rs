//! The table of a liquid as files.

use super::{By, Line, Table};
use crate::run::{
    RunError,
    tradeoff::{
        page::{Page, full, introduction, maybe, rows},
        plot::{Entry, Panel, escaped, figure, percent},
    },
};
use std::path::{Path, PathBuf};

/// Writes `tradeoff.csv`, `tradeoff.svg` and `tradeoff.html` into `folder` and returns their paths.
///
/// # Errors
/// If one cannot be written.
pub fn write(table: &Table, folder: &Path) -> Result<[PathBuf; 3], RunError> {
    page(table).write(folder)
}

fn page(table: &Table) -> Page<'_> {
    let unit = table.observable.unit();
    let observable = table.observable.name();
    let uncertainty = [
        table.uncertainty.energy.map(|e| format!("energy {}", percent(e))),
        table.uncertainty.observable.map(|o| format!("{observable} {} {unit}", figure(o))),
        table.uncertainty.position.map(|p| format!("positions {} m", figure(p))),
    ];
    let uncertainty = uncertainty.into_iter().flatten().collect::<Vec<_>>().join(", ");
    let head =
        ["#", "setting", "seconds", "whole shot", "density, mean", "density, largest", "volume", "energy"];
    Page {
        title: &table.title,
        introduction: introduction(
            &format!("Frames {}, {} threads", table.frames, table.threads),
            &uncertainty,
        ),
        panels: panels(table),
        head: head.into_iter().chain([observable, "positions", ""]).map(String::from).collect(),
        rows: rows(
            &table.lines,
            &table.reference,
            table.knee,
            |line| line.front,
            |number, line, mark| cells(number, line, mark, table),
        ),
        legend: escaped(&format!(
            "Density: how far from incompressible, mean of the frames and largest of all particles. Volume: of the \
             surface, last frame against first. Energy, {observable} and positions: RMS distance from the reference."
        )),
        csv: csv(table),
    }
}

fn cells(number: &str, line: &Line, mark: &str, table: &Table) -> Vec<String> {
    let maybe = |value: Option<f64>, say: &dyn Fn(f64) -> String| value.map_or_else(|| "–".into(), say);
    let unit = table.observable.unit();
    vec![
        number.into(),
        line.label.clone(),
        format!("{:.1}", line.seconds.median),
        format!("{:.0} s", line.shot_seconds),
        percent(line.density_dev_avg),
        percent(line.density_dev_largest),
        maybe(line.volume_change, &|v| format!("{:+.1} %", 100.0 * v)),
        maybe(line.apart.energy, &percent),
        maybe(line.apart.observable, &|o| format!("{} {unit}", figure(o))),
        maybe(line.apart.position, &|p| format!("{} m", figure(p))),
        line.diverged.as_ref().map_or_else(|| mark.into(), |why| format!("diverged, {why}")),
    ]
}

fn panels(table: &Table) -> Vec<Panel> {
    let made = By::ALL.map(|by| {
        let title = match by {
            By::Density => "density deviation, mean [%]".to_owned(),
            By::Energy => "energy, from the reference [%]".to_owned(),
            By::Observable => {
                format!("{}, from the reference [{}]", table.observable.name(), table.observable.unit())
            }
        };
        let blind = match by {
            By::Density => 0.0,
            By::Energy => 100.0 * table.uncertainty.energy.unwrap_or(0.0),
            By::Observable => table.uncertainty.observable.unwrap_or(0.0),
        };
        let error = |line: &Line| match by {
            By::Density => Some(100.0 * line.density_dev_avg),
            By::Energy => line.apart.energy.map(|energy| 100.0 * energy),
            By::Observable => line.apart.observable,
        };
        let entry = |(place, line): (usize, &Line)| Entry {
            place,
            label: line.label.clone(),
            seconds: [line.seconds.min, line.seconds.median, line.seconds.max],
            error: error(line),
            lost: line.diverged.as_ref().map(|why| format!("diverged, {why}")),
            knee: table.knee == Some(place) && table.by == by,
        };
        let entries = table.lines.iter().enumerate().map(entry).collect();
        Panel::new(title, "seconds for the frames", entries, &table.front(by), blind)
    });
    made.into_iter().flatten().collect()
}

/// Every line, the reference and its refinement; SI units, deviations as fractions, empty where there is no value.
fn csv(table: &Table) -> Vec<Vec<String>> {
    let head = "setting,seconds_median,seconds_min,seconds_max,cpu_seconds,shot_seconds,particles,substeps_a_frame,\
                iterations_a_frame,unconverged_substeps,density_dev_avg,density_dev_max_mean,density_dev_largest,\
                volume_change,energy_apart,observable_apart,position_apart,on_front,knee,diverged";
    let fields = |line: &Line, knee: bool| {
        vec![
            line.label.clone(),
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
            line.diverged.clone().unwrap_or_default(),
        ]
    };
    let head = head.split(',').map(String::from).collect();
    // The refinement's distance from the reference is what the reference's own errors are judged by.
    let refined = Line { apart: table.uncertainty, ..table.refined.clone() };
    full(head, &table.lines, [&table.reference, &refined], table.knee, fields)
}
