//! The sum by way of a lattice: what the source text announces as its next step.
//!
//! *Method*: [gourlay19], part 20 as announced there: the vector potential on a box, ∇²A = −ω, with boundary values by the
//! integral. Strengths are shared out to the nodes of a lattice (`weights.rs`); what the sum over them lacks of a core is
//! multiplied into their transform (`spread.rs`), which is solved with boundary values of the tree on a coarse lattice
//! (`boundary.rs`) by sines (`sine.rs`); differences give the velocity and its gradient (`slopes.rs`), which points gather.
//!
//! *Which core*: shares and gathering together are a core of their own, of about one spacing, which depends on where a vorton
//! stands between nodes. Its mean over places is known as a transform, and divided out; a core S of at least a
//! spacing is multiplied in. So the lattice carries the vortons' own kernel, with S = σ where it can; where cores differ, or are
//! finer than the lattice, pairs add the difference (`near.rs`). `plan.rs` chooses S and the spacing.
//!
//! *Departs from the paper*: the paper solves by multigrid, with linear shares and differences of the second order. Those are
//! in `benches/reference/vortex/`.
//!
//! *Limits*: strays, and points outside the box or within a few cells of its boundary, are the tree's. Where a lattice would cost
//! more than all pairs, all is.

mod boundary;
mod fourier;
mod lattice;
mod near;
mod plan;
mod sine;
mod slopes;
mod spread;
#[cfg(test)]
mod tests;
mod weights;

pub use lattice::{Field, Lattice};
pub(super) use spread::Spread;

use super::{
    GRADIENT, Kernel, OutOfRange, POTENTIAL, Targets, Vortons, accuracy,
    chain::{Ball, Chain, Gaussian, RosenheadMoore, WinckelmansLeonard},
    coherence, walk,
};
use crate::{math::Vec3, par};
use boundary::{Between, Faces};
use near::Near;
use plan::{Plan, Setting};
use spread::Table;
use std::ops::RangeInclusive;

/// The relative L2 errors of the velocity at the vortons that [`Method::Grid`](super::Method::Grid) accepts. A smaller one
/// takes a grid that is too large, or is below what the kernel spreads beyond any box.
pub fn grid_errors(kernel: Kernel) -> RangeInclusive<f32> {
    if kernel == Kernel::RosenheadMoore { 3e-3..=0.1 } else { 1e-4..=0.1 }
}

/// Panics unless the error is one of [`grid_errors`].
pub(super) fn assert_error(kernel: Kernel, error: f32) {
    let errors = grid_errors(kernel);
    assert!(errors.contains(&error), "the grid with {kernel:?} accepts errors {errors:?}, not {error}");
}

/// What `vortons` induce at `targets`, by a lattice for `error`.
pub(super) fn rows<K: Spread, const Q: usize, const N: usize>(
    vortons: &Vortons,
    targets: Targets<'_>,
    error: f32,
) -> Vec<[Vec3; N]> {
    let count = targets.positions(vortons).len();
    let setting = setting::<K>(vortons, error);
    match Solved::new::<K, Q>(vortons, count, setting) {
        Some(solved) => solved.rows::<K, Q, N>(targets),
        None => walk::rows::<K, Q, N>(vortons, targets, accuracy::setting(setting.error)),
    }
}

/// The velocity and its gradient at `targets`, and the velocity at `points`, of one solution.
pub(super) fn both<K: Spread>(
    vortons: &Vortons,
    targets: Targets<'_>,
    points: &[Vec3],
    error: f32,
) -> (Vec<[Vec3; 4]>, Vec<[Vec3; 1]>) {
    let count = targets.positions(vortons).len() + points.len();
    let points = Targets::Points(points);
    let setting = setting::<K>(vortons, error);
    match Solved::new::<K, GRADIENT>(vortons, count, setting) {
        Some(solved) => {
            (solved.rows::<K, GRADIENT, 4>(targets), solved.rows::<K, { super::VELOCITY }, 1>(points))
        }
        None => {
            let tree = accuracy::setting(setting.error);
            let found = walk::rows::<K, GRADIENT, 4>(vortons, targets, tree);
            (found, walk::rows::<K, { super::VELOCITY }, 1>(vortons, points, tree))
        }
    }
}

/// The setting for these vortons to miss `error` at most.
fn setting<K: Spread>(vortons: &Vortons, error: f32) -> Setting {
    Setting::new::<K>(error, coherence::eased(vortons, error))
}

/// A lattice that is solved, from which any points can gather.
struct Solved<'a> {
    vortons: &'a Vortons,
    plan: Plan,
    setting: Setting,
    /// The quantity as rows, as many as it has.
    fields: Vec<Field>,
    /// Cells from the boundary at which points gather.
    margin: usize,
}

impl<'a> Solved<'a> {
    /// For the quantity `Q` at `count` points; `None` where the tree serves.
    fn new<K: Spread, const Q: usize>(vortons: &'a Vortons, count: usize, setting: Setting) -> Option<Self> {
        let plan = Plan::new::<K>(vortons, count, Q, &setting)?;
        let potential = potential::<K>(&plan, &setting);
        let mut fields = Vec::new();
        if Q == POTENTIAL {
            fields.push(potential);
        } else {
            fields.push(slopes::curl(&potential));
            if Q == GRADIENT {
                fields.extend(slopes::gradient(&fields[0]));
            }
        }
        Some(Self { vortons, plan, setting, fields, margin: plan::margin(Q) })
    }

    /// The quantity `Q`, the solved one or the first row of it, at `targets`.
    fn rows<K: Spread, const Q: usize, const N: usize>(&self, targets: Targets<'_>) -> Vec<[Vec3; N]> {
        let Self { vortons, plan, .. } = self;
        let points = targets.positions(vortons);
        let tree = accuracy::setting(self.setting.error);
        let is_inside = |x: Vec3| plan.lattice.holds(x, self.margin);
        // Most often all points are.
        let mut outside: Vec<usize> = par::map_chunks(points.len(), par::CHUNK, |part| {
            part.filter(|&i| !is_inside(points[i])).collect::<Vec<_>>()
        })
        .concat();
        if outside.is_empty() {
            return self.inside::<K, Q, N>(points);
        }
        let mut out = vec![[Vec3::zeros(); N]; points.len()];
        let mut write = |chosen: &[usize], find: &dyn Fn(&[Vec3]) -> Vec<[Vec3; N]>| {
            let at: Vec<Vec3> = chosen.iter().map(|&i| points[i]).collect();
            for (&i, row) in chosen.iter().zip(find(&at)) {
                out[i] = row;
            }
        };
        // Outside: the tree.
        write(&outside, &|at| walk::rows::<K, Q, N>(vortons, Targets::Points(at), tree));
        outside.reverse();
        let inside: Vec<usize> =
            (0..points.len()).filter(|i| outside.pop_if(|outer| outer == i).is_none()).collect();
        write(&inside, &|at| self.inside::<K, Q, N>(at));
        out
    }

    /// The same at points inside: the lattice, what cores differ near by, and the strays.
    fn inside<K: Spread, const Q: usize, const N: usize>(&self, points: &[Vec3]) -> Vec<[Vec3; N]> {
        let Self { plan, setting, .. } = self;
        let mut found = self.gathered(points);
        if plan.near {
            Near::new::<K>(&plan.inner, plan.smooth, setting.near).add::<K, Q, N>(points, &mut found);
        }
        if !plan.outer.is_empty() {
            let tree = accuracy::setting(self.setting.error);
            let strays = walk::rows::<K, Q, N>(&plan.outer, Targets::Points(points), tree);
            par::update(&mut found, |i, row| (0..N).for_each(|n| row[n] += strays[i][n]));
        }
        found
    }

    /// What the lattice gives at points inside it.
    fn gathered<const N: usize>(&self, points: &[Vec3]) -> Vec<[Vec3; N]> {
        let lattice = &self.plan.lattice;
        let fields: &[Field; N] = self.fields[..N].try_into().expect("a field for every row");
        let planes = weights::by_plane(lattice, points);
        let sorted = weights::gather(fields, points, &planes);
        let mut inverse = par::Inverse::default();
        inverse.rebuild(planes.all());
        let mut out = par::repeated([Vec3::zeros(); N], points.len());
        par::fill(&mut out, |i| sorted[inverse.of(i)]);
        out
    }
}

/// The lattice that [`Method::Grid`](super::Method::Grid) would take for the velocity at so many targets; `None` where the tree
/// serves.
///
/// # Panics
/// If the error is outside [`grid_errors`].
pub fn lattice(vortons: &Vortons, targets: usize, kernel: Kernel, error: f32) -> Option<Lattice> {
    assert_error(kernel, error);
    fn of<K: Spread>(vortons: &Vortons, targets: usize, error: f32) -> Option<Lattice> {
        let setting = setting::<K>(vortons, error);
        let plan = Plan::new::<K>(vortons, targets, super::VELOCITY, &setting);
        plan.map(|plan| plan.lattice)
    }
    match kernel {
        Kernel::Ball => of::<Ball>(vortons, targets, error),
        Kernel::RosenheadMoore => of::<RosenheadMoore>(vortons, targets, error),
        Kernel::WinckelmansLeonard => of::<WinckelmansLeonard>(vortons, targets, error),
        Kernel::Gaussian => of::<Gaussian>(vortons, targets, error),
    }
}

/// The potential at the nodes.
fn potential<K: Spread>(plan: &Plan, setting: &Setting) -> Field {
    let Plan { lattice, smooth, inner, .. } = plan;
    let even = Vortons {
        position: inner.position.clone(),
        strength: inner.strength.clone(),
        core: vec![*smooth; inner.len()],
    };
    let faces = faces::<K::Smooth>(&even, *lattice, setting);
    let mut field = Field::new(*lattice);
    weights::deposit(&mut field, &inner.position, &inner.strength);

    // The transform of the core, over that of shares and gathering, and of ω h² = ΣΓW/h.
    let core = Table::new::<K::Smooth>();
    let divided = |i: usize| weights::transform(std::f64::consts::PI * i as f64 / SHARES as f64).powi(-2);
    let shares: Vec<f32> = (0..=SHARES).map(|i| divided(i) as f32).collect();
    let shared = |theta: f32| shares[(theta * (SHARES as f32 / std::f32::consts::PI) + 0.5) as usize];
    let (ratio, inverse) = (smooth / lattice.spacing, 1.0 / lattice.spacing);
    let spread = |theta: [f32; 3], square: f32| {
        core.at(ratio * square.sqrt()) * inverse * (shared(theta[0]) * shared(theta[1]) * shared(theta[2]))
    };
    sine::solve(&mut field, &faces, &|theta, _| {
        let square = theta[0] * theta[0] + theta[1] * theta[1] + theta[2] * theta[2];
        spread(theta, square) / square
    });
    field
}

/// The potential on the boundary of a lattice, by the tree.
fn faces<K: Chain>(vortons: &Vortons, lattice: Lattice, setting: &Setting) -> Faces {
    Faces::found(lattice, setting.step, Between::Cubic, |points| {
        let tree = accuracy::setting(setting.boundary);
        let rows = walk::rows::<K, POTENTIAL, 1>(vortons, Targets::Points(points), tree);
        rows.into_iter().map(|[a]| a).collect()
    })
}

/// Writes the potential of vortons to the boundary of a field, as a lattice for that `error` of the velocity needs it: by the
/// tree at every fourth node, and by cubics between.
///
/// # Errors
/// [`OutOfRange`] if a vorton is outside what the sums can hold.
///
/// # Panics
/// If the error is outside [`grid_errors`].
pub fn boundary_values(
    field: &mut Field,
    vortons: &Vortons,
    kernel: Kernel,
    error: f32,
) -> Result<(), OutOfRange> {
    vortons.check()?;
    assert_error(kernel, error);
    fn of<K: Spread>(vortons: &Vortons, lattice: Lattice, error: f32) -> Faces {
        faces::<K>(vortons, lattice, &Setting::new::<K>(error, error))
    }
    let faces = match kernel {
        Kernel::Ball => of::<Ball>(vortons, field.lattice, error),
        Kernel::RosenheadMoore => of::<RosenheadMoore>(vortons, field.lattice, error),
        Kernel::WinckelmansLeonard => of::<WinckelmansLeonard>(vortons, field.lattice, error),
        Kernel::Gaussian => of::<Gaussian>(vortons, field.lattice, error),
    };
    faces.write(field);
    Ok(())
}

/// Entries of the table of shares' transforms.
const SHARES: usize = 4096;

/// Solves ∇²A = −ω on a box to fourth order: `field` holds ω [1/s] inside and A [m²/s] on the boundary, and then A
/// everywhere. ω is taken for 0 on the boundary.
///
/// # Panics
/// If the number of cells along an axis is not 2ᵃ 3ᵇ 5ᶜ.
pub fn poisson(field: &mut Field) {
    let square = field.lattice.spacing * field.lattice.spacing;
    let faces = Faces::read(field);
    sine::solve(field, &faces, &|_, p| square * sine::quotient(p));
}
