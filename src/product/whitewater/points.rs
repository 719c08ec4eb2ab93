//! The files of a frame: points as PLY and NPZ, with `radius`, `velocity`, `id`, `kind` and `age`, and volumes (`volume.rs`).

use super::{
    chain::ChainFrame,
    folder::WhitewaterPoints,
    volume::{self, Fractions},
};
use crate::{
    cache::WrittenFile,
    export::{
        MeshFormat, ply,
        vdb::{self, VolumeParams},
    },
    frame::{Channel, FrameIndex, Stream},
    job::{
        OutputFiles, RunError, ShotFolder,
        batch::{BatchRequest, FileTarget, FrameFiles, ProductFolder, Written},
        file_records::{FileRecords, hex},
    },
    mesh::Points,
    sim::whitewater::{Kind, WhitewaterFormat, WhitewaterParams},
};
use std::{path::Path, time::Instant};
use xxhash_rust::xxh3::xxh3_64;

/// Raised whenever a change of what a file holds gives the same whitewater another one.
const POINTS_VERSION: u32 = 1;

/// Raised whenever a change of what a volume holds gives the same whitewater another one.
const VOLUME_VERSION: u32 = 1;

/// The name of the files.
const NAME: &str = "whitewater";

/// Attributes of points, without their places and radii.
const ATTRIBUTES: [&str; 4] = ["velocity", "id", "kind", "age"];

/// What files of frames are made with.
#[derive(Clone, Copy)]
pub(super) struct FileSettings<'a> {
    pub(super) params: &'a WhitewaterParams,
    pub(super) volume: &'a VolumeParams,
    pub(super) request: &'a BatchRequest,
    /// What was written before.
    pub(super) records: &'a FileRecords,
}

impl FileSettings<'_> {
    /// What the files of a frame are made for: whitewater with a key, of a state of the liquid, selected by an amount.
    pub(super) fn target(&self, index: FrameIndex, key: u64, state: Option<u64>) -> FileTarget {
        let text = format!("whitewater points {POINTS_VERSION} {key:016x} {}", self.params.amount);
        FileTarget { index, name: NAME.into(), key: xxh3_64(text.as_bytes()), state }
    }

    /// The key of the volume of a target, which its own settings decide, too.
    fn volume_key(&self, target: &FileTarget) -> u64 {
        let settings = serde_json::to_string(&(self.params.voxel, self.volume.compression));
        let settings = settings.expect("settings are plain data");
        xxh3_64(format!("whitewater volume {VOLUME_VERSION} {:016x} {settings}", target.key).as_bytes())
    }

    /// Outputs that are not requested, and whose file of the frame shows other whitewater.
    fn stale(&self, out: &ShotFolder, target: &FileTarget) -> Vec<OutputFiles> {
        let others = WhitewaterFormat::ALL.into_iter().filter(|format| !self.params.files.contains(format));
        let outputs = others.map(|format| output(format, target.index));
        let shows_other = |output: &OutputFiles| {
            let record = self.records.of(&output.file_name(target.index.0));
            output.file(out, target.index.0).exists()
                && record.is_none_or(|(record, _)| record.key != hex(target.key))
        };
        outputs.filter(shows_other).collect()
    }

    /// The files of a target, if they are there as their records have them.
    pub(super) fn up_to_date(&self, out: &ShotFolder, target: &FileTarget) -> Option<FrameFiles> {
        let outputs = self.params.files.iter().map(|&format| {
            let mut output = output(format, target.index);
            if format == WhitewaterFormat::Ply {
                output.attributes = MeshFormat::Ply.attributes_in(&output.file(out, target.index.0));
            }
            output
        });
        let outputs: Vec<OutputFiles> = outputs.collect();
        let volume = outputs.iter().find(|output| output.format == "vdb");
        let has_key = volume.is_none_or(|output| {
            let found = vdb::made_from(&output.file(out, target.index.0));
            found.is_some_and(|(key, _)| key == self.volume_key(target))
        });
        let files = FrameFiles { outputs, written: None, stale: self.stale(out, target) };
        (has_key && files.are_recorded(out, self.records, target)).then_some(files)
    }

    /// Writes the files of a target. Returns them, and the particles that volumes cannot hold.
    ///
    /// # Errors
    /// If one cannot be written, or takes more memory than allowed.
    pub(super) fn write(
        &self,
        frame: &ChainFrame<'_>,
        out: &ShotFolder,
        target: &FileTarget,
        start: Instant,
    ) -> Result<(FrameFiles, u64), RunError> {
        let stream = frame.whitewater.selected(frame.spacing, self.params.amount);
        let mut written = Written::of(target);
        let (mut outputs, mut too_far) = (Vec::new(), 0);
        for &format in &self.params.files {
            let mut output = output(format, target.index);
            let path = output.file(out, target.index.0);
            let file = match format {
                WhitewaterFormat::Ply => ply::write_points(&points(&stream), &path, target.key)?,
                WhitewaterFormat::Npz => npz(&stream, &path)?,
                WhitewaterFormat::Vdb => {
                    let voxel = self.params.voxel.unwrap_or(frame.spacing);
                    let made = Fractions::new(&stream, voxel, |bytes| {
                        self.request.check_memory(None, |_| bytes).map(drop)
                    })?;
                    too_far = made.too_far;
                    made.write(&path, self.volume.compression, self.volume_key(target))?
                }
            };
            written.add(&output, file);
            if format == WhitewaterFormat::Ply {
                output.attributes = MeshFormat::Ply.attributes_in(&path);
            }
            outputs.push(output);
        }
        let record = &frame.whitewater.record;
        let numbers = record.numbers().into_iter();
        written.record_figures = numbers.map(|(name, value)| (name.to_owned(), value.into())).collect();
        written.record_figures.insert("too_far_for_volume".into(), too_far.into());
        // Of the particles in the files, which a smaller amount selects.
        for kind in Kind::ALL {
            let of_kind =
                stream.u32("kind").map_or(0, |kinds| kinds.iter().filter(|&&k| k == kind as u32).count());
            written.record_figures.insert(kind.name().into(), of_kind.into());
        }
        let (count, mib) = (stream.len(), written.record.bytes() as f64 / f64::from(1 << 20));
        let seconds = start.elapsed().as_secs_f64();
        written.figures = format!("frame {}  {count} particles  {mib:.2} MiB  {seconds:.2} s", target.index);
        Ok((FrameFiles { outputs, written: Some(written), stale: self.stale(out, target) }, too_far))
    }
}

/// The points of a stream of whitewater.
fn points(stream: &Stream) -> Points {
    let (Some(positions), Some(radii)) = (stream.vec3("position"), stream.f32("radius")) else {
        unreachable!("whitewater has places and radii")
    };
    let channel = |&name: &&str| Some(Channel { name: name.into(), data: stream.channel(name)?.clone() });
    let attributes: Vec<Channel> = ATTRIBUTES.iter().filter_map(channel).collect();
    Points { positions: positions.to_vec(), radii: radii.to_vec(), attributes, ..Points::default() }
}

/// Writes the points of a stream as NumPy arrays.
#[cfg(feature = "npz")]
fn npz(stream: &Stream, path: &Path) -> Result<WrittenFile, RunError> {
    let names = ["position", "radius"].into_iter().chain(ATTRIBUTES);
    let arrays: Vec<_> = names.filter_map(|name| Some((name, stream.channel(name)?))).collect();
    Ok(crate::export::npz::write(path, &arrays)?)
}

/// Builds without NPZ refuse it when they check the preset.
#[cfg(not(feature = "npz"))]
fn npz(_: &Stream, path: &Path) -> Result<WrittenFile, RunError> {
    Err(RunError::Request(format!("{}: this build writes no NPZ files", path.display())))
}

/// The output of a format, with one frame.
fn output(format: WhitewaterFormat, index: FrameIndex) -> OutputFiles {
    let points = |extension: &str| OutputFiles::of("points", WhitewaterPoints.name(), NAME, extension, index);
    match format {
        WhitewaterFormat::Ply => points("ply"),
        WhitewaterFormat::Npz => points("npz"),
        WhitewaterFormat::Vdb => volume::output(NAME, index),
    }
}
