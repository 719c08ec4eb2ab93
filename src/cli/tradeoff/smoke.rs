//! `meniscus tradeoff` of smoke.

use super::{
    conclude, dry_run, folder, frames, not_judged, refuse_to_replace, request, start_over,
    tell::{Tell, at_least, certainty, maybe, mib, percent, seconds},
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
            smoke::{self, By, Line, Smoke, Table, Told},
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
        let spacing =
            |scene: &Scene| format!("spacing {} m", scene.smoke.as_ref().map_or(0.0, |smoke| smoke.spacing));
        return dry_run(&sweep, &selection, spacing);
    }
    refuse_to_replace(args)?;
    let folder = folder(args, &preset.name);
    if args.force {
        start_over(&folder)?;
    }
    let table = smoke::tradeoff(&sweep, &selection, &folder, args.repeats.get() as usize, by, control)?;
    conclude(args, &sweep, &table, &folder, &format!("shot {name}"))
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

impl Tell for Smoke {
    const COMMAND: &'static str = "meniscus tradeoff";
    const WHOLE: &'static str = "the shot";
    const SAME: &'static str = "the same motion as";

    fn about(&self) -> String {
        format!("frames {}", self.frames)
    }

    fn decides(table: &Table) -> &'static str {
        match table.by {
            By::Density => "density",
            By::Center => "centre",
            By::Extent => "extent",
            By::Energy => "energy",
            By::Impulse => "impulse",
            By::Velocity => "velocity",
            By::Voxel => "voxel (for the volume's own time)",
        }
    }

    fn head(_: &Table) -> Vec<&'static str> {
        vec![
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
        ]
    }

    fn cells(table: &Table, line: &Line, is_repeated: bool) -> Vec<String> {
        let (told, apart, floor) = (&line.told, line.apart, table.uncertainty);
        vec![
            seconds(&line.seconds, is_repeated, 1),
            maybe(told.volume_seconds.map(|spread| spread.median), &|s| format!("{s:.2}")),
            duration(line.shot_seconds),
            mib(told.memory),
            told.vortons.to_string(),
            maybe(told.velocity, &percent),
            at_least(apart.density, floor.density, &percent),
            at_least(apart.center, floor.center, &percent),
            at_least(apart.extent, floor.extent, &percent),
            at_least(apart.energy, floor.energy, &percent),
            at_least(apart.impulse, floor.impulse, &percent),
            maybe(told.voxel, &percent),
        ]
    }

    fn legend(table: &Table) -> String {
        let floor = &table.uncertainty;
        let errors = [
            ("density", floor.density),
            ("centre", floor.center),
            ("extent", floor.extent),
            ("energy", floor.energy),
            ("impulse", floor.impulse),
        ];
        let text = format!(
            "volume      seconds for the volume of the last frame; whole shot: simulation and volumes\n\
             velocity    against the sum over all pairs: sampled in every frame, the largest\n\
             density     the share of the smoke that is elsewhere than the reference's, on a lattice of {} m\n\
             centre, extent    of the smoke against the reference's, in its sizes (RMS over the frames)\n\
             energy, impulse    of the air: distance from the reference (RMS over the frames)\n\
             voxel       the volume's density between its nodes against the sum over tracers\n",
            table.about.cell
        );
        text + &certainty(&errors.map(|(name, error)| (name, maybe(error, &percent))))
    }

    fn notes(line: &Line) -> Vec<String> {
        let Told { capped, clamped, .. } = line.told;
        let long = (capped > 0).then(|| format!("{capped} steps were longer than asked for"));
        let cut = (clamped > 0).then(|| format!("{clamped} strengths were cut"));
        long.into_iter().chain(cut).collect()
    }

    fn kept(most: f64) -> String {
        format!("the cheapest of whose smoke at most {} is elsewhere", percent(most))
    }

    fn reason(_: &Table, line: &Line) -> String {
        let whole = duration(line.shot_seconds);
        match line.apart.density {
            Some(share) => format!(
                "About {} of the smoke is elsewhere than the reference's, about {whole} for the whole shot",
                percent(share)
            ),
            None => format!("About {whole} for the whole shot"),
        }
    }

    fn write(table: &Table, folder: &Path) -> Result<[PathBuf; 3], RunError> {
        smoke::write(table, folder)
    }
}
