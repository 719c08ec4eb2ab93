//! What a job of meshes keeps count of: what was made, named in the manifest, and what failed.

use super::{
    super::{Control, FailedFrame, FrameSpan, Manifest, OutputFiles, RunError, ShotFolder, mesh_log},
    Made, MadeStream, POINTS, SurfaceJob, Surfaced,
};
use crate::{
    cache::{self, Lock},
    export::MeshFormat,
};
use std::collections::BTreeMap;

/// Remembers what was made of a shot folder's meshes, and what failed.
pub(in crate::run) struct Ledger<'a> {
    out: &'a ShotFolder,
    done: Surfaced,
    /// Frames whose files are there, by stream.
    written: BTreeMap<String, Vec<u32>>,
    /// Which file properties hold which attribute, by stream.
    attributes: BTreeMap<String, BTreeMap<String, Vec<String>>>,
    failed: Vec<FailedFrame>,
    /// Outputs to be named no longer.
    stale: Vec<(String, MeshFormat)>,
    /// Why the log could not be written.
    unlogged: Option<RunError>,
    /// Nobody else may write the meshes, or remove what looks like the temporary of a crashed run.
    _lock: Lock,
}

impl<'a> Ledger<'a> {
    /// Makes the folder ready to be written to.
    pub(in crate::run) fn new(out: &'a ShotFolder) -> Result<Self, RunError> {
        ShotFolder::create(&out.meshes())?;
        let lock = Lock::acquire(&out.meshes())?;
        cache::remove_temporaries(&out.meshes()).map_err(|source| RunError::File {
            path: out.meshes(),
            source,
            next: "check that the folder can be read and written",
        })?;
        let done = Surfaced { folder: out.meshes(), ..Surfaced::default() };
        let (written, attributes, failed) = (BTreeMap::new(), BTreeMap::new(), Vec::new());
        Ok(Self { out, done, written, attributes, failed, stale: Vec::new(), unlogged: None, _lock: lock })
    }

    /// Remembers what became of a frame, and tells it. Frames come in ascending order.
    pub(in crate::run) fn take(&mut self, made: Made, control: Control) {
        made.notes.iter().for_each(|note| control.reporter.note(note));
        for MadeStream { name, attributes, meshed, stale } in made.streams {
            self.stale.extend(stale);
            self.attributes.entry(name.clone()).or_default().extend(attributes);
            self.written.entry(name).or_default().push(made.index.0);
            match meshed {
                None => self.done.kept += 1,
                Some(meshed) => {
                    self.done.meshed += 1;
                    self.done.triangles += meshed.triangles;
                    self.done.bytes += meshed.bytes;
                    control.reporter.frame(&meshed.figures);
                    if let Some((record, stats)) = meshed.record {
                        let logged = mesh_log::append(self.out, &record, &stats);
                        self.unlogged = self.unlogged.take().or(logged.err());
                    }
                }
            }
        }
        self.failed.extend(made.failed);
    }

    /// Names in the manifest what was written, however the job ended, and says how it went. `frames` ascend.
    pub(in crate::run) fn finish(
        mut self,
        job: &SurfaceJob,
        title: &str,
        fps: f64,
        frames: &[u32],
        outcome: Result<(), RunError>,
        control: Control,
    ) -> Result<Surfaced, RunError> {
        let named = self.name_outputs(job, title, fps, frames);
        // What ended the job comes before what went wrong because of it.
        outcome?;
        named?;
        self.unlogged.map_or(Ok(()), Err)?;
        mesh_log::tidy(self.out)?;
        self.done.jumps = mesh_log::jumps(&mesh_log::read(self.out)?);
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
    fn name_outputs(&self, job: &SurfaceJob, title: &str, fps: f64, frames: &[u32]) -> Result<(), RunError> {
        let Some(all) = FrameSpan::of(frames).filter(|_| !self.written.is_empty()) else { return Ok(()) };
        let _lock = Manifest::lock(self.out)?;
        let mut manifest = match Manifest::read(self.out)? {
            Some(old) => Manifest { title: title.into(), fps, frames: old.frames.union(all), ..old },
            None => Manifest::new(title, fps, all),
        };
        let is_stale = |output: &OutputFiles| {
            let same = |(name, format): &(String, MeshFormat)| {
                output.name == *name && output.format == format.extension()
            };
            ["mesh", "points"].contains(&output.kind.as_str()) && self.stale.iter().any(same)
        };
        manifest.outputs.retain(|output| !is_stale(output));
        for (name, numbers) in &self.written {
            let Some(span) = FrameSpan::of(numbers) else { continue };
            let mut attributes = self.attributes[name].clone();
            for &format in &job.formats {
                let mut output = output("mesh", name, format, span, &attributes);
                // Files that were kept without a look at their particles carry what they did.
                if output.attributes.is_empty() {
                    output.attributes = manifest.attributes_of(name, format.extension());
                    attributes.extend(output.attributes.clone());
                }
                manifest.put(output, numbers, self.out);
            }
            if job.params.components.is_some() {
                attributes.insert("radius".into(), vec!["radius".into()]);
                let name = format!("{name}{POINTS}");
                manifest.put(output("points", &name, MeshFormat::Ply, span, &attributes), numbers, self.out);
            }
        }
        manifest.write(self.out)
    }
}

fn output(
    kind: &str,
    name: &str,
    format: MeshFormat,
    frames: FrameSpan,
    attributes: &BTreeMap<String, Vec<String>>,
) -> OutputFiles {
    OutputFiles {
        kind: kind.into(),
        name: name.into(),
        format: format.extension().into(),
        pattern: format!("mesh/{name}_{{:04}}.{}", format.extension()),
        frames,
        attributes: match format {
            MeshFormat::Ply => attributes.clone(),
            MeshFormat::Obj => BTreeMap::new(),
        },
        grids: Vec::new(),
    }
}
