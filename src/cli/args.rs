//! The command line's types: every verb, flag and its help.

use super::{
    examples,
    product_args::{
        CollidersArgs, ExportArgs, MeshArgs, PreviewArgs, Tier, UsdArgs, VolumeArgs, WhitewaterArgs,
    },
    values::{fraction, frames, size, spacing, time},
};
use crate::{
    run::{
        Vary,
        tradeoff::{ColumnInfo, subjects},
    },
    scene::Frames,
};
use clap::{
    Arg, Args, Command, CommandFactory, Parser, Subcommand, ValueEnum,
    builder::{PossibleValue, PossibleValuesParser},
};
use std::path::PathBuf;

/// Liquid, smoke and sheets from a text preset to sequences in Blender.
///
/// A shot is a short TOML preset. `meniscus shot dam-break --quality draft` simulates the built-in dam break into the
/// folder `dam-break-draft/`, meshes every frame, and leaves a `shot.json` there that the Blender extension opens.
#[derive(Debug, Parser)]
#[command(
    name = "meniscus",
    version,
    propagate_version = true,
    max_term_width = 100,
    after_help = "First shot:   meniscus shot dam-break --quality draft\nEvery preset: meniscus presets\nThis machine: meniscus doctor",
    after_long_help = "First shot:   meniscus shot dam-break --quality draft\nEvery preset: meniscus presets\nThis machine: meniscus doctor\n\n\
        Exit codes: 0 done · 1 failed · 2 usage or preset · 3 some frames failed · 10 no such cache · 11 locked by \
        another process · 12 corrupt · 13 other version · 14 of other settings or another shot · 20 diverged · 28 disk full · 33 over the memory \
        budget · 130 interrupted (finished frames are kept)"
)]
pub(super) struct Cli {
    #[command(subcommand)]
    pub(super) verb: Verb,

    /// Threads to compute with, at most 1024; 0 uses every core. Results are the same bytes for any number
    #[arg(long, global = true, env = "MENISCUS_THREADS", hide_env_values = true, default_value_t = 0, value_name = "N", value_parser = clap::value_parser!(u16).range(0..=1024))]
    pub(super) threads: u16,

    /// Seconds to wait, at most, while another process writes the folder's `shot.json` or list of products. They are written in
    /// moments: the default is many times what a slow disk takes
    #[arg(long, global = true, default_value_t = 120, value_name = "SECONDS", hide_short_help = true, value_parser = clap::value_parser!(u32).range(0..=86400))]
    pub(super) wait: u32,

    /// How progress is shown on stderr: a bar on terminals, plain lines elsewhere
    #[arg(long, global = true, default_value = "auto", value_name = "HOW")]
    pub(super) progress: ProgressStyle,
}

/// The command line: `-h` has the first sentence about every flag, `--help` all of them.
pub(super) fn command() -> Command {
    Cli::command()
        .mut_args(shortened)
        .mut_subcommands(|verb| verb.mut_args(shortened).mut_subcommands(|verb| verb.mut_args(shortened)))
}

fn shortened(argument: Arg) -> Arg {
    let help = argument.get_help().map(ToString::to_string).unwrap_or_default();
    match help.split_once(". ") {
        Some((first, _)) if argument.get_long_help().is_none() => {
            let first = first.to_owned();
            argument.help(first).long_help(help)
        }
        _ => argument,
    }
}

/// How progress is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum ProgressStyle {
    /// A bar if stderr is a terminal, plain lines otherwise
    Auto,
    /// A bar with the time left
    Bar,
    /// A line a frame, and lines such as `Progress: 34%`, at least one every 10 s
    Plain,
    /// One JSON object a line
    Json,
    /// Open Job Description lines, on stdout as its agents expect them
    Openjd,
    /// Notes alone
    None,
}

/// What to do.
#[derive(Debug, Subcommand)]
pub(super) enum Verb {
    /// Simulate a shot, then write every output its preset names
    #[command(after_help = examples::SHOT)]
    Shot(ShotArgs),
    /// Simulate a shot into its cache; the same command again continues
    #[command(after_help = examples::SIMULATE)]
    Simulate(ShotArgs),
    /// Estimate what a shot will need: particles, passes, memory, disk, time
    #[command(after_help = examples::PLAN)]
    Plan(PlanArgs),
    /// Measure on your own shot what accuracy costs, and name the setting to use
    Tradeoff(TradeoffArgs),
    /// Turn a cache, particle files of any solver, or level sets into surface meshes
    #[command(after_help = examples::MESH)]
    Mesh(MeshArgs),
    /// Turn a cache, or particle files of any solver, into OpenVDB volumes: fog, level set, velocity
    #[command(after_help = examples::VOLUME)]
    Volume(VolumeArgs),
    /// Write the sheets of a cache as meshes with a point cache, or the tracers of smoke as PLY points
    #[command(after_help = examples::EXPORT)]
    Export(ExportArgs),
    /// Write the colliders of a shot as meshes with their motion; `shot` does so too
    Colliders(CollidersArgs),
    /// Join the meshes, points, sheets, colliders and camera of a shot folder to a USD stage, for Houdini, Maya and others
    #[command(after_help = examples::USD)]
    Usd(UsdArgs),
    /// Compute spray, foam and bubbles of a cached liquid, as PLY points; `shot` does so too where the preset has `[whitewater]`
    #[command(after_help = examples::WHITEWATER)]
    Whitewater(WhitewaterArgs),
    /// Draw shaded pictures of a cached shot: a contact sheet, a loop, and the frames that are selected
    #[command(after_help = examples::PREVIEW)]
    Preview(PreviewArgs),
    /// Make a variant of a shot for every combination of settings, and a contact sheet of them
    Wedge(WedgeArgs),
    /// Write a shot, or wedges, as a job of a render farm
    Farm(FarmArgs),
    /// List what is in a shot folder
    Info(InfoArgs),
    /// Read every frame and output whole and report which are valid, missing, corrupt, stale or foreign
    #[command(after_help = examples::VERIFY)]
    Verify(InfoArgs),
    /// List, show or copy the built-in presets
    Presets(PresetsArgs),
    /// Report what this machine has, and what of it will slow down or stop a job
    Doctor(DoctorArgs),
    /// Print the completions of a shell
    Completions(CompletionsArgs),
    /// Print the man page, or write those of all verbs
    Man(ManArgs),
}

/// Arguments of `shot` and `simulate`.
#[derive(Debug, Args)]
pub(super) struct ShotArgs {
    /// A preset file, or the name of a built-in preset (see `meniscus presets`)
    pub(super) preset: String,

    /// The shot's folder; by default `NAME`, or `NAME-TIER` with --quality, in the current folder
    #[arg(short, long, value_name = "DIR")]
    pub(super) output: Option<PathBuf>,

    /// The frames to store: `1-240`, `1-240x2`, `1,5,9-12`. By default those of the preset
    #[arg(long, value_name = "LIST", value_parser = frames)]
    pub(super) frames: Option<Frames>,

    /// Change any key of the preset: `--set liquid.iterations=20`. May be repeated
    #[arg(long, value_name = "KEY=VALUE")]
    pub(super) set: Vec<String>,

    /// Branch: go on from this cached frame of a shot, whose folder stands in place of PRESET, with the changes of --set, in a folder
    /// of its own (by default `SHOT-from-FRAME`). Frames before it are shared
    #[arg(long, value_name = "FRAME", conflicts_with = "quality")]
    pub(super) from: Option<u32>,

    /// One of the preset's quality tiers
    #[arg(long, value_name = "TIER")]
    pub(super) quality: Option<Tier>,

    /// Refuse to start if about more memory than this would be needed: `8GiB`, `500MiB`
    #[arg(long, value_name = "SIZE", value_parser = size)]
    pub(super) max_memory: Option<u64>,

    /// Delete the folder's cached frames and start over; without it a cache of other settings is refused
    #[arg(long)]
    pub(super) force: bool,

    /// Print what would run, with particles and memory, and stop; `meniscus plan` also estimates time and disk
    #[arg(long)]
    pub(super) dry_run: bool,
}

/// Arguments of `plan`.
#[derive(Debug, Args)]
pub(super) struct PlanArgs {
    /// A preset file, or the name of a built-in preset (see `meniscus presets`)
    pub(super) preset: String,

    /// The frames to plan for: `1-240`, `1-240x2`, `1,5,9-12`. By default those of the preset
    #[arg(long, value_name = "LIST", value_parser = frames)]
    pub(super) frames: Option<Frames>,

    /// Change any key of the preset: `--set liquid.iterations=20`. May be repeated
    #[arg(long, value_name = "KEY=VALUE")]
    pub(super) set: Vec<String>,

    /// One of the preset's quality tiers
    #[arg(long, value_name = "TIER")]
    pub(super) quality: Option<Tier>,

    /// Exit with code 33 if the shot would need about more memory than this: `8GiB`, `500MiB`
    #[arg(long, value_name = "SIZE", value_parser = size)]
    pub(super) max_memory: Option<u64>,

    /// Print JSON
    #[arg(long)]
    pub(super) json: bool,
}

/// Arguments of `tradeoff`.
#[derive(Debug, Args)]
#[command(
    long_about = "Measure on your own shot what accuracy costs, and name the setting to use.\n\n\
        Runs the first second of the shot (or --frames) once for every setting, and once for a reference that is finer \
        than all of them. The table shows for each setting how long it took and how far its result is from exact. \
        Settings that are slower and worse than another need not be looked at; the rest form the front, and its knee is \
        where more time stops paying.\n\n\
        With --of surface it compares surfaces of the same particles: of a shot folder, of any solver's files, or of a preset, \
        whose first second is then simulated once.\n\n\
        Every run is kept in the output folder: the same command goes on where it stopped, and a further --vary only \
        runs what is new. docs/tradeoff.md explains the columns.",
    after_help = examples::TRADEOFF
)]
pub(super) struct TradeoffArgs {
    /// A preset file, or the name of a built-in preset (see `meniscus presets`); of surfaces also a shot folder, or particle
    /// files
    #[arg(required = true, value_name = "PRESET|CACHE|FILES")]
    pub(super) inputs: Vec<String>,

    /// What to compare: the simulation of a system, by default of the first that the preset has, or surfaces of the same
    /// particles
    #[arg(long, value_name = "WHAT", value_parser = PossibleValuesParser::new(subjects().map(|subject| subject.name)))]
    pub(super) of: Option<String>,

    /// The folder for runs, table and plot; by default the input's name with -tradeoff, in the current folder
    #[arg(short, long, value_name = "DIR")]
    pub(super) output: Option<PathBuf>,

    /// A key of the preset and the values to try: `liquid.cfl=0.2,0.4`. Repeated: every combination. Keys joined by +
    /// vary together: `liquid.cfl+liquid.min_substeps=0.2+16,0.4+8`. A table comes and goes: `surface.smoothing=none,{}`.
    /// By default what docs/tradeoff.md lists; `--dry-run` shows it
    #[arg(long, value_name = "KEY=A,B,…")]
    pub(super) vary: Vec<Vary>,

    /// What to compare with: `liquid.cfl=0.1`. May be repeated. By default the finest value of every knob, refined
    /// once
    #[arg(long, value_name = "KEY=VALUE")]
    pub(super) reference: Vec<String>,

    /// The frames to compare: `1-24`. By default one second; of surfaces three that are there, the last among them
    #[arg(long, value_name = "LIST", value_parser = frames)]
    pub(super) frames: Option<Frames>,

    /// The error that decides which settings are worth their time. By default what the preset's `[tradeoff]` table names, else
    /// the density of a liquid, the displaced fraction of smoke, the distance of sheets and surfaces
    #[arg(long, value_name = "ERROR", value_parser = PossibleValuesParser::new(criteria()))]
    pub(super) by: Option<String>,

    /// Choose the most exact setting that takes at most this long for the whole shot: `90s`, `10min`, `2h`
    #[arg(long, value_name = "TIME", value_parser = time)]
    pub(super) time: Option<f64>,

    /// Choose the fastest setting whose error is at most this: `0.5%`. Of the liquid compression and dilation of the
    /// bulk, of smoke the displaced fraction, of sheets and surfaces the RMS distance in spacings
    #[arg(long, value_name = "DEVIATION", value_parser = fraction)]
    pub(super) dev: Option<f64>,

    /// Write the chosen setting as a preset
    #[arg(long, value_name = "FILE")]
    pub(super) write: Option<PathBuf>,

    /// Run every setting this often, and show the median and range of its time
    #[arg(long, value_name = "N", default_value = "1")]
    pub(super) repeats: std::num::NonZeroU32,

    /// Distance between particles at rest in particle files, in metres or with a unit (`0.02`, "2 cm"); twice the particle radius
    #[arg(long, value_name = "LENGTH", allow_negative_numbers = true, value_parser = spacing)]
    pub(super) spacing: Option<f32>,

    /// Refuse to start if a surface needs about more memory than this: `8GiB`, `500MiB`
    #[arg(long, value_name = "SIZE", value_parser = size)]
    pub(super) max_memory: Option<u64>,

    /// Show the preset's quality tiers as rows too
    #[arg(long)]
    pub(super) tiers: bool,

    /// Change any key of the preset for all runs: `--set liquid.spacing=0.05`. May be repeated
    #[arg(long, value_name = "KEY=VALUE")]
    pub(super) set: Vec<String>,

    /// Compare on one of the preset's quality tiers; of particle files, on a tier of `meniscus mesh`
    #[arg(long, value_name = "TIER")]
    pub(super) quality: Option<Tier>,

    /// Run everything again, whatever is in the folder
    #[arg(long)]
    pub(super) force: bool,

    /// List the runs and stop
    #[arg(long)]
    pub(super) dry_run: bool,

    /// Print the table as JSON
    #[arg(long)]
    pub(super) json: bool,
}

/// The errors that `--by` can name, each with what it means.
fn criteria() -> Vec<PossibleValue> {
    let mut meanings: Vec<(&str, Vec<String>)> = Vec::new();
    for subject in subjects() {
        for ColumnInfo { criterion, meaning, .. } in (subject.columns)() {
            let Some(name) = criterion else { continue };
            let help = format!("{}: {meaning}", subject.name);
            match meanings.iter_mut().find(|(known, _)| *known == name) {
                Some((_, known)) => known.push(help),
                None => meanings.push((name, vec![help])),
            }
        }
    }
    meanings.into_iter().map(|(name, help)| PossibleValue::new(name).help(help.join("; "))).collect()
}

/// Arguments of `wedge`.
#[derive(Debug, Args)]
#[command(
    long_about = "Make a variant of a shot for every combination of settings, and a contact sheet of them.\n\n\
        Every wedge is a shot folder of its own below the output folder. The contact sheet shows all at the same frames from the \
        same place; wedges.csv and wedges.html list their values, times and figures. The same command again continues, and more \
        values only run what is new. With a folder instead of a preset, it compares the wedges that are there, as after a farm's job.",
    after_help = examples::WEDGE
)]
pub(super) struct WedgeArgs {
    /// A preset file, or the name of a built-in preset; or the folder of wedges that are there
    #[arg(value_name = "PRESET|DIR")]
    pub(super) preset: String,

    /// A key of the preset and its values: `liquid.cfl=0.2,0.4`; one value: the same in all. Repeated: every combination. Keys
    /// joined by + vary together: `liquid.cfl+liquid.min_substeps=0.2+16,0.4+8`. Values with commas in quotes or brackets:
    /// `frames="1,5"`
    #[arg(long, value_name = "KEY=A,B,…")]
    pub(super) set: Vec<Vary>,

    /// One of the preset's quality tiers
    #[arg(long, value_name = "TIER")]
    pub(super) quality: Option<Tier>,

    /// The folder of the wedges; by default the preset's name with -wedges, in the current folder
    #[arg(short, long, value_name = "DIR")]
    pub(super) output: Option<PathBuf>,

    /// The frames to store: `1-240`, `1-240x2`, `1,5,9-12`. By default those of the preset
    #[arg(long, value_name = "LIST", value_parser = frames)]
    pub(super) frames: Option<Frames>,

    /// The frames that the contact sheet shows, at most twelve: `24,48,96`. By default three, the last among them
    #[arg(long, value_name = "LIST", value_parser = frames)]
    pub(super) at: Option<Frames>,

    /// Leave wedges out that need about more memory than this: `8GiB`, `500MiB`
    #[arg(long, value_name = "SIZE", value_parser = size)]
    pub(super) max_memory: Option<u64>,

    /// Write the folders with their presets, for `meniscus farm`, and stop
    #[arg(long)]
    pub(super) prepare: bool,

    /// Delete cached frames of the wedges and start over
    #[arg(long)]
    pub(super) force: bool,
}

/// Arguments of `farm`.
#[derive(Debug, Args)]
#[command(
    long_about = "Write a shot, or wedges, as a job of a render farm.\n\n\
        The job simulates, makes in chunks of frames what the preset's [output] requests, then verifies every file. A task that \
        is run again keeps what is valid, and the result has the bytes of a local run. docs/farm.md explains how to choose \
        chunks and memory.",
    after_help = examples::FARM
)]
pub(super) struct FarmArgs {
    /// The engine that runs the job
    #[arg(value_name = "ENGINE")]
    pub(super) engine: EngineName,

    /// The shot folder, or a folder of `meniscus wedge`; it gets the job's files
    #[arg(value_name = "DIR")]
    pub(super) folder: PathBuf,

    /// Write this preset, a file or the name of a built-in preset, into the folder first; else the folder has its `preset.toml`
    #[arg(long, value_name = "PRESET")]
    pub(super) preset: Option<String>,

    /// Change any key of the preset: `--set liquid.iterations=20`. May be repeated
    #[arg(long, value_name = "KEY=VALUE")]
    pub(super) set: Vec<String>,

    /// One of the preset's quality tiers
    #[arg(long, value_name = "TIER")]
    pub(super) quality: Option<Tier>,

    /// The frames: `1-240`, `1-240x2`, `1,5,9-12`. By default those of the preset
    #[arg(long, value_name = "LIST", value_parser = frames)]
    pub(super) frames: Option<Frames>,

    /// Frames of a task that makes meshes or volumes
    #[arg(long, value_name = "N", default_value = "10")]
    pub(super) chunk: std::num::NonZeroU32,

    /// Memory of a task, a quarter more of which is requested of the engine: `8GiB`, `500MiB`
    #[arg(long, value_name = "SIZE", value_parser = size)]
    pub(super) max_memory: Option<u64>,

    /// The program on the machines that run the tasks
    #[arg(long, value_name = "PROGRAM", default_value = "meniscus", value_parser = clap::builder::NonEmptyStringValueParser::new())]
    pub(super) command: String,
}

/// A render farm's engine.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum EngineName {
    /// Open Job Description: a template that `openjd run` and Deadline Cloud take
    Openjd,
    /// Slurm: a script that submits arrays
    Slurm,
    /// Flamenco: a job type and a submission
    Flamenco,
}

/// Arguments of `info` and `verify`.
#[derive(Debug, Args)]
pub(super) struct InfoArgs {
    /// A shot folder or its cache
    pub(super) folder: PathBuf,

    /// Print JSON
    #[arg(long)]
    pub(super) json: bool,
}

/// Arguments of `presets`.
#[derive(Debug, Args)]
pub(super) struct PresetsArgs {
    #[command(subcommand)]
    pub(super) verb: Option<PresetsVerb>,
}

/// What to do with the built-in presets.
#[derive(Debug, Subcommand)]
pub(super) enum PresetsVerb {
    /// One line a preset
    List,
    /// Print a preset's text
    Show {
        /// Name of the preset
        name: String,
    },
    /// Write a preset to a file, to change it
    Copy {
        /// Name of the preset
        name: String,
        /// The file to write; by default NAME.toml. An existing file is not replaced
        file: Option<PathBuf>,
    },
}

/// Arguments of `doctor`.
#[derive(Debug, Args)]
#[command(
    after_long_help = "Writes 64 MiB into a hidden folder below DIR and removes it. Exit code 1 if no shot can be made there."
)]
pub(super) struct DoctorArgs {
    /// The folder in which shots are to be made
    #[arg(default_value = ".", value_name = "DIR")]
    pub(super) folder: PathBuf,

    /// Print JSON
    #[arg(long)]
    pub(super) json: bool,
}

/// Arguments of `completions`.
#[derive(Debug, Args)]
#[command(after_help = examples::COMPLETIONS)]
pub(super) struct CompletionsArgs {
    /// The shell
    #[arg(value_name = "SHELL")]
    pub(super) shell: clap_complete::Shell,
}

/// Arguments of `man`.
#[derive(Debug, Args)]
#[command(after_help = examples::MAN)]
pub(super) struct ManArgs {
    /// Write the page of every verb into this folder, replacing older ones
    #[arg(short, long, value_name = "DIR")]
    pub(super) output: Option<PathBuf>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        command().debug_assert();
    }

    #[test]
    fn the_short_help_is_short_and_the_long_one_whole() {
        let mut command = command();
        let mesh = command.find_subcommand_mut("mesh").unwrap();
        let (short, long) = (mesh.render_help().to_string(), mesh.render_long_help().to_string());
        assert!(short.contains("The frames to use") && !short.contains("By default all that are present"));
        assert!(long.contains("By default all that are present"), "{long}");
        for verb in command.get_subcommands() {
            for argument in verb.get_arguments() {
                let help = argument.get_help().unwrap_or_else(|| panic!("{} has no help", argument.get_id()));
                assert!(!help.to_string().contains(". "), "{}: {help}", argument.get_id());
            }
        }
    }
}
