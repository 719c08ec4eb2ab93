//! What jobs need to know of a system.
//!
//! A system is one folder below `src/sim/`: its solver in the folder itself, and in `job/` what jobs need to know of it. Jobs,
//! scenes and the command line name no system; they loop over [`ALL`](super::registry::ALL).

use super::scene::Scene;
use crate::{
    frame::StreamKind,
    preset::{check::Places, problem::Finding},
    solid::Shape,
};

/// A simulated system, as jobs see it.
pub(crate) trait System: Sync {
    /// Whether the preset names the system.
    fn is_present(&self, scene: &Scene) -> bool;

    /// The kinds of the streams that it has in frames.
    fn stream_kinds(&self) -> &'static [StreamKind] {
        &[]
    }

    /// Reports everything about the system that contradicts itself or cannot be simulated.
    fn check(&self, scene: &Scene, places: &Places, findings: &mut Vec<Finding>);

    /// Fills in defaults that depend on other keys of the preset.
    fn complete(&self, _scene: &mut Scene) {}

    /// The mesh files that the system's tables name, each with the dotted key of its mesh.
    fn mesh_files<'a>(&self, _scene: &'a Scene) -> Vec<(String, &'a str)> {
        Vec::new()
    }
}

/// The file of a shape, if it is a mesh, with the dotted key of the mesh.
pub(crate) fn mesh_file((key, shape): (String, &Shape)) -> Option<(String, &str)> {
    match shape {
        Shape::Mesh(mesh) => Some((format!("{key}.mesh"), mesh.file.as_str())),
        _ => None,
    }
}
