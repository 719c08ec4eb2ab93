//! Collision mesh: the triangles, edges and points of sheets that may come into contact.
//!
//! *Method*: quads are cut into two triangles along the diagonal that is shorter at the start. A segment of a
//! chain is a triangle with two distinct corners, a loose point one with a single corner. Every edge and
//! every point belongs to one triangle, so that each pair of features is found once where two triangles come
//! close ([curtis08]).
//!
//! FeaturePair that share a point, or points of one joint, never come into contact. Within a sheet two layers
//! are kept no further apart than 0.7 of their distance at the start: otherwise a mesh finer than the
//! thickness would burst. ContactPair seams the distance along the sheets to the seam takes the place of that
//! distance.

use super::closest_points::{self, Double};
use crate::{
    math::Vec3,
    par::{self, Forest},
    sim::sheet::{
        model::{Model, Spring},
        vectors::Vectors,
    },
};
use std::{
    cmp::Reverse,
    collections::{BTreeSet, BinaryHeap},
    ops::Range,
};

/// The part of the rest distance that contact may enforce within a sheet. At 1 every fold of a fine mesh
/// would be stiff. At 0.7 a sheet can be compressed by three tenths before its own cells come into contact.
const REST_DISTANCE_FRACTION: f64 = 0.7;

/// Sine of the angle below which neighbouring triangles count as flat: flat sheets are flat to within
/// rounding.
const FLAT_ANGLE_SINE: f64 = 1e-4;

/// Index of a triangle of all sheets, not of a point.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[repr(transparent)]
pub(super) struct TriangleIndex(pub(super) u32);

/// The triangles of all sheets.
#[derive(Debug)]
pub(super) struct CollisionMesh {
    triangles: Vec<[u32; 3]>,
    /// See [`CollisionMesh::owned`].
    owned: Vec<u8>,
    /// A triangle of each point.
    of_point: Vec<TriangleIndex>,
    /// The points that share an edge with point `i`: `neighbours[neighbour_start[i]..neighbour_start[i +
    /// 1]]`.
    neighbours: Vec<u32>,
    neighbour_start: Vec<u32>,
    /// The sheet of each point.
    sheet: Vec<u32>,
    /// Positions at the start.
    pub(super) rest_positions: Vec<Vec3>,
    /// The part of the rest distance that contact may enforce, of each sheet.
    rest_fraction: Vec<f64>,
    seam: Option<Seam>,
}

/// Where joints hold points together.
#[derive(Debug)]
struct Seam {
    /// The lowest of the points that are held together.
    root: Vec<u32>,
    /// Distance along the sheet to the next seam [m]; infinite beyond the reach of contact.
    distance: Vec<f32>,
}

/// A pair of features: a point and a triangle, or two edges.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct FeaturePair {
    pub(super) points: [u32; 4],
    /// Whether the points are two edges of two points each. Otherwise they are a point and the three corners
    /// of a triangle.
    pub(super) edges: bool,
}

impl FeaturePair {
    /// Number of points on the first side.
    fn split(&self) -> usize {
        if self.edges { 2 } else { 1 }
    }

    /// The points of both sides.
    pub(super) fn sides(&self) -> (&[u32], &[u32]) {
        self.points.split_at(self.split())
    }

    /// The weights of the four points in the vector from the second side to the first at their closest
    /// points, and whether these are inside both edges.
    pub(super) fn closest(&self, x: [Double; 4]) -> ([f64; 4], bool) {
        if self.edges {
            let [s, t] = closest_points::on_segments([x[0], x[1]], [x[2], x[3]]);
            let inside = s > 0.0 && s < 1.0 && t > 0.0 && t < 1.0;
            ([1.0 - s, s, t - 1.0, -t], inside)
        } else {
            let [a, b, c] = closest_points::on_triangle(x[0], [x[1], x[2], x[3]]);
            ([1.0, -a, -b, -c], true)
        }
    }

    /// Distance of the two sides.
    pub(super) fn distance(&self, x: [Double; 4]) -> f64 {
        sum(self.closest(x).0, x).norm()
    }
}

/// Σ s x.
pub(super) fn sum(s: [f64; 4], x: [Double; 4]) -> Double {
    x[0] * s[0] + x[1] * s[1] + x[2] * s[2] + x[3] * s[3]
}

impl CollisionMesh {
    /// The collision mesh of sheets with these ranges of points; `rest` holds the factors of their rest
    /// lengths.
    pub(super) fn new(models: &[Model], ranges: &[Range<usize>], rest: &[[f32; 2]]) -> Self {
        let count = ranges.last().map_or(0, |range| range.end);
        let points: Vec<Vec3> = models.iter().flat_map(|model| model.points.iter().copied()).collect();
        let mut sheet = vec![0; count];
        let mut triangles = Vec::new();
        for (number, (model, range)) in models.iter().zip(ranges).enumerate() {
            sheet[range.clone()].fill(number as u32);
            let start = range.start as u32;
            triangles.extend(triangulate(model).into_iter().map(|corners| corners.map(|i| i + start)));
        }
        let mut mesh = Self {
            owned: vec![0; triangles.len()],
            of_point: vec![TriangleIndex(0); count],
            neighbours: Vec::new(),
            neighbour_start: vec![0; count + 1],
            triangles,
            sheet,
            rest_positions: points,
            rest_fraction: rest
                .iter()
                .map(|&[a, b]| REST_DISTANCE_FRACTION * f64::from(a.min(b).min(1.0)))
                .collect(),
            seam: None,
        };
        mesh.assign_features(count);
        mesh
    }

    /// All triangles.
    pub(super) fn triangles(&self) -> impl ExactSizeIterator<Item = TriangleIndex> + use<> {
        (0..self.triangles.len() as u32).map(TriangleIndex)
    }

    /// The points of a triangle.
    #[inline]
    pub(super) fn corners(&self, triangle: TriangleIndex) -> [u32; 3] {
        self.triangles[triangle.0 as usize]
    }

    /// The corners (bits 0, 1, 2) and edges (3, 4, 5: from each corner to the next) that belong to a
    /// triangle.
    #[inline]
    pub(super) fn owned(&self, triangle: TriangleIndex) -> u8 {
        self.owned[triangle.0 as usize]
    }

    /// Assigns every point and every edge to the first triangle that has it.
    fn assign_features(&mut self, count: usize) {
        let mut assigned = vec![false; count];
        let mut edges = BTreeSet::new();
        for (number, (corners, owned)) in self.triangles.iter().zip(&mut self.owned).enumerate() {
            for k in 0..3 {
                let (a, b) = (corners[k], corners[(k + 1) % 3]);
                if !std::mem::replace(&mut assigned[a as usize], true) {
                    *owned |= 1 << k;
                    self.of_point[a as usize] = TriangleIndex(number as u32);
                }
                if a != b && edges.insert([a.min(b), a.max(b)]) {
                    *owned |= 8 << k;
                }
            }
        }
        let mut ends: Vec<[u32; 2]> = edges.iter().flat_map(|&[a, b]| [[a, b], [b, a]]).collect();
        ends.sort_unstable();
        ends.iter().for_each(|[a, _]| self.neighbour_start[*a as usize + 1] += 1);
        (0..count).for_each(|i| self.neighbour_start[i + 1] += self.neighbour_start[i]);
        self.neighbours = ends.into_iter().map(|[_, b]| b).collect();
    }

    /// The points that share an edge with a point.
    fn neighbours(&self, i: u32) -> &[u32] {
        &self.neighbours
            [self.neighbour_start[i as usize] as usize..self.neighbour_start[i as usize + 1] as usize]
    }

    /// Whether the closest point on a triangle, given by its weights, is also the closest among the
    /// neighbouring triangles. If it lies on an edge or corner, a neighbour may have a closer one. This pair
    /// then only obstructs: what slides towards the edge would climb it. `out` points from the triangle to
    /// the other feature.
    pub(super) fn is_locally_closest(
        &self,
        features: &FeaturePair,
        weights: [f64; 4],
        out: Double,
        at: impl Fn(u32) -> Double,
    ) -> bool {
        let corners: Vec<u32> = (1..4).filter(|&k| weights[k] != 0.0).map(|k| features.points[k]).collect();
        if corners.len() == 3 {
            return true;
        }
        let closest: Double = (1..4).map(|k| at(features.points[k]) * -weights[k]).sum();
        let adjacent = self
            .neighbours(corners[0])
            .iter()
            .filter(|i| corners[1..].iter().all(|c| self.neighbours(*c).contains(i)));
        adjacent.into_iter().all(|&i| {
            let edge = at(i) - closest;
            edge.dot(&out) <= FLAT_ANGLE_SINE * edge.norm()
        })
    }

    /// Means of vectors over points and their neighbours, in `passes` passes.
    pub(super) fn smoothed(&self, mut v: Vectors, passes: usize) -> Vectors {
        let mut values = v.to_vec();
        let mut means = values.clone();
        for _ in 0..passes {
            par::fill(&mut means, |i| {
                let neighbours = self.neighbours(i as u32);
                let sum: Vec3 = neighbours.iter().map(|&j| values[j as usize]).sum();
                (values[i] + sum) / (neighbours.len() + 1) as f32
            });
            std::mem::swap(&mut values, &mut means);
        }
        values.iter().enumerate().for_each(|(i, value)| v.set(i, *value));
        v
    }

    /// Sets which points are held together; `reach` [m] is the largest distance that contact looks at.
    pub(super) fn set_seams(&mut self, pairs: &[[u32; 2]], reach: f64) {
        if pairs.is_empty() {
            self.seam = None;
            return;
        }
        let forest = Forest::new(self.rest_positions.len());
        pairs.iter().for_each(|[a, b]| forest.join(*a, *b));
        let root = forest.roots();
        let seam: BTreeSet<u32> = pairs.iter().flatten().copied().collect();
        self.seam = Some(Seam { distance: self.distances_to(&seam, reach), root });
    }

    /// Distances along the edges to the nearest of some points, up to `reach` (Dijkstra's algorithm).
    fn distances_to(&self, sources: &BTreeSet<u32>, reach: f64) -> Vec<f32> {
        let mut neighbours = vec![Vec::new(); self.rest_positions.len()];
        for corners in &self.triangles {
            for k in 0..3 {
                let (a, b) = (corners[k], corners[(k + 1) % 3]);
                neighbours[a as usize].push(b);
                neighbours[b as usize].push(a);
            }
        }
        let mut distance = vec![f32::INFINITY; self.rest_positions.len()];
        // Distances are not negative, so the order of their bits is their order.
        let mut queue: BinaryHeap<Reverse<(u32, u32)>> = sources.iter().map(|&i| Reverse((0, i))).collect();
        sources.iter().for_each(|&i| distance[i as usize] = 0.0);
        while let Some(Reverse((bits, i))) = queue.pop() {
            let so_far = f32::from_bits(bits);
            if so_far > distance[i as usize] {
                continue;
            }
            for &j in &neighbours[i as usize] {
                let length =
                    so_far + (self.rest_positions[i as usize] - self.rest_positions[j as usize]).norm();
                if f64::from(length) < reach && length < distance[j as usize] {
                    distance[j as usize] = length;
                    queue.push(Reverse((length.to_bits(), j)));
                }
            }
        }
        distance
    }

    /// Whether two points are the same, or held together.
    pub(super) fn coincide(&self, a: u32, b: u32) -> bool {
        a == b || self.seam.as_ref().is_some_and(|seam| seam.root[a as usize] == seam.root[b as usize])
    }

    /// The distance at which two features are kept [m], given the thickness of sheets.
    pub(super) fn thickness(&self, features: &FeaturePair, thickness: f64) -> f64 {
        let (first, second) = features.sides();
        let sheet = self.sheet[first[0] as usize];
        let mut out = thickness;
        if sheet == self.sheet[second[0] as usize] {
            let x = features.points.map(|i| self.rest_positions[i as usize].cast());
            out = out.min(self.rest_fraction[sheet as usize] * features.distance(x));
        }
        if let Some(seam) = &self.seam {
            let seam_distance =
                |side: &[u32]| side.iter().map(|&i| seam.distance[i as usize]).fold(f32::INFINITY, f32::min);
            out = out.min(REST_DISTANCE_FRACTION * f64::from(seam_distance(first) + seam_distance(second)));
        }
        out
    }

    /// The normal along which to separate the first of two features that lie in one place. It is the normal
    /// of the sheet with the lowest point index; that feature is pushed to its front. All of a sheet is
    /// therefore pushed the same way.
    pub(super) fn separation_normal(
        &self,
        features: &FeaturePair,
        at: impl Fn(u32) -> Double,
    ) -> Option<Double> {
        let (first, second) = features.sides();
        let lowest = first.iter().chain(second).min().copied()?;
        let [a, b, c] = self.corners(self.of_point[lowest as usize]).map(&at);
        let sign = if first.contains(&lowest) { 1.0 } else { -1.0 };
        (b - a).cross(&(c - a)).try_normalize(0.0).map(|normal| normal * sign)
    }
}

/// The triangles of a sheet. Segments of chains have their second corner twice; points without face or spring
/// have three equal corners.
fn triangulate(model: &Model) -> Vec<[u32; 3]> {
    let mut out = Vec::with_capacity(2 * model.faces.len());
    let far = |a: u32, b: u32| (model.points[a as usize] - model.points[b as usize]).norm();
    for &[a, b, c, d] in &model.faces {
        if c == d {
            out.push([a, b, c]);
        } else if far(a, c) <= far(b, d) {
            out.extend([[a, b, c], [a, c, d]]);
        } else {
            out.extend([[a, b, d], [b, c, d]]);
        }
    }
    let mut used = vec![false; model.points.len()];
    out.iter().flatten().for_each(|&i| used[i as usize] = true);
    let has_face = used.clone();
    let is_bare = |spring: &&Spring| spring.ends.iter().all(|&i| !has_face[i as usize]);
    for [a, b] in model.springs.iter().filter(is_bare).map(|spring| spring.ends) {
        out.push([a, b, b]);
        (used[a as usize], used[b as usize]) = (true, true);
    }
    out.extend((0..used.len() as u32).filter(|&i| !used[i as usize]).map(|i| [i; 3]));
    out
}
