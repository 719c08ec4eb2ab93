//! What happened and should not go unseen, in words.

use super::{RunError, volume_grids::VolumeStats};
use crate::{mesh::SurfaceError, mesh::SurfaceStats, sim::FrameRecord, sim::SeedReport};

/// What seeding had to leave out.
pub(super) fn of_seeding(report: &SeedReport) -> Vec<String> {
    let left_out = |count: u32, why: &str| {
        (count > 0).then(|| format!("{count} particles of the sources were left out: {why}"))
    };
    [
        left_out(report.skipped_in_solids, "they lay inside solids or touched them"),
        left_out(report.skipped_overlapping, "another source had filled their place"),
    ]
    .into_iter()
    .flatten()
    .collect()
}

/// The limits that changed a frame.
pub(super) fn of_frame(record: &FrameRecord) -> Vec<String> {
    let clamps = &record.clamps;
    counted(&[
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

/// The places where a surface departs from the rule.
pub(super) fn of_surface(stats: &SurfaceStats) -> Vec<String> {
    let components = stats.components.unwrap_or_default();
    let smoothing = stats.smoothing.unwrap_or_default();
    let decimation = stats.decimation.unwrap_or_default();
    counted(&[
        (components.points as u64, "small pieces made points"),
        (components.bubbles as u64, "small bubbles filled"),
        (smoothing.restored_vertices as u64, "vertices not smoothed, lest triangles fold"),
        (decimation.unsuitable.into(), "open mesh not decimated"),
        (stats.too_far_particles as u64, "particles too far from the origin, left out"),
        (stats.unseen_particles as u64, "particles between grid nodes, not seen (voxel)"),
        (stats.contour.unbounded_vertices as u64, "vertices beside values that are not finite"),
        (stats.contour.cut_cells as u64, "cells cut off by missing bricks"),
        (stats.normals_from_faces as u64, "normals from faces"),
        (stats.attributes_from_nearest as u64, "attributes from the nearest particle"),
    ])
}

/// The places where a volume departs from its particles.
pub(super) fn of_volume(stats: &VolumeStats) -> Vec<String> {
    counted(&[
        (stats.too_far as u64, "particles too far from the origin, left out"),
        (stats.unseen as u64, "particles between grid nodes, not seen (voxel)"),
        (stats.over_one as u64, "nodes denser than filled space, held to 1"),
        (stats.without_velocity as u64, "nodes of the density without a velocity"),
    ])
}

/// Why a frame that the job itself computed has no surface.
pub(super) fn no_surface(why: SurfaceError) -> RunError {
    match why {
        SurfaceError::Interrupted => RunError::Interrupted,
        why => RunError::Request(why.to_string()),
    }
}

fn counted(counts: &[(u64, &str)]) -> Vec<String> {
    counts.iter().filter(|(count, _)| *count > 0).map(|(count, what)| format!("{count} {what}")).collect()
}
