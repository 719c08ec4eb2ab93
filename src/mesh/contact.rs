//! Fitting of a surface to solids.
//!
//! *Method*: particles that rest on a solid give a surface a few hundredths of a spacing off it, which curves away within a
//! spacing of its edge: between water and glass there is a rounded gap. Vertices that face a solid within a distance r are
//! displaced along its normal to the distance of the gap, those between r and 2 r by a part that falls to zero, so that a drop
//! joins a wall without a jump; vertices inside are displaced out. Vertices whose normals point along the solid or away from it
//! stay: the free surface ends at the solid. Triangles that fold or collapse get their vertices back.
//! *Departs from the paper*: none.
//!
//! Symbols: d distance to the solid [m]; m → `m`, its unit normal out of it; r → `reach`, gap → `gap` [m].
//! Limits: an edge between two faces or two solids is filled up to the chamfer that the nearest faces leave. A solid thinner
//! than a spacing that liquid surrounds has no surface around it, and is not cut out. Vertices deeper inside than 2 r stay and
//! are counted.

use super::{
    ContactParams, Mesh,
    displaced::{DisplacedMesh, select},
    half_edges::HalfEdges,
    smooth::smooth_step,
};
use crate::{
    math::Vec3,
    par,
    solid::{Pose, Shape, Solid},
};
use std::borrow::Cow;

/// Cosine of the angle between a vertex's normal and the direction into the solid from which it begins to be displaced …
const FACING_START: f32 = 0.2;

/// … and from which it is displaced entirely. If both are smaller, the free surface climbs along the solid; if larger, more of the
/// rounded edge remains.
const FACING_END: f32 = 0.6;

/// Maximum number of corrections by the distance at the new position: those of sampled and curved solids are not linear.
const MAX_CORRECTIONS: usize = 3;

/// Distance from the gap that is not corrected further [reaches].
const GAP_TOLERANCE: f32 = 1e-3;

/// A solid in its pose at the time of a frame.
#[derive(Clone, Debug)]
pub struct PlacedSolid<'a> {
    shape: Cow<'a, Shape>,
    pose: Pose,
}

/// Result of fitting a surface to solids.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[non_exhaustive]
pub struct ContactStats {
    /// Vertices that were displaced.
    pub displaced: usize,
    /// Vertices that stay where they were because triangles would have folded.
    pub restored: usize,
    /// Vertices too deep inside of a solid to be displaced.
    pub inside: usize,
}

impl<'a> PlacedSolid<'a> {
    /// The solids at `time` [s].
    ///
    /// Meshes among them are filled.
    pub fn at(solids: &'a [Solid], time: f64) -> Vec<Self> {
        let place = |solid: &'a Solid| {
            let pose = solid.motion.as_ref().map_or_else(Pose::identity, |motion| motion.pose(time));
            Self { shape: solid.shape_at(time), pose }
        };
        solids.iter().map(place).collect()
    }

    /// Solids in these poses.
    pub(crate) fn in_poses(solids: &'a [Solid], poses: Vec<Pose>) -> impl Iterator<Item = Self> {
        solids.iter().zip(poses).map(|(solid, pose)| Self { shape: Cow::Borrowed(&solid.shape), pose })
    }

    /// The solid in a frame of this origin [m].
    pub(super) fn in_frame(&self, origin: &nalgebra::Vector3<f64>) -> Self {
        let position = (self.pose.position.cast::<f64>() - origin).cast();
        Self { pose: Pose { position, ..self.pose }, shape: self.shape.clone() }
    }

    /// Distance of `x` [m] and the unit normal out of the solid.
    fn contact(&self, x: Vec3) -> (f32, Vec3) {
        let (d, m) = self.shape.contact(self.pose.to_local(x));
        (d, self.pose.rotation * m)
    }

    /// Whether any point within `radius` [m] of `x` may be nearer than `distance` [m].
    fn is_near(&self, x: Vec3, radius: f32, distance: f32) -> bool {
        self.shape.signed_distance(self.pose.to_local(x)) <= radius + distance
    }
}

/// Fits `mesh`, of particles `spacing` [m] apart, to solids.
///
/// `normals` are the area-weighted ones of the faces around its vertices. Its triangles do not change. The result does not depend on
/// threads.
pub(super) fn fit_to_solids(
    mesh: &mut Mesh,
    half_edges: &HalfEdges,
    normals: Vec<Vec3>,
    solids: &[PlacedSolid],
    params: &ContactParams,
    spacing: f32,
) -> FittedMesh {
    let distances =
        ContactDistances { reach: params.reach.max(params.gap.abs()) * spacing, gap: params.gap * spacing };
    let before = mesh.positions.clone();
    let inside = par::map_chunks_mut([&mut mesh.positions], par::CHUNK, |start, [positions]| {
        let near = near_solids(positions, solids, 2.0 * distances.reach);
        if near.is_empty() {
            return 0;
        }
        let mut inside = 0;
        for (v, x) in (start..).zip(positions) {
            let normal = normals[v].try_normalize(0.0).unwrap_or_else(Vec3::zeros);
            let (fitted, is_inside) = distances.fitted_position(*x, normal, &near);
            *x = fitted;
            inside += usize::from(is_inside);
        }
        inside
    });
    let is_moved = |v: usize, mesh: &Mesh| mesh.positions[v] != before[v];
    let displaced = select(before.len(), |v| is_moved(v, mesh));
    let mut fitted = FittedMesh {
        stats: ContactStats { inside: inside.into_iter().sum(), ..ContactStats::default() },
        normals,
        ..FittedMesh::default()
    };
    if displaced.is_empty() {
        return fitted;
    }
    let mut changed = DisplacedMesh::with_normals(mesh, half_edges, before, fitted.normals);
    fitted.around = changed.with_neighbours(&displaced);
    changed.refresh(&fitted.around);
    // Unfolding would take vertices off the solids again.
    let triangles = changed.triangles_of(&fitted.around);
    changed.restore(&triangles);
    fitted.stats.restored = displaced.iter().filter(|&&v| changed.restored[v as usize]).count();
    fitted.stats.displaced = displaced.len() - fitted.stats.restored;
    fitted.normals = changed.normals;
    fitted
}

/// A mesh fitted to solids.
#[derive(Debug, Default)]
pub(super) struct FittedMesh {
    pub(super) stats: ContactStats,
    /// The vertices whose normals have changed, in ascending order.
    pub(super) around: Vec<u32>,
    /// Area-weighted normals of the faces around all vertices, not normalised [m²].
    pub(super) normals: Vec<Vec3>,
}

/// The solids that may be nearer than `distance` [m] to one of these points.
fn near_solids<'a>(
    points: &[Vec3],
    solids: &'a [PlacedSolid<'a>],
    distance: f32,
) -> Vec<&'a PlacedSolid<'a>> {
    let Some(&first) = points.first() else { return Vec::new() };
    let (low, high) = points.iter().fold((first, first), |(low, high), x| (low.inf(x), high.sup(x)));
    let (middle, radius) = ((low + high) / 2.0, 0.5 * (high - low).norm());
    solids.iter().filter(|solid| solid.is_near(middle, radius, distance)).collect()
}

/// Distances of the fit [m].
#[derive(Clone, Copy)]
struct ContactDistances {
    reach: f32,
    gap: f32,
}

impl ContactDistances {
    /// Where a vertex at `x` with this unit normal belongs, and whether it is too deep inside of a solid.
    fn fitted_position(&self, mut x: Vec3, normal: Vec3, solids: &[&PlacedSolid]) -> (Vec3, bool) {
        // Drawn to all of them, the vertices of an edge between two would collapse on a line.
        let contacts = solids.iter().map(|solid| (solid.contact(x), solid));
        let Some(((d, m), nearest)) = contacts.min_by(|(a, _), (b, _)| a.0.total_cmp(&b.0)) else {
            return (x, false);
        };
        let target = self.distance(d, smooth_step(FACING_START, FACING_END, -normal.dot(&m)));
        x = self.displaced(x, d, m, target, nearest);
        // It may now be inside of another.
        for solid in solids.iter().filter(|_| solids.len() > 1) {
            let (d, m) = solid.contact(x);
            x = self.displaced(x, d, m, self.distance(d, 0.0), solid);
        }
        (x, d < -2.0 * self.reach)
    }

    /// The distance at which a vertex at distance `d` [m] belongs, which faces the solid by this part.
    fn distance(&self, d: f32, facing: f32) -> f32 {
        let Self { reach, gap } = *self;
        if d < gap {
            return if d < -2.0 * reach { d } else { gap };
        }
        let near = gap + (2.0 * reach - gap) * ((d - reach) / reach).max(0.0);
        d + facing * (near - d).min(0.0)
    }

    /// A point at distance `d` [m] and normal `m` of a solid, displaced to the distance `target`.
    fn displaced(&self, mut x: Vec3, mut d: f32, mut m: Vec3, target: f32, solid: &PlacedSolid) -> Vec3 {
        for _ in 0..MAX_CORRECTIONS {
            if d.is_nan() || (d - target).abs() <= GAP_TOLERANCE * self.reach {
                break;
            }
            x += m * (target - d);
            (d, m) = solid.contact(x);
        }
        x
    }
}
