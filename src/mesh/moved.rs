//! A mesh whose vertices are moved, and the way back for those whose triangles fold.
//!
//! Everything but the first judgement works on lists of what has changed, so that the ends of a large surface that need
//! several rounds do not cost several rounds of the whole.

use super::{Mesh, check::Shape, links::Links, pieces::Pieces};
use crate::{math::Vec3, par};

/// A mesh on its way.
pub(super) struct Moved<'a> {
    pub(super) mesh: &'a mut Mesh,
    pub(super) links: &'a Links,
    /// Where the vertices were [m].
    pub(super) before: Vec<Vec3>,
    /// The area-weighted normals of the faces around the vertices where they are now, not normalised [m²].
    pub(super) normals: Vec<Vec3>,
    /// The vertices that were put back.
    pub(super) restored: Vec<bool>,
}

impl<'a> Moved<'a> {
    /// A mesh whose vertices were at `before`.
    pub(super) fn new(mesh: &'a mut Mesh, links: &'a Links, before: Vec<Vec3>) -> Self {
        let normals = links.normals(mesh);
        let restored = vec![false; before.len()];
        Self { mesh, links, before, normals, restored }
    }

    /// Finds the normals of some vertices again.
    pub(super) fn refresh(&mut self, vertices: &[u32]) {
        change(vertices, &mut self.normals, |v, normal| *normal = self.links.normal(self.mesh, v));
    }

    /// Some vertices and those beside them.
    pub(super) fn with_neighbours(&self, vertices: &[u32]) -> Vec<u32> {
        let around = |&v: &u32| self.links.neighbours(self.mesh, v as usize).chain([v]);
        sorted(par::map_chunks(vertices.len(), par::CHUNK, |range| {
            vertices[range].iter().flat_map(around).collect::<Vec<_>>()
        }))
    }

    /// Puts the vertices of triangles that collapsed or look against the surface around them back, until there are none: in
    /// the worst case the mesh is what it was. Only `triangles` are suspects at first.
    pub(super) fn restore(&mut self, triangles: &[u32]) {
        let mut bad = self.bad(triangles);
        while !bad.is_empty() {
            let back = sorted(vec![bad.iter().flat_map(|&t| self.mesh.triangles[t as usize]).collect()]);
            self.put_back(&back);
            // A verdict rests on the normals at the triangle's corners, and these on the vertices beside them.
            let near = self.with_neighbours(&back);
            self.refresh(&near);
            let links = self.links;
            let around = sorted(par::map_chunks(near.len(), par::CHUNK, |range| {
                near[range].iter().flat_map(|&v| links.of(v as usize)).map(|h| h / 3).collect()
            }));
            bad = self.bad(&around);
        }
    }

    /// Puts vertices back to where they were; their normals are to be found again.
    pub(super) fn put_back(&mut self, vertices: &[u32]) {
        for &v in vertices {
            self.mesh.positions[v as usize] = self.before[v as usize];
            self.restored[v as usize] = true;
        }
    }

    /// Those of some triangles that collapsed or look against the surface around them, but for those that were put back
    /// already.
    fn bad(&self, triangles: &[u32]) -> Vec<u32> {
        narrow(triangles, |t| {
            let triangle = self.mesh.triangles[t].map(|v| v as usize);
            let [a, b, c] = triangle.map(|v| self.mesh.positions[v]);
            let normal = (b - a).cross(&(c - a));
            let around = triangle.iter().fold(Vec3::zeros(), |sum, &v| sum + self.normals[v]);
            (normal.dot(&around) <= 0.0 || Shape::of(self.mesh, t) != Shape::Sound)
                && !triangle.iter().all(|&v| self.restored[v])
        })
    }

    /// Moves every piece along its normals so that its volume falls by `surplus`, each vertex by its weight but those that
    /// were put back. A piece that would have to go further than `longest`, because few of its vertices can move or little is
    /// left of it, is put back as a whole. `vertices` and `triangles` are those of all pieces that have a surplus.
    pub(super) fn offset(
        &mut self,
        weights: &[f32],
        pieces: &Pieces,
        [vertices, triangles]: [&[u32]; 2],
        surplus: &[f64],
        longest: f64,
    ) {
        // The normals become the ways of the vertices for a step of one.
        change(vertices, &mut self.normals, |v, way| {
            let normal = way.try_normalize(0.0).filter(|_| !self.restored[v]);
            *way = normal.map_or(Vec3::zeros(), |normal| normal * weights[v]);
        });
        let ways = &self.normals;
        let piece = |i: usize| pieces.of[vertices[i] as usize] as usize;
        let mut heaviest = vec![0.0_f32; surplus.len()];
        let parts = pieces.gather(vertices.len(), piece, |i, most: &mut f32, _| {
            *most = most.max(ways[vertices[i] as usize].norm());
        });
        parts.for_each(|(piece, most)| heaviest[piece] = heaviest[piece].max(most));

        // The volume is a cubic of the step s: its slope is −⅙ Σ (e − s de) × (f − s df) · (da + db + dc) over the triangles
        // with the corners a, b, c, the sides e and f that leave a, and the ways d.
        let mut cubics = vec![[0.0; 3]; surplus.len()];
        let triangle = |i: usize| triangles[i] as usize;
        let of = |i: usize| pieces.of_triangle(self.mesh, triangle(i));
        let parts = pieces.gather(triangles.len(), of, |i, cubic: &mut [f64; 3], _| {
            let triangle = self.mesh.triangles[triangle(i)].map(|v| v as usize);
            let ([a, b, c], [da, db, dc]) =
                (triangle.map(|v| self.mesh.positions[v]), triangle.map(|v| ways[v]));
            let (e, f, de, df, way) = (b - a, c - a, db - da, dc - da, da + db + dc);
            cubic[0] -= f64::from(e.cross(&f).dot(&way));
            cubic[1] += f64::from((de.cross(&f) + e.cross(&df)).dot(&way));
            cubic[2] -= f64::from(de.cross(&df).dot(&way));
        });
        for (piece, part) in parts {
            (0..3).for_each(|k| cubics[piece][k] += part[k] / (6 * (k + 1)) as f64);
        }
        let step = |i: usize| {
            let step = if surplus[i] == 0.0 { 0.0 } else { root(surplus[i], cubics[i]) };
            (step == 0.0 || step.abs() * f64::from(heaviest[i]) <= longest).then_some(step)
        };
        let steps: Vec<Option<f64>> = (0..surplus.len()).map(step).collect();

        // Go it, or go back.
        let step = |v: usize| steps[pieces.of[v] as usize];
        change(vertices, &mut self.restored, |v, restored| *restored |= step(v).is_none());
        change(vertices, &mut self.mesh.positions, |v, x| match step(v) {
            None => *x = self.before[v],
            Some(step) => *x -= self.normals[v] * step as f32,
        });
        self.refresh(vertices);
    }
}

/// The zero of a + b s + c s² + d s³ that Newton's method finds from the linear one; not a number if there is none near.
fn root(a: f64, [b, c, d]: [f64; 3]) -> f64 {
    (0..4).fold(-a / b, |s, _| s - (a + s * (b + s * (c + s * d))) / (b + s * (2.0 * c + s * 3.0 * d)))
}

/// The indices below `count` that are to be kept.
pub(super) fn select(count: usize, keep: impl Fn(usize) -> bool + Sync) -> Vec<u32> {
    let chunk =
        |range: std::ops::Range<usize>| range.filter(|&i| keep(i)).map(|i| i as u32).collect::<Vec<_>>();
    par::map_chunks(count, par::CHUNK, chunk).concat()
}

/// Those of a list that are to be kept.
pub(super) fn narrow(list: &[u32], keep: impl Fn(usize) -> bool + Sync) -> Vec<u32> {
    par::map_chunks(list.len(), par::CHUNK, |range| {
        list[range].iter().copied().filter(|&i| keep(i as usize)).collect::<Vec<_>>()
    })
    .concat()
}

/// Calls `f(i, &mut to[i])` for every `i` of an ascending list.
pub(super) fn change<T: Send>(list: &[u32], to: &mut [T], f: impl Fn(usize, &mut T) + Sync) {
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

/// All of some lists once, in ascending order.
fn sorted(lists: Vec<Vec<u32>>) -> Vec<u32> {
    let mut all = lists.concat();
    par::sort_by_key(&mut all, |&i| i);
    all.dedup();
    all
}
