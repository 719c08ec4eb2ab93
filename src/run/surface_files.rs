//! The job that turns other solvers' particle files into meshes.

use super::{
    Control, Failure, RunError, ShotFolder, SurfaceJob, Surfaced, batch, remarks,
    surface::{Fit, Ledger, Made, StreamState, Writer, choose},
};
use crate::{
    frame::FrameIndex,
    import::{ImportError, ParticleFile, Sequence},
    mesh::SurfaceParams,
};
use std::path::{Path, PathBuf};

/// What particle files do not say.
#[derive(Clone, Copy, Debug)]
pub struct FileSettings {
    /// Distance between particles at rest [m].
    pub spacing: f32,
    /// Frames a second of the sequence.
    pub fps: f64,
}

/// Bytes of a particle in a file, where nothing is known but its size: positions in single precision alone. Files that
/// are compressed take less, and are meshed alone when they turn out to hold more than was guessed.
const LEAST_PARTICLE: u64 = 12;

/// Meshes the files of a sequence into `out`, several at once where memory allows.
///
/// A file is known by its content: one whose mesh was made from the same bytes with the same settings is kept, unless
/// the job forces it. Frames that are missing between the first and the last are told.
///
/// # Errors
/// A file without particles gives an empty mesh: a sequence may start before its liquid does. If it is the only
/// file, that is [`ImportError::NoParticles`].
///
/// A file that cannot be read, or needs more memory than the job allows, is left out and named at the end
/// ([`RunError::SomeFailed`]), or is the job's error if it is the only one; so is a frame that the selection names and
/// no file has. A folder or disk that refuses to be written ends the job at once.
pub fn surface_files(
    sequence: &Sequence,
    out: &ShotFolder,
    settings: FileSettings,
    job: &SurfaceJob,
    control: Control,
) -> Result<Surfaced, RunError> {
    let wanted = choose(&numbered(sequence), job.selection.as_ref())?;
    let numbers: Vec<u32> = wanted.iter().map(|(index, _)| index.0).collect();
    let mut ledger = Ledger::new(out)?;
    if job.selection.is_none() {
        remarks::of_gaps(&numbers).iter().for_each(|gaps| control.reporter.note(gaps));
    }
    let size = |file: &PathBuf| std::fs::metadata(file).map_or(0, |about| about.len());
    let cost = |file: &Option<PathBuf>| guess(file.as_ref().map_or(0, size), &job.params);
    let costs: Vec<u64> = wanted.iter().map(|(_, file)| cost(file)).collect();
    let maker =
        Maker { writer: Writer::new(out, job), spacing: settings.spacing, alone: wanted.len() == 1, control };
    let outcome = batch::each(
        "mesh",
        &costs,
        job.budget(),
        control,
        |place, alone| {
            let (index, file) = &wanted[place];
            maker.frame(*index, file.as_deref(), (!alone).then_some(costs[place]))
        },
        |made| ledger.take(made, control),
    );
    let title = sequence.files().first().and_then(|file| file.file_stem()).unwrap_or_default();
    ledger.finish(job, &title.to_string_lossy(), settings.fps, &numbers, outcome, control)
}

/// Why an asked-for frame of a sequence cannot be made.
pub(super) const NO_FILE: &str =
    "no file has this number; look at what the solver wrote, or leave the frame out";

/// The files of a sequence with the numbers of their frames, which ascend.
pub(super) fn numbered(sequence: &Sequence) -> Vec<(FrameIndex, PathBuf)> {
    let numbers = sequence.numbers().iter().map(|&number| FrameIndex(number));
    numbers.zip(sequence.files().iter().cloned()).collect()
}

/// A guess of the memory that meshing a file of so many `bytes` takes.
fn guess(bytes: u64, params: &SurfaceParams) -> u64 {
    batch::cost((bytes / LEAST_PARTICLE) as usize, params)
}

/// Meshes single files.
struct Maker<'a> {
    writer: Writer<'a>,
    spacing: f32,
    /// Whether a file is all that was asked for.
    alone: bool,
    control: Control<'a>,
}

impl Maker<'_> {
    /// Meshes a file; `None` if that needs more memory than `allowance`.
    fn frame(
        &self,
        index: FrameIndex,
        file: Option<&Path>,
        allowance: Option<u64>,
    ) -> Option<Result<Made, RunError>> {
        let mut made = Made::new(index);
        let Some(file) = file else {
            made.fail(format!("frame {index}"), NO_FILE.into(), Failure::Other);
            return Some(Ok(made));
        };
        match self.mesh(file, index, &mut made, allowance) {
            Err(RunError::Import(why)) if !self.alone => {
                made.fail(format!("frame {index}"), why.to_string(), Failure::Other);
            }
            Err(why @ RunError::OverMemory { .. }) if !self.alone => {
                made.fail(file.display().to_string(), why.to_string(), Failure::Memory);
            }
            Err(why) => return Some(Err(why)),
            Ok(Fit::No) => return None,
            Ok(Fit::Yes) => {}
        }
        Some(Ok(made))
    }

    fn mesh(
        &self,
        path: &Path,
        index: FrameIndex,
        made: &mut Made,
        allowance: Option<u64>,
    ) -> Result<Fit, RunError> {
        let file = ParticleFile::open(path)?;
        let key = self.writer.key(file.content_key(), self.spacing);
        let missing = self.writer.missing(STREAM, index, key);
        if missing.is_empty() {
            made.keep(STREAM);
            return Ok(Fit::Yes);
        }
        let imported = file.particles()?;
        drop(file);
        let particles = imported.stream.len();
        if particles == 0 && self.alone {
            return Err(ImportError::NoParticles { path: path.into() }.into());
        }
        if let Fit::No = self.writer.fits(&imported.stream, self.spacing, allowance)? {
            return Ok(Fit::No);
        }
        let state = StreamState { spacing: self.spacing, key };
        self.writer.mesh(&imported.stream, state, missing, made, self.control)?;
        if particles == 0 {
            made.notes.push(format!("{}: no particles, so its mesh is empty", path.display()));
        }
        made.notes.extend(imported.ignored.iter().map(|line| format!("{}: {line}", path.display())));
        Ok(Fit::Yes)
    }
}

/// The stream that files are read as.
const STREAM: &str = "particles";

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        frame::Stream,
        math::Vec3,
        run::plan::{Product, stream_memory},
    };

    #[test]
    fn small_files_are_not_taken_for_larger_than_guessed() {
        // Else each is read twice, and meshed by itself.
        let drop = [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]].map(Vec3::from);
        for copies in [0, 1, 10, 100, 1000] {
            let positions: Vec<Vec3> = (0..copies)
                .flat_map(|i| {
                    drop.map(|x| x + Vec3::new((i % 10) as f32, (i / 10 % 10) as f32, (i / 100) as f32) * 0.2)
                })
                .collect();
            let count = positions.len();
            let stream = Stream::new("particles", count).with("position", positions);
            for voxel in [0.5, 1.0] {
                let params = SurfaceParams { voxel, ..SurfaceParams::default() };
                let needed = stream_memory(Product::Meshes, &stream, 0.1, &params);
                let guess = guess(12 * count as u64, &params);
                assert!(needed <= guess, "{count} particles at {voxel}: {needed} needed, {guess} guessed");
            }
        }
    }
}
