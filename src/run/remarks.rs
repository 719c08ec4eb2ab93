//! What happened and should not go unseen, in words.

use super::{FrameSpan, RunError, smoke_grids::SmokeStats, volume_grids::VolumeStats};
use crate::{
    frame::FrameIndex,
    mesh::{SurfaceError, SurfaceStats},
    sim::{
        FrameRecord, SeedReport,
        coupling::CouplingRecord,
        sheet::SheetRecord,
        smoke::{DriftReport, SmokeRecord},
    },
};

/// The part of the flow through solids that is told. On a ball of ten spacings 0.05 to 3 % are left, on a box of ten a tenth on its
/// faces and a quarter to a half with its edges: that is what panels of a spacing do. Beyond, as on plates and bodies thinner than a
/// spacing, the solid hardly keeps air out, and smoke only is pushed from it.
const LEAKY: f64 = 0.5;

/// The part of the flow through the panels themselves that is told: the equations ask for a hundredth of this.
const UNSOLVED: f64 = 0.01;

/// What seeding had to leave out.
pub(super) fn of_seeding(report: &SeedReport) -> Vec<String> {
    let left_out = |count: u32, why: &str| {
        (count > 0).then(|| format!("{count} particles of the sources were left out: {why}"))
    };
    let smoke = report.smoke.unwrap_or_default();
    let across = smoke.wind_across;
    let wind = (across > 0.0).then(|| {
        format!("the wind is left without the {across:.3} m/s with which it blows at a plane: no air goes through one")
    });
    let crossings = report.crossings;
    let crossed = (crossings > 0).then(|| {
        format!(
            "{crossings} edges of sheets go through faces of sheets from the start: there they pass through each other until they have \
             left each other; move the sheets apart"
        )
    });
    [
        left_out(smoke.skipped_in_solids, "tracers lay inside solids"),
        left_out(report.skipped_in_solids, "they lay inside solids or touched them"),
        left_out(report.skipped_overlapping, "another source had filled their place"),
        wind,
        crossed,
    ]
    .into_iter()
    .flatten()
    .collect()
}

/// The limits that changed a frame.
pub(super) fn of_frame(record: &FrameRecord) -> Vec<String> {
    let clamps = &record.clamps;
    let smoke = record.smoke.as_ref().map_or_else(Vec::new, of_smoke);
    let liquid = counted(&[
        (record.unconverged.into(), "substeps stopped at max_iterations"),
        (record.cfl_capped.into(), "substeps longer than cfl (max_substeps)"),
        (clamps.corrections, "corrections shortened"),
        (clamps.energy, "velocities held to the energy bound"),
        (clamps.confinement, "confinements scaled down"),
        (clamps.contacts, "contacts unresolved"),
        (u64::from(clamps.momentum), "iterations slowed down"),
        (record.particles_inside_solids.into(), "particles inside solids"),
    ]);
    let sheets = record.sheets.as_ref().map_or_else(Vec::new, of_sheets);
    let coupling = record.coupling.as_ref().map_or_else(Vec::new, of_coupling);
    liquid.into_iter().chain(smoke).chain(sheets).chain(coupling).collect()
}

/// The same of couplings.
fn of_coupling(record: &CouplingRecord) -> Vec<String> {
    let liquid = record.liquid.clone().unwrap_or_default();
    let smoke = record.smoke.clone().unwrap_or_default();
    counted(&[
        (liquid.crossed, "particles got through a sheet"),
        (liquid.put_back, "particles put back to their side of a sheet"),
        (liquid.unfinished, "rounds of contact ended by their number"),
        (smoke.cut, "drags of faces cut (longer substeps than the air allows)"),
    ])
}

/// The same of the sheets.
fn of_sheets(record: &SheetRecord) -> Vec<String> {
    let contact = record.contact.clone().unwrap_or_default();
    counted(&[
        (contact.crossings, "edges of sheets through faces of sheets"),
        (contact.unseparated, "pairs of sheets not surely kept apart"),
        (record.unconverged.into(), "substeps of sheets stopped at max_iterations"),
        (record.overshot.into(), "substeps of sheets too long for one linearisation: springs gained energy"),
        (record.inside_solids, "points of sheets inside solids"),
        (record.cut_faces, "faces of sheets cut into solids (sheets.clearance or smaller cells)"),
        (record.folded, "springs of sheets without a direction"),
    ])
}

/// The limits that changed the smoke of a frame.
fn of_smoke(record: &SmokeRecord) -> Vec<String> {
    let part = |part: Option<f64>, least: f64, what: &str| {
        // What is no number is told as well.
        part.filter(|part| part.is_nan() || *part > least).map(|part| format!("{:.0} % {what}", 100.0 * part))
    };
    let solid = record.leakiest.map_or_else(String::new, collider);
    let through = &format!("of the air's flow at {solid} goes through it (smoke.spacing)");
    let unsolved = "of the flow through panels of solids is left (they are too thin or too close)";
    let counts = counted(&[
        (
            record.flow.capped.into(),
            "steps longer than strain, displacement, wind and solids allow (max_substeps)",
        ),
        (record.flow.clamped, "strengths cut"),
        (record.smothered, "tracers not emitted, inside solids"),
        (record.returned_vortons, "vortons put out of solids"),
        (record.returned_tracers, "tracers put out of solids"),
    ]);
    let parts = [part(record.through_flow, LEAKY, through), part(record.unsolved, UNSOLVED, unsolved)];
    counts.into_iter().chain(parts.into_iter().flatten()).collect()
}

/// The key of a solid in the preset.
fn collider(number: u32) -> String {
    format!("world.collider.{number}")
}

/// The solids without sources, by number.
pub(super) fn of_sourceless(solids: &[usize]) -> Option<String> {
    let named: Vec<String> = solids.iter().take(MOST_NAMED).map(|&number| collider(number as u32)).collect();
    let more = solids.len() - named.len();
    let more = if more > 0 { format!(" and {more} more") } else { String::new() };
    (!solids.is_empty()).then(|| {
        format!(
            "air goes through {}{more}: too thin or too small for the sources that keep it out, or one of so many solids that \
             1600 panels do not go round; make it thicker than smoke.spacing, smoke.spacing smaller, or the solids fewer",
            named.join(", ")
        )
    })
}

/// Solids that a line names.
const MOST_NAMED: usize = 8;

/// What happened to tracers on the way to the frame `index` of smoke that is played again.
pub(super) fn of_drift(index: FrameIndex, report: &DriftReport) -> Option<String> {
    let DriftReport { steps, capped, returned, smothered } = *report;
    let told = counted(&[
        (capped, &format!("of {steps} steps longer than air and solids allow (cache more frames a second)")),
        (returned, "tracers put out of solids"),
        (smothered, "tracers not emitted, inside solids"),
    ]);
    (!told.is_empty()).then(|| format!("frame {index}: {}", told.join(", ")))
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
        (decimation.over_target as u64, "triangles more than asked for (decimation)"),
        (stats.too_far_particles as u64, "particles too far from the origin, left out"),
        (stats.unseen_particles as u64, "particles between grid nodes, not seen (voxel)"),
        (stats.contour.unbounded_vertices as u64, "vertices beside values that are not finite"),
        (stats.contour.cut_cells as u64, "cells cut off by missing bricks"),
        (stats.normals_from_faces as u64, "normals from faces"),
        (stats.attributes_from_nearest as u64, "attributes from the nearest particle"),
    ])
}

/// The places where a volume of smoke departs from its tracers.
pub(super) fn of_smoke_volume(stats: &SmokeStats) -> Vec<String> {
    let short = stats.short.then(|| "velocities end before the smoke does in a frame".to_owned());
    counted(&[(stats.too_far as u64, "tracers too far from the origin, left out")])
        .into_iter()
        .chain(short)
        .collect()
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

/// The frames that a sequence lacks between its first and its last. Where more than two frames are all at multiples of a
/// distance, that is its step.
pub(super) fn of_gaps(frames: &[u32]) -> Option<String> {
    let span = FrameSpan::of(frames)?;
    let step = if frames.len() > 2 { span.step } else { 1 };
    let gaps: Vec<(u32, u32)> = frames
        .windows(2)
        .filter(|pair| pair[1] - pair[0] > step)
        .map(|pair| (pair[0] + step, pair[1] - step))
        .collect();
    let missing: u64 = gaps.iter().map(|(first, last)| u64::from((last - first) / step) + 1).sum();
    let text = |&(first, last): &(u32, u32)| match step {
        _ if first == last => first.to_string(),
        1 => format!("{first}-{last}"),
        step => format!("{first}-{last}x{step}"),
    };
    let listed: Vec<String> = gaps.iter().take(MOST_GAPS).map(text).collect();
    let more = if gaps.len() > MOST_GAPS { ",…" } else { "" };
    (missing > 0).then(|| {
        let (first, last) = (span.first, span.last);
        format!("{missing} frames are missing between {first} and {last}: {}{more}", listed.join(","))
    })
}

/// Gaps that a line shows.
const MOST_GAPS: usize = 20;

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

#[cfg(test)]
mod tests {
    use super::of_gaps;

    #[test]
    fn gaps_are_named_as_frames_are_written() {
        let gaps = |frames: &[u32]| of_gaps(frames);
        let told = |count: u32, first: u32, last: u32, which: &str| {
            Some(format!("{count} frames are missing between {first} and {last}: {which}"))
        };
        assert_eq!(gaps(&[]), None);
        assert_eq!(gaps(&[5]), None);
        assert_eq!(gaps(&[1, 2, 3]), None);
        assert_eq!(gaps(&[1, 3]), told(1, 1, 3, "2"));
        assert_eq!(gaps(&[3, 4, 10]), told(5, 3, 10, "5-9"));
        assert_eq!(gaps(&[1, 3, 5, 7]), None, "every second frame is there");
        assert_eq!(gaps(&[10, 20, 50, 70]), told(3, 10, 70, "30-40x10,60"));
        assert_eq!(gaps(&[0, 1, u32::MAX]), told(u32::MAX - 2, 0, u32::MAX, "2-4294967294"));
        let every_third_lacks: Vec<u32> = (0..90).filter(|i| i % 3 != 1).collect();
        assert!(gaps(&every_third_lacks).unwrap().starts_with("30 frames"));
        assert!(gaps(&every_third_lacks).unwrap().ends_with("55,58,…"));
    }
}
