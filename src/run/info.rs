//! What is in a shot folder.

use super::{Failure, FrameSpan, Manifest, OutputFiles, RunError, ShotFolder, Total};
use crate::{
    cache::{self, CacheError, FrameKeys, StreamInfo},
    frame::FrameIndex,
    job::{file_records::FileRecords, log, totals_by_key},
    product,
    sim::{FrameRecord, registry, system::CachedFrame},
};
use serde::Serialize;
use serde_json::{Map, Value};
use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
};

/// What a shot folder holds.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Info {
    /// The shot's name.
    pub title: String,
    /// Frames a second; 0 if the folder has no manifest.
    pub fps: f64,
    /// The requested frames, if the folder has a manifest.
    pub span: Option<FrameSpan>,
    /// The frames that are there.
    pub frames: Vec<FrameState>,
    /// Requested frames that are missing, in ascending order; the first thousand of more.
    pub missing: Vec<u32>,
    /// How many these are.
    pub missing_count: u64,
    /// Sums and extremes of each system over the frames that are present and sound.
    #[serde(flatten, serialize_with = "totals_by_key")]
    pub totals: Vec<Total>,
    /// Files made of the frames.
    pub outputs: Vec<OutputInfo>,
    /// What the products know of their files beyond the manifest, for programs.
    #[serde(flatten)]
    pub products: Map<String, Value>,
    /// Products as text, a line each.
    #[serde(skip)]
    pub product_lines: Vec<String>,
}

/// One cached frame.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct FrameState {
    /// Frame number.
    pub frame: u32,
    /// Time since the start of the shot [s].
    pub time: f64,
    /// Particles of all systems.
    pub particles: u64,
    /// Size on disk.
    pub bytes: u64,
    /// Named numbers of the systems.
    #[serde(flatten)]
    pub figures: BTreeMap<&'static str, f64>,
    /// Fault of the frame.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fault: Option<String>,
    /// Which kind of fault that is.
    #[serde(skip)]
    pub failure: Option<Failure>,
}

/// One sequence of files.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct OutputInfo {
    /// "mesh" or "points".
    pub kind: String,
    /// The system it shows.
    pub name: String,
    /// "ply" or "obj".
    pub format: String,
    /// File name with the frame number as `{:04}`.
    pub pattern: String,
    /// Whether every frame has a file of its own.
    #[serde(skip)]
    pub is_per_frame: bool,
    /// Files that are there; of a file for several frames, the frames that it has.
    pub present: usize,
    /// Files that should be there and are not.
    pub missing: u64,
}

/// Whether frames were simulated into the folder.
///
/// # Errors
/// If there is a manifest that cannot be read.
pub(crate) fn is_shot(folder: &ShotFolder) -> Result<bool, RunError> {
    Ok(Manifest::keys_in(folder)?.is_some() || cache::list(&folder.cache()).is_ok())
}

/// Lists what is in the folder.
///
/// # Errors
/// If there is neither a cache nor a manifest. Damaged frames, and those of another version, are part of the
/// result.
pub(crate) fn info(folder: &ShotFolder) -> Result<Info, RunError> {
    let manifest = Manifest::read(folder)?;
    let present = match cache::list(&folder.cache()) {
        Err(CacheError::NotFound { .. }) if manifest.is_some() => Vec::new(),
        listed => listed?,
    };
    let mut log = log::read::<FrameRecord>(folder)?;
    let (mut frames, mut cached) = (Vec::new(), Vec::new());
    let keys = manifest.as_ref().and_then(Manifest::frame_keys);
    for (index, path) in present {
        let (state, streams) = frame_state(index, &path, keys.as_ref());
        if state.fault.is_none() {
            let record = log.remove(&index).map(|line| line.record);
            cached.push(CachedFrame { index, streams, record });
        }
        frames.push(state);
    }
    let span = manifest.as_ref().map(|manifest| manifest.frames);
    let (missing, missing_count) = span.map_or_else(Default::default, |span| lacking(span, &frames));
    let outputs = manifest.iter().flat_map(|manifest| &manifest.outputs);
    let (mut products, mut product_lines) = (Map::new(), Vec::new());
    for product in product::ALL {
        let info = product.info(folder)?;
        products.extend(info.values);
        product_lines.extend(info.lines);
    }
    Ok(Info {
        title: manifest
            .as_ref()
            .map_or_else(|| "Cache without shot.json".into(), |known| known.title.clone()),
        fps: manifest.as_ref().map_or(0.0, |known| known.fps),
        span,
        totals: registry::ALL.iter().flat_map(|system| system.totals(&cached)).collect(),
        outputs: outputs.map(|output| output_info(output, folder)).collect::<Result<_, _>>()?,
        frames,
        missing,
        missing_count,
        products,
        product_lines,
    })
}

impl Info {
    /// The totals as text, a line each.
    pub(crate) fn total_lines(&self) -> impl Iterator<Item = String> {
        self.totals.iter().map(Total::line)
    }
}

/// Missing frames that are listed.
const MAX_LISTED_MISSING: usize = 1000;

/// The state of a frame and the streams in its header.
fn frame_state(index: FrameIndex, path: &Path, keys: Option<&FrameKeys>) -> (FrameState, Vec<StreamInfo>) {
    let mut state = FrameState {
        frame: index.0,
        time: 0.0,
        particles: 0,
        bytes: 0,
        figures: BTreeMap::new(),
        fault: None,
        failure: None,
    };
    let mut streams = Vec::new();
    let header = cache::read_header(path)
        .and_then(|info| keys.map_or(Ok(()), |keys| keys.expect(&info, path)).map(|()| info));
    match header {
        Ok(info) => {
            state.time = info.time;
            state.bytes = info.bytes;
            let points = info.streams.iter().filter(|stream| stream.kind.has_positions());
            state.particles = points.map(|stream| stream.len).sum();
            let figures = registry::ALL.iter().flat_map(|system| system.frame_figures(&info.streams));
            state.figures = figures.collect();
            streams = info.streams;
        }
        // Also of one that cannot be read: the others are listed.
        Err(damage) => {
            state.fault = Some(damage.to_string());
            state.failure = Some(Failure::of(&damage));
        }
    }
    (state, streams)
}

/// The first of the frames that a span has and that are not there, and how many these are; none where there is no frame at all.
fn lacking(span: FrameSpan, frames: &[FrameState]) -> (Vec<u32>, u64) {
    if frames.is_empty() {
        return (Vec::new(), 0);
    }
    // A span may have a frame for each of 2³² numbers.
    let is_lacking = |number: &u32| frames.binary_search_by_key(number, |frame| frame.frame).is_err();
    let present = frames.iter().filter(|frame| span.contains(frame.frame)).count() as u64;
    (span.numbers().filter(is_lacking).take(MAX_LISTED_MISSING).collect(), span.count() - present)
}

/// Files of an output that exist.
fn output_info(output: &OutputFiles, folder: &ShotFolder) -> Result<OutputInfo, RunError> {
    let subfolder = output.pattern.split('/').next().unwrap_or_default();
    let product = product::ALL.into_iter().find(|product| product.name() == subfolder);
    let is_of_selected =
        output.is_per_frame() && product.is_some_and(|product| product.is_of_selected_frames());
    let expected = match is_of_selected {
        true => {
            let records = FileRecords::read(folder, subfolder)?;
            let recorded = records.frames_with(|frame| output.file_name(frame));
            let frames = output.present(folder).into_iter().chain(recorded);
            frames.filter(|&frame| output.frames.contains(frame)).collect::<BTreeSet<u32>>().len() as u64
        }
        false => output.frames.count(),
    };
    let present = match output.is_per_frame() {
        true => output.present(folder).len(),
        // A sheet has one file for all of its frames.
        false => {
            let is_there = |path: &str| folder.root().join(path).is_file();
            if output.paths().all(is_there) { output.frames.count() as usize } else { 0 }
        }
    };
    Ok(OutputInfo {
        kind: output.kind.clone(),
        name: output.name.clone(),
        format: output.format.clone(),
        pattern: output.pattern.clone(),
        is_per_frame: output.is_per_frame(),
        present,
        missing: expected.saturating_sub(present as u64),
    })
}

/// Ascending frame numbers as `--frames` takes them: `3,5-9`.
pub(crate) fn frame_ranges(frames: &[u32]) -> String {
    let runs = frames.chunk_by(|a, b| a.checked_add(1) == Some(*b)).map(|run| match run {
        [first, .., last] => format!("{first}-{last}"),
        _ => run[0].to_string(),
    });
    runs.collect::<Vec<_>>().join(",")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_listed_as_ranges() {
        assert_eq!(frame_ranges(&[1, 3, 4, 5, 9, 10]), "1,3-5,9-10");
        assert_eq!(frame_ranges(&[]), "");
    }
}
