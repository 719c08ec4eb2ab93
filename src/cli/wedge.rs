//! `meniscus wedge`.

use super::{
    args::WedgeArgs,
    output::print,
    shot::{make_outputs, quality},
    shot_inputs::is_folder,
};
use crate::{
    job::Failure,
    run::{
        self, Control, FailedFrame, RunError, ShotFolder,
        wedge::{self, Layout, MAX_FRAMES, WedgeList},
    },
    scene::{self, Scene, builtin},
};
use std::path::{Path, PathBuf};

/// Makes a wedge of a shot for every combination of settings, or compares those that are there.
pub(super) fn wedge(args: &WedgeArgs, control: Control) -> Result<(), RunError> {
    if let Some(at) = args.at.as_ref().filter(|at| at.count() > MAX_FRAMES) {
        return Err(RunError::Request(format!(
            "--at {at}: found {} frames, expected at most {MAX_FRAMES}",
            at.count()
        )));
    }
    if builtin::get(&args.preset).is_none() && is_folder(&args.preset) {
        return compare_existing(args, control);
    }
    let preset = scene::load(&args.preset)?;
    let Layout { list, scenes } = wedge::lay_out(&preset, args.quality.map(quality), &args.set)?;
    if args.prepare && args.frames.is_some() {
        return Err(RunError::Request(
            "--frames: wedges are prepared with the frames of their preset; give them to `meniscus farm`, or set `frames`".into(),
        ));
    }
    let root = args.output.clone().unwrap_or_else(|| {
        let mut name = Path::new(&preset.name).file_stem().unwrap_or("shot".as_ref()).to_owned();
        name.push("-wedges");
        PathBuf::from(name)
    });
    let shots = list.shots(&root)?;
    // All before the first runs: what is refused is known at once.
    for (scene, shot) in scenes.iter().zip(&shots).filter(|_| !args.force) {
        run::prepare(scene, shot, control)?;
    }
    ShotFolder::create(&root)?;
    list.write(&root)?;
    if args.prepare {
        print(&format!("{}: {} wedges prepared", root.display(), shots.len()));
        print(&format!("next: meniscus farm openjd|slurm|flamenco {}", root.display()));
        return Ok(());
    }
    let mut failed = Vec::new();
    for (place, (scene, shot)) in scenes.iter().zip(&shots).enumerate() {
        let wedge = &list.wedges[place];
        let label = list.label(wedge);
        control.reporter.note(&format!("wedge {} of {}: {label}", place + 1, shots.len()));
        match make(scene, shot, args, control) {
            Ok(()) => {}
            Err(
                why @ (RunError::Diverged { .. }
                | RunError::SomeFailed { .. }
                | RunError::OverMemory { .. }
                | RunError::Setup(_)),
            ) => {
                control.reporter.stop();
                let kind =
                    if matches!(why, RunError::OverMemory { .. }) { Failure::Memory } else { Failure::Other };
                failed.push(FailedFrame { name: list.numbered(place), why: why.to_string(), kind });
            }
            Err(why) => return Err(why),
        }
    }
    // Where every wedge failed there may be nothing to compare.
    match compare(&root, &list, args, control) {
        Err(RunError::Interrupted) => Err(RunError::Interrupted),
        Err(why) if failed.is_empty() => Err(why),
        Err(_) => Err(RunError::WedgesFailed { failed, all: shots.len() }),
        Ok(found) => outcome(failed, found, shots.len()),
    }
}

/// The result of wedges of which some `failed` when they were made, and some were `found` to be wrong: the gravest fault of each.
fn outcome(mut failed: Vec<FailedFrame>, found: Vec<FailedFrame>, all: usize) -> Result<(), RunError> {
    for fault in found {
        match failed.iter_mut().find(|known| known.name == fault.name) {
            Some(known) if fault.kind < known.kind => *known = fault,
            Some(_) => {}
            None => failed.push(fault),
        }
    }
    if failed.is_empty() { Ok(()) } else { Err(RunError::WedgesFailed { failed, all }) }
}

/// Simulates a wedge and writes its outputs.
fn make(scene: &Scene, shot: &ShotFolder, args: &WedgeArgs, control: Control) -> Result<(), RunError> {
    let selection = args.frames.as_ref().unwrap_or(&scene.frames);
    if let Some(allowed) = args.max_memory {
        run::refuse_over_memory(scene, selection, true, allowed, control)?;
    }
    run::simulate(scene, shot, selection, args.force, args.max_memory, control)?;
    make_outputs(scene, shot, selection, args.force, args.max_memory, control)
}

/// Compares the wedges that a folder holds.
fn compare_existing(args: &WedgeArgs, control: Control) -> Result<(), RunError> {
    let given = [
        ("--set", !args.set.is_empty()),
        ("--quality", args.quality.is_some()),
        ("--frames", args.frames.is_some()),
        ("--output", args.output.is_some()),
        ("--prepare", args.prepare),
        ("--force", args.force),
    ];
    if let Some((flag, _)) = given.iter().find(|(_, given)| *given) {
        return Err(RunError::Request(format!(
            "{flag}: {} is a folder, whose wedges are only compared; name a preset to make wedges, or leave {flag} out",
            args.preset
        )));
    }
    let root = Path::new(&args.preset);
    match WedgeList::read(root)? {
        Some(list) => outcome(Vec::new(), compare(root, &list, args, control)?, list.wedges.len()),
        None => Err(RunError::Request(format!(
            "{}: found no wedges.json and no preset; name a preset and --set KEY=A,B",
            root.display()
        ))),
    }
}

/// Draws the contact sheet, writes the tables, and returns what is wrong with wedges.
fn compare(
    root: &Path,
    list: &WedgeList,
    args: &WedgeArgs,
    control: Control,
) -> Result<Vec<FailedFrame>, RunError> {
    let rows = wedge::rows(root, list, control)?;
    let page = wedge::draw_wedges(root, list, &rows, args.at.as_ref(), args.max_memory, control)?;
    if page.outside > 0 {
        let outside = page.outside;
        control.reporter.note(&format!("{outside} particles are outside the pictures of the contact sheet"));
    }
    let tables = wedge::write(root, list, &rows)?;
    for path in [page.path].iter().chain(&tables) {
        print(&path.display().to_string());
    }
    let faults = rows.into_iter().filter_map(|row| row.fault);
    Ok(faults.chain(page.unread).collect())
}
