//! Where the frames of a batch come from.

use crate::{
    cache::{self, FrameKeys},
    control::printable,
    frame::{Frame, FrameIndex, SPACING_RANGE, Stream, StreamKind},
    import::{ImportError, ParticleFile, Sequence},
    job::{Manifest, RunError, ShotFolder},
    preset::Frames,
};
use std::{
    path::{Path, PathBuf},
    time::Duration,
};
use xxhash_rust::xxh3::xxh3_64;

/// Where particles come from.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Source<'a> {
    /// The cache of a shot.
    Cache(&'a ShotFolder),
    /// Files of any solver.
    Files {
        /// The files.
        sequence: &'a Sequence,
        /// Distance between particles at rest [m], which files lack.
        spacing: f32,
    },
}

/// A requested frame, and the file it is in, if there is one.
pub(crate) type RequestedFrame = (FrameIndex, Option<PathBuf>);

/// Bytes of a particle in a file, where nothing is known but its size: positions in single precision alone. Files that
/// are compressed take less, and run alone when they turn out to hold more than was estimated.
const MIN_PARTICLE_BYTES: u64 = 12;

impl Source<'_> {
    /// The frames of `selection`, or all that are present.
    ///
    /// # Errors
    /// If a cache cannot be listed; as [`choose`].
    pub(crate) fn frames(&self, selection: Option<&Frames>) -> Result<Vec<RequestedFrame>, RunError> {
        match self {
            Self::Cache(folder) => choose(&cache::list(&folder.cache())?, selection),
            Self::Files { sequence, .. } => choose(&numbered_files(sequence), selection),
        }
    }

    /// The frames with the files that those will have which are not there yet, and the shot whose simulation is followed; without
    /// a limit of the wait, the frames as they are.
    pub(super) fn follow(
        &self,
        frames: Vec<RequestedFrame>,
        limit: Option<Duration>,
    ) -> (Vec<RequestedFrame>, Option<(&ShotFolder, Duration)>) {
        let (Self::Cache(shot), Some(limit)) = (self, limit) else { return (frames, None) };
        let expected = |(index, _): RequestedFrame| (index, Some(cache::frame_path(&shot.cache(), index)));
        (frames.into_iter().map(expected).collect(), Some((shot, limit)))
    }

    /// Why a requested frame that is not present cannot be made.
    pub(crate) fn absent(&self) -> &'static str {
        match self {
            Self::Cache(_) => "not in the cache; simulate it first",
            Self::Files { .. } => NO_FILE,
        }
    }

    /// The title of what is made in `out`, and its frames a second: `fps` without a manifest.
    ///
    /// # Errors
    /// If there is a manifest that cannot be read.
    pub(crate) fn title(&self, out: &ShotFolder, fps: f64) -> Result<(String, f64), RunError> {
        match self {
            Self::Cache(folder) => {
                let known = match Manifest::read(folder)? {
                    Some(known) => Some(known),
                    None => Manifest::read(out)?,
                };
                Ok(known.map_or(("Untitled".into(), fps), |known| (known.title, known.fps)))
            }
            Self::Files { sequence, .. } => {
                let stem = sequence.files().first().and_then(|file| file.file_stem()).unwrap_or_default();
                Ok((stem.to_string_lossy().into_owned(), fps))
            }
        }
    }

    /// The keys that the frames have to have; `None` if any will do.
    ///
    /// # Errors
    /// If there is a manifest that cannot be read.
    pub(crate) fn keys(&self) -> Result<Option<FrameKeys>, RunError> {
        match self {
            Self::Cache(folder) => Manifest::keys_in(folder),
            Self::Files { .. } => Ok(None),
        }
    }

    /// The number of entries of the largest stream in the file at `path`, estimated from its header or its size.
    pub(crate) fn max_entries(&self, path: &Path) -> usize {
        match self {
            Self::Cache(_) => {
                let streams = cache::read_header(path).map_or_else(|_| Vec::new(), |info| info.streams);
                streams.iter().map(|stream| stream.len as usize).max().unwrap_or(0)
            }
            Self::Files { .. } => (file_size(path) / MIN_PARTICLE_BYTES) as usize,
        }
    }

    /// The names and kinds of the streams in the frame at `path`; `None` if they cannot be read before the particles.
    pub(crate) fn streams(&self, path: &Path) -> Option<Vec<(String, StreamKind)>> {
        match self {
            Self::Cache(_) => {
                let streams = cache::read_header(path).ok()?.streams;
                Some(streams.into_iter().map(|stream| (stream.name, stream.kind)).collect())
            }
            Self::Files { .. } => None,
        }
    }

    /// Reads the frame `index` from `path`, as far as that takes at most `max_memory` [bytes]; a particle file is not unpacked yet.
    ///
    /// # Errors
    /// If it cannot be read, or takes more.
    pub(crate) fn open(
        &self,
        path: &Path,
        index: FrameIndex,
        max_memory: Option<u64>,
    ) -> Result<OpenedFrame, RunError> {
        match *self {
            Self::Cache(_) => {
                let (frame, info) = cache::read_frame_within(path, max_memory)?;
                let header = |stream: &Stream| StreamHeader {
                    name: stream.name.clone(),
                    kind: stream.kind,
                    state: state_key(info.key, index, &stream.name),
                    spacing: spacing_of(stream),
                };
                let headers = frame.streams.iter().map(header).collect();
                Ok(OpenedFrame { headers, time: frame.time, content: Content::Frame(frame) })
            }
            Self::Files { spacing, .. } => {
                let file = ParticleFile::open(path, max_memory)?;
                let header = StreamHeader {
                    name: STREAM.into(),
                    kind: StreamKind::Particles,
                    state: file.content_key(),
                    spacing: Ok(spacing),
                };
                Ok(OpenedFrame { headers: vec![header], time: 0.0, content: Content::File(file) })
            }
        }
    }
}

/// A frame whose bytes are read.
pub(crate) struct OpenedFrame {
    /// The headers of its streams.
    pub(crate) headers: Vec<StreamHeader>,
    /// Time since the shot's start [s]; 0 of a file.
    pub(super) time: f64,
    content: Content,
}

/// Header of a stream, whose entries are not unpacked yet.
pub(crate) struct StreamHeader {
    pub(crate) name: String,
    pub(crate) kind: StreamKind,
    /// Identifies the state that its entries are.
    pub(crate) state: u64,
    /// Distance between particles at rest [m], or why the frame has none that can be used.
    pub(crate) spacing: Result<f32, String>,
}

/// The spacing of a stream [m], or what it has instead.
fn spacing_of(stream: &Stream) -> Result<f32, String> {
    stream.spacing().ok_or_else(|| {
        let found = match stream.scalar("spacing") {
            Some(spacing) => format!("a spacing of {spacing:e} m"),
            None => "no spacing".into(),
        };
        let (name, range) = (printable(&stream.name), SPACING_RANGE);
        let (min, max) = (range.start(), range.end());
        format!("stream {name}: found {found}, expected {min:e} to {max:e} m; simulate the shot again")
    })
}

impl StreamHeader {
    /// The name of what the stream shows, by which files are called: of `sheet.cloth` it is `cloth`, of `smoke_tracers` `smoke`.
    pub(crate) fn subject(&self) -> &str {
        let name = self.name.rsplit_once('.').map_or(&*self.name, |(_, name)| name);
        name.strip_suffix("_tracers").unwrap_or(name)
    }
}

enum Content {
    Frame(Frame),
    File(ParticleFile),
}

impl OpenedFrame {
    /// The streams, unpacked, with notes for the user.
    ///
    /// # Errors
    /// If they cannot be unpacked.
    pub(crate) fn unpack(self) -> Result<(Vec<Stream>, Vec<String>), ImportError> {
        match self.content {
            Content::Frame(frame) => Ok((frame.streams, Vec::new())),
            Content::File(file) => {
                let imported = file.particles()?;
                Ok((vec![imported.stream], imported.ignored))
            }
        }
    }
}

/// The stream that files are read as.
const STREAM: &str = "particles";

/// Why a requested frame of a sequence cannot be made.
pub(crate) const NO_FILE: &str =
    "no file has this number; look at what the solver wrote, or leave the frame out";

/// The size of a file [bytes]; 0 if it is not there.
pub(crate) fn file_size(path: &Path) -> u64 {
    std::fs::metadata(path).map_or(0, |about| about.len())
}

/// The files of a sequence with the numbers of their frames, which ascend.
pub(crate) fn numbered_files(sequence: &Sequence) -> Vec<(FrameIndex, PathBuf)> {
    let numbers = sequence.numbers().iter().map(|&number| FrameIndex(number));
    numbers.zip(sequence.files().iter().cloned()).collect()
}

/// The frames of a selection and their files; all that are present without a selection. `present` ascend.
///
/// # Errors
/// [`RunError::Request`] if the selection has more than [`MAX_FRAMES`]: each missing frame would be reported.
pub(crate) fn choose(
    present: &[(FrameIndex, PathBuf)],
    selection: Option<&Frames>,
) -> Result<Vec<RequestedFrame>, RunError> {
    let Some(selection) = selection else {
        return Ok(present.iter().map(|(index, path)| (*index, Some(path.clone()))).collect());
    };
    if selection.count() > MAX_FRAMES {
        return Err(RunError::Request(format!(
            "--frames {selection}: found {} frames, expected at most {MAX_FRAMES}; select frames that are present, or \
             leave --frames out for all of them",
            selection.count()
        )));
    }
    let file = |frame: FrameIndex| {
        let place = present.binary_search_by_key(&frame, |(index, _)| *index);
        place.ok().map(|place| present[place].1.clone())
    };
    Ok(selection.iter().map(|frame| (frame, file(frame))).collect())
}

/// The largest number of frames that may be requested: eleven hours at 24 a second.
pub(crate) const MAX_FRAMES: u64 = 1_000_000;

/// Identifies the simulated state that files are made from.
pub(crate) fn state_key(simulation: u64, index: FrameIndex, stream: &str) -> u64 {
    xxh3_64(format!("{simulation:016x} {index} {stream}").as_bytes())
}
