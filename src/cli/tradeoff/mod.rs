//! `meniscus tradeoff`.

mod comparison;
mod product;
mod text;

use super::args::TradeoffArgs;
use crate::{
    frame::FrameIndex,
    job::{Control, RunError},
    run::tradeoff::{Origin, Runs, Subject, subjects, systems},
    scene::{self, Frames, Scene},
};
use comparison::{base, conclude, criterion, dry_run, folder, job, request};
use std::path::Path;

/// Compares settings on the user's own shot.
pub(super) fn tradeoff(args: &TradeoffArgs, control: Control) -> Result<(), RunError> {
    let named = subjects().find(|subject| args.of.as_deref() == Some(subject.name));
    match named.map(|subject| (subject, &subject.runs)) {
        Some((subject, Runs::Product(product))) => product::tradeoff(args, subject, product, control),
        _ => simulations(args, named, control),
    }
}

/// Compares simulations of a system: the named one, or the first that the preset has.
fn simulations(args: &TradeoffArgs, named: Option<&Subject>, control: Control) -> Result<(), RunError> {
    let name = preset_name(args)?;
    let preset = scene::load(name)?;
    let scene = Scene::from_preset(&preset, &base(args))?;
    let found = systems(&scene).find(|subject| named.is_none_or(|named| named.name == subject.name));
    let Some(subject @ Subject { runs: Runs::System(system), .. }) = found else {
        let name = named.map_or("system", |subject| subject.name);
        return Err(RunError::Request(format!(
            "--of {name}: found no {name} in {}; leave it out to compare what the preset has",
            preset.name
        )));
    };
    let sweep = request(args).sweep(subject, Origin::Preset(&preset))?;
    let frames = frames(args, &sweep.base)?;
    let by = criterion(args, subject, Some(&sweep.base))?;
    if args.dry_run {
        let runs = format!("frames {frames}: {} runs", sweep.rows.len() + 2);
        dry_run(&sweep, &runs, |scene| format!("  ({})", (system.size)(scene)));
        return Ok(());
    }
    let folder = folder(args, &preset.name)?;
    let job = job(args, &frames, &folder, by);
    let table = (system.run)(&sweep, &job, control)?;
    conclude(args, &sweep, &table, &folder, &format!("shot {name}"))
}

/// The one preset that was named.
fn preset_name(args: &TradeoffArgs) -> Result<&String, RunError> {
    let for_products = [("--spacing", args.spacing.is_some()), ("--max-memory", args.max_memory.is_some())];
    if let Some((flag, _)) = for_products.iter().find(|(_, given)| *given) {
        return Err(RunError::Request(format!(
            "{flag}: found no {} that it is for; add it or leave it out",
            product_flags()
        )));
    }
    let add = format!("add {} to compare what is made of particles", product_flags());
    match &args.inputs[..] {
        [folder] if Path::new(folder).is_dir() && scene::builtin::get(folder).is_none() => {
            Err(RunError::Request(format!("{folder}: found a folder, expected a preset; {add}")))
        }
        [preset] => Ok(preset),
        several => {
            Err(RunError::Request(format!("found {} inputs, expected one preset; {add}", several.len())))
        }
    }
}

/// The flags that compare what is made of particles.
fn product_flags() -> String {
    let products = subjects().filter(|subject| matches!(subject.runs, Runs::Product(_)));
    products.map(|subject| format!("--of {}", subject.name)).collect::<Vec<_>>().join(" or ")
}

/// The frames to compare: those named, or one second, or what the shot has.
fn frames(args: &TradeoffArgs, scene: &Scene) -> Result<Frames, RunError> {
    let first = scene.frames.first();
    let second = first.0.saturating_add(scene.fps.ceil() as u32 - 1).max(first.0 + 1);
    let last = scene.frames.last().0.min(second);
    let frames = match &args.frames {
        Some(frames) => frames.clone(),
        None => Frames::from_first_to_last(first, FrameIndex(last)).expect("a second has frames"),
    };
    if frames.first() < first || frames.last() <= first {
        return Err(RunError::Request(format!(
            "--frames {frames}: expected frames from the first, {first}, on, and some after it, such as 1-24"
        )));
    }
    Ok(frames)
}
