//! Mesh decimation by edge collapse; the mesh stays closed, manifold and oriented.
//!
//! *Method* [garland97]: every vertex sums the squared distances to the planes of the faces it represents,
//! weighted by their areas, Q(x) = Σ A (n·x + d)². The edge whose optimal joint vertex has the smallest Q₁ +
//! Q₂ collapses first.
//! *Departs from the paper*: an edge collapses only under the link condition [dey99], if no triangle around
//! it turns by more than [`MIN_TURN_COSINE`] or becomes a sliver. Only edges of the mesh are candidates, not
//! pairs of near vertices. A small attraction to the middle of the edge ([`MIDDLE_WEIGHT`]) decides where the
//! planes do not.
//!
//! One thread, one heap: edges collapse in the order of their costs, ties by number, so that the result
//! depends on the mesh alone. O(n log n).
//!
//! Half-edges: h runs in its triangle to the next vertex, `twin[h]` the opposite direction in the neighbour.
//! The collapse u → v assigns u's triangles to v, removes the two triangles of the edge, and makes the outer
//! sides of each twins.
//!
//! Limits: a refused edge is tried again only if something at its ends has changed. The error is a mean over
//! the planes of the faces that a vertex represents, not a bound on the distance of the surfaces.

use super::{
    DecimationParams, Mesh,
    half_edges::{HalfEdge, HalfEdges},
};
use crate::par;
use std::{cmp::Reverse, collections::BinaryHeap};

type Vec3d = nalgebra::Vector3<f64>;

/// Smallest cosine between a triangle's normals before and after a collapse. Smaller lets the surface fold
/// within a few collapses; larger keeps unnecessary triangles.
const MIN_TURN_COSINE: f64 = 0.5;

/// Smallest height of a triangle over its longest side, unless the collapse improves it. Smaller admits
/// needles, whose normals are rounding errors; larger refuses the triangles of marching cubes near nodes.
const MIN_HEIGHT_RATIO: f64 = 0.02;

/// Weight of the attraction to the middle of the edge, relative to the quadric's own: where the surface is
/// flat it keeps vertices from sliding along it. Larger shows as error on curved parts: at 1e-3, 3 % of the
/// quadric's.
const MIDDLE_WEIGHT: f64 = 1e-3;

/// Index of no vertex.
const NONE: u32 = u32::MAX;

/// Result of a decimation.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
#[non_exhaustive]
pub struct DecimationStats {
    /// Triangles before decimation.
    pub before: usize,
    /// Triangles after decimation.
    pub after: usize,
    /// Collapses refused because the mesh would not have stayed manifold, or a triangle would have folded.
    pub refused: usize,
    /// Largest error of a collapse: root mean square distance from the planes [m].
    pub largest_error: f64,
    /// Triangles left above the target because no further collapse was allowed; 0 with an error bound, which
    /// then decides.
    pub over_target: usize,
    /// Whether the mesh is unchanged because it is open or not manifold.
    pub unsuitable: bool,
}

/// Collapses edges of `mesh`, which has neither normals nor attributes yet, until the target number of
/// triangles is reached or every further collapse would exceed an error of `params.error` spacings.
pub fn decimate(mesh: &mut Mesh, params: &DecimationParams, spacing: f32) -> DecimationStats {
    let before = mesh.triangles.len();
    let mut stats = DecimationStats { before, after: before, ..DecimationStats::default() };
    let part = (f64::from(params.fraction) * before as f64) as usize;
    let target = params.triangles.map_or(part, |max| part.min(max as usize));
    if target >= before {
        return stats;
    }
    let Some(mut shape) = Shape::new(mesh) else {
        return DecimationStats { unsuitable: true, ..stats };
    };
    let bound = params.error.map_or(f64::INFINITY, |error| f64::from(error) * f64::from(spacing));

    // Queue every edge by its cost.
    let mut ages = vec![0_u32; 3 * before];
    let queued = par::map_chunks(3 * before, par::CHUNK, |range| {
        let edges = range.map(|h| HalfEdge(h as u32)).filter(|&h| h < shape.twin[h.at()]);
        edges.map(|h| Reverse((shape.candidate(h).cost, h, 0))).collect::<Vec<_>>()
    });
    let mut queue = BinaryHeap::from(queued.concat());

    // Collapse the cheapest edge, and queue the edges it changed again.
    let mut around = Vec::new();
    while stats.after > target {
        let Some(Reverse((_, h, age))) = queue.pop() else { break };
        if ages[h.at()] != age || !shape.is_edge(h) {
            continue;
        }
        let candidate = shape.candidate(h);
        if candidate.error > bound {
            continue;
        }
        if !shape.allows(h, candidate.place) {
            stats.refused += 1;
            continue;
        }
        let v = shape.collapse(h, candidate.place);
        stats.after -= 2;
        stats.largest_error = stats.largest_error.max(candidate.error);
        shape.half_edges_from(v, &mut around);
        for &h in &around {
            let edge = h.min(shape.twin[h.at()]);
            ages[edge.at()] += 1;
            queue.push(Reverse((shape.candidate(edge).cost, edge, ages[edge.at()])));
        }
    }
    if params.error.is_none() {
        stats.over_target = stats.after.saturating_sub(target);
    }
    shape.write(mesh);
    stats
}

/// A mesh whose edges can collapse.
struct Shape {
    /// The vertex each half-edge leaves; `NONE` in removed triangles.
    from: Vec<u32>,
    /// The half-edge in the opposite direction.
    twin: Vec<HalfEdge>,
    /// A half-edge that leaves each vertex; `NONE` for removed vertices.
    out: Vec<HalfEdge>,
    /// Vertex positions as they will be written [m].
    positions: Vec<crate::math::Vec3>,
    /// Origin of all distances [m].
    origin: Vec3d,
    quadrics: Vec<Quadric>,
}

/// Position of the joint vertex of a collapse, and its cost.
struct Candidate {
    place: crate::math::Vec3,
    /// Bits of Q [m⁴] in single precision, which have the order of the numbers.
    cost: u32,
    /// √(Q/Σ A) [m].
    error: f64,
}

impl Shape {
    /// The half-edges of a mesh; `None` unless it is closed, manifold and oriented.
    fn new(mesh: &Mesh) -> Option<Self> {
        let half_edges = HalfEdges::new(mesh, |_| true);
        let from: Vec<u32> = mesh.triangles.iter().flatten().copied().collect();
        let mut twin = vec![HalfEdge::NONE; from.len()];
        par::fill(&mut twin, |h| {
            let (a, b) = (from[h], from[HalfEdge(h as u32).next().at()]);
            let mut back = half_edges.of(b as usize).iter().filter(|&&g| from[g.next().at()] == a);
            let twice = half_edges.of(a as usize).iter().filter(|&&g| from[g.next().at()] == b).count() > 1;
            match (back.next(), back.next()) {
                (Some(&g), None) if !twice => g,
                _ => HalfEdge::NONE,
            }
        });
        let out: Vec<HalfEdge> = (0..mesh.positions.len())
            .map(|v| half_edges.of(v).first().copied().unwrap_or(HalfEdge::NONE))
            .collect();
        let origin = mesh.positions.first().map_or(Vec3d::zeros(), |x| x.cast());
        let mut shape =
            Self { from, twin, out, positions: mesh.positions.clone(), origin, quadrics: Vec::new() };
        if shape.twin.contains(&HalfEdge::NONE) {
            return None;
        }
        // One fan around every vertex.
        let fans = par::map_chunks(shape.out.len(), par::CHUNK, |mut range| {
            let mut fan = Vec::new();
            range.all(|v| {
                fan.clear();
                if shape.out[v] != HalfEdge::NONE {
                    shape.half_edges_from(v as u32, &mut fan);
                }
                fan.len() == half_edges.of(v).len()
            })
        });
        if fans.contains(&false) {
            return None;
        }
        let mut quadrics = vec![Quadric::default(); shape.out.len()];
        par::fill(&mut quadrics, |v| {
            half_edges.of(v).iter().fold(Quadric::default(), |sum, &h| sum + shape.plane(h))
        });
        shape.quadrics = quadrics;
        Some(shape)
    }

    fn to(&self, h: HalfEdge) -> u32 {
        self.from[h.next().at()]
    }

    fn at(&self, v: u32) -> Vec3d {
        self.positions[v as usize].cast::<f64>() - self.origin
    }

    /// Whether `h` exists and is the lower half-edge of its edge.
    fn is_edge(&self, h: HalfEdge) -> bool {
        self.from[h.at()] != NONE && h < self.twin[h.at()]
    }

    /// The half-edges that leave `v`, in order around it.
    fn half_edges_from(&self, v: u32, around: &mut Vec<HalfEdge>) {
        around.clear();
        let first = self.out[v as usize];
        let mut h = first;
        loop {
            around.push(h);
            h = self.twin[h.previous().at()];
            if h == first {
                return;
            }
        }
    }

    /// The quadric of the triangle of `h`.
    fn plane(&self, h: HalfEdge) -> Quadric {
        let [a, b, c] = [h, h.next(), h.previous()].map(|h| self.at(self.from[h.at()]));
        let normal = (b - a).cross(&(c - a));
        let double_area = normal.norm();
        if double_area > 0.0 {
            Quadric::plane(normal / double_area, a, 0.5 * double_area)
        } else {
            Quadric::default()
        }
    }

    /// The result of collapsing the edge of `h`.
    fn candidate(&self, h: HalfEdge) -> Candidate {
        let (u, v) = (self.from[h.at()], self.to(h));
        let sum = self.quadrics[u as usize] + self.quadrics[v as usize];
        let middle = (self.at(u) + self.at(v)) * 0.5;
        let best = sum.minimum(middle).unwrap_or(middle);
        // A distant minimum belongs to nearly parallel planes; the middle suits them as well.
        let length = (self.at(u) - self.at(v)).norm();
        let best = if (best - middle).norm() <= length { best } else { middle };
        let place = (best + self.origin).cast::<f32>();
        let value = sum.value(place.cast::<f64>() - self.origin).max(0.0);
        let error = (value / sum.area.max(f64::MIN_POSITIVE)).sqrt();
        Candidate { place, cost: (value as f32).to_bits(), error }
    }

    /// Whether the mesh stays manifold and no triangle folds or becomes a sliver if the edge of `h` collapses
    /// to `place`.
    fn allows(&self, h: HalfEdge, place: crate::math::Vec3) -> bool {
        let g = self.twin[h.at()];
        let (u, v) = (self.from[h.at()], self.from[g.at()]);
        let (mut of_u, mut of_v) = (Vec::with_capacity(16), Vec::with_capacity(16));
        self.half_edges_from(u, &mut of_u);
        self.half_edges_from(v, &mut of_v);

        // The link condition: u and v have the two opposite corners as common neighbours, and no others …
        let common = of_u.iter().filter(|&&i| of_v.iter().any(|&j| self.to(i) == self.to(j))).count();
        if common != 2 {
            return false;
        }
        // … and the opposite corners keep three neighbours.
        let mut opposite = Vec::with_capacity(16);
        for corner in [h.previous(), g.previous()] {
            self.half_edges_from(self.from[corner.at()], &mut opposite);
            if opposite.len() < 4 {
                return false;
            }
        }

        // Every remaining triangle keeps its orientation and its shape.
        let place = place.cast::<f64>() - self.origin;
        let remains = |&&i: &&HalfEdge| i.triangle() != h.triangle() && i.triangle() != g.triangle();
        of_u.iter().chain(&of_v).filter(remains).all(|&i| {
            let [a, b, c] = [i, i.next(), i.previous()].map(|i| self.at(self.from[i.at()]));
            let (old, new) = ((b - a).cross(&(c - a)), (b - place).cross(&(c - place)));
            let longest =
                |a: Vec3d| (b - a).norm_squared().max((c - a).norm_squared()).max((c - b).norm_squared());
            let (was, is) = (old.norm() / longest(a), new.norm() / longest(place));
            new.dot(&old) > MIN_TURN_COSINE * new.norm() * old.norm() && (is > MIN_HEIGHT_RATIO || is > was)
        })
    }

    /// Joins the ends of `h` at `place`; returns the remaining vertex.
    fn collapse(&mut self, h: HalfEdge, place: crate::math::Vec3) -> u32 {
        let g = self.twin[h.at()];
        let (u, v) = (self.from[h.at()], self.from[g.at()]);
        let mut of_u = Vec::with_capacity(16);
        self.half_edges_from(u, &mut of_u);
        for i in of_u {
            self.from[i.at()] = v;
        }
        for side in [h, g] {
            // The outer sides of a removed triangle become twins of each other.
            let (after, before) = (self.twin[side.next().at()], self.twin[side.previous().at()]);
            self.twin[after.at()] = before;
            self.twin[before.at()] = after;
            for i in [after, before] {
                self.out[self.from[i.at()] as usize] = i;
            }
            for i in [side, side.next(), side.previous()] {
                self.from[i.at()] = NONE;
            }
        }
        self.out[u as usize] = HalfEdge::NONE;
        self.positions[v as usize] = place;
        self.quadrics[v as usize] = self.quadrics[v as usize] + self.quadrics[u as usize];
        v
    }

    /// Writes the remaining mesh, in the original order.
    fn write(self, mesh: &mut Mesh) {
        let mut number = vec![NONE; self.out.len()];
        mesh.positions.clear();
        for (v, &out) in self.out.iter().enumerate() {
            if out != HalfEdge::NONE {
                number[v] = mesh.positions.len() as u32;
                mesh.positions.push(self.positions[v]);
            }
        }
        let left = self.from.as_chunks::<3>().0.iter().filter(|triangle| triangle[0] != NONE);
        mesh.triangles = left.map(|triangle| triangle.map(|v| number[v as usize])).collect();
    }
}

/// Q(x) = xᵀ A x + 2 b·x + c, area-weighted squared distance to planes [m⁴].
#[derive(Clone, Copy, Debug, Default)]
struct Quadric {
    /// A: xx, yy, zz, xy, xz, yz [m²].
    a: [f64; 6],
    /// b [m³].
    b: Vec3d,
    /// c [m⁴].
    c: f64,
    /// Σ area [m²].
    area: f64,
}

impl Quadric {
    /// The quadric of the plane through `x` with unit normal `n`.
    fn plane(n: Vec3d, x: Vec3d, area: f64) -> Self {
        let d = -n.dot(&x);
        let a = [n.x * n.x, n.y * n.y, n.z * n.z, n.x * n.y, n.x * n.z, n.y * n.z];
        Self { a: a.map(|v| area * v), b: n * (area * d), c: area * d * d, area }
    }

    fn product(&self, x: Vec3d) -> Vec3d {
        let [xx, yy, zz, xy, xz, yz] = self.a;
        Vec3d::new(
            xx * x.x + xy * x.y + xz * x.z,
            xy * x.x + yy * x.y + yz * x.z,
            xz * x.x + yz * x.y + zz * x.z,
        )
    }

    fn value(&self, x: Vec3d) -> f64 {
        x.dot(&self.product(x)) + 2.0 * self.b.dot(&x) + self.c
    }

    /// Minimum of Q with the attraction to `middle`.
    fn minimum(&self, middle: Vec3d) -> Option<Vec3d> {
        // (A + p) (x − middle) = −(A middle + b), symmetric and positive definite.
        let right = -(self.product(middle) + self.b);
        let pull = MIDDLE_WEIGHT * self.area;
        let [xx, yy, zz, xy, xz, yz] = self.a;
        let [xx, yy, zz] = [xx + pull, yy + pull, zz + pull];
        let (c_x, c_y, c_z) = (yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy);
        let determinant = xx * c_x + xy * c_y + xz * c_z;
        let inverse = [
            Vec3d::new(c_x, c_y, c_z),
            Vec3d::new(c_y, xx * zz - xz * xz, xy * xz - xx * yz),
            Vec3d::new(c_z, xy * xz - xx * yz, xx * yy - xy * xy),
        ];
        let step = Vec3d::from(inverse.map(|row| row.dot(&right))) / determinant;
        step.iter().all(|v| v.is_finite()).then(|| middle + step)
    }
}

impl std::ops::Add for Quadric {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            a: std::array::from_fn(|i| self.a[i] + other.a[i]),
            b: self.b + other.b,
            c: self.c + other.c,
            area: self.area + other.area,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_minimum_of_three_planes_is_their_intersection() {
        let x = Vec3d::new(0.3, -2.0, 5.0);
        let normals = [Vec3d::x(), Vec3d::new(0.6, 0.8, 0.0), Vec3d::new(0.0, 0.6, -0.8)];
        let sum = normals.iter().fold(Quadric::default(), |sum, &n| sum + Quadric::plane(n, x, 2.0));
        assert!(sum.value(x).abs() < 1e-12 && (sum.area - 6.0).abs() < 1e-12);
        let off = x + Vec3d::new(0.1, 0.0, 0.0);
        assert!((sum.value(off) - 2.0 * (0.01 + 0.0036)).abs() < 1e-12);
        let found = sum.minimum(off).unwrap();
        assert!((found - x).norm() < 0.02, "the attraction moves it a little: {found}");
        assert!(
            (Quadric::plane(Vec3d::z(), x, 1.0).minimum(off).unwrap() - off).norm() < 1e-9,
            "a flat part does not move"
        );
    }
}
