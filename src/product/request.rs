//! What is requested of products.

use super::{colliders, preview::PreviewParams};
use crate::{
    export::{usd::StageParams, vdb::VolumeParams},
    import::Sequence,
    job::{
        RunError, ShotFolder,
        batch::{BatchRequest, Source},
    },
    mesh::SurfaceParams,
    sim::{
        scene::{Output, Scene},
        whitewater::WhitewaterParams,
    },
};
use serde_json::{Map, Value};

/// The settings of all products.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct ProductSettings {
    /// How particles become a surface.
    pub surface: SurfaceParams,
    /// How frames become volumes.
    pub volume: VolumeParams,
    /// The files to write.
    pub output: Output,
    /// How whitewater is made of a liquid; `None`: it is not.
    pub whitewater: Option<WhitewaterParams>,
    /// Whether tracers are written as points, which presets cannot request.
    pub points: bool,
    /// Whether colliders are written: those of a preset come with its other outputs.
    pub colliders: bool,
    /// What a stage of the shot's files is like; `None`: there is none.
    pub usd: Option<StageParams>,
    /// How pictures are made, which presets cannot request; `None`: they are not.
    pub preview: Option<PreviewParams>,
}

impl ProductSettings {
    /// The settings of a preset.
    pub(crate) fn of(scene: &Scene) -> Self {
        let Scene { surface, volume, whitewater, output, world, body, .. } = scene;
        let is_any_shown = world.collider.iter().any(|collider| collider.shown_look().is_some());
        let colliders = output.has_files() && (is_any_shown || !body.is_empty());
        let (surface, volume, output) = (surface.clone(), volume.clone(), output.clone());
        Self {
            surface,
            volume,
            output,
            whitewater: whitewater.clone(),
            points: false,
            colliders,
            usd: None,
            preview: None,
        }
    }

    /// The settings of the preset of a shot: its colliders are requested too if the manifest lists some of an earlier run.
    ///
    /// # Errors
    /// If the manifest cannot be read.
    pub(crate) fn of_shot(scene: &Scene, shot: &ShotFolder) -> Result<Self, RunError> {
        let settings = Self::of(scene);
        let colliders = settings.colliders || scene.output.has_files() && colliders::are_listed(shot)?;
        Ok(Self { colliders, ..settings })
    }
}

/// How a cache is retimed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Retime {
    /// Frames made of one [–], above 0: 2 is half as fast.
    pub factor: f64,
    /// Whether tracers are seeded by the preset and advected from the start; else those of the cache are used.
    pub reseed: bool,
}

/// Input of products.
#[derive(Clone, Copy, Debug)]
pub(crate) enum ProductInput<'a> {
    /// Frames.
    Frames(Source<'a>),
    /// Level sets that other programs wrote.
    LevelSets(&'a Sequence),
}

/// A request of products.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ProductRequest<'a> {
    /// Input of the products.
    pub input: ProductInput<'a>,
    /// The shot folder that gets their files.
    pub out: &'a ShotFolder,
    /// Settings of the products.
    pub settings: &'a ProductSettings,
    /// The preset of the input, if it is known.
    pub scene: Option<&'a Scene>,
    /// How the input is retimed; `None`: its frames are used as they are.
    pub retime: Option<Retime>,
    /// The frames to use, and how.
    pub batch: &'a BatchRequest,
}

impl<'a> ProductRequest<'a> {
    /// The frames of the request.
    ///
    /// # Errors
    /// If the input has none.
    pub(super) fn frames(&self) -> Result<Source<'a>, RunError> {
        match self.input {
            ProductInput::Frames(source) => Ok(source),
            ProductInput::LevelSets(_) => {
                Err(RunError::Request("found level sets, expected particle files or a cache".into()))
            }
        }
    }
}

/// Figures of a product's files that are not in the manifest.
#[derive(Clone, Debug, Default)]
pub(crate) struct ProductInfo {
    /// For programs.
    pub(crate) values: Map<String, Value>,
    /// For people, a line each.
    pub(crate) lines: Vec<String>,
}
