//! Marching cubes on sparse bricks.
//!
//! *Method* [lorensen87]: a vertex on every grid edge with one end inside, by linear interpolation; triangles by the
//! cases of `cases`.
//! *Departs from the paper*: the case table (see `cases`); vertices are shared by the edge they lie on, which its
//! lower node owns; a vertex stays [`MARGIN`] of an edge away from the nodes, so that no triangle has zero area.
//!
//! Four passes over the bricks, each brick alone: first the sides of its nodes, which tell the bricks that the surface
//! does not touch; then how many vertices and triangles it has, so that all of them have their places; then its vertices and, for
//! every node, which of its three edges are crossed; then its triangles. The last two follow each other through windows of
//! whole layers of bricks, so that what a brick knows of its edges is kept for a short time only. Brick order and node order decide
//! the numbering, so the mesh does not depend on threads or on bricks without surface. Every vertex is used: the
//! ends of its edge lie in one brick or in two that share a face, and so do all nodes of one of its four cells.
//!
//! Symbols: a, b → values at an edge's ends; t → place of the vertex on the edge [0..1].
//! Limits: second order in the voxel where the field is smooth; features thinner than a voxel may vanish. Fewer
//! than 2³² vertices.

use super::{
    Contour, Mesh, cases,
    sides::{Sides, Signs, around, bits, neighbour},
};
use crate::{
    grid::{BRICK, BRICK_NODES, SparseGrid, offset},
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

    // Give every vertex and triangle its place.
    let table = cases::Cases::derive();
    let (places, mut stats) = Places::of(grid, &signs, &table);
    let mut mesh = Mesh {
        positions: par::repeated(Vec3::zeros(), places.vertices()),
        triangles: par::repeated([0; 3], places.triangles()),
        ..Mesh::default()
    };

    // Find the vertices window by window; the window before has then all neighbours that its triangles need.
    let mut before = Window::default();
    for range in windows(grid) {
        let window = Window::cut(&contour, &signs, &places, range, &mut mesh.positions, &mut stats);
        before.join(&window, &places, &table, &mut mesh.triangles);
        before = window;
    }
    before.join(&Window::default(), &places, &table, &mut mesh.triangles);
    (mesh, stats)
}

/// Where the vertices and triangles of each brick end.
struct Places {
    vertices: Vec<usize>,
    triangles: Vec<usize>,
}

/// What a brick has of each.
#[derive(Default)]
struct Tally {
    vertices: usize,
    triangles: usize,
    cut_cells: usize,
}

impl Places {
    /// Counts them, and the cells that are cut off.
    ///
    /// # Panics
    /// If there are 2³² vertices or more.
    fn of(grid: &SparseGrid, signs: &[Signs], table: &cases::Cases) -> (Self, ContourStats) {
        let parts = par::map_chunks(signs.len(), TASK, |part| {
            let mut missing = Vec::new();
            let tallies: Vec<_> = part.map(|b| Tally::of(grid, signs, table, b, &mut missing)).collect();
            (tallies, missing)
        });
        let mut places =
            Self { vertices: Vec::with_capacity(signs.len()), triangles: Vec::with_capacity(signs.len()) };
        let (mut sum, mut missing) = (Tally::default(), Vec::new());
        for (tallies, some) in parts {
            missing.extend(some);
            for tally in tallies {
                sum.vertices += tally.vertices;
                sum.triangles += tally.triangles;
                sum.cut_cells += tally.cut_cells;
                places.vertices.push(sum.vertices);
                places.triangles.push(sum.triangles);
            }
        }
        assert!(u32::try_from(sum.vertices).is_ok(), "a surface has fewer than 2³² vertices");
        missing.sort_unstable();
        missing.dedup();
        sum.cut_cells += missing.into_iter().map(|coord| cut_below(grid, signs, coord)).sum::<usize>();
        (places, ContourStats { cut_cells: sum.cut_cells, ..ContourStats::default() })
    }

    fn vertices(&self) -> usize {
        self.vertices.last().copied().unwrap_or(0)
    }

    fn triangles(&self) -> usize {
        self.triangles.last().copied().unwrap_or(0)
    }
}

impl Tally {
    /// What brick `brick` has; adds to `missing` the lower neighbours that are not there and hold the lowest corners of cells
    /// that the surface may cross.
    fn of(
        grid: &SparseGrid,
        signs: &[Signs],
        table: &cases::Cases,
        brick: usize,
        missing: &mut Vec<[i32; 3]>,
    ) -> Self {
        let coord = grid.bricks.coords()[brick];
        let Some(sides) = Sides::crossed(grid, signs, brick) else { return Self::default() };
        let mut tally = Self::default();
        for z in 0..BRICK {
            for y in 0..BRICK {
                tally.vertices +=
                    sides.edges(y, z).map(|edges| edges.count_ones() as usize).iter().sum::<usize>();
                let (crossed, complete) = sides.cells(y, z);
                tally.cut_cells += (crossed & !complete).count_ones() as usize;
                for x in bits(crossed & complete) {
                    tally.triangles += table.of(sides.mask([x, y, z])).len();
                }
            }
        }
        // A cell whose lowest corner is in a lower neighbour has its other corners in this brick's lowest layers.
        let lowest = sides.crossed_layers();
        for side in (1..8).filter(|side| (0..3).all(|axis| side >> axis & 1 == 0 || lowest[axis])) {
            let below = std::array::from_fn(|axis| coord[axis] - (side >> axis & 1));
            if grid.bricks.find(below).is_none() {
                missing.push(below);
            }
        }
        tally
    }
}

/// How many cells the surface crosses whose lowest corner is in the missing brick at `coord`.
fn cut_below(grid: &SparseGrid, signs: &[Signs], coord: [i32; 3]) -> usize {
    let sides = Sides::of(signs, around(grid, coord));
    let rows = (0..BRICK * BRICK).map(|row| sides.cells(row % BRICK, row / BRICK));
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
}

impl Window {
    /// Writes the vertices of some bricks to their places in `positions`.
    fn cut(
        contour: &Contour,
        signs: &[Signs],
        places: &Places,
        range: Range<usize>,
        positions: &mut [Vec3],
        stats: &mut ContourStats,
    ) -> Self {
        let (part, ends) = part_of(&places.vertices, range.clone());
        let found = par::map_parts(&mut positions[part], &ends, TASK, |b, vertices| {
            cut(contour, signs, range.start + b, vertices)
        });
        let mut bricks = Vec::with_capacity(found.len());
        for (brick, [moved, unbounded]) in found {
            bricks.push(brick);
            stats.moved_vertices += moved;
            stats.unbounded_vertices += unbounded;
        }
        Self { range, bricks }
    }

    /// Joins the vertices to triangles and writes these to their places; `next` is the window after this one.
    fn join(&self, next: &Self, places: &Places, table: &cases::Cases, triangles: &mut [[u32; 3]]) {
        let (part, ends) = part_of(&places.triangles, self.range.clone());
        let at = |brick: usize| {
            let found = self.at(brick).or_else(|| next.at(brick))?;
            Some((found, start_of(&places.vertices, brick) as u32))
        };
        par::for_parts(&mut triangles[part], &ends, TASK, |b, triangles| {
            if self.bricks[b].is_some() {
                join(self.range.start + b, at, table, triangles);
            }
        });
    }

    /// A brick of this window that the surface crosses.
    fn at(&self, brick: usize) -> Option<&BrickCut> {
        self.range.contains(&brick).then(|| self.bricks[brick - self.range.start].as_deref())?
    }
}

/// Where the items of brick `brick` start, of which `ends` tells where those of each brick end.
fn start_of(ends: &[usize], brick: usize) -> usize {
    brick.checked_sub(1).map_or(0, |before| ends[before])
}

/// Where the items of some bricks are, and where in there those of each brick end.
fn part_of(ends: &[usize], bricks: Range<usize>) -> (Range<usize>, Vec<usize>) {
    let start = start_of(ends, bricks.start);
    let within: Vec<usize> = ends[bricks].iter().map(|end| end - start).collect();
    (start..start + within.last().copied().unwrap_or(0), within)
}

/// One brick that the surface crosses.
struct BrickCut {
    sides: Sides,
    /// For every node of the brick: 8 × (vertices on edges of earlier nodes) + (bits of its crossed edges).
    marks: [u16; BRICK_NODES],
}

/// Writes the vertices of brick `brick`; gives the brick, `None` if it and its upper neighbours are on one side, and how many
/// vertices were moved and were unbounded.
fn cut(
    contour: &Contour,
    signs: &[Signs],
    brick: usize,
    vertices: &mut [Vec3],
) -> (Option<Box<BrickCut>>, [usize; 2]) {
    let Contour { grid, level, .. } = *contour;
    let Some(sides) = Sides::crossed(grid, signs, brick) else { return (None, [0; 2]) };
    let mut found = Box::new(BrickCut { sides, marks: [0; BRICK_NODES] });
    let sides = &found.sides;
    let coord = grid.bricks.coords()[brick];
    let own = grid.brick(brick);
    let beyond = |node: [usize; 3]| {
        let brick = sides.around[neighbour(node)] as usize;
        grid.values[brick * BRICK_NODES + offset(node.map(|i| i % BRICK))]
    };

    // Put a vertex on every crossed edge that a node of this brick owns.
    let (mut stats, mut count) = ([0; 2], 0);
    for z in 0..BRICK {
        for y in 0..BRICK {
            let edges = sides.edges(y, z);
            for x in bits(edges[0] | edges[1] | edges[2]) {
                let edges_of_node: u16 = (0..3).map(|axis| (edges[axis] >> x & 1) << axis).sum();
                found.marks[offset([x, y, z])] = (count as u16) << 3 | edges_of_node;
                let node = std::array::from_fn(|d| coord[d] * BRICK as i32 + [x, y, z][d] as i32);
                for axis in bits(edges_of_node) {
                    let mut upper = [x, y, z];
                    upper[axis] += 1;
                    let above = if upper[axis] < BRICK { own[offset(upper)] } else { beyond(upper) };
                    let t = place(own[offset([x, y, z])], above, level, &mut stats);
                    vertices[count] = point(node, axis, t, grid.voxel);
                    count += 1;
                }
            }
        }
    }
    debug_assert_eq!(count, vertices.len(), "as many vertices as were counted");
    (Some(found), stats)
}

/// Where on an edge with the values `a` and `b` at its ends the surface of a level crosses it [0..1]; counts the vertices that
/// it moves and those that are unbounded.
fn place(a: f32, b: f32, level: f32, [moved, unbounded]: &mut [usize; 2]) -> f64 {
    if !(a.is_finite() && b.is_finite()) {
        *unbounded += 1;
        return 0.5;
    }
    let (a, b, level) = (f64::from(a), f64::from(b), f64::from(level));
    let t = (a - level) / (a - b);
    let kept = t.clamp(MARGIN, 1.0 - MARGIN);
    *moved += usize::from(kept != t);
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
    /// The number of the vertex on the edge that leaves the node at `place` along `axis`, from the brick's first.
    #[inline]
    fn vertex(&self, place: usize, axis: u8) -> u32 {
        let mark = self.marks[place];
        u32::from(mark >> 3) + (mark & ((1 << axis) - 1)).count_ones()
    }
}

/// Writes the triangles of the cells whose lowest corner is in brick `brick`; `at` gives bricks and the numbers of their first
/// vertices.
fn join<'a>(
    brick: usize,
    at: impl Fn(usize) -> Option<(&'a BrickCut, u32)>,
    table: &cases::Cases,
    triangles: &mut [[u32; 3]],
) {
    let (own, first) = at(brick).expect("a brick of its own window");
    let across = |cell: [usize; 3], edge: u8| {
        let (corner, axis) = cases::edge(edge);
        let node: [usize; 3] = std::array::from_fn(|d| cell[d] + usize::from(corner >> d & 1));
        let owner = own.sides.around[neighbour(node)];
        let (found, first) = at(owner as usize).expect("a crossed edge's owner has vertices");
        first + found.vertex(offset(node.map(|i| i % BRICK)), axis)
    };
    let mut to = triangles.iter_mut();
    for z in 0..BRICK {
        for y in 0..BRICK {
            let (crossed, complete) = own.sides.cells(y, z);
            for x in bits(crossed & complete) {
                let cell = [x, y, z];
                // Most cells have all their nodes in the brick itself.
                let is_inner = x.max(y).max(z) + 1 < BRICK;
                let place = offset(cell);
                for (triangle, to) in table.of(own.sides.mask(cell)).iter().zip(&mut to) {
                    *to = triangle.map(|edge| {
                        if is_inner {
                            first + own.vertex(place + EDGES[usize::from(edge)].0, EDGES[usize::from(edge)].1)
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
