//! The particles that surfaces are compared on.

use crate::{
    cache,
    control::printable_path,
    frame::{FrameIndex, Stream, StreamKind},
    import::ParticleFile,
    job::{RunError, batch::Source},
    preset::Frames,
};
use std::path::PathBuf;

/// One stream of one frame. Its particles are read whenever they are needed, as `mesh` reads them.
#[derive(Clone, Debug)]
pub(crate) struct Sample {
    /// The frame.
    pub(crate) frame: FrameIndex,
    /// Number of particles.
    pub(crate) particles: usize,
    /// Distance between particles at rest [m].
    pub(crate) spacing: f32,
    /// Key of the particles' state.
    pub(crate) state: u64,
    /// The frame's file.
    pub(crate) path: PathBuf,
    /// The stream's place in a cached frame; `None` of a particle file.
    pub(crate) stream: Option<usize>,
    /// The memory that the file may take when it is read [bytes].
    pub(crate) max_memory: Option<u64>,
}

/// The particles of some frames that are there, stream by stream; none may take more than `max_memory` [bytes].
pub(super) fn samples(
    source: &Source<'_>,
    frames: &Frames,
    max_memory: Option<u64>,
) -> Result<Vec<Sample>, RunError> {
    let mut samples = Vec::new();
    for (frame, path) in source.frames(Some(frames))? {
        let Some(path) = path else { continue };
        let mut opened = source.open(&path, frame, max_memory)?;
        let headers = std::mem::take(&mut opened.headers);
        let (streams, _) = opened.unpack()?;
        for (place, (stream, known)) in streams.iter().zip(headers).enumerate() {
            if stream.kind != StreamKind::Particles {
                continue;
            }
            let spacing = known.spacing.map_err(|why| RunError::Request(format!("frame {frame}: {why}")))?;
            let (particles, state, path) = (stream.len(), known.state, path.clone());
            let stream = matches!(source, Source::Cache(_)).then_some(place);
            samples.push(Sample { frame, particles, spacing, state, path, stream, max_memory });
        }
    }
    Ok(samples)
}

impl Sample {
    /// Reads the particles, and the time since the shot's start [s]; 0 of a file.
    pub(super) fn read(&self) -> Result<(Stream, f64), RunError> {
        match self.stream {
            // Another file may have taken the place of the one that was sampled.
            Some(place) => {
                let (mut frame, _) = cache::read_frame_within(&self.path, self.max_memory)?;
                if place >= frame.streams.len() {
                    let path = printable_path(&self.path);
                    return Err(RunError::Request(format!(
                        "{path}: found {} streams, expected the frame that was there before; run the same command again",
                        frame.streams.len()
                    )));
                }
                Ok((frame.streams.swap_remove(place), frame.time))
            }
            None => Ok((ParticleFile::open(&self.path, self.max_memory)?.particles()?.stream, 0.0)),
        }
    }
}
