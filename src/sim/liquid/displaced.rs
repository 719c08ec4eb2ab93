//! How much density a sampled body displaces, its edges, corners and thin parts included.
//!
//! *Method*: as in density maps [koschier17], the kernel is integrated over the solid at the nodes of a grid, once.
//! *Departs from the paper*: what is kept is not the share but the distance at which a half space would have that
//! share. On flat parts it is the distance itself, so that interpolation is exact there, and the closed forms of the
//! half space give share and slope.
//!
//! Symbols: h → `support`; all lengths in the unit of the mesh's file.
//! Limits: cells of the grid are cut linearly, so edges are blurred by half a voxel: at 4 voxels in h the share at an
//! edge or corner comes out 0.02 too large. The same sum over half spaces is what is inverted, so flat parts are not.

use super::rest::Rest;
use crate::{math::Vec3, par, sdf::Sampled, solid::MeshShape};
use std::sync::Arc;

/// Voxels in h beyond which the grid is coarsened: cost grows with the cube of it, and nothing is gained.
const FINEST: f32 = 6.0;

/// Below so many voxels in h the sum has too few terms to be better than a half space.
const COARSEST: f32 = 2.5;

/// The mesh with the distances of the half spaces that displace as much; `None` if its voxels are too large for that.
pub(super) fn equivalent(mesh: &MeshShape, rest: &Rest) -> Option<MeshShape> {
    let (field, scale) = (mesh.samples(), mesh.scale);
    let (support, shift) = (rest.support / scale, rest.wall_shift / scale);
    let finest = support / field.voxel;
    if finest < COARSEST {
        return None;
    }
    let voxel = field.voxel * (finest / FINEST).ceil();
    let reach = (support / voxel).ceil() as i32;

    // A grid that holds everything within h of the mesh, and how full of solid its cells are.
    let origin = field.origin - Vec3::repeat(reach as f32 * voxel);
    let extent = field.end() - field.origin;
    let nodes: [u32; 3] =
        std::array::from_fn(|axis| (extent[axis] / voxel).ceil() as u32 + 1 + 2 * reach as u32);
    let [nx, ny, nz] = nodes.map(|n| n as usize);
    let place = |i: usize| [i % nx, i / nx % ny, i / (nx * ny)];
    let mut values = vec![0.0; nx * ny * nz];
    par::fill(&mut values, |i| field.sample(origin + Vec3::from(place(i).map(|n| n as f32)) * voxel).0);
    let full: Vec<f32> = values.iter().map(|d| (0.5 - (d + shift) / voxel).clamp(0.0, 1.0)).collect();

    // The kernel's weights around a node.
    let side = || -reach..=reach;
    let all = side().flat_map(|z| side().flat_map(move |y| side().map(move |x| [x, y, z])));
    let weight = |o: [i32; 3]| {
        let q2 = o.map(|c| f64::from(c * c)).iter().sum::<f64>() * f64::from(voxel / support).powi(2);
        rest.kernel.density(q2.sqrt().min(1.0)) as f32
    };
    let stencil: Vec<([i32; 3], f32)> =
        all.map(|o| (o, weight(o))).filter(|&(_, weight)| weight > 0.0).collect();
    let whole: f32 = stencil.iter().map(|(_, weight)| weight).sum();
    let half_spaces = half_spaces(&stencil, whole, voxel / support);

    // Near the surface, the distance of the half space with the same share; elsewhere the distance stays.
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
        *value = distance_of(share / whole, &half_spaces) * support - shift;
    });
    let mut out = mesh.clone();
    out.fill(Arc::new(Sampled { origin, voxel, nodes, values }));
    Some(out)
}

/// Shares of half spaces at distances from -[`WIDEST`] to it, in h, by the same sum as for the mesh.
fn half_spaces(stencil: &[([i32; 3], f32)], whole: f32, voxel_in_h: f32) -> Vec<f32> {
    let share = |d: f32| {
        let full = |z: i32| (0.5 - d / voxel_in_h - z as f32).clamp(0.0, 1.0);
        stencil.iter().map(|&([_, _, z], weight)| weight * full(z)).sum::<f32>() / whole
    };
    (0..=ENTRIES).map(|i| share(WIDEST * (2.0 * i as f32 / ENTRIES as f32 - 1.0))).collect()
}

/// Entries of that table, less one.
const ENTRIES: usize = 128;

/// Where the sum, which blurs by half a voxel, has reached all or nothing, in h.
const WIDEST: f32 = 1.25;

/// The distance, in h, at which a half space has this share.
fn distance_of(share: f32, half_spaces: &[f32]) -> f32 {
    let after = half_spaces.partition_point(|&other| other > share).clamp(1, ENTRIES);
    let (a, b) = (half_spaces[after - 1], half_spaces[after]);
    let part = if a > b { ((a - share) / (a - b)).clamp(0.0, 1.0) } else { 0.0 };
    WIDEST * (2.0 * ((after - 1) as f32 + part) / ENTRIES as f32 - 1.0)
}
