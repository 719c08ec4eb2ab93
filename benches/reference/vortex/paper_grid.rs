//! The grid of [gourlay19], for comparison: multigrid between shares and differences of low order.
//!
//! *Method*: [gourlay19], part 20: the vorticity of vortons on the nodes of a grid, ∇²A = −ω by multigrid
//! with boundary values by the integral, and the velocity as differences of A, gathered at the vortons.
//!
//! *Departs from the paper*: the cores are Gaussian, all of one size, and are spread over the nodes by a
//! convolution along each axis. Boundary values are those of the library's tree.

use super::multigrid;
use meniscus::{
    math::Vec3,
    par,
    sim::vortex::{Kernel, UniformGrid, VectorField, Vortons, boundary_values},
};

/// How vortons are shared out to nodes, and how differences are taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Scheme {
    /// Linear shares and differences of second order, as in the paper.
    Linear,
    /// [monaghan85]'s M₄′ and differences of sixth order.
    Smooth,
}

impl Scheme {
    /// The weights of the nodes −1, 0, 1, 2 of a point between nodes 0 and 1.
    fn shares(self, t: f32) -> [f32; 4] {
        if self == Self::Linear {
            return [0.0, 1.0 - t, t, 0.0];
        }
        let near = |t: f32| 1.0 + t * t * (1.5 * t - 2.5);
        let far = |t: f32| 0.5 * (2.0 - t) * (2.0 - t) * (1.0 - t);
        [far(1.0 + t), near(t), near(1.0 - t), far(2.0 - t)]
    }

    /// Weights of f₁ − f₋₁, f₂ − f₋₂ and f₃ − f₋₃, times the spacing.
    fn differences(self) -> [f32; 3] {
        if self == Self::Linear { [0.5, 0.0, 0.0] } else { [0.75, -0.15, 1.0 / 60.0] }
    }
}

/// Cells from the vortons to the boundary: M₄′ reaches two nodes, the differences three.
const MIN_MARGIN: usize = 5;

/// Cores from the vortons to the boundary. What a core spreads beyond it is lost.
const MARGIN_IN_CORES: f32 = 3.0;

/// The velocity of Gaussian vortons of one core at themselves [m/s], with so many spacings to a core.
///
/// # Panics
/// If there is no vorton, if cores differ, or if a vorton is out of range.
pub(crate) fn velocity(vortons: &Vortons, scheme: Scheme, spacings_per_core: f32) -> Vec<Vec3> {
    let core = vortons.core[0];
    assert!(vortons.core.iter().all(|&other| other == core), "the grid carries cores of one size");
    let grid = grid_around(&vortons.position, core / spacings_per_core, spacings_per_core);
    let mut field = VectorField::new(grid);
    deposit(&mut field, vortons, scheme);
    spread(&mut field, spacings_per_core);
    boundary_values(&mut field, vortons, Kernel::Gaussian, 1e-2).expect("the vortons are in range");
    multigrid::solve(&mut field);
    let velocity = curl(&field, scheme.differences());
    let mut out = vec![Vec3::zeros(); vortons.len()];
    par::fill(&mut out, |i| {
        let mut u = Vec3::zeros();
        for_each_share(&grid, vortons.position[i], scheme, |node, w| u += velocity.at(node) * w);
        u
    });
    out
}

/// The box around the vortons, with a number of cells that can be halved until twelve or fewer are left.
fn grid_around(points: &[Vec3], spacing: f32, spacings_per_core: f32) -> UniformGrid {
    let low = points.iter().fold(Vec3::repeat(f32::INFINITY), |a, b| a.inf(b));
    let high = points.iter().fold(Vec3::repeat(f32::NEG_INFINITY), |a, b| a.sup(b));
    let margin = MIN_MARGIN.max((MARGIN_IN_CORES * spacings_per_core).ceil() as usize);
    let cells: [usize; 3] = std::array::from_fn(|k| {
        let wanted = ((high[k] - low[k]) / spacing).ceil() as usize + 2 * margin;
        let halvings = (wanted as f32 / 12.0).log2().ceil().max(0.0) as u32;
        wanted.div_ceil(1 << halvings) << halvings
    });
    let half = Vec3::from_fn(|k, _| cells[k] as f32) * (0.5 * spacing);
    UniformGrid { low: (low + high) * 0.5 - half, spacing, cells }
}

/// Calls `f(node, weight)` for the 64 nodes around a point.
fn for_each_share(grid: &UniformGrid, x: Vec3, scheme: Scheme, mut f: impl FnMut([usize; 3], f32)) {
    let t = (x - grid.low) / grid.spacing;
    let first: [usize; 3] = std::array::from_fn(|k| t[k] as usize - 1);
    let weights: [[f32; 4]; 3] = std::array::from_fn(|k| scheme.shares(t[k].fract()));
    for n in 0..64 {
        let at = [n & 3, n >> 2 & 3, n >> 4];
        let weight = weights[0][at[0]] * weights[1][at[1]] * weights[2][at[2]];
        f(std::array::from_fn(|k| first[k] + at[k]), weight);
    }
}

/// Writes h² ω, that is Γ over the spacing, to the nodes around every vorton.
fn deposit(field: &mut VectorField, vortons: &Vortons, scheme: Scheme) {
    let grid = field.grid;
    for (&x, strength) in vortons.position.iter().zip(&vortons.strength) {
        for_each_share(&grid, x, scheme, |node, weight| {
            let place = grid.index(node);
            for (values, g) in field.values.iter_mut().zip(strength.iter()) {
                values[place] += weight * g / grid.spacing;
            }
        });
    }
}

/// Convolves with a Gaussian core of so many spacings along each axis.
fn spread(field: &mut VectorField, spacings_per_core: f32) {
    let grid = field.grid;
    let reach = (5.0 * spacings_per_core).ceil() as usize;
    let tap = |k: usize| (-0.5 * (k as f32 / spacings_per_core).powi(2)).exp();
    let sum = tap(0) + 2.0 * (1..=reach).map(tap).sum::<f32>();
    let taps: Vec<f32> = (0..=reach).map(|k| tap(k) / sum).collect();
    let plane = grid.plane();
    for values in &mut field.values {
        for axis in 0..3 {
            let source = values.clone();
            par::for_chunks(values, plane, |first, values| {
                for y in 0..=grid.cells[1] {
                    for x in 0..=grid.cells[0] {
                        let node = [x, y, first / plane];
                        let value = |at: usize| {
                            let mut node = node;
                            node[axis] = at;
                            source[grid.index(node)]
                        };
                        let mut sum = taps[0] * value(node[axis]);
                        for (k, tap) in taps.iter().enumerate().skip(1) {
                            sum += tap * if k <= node[axis] { value(node[axis] - k) } else { 0.0 };
                            let ahead = node[axis] + k;
                            sum += tap * if ahead <= grid.cells[axis] { value(ahead) } else { 0.0 };
                        }
                        values[grid.index([x, y, 0])] = sum;
                    }
                }
            });
        }
    }
}

/// ∇ × A; zero within three nodes of the boundary.
fn curl(field: &VectorField, differences: [f32; 3]) -> VectorField {
    let grid = field.grid;
    let strides = [1, grid.row(), grid.plane()];
    let slope = |place: usize, component: usize, axis: usize| -> f32 {
        let value = &field.values[component];
        let pair = |k: usize| value[place + k * strides[axis]] - value[place - k * strides[axis]];
        (1..=3).map(|k| differences[k - 1] * pair(k)).sum::<f32>() / grid.spacing
    };
    let mut out = VectorField::new(grid);
    for (k, values) in out.values.iter_mut().enumerate() {
        let (b, c) = ((k + 1) % 3, (k + 2) % 3);
        par::for_chunks(values, strides[2], |first, values| {
            let z = first / strides[2];
            if z < 3 || z + 3 > grid.cells[2] {
                return;
            }
            for y in 3..=grid.cells[1] - 3 {
                for x in 3..=grid.cells[0] - 3 {
                    let place = grid.index([x, y, z]);
                    values[place - first] = slope(place, c, b) - slope(place, b, c);
                }
            }
        });
    }
    out
}
