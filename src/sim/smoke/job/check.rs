//! Checks of a preset's smoke, once every value is valid on its own.

use crate::{
    preset::{
        check::Places,
        problem::Finding,
        shapes::{check_motion, source_finding},
    },
    sim::{
        scene::Scene,
        smoke::{MAX_TRACERS_AND_VORTONS, SmokeParams, estimate},
        vortex::{Kernel, flow::Sum, grid_errors},
    },
    solid::Shape,
};

/// Everything about the smoke that contradicts itself or cannot be simulated.
pub(super) fn check_smoke(scene: &Scene, smoke: &SmokeParams, places: &Places, findings: &mut Vec<Finding>) {
    let nothing = smoke.ring.is_empty() && smoke.tube.is_empty() && smoke.turbulence.is_none();
    if nothing && smoke.source.is_empty() && smoke.emitter.is_empty() {
        let label = "no ring, tube, turbulence, source or emitter";
        let help = "add `[[smoke.ring]]` with a center, radius, thickness and circulation, or `[[smoke.emitter]]` with a shape";
        let message = "nothing seeds or emits smoke";
        findings.push(Finding::new(places.of("smoke"), "smoke", message, label).with_help(help));
    }
    let count = estimate(smoke, scene.seconds());
    if count > MAX_TRACERS_AND_VORTONS {
        let (message, label) = (
            format!("the smoke would have about {count:.1e} tracers and vortons, more than 2³¹"),
            format!("found {} m between vortons", smoke.spacing),
        );
        let finding = Finding::new(places.of("smoke.spacing"), "smoke.spacing", message, label);
        findings
            .push(finding.with_help("make `smoke.spacing` or `smoke.tracers` larger, or the shapes smaller"));
    }
    for (index, ring) in smoke.ring.iter().enumerate() {
        direction(&ring.direction, &format!("smoke.ring.{index}.direction"), places, findings);
        if 2.0 * ring.thickness >= ring.radius {
            let key = format!("smoke.ring.{index}.thickness");
            let label =
                format!("found a thickness of {} m and a radius of {} m", ring.thickness, ring.radius);
            let message = "the ring is so thick that it closes its own hole";
            let help =
                "make `thickness` less than half of `radius`: vorticity reaches to twice the thickness";
            findings.push(Finding::new(places.of(&key), &key, message, label).with_help(help));
        }
    }
    for (index, tube) in smoke.tube.iter().enumerate() {
        let axis = [0, 1, 2].map(|axis| tube.to[axis] - tube.from[axis]);
        direction(&axis, &format!("smoke.tube.{index}.to"), places, findings);
    }
    for (path, shape) in smoke.shapes() {
        findings.extend(source_finding(&format!("smoke.{path}"), shape, places));
    }
    for (index, emitter) in smoke.emitter.iter().enumerate() {
        let path = format!("smoke.emitter.{index}");
        check_motion(&emitter.keyframes, &emitter.shape, &path, places, findings);
        if let (Some(start), Some(end)) = (emitter.start, emitter.end)
            && end <= start
        {
            let key = format!("{path}.end");
            let label = format!("found frames {start} to {end}");
            let message = format!("`{path}` ends before it gives anything off");
            let help = "give an `end` after `start`: smoke comes between the two";
            findings.push(Finding::new(places.of(&key), &key, message, label).with_help(help));
        }
    }
    check_sum(smoke, places, findings);
    check_planes(scene, places, findings);
    check_tanks(scene, places, findings);
}

/// Checks that the grid sum can keep the requested error, and that multigrid has its kernel.
fn check_sum(smoke: &SmokeParams, places: &Places, findings: &mut Vec<Finding>) {
    let flow = &smoke.flow;
    let errors = grid_errors(flow.kernel);
    if flow.sum == Sum::Grid && !errors.contains(&flow.error) {
        let key = "smoke.flow.error";
        let message =
            format!("`sum = \"grid\"` with this kernel cannot reach an error below {}", errors.start());
        let finding = Finding::new(places.of(key), key, message, format!("found {}", flow.error));
        findings.push(finding.with_help("raise `error`, or write `sum = \"tree\"`"));
    }
    if flow.sum == Sum::Multigrid && flow.kernel != Kernel::Gaussian {
        let key = "smoke.flow.sum";
        let message = "`sum = \"multigrid\"` has Gaussian cores only";
        let finding = Finding::new(places.of(key), key, message, "found another `kernel`");
        findings.push(
            finding.with_help("write `kernel = \"gaussian\"`, or `sum = \"grid\"`, which has every kernel"),
        );
    }
}

/// Checks that there is at most one plane among the colliders, and that it does not move.
fn check_planes(scene: &Scene, places: &Places, findings: &mut Vec<Finding>) {
    let planes = scene.world.collider.iter().enumerate();
    let mut planes = planes.filter(|(_, collider)| matches!(collider.shape, Shape::Plane { .. }));
    if let Some((index, collider)) = planes.next()
        && !collider.keyframes.is_empty()
    {
        let key = format!("world.collider.{index}.keyframes");
        let message = "a plane next to smoke must stand still: its mirror images do not move";
        findings.push(
            Finding::new(places.of(&key), &key, message, "found keyframes")
                .with_help("use a box with its face where the plane is"),
        );
    }
    if let Some((index, _)) = planes.next() {
        let key = format!("world.collider.{index}.shape");
        findings.push(
            Finding::new(
                places.of(&key),
                &key,
                "smoke supports one plane only, by mirror images",
                "found another plane",
            )
            .with_help("use a box with its face where the plane is"),
        );
    }
}

/// Checks that no solid changes its size by `scale` next to a tank: the air in a tank is not compressed and cannot leave.
fn check_tanks(scene: &Scene, places: &Places, findings: &mut Vec<Finding>) {
    let colliders = &scene.world.collider;
    if !colliders.iter().any(|collider| matches!(collider.shape, Shape::Tank { .. })) {
        return;
    }
    // A tank's own size is checked with its shape.
    let solids = colliders.iter().enumerate().filter(|(_, solid)| !matches!(solid.shape, Shape::Tank { .. }));
    for (index, collider) in solids {
        let Some(key) = collider.keyframes.windows(2).position(|pair| pair[0].scale != pair[1].scale) else {
            continue;
        };
        let key = format!("world.collider.{index}.keyframes.{}", key + 1);
        let message = "a solid changes its size next to smoke in a tank, whose air cannot leave";
        let finding = Finding::new(places.of(&key), &key, message, "found another `scale` than before");
        findings.push(finding.with_help("use boxes with an opening for the tank, or keep `scale` as it is"));
    }
}

fn direction(axis: &[f32; 3], key: &str, places: &Places, findings: &mut Vec<Finding>) {
    let length = axis.iter().map(|&c| f64::from(c).powi(2)).sum::<f64>().sqrt();
    if length < 1e-9 {
        let message = format!("`{key}` gives no direction");
        let finding = Finding::new(places.of(key), key, message, "a vector of length zero");
        findings.push(finding.with_help("give any other vector or point"));
    }
}
