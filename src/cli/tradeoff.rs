//! `meniscus tradeoff`.

use super::{
    args::{Judge, TradeoffArgs},
    plan::duration,
    print,
    shot::quality,
};
use crate::{
    run::{
        Control, RunError, ShotFolder,
        tradeoff::{self, By, Line, Request, Sweep, Table},
    },
    scene::{self, Frames, Overrides, Scene},
};
use std::path::{Path, PathBuf};

/// Compares settings on the user's own shot.
pub(super) fn tradeoff(args: &TradeoffArgs, control: Control) -> Result<(), RunError> {
    let preset = scene::load(&args.preset)?;
    let base = Overrides { quality: args.quality.map(quality), set: args.set.clone() };
    let request =
        Request { base, vary: args.vary.clone(), reference: args.reference.clone(), tiers: args.tiers };
    let sweep = request.sweep(&preset)?;
    let selection = match &args.frames {
        Some(frames) => frames.clone(),
        None => first_frames(&sweep.base),
    };
    if selection.last() <= sweep.base.frames.first() {
        return Err(RunError::Request(format!(
            "--frames {selection}: found no frame after the first, {}; expected some to compare, such as 1-24",
            sweep.base.frames.first()
        )));
    }
    if args.dry_run {
        return dry_run(&sweep, &selection);
    }
    if let Some(path) = args.write.as_deref().filter(|path| path.exists()) {
        return Err(already_there(path));
    }
    let folder =
        args.output.clone().unwrap_or_else(|| PathBuf::from(format!("{}-tradeoff", stem(&preset.name))));
    if args.force {
        start_over(&folder)?;
    }
    let by = match args.by {
        Judge::Density => By::Density,
        Judge::Energy => By::Energy,
        Judge::Observable => By::Observable,
    };
    let table = tradeoff::tradeoff(&sweep, &selection, &folder, args.repeats.get() as usize, by, control)?;
    let files = tradeoff::write(&table, &folder)?;
    if args.json {
        print(&serde_json::to_string_pretty(&table).expect("a table is plain data"))?;
    } else {
        print(&describe(&table))?;
        print(&format!("\nwritten     {}", files.map(|path| path.display().to_string()).join(", ")))?;
    }
    let chosen = table.choose(args.time, args.dev)?;
    if let Some(place) = chosen.filter(|_| !args.json) {
        print(&advice(&table, place, args))?;
    }
    match (&args.write, chosen) {
        (Some(path), Some(place)) => write_preset(path, &sweep.rows[place].1, &table, place, args.json),
        (Some(_), None) => Err(RunError::Request(
            "--write: the table has no knee, so no setting stands out; name a limit with --time or --dev"
                .into(),
        )),
        (None, _) => Ok(()),
    }
}

/// The frames compared if none are named: one second, or what the shot has.
fn first_frames(scene: &Scene) -> Frames {
    let first = scene.frames.first();
    let second = first.0.saturating_add(scene.fps.ceil() as u32 - 1).max(first.0 + 1);
    let last = scene.frames.last().0.min(second);
    Frames::from_first_to_last(first, crate::frame::FrameIndex(last)).expect("a second has frames")
}

fn stem(name: &str) -> String {
    Path::new(name).file_stem().map_or_else(|| "shot".into(), |stem| stem.to_string_lossy().into_owned())
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

/// Lists the runs.
fn dry_run(sweep: &Sweep, selection: &Frames) -> Result<(), RunError> {
    print(&format!("{}, frames {selection}: {} runs", sweep.base.title, sweep.rows.len() + 2))?;
    let named = [&sweep.reference, &sweep.refined];
    for (setting, _) in named {
        let extra = setting.overrides.set.join(" ");
        print(&format!("     {}: {extra}", setting.label))?;
    }
    for (place, (setting, scene)) in sweep.rows.iter().enumerate() {
        let spacing = scene.liquid.as_ref().map_or(0.0, |liquid| liquid.spacing);
        print(&format!("{:>3}  {}  (spacing {spacing} m)", place + 1, setting.label))?;
    }
    Ok(())
}

/// What people read: a line a setting, then how to read it.
fn describe(table: &Table) -> String {
    let unit = table.observable.unit();
    let head = [
        "",
        "setting",
        "seconds",
        "whole shot",
        "density",
        "largest",
        "volume",
        "energy",
        table.observable.name(),
        "positions",
        "",
    ];
    let mut rows = vec![head.map(String::from).to_vec()];
    let repeated = table.lines.iter().any(|line| line.seconds.min < line.seconds.max);
    for (place, line) in table.lines.iter().enumerate() {
        let mark = match (table.knee == Some(place), line.front) {
            (true, _) => "knee",
            (false, true) => "front",
            _ => "",
        };
        rows.push(cells(&(place + 1).to_string(), line, table, repeated, mark));
    }
    rows.push(cells("", &table.reference, table, repeated, "reference"));
    let mut text = format!(
        "{}, frames {}, {} threads\n\n{}\n",
        table.title,
        table.frames,
        table.threads,
        aligned(&rows)
    );
    let by = match table.by {
        By::Density => "density",
        By::Energy => "energy",
        By::Observable => table.observable.name(),
    };
    text += &format!(
        "front       settings that no other beats in both time and {by}; knee: after it, more time buys little\n\
         density     how far from incompressible: mean of the frames, then the largest of any particle\n\
         volume      of the surface, last frame against the first\n\
         energy, {}, positions    distance from the reference (RMS over the frames)\n",
        table.observable.name()
    );
    let maybe = |value: Option<f64>, say: &dyn Fn(f64) -> String| value.map_or_else(|| "-".into(), say);
    text += &format!(
        "certainty   the reference differs from its own refinement by energy {}, {} {}: smaller errors show as ≤",
        maybe(table.uncertainty.energy, &percent),
        table.observable.name(),
        maybe(table.uncertainty.observable, &|o| format!("{} {unit}", short(o)))
    );
    text += &match table.horizon {
        Some(frame) if frame == table.frames.last().0 => {
            "\nhorizon     particles are compared in all frames".into()
        }
        Some(frame) => {
            format!("\nhorizon     particles are compared up to frame {frame}; then paths part by a spacing")
        }
        None => "\nhorizon     none: the reference and its refinement do not have the same particles".into(),
    };
    if table.by == By::Density && table.lines.iter().any(|line| line.particles != table.reference.particles) {
        text += "\nnote        the settings differ in particles: their densities say little about each other; use --by \
                 observable or --by energy";
    }
    let failed = [("reference", &table.reference), ("refined reference", &table.refined)];
    for (name, why) in failed.iter().filter_map(|(name, line)| Some((name, line.diverged.as_ref()?))) {
        text += &format!("\nnote        the {name} diverged, so what is compared with it is left out: {why}");
    }
    for (place, line) in table.lines.iter().enumerate() {
        if let Some(why) = &line.diverged {
            text += &format!("\ndiverged    {}: {why}", place + 1);
        } else if let Some(first) = line.same_as {
            text += &format!("\nsame        {} gives the same frames as {}", place + 1, first + 1);
        }
        if line.unconverged > 0 {
            text += &format!(
                "\nnote        {}: {} substeps stopped at max_iterations",
                place + 1,
                line.unconverged
            );
        }
    }
    text
}

fn cells(number: &str, line: &Line, table: &Table, repeated: bool, mark: &str) -> Vec<String> {
    let unit = table.observable.unit();
    let at_least = |value: Option<f64>, floor: Option<f64>, say: &dyn Fn(f64) -> String| match (value, floor)
    {
        (Some(value), Some(floor)) if value < floor => format!("≤ {}", say(floor)),
        (Some(value), _) => say(value),
        (None, _) => "-".into(),
    };
    let (apart, floor) = (line.apart, table.uncertainty);
    let range = match repeated {
        true => format!(" ({:.1}-{:.1})", line.seconds.min, line.seconds.max),
        false => String::new(),
    };
    vec![
        number.into(),
        line.label.clone(),
        format!("{:.1}{range}", line.seconds.median),
        duration(line.shot_seconds),
        percent(line.density_dev_avg),
        percent(line.density_dev_largest),
        line.volume_change.map_or_else(|| "-".into(), |v| format!("{:+.1} %", 100.0 * v)),
        at_least(apart.energy, floor.energy, &percent),
        at_least(apart.observable, floor.observable, &|o| format!("{} {unit}", short(o))),
        apart.position.map_or_else(|| "-".into(), |p| format!("{} m", short(p))),
        if line.diverged.is_some() { "diverged".into() } else { mark.into() },
    ]
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

/// The setting to use, and why.
fn advice(table: &Table, place: usize, args: &TradeoffArgs) -> String {
    let line = &table.lines[place];
    let why = match (args.time, args.dev) {
        (None, None) => "the knee: faster settings lose much, slower ones gain little".to_owned(),
        (time, None) => format!("the most exact within {} for the shot", duration(time.unwrap_or(0.0))),
        (_, Some(dev)) => format!("the cheapest with a mean density deviation of at most {}", percent(dev)),
    };
    let flags: Vec<String> = line
        .quality
        .iter()
        .map(|tier| format!("--quality {tier}"))
        .chain(line.set.iter().map(|set| format!("--set {}", for_a_shell(set))))
        .collect();
    let flags = if flags.is_empty() { "(as written)".into() } else { flags.join(" ") };
    format!("\nuse         {}: {why}\n            meniscus shot {} {flags}", place + 1, args.preset)
}

/// An argument that shells hand on as it is.
fn for_a_shell(text: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "._=%+-/".contains(c);
    if text.chars().all(plain) { text.into() } else { format!("'{}'", text.replace('\'', "'\\''")) }
}

/// Writes the chosen setting as a preset of its own.
fn write_preset(
    path: &Path,
    scene: &Scene,
    table: &Table,
    place: usize,
    quiet: bool,
) -> Result<(), RunError> {
    let line = &table.lines[place];
    let text = format!(
        "# {}: chosen by `meniscus tradeoff` over frames {} among {} settings.\n# Setting: {}. Mean density deviation \
         {}, about {} for the whole shot on {} threads.\n\n{}",
        one_line(&table.title),
        table.frames,
        table.lines.len(),
        line.label,
        percent(line.density_dev_avg),
        duration(line.shot_seconds),
        table.threads,
        scene.to_toml()
    );
    if path.exists() {
        return Err(already_there(path));
    }
    ShotFolder::write(path.into(), &text)?;
    if quiet { Ok(()) } else { print(&format!("preset      {}", path.display())) }
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
