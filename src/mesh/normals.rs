//! Normals of a surface.
//!
//! *Method*: the gradient of the field that the isosurface belongs to, by central differences at the grid
//! nodes and trilinear interpolation between them.
//!
//! Limits: second order in the voxel away from the field's kinks.

use super::{
    Contour, Mesh,
    check::{area_normal, face_normals},
};
use crate::{
    grid::{BRICK, SparseGrid, offset},
    math::Vec3,
    par,
};

/// A vertex nearer than this to a node, in voxels, counts as lying on it. Vertices lie on grid edges, and the
/// two coordinates across the edge are exact only up to rounding. If it is smaller, nodes without weight are
/// read.
const SNAP_DISTANCE: f64 = 1e-4;

/// Unit outward normals at the vertices of `mesh` by the gradient of its field, and how many vertices had no
/// usable gradient (zero, not finite, or opposed to the faces around). These have the area-weighted normal of
/// their faces instead, or +Z if that is zero. A vertex with a usable gradient and no face keeps it.
pub fn normals_from_field<'a>(mesh: &Mesh, contour: impl Into<Contour<'a>>) -> (Vec<Vec3>, usize) {
    Directions::of(&mesh.positions, &contour.into()).check_against_faces(mesh)
}

/// The normals by the field alone.
pub(super) struct Directions {
    /// Unit normals; zero where there is none.
    normals: Vec<Vec3>,
    /// The vertices without a normal.
    without: Vec<u32>,
}

impl Directions {
    /// The normals at `positions` [m].
    pub(super) fn of(positions: &[Vec3], contour: &Contour) -> Self {
        let mut normals = par::repeated(Vec3::zeros(), positions.len());
        let without = par::map_chunks_mut([&mut normals], par::CHUNK, |start, [normals]| {
            let mut reader = Reader::new(contour.grid);
            let mut without = Vec::new();
            for (v, normal) in (start..).zip(normals) {
                match reader.direction(contour, positions[v]) {
                    Some(direction) => *normal = direction,
                    None => without.push(v as u32),
                }
            }
            without
        });
        Self { normals, without: without.concat() }
    }

    /// Removes the vertices that are not `kept`.
    pub(super) fn retain(&mut self, kept: &[bool]) {
        let mut number = Vec::with_capacity(kept.len());
        let mut count = 0;
        for &is_kept in kept {
            number.push(count);
            count += u32::from(is_kept);
        }
        self.without.retain(|&v| kept[v as usize]);
        self.without.iter_mut().for_each(|v| *v = number[*v as usize]);
        let mut is_kept = kept.iter();
        self.normals.retain(|_| is_kept.next() == Some(&true));
    }

    /// The normals at the vertices of `mesh`, with those of the faces where the field's oppose them, and how
    /// many these are.
    pub(super) fn check_against_faces(self, mesh: &Mesh) -> (Vec<Vec3>, usize) {
        let Self { mut normals, without } = self;
        // A normal on the side of every single face is on the side of their sum; only others need the sum.
        let against = par::map_chunks(mesh.triangles.len(), par::CHUNK, |range| {
            let mut against = Vec::new();
            for triangle in &mesh.triangles[range] {
                let face = area_normal(mesh, triangle);
                against.extend(triangle.iter().filter(|&&v| !agrees_with(&normals[v as usize], &face)));
            }
            against.sort_unstable();
            against.dedup();
            against
        });
        let mut doubtful: Vec<u32> = against.into_iter().flatten().chain(without).collect();
        doubtful.sort_unstable();
        doubtful.dedup();
        let mut replaced = 0;
        for (&v, face) in doubtful.iter().zip(sums_at(mesh, &doubtful)) {
            let normal = &mut normals[v as usize];
            if !agrees_with(normal, &face) {
                *normal = unit(&face);
                replaced += 1;
            }
        }
        (normals, replaced)
    }
}

/// Area-weighted normals of the faces around some vertices, in ascending order; not normalised [m²].
fn sums_at(mesh: &Mesh, vertices: &[u32]) -> Vec<Vec3> {
    if vertices.is_empty() {
        return Vec::new();
    }
    let mut is_one = vec![false; mesh.positions.len()];
    vertices.iter().for_each(|&v| is_one[v as usize] = true);
    let around = par::map_chunks(mesh.triangles.len(), par::CHUNK, |range| {
        let faces = mesh.triangles[range].iter();
        faces.filter(|face| face.iter().any(|&v| is_one[v as usize])).collect::<Vec<_>>()
    });
    let mut sums = vec![Vec3::zeros(); vertices.len()];
    for triangle in around.into_iter().flatten() {
        let face = area_normal(mesh, triangle);
        for v in triangle {
            if let Ok(place) = vertices.binary_search(v) {
                sums[place] += face;
            }
        }
    }
    sums
}

/// The normals of some vertices that have faces, as by [`normals_from_field`], given the area-weighted
/// normals of the faces.
pub(super) fn some_from_field(mesh: &Mesh, contour: Contour, faces: &[Vec3], vertices: &[u32]) -> Vec<Vec3> {
    par::map_chunks(vertices.len(), par::CHUNK, |range| {
        let mut reader = Reader::new(contour.grid);
        let normal = |&v: &u32| {
            let (x, face) = (mesh.positions[v as usize], &faces[v as usize]);
            reader.direction(&contour, x).filter(|n| agrees_with(n, face)).unwrap_or_else(|| unit(face))
        };
        vertices[range].iter().map(normal).collect::<Vec<_>>()
    })
    .concat()
}

/// Unit outward normals at the vertices of `mesh` by the area-weighted normals of the faces around them; +Z
/// where these cancel.
pub fn normals_from_faces(mesh: &Mesh) -> Vec<Vec3> {
    let mut normals = face_normals(mesh);
    par::update(&mut normals, |_, n| *n = unit(n));
    normals
}

/// The unit vector of a normal; +Z if it is zero.
pub(super) fn unit(normal: &Vec3) -> Vec3 {
    try_unit(normal).unwrap_or_else(Vec3::z)
}

/// The unit vector of a normal; `None` if the normal is zero, not finite or too long to be normalized.
pub(crate) fn try_unit(normal: &Vec3) -> Option<Vec3> {
    normal.try_normalize(0.0).filter(is_usable)
}

/// Whether a normal is on the side of a face's normal; false for NaN.
fn agrees_with(normal: &Vec3, face: &Vec3) -> bool {
    normal.dot(face) > 0.0
}

/// Whether a normal is finite and of unit length.
fn is_usable(normal: &Vec3) -> bool {
    (normal.norm_squared() - 1.0).abs() < 1e-3
}

/// Nodes along an edge of a brick with its rim, one below and two above: all that gradients between its nodes
/// and the next need.
const WITH_RIM: usize = BRICK + 3;

/// Reads gradients of a grid. It keeps the last brick with its rim, because vertices mostly come brick by
/// brick.
struct Reader<'a> {
    grid: &'a SparseGrid,
    coord: [i32; 3],
    /// Nodes from −1 to 9 along each axis; NaN for missing or infinite ones.
    nodes: Box<[f32; WITH_RIM.pow(3)]>,
}

impl<'a> Reader<'a> {
    fn new(grid: &'a SparseGrid) -> Self {
        Self { grid, coord: [i32::MIN; 3], nodes: Box::new([f32::NAN; WITH_RIM.pow(3)]) }
    }

    /// Loads the brick at `coord`.
    fn visit(&mut self, coord: [i32; 3]) {
        if self.coord == coord {
            return;
        }
        self.coord = coord;
        let around: [Option<&[f32]>; 27] = std::array::from_fn(|i| {
            let step = [i % 3, i / 3 % 3, i / 9].map(|s| s as i32 - 1);
            let neighbour = std::array::from_fn(|axis| coord[axis].wrapping_add(step[axis]));
            self.grid.bricks.find(neighbour).map(|brick| self.grid.brick(brick))
        });
        // The brick of three that holds a node, and its index there.
        let within = |i: usize| {
            let from_first = i + BRICK - 1;
            (from_first / BRICK, from_first % BRICK)
        };
        for z in 0..WITH_RIM {
            for y in 0..WITH_RIM {
                let ((by, ly), (bz, lz)) = (within(y), within(z));
                let row = |bx: usize| {
                    around[bx + 3 * (by + 3 * bz)].map(|values| &values[offset([0, ly, lz])..][..BRICK])
                };
                let to = &mut self.nodes[WITH_RIM * (y + WITH_RIM * z)..][..WITH_RIM];
                to.fill(f32::NAN);
                if let Some(row) = row(0) {
                    to[0] = row[BRICK - 1];
                }
                if let Some(row) = row(1) {
                    to[1..=BRICK].copy_from_slice(row);
                }
                if let Some(row) = row(2) {
                    to[BRICK + 1..].copy_from_slice(&row[..WITH_RIM - BRICK - 1]);
                }
            }
        }
        // Infinite values become NaN.
        for value in self.nodes.iter_mut() {
            *value = if value.is_finite() { *value } else { f32::NAN };
        }
    }

    /// The gradient at a node 0..=8 of the loaded brick, in the grid's unit per voxel: central differences,
    /// one-sided at the rim.
    fn at_node(&self, node: [usize; 3]) -> Vec3 {
        let place = node[0] + 1 + WITH_RIM * (node[1] + 1 + WITH_RIM * (node[2] + 1));
        let here = self.nodes[place];
        Vec3::from_fn(|axis, _| {
            let step = WITH_RIM.pow(axis as u32);
            let (below, above) = (self.nodes[place - step], self.nodes[place + step]);
            let slope = match (below.is_nan(), above.is_nan()) {
                (false, false) => 0.5 * (above - below),
                (false, true) => here - below,
                (true, false) => above - here,
                (true, true) => 0.0,
            };
            if slope.is_nan() { 0.0 } else { slope }
        })
    }

    /// The unit normal of the contour at `x`, if there is a usable one.
    fn direction(&mut self, contour: &Contour, x: Vec3) -> Option<Vec3> {
        let gradient = self.gradient(x) * contour.outward();
        gradient.try_normalize(0.0).filter(is_usable)
    }

    /// The gradient at `x`, trilinear between the nodes' gradients.
    fn gradient(&mut self, x: Vec3) -> Vec3 {
        let mut node = [0; 3];
        let mut t = [0.0; 3];
        for axis in 0..3 {
            let at = f64::from(x[axis]) / f64::from(self.grid.voxel);
            // Positions are exact to their own digits.
            let snap = SNAP_DISTANCE.max(at.abs() * f64::from(f32::EPSILON)).min(0.5);
            let below = (at + snap).floor();
            node[axis] = below as i32;
            t[axis] = if at - below < snap { 0.0 } else { (at - below) as f32 };
        }
        self.visit(node.map(|i: i32| i.div_euclid(BRICK as i32)));
        let local = node.map(|i| i.rem_euclid(BRICK as i32) as usize);
        let mut sum = Vec3::zeros();
        for corner in 0..8 {
            let upper = [0, 1, 2].map(|axis| corner >> axis & 1);
            let weight: f32 =
                [0, 1, 2].map(|axis| if upper[axis] == 1 { t[axis] } else { 1.0 - t[axis] }).iter().product();
            if weight > 0.0 {
                sum += self.at_node([0, 1, 2].map(|axis| local[axis] + upper[axis])) * weight;
            }
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_normal_must_agree_with_the_sum_of_its_faces_but_not_with_each() {
        // Around vertex 0: two faces of area ½ that face upwards, and a small one that faces down.
        let corners = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.1, 0.0], [0.0, 0.1]];
        let positions = corners.map(|[x, y]| Vec3::new(x, y, 0.0)).to_vec();
        let triangles = vec![[0, 1, 2], [0, 2, 3], [0, 5, 4]];
        let mesh = Mesh { positions, triangles, ..Mesh::default() };
        let normals = |directions: [f32; 6], without: Vec<u32>| {
            let normals = directions.map(|z| Vec3::new(0.0, 0.0, z)).to_vec();
            let (normals, replaced) = Directions { normals, without }.check_against_faces(&mesh);
            (normals.iter().map(|n| n.z).collect::<Vec<_>>(), replaced)
        };
        let right = [1.0, 1.0, 1.0, 1.0, -1.0, -1.0];
        assert_eq!(normals(right, vec![]), (right.to_vec(), 0));
        assert_eq!(normals([-1.0, 1.0, 1.0, -1.0, -1.0, 1.0], vec![]), (right.to_vec(), 3));
        assert_eq!(normals([0.0, 1.0, 1.0, 1.0, 0.0, -1.0], vec![0, 4]), (right.to_vec(), 2));
    }
}
