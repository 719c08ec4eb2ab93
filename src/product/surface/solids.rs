//! The colliders that a surface is fitted to.

use crate::{
    job::{RunError, batch::Source},
    product::request::{ProductInput, ProductRequest},
    sim::scene::Scene,
    solid::{Shape, Solid},
};

/// The colliders of a shot, in the form of the surfacer; none if the settings do not fit surfaces to them.
#[derive(Debug, Default)]
pub(super) struct Colliders {
    /// The colliders, whose meshes are sampled.
    pub(super) solids: Vec<Solid>,
    /// What they depend on, for the key of a mesh.
    pub(super) text: String,
}

impl Colliders {
    /// The colliders that the surfaces of a request are fitted to.
    ///
    /// # Errors
    /// [`RunError::Request`] if the input has no preset that lists them.
    pub(super) fn of(request: &ProductRequest) -> Result<Self, RunError> {
        if request.settings.surface.contact.is_none() {
            return Ok(Self::default());
        }
        match (request.input, request.scene) {
            (ProductInput::Frames(Source::Cache(_)), Some(scene)) => Ok(Self::of_scene(scene)),
            _ => Err(RunError::Request(
                "found `surface.contact` for particle files, expected the folder of a shot, whose preset has the colliders; leave \
                 the setting out"
                    .into(),
            )),
        }
    }

    fn of_scene(scene: &Scene) -> Self {
        let text = |text: String, collider: &crate::solid::Collider| {
            let hash = match &collider.shape {
                Shape::Mesh(mesh) => scene.assets.get(&mesh.file).map_or(0, |asset| asset.hash),
                _ => 0,
            };
            let collider = serde_json::to_string(collider).expect("a collider is plain data");
            format!("{text} {collider} {hash:016x}")
        };
        let start = format!("{} {}", scene.fps, scene.frames.first().0);
        let text = scene.world.collider.iter().fold(start, text);
        Self { solids: scene.surroundings().solids, text }
    }
}
