//! The induced quantities of vortons: quantities, kernels, methods and targets.

use super::Vortons;
use crate::math::Vec3;
use serde::{Deserialize, Serialize};

/// The velocity gradient ∇u: the row is the component of the velocity, the column the direction of the derivative.
pub type Gradient = nalgebra::Matrix3<f32>;

/// The distribution of the vorticity of a vorton over its core σ; ρ = r/σ.
///
/// C is the constant in the speed of a thin vortex ring of circulation Γ_c: Γ_c/(4πR) · (ln(8R/σ) − C).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum Kernel {
    /// Uniform inside a ball of radius σ, and zero outside; C = ln 2 − 1/3. The kernel that [gourlay19] describes. Its
    /// velocity gradient is discontinuous at the edge of the core.
    Ball,
    /// G = (r² + σ²)^-½; C = 1. Differs from a point by 1.5/ρ² in velocity, so the core has an effect far away.
    RosenheadMoore,
    /// G = (r² + 1.5 σ²)/(r² + σ²)^3/2; C = ½. Fourth order: differs from a point by 1.9/ρ⁴.
    #[default]
    WinckelmansLeonard,
    /// G = erf(ρ/√2)/r; C = 1 + (ln 2 − γ)/2. The core that viscosity produces. Pairs take three times as long.
    Gaussian,
}

impl Kernel {
    /// The mean square radius of the vorticity of a straight filament of vortons, in σ²; that of the Gaussian core e^(−r²/a²) is a².
    /// For [`Kernel::RosenheadMoore`], whose tail has none, the one with which thin rings of one filament fly as fast: their C is
    /// that of Gaussian vortons of 0.94 σ.
    pub(in crate::sim) fn filament_variance(self) -> f64 {
        match self {
            Self::Ball => 0.4,
            Self::RosenheadMoore => 1.781,
            Self::WinckelmansLeonard => 1.0,
            Self::Gaussian => 2.0,
        }
    }
}

/// The method of summation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Method {
    /// Over all pairs: exact to single precision. The time grows with the product of the numbers of vortons and targets.
    Direct,
    /// By multipole expansions between cells of octrees (a fast multipole method). The relative L2 error of the velocity at
    /// the vortons is at most about `error`, one of [`ERRORS`]. Faster than [`Method::Direct`] from about 2000 vortons on.
    Tree {
        /// The requested relative L2 error.
        error: f32,
    },
    /// By a Poisson equation on a grid with boundary values of the tree, to an error of [`grid_errors`]. The error of the
    /// gradient is up to twelve times as large. Where a grid would cost more than all pairs, as for fewer than some thousand
    /// vortons, and far from the bulk of the vortons, the tree serves.
    Grid {
        /// The requested relative L2 error.
        error: f32,
    },
    /// By the grouping rule of [gourlay19], for comparison: 30 to 80 % of the velocity is error.
    Grouping,
    /// By the grid of [gourlay19] and multigrid, for comparison, of [`Kernel::Gaussian`] and the mean core: 1 to 16 % of the
    /// velocity is error. The tree serves points outside the grid, and all where it would be too large.
    Multigrid,
}

/// The induced quantity to evaluate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// The vector potential.
    Potential,
    /// The velocity.
    Velocity,
    /// The velocity and its gradient, in about twice the time of the velocity.
    VelocityAndGradient,
}

/// The points at which an induced quantity is evaluated.
#[derive(Clone, Copy, Debug)]
pub enum Targets<'a> {
    /// The vortons. Each is part of the sum at its own position.
    Vortons,
    /// Any points [m]: tracers, or the nodes of a grid.
    Points(&'a [Vec3]),
}

/// Induced quantities, in the order of the targets. Those that were not requested are empty.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Induced {
    /// A [m²/s].
    pub potential: Vec<Vec3>,
    /// u [m/s].
    pub velocity: Vec<Vec3>,
    /// ∇u [1/s].
    pub gradient: Vec<Gradient>,
}

/// The quantities as constants for which loops are compiled: how often the kernel is differentiated.
pub(super) const POTENTIAL: usize = 0;
pub(super) const VELOCITY: usize = 1;
pub(super) const GRADIENT: usize = 2;

impl<'a> Targets<'a> {
    pub(super) fn positions(self, vortons: &'a Vortons) -> &'a [Vec3] {
        match self {
            Targets::Vortons => &vortons.position,
            Targets::Points(points) => points,
        }
    }
}
