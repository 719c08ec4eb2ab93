//! The table of sheets as files.

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
    let floor = &table.uncertainty;
    let uncertainty = [
        floor.distance.map(|d| format!("distance {}", length(d))),
        floor.farthest.map(|d| format!("farthest {}", length(d))),
        floor.energy.map(|e| format!("energy {}", percent(e))),
    ];
    let head = [
        "#",
        "setting",
        "seconds",
        "whole shot",
        "MiB",
        "points",
        "substeps",
        "rounds",
        "strain",
        "distance",
        "farthest",
        "energy",
        "",
    ];
    Page {
        title: &table.title,
        introduction: introduction(
            &format!("Frames {}, {} threads", table.about.frames, table.threads),
            &uncertainty.into_iter().flatten().collect::<Vec<_>>().join(", "),
        ),
        panels: panels(table),
        head: head.map(String::from).to_vec(),
        rows: rows(table, cells),
        legend: escaped(
            "Substeps and rounds of the conjugate gradients: of a frame. Strain: the largest of a spring at any frame's end. Distance: \
             between the same points of the cloth and the reference's, RMS over points and frames; farthest: the largest. Energy: of \
             motion, springs and height, RMS over the frames, as a part of the largest that the reference has in motion and springs.",
        ),
        csv: csv(table),
    }
}

/// A length in the unit that suits it.
fn length(metres: f64) -> String {
    format!("{} mm", figure(1e3 * metres))
}

fn cells(number: &str, line: &Line, mark: &str) -> Vec<String> {
    let maybe = |value: Option<f64>, say: &dyn Fn(f64) -> String| value.map_or_else(|| "–".into(), say);
    let (told, apart) = (&line.told, &line.apart);
    vec![
        number.into(),
        line.label.clone(),
        figure(line.seconds.median),
        format!("{:.0} s", line.shot_seconds),
        maybe(told.memory.map(|bytes| bytes as f64), &|bytes| format!("{:.0}", bytes / f64::from(1 << 20))),
        told.points.to_string(),
        format!("{:.0}", told.substeps),
        format!("{:.0}", told.iterations),
        percent(told.strain),
        maybe(apart.distance, &length),
        maybe(apart.farthest, &length),
        maybe(apart.energy, &percent),
        line.diverged.as_ref().map_or_else(|| mark.into(), |why| format!("diverged, {why}")),
    ]
}

fn panels(table: &Table) -> Vec<Panel> {
    let shown = By::ALL.map(|by| {
        let (title, scale) = match by {
            By::Distance => ("points, from the reference's, RMS [mm]", 1e3),
            By::Farthest => ("points, from the reference's, largest [mm]", 1e3),
            By::Energy => ("energy, from the reference [%]", 100.0),
        };
        Shown { by, title: title.into(), below: "seconds for the frames", scale }
    });
    page::panels(table, shown)
}

fn csv(table: &Table) -> Vec<Vec<String>> {
    let own = "memory_bytes,points,substeps_a_frame,iterations_a_frame,unconverged,overshot,strain_max,caught,inside_solids,\
               distance_apart,farthest_apart,energy_apart";
    page::csv(table, own.split(',').map(String::from), |line| {
        let (told, apart) = (&line.told, &line.apart);
        vec![
            told.memory.map_or_else(String::new, |bytes| bytes.to_string()),
            told.points.to_string(),
            told.substeps.to_string(),
            told.iterations.to_string(),
            told.unconverged.to_string(),
            told.overshot.to_string(),
            told.strain.to_string(),
            told.caught.to_string(),
            told.inside.to_string(),
            maybe(apart.distance),
            maybe(apart.farthest),
            maybe(apart.energy),
        ]
    })
}
