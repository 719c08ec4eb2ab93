//! `meniscus plan`.

use super::{args::PlanArgs, output::print, shot::quality};
use crate::{
    job::usage::duration,
    run::{self, Control, Plan, RunError},
    scene::{self, Overrides, Scene},
};

/// Tells what a shot will need.
pub(super) fn plan(args: &PlanArgs, control: Control) -> Result<(), RunError> {
    let preset = scene::load(&args.preset)?;
    let overrides = Overrides { quality: args.quality.map(quality), set: args.set.clone() };
    let scene = Scene::from_preset(&preset, &overrides)?;
    let selection = args.frames.clone().unwrap_or_else(|| scene.frames.clone());
    let plan = run::plan(&scene, &selection, args.max_memory, control)?;
    if args.json {
        print(&serde_json::to_string_pretty(&plan).expect("a plan is plain data"))
    } else {
        print(&describe(&plan, scene.fps))
    }
}

/// What people read.
fn describe(plan: &Plan, fps: f32) -> String {
    let mib = |bytes: f64| format!("{:.0} MiB", bytes / f64::from(1 << 20));
    let mut lines = vec![plan.title.clone()];
    let mut row = |name: &str, text: String| lines.push(format!("{name:<11} {text}"));
    row("frames", format!("{} at {fps} fps: {} stored", plan.frames, plan.frames_stored));
    if plan.particles > 0 {
        row("particles", plan.particles.to_string());
    }
    if let Some(smoke) = &plan.smoke {
        let [from, to] = smoke.vortons;
        row("vortons", format!("{from:.0} at the start, about {to:.0} at the end"));
        let [from, to] = smoke.tracers;
        row("tracers", format!("{from:.0} at the start, about {to:.0} at the end"));
    }
    if let Some(sheets) = &plan.sheets {
        row("points", format!("{:.0}, of sheets", sheets.points));
    }
    row("runs", plan.passes.join(", "));
    if !plan.absent.is_empty() {
        row("does not", format!("{} (not in the preset)", plan.absent.join(", ")));
    }
    let frames = plan.frames_simulated.max(1) as f64;
    if plan.particles > 0 {
        let (substeps, iterations) = (plan.substeps / frames, plan.iterations / frames);
        row("work", format!("about {substeps:.1} substeps and {iterations:.1} iterations a frame"));
    }
    if let Some(smoke) = &plan.smoke {
        row("work", format!("about {:.1} steps of the smoke a frame", smoke.substeps / frames));
    }
    if let Some(sheets) = &plan.sheets {
        let (substeps, iterations) = (sheets.substeps / frames, sheets.iterations / frames);
        row(
            "work",
            format!("about {substeps:.1} substeps of the sheets and {iterations:.1} iterations a frame"),
        );
    }
    match plan.voxel {
        _ if plan.particles == 0 => {}
        Some(voxel) => row(
            "surface",
            format!("cells of {:.1} mm, about {:.0} bricks of 8×8×8 at most", 1000.0 * voxel, plan.bricks),
        ),
        None => row("surface", "none: [output] names no mesh".into()),
    }
    row("memory", format!("about {}", mib(plan.memory as f64)));
    let volumes = plan.smoke.as_ref().map_or([0.0; 2], |smoke| [smoke.volumes, smoke.seconds[1]]);
    let files = plan.sheets.as_ref().map_or(0.0, |sheets| sheets.files);
    let mut disk = format!(
        "about {}: cache {}, meshes {}",
        mib(plan.cache + plan.meshes + volumes[0] + files),
        mib(plan.cache),
        mib(plan.meshes)
    );
    let mut time = format!(
        "about {} (± {:.0} %) on {} threads: simulation {}, surfaces {}",
        duration(plan.seconds),
        100.0 * plan.uncertainty,
        plan.threads,
        duration(plan.seconds - plan.surface_seconds - volumes[1]),
        duration(plan.surface_seconds)
    );
    if volumes[0] > 0.0 {
        disk += &format!(", volumes of the smoke {}", mib(volumes[0]));
        time += &format!(", volumes of the smoke {}", duration(volumes[1]));
    }
    if files > 0.0 {
        disk += &format!(", sheets {}", mib(files));
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
