//! Where the particles of a job's frames come from.

use super::{Manifest, RunError, ShotFolder};
use crate::{
    cache,
    frame::{Frame, FrameIndex, Stream},
    import::{ImportError, ParticleFile, Sequence},
    scene::Frames,
};
use std::path::{Path, PathBuf};
use xxhash_rust::xxh3::xxh3_64;

/// Where particles come from.
#[derive(Clone, Copy, Debug)]
pub enum Source<'a> {
    /// The cache of a shot.
    Cache(&'a ShotFolder),
    /// Files of any solver.
    Files {
        /// The files.
        sequence: &'a Sequence,
        /// Distance between particles at rest [m], which files do not say.
        spacing: f32,
    },
}

/// A frame that was asked for, and the file it is in, if there is one.
pub(super) type Wanted = (FrameIndex, Option<PathBuf>);

/// Bytes of a particle in a file, where nothing is known but its size: positions in single precision alone. Files that
/// are compressed take less, and run alone when they turn out to hold more than was guessed.
const LEAST_PARTICLE: u64 = 12;

impl Source<'_> {
    /// The frames of `selection`, or all that are there.
    ///
    /// # Errors
    /// If a cache cannot be listed; as [`choose`].
    pub(super) fn wanted(&self, selection: Option<&Frames>) -> Result<Vec<Wanted>, RunError> {
        match self {
            Self::Cache(folder) => choose(&cache::list(&folder.cache())?, selection),
            Self::Files { sequence, .. } => choose(&numbered(sequence), selection),
        }
    }

    /// Why an asked-for frame cannot be made.
    pub(super) fn absent(&self) -> &'static str {
        match self {
            Self::Cache(_) => "not in the cache; simulate it first",
            Self::Files { .. } => NO_FILE,
        }
    }

    /// The title of what is made in `out`, and its frames a second: `fps` where nothing tells.
    ///
    /// # Errors
    /// If there is a manifest that cannot be read.
    pub(super) fn title(&self, out: &ShotFolder, fps: f64) -> Result<(String, f64), RunError> {
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

    /// How many particles the file at `path` has, as far as its header or its size tells: those of the largest stream.
    pub(super) fn count(&self, path: &Path) -> usize {
        match self {
            Self::Cache(_) => {
                let streams = cache::read_header(path).map_or_else(|_| Vec::new(), |info| info.streams);
                streams.iter().map(|stream| stream.len as usize).max().unwrap_or(0)
            }
            Self::Files { .. } => (size(path) / LEAST_PARTICLE) as usize,
        }
    }

    /// The names of the streams in the frame at `path`, which files do not tell; `None` if it cannot be read.
    pub(super) fn names(&self, path: &Path) -> Option<Vec<String>> {
        match self {
            Self::Cache(_) => {
                let streams = cache::read_header(path).ok()?.streams;
                Some(streams.into_iter().map(|stream| stream.name).collect())
            }
            Self::Files { .. } => None,
        }
    }

    /// Reads the frame `index` from `path`; a particle file is not unpacked yet.
    ///
    /// # Errors
    /// If it cannot be read.
    pub(super) fn open(&self, path: &Path, index: FrameIndex) -> Result<Opened, RunError> {
        match *self {
            Self::Cache(_) => {
                let (frame, info) = cache::read_frame(path)?;
                let of = |stream: &Stream| Known {
                    name: stream.name.clone(),
                    state: state_key(info.key, index, &stream.name),
                    spacing: stream.scalar("spacing").map(|s| s as f32).filter(|&s| s > 0.0),
                };
                let known = frame.streams.iter().map(of).collect();
                Ok(Opened { known, time: frame.time, content: Content::Frame(frame) })
            }
            Self::Files { spacing, .. } => {
                let file = ParticleFile::open(path)?;
                let name = STREAM.into();
                let known = vec![Known { name, state: file.content_key(), spacing: Some(spacing) }];
                Ok(Opened { known, time: 0.0, content: Content::File(file) })
            }
        }
    }
}

/// A frame whose bytes are read.
pub(super) struct Opened {
    /// Its streams.
    pub(super) known: Vec<Known>,
    /// Time since the shot's start [s]; 0 of a file.
    pub(super) time: f64,
    content: Content,
}

/// What is known of a stream before its particles are unpacked.
pub(super) struct Known {
    pub(super) name: String,
    /// Identifies its particles.
    pub(super) state: u64,
    /// Distance between them at rest [m]; `None`: the frame does not say.
    pub(super) spacing: Option<f32>,
}

enum Content {
    Frame(Frame),
    File(ParticleFile),
}

impl Opened {
    /// The streams, unpacked, and what the user should know of them.
    ///
    /// # Errors
    /// If they cannot be unpacked.
    pub(super) fn streams(self) -> Result<(Vec<Stream>, Vec<String>), ImportError> {
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

/// Why an asked-for frame of a sequence cannot be made.
pub(super) const NO_FILE: &str =
    "no file has this number; look at what the solver wrote, or leave the frame out";

/// The size of a file [bytes]; 0 if it is not there.
pub(super) fn size(path: &Path) -> u64 {
    std::fs::metadata(path).map_or(0, |about| about.len())
}

/// The files of a sequence with the numbers of their frames, which ascend.
pub(super) fn numbered(sequence: &Sequence) -> Vec<(FrameIndex, PathBuf)> {
    let numbers = sequence.numbers().iter().map(|&number| FrameIndex(number));
    numbers.zip(sequence.files().iter().cloned()).collect()
}

/// The asked-for frames and where they are; all that are present if nothing was asked. `present` ascend.
///
/// # Errors
/// [`RunError::Request`] if more are asked for than any shot has: each that is not there would be told.
pub(super) fn choose(
    present: &[(FrameIndex, PathBuf)],
    selection: Option<&Frames>,
) -> Result<Vec<Wanted>, RunError> {
    let Some(selection) = selection else {
        return Ok(present.iter().map(|(index, path)| (*index, Some(path.clone()))).collect());
    };
    if selection.count() > MOST_FRAMES {
        return Err(RunError::Request(format!(
            "--frames {selection}: found {} frames, expected at most {MOST_FRAMES}; name those that are there, or leave \
             --frames out for all of them",
            selection.count()
        )));
    }
    let found = |wanted: FrameIndex| {
        let place = present.binary_search_by_key(&wanted, |(index, _)| *index);
        place.ok().map(|place| present[place].1.clone())
    };
    Ok(selection.iter().map(|wanted| (wanted, found(wanted))).collect())
}

/// Frames that a job may be asked for: eleven hours at 24 a second.
pub(super) const MOST_FRAMES: u64 = 1_000_000;

/// Identifies the simulated state that something was made from.
pub(super) fn state_key(simulation: u64, index: FrameIndex, stream: &str) -> u64 {
    xxh3_64(format!("{simulation:016x} {index} {stream}").as_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        frame::StreamKind,
        math::Vec3,
        mesh::SurfaceParams,
        run::{
            batch,
            plan::{Product, stream_memory},
        },
    };

    #[test]
    fn small_files_are_not_taken_for_larger_than_guessed() {
        // Else each is read twice, and made by itself.
        let drop = [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]].map(Vec3::from);
        let dir = tempfile::tempdir().unwrap();
        for copies in [0, 1, 10, 100, 1000] {
            let positions: Vec<Vec3> = (0..copies)
                .flat_map(|i| {
                    drop.map(|x| x + Vec3::new((i % 10) as f32, (i / 10 % 10) as f32, (i / 100) as f32) * 0.2)
                })
                .collect();
            let count = positions.len();
            let file = dir.path().join("drops.xyz");
            std::fs::write(&file, vec![0; 12 * count]).unwrap();
            let sequence = crate::import::expand(&[file.to_string_lossy().into_owned()]).unwrap();
            let source = Source::Files { sequence: &sequence, spacing: 0.1 };
            let stream = Stream::new("particles", StreamKind::Particles, count).with("position", positions);
            for (product, voxel) in
                [Product::Meshes, Product::Volumes].into_iter().flat_map(|p| [(p, 0.5), (p, 1.0)])
            {
                let params = SurfaceParams { voxel, ..SurfaceParams::default() };
                let needed = stream_memory(product, &stream, 0.1, &params, u64::MAX);
                let guess = batch::cost(product, source.count(&file), &params);
                assert!(needed <= guess, "{count} particles at {voxel}: {needed} needed, {guess} guessed");
            }
        }
    }
}
