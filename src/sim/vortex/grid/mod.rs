//! Induced velocity by a Poisson equation on a grid: a vortex-in-cell method.
//!
//! *Method*: [gourlay19], announced there for part 20: the vector potential on a box, ∇²A = −ω, with boundary
//! values by the integral. Each vorton deposits its strength on the nodes around it (`weights.rs`). The
//! transform of the core is multiplied into that of the deposited strengths (`transforms.rs`). The equation
//! is solved by sine transforms (`sine.rs`) with boundary values that the tree finds at a few nodes
//! (`boundary.rs`). Finite differences give the velocity and its gradient (`differences.rs`), which are
//! interpolated at the points.
//!
//! *Effective core*: deposit and interpolation together smear like a core of about one spacing, which depends
//! on the position of a vorton between nodes. The transform of its mean over positions is known and divided
//! out. A core S of at least a spacing is multiplied in. So the grid represents the kernel of the vortons
//! itself, with S = σ where it can. Where cores differ, or are finer than the grid, pairs add the difference
//! (`near_correction.rs`). `plan.rs` chooses S and the spacing.
//!
//! *Departs from the paper*: the paper solves by multigrid, with linear weights and differences of second
//! order. Those are in `gourlay/`.
//!
//! *Limits*: the tree serves stray vortons, and points outside the box or within a few cells of its boundary.
//! Where a grid would cost more than all pairs, the tree serves all points.

mod boundary;
mod differences;
mod fourier;
mod near_correction;
mod plan;
mod sine;
#[cfg(test)]
mod tests;
mod transforms;
mod uniform;
mod weights;

pub(super) use plan::{MAX_NODES, bounds, mean_core};
pub(super) use transforms::GridKernel;
pub use uniform::{UniformGrid, VectorField};

use super::{
    Kernel, OutOfRange, Targets, Vortons, accuracy, coherence,
    kernels::{Ball, Gaussian, RadialKernel, RosenheadMoore, WinckelmansLeonard},
    quantities::{GRADIENT, POTENTIAL, VELOCITY},
    traversal,
};
use crate::{math::Vec3, par};
use boundary::{BoundaryValues, Interpolation};
use near_correction::NearCorrection;
use plan::{GridSettings, Plan};
use std::ops::RangeInclusive;
use transforms::TransformTable;

/// The relative L2 errors of the velocity at the vortons that [`Method::Grid`](super::Method::Grid) accepts.
/// A smaller one takes a grid that is too large, or is below what the kernel spreads beyond any box.
pub fn grid_errors(kernel: Kernel) -> RangeInclusive<f32> {
    if kernel == Kernel::RosenheadMoore { 3e-3..=0.1 } else { 1e-4..=0.1 }
}

/// Panics unless the error is one of [`grid_errors`].
pub(super) fn assert_error(kernel: Kernel, error: f32) {
    let errors = grid_errors(kernel);
    assert!(errors.contains(&error), "the grid with {kernel:?} accepts errors {errors:?}, not {error}");
}

/// The quantity `Q` that `vortons` induce at `targets`, by a grid for `error`.
pub(super) fn rows<K: GridKernel, const Q: usize, const N: usize>(
    vortons: &Vortons,
    targets: Targets<'_>,
    error: f32,
) -> Vec<[Vec3; N]> {
    let count = targets.positions(vortons).len();
    let settings = settings::<K>(vortons, error);
    match SolvedGrid::new::<K, Q>(vortons, count, settings) {
        Some(solved) => solved.rows::<K, Q, N>(targets),
        None => traversal::rows::<K, Q, N>(vortons, targets, accuracy::tree_settings(settings.error)),
    }
}

/// The velocity and its gradient at `targets`, and the velocity at `points`, from one solution.
pub(super) fn both<K: GridKernel>(
    vortons: &Vortons,
    targets: Targets<'_>,
    points: &[Vec3],
    error: f32,
) -> (Vec<[Vec3; 4]>, Vec<[Vec3; 1]>) {
    let count = targets.positions(vortons).len() + points.len();
    let points = Targets::Points(points);
    let settings = settings::<K>(vortons, error);
    match SolvedGrid::new::<K, GRADIENT>(vortons, count, settings) {
        Some(solved) => (solved.rows::<K, GRADIENT, 4>(targets), solved.rows::<K, VELOCITY, 1>(points)),
        None => {
            let tree = accuracy::tree_settings(settings.error);
            let found = traversal::rows::<K, GRADIENT, 4>(vortons, targets, tree);
            (found, traversal::rows::<K, VELOCITY, 1>(vortons, points, tree))
        }
    }
}

/// The settings with which the error of these vortons is at most `error`.
fn settings<K: GridKernel>(vortons: &Vortons, error: f32) -> GridSettings {
    GridSettings::new::<K>(error, coherence::eased(vortons, error))
}

/// A solved grid, from which the quantity can be interpolated at any point.
struct SolvedGrid<'a> {
    vortons: &'a Vortons,
    plan: Plan,
    settings: GridSettings,
    /// One field for each row of the quantity.
    fields: Vec<VectorField>,
    /// Cells from the boundary within which the grid does not serve points.
    margin: usize,
}

impl<'a> SolvedGrid<'a> {
    /// Solves for the quantity `Q` at `count` points; `None` where the tree serves.
    fn new<K: GridKernel, const Q: usize>(
        vortons: &'a Vortons,
        count: usize,
        settings: GridSettings,
    ) -> Option<Self> {
        let plan = Plan::new::<K>(vortons, count, Q, &settings)?;
        let potential = potential::<K>(&plan, &settings);
        let mut fields = Vec::new();
        if Q == POTENTIAL {
            fields.push(potential);
        } else {
            fields.push(differences::curl(&potential));
            if Q == GRADIENT {
                fields.extend(differences::gradient(&fields[0]));
            }
        }
        Some(Self { vortons, plan, settings, fields, margin: plan::margin(Q) })
    }

    /// The quantity `Q` at `targets`: the solved one or its first row.
    fn rows<K: GridKernel, const Q: usize, const N: usize>(&self, targets: Targets<'_>) -> Vec<[Vec3; N]> {
        let Self { vortons, plan, .. } = self;
        let points = targets.positions(vortons);
        let tree = accuracy::tree_settings(self.settings.error);
        let is_inside = |x: Vec3| plan.grid.contains(x, self.margin);
        // All points inside is the frequent case.
        let mut outside: Vec<usize> = par::map_chunks(points.len(), par::CHUNK, |part| {
            part.filter(|&i| !is_inside(points[i])).collect::<Vec<_>>()
        })
        .concat();
        if outside.is_empty() {
            return self.rows_inside::<K, Q, N>(points);
        }
        let mut out = vec![[Vec3::zeros(); N]; points.len()];
        let mut write = |chosen: &[usize], find: &dyn Fn(&[Vec3]) -> Vec<[Vec3; N]>| {
            let at: Vec<Vec3> = chosen.iter().map(|&i| points[i]).collect();
            for (&i, row) in chosen.iter().zip(find(&at)) {
                out[i] = row;
            }
        };
        // The tree serves points outside.
        write(&outside, &|at| traversal::rows::<K, Q, N>(vortons, Targets::Points(at), tree));
        outside.reverse();
        let inside: Vec<usize> =
            (0..points.len()).filter(|i| outside.pop_if(|outer| outer == i).is_none()).collect();
        write(&inside, &|at| self.rows_inside::<K, Q, N>(at));
        out
    }

    /// The quantity `Q` at points inside: the grid, the near correction where cores differ, and stray
    /// vortons.
    fn rows_inside<K: GridKernel, const Q: usize, const N: usize>(&self, points: &[Vec3]) -> Vec<[Vec3; N]> {
        let Self { plan, settings, .. } = self;
        let mut found = self.interpolated(points);
        if plan.needs_correction {
            NearCorrection::new::<K>(&plan.bulk, plan.grid_core, settings.near_error)
                .add::<K, Q, N>(points, &mut found);
        }
        if !plan.strays.is_empty() {
            let tree = accuracy::tree_settings(self.settings.error);
            let strays = traversal::rows::<K, Q, N>(&plan.strays, Targets::Points(points), tree);
            par::update(&mut found, |i, row| (0..N).for_each(|n| row[n] += strays[i][n]));
        }
        found
    }

    /// The solved fields, interpolated at points inside.
    fn interpolated<const N: usize>(&self, points: &[Vec3]) -> Vec<[Vec3; N]> {
        let grid = &self.plan.grid;
        let fields: &[VectorField; N] = self.fields[..N].try_into().expect("a field for every row");
        let planes = weights::by_plane(grid, points);
        let sorted = weights::interpolate(fields, points, &planes);
        let mut inverse = par::Inverse::default();
        inverse.rebuild(planes.all());
        let mut out = par::repeated([Vec3::zeros(); N], points.len());
        par::fill(&mut out, |i| sorted[inverse.of(i)]);
        out
    }
}

/// The grid on which [`Method::Grid`](super::Method::Grid) solves for the velocity at so many targets; `None`
/// where the tree serves.
///
/// # Panics
/// If the error is outside [`grid_errors`].
pub fn choose_grid(vortons: &Vortons, targets: usize, kernel: Kernel, error: f32) -> Option<UniformGrid> {
    assert_error(kernel, error);
    fn of<K: GridKernel>(vortons: &Vortons, targets: usize, error: f32) -> Option<UniformGrid> {
        let settings = settings::<K>(vortons, error);
        let plan = Plan::new::<K>(vortons, targets, VELOCITY, &settings);
        plan.map(|plan| plan.grid)
    }
    match kernel {
        Kernel::Ball => of::<Ball>(vortons, targets, error),
        Kernel::RosenheadMoore => of::<RosenheadMoore>(vortons, targets, error),
        Kernel::WinckelmansLeonard => of::<WinckelmansLeonard>(vortons, targets, error),
        Kernel::Gaussian => of::<Gaussian>(vortons, targets, error),
    }
}

/// The potential at the nodes.
fn potential<K: GridKernel>(plan: &Plan, settings: &GridSettings) -> VectorField {
    let Plan { grid, grid_core, bulk, .. } = plan;
    let even = Vortons {
        position: bulk.position.clone(),
        strength: bulk.strength.clone(),
        core: vec![*grid_core; bulk.len()],
    };
    let boundary = boundary_by_tree::<K::Smooth>(&even, *grid, settings);
    let mut field = VectorField::new(*grid);
    weights::deposit(&mut field, &bulk.position, &bulk.strength);

    // The transform of the core, divided by that of deposit and interpolation, times ω h² = ΣΓW/h.
    let core = TransformTable::new::<K::Smooth>();
    let divided = |i: usize| weights::transform(std::f64::consts::PI * i as f64 / ANGLES as f64).powi(-2);
    let deconvolution: Vec<f32> = (0..=ANGLES).map(|i| divided(i) as f32).collect();
    let deconvolved =
        |theta: f32| deconvolution[(theta * (ANGLES as f32 / std::f32::consts::PI) + 0.5) as usize];
    let (ratio, inverse) = (grid_core / grid.spacing, 1.0 / grid.spacing);
    let vorticity = |theta: [f32; 3], square: f32| {
        core.at(ratio * square.sqrt())
            * inverse
            * (deconvolved(theta[0]) * deconvolved(theta[1]) * deconvolved(theta[2]))
    };
    sine::solve(&mut field, &boundary, &|theta, _| {
        let square = theta[0] * theta[0] + theta[1] * theta[1] + theta[2] * theta[2];
        vorticity(theta, square) / square
    });
    field
}

/// The potential on the boundary of a grid, by the tree.
fn boundary_by_tree<K: RadialKernel>(
    vortons: &Vortons,
    grid: UniformGrid,
    settings: &GridSettings,
) -> BoundaryValues {
    BoundaryValues::sampled(grid, settings.boundary_step, Interpolation::Cubic, |points| {
        let tree = accuracy::tree_settings(settings.boundary_error);
        let rows = traversal::rows::<K, POTENTIAL, 1>(vortons, Targets::Points(points), tree);
        rows.into_iter().map(|[a]| a).collect()
    })
}

/// Writes the potential of vortons to the boundary of a field, as accurately as a grid for that `error` of
/// the velocity needs it: by the tree at every fourth node, and by cubic interpolation between.
///
/// # Errors
/// [`OutOfRange`] if a vorton is outside what the sums can hold.
///
/// # Panics
/// If the error is outside [`grid_errors`].
pub fn boundary_values(
    field: &mut VectorField,
    vortons: &Vortons,
    kernel: Kernel,
    error: f32,
) -> Result<(), OutOfRange> {
    vortons.check()?;
    assert_error(kernel, error);
    fn of<K: GridKernel>(vortons: &Vortons, grid: UniformGrid, error: f32) -> BoundaryValues {
        boundary_by_tree::<K>(vortons, grid, &GridSettings::new::<K>(error, error))
    }
    let boundary = match kernel {
        Kernel::Ball => of::<Ball>(vortons, field.grid, error),
        Kernel::RosenheadMoore => of::<RosenheadMoore>(vortons, field.grid, error),
        Kernel::WinckelmansLeonard => of::<WinckelmansLeonard>(vortons, field.grid, error),
        Kernel::Gaussian => of::<Gaussian>(vortons, field.grid, error),
    };
    boundary.write(field);
    Ok(())
}

/// Intervals of θ in 0..π in the table of the transform of deposit and interpolation.
const ANGLES: usize = 4096;

/// Solves ∇²A = −ω on a box to fourth order: `field` holds ω [1/s] inside and A [m²/s] on the boundary, and
/// then A everywhere. ω is assumed to be 0 on the boundary.
///
/// # Panics
/// If the number of cells along an axis is not 2ᵃ 3ᵇ 5ᶜ.
pub fn poisson(field: &mut VectorField) {
    let square = field.grid.spacing * field.grid.spacing;
    let boundary = BoundaryValues::read(field);
    sine::solve(field, &boundary, &|_, p| square * sine::greens_function(p));
}
