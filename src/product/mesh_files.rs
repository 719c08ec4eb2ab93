//! The files that the mesh of a frame is written to, in every requested format.

use crate::{
    export::{self, MeshFormat},
    job::{
        OutputFiles, RunError, ShotFolder,
        batch::{BatchSummary, FileTarget, FrameFiles, Written},
    },
    mesh::{Mesh, Points},
};

/// The suffix of the file of small components that became points.
const POINTS_SUFFIX: &str = "_points";

/// The files that the mesh of a frame is written to.
pub(super) struct MeshFiles<'a> {
    pub(super) out: &'a ShotFolder,
    /// Sub-folder of the files.
    pub(super) folder: &'static str,
    pub(super) formats: &'a [MeshFormat],
    /// Whether small components go to a file of points.
    pub(super) points: bool,
}

impl MeshFiles<'_> {
    /// The outputs that a frame's files belong to, with that frame alone: those that are written, or all others.
    fn outputs(
        &self,
        FileTarget { index, name, .. }: &FileTarget,
        written: bool,
    ) -> Vec<(MeshFormat, OutputFiles)> {
        let formats = MeshFormat::ALL.into_iter().filter(|format| self.formats.contains(format) == written);
        let mesh = formats.map(|format| (format, "mesh", name.clone()));
        let points =
            (self.points == written).then(|| (MeshFormat::Ply, "points", format!("{name}{POINTS_SUFFIX}")));
        let of = |(format, kind, name): (MeshFormat, &str, String)| {
            (format, OutputFiles::of(kind, self.folder, &name, format.extension(), *index))
        };
        mesh.chain(points).map(of).collect()
    }

    /// The files of a target, if all are present and have its key.
    pub(super) fn up_to_date(&self, target: &FileTarget) -> Option<FrameFiles> {
        let outputs = self.outputs(target, true);
        let has_key = |(format, output): &(MeshFormat, OutputFiles)| {
            format.key_in(&output.file(self.out, target.index.0)) == Some(target.key)
        };
        let all = outputs.iter().all(has_key);
        let with_attributes = |(format, mut output): (MeshFormat, OutputFiles)| {
            output.attributes = format.attributes_in(&output.file(self.out, target.index.0));
            output
        };
        all.then(|| FrameFiles {
            outputs: outputs.into_iter().map(with_attributes).collect(),
            written: None,
            stale: self.stale(target),
        })
    }

    /// The outputs that are not written of a target, and whose file of its frame shows something else.
    fn stale(&self, target: &FileTarget) -> Vec<OutputFiles> {
        let mut stale = self.outputs(target, false);
        stale.retain(|(format, output)| {
            let path = output.file(self.out, target.index.0);
            // A target without a key equals no other.
            path.exists() && (target.key == 0 || format.key_in(&path) != Some(target.key))
        });
        stale.into_iter().map(|(_, output)| output).collect()
    }

    /// Writes the files of a target, and adds them to what the frame has `written` so far.
    ///
    /// # Errors
    /// What a folder or disk refuses.
    pub(super) fn write(
        &self,
        mesh: &Mesh,
        points: Option<&Points>,
        target: &FileTarget,
        mut written: Written,
    ) -> Result<FrameFiles, RunError> {
        written.triangles += mesh.triangles.len() as u64;
        let mut outputs = Vec::new();
        for (format, mut output) in self.outputs(target, true) {
            let path = output.file(self.out, target.index.0);
            let file = match points.filter(|_| output.kind == "points") {
                Some(points) => export::ply::write_points(points, &path, target.key)?,
                None => format.write(mesh, &path, target.key)?,
            };
            written.add(&output, file);
            output.attributes = format.attributes_in(&path);
            outputs.push(output);
        }
        Ok(FrameFiles { outputs, written: Some(written), stale: self.stale(target) })
    }
}

/// The summary of a batch that wrote meshes.
pub(super) fn mesh_summary(batch: &BatchSummary) -> String {
    let BatchSummary { folder, made, kept, triangles, .. } = batch;
    let (folder, mib) = (folder.display(), batch.mebibytes());
    format!("{folder}: {made} frames meshed ({triangles} triangles, {mib:.1} MiB), {kept} up to date")
}
