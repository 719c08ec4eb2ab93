//! USD: a stage of a whole shot (`docs/formats/usd.md`, `docs/decisions/039-usd.md`).
//!
//! `GeometryLayer` and `AnimatedMesh` write binary layers through `crate_file`, `Stage` the text that joins them.

mod animated;
mod compress;
mod corner_normals;
mod crate_file;
mod geometry;
mod layer;
mod names;
mod params;
mod space;
mod stage;

#[cfg(test)]
mod tests;

pub use geometry::NameScheme;
pub use params::StageParams;
pub use space::{SCALE_RANGE, StageSpace, UpAxis};

pub(crate) use animated::{AnimatedMesh, PointSamples, Poses};
pub(crate) use geometry::{GeometryAttribute, GeometryLayer, attributes, schema};
pub(crate) use layer::LayerSettings;
pub(crate) use names::{Identifiers, identifier};
pub(crate) use stage::{CAMERA, Content, MANIFEST, Member, Stage, StageCamera, group_members};

use crate::{
    cache::{WrittenFile, write_atomically},
    export::ExportError,
};
use std::path::Path;

impl GeometryLayer {
    /// Writes the layer to `path`, whole or not at all, and returns its size and checksum.
    ///
    /// # Errors
    /// If the system refuses.
    pub(crate) fn write(self, path: &Path) -> Result<WrittenFile, ExportError> {
        let Self { file, fields, prim, .. } = self;
        write_atomically(path, |mut out| file.write(&fields, &prim, &mut out, |_, _| Ok(())))
            .map_err(|source| ExportError::write(path, source))
    }
}
