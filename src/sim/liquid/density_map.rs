//! Density map of a sampled solid ([koschier17]): the density that the solid contributes to the liquid near it.
//!
//! *Method*: instead of sampling the solid with boundary particles, the kernel is integrated over the solid at the nodes
//! of a grid, once. Edges, corners and thin parts are included.
//! *Departs from the paper*: the grid does not store the density itself but the distance at which a half space contributes
//! the same density. On flat parts this is the distance to the surface, so that interpolation is exact there, and the
//! closed forms of the half space give density and gradient.
//!
//! Symbols: h → `support`; all lengths in the unit of the mesh's file.
//! Limits: cells of the grid are cut linearly, so edges are blurred by half a voxel: at 4 voxels in h the density at an
//! edge or corner is 0.02 too large. Flat parts are exact, because the same sum over half spaces is inverted.

use super::calibration::RestState;
use crate::{math::Vec3, par, sdf::Sampled, solid::MeshShape};
use std::sync::Arc;

/// Most voxels in h; a finer grid is coarsened: its cost grows with the cube, without a gain.
const MAX_VOXELS_IN_SUPPORT: f32 = 6.0;

/// Fewest voxels in h: with fewer the sum has too few terms to be better than a half space. A coarser mesh is sampled between its
/// nodes.
const MIN_VOXELS_IN_SUPPORT: f32 = 2.5;

/// Most nodes of a grid that is finer than the mesh's: 16 MB.
const MAX_NODES: f32 = 4e6;

/// The mesh with the distances of the equivalent half spaces; `None` if the grid for a coarse mesh would be too large.
pub(super) fn equivalent_distances(mesh: &MeshShape, rest: &RestState) -> Option<MeshShape> {
    let (field, scale) = (mesh.samples(), mesh.scale);
    let (support, shift) = (rest.support / scale, rest.wall_shift / scale);
    let finest = support / field.voxel;
    let voxel = if finest < MIN_VOXELS_IN_SUPPORT {
        field.voxel / (MIN_VOXELS_IN_SUPPORT / finest).ceil()
    } else {
        field.voxel * (finest / MAX_VOXELS_IN_SUPPORT).ceil()
    };
    let reach = (support / voxel).ceil() as i32;
    let size = (field.end() - field.origin) / voxel;
    if finest < MIN_VOXELS_IN_SUPPORT && size.add_scalar(2.0 * reach as f32 + 1.0).product() > MAX_NODES {
        return None;
    }

    // A grid that contains everything within h of the mesh, and the solid fraction of its cells.
    let origin = field.origin - Vec3::repeat(reach as f32 * voxel);
    let extent = field.end() - field.origin;
    let nodes: [u32; 3] =
        std::array::from_fn(|axis| (extent[axis] / voxel).ceil() as u32 + 1 + 2 * reach as u32);
    let [nx, ny, nz] = nodes.map(|n| n as usize);
    let place = |i: usize| [i % nx, i / nx % ny, i / (nx * ny)];
    let mut values = vec![0.0; nx * ny * nz];
    par::fill(&mut values, |i| field.sample(origin + Vec3::from(place(i).map(|n| n as f32)) * voxel).0);
    let full: Vec<f32> = values.iter().map(|d| (0.5 - (d + shift) / voxel).clamp(0.0, 1.0)).collect();

    // Weights of the kernel around a node.
    let side = || -reach..=reach;
    let all = side().flat_map(|z| side().flat_map(move |y| side().map(move |x| [x, y, z])));
    let weight = |o: [i32; 3]| {
        let q2 = o.map(|c| f64::from(c * c)).iter().sum::<f64>() * f64::from(voxel / support).powi(2);
        rest.kernel.density(q2.sqrt().min(1.0)) as f32
    };
    let stencil: Vec<([i32; 3], f32)> =
        all.map(|o| (o, weight(o))).filter(|&(_, weight)| weight > 0.0).collect();
    let whole: f32 = stencil.iter().map(|(_, weight)| weight).sum();
    let half_space_table = half_space_table(&stencil, whole, voxel / support);

    // Near the surface, the distance of the half space with the same density; elsewhere the distance itself.
    par::update(&mut values, |i, value| {
        if value.abs() > support {
            return;
        }
        let at = place(i).map(|n| n as i32);
        let share: f32 = stencil
            .iter()
            .map(|&(o, weight)| {
                let [x, y, z] = [0, 1, 2].map(|axis| (at[axis] + o[axis]) as usize);
                if x < nx && y < ny && z < nz { weight * full[x + nx * (y + ny * z)] } else { 0.0 }
            })
            .sum();
        *value = distance_of(share / whole, &half_space_table) * support - shift;
    });
    let mut out = mesh.clone();
    out.fill(Arc::new(Sampled { origin, voxel, nodes, values }));
    Some(out)
}

/// Densities of half spaces at distances from -[`TABLE_REACH`] to [`TABLE_REACH`], in h, by the same sum as for the mesh.
fn half_space_table(stencil: &[([i32; 3], f32)], whole: f32, voxel_in_h: f32) -> Vec<f32> {
    let share = |d: f32| {
        let full = |z: i32| (0.5 - d / voxel_in_h - z as f32).clamp(0.0, 1.0);
        stencil.iter().map(|&([_, _, z], weight)| weight * full(z)).sum::<f32>() / whole
    };
    (0..=TABLE_INTERVALS)
        .map(|i| share(TABLE_REACH * (2.0 * i as f32 / TABLE_INTERVALS as f32 - 1.0)))
        .collect()
}

/// Intervals of the table of half spaces.
const TABLE_INTERVALS: usize = 128;

/// Largest distance in the table, in h: beyond it the sum, which blurs by half a voxel, is 0 or 1.
const TABLE_REACH: f32 = 1.25;

/// Distance, in h, at which a half space contributes this density.
fn distance_of(share: f32, half_space_table: &[f32]) -> f32 {
    let after = half_space_table.partition_point(|&other| other > share).clamp(1, TABLE_INTERVALS);
    let (a, b) = (half_space_table[after - 1], half_space_table[after]);
    let part = if a > b { ((a - share) / (a - b)).clamp(0.0, 1.0) } else { 0.0 };
    TABLE_REACH * (2.0 * ((after - 1) as f32 + part) / TABLE_INTERVALS as f32 - 1.0)
}
