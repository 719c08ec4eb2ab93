//! The table of a liquid as files.

use super::{By, Line, Table};
use crate::run::{
    RunError,
    tradeoff::{
        page::{self, Page, Shown, introduction, maybe, rows},
        plot::{Panel, escaped, figure, percent},
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
    let unit = table.about.observable.unit();
    let observable = table.about.observable.name();
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
            &format!("Frames {}, {} threads", table.about.frames, table.threads),
            &uncertainty,
        ),
        panels: panels(table),
        head: head.into_iter().chain([observable, "positions", ""]).map(String::from).collect(),
        rows: rows(table, |number, line, mark| cells(number, line, mark, table)),
        legend: escaped(&format!(
            "Density: how far from incompressible, mean of the frames and largest of all particles. Volume: of the \
             surface, last frame against first. Energy, {observable} and positions: RMS distance from the reference."
        )),
        csv: csv(table),
    }
}

fn cells(number: &str, line: &Line, mark: &str, table: &Table) -> Vec<String> {
    let maybe = |value: Option<f64>, say: &dyn Fn(f64) -> String| value.map_or_else(|| "–".into(), say);
    let unit = table.about.observable.unit();
    vec![
        number.into(),
        line.label.clone(),
        format!("{:.1}", line.seconds.median),
        format!("{:.0} s", line.shot_seconds),
        percent(line.told.density_dev_avg),
        percent(line.told.density_dev_largest),
        maybe(line.told.volume_change, &|v| format!("{:+.1} %", 100.0 * v)),
        maybe(line.apart.energy, &percent),
        maybe(line.apart.observable, &|o| format!("{} {unit}", figure(o))),
        maybe(line.apart.position, &|p| format!("{} m", figure(p))),
        line.diverged.as_ref().map_or_else(|| mark.into(), |why| format!("diverged, {why}")),
    ]
}

fn panels(table: &Table) -> Vec<Panel> {
    let shown = By::ALL.map(|by| {
        let (title, scale) = match by {
            By::Density => ("density deviation, mean [%]".to_owned(), 100.0),
            By::Energy => ("energy, from the reference [%]".to_owned(), 100.0),
            By::Observable => {
                let observable = table.about.observable;
                (format!("{}, from the reference [{}]", observable.name(), observable.unit()), 1.0)
            }
        };
        Shown { by, title, below: "seconds for the frames", scale }
    });
    page::panels(table, shown)
}

fn csv(table: &Table) -> Vec<Vec<String>> {
    let own = "particles,substeps_a_frame,iterations_a_frame,unconverged_substeps,density_dev_avg,density_dev_max_mean,\
               density_dev_largest,volume_change,energy_apart,observable_apart,position_apart";
    page::csv(table, own.split(',').map(String::from), |line| {
        let told = &line.told;
        vec![
            told.particles.to_string(),
            told.substeps.to_string(),
            told.iterations.to_string(),
            told.unconverged.to_string(),
            told.density_dev_avg.to_string(),
            told.density_dev_max.to_string(),
            told.density_dev_largest.to_string(),
            maybe(told.volume_change),
            maybe(line.apart.energy),
            maybe(line.apart.observable),
            maybe(line.apart.position),
        ]
    })
}
