//! Batches as jobs of render farms: the steps of a shot, and each engine's form of them.
//!
//! A job is a list of steps (`job.rs`): simulate, then what the preset's output requests, in chunks of frames, then verify. Every
//! engine writes the same command lines; a task that is run again keeps what is valid, so an engine may repeat any task.

mod flamenco;
mod job;
mod openjd;
mod slurm;

pub(crate) use job::{FarmJob, Request};

use crate::{
    cache,
    job::{RunError, ShotFolder},
};
use job::{JobFiles, MARK};
use std::{io::ErrorKind, path::PathBuf};

/// A render farm's engine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Engine {
    /// Open Job Description, as Deadline Cloud and its command line run it.
    OpenJd,
    /// Slurm.
    Slurm,
    /// Flamenco, Blender's farm.
    Flamenco,
}

/// Writes the files of a job into its folder. Returns the files and the command that submits them.
///
/// # Errors
/// [`RunError::Request`] if the engine cannot express the job, or a file of the user is in a file's place.
pub(crate) fn write(engine: Engine, job: &FarmJob) -> Result<(Vec<PathBuf>, String), RunError> {
    let JobFiles { files, submit } = match engine {
        Engine::OpenJd => openjd::files(job)?,
        Engine::Slurm => slurm::files(job),
        Engine::Flamenco => flamenco::files(job)?,
    };
    let path = |name: &str| job.root.join(name);
    for (name, _) in &files {
        refuse_foreign(&path(name))?;
    }
    let mut written = Vec::new();
    for (name, text) in files {
        ShotFolder::write(path(name), &text)?;
        written.push(path(name));
    }
    Ok((written, submit))
}

/// Refuses to replace a file that no job has written.
fn refuse_foreign(path: &std::path::Path) -> Result<(), RunError> {
    match cache::read_text(path) {
        Ok(text) if !text.contains(MARK) => Err(RunError::Request(format!(
            "{}: found a file that `meniscus farm` has not written, and the job would replace it; rename the file",
            path.display()
        ))),
        Err(source) if !matches!(source.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => {
            Err(RunError::File { path: path.into(), source, next: "check that the folder can be read" })
        }
        _ => Ok(()),
    }
}
