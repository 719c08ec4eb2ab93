//! `meniscus tradeoff` of smoke.

use super::{
    Tell, at_least, conclude, drawn, dry_run, flags, folder, frames, maybe, not_judged, one_line, percent,
    refuse_to_replace, request, seconds, short, start_over,
};
use crate::{
    cli::{
        args::{Judge, TradeoffArgs},
        plan::duration,
    },
    run::{
        Control, RunError,
        tradeoff::{
            Ground, Subject, rows,
            smoke::{self, By, Line, Table},
        },
    },
    scene::{Overrides, Preset, Scene},
};
use std::path::{Path, PathBuf};

/// Compares settings of the smoke of a preset called `name`.
pub(super) fn tradeoff(
    args: &TradeoffArgs,
    name: &str,
    preset: &Preset,
    base: Overrides,
    control: Control,
) -> Result<(), RunError> {
    let sweep = request(args, base).sweep(Subject::Smoke, Ground::Preset(preset))?;
    let selection = frames(args, &sweep.base)?;
    let by = by(args.by)?;
    if args.dry_run {
        let spacing = |scene: &Scene| scene.smoke.as_ref().map_or(0.0, |smoke| smoke.spacing);
        return dry_run(&sweep, &selection, spacing);
    }
    refuse_to_replace(args)?;
    let folder = folder(args, &preset.name);
    if args.force {
        start_over(&folder)?;
    }
    let table = smoke::tradeoff(&sweep, &selection, &folder, args.repeats.get() as usize, by, control)?;
    conclude(args, &sweep, &table, &folder, |place| advice(&table, place, args, name))
}

fn by(judge: Option<Judge>) -> Result<By, RunError> {
    match judge {
        None | Some(Judge::Density) => Ok(By::Density),
        Some(Judge::Center) => Ok(By::Center),
        Some(Judge::Extent) => Ok(By::Extent),
        Some(Judge::Energy) => Ok(By::Energy),
        Some(Judge::Impulse) => Ok(By::Impulse),
        Some(Judge::Velocity) => Ok(By::Velocity),
        Some(Judge::Voxel) => Ok(By::Voxel),
        Some(other) => {
            Err(not_judged(other, "density, center, extent, energy, impulse, velocity or voxel for smoke"))
        }
    }
}

impl Tell for Table {
    fn describe(&self) -> String {
        describe(self)
    }

    fn write(&self, folder: &Path) -> Result<[PathBuf; 3], RunError> {
        smoke::write(self, folder)
    }

    fn choose(&self, time: Option<f64>, dev: Option<f64>) -> Result<Option<usize>, RunError> {
        Table::choose(self, time, dev)
    }

    fn comment(&self, place: usize) -> String {
        comment(self, place)
    }
}

/// What people read: a line a setting, then how to read it.
fn describe(table: &Table) -> String {
    let head = [
        "",
        "setting",
        "seconds",
        "volume",
        "whole shot",
        "MiB",
        "vortons",
        "velocity",
        "density",
        "centre",
        "extent",
        "energy",
        "impulse",
        "voxel",
        "",
    ];
    let repeated = table.lines.iter().any(|line| line.seconds.min < line.seconds.max);
    let rows = rows(
        &table.lines,
        &table.reference,
        table.knee,
        |line| line.front,
        |number, line, mark| cells(number, line, table, repeated, mark),
    );
    let mut text = format!(
        "{}, frames {}, {} threads\n\n{}\n",
        table.title,
        table.frames,
        table.threads,
        drawn(&head, rows)
    );
    let by = match table.by {
        By::Density => "density",
        By::Center => "centre",
        By::Extent => "extent",
        By::Energy => "energy",
        By::Impulse => "impulse",
        By::Velocity => "velocity",
        By::Voxel => "voxel (for the volume's own time)",
    };
    text += &format!(
        "front       settings that no other beats in both time and {by}; knee: after it, more time buys little\n\
         volume      seconds for the volume of the last frame; whole shot: simulation and volumes\n\
         velocity    against the sum over all pairs: sampled in every frame, the largest\n\
         density     the share of the smoke that is elsewhere than the reference's, on a lattice of {} m\n\
         centre, extent    of the smoke against the reference's, in its sizes (RMS over the frames)\n\
         energy, impulse    of the air: distance from the reference (RMS over the frames)\n\
         voxel       the volume's density between its nodes against the sum over tracers\n",
        table.cell
    );
    let floor = &table.uncertainty;
    text += &format!(
        "certainty   the reference differs from its own refinement by density {}, centre {}, extent {}, energy {}, impulse {}: \
         smaller errors show as ≤",
        maybe(floor.density, &percent),
        maybe(floor.center, &percent),
        maybe(floor.extent, &percent),
        maybe(floor.energy, &percent),
        maybe(floor.impulse, &percent)
    );
    let failed = [("reference", &table.reference), ("refined reference", &table.refined)];
    for (name, why) in failed.iter().filter_map(|(name, line)| Some((name, line.diverged.as_ref()?))) {
        text += &format!("\nnote        the {name} diverged, so what is compared with it is left out: {why}");
    }
    for (place, line) in table.lines.iter().enumerate() {
        if let Some(why) = &line.diverged {
            text += &format!("\ndiverged    {}: {why}", place + 1);
        } else if let Some(first) = line.same_as {
            text += &format!(
                "\nsame        {} moves as {}: if anything, its volumes differ",
                place + 1,
                first + 1
            );
        }
        if line.capped > 0 {
            text += &format!("\nnote        {}: {} steps were longer than asked for", place + 1, line.capped);
        }
        if line.clamped > 0 {
            text += &format!("\nnote        {}: {} strengths were cut", place + 1, line.clamped);
        }
    }
    text
}

fn cells(number: &str, line: &Line, table: &Table, repeated: bool, mark: &str) -> Vec<String> {
    let (apart, floor) = (line.apart, table.uncertainty);
    vec![
        number.into(),
        line.label.clone(),
        seconds(&line.seconds, repeated, 1),
        maybe(line.volume_seconds.map(|spread| spread.median), &|s| format!("{s:.2}")),
        duration(line.shot_seconds),
        maybe(line.memory.map(|bytes| bytes as f64), &|bytes| format!("{:.0}", bytes / f64::from(1 << 20))),
        line.vortons.to_string(),
        maybe(line.velocity, &percent),
        at_least(apart.density, floor.density, &percent),
        at_least(apart.center, floor.center, &percent),
        at_least(apart.extent, floor.extent, &percent),
        at_least(apart.energy, floor.energy, &percent),
        at_least(apart.impulse, floor.impulse, &percent),
        maybe(line.voxel, &percent),
        if line.diverged.is_some() { "diverged".into() } else { mark.into() },
    ]
}

/// The setting to use, and why.
fn advice(table: &Table, place: usize, args: &TradeoffArgs, preset: &str) -> String {
    let line = &table.lines[place];
    let why = match (args.time, args.dev) {
        (None, None) => "the knee: faster settings lose much, slower ones gain little".to_owned(),
        (time, None) => format!("the most exact within {} for the shot", duration(time.unwrap_or(0.0))),
        (_, Some(dev)) => format!("the cheapest of whose smoke at most {} is elsewhere", percent(dev)),
    };
    format!(
        "\nuse         {}: {why}\n            meniscus shot {preset} {}",
        place + 1,
        flags(line.quality.as_ref(), &line.set)
    )
}

/// Where the chosen preset comes from.
fn comment(table: &Table, place: usize) -> String {
    let line = &table.lines[place];
    format!(
        "# {}: chosen by `meniscus tradeoff` over frames {} among {} settings.\n# Setting: {}. {} of the smoke is elsewhere than \
         the reference's, about {} for the whole shot on {} threads.",
        one_line(&table.title),
        table.frames,
        table.lines.len(),
        line.label,
        maybe(line.apart.density, &|share| format!("About {}", short(100.0 * share) + " %")),
        duration(line.shot_seconds),
        table.threads,
    )
}
