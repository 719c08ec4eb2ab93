//! What jobs report of the smoke: progress and warnings.

use crate::{
    job::nonzero,
    sim::{
        smoke::{SmokeRecord, SmokeSeeds},
        vortex::flow::Account,
    },
};

/// The leakage of a solid above which it is reported. A ball of ten spacings leaves 0.05 to 3 %, a box of ten a tenth on its
/// faces and a quarter to a half with its edges: that is the accuracy of panels of a spacing. Beyond, as on plates and bodies
/// thinner than a spacing, the solid hardly keeps air out, and only the smoke is projected out of it.
const MAX_LEAKAGE: f64 = 0.5;

/// The part of the flow through the panels themselves above which it is reported: the equations are solved to a
/// hundredth of this.
const MAX_PANEL_RESIDUAL: f64 = 0.01;

/// Solids that a line names.
const MAX_NAMED_SOLIDS: usize = 8;

/// What seeding left out, and what the smoke's setup cannot do.
pub(super) fn seeding_warnings(seeds: &SmokeSeeds) -> Vec<String> {
    let left_out = nonzero(&[
        (seeds.skipped_in_solids.into(), "tracers were left out: they lay inside solids"),
        (
            seeds.narrow_cores.into(),
            "rings or tubes are narrower than the cores of vortons, and have those: rings fly slower (lower smoke.spacing)",
        ),
    ]);
    let across = seeds.wind_across;
    let wind = (across > 0.0).then(|| {
        format!("the wind's component of {across:.3} m/s normal to a plane is removed: no air flows through a plane")
    });
    left_out.into_iter().chain(wind).chain(without_panels(&seeds.sourceless)).collect()
}

/// The solids that have no source panels, by number.
fn without_panels(solids: &[usize]) -> Option<String> {
    let named: Vec<String> =
        solids.iter().take(MAX_NAMED_SOLIDS).map(|&number| collider(number as u32)).collect();
    let more = solids.len() - named.len();
    let more = if more > 0 { format!(" and {more} more") } else { String::new() };
    (!solids.is_empty()).then(|| {
        format!(
            "air goes through {}{more}: at its largest too thin or too small for source panels, or one of more solids than 1600 panels \
             suffice for; make it thicker than smoke.spacing, lower smoke.spacing, or use fewer solids",
            named.join(", ")
        )
    })
}

/// What a frame's progress line shows.
pub(super) fn progress(record: &SmokeRecord) -> String {
    format!("substeps {}  vortons {}  tracers {}", record.flow.substeps, record.vortons, record.tracers)
}

/// The limits that changed a frame.
pub(super) fn warnings(record: &SmokeRecord) -> Vec<String> {
    let above = |part: Option<f64>, limit: f64, what: &str| {
        // NaN is reported too.
        part.filter(|part| part.is_nan() || *part > limit).map(|part| format!("{:.0} % {what}", 100.0 * part))
    };
    let solid = record.leakiest.map_or_else(String::new, collider);
    let leakage = &format!("of the normal flow at {solid} leaks through it (lower smoke.spacing)");
    let residual = "of the flow through panels of solids is left (they are too thin or too close)";
    let counts = nonzero(&[
        (
            record.flow.capped.into(),
            "steps longer than strain, displacement, wind and solids allow (max_substeps)",
        ),
        (record.flow.clamped, "strengths cut"),
        (record.rejected, "tracers not emitted, inside solids"),
        (record.returned_vortons, "vortons projected out of solids"),
        (record.returned_tracers, "tracers projected out of solids"),
    ]);
    let parts = [
        above(record.through_flow, MAX_LEAKAGE, leakage),
        above(record.unsolved, MAX_PANEL_RESIDUAL, residual),
    ];
    counts.into_iter().chain(parts.into_iter().flatten()).chain(inaccurate(&record.account)).collect()
}

/// The sampled error of the velocity, where it is larger than requested.
fn inaccurate(Account { error, tolerance, .. }: &Account) -> Option<String> {
    // NaN is reported too.
    error.zip(*tolerance).filter(|(error, tolerance)| error.is_nan() || error > tolerance).map(
        |(error, tolerance)| {
            format!(
                "the velocity's error of {error:.1e} exceeds the requested {tolerance:.1e} (smoke.flow.error, which \"grouping\" and \"multigrid\" do not keep: smoke.flow.sum)"
            )
        },
    )
}

/// The key of a solid in the preset.
fn collider(number: u32) -> String {
    format!("world.collider.{number}")
}
