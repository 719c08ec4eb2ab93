//! The grid of [gourlay19]: the Poisson equation by multigrid, between linear weights and differences of second order.
//!
//! *Method*: [gourlay19], part 20: the vorticity of vortons on the nodes of a grid, ∇²A = −ω by full multigrid
//! with boundary values by the integral, the velocity as differences of A, and linear interpolation at the points.
//!
//! *Departs from the paper*: the cores are Gaussian and are spread over the nodes by a convolution along each axis.
//! Boundary values are those of the library's tree, which also serves points outside the grid.
//!
//! *Limits*: all vortons have the mean core. The error is about 1 % of the velocity of a ring and 5 to 16 % of that of
//! random strengths.

use super::multigrid;
use crate::{
    math::{Vec3, elementary::exp},
    par,
    sim::vortex::{
        UniformGrid, VectorField, Vortons, accuracy, boundary_values,
        grid::{MAX_NODES, bounds, mean_core},
        kernels::Gaussian,
        quantities::{GRADIENT, Kernel, POTENTIAL},
        traversal,
    },
};

/// Spacings of the grid in a core, as in the paper.
const SPACINGS_PER_CORE: f32 = 2.0;

/// Cells from the vortons to the boundary: five cores, beyond which a Gaussian core ends, and a node for each difference.
const MARGIN: usize = 12;

/// Nodes to each side of a vorton over which its core is spread: five cores.
const REACH: usize = 10;

/// Cells from the boundary within which a point is left to the tree: linear weights and two differences.
const MIN_DEPTH: usize = 3;

/// Nodes per vorton in a grid at most. A cloud of the default overlap that fills its box has (4/3)³, and the margins.
const NODES_PER_VORTON: usize = 256;

/// Nodes that a grid may have however few the vortons are.
const MIN_NODES: usize = 1 << 18;

/// The requested error of the tree on the boundary, and outside.
const TREE_ERROR: f32 = 1e-2;

/// The quantity `Q` that Gaussian vortons induce at `points`. The tree serves where the grid would be too large.
pub(in crate::sim::vortex) fn rows<const Q: usize, const N: usize>(
    vortons: &Vortons,
    points: &[Vec3],
) -> Vec<[Vec3; N]> {
    let mut out = vec![[Vec3::zeros(); N]; points.len()];
    if vortons.is_empty() {
        return out;
    }
    let core = mean_core(vortons);
    let grid = grid_around(&vortons.position, core / SPACINGS_PER_CORE, max_nodes(vortons.len()));
    if let Some(grid) = grid {
        let fields = solve::<Q>(vortons, core, grid);
        par::fill(&mut out, |i| interpolate(&fields, grid, points[i]));
    }
    let is_outside = |&i: &usize| grid.is_none_or(|grid| !grid.contains(points[i], MIN_DEPTH));
    let outside: Vec<usize> = (0..points.len()).filter(is_outside).collect();
    if !outside.is_empty() {
        let at: Vec<Vec3> = outside.iter().map(|&i| points[i]).collect();
        let tree = accuracy::tree_settings(TREE_ERROR);
        let targets = crate::sim::vortex::Targets::Points(&at);
        let found = traversal::rows::<Gaussian, Q, N>(vortons, targets, tree);
        outside.iter().zip(found).for_each(|(&i, row)| out[i] = row);
    }
    out
}

/// The fields of the rows of a quantity: A, or u, or u and the gradients of its components.
fn solve<const Q: usize>(vortons: &Vortons, core: f32, grid: UniformGrid) -> Vec<VectorField> {
    let even = Vortons { core: vec![core; vortons.len()], ..vortons.clone() };
    let mut potential = VectorField::new(grid);
    deposit(&mut potential, vortons);
    spread(&mut potential);
    boundary_values(&mut potential, &even, Kernel::Gaussian, TREE_ERROR).expect("the vortons were checked");
    multigrid::solve(&mut potential);
    if Q == POTENTIAL {
        return vec![potential];
    }
    let velocity = curl(&potential);
    drop(potential);
    let slopes = |i| differences(grid, |place, axis| difference(&velocity, place, i, axis));
    let gradients: Vec<VectorField> = if Q == GRADIENT { (0..3).map(slopes).collect() } else { Vec::new() };
    [velocity].into_iter().chain(gradients).collect()
}

/// Maximum number of nodes of a grid for so many vortons: in clouds of many gaps the tree takes a fraction of the memory and the time.
const fn max_nodes(vortons: usize) -> usize {
    let nodes = vortons.saturating_mul(NODES_PER_VORTON).saturating_add(MIN_NODES);
    if nodes < MAX_NODES { nodes } else { MAX_NODES }
}

/// Memory of the multigrid solve for so many vortons at most [bytes]: vectors of potential, velocity and its gradients at each node, and
/// of the coarser grids.
pub(in crate::sim) fn max_multigrid_bytes(vortons: usize) -> f64 {
    (max_nodes(vortons) * 6 * size_of::<Vec3>()) as f64
}

/// The box around the vortons, with a number of cells that can be halved until twelve or fewer are left; `None` if it has
/// too many nodes, or if the spacing is below the precision of coordinates.
fn grid_around(points: &[Vec3], spacing: f32, max_nodes: usize) -> Option<UniformGrid> {
    let (low, high) = bounds(points);
    let mut cells = [0; 3];
    for k in 0..3 {
        let wanted = ((high[k] - low[k]) / spacing).ceil() + (2 * MARGIN) as f32;
        if wanted > max_nodes as f32 {
            return None;
        }
        let mut halvings = 0;
        while (wanted as usize).div_ceil(1 << halvings) > 12 {
            halvings += 1;
        }
        cells[k] = (wanted as usize).div_ceil(1 << halvings) << halvings;
    }
    let half = Vec3::from_fn(|k, _| cells[k] as f32) * (0.5 * spacing);
    let grid = UniformGrid { low: (low + high) * 0.5 - half, spacing, cells };
    let coarse = low.amax().max(high.amax()) * f32::EPSILON > 0.01 * spacing;
    (!coarse && grid.nodes() <= max_nodes).then_some(grid)
}

/// Calls `f(index, weight)` for the eight nodes around a point inside.
fn for_each_weight(grid: &UniformGrid, x: Vec3, mut f: impl FnMut(usize, f32)) {
    let (first, t) = grid.cell(x);
    for n in 0..8 {
        let at: [usize; 3] = std::array::from_fn(|k| n >> k & 1);
        let weight: f32 = (0..3).map(|k| if at[k] == 1 { t[k] } else { 1.0 - t[k] }).product();
        f(grid.index(std::array::from_fn(|k| first[k] + at[k])), weight);
    }
}

/// The fields at a point; zero at one near the boundary or outside.
fn interpolate<const N: usize>(fields: &[VectorField], grid: UniformGrid, x: Vec3) -> [Vec3; N] {
    let mut row = [Vec3::zeros(); N];
    if grid.contains(x, MIN_DEPTH) {
        for_each_weight(&grid, x, |place, weight| {
            for (row, field) in row.iter_mut().zip(fields) {
                *row += Vec3::from_fn(|k, _| field.values[k][place]) * weight;
            }
        });
    }
    row
}

/// Writes h² ω, that is Γ over the spacing, to the nodes around every vorton.
fn deposit(field: &mut VectorField, vortons: &Vortons) {
    let grid = field.grid;
    for (&x, strength) in vortons.position.iter().zip(&vortons.strength) {
        for_each_weight(&grid, x, |place, weight| {
            for (values, g) in field.values.iter_mut().zip(strength.iter()) {
                values[place] += weight * g / grid.spacing;
            }
        });
    }
}

/// Convolves with a Gaussian core along each axis.
fn spread(field: &mut VectorField) {
    let grid = field.grid;
    let tap = |k: usize| exp(-0.5 * (k as f64 / f64::from(SPACINGS_PER_CORE)).powi(2)) as f32;
    let sum = tap(0) + 2.0 * (1..=REACH).map(tap).sum::<f32>();
    let taps: [f32; REACH + 1] = std::array::from_fn(|k| tap(k) / sum);
    let (plane, strides) = (grid.plane(), [1, grid.row(), grid.plane()]);
    for values in &mut field.values {
        for axis in 0..3 {
            let source = values.clone();
            par::for_chunks(values, plane, |first, values| {
                for y in 0..=grid.cells[1] {
                    for x in 0..=grid.cells[0] {
                        let node = [x, y, first / plane];
                        let (place, at) = (grid.index(node), node[axis]);
                        let mut sum = taps[0] * source[place];
                        for (k, tap) in taps.iter().enumerate().skip(1) {
                            sum += tap * if k <= at { source[place - k * strides[axis]] } else { 0.0 };
                            let inside = at + k <= grid.cells[axis];
                            sum += tap * if inside { source[place + k * strides[axis]] } else { 0.0 };
                        }
                        values[grid.index([x, y, 0])] = sum;
                    }
                }
            });
        }
    }
}

/// The difference of second order of a component along an axis, at a node inside.
fn difference(field: &VectorField, place: usize, component: usize, axis: usize) -> f32 {
    let stride = [1, field.grid.row(), field.grid.plane()][axis];
    let values = &field.values[component];
    (values[place + stride] - values[place - stride]) / (2.0 * field.grid.spacing)
}

/// ∇ × A; zero on the boundary.
fn curl(field: &VectorField) -> VectorField {
    differences(field.grid, |place, k| {
        let (b, c) = ((k + 1) % 3, (k + 2) % 3);
        difference(field, place, c, b) - difference(field, place, b, c)
    })
}

/// `f(place, component)` at every node inside.
fn differences(grid: UniformGrid, f: impl Fn(usize, usize) -> f32 + Sync) -> VectorField {
    let mut out = VectorField::new(grid);
    for (k, values) in out.values.iter_mut().enumerate() {
        par::for_chunks(values, grid.plane(), |first, values| {
            let z = first / grid.plane();
            if z == 0 || z == grid.cells[2] {
                return;
            }
            for y in 1..grid.cells[1] {
                let row = grid.index([0, y, z]);
                for place in row + 1..row + grid.cells[0] {
                    values[place - first] = f(place, k);
                }
            }
        });
    }
    out
}
