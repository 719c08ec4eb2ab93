//! Parameters of the motion of vortons.

use super::super::{ERRORS, Kernel, Method, grid_errors};
use crate::sim::setup::from_spacing;
use serde::{Deserialize, Serialize};

/// The motion of vortons. All keys except those of the evaluation and the time step are physics; absent terms
/// are not applied.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub struct FlowParams {
    /// The distribution of the vorticity of a vorton over its core.
    pub kernel: Kernel,
    /// The method by which induced velocities are summed.
    pub sum: Sum,
    /// The requested relative error of the velocity with `sum = "tree"` and `"grid"`. Smaller is slower;
    /// below 1e-3 the eddies of a shot hardly change, above 1e-2 thin rings wobble. Range: 0.00001 to 0.1.
    pub error: f32,
    /// Largest rotation and strain in a substep: the time step times the largest velocity gradient. Larger is
    /// faster; above about 0.5 eddies that stretch each other gain energy, above 1 they become unstable and
    /// are clamped. Range: above 0, at most 100.
    pub strain: f32,
    /// Largest displacement of a vorton in a substep, in cores. Larger is faster; above 1 eddies pass each
    /// other without interaction. Range: above 0, at most 100.
    pub displacement: f32,
    /// Largest number of substeps per frame; if the two limits require more, the record of the frame reports
    /// it. Range: 1 to 10000.
    pub max_substeps: u32,
    /// Viscosity of the air; absent: not applied.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub viscosity: Option<Viscosity>,
    /// Rotation of strengths towards the local vorticity, against the drift of vortex stretching; absent: not
    /// applied.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub relaxation: Option<Relaxation>,
    /// Remeshing: replacement of vortons by new ones on a grid where they no longer overlap or crowd; absent:
    /// not done.
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
    /// The method of summation, with its error in the accepted range.
    pub(in crate::sim) fn method(&self) -> Method {
        match self.sum {
            Sum::Tree => Method::Tree { error: self.error.clamp(*ERRORS.start(), *ERRORS.end()) },
            Sum::Grid => {
                let errors = grid_errors(self.kernel);
                Method::Grid { error: self.error.clamp(*errors.start(), *errors.end()) }
            }
            Sum::Direct => Method::Direct,
            Sum::Grouping => Method::Grouping,
            Sum::Multigrid => Method::Multigrid,
        }
    }
}

/// The method by which induced velocities are summed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Sum {
    /// Multipole expansions between cells of an octree, to `error`.
    #[default]
    Tree,
    /// A grid around the bulk of the vortons, to `error`, at least 1e-4, with the kernel `"rosenhead_moore"`
    /// 3e-3. Points far from the bulk, and clouds that would need too large a grid, are summed as with
    /// `tree`.
    Grid,
    /// All pairs: exact, and slow above some thousand vortons.
    Direct,
    /// The grouping rule of [gourlay19], for comparison: `error` only decides what is reported, and 30 to 80 % of the velocity is error.
    Grouping,
    /// The multigrid solve of [gourlay19], for comparison, with `kernel = "gaussian"`: `error` only decides what is reported, and 1 to 16 %
    /// of the velocity is error.
    Multigrid,
}

/// Viscosity.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Viscosity {
    /// Kinematic viscosity ν [m²/s]; air has 1.5e-5. Larger blurs eddies sooner: those of size s decay within
    /// s²/ν. Range: at least 0.
    pub nu: f32,
    /// The method of diffusion.
    #[serde(default)]
    pub scheme: ViscousScheme,
    /// The constant C of an eddy viscosity (C · core)² |S|, [smagorinsky63], for eddies smaller than cores;
    /// absent: none. 0.2 stabilises wakes and plumes at coarse spacings; larger blurs. Range: 0 to 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub eddies: Option<f32>,
}

/// The method of diffusion.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum ViscousScheme {
    /// Particle strength exchange between neighbours: needs cores that overlap, and `remesh` where smoke is
    /// to grow.
    #[default]
    Exchange,
    /// Core spreading: costs nothing and needs no neighbours; `remesh` splits cores that become too wide.
    Spreading,
}

/// Pedrizzetti's relaxation, corrected so that strengths keep their size, [pedrizzetti92] and [alvarez24].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Relaxation {
    /// The time τ in which a strength rotates to the direction of the local vorticity [s]. Smaller is more
    /// stable; below the turnover time of the smallest eddies it damps their twisting. Range: above 0.
    pub time: f32,
}

/// Remeshing by the M4′ kernel, [monaghan85].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Remesh {
    /// The spacing h of the grid [m]; new vortons have cores of `core` spacings; absent: `smoke.spacing`.
    /// Half the spacing gives eight times the vortons. Range: above 0.
    #[serde(default = "defaults::as_seeded")]
    #[cfg_attr(feature = "presets", schemars(extend("default" = null)))]
    pub spacing: f32,
    /// Cores of new vortons, in spacings. Below 1 they leave gaps, above 2 detail blurs and pairs cost more.
    /// Range: 1 to 2.5.
    #[serde(default = "defaults::core")]
    pub core: f32,
    /// The strain after which vortons are remeshed: the time integral of the largest velocity gradient.
    /// Smaller remeshes more often, each time blurring a little; above 3 colliding rings become unstable.
    /// Range: above 0, at most 100.
    #[serde(default = "defaults::strain")]
    pub strain: f32,
    /// The smallest overlap of cores, as a fraction of that on the grid: a vorton with less has lost its
    /// neighbours. After remeshing, the edges of bodies have 0.8. Range: 0.1 to 0.75.
    #[serde(default = "defaults::min_overlap")]
    pub least: f32,
    /// The largest overlap of cores, as a fraction of that on the grid: above it vortons crowd, or cores have
    /// grown. Range: 1.25 to 2.
    #[serde(default = "defaults::max_overlap")]
    pub most: f32,
    /// Vortons are also remeshed when those with an overlap outside these limits hold more than this fraction
    /// of all strength. Smaller remeshes thin bodies without need; larger lets holes grow. Range: 0 to 1.
    #[serde(default = "defaults::max_fraction_outside")]
    pub share: f32,
    /// Population control: vortons with less than this fraction of the largest circulation around them are
    /// removed, and their strength is redistributed to their neighbours. The influence of distant vortons
    /// decreases with their squared distance. At 0 none is removed: every remeshing adds two layers of
    /// useless vortons to bodies. Larger is faster, and erodes faint bodies. Range: 0 to 0.1.
    #[serde(default = "defaults::min_circulation")]
    pub weak: f32,
}

impl Remesh {
    /// Remeshing with this spacing [m], and defaults otherwise.
    pub fn of(spacing: f32) -> Self {
        from_spacing(spacing)
    }
}

mod defaults {
    /// Stands for `smoke.spacing`, which replaces it when the preset is read.
    pub(super) fn as_seeded() -> f32 {
        0.0
    }
    pub(super) fn core() -> f32 {
        1.5
    }
    pub(super) fn strain() -> f32 {
        1.5
    }
    pub(super) fn min_overlap() -> f32 {
        0.67
    }
    pub(super) fn max_overlap() -> f32 {
        1.67
    }
    pub(super) fn max_fraction_outside() -> f32 {
        0.25
    }
    pub(super) fn min_circulation() -> f32 {
        3e-3
    }
}
