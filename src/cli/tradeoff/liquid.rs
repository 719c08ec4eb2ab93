//! `meniscus tradeoff` of a liquid.

use super::{
    conclude, dry_run, folder, frames, not_judged, refuse_to_replace, request, start_over,
    tell::{Tell, at_least, certainty, maybe, percent, seconds, short},
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
            liquid::{self, By, Line, Liquid, Table},
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
        let spacing = |scene: &Scene| {
            format!("spacing {} m", scene.liquid.as_ref().map_or(0.0, |liquid| liquid.spacing))
        };
        return dry_run(&sweep, &selection, spacing);
    }
    refuse_to_replace(args)?;
    let folder = folder(args, &preset.name);
    if args.force {
        start_over(&folder)?;
    }
    let table = liquid::tradeoff(&sweep, &selection, &folder, args.repeats.get() as usize, by, control)?;
    conclude(args, &sweep, &table, &folder, &format!("shot {name}"))
}

impl Tell for Liquid {
    const COMMAND: &'static str = "meniscus tradeoff";
    const WHOLE: &'static str = "the shot";
    const SAME: &'static str = "the same frames as";

    fn about(&self) -> String {
        format!("frames {}", self.frames)
    }

    fn decides(table: &Table) -> &'static str {
        match table.by {
            By::Density => "density",
            By::Energy => "energy",
            By::Observable => table.about.observable.name(),
        }
    }

    fn head(table: &Table) -> Vec<&'static str> {
        let observable = table.about.observable.name();
        vec!["seconds", "whole shot", "density", "largest", "volume", "energy", observable, "positions"]
    }

    fn cells(table: &Table, line: &Line, is_repeated: bool) -> Vec<String> {
        let unit = table.about.observable.unit();
        let (apart, floor) = (line.apart, table.uncertainty);
        vec![
            seconds(&line.seconds, is_repeated, 1),
            duration(line.shot_seconds),
            percent(line.told.density_dev_avg),
            percent(line.told.density_dev_largest),
            maybe(line.told.volume_change, &|v| format!("{:+.1} %", 100.0 * v)),
            at_least(apart.energy, floor.energy, &percent),
            at_least(apart.observable, floor.observable, &|o| format!("{} {unit}", short(o))),
            maybe(apart.position, &|p| format!("{} m", short(p))),
        ]
    }

    fn legend(table: &Table) -> String {
        let (observable, floor) = (table.about.observable, table.uncertainty);
        let text = format!(
            "density     how far from incompressible: mean of the frames, then the largest of any particle\n\
             volume      of the surface, last frame against the first\n\
             energy, {}, positions    distance from the reference (RMS over the frames)\n",
            observable.name()
        );
        let observed = maybe(floor.observable, &|o| format!("{} {}", short(o), observable.unit()));
        let certainty =
            certainty(&[("energy", maybe(floor.energy, &percent)), (observable.name(), observed)]);
        text + &certainty + &horizon(table)
    }

    fn notes(line: &Line) -> Vec<String> {
        let unconverged = line.told.unconverged;
        let note = (unconverged > 0).then(|| format!("{unconverged} substeps stopped at max_iterations"));
        note.into_iter().collect()
    }

    fn kept(most: f64) -> String {
        format!("the cheapest with a mean density deviation of at most {}", percent(most))
    }

    fn reason(_: &Table, line: &Line) -> String {
        format!(
            "Mean density deviation {}, about {} for the whole shot",
            percent(line.told.density_dev_avg),
            duration(line.shot_seconds)
        )
    }

    fn write(table: &Table, folder: &Path) -> Result<[PathBuf; 3], RunError> {
        liquid::write(table, folder)
    }
}

/// How far particles can be compared, and whether densities can.
fn horizon(table: &Table) -> String {
    let mut text = match table.about.horizon {
        Some(frame) if frame == table.about.frames.last().0 => {
            "\nhorizon     particles are compared in all frames".into()
        }
        Some(frame) => {
            format!("\nhorizon     particles are compared up to frame {frame}; then paths part by a spacing")
        }
        None => "\nhorizon     none: the reference and its refinement do not have the same particles".into(),
    };
    let particles = table.reference.told.particles;
    if table.by == By::Density && table.lines.iter().any(|line| line.told.particles != particles) {
        text += "\nnote        the settings differ in particles: their densities say little about each other; use --by \
                 observable or --by energy";
    }
    text
}
