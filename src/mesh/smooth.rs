//! Smoothing that keeps volume, edges, and what is thin.
//!
//! *Method* [taubin96]: the vertices are filtered by a low pass ([`super::low_pass`]) of the umbrella operator M
//! ([`super::umbrella`]). Waves longer than asked for pass, shorter ones vanish: what repeated averaging would shrink stays.
//! *Departs from the paper*: w_i is less where the liquid behind the vertex is thin; edges are kept as below; what volume still
//! changes is given back, piece by piece, by one offset along the normals.
//!
//! Edges: as cut, an edge of a box of particles is spread over vertices that lean apart no more than single particles make
//! them do. As filtered, it is spread over half a wavelength, and the particles are gone. So the bend of the surface is
//! measured after the filter, on normals that no longer show the particles, as [zheng11] filters the normals before the
//! places: κ = √(2 Σ_j |n_j − n_i|²/Σ_j |x_j − x_i|²). Where κ Λ/2 is more than `crease`, the vertices get a filter of a
//! shorter wavelength instead, which costs little beside the long one: its terms are the first of the same. An edge of the
//! angle φ that the filter has rounded bends by κ Λ/2 ≈ 2 tan(φ/2), 115° for a right angle.
//!
//! Symbols: Λ → `wavelength` [m]; w → `weights` [0..1]; κ → `bend` [rad/m].
//! Limits: a vertex whose triangles would fold or collapse goes back to where it was, and is counted; so do pieces that
//! would lose a third of their volume, or would have to move far to get it back. What is round within a wavelength, droplets
//! and threads, counts as an edge.

use super::{
    Mesh, SmoothingParams,
    links::Links,
    low_pass::{pass, response},
    moved::{Moved, change, narrow, select},
    normals::unit,
    pieces::Pieces,
    umbrella::{Four, Umbrella},
};
use crate::{field::Density, grid::Probe, math::Vec3, par};

/// How deep below the surface the liquid is looked for [spacings]. A layer of one particle ends one spacing below, two
/// layers end at two: between them, both are told apart from either side.
const DEPTH: f32 = 1.5;

/// The wavelength at edges, as a part of the other. Larger rounds them, smaller leaves more of the particles on them. At the
/// usual six spacings it is two, below which the density has little.
const EDGE: f64 = 1.0 / 3.0;

/// Where the surface bends by this part of what an edge does, it begins to be one. Less, and what is left
/// of disordered particles counts: at a half, some of a ball did. More, and edges begin suddenly.
const NO_EDGE: f32 = 0.7;

/// How often normals are averaged with their neighbours before their bend is measured. Less, and what is an edge depends on how
/// the grid happens to cut it: unaveraged, the area of a still ball that moves by parts of a voxel varied by 0.6 %.
const CALM: usize = 2;

/// From this crease on nothing is an edge [deg].
const FLAT: f32 = 180.0;

/// A piece that keeps less than this part of its volume is not smoothed: what offsets along its normals make of the rest
/// is not its shape.
const KEPT: f64 = 0.7;

/// Volume is given back to a piece until this part of it is wrong: single precision places it no better …
const EXACT: f64 = 1e-6;

/// … or this often. One offset does it, but for pieces of which vertices were put back.
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
    /// Vertices at edges, which were smoothed less, and some of them hardly less.
    pub crease_vertices: usize,
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

/// How much of the smoothing each vertex gets: `thin` where the liquid is one particle thick, 1 in the bulk. `field` is the
/// density that the surface was cut from.
pub(super) fn depth_weights(
    mesh: &Mesh,
    links: &Links,
    field: &Density,
    thin: f32,
    spacing: f32,
) -> Vec<f32> {
    let mut weights = vec![0.0; mesh.positions.len()];
    par::for_chunks(&mut weights, par::CHUNK, |start, weights| {
        let mut probe = Probe::new(&field.grid);
        for (v, weight) in (start..).zip(weights) {
            let inward = unit(&links.normal(mesh, v)) * (DEPTH * spacing);
            let behind = probe.trilinear(mesh.positions[v] - inward) / field.threshold;
            let t = (behind - 0.5).clamp(0.0, 1.0);
            *weight = thin + (1.0 - thin) * t * t * (3.0 - 2.0 * t);
        }
    });
    weights
}

/// Smooths the positions of `mesh`, each vertex by its weight [0..1].
///
/// The mesh is closed: at a rim a vertex has a neighbour that does not have it, and the filter is not bounded. The result
/// does not depend on threads. Triangles stay as they are.
pub fn smooth(mesh: &mut Mesh, weights: &[f32], params: &SmoothingParams, spacing: f32) -> SmoothingStats {
    let links = Links::new(mesh, |_| true);
    smooth_linked(mesh, &links, weights, params, spacing).stats
}

/// What smoothing leaves.
pub(super) struct Smoothed {
    pub(super) stats: SmoothingStats,
    /// The area-weighted normals of the faces around the vertices, not normalised [m²].
    pub(super) normals: Vec<Vec3>,
    /// The vertices that are where they were.
    pub(super) still: Vec<u32>,
}

/// [`smooth`] of a mesh whose half-edges are known.
pub(super) fn smooth_linked(
    mesh: &mut Mesh,
    links: &Links,
    weights: &[f32],
    params: &SmoothingParams,
    spacing: f32,
) -> Smoothed {
    let is_thin = |w: f32| w < 0.5 * (1.0 + params.thin);
    let mut stats = SmoothingStats {
        thin_vertices: count(weights.len(), |v| is_thin(weights[v])),
        ..SmoothingStats::default()
    };
    let umbrella = Umbrella::new(mesh, links, weights);
    if umbrella.edge.is_nan() || umbrella.edge <= 0.0 {
        // All vertices stand in one place, or in none.
        let still = select(weights.len(), |_| true);
        return Smoothed { stats, normals: links.normals(mesh), still };
    }
    let pieces = Pieces::new(mesh);
    let triangles: Vec<u32> = (0..mesh.triangles.len() as u32).collect();
    let target = pieces.volumes(mesh, &triangles);

    // Filter, but less where the surface would lose an edge, and take back what folded.
    let wavelength = f64::from(params.wavelength) * f64::from(spacing);
    let long = response(pass(umbrella.edge, wavelength));
    let short = (params.crease < FLAT).then(|| response(pass(umbrella.edge, EDGE * wavelength)));
    stats.degree = long.len();
    let [moves, at_edges] = umbrella.filter(&mesh.positions, &long, short.as_deref().unwrap_or_default());
    let before = mesh.positions.clone();
    par::update(&mut mesh.positions, |v, x| *x += vector(moves[v]));
    let mut moved = Moved::new(mesh, links, before);
    if short.is_some() {
        let limit = params.crease.to_radians() / (0.5 * wavelength) as f32;
        stats.crease_vertices = keep_edges(&mut moved, &umbrella, [moves, at_edges], limit);
    }
    drop(umbrella);
    moved.restore(&triangles);

    // Pieces that are short beside the wavelength shrink to nothing: they stay as they were.
    let mut now = pieces.volumes(moved.mesh, &triangles);
    let shrank: Vec<bool> =
        now.iter().zip(&target).map(|(now, before)| now.abs() < KEPT * before.abs()).collect();
    let back = select(weights.len(), |v| shrank[pieces.of[v] as usize]);
    moved.put_back(&back);
    moved.refresh(&back);
    for i in (0..now.len()).filter(|&i| shrank[i]) {
        now[i] = target[i];
    }

    give_back(&mut moved, weights, &pieces, [&target, &now], triangles, f64::from(spacing), &mut stats);
    let Moved { before, normals, restored, .. } = moved;
    stats.restored_vertices = count(weights.len(), |v| restored[v] && weights[v] > 0.0);
    stats.longest_move = par::max(before.len(), |v| (mesh.positions[v] - before[v]).norm())
        .map_or(0.0, |(_, longest)| longest);
    let still = select(before.len(), |v| mesh.positions[v] == before[v]);
    Smoothed { stats, normals, still }
}

/// Moves the vertices at edges from where the long filter put them towards where the short one does, and returns how many.
/// `moves` are what both did.
fn keep_edges(moved: &mut Moved, umbrella: &Umbrella, moves: [Vec<Four>; 2], limit: f32) -> usize {
    let [long, short] = &moves;
    let shares = crease_shares(moved, umbrella, limit);
    let creased = select(shares.len(), |v| shares[v] > 0.0);
    change(&creased, &mut moved.mesh.positions, |v, x| {
        *x += (vector(short[v]) - vector(long[v])) * shares[v];
    });
    let mut near = vec![false; shares.len()];
    umbrella.fill(&mut near, |v, neighbours| {
        shares[v] > 0.0 || neighbours.iter().any(|&j| shares[j as usize] > 0.0)
    });
    moved.refresh(&select(near.len(), |v| near[v]));
    creased.len()
}

/// Gives every piece its volume in `target` back, which it has `now`, by an offset of every
/// piece that is still wrong. `triangles` are all.
fn give_back(
    moved: &mut Moved,
    weights: &[f32],
    pieces: &Pieces,
    [target, now]: [&[f64]; 2],
    mut triangles: Vec<u32>,
    spacing: f64,
    stats: &mut SmoothingStats,
) {
    let total: f64 = target.iter().map(|volume| volume.abs()).sum();
    let sizes: Vec<f64> =
        target.iter().map(|volume| volume.abs().max(LEAST * total).max(f64::MIN_POSITIVE)).collect();
    let relative =
        |left: &[f64]| left.iter().map(|left| left.abs()).sum::<f64>() / total.max(f64::MIN_POSITIVE);
    let mut left: Vec<f64> = now.iter().zip(target).map(|(now, before)| now - before).collect();
    let mut vertices = select(weights.len(), |_| true);
    let mut rests = vec![false; sizes.len()];
    stats.volume_change = relative(&left);
    for round in 0..OFFSETS {
        let surplus: Vec<f64> = (0..sizes.len())
            .map(|i| if rests[i] || left[i].abs() < EXACT * sizes[i] { 0.0 } else { left[i] })
            .collect();
        if surplus.iter().all(|&surplus| surplus == 0.0) {
            break;
        }
        // What is right stays so: from round to round there is less to do.
        vertices = narrow(&vertices, |v| surplus[pieces.of[v] as usize] != 0.0);
        triangles = narrow(&triangles, |t| surplus[pieces.of_triangle(moved.mesh, t)] != 0.0);
        moved.offset(weights, pieces, [&vertices, &triangles], &surplus, spacing);
        moved.restore(&triangles);
        let now = pieces.volumes(moved.mesh, &triangles);
        // The first step may go too far; a piece that later ones bring no nearer is as near as rounding lets it.
        for i in (0..sizes.len()).filter(|&i| surplus[i] != 0.0) {
            let now = now[i] - target[i];
            rests[i] |= round > 0 && now.abs() > 0.5 * left[i].abs();
            left[i] = now;
        }
    }
    stats.volume_error = relative(&left);
    stats.worst_piece = left.iter().zip(&sizes).map(|(left, size)| left.abs() / size).fold(0.0, f64::max);
}

/// How much of the edges' own filter every vertex gets instead of the whole: all where the surface as the whole filter
/// leaves it bends by `limit` [rad/m], none where by [`NO_EDGE`] of it.
fn crease_shares(moved: &Moved, umbrella: &Umbrella, limit: f32) -> Vec<f32> {
    let mesh = &*moved.mesh;
    let mut normals = moved.normals.clone();
    let direction = |n: Vec3| n.try_normalize(0.0).unwrap_or_else(Vec3::zeros);
    par::update(&mut normals, |_, n| *n = direction(*n));
    let mut calmed = vec![Vec3::zeros(); normals.len()];
    for _ in 0..CALM {
        umbrella.fill(&mut calmed, |v, neighbours| {
            direction(neighbours.iter().fold(normals[v], |sum, &j| sum + normals[j as usize]))
        });
        std::mem::swap(&mut normals, &mut calmed);
    }
    drop(calmed);

    // How much the normals turn along the edges of every vertex, and how long these are.
    let mut turns = vec![[0.0; 2]; mesh.positions.len()];
    umbrella.fill(&mut turns, |v, neighbours| {
        neighbours.iter().fold([0.0; 2], |[turn, length], &j| {
            let turned = (normals[j as usize] - normals[v]).norm_squared();
            [turn + turned, length + (mesh.positions[j as usize] - mesh.positions[v]).norm_squared()]
        })
    });
    let mut shares = vec![0.0; turns.len()];
    umbrella.fill(&mut shares, |v, neighbours| {
        // A single vertex says little: small triangles lean as they please.
        let around = neighbours.iter().map(|&j| turns[j as usize]);
        let [turn, length] = around.fold(turns[v], |sum, of| [sum[0] + of[0], sum[1] + of[1]]);
        // A neighbour along an edge does not turn: on average half of the square is seen.
        let bend = (2.0 * turn / length).sqrt();
        let t = ((bend / limit - NO_EDGE) / (1.0 - NO_EDGE)).clamp(0.0, 1.0);
        if t.is_nan() { 0.0 } else { t * t * (3.0 - 2.0 * t) }
    });
    shares
}

fn vector([x, y, z, _]: Four) -> Vec3 {
    Vec3::new(x, y, z)
}

/// How many indices below `count` are as asked.
fn count(count: usize, is: impl Fn(usize) -> bool + Sync) -> usize {
    par::map_chunks(count, par::CHUNK, |range| range.filter(|&i| is(i)).count()).into_iter().sum()
}
