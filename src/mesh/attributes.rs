//! What the vertices of a surface carry: normals and values taken from the particles.
//!
//! *Method*: normals by the gradient of the signed distance that the surface was cut from, central differences at the grid
//! nodes and trilinear between them; values by a normalised kernel sum [shepard68],
//! A(x) = Σ w_j A_j / Σ w_j with w_j = (1 − (r_j/R)²)³.
//! *Departs from the paper*: the weight has compact support instead of growing towards the samples, so that a
//! single particle does not print through.
//!
//! Symbols: R → `radius` [m]; r_j → distance to particle j [m].
//! Limits: second order in the voxel away from the field's kinks.

use super::{Mesh, check::face_normals};
use crate::{
    grid::{BRICK, BRICK_NODES, SparseGrid, offset},
    math::Vec3,
    par,
    space::CellGrid,
};
use std::cell::Cell;

/// Nearer than this to a node, in voxels, a vertex is taken to lie on it: vertices lie on grid edges, and
/// the two coordinates across the edge are exact up to rounding only. Smaller reads nodes that have no weight.
const SNAP: f64 = 1e-4;

/// Unit outward normals at the vertices of `mesh` by the gradient of the signed distance `sdf`, positive outside,
/// and how many vertices had no usable gradient there (zero, not finite, or against all the faces around) and carry the area-weighted normal of
/// their faces instead. A vertex without any face of its own size gets +Z.
pub fn normals_from_distance(mesh: &Mesh, sdf: &SparseGrid) -> (Vec<Vec3>, usize) {
    let faces = face_normals(mesh);
    let chunks = par::map_chunks(mesh.positions.len(), par::CHUNK, |range| {
        let reader = Reader::new(sdf);
        let mut replaced = 0;
        let normals: Vec<Vec3> = range
            .map(|v| {
                let gradient = reader.gradient(mesh.positions[v]);
                gradient.try_normalize(0.0).filter(|n| usable(n) && n.dot(&faces[v]) > 0.0).unwrap_or_else(
                    || {
                        replaced += 1;
                        faces[v].try_normalize(0.0).filter(usable).unwrap_or_else(Vec3::z)
                    },
                )
            })
            .collect();
        (normals, replaced)
    });
    let mut normals = Vec::with_capacity(mesh.positions.len());
    let mut replaced = 0;
    for (part, count) in chunks {
        normals.extend(part);
        replaced += count;
    }
    (normals, replaced)
}

/// Whether a normal is finite and of unit length.
fn usable(normal: &Vec3) -> bool {
    (normal.norm_squared() - 1.0).abs() < 1e-3
}

/// Reads nodes of a grid; remembers the last brick, because neighbouring nodes mostly share it.
struct Reader<'a> {
    grid: &'a SparseGrid,
    last: Cell<([i32; 3], Option<usize>)>,
}

impl<'a> Reader<'a> {
    fn new(grid: &'a SparseGrid) -> Self {
        let none = [i32::MIN; 3];
        Self { grid, last: Cell::new((none, grid.bricks.find(none))) }
    }

    /// The number at a node, if it is there and finite.
    fn value(&self, node: [i32; 3]) -> Option<f32> {
        let coord = node.map(|i| i.div_euclid(BRICK as i32));
        if self.last.get().0 != coord {
            self.last.set((coord, self.grid.bricks.find(coord)));
        }
        let local = node.map(|i| i.rem_euclid(BRICK as i32) as usize);
        let value = self.grid.values[self.last.get().1? * BRICK_NODES + offset(local)];
        Some(value).filter(|value| value.is_finite())
    }

    /// The gradient at a node, in the grid's unit a voxel: central differences, one-sided at the rim.
    fn at_node(&self, node: [i32; 3]) -> Vec3 {
        Vec3::from_fn(|axis, _| {
            let beside = |step: i32| {
                let mut other = node;
                other[axis] += step;
                self.value(other)
            };
            match (beside(-1), beside(1)) {
                (Some(below), Some(above)) => 0.5 * (above - below),
                (Some(below), None) => self.value(node).map_or(0.0, |here| here - below),
                (None, Some(above)) => self.value(node).map_or(0.0, |here| above - here),
                (None, None) => 0.0,
            }
        })
    }

    /// The gradient at `x`, trilinear between the nodes' gradients.
    fn gradient(&self, x: Vec3) -> Vec3 {
        let mut node = [0; 3];
        let mut t = [0.0; 3];
        for axis in 0..3 {
            let at = f64::from(x[axis]) / f64::from(self.grid.voxel);
            let below = (at + SNAP).floor();
            node[axis] = below as i32;
            t[axis] = if at - below < SNAP { 0.0 } else { (at - below) as f32 };
        }
        let mut sum = Vec3::zeros();
        for corner in 0..8 {
            let mut weight = 1.0;
            let mut at = node;
            for axis in 0..3 {
                let upper = corner >> axis & 1;
                weight *= if upper == 1 { t[axis] } else { 1.0 - t[axis] };
                at[axis] = at[axis].saturating_add(upper);
            }
            if weight > 0.0 {
                sum += self.at_node(at) * weight;
            }
        }
        sum
    }
}

/// Values at `vertices` from the values of particles within `radius` [m], and how many vertices had no particle
/// that near and carry the value of the nearest one instead.
///
/// `particles` are finite. Without particles, and at vertices that are not finite, the value is zero, counted
/// as well.
///
/// # Panics
/// If there are not as many values as particles.
pub fn interpolate_vec3(
    vertices: &[Vec3],
    particles: &[Vec3],
    values: &[Vec3],
    radius: f32,
) -> (Vec<Vec3>, usize) {
    assert_eq!(particles.len(), values.len(), "one value a particle");
    let cells = CellGrid::new(particles, radius);
    let mut found = vec![None; vertices.len()];
    par::fill(&mut found, |v| shepard(&cells, particles, values, vertices[v], radius));
    let missing: Vec<usize> = (0..vertices.len()).filter(|&v| found[v].is_none()).collect();
    let nearest = nearest(&missing, vertices, particles, radius);
    for (&v, &j) in missing.iter().zip(&nearest) {
        found[v] = Some(j.map_or(Vec3::zeros(), |j| values[j as usize]));
    }
    (found.into_iter().map(|value| value.expect("every vertex has its value")).collect(), missing.len())
}

/// The weighted mean of the values around `x`; `None` if there is none.
fn shepard(cells: &CellGrid, particles: &[Vec3], values: &[Vec3], x: Vec3, radius: f32) -> Option<Vec3> {
    if !x.iter().all(|x| x.is_finite()) {
        return None;
    }
    let mut sum = Vec3::zeros();
    let mut weights = 0.0;
    cells.for_each_within(particles, x, radius, |j, r2| {
        let w = (1.0 - r2 / (radius * radius)).powi(3);
        sum += values[j] * w;
        weights += w;
    });
    (weights > f32::MIN_POSITIVE).then(|| sum / weights) // A(x), [shepard68]
}

/// The particle nearest to each of some vertices (the first of equals), in widening circles.
fn nearest(missing: &[usize], vertices: &[Vec3], particles: &[Vec3], radius: f32) -> Vec<Option<u32>> {
    let mut found = vec![None; missing.len()];
    let mut radius = radius;
    let finite = |v: usize| vertices[v].iter().all(|x| x.is_finite());
    while !particles.is_empty() && (0..missing.len()).any(|i| found[i].is_none() && finite(missing[i])) {
        radius *= 2.0;
        let cells = CellGrid::new(particles, radius);
        par::update(&mut found, |i, slot| {
            if slot.is_some() || !finite(missing[i]) {
                return;
            }
            let mut best: Option<(f32, u32)> = None;
            cells.for_each_within(particles, vertices[missing[i]], radius, |j, r2| {
                if best.is_none_or(|(least, first)| (r2, j as u32) < (least, first)) {
                    best = Some((r2, j as u32));
                }
            });
            // Circles wider than any number reach everything: the search ends.
            *slot = best.map(|(_, j)| j).or((!radius.is_finite()).then_some(0));
        });
    }
    found
}
