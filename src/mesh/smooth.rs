//! Smoothing that keeps volume, creases, and what is thin.
//!
//! *Method* [taubin96]: the vertices are filtered by a polynomial of the umbrella operator, x' = Σ c_k T_k(M) x, with
//! M x_i = x_i + w_i Σ_j a_ij (x_j − x_i)/Σ_j a_ij, Chebyshev polynomials T_k and the coefficients c_k of a low pass in
//! θ = arccos(eigenvalue of M) under a Hamming window. Waves longer than asked for pass, shorter ones vanish: what
//! repeated averaging would shrink stays.
//! *Departs from the paper*: coefficients are divided by their sum, so that a constant passes exactly; the filter
//! works on the displacements it makes, S_k = (T_k − 1)/(M − 1), S_{k+1} = 2 M S_k − S_{k−1} + 2 on the small vectors
//! (M − 1) x, so that a mesh far from the origin loses no digits; a_ij falls to zero where the normals of the ends lean
//! apart (creases), w_i where the liquid behind the vertex is thin; what volume still changes is given back, piece by
//! piece, by one offset along the normals.
//!
//! a_ij = a_ji, so M is similar to a symmetric matrix with eigenvalues in [−1, 1], and the sum stays bounded.
//!
//! Symbols: Λ → `wavelength` [m]; ℓ → root mean square edge [m]; w → `weights` [0..1]; θ₀ → `pass` [rad].
//! Limits: a vertex whose triangles would fold or collapse goes back to where it was, and is counted; so do pieces that
//! would lose a third of their volume, or would have to move far to get it back.

use super::{
    Mesh, SmoothingParams,
    check::{Shape, face_normals},
    links::{Links, next},
    pieces::Pieces,
};
use crate::{grid::SparseGrid, math::Vec3, par};
use std::f64::consts::PI;

/// How deep below the surface the liquid is looked for [spacings]. A layer of one particle ends one spacing below, two
/// layers end at two: between them, both are told apart from either side.
const DEPTH: f32 = 1.5;

/// The degree of the filter times θ₀. A Hamming window lets a degree n go from pass to stop within ±5/n: less than 5,
/// and the longest waves shrink; more only makes the cut sharper.
const DEGREE: f64 = 5.0;

/// A piece that keeps less than this part of its volume is not smoothed: what offsets along its normals make of the rest
/// is not its shape.
const KEPT: f64 = 0.7;

/// Volume is given back to a piece until this part of it is wrong: single precision places it no better …
const EXACT: f64 = 1e-6;

/// … or this often. A bulk takes one offset, a droplet that lost much of its volume four.
const OFFSETS: usize = 8;

/// A piece of less than this part of the whole counts as that large: one that rounding has flattened has no volume to
/// compare with. Larger, and the error of droplets in a large splash goes unseen.
const LEAST: f64 = 1e-9;

/// What smoothing did.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct SmoothingStats {
    /// Degree of the filter: how often every vertex looked at its neighbours.
    pub degree: usize,
    /// Vertices in thin parts: nearer to the part of it that `thin` names than to all of it.
    pub thin_vertices: usize,
    /// Vertices put back because their triangles would have folded or collapsed, or their piece have shrunk away.
    pub restored_vertices: usize,
    /// How much volume the filter changed, Σ over the pieces of |change| over Σ |volume|, before it was given back …
    pub volume_change: f64,
    /// … and after.
    pub volume_error: f64,
    /// The most that a single piece's volume is wrong after it, as a part of its own.
    pub worst_piece: f64,
    /// The longest way of a vertex [m].
    pub longest_move: f32,
}

/// How much of the smoothing each vertex gets: `thin` where the liquid is one particle thick, 1 in the bulk. `normals`
/// point outward; `field` is the density that the surface was cut from, at `threshold`.
pub fn depth_weights(
    mesh: &Mesh,
    normals: &[Vec3],
    field: &SparseGrid,
    threshold: f32,
    spacing: f32,
    thin: f32,
) -> Vec<f32> {
    let mut weights = vec![0.0; mesh.positions.len()];
    par::fill(&mut weights, |v| {
        let behind = field.trilinear(mesh.positions[v] - normals[v] * (DEPTH * spacing)) / threshold;
        let t = (behind - 0.5).clamp(0.0, 1.0);
        thin + (1.0 - thin) * t * t * (3.0 - 2.0 * t)
    });
    weights
}

/// Smooths the positions of `mesh`, each vertex by its weight [0..1].
///
/// The result does not depend on threads. Triangles stay as they are.
pub fn smooth(mesh: &mut Mesh, weights: &[f32], params: &SmoothingParams, spacing: f32) -> SmoothingStats {
    let is_thin = |w: f32| w < 0.5 * (1.0 + params.thin);
    let mut stats = SmoothingStats {
        thin_vertices: weights.iter().filter(|&&w| is_thin(w)).count(),
        ..SmoothingStats::default()
    };
    if mesh.triangles.is_empty() {
        return stats;
    }
    let umbrella = Umbrella::new(mesh, weights, params.crease.to_radians());
    if umbrella.edge.is_nan() || umbrella.edge <= 0.0 {
        // All vertices stand in one place, or in none.
        return stats;
    }
    let coefficients = low_pass(pass(umbrella.edge, f64::from(params.wavelength) * f64::from(spacing)));
    stats.degree = coefficients.len() - 1;

    let pieces = Pieces::new(mesh);
    let target = pieces.moments(mesh);
    let total: f64 = target.iter().map(|(volume, _)| volume.abs()).sum();

    // Filter, and take back what folded.
    let before = mesh.positions.clone();
    let moves = umbrella.filter(&before, &coefficients);
    par::update(&mut mesh.positions, |v, x| *x += moves[v]);
    drop((moves, umbrella));
    let mut restored = vec![false; before.len()];
    restore(mesh, &before, &mut restored);

    // Pieces that are short beside the wavelength shrink to nothing: they stay as they were.
    let shrunk = pieces.moments(mesh);
    for v in 0..before.len() {
        let piece = pieces.of[v] as usize;
        if shrunk[piece].0.abs() < KEPT * target[piece].0.abs() {
            mesh.positions[v] = before[v];
            restored[v] = true;
        }
    }

    // Give the volume back, by Newton's method on the offset of every piece that is still wrong.
    let sizes: Vec<f64> =
        target.iter().map(|(volume, _)| volume.abs().max(LEAST * total).max(f64::MIN_POSITIVE)).collect();
    let change = |mesh: &Mesh| -> Vec<f64> {
        pieces.moments(mesh).iter().zip(&target).map(|(now, before)| now.0 - before.0).collect()
    };
    let relative =
        |change: &[f64]| change.iter().map(|c| c.abs()).sum::<f64>() / total.max(f64::MIN_POSITIVE);
    let mut left = change(mesh);
    let mut rests = vec![false; sizes.len()];
    stats.volume_change = relative(&left);
    for round in 0..OFFSETS {
        let surplus: Vec<f64> = (0..sizes.len())
            .map(|i| if rests[i] || left[i].abs() < EXACT * sizes[i] { 0.0 } else { left[i] })
            .collect();
        if surplus.iter().all(|&surplus| surplus == 0.0) {
            break;
        }
        offset(mesh, &before, &mut restored, weights, &pieces, &surplus, f64::from(spacing));
        restore(mesh, &before, &mut restored);
        let now = change(mesh);
        // The first step may go too far; a piece that later ones bring no nearer is as near as rounding lets it.
        for i in 0..sizes.len() {
            rests[i] |= round > 0 && surplus[i] != 0.0 && now[i].abs() > 0.5 * left[i].abs();
        }
        left = now;
    }
    stats.volume_error = relative(&left);
    stats.worst_piece = left.iter().zip(&sizes).map(|(left, size)| left.abs() / size).fold(0.0, f64::max);
    stats.restored_vertices = restored.iter().zip(weights).filter(|&(&back, &w)| back && w > 0.0).count();
    stats.longest_move = par::max(before.len(), |v| (mesh.positions[v] - before[v]).norm())
        .map_or(0.0, |(_, longest)| longest);
    stats
}

/// A vector and a zero: one instruction does four numbers.
type Four = [f32; 4];

/// M − 1: where each vertex goes to the mean of its neighbours.
struct Umbrella {
    start: Vec<u32>,
    /// The neighbours of every vertex and w_i a_ij/Σ_j a_ij.
    links: Vec<(u32, f32)>,
    /// ℓ [m].
    edge: f64,
}

impl Umbrella {
    fn new(mesh: &Mesh, weights: &[f32], crease: f32) -> Self {
        let mut normals = face_normals(mesh);
        par::update(&mut normals, |_, n| *n = n.try_normalize(0.0).unwrap_or_else(Vec3::zeros));
        let list = Links::new(mesh, |_| true);
        let target = |h: u32| {
            let after = next(h);
            mesh.triangles[after as usize / 3][after as usize % 3]
        };
        let parts = par::map_chunks(mesh.positions.len(), par::CHUNK, |range| {
            let mut links = Vec::with_capacity(7 * range.len());
            let mut squares = 0.0;
            for i in range {
                let from = links.len();
                let mut sum = 0.0;
                for &h in list.of(i) {
                    let j = target(h) as usize;
                    let lean = (normals[i].dot(&normals[j]) - crease.cos()) / (1.0 - crease.cos());
                    let a_ij = lean.clamp(0.0, 1.0);
                    sum += a_ij;
                    links.push((j as u32, a_ij));
                    squares += f64::from((mesh.positions[j] - mesh.positions[i]).norm_squared());
                }
                let scale = if sum > 0.0 { weights[i] / sum } else { 0.0 };
                links[from..].iter_mut().for_each(|(_, a_ij)| *a_ij *= scale);
            }
            (links, squares)
        });
        let mut links = Vec::with_capacity(list.len());
        let mut squares = 0.0;
        for (part, sum) in parts {
            links.extend(part);
            squares += sum;
        }
        let edge = (squares / links.len() as f64).sqrt();
        let start = (0..mesh.positions.len()).map(|v| list.range(v).start as u32);
        Self { start: start.chain([links.len() as u32]).collect(), links, edge }
    }

    /// (M − 1) s at vertex `i`.
    #[inline]
    fn pull(&self, s: &[Four], i: usize) -> Four {
        let here = s[i];
        let links = &self.links[self.start[i] as usize..self.start[i + 1] as usize];
        links.iter().fold([0.0; 4], |sum, &(j, share)| {
            let there = s[j as usize];
            std::array::from_fn(|k| sum[k] + (there[k] - here[k]) * share)
        })
    }

    /// Σ c_k S_k (M − 1) x: where each vertex is moved.
    fn filter(&self, x: &[Vec3], coefficients: &[f32]) -> Vec<Vec3> {
        let mut pull = vec![[0.0; 4]; x.len()];
        {
            let x: Vec<Four> = x.iter().map(|x| [x.x, x.y, x.z, 0.0]).collect();
            par::fill(&mut pull, |i| self.pull(&x, i));
        }
        let mut now = pull.clone();
        let mut last = vec![[0.0; 4]; x.len()];
        let mut sum = vec![[0.0; 4]; x.len()];
        par::fill(&mut sum, |i| pull[i].map(|v| v * coefficients[1]));
        for &c in &coefficients[2..] {
            // S_{k+1} = 2 M S_k − S_{k−1} + 2 on (M − 1) x
            par::map_chunks_mut([&mut last, &mut sum], par::CHUNK, |start, [last, sum]| {
                for (i, (last, sum)) in (start..).zip(last.iter_mut().zip(sum)) {
                    let pulled = self.pull(&now, i);
                    for k in 0..4 {
                        last[k] = (now[i][k] + pulled[k] + pull[i][k]) * 2.0 - last[k];
                        sum[k] += last[k] * c;
                    }
                }
            });
            std::mem::swap(&mut last, &mut now);
        }
        sum.into_iter().map(|[x, y, z, _]| Vec3::new(x, y, z)).collect()
    }
}

/// θ₀ of waves of length `wavelength` on edges of length `edge`: on a regular mesh the umbrella operator has the
/// eigenvalue 1 − (π ℓ/Λ)² there, up to fourth order.
fn pass(edge: f64, wavelength: f64) -> f64 {
    (1.0 - (PI * edge / wavelength).powi(2)).clamp(-1.0, 1.0).acos()
}

/// The coefficients of the low pass up to θ₀, with sum 1; at least two.
fn low_pass(pass: f64) -> Vec<f32> {
    let degree = (DEGREE / pass).ceil() as usize;
    let raw: Vec<f64> = (0..=degree)
        .map(|k| {
            let angle = k as f64 * PI;
            let window = 0.54 + 0.46 * (angle / (degree + 1) as f64).cos();
            if k == 0 { pass / PI } else { window * 2.0 * (k as f64 * pass).sin() / angle }
        })
        .collect();
    let sum: f64 = raw.iter().sum();
    raw.iter().map(|c| (c / sum) as f32).collect()
}

/// Moves every piece along its normals so that its volume falls by `surplus`, each vertex by its weight but those that
/// were put back. A piece that would have to go further than `longest`, because few of its vertices can move or little is
/// left of it, is put back `before` smoothing as a whole.
fn offset(
    mesh: &mut Mesh,
    before: &[Vec3],
    restored: &mut [bool],
    weights: &[f32],
    pieces: &Pieces,
    surplus: &[f64],
    longest: f64,
) {
    let normals = face_normals(mesh);
    // How much volume a step takes from each piece, and the greatest weight in it.
    let mut slopes = vec![(0.0, 0.0_f64); surplus.len()];
    for (v, normal) in normals.iter().enumerate().filter(|&(v, _)| !restored[v]) {
        let (slope, heaviest) = &mut slopes[pieces.of[v] as usize];
        *slope += f64::from(weights[v]) * f64::from(normal.norm()) / 6.0;
        *heaviest = heaviest.max(f64::from(weights[v]));
    }
    let step = |(&surplus, (slope, heaviest)): (&f64, (f64, f64))| {
        let step = if surplus == 0.0 { 0.0 } else { surplus / slope };
        (step == 0.0 || step.abs() * heaviest <= longest).then_some(step)
    };
    let steps: Vec<Option<f64>> = surplus.iter().zip(slopes).map(step).collect();
    par::update(restored, |v, restored| *restored |= steps[pieces.of[v] as usize].is_none());
    par::update(&mut mesh.positions, |v, x| match steps[pieces.of[v] as usize] {
        None => *x = before[v],
        Some(step) if !restored[v] => {
            if let Some(normal) = normals[v].try_normalize(0.0) {
                *x -= normal * (f64::from(weights[v]) * step) as f32;
            }
        }
        Some(_) => {}
    });
}

/// Puts the vertices of triangles that collapsed or look against the surface around them back to `before`, until
/// there are none: in the worst case the mesh is what it was.
fn restore(mesh: &mut Mesh, before: &[Vec3], restored: &mut [bool]) {
    loop {
        let normals = face_normals(mesh);
        let bad: Vec<usize> = par::map_chunks(mesh.triangles.len(), par::CHUNK, |range| {
            let is_bad = |&t: &usize| {
                let triangle = mesh.triangles[t].map(|v| v as usize);
                let [a, b, c] = triangle.map(|v| mesh.positions[v]);
                let normal = (b - a).cross(&(c - a));
                let around = triangle.iter().fold(Vec3::zeros(), |sum, &v| sum + normals[v]);
                !triangle.iter().all(|&v| restored[v])
                    && (Shape::of(mesh, t) != Shape::Sound || normal.dot(&around) <= 0.0)
            };
            range.filter(is_bad).collect::<Vec<_>>()
        })
        .concat();
        if bad.is_empty() {
            return;
        }
        for v in bad.iter().flat_map(|&t| mesh.triangles[t]) {
            mesh.positions[v as usize] = before[v as usize];
            restored[v as usize] = true;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The filter's answer to a wave with eigenvalue cos θ.
    fn answer(coefficients: &[f32], theta: f64) -> f64 {
        (0..).zip(coefficients).map(|(k, &c)| f64::from(c) * (f64::from(k) * theta).cos()).sum()
    }

    #[test]
    fn the_low_pass_keeps_long_waves_and_stops_short_ones() {
        for pass in [0.02, 0.1, 0.3, 0.8] {
            let coefficients = low_pass(pass);
            assert!((answer(&coefficients, 0.0) - 1.0).abs() < 1e-5);
            assert!(answer(&coefficients, 0.1 * pass) > 0.99);
            assert!((answer(&coefficients, pass) - 0.5).abs() < 0.1, "half at the wavelength asked for");
            for i in 0..=50 {
                let theta = 2.0 * pass + (PI - 2.0 * pass) * f64::from(i) / 50.0;
                assert!(
                    answer(&coefficients, theta).abs() < 0.02,
                    "{pass}: {}",
                    answer(&coefficients, theta)
                );
            }
        }
    }

    #[test]
    fn waves_longer_than_the_mesh_can_show_pass_whole() {
        assert_eq!(pass(1.0, 1.0), PI);
        assert!(low_pass(PI).len() >= 2);
        assert!((pass(0.1, 10.0) - 2_f64.sqrt() * PI * 0.01).abs() < 1e-5);
    }
}
