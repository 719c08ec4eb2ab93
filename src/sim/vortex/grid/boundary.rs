//! The potential on the boundary of a box: found on a coarse lattice, and interpolated between.
//!
//! *Method*: [gourlay19]'s integral boundary values. The potential is smooth where there is no vorticity, so every few cells a value
//! of the tree will do, and a product of two cubics through four of them is the rest.

use super::{
    lattice::{Field, Lattice, ROW},
    sine::others,
};
use crate::{math::Vec3, par};

/// Numbers on one face of a box; its axes are those that are left, in their order.
#[derive(Clone, Debug)]
pub(super) struct Plane {
    pub(super) cells: [usize; 2],
    /// Rows along the first axis, filled up to sixteens.
    pub(super) values: Vec<f32>,
}

impl Plane {
    pub(super) fn new(cells: [usize; 2]) -> Self {
        let row = (cells[0] + 1).next_multiple_of(ROW);
        Self { cells, values: vec![0.0; row * (cells[1] + 1)] }
    }

    #[inline(always)]
    pub(super) fn row(&self) -> usize {
        (self.cells[0] + 1).next_multiple_of(ROW)
    }

    #[inline(always)]
    pub(super) fn at(&self, i: usize, j: usize) -> f32 {
        self.values[j * self.row() + i]
    }

    #[inline(always)]
    pub(super) fn set(&mut self, i: usize, j: usize, value: f32) {
        let row = self.row();
        self.values[j * row + i] = value;
    }
}

/// The potential on the six faces.
#[derive(Clone, Debug)]
pub(super) struct Faces {
    /// By axis, side and component.
    pub(super) values: [[[Plane; 3]; 2]; 3],
}

/// How values between those of the coarse lattice are made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Between {
    /// By a cubic through four.
    Cubic,
    /// By the nearest.
    #[cfg(test)]
    Copied,
}

/// The coarse lattice along one axis of a face: where its nodes are, in cells, and for every node of the fine one the first
/// of its four and their weights.
struct Coarse {
    nodes: Vec<f32>,
    weights: Vec<(usize, [f32; 4])>,
}

impl Coarse {
    /// Every `step` cells, or a little closer so that ends meet; at least three intervals.
    fn new(cells: usize, step: usize, between: Between) -> Self {
        let intervals = cells.div_ceil(step).max(3);
        let ratio = cells as f32 / intervals as f32;
        let weight = |i: usize| {
            let t = i as f32 / ratio;
            let first = (t as usize).clamp(1, intervals - 2) - 1;
            let t = t - first as f32;
            let weights: [f32; 4] = match between {
                // Lagrange's.
                Between::Cubic => std::array::from_fn(|k| {
                    let factors = (0..4).filter(|&j| j != k);
                    factors.map(|j| (t - j as f32) / (k as f32 - j as f32)).product()
                }),
                #[cfg(test)]
                Between::Copied => std::array::from_fn(|k| f32::from(u8::from(t.round() == k as f32))),
            };
            (first, weights)
        };
        Self {
            nodes: (0..=intervals).map(|i| i as f32 * ratio).collect(),
            weights: (0..=cells).map(weight).collect(),
        }
    }
}

impl Faces {
    /// 0 everywhere.
    pub(super) fn zero(lattice: Lattice) -> Self {
        let plane = |axis: usize| Plane::new(others(axis).map(|k| lattice.cells[k]));
        Self { values: [0, 1, 2].map(|axis| [0, 1].map(|_| [0, 1, 2].map(|_| plane(axis)))) }
    }

    /// What a field has there.
    pub(super) fn read(field: &Field) -> Self {
        let mut faces = Self::zero(field.lattice);
        faces.for_each_node(field.lattice, |k, place, value| *value = field.values[k][place]);
        faces
    }

    /// Writes them to a field.
    pub(super) fn write(&self, field: &mut Field) {
        let lattice = field.lattice;
        let [nx, ny, nz] = lattice.cells;
        let row = lattice.row();
        for (k, values) in field.values.iter_mut().enumerate() {
            // Nodes that faces share are of the last of these.
            par::for_chunks(values, lattice.plane(), |first, plane| {
                let z = first / lattice.plane();
                for side in 0..2 {
                    let face = &self.values[0][side][k];
                    for y in 0..=ny {
                        plane[y * row + side * nx] = face.at(y, z);
                    }
                }
                for side in 0..2 {
                    let face = &self.values[1][side][k];
                    plane[side * ny * row..][..=nx].copy_from_slice(&face.values[z * face.row()..][..=nx]);
                }
                for side in (0..2).filter(|side| z == side * nz) {
                    let face = &self.values[2][side][k];
                    for (out, row) in plane.chunks_exact_mut(row).zip(face.values.chunks_exact(face.row())) {
                        out[..=nx].copy_from_slice(&row[..=nx]);
                    }
                }
            });
        }
    }

    fn for_each_node(&mut self, lattice: Lattice, mut f: impl FnMut(usize, usize, &mut f32)) {
        for axis in 0..3 {
            let [b, c] = others(axis);
            for side in 0..2 {
                for k in 0..3 {
                    let plane = &mut self.values[axis][side][k];
                    let row = plane.row();
                    for j in 0..=lattice.cells[c] {
                        for i in 0..=lattice.cells[b] {
                            let mut at = [side * lattice.cells[axis]; 3];
                            (at[b], at[c]) = (i, j);
                            f(k, lattice.place(at), &mut plane.values[j * row + i]);
                        }
                    }
                }
            }
        }
    }

    /// Asks `find` for the potential at points every `step` cells, and fills in between.
    pub(super) fn found(
        lattice: Lattice,
        step: usize,
        between: Between,
        find: impl FnOnce(&[Vec3]) -> Vec<Vec3>,
    ) -> Self {
        let coarse = lattice.cells.map(|cells| Coarse::new(cells, step, between));
        let mut points = Vec::new();
        for axis in 0..3 {
            let [b, c] = others(axis);
            for side in 0..2 {
                for &v in &coarse[c].nodes {
                    for &u in &coarse[b].nodes {
                        let mut t = Vec3::repeat((side * lattice.cells[axis]) as f32);
                        (t[b], t[c]) = (u, v);
                        points.push(lattice.low + t * lattice.spacing);
                    }
                }
            }
        }
        let potential = find(&points);
        // Where the nodes of every axis begin, and how many a side has.
        let count =
            [0, 1, 2].map(|axis| others(axis).map(|k| coarse[k].nodes.len()).iter().product::<usize>());
        let first = [0, 2 * count[0], 2 * (count[0] + count[1])];
        let mut planes = par::map(18, |n| {
            let (axis, side, k) = (n / 6, n / 3 % 2, n % 3);
            let [b, c] = others(axis);
            let (row, first) = (coarse[b].nodes.len(), first[axis] + side * count[axis]);
            let mut plane = Plane::new([b, c].map(|k| lattice.cells[k]));
            fill(&mut plane, &coarse[b], &coarse[c], |i, j| potential[first + j * row + i][k]);
            Some(plane)
        });
        let mut taken = |n: usize| planes[n].take().expect("one each");
        Self {
            values: [0, 1, 2]
                .map(|axis| [0, 1].map(|side| [0, 1, 2].map(|k| taken(6 * axis + 3 * side + k)))),
        }
    }
}

/// Fills a plane from the values of its coarse lattice, along the first axis and then along the second.
fn fill(plane: &mut Plane, along: &Coarse, across: &Coarse, value: impl Fn(usize, usize) -> f32) {
    let width = along.weights.len();
    let mut rows = vec![0.0; width * across.nodes.len()];
    for j in 0..across.nodes.len() {
        for (i, (first, weights)) in along.weights.iter().enumerate() {
            rows[j * width + i] = (0..4).map(|k| weights[k] * value(first + k, j)).sum();
        }
    }
    for (j, (first, weights)) in across.weights.iter().enumerate() {
        for i in 0..width {
            plane.set(i, j, (0..4).map(|k| weights[k] * rows[(first + k) * width + i]).sum());
        }
    }
}
