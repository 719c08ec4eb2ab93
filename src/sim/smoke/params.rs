//! Parameters of smoke in a preset.

use crate::{
    sim::{setup::from_spacing, vortex::flow::FlowParams},
    solid::{Interpolation, Keyframe, Shape},
};
use serde::{Deserialize, Serialize};

/// Smoke in air of vortons, which are particles of vorticity that induce the air's velocity. It advects tracers, whose density and
/// temperature are seen.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct SmokeParams {
    /// Distance between vortons where they are seeded [m]: half as much shows swirls of half the size, and takes eight
    /// times the vortons. Range: above 0.
    pub spacing: f32,
    /// Core σ of a vorton, in spacings. Below 1 vortons part and the air between them is jerky; above 2 swirls blur.
    /// Range: 0.8 to 4.
    #[serde(default = "defaults::overlap")]
    pub overlap: f32,
    /// Distance between tracers where smoke is seeded or emitted, in spacings. Half as much gives eight times the tracers
    /// and smoother volumes; it does not change how the air moves but through `buoyancy`. Range: 0.05 to 4.
    #[serde(default = "defaults::tracers")]
    pub tracers: f32,
    /// Frames between two samples of the velocity's error against the sum over all pairs. 1 samples every frame.
    /// Range: 1 to 100000.
    #[serde(default = "defaults::sample_every")]
    pub sample_every: u32,
    /// How vortons move.
    #[serde(default)]
    pub flow: FlowParams,
    /// Velocity of the air far away [m/s]; absent: it is still.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wind: Option<[f32; 3]>,
    /// Rate at which tracers cool down to the air's temperature [1/s]: after 1/rate a third of the heat is left; absent:
    /// heat stays. Range: at least 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cooling: Option<f32>,
    /// Rate at which smoke thins out [1/s]: after 1/rate a third of the density is left; absent: it stays.
    /// Range: at least 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dissolve: Option<f32>,
    /// Hot smoke rises, heavy smoke sinks; absent: smoke only drifts.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub buoyancy: Option<Buoyancy>,
    /// Swirls that leave the surfaces of colliders; absent: air slips along them and nothing is shed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shedding: Option<Shedding>,
    /// Random swirls at the start; absent: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub turbulence: Option<Turbulence>,
    /// Smoke rings at the start.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub ring: Vec<Ring>,
    /// Straight vortex tubes at the start.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub tube: Vec<Tube>,
    /// Smoke that is there at the start.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub source: Vec<SmokeSource>,
    /// Smoke that comes while the shot runs.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub emitter: Vec<Emitter>,
}

impl SmokeParams {
    /// Smoke of vortons `spacing` [m] apart with the defaults of presets, still without a source.
    pub fn new(spacing: f32) -> Self {
        from_spacing(spacing)
    }
}

/// How the weight of smoke moves the air: Dω/Dt = (1/ρ) ∇ρ × g.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub struct Buoyancy {
    /// Temperature of the air far away [K]. Smoke hotter by as much weighs half of it. Range: above 0.
    pub ambient: f32,
    /// By which part of the air's weight smoke of density 1 is heavier. 0: density weighs nothing; large enough, and
    /// hot smoke turns over and falls. Range: 0 to 1000.
    pub weight: f32,
}

impl Default for Buoyancy {
    fn default() -> Self {
        Self { ambient: 293.0, weight: 0.0 }
    }
}

/// Vorticity shed by colliders: the slip along a surface is released into the air as vortons.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub struct Shedding {
    /// Part of the slip along a surface that is released, 0 to 1: 1 is a rough body with a full wake, 0.2 a smooth one.
    /// 0 sheds nothing; above it, the air that a turning body takes along does not depend on it. Range: 0 to 1.
    pub strength: f32,
    /// Thickness of the layer in which air slips, in spacings: vortons are released in its middle. Thinner, and they touch the
    /// body and are projected out of it. Air sticks to the body: the nearer vortons in the layer are, the less they are stretched.
    /// Range: 0.25 to 4.
    pub layer: f32,
}

impl Default for Shedding {
    fn default() -> Self {
        Self { strength: 1.0, layer: 1.0 }
    }
}

/// Random swirls: the curl of a random potential, so that vorticity has no ends.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Turbulence {
    /// Where they are: they fade to nothing at its surface. A box, a ball or a capsule.
    pub shape: Shape,
    /// Size of the largest swirls [m]: at least four spacings, or the vortons do not resolve them. Range: above 0.
    pub scale: f32,
    /// Root of the mean square of the air's speed where the vortons are [m/s]. Range: at least 0.
    pub strength: f32,
    /// Another number gives other swirls.
    #[serde(default)]
    pub seed: u32,
}

/// A vortex ring.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Ring {
    /// Centre of the ring [m].
    pub center: [f32; 3],
    /// Where it flies to; any length but zero.
    #[serde(default = "defaults::up")]
    pub direction: [f32; 3],
    /// From the centre to the middle of the core [m]. Range: above 0.
    pub radius: f32,
    /// Radius a of the core [m]: vorticity falls off from its middle as e^(−r²/a²). Below 1.5 spacings (at the default
    /// `overlap` and `kernel`) vortons are wider; the shot then reports it, and the ring is slower. Range: above 0.
    pub thickness: f32,
    /// Circulation [m²/s]; it flies with about circulation/(4π radius) · (ln(8 radius/thickness) − 0.558), [saffman70], thick ones
    /// more slowly.
    pub circulation: f32,
    /// How far the radius waves along the ring, as a part of it: a little makes it break up as rings do.
    /// Range: 0 to 0.5.
    #[serde(default)]
    pub wobble: f32,
    /// Density of the smoke in the core; 0: the ring is not seen. Range: at least 0.
    #[serde(default = "defaults::one")]
    pub density: f32,
    /// Temperature of the smoke above that of the air [K].
    #[serde(default)]
    pub temperature: f32,
}

/// A straight vortex tube. Its ends are free: the air closes the swirl around them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Tube {
    /// One end of the axis [m].
    pub from: [f32; 3],
    /// The other end [m]. Seen from here, the air turns counter-clockwise.
    pub to: [f32; 3],
    /// Radius of the core [m], as of a ring. Range: above 0.
    pub thickness: f32,
    /// Circulation [m²/s].
    pub circulation: f32,
    /// Density of the smoke in the core; 0: the tube is not seen. Range: at least 0.
    #[serde(default = "defaults::one")]
    pub density: f32,
    /// Temperature of the smoke above that of the air [K].
    #[serde(default)]
    pub temperature: f32,
}

/// A volume filled with smoke when the shot starts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct SmokeSource {
    /// The volume: a box, a ball, a capsule or a mesh.
    pub shape: Shape,
    /// Density of the smoke; 1 is what `density` grids show as full. Range: at least 0.
    #[serde(default = "defaults::one")]
    pub density: f32,
    /// Temperature above that of the air [K].
    #[serde(default)]
    pub temperature: f32,
}

/// A volume that gives off smoke.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Emitter {
    /// The volume: a box, a ball, a capsule or a mesh.
    pub shape: Shape,
    /// Where the shape is over time, as for colliders.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub keyframes: Vec<Keyframe>,
    /// How it moves from keyframe to keyframe.
    #[serde(default)]
    pub interpolation: Interpolation,
    /// How often a second the volume is filled with new smoke [1/s]. Range: at least 0.
    #[serde(default = "defaults::rate")]
    pub rate: f32,
    /// Density of the smoke. Range: at least 0.
    #[serde(default = "defaults::one")]
    pub density: f32,
    /// Temperature above that of the air [K].
    #[serde(default)]
    pub temperature: f32,
    /// Velocity with which smoke is emitted, in addition to that of the shape [m/s]: it drags the air along; absent: smoke
    /// appears in the air as that moves.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub velocity: Option<[f32; 3]>,
    /// The frame at which it begins to give off smoke, which the next one shows; absent: the shot's first.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub start: Option<u32>,
    /// The last frame with new smoke; absent: the shot's last.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub end: Option<u32>,
    /// Another number puts the tracers elsewhere.
    #[serde(default)]
    pub seed: u32,
}

impl SmokeParams {
    /// Sets the grid spacing of [`Remesh`](crate::sim::vortex::flow::Remesh) to that of the smoke if a preset names none.
    pub fn settle(&mut self) {
        if let Some(remesh) = self.flow.remesh.as_mut().filter(|remesh| remesh.spacing == 0.0) {
            remesh.spacing = self.spacing;
        }
    }

    /// Core of a vorton [m].
    pub fn core(&self) -> f32 {
        self.overlap * self.spacing
    }

    /// Shapes in the parameters, with their keys below `smoke`.
    pub fn shapes(&self) -> Vec<(String, &Shape)> {
        let turbulence = self.turbulence.iter().map(|t| ("turbulence".to_owned(), &t.shape));
        let sources = self.source.iter().enumerate().map(|(i, s)| (format!("source.{i}"), &s.shape));
        let emitters = self.emitter.iter().enumerate().map(|(i, e)| (format!("emitter.{i}"), &e.shape));
        turbulence.chain(sources).chain(emitters).collect()
    }

    /// Shapes in the parameters, to be filled.
    pub fn shapes_mut(&mut self) -> impl Iterator<Item = &mut Shape> {
        let turbulence = self.turbulence.iter_mut().map(|t| &mut t.shape);
        let sources = self.source.iter_mut().map(|s| &mut s.shape);
        turbulence.chain(sources).chain(self.emitter.iter_mut().map(|e| &mut e.shape))
    }

    /// Distance between tracers where they are seeded [m].
    pub fn tracer_spacing(&self) -> f32 {
        self.tracers * self.spacing
    }
}

mod defaults {
    pub(super) fn overlap() -> f32 {
        1.5
    }
    pub(super) fn tracers() -> f32 {
        0.5
    }
    pub(super) fn sample_every() -> u32 {
        10
    }
    pub(super) fn up() -> [f32; 3] {
        [0.0, 0.0, 1.0]
    }
    pub(super) fn one() -> f32 {
        1.0
    }
    pub(super) fn rate() -> f32 {
        10.0
    }
}
