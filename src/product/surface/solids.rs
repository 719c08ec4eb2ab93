//! The colliders that a surface is fitted to.

use crate::{
    control::printable_path,
    job::{RunError, batch::Source},
    preset::assets,
    product::request::{ProductInput, ProductRequest},
    sim::scene::Scene,
    solid::{Collider, Shape, Solid},
};

/// The colliders of a shot, in the form of the surfacer; none if the settings do not fit surfaces to them.
#[derive(Debug, Default)]
pub(super) struct Colliders {
    /// The colliders, whose meshes are sampled.
    pub(super) solids: Vec<Solid>,
    /// The rigid bodies, whose poses are in the frames.
    pub(super) bodies: Vec<Solid>,
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
            (ProductInput::Frames(Source::Cache(shot)), None) => {
                Err(no_colliders(&format!("a cache without a preset ({})", printable_path(&shot.preset()))))
            }
            _ => Err(no_colliders("particle files")),
        }
    }

    /// The colliders of a scene whose meshes are sampled.
    pub(super) fn of_scene(scene: &Scene) -> Self {
        let hash = |shape: &Shape| assets::hash(shape.files(), &scene.assets);
        let text = |text: String, collider: &Collider| {
            let Collider { shape, keyframes, interpolation, .. } = collider;
            let hash = hash(shape);
            let collider = serde_json::to_string(&(shape, keyframes, interpolation));
            format!("{text} {} {hash:016x}", collider.expect("a collider is plain data"))
        };
        let start = format!("{} {}", scene.fps, scene.frames.first().0);
        let text = scene.world.collider.iter().fold(start, text);
        let text = scene.body.iter().fold(text, |text, body| {
            let shape = serde_json::to_string(&body.shape).expect("a shape is plain data");
            format!("{text} body {shape} {:016x}", hash(&body.shape))
        });
        let bodies = scene.body.iter().map(|body| Solid::fixed(body.shape.clone())).collect();
        Self { solids: scene.surroundings().solids, bodies, text }
    }
}

/// The error of a surface that is to be fitted to the colliders of `what`, which has none.
pub(super) fn no_colliders(what: &str) -> RunError {
    RunError::Request(format!(
        "found `surface.contact` for {what}, expected the folder of a shot, whose preset has the colliders; leave the setting out"
    ))
}
