//! The job that turns particles into volume files.

use super::{
    Control, Failure, OutputFiles, RunError, ShotFolder, Source,
    job::{self, Job, Make, Target},
    ledger::{Done, Made, Piece, Work},
    plan::Product,
    remarks,
    volume_grids::VolumeGrids,
};
use crate::{
    export::{
        ExportError,
        vdb::{self, VolumeGrid, VolumeParams},
    },
    field::Anisotropy,
    frame::{FrameIndex, Stream},
    mesh::{self, DistanceParams, SurfaceError, SurfaceParams},
};
use serde::Serialize;
use std::time::Instant;
use xxhash_rust::xxh3::xxh3_64;

/// Raised whenever a change of what a volume holds gives the same particles and settings another file. Changes of the
/// surface raise [`mesh::SURFACE_VERSION`].
const VOLUME_VERSION: u32 = 2;

/// What is made of every frame.
#[derive(Clone, Debug, PartialEq)]
pub struct VolumeSettings {
    /// How particles become a density.
    pub surface: SurfaceParams,
    /// How grids are stored.
    pub volume: VolumeParams,
    /// Which grids a file has; at least one.
    pub grids: Vec<VolumeGrid>,
}

/// Makes volumes of the frames of `source` in `out`, several at once where memory allows.
///
/// Frames are numbered, kept, left out and told as by [`surface`](super::surface::surface); one without particles gives
/// a file with empty grids.
///
/// # Errors
/// As [`surface`](super::surface::surface).
pub fn volume(
    source: Source,
    out: &ShotFolder,
    settings: &VolumeSettings,
    job: &Job,
    control: Control,
) -> Result<Done, RunError> {
    job::run(source, out, &Volumes { out, settings, text: decisive(settings) }, job, control)
}

/// All that decides what the volumes of a state hold, as text: not how a mesh of it is cleaned up.
fn decisive(settings: &VolumeSettings) -> String {
    #[derive(Serialize)]
    struct Decisive<'a> {
        voxel: f32,
        kernel_radius: f32,
        anisotropy: &'a Option<Anisotropy>,
        distance: Option<DistanceParams>,
        volume: &'a VolumeParams,
        grids: &'a [VolumeGrid],
    }
    let VolumeSettings { surface, volume, grids } = settings;
    let SurfaceParams { voxel, kernel_radius, anisotropy, distance, .. } = surface;
    let (voxel, kernel_radius, distance) = (*voxel, *kernel_radius, *distance);
    serde_json::to_string(&Decisive { voxel, kernel_radius, anisotropy, distance, volume, grids })
        .expect("settings are plain data")
}

/// Makes volumes.
struct Volumes<'a> {
    out: &'a ShotFolder,
    settings: &'a VolumeSettings,
    /// What decides their content, as text.
    text: String,
}

impl Make for Volumes<'_> {
    const PRODUCT: Product = Product::Volumes;

    fn params(&self) -> &SurfaceParams {
        &self.settings.surface
    }

    fn key(&self, state: u64, spacing: f32) -> u64 {
        let versions = [VOLUME_VERSION, mesh::SURFACE_VERSION];
        xxh3_64(format!("{versions:?} {state:016x} {spacing} {}", self.text).as_bytes())
    }

    fn kept(&self, target: &Target) -> Option<Piece> {
        let mut output = output(target);
        let (key, grids) = vdb::made_from(&output.file(self.out, target.index.0))?;
        if key != target.key {
            return None;
        }
        // Which grids were made depends on the frame's particles, too.
        output.grids = grids;
        Some(Piece { outputs: vec![output], work: None, stale: Vec::new() })
    }

    fn make(
        &self,
        stream: &Stream,
        spacing: f32,
        target: &Target,
        made: &mut Made,
        control: Control,
    ) -> Result<(), RunError> {
        let start = Instant::now();
        let keep_going = || !(control.interrupted)();
        let VolumeSettings { surface, volume, grids: wanted } = self.settings;
        let grids = match VolumeGrids::new(stream, spacing, surface, wanted, &keep_going) {
            Ok(found) if found.names().is_empty() => {
                let why = "the particles have no velocities, and no other grid is asked for";
                made.fail(why.into(), Failure::Other);
                return Ok(());
            }
            Ok(found) => found,
            Err(SurfaceError::Interrupted) => return Err(RunError::Interrupted),
            Err(why) => {
                made.fail(why.to_string(), Failure::Other);
                return Ok(());
            }
        };
        let mut output = output(target);
        let bytes = match grids.write(&output.file(self.out, target.index.0), volume, target.key) {
            Ok(bytes) => bytes,
            Err(why @ ExportError::Volume { .. }) => {
                made.fail(why.to_string(), Failure::Other);
                return Ok(());
            }
            Err(why) => return Err(why.into()),
        };
        output.grids = grids.names().into_iter().map(|grid| grid.name().into()).collect();
        let lacking = wanted.len() > output.grids.len();
        let figures = figures(target.index, &grids, lacking, bytes, start.elapsed().as_secs_f64());
        let work = Some(Work { bytes, triangles: 0, figures, record: None });
        made.pieces.push(Piece { outputs: vec![output], work, stale: Vec::new() });
        Ok(())
    }
}

/// The output that the volume of a target belongs to, with its frame alone.
fn output(target: &Target) -> OutputFiles {
    OutputFiles::of("volume", "volume", &target.name, "vdb", target.index)
}

/// One line about a frame; `lacking` velocities that were asked for.
fn figures(index: FrameIndex, grids: &VolumeGrids, lacking: bool, bytes: u64, seconds: f64) -> String {
    let names: Vec<&str> = grids.names().into_iter().map(VolumeGrid::name).collect();
    let mib = bytes as f64 / f64::from(1 << 20);
    let bricks = grids.stats.bricks;
    let mut line =
        format!("frame {index}  {}  {bricks} bricks  {mib:.2} MiB  {seconds:.2} s", names.join(", "));
    if lacking {
        line += "  the particles have no velocities";
    }
    for remark in remarks::of_volume(&grids.stats) {
        line += &format!("  {remark}");
    }
    line
}
