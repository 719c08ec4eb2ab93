//! The particles that surfaces are compared on.

use crate::{
    cache,
    frame::{FrameIndex, Stream},
    import::ParticleFile,
    job::batch::state_key,
    run::{RunError, Source},
    scene::Frames,
};
use std::path::PathBuf;

/// One stream of one frame. Its particles are read whenever they are needed, as `mesh` reads them.
#[derive(Clone, Debug)]
pub(super) struct Sample {
    /// The frame.
    pub(super) frame: FrameIndex,
    /// How many particles it has.
    pub(super) particles: usize,
    /// Distance between them at rest [m].
    pub(super) spacing: f32,
    /// Identifies them.
    pub(super) state: u64,
    path: PathBuf,
    /// Its place in a cached frame; `None`: the path is a particle file.
    stream: Option<usize>,
}

/// Frames that are compared if none are named: enough to see calm and splash.
const FEW: usize = 3;

impl Source<'_> {
    /// Every frame that is there, ascending.
    ///
    /// # Errors
    /// If a cache cannot be listed.
    pub fn numbers(&self) -> Result<Vec<u32>, RunError> {
        match self {
            Self::Cache(folder) => {
                Ok(cache::list(&folder.cache())?.iter().map(|(index, _)| index.0).collect())
            }
            Self::Files { sequence, .. } => Ok(sequence.numbers().to_vec()),
        }
    }

    /// The frames to compare: those selected, or three, evenly spread up to the last.
    ///
    /// # Errors
    /// If a selected frame is not there.
    pub fn choose(&self, selection: Option<&Frames>) -> Result<Vec<u32>, RunError> {
        let present = self.numbers()?;
        let Some(selection) = selection else {
            let few = FEW.min(present.len());
            return Ok((1..=few).map(|i| present[i * present.len() / few - 1]).collect());
        };
        let wanted: Vec<u32> = selection.iter().map(|index| index.0).collect();
        match wanted.iter().find(|number| present.binary_search(number).is_err()) {
            None => Ok(wanted),
            Some(missing) => Err(RunError::Request(format!(
                "--frames {selection}: found no frame {missing}, expected frames that are there: {} to {}",
                present.first().copied().unwrap_or_default(),
                present.last().copied().unwrap_or_default()
            ))),
        }
    }

    /// How many particles the largest of some frames has, where a header tells.
    ///
    /// # Errors
    /// If a cached frame cannot be read.
    pub fn particles(&self, numbers: &[u32]) -> Result<Option<usize>, RunError> {
        let Self::Cache(folder) = self else { return Ok(None) };
        let mut most = None;
        for &number in numbers {
            let info = cache::read_header(&cache::frame_path(&folder.cache(), FrameIndex(number)))?;
            most = most.max(info.streams.iter().map(|stream| stream.len as usize).max());
        }
        Ok(most)
    }

    /// The streams of some frames that are there.
    ///
    /// # Errors
    /// If a frame cannot be read.
    pub(super) fn samples(&self, numbers: &[u32]) -> Result<Vec<Sample>, RunError> {
        match self {
            Self::Cache(folder) => {
                let mut samples = Vec::new();
                for &number in numbers {
                    let frame = FrameIndex(number);
                    let path = cache::frame_path(&folder.cache(), frame);
                    let (read, info) = cache::read_frame(&path)?;
                    for (place, stream) in read.streams.iter().enumerate() {
                        let spacing = stream.scalar("spacing").map(|s| s as f32).filter(|&s| s > 0.0);
                        let spacing = spacing.ok_or_else(|| no_spacing(frame, &stream.name))?;
                        samples.push(Sample {
                            frame,
                            particles: stream.len(),
                            spacing,
                            state: state_key(info.key, frame, &stream.name),
                            path: path.clone(),
                            stream: Some(place),
                        });
                    }
                }
                Ok(samples)
            }
            Self::Files { sequence, spacing } => {
                let all = sequence.numbers().iter().zip(sequence.files());
                let wanted = all.filter(|(number, _)| numbers.contains(number));
                wanted
                    .map(|(&number, path)| {
                        let file = ParticleFile::open(path)?;
                        let particles = file.particles()?.stream.len();
                        let (frame, state) = (FrameIndex(number), file.content_key());
                        let (spacing, path) = (*spacing, path.clone());
                        Ok(Sample { frame, particles, spacing, state, path, stream: None })
                    })
                    .collect()
            }
        }
    }
}

#[cfg(test)]
impl Sample {
    /// One without a file.
    pub(super) fn made_up(frame: u32, particles: usize, spacing: f32) -> Self {
        let (frame, state) = (FrameIndex(frame), u64::from(frame));
        Self { frame, particles, spacing, state, path: PathBuf::new(), stream: None }
    }
}

impl Sample {
    /// Its particles.
    ///
    /// # Errors
    /// If they cannot be read.
    pub(super) fn read(&self) -> Result<Stream, RunError> {
        match self.stream {
            Some(place) => Ok(cache::read_frame(&self.path)?.0.streams.swap_remove(place)),
            None => Ok(ParticleFile::open(&self.path)?.particles()?.stream),
        }
    }
}

fn no_spacing(frame: FrameIndex, stream: &str) -> RunError {
    RunError::Request(format!(
        "frame {frame}: the stream {stream} does not say its spacing; simulate it again"
    ))
}
