//! Closing of small cavities: closed pockets of air in the liquid.
//!
//! *Method*: a cavity is a connected component of the surface that is oriented inwards, so that its volume by
//! the divergence theorem is negative. The isosurface has liquid on one side of every component. Liquid is
//! bounded, hence a component with liquid around it lies inside of another one. Cavities below a volume are
//! removed, together with the droplets in them: components oriented outwards, smaller than the cavity, whose first vertex has
//! the winding number −1 with respect to the cavity, by the solid angles of its triangles
//! [oosterom83].
//!
//! The gaps between particles are such pockets: anisotropic kernels leave some where their axes diverge. On
//! 20 frames of a dam break they come and go from one frame to the next.
//!
//! Limits: the surface is closed. A cavity that is open to the outside is a hole or a bay and stays.

use super::{Mesh, components::Components};
use crate::{
    math::{Vec3, elementary::atan2},
    par,
};
use std::f64::consts::PI;

/// Result of closing cavities.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
#[non_exhaustive]
pub struct CavityStats {
    /// Cavities that were closed.
    pub closed: usize,
    /// Volume of these cavities [m³].
    pub volume: f64,
    /// Droplets inside of these cavities, which were removed with them.
    pub droplets: usize,
    /// Cavities that remain, because they are larger.
    pub remaining: usize,
}

/// What [`close`] made of a mesh.
pub(super) struct ClosedCavities {
    pub(super) stats: CavityStats,
    /// Which of the former vertices remain; empty if all do.
    pub(super) kept: Vec<bool>,
    /// Number of remaining components.
    pub(super) components: usize,
}

/// Removes the cavities with a volume below `smallest` [m³] from a closed `mesh` without normals and
/// attributes.
///
/// # Panics
/// If the mesh has normals or attributes.
pub fn close_cavities(mesh: &mut Mesh, smallest: f64) -> CavityStats {
    close(mesh, smallest).stats
}

/// [`close_cavities`], with the numbers of what remains.
pub(super) fn close(mesh: &mut Mesh, smallest: f64) -> ClosedCavities {
    assert!(mesh.normals.is_empty() && mesh.attributes.is_empty(), "a mesh of positions and triangles");
    let components = Components::new(mesh);
    let volumes = components.all_volumes(mesh);
    let mut removed: Vec<bool> = volumes.iter().map(|&volume| volume < 0.0 && -volume < smallest).collect();
    let cavities: Vec<usize> = (0..removed.len()).filter(|&component| removed[component]).collect();
    let mut stats = CavityStats {
        closed: cavities.len(),
        volume: -cavities.iter().map(|&cavity| volumes[cavity]).sum::<f64>(),
        droplets: 0,
        remaining: volumes.iter().filter(|&&volume| volume < 0.0).count() - cavities.len(),
    };
    if cavities.is_empty() {
        return ClosedCavities { stats, kept: Vec::new(), components: removed.len() };
    }
    for droplet in droplets_inside(mesh, &components, &volumes, &cavities) {
        removed[droplet] = true;
        stats.droplets += 1;
    }
    let kept = components.remove(mesh, &removed);
    ClosedCavities { stats, kept, components: removed.len() - stats.closed - stats.droplets }
}

/// A box [m].
#[derive(Clone, Copy)]
struct Bounds {
    low: Vec3,
    high: Vec3,
}

impl Bounds {
    fn contain(&self, other: &Self) -> bool {
        (0..3).all(|axis| self.low[axis] <= other.low[axis] && other.high[axis] <= self.high[axis])
    }
}

/// The droplets inside of some of the components, in ascending order.
fn droplets_inside(mesh: &Mesh, components: &Components, volumes: &[f64], cavities: &[usize]) -> Vec<usize> {
    let empty = Bounds { low: Vec3::repeat(f32::INFINITY), high: Vec3::repeat(f32::NEG_INFINITY) };
    let mut bounds = vec![empty; volumes.len()];
    for (x, &component) in mesh.positions.iter().zip(&components.of) {
        let Bounds { low, high } = &mut bounds[component as usize];
        (*low, *high) = (low.inf(x), high.sup(x));
    }
    let width = |&cavity: &usize| bounds[cavity].high.x - bounds[cavity].low.x;
    let widest = cavities.iter().map(width).fold(0.0, f32::max);
    let mut by_x = cavities.to_vec();
    by_x.sort_by(|&a, &b| bounds[a].low.x.total_cmp(&bounds[b].low.x));

    // Pairs of a droplet and a cavity whose box contains it.
    let largest = cavities.iter().map(|&cavity| -volumes[cavity]).fold(0.0, f64::max);
    let mut pairs = Vec::new();
    for droplet in
        (0..volumes.len()).filter(|&component| volumes[component] > 0.0 && volumes[component] < largest)
    {
        let x = bounds[droplet].low.x;
        let from = by_x.partition_point(|&cavity| bounds[cavity].low.x < x - widest);
        let near = by_x[from..].iter().take_while(|&&cavity| bounds[cavity].low.x <= x);
        let around = |&&cavity: &&usize| {
            volumes[droplet] < -volumes[cavity] && bounds[cavity].contain(&bounds[droplet])
        };
        pairs.extend(near.filter(around).map(|&cavity| (droplet, cavity)));
    }
    if pairs.is_empty() {
        return Vec::new();
    }

    // Those that are inside indeed.
    let mut triangles = vec![Vec::new(); volumes.len()];
    let mut is_listed = vec![false; volumes.len()];
    pairs.iter().for_each(|&(_, cavity)| is_listed[cavity] = true);
    for (t, triangle) in mesh.triangles.iter().enumerate() {
        let component = components.of_triangle(mesh, t);
        if is_listed[component] {
            triangles[component].push(*triangle);
        }
    }
    let is_inside = par::map(pairs.len(), |i| {
        let (droplet, cavity) = pairs[i];
        let x = mesh.positions[components.first[droplet] as usize];
        winding_number(mesh, &triangles[cavity], x) < -0.5
    });
    let inside = pairs.into_iter().zip(is_inside).filter(|&(_, is_inside)| is_inside);
    let mut inside: Vec<usize> = inside.map(|((droplet, _), _)| droplet).collect();
    inside.dedup();
    inside
}

/// How often closed `triangles` wind around `x` [m], counter-clockwise seen from outside.
fn winding_number(mesh: &Mesh, triangles: &[[u32; 3]], x: Vec3) -> f64 {
    let x = x.cast::<f64>();
    let angles = triangles.iter().map(|triangle| {
        let [a, b, c] = triangle.map(|v| mesh.positions[v as usize].cast::<f64>() - x);
        let [la, lb, lc] = [a, b, c].map(|side| side.norm());
        let below = la * lb * lc + a.dot(&b) * lc + b.dot(&c) * la + c.dot(&a) * lb;
        2.0 * atan2(a.dot(&b.cross(&c)), below) // [oosterom83] Eq. 8
    });
    angles.sum::<f64>() / (4.0 * PI)
}
