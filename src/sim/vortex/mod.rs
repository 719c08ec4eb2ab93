//! The velocity that vortex particles (vortons) induce.
//!
//! This is the base of the vortex particle method: one evaluator of the vector potential, the velocity and
//! its gradient that a set of vortons induces, at the vortons themselves or at any points.
//!
//! *Method*: [gourlay19]'s sum of vector potentials over mollified vortons, as in [winckelmans93]. With d = x
//! − x_q, r = |d| and a kernel G (see [`Kernel`]):
//!
//! ```text
//! A(x) = (1/4π) Σ Γ_q G(r)      u(x) = ∇ × A = (1/4π) Σ K(r) Γ_q × d      K = −G′/r,  H = K′/r
//! ∂u_i/∂x_j = (1/4π) Σ [ H d_j (Γ × d)_i + K ε_ikj Γ_k ]
//! ```
//!
//! The sum is taken over all pairs ([`Method::Direct`]), with multipole expansions between the cells of
//! octrees ([`Method::Tree`], `traversal.rs`), or by a Poisson equation on a grid with boundary values of the
//! tree ([`Method::Grid`], `grid/`). The accuracy parameter of both is the error of the velocity. The grouping
//! rule and the multigrid of the paper serve for comparison ([`Method::Grouping`], [`Method::Multigrid`],
//! `gourlay/`).
//!
//! *Departs from the paper*: a vorton has a strength Γ = ω V and a core, not an angular velocity and a size.
//! The potential inside a core is that of the ball, because the curl of the paper's eq. 5 has the wrong sign.
//! Sums over cells are of strengths, about the centre of |Γ|. The kernel of each vorton is expanded, not that
//! of a point.
//!
//! *Symbols*: Γ → `strength` [m³/s], σ → `core` [m], A → `potential` [m²/s], u → `velocity` [m/s], ∇u →
//! `gradient` [1/s].
//!
//! *Limits*: single precision: about 1e-6 of the velocity. Coincident vortons of different cores, more than a
//! leaf holds, are summed pair by pair.

mod accuracy;
mod coherence;
mod direct;
mod expansion;
pub mod flow;
mod gourlay;
mod grid;
mod index;
mod invariants;
mod kernels;
mod moments;
mod octree;
mod pairs;
mod quantities;
mod reach;
mod sampled_error;
mod traversal;
mod vortons;

pub use accuracy::ERRORS;
pub(in crate::sim) use gourlay::grid::max_multigrid_bytes;
pub use gourlay::multigrid_poisson;
pub use grid::{UniformGrid, VectorField, boundary_values, choose_grid, grid_errors, poisson};
pub use invariants::{Invariants, invariants};
pub(in crate::sim) use pairs::columns;
pub use quantities::{Gradient, Induced, Kernel, Method, Quantity, Targets};
pub(crate) use reach::fraction_beyond_plane;
pub use sampled_error::sampled_error;
pub use vortons::{ElementKind, MAX_MAGNITUDE, MIN_CORE, OutOfRange, Vortons};

use crate::math::Vec3;
use grid::GridKernel;
use kernels::{Ball, Gaussian, RosenheadMoore, WinckelmansLeonard};
use quantities::{GRADIENT, POTENTIAL, VELOCITY};

/// Evaluates the quantity that `vortons` induce at `targets`. The result has the same bits for any number of
/// threads.
///
/// # Errors
/// [`OutOfRange`] if a vorton or a point is out of range.
///
/// # Panics
/// If the columns of the vortons differ in length, or the error of [`Method::Tree`] is outside [`ERRORS`], or
/// that of [`Method::Grid`] outside [`grid_errors`], or if [`Method::Multigrid`] is requested for another kernel than
/// [`Kernel::Gaussian`].
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

/// Evaluates the velocity and its gradient at `targets`, and the velocity at `points` [m/s], as [`induced`]
/// does. [`Method::Grid`] solves one grid for both; the other methods take as long as two calls.
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

/// Checks that vortons and points are in range, and that the method accepts its error.
fn check(vortons: &Vortons, targets: Targets<'_>, kernel: Kernel, method: Method) -> Result<(), OutOfRange> {
    vortons.check()?;
    if let Targets::Points(points) = targets {
        vortons::check_points(points)?;
    }
    match method {
        Method::Grid { error } => grid::assert_error(kernel, error),
        Method::Multigrid => assert_eq!(kernel, Kernel::Gaussian, "the kernel of multigrid"),
        Method::Direct | Method::Tree { .. } | Method::Grouping => {}
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
    let (found, at_points) = match method {
        Method::Grid { error } if !points.is_empty() => grid::both::<K>(vortons, targets, points, error),
        _ => {
            let found = rows::<K, GRADIENT, 4>(vortons, targets, method);
            let at_points = match points {
                [] => Vec::new(),
                points => rows::<K, VELOCITY, 1>(vortons, Targets::Points(points), method),
            };
            (found, at_points)
        }
    };
    (with_gradient(found), at_points.into_iter().map(|[v]| v).collect())
}

/// The velocity and its gradient from their rows.
fn with_gradient(rows: Vec<[Vec3; 4]>) -> Induced {
    let gradient = |row: &[Vec3; 4]| Gradient::from_rows(&[row[1], row[2], row[3]].map(|v| v.transpose()));
    Induced {
        potential: Vec::new(),
        velocity: rows.iter().map(|row| row[0]).collect(),
        gradient: rows.iter().map(gradient).collect(),
    }
}

/// The quantity `Q` as `N` vectors per target: A, u, or u and the rows of ∇u.
fn rows<K: GridKernel, const Q: usize, const N: usize>(
    vortons: &Vortons,
    targets: Targets<'_>,
    method: Method,
) -> Vec<[Vec3; N]> {
    match method {
        Method::Direct => direct::rows::<K, Q, N>(vortons, targets.positions(vortons)),
        Method::Tree { error } => {
            let error = coherence::eased(vortons, error);
            traversal::rows::<K, Q, N>(vortons, targets, accuracy::tree_settings(error))
        }
        Method::Grid { error } => grid::rows::<K, Q, N>(vortons, targets, error),
        Method::Grouping => gourlay::grouping::rows::<K, Q, N>(vortons, targets.positions(vortons)),
        Method::Multigrid => gourlay::grid::rows::<Q, N>(vortons, targets.positions(vortons)),
    }
}
