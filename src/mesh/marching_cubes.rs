//! Marching cubes on sparse bricks.
//!
//! *Method* [lorensen87]: a vertex on every grid edge with one end inside, by linear interpolation; triangles by the
//! cases of `cases`.
//! *Departs from the paper*: the case table (see `cases`); vertices are shared by the edge they lie on, which its
//! lower node owns; a vertex stays [`MARGIN`] of an edge away from the nodes, so that no triangle has zero area.
//!
//! Three passes over the bricks, each brick alone: first the sides of its nodes, which tell the bricks that the surface
//! does not touch; then its vertices and, for every node, which of its three edges are crossed; then, with the vertices
//! numbered brick by brick, its triangles, written where they belong. The last two follow each other through windows of
//! whole layers of bricks, so that what a brick knows of its edges is kept for a short time only. Brick order and node order decide
//! the numbering, so the mesh does not depend on threads or on bricks without surface. Every vertex is used: the
//! ends of its edge lie in one brick or in two that share a face, and so do all nodes of one of its four cells.
//!
//! Symbols: a, b → values at an edge's ends; t → place of the vertex on the edge [0..1].
//! Limits: second order in the voxel where the field is smooth; features thinner than a voxel may vanish. Fewer
//! than 2³² vertices.

use super::{Contour, Mesh, cases};
use crate::{
    grid::{BRICK, BRICK_NODES, NodeMask, SparseGrid, mask_of, offset},
    math::Vec3,
    par,
};
use std::ops::Range;

/// How near a vertex may come to a grid node, as a part of the edge.
///
/// Smaller, and far from the origin (N voxels away, where positions are exact to N·2⁻²⁴ voxels) the triangles
/// around a node collapse: at 1/256 they keep their shape up to N = 8000. Larger, and the surface shows steps
/// where it passes close to nodes: 1/256 moves it by 0.4 % of a voxel at most.
pub const MARGIN: f64 = 1.0 / 256.0;

/// Bricks a task holds: enough work to be worth a task, few enough to share out a small surface.
const TASK: usize = 16;

/// Bricks whose vertices are kept at a time, but for whole layers: enough to share out, few beside the surface.
const WINDOW: usize = 4096;

/// Vertices that a brick has room for at first: a plane through it makes about as many.
const VERTICES: usize = 96;

/// No brick is there.
const MISSING: u32 = u32::MAX;

/// What [`marching_cubes`] had to do beside extracting.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct ContourStats {
    /// Vertices moved along their edge to stay [`MARGIN`] away from a node.
    pub moved_vertices: usize,
    /// Vertices put in the middle of their edge because an end is infinite or not a number.
    pub unbounded_vertices: usize,
    /// Cells left out although the surface crosses them, because the brick of any corner is missing: the mesh is
    /// open there.
    pub cut_cells: usize,
}

/// The surface of a contour as an indexed mesh that faces the outside, and what was special.
///
/// Cells with a node in a missing brick are left out; if the surface crosses none of them, the mesh is closed and
/// manifold. No normals, no attributes.
///
/// # Panics
/// If the surface has 2³² vertices or more.
pub fn marching_cubes<'a>(contour: impl Into<Contour<'a>>) -> (Mesh, ContourStats) {
    extract(contour.into())
}

fn extract(contour: Contour) -> (Mesh, ContourStats) {
    let grid = contour.grid;

    // Read the signs of every brick.
    let mut signs = vec![Signs::default(); grid.bricks.len()];
    par::for_chunks(&mut signs, TASK, |start, signs| {
        for (b, signs) in (start..).zip(signs) {
            *signs = Signs::of(&contour, b);
        }
    });

    // Find the vertices window by window; the window before has then all neighbours that its triangles need.
    let table = cases::Cases::derive();
    let mut mesh = Mesh::default();
    let mut stats = ContourStats::default();
    let mut before = Window::default();
    let mut missing = Vec::new();
    for range in windows(grid) {
        let mut window = Window::cut(&contour, &signs, &table, range, &mut mesh.positions, &mut stats);
        missing.append(&mut window.missing);
        before.join(&window, &table, &mut mesh.triangles);
        before = window;
    }
    before.join(&Window::default(), &table, &mut mesh.triangles);
    missing.sort_unstable();
    missing.dedup();
    stats.cut_cells += missing.into_iter().map(|coord| cut_below(grid, &signs, coord)).sum::<usize>();
    (mesh, stats)
}

/// How many cells the surface crosses whose lowest corner is in the missing brick at `coord`.
fn cut_below(grid: &SparseGrid, signs: &[Signs], coord: [i32; 3]) -> usize {
    let (inside, present) = rows(signs, &around(grid, coord));
    let rows = (0..BRICK * BRICK).map(|row| cells(&inside, &present, row % BRICK, row / BRICK));
    rows.map(|(crossed, _)| crossed.count_ones() as usize).sum()
}

/// The bricks in runs of whole layers along z of [`WINDOW`] bricks or more, so that a brick's neighbours are in its own run or
/// the next.
fn windows(grid: &SparseGrid) -> Vec<Range<usize>> {
    let mut windows = Vec::new();
    let (mut start, mut end) = (0, 0);
    for layer in grid.bricks.coords().chunk_by(|a, b| a[2] == b[2]) {
        end += layer.len();
        if end - start >= WINDOW {
            windows.push(start..end);
            start = end;
        }
    }
    windows.push(start..end);
    windows
}

/// A run of bricks.
#[derive(Default)]
struct Window {
    range: Range<usize>,
    bricks: Vec<Option<Box<BrickCut>>>,
    /// The number of the first vertex of each brick.
    first: Vec<u32>,
    /// Bricks that are not there and hold the lowest corners of cells that the surface may cross; some more than once.
    missing: Vec<[i32; 3]>,
}

impl Window {
    /// Finds the vertices of some bricks and numbers them, brick by brick.
    fn cut(
        contour: &Contour,
        signs: &[Signs],
        table: &cases::Cases,
        range: Range<usize>,
        positions: &mut Vec<Vec3>,
        stats: &mut ContourStats,
    ) -> Self {
        let parts = par::map_chunks(range.len(), TASK, |part| {
            part.map(|b| cut(contour, signs, table, range.start + b)).collect::<Vec<_>>()
        });
        let mut bricks: Vec<_> = parts.into_iter().flatten().collect();
        let mut first = Vec::with_capacity(bricks.len());
        let mut missing = Vec::new();
        for brick in &mut bricks {
            first.push(u32::try_from(positions.len()).expect("a surface has fewer than 2³² vertices"));
            if let Some(brick) = brick {
                positions.append(&mut std::mem::take(&mut brick.vertices));
                missing.append(&mut brick.missing);
                stats.moved_vertices += brick.stats.moved_vertices;
                stats.unbounded_vertices += brick.stats.unbounded_vertices;
                stats.cut_cells += brick.stats.cut_cells;
            }
        }
        assert!(u32::try_from(positions.len()).is_ok(), "a surface has fewer than 2³² vertices");
        Self { range, bricks, first, missing }
    }

    /// Joins the vertices to triangles; `next` is the window after this one.
    fn join(&self, next: &Self, table: &cases::Cases, triangles: &mut Vec<[u32; 3]>) {
        let mut count = 0;
        let count_up = |brick: &Option<Box<BrickCut>>| {
            count += brick.as_ref().map_or(0, |brick| brick.triangles);
            count
        };
        let ends: Vec<usize> = self.bricks.iter().map(count_up).collect();
        let old = triangles.len();
        triangles.resize(old + count, [0; 3]);
        par::for_parts(&mut triangles[old..], &ends, TASK, |b, triangles| {
            if let Some(brick) = &self.bricks[b] {
                join(brick, |owner| self.at(owner).or_else(|| next.at(owner)), table, triangles);
            }
        });
    }

    /// A brick of this window that the surface crosses, and the number of its first vertex.
    fn at(&self, brick: usize) -> Option<(&BrickCut, u32)> {
        let place = self.range.contains(&brick).then(|| brick - self.range.start)?;
        Some((self.bricks[place].as_ref()?, self.first[place]))
    }
}

/// The nodes of a brick that are inside.
#[derive(Clone, Copy, Default)]
struct Signs(NodeMask);

impl Signs {
    fn of(contour: &Contour, brick: usize) -> Self {
        Self(mask_of(contour.grid.brick(brick), |&value| contour.is_inside(value)))
    }

    /// The nodes of row y of layer z, bit x.
    fn row(&self, y: usize, z: usize) -> u16 {
        (self.0[z] >> (BRICK * y)) as u16 & 0xff
    }

    /// Whether all nodes are inside (`Some(true)`) or outside (`Some(false)`).
    fn side(&self) -> Option<bool> {
        let all = |word: u64| self.0.iter().all(|&other| other == word);
        if all(u64::MAX) { Some(true) } else { all(0).then_some(false) }
    }
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
    /// Lower neighbours that are not there, where the surface crosses the layers of nodes that face them.
    missing: Vec<[i32; 3]>,
    /// How many triangles its cells have.
    triangles: usize,
    stats: ContourStats,
}

/// The vertices of brick `brick`; `None` if it and its upper neighbours are on one side.
fn cut(contour: &Contour, signs: &[Signs], table: &cases::Cases, brick: usize) -> Option<Box<BrickCut>> {
    let Contour { grid, level, .. } = *contour;
    let coord = grid.bricks.coords()[brick];
    let around = around(grid, coord);
    let side = |brick: u32| signs[brick as usize].side();
    let own = side(brick as u32);
    if own.is_some() && around.iter().all(|&other| other == MISSING || side(other) == own) {
        return None;
    }
    let (inside, present) = rows(signs, &around);

    // Put a vertex on every crossed edge that a node of this brick owns.
    let mut found = Box::new(BrickCut {
        around,
        inside,
        present,
        marks: [0; BRICK_NODES],
        vertices: Vec::with_capacity(VERTICES),
        missing: Vec::new(),
        triangles: 0,
        stats: ContourStats::default(),
    });
    let own = grid.brick(brick);
    let beyond = |node: [usize; 3]| {
        let side = (0..3).map(|axis| (node[axis] / BRICK) << axis).sum::<usize>();
        grid.values[around[side] as usize * BRICK_NODES + offset(node.map(|i| i % BRICK))]
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
                let edges_of_node: u16 = (0..3).map(|axis| (edges[axis] >> x & 1) << axis).sum();
                found.marks[offset([x, y, z])] = (found.vertices.len() as u16) << 3 | edges_of_node;
                let node = std::array::from_fn(|d| coord[d] * BRICK as i32 + [x, y, z][d] as i32);
                for axis in bits(edges_of_node) {
                    let mut upper = [x, y, z];
                    upper[axis] += 1;
                    let above = if upper[axis] < BRICK { own[offset(upper)] } else { beyond(upper) };
                    let t = place(own[offset([x, y, z])], above, level, &mut found.stats);
                    found.vertices.push(point(node, axis, t, grid.voxel));
                }
            }
        }
    }

    found.count(table);
    // A cell whose lowest corner is in a lower neighbour has its other corners in this brick's lowest layers.
    let lowest = found.crossed_layers();
    for side in (1..8).filter(|side| (0..3).all(|axis| side >> axis & 1 == 0 || lowest[axis])) {
        let below = std::array::from_fn(|axis| coord[axis] - (side >> axis & 1));
        if grid.bricks.find(below).is_none() {
            found.missing.push(below);
        }
    }
    Some(found)
}

/// The brick at `coord` and its upper neighbours: bit 0 is set for the one along x, bit 1 for y, bit 2 for z.
fn around(grid: &SparseGrid, coord: [i32; 3]) -> [u32; 8] {
    let coords = grid.bricks.coords();
    let mut around = [MISSING; 8];
    for side in [0, 2, 4, 6] {
        let beside: [i32; 3] = std::array::from_fn(|axis| coord[axis] + (side >> axis & 1) as i32);
        let next = [beside[0] + 1, beside[1], beside[2]];
        let found = grid.bricks.find(beside);
        // Bricks stand in order of z, y, x: the next along x is the next one, if it is there.
        let after = match found {
            Some(found) => coords.get(found + 1).is_some_and(|&coord| coord == next).then_some(found + 1),
            None => grid.bricks.find(next),
        };
        around[side] = found.map_or(MISSING, |found| found as u32);
        around[side + 1] = after.map_or(MISSING, |found| found as u32);
    }
    around
}

/// Which of the 9³ nodes are inside, and which exist, in rows along x.
fn rows(signs: &[Signs], around: &[u32; 8]) -> ([u16; 81], [u16; 81]) {
    let (mut inside, mut present) = ([0; 81], [0; 81]);
    for z in 0..=BRICK {
        for y in 0..=BRICK {
            let side = (y / BRICK) << 1 | (z / BRICK) << 2;
            let row = |brick: u32| signs.get(brick as usize).map(|signs| signs.row(y % BRICK, z % BRICK));
            let (own, next) = (row(around[side]), row(around[side | 1]).map(|row| row & 1));
            inside[y + 9 * z] = own.unwrap_or(0) | next.unwrap_or(0) << BRICK;
            present[y + 9 * z] = own.map_or(0, |_| 0xff) | next.map_or(0, |_| 1) << BRICK;
        }
    }
    (inside, present)
}

/// Where on an edge with the values `a` and `b` at its ends the surface of a level crosses it [0..1].
fn place(a: f32, b: f32, level: f32, stats: &mut ContourStats) -> f64 {
    if !(a.is_finite() && b.is_finite()) {
        stats.unbounded_vertices += 1;
        return 0.5;
    }
    let (a, b, level) = (f64::from(a), f64::from(b), f64::from(level));
    let t = (a - level) / (a - b);
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

impl BrickCut {
    /// Counts its triangles, and the crossed cells that are cut off.
    fn count(&mut self, table: &cases::Cases) {
        for z in 0..BRICK {
            for y in 0..BRICK {
                let (crossed, complete) = self.cells(y, z);
                self.stats.cut_cells += (crossed & !complete).count_ones() as usize;
                for x in bits(crossed & complete) {
                    self.triangles += table.of(self.mask([x, y, z])).len();
                }
            }
        }
    }

    /// The cells of a row that have corners on both sides, and those that have all corners.
    #[inline]
    fn cells(&self, y: usize, z: usize) -> (u16, u16) {
        cells(&self.inside, &self.present, y, z)
    }

    /// Whether the lowest layers of nodes across x, y and z have nodes on both sides, those of the upper neighbours
    /// included.
    fn crossed_layers(&self) -> [bool; 3] {
        let crossed = |step: usize, count: usize, mask: u16| {
            let rows = || (0..count).map(|i| step * i);
            rows().any(|row| self.inside[row] & mask != 0)
                && rows().any(|row| self.present[row] & !self.inside[row] & mask != 0)
        };
        [crossed(1, 81, 1), crossed(9, 9, u16::MAX), crossed(1, 9, u16::MAX)]
    }

    /// The corners of a cell that are inside.
    #[inline]
    fn mask(&self, [x, y, z]: [usize; 3]) -> u8 {
        let corners = |i: usize, step: usize| (self.inside[y + 9 * z + step] >> x & 3) << (2 * i);
        (corners(0, 0) | corners(1, 1) | corners(2, 9) | corners(3, 10)) as u8
    }

    /// The number of the vertex on the edge that leaves the node at `place` along `axis`, from the brick's first.
    #[inline]
    fn vertex(&self, place: usize, axis: u8) -> u32 {
        let mark = self.marks[place];
        u32::from(mark >> 3) + (mark & ((1 << axis) - 1)).count_ones()
    }
}

/// The cells of a row that have corners on both sides, and those that have all corners.
#[inline]
fn cells(inside: &[u16; 81], present: &[u16; 81], y: usize, z: usize) -> (u16, u16) {
    let [mut any_inside, mut any_outside, mut all_present] = [0, 0, u16::MAX];
    for row in [0, 1, 9, 10].map(|step| y + 9 * z + step) {
        any_inside |= inside[row];
        any_outside |= present[row] & !inside[row];
        all_present &= present[row];
    }
    let crossed = (any_inside | any_inside >> 1) & (any_outside | any_outside >> 1) & 0xff;
    (crossed, all_present & all_present >> 1)
}

/// Writes the triangles of the cells whose lowest corner is in `brick`; `at` gives bricks and the numbers of their first
/// vertices.
fn join<'a>(
    brick: &BrickCut,
    at: impl Fn(usize) -> Option<(&'a BrickCut, u32)>,
    table: &cases::Cases,
    triangles: &mut [[u32; 3]],
) {
    let (_, own) = at(brick.around[0] as usize).expect("a brick of its own window");
    let across = |cell: [usize; 3], edge: u8| {
        let (corner, axis) = cases::edge(edge);
        let node: [usize; 3] = std::array::from_fn(|d| cell[d] + usize::from(corner >> d & 1));
        let side = (0..3).map(|d| (node[d] / BRICK) << d).sum::<usize>();
        let (found, first) = at(brick.around[side] as usize).expect("a crossed edge's owner has vertices");
        first + found.vertex(offset(node.map(|i| i % BRICK)), axis)
    };
    let mut to = triangles.iter_mut();
    for z in 0..BRICK {
        for y in 0..BRICK {
            let (crossed, complete) = brick.cells(y, z);
            for x in bits(crossed & complete) {
                let cell = [x, y, z];
                // Most cells have all their nodes in the brick itself.
                let is_inner = x.max(y).max(z) + 1 < BRICK;
                let place = offset(cell);
                for (triangle, to) in table.of(brick.mask(cell)).iter().zip(&mut to) {
                    *to = triangle.map(|edge| {
                        if is_inner {
                            own + brick.vertex(place + EDGES[usize::from(edge)].0, EDGES[usize::from(edge)].1)
                        } else {
                            across(cell, edge)
                        }
                    });
                }
            }
        }
    }
    debug_assert!(to.next().is_none(), "as many triangles as were counted");
}

/// Where the lower node of each edge of a cell stands from the cell's own, in a brick, and the edge's axis.
const EDGES: [(usize, u8); 12] = {
    let mut edges = [(0, 0); 12];
    let mut e = 0;
    while e < 12 {
        let (corner, axis) = cases::edge(e);
        let corner = corner as usize;
        edges[e as usize] = ((corner & 1) + BRICK * ((corner >> 1 & 1) + BRICK * (corner >> 2)), axis);
        e += 1;
    }
    edges
};

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
