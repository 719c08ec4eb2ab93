//! Connected components of a mesh: their vertices and volumes, and the removal of the small ones.
//!
//! *Method*: union-find over the triangles; volume V = ⅙ Σ a·(b × c) and its centre Σ (a + b + c)/4 · ⅙ a·(b
//! × c) / V by the divergence theorem, measured from the component's first vertex. A removed component
//! becomes a point at its centre with the radius of the ball of its volume, r = ∛(3V/4π).
//!
//! A surface that faces inwards bounds a bubble: its volume is negative. Small bubbles are filled, and give
//! no point. A removed component takes its bubbles with it, because they are smaller than it is. A component
//! without volume, flattened by rounding far from the origin, becomes a point of radius 0 at its first
//! vertex.

use super::{ComponentParams, Mesh};
use crate::math::elementary::cbrt;
use crate::{frame::Channel, math::Vec3, par};
use std::f64::consts::PI;

/// Volumes below this part of the smallest volume that stays are rounding errors: their sign does not
/// distinguish a bubble from a drop. If it is larger, real bubbles become points.
const BUBBLE_TOLERANCE: f64 = 1e-9;

/// Small connected components as points.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Points {
    /// Centres of volume, relative to `origin` [m].
    pub positions: Vec<Vec3>,
    /// Origin of the positions [m], that of the mesh.
    pub origin: nalgebra::Vector3<f64>,
    /// Radii of the balls of the same volumes [m].
    pub radii: Vec<f32>,
    /// Attributes with the names of the mesh's.
    pub attributes: Vec<Channel>,
}

/// Result of the removal of small components.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
#[non_exhaustive]
pub struct ComponentStats {
    /// Components that became points.
    pub points: usize,
    /// Volume of the components that became points [m³].
    pub points_volume: f64,
    /// Bubbles that were filled, or removed with the component around them.
    pub bubbles: usize,
    /// Volume of these bubbles [m³].
    pub bubbles_volume: f64,
    /// Triangles removed.
    pub triangles: usize,
}

/// The connected components of a mesh, numbered by their first vertices.
pub(super) struct Components {
    /// The component of every vertex.
    pub(super) of: Vec<u32>,
    /// The first vertex of every component.
    pub(super) first: Vec<u32>,
}

impl Components {
    /// The components of all triangles of `mesh`.
    pub(super) fn new(mesh: &Mesh) -> Self {
        Self::of_triangles(mesh, |_| true)
    }

    /// The components of the triangles that `counts` selects; a vertex without such a triangle is a component
    /// by itself.
    pub(super) fn of_triangles(mesh: &Mesh, counts: impl Fn(usize) -> bool + Sync) -> Self {
        let forest = par::Forest::new(mesh.positions.len());
        par::map_chunks(mesh.triangles.len(), par::CHUNK, |range| {
            for [a, b, c] in range.filter(|&t| counts(t)).map(|t| mesh.triangles[t]) {
                forest.join(a, b);
                forest.join(a, c);
            }
        });
        // A root is the lowest vertex of its component, so it is numbered before the others refer to it.
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

    /// The volume [m³] and its first moment about the component's first vertex [m⁴], of every component.
    fn moments(&self, mesh: &Mesh) -> Vec<Moments> {
        let mut sums = vec![Moments::default(); self.first.len()];
        let parts = self.gather(
            mesh.triangles.len(),
            |t| self.of_triangle(mesh, t),
            |t, sum: &mut Moments, component| {
                let [a, b, c] = self.corners(mesh, t, component);
                let volume = a.dot(&b.cross(&c)) / 6.0;
                sum.volume += volume;
                sum.first += (a + b + c) * (0.25 * volume);
            },
        );
        for (component, part) in parts {
            sums[component].volume += part.volume;
            sums[component].first += part.first;
        }
        sums
    }

    /// The volume of every component [m³], negative if it is oriented inwards.
    pub(super) fn all_volumes(&self, mesh: &Mesh) -> Vec<f64> {
        self.volumes_of(mesh, mesh.triangles.len(), |i| i)
    }

    /// Removes some of the components from `mesh`, which has neither normals nor attributes yet. The others
    /// keep their order. Returns which vertices remain.
    pub(super) fn remove(&self, mesh: &mut Mesh, removed: &[bool]) -> Vec<bool> {
        let kept: Vec<bool> = self.of.iter().map(|&component| !removed[component as usize]).collect();
        mesh.triangles.retain(|triangle| kept[triangle[0] as usize]);
        let mut number = vec![0; mesh.positions.len()];
        let mut positions = Vec::new();
        for (v, &x) in mesh.positions.iter().enumerate() {
            if kept[v] {
                number[v] = positions.len() as u32;
                positions.push(x);
            }
        }
        mesh.positions = positions;
        par::update(&mut mesh.triangles, |_, triangle| *triangle = triangle.map(|v| number[v as usize]));
        kept
    }

    /// The volume [m³] of every component with some of these triangles, as far as they bound it; 0 for the
    /// others.
    pub(super) fn volumes(&self, mesh: &Mesh, triangles: &[u32]) -> Vec<f64> {
        self.volumes_of(mesh, triangles.len(), |i| triangles[i] as usize)
    }

    fn volumes_of(&self, mesh: &Mesh, count: usize, triangle: impl Fn(usize) -> usize + Sync) -> Vec<f64> {
        let mut sums = vec![0.0; self.first.len()];
        let of = |i: usize| self.of_triangle(mesh, triangle(i));
        let parts = self.gather(count, of, |i, sum: &mut f64, component| {
            let [a, b, c] = self.corners(mesh, triangle(i), component);
            *sum += a.dot(&b.cross(&c)) / 6.0;
        });
        parts.for_each(|(component, part)| sums[component] += part);
        sums
    }

    /// The corners of a triangle, relative to the component's first vertex [m].
    #[inline]
    pub(super) fn corners(&self, mesh: &Mesh, t: usize, component: usize) -> [nalgebra::Vector3<f64>; 3] {
        let origin = mesh.positions[self.first[component] as usize].cast::<f64>();
        mesh.triangles[t].map(|v| mesh.positions[v as usize].cast::<f64>() - origin)
    }

    /// The component of a triangle.
    pub(super) fn of_triangle(&self, mesh: &Mesh, t: usize) -> usize {
        self.of[mesh.triangles[t][0] as usize] as usize
    }

    /// Sums over `i` in `0..count`, one per run of equal components within a chunk: to be folded in order.
    pub(super) fn gather<T: Default + Send>(
        &self,
        count: usize,
        component: impl Fn(usize) -> usize + Sync,
        add: impl Fn(usize, &mut T, usize) + Sync,
    ) -> impl Iterator<Item = (usize, T)> {
        par::map_chunks(count, par::CHUNK, |range| {
            let mut runs = Vec::new();
            let mut run = (component(range.start), T::default());
            for i in range {
                let component = component(i);
                if run.0 != component {
                    runs.push(std::mem::replace(&mut run, (component, T::default())));
                }
                add(i, &mut run.1, component);
            }
            runs.push(run);
            runs
        })
        .into_iter()
        .flatten()
    }
}

/// A component's volume [m³] and its first moment about its first vertex [m⁴].
#[derive(Clone, Copy, Debug, Default)]
struct Moments {
    volume: f64,
    first: nalgebra::Vector3<f64>,
}

/// Removes the components below `params.smallest` particle volumes from `mesh`, which has neither normals nor
/// attributes yet, and returns them as points.
pub fn remove_small(mesh: &mut Mesh, params: &ComponentParams, spacing: f32) -> (Points, ComponentStats) {
    let components = Components::new(mesh);
    let moments = components.moments(mesh);
    let smallest = f64::from(params.smallest) * f64::from(spacing).powi(3);
    let small: Vec<bool> = moments.iter().map(|moments| moments.volume.abs() < smallest).collect();

    // Make points of the small components, in the order of their first vertices.
    let (mut points, mut stats) = (Points::default(), ComponentStats::default());
    for (component, &Moments { volume, first: moment }) in
        moments.iter().enumerate().filter(|&(component, _)| small[component])
    {
        if volume < -BUBBLE_TOLERANCE * smallest {
            stats.bubbles += 1;
            stats.bubbles_volume -= volume;
            continue;
        }
        let first = mesh.positions[components.first[component] as usize].cast::<f64>();
        let (from_first, volume) = if volume > BUBBLE_TOLERANCE * smallest {
            (moment / volume, volume)
        } else {
            (nalgebra::Vector3::zeros(), 0.0)
        };
        points.positions.push((first + from_first).cast());
        points.radii.push(cbrt(volume * 0.75 / PI) as f32);
        stats.points += 1;
        stats.points_volume += volume;
    }

    // Keep the others, in their order.
    let before = mesh.triangles.len();
    components.remove(mesh, &small);
    stats.triangles = before - mesh.triangles.len();
    (points, stats)
}
