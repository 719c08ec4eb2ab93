//! Volume files of frames: grids of particles and of tracers.

use super::{
    file::{figures, names, up_to_date, write_file},
    folder::VolumeFile,
    memory::{max_volume_memory, stream_memory},
    particle_grids::{ParticleGridStats, ParticleGrids},
    settings::VolumeSettings,
    tracer_grids::TracerFrame,
    tracers::{no_velocity, tracer_key, write_tracers},
};
use crate::{
    export::vdb::{VolumeGrid, VolumeParams},
    field::Anisotropy,
    frame::{Stream, StreamKind},
    job::{
        Control, Failure, RunError, ShotFolder,
        batch::{
            BatchRequest, BatchSummary, FileTarget, FrameFiles, FrameOutcome, ProductFolder, Source,
            StreamHeader, StreamInput, StreamWriter, process_streams,
        },
        nonzero,
    },
    mesh::{self, DistanceParams, RadiusSource, SurfaceError, SurfaceParams},
    sim::smoke::ShotAir,
};
use serde::Serialize;
use std::time::Instant;
use xxhash_rust::xxh3::xxh3_64;

/// Raised whenever a change of what a volume holds gives the same particles and settings another file. Changes of the
/// surface raise [`mesh::SURFACE_VERSION`].
const VOLUME_VERSION: u32 = 2;

/// Makes volumes of the frames of `source` in `out`, several at once where memory allows.
///
/// Frames are numbered, kept, left out and reported as by meshes; one without particles gives
/// a file with empty grids.
///
/// # Errors
/// As [`Product::make`](crate::product::interface::Product::make).
pub(super) fn volume(
    source: Source,
    out: &ShotFolder,
    settings: &VolumeSettings,
    request: &BatchRequest,
    control: Control,
) -> Result<BatchSummary, RunError> {
    let requested = |available: &[VolumeGrid]| -> Vec<VolumeGrid> {
        settings.grids.iter().copied().filter(|grid| available.contains(grid)).collect()
    };
    let particles = requested(&VolumeGrid::OF_PARTICLES);
    let tracers = requested(&VolumeGrid::OF_TRACERS);
    if particles.is_empty() && (tracers.is_empty() || settings.smoke.is_none()) {
        return Err(RunError::Request(format!(
            "particles have none of the requested grids; expected {}, or a shot of smoke",
            names(&VolumeGrid::OF_PARTICLES)
        )));
    }
    let text = content_text(settings, &particles);
    let air = settings.air();
    process_streams(
        source,
        out,
        &VolumeWriter { out, settings, particles, tracers, text, air },
        request,
        control,
    )
}

/// The settings that decide the content of volumes of particles, as text: not how a mesh is cleaned up.
fn content_text(settings: &VolumeSettings, grids: &[VolumeGrid]) -> String {
    #[derive(Serialize)]
    struct Decisive<'a> {
        voxel: f32,
        kernel_radius: f32,
        #[serde(skip_serializing_if = "Option::is_none")]
        radius: Option<RadiusSource>,
        anisotropy: &'a Option<Anisotropy>,
        distance: Option<DistanceParams>,
        volume: &'a VolumeParams,
        grids: &'a [VolumeGrid],
    }
    let VolumeSettings { surface, volume, .. } = settings;
    let SurfaceParams { voxel, kernel_radius, radius, anisotropy, distance, .. } = surface;
    let (voxel, kernel_radius, radius, distance) = (*voxel, *kernel_radius, *radius, *distance);
    serde_json::to_string(&Decisive { voxel, kernel_radius, radius, anisotropy, distance, volume, grids })
        .expect("settings are plain data")
}

/// Writes the volumes of streams of particles and of tracers.
struct VolumeWriter<'a> {
    out: &'a ShotFolder,
    settings: &'a VolumeSettings,
    /// The requested grids of particles, and of tracers.
    particles: Vec<VolumeGrid>,
    tracers: Vec<VolumeGrid>,
    /// The settings that decide the content of volumes of particles, as text.
    text: String,
    /// The air that moves tracers, if its velocity is requested.
    air: Option<ShotAir>,
}

impl StreamWriter for VolumeWriter<'_> {
    fn folder(&self) -> &dyn ProductFolder {
        &VolumeFile
    }

    fn accepts(&self, kind: StreamKind) -> bool {
        match kind {
            StreamKind::Particles => !self.particles.is_empty(),
            StreamKind::Tracers => !self.tracers.is_empty(),
            _ => false,
        }
    }

    fn no_stream(&self) -> String {
        format!(
            "no stream of this cache has any of the requested grids ({}); expected {} of tracers, or {} of particles",
            names(&self.settings.grids),
            names(&VolumeGrid::OF_TRACERS),
            names(&VolumeGrid::OF_PARTICLES)
        )
    }

    fn key(&self, stream: &StreamHeader, spacing: f32) -> u64 {
        if stream.kind == StreamKind::Tracers {
            return tracer_key(self.settings, &self.tracers, stream.state);
        }
        let versions = [VOLUME_VERSION, mesh::SURFACE_VERSION];
        xxh3_64(format!("{versions:?} {:016x} {spacing} {}", stream.state, self.text).as_bytes())
    }

    fn up_to_date(&self, target: &FileTarget) -> Option<FrameFiles> {
        up_to_date(self.out, target)
    }

    fn max_memory(&self, particles: usize) -> u64 {
        max_volume_memory(StreamKind::Particles, particles, &self.settings.surface, &self.settings.grids)
    }

    fn memory(&self, stream: &Stream, spacing: f32, _: u64) -> u64 {
        stream_memory(stream, spacing, &self.settings.surface, &self.settings.grids)
    }

    fn write(
        &self,
        input: StreamInput<'_>,
        target: &FileTarget,
        outcome: &mut FrameOutcome,
        control: Control,
    ) -> Result<(), RunError> {
        if input.stream.kind != StreamKind::Tracers {
            return self.write_particles(input, target, outcome, control);
        }
        let air = self.air.as_ref().map(|air| air.frame(input.streams, input.time)).transpose();
        let air = match air {
            Ok(air) => air,
            Err(why) => {
                outcome.fail(no_velocity(&why), Failure::Other);
                return Ok(());
            }
        };
        let frame = TracerFrame {
            tracers: input.stream,
            air: air.as_ref(),
            spacing: input.spacing,
            grids: &self.tracers,
            slowdown: 1.0,
        };
        write_tracers(self.out, self.settings, frame, target, outcome, control)
    }
}

impl VolumeWriter<'_> {
    /// Writes the volume of a stream of particles.
    fn write_particles(
        &self,
        StreamInput { stream, spacing, .. }: StreamInput<'_>,
        target: &FileTarget,
        outcome: &mut FrameOutcome,
        control: Control,
    ) -> Result<(), RunError> {
        let start = Instant::now();
        let VolumeSettings { surface, volume, .. } = self.settings;
        let requested = &self.particles;
        let grids = match ParticleGrids::new(stream, spacing, surface, requested, control.cancel) {
            Ok(found) if found.names().is_empty() => {
                let why = "the particles have no velocities, and no other grid is requested";
                outcome.fail(why.into(), Failure::Other);
                return Ok(());
            }
            Ok(found) => found,
            Err(SurfaceError::Interrupted) => return Err(RunError::Interrupted),
            Err(why) => {
                outcome.fail(why.to_string(), Failure::Other);
                return Ok(());
            }
        };
        let written = write_file(self.out, target, outcome, &grids.names(), |path| {
            grids.write(path, volume, target.key)
        })?;
        let Some((output, mut written)) = written else { return Ok(()) };
        let mut remarks = remarks(&grids.stats);
        if requested.len() > grids.names().len() {
            remarks.insert(0, "the particles have no velocities".into());
        }
        let bytes = written.record.bytes();
        written.figures = figures(target.index, &grids.names(), grids.stats.bricks, bytes, start, &remarks);
        outcome.files.push(FrameFiles { outputs: vec![output], written: Some(written), stale: Vec::new() });
        Ok(())
    }
}

/// What a volume lacks of its particles.
fn remarks(stats: &ParticleGridStats) -> Vec<String> {
    nonzero(&[
        (stats.too_far as u64, "particles too far from the origin, left out"),
        (stats.unseen as u64, "particles between grid nodes, without effect (surface.voxel)"),
        (
            stats.clustered as u64,
            "particles left out of clusters of more than 8 in a cube of half a spacing (check the spacing)",
        ),
        (stats.over_one as u64, "nodes denser than filled space, limited to 1"),
        (stats.without_velocity as u64, "nodes of the density without a velocity"),
    ])
}
