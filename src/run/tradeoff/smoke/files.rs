//! The table of smoke as files.

use super::{By, Line, Table, seconds};
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
        .filter_map(|(by, name)| by.of(&table.uncertainty).map(|found| format!("{name} {}", percent(found))));
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
            &format!("Frames {}, {} threads", table.frames, table.threads),
            &uncertainty.collect::<Vec<_>>().join(", "),
        ),
        panels: panels(table),
        head: head.map(String::from).to_vec(),
        rows: rows(&table.lines, &table.reference, table.knee, |line| line.front, cells),
        legend: escaped(&format!(
            "Velocity: against the sum over all pairs, largest of the frames. Density: the share of the smoke that is elsewhere \
             than the reference's, on a lattice of {} m, mean of the frames. Centre and extent: against the reference's, in \
             its sizes. Energy and impulse: of the air, RMS distance from the reference. Drift: at the end against the start of \
             the run itself; what is pushed, viscous or held by solids drifts rightly. Voxel: the volume's density between nodes \
             against the sum over tracers, mean.",
            table.cell
        )),
        csv: csv(table),
    }
}

fn cells(number: &str, line: &Line, mark: &str) -> Vec<String> {
    let maybe = |value: Option<f64>, say: &dyn Fn(f64) -> String| value.map_or_else(|| "–".into(), say);
    let mut cells = vec![
        number.into(),
        line.label.clone(),
        figure(line.seconds.median),
        maybe(line.volume_seconds.map(|spread| spread.median), &figure),
        format!("{:.0} s", line.shot_seconds),
        maybe(line.memory.map(|bytes| bytes as f64), &|bytes| format!("{:.0}", bytes / f64::from(1 << 20))),
        line.vortons.to_string(),
        maybe(line.velocity, &percent),
    ];
    cells.extend(COMPARED.iter().map(|(by, _)| maybe(by.of(&line.apart), &percent)));
    cells.extend([
        maybe(line.drift.energy, &|part| format!("{:+.2} %", 100.0 * part)),
        maybe(line.drift.impulse, &percent),
        maybe(line.voxel, &percent),
        maybe(line.volume.map(|bytes| bytes as f64 / 1e6), &figure),
        line.diverged.as_ref().map_or_else(|| mark.into(), |why| format!("diverged, {why}")),
    ]);
    cells
}

fn panels(table: &Table) -> Vec<Panel> {
    let made = By::ALL.map(|by| {
        let title = match by {
            By::Density => "smoke elsewhere than the reference's [%]",
            By::Center => "centre, from the reference [% of its size]",
            By::Extent => "extent, from the reference [%]",
            By::Energy => "energy, from the reference [%]",
            By::Impulse => "impulse, from the reference [%]",
            By::Velocity => "velocity, from the sum over all pairs [%]",
            By::Voxel => "volume, from the sum over tracers [%]",
        };
        let error = |line: &Line| match by {
            By::Velocity => line.velocity,
            By::Voxel => line.voxel,
            _ => by.of(&line.apart),
        };
        let entry = |(place, line): (usize, &Line)| {
            let spread = seconds(line, by)?;
            Some(Entry {
                place,
                label: line.label.clone(),
                seconds: [spread.min, spread.median, spread.max],
                error: error(line).map(|error| 100.0 * error),
                lost: line.diverged.as_ref().map(|why| format!("diverged, {why}")),
                knee: table.knee == Some(place) && table.by == by,
            })
        };
        let entries = table.lines.iter().enumerate().filter_map(entry).collect();
        let below = if by == By::Voxel { "seconds a volume" } else { "seconds for the frames" };
        let blind = 100.0 * by.of(&table.uncertainty).unwrap_or(0.0);
        Panel::new(title.into(), below, entries, &table.front(by), blind)
    });
    made.into_iter().flatten().collect()
}

/// Every line, the reference and its refinement; SI units, errors as fractions, empty where there is no value.
fn csv(table: &Table) -> Vec<Vec<String>> {
    let head = "setting,seconds_median,seconds_min,seconds_max,cpu_seconds,volume_seconds,shot_seconds,memory_bytes,cache_bytes,\
                volume_bytes,vortons,tracers,substeps_a_frame,capped,clamped,velocity_error,voxel_error,density_apart,\
                center_apart,extent_apart,energy_apart,impulse_apart,energy_drift,impulse_drift,on_front,knee,diverged";
    let whole = |value: Option<u64>| value.map_or_else(String::new, |value| value.to_string());
    let fields = |line: &Line, knee: bool| {
        let mut fields = vec![
            line.label.clone(),
            line.seconds.median.to_string(),
            line.seconds.min.to_string(),
            line.seconds.max.to_string(),
            maybe(line.cpu_seconds.map(|spread| spread.median)),
            maybe(line.volume_seconds.map(|spread| spread.median)),
            line.shot_seconds.to_string(),
            whole(line.memory),
            line.cache.to_string(),
            whole(line.volume),
            line.vortons.to_string(),
            line.tracers.to_string(),
            line.substeps.to_string(),
            line.capped.to_string(),
            line.clamped.to_string(),
            maybe(line.velocity),
            maybe(line.voxel),
        ];
        fields.extend(COMPARED.iter().map(|(by, _)| maybe(by.of(&line.apart))));
        fields.extend([
            maybe(line.drift.energy),
            maybe(line.drift.impulse),
            line.front.to_string(),
            knee.to_string(),
            line.diverged.clone().unwrap_or_default(),
        ]);
        fields
    };
    let head = head.split(',').map(String::from).collect();
    // The refinement's distance from the reference is what the reference's own errors are judged by.
    let refined = Line { apart: table.uncertainty, ..table.refined.clone() };
    full(head, &table.lines, [&table.reference, &refined], table.knee, fields)
}
