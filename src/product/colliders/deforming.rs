//! Colliders that deform: a mesh, and a point cache of its vertices in the frames in which they move.

use crate::{
    cache::WrittenFile,
    control::printable,
    export::pc2::{self, Head, Pc2Error},
    job::{MAX_POSES, RunError},
    math::Vec3,
    mesh::Mesh,
    preset::assets,
    sim::{deforming::deformation, scene::Scene},
    solid::{Deformation, MeshShape, Shape},
};
use std::{convert::Infallible, ops::RangeInclusive, path::Path};

/// A collider that deforms, in the frames of a shot.
pub(super) struct DeformedMesh {
    mesh: MeshShape,
    deformation: Deformation,
    /// The first and the last frame in which vertices move; one frame if they do not in the shot.
    frames: RangeInclusive<u32>,
    /// Frames a second, and the frame at time 0.
    fps: f64,
    start: f64,
}

impl DeformedMesh {
    /// The motion of the vertices of a shape in the frames `span`; `None` if it does not deform.
    ///
    /// # Errors
    /// If its files cannot be read as a motion.
    pub(super) fn of(
        shape: &Shape,
        scene: &Scene,
        span: &RangeInclusive<u32>,
    ) -> Result<Option<Self>, RunError> {
        let Shape::Mesh(mesh) = shape else { return Ok(None) };
        let Some(deformation) = deformation(mesh, scene)? else { return Ok(None) };
        let (fps, start) = (f64::from(scene.fps), f64::from(scene.frames.first().0));
        let (from, to) = deformation.time_span();
        // Casts saturate, and the frames of the shot bound them.
        let first = ((from * fps + start).floor() as u32).clamp(*span.start(), *span.end());
        let last = ((to * fps + start).ceil() as u32).clamp(first, *span.end());
        if u64::from(last - first) >= MAX_POSES {
            return Err(RunError::Request(format!(
                "{}: found vertices that move in {} frames, expected at most {MAX_POSES}; select frames with --frames",
                printable(&mesh.file),
                u64::from(last - first) + 1
            )));
        }
        Ok(Some(Self { mesh: mesh.clone(), deformation, frames: first..=last, fps, start }))
    }

    /// The first and the last of its frames.
    pub(super) fn frames(&self) -> [u32; 2] {
        [*self.frames.start(), *self.frames.end()]
    }

    /// The mesh in the first of its frames, in the collider's axes.
    pub(super) fn first(&self) -> Mesh {
        let positions = self.positions(*self.frames.start());
        Mesh { positions, triangles: self.deformation.triangles().to_vec(), ..Mesh::default() }
    }

    /// Positions of the vertices in a frame, in the collider's axes [m].
    fn positions(&self, frame: u32) -> Vec<Vec3> {
        let time = (f64::from(frame) - self.start) / self.fps;
        self.mesh.place(&self.deformation.positions(time))
    }

    /// Writes the point cache.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub(super) fn write(&self, path: &Path) -> Result<WrittenFile, RunError> {
        let first = *self.frames.start();
        let head = Head {
            points: self.deformation.vertices(),
            start: first as f32,
            step: 1.0,
            samples: (self.frames.end() - first) as usize + 1,
        };
        let sample = |number: usize| Ok::<_, Infallible>(self.positions(first + number as u32));
        pc2::write(path, head, sample).map_err(|error| match error {
            Pc2Error::Export(error) => error.into(),
            Pc2Error::Sample(never) => match never {},
        })
    }
}

/// Bytes of the files of a shape that deforms; 0 of others.
pub(super) fn size(shape: &Shape, scene: &Scene) -> usize {
    if !matches!(shape, Shape::Mesh(mesh) if mesh.names_motion()) {
        return 0;
    }
    let of = |file: &str| match scene.assets.get(file) {
        Some(asset) => asset.bytes.len(),
        None => assets::sequence(file, &scene.assets).iter().map(|(.., asset)| asset.bytes.len()).sum(),
    };
    shape.files().map(of).sum()
}
