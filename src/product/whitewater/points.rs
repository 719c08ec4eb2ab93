//! The PLY file of a frame: positions with `radius`, `velocity`, `id`, `kind` and `age`.

use super::{chain::ChainFrame, folder::WhitewaterPoints};
use crate::{
    export::{MeshFormat, ply},
    frame::{Channel, FrameIndex},
    job::{
        OutputFiles, RunError, ShotFolder,
        batch::{FileTarget, FrameFiles, ProductFolder, Written},
    },
    mesh::Points,
    sim::whitewater::Kind,
};
use std::time::Instant;
use xxhash_rust::xxh3::xxh3_64;

/// Raised whenever a change of what a file holds gives the same whitewater another one.
const POINTS_VERSION: u32 = 1;

/// The name of the files.
const NAME: &str = "whitewater";

/// What the file of a frame is made for: whitewater with a key, selected by an amount.
pub(super) fn target(index: FrameIndex, key: u64, amount: f32) -> FileTarget {
    let key = xxh3_64(format!("whitewater points {POINTS_VERSION} {key:016x} {amount}").as_bytes());
    FileTarget { index, name: NAME.into(), key, state: None }
}

/// The file of a target, if it is there and has its key.
pub(super) fn up_to_date(out: &ShotFolder, target: &FileTarget) -> Option<FrameFiles> {
    let mut output = output(target);
    let path = output.file(out, target.index.0);
    output.attributes = MeshFormat::Ply.attributes_in(&path);
    let has_key = MeshFormat::Ply.key_in(&path) == Some(target.key);
    has_key.then(|| FrameFiles { outputs: vec![output], written: None, stale: Vec::new() })
}

/// Writes the file of a target.
///
/// # Errors
/// If it cannot be written.
pub(super) fn write(
    frame: &ChainFrame<'_>,
    amount: f32,
    out: &ShotFolder,
    target: &FileTarget,
    start: Instant,
) -> Result<FrameFiles, RunError> {
    let stream = frame.whitewater.selected(frame.spacing, amount);
    let (Some(positions), Some(radii)) = (stream.vec3("position"), stream.f32("radius")) else {
        unreachable!("whitewater has places and radii")
    };
    let attributes: Vec<Channel> = ["velocity", "id", "kind", "age"]
        .iter()
        .filter_map(|&name| Some(Channel { name: name.into(), data: stream.channel(name)?.clone() }))
        .collect();
    let points =
        Points { positions: positions.to_vec(), radii: radii.to_vec(), attributes, ..Points::default() };
    let mut output = output(target);
    let path = output.file(out, target.index.0);
    let mut written = Written::of(target);
    written.add(&output, ply::write_points(&points, &path, target.key)?);
    output.attributes = MeshFormat::Ply.attributes_in(&path);
    let record = &frame.whitewater.record;
    let numbers = record.numbers().into_iter();
    written.record_figures = numbers.map(|(name, value)| (name.to_owned(), value.into())).collect();
    // Of the particles in the file, which a smaller amount selects.
    for kind in Kind::ALL {
        let of_kind =
            stream.u32("kind").map_or(0, |kinds| kinds.iter().filter(|&&k| k == kind as u32).count());
        written.record_figures.insert(kind.name().into(), of_kind.into());
    }
    let (count, mib) = (points.positions.len(), written.record.bytes() as f64 / f64::from(1 << 20));
    let seconds = start.elapsed().as_secs_f64();
    written.figures = format!("frame {}  {count} particles  {mib:.2} MiB  {seconds:.2} s", target.index);
    Ok(FrameFiles { outputs: vec![output], written: Some(written), stale: Vec::new() })
}

/// The output that the file of a target belongs to, with its frame alone.
fn output(target: &FileTarget) -> OutputFiles {
    OutputFiles::of("points", WhitewaterPoints.name(), &target.name, "ply", target.index)
}
