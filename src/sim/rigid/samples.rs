//! Points on the surface of a shape, at which contacts are found.
//!
//! *Method*: nodes of a grid near the surface, projected onto it, and the corners of boxes. A ball needs its centre alone, a capsule
//! points of its axis, with their radius.
//! Limits: an edge that meets an edge between its points is found when it is as deep as the points are apart times their slope.

use crate::{math::Vec3, solid::Shape};

/// Cells along the longest side of a shape.
const CELLS_ALONG_SIDE: f32 = 8.0;

/// Points along the axis of a capsule.
const AXIS_POINTS: u16 = 5;

/// Part of a cell within which points are one.
const MERGE_DISTANCE: f32 = 0.5;

/// A ball, mostly of radius 0, whose surface lies on that of a shape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct SurfacePoint {
    /// Centre in the shape's own axes [m].
    pub(super) x: Vec3,
    pub(super) radius: f32,
}

/// Points on the surface of a bounded shape; none on that of others.
pub(super) fn surface_points(shape: &Shape) -> Vec<SurfacePoint> {
    let point = |x: Vec3| SurfacePoint { x, radius: 0.0 };
    match *shape {
        Shape::Sphere { center, radius } => vec![SurfacePoint { x: center.into(), radius }],
        Shape::Capsule { from, to, radius } => {
            let (from, to) = (Vec3::from(from), Vec3::from(to));
            let at = |k: u16| from + (to - from) * (f32::from(k) / f32::from(AXIS_POINTS - 1));
            (0..AXIS_POINTS).map(|k| SurfacePoint { x: at(k), radius }).collect()
        }
        Shape::Box { min, max } => {
            let (min, max) = (Vec3::from(min), Vec3::from(max));
            let corner =
                |k: u32| Vec3::from_fn(|axis, _| if k >> axis & 1 == 0 { min[axis] } else { max[axis] });
            let corners: Vec<_> = (0..8).map(corner).map(point).collect();
            grid_points(shape, corners)
        }
        _ => grid_points(shape, Vec::new()),
    }
}

/// Adds nodes near the surface to points that are on it.
fn grid_points(shape: &Shape, mut points: Vec<SurfacePoint>) -> Vec<SurfacePoint> {
    let Some((low, high)) = shape.bounds() else { return points };
    let size = high - low;
    let cell = size.max() / CELLS_ALONG_SIDE;
    if !(cell > 0.0 && cell.is_finite()) {
        return points;
    }
    let count = size.map(|side| (side / cell).ceil().max(1.0));
    let step = size.component_div(&count);
    for k in 0..=count.z as u32 {
        for j in 0..=count.y as u32 {
            for i in 0..=count.x as u32 {
                let node = low + Vec3::new(i as f32, j as f32, k as f32).component_mul(&step);
                let (d, n) = shape.contact(node);
                if d.abs() > cell {
                    continue;
                }
                let x = node - n * d;
                // The projection of a sampled distance may miss the surface.
                let is_on_surface = shape.signed_distance(x).abs() < 0.1 * cell;
                if is_on_surface && points.iter().all(|other| (other.x - x).norm() > MERGE_DISTANCE * cell) {
                    points.push(SurfacePoint { x, radius: 0.0 });
                }
            }
        }
    }
    points
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_are_on_the_surface_and_leave_no_gap() {
        let center = [1.0, 2.0, 3.0];
        for shape in [
            Shape::Box { min: [0.0; 3], max: [1.0, 0.1, 0.4] },
            Shape::Sphere { center, radius: 0.5 },
            Shape::Capsule { from: center, to: [1.0, 2.0, 4.0], radius: 0.2 },
            Shape::Torus { center, axis: [1.0, 1.0, 0.0], radius: 0.5, tube: 0.15 },
            Shape::Ellipsoid { center, radii: [0.2, 0.4, 0.8] },
            Shape::Disc { center, normal: [0.0, 1.0, 1.0], radius: 0.5, thickness: 0.2 },
        ] {
            let points = surface_points(&shape);
            assert!((1..400).contains(&points.len()), "{shape:?}: {}", points.len());
            for point in &points {
                let d = shape.signed_distance(point.x) + point.radius;
                assert!(d.abs() < 1e-3, "{shape:?}: {point:?} is at {d}");
            }
            let (low, high) = shape.bounds().expect("it is bounded");
            let longest = (high - low).max();
            // Places on the surface, in all directions from outside.
            for k in 0..200_u32 {
                let part = |prime: u32| f32::from((k * prime % 199) as u16) / 199.0;
                let start = low + (high - low).component_mul(&Vec3::new(part(37), part(73), part(151)));
                let (d, n) = shape.contact(start);
                let x = start - n * d;
                let gap =
                    points.iter().map(|point| (point.x - x).norm() - point.radius).fold(f32::MAX, f32::min);
                assert!(gap < 0.25 * longest, "{shape:?}: {gap} from {x}");
            }
        }
        assert!(surface_points(&Shape::Plane { point: [0.0; 3], normal: center }).is_empty());
    }
}
