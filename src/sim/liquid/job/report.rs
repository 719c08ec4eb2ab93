//! Reports of the liquid: progress, warnings, totals.

use crate::{
    cache::StreamInfo,
    job::{Total, nonzero},
    sim::{
        liquid::{LiquidRecord, LiquidSeeds, NAME},
        system::CachedFrame,
    },
};
use serde_json::json;

/// The scalars of the liquid's stream that `info` lists.
const DENSITY_DEV_AVG: &str = "density_dev_avg";
const DENSITY_DEV_MAX: &str = "density_dev_max";

/// Particles that seeding skipped.
pub(super) fn seeding_warnings(seeds: &LiquidSeeds) -> Vec<String> {
    nonzero(&[
        (
            seeds.skipped_in_solids.into(),
            "particles of the sources were skipped: they were inside solids or touched them",
        ),
        (
            seeds.skipped_overlapping.into(),
            "particles of the sources were skipped: another source had already filled their position",
        ),
    ])
}

/// Progress line of a frame.
pub(super) fn progress(record: &LiquidRecord) -> String {
    format!(
        "substeps {}  iterations {}  density_dev {:.3}% (max {:.2}%)",
        record.substeps,
        record.iterations,
        100.0 * record.density_dev_avg,
        100.0 * record.density_dev_max,
    )
}

/// Limits that changed a frame.
pub(super) fn warnings(record: &LiquidRecord) -> Vec<String> {
    let clamps = &record.clamps;
    nonzero(&[
        (record.unconverged.into(), "substeps stopped at max_iterations"),
        (record.cfl_capped.into(), "substeps longer than cfl (max_substeps)"),
        (clamps.corrections, "corrections shortened"),
        (clamps.energy, "velocities held to the energy bound"),
        (clamps.confinement, "confinements scaled down"),
        (clamps.contacts, "contacts unresolved"),
        (u64::from(clamps.momentum), "iterations slowed down"),
        (record.particles_inside_solids.into(), "particles inside solids"),
    ])
}

/// Density deviations in a frame's header.
pub(super) fn frame_figures(streams: &[StreamInfo]) -> Vec<(&'static str, f64)> {
    let scalars = streams.iter().filter(|stream| stream.name == NAME).flat_map(|stream| &stream.scalars);
    let named =
        |name: &'static str| scalars.clone().find(|(key, _)| key == name).map(|&(_, value)| (name, value));
    [DENSITY_DEV_AVG, DENSITY_DEV_MAX].into_iter().filter_map(named).collect()
}

/// The density deviations over all frames.
pub(super) fn totals(frames: &[CachedFrame]) -> Option<Total> {
    let figures = || frames.iter().flat_map(|frame| frame_figures(&frame.streams));
    let values = |name: &'static str| figures().filter(move |(key, _)| *key == name).map(|(_, value)| value);
    let count = values(DENSITY_DEV_AVG).count();
    let average = values(DENSITY_DEV_AVG).sum::<f64>() / count as f64;
    let largest = values(DENSITY_DEV_MAX).fold(0.0, f64::max);
    (count > 0).then(|| Total {
        key: NAME,
        value: json!({ "frames": count, DENSITY_DEV_AVG: average, DENSITY_DEV_MAX: largest }),
        heading: "density",
        text: format!("deviates by {:.3}% on average, {:.2}% at most", 100.0 * average, 100.0 * largest),
    })
}
