//! The normals of a surface.
//!
//! *Method*: the gradient of the signed distance that the surface was cut from, central differences at the grid nodes
//! and trilinear between them.
//!
//! Limits: second order in the voxel away from the field's kinks.

use super::{Mesh, check::face_normals};
use crate::{
    grid::{BRICK, BRICK_NODES, SparseGrid, offset},
    math::Vec3,
    par,
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

/// Unit outward normals at the vertices of `mesh` by the area-weighted normals of the faces around them; +Z where these
/// cancel.
pub fn normals_from_faces(mesh: &Mesh) -> Vec<Vec3> {
    let mut normals = face_normals(mesh);
    par::update(&mut normals, |_, n| {
        *n = n.try_normalize(0.0).filter(usable).unwrap_or_else(Vec3::z);
    });
    normals
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
