//! Marching cubes on sparse bricks.
//!
//! *Method* [lorensen87]: a vertex on every grid edge with one end inside, by linear interpolation; triangles by the
//! cases of `cases`.
//! *Departs from the paper*: the case table (see `cases`); vertices are shared by the edge they lie on, which its
//! lower node owns; a vertex stays [`MARGIN`] of an edge away from the nodes, so that no triangle has zero area.
//!
//! Four passes over the bricks, each brick alone: first the sides of its nodes, which tell the bricks that the surface
//! does not touch; then how many vertices and triangles it has, so that all of them have their places; then its vertices; then
//! its triangles, of which the sides alone tell, so that nothing needs the values any more. Triangles are joined in windows of
//! whole layers of bricks: what a brick knows of its edges is kept for a short time only. Brick order and node order decide
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
    grid::{BRICK, BRICK_NODES, Bricks, offset},
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
    let contour = contour.into();
    let cut = Cut::new(&contour);
    let (positions, stats) = cut.vertices(&contour);
    let triangles = cut.triangles(&contour.grid.bricks);
    (Mesh { positions, triangles, ..Mesh::default() }, stats)
}

/// All of a surface but where exactly its vertices are.
pub(super) struct Cut {
    signs: Vec<Signs>,
    places: Places,
    cut_cells: usize,
    table: cases::Cases,
}

impl Cut {
    /// Counts the vertices and triangles of a contour.
    ///
    /// # Panics
    /// If the surface has 2³² vertices or more.
    pub(super) fn new(contour: &Contour) -> Self {
        let bricks = &contour.grid.bricks;
        let mut signs = vec![Signs::default(); bricks.len()];
        par::for_chunks(&mut signs, TASK, |start, signs| {
            for (b, signs) in (start..).zip(signs) {
                *signs = Signs::of(contour, b);
            }
        });
        let table = cases::Cases::derive();
        let (places, cut_cells) = Places::of(bricks, &signs, &table);
        Self { signs, places, cut_cells, table }
    }

    /// The vertices, and what was special; of the same contour.
    pub(super) fn vertices(&self, contour: &Contour) -> (Vec<Vec3>, ContourStats) {
        let ends = &self.places.vertices;
        let mut positions = par::repeated(Vec3::zeros(), ends.last().copied().unwrap_or(0));
        let counts = par::map_parts(&mut positions, ends, TASK, |brick, vertices| {
            if vertices.is_empty() { [0; 2] } else { put_vertices(contour, &self.signs, brick, vertices) }
        });
        let [moved_vertices, unbounded_vertices] =
            counts.iter().fold([0; 2], |sum, part| [sum[0] + part[0], sum[1] + part[1]]);
        (positions, ContourStats { moved_vertices, unbounded_vertices, cut_cells: self.cut_cells })
    }

    /// The triangles; `bricks` are those of the contour.
    pub(super) fn triangles(&self, bricks: &Bricks) -> Vec<[u32; 3]> {
        let mut triangles = par::repeated([0; 3], self.places.triangles.last().copied().unwrap_or(0));
        // A window has all neighbours that its triangles need in itself and the next.
        let mut before = Window::default();
        for range in windows(bricks) {
            let window = Window::cut(self, bricks, range);
            before.join(&window, self, &mut triangles);
            before = window;
        }
        before.join(&Window::default(), self, &mut triangles);
        triangles
    }
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
    fn of(bricks: &Bricks, signs: &[Signs], table: &cases::Cases) -> (Self, usize) {
        let parts = par::map_chunks(signs.len(), TASK, |part| {
            let mut missing = Vec::new();
            let tallies: Vec<_> = part.map(|b| Tally::of(bricks, signs, table, b, &mut missing)).collect();
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
        sum.cut_cells += missing.into_iter().map(|coord| cut_below(bricks, signs, coord)).sum::<usize>();
        (places, sum.cut_cells)
    }

    /// The number of the first vertex of a brick.
    fn first_vertex(&self, brick: usize) -> u32 {
        start_of(&self.vertices, brick) as u32
    }

    /// Whether a brick has any vertex or triangle.
    fn is_crossed(&self, brick: usize) -> bool {
        [&self.vertices, &self.triangles].into_iter().any(|ends| start_of(ends, brick) < ends[brick])
    }
}

impl Tally {
    /// What brick `brick` has; adds to `missing` the lower neighbours that are not there and hold the lowest corners of cells
    /// that the surface may cross.
    fn of(
        bricks: &Bricks,
        signs: &[Signs],
        table: &cases::Cases,
        brick: usize,
        missing: &mut Vec<[i32; 3]>,
    ) -> Self {
        let Some(sides) = Sides::crossed(bricks, signs, brick) else { return Self::default() };
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
        let (coord, lowest) = (bricks.coords()[brick], sides.crossed_layers());
        for side in (1..8).filter(|side| (0..3).all(|axis| side >> axis & 1 == 0 || lowest[axis])) {
            let below = std::array::from_fn(|axis| coord[axis] - (side >> axis & 1));
            if bricks.find(below).is_none() {
                missing.push(below);
            }
        }
        tally
    }
}

/// How many cells the surface crosses whose lowest corner is in the missing brick at `coord`.
fn cut_below(bricks: &Bricks, signs: &[Signs], coord: [i32; 3]) -> usize {
    let sides = Sides::of(signs, around(bricks, coord));
    let rows = (0..BRICK * BRICK).map(|row| sides.cells(row % BRICK, row / BRICK));
    rows.map(|(crossed, _)| crossed.count_ones() as usize).sum()
}

/// The bricks in runs of whole layers along z of [`WINDOW`] bricks or more, so that a brick's neighbours are in its own run or
/// the next.
fn windows(bricks: &Bricks) -> Vec<Range<usize>> {
    let mut windows = Vec::new();
    let (mut start, mut end) = (0, 0);
    for layer in bricks.coords().chunk_by(|a, b| a[2] == b[2]) {
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
    /// The edges of some bricks.
    fn cut(cut: &Cut, bricks: &Bricks, range: Range<usize>) -> Self {
        let found = par::map_chunks(range.len(), TASK, |part| {
            let brick = |b: usize| {
                let brick = range.start + b;
                cut.places.is_crossed(brick).then(|| {
                    let around = around(bricks, bricks.coords()[brick]);
                    Box::new(BrickCut::of(Sides::of(&cut.signs, around)))
                })
            };
            part.map(brick).collect::<Vec<_>>()
        });
        Self { range, bricks: found.into_iter().flatten().collect() }
    }

    /// Writes the triangles of its bricks to their places; `next` is the window after this one.
    fn join(&self, next: &Self, Cut { places, table, .. }: &Cut, triangles: &mut [[u32; 3]]) {
        let (part, ends) = part_of(&places.triangles, self.range.clone());
        let at = |brick: usize| {
            let found = self.at(brick).or_else(|| next.at(brick))?;
            Some((found, places.first_vertex(brick)))
        };
        par::for_parts(&mut triangles[part], &ends, TASK, |b, triangles| {
            if !triangles.is_empty() {
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

/// Writes the vertices of brick `brick`; gives how many were moved and how many were unbounded.
fn put_vertices(contour: &Contour, signs: &[Signs], brick: usize, vertices: &mut [Vec3]) -> [usize; 2] {
    let Contour { grid, level, .. } = *contour;
    let coord = grid.bricks.coords()[brick];
    let sides = Sides::of(signs, around(&grid.bricks, coord));
    let own = grid.brick(brick);
    let beyond = |node: [usize; 3]| {
        let brick = sides.around[neighbour(node)] as usize;
        grid.values[brick * BRICK_NODES + offset(node.map(|i| i % BRICK))]
    };

    // Put a vertex on every crossed edge that a node of this brick owns.
    let (mut stats, mut free) = ([0; 2], vertices.iter_mut());
    for z in 0..BRICK {
        for y in 0..BRICK {
            for (x, edges) in sides.crossed_edges(y, z) {
                let node = std::array::from_fn(|d| coord[d] * BRICK as i32 + [x, y, z][d] as i32);
                let here = own[offset([x, y, z])];
                for (axis, vertex) in bits(edges).zip(&mut free) {
                    let mut upper = [x, y, z];
                    upper[axis] += 1;
                    let above = if upper[axis] < BRICK { own[offset(upper)] } else { beyond(upper) };
                    *vertex = point(node, axis, place(here, above, level, &mut stats), grid.voxel);
                }
            }
        }
    }
    debug_assert!(free.next().is_none(), "as many vertices as were counted");
    stats
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
    /// Counts the vertices before each node.
    fn of(sides: Sides) -> Self {
        let (mut marks, mut count) = ([0; BRICK_NODES], 0);
        for z in 0..BRICK {
            for y in 0..BRICK {
                for (x, edges) in sides.crossed_edges(y, z) {
                    marks[offset([x, y, z])] = count << 3 | edges;
                    count += edges.count_ones() as u16;
                }
            }
        }
        Self { sides, marks }
    }

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
