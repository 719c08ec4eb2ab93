//! The job that writes tracers as points.

use super::{
    Control, Failure, OutputFiles, RunError, ShotFolder, Source, Surroundings,
    job::{self, Job, Make, Part, Target},
    ledger::{Done, Made, Piece, Work},
    plan::Product,
    volume::no_air,
};
use crate::{
    export::{MeshFormat, ply},
    frame::{Channel, ChannelData},
    mesh::{Points, SurfaceParams},
    sim::smoke::{ShotAir, TRACERS},
};
use std::time::Instant;
use xxhash_rust::xxh3::xxh3_64;

/// Raised whenever a change of what a file holds gives the same tracers another one.
const POINTS_VERSION: u32 = 3;

/// Writes the tracers of the frames of `source` to `out` as PLY points: places, `radius`, `velocity`, `density`, `temperature` and `id`.
///
/// Frames are numbered, kept, left out and told as by [`volume`](super::volume::volume). Frames without smoke give no file.
///
/// # Errors
/// As [`volume`](super::volume::volume).
pub fn points(
    source: Source,
    out: &ShotFolder,
    smoke: Option<&Surroundings>,
    job: &Job,
    control: Control,
) -> Result<Done, RunError> {
    let params = SurfaceParams::default();
    let air = smoke.map(Surroundings::air);
    job::run(source, out, &Tracers { out, air, params }, job, control)
}

/// Writes tracers.
struct Tracers<'a> {
    out: &'a ShotFolder,
    /// What moves them; `None`: they have no velocities.
    air: Option<ShotAir>,
    /// Nothing is made into a surface.
    params: SurfaceParams,
}

impl Make for Tracers<'_> {
    const PRODUCT: Product = Product::Points;

    fn params(&self) -> &SurfaceParams {
        &self.params
    }

    fn takes(&self, stream: &str) -> bool {
        stream == TRACERS
    }

    fn nothing(&self) -> String {
        "no tracers in this cache: only shots of smoke have them. `meniscus mesh` turns liquids into surfaces"
            .into()
    }

    fn key(&self, _: &str, state: u64, spacing: f32) -> u64 {
        let moved = self.air.is_some();
        xxh3_64(format!("points {POINTS_VERSION} {state:016x} {spacing} {moved}").as_bytes())
    }

    fn kept(&self, target: &Target) -> Option<Piece> {
        let mut output = output(target);
        let path = output.file(self.out, target.index.0);
        output.attributes = MeshFormat::Ply.attributes_in(&path);
        let same = MeshFormat::Ply.key_in(&path) == Some(target.key);
        same.then(|| Piece { outputs: vec![output], work: None, stale: Vec::new() })
    }

    fn make(
        &self,
        part: Part<'_>,
        spacing: f32,
        target: &Target,
        made: &mut Made,
        _: Control,
    ) -> Result<(), RunError> {
        let start = Instant::now();
        let Some(positions) = part.stream.vec3("position") else {
            made.fail("the tracers have no position; simulate the shot again".into(), Failure::Other);
            return Ok(());
        };
        let mut attributes: Vec<Channel> =
            part.stream.channels().iter().filter(|channel| channel.name != "position").cloned().collect();
        if let Some(air) = &self.air {
            let found = air.frame(part.streams, part.time).and_then(|air| Ok(air.velocity(positions)?));
            match found {
                Ok(velocity) => {
                    let data = ChannelData::Vec3(velocity);
                    attributes.insert(0, Channel { name: "velocity".into(), data });
                }
                Err(why) => {
                    made.fail(no_air(&why), Failure::Other);
                    return Ok(());
                }
            }
        }
        // A ball of the volume that a tracer was seeded for.
        let radius = spacing * (0.75 / std::f32::consts::PI).cbrt();
        let radii = vec![radius; positions.len()];
        let points = Points { positions: positions.to_vec(), radii, attributes };
        let mut output = output(target);
        let path = output.file(self.out, target.index.0);
        let bytes = ply::write_points(&points, &path, target.key)?;
        output.attributes = MeshFormat::Ply.attributes_in(&path);
        let (count, mib) = (points.positions.len(), bytes as f64 / f64::from(1 << 20));
        let seconds = start.elapsed().as_secs_f64();
        let figures = format!("frame {}  {count} points  {mib:.2} MiB  {seconds:.2} s", target.index);
        let work = Some(Work { bytes, triangles: 0, figures, record: None });
        made.pieces.push(Piece { outputs: vec![output], work, stale: Vec::new() });
        Ok(())
    }
}

/// The output that the file of a target belongs to, with its frame alone.
fn output(target: &Target) -> OutputFiles {
    OutputFiles::of("points", "points", &target.name, "ply", target.index)
}
