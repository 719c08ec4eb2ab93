//! The table of smoke as files.

use super::{By, Line, Smoke, Table};
use crate::run::{
    RunError,
    tradeoff::{
        Compared,
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

/// What errors against the reference are called.
const COMPARED: [(By, &str); 5] = [
    (By::Density, "density"),
    (By::Center, "centre"),
    (By::Extent, "extent"),
    (By::Energy, "energy"),
    (By::Impulse, "impulse"),
];

fn page(table: &Table) -> Page<'_> {
    let uncertainty = COMPARED
        .iter()
        .filter_map(|(by, name)| table.floor(*by).map(|found| format!("{name} {}", percent(found))));
    let head = [
        "#",
        "setting",
        "seconds",
        "s a volume",
        "whole shot",
        "MiB",
        "vortons",
        "velocity",
        "density",
        "centre",
        "extent",
        "energy",
        "impulse",
        "energy, drift",
        "impulse, drift",
        "voxel",
        "MB a volume",
        "",
    ];
    Page {
        title: &table.title,
        introduction: introduction(
            &format!("Frames {}, {} threads", table.about.frames, table.threads),
            &uncertainty.collect::<Vec<_>>().join(", "),
        ),
        panels: panels(table),
        head: head.map(String::from).to_vec(),
        rows: rows(table, cells),
        legend: escaped(&format!(
            "Velocity: against the sum over all pairs, largest of the frames. Density: the share of the smoke that is elsewhere \
             than the reference's, on a lattice of {} m, mean of the frames. Centre and extent: against the reference's, in \
             its sizes. Energy and impulse: of the air, RMS distance from the reference. Drift: at the end against the start of \
             the run itself; what is pushed, viscous or held by solids drifts rightly. Voxel: the volume's density between nodes \
             against the sum over tracers, mean.",
            table.about.cell
        )),
        csv: csv(table),
    }
}

/// The errors against the reference.
fn compared(line: &Line) -> impl Iterator<Item = Option<f64>> {
    COMPARED.iter().map(|(by, _)| Smoke::error(*by, &line.told, &line.apart))
}

fn cells(number: &str, line: &Line, mark: &str) -> Vec<String> {
    let maybe = |value: Option<f64>, say: &dyn Fn(f64) -> String| value.map_or_else(|| "–".into(), say);
    let told = &line.told;
    let mut cells = vec![
        number.into(),
        line.label.clone(),
        figure(line.seconds.median),
        maybe(told.volume_seconds.map(|spread| spread.median), &figure),
        format!("{:.0} s", line.shot_seconds),
        maybe(told.memory.map(|bytes| bytes as f64), &|bytes| format!("{:.0}", bytes / f64::from(1 << 20))),
        told.vortons.to_string(),
        maybe(told.velocity, &percent),
    ];
    cells.extend(compared(line).map(|error| maybe(error, &percent)));
    cells.extend([
        maybe(told.drift.energy, &|part| format!("{:+.2} %", 100.0 * part)),
        maybe(told.drift.impulse, &percent),
        maybe(told.voxel, &percent),
        maybe(told.volume.map(|bytes| bytes as f64 / 1e6), &figure),
        line.diverged.as_ref().map_or_else(|| mark.into(), |why| format!("diverged, {why}")),
    ]);
    cells
}

fn panels(table: &Table) -> Vec<Panel> {
    let shown = By::ALL.map(|by| {
        let title = match by {
            By::Density => "smoke elsewhere than the reference's [%]",
            By::Center => "centre, from the reference [% of its size]",
            By::Extent => "extent, from the reference [%]",
            By::Energy => "energy, from the reference [%]",
            By::Impulse => "impulse, from the reference [%]",
            By::Velocity => "velocity, from the sum over all pairs [%]",
            By::Voxel => "volume, from the sum over tracers [%]",
        };
        let below = if by == By::Voxel { "seconds a volume" } else { "seconds for the frames" };
        Shown { by, title: title.into(), below, scale: 100.0 }
    });
    page::panels(table, shown)
}

fn csv(table: &Table) -> Vec<Vec<String>> {
    let own = "volume_seconds,memory_bytes,cache_bytes,volume_bytes,vortons,tracers,substeps_a_frame,capped,clamped,\
               velocity_error,voxel_error,density_apart,center_apart,extent_apart,energy_apart,impulse_apart,energy_drift,\
               impulse_drift";
    let whole = |value: Option<u64>| value.map_or_else(String::new, |value| value.to_string());
    page::csv(table, own.split(',').map(String::from), |line| {
        let told = &line.told;
        let mut fields = vec![
            maybe(told.volume_seconds.map(|spread| spread.median)),
            whole(told.memory),
            told.cache.to_string(),
            whole(told.volume),
            told.vortons.to_string(),
            told.tracers.to_string(),
            told.substeps.to_string(),
            told.capped.to_string(),
            told.clamped.to_string(),
            maybe(told.velocity),
            maybe(told.voxel),
        ];
        fields.extend(compared(line).map(maybe));
        fields.extend([maybe(told.drift.energy), maybe(told.drift.impulse)]);
        fields
    })
}
