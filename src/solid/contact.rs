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
mod tests {
    use super::*;

    fn plane() -> Shape {
        Shape::Plane { point: [0.3, -0.2, 0.1], normal: [1.0, -2.0, 4.0] }
    }

    fn cuboid() -> Shape {
        Shape::Box { min: [-0.5, -0.3, 0.1], max: [0.6, 0.4, 0.7] }
    }

    fn tank() -> Shape {
        Shape::Tank { min: [-0.5, -0.3, 0.1], max: [0.6, 0.4, 0.7] }
    }

    fn sphere() -> Shape {
        Shape::Sphere { center: [0.1, 0.2, -0.1], radius: 0.45 }
    }

    fn capsule() -> Shape {
        Shape::Capsule { from: [-0.4, 0.1, -0.2], to: [0.5, -0.2, 0.3], radius: 0.25 }
    }

    fn disc() -> Shape {
        Shape::Disc { center: [0.1, -0.1, 0.05], normal: [0.3, -0.2, 2.0], radius: 0.6, thickness: 0.3 }
    }

    fn torus() -> Shape {
        Shape::Torus { center: [0.1, -0.1, 0.05], axis: [0.3, -0.2, 2.0], radius: 0.6, tube: 0.2 }
    }

    fn ellipsoid() -> Shape {
        Shape::Ellipsoid { center: [0.1, 0.2, -0.1], radii: [0.6, 0.3, 0.45] }
    }

    fn all() -> [Shape; 8] {
        [plane(), cuboid(), sphere(), capsule(), tank(), torus(), ellipsoid(), disc()]
    }

    /// Points of a regular grid over [-1.2, 1.2]³ that favours no symmetry plane.
    fn queries(n: usize) -> impl Iterator<Item = Vec3> {
        let at = move |i: usize| 2.4 * (i as f32 + 0.37) / n as f32 - 1.2;
        (0..n * n * n).map(move |i| Vec3::new(at(i % n), at(i / n % n), at(i / n / n)))
    }

    /// A dense sampling of the surface, and whether a point lies in the solid, both from first principles.
    fn sampled(shape: &Shape) -> (Vec<Vec3>, Box<dyn Fn(Vec3) -> bool>) {
        let n = 160;
        let grid = move || (0..=n).flat_map(move |i| (0..=n).map(move |j| (i, j)));
        let ball = |c: Vec3, r: f32| -> Vec<Vec3> {
            grid()
                .map(|(i, j)| {
                    let (a, b) = (
                        std::f32::consts::TAU * i as f32 / n as f32,
                        std::f32::consts::PI * j as f32 / n as f32,
                    );
                    c + r * Vec3::new(b.sin() * a.cos(), b.sin() * a.sin(), b.cos())
                })
                .collect()
        };
        match shape.clone() {
            Shape::Plane { point, normal } => {
                let (p, n_) = (vec3(&point), vec3(&normal));
                let u = n_.cross(&Vec3::x()).normalize();
                let v = n_.cross(&u).normalize();
                let at = move |i: i32| 6.0 * (i as f32 / n as f32 - 0.5);
                let points = grid().map(|(i, j)| p + u * at(i) + v * at(j)).collect();
                (points, Box::new(move |x| n_.dot(&(x - p)) < 0.0))
            }
            Shape::Box { min, max } | Shape::Tank { min, max } => {
                let tank = matches!(shape, Shape::Tank { .. });
                let (lo, hi) = (vec3(&min), vec3(&max));
                let mut points = Vec::new();
                for axis in 0..3 {
                    for (i, j) in grid() {
                        for end in [lo, hi] {
                            let (b, c) = ((axis + 1) % 3, (axis + 2) % 3);
                            let mut p = end;
                            p[b] = lo[b] + (hi[b] - lo[b]) * i as f32 / n as f32;
                            p[c] = lo[c] + (hi[c] - lo[c]) * j as f32 / n as f32;
                            points.push(p);
                        }
                    }
                }
                (points, Box::new(move |x| (0..3).all(|a| lo[a] < x[a] && x[a] < hi[a]) != tank))
            }
            Shape::Sphere { center, radius } => {
                let c = vec3(&center);
                (ball(c, radius), Box::new(move |x| (x - c).norm() < radius))
            }
            Shape::Capsule { from, to, radius } => {
                let (a, b) = (vec3(&from), vec3(&to));
                let w = (b - a).normalize();
                let u = w.cross(&Vec3::z()).normalize();
                let v = w.cross(&u);
                let mut points = ball(a, radius);
                points.extend(ball(b, radius));
                points.extend(grid().map(|(i, j)| {
                    let phi = std::f32::consts::TAU * i as f32 / n as f32;
                    a + (b - a) * (j as f32 / n as f32) + radius * (u * phi.cos() + v * phi.sin())
                }));
                // Spheres within the capsule are no surface: keep what is not strictly inside a dense chain of balls.
                let chain: Vec<Vec3> = (0..=64).map(|k| a + (b - a) * (k as f32 / 64.0)).collect();
                let near = move |x: Vec3| chain.iter().map(|c| (x - c).norm()).fold(f32::MAX, f32::min);
                points.retain(|&p| near(p) >= radius - 1e-4);
                let chain: Vec<Vec3> = (0..=4000).map(|k| a + (b - a) * (k as f32 / 4000.0)).collect();
                (points, Box::new(move |x| chain.iter().any(|c| (x - c).norm() < radius)))
            }
            Shape::Disc { center, normal, radius, thickness } => {
                let (c, w) = (vec3(&center), vec3(&normal).normalize());
                let u = w.cross(&Vec3::x()).normalize();
                let v = w.cross(&u);
                let at = |i: i32, r: f32, along: f32| {
                    let (sin, cos) = (std::f32::consts::TAU * i as f32 / n as f32).sin_cos();
                    c + (u * cos + v * sin) * r + w * along
                };
                let part = |j: i32| j as f32 / n as f32;
                let faces = grid()
                    .flat_map(|(i, j)| [-0.5, 0.5].map(|side| at(i, radius * part(j), side * thickness)));
                let rim = grid().map(|(i, j)| at(i, radius, (part(j) - 0.5) * thickness));
                let points = faces.chain(rim).collect();
                let inside = move |x: Vec3| {
                    let along = w.dot(&(x - c));
                    along.abs() < 0.5 * thickness && (x - c - w * along).norm() < radius
                };
                (points, Box::new(inside))
            }
            Shape::Torus { center, axis, radius, tube } => {
                let (c, w) = (vec3(&center), vec3(&axis).normalize());
                let u = w.cross(&Vec3::x()).normalize();
                let v = w.cross(&u);
                let turn = |i: i32| (std::f32::consts::TAU * i as f32 / n as f32).sin_cos();
                let points = grid().map(|(i, j)| {
                    let ((sin, cos), (up, out)) = (turn(i), turn(j));
                    c + (u * cos + v * sin) * (radius + tube * out) + w * (tube * up)
                });
                let off_ring = move |x: Vec3| {
                    let along = w.dot(&(x - c));
                    ((x - c - w * along).norm() - radius).hypot(along)
                };
                (points.collect(), Box::new(move |x| off_ring(x) < tube))
            }
            Shape::Ellipsoid { center, radii } => {
                let (c, a) = (vec3(&center), vec3(&radii));
                let points = ball(Vec3::zeros(), 1.0).into_iter().map(|p| c + p.component_mul(&a)).collect();
                (points, Box::new(move |x| (x - c).component_div(&a).norm() < 1.0))
            }
            Shape::Mesh(_) => unreachable!("sampled fields have tests of their own"),
        }
    }

    #[test]
    fn distances_match_a_dense_sampling_of_the_surface() {
        for shape in all() {
            let (points, solid) = sampled(&shape);
            for x in queries(7) {
                let brute = points.iter().map(|p| (p - x).norm()).fold(f32::MAX, f32::min);
                let expected = if solid(x) { -brute } else { brute };
                let d = shape.signed_distance(x);
                // Samples lie on the surface at most 0.02 (plane: 0.03) from any closest point; the error is
                // bounded by that, and second order in it where the query is far.
                assert!(
                    (d - expected).abs() < 0.5 * 0.03_f32.powi(2) / brute.max(0.015) + 1e-4,
                    "{shape:?} {x:?} {d} {expected}"
                );
                assert_eq!(d.to_bits(), shape.contact(x).0.to_bits());
            }
        }
    }

    #[test]
    fn normals_are_the_gradient_of_the_distance_and_point_out_of_the_solid() {
        let e = 1e-3;
        for shape in all() {
            let mut smooth = 0;
            for x in queries(11) {
                let (d, n) = shape.contact(x);
                assert!((n.norm() - 1.0).abs() < 1e-5);
                let step = |v: Vec3| {
                    (shape.signed_distance(x + v * e) - shape.signed_distance(x - v * e)) / (2.0 * e)
                };
                let gradient = Vec3::new(step(Vec3::x()), step(Vec3::y()), step(Vec3::z()));
                // Across a crease of the distance the difference quotient means nothing.
                if (shape.contact(x + n * e).1 - n).norm() < 0.02 && (gradient - n).norm() < 0.9 {
                    assert!((gradient.norm() - 1.0).abs() < 4e-3, "{shape:?} {x:?} {gradient:?}");
                    assert!((gradient - n).norm() < 6e-3, "{shape:?} {x:?} {gradient:?} {n:?}");
                    smooth += 1;
                }
                // The surface lies at distance d against the normal, and beyond it is the other side.
                assert!(shape.signed_distance(x - n * d).abs() < 2e-6, "{shape:?} {x:?}");
                assert!(shape.signed_distance(x - n * (d - 1e-3)) > 0.0);
                assert!(shape.signed_distance(x - n * (d + 1e-3)) < 0.0);
            }
            assert!(smooth > 1250, "{shape:?}: {smooth} of 1331");
        }
    }

    #[test]
    fn degenerate_points_still_have_a_unit_normal() {
        let mid = Vec3::new(0.05, 0.05, 0.4);
        let axis = Vec3::new(0.05, -0.05, 0.05);
        let cases = [
            (sphere(), vec3(&[0.1, 0.2, -0.1]), -0.45),
            (cuboid(), mid, -0.3),
            (tank(), mid, 0.3),
            (tank(), vec3(&[-0.5, -0.3, 0.1]), 0.0),
            (tank(), vec3(&[0.6, 0.4, 0.7]), 0.0),
            (cuboid(), vec3(&[0.6, 0.4, 0.7]), 0.0),
            (cuboid(), vec3(&[0.6, 0.4, 0.3]), 0.0),
            (capsule(), axis, -0.25),
            (capsule(), vec3(&[-0.4, 0.1, -0.2]), -0.25),
            (capsule(), vec3(&[0.5, -0.2, 0.3]), -0.25),
            (torus(), vec3(&[0.1, -0.1, 0.05]), 0.4),
            (disc(), vec3(&[0.1, -0.1, 0.05]), -0.15),
            (ellipsoid(), vec3(&[0.1, 0.2, -0.1]), -0.3),
            (ellipsoid(), vec3(&[0.7, 0.2, -0.1]), 0.0),
            (Shape::Capsule { from: [1.0; 3], to: [1.0; 3], radius: 0.5 }, vec3(&[1.0; 3]), -0.5),
        ];
        for (shape, x, expected) in cases {
            let (d, n) = shape.contact(x);
            assert!((d - expected).abs() < 1e-6, "{shape:?} {x:?} {d}");
            assert!((n.norm() - 1.0).abs() < 1e-6, "{shape:?} {x:?} {n:?}");
        }
        // On the axis of a capsule the normal is perpendicular to it.
        let Shape::Capsule { from, to, .. } = capsule() else { unreachable!() };
        let along = (vec3(&to) - vec3(&from)).normalize();
        assert!(capsule().contact(axis).1.dot(&along).abs() < 1e-5);
        // At the corner of a tank the normal points inwards.
        let n = tank().contact(vec3(&[-0.5, -0.3, 0.1])).1;
        assert!(tank().signed_distance(vec3(&[-0.5, -0.3, 0.1]) + n * 0.01) >= 0.0);
    }

    #[test]
    fn extreme_and_invalid_queries_keep_a_unit_normal() {
        let far = [1e20, -1e30, 3e38, f32::MIN_POSITIVE, 1e-40, 0.0];
        for shape in all() {
            for a in far {
                for b in far {
                    let (d, n) = shape.contact(Vec3::new(a, b, -a));
                    assert!(!d.is_nan(), "{shape:?} {a} {b}");
                    assert!((n.norm() - 1.0).abs() < 1e-5, "{shape:?} {a} {b} {n:?}");
                }
            }
            for x in [Vec3::new(f32::NAN, 0.0, 0.0), Vec3::new(0.0, f32::INFINITY, f32::NEG_INFINITY)] {
                assert!((shape.contact(x).1.norm() - 1.0).abs() < 1e-5, "{shape:?}");
            }
        }
        // Offsets whose squares overflow or vanish still have their length and direction.
        let ball = Shape::Sphere { center: [0.0; 3], radius: 1.0 };
        for scale in [1e30, 1e-30] {
            let (d, n) = ball.contact(Vec3::new(3.0, 0.0, -4.0) * scale);
            assert!((n - Vec3::new(0.6, 0.0, -0.8)).norm() < 1e-6, "{n:?}");
            assert!((d / (5.0 * scale - 1.0) - 1.0).abs() < 1e-6, "{d}");
        }
        // A thousand kilometres away the digits that f32 has are all there.
        let moved = Shape::Sphere { center: [1e6, 0.0, 0.0], radius: 1.0 };
        assert_eq!(moved.contact(Vec3::new(1e6 + 2.0, 0.0, 0.0)), (1.0, Vec3::x()));
    }

    #[test]
    fn check_names_the_parameter_at_fault() {
        for shape in all() {
            assert_eq!(shape.check(), Ok(()));
        }
        let faults = [
            (Shape::Plane { point: [0.0; 3], normal: [0.0; 3] }, ShapeError::NoDirection),
            (Shape::Box { min: [0.0; 3], max: [1.0, 0.0, 1.0] }, ShapeError::Inverted { axis: 1 }),
            (Shape::Tank { min: [0.0; 3], max: [1.0, 1.0, -1.0] }, ShapeError::Inverted { axis: 2 }),
            (Shape::Sphere { center: [0.0; 3], radius: 0.0 }, ShapeError::NoRadius),
            (Shape::Capsule { from: [0.0; 3], to: [0.0; 3], radius: -1.0 }, ShapeError::NoRadius),
            (
                Shape::Torus { center: [0.0; 3], axis: [0.0; 3], radius: 2.0, tube: 1.0 },
                ShapeError::OutOfRange { field: "axis" },
            ),
            (
                Shape::Torus { center: [0.0; 3], axis: [0.0, 0.0, 1.0], radius: 1.0, tube: 1.0 },
                ShapeError::OutOfRange { field: "tube" },
            ),
            (
                Shape::Ellipsoid { center: [0.0; 3], radii: [1.0, 0.0, 1.0] },
                ShapeError::OutOfRange { field: "radii" },
            ),
            (
                Shape::Sphere { center: [0.0, f32::NAN, 0.0], radius: 1.0 },
                ShapeError::NotFinite { field: "center" },
            ),
        ];
        for (shape, error) in faults {
            assert_eq!(shape.check(), Err(error));
            assert!(error.to_string().contains(error.field()));
        }
    }
}
