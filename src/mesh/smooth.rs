//! Mesh smoothing that preserves volume, edges and thin parts.
//!
//! *Method* [taubin96]: the vertices are filtered by a low pass ([`super::low_pass`]) of the umbrella
//! operator M ([`super::umbrella`]). Waves longer than the wavelength pass and shorter ones
//! vanish, whereas repeated averaging also shrinks long waves.
//! *Departs from the paper*: w_i is smaller where the liquid behind the vertex is thin. Edges are preserved
//! as described below if this is requested. The remaining change of volume is corrected, component by component, by
//! an offset along the normals. Triangles that fold are unfolded ([`super::displaced`]).
//!
//! Edges: before filtering, an edge of a box of particles is spread over vertices whose normals deviate no
//! more than single particles make them do. After filtering, it is spread over half a wavelength, and the
//! particles are gone. So the bend of the surface is measured after the filter, on normals that no longer
//! show the particles, as [zheng11] filters the normals before the positions: κ = √(2 Σ_j |n_j − n_i|²/Σ_j
//! |x_j − x_i|²). Where κ Λ/2 exceeds `crease`, the vertices get a filter of a shorter wavelength instead,
//! which costs little in addition to the long one: its terms are the first of the same series. An edge of the
//! angle φ that the filter has rounded bends by κ Λ/2 ≈ 2 tan(φ/2), 115° for a right angle.
//!
//! Symbols: Λ → `wavelength` [m]; w → `weights` [0..1]; κ → `bend` [rad/m].
//! Limits: a vertex whose triangles fold or collapse and cannot be unfolded is restored to its original position, and
//! counted. So are components that would lose a third of their volume, or would have to move far to regain it. With
//! `crease`, shapes rounder than a wavelength count as edges.

use super::{
    Mesh, SmoothingParams,
    components::Components,
    displaced::{DisplacedMesh, retain, select, update_at},
    half_edges::HalfEdges,
    low_pass::{cutoff, response},
    normals::unit,
    umbrella::{Four, Umbrella},
};
use crate::{field::Density, grid::Probe, math::Vec3, par};

/// Depth below the surface at which the liquid is sampled [spacings]. A layer of one particle ends one
/// spacing below, two layers end at two: between them, both can be distinguished from either side.
const PROBE_DEPTH: f32 = 1.5;

/// Radius of thin spots that are smoothed like what is around them [spacings], such as the sides of a particle that
/// is proud of a bulk. If it is larger, stubs of threads are removed; if smaller, such particles stay warts.
const CLOSING_RADIUS: f32 = 1.5;

/// Passes of closing at most, for very small voxels.
const MAX_CLOSING_PASSES: f64 = 60.0;

/// Length of the mean normal over a wavelength from which the surface counts as flat …
const FLAT_END: f32 = 0.9;

/// … and below which it counts as round. At a right angle it is 0.7; on a cylinder it is the part of the radius
/// that the filter leaves.
const FLAT_START: f32 = 0.6;

/// The wavelength at edges, relative to the other. Larger makes them rounder, smaller leaves more of the particles
/// on them. At the usual six spacings it is two, below which the density has little content.
const CREASE_WAVELENGTH_FRACTION: f64 = 1.0 / 3.0;

/// Bend at which an edge begins, relative to that of a full edge. If it is smaller, remains of disordered
/// particles count: at a half, some of a ball did. If it is larger, edges begin suddenly.
const CREASE_START_FRACTION: f32 = 0.7;

/// Passes of averaging normals with their neighbours before their bend is measured. If there are fewer, edges
/// depend on how the grid happens to cut them: without averaging, the area of a still ball that moves by
/// parts of a voxel varied by 0.6 %.
const NORMAL_AVERAGING_PASSES: usize = 2;

/// From this crease on, nothing is an edge [deg].
const NO_CREASE_ANGLE: f32 = 180.0;

/// A component that keeps less than this part of its volume is not smoothed: offsets along its normals would
/// not restore its shape.
const MIN_VOLUME_FRACTION: f32 = 0.7;

/// A component that keeps more than this part of its volume is smoothed entirely. Between the two it is smoothed in
/// part, so that no droplet jumps between the two from frame to frame.
const SOUND_VOLUME_FRACTION: f32 = 0.85;

/// Relative error of a component's volume that is accepted: single precision allows no better.
const VOLUME_TOLERANCE: f64 = 1e-6;

/// Offsets of a component at most. One suffices, except for components with restored vertices.
const MAX_OFFSETS: usize = 8;

/// Smallest volume of a component relative to the whole that enters relative errors: a component flattened by
/// rounding has no volume to compare with. If it is larger, the error of droplets in a large splash goes
/// unnoticed.
const MIN_COMPONENT_FRACTION: f64 = 1e-9;

/// Result of smoothing.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
#[non_exhaustive]
pub struct SmoothingStats {
    /// Degree of the filter: how often every vertex reads its neighbours.
    pub degree: usize,
    /// Vertices in thin parts: nearer to the fraction `thin` of the smoothing than to all of it.
    pub thin_vertices: usize,
    /// Vertices at edges, which were smoothed less, some of them hardly less.
    pub crease_vertices: usize,
    /// Vertices restored because their triangles would have folded or collapsed, or their component would
    /// have shrunk.
    pub restored_vertices: usize,
    /// Vertices of components that would have shrunk by less, and were smoothed in part.
    pub partly_smoothed_vertices: usize,
    /// Change of volume by the filter, Σ over the components of |change| over Σ |volume|, before the
    /// correction …
    pub volume_change: f64,
    /// … and after.
    pub volume_error: f64,
    /// Largest error of a single component's volume after the correction, relative to its own.
    #[serde(rename = "worst_piece")]
    pub worst_component: f64,
    /// Largest displacement of a vertex [m].
    pub longest_move: f32,
}

/// What the depth of the liquid behind a surface is found in.
pub(super) struct Depths<'a> {
    /// The density of the particles.
    pub(super) field: &'a Density,
    /// How far the surface is outside of its isosurface [m].
    pub(super) offset: f32,
}

/// The weight of smoothing at each vertex: `thin` where the liquid is thin, 1 in the bulk.
///
/// The liquid is sampled along the mean normal over a wavelength: on the side of a single particle that is
/// proud of a bulk, the vertex's own normal points along the surface, and misses the bulk. Where the normals
/// around a vertex differ by so much that their mean is short, the surface is round within a wavelength. There
/// the filter shortens radii by as much as it shortens normals, so the liquid must be half a wavelength deep
/// along the vertex's own normal.
fn depth_weights(
    mesh: &Mesh,
    half_edges: &HalfEdges,
    umbrella: &Umbrella,
    depths: Depths,
    params: &SmoothingParams,
    spacing: f32,
) -> Vec<f32> {
    let Depths { field, offset } = depths;
    if !is_extended(umbrella) {
        return vec![1.0; mesh.positions.len()];
    }
    let mut normals = half_edges.normals(mesh);
    par::update(&mut normals, |_, n| *n = unit(n));
    let wavelength = f64::from(params.wavelength) * f64::from(spacing);
    let long = response(cutoff(umbrella.edge, wavelength));
    let [change, _] = umbrella.filter(&normals, &vec![1.0; normals.len()], [&long, &[]]);
    let mut weights = vec![0.0; normals.len()];
    par::for_chunks(&mut weights, par::CHUNK, |start, weights| {
        let mut probe = Probe::new(&field.grid);
        for (v, weight) in (start..).zip(weights) {
            let mean = normals[v] + vector(change[v]);
            let flat = smooth_step(FLAT_START, FLAT_END, mean.norm());
            let inward = unit(&(normals[v] * (1.0 - flat) + unit(&mean) * flat)) * -spacing;
            let deepest = (0.5 * params.wavelength).max(PROBE_DEPTH);
            let depth = deepest + (PROBE_DEPTH - deepest) * flat;
            let samples = (depth / PROBE_DEPTH).ceil();
            let x = mesh.positions[v] - normals[v] * offset;
            let minimum = (1..=samples as usize)
                .map(|i| probe.trilinear(x + inward * (depth * i as f32 / samples)))
                .fold(f32::MAX, f32::min);
            *weight = params.thin + (1.0 - params.thin) * smooth_step(0.5, 1.5, minimum / field.threshold);
        }
    });
    close(&mut weights, umbrella, spacing);
    weights
}

/// Raises weights around which there are higher ones on all sides within [`CLOSING_RADIUS`]: the morphological
/// closing of grey-scale images [serra82].
fn close(weights: &mut Vec<f32>, umbrella: &Umbrella, spacing: f32) {
    let passes =
        (f64::from(CLOSING_RADIUS * spacing) / umbrella.edge).ceil().min(MAX_CLOSING_PASSES) as usize;
    let mut next = weights.clone();
    for extremum in [f32::max as fn(f32, f32) -> f32, f32::min] {
        for _ in 0..passes {
            umbrella.fill(&mut next, |v, neighbours| {
                neighbours.iter().fold(weights[v], |found, &j| extremum(found, weights[j as usize]))
            });
            std::mem::swap(weights, &mut next);
        }
    }
}

/// Whether there are vertices at different places.
fn is_extended(umbrella: &Umbrella) -> bool {
    umbrella.edge > 0.0
}

/// The cubic step from 0 at `start` to 1 at `end`; 0 for NaN.
pub(super) fn smooth_step(start: f32, end: f32, x: f32) -> f32 {
    let t = ((x - start) / (end - start)).clamp(0.0, 1.0);
    if t.is_nan() { 0.0 } else { t * t * (3.0 - 2.0 * t) }
}

/// Smooths the positions of `mesh`, each vertex by its weight [0..1].
///
/// The mesh is closed: at a boundary a vertex would have a neighbour of which it is no neighbour, and the
/// filter would be unbounded. The result does not depend on threads. The triangles do not change.
pub fn smooth(mesh: &mut Mesh, weights: &[f32], params: &SmoothingParams, spacing: f32) -> SmoothingStats {
    let half_edges = HalfEdges::new(mesh, |_| true);
    let umbrella = Umbrella::new(mesh, &half_edges);
    smooth_with_umbrella(mesh, &half_edges, umbrella, weights, params, spacing).stats
}

/// Result of smoothing, with the normals and unmoved vertices.
pub(super) struct Smoothed {
    pub(super) stats: SmoothingStats,
    /// The area-weighted normals of the faces around the vertices, not normalised [m²].
    pub(super) normals: Vec<Vec3>,
    /// The vertices that did not move.
    pub(super) unmoved: Vec<u32>,
}

/// [`smooth`] of a mesh with known half-edges, each vertex by the depth of the liquid behind it and its part by a mask [0..1].
pub(super) fn smooth_by_depth(
    mesh: &mut Mesh,
    half_edges: &HalfEdges,
    depths: Depths,
    mask: Option<&[f32]>,
    params: &SmoothingParams,
    spacing: f32,
) -> Smoothed {
    let umbrella = Umbrella::new(mesh, half_edges);
    let mut weights = depth_weights(mesh, half_edges, &umbrella, depths, params, spacing);
    if let Some(mask) = mask {
        par::update(&mut weights, |v, weight| *weight *= mask[v]);
    }
    smooth_with_umbrella(mesh, half_edges, umbrella, &weights, params, spacing)
}

/// [`smooth`] of a mesh with known half-edges and umbrella operator.
fn smooth_with_umbrella(
    mesh: &mut Mesh,
    half_edges: &HalfEdges,
    umbrella: Umbrella,
    weights: &[f32],
    params: &SmoothingParams,
    spacing: f32,
) -> Smoothed {
    let is_thin = |w: f32| w < 0.5 * (1.0 + params.thin);
    let mut stats = SmoothingStats {
        thin_vertices: count(weights.len(), |v| is_thin(weights[v])),
        ..SmoothingStats::default()
    };
    if !is_extended(&umbrella) {
        let unmoved = select(weights.len(), |_| true);
        return Smoothed { stats, normals: half_edges.normals(mesh), unmoved };
    }
    let components = Components::new(mesh);
    let triangles: Vec<u32> = (0..mesh.triangles.len() as u32).collect();
    let target = components.volumes(mesh, &triangles);

    // Filter, but less at edges, and restore folded triangles.
    let wavelength = f64::from(params.wavelength) * f64::from(spacing);
    let long = response(cutoff(umbrella.edge, wavelength));
    let short = (params.crease < NO_CREASE_ANGLE)
        .then(|| response(cutoff(umbrella.edge, CREASE_WAVELENGTH_FRACTION * wavelength)));
    stats.degree = long.len();
    let [displacements, at_creases] =
        umbrella.filter(&mesh.positions, weights, [&long, short.as_deref().unwrap_or_default()]);
    let before = mesh.positions.clone();
    par::update(&mut mesh.positions, |v, x| *x += vector(displacements[v]));
    let mut displaced = DisplacedMesh::new(mesh, half_edges, before);
    if short.is_some() {
        let limit = params.crease.to_radians() / (0.5 * wavelength) as f32;
        stats.crease_vertices =
            restore_creases(&mut displaced, &umbrella, [displacements, at_creases], limit);
    }
    drop(umbrella);
    displaced.unfold(&triangles, weights, spacing);

    // Components shorter than the wavelength shrink: they are restored, or in part.
    let mut now = components.volumes(displaced.mesh, &triangles);
    let kept: Vec<f32> = now
        .iter()
        .zip(&target)
        .map(|(now, before)| {
            smooth_step(MIN_VOLUME_FRACTION, SOUND_VOLUME_FRACTION, (now / before).abs() as f32)
        })
        .collect();
    let part = |v: usize| kept[components.of[v] as usize];
    let back = select(weights.len(), |v| part(v) < 1.0);
    stats.partly_smoothed_vertices = count(weights.len(), |v| part(v) > 0.0 && part(v) < 1.0);
    displaced.restore_parts(&back, |v| kept[components.of[v] as usize]);
    let of_these = retain(&triangles, |t| kept[components.of_triangle(displaced.mesh, t)] < 1.0);
    displaced.unfold(&of_these, weights, spacing);
    let volumes = components.volumes(displaced.mesh, &of_these);
    for i in (0..now.len()).filter(|&i| kept[i] < 1.0) {
        now[i] = volumes[i];
    }

    correct_volumes(
        &mut displaced,
        weights,
        &components,
        [&target, &now],
        triangles,
        f64::from(spacing),
        &mut stats,
    );
    let DisplacedMesh { before, normals, restored, .. } = displaced;
    stats.restored_vertices = count(weights.len(), |v| restored[v] && weights[v] > 0.0);
    stats.longest_move = par::max(before.len(), |v| (mesh.positions[v] - before[v]).norm())
        .map_or(0.0, |(_, longest)| longest);
    let unmoved = select(before.len(), |v| mesh.positions[v] == before[v]);
    Smoothed { stats, normals, unmoved }
}

/// Moves the vertices at edges from the result of the long filter towards that of the short one, and returns
/// their number. `displacements` are the displacements of both.
fn restore_creases(
    displaced: &mut DisplacedMesh,
    umbrella: &Umbrella,
    displacements: [Vec<Four>; 2],
    limit: f32,
) -> usize {
    let [long, short] = &displacements;
    let shares = crease_shares(displaced, umbrella, limit);
    let creased = select(shares.len(), |v| shares[v] > 0.0);
    update_at(&creased, &mut displaced.mesh.positions, |v, x| {
        *x += (vector(short[v]) - vector(long[v])) * shares[v];
    });
    let mut near = vec![false; shares.len()];
    umbrella.fill(&mut near, |v, neighbours| {
        shares[v] > 0.0 || neighbours.iter().any(|&j| shares[j as usize] > 0.0)
    });
    displaced.refresh(&select(near.len(), |v| near[v]));
    creased.len()
}

/// Corrects the volume of every component from `now` to `target`, by offsets of the components that still
/// have an error. `triangles` are all.
fn correct_volumes(
    displaced: &mut DisplacedMesh,
    weights: &[f32],
    components: &Components,
    [target, now]: [&[f64]; 2],
    mut triangles: Vec<u32>,
    spacing: f64,
    stats: &mut SmoothingStats,
) {
    let total: f64 = target.iter().map(|volume| volume.abs()).sum();
    let sizes: Vec<f64> = target
        .iter()
        .map(|volume| volume.abs().max(MIN_COMPONENT_FRACTION * total).max(f64::MIN_POSITIVE))
        .collect();
    let relative =
        |error: &[f64]| error.iter().map(|error| error.abs()).sum::<f64>() / total.max(f64::MIN_POSITIVE);
    let mut error: Vec<f64> = now.iter().zip(target).map(|(now, before)| now - before).collect();
    let mut vertices = select(weights.len(), |_| true);
    let mut is_exact = vec![false; sizes.len()];
    stats.volume_change = relative(&error);
    for iteration in 0..MAX_OFFSETS {
        let surplus: Vec<f64> = (0..sizes.len())
            .map(|i| if is_exact[i] || error[i].abs() < VOLUME_TOLERANCE * sizes[i] { 0.0 } else { error[i] })
            .collect();
        if surplus.iter().all(|&surplus| surplus == 0.0) {
            break;
        }
        // Corrected components stay so: each iteration has less to do.
        vertices = retain(&vertices, |v| surplus[components.of[v] as usize] != 0.0);
        triangles = retain(&triangles, |t| surplus[components.of_triangle(displaced.mesh, t)] != 0.0);
        displaced.offset(weights, components, [&vertices, &triangles], &surplus, spacing);
        displaced.unfold(&triangles, weights, spacing as f32);
        let now = components.volumes(displaced.mesh, &triangles);
        // The first step may go too far. A component that later steps bring no nearer is as near as rounding
        // allows.
        for i in (0..sizes.len()).filter(|&i| surplus[i] != 0.0) {
            let now = now[i] - target[i];
            is_exact[i] |= iteration > 0 && now.abs() > 0.5 * error[i].abs();
            error[i] = now;
        }
    }
    stats.volume_error = relative(&error);
    stats.worst_component =
        error.iter().zip(&sizes).map(|(error, size)| error.abs() / size).fold(0.0, f64::max);
}

/// The share of the short filter at every vertex: 1 where the surface after the long filter bends by `limit`
/// [rad/m], 0 where by [`CREASE_START_FRACTION`] of it.
fn crease_shares(displaced: &DisplacedMesh, umbrella: &Umbrella, limit: f32) -> Vec<f32> {
    let mesh = &*displaced.mesh;
    let mut normals = displaced.normals.clone();
    let direction = |n: Vec3| n.try_normalize(0.0).unwrap_or_else(Vec3::zeros);
    par::update(&mut normals, |_, n| *n = direction(*n));
    let mut averaged = vec![Vec3::zeros(); normals.len()];
    for _ in 0..NORMAL_AVERAGING_PASSES {
        umbrella.fill(&mut averaged, |v, neighbours| {
            direction(neighbours.iter().fold(normals[v], |sum, &j| sum + normals[j as usize]))
        });
        std::mem::swap(&mut normals, &mut averaged);
    }
    drop(averaged);

    // How much the normals turn along the edges of every vertex, and the lengths of these edges.
    let mut bends = vec![[0.0; 2]; mesh.positions.len()];
    umbrella.fill(&mut bends, |v, neighbours| {
        neighbours.iter().fold([0.0; 2], |[turn, length], &j| {
            let difference = (normals[j as usize] - normals[v]).norm_squared();
            [turn + difference, length + (mesh.positions[j as usize] - mesh.positions[v]).norm_squared()]
        })
    });
    let mut shares = vec![0.0; bends.len()];
    umbrella.fill(&mut shares, |v, neighbours| {
        // A single vertex is unreliable: small triangles have noisy normals.
        let around = neighbours.iter().map(|&j| bends[j as usize]);
        let [turn, length] = around.fold(bends[v], |sum, of| [sum[0] + of[0], sum[1] + of[1]]);
        // A neighbour along an edge does not turn: on average half of the square is seen.
        let bend = (2.0 * turn / length).sqrt();
        smooth_step(CREASE_START_FRACTION, 1.0, bend / limit)
    });
    shares
}

fn vector([x, y, z, _]: Four) -> Vec3 {
    Vec3::new(x, y, z)
}

/// Number of indices below `count` that `is` selects.
fn count(count: usize, is: impl Fn(usize) -> bool + Sync) -> usize {
    par::map_chunks(count, par::CHUNK, |range| range.filter(|&i| is(i)).count()).into_iter().sum()
}
