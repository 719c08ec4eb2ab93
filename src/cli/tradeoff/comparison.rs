//! What the arguments of `meniscus tradeoff` mean for a comparison of any subject, and its output.

use super::text;
use crate::{
    cli::{args::TradeoffArgs, output::print, shot::quality},
    job::{RunError, ShotFolder},
    run::tradeoff::{Request, RunJobs, Subject, Sweep, Table, TradeoffJob, subjects, write},
    scene::{Frames, Overrides, Scene},
};
use std::path::{Path, PathBuf};

/// The tier and settings that all runs share.
pub(super) fn base(args: &TradeoffArgs) -> Overrides {
    Overrides { quality: args.quality.map(quality), set: args.set.clone() }
}

/// The requested runs.
pub(super) fn request(args: &TradeoffArgs) -> Request {
    Request {
        base: base(args),
        vary: args.vary.clone(),
        reference: args.reference.clone(),
        tiers: args.tiers,
    }
}

pub(super) fn job<'a>(
    args: &TradeoffArgs,
    frames: &'a Frames,
    folder: &'a Path,
    by: &'static str,
) -> TradeoffJob<'a> {
    TradeoffJob { frames, folder, repeats: args.repeats.get() as usize, by, jobs: &RunJobs }
}

/// The criterion of what a preset's `[tradeoff]` names.
const OBSERVABLE: &str = "observable";

/// The criterion of `--by`, which has to be one of the subject's; by default that of the preset's own `[tradeoff]`.
pub(super) fn criterion(
    args: &TradeoffArgs,
    subject: &Subject,
    scene: Option<&Scene>,
) -> Result<&'static str, RunError> {
    let criteria = |subject: &Subject| (subject.columns)().into_iter().filter_map(|info| info.criterion);
    let Some(name) = args.by.as_deref() else {
        let named = scene.and_then(|scene| scene.tradeoff.as_ref()).map(|_| OBSERVABLE);
        let own = criteria(subject).find(|known| Some(*known) == named);
        return Ok(own.unwrap_or(subject.wording.criterion));
    };
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

/// Lists the runs; `size` describes how large a scene is.
pub(super) fn dry_run(sweep: &Sweep, runs: &str, size: impl Fn(&Scene) -> String) {
    print(&format!("{}, {runs}", sweep.base.title));
    for (setting, scene) in [&sweep.reference, &sweep.refined] {
        print(&format!("     {}: {}{}", setting.label, setting.set.join(" "), size(scene)));
    }
    for (place, (setting, scene)) in sweep.rows.iter().enumerate() {
        print(&format!("{:>3}  {}{}", place + 1, setting.label, size(scene)));
    }
}

/// The folder of runs, table and plot, by default named after what is compared.
pub(super) fn output(args: &TradeoffArgs, name: &str) -> PathBuf {
    let stem = Path::new(name).file_stem().map_or("shot".into(), |stem| stem.to_string_lossy());
    args.output.clone().unwrap_or_else(|| PathBuf::from(format!("{stem}-tradeoff")))
}

/// That folder, without the rows of earlier runs if everything is to run again. Refuses to write over a preset.
pub(super) fn folder(args: &TradeoffArgs, name: &str) -> Result<PathBuf, RunError> {
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
pub(super) fn conclude(
    args: &TradeoffArgs,
    sweep: &Sweep,
    table: &Table,
    folder: &Path,
    command: &str,
) -> Result<(), RunError> {
    let files = write(table, folder)?;
    if args.json {
        print(&serde_json::to_string_pretty(&table.json()).expect("a table is plain data"));
    } else {
        print(&text::describe(table));
        print(&format!("\nwritten     {}", files.map(|path| path.display().to_string()).join(", ")));
    }
    let chosen = table.choose(args.time, args.dev)?;
    if let Some(place) = chosen.filter(|_| !args.json) {
        print(&text::advice(table, place, args, command));
    }
    if let Some(why) = text::no_advice(table).filter(|_| !args.json) {
        print(&why);
    }
    let Some(path) = &args.write else { return Ok(()) };
    let place = chosen.ok_or_else(|| {
        let why = if table.are_all_outside() {
            "every setting is out of the bounds of the table; vary what causes it"
        } else {
            "the table has no knee, so no setting stands out; name a limit with --time or --dev"
        };
        RunError::Request(format!("--write: {why}"))
    })?;
    if path.exists() {
        return Err(already_there(path));
    }
    let comment = text::comment(table, place);
    ShotFolder::write(path.into(), &format!("{comment}\n\n{}", sweep.rows[place].1.to_toml()))?;
    if !args.json {
        print(&format!("preset      {}", path.display()));
    }
    Ok(())
}

/// Refuses a file that exists.
fn already_there(path: &Path) -> RunError {
    RunError::File {
        path: path.into(),
        source: std::io::ErrorKind::AlreadyExists.into(),
        next: "name a file that does not exist yet",
    }
}
