//! What a preset can say about the motion of vortons.

use super::super::{ERRORS, Kernel, Method, grid_errors};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How vortons move. Everything but the limits of the step is physics; what is absent is not applied.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct FlowParams {
    /// How the vorticity of a vorton is spread over its core.
    pub kernel: Kernel,
    /// How velocities are summed.
    pub sum: Sum,
    /// The relative error of the velocity that `sum = "tree"` and `"grid"` aim at. Smaller is slower; from 1e-3 on eddies of a
    /// shot hardly differ, above 1e-2 thin rings wobble.
    #[schemars(range(min = 1e-5, max = 0.1))]
    pub error: f32,
    /// Most turn and strain in a substep: its length times the largest velocity gradient. Larger is faster; above about 0.5
    /// eddies that stretch each other gain energy, above 1 they burst and are clamped.
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 100.0))]
    pub strain: f32,
    /// Most cores that a vorton moves in a substep. Larger is faster; above 1 eddies jump past what they should turn around.
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 100.0))]
    pub displacement: f32,
    /// Most substeps a frame; when the two limits ask for more, the frame's record says so.
    #[schemars(range(min = 1, max = 10000))]
    pub max_substeps: u32,
    /// Viscosity of the air; absent: not applied.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub viscosity: Option<Viscosity>,
    /// Turns strengths towards the vorticity around them, against the drift of stretching; absent: not applied.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub relaxation: Option<Relaxation>,
    /// Puts vortons back onto a lattice when they part or crowd; absent: not done.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub remesh: Option<Remesh>,
}

impl Default for FlowParams {
    fn default() -> Self {
        Self {
            kernel: Kernel::default(),
            sum: Sum::default(),
            error: 1e-3,
            strain: 0.3,
            displacement: 1.0,
            max_substeps: 200,
            viscosity: None,
            relaxation: None,
            remesh: None,
        }
    }
}

impl FlowParams {
    /// How the evaluator sums.
    pub(in crate::sim) fn method(&self) -> Method {
        match self.sum {
            Sum::Tree => Method::Tree { error: self.error.clamp(*ERRORS.start(), *ERRORS.end()) },
            Sum::Grid => {
                let errors = grid_errors(self.kernel);
                Method::Grid { error: self.error.clamp(*errors.start(), *errors.end()) }
            }
            Sum::Direct => Method::Direct,
        }
    }
}

/// How velocities are summed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Sum {
    /// By expansions between cells, to `error`.
    #[default]
    Tree,
    /// By a lattice around the bulk of the vortons, to `error`, which has to be 1e-4 at least, with the kernel
    /// `"rosenhead_moore"` 3e-3. What is far from the bulk, or would take too large a lattice, is summed as by `tree`.
    Grid,
    /// Over all pairs: exact, and slow above some thousand vortons.
    Direct,
}

/// Viscosity.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Viscosity {
    /// Kinematic viscosity ν [m²/s]; air has 1.5e-5. Larger blurs eddies sooner: those of size s fade within s²/ν.
    #[schemars(extend("unit" = "m²/s", "minimum" = 0.0))]
    pub nu: f32,
    /// How strength spreads.
    #[serde(default)]
    pub scheme: ViscousScheme,
    /// What eddies too fine for the vortons take from those that are not: the constant C of a viscosity (C · core)² |S|,
    /// [smagorinsky63]; absent: nothing. 0.2 calms wakes and plumes that stir themselves up on coarse lattices; larger blurs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub eddies: Option<f32>,
}

/// How strength spreads.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ViscousScheme {
    /// Vortons hand strength to those around them: needs cores that overlap, and `remesh` where smoke is to grow.
    #[default]
    Exchange,
    /// Cores grow: costs nothing and needs no neighbours; cores that outgrow the overlap are divided by `remesh`.
    Spreading,
}

/// Pedrizzetti's relaxation, corrected so that strengths keep their size, [pedrizzetti92] and [alvarez24].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Relaxation {
    /// Seconds τ in which a strength turns to the vorticity around it [s]. Smaller is calmer; shorter than the turn of the
    /// smallest eddies it damps what ought to twist.
    #[schemars(extend("unit" = "s", "exclusiveMinimum" = 0.0))]
    pub time: f32,
}

/// Remeshing by the M4′ kernel, [monaghan85].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Remesh {
    /// The lattice's spacing h [m]; vortons stand there with cores of `core` spacings; absent: `smoke.spacing`. Half as much
    /// gives eight times the vortons.
    #[serde(default = "defaults::as_seeded")]
    #[schemars(extend("unit" = "m", "exclusiveMinimum" = 0.0, "default" = null))]
    pub spacing: f32,
    /// Cores of new vortons, in spacings. Below 1 they leave gaps, above 2 detail blurs and pairs cost more.
    #[serde(default = "defaults::core")]
    #[schemars(range(min = 1.0, max = 2.5))]
    pub core: f32,
    /// The lattice is made anew after this much strain: the largest velocity gradient, summed over time. Smaller makes it often,
    /// each time blurring by a little; above 3 rings that collide burst.
    #[serde(default = "defaults::strain")]
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 100.0))]
    pub strain: f32,
    /// A vorton around which cores overlap by less than this part of the lattice's overlap has lost its neighbours. On a lattice
    /// the edges of bodies have 0.8.
    #[serde(default = "defaults::least")]
    #[schemars(range(min = 0.1, max = 0.75))]
    pub least: f32,
    /// Above this part they crowd, or cores have grown.
    #[serde(default = "defaults::most")]
    #[schemars(range(min = 1.25, max = 2.0))]
    pub most: f32,
    /// The lattice is made anew, too, when vortons that hold more than this share of all strength are outside both. Smaller
    /// takes thin bodies for lost; larger lets holes grow.
    #[serde(default = "defaults::share")]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub share: f32,
    /// Vortons weaker than this part of the strongest around them hand their strength to their neighbours and go; of what is
    /// far the part counts that its distance leaves. At 0 every one stays: bodies swell by two layers each time, of vortons that
    /// do nothing. Larger is faster, and wears off what is faint.
    #[serde(default = "defaults::weak")]
    #[schemars(range(min = 0.0, max = 0.1))]
    pub weak: f32,
}

impl Remesh {
    /// With this spacing [m], and what else presets need not say.
    pub fn of(spacing: f32) -> Self {
        Self {
            spacing,
            core: defaults::core(),
            strain: defaults::strain(),
            least: defaults::least(),
            most: defaults::most(),
            share: defaults::share(),
            weak: defaults::weak(),
        }
    }
}

mod defaults {
    /// No lattice has this spacing: a preset's own takes its place when it is read.
    pub(super) fn as_seeded() -> f32 {
        0.0
    }
    pub(super) fn core() -> f32 {
        1.5
    }
    pub(super) fn strain() -> f32 {
        1.5
    }
    pub(super) fn least() -> f32 {
        0.67
    }
    pub(super) fn most() -> f32 {
        1.67
    }
    pub(super) fn share() -> f32 {
        0.25
    }
    pub(super) fn weak() -> f32 {
        3e-3
    }
}
