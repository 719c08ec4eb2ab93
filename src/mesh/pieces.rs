//! The pieces of a mesh: which vertex belongs to which, their volumes, and removal of the small ones.
//!
//! *Method*: union-find over the triangles; volume V = ⅙ Σ a·(b × c) and its centre Σ (a + b + c)/4 · ⅙ a·(b × c) / V
//! by the divergence theorem, measured from the piece's first vertex. A removed piece becomes a point at its centre
//! with the radius of the ball of its volume, r = ∛(3V/4π).
//!
//! A surface that looks inward bounds a bubble: its volume is negative. Small bubbles are filled, and give no point.
//! A removed piece takes its bubbles with it, because they are smaller than it is. A piece without volume, which rounding
//! has flattened far from the origin, becomes a point of radius 0 at its first vertex.

use super::{ComponentParams, Mesh, check::join};
use crate::{frame::Channel, math::Vec3};
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
    pub(super) fn new(mesh: &Mesh) -> Self {
        let mut forest: Vec<u32> = (0..mesh.positions.len() as u32).collect();
        for &[a, b, c] in &mesh.triangles {
            join(&mut forest, a, b);
            join(&mut forest, a, c);
        }
        // Roots are the lowest vertices of their trees, so every vertex stands behind the one it points to.
        let mut first = Vec::new();
        for v in 0..forest.len() {
            if forest[v] as usize == v {
                forest[v] = first.len() as u32;
                first.push(v as u32);
            } else {
                forest[v] = forest[forest[v] as usize];
            }
        }
        Self { of: forest, first }
    }

    /// The volume [m³] and its first moment about the piece's first vertex [m⁴], of every piece.
    pub(super) fn moments(&self, mesh: &Mesh) -> Vec<(f64, nalgebra::Vector3<f64>)> {
        let mut sums = vec![(0.0, nalgebra::Vector3::zeros()); self.first.len()];
        for &triangle in &mesh.triangles {
            let piece = self.of[triangle[0] as usize] as usize;
            let origin = mesh.positions[self.first[piece] as usize].cast::<f64>();
            let [a, b, c] = triangle.map(|v| mesh.positions[v as usize].cast::<f64>() - origin);
            let volume = a.dot(&b.cross(&c)) / 6.0;
            sums[piece].0 += volume;
            sums[piece].1 += (a + b + c) * (0.25 * volume);
        }
        sums
    }
}

/// Takes the pieces below `params.smallest` volumes of a particle out of `mesh`, which has neither normals nor
/// attributes yet, and returns them as points.
pub fn remove_small(mesh: &mut Mesh, params: &ComponentParams, spacing: f32) -> (Points, ComponentStats) {
    let pieces = Pieces::new(mesh);
    let moments = pieces.moments(mesh);
    let least = f64::from(params.smallest) * f64::from(spacing).powi(3);
    let small: Vec<bool> = moments.iter().map(|(volume, _)| volume.abs() < least).collect();

    // Make points of them, in the order of their first vertices.
    let (mut points, mut stats) = (Points::default(), ComponentStats::default());
    for (piece, &(volume, moment)) in moments.iter().enumerate().filter(|&(piece, _)| small[piece]) {
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
    mesh.triangles.iter_mut().flatten().for_each(|v| *v = number[*v as usize]);
    (points, stats)
}
