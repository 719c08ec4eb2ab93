//! The potential on the boundary of a box: sampled at the nodes of a coarse grid, and interpolated between
//! them.
//!
//! *Method*: [gourlay19]'s integral boundary values. The potential is smooth where there is no vorticity. So
//! a value of the tree every few cells is enough, with a product of two cubics through four of them in
//! between.

use super::uniform::{ROW_MULTIPLE, UniformGrid, VectorField};
use crate::{math::Vec3, par};

/// A number at every node of one face of a box. The axes of the face are the other two, in ascending order.
#[derive(Clone, Debug)]
pub(super) struct FaceValues {
    pub(super) cells: [usize; 2],
    /// Rows along the first axis, padded like those of a grid.
    pub(super) values: Vec<f32>,
}

impl FaceValues {
    pub(super) fn new(cells: [usize; 2]) -> Self {
        let row = (cells[0] + 1).next_multiple_of(ROW_MULTIPLE);
        Self { cells, values: vec![0.0; row * (cells[1] + 1)] }
    }

    #[inline(always)]
    pub(super) fn row(&self) -> usize {
        (self.cells[0] + 1).next_multiple_of(ROW_MULTIPLE)
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
pub(super) struct BoundaryValues {
    /// By axis, side and component.
    pub(super) faces: [[[FaceValues; 3]; 2]; 3],
}

/// How values between the nodes of the coarse grid are found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Interpolation {
    /// By a cubic through four nodes.
    Cubic,
    /// By the nearest node.
    #[cfg(test)]
    Nearest,
}

/// The coarse grid along one axis of a face: the positions of its nodes, in cells, and for every node of the
/// fine grid the first of four coarse nodes and their weights.
struct CoarseAxis {
    nodes: Vec<f32>,
    weights: Vec<(usize, [f32; 4])>,
}

impl CoarseAxis {
    /// A node every `step` cells, or a little closer so that the last is on the edge; at least three
    /// intervals.
    fn new(cells: usize, step: usize, interpolation: Interpolation) -> Self {
        let intervals = cells.div_ceil(step).max(3);
        let ratio = cells as f32 / intervals as f32;
        let weight = |i: usize| {
            let t = i as f32 / ratio;
            let first = (t as usize).clamp(1, intervals - 2) - 1;
            let t = t - first as f32;
            let weights: [f32; 4] = match interpolation {
                // Lagrange polynomials.
                Interpolation::Cubic => std::array::from_fn(|k| {
                    let factors = (0..4).filter(|&j| j != k);
                    factors.map(|j| (t - j as f32) / (k as f32 - j as f32)).product()
                }),
                #[cfg(test)]
                Interpolation::Nearest => std::array::from_fn(|k| f32::from(u8::from(t.round() == k as f32))),
            };
            (first, weights)
        };
        Self {
            nodes: (0..=intervals).map(|i| i as f32 * ratio).collect(),
            weights: (0..=cells).map(weight).collect(),
        }
    }
}

impl BoundaryValues {
    /// 0 everywhere.
    pub(super) fn zero(grid: UniformGrid) -> Self {
        let face = |axis: usize| FaceValues::new(face_axes(axis).map(|k| grid.cells[k]));
        Self { faces: [0, 1, 2].map(|axis| [0, 1].map(|_| [0, 1, 2].map(|_| face(axis)))) }
    }

    /// The values of a field on its boundary.
    pub(super) fn read(field: &VectorField) -> Self {
        let mut boundary = Self::zero(field.grid);
        boundary.for_each_node(field.grid, |k, index, value| *value = field.values[k][index]);
        boundary
    }

    /// Writes the values to the boundary of a field.
    pub(super) fn write(&self, field: &mut VectorField) {
        let grid = field.grid;
        let [nx, ny, nz] = grid.cells;
        let row = grid.row();
        for (k, values) in field.values.iter_mut().enumerate() {
            // The last of these faces sets the nodes that faces share.
            par::for_chunks(values, grid.plane(), |first, plane| {
                let z = first / grid.plane();
                for side in 0..2 {
                    let face = &self.faces[0][side][k];
                    for y in 0..=ny {
                        plane[y * row + side * nx] = face.at(y, z);
                    }
                }
                for side in 0..2 {
                    let face = &self.faces[1][side][k];
                    plane[side * ny * row..][..=nx].copy_from_slice(&face.values[z * face.row()..][..=nx]);
                }
                for side in (0..2).filter(|side| z == side * nz) {
                    let face = &self.faces[2][side][k];
                    for (out, row) in plane.chunks_exact_mut(row).zip(face.values.chunks_exact(face.row())) {
                        out[..=nx].copy_from_slice(&row[..=nx]);
                    }
                }
            });
        }
    }

    fn for_each_node(&mut self, grid: UniformGrid, mut f: impl FnMut(usize, usize, &mut f32)) {
        for axis in 0..3 {
            let [b, c] = face_axes(axis);
            for side in 0..2 {
                for k in 0..3 {
                    let face = &mut self.faces[axis][side][k];
                    let row = face.row();
                    for j in 0..=grid.cells[c] {
                        for i in 0..=grid.cells[b] {
                            let mut at = [side * grid.cells[axis]; 3];
                            (at[b], at[c]) = (i, j);
                            f(k, grid.index(at), &mut face.values[j * row + i]);
                        }
                    }
                }
            }
        }
    }

    /// Samples the potential by `find` at points every `step` cells, and interpolates between them.
    pub(super) fn sampled(
        grid: UniformGrid,
        step: usize,
        interpolation: Interpolation,
        find: impl FnOnce(&[Vec3]) -> Vec<Vec3>,
    ) -> Self {
        let coarse = grid.cells.map(|cells| CoarseAxis::new(cells, step, interpolation));
        let mut points = Vec::new();
        for axis in 0..3 {
            let [b, c] = face_axes(axis);
            for side in 0..2 {
                for &v in &coarse[c].nodes {
                    for &u in &coarse[b].nodes {
                        let mut t = Vec3::repeat((side * grid.cells[axis]) as f32);
                        (t[b], t[c]) = (u, v);
                        points.push(grid.low + t * grid.spacing);
                    }
                }
            }
        }
        let potential = find(&points);
        // The samples per face of each axis, and the index of the first.
        let count =
            [0, 1, 2].map(|axis| face_axes(axis).map(|k| coarse[k].nodes.len()).iter().product::<usize>());
        let first = [0, 2 * count[0], 2 * (count[0] + count[1])];
        let mut faces = par::map(18, |n| {
            let (axis, side, k) = (n / 6, n / 3 % 2, n % 3);
            let [b, c] = face_axes(axis);
            let (row, first) = (coarse[b].nodes.len(), first[axis] + side * count[axis]);
            let mut face = FaceValues::new([b, c].map(|k| grid.cells[k]));
            fill(&mut face, &coarse[b], &coarse[c], |i, j| potential[first + j * row + i][k]);
            Some(face)
        });
        let mut taken = |n: usize| faces[n].take().expect("one each");
        Self {
            faces: [0, 1, 2].map(|axis| [0, 1].map(|side| [0, 1, 2].map(|k| taken(6 * axis + 3 * side + k)))),
        }
    }
}

/// Interpolates the values of the coarse grid to a face, along the first axis and then along the second.
fn fill(face: &mut FaceValues, along: &CoarseAxis, across: &CoarseAxis, value: impl Fn(usize, usize) -> f32) {
    let width = along.weights.len();
    let mut rows = vec![0.0; width * across.nodes.len()];
    for j in 0..across.nodes.len() {
        for (i, (first, weights)) in along.weights.iter().enumerate() {
            rows[j * width + i] = (0..4).map(|k| weights[k] * value(first + k, j)).sum();
        }
    }
    for (j, (first, weights)) in across.weights.iter().enumerate() {
        for i in 0..width {
            face.set(i, j, (0..4).map(|k| weights[k] * rows[(first + k) * width + i]).sum());
        }
    }
}

/// The axes of a face that is normal to `axis`.
pub(super) fn face_axes(axis: usize) -> [usize; 2] {
    [[1, 2], [0, 2], [0, 1]][axis]
}
