//! Checks that a mesh is closed, manifold, oriented and free of slivers, as renderers and solvers require.
//!
//! *Method*: a counting sort lists the corners of every vertex, that is the triangles around it. Sorted by
//! the vertex at their other end, the sides at a vertex give the number of triangles of each edge and their
//! directions. Corners that share an edge form fans, and a manifold vertex has one fan. Each vertex is
//! checked on its own. Volume by the divergence theorem, V = ⅙ Σ a·(b × c); Euler characteristic V − E + F
//! over the vertices in use.
//!
//! Limits: self-intersections are not detected.

use super::{Mesh, components::Components, half_edges::HalfEdges};
use crate::{math::Vec3, par};

/// A triangle is degenerate if twice its area is at most this part of its longest side squared: its height is
/// then below one millionth of its length, where a normal in single precision is meaningless.
const DEGENERATE_RATIO: f64 = 1e-6;

/// The same ratio above which a triangle is certainly not degenerate. If it is smaller, rounding in single
/// precision matters; if larger, more triangles are computed twice.
const CERTAINLY_SOUND_RATIO: f32 = 1e-3;

/// The first fault of a mesh.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
#[non_exhaustive]
pub struct Fault {
    /// Kind of fault.
    pub what: &'static str,
    /// The vertex, or the first vertex of the edge or triangle.
    pub vertex: u32,
    /// Position of that vertex [m].
    pub at: [f32; 3],
}

/// Result of [`check`].
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct MeshCheck {
    /// Whether every edge has two triangles or more.
    pub closed: bool,
    /// Whether every edge has at most two triangles and the triangles around every vertex form one fan.
    pub manifold: bool,
    /// Whether the two triangles at every edge run along it in opposite directions.
    pub oriented: bool,
    /// Edges with one triangle.
    pub boundary_edges: usize,
    /// Edges with more than two triangles.
    pub non_manifold_edges: usize,
    /// Vertices whose triangles form more than one fan.
    pub non_manifold_vertices: usize,
    /// Edges with two triangles that run along it in the same direction.
    pub misoriented_edges: usize,
    /// Triangles with a repeated vertex or with a height below one millionth of their longest side.
    pub degenerate_triangles: usize,
    /// Triangles that name a vertex the mesh does not have; they take no part in other counts.
    pub out_of_range_triangles: usize,
    /// Vertices with an infinite or NaN coordinate.
    pub non_finite_vertices: usize,
    /// Vertices that no triangle uses.
    pub unused_vertices: usize,
    /// Connected components, which share no vertex.
    pub components: usize,
    /// Vertices in use − edges + triangles: 2 for each closed component, less 2 for each handle.
    pub euler: i64,
    /// Enclosed volume [m³], positive if faces point outwards; meaningless for an open mesh.
    pub volume: f64,
    /// Area [m²].
    pub area: f64,
    /// The first fault: of a triangle, or else of a vertex or edge in order of the vertices.
    pub first_fault: Option<Fault>,
}

impl MeshCheck {
    /// Whether the mesh is closed, manifold, oriented, finite and without degenerate triangles.
    pub fn is_sound(&self) -> bool {
        self.closed
            && self.manifold
            && self.oriented
            && self.degenerate_triangles == 0
            && self.out_of_range_triangles == 0
            && self.non_finite_vertices == 0
    }
}

/// Checks a mesh. An empty mesh is sound, with volume and area zero.
pub fn check(mesh: &Mesh) -> MeshCheck {
    check_with(mesh, KnownParts::default())
}

/// Number of triangles without area where the vertices are rounded to single precision in the frame of the world.
pub(crate) fn degenerate_in_world_frame(mesh: &Mesh) -> usize {
    let mut positions = mesh.positions.clone();
    par::update(&mut positions, |_, x| *x = (x.cast::<f64>() + mesh.origin).cast());
    let is_degenerate = |t: usize| {
        let triangle = mesh.triangles[t];
        !matches!(Shape::of(&positions, triangle), Shape::Sound | Shape::OutOfRange)
    };
    par::sum(mesh.triangles.len(), |t| f64::from(u8::from(is_degenerate(t)))) as usize
}

/// What is known of a mesh before it is checked.
#[derive(Default)]
pub(super) struct KnownParts {
    pub(super) half_edges: Option<HalfEdges>,
    /// Number of connected components.
    pub(super) components: Option<usize>,
}

/// [`check`] of a mesh of which something is known.
pub(super) fn check_with(mesh: &Mesh, known: KnownParts) -> MeshCheck {
    let mut result = MeshCheck::default();

    // Check every triangle alone; those with a repeated or missing vertex take no part in the edges.
    let shape: Vec<Shape> = {
        let mut shape = vec![Shape::Sound; mesh.triangles.len()];
        par::fill(&mut shape, |t| Shape::of(&mesh.positions, mesh.triangles[t]));
        shape
    };
    let faulty = par::map_chunks(shape.len(), par::CHUNK, |range| {
        range.filter(|&t| shape[t] != Shape::Sound).collect::<Vec<_>>()
    })
    .concat();
    for &t in &faulty {
        let fault = match shape[t] {
            Shape::OutOfRange => {
                result.out_of_range_triangles += 1;
                "triangle names a vertex that does not exist"
            }
            _ => {
                result.degenerate_triangles += 1;
                "degenerate triangle"
            }
        };
        result.record_fault(mesh, fault, mesh.triangles[t][0]);
    }
    let has_edges = |t: usize| matches!(shape[t], Shape::Sound | Shape::Flat);
    let without_edges = faulty.iter().filter(|&&t| !has_edges(t)).count();

    // Check every vertex with the triangles around it.
    let half_edges = known.half_edges.filter(|_| without_edges == 0);
    let components = known.components.filter(|_| without_edges == 0);
    let count_components = || Components::of_triangles(mesh, has_edges).first.len();
    let (half_edges, (components, sizes)) = par::join(
        || half_edges.unwrap_or_else(|| HalfEdges::new(mesh, has_edges)),
        || (components.unwrap_or_else(count_components), volume_and_area(mesh, &shape)),
    );
    for faults in par::map_chunks(mesh.positions.len(), par::CHUNK, |range| {
        let mut scratch = Scratch::default();
        let mut sum = VertexFaults::default();
        for v in range {
            sum.add(mesh, &half_edges, v as u32, &mut scratch);
        }
        sum
    }) {
        result.boundary_edges += faults.boundary;
        result.non_manifold_edges += faults.non_manifold;
        result.misoriented_edges += faults.misoriented;
        result.non_manifold_vertices += faults.pinched;
        result.unused_vertices += faults.unused;
        result.non_finite_vertices += faults.non_finite;
        result.euler += faults.euler;
        if let Some((what, vertex)) = faults.fault {
            result.record_fault(mesh, what, vertex);
        }
    }
    drop(half_edges);
    result.closed = result.boundary_edges == 0;
    result.manifold = result.non_manifold_edges == 0 && result.non_manifold_vertices == 0;
    result.oriented = result.misoriented_edges == 0;

    // Measure the whole mesh.
    result.euler += (mesh.triangles.len() - without_edges) as i64;
    result.components = components - result.unused_vertices;
    (result.volume, result.area) = sizes;
    result
}

impl MeshCheck {
    /// Records the first fault.
    fn record_fault(&mut self, mesh: &Mesh, what: &'static str, vertex: u32) {
        let at = mesh.positions.get(vertex as usize).map_or([f32::NAN; 3], |&x| x.into());
        self.first_fault.get_or_insert(Fault { what, vertex, at });
    }
}

/// Validity of a triangle on its own.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Shape {
    Sound,
    Flat,
    Repeated,
    OutOfRange,
}

impl Shape {
    pub(super) fn of(positions: &[Vec3], [a, b, c]: [u32; 3]) -> Self {
        if [a, b, c].iter().any(|&v| v as usize >= positions.len()) {
            return Self::OutOfRange;
        }
        if a == b || b == c || c == a {
            return Self::Repeated;
        }
        // Triangles far from degenerate are recognised in single precision.
        let [a, b, c] = [a, b, c].map(|v| positions[v as usize]);
        let longest = (b - a).norm_squared().max((c - b).norm_squared()).max((a - c).norm_squared());
        if (b - a).cross(&(c - a)).norm_squared() > (CERTAINLY_SOUND_RATIO * longest).powi(2) {
            return Self::Sound;
        }
        let [a, b, c] = [a, b, c].map(|x| x.cast::<f64>());
        let longest = (b - a).norm_squared().max((c - b).norm_squared()).max((a - c).norm_squared());
        let double_area = (b - a).cross(&(c - a)).norm();
        // NaN is not larger, so it counts as degenerate.
        if double_area > DEGENERATE_RATIO * longest { Self::Sound } else { Self::Flat }
    }
}

/// Buffers that the vertices of a chunk share.
#[derive(Default)]
struct Scratch {
    /// The next and the previous vertex at each corner.
    corners: Vec<[u32; 2]>,
    /// The sides at a vertex: (vertex at the other end, corner they belong to, whether they leave the
    /// vertex).
    sides: Vec<(u32, u32, bool)>,
    /// The fan of every corner, as a union-find forest.
    fans: Vec<u32>,
}

/// Faults of a range of vertices; edges are counted at their lower vertex.
#[derive(Default)]
struct VertexFaults {
    boundary: usize,
    non_manifold: usize,
    misoriented: usize,
    pinched: usize,
    unused: usize,
    non_finite: usize,
    /// Vertices in use − edges.
    euler: i64,
    fault: Option<(&'static str, u32)>,
}

impl VertexFaults {
    fn add(&mut self, mesh: &Mesh, half_edges: &HalfEdges, v: u32, scratch: &mut Scratch) {
        if !mesh.positions[v as usize].iter().all(|x| x.is_finite()) {
            self.non_finite += 1;
            self.fault.get_or_insert(("vertex that is not finite", v));
        }
        let Scratch { corners: faults, sides, fans } = scratch;
        faults.clear();
        faults.extend(half_edges.of(v as usize).iter().map(|&h| {
            let (triangle, k) = (mesh.triangles[h.triangle() as usize], h.at() % 3);
            [triangle[(k + 1) % 3], triangle[(k + 2) % 3]]
        }));
        let corners = faults.as_slice();
        if corners.is_empty() {
            self.unused += 1;
            return;
        }
        self.euler += 1;
        if let Some(edges) = closed_fan(v, corners) {
            self.euler -= edges;
            return;
        }

        // Sort the sides by the vertex at their other end, so that those of one edge are consecutive.
        sides.clear();
        fans.clear();
        for (corner, &[next, previous]) in (0..).zip(corners) {
            sides.push((next, corner, true));
            sides.push((previous, corner, false));
            fans.push(corner);
        }
        sides.sort_unstable();

        let mut components = corners.len();
        for edge in sides.chunk_by(|a, b| a.0 == b.0) {
            // Join the corners that share this edge to one fan.
            for pair in edge.windows(2) {
                components -= usize::from(join(fans, pair[0].1, pair[1].1));
            }
            if edge[0].0 < v {
                continue;
            }
            // Count the edge's triangles and their directions.
            self.euler -= 1;
            let leaving = edge.iter().filter(|side| side.2).count();
            let (count, what) = match (edge.len(), leaving) {
                (1, _) => (&mut self.boundary, "edge with one triangle"),
                (2, 1) => continue,
                (2, _) => (&mut self.misoriented, "edge whose triangles run the same way"),
                _ => (&mut self.non_manifold, "edge with more than two triangles"),
            };
            *count += 1;
            self.fault.get_or_insert((what, v));
        }
        if components > 1 {
            self.pinched += 1;
            self.fault.get_or_insert(("vertex whose triangles form more than one fan", v));
        }
    }
}

/// Number of edges from `v` to later vertices, if its corners are one closed and consistently oriented fan;
/// most are.
fn closed_fan(v: u32, corners: &[[u32; 2]]) -> Option<i64> {
    let [first, mut last] = corners[0];
    // The next corner begins where this one ends. A side that two corners share is found only once, so that
    // the fan closes too early.
    for _ in 1..corners.len() {
        if last == first {
            return None;
        }
        last = corners.iter().find(|corner| corner[0] == last)?[1];
    }
    let later = corners.iter().filter(|corner| corner[0] > v).count();
    (last == first).then_some(later as i64)
}

/// Joins the trees of `a` and `b`; whether they were separate.
fn join(forest: &mut [u32], a: u32, b: u32) -> bool {
    let (a, b) = (root(forest, a), root(forest, b));
    forest[a.max(b) as usize] = a.min(b);
    a != b
}

/// The root of `a`'s tree, halving the path on the way.
fn root(forest: &mut [u32], mut a: u32) -> u32 {
    while forest[a as usize] != a {
        let above = forest[forest[a as usize] as usize];
        forest[a as usize] = above;
        a = above;
    }
    a
}

/// Enclosed volume [m³] and area [m²].
fn volume_and_area(mesh: &Mesh, shape: &[Shape]) -> (f64, f64) {
    // Measure from a vertex, so that a small mesh far from the origin loses no digits.
    let origin = mesh.positions.first().map_or(nalgebra::Vector3::zeros(), |x| x.cast::<f64>());
    let at = |v: u32| -> nalgebra::Vector3<f64> { mesh.positions[v as usize].cast::<f64>() - origin };
    let sums = par::map_chunks(mesh.triangles.len(), par::CHUNK, |range| {
        let (mut volume, mut area) = (0.0, 0.0);
        for t in range.filter(|&t| shape[t] != Shape::OutOfRange) {
            let [a, b, c] = mesh.triangles[t].map(at);
            volume += a.dot(&b.cross(&c)) / 6.0;
            area += (b - a).cross(&(c - a)).norm() / 2.0;
        }
        (volume, area)
    });
    sums.into_iter().fold((0.0, 0.0), |sum, part| (sum.0 + part.0, sum.1 + part.1))
}

/// Area-weighted normals of the faces around every vertex, not normalised [m²]: equal to
/// [`HalfEdges::normals`], on one thread and without half-edges, which take more memory than everything else
/// at this stage.
pub(super) fn face_normals(mesh: &Mesh) -> Vec<Vec3> {
    let mut sums = vec![Vec3::zeros(); mesh.positions.len()];
    for triangle in &mesh.triangles {
        let normal = area_normal(mesh, triangle);
        for &v in triangle {
            sums[v as usize] += normal;
        }
    }
    sums
}

/// Normal of a face, of length twice its area [m²].
#[inline]
pub(super) fn area_normal(mesh: &Mesh, triangle: &[u32; 3]) -> Vec3 {
    let [a, b, c] = triangle.map(|v| mesh.positions[v as usize]);
    (b - a).cross(&(c - a))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A unit cube of 12 triangles.
    fn cube() -> Mesh {
        let positions =
            (0..8).map(|c| Vec3::from_fn(|d, _| if c >> d & 1 == 1 { 1.0 } else { 0.0 })).collect();
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let triangles = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
        Mesh { positions, triangles, ..Mesh::default() }
    }

    #[test]
    fn a_cube_is_sound() {
        let found = check(&cube());
        assert!(found.is_sound() && found.first_fault.is_none(), "{found:?}");
        assert_eq!((found.components, found.euler, found.unused_vertices), (1, 2, 0));
        assert!((found.volume - 1.0).abs() < 1e-12 && (found.area - 6.0).abs() < 1e-12);
        let empty = check(&Mesh::default());
        assert!(empty.is_sound() && empty.components == 0 && empty.euler == 0 && empty.volume == 0.0);
    }

    #[test]
    fn both_sums_of_normals_give_the_same_bits() {
        let mut mesh = cube();
        mesh.positions.iter_mut().for_each(|x| *x = *x * 0.37 + Vec3::new(0.1 * x.y, x.z.sin(), 0.3));
        assert_eq!(HalfEdges::new(&mesh, |_| true).normals(&mesh), face_normals(&mesh));
    }

    #[test]
    fn a_removed_triangle_opens_the_mesh() {
        let mut mesh = cube();
        mesh.triangles.remove(5);
        let found = check(&mesh);
        assert!(!found.closed && found.manifold && found.oriented);
        assert_eq!((found.boundary_edges, found.euler), (3, 1));
        assert_eq!(found.first_fault.unwrap().what, "edge with one triangle");
    }

    #[test]
    fn a_flipped_triangle_is_misoriented() {
        let mut mesh = cube();
        mesh.triangles[7].swap(0, 2);
        let found = check(&mesh);
        assert!(found.closed && found.manifold && !found.oriented);
        assert_eq!(found.misoriented_edges, 3);
    }

    #[test]
    fn a_duplicated_vertex_opens_a_seam() {
        let mut mesh = cube();
        mesh.positions.push(mesh.positions[3]);
        let triangle = mesh.triangles.iter_mut().find(|t| t.contains(&3)).unwrap();
        triangle.iter_mut().filter(|v| **v == 3).for_each(|v| *v = 8);
        let found = check(&mesh);
        assert!(!found.closed && found.boundary_edges == 4, "{found:?}");
    }

    #[test]
    fn degenerate_unused_and_broken_parts_are_counted() {
        let mut mesh = cube();
        mesh.positions.push(Vec3::new(0.5, 0.0, 0.0));
        mesh.triangles.push([0, 1, 8]);
        mesh.triangles.push([2, 2, 3]);
        mesh.triangles.push([0, 1, 99]);
        mesh.positions.push(Vec3::new(f32::NAN, 0.0, 0.0));
        let found = check(&mesh);
        assert_eq!((found.degenerate_triangles, found.out_of_range_triangles), (2, 1));
        assert_eq!((found.non_finite_vertices, found.unused_vertices), (1, 1));
        assert_eq!((found.non_manifold_edges, found.boundary_edges), (1, 2), "{found:?}");
        assert!(!found.is_sound());
        assert_eq!(found.first_fault.unwrap().what, "degenerate triangle");
    }

    #[test]
    fn cubes_that_touch_in_a_vertex_are_pinched() {
        let mut mesh = cube();
        let second = cube();
        let shift = |v: u32| if v == 0 { 7 } else { v + 7 };
        mesh.positions.extend(second.positions[1..].iter().map(|x| x + Vec3::new(1.0, 1.0, 1.0)));
        mesh.triangles.extend(second.triangles.iter().map(|t| t.map(shift)));
        let found = check(&mesh);
        assert!(found.closed && found.oriented && !found.manifold);
        assert_eq!((found.non_manifold_vertices, found.non_manifold_edges, found.components), (1, 0, 1));
        assert_eq!(found.first_fault.unwrap().vertex, 7);
    }

    #[test]
    fn the_order_of_triangles_does_not_change_the_result() {
        let mut mesh = cube();
        let before = check(&mesh);
        mesh.triangles.reverse();
        mesh.triangles.iter_mut().for_each(|t| t.rotate_left(1));
        let after = check(&mesh);
        assert_eq!(
            (before.euler, before.components, before.closed),
            (after.euler, after.components, after.closed)
        );
        assert!((before.volume - after.volume).abs() < 1e-12);
    }
}
