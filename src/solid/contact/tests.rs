use super::*;
use crate::{sdf::Sampled, solid::MeshShape};
use std::sync::Arc;

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

/// Points of a surface, and whether a point lies in the solid.
type Sampling = (Vec<Vec3>, Box<dyn Fn(Vec3) -> bool>);

/// The sampling of a disc.
fn sampled_disc(center: [f32; 3], normal: [f32; 3], radius: f32, thickness: f32) -> Sampling {
    let n = 160;
    let grid = move || (0..=n).flat_map(move |i| (0..=n).map(move |j| (i, j)));
    let (c, w) = (vec3(&center), vec3(&normal).normalize());
    let u = w.cross(&Vec3::x()).normalize();
    let v = w.cross(&u);
    let at = |i: i32, r: f32, along: f32| {
        let (sin, cos) = (std::f32::consts::TAU * i as f32 / n as f32).sin_cos();
        c + (u * cos + v * sin) * r + w * along
    };
    let part = |j: i32| j as f32 / n as f32;
    let faces = grid().flat_map(|(i, j)| [-0.5, 0.5].map(|side| at(i, radius * part(j), side * thickness)));
    let rim = grid().map(|(i, j)| at(i, radius, (part(j) - 0.5) * thickness));
    let points = faces.chain(rim).collect();
    let inside = move |x: Vec3| {
        let along = w.dot(&(x - c));
        along.abs() < 0.5 * thickness && (x - c - w * along).norm() < radius
    };
    (points, Box::new(inside))
}

/// A dense sampling of the surface, and whether a point lies in the solid, both from first principles.
fn sampled(shape: &Shape) -> Sampling {
    let n = 160;
    let grid = move || (0..=n).flat_map(move |i| (0..=n).map(move |j| (i, j)));
    let ball = |c: Vec3, r: f32| -> Vec<Vec3> {
        grid()
            .map(|(i, j)| {
                let (a, b) =
                    (std::f32::consts::TAU * i as f32 / n as f32, std::f32::consts::PI * j as f32 / n as f32);
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
        Shape::Disc { center, normal, radius, thickness } => sampled_disc(center, normal, radius, thickness),
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
fn bounding_balls_contain_shapes_and_are_no_larger() {
    for shape in all() {
        let Some((center, radius)) = shape.bounding_ball() else { continue };
        let farthest = sampled(&shape).0.iter().map(|p| (p - center).norm()).fold(0.0, f32::max);
        assert!((0.999..1.00001).contains(&(farthest / radius)), "{shape:?} {farthest} {radius}");
    }
}

/// Distances to a surface on a grid with another number of nodes along each axis.
fn sampled_field(distance: impl Fn(Vec3) -> f32) -> Sampled {
    let nodes = [31, 27, 23];
    let mut field =
        Sampled { origin: Vec3::new(-0.75, -0.65, -0.55), voxel: 0.05, nodes, values: Vec::new() };
    field.values = (0..31 * 27 * 23).map(|i| distance(field.node(i))).collect();
    field
}

#[test]
fn bounding_balls_of_meshes_contain_them_and_are_hardly_larger() {
    // A ball off the centre, and a bar thinner than a voxel that lies between nodes: none is inside.
    let (from, to) = (Vec3::new(-0.475, 0.025, 0.025), Vec3::new(0.475, 0.025, 0.025));
    let capsule = move |x: Vec3, from: Vec3, to: Vec3, radius: f32| {
        let t = (x - from).dot(&(to - from)) / (to - from).norm_squared().max(1e-9);
        (x - from - (to - from) * t.clamp(0.0, 1.0)).norm() - radius
    };
    let ball = Vec3::new(0.3, 0.2, 0.1);
    let cases = [(ball, ball, 0.3, ball.norm() + 0.3), (from, to, 0.01, to.norm() + 0.01)];
    for (from, to, radius, expected) in cases {
        let field = Arc::new(sampled_field(|x| capsule(x, from, to, radius)));
        let mut mesh = MeshShape::new("made here");
        (mesh.scale, mesh.rotate, mesh.translate) = (0.5, [30.0, 50.0, -70.0], [3.0, 2.0, -1.0]);
        mesh.fill(field.clone());
        let (center, found) = Shape::Mesh(mesh.clone()).bounding_ball().unwrap();
        assert!((center - Vec3::from(mesh.translate)).norm() < 1e-5, "{center:?}");
        let slack = 1.5 * 3.0_f32.sqrt() * field.voxel;
        assert!((expected..expected + slack).contains(&(found / 0.5)), "{found} {expected}");
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
            let step =
                |v: Vec3| (shape.signed_distance(x + v * e) - shape.signed_distance(x - v * e)) / (2.0 * e);
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
