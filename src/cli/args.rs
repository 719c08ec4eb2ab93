//! The command line's types: every verb, flag and its help.

use crate::{export::MeshFormat, scene::Frames};
use clap::{Args, Parser, Subcommand, ValueEnum};
use std::path::PathBuf;

/// Liquids from a text preset to meshes in Blender.
///
/// A shot is a short TOML preset. `meniscus shot dam-break` simulates the built-in dam break into the folder
/// `dam-break/`, meshes every frame, and leaves a `shot.json` there that the Blender extension opens.
#[derive(Debug, Parser)]
#[command(
    name = "meniscus",
    version,
    propagate_version = true,
    max_term_width = 100,
    after_help = "First shot:  meniscus shot dam-break\nEvery preset: meniscus presets\n\n\
        Exit codes: 0 done · 1 failed · 2 usage or preset · 3 some frames failed · 10 no such cache · 11 locked by \
        another process · 12 corrupt · 13 other version · 14 stale · 20 diverged · 28 disk full · 33 over the memory \
        budget · 130 interrupted (finished frames are kept)"
)]
pub(super) struct Cli {
    #[command(subcommand)]
    pub(super) verb: Verb,

    /// Threads to compute with; 0 uses every core. Results are the same bytes for any number
    #[arg(long, global = true, default_value_t = 0, value_name = "N")]
    pub(super) threads: usize,

    /// How progress is shown on stderr: a bar on terminals, plain lines elsewhere
    #[arg(long, global = true, default_value = "auto", value_name = "HOW")]
    pub(super) progress: ProgressStyle,
}

/// How progress is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum ProgressStyle {
    /// A bar if stderr is a terminal, plain lines otherwise
    Auto,
    /// A bar with the time left
    Bar,
    /// Lines such as `Progress: 34%`, at least one every 10 s
    Plain,
    /// One JSON object a line
    Json,
    /// Open Job Description lines, on stdout as its agents expect them
    Openjd,
    /// Nothing
    None,
}

/// What to do.
#[derive(Debug, Subcommand)]
pub(super) enum Verb {
    /// Simulate a shot, then write every output its preset names
    Shot(ShotArgs),
    /// Simulate a shot into its cache; the same command again continues
    Simulate(ShotArgs),
    /// Turn a cache, or particle files of any solver, into surface meshes
    Mesh(MeshArgs),
    /// Tell what is in a shot folder
    Info(InfoArgs),
    /// Read every cached frame whole and tell which are valid, missing or corrupt
    Verify(InfoArgs),
    /// List, show or copy the built-in presets
    Presets(PresetsArgs),
}

/// Arguments of `shot` and `simulate`.
#[derive(Debug, Args)]
pub(super) struct ShotArgs {
    /// A preset file, or the name of a built-in preset (see `meniscus presets`)
    pub(super) preset: String,

    /// The shot's folder; by default the preset's name, in the current folder
    #[arg(short, long, value_name = "DIR")]
    pub(super) output: Option<PathBuf>,

    /// The frames to store: `1-240`, `1-240x2`, `1,5,9-12`. By default those of the preset
    #[arg(long, value_name = "LIST", value_parser = frames)]
    pub(super) frames: Option<Frames>,

    /// Change any key of the preset: `--set liquid.iterations=20`. May be repeated
    #[arg(long, value_name = "KEY=VALUE")]
    pub(super) set: Vec<String>,

    /// One of the preset's quality tiers
    #[arg(long, value_name = "TIER")]
    pub(super) quality: Option<Tier>,

    /// Refuse to start if about more memory than this would be needed: `8GiB`, `500MiB`
    #[arg(long, value_name = "SIZE", value_parser = size)]
    pub(super) max_memory: Option<u64>,

    /// Start over, whatever is in the folder; without it a cache of other settings is refused
    #[arg(long)]
    pub(super) force: bool,

    /// Say what would run, with particles, memory and disk, and stop
    #[arg(long)]
    pub(super) dry_run: bool,
}

/// A quality tier of a preset.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum Tier {
    /// Seconds: to block a shot
    Draft,
    /// Minutes: to judge motion
    Preview,
    /// The preset as written, unless it says otherwise
    Final,
}

/// Arguments of `mesh`.
#[derive(Debug, Args)]
pub(super) struct MeshArgs {
    /// A shot folder or its cache, or particle files (PLY, XYZ, legacy VTK, BGEO): names, globs, or `frame_####.vtk`
    #[arg(required = true, value_name = "CACHE|FILES")]
    pub(super) inputs: Vec<String>,

    /// The folder that gets `mesh/` and `shot.json`; by default the shot folder itself
    #[arg(short, long, value_name = "DIR")]
    pub(super) output: Option<PathBuf>,

    /// File formats
    #[arg(long, value_name = "FORMAT", value_delimiter = ',', default_value = "ply", value_parser = mesh_format)]
    pub(super) format: Vec<MeshFormat>,

    /// The frames of the cache to mesh: `1-240`, `1-240x2`, `1,5,9-12`. By default all that are there
    #[arg(long, value_name = "LIST", value_parser = frames)]
    pub(super) frames: Option<Frames>,

    /// Distance between particles at rest in particle files, in metres; twice the particle radius
    #[arg(long, value_name = "METRES", allow_negative_numbers = true)]
    pub(super) spacing: Option<f32>,

    /// Frames a second of a sequence of particle files, 24 if not given
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub(super) fps: Option<f64>,

    /// Change a key of the surface: `--set surface.voxel=0.25`. May be repeated
    #[arg(long, value_name = "KEY=VALUE")]
    pub(super) set: Vec<String>,

    /// Grid cell in particle spacings, short for `--set surface.voxel=…`
    #[arg(long, value_name = "SPACINGS", allow_negative_numbers = true)]
    pub(super) voxel: Option<String>,

    /// Mesh again what is there already
    #[arg(long)]
    pub(super) force: bool,
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
        /// Its name
        name: String,
    },
    /// Write a preset to a file, to change it
    Copy {
        /// Its name
        name: String,
        /// The file to write; by default NAME.toml. An existing file is not replaced
        file: Option<PathBuf>,
    },
}

fn frames(text: &str) -> Result<Frames, String> {
    text.parse().map_err(|why: crate::scene::FramesError| why.to_string())
}

fn mesh_format(text: &str) -> Result<MeshFormat, String> {
    MeshFormat::from_extension(text).ok_or_else(|| "expected ply or obj".into())
}

/// A number of bytes with a unit.
fn size(text: &str) -> Result<u64, String> {
    let digits = text.trim_end_matches(|c: char| c.is_ascii_alphabetic());
    let factor = match text[digits.len()..].to_ascii_lowercase().as_str() {
        "k" | "kib" => 1 << 10,
        "m" | "mib" => 1 << 20,
        "g" | "gib" => 1_u64 << 30,
        "t" | "tib" => 1 << 40,
        "kb" => 1000,
        "mb" => 1_000_000,
        "gb" => 1_000_000_000,
        "b" | "" => 1,
        unit => return Err(format!("unknown unit {unit:?}; expected a size such as 8GiB or 500MiB")),
    };
    match digits.trim().parse::<f64>() {
        Ok(number) if number > 0.0 && number.is_finite() => Ok((number * factor as f64) as u64),
        _ => Err("expected a size such as 8GiB or 500MiB".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_command_line_is_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn sizes_carry_units() {
        assert_eq!(size("8GiB"), Ok(8 << 30));
        assert_eq!(size("1.5k"), Ok(1536));
        assert_eq!(size("500MB"), Ok(500_000_000));
        for wrong in ["", "GiB", "-1GiB", "8 parsecs", "nan"] {
            assert!(size(wrong).is_err(), "{wrong}");
        }
    }
}
