//! Point files of tracers.

use crate::math::elementary::cbrt;
use crate::{
    export::{MeshFormat, ply},
    frame::{Channel, ChannelData, Stream, StreamKind},
    job::{
        Control, Failure, OutputFiles, RunError, ShotFolder,
        batch::{
            BatchRequest, BatchSummary, FileTarget, FrameFiles, FrameOutcome, ProductFolder, Source,
            StreamHeader, StreamInput, StreamWriter, Written, process_streams,
        },
        memory::BASE_MEMORY,
    },
    mesh::Points,
    product::{
        interface::Product,
        request::{ProductRequest, ProductSettings},
        volume::{Surroundings, no_velocity},
    },
    sim::smoke::ShotAir,
};
use std::time::Instant;
use xxhash_rust::xxh3::xxh3_64;

/// Raised whenever a change of what a file holds gives the same tracers another one.
const POINTS_VERSION: u32 = 3;

/// Memory of writing tracers [bytes/tracer].
const TRACER_BYTES: f64 = 230.0;

/// Writes the tracers of the frames of `source` to `out` as PLY points: positions, `radius`, `velocity`, `density`, `temperature` and `id`.
///
/// Frames are numbered, kept, left out and reported as for volumes. Frames without tracers give no file.
///
/// # Errors
/// As [`Product::make`].
fn points(
    source: Source,
    out: &ShotFolder,
    smoke: Option<Surroundings>,
    request: &BatchRequest,
    control: Control,
) -> Result<BatchSummary, RunError> {
    let air = smoke.as_ref().map(Surroundings::air);
    process_streams(source, out, &PointsWriter { out, air }, request, control)
}

/// Point files of tracers, as jobs see them.
pub(in crate::product) struct TracerPoints;

impl ProductFolder for TracerPoints {
    fn name(&self) -> &'static str {
        "points"
    }

    fn summary(&self, batch: &BatchSummary) -> String {
        let BatchSummary { folder, made, kept, .. } = batch;
        let (folder, mib) = (folder.display(), batch.mebibytes());
        format!("{folder}: {made} frames of points written ({mib:.1} MiB), {kept} up to date")
    }
}

impl Product for TracerPoints {
    fn verb(&self) -> &'static str {
        "export"
    }

    fn input(&self) -> &'static str {
        "tracers"
    }

    fn accepts(&self, kind: StreamKind) -> bool {
        kind == StreamKind::Tracers
    }

    fn is_requested(&self, settings: &ProductSettings) -> bool {
        settings.points
    }

    /// Without a format, `export` writes tracers.
    fn arguments(&self, _: &ProductSettings) -> Vec<String> {
        Vec::new()
    }

    fn max_memory(&self, _: &ProductSettings, _: StreamKind, tracers: usize) -> f64 {
        BASE_MEMORY + tracers as f64 * TRACER_BYTES
    }

    fn make(&self, request: &ProductRequest, control: Control) -> Result<BatchSummary, RunError> {
        let smoke = request.scene.and_then(Surroundings::of);
        points(request.frames()?, request.out, smoke, request.batch, control)
    }
}

/// Writes tracers as points.
struct PointsWriter<'a> {
    out: &'a ShotFolder,
    /// The air that moves them; `None`: they have no velocities.
    air: Option<ShotAir>,
}

impl StreamWriter for PointsWriter<'_> {
    fn folder(&self) -> &dyn ProductFolder {
        &TracerPoints
    }

    fn accepts(&self, kind: StreamKind) -> bool {
        kind == StreamKind::Tracers
    }

    fn key(&self, stream: &StreamHeader, spacing: f32) -> u64 {
        let (state, has_velocity) = (stream.state, self.air.is_some());
        xxh3_64(format!("points {POINTS_VERSION} {state:016x} {spacing} {has_velocity}").as_bytes())
    }

    fn up_to_date(&self, target: &FileTarget) -> Option<FrameFiles> {
        let mut output = output(target);
        let path = output.file(self.out, target.index.0);
        output.attributes = MeshFormat::Ply.attributes_in(&path);
        let has_key = MeshFormat::Ply.key_in(&path) == Some(target.key);
        has_key.then(|| FrameFiles { outputs: vec![output], written: None, stale: Vec::new() })
    }

    fn max_memory(&self, tracers: usize) -> u64 {
        (BASE_MEMORY + tracers as f64 * TRACER_BYTES) as u64
    }

    fn memory(&self, stream: &Stream, _: f32, _: u64) -> u64 {
        self.max_memory(stream.len())
    }

    fn write(
        &self,
        input: StreamInput<'_>,
        target: &FileTarget,
        outcome: &mut FrameOutcome,
        _: Control,
    ) -> Result<(), RunError> {
        let start = Instant::now();
        let Some(positions) = input.stream.vec3("position") else {
            outcome.fail("the tracers have no position; simulate the shot again".into(), Failure::Other);
            return Ok(());
        };
        let mut attributes: Vec<Channel> =
            input.stream.channels().iter().filter(|channel| channel.name != "position").cloned().collect();
        if let Some(air) = &self.air {
            let found = air.frame(input.streams, input.time).and_then(|air| Ok(air.velocity(positions)?));
            match found {
                Ok(velocity) => {
                    let data = ChannelData::Vec3(velocity);
                    attributes.insert(0, Channel { name: "velocity".into(), data });
                }
                Err(why) => {
                    outcome.fail(no_velocity(&why), Failure::Other);
                    return Ok(());
                }
            }
        }
        // The radius of a ball of the volume that a tracer was seeded for.
        let radius = input.spacing * cbrt(0.75 / std::f32::consts::PI);
        let radii = vec![radius; positions.len()];
        let points = Points { positions: positions.to_vec(), radii, attributes, ..Points::default() };
        let mut output = output(target);
        let path = output.file(self.out, target.index.0);
        let mut written = Written::of(target);
        written.add(&output, ply::write_points(&points, &path, target.key)?);
        output.attributes = MeshFormat::Ply.attributes_in(&path);
        let (count, mib) = (points.positions.len(), written.record.bytes() as f64 / f64::from(1 << 20));
        let seconds = start.elapsed().as_secs_f64();
        written.figures = format!("frame {}  {count} points  {mib:.2} MiB  {seconds:.2} s", target.index);
        outcome.files.push(FrameFiles { outputs: vec![output], written: Some(written), stale: Vec::new() });
        Ok(())
    }
}

/// The output that the file of a target belongs to, with its frame alone.
fn output(target: &FileTarget) -> OutputFiles {
    OutputFiles::of("points", TracerPoints.name(), &target.name, "ply", target.index)
}
