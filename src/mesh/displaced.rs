//! A mesh with displaced vertices, which unfolds triangles or restores their vertices.
//!
//! Folded triangles are unfolded by the umbrella operator: a patch whose interior vertices are the means of their
//! neighbours has no folds over a convex boundary [tutte63]. Restoring the vertices of the triangles alone would
//! leave them outside of a surface that has moved away.
//!
//! Only the first check covers the whole mesh. Later iterations work on lists of what has changed, so that a
//! large surface with some late corrections costs little.

use super::{Mesh, check::Shape, components::Components, half_edges::HalfEdges};
use crate::{math::Vec3, par};

/// Passes of unfolding of a mesh at most. Folds that are left are restored: on four frames of a splash 24 vertices after 20 passes as
/// after 40, and 37 without any.
const MAX_UNFOLDING_PASSES: usize = 20;

/// Rings of vertices around a folded triangle that are moved with it. One ring leaves more folds around single particles; four
/// take three times as long.
const UNFOLDING_RINGS: usize = 2;

/// Displacement by unfolding from which a vertex stays where it is [spacings]. If it is larger, averaging wears edges.
const MAX_UNFOLDING: f32 = 1.0;

/// A mesh whose vertices are displaced.
pub(super) struct DisplacedMesh<'a> {
    pub(super) mesh: &'a mut Mesh,
    pub(super) half_edges: &'a HalfEdges,
    /// Original positions of the vertices [m].
    pub(super) before: Vec<Vec3>,
    /// Area-weighted normals of the faces around the vertices at their present positions, not normalised
    /// [m²].
    pub(super) normals: Vec<Vec3>,
    /// The vertices restored to their original positions.
    pub(super) restored: Vec<bool>,
    /// Passes of unfolding that are left.
    unfolding_passes: usize,
}

impl<'a> DisplacedMesh<'a> {
    /// A mesh whose vertices were at `before`.
    pub(super) fn new(mesh: &'a mut Mesh, half_edges: &'a HalfEdges, before: Vec<Vec3>) -> Self {
        let normals = half_edges.normals(mesh);
        Self::with_normals(mesh, half_edges, before, normals)
    }

    /// [`DisplacedMesh::new`] with known normals: those of displaced vertices have to be computed again.
    pub(super) fn with_normals(
        mesh: &'a mut Mesh,
        half_edges: &'a HalfEdges,
        before: Vec<Vec3>,
        normals: Vec<Vec3>,
    ) -> Self {
        let restored = vec![false; before.len()];
        Self { mesh, half_edges, before, normals, restored, unfolding_passes: MAX_UNFOLDING_PASSES }
    }

    /// Computes the normals of some vertices again.
    pub(super) fn refresh(&mut self, vertices: &[u32]) {
        update_at(vertices, &mut self.normals, |v, normal| *normal = self.half_edges.normal(self.mesh, v));
    }

    /// Some vertices and their neighbours.
    pub(super) fn with_neighbours(&self, vertices: &[u32]) -> Vec<u32> {
        let around = |&v: &u32| self.half_edges.neighbours(self.mesh, v as usize).chain([v]);
        sorted(par::map_chunks(vertices.len(), par::CHUNK, |range| {
            vertices[range].iter().flat_map(around).collect::<Vec<_>>()
        }))
    }

    /// Unfolds triangles that collapsed or are flipped relative to the surface around them, and restores the
    /// vertices of those that stay folded, until there are none. In the worst case the mesh is the original one.
    /// Only `triangles` are checked at first. Vertices of weight 0 are not moved.
    pub(super) fn unfold(&mut self, triangles: &[u32], weights: &[f32], spacing: f32) {
        let mut folded = self.folded(triangles);
        if folded.is_empty() {
            return;
        }
        let start = self.mesh.positions.clone();
        let longest2 = (MAX_UNFOLDING * spacing).powi(2);
        while !folded.is_empty() && self.unfolding_passes > 0 {
            self.unfolding_passes -= 1;
            let mut patch = self.corners(&folded);
            for _ in 0..UNFOLDING_RINGS {
                patch = self.with_neighbours(&patch);
            }
            let patch = retain(&patch, |v| {
                let is_near = (self.mesh.positions[v] - start[v]).norm_squared() < longest2;
                weights[v] > 0.0 && !self.restored[v] && is_near
            });
            self.average(&patch);
            let around = self.refresh_around(&patch);
            folded = self.folded(&sorted(vec![around, folded]));
        }
        while !folded.is_empty() {
            let restored_now = self.corners(&folded);
            self.restore_vertices(&restored_now);
            let around = self.refresh_around(&restored_now);
            folded = self.folded(&around);
        }
    }

    /// Restores vertices of triangles that collapsed or are flipped, of these `triangles` at first, and those around them, until
    /// none is that was not before. In the worst case the mesh is the original one.
    pub(super) fn restore(&mut self, triangles: &[u32]) {
        let mut folded = retain(triangles, |t| self.is_folded(t));
        while !folded.is_empty() {
            let around = retain(&self.with_neighbours(&self.corners(&folded)), |v| !self.restored[v]);
            if around.is_empty() {
                break;
            }
            self.restore_vertices(&around);
            folded.extend(self.refresh_around(&around));
            folded = retain(&sorted(vec![folded]), |t| self.is_folded(t));
        }
    }

    /// The corners of some triangles.
    fn corners(&self, triangles: &[u32]) -> Vec<u32> {
        sorted(vec![triangles.iter().flat_map(|&t| self.mesh.triangles[t as usize]).collect()])
    }

    /// Moves vertices to the means of their neighbours.
    fn average(&mut self, vertices: &[u32]) {
        let mean = |&v: &u32| {
            let (sum, count) = self
                .half_edges
                .neighbours(self.mesh, v as usize)
                .fold((Vec3::zeros(), 0), |(sum, n), j| (sum + self.mesh.positions[j as usize], n + 1));
            sum / count as f32
        };
        let means = par::map_chunks(vertices.len(), par::CHUNK, |range| {
            vertices[range].iter().map(mean).collect::<Vec<_>>()
        });
        for (&v, mean) in vertices.iter().zip(means.into_iter().flatten()) {
            self.mesh.positions[v as usize] = mean;
        }
    }

    /// Computes the normals around moved vertices again, and returns the triangles whose checks this affects.
    fn refresh_around(&mut self, moved: &[u32]) -> Vec<u32> {
        // The check of a triangle depends on the normals at its corners, and these on the neighbouring vertices.
        let near = self.with_neighbours(moved);
        self.refresh(&near);
        self.triangles_of(&near)
    }

    /// The triangles of some vertices.
    pub(super) fn triangles_of(&self, vertices: &[u32]) -> Vec<u32> {
        let half_edges = self.half_edges;
        sorted(par::map_chunks(vertices.len(), par::CHUNK, |range| {
            vertices[range].iter().flat_map(|&v| half_edges.of(v as usize)).map(|h| h.triangle()).collect()
        }))
    }

    /// Restores vertices to their original positions; their normals have to be computed again.
    pub(super) fn restore_vertices(&mut self, vertices: &[u32]) {
        for &v in vertices {
            self.mesh.positions[v as usize] = self.before[v as usize];
            self.restored[v as usize] = true;
        }
    }

    /// Moves vertices back to their original positions until only a part of their displacement is left, and computes
    /// their normals again. Those of which none is left are restored.
    pub(super) fn restore_parts(&mut self, vertices: &[u32], kept: impl Fn(usize) -> f32 + Sync) {
        update_at(vertices, &mut self.mesh.positions, |v, x| {
            let kept = kept(v);
            *x = if kept == 0.0 { self.before[v] } else { self.before[v] + (*x - self.before[v]) * kept };
        });
        update_at(vertices, &mut self.restored, |v, restored| *restored |= kept(v) == 0.0);
        self.refresh(vertices);
    }

    /// Selects triangles that collapsed or are flipped relative to the surface around them, without
    /// those that are already restored.
    fn folded(&self, triangles: &[u32]) -> Vec<u32> {
        retain(triangles, |t| {
            self.is_folded(t) && !self.mesh.triangles[t].iter().all(|&v| self.restored[v as usize])
        })
    }

    fn is_folded(&self, t: usize) -> bool {
        let triangle = self.mesh.triangles[t].map(|v| v as usize);
        let [a, b, c] = triangle.map(|v| self.mesh.positions[v]);
        let normal = (b - a).cross(&(c - a));
        let around = triangle.iter().fold(Vec3::zeros(), |sum, &v| sum + self.normals[v]);
        normal.dot(&around) <= 0.0 || Shape::of(&self.mesh.positions, self.mesh.triangles[t]) != Shape::Sound
    }

    /// Offsets every component along its normals so that its volume decreases by `surplus`, each vertex by
    /// its weight; restored vertices stay. A component that would have to move further than `longest`,
    /// because few of its vertices can move or little of it is left, is restored completely. `vertices` and
    /// `triangles` are those of all components with a surplus.
    pub(super) fn offset(
        &mut self,
        weights: &[f32],
        components: &Components,
        [vertices, triangles]: [&[u32]; 2],
        surplus: &[f64],
        longest: f64,
    ) {
        // The normals become the displacements of the vertices for a step of one.
        update_at(vertices, &mut self.normals, |v, displacement| {
            let normal = displacement.try_normalize(0.0).filter(|_| !self.restored[v]);
            *displacement = normal.map_or(Vec3::zeros(), |normal| normal * weights[v]);
        });
        let displacements = &self.normals;
        let component = |i: usize| components.of[vertices[i] as usize] as usize;
        let mut largest_displacement = vec![0.0_f32; surplus.len()];
        let parts = components.gather(vertices.len(), component, |i, largest: &mut f32, _| {
            *largest = largest.max(displacements[vertices[i] as usize].norm());
        });
        parts.for_each(|(component, largest)| {
            largest_displacement[component] = largest_displacement[component].max(largest)
        });

        // The volume is a cubic of the step s. Its slope is −⅙ Σ (e − s de) × (f − s df) · (da + db + dc)
        // over the triangles with the corners a, b, c, the sides e and f that leave a, and the displacements
        // d.
        let mut cubics = vec![[0.0; 3]; surplus.len()];
        let triangle = |i: usize| triangles[i] as usize;
        let of = |i: usize| components.of_triangle(self.mesh, triangle(i));
        let parts = components.gather(triangles.len(), of, |i, cubic: &mut [f64; 3], _| {
            let triangle = self.mesh.triangles[triangle(i)].map(|v| v as usize);
            let ([a, b, c], [da, db, dc]) =
                (triangle.map(|v| self.mesh.positions[v]), triangle.map(|v| displacements[v]));
            let (e, f, de, df, displacement) = (b - a, c - a, db - da, dc - da, da + db + dc);
            cubic[0] -= f64::from(e.cross(&f).dot(&displacement));
            cubic[1] += f64::from((de.cross(&f) + e.cross(&df)).dot(&displacement));
            cubic[2] -= f64::from(de.cross(&df).dot(&displacement));
        });
        for (component, part) in parts {
            (0..3).for_each(|k| cubics[component][k] += part[k] / (6 * (k + 1)) as f64);
        }
        let step = |i: usize| {
            let step = if surplus[i] == 0.0 { 0.0 } else { root(surplus[i], cubics[i]) };
            (step == 0.0 || step.abs() * f64::from(largest_displacement[i]) <= longest).then_some(step)
        };
        let steps: Vec<Option<f64>> = (0..surplus.len()).map(step).collect();

        // Take the step, or restore the component.
        let step = |v: usize| steps[components.of[v] as usize];
        update_at(vertices, &mut self.restored, |v, restored| *restored |= step(v).is_none());
        update_at(vertices, &mut self.mesh.positions, |v, x| match step(v) {
            None => *x = self.before[v],
            Some(step) => *x -= self.normals[v] * step as f32,
        });
        self.refresh(vertices);
    }
}

/// The root of a + b s + c s² + d s³ by Newton's method from the linear one; NaN if there is none near.
fn root(a: f64, [b, c, d]: [f64; 3]) -> f64 {
    (0..4).fold(-a / b, |s, _| s - (a + s * (b + s * (c + s * d))) / (b + s * (2.0 * c + s * 3.0 * d)))
}

/// The indices below `count` that `keep` selects.
pub(super) fn select(count: usize, keep: impl Fn(usize) -> bool + Sync) -> Vec<u32> {
    let chunk =
        |range: std::ops::Range<usize>| range.filter(|&i| keep(i)).map(|i| i as u32).collect::<Vec<_>>();
    par::map_chunks(count, par::CHUNK, chunk).concat()
}

/// The entries of a list that `keep` selects.
pub(super) fn retain(list: &[u32], keep: impl Fn(usize) -> bool + Sync) -> Vec<u32> {
    par::map_chunks(list.len(), par::CHUNK, |range| {
        list[range].iter().copied().filter(|&i| keep(i as usize)).collect::<Vec<_>>()
    })
    .concat()
}

/// Calls `f(i, &mut to[i])` for every `i` of an ascending list.
pub(super) fn update_at<T: Send>(list: &[u32], to: &mut [T], f: impl Fn(usize, &mut T) + Sync) {
    let chunks = list.len().div_ceil(par::CHUNK);
    let first = |chunk: usize| if chunk == 0 { 0 } else { list[chunk * par::CHUNK] as usize };
    let mut ends: Vec<usize> = (1..chunks).map(first).collect();
    ends.push(to.len());
    par::for_parts(to, &ends, 1, |chunk, part| {
        for &i in list.iter().skip(chunk * par::CHUNK).take(par::CHUNK) {
            f(i as usize, &mut part[i as usize - first(chunk)]);
        }
    });
}

/// The union of some lists, in ascending order.
fn sorted(lists: Vec<Vec<u32>>) -> Vec<u32> {
    let mut all = lists.concat();
    par::sort_by_key(&mut all, |&i| i);
    all.dedup();
    all
}
