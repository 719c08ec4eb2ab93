//! `meniscus tradeoff` of sheets.

use super::{
    conclude, dry_run, folder, frames, not_judged, refuse_to_replace, request, start_over,
    tell::{Tell, at_least, certainty, maybe, mib, percent, seconds, short},
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
            sheet::{self, By, Cloth, Line, Table, Told},
        },
    },
    scene::{Overrides, Preset, Scene},
};
use std::path::{Path, PathBuf};

/// Compares settings of the sheets of a preset called `name`.
pub(super) fn tradeoff(
    args: &TradeoffArgs,
    name: &str,
    preset: &Preset,
    base: Overrides,
    control: Control,
) -> Result<(), RunError> {
    let sweep = request(args, base).sweep(Subject::Sheets, Ground::Preset(preset))?;
    let selection = frames(args, &sweep.base)?;
    let by = match args.by {
        None | Some(Judge::Distance) => By::Distance,
        Some(Judge::Farthest) => By::Farthest,
        Some(Judge::Energy) => By::Energy,
        Some(other) => return Err(not_judged(other, "distance, farthest or energy for sheets")),
    };
    if args.dry_run {
        return dry_run(&sweep, &selection, |scene| format!("{} points", points(scene)));
    }
    refuse_to_replace(args)?;
    let folder = folder(args, &preset.name);
    if args.force {
        start_over(&folder)?;
    }
    let table = sheet::tradeoff(&sweep, &selection, &folder, args.repeats.get() as usize, by, control)?;
    conclude(args, &sweep, &table, &folder, &format!("shot {name}"))
}

/// Points of all sheets.
fn points(scene: &Scene) -> f64 {
    scene.sheet.iter().map(|sheet| sheet.shape.points()).sum()
}

/// A length in words.
fn length(metres: f64) -> String {
    format!("{} mm", short(1e3 * metres))
}

impl Tell for Cloth {
    const COMMAND: &'static str = "meniscus tradeoff";
    const WHOLE: &'static str = "the shot";
    const SAME: &'static str = "the same frames as";

    fn about(&self) -> String {
        format!("frames {}", self.frames)
    }

    fn decides(table: &Table) -> &'static str {
        match table.by {
            By::Distance => "distance",
            By::Farthest => "the farthest point",
            By::Energy => "energy",
        }
    }

    fn head(_: &Table) -> Vec<&'static str> {
        vec![
            "seconds",
            "whole shot",
            "MiB",
            "points",
            "substeps",
            "rounds",
            "strain",
            "distance",
            "farthest",
            "energy",
        ]
    }

    fn cells(table: &Table, line: &Line, is_repeated: bool) -> Vec<String> {
        let (told, apart, floor) = (&line.told, line.apart, table.uncertainty);
        vec![
            seconds(&line.seconds, is_repeated, 2),
            duration(line.shot_seconds),
            mib(told.memory),
            told.points.to_string(),
            format!("{:.0}", told.substeps),
            format!("{:.0}", told.iterations),
            percent(told.strain),
            at_least(apart.distance, floor.distance, &length),
            at_least(apart.farthest, floor.farthest, &length),
            at_least(apart.energy, floor.energy, &percent),
        ]
    }

    fn legend(table: &Table) -> String {
        let floor = &table.uncertainty;
        let errors = [
            ("distance", maybe(floor.distance, &length)),
            ("farthest", maybe(floor.farthest, &length)),
            ("energy", maybe(floor.energy, &percent)),
        ];
        let text = format!(
            "substeps, rounds    of a frame; rounds are those of the conjugate gradients\n\
             strain      the largest of a spring at the end of any frame\n\
             distance    between the same points of the cloth and the reference's, RMS over points and frames; points as \
             written are {} apart\n\
             farthest    the largest of these distances\n\
             energy      of motion, springs and height: distance from the reference (RMS over the frames)\n",
            length(table.about.spacing)
        );
        text + &certainty(&errors)
    }

    fn notes(line: &Line) -> Vec<String> {
        let Told { unconverged, overshot, inside, .. } = line.told;
        let open = (unconverged > 0).then(|| format!("{unconverged} substeps stopped at max_iterations"));
        let long = (overshot > 0).then(|| format!("{overshot} substeps were too long for one linearisation"));
        let held = (inside > 0).then(|| format!("{inside} points were inside solids at the ends of frames"));
        open.into_iter().chain(long).chain(held).collect()
    }

    fn kept(most: f64) -> String {
        format!("the cheapest whose points are off by at most {} of the distance between them", percent(most))
    }

    fn reason(_: &Table, line: &Line) -> String {
        let whole = duration(line.shot_seconds);
        match line.apart.distance {
            Some(apart) => {
                format!("Points {} from the reference's, about {whole} for the whole shot", length(apart))
            }
            None => format!("About {whole} for the whole shot"),
        }
    }

    fn write(table: &Table, folder: &Path) -> Result<[PathBuf; 3], RunError> {
        sheet::write(table, folder)
    }
}
