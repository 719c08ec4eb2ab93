//! Marching cubes on sparse bricks: the isosurface of a sampled field as a triangle mesh.
//!
//! *Method* [lorensen87]: a vertex on every grid edge with one end inside; triangles by the cases of `cases`.
//! *Departs from the paper*: the case table (see `cases`). Vertices are the roots of the cubic through four nodes
//! in a row instead of linear interpolation, which moves a surface by a twentieth of a voxel as it passes through
//! the grid; interpolation is linear where one of the four is missing and where the contour requests it. Vertices are shared by the edge they lie on, which
//! its lower node owns. A vertex stays [`MARGIN`] of an edge away from the nodes, so that no triangle has
//! zero area.
//!
//! There are four passes over the bricks, each brick alone. The first computes the signs of its nodes, which
//! exclude bricks without surface. The second counts its vertices and triangles, so that all of them have
//! their positions in the arrays. The third computes its vertices. The fourth computes its triangles from the
//! signs alone, so that the field's values can be freed before. Triangles are written in windows of whole
//! layers of bricks, so that the edges of a brick are stored for a short time only. Brick order and node
//! order decide the numbering, so the mesh depends neither on threads nor on bricks without surface. Every
//! vertex is used: the ends of its edge lie in one brick or in two that share a face, and so do all nodes of
//! one of its four cells.
//!
//! Symbols: a, b → values at an edge's ends, less the level; t → position of the vertex on the edge [0..1].
//! Limits: facets are second order in the voxel where the field is smooth; features thinner than a voxel may vanish.
//! Fewer than 2³² vertices.

use super::{
    Contour, Interpolation, Mesh, cases,
    node_signs::{BrickSigns, MISSING, PaddedSigns, around, bits, neighbour},
};
use crate::{
    grid::{BRICK, BRICK_NODES, Bricks, offset},
    math::Vec3,
    par,
};
use std::ops::Range;

/// Smallest distance of a vertex from a grid node, as a part of the edge.
///
/// If it is smaller, the triangles around a node collapse far from the origin (N voxels away, where positions
/// are exact to N·2⁻²⁴ voxels): at 1/256 they keep their shape up to N = 8000. If it is larger, the surface
/// has steps where it passes close to nodes: 1/256 moves it by at most 0.4 % of a voxel.
pub const MARGIN: f64 = 1.0 / 256.0;

/// Iterations for the root of a cubic. Five leave an error of 1e-6 edges.
const ROOT_ITERATIONS: usize = 5;

/// Bricks of a task: enough work for a task, few enough to distribute a small surface.
const BRICKS_PER_TASK: usize = 16;

/// Smallest number of bricks whose edges are stored at a time, in whole layers: enough to distribute, few
/// compared with the surface.
const MIN_WINDOW_BRICKS: usize = 4096;

/// What [`marching_cubes`] had to adjust.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[non_exhaustive]
pub struct ContourStats {
    /// Vertices moved along their edge to stay [`MARGIN`] away from a node.
    pub moved_vertices: usize,
    /// Vertices put in the middle of their edge because an end is infinite or NaN.
    pub unbounded_vertices: usize,
    /// Cells left out although the surface crosses them, because the brick of a corner is missing: the mesh
    /// is open there.
    pub cut_cells: usize,
}

/// The isosurface of a contour as an indexed mesh that faces the outside, and the adjustments made.
///
/// Cells with a node in a missing brick are left out; if the surface crosses none of them, the mesh is closed
/// and manifold. No normals, no attributes.
///
/// # Panics
/// If the surface has 2³² vertices or more.
pub fn marching_cubes<'a>(contour: impl Into<Contour<'a>>) -> (Mesh, ContourStats) {
    let contour = contour.into();
    let extraction = Extraction::new(&contour);
    let (positions, stats) = extraction.vertices(&contour);
    let triangles = extraction.triangles(&contour.grid.bricks);
    (Mesh { positions, triangles, ..Mesh::default() }, stats)
}

/// The topology of a surface: everything but the positions of its vertices.
pub(super) struct Extraction {
    signs: Vec<BrickSigns>,
    offsets: Offsets,
    cut_cells: usize,
    table: cases::Cases,
}

impl Extraction {
    /// Counts the vertices and triangles of a contour.
    ///
    /// # Panics
    /// If the surface has 2³² vertices or more.
    pub(super) fn new(contour: &Contour) -> Self {
        let bricks = &contour.grid.bricks;
        let mut signs = vec![BrickSigns::default(); bricks.len()];
        par::for_chunks(&mut signs, BRICKS_PER_TASK, |start, signs| {
            for (b, signs) in (start..).zip(signs) {
                *signs = BrickSigns::of(contour, b);
            }
        });
        let table = cases::Cases::derive();
        let (offsets, cut_cells) = Offsets::of(bricks, &signs, &table);
        Self { signs, offsets, cut_cells, table }
    }

    /// The vertices, and the adjustments made, of the same contour.
    pub(super) fn vertices(&self, contour: &Contour) -> (Vec<Vec3>, ContourStats) {
        let ends = &self.offsets.vertices;
        let mut positions = par::repeated(Vec3::zeros(), ends.last().copied().unwrap_or(0));
        let counts = par::map_parts(&mut positions, ends, BRICKS_PER_TASK, |brick, vertices| {
            if vertices.is_empty() { [0; 2] } else { write_vertices(contour, &self.signs, brick, vertices) }
        });
        let [moved_vertices, unbounded_vertices] =
            counts.iter().fold([0; 2], |sum, part| [sum[0] + part[0], sum[1] + part[1]]);
        (positions, ContourStats { moved_vertices, unbounded_vertices, cut_cells: self.cut_cells })
    }

    /// The triangles; `bricks` are those of the contour.
    pub(super) fn triangles(&self, bricks: &Bricks) -> Vec<[u32; 3]> {
        let mut triangles = par::repeated([0; 3], self.offsets.triangles.last().copied().unwrap_or(0));
        // A window and the next contain all neighbours that its triangles need.
        let mut before = Window::default();
        for range in windows(bricks) {
            let window = Window::extraction(self, bricks, range);
            before.write(&window, self, &mut triangles);
            before = window;
        }
        before.write(&Window::default(), self, &mut triangles);
        triangles
    }
}

/// Ends of the vertices and triangles of each brick in their arrays.
struct Offsets {
    vertices: Vec<usize>,
    triangles: Vec<usize>,
}

/// Numbers of vertices, triangles and cut cells of a brick.
#[derive(Default)]
struct BrickCounts {
    vertices: usize,
    triangles: usize,
    cut_cells: usize,
}

impl Offsets {
    /// Counts vertices and triangles, and the cells that are cut off.
    fn of(bricks: &Bricks, signs: &[BrickSigns], table: &cases::Cases) -> (Self, usize) {
        let parts = par::map_chunks(signs.len(), BRICKS_PER_TASK, |part| {
            let mut missing = Vec::new();
            let counts: Vec<_> =
                part.map(|b| BrickCounts::of(bricks, signs, table, b, &mut missing)).collect();
            (counts, missing)
        });
        let mut offsets =
            Self { vertices: Vec::with_capacity(signs.len()), triangles: Vec::with_capacity(signs.len()) };
        let (mut sum, mut missing) = (BrickCounts::default(), Vec::new());
        for (counts, some) in parts {
            missing.extend(some);
            for counts in counts {
                sum.vertices += counts.vertices;
                sum.triangles += counts.triangles;
                sum.cut_cells += counts.cut_cells;
                offsets.vertices.push(sum.vertices);
                offsets.triangles.push(sum.triangles);
            }
        }
        assert!(u32::try_from(sum.vertices).is_ok(), "a surface has fewer than 2³² vertices");
        missing.sort_unstable();
        missing.dedup();
        sum.cut_cells += missing.into_iter().map(|coord| cut_below(bricks, signs, coord)).sum::<usize>();
        (offsets, sum.cut_cells)
    }

    /// The index of the first vertex of a brick.
    fn first_vertex(&self, brick: usize) -> u32 {
        start_of(&self.vertices, brick) as u32
    }

    /// Whether a brick has any vertex or triangle.
    fn is_crossed(&self, brick: usize) -> bool {
        [&self.vertices, &self.triangles].into_iter().any(|ends| start_of(ends, brick) < ends[brick])
    }
}

impl BrickCounts {
    /// Counts for brick `brick`. Adds to `missing` the absent lower neighbours that hold the lowest corners
    /// of cells which the surface may cross.
    fn of(
        bricks: &Bricks,
        signs: &[BrickSigns],
        table: &cases::Cases,
        brick: usize,
        missing: &mut Vec<[i32; 3]>,
    ) -> Self {
        let Some(sides) = PaddedSigns::crossed(bricks, signs, brick) else { return Self::default() };
        let mut counts = Self::default();
        for z in 0..BRICK {
            for y in 0..BRICK {
                counts.vertices +=
                    sides.edges(y, z).map(|edges| edges.count_ones() as usize).iter().sum::<usize>();
                let (crossed, complete) = sides.cells(y, z);
                counts.cut_cells += (crossed & !complete).count_ones() as usize;
                for x in bits(crossed & complete) {
                    counts.triangles += table.of(sides.mask([x, y, z])).len();
                }
            }
        }
        // A cell whose lowest corner is in a lower neighbour has its other corners in this brick's lowest
        // layers.
        let (coord, lowest) = (bricks.coords()[brick], sides.crossed_layers());
        for side in (1..8).filter(|side| (0..3).all(|axis| side >> axis & 1 == 0 || lowest[axis])) {
            let below = std::array::from_fn(|axis| coord[axis] - (side >> axis & 1));
            if bricks.find(below).is_none() {
                missing.push(below);
            }
        }
        counts
    }
}

/// Number of crossed cells whose lowest corner is in the missing brick at `coord`.
fn cut_below(bricks: &Bricks, signs: &[BrickSigns], coord: [i32; 3]) -> usize {
    let sides = PaddedSigns::of(signs, around(bricks, coord));
    let rows = (0..BRICK * BRICK).map(|row| sides.cells(row % BRICK, row / BRICK));
    rows.map(|(crossed, _)| crossed.count_ones() as usize).sum()
}

/// Ranges of bricks in whole layers along z, of [`MIN_WINDOW_BRICKS`] bricks or more, so that a brick's
/// neighbours are in its own range or the next.
fn windows(bricks: &Bricks) -> Vec<Range<usize>> {
    let mut windows = Vec::new();
    let (mut start, mut end) = (0, 0);
    for layer in bricks.coords().chunk_by(|a, b| a[2] == b[2]) {
        end += layer.len();
        if end - start >= MIN_WINDOW_BRICKS {
            windows.push(start..end);
            start = end;
        }
    }
    windows.push(start..end);
    windows
}

/// A range of bricks with their edges.
#[derive(Default)]
struct Window {
    range: Range<usize>,
    bricks: Vec<Option<Box<BrickEdges>>>,
}

impl Window {
    /// The edges of the bricks of a range.
    fn extraction(extraction: &Extraction, bricks: &Bricks, range: Range<usize>) -> Self {
        let found = par::map_chunks(range.len(), BRICKS_PER_TASK, |part| {
            let brick = |b: usize| {
                let brick = range.start + b;
                extraction.offsets.is_crossed(brick).then(|| {
                    let around = around(bricks, bricks.coords()[brick]);
                    Box::new(BrickEdges::of(PaddedSigns::of(&extraction.signs, around)))
                })
            };
            part.map(brick).collect::<Vec<_>>()
        });
        Self { range, bricks: found.into_iter().flatten().collect() }
    }

    /// Writes the triangles of the window's bricks to their positions; `next` is the following window.
    fn write(&self, next: &Self, Extraction { offsets, table, .. }: &Extraction, triangles: &mut [[u32; 3]]) {
        let (part, ends) = range_of(&offsets.triangles, self.range.clone());
        let at = |brick: usize| {
            let found = self.at(brick).or_else(|| next.at(brick))?;
            Some((found, offsets.first_vertex(brick)))
        };
        par::for_parts(&mut triangles[part], &ends, BRICKS_PER_TASK, |b, triangles| {
            if !triangles.is_empty() {
                write_triangles(self.range.start + b, at, table, triangles);
            }
        });
    }

    /// A brick of this window that the surface crosses.
    fn at(&self, brick: usize) -> Option<&BrickEdges> {
        self.range.contains(&brick).then(|| self.bricks[brick - self.range.start].as_deref())?
    }
}

/// Start of the items of brick `brick`; `ends` holds the ends of those of each brick.
fn start_of(ends: &[usize], brick: usize) -> usize {
    brick.checked_sub(1).map_or(0, |before| ends[before])
}

/// The range of the items of some bricks, and the ends of those of each brick within it.
fn range_of(ends: &[usize], bricks: Range<usize>) -> (Range<usize>, Vec<usize>) {
    let start = start_of(ends, bricks.start);
    let within: Vec<usize> = ends[bricks].iter().map(|end| end - start).collect();
    (start..start + within.last().copied().unwrap_or(0), within)
}

/// The crossed edges of one brick.
struct BrickEdges {
    sides: PaddedSigns,
    /// For every node of the brick: 8 × (vertices on edges of earlier nodes) + (bits of its crossed edges).
    marks: [u16; BRICK_NODES],
}

/// Writes the vertices of brick `brick`; returns how many were moved and how many were unbounded.
fn write_vertices(
    contour: &Contour,
    signs: &[BrickSigns],
    brick: usize,
    vertices: &mut [Vec3],
) -> [usize; 2] {
    let Contour { grid, level, interpolation, .. } = *contour;
    let coord = grid.bricks.coords()[brick];
    let sides = PaddedSigns::of(signs, around(&grid.bricks, coord));
    let own = grid.brick(brick);
    let beyond = |node: [usize; 3]| {
        let brick = sides.around[neighbour(node)] as usize;
        grid.values[brick * BRICK_NODES + offset(node.map(|i| i % BRICK))]
    };
    let below: [Option<&[f32]>; 3] = std::array::from_fn(|axis| {
        let coord = std::array::from_fn(|d| coord[d] - i32::from(d == axis));
        grid.bricks.find(coord).map(|brick| grid.brick(brick))
    });
    // The values before and after an edge; NaN where a brick is missing.
    let around_edge = |node: [usize; 3], axis: usize| {
        let at = |along: usize| {
            let mut node = node;
            node[axis] = along % BRICK;
            offset(node)
        };
        let before = match node[axis].checked_sub(1) {
            Some(along) => own[at(along)],
            None => below[axis].map_or(f32::NAN, |values| values[at(BRICK - 1)]),
        };
        let after = match node[axis] + 2 {
            along if along < BRICK => own[at(along)],
            along => match sides.around[1 << axis] {
                MISSING => f32::NAN,
                brick => grid.values[brick as usize * BRICK_NODES + at(along)],
            },
        };
        [before, after]
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
                    let ends = match interpolation {
                        Interpolation::Cubic => around_edge([x, y, z], axis),
                        Interpolation::Linear => [f32::NAN; 2],
                    };
                    *vertex = point(node, axis, place([here, above], ends, level, &mut stats), grid.voxel);
                }
            }
        }
    }
    assert!(free.next().is_none(), "as many vertices as were counted");
    stats
}

/// Position [0..1] at which the surface of a level crosses an edge with the values `a` and `b` at its ends and
/// `around` before and after it, by the cubic through the four; linear if these two are not both finite.
/// Counts the vertices that it moves and those that are unbounded.
fn place([a, b]: [f32; 2], around: [f32; 2], level: f32, [displaced, unbounded]: &mut [usize; 2]) -> f64 {
    if !(a.is_finite() && b.is_finite()) {
        *unbounded += 1;
        return 0.5;
    }
    let [a, b, before, after] = [a, b, around[0], around[1]].map(|value| f64::from(value) - f64::from(level));
    let linear = a / (a - b);
    let is_between = linear > 0.0 && linear < 1.0 && (before + after).is_finite();
    let t = if is_between { cubic_root([before, a, b, after], linear) } else { linear };
    let kept = t.clamp(MARGIN, 1.0 - MARGIN);
    *displaced += usize::from(kept != t);
    kept
}

/// The root in [0..1] of the cubic with these values at −1, 0, 1 and 2, of which those at 0 and 1 differ in sign.
fn cubic_root([before, a, b, after]: [f64; 4], linear: f64) -> f64 {
    // Newton's form: the differences of the values.
    let (first, second) = (b - a, 0.5 * (before - 2.0 * a + b));
    let third = (after - before + 3.0 * (a - b)) / 6.0;
    let value = |t: f64| a + t * (first + (t - 1.0) * (second + (t + 1.0) * third));
    // The method of false position with the side that stays halved [dowell71].
    let (mut low, mut high) = ([0.0, a], [1.0, b]);
    let mut t = linear;
    for _ in 0..ROOT_ITERATIONS {
        let found = value(t);
        if (found > 0.0) == (low[1] > 0.0) {
            low = [t, found];
            high[1] *= 0.5;
        } else {
            high = [t, found];
            low[1] *= 0.5;
        }
        let next = (low[0] * high[1] - high[0] * low[1]) / (high[1] - low[1]);
        // Values that differ by many orders of magnitude leave no digits.
        t = if next > low[0] && next < high[0] { next } else { t };
    }
    t
}

/// The point at `t` on the edge that leaves `node` along `axis` [m].
fn point(node: [i32; 3], axis: usize, t: f64, voxel: f32) -> Vec3 {
    Vec3::from_fn(|d, _| {
        let along = if d == axis { t } else { 0.0 };
        ((f64::from(node[d]) + along) * f64::from(voxel)) as f32
    })
}

impl BrickEdges {
    /// Counts the vertices before each node.
    fn of(sides: PaddedSigns) -> Self {
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

    /// The index of the vertex on the edge that leaves the node at `place` along `axis`, relative to the
    /// brick's first.
    #[inline]
    fn vertex(&self, place: usize, axis: u8) -> u32 {
        let mark = self.marks[place];
        u32::from(mark >> 3) + (mark & ((1 << axis) - 1)).count_ones()
    }
}

/// Writes the triangles of the cells whose lowest corner is in brick `brick`; `at` returns bricks and the
/// indices of their first vertices.
fn write_triangles<'a>(
    brick: usize,
    at: impl Fn(usize) -> Option<(&'a BrickEdges, u32)>,
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
    assert!(to.next().is_none(), "as many triangles as were counted");
}

/// Offset in a brick of the lower node of each edge of a cell from the cell's own, and the edge's axis.
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
