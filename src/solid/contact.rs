//! Signed distances and normals of the shapes; exact but for meshes, which are sampled.
//!
//! *Method* Closest point on each shape, in closed form. *Departs from the paper*: none is followed.
//!
//! Symbols: `x` query point [m], `d` distance to the surface [m], positive where liquid may be, `n` unit normal
//! that points out of the solid.
//!
//! Limits: where the closest point is not unique (a centre, an axis, a medial plane, an edge seen from inside
//! the box) one of the closest points is chosen by a fixed rule, so the normal is always one unit vector. The
//! rounding error of `d` is a few ulps of the largest coordinate involved. Coordinates up to 1e38 m neither
//! overflow nor give a NaN; a query that is itself NaN has a NaN distance but a unit normal.

use super::{Shape, round};
use crate::math::Vec3;

/// Why a shape cannot stand in a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ShapeError {
    /// A box or tank whose `max` does not lie above its `min`.
    #[error("`max` is not above `min` on the {} axis", ["x", "y", "z"][*axis])]
    Inverted {
        /// 0, 1 or 2.
        axis: usize,
    },
    /// A plane whose normal has no direction.
    #[error("`normal` has length zero, so it has no direction")]
    NoDirection,
    /// A ball or capsule whose radius is not positive.
    #[error("`radius` is not above zero")]
    NoRadius,
    /// A torus whose tube, or an ellipsoid whose half length, is not positive, or a torus without a hole.
    #[error("`{field}` is not above zero{}", if *field == "tube" { ", or not below `radius`" } else { "" })]
    OutOfRange {
        /// The parameter at fault.
        field: &'static str,
    },
    /// A mesh whose scale is not positive.
    #[error("`scale` is not above zero")]
    NoScale,
    /// A coordinate or radius that is NaN or infinite.
    #[error("`{field}` is not finite")]
    NotFinite {
        /// The parameter at fault.
        field: &'static str,
    },
}

impl ShapeError {
    /// The parameter of the shape to look at.
    pub fn field(&self) -> &'static str {
        match self {
            Self::Inverted { .. } => "max",
            Self::NoDirection => "normal",
            Self::NoRadius => "radius",
            Self::NoScale => "scale",
            Self::NotFinite { field } | Self::OutOfRange { field } => field,
        }
    }
}

impl Shape {
    /// Distance from `x` to the surface, in metres: positive outside the solid, where liquid may be (for a tank:
    /// inside its box), negative within it. Beyond a mesh's grid, a lower bound.
    #[inline]
    pub fn signed_distance(&self, x: Vec3) -> f32 {
        match self {
            Self::Plane { point, normal } => unit(vec3(normal)).1.dot(&(x - vec3(point))),
            Self::Box { min, max } => box_distance(x, vec3(min), vec3(max)),
            Self::Sphere { center, radius } => unit(x - vec3(center)).0 - radius,
            Self::Capsule { from, to, radius } => unit(off_axis(x, vec3(from), vec3(to))).0 - radius,
            Self::Tank { min, max } => -box_distance(x, vec3(min), vec3(max)),
            Self::Torus { .. } | Self::Ellipsoid { .. } | Self::Disc { .. } => self.contact(x).0,
            Self::Mesh(mesh) => mesh.distance(x),
        }
    }

    /// [`Self::signed_distance`] and the unit normal at the closest surface point, pointing out of the solid.
    ///
    /// The normal has length 1 everywhere, also where several surface points are equally close.
    #[inline]
    pub fn contact(&self, x: Vec3) -> (f32, Vec3) {
        match self {
            Self::Plane { point, normal } => {
                let (_, n) = unit(vec3(normal));
                (n.dot(&(x - vec3(point))), n)
            }
            Self::Box { min, max } => box_contact(x, vec3(min), vec3(max)),
            Self::Sphere { center, radius } => {
                let (r, n) = unit(x - vec3(center));
                (r - radius, n)
            }
            Self::Capsule { from, to, radius } => capsule_contact(x, vec3(from), vec3(to), *radius),
            Self::Tank { min, max } => {
                let (d, n) = box_contact(x, vec3(min), vec3(max));
                (-d, -n)
            }
            Self::Torus { center, axis, radius, tube } => {
                round::torus(x, vec3(center), vec3(axis), *radius, *tube)
            }
            Self::Ellipsoid { center, radii } => round::ellipsoid(x, vec3(center), vec3(radii)),
            Self::Disc { center, normal, radius, thickness } => {
                round::disc(x, vec3(center), vec3(normal), *radius, *thickness)
            }
            Self::Mesh(mesh) => mesh.contact(x),
        }
    }

    /// The distance of the shape's farthest point from its origin [m]; infinite for a plane.
    ///
    /// A tank ends at its walls: whatever the liquid can touch lies there.
    pub fn reach(&self) -> f32 {
        match self {
            Self::Plane { .. } => f32::INFINITY,
            Self::Box { min, max } | Self::Tank { min, max } => vec3(min).abs().sup(&vec3(max).abs()).norm(),
            Self::Sphere { center, radius } => vec3(center).norm() + radius,
            Self::Capsule { from, to, radius } => vec3(from).norm().max(vec3(to).norm()) + radius,
            Self::Torus { center, radius, tube, .. } => vec3(center).norm() + radius + tube,
            Self::Ellipsoid { center, radii } => vec3(center).norm() + vec3(radii).max(),
            Self::Disc { center, radius, thickness, .. } => {
                vec3(center).norm() + (radius * radius + 0.25 * thickness * thickness).sqrt()
            }
            Self::Mesh(mesh) => mesh.corners().iter().map(|corner| corner.norm()).fold(0.0, f32::max),
        }
    }

    /// The radius of the largest ball that fits into the shape [m]; infinite for planes and tanks.
    pub fn inner_radius(&self) -> f32 {
        match self {
            Self::Plane { .. } | Self::Tank { .. } => f32::INFINITY,
            Self::Box { min, max } => 0.5 * (vec3(max) - vec3(min)).min(),
            Self::Sphere { radius, .. } | Self::Capsule { radius, .. } => *radius,
            Self::Torus { tube, .. } => *tube,
            Self::Ellipsoid { radii, .. } => vec3(radii).min(),
            Self::Disc { radius, thickness, .. } => radius.min(0.5 * thickness),
            Self::Mesh(mesh) => mesh.inner_radius(),
        }
    }

    /// Centre of the shape's bounding box and the radius of the smallest ball about it that contains the shape [m]; `None` if it is
    /// unbounded. The radius of meshes is up to one and a half diagonals of a voxel larger; of meshes that deform, that of their bounds.
    pub(crate) fn bounding_ball(&self) -> Option<(Vec3, f32)> {
        let (low, high) = self.bounds()?;
        let center = (low + high) / 2.0;
        let radius = match self {
            Self::Box { .. } => (high - low).norm() / 2.0,
            Self::Sphere { radius, .. } => *radius,
            Self::Capsule { from, to, radius } => (vec3(to) - vec3(from)).norm() / 2.0 + radius,
            Self::Torus { radius, tube, .. } => radius + tube,
            Self::Ellipsoid { radii, .. } => vec3(radii).max(),
            Self::Disc { radius, thickness, .. } => (radius * radius + 0.25 * thickness * thickness).sqrt(),
            Self::Mesh(mesh) => mesh.radius_about(center),
            Self::Plane { .. } | Self::Tank { .. } => return None,
        };
        Some((center, radius))
    }

    /// The lowest and highest corner of a box around the shape [m]; `None` for planes and tanks, which have no end.
    pub fn bounds(&self) -> Option<(Vec3, Vec3)> {
        match self {
            Self::Plane { .. } | Self::Tank { .. } => None,
            Self::Box { min, max } => Some((vec3(min), vec3(max))),
            Self::Sphere { center, radius } => {
                Some((vec3(center).add_scalar(-radius), vec3(center).add_scalar(*radius)))
            }
            Self::Capsule { from, to, radius } => {
                let (from, to) = (vec3(from), vec3(to));
                Some((from.inf(&to).add_scalar(-radius), from.sup(&to).add_scalar(*radius)))
            }
            Self::Torus { center, axis, radius, tube } => {
                let axis = unit(vec3(axis)).1;
                let half = axis.map(|c| radius * (1.0 - c * c).max(0.0).sqrt() + tube);
                Some((vec3(center) - half, vec3(center) + half))
            }
            Self::Ellipsoid { center, radii } => {
                Some((vec3(center) - vec3(radii), vec3(center) + vec3(radii)))
            }
            Self::Disc { center, normal, radius, thickness } => {
                let axis = unit(vec3(normal)).1;
                let half = axis.map(|c| radius * (1.0 - c * c).max(0.0).sqrt() + 0.5 * thickness * c.abs());
                Some((vec3(center) - half, vec3(center) + half))
            }
            Self::Mesh(mesh) => Some(mesh.bounds()),
        }
    }

    /// Whether the shape has a surface at all.
    ///
    /// # Errors
    /// The first parameter at fault. A capsule whose two ends coincide is a ball, and fine.
    pub fn check(&self) -> Result<(), ShapeError> {
        match self {
            Self::Plane { point, normal } => {
                finite("point", point)?;
                finite("normal", normal)?;
                if normal.iter().all(|&c| c == 0.0) { Err(ShapeError::NoDirection) } else { Ok(()) }
            }
            Self::Box { min, max } | Self::Tank { min, max } => {
                finite("min", min)?;
                finite("max", max)?;
                match (0..3).find(|&axis| max[axis] <= min[axis]) {
                    Some(axis) => Err(ShapeError::Inverted { axis }),
                    None => Ok(()),
                }
            }
            Self::Sphere { center, radius } => {
                finite("center", center)?;
                positive(*radius)
            }
            Self::Capsule { from, to, radius } => {
                finite("from", from)?;
                finite("to", to)?;
                positive(*radius)
            }
            Self::Torus { center, axis, radius, tube } => {
                finite("center", center)?;
                finite("axis", axis)?;
                finite("tube", &[*tube])?;
                positive(*radius)?;
                if axis.iter().all(|&c| c == 0.0) {
                    return Err(ShapeError::OutOfRange { field: "axis" });
                }
                if *tube > 0.0 && tube < radius {
                    Ok(())
                } else {
                    Err(ShapeError::OutOfRange { field: "tube" })
                }
            }
            Self::Ellipsoid { center, radii } => {
                finite("center", center)?;
                finite("radii", radii)?;
                let thick = radii.iter().all(|&r| r > 0.0);
                if thick { Ok(()) } else { Err(ShapeError::OutOfRange { field: "radii" }) }
            }
            Self::Disc { center, normal, radius, thickness } => {
                finite("center", center)?;
                finite("normal", normal)?;
                finite("thickness", &[*thickness])?;
                positive(*radius)?;
                if normal.iter().all(|&c| c == 0.0) {
                    return Err(ShapeError::NoDirection);
                }
                if *thickness > 0.0 { Ok(()) } else { Err(ShapeError::OutOfRange { field: "thickness" }) }
            }
            Self::Mesh(mesh) => {
                finite("scale", &[mesh.scale])?;
                finite("rotate", &mesh.rotate)?;
                finite("translate", &mesh.translate)?;
                if mesh.scale > 0.0 { Ok(()) } else { Err(ShapeError::NoScale) }
            }
        }
    }
}

fn finite(field: &'static str, values: &[f32]) -> Result<(), ShapeError> {
    if values.iter().all(|value| value.is_finite()) { Ok(()) } else { Err(ShapeError::NotFinite { field }) }
}

fn positive(radius: f32) -> Result<(), ShapeError> {
    finite("radius", &[radius])?;
    if radius > 0.0 { Ok(()) } else { Err(ShapeError::NoRadius) }
}

#[inline]
fn vec3(values: &[f32; 3]) -> Vec3 {
    Vec3::new(values[0], values[1], values[2])
}

/// Length and direction of `v`, without overflow or underflow; the direction is +Z if `v` has none.
#[inline]
fn unit(v: Vec3) -> (f32, Vec3) {
    // Scaled so that the largest component is 1, the squares neither overflow nor vanish.
    let scale = v.amax();
    let v_scaled = v / scale;
    let length = v_scaled.norm();
    if length > 0.0 && length < f32::INFINITY {
        (scale * length, v_scaled / length)
    } else {
        (v.abs().sum(), Vec3::z())
    }
}

/// Signed excess of `x` over the slab of each axis: positive beyond it, else minus the depth.
#[inline]
fn excess(x: Vec3, min: Vec3, max: Vec3) -> Vec3 {
    Vec3::new((min.x - x.x).max(x.x - max.x), (min.y - x.y).max(x.y - max.y), (min.z - x.z).max(x.z - max.z))
}

#[inline]
fn box_distance(x: Vec3, min: Vec3, max: Vec3) -> f32 {
    box_contact(x, min, max).0
}

/// Distance and normal of a solid box.
#[inline]
fn box_contact(x: Vec3, min: Vec3, max: Vec3) -> (f32, Vec3) {
    let q = excess(x, min, max);
    // The side of each slab that is nearer; the upper one at the middle.
    let side = Vec3::from_fn(|axis, _| if x[axis] - max[axis] >= min[axis] - x[axis] { 1.0 } else { -1.0 });

    // Outside, the closest point is the query clamped to the box.
    let outward = q.map(|c| if c <= 0.0 { 0.0 } else { c }).component_mul(&side);
    if outward.amax() > 0.0 || q.iter().any(|c| c.is_nan()) {
        return unit(outward);
    }

    // Inside and on the surface, the nearest face wins; of equals, the first axis.
    let mut nearest = 0;
    for axis in 1..3 {
        if q[axis] > q[nearest] {
            nearest = axis;
        }
    }
    let mut n = Vec3::zeros();
    n[nearest] = side[nearest];
    (q[nearest], n)
}

/// From the closest point of the segment to `x`.
#[inline]
fn off_axis(x: Vec3, from: Vec3, to: Vec3) -> Vec3 {
    let axis = to - from;
    let along = axis.dot(&(x - from)) / axis.norm_squared();
    // Ends that coincide (0/0) and overflowing squares leave no usable parameter: the capsule is then a ball.
    let t = if along.is_finite() { along.clamp(0.0, 1.0) } else { 0.0 };
    // Measured from the nearer end, so that a point at either end keeps all its digits.
    if t <= 0.5 { (x - from) - axis * t } else { (x - to) + axis * (1.0 - t) }
}

#[inline]
fn capsule_contact(x: Vec3, from: Vec3, to: Vec3, radius: f32) -> (f32, Vec3) {
    let offset = off_axis(x, from, to);
    let (r, n) = unit(offset);
    // On the axis only rounding noise is left of the offset; any direction across the axis is then closest.
    let noise = 4.0 * f32::EPSILON * (from.amax().max(to.amax()).max(x.amax()));
    if r > noise || r.is_nan() {
        return (r - radius, n);
    }
    let (_, axis) = unit(to - from);
    let across = Vec3::from_fn(|i, _| if i == axis.iamin() { 1.0 } else { 0.0 });
    (r - radius, unit(axis.cross(&across)).1)
}

#[cfg(test)]
mod tests;
