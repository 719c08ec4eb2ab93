//! `meniscus tradeoff` of a liquid.

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
            Ground, Subject,
            liquid::{self, By, Line, Table},
            rows,
        },
    },
    scene::{Overrides, Preset, Scene},
};
use std::path::{Path, PathBuf};

/// Compares settings of the simulation of a preset called `name`.
pub(super) fn tradeoff(
    args: &TradeoffArgs,
    name: &str,
    preset: &Preset,
    base: Overrides,
    control: Control,
) -> Result<(), RunError> {
    let sweep = request(args, base).sweep(Subject::Liquid, Ground::Preset(preset))?;
    let selection = frames(args, &sweep.base)?;
    let by = match args.by {
        None | Some(Judge::Density) => By::Density,
        Some(Judge::Energy) => By::Energy,
        Some(Judge::Observable) => By::Observable,
        Some(other) => {
            return Err(not_judged(
                other,
                "density, energy or observable; the others are for smoke or --surface",
            ));
        }
    };
    if args.dry_run {
        let spacing = |scene: &Scene| scene.liquid.as_ref().map_or(0.0, |liquid| liquid.spacing);
        return dry_run(&sweep, &selection, spacing);
    }
    refuse_to_replace(args)?;
    let folder = folder(args, &preset.name);
    if args.force {
        start_over(&folder)?;
    }
    let table = liquid::tradeoff(&sweep, &selection, &folder, args.repeats.get() as usize, by, control)?;
    conclude(args, &sweep, &table, &folder, |place| advice(&table, place, args, name))
}

impl Tell for Table {
    fn describe(&self) -> String {
        describe(self)
    }

    fn write(&self, folder: &Path) -> Result<[PathBuf; 3], RunError> {
        liquid::write(self, folder)
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
    let (apart, floor) = (line.apart, table.uncertainty);
    vec![
        number.into(),
        line.label.clone(),
        seconds(&line.seconds, repeated, 1),
        duration(line.shot_seconds),
        percent(line.density_dev_avg),
        percent(line.density_dev_largest),
        maybe(line.volume_change, &|v| format!("{:+.1} %", 100.0 * v)),
        at_least(apart.energy, floor.energy, &percent),
        at_least(apart.observable, floor.observable, &|o| format!("{} {unit}", short(o))),
        maybe(apart.position, &|p| format!("{} m", short(p))),
        if line.diverged.is_some() { "diverged".into() } else { mark.into() },
    ]
}

/// The setting to use, and why.
fn advice(table: &Table, place: usize, args: &TradeoffArgs, preset: &str) -> String {
    let line = &table.lines[place];
    let why = match (args.time, args.dev) {
        (None, None) => "the knee: faster settings lose much, slower ones gain little".to_owned(),
        (time, None) => format!("the most exact within {} for the shot", duration(time.unwrap_or(0.0))),
        (_, Some(dev)) => format!("the cheapest with a mean density deviation of at most {}", percent(dev)),
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
        "# {}: chosen by `meniscus tradeoff` over frames {} among {} settings.\n# Setting: {}. Mean density deviation \
         {}, about {} for the whole shot on {} threads.",
        one_line(&table.title),
        table.frames,
        table.lines.len(),
        line.label,
        percent(line.density_dev_avg),
        duration(line.shot_seconds),
        table.threads,
    )
}
