//! `meniscus plan`.

use super::{
    args::PlanArgs,
    output::{counts, print},
    shot::quality,
};
use crate::{
    job::{Total, usage::duration},
    run::{self, Control, Plan, RunError},
    scene::{self, Overrides, Scene},
    sim::{ProductForecast, SystemForecast},
};

/// Forecasts what a shot will need.
pub(super) fn plan(args: &PlanArgs, control: Control) -> Result<(), RunError> {
    let preset = scene::load(&args.preset)?;
    let overrides = Overrides { quality: args.quality.map(quality), set: args.set.clone() };
    let scene = Scene::from_preset(&preset, &overrides)?;
    let selection = args.frames.clone().unwrap_or_else(|| scene.frames.clone());
    let plan = run::plan(&scene, &selection, args.max_memory, control)?;
    if args.json {
        print(&serde_json::to_string_pretty(&plan).expect("a plan is plain data"));
    } else {
        print(&describe(&plan, scene.fps));
    }
    Ok(())
}

/// The plan as a table.
fn describe(plan: &Plan, fps: f32) -> String {
    let mib = |bytes: f64| format!("{:.0} MiB", bytes / f64::from(1 << 20));
    let mut lines = vec![plan.title.clone()];
    let mut row = |name: &str, text: String| lines.push(format!("{name:<11} {text}"));
    row("frames", format!("{} at {fps} fps: {} stored", plan.frames, plan.frames_stored));
    for system in &plan.systems {
        row(system.name, counts(&system.counts));
    }
    row("runs", plan.passes.join(", "));
    if !plan.absent.is_empty() {
        row("does not", format!("{} (not in the preset)", plan.absent.join(", ")));
    }
    let frames = plan.frames_simulated.max(1) as f64;
    for SystemForecast { name, substeps, iterations, .. } in &plan.systems {
        let iterations = match iterations / frames {
            0.0 => String::new(),
            each => format!(" and {each:.1} iterations"),
        };
        if *substeps > 0.0 {
            row("work", format!("{name}: about {:.1} substeps{iterations} a frame", substeps / frames));
        }
    }
    for Total { heading, text, .. } in plan.systems.iter().flat_map(|system| &system.totals) {
        row(heading, text.clone());
    }
    if plan.products.is_empty() {
        row("products", "none: [output] requests none".into());
    }
    row("memory", format!("about {}", mib(plan.memory as f64)));
    let mut disk = format!("about {}: cache {}", mib(plan.disk), mib(plan.cache));
    let simulation: f64 = plan.systems.iter().map(|system| system.seconds).sum();
    let mut time = format!(
        "about {} (± {:.0} %) on {} threads: simulation {}",
        duration(plan.seconds),
        100.0 * plan.uncertainty,
        plan.threads,
        duration(simulation)
    );
    for ProductForecast { name, bytes, seconds, .. } in &plan.products {
        disk += &format!(", {name} {}", mib(*bytes));
        time += &format!(", {name} {}", duration(*seconds));
    }
    row("disk", disk);
    row("time", time);
    row(
        "calibrated",
        format!("in {}, on this machine, as busy as it is now", duration(plan.calibration_seconds)),
    );
    for remark in &plan.remarks {
        row("note", remark.clone());
    }
    lines.join("\n")
}
