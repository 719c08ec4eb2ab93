//! Inflow and outflow as jobs see them: checks of presets, warnings, the balance of particles.

use crate::{
    cache::StreamInfo,
    job::{Total, nonzero, tradeoff::figure},
    preset::{
        check::Places,
        problem::Finding,
        shapes::{check_motion, shape_finding, source_finding},
    },
    sim::{
        Timeline,
        liquid::{
            FlowRecord, FlowTotals, FrameRange, LiquidEmitter, LiquidParams, LiquidSeeds, NAME, NozzleReport,
            Side, inflow::max_emitted_particles,
        },
        system::CachedFrame,
    },
    solid::{Shape, ShapeError},
};
use serde_json::json;

/// Most particles of a shot: ids have 32 bits.
const MAX_EMITTED: f64 = 2_147_483_648.0;

/// Part of the outline's area by which the cross-section of the particles may differ from it without a warning.
const MAX_AREA_DIFFERENCE: f64 = 0.1;

/// The shapes of a liquid's tables, with their dotted keys.
pub(super) fn shapes(liquid: &LiquidParams) -> impl Iterator<Item = (String, &Shape)> {
    let sources =
        liquid.source.iter().enumerate().map(|(i, it)| (format!("liquid.source.{i}.shape"), &it.shape));
    let emitters =
        liquid.emitter.iter().enumerate().map(|(i, it)| (format!("liquid.emitter.{i}.shape"), &it.shape));
    let outflows =
        liquid.outflow.iter().enumerate().map(|(i, it)| (format!("liquid.outflow.{i}.shape"), &it.shape));
    sources.chain(emitters).chain(outflows)
}

/// Reports contradictions in emitters, outflows and the domain.
pub(super) fn check_flow(
    liquid: &LiquidParams,
    seconds: f64,
    timeline: Timeline,
    places: &Places,
    findings: &mut Vec<Finding>,
) {
    for (index, emitter) in liquid.emitter.iter().enumerate() {
        let path = format!("liquid.emitter.{index}");
        check_motion(&emitter.keyframes, &emitter.shape, &path, places, findings);
        check_ranges(&emitter.on, &path, places, findings);
        let found = emitter_shape_finding(&path, &emitter.shape, places);
        let is_shape = found.is_none();
        findings.extend(found);
        check_rate(emitter, &path, is_shape, places, findings);
    }
    for (index, outflow) in liquid.outflow.iter().enumerate() {
        let path = format!("liquid.outflow.{index}");
        check_motion(&outflow.keyframes, &outflow.shape, &path, places, findings);
        check_ranges(&outflow.on, &path, places, findings);
        if let Err(error) = outflow.shape.check() {
            findings.push(shape_finding(&format!("{path}.shape.{}", outflow.shape.name()), error, places));
        }
    }
    if let Some(domain) = &liquid.domain
        && let Err(error) = (Shape::Box { min: domain.min, max: domain.max }).check()
    {
        findings.push(shape_finding("liquid.domain", error, places));
    }
    if findings.is_empty() {
        let count = max_emitted_particles(liquid, timeline, seconds);
        if count > MAX_EMITTED {
            let message = format!(
                "the emitters add up to {count:.1e} particles, more than the solver can number ({MAX_EMITTED})"
            );
            let label = format!("found {} m between particles", liquid.spacing);
            let finding = Finding::new(places.of("liquid.spacing"), "liquid.spacing", message, label);
            findings.push(
                finding.with_help("make `liquid.spacing` larger, the rates smaller, or the shot shorter"),
            );
        }
    }
}

/// What is wrong with the shape of an emitter; a disc needs no thickness.
fn emitter_shape_finding(path: &str, shape: &Shape, places: &Places) -> Option<Finding> {
    match (shape, shape.check()) {
        (Shape::Disc { thickness: 0.0, .. }, Err(ShapeError::OutOfRange { .. })) => None,
        _ => source_finding(path, shape, places),
    }
}

/// Whether the ranges ascend and are apart.
fn check_ranges(ranges: &[FrameRange], path: &str, places: &Places, findings: &mut Vec<Finding>) {
    let mut end = None;
    for (index, range) in ranges.iter().enumerate() {
        let key = format!("{path}.on.{index}");
        let (from, to) = (range.start.unwrap_or(0), range.end.unwrap_or(u32::MAX));
        let fault = if to <= from {
            Some((format!("range {index} of `{path}.on` is empty"), format!("found frames {from} to {to}")))
        } else if index > 0 && end.is_none_or(|end| range.start.is_none_or(|start| start < end)) {
            Some((
                format!("the ranges of `{path}.on` overlap or do not ascend"),
                format!("found a range from frame {from} after one to frame {}", end.unwrap_or(u32::MAX)),
            ))
        } else {
            None
        };
        if let Some((message, label)) = fault {
            findings.push(
                Finding::new(places.of(&key), &key, message, label)
                    .with_help("give each range a `start` below its `end`, and sort them by frame"),
            );
        }
        end = range.end;
    }
}

/// Whether a flow has one rate and one direction.
fn check_rate(
    emitter: &LiquidEmitter,
    path: &str,
    is_shape: bool,
    places: &Places,
    findings: &mut Vec<Finding>,
) {
    let given = [
        ("velocity", emitter.velocity.is_some()),
        ("rate", emitter.rate.is_some()),
        ("rate_keyframes", !emitter.rate_keyframes.is_empty()),
    ];
    let given: Vec<&str> =
        given.into_iter().filter(|(_, is_given)| *is_given).map(|(name, _)| name).collect();
    let mut report = |key: String, message: String, label: String, help: &str| {
        findings.push(Finding::new(places.of(&key), &key, message, label).with_help(help));
    };
    match given[..] {
        [_] => {}
        [] => report(
            path.to_owned(),
            format!("`{path}` has no flow"),
            "no `velocity`, `rate` or `rate_keyframes`".to_owned(),
            "add `velocity = [0, 0, -1]` in m/s, or `rate = \"1 L/s\"` with `direction = [0, 0, -1]`",
        ),
        [first, second, ..] => report(
            format!("{path}.{second}"),
            format!("`{path}.{first}` and `{path}.{second}` exclude each other"),
            format!("found `{second}`, but `{first}` is given too"),
            "keep one of them; the speed follows from a rate and the area of the nozzle",
        ),
    }
    if let (Some(_), Some(_)) = (emitter.velocity, emitter.direction) {
        report(
            format!("{path}.direction"),
            format!("`{path}.velocity` and `{path}.direction` exclude each other"),
            "found a direction, but the velocity has one".to_owned(),
            "remove the direction",
        );
    }
    let has_length = |v: [f32; 3]| v.iter().any(|&c| c != 0.0);
    match emitter.flow_direction() {
        None if is_shape && !given.is_empty() => report(
            path.to_owned(),
            format!("the flow of `{path}` has no direction"),
            format!("found a {}, which has none of its own", emitter.shape.name()),
            "add `direction = [0, 0, -1]`; only a disc has a direction of its own, its normal",
        ),
        Some(direction) if !has_length(direction) => {
            let name = if emitter.velocity.is_some() { "velocity" } else { "direction" };
            report(
                format!("{path}.{name}"),
                format!("`{path}.{name}` has length zero, so the flow has no direction"),
                "found a vector of length zero".to_owned(),
                "give any other vector; to switch the flow off, use `on`, or `rate_keyframes` with a rate of 0",
            );
        }
        _ => {}
    }
    for (index, pair) in emitter.rate_keyframes.windows(2).enumerate() {
        if pair[1].frame <= pair[0].frame {
            report(
                format!("{path}.rate_keyframes.{}.frame", index + 1),
                format!("the rate keyframes of `{path}` do not ascend"),
                format!("found frame {} after frame {}", pair[1].frame, pair[0].frame),
                "sort the keyframes by frame, and give each frame once",
            );
        }
    }
}

/// Nozzles that cannot deliver what the preset gives them, and outflows that particles may pass.
pub(super) fn seeding_warnings(seeds: &LiquidSeeds) -> Vec<String> {
    let nozzles = seeds.nozzles.iter().enumerate();
    let nozzles = nozzles.flat_map(|(index, nozzle)| nozzle_warnings(index, nozzle, seeds.allowed_speed));
    let thin = |index: &u32| {
        format!("liquid.outflow.{index} is thinner than a spacing: fast particles pass it; make it thicker")
    };
    nozzles.chain(seeds.thin_outflows.iter().map(thin)).collect()
}

fn nozzle_warnings(index: usize, nozzle: &NozzleReport, allowed_speed: f64) -> Vec<String> {
    let name = format!("liquid.emitter.{index}");
    let NozzleReport { columns, area, outline_area, in_solids, at_wall, in_outflow, max_speed } = *nozzle;
    if columns == 0 {
        return vec![format!(
            "{name} emits nothing: its nozzle is narrower than the spacing; enlarge it, or lower liquid.spacing"
        )];
    }
    let mut warnings = Vec::new();
    let difference = area / outline_area - 1.0;
    if difference.abs() > MAX_AREA_DIFFERENCE {
        warnings.push(format!(
            "{name} has a cross-section of {} m² in {columns} particle{}, {:+.0} % of that of its shape: a `velocity` delivers as much \
             more, a `rate` is met by another speed; lower liquid.spacing",
            figure(area, 2),
            if columns == 1 { "" } else { "s" },
            100.0 * difference,
        ));
    }
    let place = |count: u32| match (count, columns) {
        (1, 1) => "its only column".to_owned(),
        _ if count == columns => "all its columns".to_owned(),
        _ => format!("{count} of its {columns} columns"),
    };
    for (count, what) in [
        (in_solids, "begins in a collider, and is not emitted; move it out of the collider"),
        (
            at_wall,
            "is directed at a collider less than a kernel's reach away, which blocks the flow; move it away",
        ),
        (in_outflow, "begins in an outflow or outside of the domain, which removes it at once"),
    ] {
        if count > 0 {
            warnings.push(format!("{name}: the liquid of {} {what}", place(count)));
        }
    }
    if max_speed > allowed_speed {
        warnings.push(format!(
            "{name} is faster ({} m/s) than liquid.cfl and liquid.max_substeps allow ({} m/s): its layers enter several at once; raise \
             liquid.max_substeps",
            figure(max_speed, 3),
            figure(allowed_speed, 3)
        ));
    }
    warnings
}

/// Particles that entered and left in a frame, for its progress line.
pub(super) fn progress(flow: &FlowRecord) -> String {
    let entered: u64 = flow.emitted.iter().sum();
    let left = flow.removed.iter().chain(&flow.left_by_side).sum::<u64>() + flow.left_by_accident;
    format!("particles {} (+{entered} -{left})", flow.present)
}

/// What kept particles from entering, and those that left by accident.
pub(super) fn warnings(flow: &FlowRecord) -> Vec<String> {
    nonzero(&[
        (flow.blocked_by_solids.iter().sum(), "particles not emitted, their place was in a solid"),
        (flow.blocked_by_liquid.iter().sum(), "particles not emitted, other particles were in their place"),
        (flow.released_early, "particles left a nozzle early, which led them into a solid"),
        (flow.left_by_accident, "particles left the domain through a side that is not open"),
    ])
}

/// The balance of particles in a frame's header; `None` without inflow and outflow.
fn balance(streams: &[StreamInfo]) -> Option<(FlowTotals, u64)> {
    let stream = streams.iter().find(|stream| stream.name == NAME)?;
    let scalar =
        |name: &str| stream.scalars.iter().find(|(key, _)| key == name).map(|&(_, value)| value as u64);
    let [a, b, c, d] = FlowTotals::NAMES.map(scalar);
    Some((FlowTotals::of([a?, b?, c?, d?]), stream.len))
}

/// The balance of particles in the last frame.
pub(super) fn totals(frames: &[CachedFrame]) -> Option<Total> {
    let (index, (totals, present)) =
        frames.iter().rev().find_map(|frame| Some((frame.index, balance(&frame.streams)?)))?;
    let sums = |get: &dyn Fn(&FlowRecord) -> u64| -> u64 {
        let records = frames.iter().filter_map(|frame| frame.record.as_ref()?.liquid.as_ref()?.flow.as_ref());
        records.map(get).sum()
    };
    let by_side: Vec<String> = Side::ALL
        .iter()
        .map(|side| (side, sums(&|flow| flow.left_by_side[side.index()])))
        .filter(|(_, count)| *count > 0)
        .map(|(side, count)| format!("{count} through {}", side.name()))
        .collect();
    let sides = if by_side.is_empty() { String::new() } else { format!(" ({})", by_side.join(", ")) };
    let FlowTotals { initial, emitted, removed, left_by_accident, .. } = totals;
    let is_balanced = (initial + emitted).checked_sub(removed + left_by_accident) == Some(present);
    let end = if is_balanced { "" } else { ", which is no balance: simulate the shot again" };
    Some(Total {
        key: "liquid_flow",
        value: json!({
            "frame": index,
            "initial": initial,
            "emitted": emitted,
            "removed": removed,
            "left_by_accident": left_by_accident,
            "present": present,
        }),
        heading: "particles",
        text: format!(
            "{initial} at the start + {emitted} emitted - {removed} removed{sides} - {left_by_accident} left by accident = {present} in \
             frame {index}{end}"
        ),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nozzles_that_cannot_deliver_are_reported() {
        let good = NozzleReport {
            columns: 9,
            area: 0.09,
            outline_area: 0.092,
            max_speed: 2.0,
            ..NozzleReport::default()
        };
        let warned = |nozzle: NozzleReport| nozzle_warnings(3, &nozzle, 4.0);
        assert_eq!(warned(good), [""; 0]);
        for (nozzle, words) in [
            (NozzleReport { columns: 0, ..good }, "liquid.emitter.3 emits nothing"),
            (NozzleReport { outline_area: 0.07, ..good }, "9 particles, +29 %"),
            (
                NozzleReport { in_solids: 9, ..good },
                "liquid.emitter.3: the liquid of all its columns begins in a collider",
            ),
            (
                NozzleReport { at_wall: 2, ..good },
                "the liquid of 2 of its 9 columns is directed at a collider",
            ),
            (NozzleReport { in_outflow: 1, ..good }, "the liquid of 1 of its 9 columns begins in an outflow"),
            (
                NozzleReport { max_speed: 4.5, ..good },
                "is faster (4.5 m/s) than liquid.cfl and liquid.max_substeps allow (4 m/s)",
            ),
        ] {
            let warnings = warned(nozzle);
            assert!(warnings.len() == 1 && warnings[0].contains(words), "{words}: {warnings:?}");
        }
    }

    #[test]
    fn a_frame_counts_what_entered_and_left_and_warns_of_accidents() {
        let flow = FlowRecord {
            emitted: vec![5, 7],
            blocked_by_solids: vec![0, 2],
            blocked_by_liquid: vec![1, 0],
            released_early: 3,
            removed: vec![4],
            left_by_side: [0, 1, 0, 0, 2, 0],
            left_by_accident: 6,
            present: 100,
            ..FlowRecord::default()
        };
        assert_eq!(progress(&flow), "particles 100 (+12 -13)");
        let warned = warnings(&flow);
        for (line, count) in warned.iter().zip(["2 ", "1 ", "3 ", "6 "]) {
            assert!(line.starts_with(count), "{line}");
        }
        assert_eq!(warned.len(), 4);
        assert_eq!(warnings(&FlowRecord::default()), [""; 0]);
    }
}
