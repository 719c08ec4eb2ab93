//! What a job of frames keeps count of: what was made, named in the manifest, and what failed.

use super::{
    Control, FailedFrame, Failure, FrameSpan, Jump, Manifest, MeshRecord, OutputFiles, RunError, ShotFolder,
    mesh_log, plan::Product,
};
use crate::{
    cache::{self, Lock},
    frame::FrameIndex,
    mesh::{Mesh, SurfaceStats},
};
use std::path::PathBuf;

/// What a job did.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Done {
    /// Frames whose files were there already, made from the same with the same settings.
    pub kept: usize,
    /// Frames made.
    pub made: usize,
    /// Whether the job writes points.
    pub points: bool,
    /// Triangles written; `None`: the job makes no meshes.
    pub triangles: Option<u64>,
    /// Bytes written.
    pub bytes: u64,
    /// Where the files are.
    pub folder: PathBuf,
    /// Changes between the folder's meshes that their neighbours do not suggest.
    pub jumps: Vec<Jump>,
}

impl Done {
    /// What was done, a line each.
    pub fn lines(&self) -> Vec<String> {
        let Self { kept, made, .. } = self;
        let (folder, mib) = (self.folder.display(), self.bytes as f64 / f64::from(1 << 20));
        let done = match self.triangles {
            Some(triangles) => {
                format!(
                    "{folder}: {made} frames meshed ({triangles} triangles, {mib:.1} MiB), {kept} were there"
                )
            }
            None if self.points => {
                format!("{folder}: {made} frames of points written ({mib:.1} MiB), {kept} were there")
            }
            None => format!("{folder}: {made} volumes written ({mib:.1} MiB), {kept} were there"),
        };
        [done].into_iter().chain(self.jumps.iter().map(|jump| format!("jump: {jump}"))).collect()
    }
}

/// What became of one frame.
pub(super) struct Made {
    pub(super) index: FrameIndex,
    /// What the user should know of it.
    pub(super) notes: Vec<String>,
    /// What is there now.
    pub(super) pieces: Vec<Piece>,
    failed: Vec<FailedFrame>,
}

/// The files of one stream of a frame.
pub(super) struct Piece {
    /// The outputs that they belong to, with this frame alone.
    pub(super) outputs: Vec<OutputFiles>,
    /// `None`: they were there.
    pub(super) work: Option<Work>,
    /// Outputs that this job does not write and whose file of the frame shows something else, with this frame alone.
    pub(super) stale: Vec<OutputFiles>,
}

/// What making files did.
pub(super) struct Work {
    /// Written.
    pub(super) bytes: u64,
    pub(super) triangles: u64,
    /// One line about the frame.
    pub(super) figures: String,
    /// What the log says of it.
    pub(super) record: Option<(MeshRecord, SurfaceStats)>,
}

impl Work {
    /// On a mesh that is not written yet.
    pub(super) fn on(mesh: &Mesh, figures: String, record: Option<(MeshRecord, SurfaceStats)>) -> Self {
        Self { bytes: 0, triangles: mesh.triangles.len() as u64, figures, record }
    }
}

impl Made {
    /// Nothing yet.
    pub(super) fn new(index: FrameIndex) -> Self {
        Self { index, notes: Vec::new(), pieces: Vec::new(), failed: Vec::new() }
    }

    /// Remembers that something could not be made; the job goes on.
    pub(super) fn fail(&mut self, why: String, kind: Failure) {
        self.failed.push(FailedFrame { name: format!("frame {}", self.index), why, kind });
    }
}

/// Remembers what was made in a shot folder, and what failed.
pub(super) struct Ledger<'a> {
    out: &'a ShotFolder,
    product: Product,
    done: Done,
    /// The outputs whose files are there, and of which frames.
    written: Vec<(OutputFiles, Vec<u32>)>,
    failed: Vec<FailedFrame>,
    /// Outputs to be named no longer.
    stale: Vec<OutputFiles>,
    /// Why the log could not be written.
    unlogged: Option<RunError>,
    /// Nobody else may write the files, or remove what looks like the temporary of a crashed run.
    _lock: Lock,
}

impl<'a> Ledger<'a> {
    /// Makes the folder ready to be written to.
    ///
    /// # Errors
    /// If it cannot be, or another process writes to it.
    pub(super) fn new(out: &'a ShotFolder, product: Product) -> Result<Self, RunError> {
        let (folder, triangles) = match product {
            Product::Meshes => (out.meshes(), Some(0)),
            Product::Volumes => (out.volumes(), None),
            Product::Points => (out.points(), None),
            Product::Sheets => (out.sheets(), Some(0)),
        };
        ShotFolder::create(&folder)?;
        let lock = Lock::acquire(&folder)?;
        cache::remove_temporaries(&folder).map_err(|source| RunError::File {
            path: folder.clone(),
            source,
            next: "check that the folder can be read and written",
        })?;
        let points = product == Product::Points;
        let done = Done { folder, triangles, points, ..Done::default() };
        let (written, failed, stale) = (Vec::new(), Vec::new(), Vec::new());
        Ok(Self { out, product, done, written, failed, stale, unlogged: None, _lock: lock })
    }

    /// Remembers what became of a frame, and tells it. Frames come in ascending order.
    pub(super) fn take(&mut self, made: Made, control: Control) {
        made.notes.iter().for_each(|note| control.reporter.note(note));
        for Piece { outputs, work, stale } in made.pieces {
            self.stale.extend(stale);
            outputs.into_iter().for_each(|output| self.add(output));
            let Some(work) = work else {
                self.done.kept += 1;
                continue;
            };
            self.done.made += 1;
            self.done.bytes += work.bytes;
            self.done.triangles = self.done.triangles.map(|triangles| triangles + work.triangles);
            control.reporter.frame(&work.figures);
            if let Some((record, stats)) = work.record {
                let logged = mesh_log::append(self.out, &record, &stats);
                self.unlogged = self.unlogged.take().or(logged.err());
            }
        }
        self.failed.extend(made.failed);
    }

    /// Adds a frame of an output.
    fn add(&mut self, output: OutputFiles) {
        let frame = output.frames.first;
        match self.written.iter_mut().find(|(known, _)| known.is_same(&output)) {
            None => self.written.push((output, vec![frame])),
            Some((known, frames)) => {
                frames.push(frame);
                known.attributes.extend(output.attributes);
                let grids = output.grids.into_iter();
                let new: Vec<String> = grids.filter(|grid| !known.grids.contains(grid)).collect();
                known.grids.extend(new);
            }
        }
    }

    /// Names in the manifest what was written, however the job ended, and says how it went. `frames` ascend.
    ///
    /// # Errors
    /// What ended the job; else what could not be written; else the frames that failed.
    pub(super) fn finish(
        mut self,
        title: &str,
        fps: f64,
        frames: &[u32],
        outcome: Result<(), RunError>,
        control: Control,
    ) -> Result<Done, RunError> {
        let named = self.name_outputs(title, fps, frames);
        // What ended the job comes before what went wrong because of it.
        outcome?;
        named?;
        self.unlogged.map_or(Ok(()), Err)?;
        if self.product == Product::Meshes {
            mesh_log::tidy(self.out)?;
            self.done.jumps = mesh_log::jumps(&mesh_log::read(self.out)?);
        }
        match self.failed {
            failed if failed.is_empty() => Ok(self.done),
            failed => {
                // The frames that were made are told as well.
                self.done.lines().iter().for_each(|line| control.reporter.note(line));
                Err(RunError::SomeFailed { failed, asked: frames.len() })
            }
        }
    }

    /// Adds what was written to the folder's manifest.
    fn name_outputs(&mut self, title: &str, fps: f64, frames: &[u32]) -> Result<(), RunError> {
        let Some(all) = FrameSpan::of(frames).filter(|_| !self.written.is_empty()) else { return Ok(()) };
        let _lock = Manifest::lock(self.out)?;
        let mut manifest = match Manifest::read(self.out)? {
            Some(old) => Manifest { title: title.into(), fps, frames: old.frames.union(all), ..old },
            None => Manifest::new(title, fps, all),
        };
        manifest.outputs.retain(|output| !self.stale.iter().any(|stale| stale.is_same(output)));
        for (mut output, numbers) in std::mem::take(&mut self.written) {
            output.frames = FrameSpan::of(&numbers).expect("an output has a frame");
            manifest.put(output, &numbers, self.out);
        }
        manifest.write(self.out)
    }
}
