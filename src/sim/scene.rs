//! The composition of a preset: a whole [`Scene`] as plain data.

use super::{
    Observable, SetupError, Systems, Timeline,
    coupling::Coupling,
    force::ForceParams,
    liquid::{self, LiquidParams},
    rigid::BodyParams,
    sheet::{SheetParams, SheetsCommon, SheetsParams, Shot},
    smoke::{self, Smoke, SmokeParams},
    whitewater::WhitewaterParams,
};
use crate::{
    cache::FrameKeys,
    export::{
        MeshFormat, SheetFormat,
        vdb::{VolumeGrid, VolumeParams},
    },
    mesh::SurfaceParams,
    preset::{Assets, Branch, Camera, Frames, frame_keys},
    solid::Collider,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// A whole shot: the content of a preset.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Scene {
    /// The shot's name.
    pub title: String,
    /// The frames to compute: "1-96", "1-240x2", "1,5,9-12". The first is the initial state.
    pub frames: Frames,
    /// Frames a second. Range: above 0, at most 10000.
    #[serde(default = "default_fps")]
    pub fps: f32,
    /// Gravity and colliders.
    #[serde(default)]
    pub world: World,
    /// The liquid; absent: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub liquid: Option<LiquidParams>,
    /// The smoke; absent: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub smoke: Option<SmokeParams>,
    /// The sheets; empty: none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub sheet: Vec<SheetParams>,
    /// Parameters of all sheets; absent: no joints, collisions with solids, and the solver's defaults.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sheets: Option<SheetsCommon>,
    /// Rigid bodies; empty: none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub body: Vec<BodyParams>,
    /// Couplings of systems; empty: they do not interact.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub coupling: Vec<Coupling>,
    /// Force fields; empty: none but gravity.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub force: Vec<ForceParams>,
    /// Surface reconstruction.
    #[serde(default)]
    pub surface: SurfaceParams,
    /// Volumes.
    #[serde(default)]
    pub volume: VolumeParams,
    /// Spray, foam and bubbles of the liquid, which `shot` and `whitewater` compute from cached frames; absent: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub whitewater: Option<WhitewaterParams>,
    /// Files that `shot` writes in addition to the cache.
    #[serde(default)]
    pub output: Output,
    /// Camera for pictures, which the Blender extension places; absent: it frames the shot itself.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera: Option<Camera>,
    /// Observable of `tradeoff`; absent: the bulk's height.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tradeoff: Option<Tradeoff>,
    /// Where the shot branched from others, in ascending order of frames; `simulate --from` writes it. Empty: it starts with the seeds.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub branch: Vec<Branch>,
    /// Content of the files that the preset names; not part of its text.
    #[serde(skip)]
    pub assets: Assets,
}

/// What `tradeoff` compares in addition to densities and energy.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Tradeoff {
    /// The observable that matters for the picture; see docs/tradeoff.md.
    pub observable: Observable,
}

/// Surroundings of the systems.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct World {
    /// Acceleration of gravity [m/s²].
    pub gravity: [f32; 3],
    /// Solid obstacles.
    pub collider: Vec<Collider>,
}

impl Default for World {
    fn default() -> Self {
        Self { gravity: [0.0, 0.0, -9.81], collider: Vec::new() }
    }
}

/// Files that `shot` writes in addition to the cache.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Output {
    /// Formats of the surface meshes.
    pub mesh: Vec<MeshFormat>,
    /// Grids of the volume files; empty: no volumes.
    pub volume: Vec<VolumeGrid>,
    /// Files of the sheets: "pc2" is a mesh and a point cache of all frames, which Blender plays; "ply" and "obj" are a mesh per
    /// frame.
    pub sheet: Vec<SheetFormat>,
    /// Thickness of sheets in files [m]; absent: surfaces without thickness. Range: above 0.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub thickness: Option<f32>,
}

impl Output {
    /// Whether any file is requested.
    pub(crate) fn has_files(&self) -> bool {
        !(self.mesh.is_empty() && self.volume.is_empty() && self.sheet.is_empty())
    }
}

/// Settings as a tree of values, without keys that have no value (TOML has none).
///
/// By way of JSON text: each serialiser of its own would compile every table of parameters once more, and only text keeps
/// single precision numbers as short as they were written.
pub(crate) fn plain_values(settings: &impl Serialize) -> serde_json::Value {
    let text = serde_json::to_string(settings).expect("settings are plain data");
    let mut values = serde_json::from_str(&text).expect("it was written as JSON");
    drop_absent(&mut values);
    values
}

fn drop_absent(values: &mut serde_json::Value) {
    match values {
        serde_json::Value::Object(table) => {
            table.retain(|_, value| !value.is_null());
            table.values_mut().for_each(drop_absent);
        }
        serde_json::Value::Array(list) => list.iter_mut().for_each(drop_absent),
        _ => {}
    }
}

fn default_fps() -> f32 {
    24.0
}

impl Scene {
    /// The scene as a preset, with every default written out. It reads as an equal scene.
    pub fn to_toml(&self) -> String {
        toml::to_string(&self.values()).expect("a scene has only values that TOML can hold")
    }

    /// The values by the keys of presets, with every default, without keys that have no value.
    pub(crate) fn values(&self) -> serde_json::Value {
        plain_values(self)
    }

    /// Gravity and colliders in the form of the simulation. Meshes of colliders must be sampled before.
    pub fn surroundings(&self) -> super::World {
        let (fps, first) = (f64::from(self.fps), self.frames.first().0);
        let solids = self.world.collider.iter().map(|collider| collider.solid(fps, first)).collect();
        super::World { gravity: self.world.gravity.into(), solids }
    }

    /// The systems in the form of the simulation.
    pub fn systems(&self) -> Systems {
        let (fps, first) = (f64::from(self.fps), self.frames.first().0);
        let smoke = self.smoke.clone().map(|params| Smoke { params, fps, first });
        let params =
            SheetsParams { sheet: self.sheet.clone(), common: self.sheets.clone().unwrap_or_default() };
        let sheets = (!self.sheet.is_empty()).then_some(Shot { params, fps, first });
        let timeline = self.timeline();
        let (liquid, couplings, forces) = (self.liquid.clone(), self.coupling.clone(), self.force.clone());
        Systems { liquid, smoke, sheets, bodies: self.body.clone(), couplings, forces, timeline }
    }

    /// The scene with no system but its smoke.
    pub(in crate::sim) fn smoke_alone(&self) -> Self {
        let (sheet, body, coupling) = (Vec::new(), Vec::new(), Vec::new());
        Self { liquid: None, sheet, sheets: None, body, coupling, ..self.clone() }
    }

    /// The liquid and its bodies, and the sheets that share its substeps because they are coupled with it.
    pub(in crate::sim) fn systems_sharing_substeps(&self) -> Systems {
        let Systems { liquid, sheets, bodies, mut couplings, forces, timeline, .. } = self.systems();
        couplings.retain(|coupling| coupling.between.iter().any(|side| side == liquid::NAME));
        let sheets = sheets.filter(|_| liquid.is_some() && !couplings.is_empty());
        let bodies = if liquid.is_some() { bodies } else { Vec::new() };
        Systems { liquid, sheets, bodies, couplings, forces, timeline, ..Systems::default() }
    }

    /// Times of frames.
    pub(crate) fn timeline(&self) -> Timeline {
        Timeline { fps: f64::from(self.fps), first: self.frames.first().0 }
    }

    /// Time from the first to the last frame [s].
    pub(in crate::sim) fn seconds(&self) -> f64 {
        f64::from(self.frames.last().0.saturating_sub(self.frames.first().0)) / f64::from(self.fps)
    }

    /// Refuses smoke with too many vortons and tracers, once its meshes are sampled. The check of the preset refuses what does
    /// not depend on meshes.
    ///
    /// # Errors
    /// [`SetupError::TooMuchSmoke`].
    pub fn refuse_too_much_smoke(&self) -> Result<(), SetupError> {
        self.smoke.as_ref().map_or(Ok(()), |params| smoke::refuse_too_much(params, self.seconds()))
    }

    /// Hash of everything that determines the simulated state: frame rate, first frame, world, systems, the bytes of the files
    /// that these name, and the solvers' version.
    ///
    /// The title, the frames after the first, the surface, the volume, whitewater, the output, the camera, the tradeoff, the colours of liquids (but whether there are any) and the looks of colliders
    /// do not change it. Caches store it, so that frames of another scene are recognised as stale.
    pub fn simulation_key(&self) -> u64 {
        xxhash_rust::xxh3::xxh3_64(self.decisive().as_bytes())
    }

    /// The keys of the cached frames: those before a branch are of another simulation.
    pub fn frame_keys(&self) -> FrameKeys {
        let own = self.simulation_key();
        frame_keys(own, &self.branch).unwrap_or_else(|| FrameKeys::new(own, Vec::new()))
    }

    /// What [`Self::simulation_key`] is a hash of, by the keys of presets, with every default.
    pub fn simulation_settings(&self) -> serde_json::Value {
        serde_json::from_str(&self.decisive()).expect("it was written as JSON")
    }

    /// What decides the simulated state, as JSON.
    fn decisive(&self) -> String {
        #[derive(Serialize)]
        struct Decisive<'a> {
            fps: f32,
            first: u32,
            solvers: u32,
            world: World,
            liquid: Option<LiquidParams>,
            #[serde(skip_serializing_if = "Option::is_none")]
            smoke: &'a Option<SmokeParams>,
            #[serde(skip_serializing_if = "Option::is_none")]
            smoke_solver: Option<u32>,
            #[serde(skip_serializing_if = "<[SheetParams]>::is_empty")]
            sheet: &'a [SheetParams],
            #[serde(skip_serializing_if = "Option::is_none")]
            sheets: &'a Option<SheetsCommon>,
            #[serde(skip_serializing_if = "Vec::is_empty")]
            body: Vec<BodyParams>,
            #[serde(skip_serializing_if = "Option::is_none")]
            body_solver: Option<u32>,
            #[serde(skip_serializing_if = "Vec::is_empty")]
            coupling: Vec<Coupling>,
            #[serde(skip_serializing_if = "<[ForceParams]>::is_empty")]
            force: &'a [ForceParams],
            #[serde(skip_serializing_if = "<[Branch]>::is_empty")]
            branch: &'a [Branch],
            #[serde(skip_serializing_if = "BTreeMap::is_empty")]
            files: BTreeMap<&'a str, u64>,
        }
        let Self {
            title: _,
            frames,
            fps,
            world,
            liquid,
            smoke,
            sheet,
            sheets,
            body,
            coupling,
            force,
            surface: _,
            volume: _,
            whitewater: _,
            output: _,
            camera: _,
            tradeoff: _,
            branch,
            assets,
        } = self;
        let files = assets.iter().map(|(name, asset)| (name.as_str(), asset.hash)).collect();
        let solvers = super::STATE_VERSION;
        let smoke_solver = smoke.as_ref().map(|_| super::SMOKE_STATE_VERSION);
        let mut world = world.clone();
        world.collider.iter_mut().for_each(|collider| collider.look = None);
        let body_solver = (!body.is_empty()).then_some(super::BODY_STATE_VERSION);
        let mut body = body.clone();
        body.iter_mut().for_each(|body| body.look = None);
        let mut liquid = liquid.as_ref().map(LiquidParams::without_colors);
        if let Some(LiquidParams { channels, .. }) = &mut liquid {
            // Frames have channels in a fixed order, each once.
            channels.sort_unstable();
            channels.dedup();
        }
        // Neither the order of couplings nor that of their systems matters.
        let mut coupling = coupling.clone();
        coupling.iter_mut().for_each(|coupling| coupling.between.sort());
        coupling.sort_by(|a, b| a.between.cmp(&b.between));
        let decisive = Decisive {
            fps: *fps,
            first: frames.first().0,
            solvers,
            world,
            liquid,
            smoke,
            smoke_solver,
            sheet,
            sheets,
            body,
            body_solver,
            coupling,
            force,
            branch,
            files,
        };
        serde_json::to_string(&decisive).expect("a scene has only values that JSON can hold")
    }
}
