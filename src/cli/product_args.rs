//! Arguments of the verbs that make products.

use super::values::{
    frames, mesh_format, name_scheme, picture_size, scale, sheet_format, size, spacing, thickness, up_axis,
    volume_grid, wait,
};
use crate::{
    export::{
        MeshFormat, SheetFormat,
        usd::{NameScheme, UpAxis},
        vdb::VolumeGrid,
    },
    run::ParticleLook,
    scene::Frames,
};
use clap::{
    Args, ValueEnum,
    builder::{PossibleValuesParser, TypedValueParser},
};
use std::{path::PathBuf, time::Duration};

/// A quality tier of a preset.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum Tier {
    /// Seconds: to block a shot
    Draft,
    /// Minutes: to judge motion
    Preview,
    /// The preset as written, unless it has a tier of this name
    Final,
}

/// Where the frames of a product come from, and where its files go.
#[derive(Clone, Debug, Default, Args)]
pub(super) struct InputArgs {
    /// Shot folders, their caches or cached frames, or particle files (PLY, XYZ, CSV, VTK, VTU, NPY, NPZ, BGEO): names, globs (in quotes), or
    /// `frame_####.vtk`, where # are the digits of the frame; `mesh` takes OpenVDB level sets too
    #[arg(required = true, value_name = "CACHE|FILES")]
    pub(super) inputs: Vec<String>,

    /// The folder that gets the files and `shot.json`; by default the shot folder itself
    #[arg(short, long, value_name = "DIR")]
    pub(super) output: Option<PathBuf>,

    /// The frames to use: `1-240`, `1-240x2`, `1,5,9-12`. By default all that are present
    #[arg(long, value_name = "LIST", value_parser = frames)]
    pub(super) frames: Option<Frames>,

    /// Distance between particles at rest in particle files, in metres or with a unit (`0.02`, "2 cm"); twice the particle radius
    #[arg(long, value_name = "LENGTH", allow_negative_numbers = true, value_parser = spacing)]
    pub(super) spacing: Option<f32>,

    /// Frames a second of a sequence of particle files, 24 if not given
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub(super) fps: Option<f64>,

    /// Change a key of the surface or the volume: `--set surface.voxel=0.25`. May be repeated
    #[arg(long, value_name = "KEY=VALUE")]
    pub(super) set: Vec<String>,

    /// Grid cell in particle spacings, short for `--set surface.voxel=…`
    #[arg(long, value_name = "SPACINGS", allow_negative_numbers = true)]
    pub(super) voxel: Option<String>,

    /// Make so many frames at once as need about this much memory, and refuse a frame that needs more: `8GiB`, `500MiB`
    #[arg(long, value_name = "SIZE", value_parser = size)]
    pub(super) max_memory: Option<u64>,

    /// Make the frames of a running simulation as they come: until all that were requested of it (or --frames) are made, waiting
    /// at most so long for each. If no process simulates for --wait seconds, the command ends with exit code 3
    #[arg(long, value_name = "TIME", num_args = 0..=1, require_equals = true, default_missing_value = "1d", value_parser = wait)]
    pub(super) follow: Option<Duration>,

    /// Make files again that are up to date
    #[arg(long)]
    pub(super) force: bool,
}

/// Arguments of `mesh`.
#[derive(Debug, Args)]
pub(super) struct MeshArgs {
    #[command(flatten)]
    pub(super) input: InputArgs,

    /// Of particle files: the surface's tier, which --set changes. `draft`: isotropic kernels on a coarser grid; `preview`: isotropic
    /// kernels, smoothed; `final`: anisotropic kernels, smoothed, as in the built-in presets. By default `final`
    #[arg(long, value_name = "TIER")]
    pub(super) quality: Option<Tier>,

    /// Print the box around the particles, their number, an estimate of the spacing, voxels and memory of each frame, and make no
    /// mesh; --spacing and -o may be left out
    #[arg(long)]
    pub(super) bounds: bool,

    /// File formats
    #[arg(long, value_name = "FORMAT", value_delimiter = ',', default_value = "ply", value_parser = mesh_format)]
    pub(super) format: Vec<MeshFormat>,
}

/// Arguments of `export`.
#[derive(Debug, Args)]
pub(super) struct ExportArgs {
    /// A shot folder or its cache
    #[arg(value_name = "CACHE")]
    pub(super) cache: PathBuf,

    /// The folder that gets `sheet/` or `points/`, and `shot.json`; by default the shot folder itself
    #[arg(short, long, value_name = "DIR")]
    pub(super) output: Option<PathBuf>,

    /// Of sheets: `pc2` (a mesh and a point cache of all frames), `ply` or `obj` (a mesh a frame). By default pc2
    #[arg(long, value_name = "FORMAT", value_delimiter = ',', value_parser = sheet_format)]
    pub(super) format: Vec<SheetFormat>,

    /// Of sheets: how thick they are, in metres. By default surfaces without a thickness
    #[arg(long, value_name = "METRES", value_parser = thickness)]
    pub(super) thickness: Option<f32>,

    /// The frames to write: `1-240`, `1-240x2`, `1,5,9-12`. By default all that are there
    #[arg(long, value_name = "LIST", value_parser = frames)]
    pub(super) frames: Option<Frames>,

    /// Make so many frames at once as need about this much memory, and refuse a frame that needs more: `8GiB`, `500MiB`
    #[arg(long, value_name = "SIZE", value_parser = size)]
    pub(super) max_memory: Option<u64>,

    /// Write again what is there already
    #[arg(long)]
    pub(super) force: bool,
}

/// Arguments of `colliders`.
#[derive(Debug, Args)]
pub(super) struct CollidersArgs {
    /// A shot folder or its cache
    #[arg(value_name = "CACHE")]
    pub(super) cache: PathBuf,

    /// The folder that gets `collider/` and `shot.json`; by default the shot folder itself
    #[arg(short, long, value_name = "DIR")]
    pub(super) output: Option<PathBuf>,

    /// The frames that the motion has to cover, besides those of the shot: `1-240`
    #[arg(long, value_name = "LIST", value_parser = frames)]
    pub(super) frames: Option<Frames>,

    /// Refuse colliders that need more memory than this: `8GiB`, `500MiB`
    #[arg(long, value_name = "SIZE", value_parser = size)]
    pub(super) max_memory: Option<u64>,

    /// Write again what is there already
    #[arg(long)]
    pub(super) force: bool,
}

/// Arguments of `usd`.
#[derive(Debug, Args)]
pub(super) struct UsdArgs {
    /// A shot folder with PLY meshes or points, sheets or colliders
    #[arg(value_name = "SHOT")]
    pub(super) shot: PathBuf,

    /// The folder that gets `usd/` and `shot.json`; by default the shot folder itself
    #[arg(short, long, value_name = "DIR")]
    pub(super) output: Option<PathBuf>,

    /// The axis that points up: `z`, or `y` as in Houdini and Maya. Coordinates are turned, no transform is added
    #[arg(long, value_name = "AXIS", default_value = "z", value_parser = up_axis)]
    pub(super) up: UpAxis,

    /// Units in a metre: 100 for centimetres, as in Maya. Coordinates, velocities and widths are multiplied by it
    #[arg(long, value_name = "UNITS", default_value_t = 1.0, allow_negative_numbers = true, value_parser = scale)]
    pub(super) scale: f64,

    /// Add attributes under the names of a program: `houdini` (v, N, pscale, Cd) or `maya` (velocityPV, radiusPP, rgbPP)
    #[arg(long, value_name = "PROGRAM", value_parser = name_scheme)]
    pub(super) names: Option<NameScheme>,

    /// The frames to write: `1-240`, `1-240x2`, `1,5,9-12`. By default all that are there
    #[arg(long, value_name = "LIST", value_parser = frames)]
    pub(super) frames: Option<Frames>,

    /// Make so many frames at once as need about this much memory, and refuse a frame that needs more: `8GiB`, `500MiB`
    #[arg(long, value_name = "SIZE", value_parser = size)]
    pub(super) max_memory: Option<u64>,

    /// Write again what is there already
    #[arg(long)]
    pub(super) force: bool,
}

/// Arguments of `volume`.
#[derive(Debug, Args)]
pub(super) struct VolumeArgs {
    #[command(flatten)]
    pub(super) input: InputArgs,

    /// Grids: `density` (fog), `surface` (level set), `velocity`, `temperature` (of smoke). By default those of the preset, or all
    #[arg(long = "grid", value_name = "GRID", value_delimiter = ',', value_parser = volume_grid)]
    pub(super) grids: Vec<VolumeGrid>,

    /// `half` or `float`, short for `--set volume.precision=…`
    #[arg(long, value_name = "DIGITS")]
    pub(super) precision: Option<String>,

    /// `blosc`, `zip` or `none`, short for `--set volume.compression=…`
    #[arg(long, value_name = "HOW")]
    pub(super) compression: Option<String>,

    /// Play cached smoke so many times slower (or faster, below 1) without simulating again: into another folder, -o. Other
    /// tracers, too, are only advected by the cached air: --set smoke.tracers=…
    #[arg(long, value_name = "FACTOR", allow_negative_numbers = true)]
    pub(super) retime: Option<f64>,
}

/// Arguments of `whitewater`.
#[derive(Debug, Args)]
pub(super) struct WhitewaterArgs {
    /// A shot folder or its cache
    #[arg(value_name = "CACHE")]
    pub(super) cache: PathBuf,

    /// The folder that gets `whitewater/` and `shot.json`; by default the shot folder itself
    #[arg(short, long, value_name = "DIR")]
    pub(super) output: Option<PathBuf>,

    /// The frames to write: `1-240`, `1-240x2`, `1,5,9-12`. By default all that are there
    #[arg(long, value_name = "LIST", value_parser = frames)]
    pub(super) frames: Option<Frames>,

    /// Change a key of whitewater: `--set whitewater.amount=2`. May be repeated
    #[arg(long, value_name = "KEY=VALUE")]
    pub(super) set: Vec<String>,

    /// Refuse a frame that needs more memory than this: `8GiB`, `500MiB`
    #[arg(long, value_name = "SIZE", value_parser = size)]
    pub(super) max_memory: Option<u64>,

    /// Compute again what is there already
    #[arg(long)]
    pub(super) force: bool,
}

/// Arguments of `preview`.
#[derive(Debug, Args)]
#[command(long_about = "Draw shaded pictures of a cached shot, without Blender.\n\n\
        Writes preview/contact.png and preview/loop.webp of the whole shot, and with --frames the picture of each of \
        these frames. Meshes and whitewater that are in the folder are shown; a liquid without a mesh gets a draft surface in memory. \
        The camera is that of the preset, or one that frames what moves. docs/preview.md shows what to expect.")]
pub(super) struct PreviewArgs {
    /// A shot folder or its cache
    #[arg(value_name = "DIR")]
    pub(super) cache: PathBuf,

    /// The folder that gets `preview/` and `shot.json`; by default the shot folder itself
    #[arg(short, long, value_name = "DIR")]
    pub(super) output: Option<PathBuf>,

    /// The frames that get a picture of their own, `preview/frame_0001.png`: `1-240`, `1-240x2`, `1,5,9-12`
    #[arg(long, value_name = "LIST", value_parser = frames)]
    pub(super) frames: Option<Frames>,

    /// Width and height of these pictures in pixels, from 16 to 4096; loop and contact sheet have the same shape, 480 pixels wide
    #[arg(long, value_name = "WxH", default_value = "960x540", value_parser = picture_size)]
    pub(super) size: [usize; 2],

    /// What is shown of a liquid: its `surface`, or its particles by `speed`
    #[arg(long, value_name = "WHAT", default_value = "surface", value_parser = particle_look())]
    pub(super) show: ParticleLook,

    /// Refuse a picture that needs more memory than this: `8GiB`, `500MiB`
    #[arg(long, value_name = "SIZE", value_parser = size)]
    pub(super) max_memory: Option<u64>,

    /// Show each picture in the terminal as it is drawn, if that declares the graphics of kitty or sixel
    #[arg(long)]
    pub(super) live: bool,

    /// Draw the frames of a running simulation as they come: until all that were requested of it (or --frames) are drawn, waiting at
    /// most so long for each
    #[arg(long, value_name = "TIME", num_args = 0..=1, require_equals = true, default_missing_value = "1d", value_parser = wait)]
    pub(super) follow: Option<Duration>,

    /// Write `preview/report.html` too: one page with the loop, plots over frames, warnings, settings and the command of the shot
    #[arg(long)]
    pub(super) report: bool,

    /// Draw again what is there already
    #[arg(long)]
    pub(super) force: bool,
}

/// The looks of particles, by their names.
fn particle_look() -> impl TypedValueParser<Value = ParticleLook> {
    PossibleValuesParser::new(ParticleLook::ALL.map(ParticleLook::name)).map(|name| {
        ParticleLook::ALL.into_iter().find(|look| look.name() == name).expect("only these are accepted")
    })
}
