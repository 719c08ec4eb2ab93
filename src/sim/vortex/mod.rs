//! Vortons: smoke and air as moving pieces of vorticity.
//!
//! This is the base of the vortex particle method: one evaluator of what a set of vortons induces, the vector potential,
//! the velocity and its gradient, at the vortons themselves or at any points.
//!
//! *Method*: [gourlay19]'s sum of vector potentials over mollified vortons, as in [winckelmans93]. With d = x − x_q,
//! r = |d| and a kernel G (see [`Kernel`]):
//!
//! ```text
//! A(x) = (1/4π) Σ Γ_q G(r)      u(x) = ∇ × A = (1/4π) Σ K(r) Γ_q × d      K = −G′/r,  H = K′/r
//! ∂u_i/∂x_j = (1/4π) Σ [ H d_j (Γ × d)_i + K ε_ikj Γ_k ]
//! ```
//!
//! The sum is taken over all pairs ([`Method::Direct`]), or with Taylor expansions of the kernel between the cells of
//! octrees ([`Method::Tree`], `walk.rs`), or by a Poisson equation on a lattice with boundary values of the tree
//! ([`Method::Grid`], `grid/`); the knob of both is the error of the velocity. The paper's own tree rule and grid are kept
//! for comparison in `benches/reference/vortex/`.
//!
//! *Departs from the paper*: a vorton carries its strength Γ = ω V and its core, not an angular velocity and a size; the
//! potential inside a core is the ball's, where the text's eq. 5 has a curl that turns the wrong way; sums over cells are
//! of strengths, about the centre of |Γ|; the kernel of each vorton is expanded, not that of a point.
//!
//! *Symbols*: Γ → `strength` [m³/s], σ → `core` [m], A → `potential` [m²/s], u → `velocity` [m/s], ∇u → `gradient` [1/s].
//!
//! *Limits*: single precision: about 1e-6 of the velocity. More vortons than a leaf holds at exactly one place are summed
//! pair by pair.

mod accuracy;
mod chain;
mod coherence;
mod direct;
mod expansion;
pub mod flow;
mod grid;
mod index;
mod invariants;
mod lanes;
#[cfg(target_arch = "x86_64")]
mod lanes_avx2;
mod moments;
mod octree;
mod pairs;
mod reach;
mod vortons;
mod walk;

pub use accuracy::{ERRORS, sampled_error};
pub use grid::{UniformGrid, VectorField, boundary_values, choose_grid, grid_errors, poisson};
pub use invariants::{Invariants, invariants};
pub use reach::beyond;
pub use vortons::{ElementKind, LARGEST, OutOfRange, SMALLEST_CORE, Vortons};

use crate::math::Vec3;
use chain::{Ball, Gaussian, RosenheadMoore, WinckelmansLeonard};
use grid::GridKernel;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// ∇u: the row is the component of the velocity, the column the direction of the derivative.
pub type Gradient = nalgebra::Matrix3<f32>;

/// How the vorticity of a vorton is spread over its core σ; ρ = r/σ.
///
/// The constant C is that of a thin ring of vortons of circulation Γ_c, which moves at Γ_c/(4πR) · (ln(8R/σ) − C).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Kernel {
    /// Even inside a ball of radius σ, and that of a point outside; C = ln 2 − 1/3. What the source text meant. Its
    /// gradient jumps at the core's edge.
    Ball,
    /// G = (r² + σ²)^-½; C = 1. Differs from a point by 1.5/ρ² in velocity, so cores are felt from afar.
    RosenheadMoore,
    /// G = (r² + 1.5 σ²)/(r² + σ²)^3/2; C = ½. Fourth order: differs from a point by 1.9/ρ⁴.
    #[default]
    WinckelmansLeonard,
    /// G = erf(ρ/√2)/r; C = 1 + (ln 2 − γ)/2. The core that viscosity makes. Pairs take three times as long.
    Gaussian,
}

/// How the sum is taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Method {
    /// Over all pairs: exact to single precision; time grows with the product of the numbers.
    Direct,
    /// By expansions between cells of octrees, with a relative L2 error of the velocity at the vortons of at most about
    /// `error`, which is in [`ERRORS`]. Faster than [`Method::Direct`] from about 2000 vortons on.
    Tree {
        /// The relative L2 error wanted.
        error: f32,
    },
    /// By a Poisson equation on a lattice, with boundary values of the tree, to the same error, which is in
    /// [`grid_errors`]; the gradient's is up to twelve times that. Where a lattice would cost more than all pairs, as for
    /// fewer than some thousand vortons, or far from it, the tree serves.
    Grid {
        /// The relative L2 error wanted.
        error: f32,
    },
}

/// What to find.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// The vector potential.
    Potential,
    /// The velocity.
    Velocity,
    /// The velocity and its gradient, at about twice the time of the velocity.
    VelocityAndGradient,
}

/// Where to find it.
#[derive(Clone, Copy, Debug)]
pub enum Targets<'a> {
    /// At the vortons, each of which is part of the sum at its own place.
    Vortons,
    /// At points [m]: tracers, or the nodes of a grid.
    Points(&'a [Vec3]),
}

/// What vortons induce, in the order of the targets; what was not asked for is empty.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Induced {
    /// A [m²/s].
    pub potential: Vec<Vec3>,
    /// u [m/s].
    pub velocity: Vec<Vec3>,
    /// ∇u [1/s].
    pub gradient: Vec<Gradient>,
}

/// Finds what `vortons` induce at `targets`. The same bits for any number of threads.
///
/// # Errors
/// [`OutOfRange`] if a vorton or a point is outside what the sums can hold.
///
/// # Panics
/// If the columns of the vortons differ in length, or the error of [`Method::Tree`] is outside [`ERRORS`], or that of
/// [`Method::Grid`] outside [`grid_errors`].
pub fn induced(
    vortons: &Vortons,
    targets: Targets<'_>,
    quantity: Quantity,
    kernel: Kernel,
    method: Method,
) -> Result<Induced, OutOfRange> {
    check(vortons, targets, kernel, method)?;
    Ok(match kernel {
        Kernel::Ball => with_kernel::<Ball>(vortons, targets, quantity, method),
        Kernel::RosenheadMoore => with_kernel::<RosenheadMoore>(vortons, targets, quantity, method),
        Kernel::WinckelmansLeonard => with_kernel::<WinckelmansLeonard>(vortons, targets, quantity, method),
        Kernel::Gaussian => with_kernel::<Gaussian>(vortons, targets, quantity, method),
    })
}

/// As [`induced`], the velocity and its gradient at `targets`, and besides the velocity at `points` [m/s]. [`Method::Grid`] solves one
/// lattice for both; the others take as long as two calls.
///
/// # Errors
/// As [`induced`].
///
/// # Panics
/// As [`induced`].
pub fn induced_both(
    vortons: &Vortons,
    targets: Targets<'_>,
    points: &[Vec3],
    kernel: Kernel,
    method: Method,
) -> Result<(Induced, Vec<Vec3>), OutOfRange> {
    check(vortons, targets, kernel, method)?;
    vortons::check_points(points)?;
    Ok(match kernel {
        Kernel::Ball => both_with_kernel::<Ball>(vortons, targets, points, method),
        Kernel::RosenheadMoore => both_with_kernel::<RosenheadMoore>(vortons, targets, points, method),
        Kernel::WinckelmansLeonard => {
            both_with_kernel::<WinckelmansLeonard>(vortons, targets, points, method)
        }
        Kernel::Gaussian => both_with_kernel::<Gaussian>(vortons, targets, points, method),
    })
}

/// Whether the sums can hold all, and the method can be asked for its error.
fn check(vortons: &Vortons, targets: Targets<'_>, kernel: Kernel, method: Method) -> Result<(), OutOfRange> {
    vortons.check()?;
    if let Targets::Points(points) = targets {
        vortons::check_points(points)?;
    }
    if let Method::Grid { error } = method {
        grid::assert_error(kernel, error);
    }
    Ok(())
}

fn with_kernel<K: GridKernel>(
    vortons: &Vortons,
    targets: Targets<'_>,
    quantity: Quantity,
    method: Method,
) -> Induced {
    let vectors = |rows: Vec<[Vec3; 1]>| rows.into_iter().map(|[v]| v).collect();
    match quantity {
        Quantity::Potential => Induced {
            potential: vectors(rows::<K, POTENTIAL, 1>(vortons, targets, method)),
            ..Induced::default()
        },
        Quantity::Velocity => Induced {
            velocity: vectors(rows::<K, VELOCITY, 1>(vortons, targets, method)),
            ..Induced::default()
        },
        Quantity::VelocityAndGradient => with_gradient(rows::<K, GRADIENT, 4>(vortons, targets, method)),
    }
}

fn both_with_kernel<K: GridKernel>(
    vortons: &Vortons,
    targets: Targets<'_>,
    points: &[Vec3],
    method: Method,
) -> (Induced, Vec<Vec3>) {
    let (found, along) = match method {
        Method::Grid { error } if !points.is_empty() => grid::both::<K>(vortons, targets, points, error),
        _ => {
            let found = rows::<K, GRADIENT, 4>(vortons, targets, method);
            let along = match points {
                [] => Vec::new(),
                points => rows::<K, VELOCITY, 1>(vortons, Targets::Points(points), method),
            };
            (found, along)
        }
    };
    (with_gradient(found), along.into_iter().map(|[v]| v).collect())
}

/// The velocity, and the rows of its gradient.
fn with_gradient(rows: Vec<[Vec3; 4]>) -> Induced {
    let gradient = |row: &[Vec3; 4]| Gradient::from_rows(&[row[1], row[2], row[3]].map(|v| v.transpose()));
    Induced {
        potential: Vec::new(),
        velocity: rows.iter().map(|row| row[0]).collect(),
        gradient: rows.iter().map(gradient).collect(),
    }
}

/// The quantities as numbers that loops are compiled for: how often the kernel is differentiated.
const POTENTIAL: usize = 0;
const VELOCITY: usize = 1;
const GRADIENT: usize = 2;

/// The quantity `Q` as `N` vectors a target: A, u, or u and the rows of ∇u.
fn rows<K: GridKernel, const Q: usize, const N: usize>(
    vortons: &Vortons,
    targets: Targets<'_>,
    method: Method,
) -> Vec<[Vec3; N]> {
    match method {
        Method::Direct => direct::rows::<K, Q, N>(vortons, targets.positions(vortons)),
        Method::Tree { error } => {
            let error = coherence::eased(vortons, error);
            walk::rows::<K, Q, N>(vortons, targets, accuracy::setting(error))
        }
        Method::Grid { error } => grid::rows::<K, Q, N>(vortons, targets, error),
    }
}

impl<'a> Targets<'a> {
    fn positions(self, vortons: &'a Vortons) -> &'a [Vec3] {
        match self {
            Targets::Vortons => &vortons.position,
            Targets::Points(points) => points,
        }
    }
}
