//! Marching cubes at zero on sparse bricks.
//!
//! *Method* [lorensen87]: a vertex on every grid edge whose ends differ in sign, by linear interpolation;
//! triangles by the cases of `cases`. A value of exactly zero is outside.
//! *Departs from the paper*: the case table (see `cases`); vertices are shared by the edge they lie on, which its
//! lower node owns; a vertex stays [`MARGIN`] of an edge away from the nodes, so that no triangle has zero area.
//!
//! Two passes over the bricks, each brick alone: first its vertices and, for every node, which of its three edges
//! are crossed; then, with the vertices numbered brick by brick, its triangles. Brick order and node order decide
//! the numbering, so the mesh does not depend on threads or on bricks without surface. Every vertex is used: the
//! ends of its edge lie in one brick or in two that share a face, and so do all nodes of one of its four cells.
//!
//! Symbols: a, b → values at an edge's ends [m]; t → place of the vertex on the edge [0..1].
//! Limits: second order in the voxel where the field is smooth; features thinner than a voxel may vanish. Fewer
//! than 2³² vertices.

use super::{Mesh, cases};
use crate::{
    grid::{BRICK, BRICK_NODES, SparseGrid, offset},
    math::Vec3,
    par,
};

/// How near a vertex may come to a grid node, as a part of the edge.
///
/// Smaller, and far from the origin (N voxels away, where positions are exact to N·2⁻²⁴ voxels) the triangles
/// around a node collapse: at 1/256 they keep their shape up to N = 8000. Larger, and the surface shows steps
/// where it passes close to nodes: 1/256 moves it by 0.4 % of a voxel at most.
pub const MARGIN: f64 = 1.0 / 256.0;

/// Bricks a task holds: enough work to be worth a task, few enough to share out a small surface.
const TASK: usize = 16;

/// No brick is there.
const MISSING: u32 = u32::MAX;

/// What [`marching_cubes`] had to do beside extracting.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct ContourStats {
    /// Vertices moved along their edge to stay [`MARGIN`] away from a node.
    pub moved_vertices: usize,
    /// Vertices put in the middle of their edge because an end is infinite or not a number.
    pub unbounded_vertices: usize,
    /// Cells left out although the surface crosses them, because a corner's brick is missing: the mesh is open
    /// there.
    pub cut_cells: usize,
}

/// The surface where `sdf` is zero, as an indexed mesh that faces the positive side, and what was special.
///
/// Values: inside negative, outside positive [m]. Cells with a node in a missing brick are left out; if the
/// surface crosses none of them, the mesh is closed and manifold. No normals, no attributes.
///
/// # Panics
/// If the surface has 2³² vertices or more.
pub fn marching_cubes(sdf: &SparseGrid) -> (Mesh, ContourStats) {
    // Find the vertices of every brick.
    let bricks: Vec<Option<Box<BrickCut>>> =
        par::map_chunks(sdf.bricks.len(), TASK, |range| range.map(|b| cut(sdf, b)).collect::<Vec<_>>())
            .into_iter()
            .flatten()
            .collect();

    // Number them, brick by brick.
    let mut first = Vec::with_capacity(bricks.len());
    let mut positions = Vec::with_capacity(bricks.iter().flatten().map(|brick| brick.vertices.len()).sum());
    let mut stats = ContourStats::default();
    for brick in &bricks {
        first.push(u32::try_from(positions.len()).expect("a surface has fewer than 2³² vertices"));
        if let Some(brick) = brick {
            positions.extend_from_slice(&brick.vertices);
            stats.moved_vertices += brick.stats.moved_vertices;
            stats.unbounded_vertices += brick.stats.unbounded_vertices;
        }
    }
    assert!(u32::try_from(positions.len()).is_ok(), "a surface has fewer than 2³² vertices");

    // Join them to triangles.
    let table = cases::Cases::derive();
    let parts = par::map_chunks(bricks.len(), TASK, |range| {
        let mut triangles = Vec::new();
        let mut cut_cells = 0;
        for brick in bricks[range].iter().flatten() {
            cut_cells += join(brick, &bricks, &first, &table, &mut triangles);
        }
        (triangles, cut_cells)
    });
    let mut triangles = Vec::with_capacity(parts.iter().map(|part| part.0.len()).sum());
    for (part, cut_cells) in parts {
        triangles.extend_from_slice(&part);
        stats.cut_cells += cut_cells;
    }
    (Mesh { positions, triangles, ..Mesh::default() }, stats)
}

/// One brick that the surface crosses, with the nodes of its upper neighbours that its cells touch.
struct BrickCut {
    /// This brick and its upper neighbours: bit 0 is set for the one along x, bit 1 for y, bit 2 for z.
    around: [u32; 8],
    /// Rows of nodes along x: bit x of row y + 9·z is set if node (x, y, z) is inside …
    inside: [u16; 81],
    /// … and if its brick exists.
    present: [u16; 81],
    /// For every node of the brick: 8 × (vertices on edges of earlier nodes) + (bits of its crossed edges).
    marks: [u16; BRICK_NODES],
    vertices: Vec<Vec3>,
    stats: ContourStats,
}

/// The vertices of brick `brick`; `None` if all its nodes are on one side.
fn cut(sdf: &SparseGrid, brick: usize) -> Option<Box<BrickCut>> {
    let coord = sdf.bricks.coords()[brick];
    let around: [u32; 8] = std::array::from_fn(|side| {
        let beside = std::array::from_fn(|axis| coord[axis] + (side >> axis & 1) as i32);
        if side == 0 { brick as u32 } else { sdf.bricks.find(beside).map_or(MISSING, |found| found as u32) }
    });

    // Read the signs of 9³ nodes.
    let (inside, present) = signs(sdf, &around);
    let outside = |row: usize| present[row] & !inside[row];
    if inside.iter().all(|&row| row == 0) || (0..81).all(|row| outside(row) == 0) {
        return None;
    }

    // Put a vertex on every crossed edge that a node of this brick owns.
    let mut found = Box::new(BrickCut {
        around,
        inside,
        present,
        marks: [0; BRICK_NODES],
        vertices: Vec::new(),
        stats: ContourStats::default(),
    });
    let value = |node: [usize; 3]| {
        let side = (0..3).map(|axis| (node[axis] / BRICK) << axis).sum::<usize>();
        sdf.values[around[side] as usize * BRICK_NODES + offset(node.map(|i| i % BRICK))]
    };
    for z in 0..BRICK {
        for y in 0..BRICK {
            let row = y + 9 * z;
            let crossed = |step: usize, shift: usize| {
                (inside[row] ^ (inside[row + step] >> shift))
                    & present[row]
                    & (present[row + step] >> shift)
                    & 0xff
            };
            let edges = [crossed(0, 1), crossed(1, 0), crossed(9, 0)];
            for x in bits(edges[0] | edges[1] | edges[2]) {
                let own: u16 = (0..3).map(|axis| (edges[axis] >> x & 1) << axis).sum();
                found.marks[offset([x, y, z])] = (found.vertices.len() as u16) << 3 | own;
                for axis in bits(own) {
                    let mut upper = [x, y, z];
                    upper[axis] += 1;
                    let t = place(value([x, y, z]), value(upper), &mut found.stats);
                    let node = std::array::from_fn(|d| coord[d] * BRICK as i32 + [x, y, z][d] as i32);
                    found.vertices.push(point(node, axis, t, sdf.voxel));
                }
            }
        }
    }
    Some(found)
}

/// Which of the 9³ nodes are inside, and which exist, in rows along x.
fn signs(sdf: &SparseGrid, around: &[u32; 8]) -> ([u16; 81], [u16; 81]) {
    let (mut inside, mut present) = ([0; 81], [0; 81]);
    for z in 0..=BRICK {
        for y in 0..=BRICK {
            for side_x in 0..2 {
                let brick = around[side_x | (y / BRICK) << 1 | (z / BRICK) << 2];
                if brick == MISSING {
                    continue;
                }
                let start = brick as usize * BRICK_NODES + offset([0, y % BRICK, z % BRICK]);
                let nodes = if side_x == 0 { BRICK } else { 1 };
                for (x, &value) in sdf.values[start..start + nodes].iter().enumerate() {
                    let bit = x + side_x * BRICK;
                    inside[y + 9 * z] |= u16::from(value < 0.0) << bit;
                    present[y + 9 * z] |= 1 << bit;
                }
            }
        }
    }
    (inside, present)
}

/// Where on an edge with the values `a` and `b` at its ends the surface crosses it [0..1].
fn place(a: f32, b: f32, stats: &mut ContourStats) -> f64 {
    if !(a.is_finite() && b.is_finite()) {
        stats.unbounded_vertices += 1;
        return 0.5;
    }
    let (a, b) = (f64::from(a), f64::from(b));
    let t = a / (a - b);
    let kept = t.clamp(MARGIN, 1.0 - MARGIN);
    stats.moved_vertices += usize::from(kept != t);
    kept
}

/// The point at `t` on the edge that leaves `node` along `axis` [m].
fn point(node: [i32; 3], axis: usize, t: f64, voxel: f32) -> Vec3 {
    Vec3::from_fn(|d, _| {
        let along = if d == axis { t } else { 0.0 };
        ((f64::from(node[d]) + along) * f64::from(voxel)) as f32
    })
}

/// Adds the triangles of the cells whose lowest corner is in `brick`; returns how many crossed cells are cut off.
fn join(
    brick: &BrickCut,
    bricks: &[Option<Box<BrickCut>>],
    first: &[u32],
    table: &cases::Cases,
    triangles: &mut Vec<[u32; 3]>,
) -> usize {
    let vertex = |cell: [usize; 3], edge: u8| {
        let (corner, axis) = cases::edge(edge);
        let node: [usize; 3] = std::array::from_fn(|d| cell[d] + usize::from(corner >> d & 1));
        let side = (0..3).map(|d| (node[d] / BRICK) << d).sum::<usize>();
        let owner = brick.around[side] as usize;
        let marks = &bricks[owner].as_ref().expect("a crossed edge's owner has vertices").marks;
        let mark = marks[offset(node.map(|i| i % BRICK))];
        let before = (mark & ((1 << axis) - 1)).count_ones();
        first[owner] + u32::from(mark >> 3) + before
    };
    let mut cut_cells = 0;
    for z in 0..BRICK {
        for y in 0..BRICK {
            // Cells of this row that have corners on both sides, and those of them with all corners there.
            let rows = [0, 1, 9, 10].map(|step| y + 9 * z + step);
            let [mut any_inside, mut any_outside, mut all_present] = [0, 0, u16::MAX];
            for row in rows {
                any_inside |= brick.inside[row];
                any_outside |= brick.present[row] & !brick.inside[row];
                all_present &= brick.present[row];
            }
            let crossed = (any_inside | any_inside >> 1) & (any_outside | any_outside >> 1) & 0xff;
            let complete = all_present & all_present >> 1;
            cut_cells += (crossed & !complete).count_ones() as usize;
            for x in bits(crossed & complete) {
                let mask: u16 = (0..4).map(|i| (brick.inside[rows[i]] >> x & 3) << (2 * i)).sum();
                for triangle in table.of(mask as u8) {
                    triangles.push(triangle.map(|edge| vertex([x, y, z], edge)));
                }
            }
        }
    }
    cut_cells
}

/// The places of the set bits, from the lowest.
#[inline]
fn bits(mut word: u16) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let place = word.trailing_zeros() as usize;
        let more = word != 0;
        word &= word.wrapping_sub(1);
        more.then_some(place)
    })
}
