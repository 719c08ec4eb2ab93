//! What happened and should not go unseen, in words.

use super::RunError;
use crate::{
    job::nonzero,
    mesh::SurfaceError,
    sim::{FrameRecord, SeedReport, coupling::CouplingRecord, sheet::SheetRecord, smoke::SmokeRecord},
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
    let liquid = nonzero(&[
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
    nonzero(&[
        (liquid.crossed, "particles crossed a sheet"),
        (liquid.projected_back, "particles projected back to their side of a sheet"),
        (liquid.unconverged, "contact solves reached their iteration limit"),
        (smoke.limited, "drag forces on faces limited (substeps too long for the air)"),
    ])
}

/// The same of the sheets.
fn of_sheets(record: &SheetRecord) -> Vec<String> {
    let contact = record.contact.clone().unwrap_or_default();
    nonzero(&[
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
    let counts = nonzero(&[
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

/// Why a frame that the job itself computed has no surface.
pub(super) fn no_surface(why: SurfaceError) -> RunError {
    match why {
        SurfaceError::Interrupted => RunError::Interrupted,
        why => RunError::Request(why.to_string()),
    }
}
