//! `meniscus tradeoff`.

mod liquid;
mod sheet;
mod smoke;
mod surface;
mod tell;

use super::{
    args::{Judge, TradeoffArgs},
    output::print,
    shot::quality,
};
use crate::{
    frame::FrameIndex,
    run::{
        Control, RunError, ShotFolder,
        tradeoff::{Request, Sweep, Table},
    },
    scene::{self, Frames, Overrides, Scene},
};
use std::path::{Path, PathBuf};
use tell::{Tell, advice, comment, describe};

/// Compares settings on the user's own shot.
pub(super) fn tradeoff(args: &TradeoffArgs, control: Control) -> Result<(), RunError> {
    if args.surface {
        return surface::tradeoff(args, control);
    }
    let name = preset_name(args)?;
    let preset = scene::load(name)?;
    let base = Overrides { quality: args.quality.map(quality), set: args.set.clone() };
    let scene = Scene::from_preset(&preset, &base)?;
    let (liquid, smoke, sheets) = (scene.liquid.is_some(), scene.smoke.is_some(), !scene.sheet.is_empty());
    let asked = [("--smoke", args.smoke, smoke, "smoke"), ("--sheet", args.sheet, sheets, "sheet")];
    if let Some((flag, .., what)) = asked.iter().find(|(_, asked, there, _)| *asked && !there) {
        let other = if liquid { "liquid" } else { "simulation" };
        return Err(RunError::Request(format!(
            "{flag}: found no {what} in {}; leave it out to compare the {other}",
            preset.name
        )));
    }
    // What was asked for, or the first that is there.
    if args.sheet || (sheets && !args.smoke && !liquid && !smoke) {
        sheet::tradeoff(args, name, &preset, base, control)
    } else if args.smoke || (smoke && !liquid) {
        smoke::tradeoff(args, name, &preset, base, control)
    } else {
        liquid::tradeoff(args, name, &preset, base, control)
    }
}

/// The one preset that was named.
fn preset_name(args: &TradeoffArgs) -> Result<&String, RunError> {
    let for_surfaces = [("--spacing", args.spacing.is_some()), ("--max-memory", args.max_memory.is_some())];
    if let Some((flag, _)) = for_surfaces.iter().find(|(_, given)| *given) {
        return Err(RunError::Request(format!(
            "{flag}: found no --surface, which it is for; add it or leave it out"
        )));
    }
    match &args.inputs[..] {
        [folder] if Path::new(folder).is_dir() && scene::builtin::get(folder).is_none() => {
            Err(RunError::Request(format!(
                "{folder}: found a folder, expected a preset; add --surface to compare surfaces of the particles in it"
            )))
        }
        [preset] => Ok(preset),
        several => Err(RunError::Request(format!(
            "found {} inputs, expected one preset; add --surface to compare surfaces of particle files",
            several.len()
        ))),
    }
}

/// The runs that were asked for.
fn request(args: &TradeoffArgs, base: Overrides) -> Request {
    Request { base, vary: args.vary.clone(), reference: args.reference.clone(), tiers: args.tiers }
}

/// The frames to compare: those named, or one second, or what the shot has.
fn frames(args: &TradeoffArgs, scene: &Scene) -> Result<Frames, RunError> {
    let first = scene.frames.first();
    let second = first.0.saturating_add(scene.fps.ceil() as u32 - 1).max(first.0 + 1);
    let last = scene.frames.last().0.min(second);
    let selection = match &args.frames {
        Some(frames) => frames.clone(),
        None => Frames::from_first_to_last(first, FrameIndex(last)).expect("a second has frames"),
    };
    if selection.last() <= first {
        return Err(RunError::Request(format!(
            "--frames {selection}: found no frame after the first, {first}; expected some to compare, such as 1-24"
        )));
    }
    Ok(selection)
}

/// Lists the runs of a simulation; `size` tells how fine a scene is.
fn dry_run(sweep: &Sweep, selection: &Frames, size: impl Fn(&Scene) -> String) -> Result<(), RunError> {
    print(&format!("{}, frames {selection}: {} runs", sweep.base.title, sweep.rows.len() + 2))?;
    references(sweep).iter().try_for_each(|line| print(line))?;
    for (place, (setting, scene)) in sweep.rows.iter().enumerate() {
        print(&format!("{:>3}  {}  ({})", place + 1, setting.label, size(scene)))?;
    }
    Ok(())
}

/// The folder of runs, table and plot; by default named after what is compared.
fn folder(args: &TradeoffArgs, name: &str) -> PathBuf {
    args.output.clone().unwrap_or_else(|| PathBuf::from(format!("{}-tradeoff", stem(name))))
}

fn stem(name: &str) -> String {
    Path::new(name).file_stem().map_or_else(|| "shot".into(), |stem| stem.to_string_lossy().into_owned())
}

/// Refuses to write over a preset, before anything runs.
fn refuse_to_replace(args: &TradeoffArgs) -> Result<(), RunError> {
    match args.write.as_deref().filter(|path| path.exists()) {
        Some(path) => Err(already_there(path)),
        None => Ok(()),
    }
}

/// Refuses an error that the table does not have.
fn not_judged(judge: Judge, expected: &str) -> RunError {
    use clap::ValueEnum;
    let name = judge.to_possible_value().map_or_else(String::new, |value| value.get_name().to_owned());
    RunError::Request(format!("--by {name}: expected {expected}"))
}

/// Forgets the rows of earlier runs.
fn start_over(folder: &Path) -> Result<(), RunError> {
    let rows = folder.join("rows");
    match std::fs::remove_dir_all(&rows) {
        Err(source) if source.kind() != std::io::ErrorKind::NotFound => {
            Err(RunError::File { path: rows, source, next: "check that the folder can be written" })
        }
        _ => Ok(()),
    }
}

/// What makes the references, as `--set` takes it.
fn references(sweep: &Sweep) -> Vec<String> {
    let named = [&sweep.reference.0, &sweep.refined.0];
    named.map(|setting| format!("     {}: {}", setting.label, setting.overrides.set.join(" "))).to_vec()
}

/// Tells the table, writes the files, and names the setting to use, as a flag of `command`.
fn conclude<C: Tell>(
    args: &TradeoffArgs,
    sweep: &Sweep,
    table: &Table<C>,
    folder: &Path,
    command: &str,
) -> Result<(), RunError> {
    let files = C::write(table, folder)?;
    if args.json {
        print(&serde_json::to_string_pretty(table).expect("a table is plain data"))?;
    } else {
        print(&describe(table))?;
        print(&format!("\nwritten     {}", files.map(|path| path.display().to_string()).join(", ")))?;
    }
    let chosen = table.choose(args.time, args.dev)?;
    if let Some(place) = chosen.filter(|_| !args.json) {
        print(&advice(table, place, args, command))?;
    }
    let Some(path) = &args.write else { return Ok(()) };
    let place = chosen.ok_or_else(no_knee)?;
    write_preset(path, &comment(table, place), &sweep.rows[place].1.to_toml())?;
    if args.json { Ok(()) } else { print(&format!("preset      {}", path.display())) }
}

/// Writes the chosen setting as a preset of its own, below lines that say where it comes from.
fn write_preset(path: &Path, comment: &str, preset: &str) -> Result<(), RunError> {
    if path.exists() {
        return Err(already_there(path));
    }
    ShotFolder::write(path.into(), &format!("{comment}\n\n{preset}"))
}

fn no_knee() -> RunError {
    RunError::Request(
        "--write: the table has no knee, so no setting stands out; name a limit with --time or --dev".into(),
    )
}

fn already_there(path: &Path) -> RunError {
    RunError::File {
        path: path.into(),
        source: std::io::ErrorKind::AlreadyExists.into(),
        next: "name a file that does not exist yet",
    }
}
