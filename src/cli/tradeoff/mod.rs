//! `meniscus tradeoff`.

mod product;
mod text;

use super::{args::TradeoffArgs, output::print, shot::quality};
use crate::{
    frame::FrameIndex,
    job::{Control, RunError, ShotFolder},
    run::tradeoff::{
        Origin, Request, RunJobs, Runs, Subject, Sweep, Table, TradeoffJob, subjects, systems, write,
    },
    scene::{self, Frames, Overrides, Scene},
};
use std::path::{Path, PathBuf};

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
    let by = criterion(args, subject)?;
    if args.dry_run {
        let runs = format!("frames {frames}: {} runs", sweep.rows.len() + 2);
        return dry_run(&sweep, &runs, |scene| format!("  ({})", (system.size)(scene)));
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

/// The tier and settings that all runs share.
fn base(args: &TradeoffArgs) -> Overrides {
    Overrides { quality: args.quality.map(quality), set: args.set.clone() }
}

/// The requested runs.
fn request(args: &TradeoffArgs) -> Request {
    Request {
        base: base(args),
        vary: args.vary.clone(),
        reference: args.reference.clone(),
        tiers: args.tiers,
    }
}

fn job<'a>(args: &TradeoffArgs, frames: &'a Frames, folder: &'a Path, by: &'static str) -> TradeoffJob<'a> {
    TradeoffJob { frames, folder, repeats: args.repeats.get() as usize, by, jobs: &RunJobs }
}

/// The criterion of `--by`, which has to be one of the subject's.
fn criterion(args: &TradeoffArgs, subject: &Subject) -> Result<&'static str, RunError> {
    let Some(name) = args.by.as_deref() else { return Ok(subject.wording.criterion) };
    let criteria = |subject: &Subject| (subject.columns)().into_iter().filter_map(|info| info.criterion);
    criteria(subject).find(|known| *known == name).ok_or_else(|| {
        let others = subjects().filter(|other| criteria(other).any(|known| known == name));
        let others: Vec<String> = others.map(|other| format!("--of {}", other.name)).collect();
        RunError::Request(format!(
            "--by {name}: expected {} for {}; {name} is for {}",
            criteria(subject).collect::<Vec<_>>().join(", "),
            subject.name,
            others.join(" and ")
        ))
    })
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

/// Lists the runs; `size` describes how large a scene is.
fn dry_run(sweep: &Sweep, runs: &str, size: impl Fn(&Scene) -> String) -> Result<(), RunError> {
    print(&format!("{}, {runs}", sweep.base.title))?;
    for (setting, scene) in [&sweep.reference, &sweep.refined] {
        print(&format!("     {}: {}{}", setting.label, setting.set.join(" "), size(scene)))?;
    }
    for (place, (setting, scene)) in sweep.rows.iter().enumerate() {
        print(&format!("{:>3}  {}{}", place + 1, setting.label, size(scene)))?;
    }
    Ok(())
}

/// The folder of runs, table and plot, by default named after what is compared.
fn output(args: &TradeoffArgs, name: &str) -> PathBuf {
    let stem = Path::new(name).file_stem().map_or("shot".into(), |stem| stem.to_string_lossy());
    args.output.clone().unwrap_or_else(|| PathBuf::from(format!("{stem}-tradeoff")))
}

/// That folder, without the rows of earlier runs if everything is to run again. Refuses to write over a preset.
fn folder(args: &TradeoffArgs, name: &str) -> Result<PathBuf, RunError> {
    if let Some(path) = args.write.as_deref().filter(|path| path.exists()) {
        return Err(already_there(path));
    }
    let folder = output(args, name);
    let rows = folder.join("rows");
    if args.force && rows.exists() {
        let next = "check that the folder can be written";
        std::fs::remove_dir_all(&rows).map_err(|source| RunError::File { path: rows, source, next })?;
    }
    Ok(folder)
}

/// Prints the table, writes the files, and names the setting to use, as flags of `command`.
fn conclude(
    args: &TradeoffArgs,
    sweep: &Sweep,
    table: &Table,
    folder: &Path,
    command: &str,
) -> Result<(), RunError> {
    let files = write(table, folder)?;
    if args.json {
        print(&serde_json::to_string_pretty(&table.json()).expect("a table is plain data"))?;
    } else {
        print(&text::describe(table))?;
        print(&format!("\nwritten     {}", files.map(|path| path.display().to_string()).join(", ")))?;
    }
    let chosen = table.choose(args.time, args.dev)?;
    if let Some(place) = chosen.filter(|_| !args.json) {
        print(&text::advice(table, place, args, command))?;
    }
    let Some(path) = &args.write else { return Ok(()) };
    let place = chosen.ok_or_else(|| {
        let no_knee =
            "--write: the table has no knee, so no setting stands out; name a limit with --time or --dev";
        RunError::Request(no_knee.into())
    })?;
    if path.exists() {
        return Err(already_there(path));
    }
    let comment = text::comment(table, place);
    ShotFolder::write(path.into(), &format!("{comment}\n\n{}", sweep.rows[place].1.to_toml()))?;
    if args.json { Ok(()) } else { print(&format!("preset      {}", path.display())) }
}

fn already_there(path: &Path) -> RunError {
    RunError::File {
        path: path.into(),
        source: std::io::ErrorKind::AlreadyExists.into(),
        next: "name a file that does not exist yet",
    }
}
