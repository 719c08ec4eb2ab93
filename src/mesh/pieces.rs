//! The pieces of a mesh: which vertex belongs to which, their volumes, and removal of the small ones.
//!
//! *Method*: union-find over the triangles; volume V = ⅙ Σ a·(b × c) and its centre Σ (a + b + c)/4 · ⅙ a·(b × c) / V
//! by the divergence theorem, measured from the piece's first vertex. A removed piece becomes a point at its centre
//! with the radius of the ball of its volume, r = ∛(3V/4π).
//!
//! A surface that looks inward bounds a bubble: its volume is negative. Small bubbles are filled, and give no point.
//! A removed piece takes its bubbles with it, because they are smaller than it is. A piece without volume, which rounding
//! has flattened far from the origin, becomes a point of radius 0 at its first vertex.

use super::{ComponentParams, Mesh};
use crate::{frame::Channel, math::Vec3, par};
use std::f64::consts::PI;

/// Of less than this part of the least volume that stays, the sign is rounding and tells no bubble from a drop. Larger,
/// and bubbles of a sane size become points.
const FLAT: f64 = 1e-9;

/// Small pieces as points.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Points {
    /// Centres of volume [m].
    pub positions: Vec<Vec3>,
    /// Radii of the balls of the same volumes [m].
    pub radii: Vec<f32>,
    /// What the vertices of the mesh carry too.
    pub attributes: Vec<Channel>,
}

/// What the removal of small pieces did.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct ComponentStats {
    /// Pieces that became points.
    pub points: usize,
    /// Their volume [m³].
    pub points_volume: f64,
    /// Bubbles that were filled, or went with the piece around them.
    pub bubbles: usize,
    /// Their volume [m³].
    pub bubbles_volume: f64,
    /// Triangles removed.
    pub triangles: usize,
}

/// The pieces of a mesh, numbered by their first vertices.
pub(super) struct Pieces {
    /// The piece of every vertex.
    pub(super) of: Vec<u32>,
    /// The first vertex of every piece.
    pub(super) first: Vec<u32>,
}

impl Pieces {
    /// The pieces of all triangles of `mesh`.
    pub(super) fn new(mesh: &Mesh) -> Self {
        Self::of_triangles(mesh, |_| true)
    }

    /// The pieces of the triangles that `counts`; a vertex that none of them has is a piece by itself.
    pub(super) fn of_triangles(mesh: &Mesh, counts: impl Fn(usize) -> bool + Sync) -> Self {
        let forest = par::Forest::new(mesh.positions.len());
        par::map_chunks(mesh.triangles.len(), par::CHUNK, |range| {
            for [a, b, c] in range.filter(|&t| counts(t)).map(|t| mesh.triangles[t]) {
                forest.join(a, b);
                forest.join(a, c);
            }
        });
        // A root is the lowest vertex of its piece, so it has its number before the others ask for it.
        let mut of = forest.roots();
        let mut first = Vec::new();
        for v in 0..of.len() {
            if of[v] as usize == v {
                of[v] = first.len() as u32;
                first.push(v as u32);
            } else {
                of[v] = of[of[v] as usize];
            }
        }
        Self { of, first }
    }

    /// The volume [m³] and its first moment about the piece's first vertex [m⁴], of every piece.
    fn moments(&self, mesh: &Mesh) -> Vec<Moments> {
        let mut sums = vec![Moments::default(); self.first.len()];
        let parts = self.gather(
            mesh.triangles.len(),
            |t| self.of_triangle(mesh, t),
            |t, sum: &mut Moments, piece| {
                let [a, b, c] = self.corners(mesh, t, piece);
                let volume = a.dot(&b.cross(&c)) / 6.0;
                sum.volume += volume;
                sum.first += (a + b + c) * (0.25 * volume);
            },
        );
        for (piece, part) in parts {
            sums[piece].volume += part.volume;
            sums[piece].first += part.first;
        }
        sums
    }

    /// The volume [m³] of every piece that has some of these triangles, as far as they bound it; 0 of the others.
    pub(super) fn volumes(&self, mesh: &Mesh, triangles: &[u32]) -> Vec<f64> {
        let mut sums = vec![0.0; self.first.len()];
        let triangle = |i: usize| triangles[i] as usize;
        let of = |i: usize| self.of_triangle(mesh, triangle(i));
        let parts = self.gather(triangles.len(), of, |i, sum: &mut f64, piece| {
            let [a, b, c] = self.corners(mesh, triangle(i), piece);
            *sum += a.dot(&b.cross(&c)) / 6.0;
        });
        parts.for_each(|(piece, part)| sums[piece] += part);
        sums
    }

    /// The corners of a triangle, from the piece's first vertex [m].
    #[inline]
    pub(super) fn corners(&self, mesh: &Mesh, t: usize, piece: usize) -> [nalgebra::Vector3<f64>; 3] {
        let origin = mesh.positions[self.first[piece] as usize].cast::<f64>();
        mesh.triangles[t].map(|v| mesh.positions[v as usize].cast::<f64>() - origin)
    }

    /// The piece of a triangle.
    pub(super) fn of_triangle(&self, mesh: &Mesh, t: usize) -> usize {
        self.of[mesh.triangles[t][0] as usize] as usize
    }

    /// Sums over `i` in `0..count`, of every run of equal pieces within a chunk: to be folded as they come.
    pub(super) fn gather<T: Default + Send>(
        &self,
        count: usize,
        piece: impl Fn(usize) -> usize + Sync,
        add: impl Fn(usize, &mut T, usize) + Sync,
    ) -> impl Iterator<Item = (usize, T)> {
        par::map_chunks(count, par::CHUNK, |range| {
            let mut runs = Vec::new();
            let mut run = (piece(range.start), T::default());
            for i in range {
                let piece = piece(i);
                if run.0 != piece {
                    runs.push(std::mem::replace(&mut run, (piece, T::default())));
                }
                add(i, &mut run.1, piece);
            }
            runs.push(run);
            runs
        })
        .into_iter()
        .flatten()
    }
}

/// A piece's volume [m³] and its first moment about the piece's first vertex [m⁴].
#[derive(Clone, Copy, Debug, Default)]
struct Moments {
    volume: f64,
    first: nalgebra::Vector3<f64>,
}

/// Takes the pieces below `params.smallest` volumes of a particle out of `mesh`, which has neither normals nor
/// attributes yet, and returns them as points.
pub fn remove_small(mesh: &mut Mesh, params: &ComponentParams, spacing: f32) -> (Points, ComponentStats) {
    let pieces = Pieces::new(mesh);
    let moments = pieces.moments(mesh);
    let least = f64::from(params.smallest) * f64::from(spacing).powi(3);
    let small: Vec<bool> = moments.iter().map(|moments| moments.volume.abs() < least).collect();

    // Make points of them, in the order of their first vertices.
    let (mut points, mut stats) = (Points::default(), ComponentStats::default());
    for (piece, &Moments { volume, first: moment }) in
        moments.iter().enumerate().filter(|&(piece, _)| small[piece])
    {
        if volume < -FLAT * least {
            stats.bubbles += 1;
            stats.bubbles_volume -= volume;
            continue;
        }
        let first = mesh.positions[pieces.first[piece] as usize].cast::<f64>();
        let (from_first, volume) =
            if volume > FLAT * least { (moment / volume, volume) } else { (nalgebra::Vector3::zeros(), 0.0) };
        points.positions.push((first + from_first).cast());
        points.radii.push((volume * 0.75 / PI).cbrt() as f32);
        stats.points += 1;
        stats.points_volume += volume;
    }

    // Keep the others, in their order.
    let goes = |v: u32| small[pieces.of[v as usize] as usize];
    let before = mesh.triangles.len();
    mesh.triangles.retain(|triangle| !goes(triangle[0]));
    stats.triangles = before - mesh.triangles.len();
    let mut number = vec![0; mesh.positions.len()];
    let mut kept = Vec::new();
    for (v, &x) in mesh.positions.iter().enumerate() {
        if !goes(v as u32) {
            number[v] = kept.len() as u32;
            kept.push(x);
        }
    }
    mesh.positions = kept;
    par::update(&mut mesh.triangles, |_, triangle| *triangle = triangle.map(|v| number[v as usize]));
    (points, stats)
}
