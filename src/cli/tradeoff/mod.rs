//! `meniscus tradeoff`.

mod liquid;
mod smoke;
mod surface;

use super::{
    args::{Judge, TradeoffArgs},
    print,
    shot::quality,
};
use crate::{
    frame::FrameIndex,
    run::{
        Control, RunError, ShotFolder,
        tradeoff::{Request, Spread, Sweep},
    },
    scene::{self, Frames, Overrides, Scene},
};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Compares settings on the user's own shot.
pub(super) fn tradeoff(args: &TradeoffArgs, control: Control) -> Result<(), RunError> {
    if args.surface {
        return surface::tradeoff(args, control);
    }
    let name = preset_name(args)?;
    let preset = scene::load(name)?;
    let base = Overrides { quality: args.quality.map(quality), set: args.set.clone() };
    let scene = Scene::from_preset(&preset, &base)?;
    match (args.smoke, &scene.liquid, &scene.smoke) {
        (true, _, None) => Err(RunError::Request(format!(
            "--smoke: found no smoke in {}; leave it out to compare the liquid",
            preset.name
        ))),
        (true, ..) | (_, None, Some(_)) => smoke::tradeoff(args, name, &preset, base, control),
        _ => liquid::tradeoff(args, name, &preset, base, control),
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

/// Lists the runs of a simulation; `spacing` tells that of a scene [m].
fn dry_run(sweep: &Sweep, selection: &Frames, spacing: impl Fn(&Scene) -> f32) -> Result<(), RunError> {
    print(&format!("{}, frames {selection}: {} runs", sweep.base.title, sweep.rows.len() + 2))?;
    references(sweep).iter().try_for_each(|line| print(line))?;
    for (place, (setting, scene)) in sweep.rows.iter().enumerate() {
        print(&format!("{:>3}  {}  (spacing {} m)", place + 1, setting.label, spacing(scene)))?;
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

/// A finished table, whatever it compares, and how it is told.
trait Tell: Serialize {
    /// What people read: a line a setting, then how to read it.
    fn describe(&self) -> String;
    /// Writes it to the folder as files.
    fn write(&self, folder: &Path) -> Result<[PathBuf; 3], RunError>;
    /// The setting to use; see the tables.
    fn choose(&self, time: Option<f64>, dev: Option<f64>) -> Result<Option<usize>, RunError>;
    /// Where a preset of the setting at `place` comes from, as its first lines.
    fn comment(&self, place: usize) -> String;
}

/// Tells the table, writes the files, and names the setting to use; `advice` says how.
fn conclude(
    args: &TradeoffArgs,
    sweep: &Sweep,
    table: &impl Tell,
    folder: &Path,
    advice: impl Fn(usize) -> String,
) -> Result<(), RunError> {
    let files = table.write(folder)?;
    if args.json {
        print(&serde_json::to_string_pretty(table).expect("a table is plain data"))?;
    } else {
        print(&table.describe())?;
        print(&format!("\nwritten     {}", files.map(|path| path.display().to_string()).join(", ")))?;
    }
    let chosen = table.choose(args.time, args.dev)?;
    if let Some(place) = chosen.filter(|_| !args.json) {
        print(&advice(place))?;
    }
    let Some(path) = &args.write else { return Ok(()) };
    let place = chosen.ok_or_else(no_knee)?;
    write_preset(path, &table.comment(place), &sweep.rows[place].1.to_toml())?;
    if args.json { Ok(()) } else { print(&format!("preset      {}", path.display())) }
}

/// A table to look at: below its head the settings, and the reference.
fn drawn(head: &[&str], rows: Vec<(&'static str, Vec<String>)>) -> String {
    let head = head.iter().map(|&name| name.to_owned()).collect();
    aligned(&[head].into_iter().chain(rows.into_iter().map(|(_, cells)| cells)).collect::<Vec<_>>())
}

/// The median of times [s], and their range if settings were `repeated`.
fn seconds(spread: &Spread, repeated: bool, digits: usize) -> String {
    let Spread { median, min, max } = spread;
    match repeated {
        true => format!("{median:.digits$} ({min:.digits$}-{max:.digits$})"),
        false => format!("{median:.digits$}"),
    }
}

/// Columns under each other: the setting to the left, figures to the right.
fn aligned(rows: &[Vec<String>]) -> String {
    let count = rows.first().map_or(0, Vec::len);
    let width = |column: usize| rows.iter().map(|row| row[column].chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = (0..count).map(width).collect();
    let line = |row: &Vec<String>| {
        let cells = row.iter().zip(&widths).enumerate().map(|(column, (cell, &width))| {
            if column == 1 || column + 1 == count {
                format!("{cell:<width$}")
            } else {
                format!("{cell:>width$}")
            }
        });
        cells.collect::<Vec<_>>().join("  ").trim_end().to_owned() + "\n"
    };
    rows.iter().map(line).collect()
}

/// A value in words; a dash where there is none.
fn maybe(value: Option<f64>, say: &dyn Fn(f64) -> String) -> String {
    value.map_or_else(|| "-".into(), say)
}

/// An error in words, as far as the reference can tell: what is below `floor` shows as ≤.
fn at_least(value: Option<f64>, floor: Option<f64>, say: &dyn Fn(f64) -> String) -> String {
    match (value, floor) {
        (Some(value), Some(floor)) if value < floor => format!("≤ {}", say(floor)),
        (value, _) => maybe(value, say),
    }
}

fn percent(fraction: f64) -> String {
    format!("{} %", short(100.0 * fraction))
}

/// Two significant digits: what a table of errors is good for.
fn short(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return value.to_string();
    }
    let digits = (1 - value.abs().log10().floor() as i32).clamp(0, 9) as usize;
    format!("{value:.digits$}")
}

/// A setting as arguments.
fn flags(quality: Option<&String>, set: &[String]) -> String {
    let flags: Vec<String> = quality
        .iter()
        .map(|tier| format!("--quality {tier}"))
        .chain(set.iter().map(|set| format!("--set {}", for_a_shell(set))))
        .collect();
    if flags.is_empty() { "(as written)".into() } else { flags.join(" ") }
}

/// An argument that shells hand on as it is.
fn for_a_shell(text: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "._=%+-/".contains(c);
    if text.chars().all(plain) { text.into() } else { format!("'{}'", text.replace('\'', "'\\''")) }
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

fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

fn already_there(path: &Path) -> RunError {
    RunError::File {
        path: path.into(),
        source: std::io::ErrorKind::AlreadyExists.into(),
        next: "name a file that does not exist yet",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arguments_survive_a_shell() {
        assert_eq!(for_a_shell("liquid.density_dev=0.3%"), "liquid.density_dev=0.3%");
        assert_eq!(for_a_shell("a=[0, 1]"), "'a=[0, 1]'");
        assert_eq!(for_a_shell("a=it's"), r"'a=it'\''s'");
    }

    #[test]
    fn columns_stand_under_each_other() {
        let rows = [["", "setting", "s"], ["1", "a", "10"]].map(|row| row.map(String::from).to_vec());
        assert_eq!(aligned(&rows), "   setting  s\n1  a        10\n");
        assert_eq!([0.0, 0.01234, 1.26, 130.0].map(short), ["0", "0.012", "1.3", "130"]);
    }
}
