//! Triangle meshes of shapes, in their own axes.
//!
//! *Method*: shapes of revolution are profiles turned about their axis; every vertex is on the surface, every other mesh is exact.
//! A plane is unbounded and becomes a square, the only mesh with a border.
//!
//! Limits: with 128 segments the chords of a round shape are within 3·10⁻⁴ of its radius.

use crate::{
    import::{self, ImportError},
    math::{
        Vec3,
        elementary::{cos, sin},
    },
    mesh::Mesh,
    solid::{Look, Shape},
};
use nalgebra::Vector3;
use std::{f64::consts::PI, path::Path};

/// Segments of a circle about an axis.
const SEGMENTS: usize = 128;

/// Segments of a half circle from pole to pole, an even number.
const HALF_CIRCLE: usize = 64;

/// Thickness of the walls of a glass tank, as a part of its longest side.
const GLASS_THICKNESS: f32 = 0.006;

/// The mesh that pictures show of a shape with this look: a glass tank has walls, which refract. Otherwise as [`tessellate`].
///
/// # Errors
/// As [`tessellate`].
pub(in crate::product) fn shown_mesh(
    shape: &Shape,
    look: Look,
    bytes: &[u8],
    plane_reach: f32,
) -> Result<Mesh, ImportError> {
    match (shape, look) {
        (Shape::Tank { min, max }, Look::Glass) => Ok(glass_tank(*min, *max)),
        _ => tessellate(shape, bytes, plane_reach),
    }
}

/// The mesh of a shape; `bytes` is the file that a mesh shape names, `plane_reach` half of the side of the square that stands for a
/// plane [m].
///
/// # Errors
/// If the file is no mesh.
fn tessellate(shape: &Shape, bytes: &[u8], plane_reach: f32) -> Result<Mesh, ImportError> {
    Ok(match shape {
        Shape::Plane { point, normal } => square((*point).into(), (*normal).into(), plane_reach),
        Shape::Box { min, max } => cuboid(*min, *max, false),
        Shape::Tank { min, max } => cuboid(*min, *max, true),
        Shape::Sphere { center, radius } => {
            let radius = f64::from(*radius);
            revolve((*center).into(), Vec3::z(), &half_circle(radius, 0.0, radius))
        }
        Shape::Capsule { from, to, radius } => capsule((*from).into(), (*to).into(), *radius),
        Shape::Torus { center, axis, radius, tube } => {
            torus((*center).into(), (*axis).into(), *radius, *tube)
        }
        Shape::Ellipsoid { center, radii } => {
            let mut mesh = revolve(Vec3::zeros(), Vec3::z(), &half_circle(1.0, 0.0, 1.0));
            let place = |x: &Vec3| x.component_mul(&Vec3::from(*radii)) + Vec3::from(*center);
            mesh.positions = mesh.positions.iter().map(place).collect();
            mesh
        }
        Shape::Disc { center, normal, radius, thickness } => {
            let (radius, half) = (f64::from(*radius), 0.5 * f64::from(*thickness));
            let profile = [[0.0, -half], [radius, -half], [radius, half], [0.0, half]];
            revolve((*center).into(), (*normal).into(), &profile)
        }
        Shape::Mesh(mesh) => {
            let read = import::parse_triangles(Path::new(&mesh.file), bytes)?;
            let positions = mesh.place(&read.positions);
            Mesh { positions, triangles: read.triangles, ..Mesh::default() }
        }
    })
}

/// A box; `inwards`: its faces are seen from inside.
fn cuboid(min: [f32; 3], max: [f32; 3], inwards: bool) -> Mesh {
    let corner = |i: usize| Vec3::from_fn(|axis, _| if i >> axis & 1 == 1 { max[axis] } else { min[axis] });
    let faces = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let mut triangles: Vec<[u32; 3]> =
        faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    if inwards {
        triangles.iter_mut().for_each(|triangle| triangle.swap(1, 2));
    }
    Mesh { positions: (0..8).map(corner).collect(), triangles, ..Mesh::default() }
}

/// The walls around a box, whose inside is that of the tank.
fn glass_tank(min: [f32; 3], max: [f32; 3]) -> Mesh {
    let longest = (0..3).map(|axis| max[axis] - min[axis]).fold(0.0, f32::max);
    let outwards = GLASS_THICKNESS * longest;
    let outside = cuboid(min.map(|x| x - outwards), max.map(|x| x + outwards), false);
    let mut mesh = cuboid(min, max, true);
    let first = mesh.positions.len() as u32;
    mesh.positions.extend(outside.positions);
    mesh.triangles.extend(outside.triangles.iter().map(|triangle| triangle.map(|corner| first + corner)));
    mesh
}

/// A square about the point of the plane.
fn square(point: Vec3, normal: Vec3, reach: f32) -> Mesh {
    let [u, v, _] = axes(normal);
    let corner = |a: f64, b: f64| (point.cast() + (u * a + v * b) * f64::from(reach)).cast();
    let positions = vec![corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)];
    Mesh { positions, triangles: vec![[0, 1, 2], [0, 2, 3]], ..Mesh::default() }
}

/// A cylinder with round ends; a ball if both ends coincide.
fn capsule(from: Vec3, to: Vec3, radius: f32) -> Mesh {
    let along: Vector3<f64> = to.cast() - from.cast();
    let (half, radius) = (0.5 * along.norm(), f64::from(radius));
    let middle: Vector3<f64> = (from.cast::<f64>() + to.cast::<f64>()) / 2.0;
    let mut profile = half_circle(radius, -half, radius);
    if half > 0.0 {
        // The equator of either half: the cylinder is between them.
        let upper = half_circle(radius, half, radius).split_off(HALF_CIRCLE / 2);
        profile.truncate(HALF_CIRCLE / 2 + 1);
        profile.extend(upper);
    }
    let axis = if half > 0.0 { along.cast() } else { Vec3::z() };
    revolve(middle.cast(), axis, &profile)
}

/// A half circle from the lower pole to the upper one, as radii and heights.
fn half_circle(radius: f64, height: f64, height_radius: f64) -> Vec<[f64; 2]> {
    let point = |i: usize| match i {
        0 => [0.0, height - height_radius],
        HALF_CIRCLE => [0.0, height + height_radius],
        _ => {
            let angle = PI * (i as f64 / HALF_CIRCLE as f64 - 0.5);
            [radius * cos(angle), height + height_radius * sin(angle)]
        }
    };
    (0..=HALF_CIRCLE).map(point).collect()
}

/// A profile of radii and heights, from one pole to the other, turned about an axis.
fn revolve(center: Vec3, axis: Vec3, profile: &[[f64; 2]]) -> Mesh {
    let [u, v, w] = axes(axis);
    let rings = &profile[1..profile.len() - 1];
    let at = |radius: f64, height: f64, angle: f64| -> Vec3 {
        (center.cast() + (u * cos(angle) + v * sin(angle)) * radius + w * height).cast()
    };
    let angle = |i: usize| 2.0 * PI * i as f64 / SEGMENTS as f64;
    let mut positions = vec![at(0.0, profile[0][1], 0.0)];
    for &[radius, height] in rings {
        positions.extend((0..SEGMENTS).map(|i| at(radius, height, angle(i))));
    }
    positions.push(at(0.0, profile[profile.len() - 1][1], 0.0));
    let vertex = |ring: usize, i: usize| (1 + ring * SEGMENTS + i % SEGMENTS) as u32;
    let (last, top) = (rings.len() - 1, (positions.len() - 1) as u32);
    let mut triangles = Vec::new();
    for i in 0..SEGMENTS {
        triangles.push([0, vertex(0, i + 1), vertex(0, i)]);
        for ring in 0..last {
            let [a, b] = [vertex(ring, i), vertex(ring, i + 1)];
            let [c, d] = [vertex(ring + 1, i + 1), vertex(ring + 1, i)];
            triangles.extend([[a, b, c], [a, c, d]]);
        }
        triangles.push([top, vertex(last, i), vertex(last, i + 1)]);
    }
    Mesh { positions, triangles, ..Mesh::default() }
}

/// A ring with a round cross-section.
fn torus(center: Vec3, axis: Vec3, radius: f32, tube: f32) -> Mesh {
    let [u, v, w] = axes(axis);
    let (radius, tube) = (f64::from(radius), f64::from(tube));
    let angle = |i: usize| 2.0 * PI * i as f64 / SEGMENTS as f64;
    let point = |i: usize, j: usize| -> Vec3 {
        let out = u * cos(angle(i)) + v * sin(angle(i));
        (center.cast() + out * (radius + tube * cos(angle(j))) + w * (tube * sin(angle(j)))).cast()
    };
    let positions = (0..SEGMENTS).flat_map(|i| (0..SEGMENTS).map(move |j| (i, j)));
    let positions = positions.map(|(i, j)| point(i, j)).collect();
    let vertex = |i: usize, j: usize| (i % SEGMENTS * SEGMENTS + j % SEGMENTS) as u32;
    let mut triangles = Vec::new();
    for i in 0..SEGMENTS {
        for j in 0..SEGMENTS {
            let [a, b] = [vertex(i, j), vertex(i + 1, j)];
            let [c, d] = [vertex(i + 1, j + 1), vertex(i, j + 1)];
            triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    Mesh { positions, triangles, ..Mesh::default() }
}

/// Three unit vectors, right-handed, of which the third has the direction of `axis`.
fn axes(axis: Vec3) -> [Vector3<f64>; 3] {
    let axis: Vector3<f64> = axis.cast();
    // Scaled first: the square of a tiny or huge component would vanish or overflow.
    let w = (axis / axis.amax()).normalize();
    let across = Vector3::from_fn(|i, _| if i == w.iamin() { 1.0 } else { 0.0 });
    let u = across.cross(&w).normalize();
    [u, w.cross(&u), w]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{mesh::check, sdf, solid::MeshShape};
    use std::sync::Arc;

    fn bounded() -> Vec<Shape> {
        let (center, axis) = ([0.3, -0.2, 1.0], [0.2, -0.5, 0.4]);
        vec![
            Shape::Box { min: [-1.0, 0.0, 0.5], max: [1.0, 0.25, 0.75] },
            Shape::Sphere { center, radius: 0.5 },
            Shape::Capsule { from: center, to: [0.3, 0.6, 1.5], radius: 0.2 },
            Shape::Capsule { from: center, to: center, radius: 0.2 },
            Shape::Torus { center, axis, radius: 0.5, tube: 0.2 },
            Shape::Ellipsoid { center, radii: [0.5, 0.2, 1.0] },
            Shape::Disc { center, normal: axis, radius: 0.5, thickness: 0.1 },
        ]
    }

    #[test]
    fn every_shape_is_a_closed_mesh_with_its_vertices_on_the_surface() {
        for shape in bounded() {
            let mesh = tessellate(&shape, &[], 1.0).unwrap();
            let found = check(&mesh);
            assert!(found.is_sound() && found.unused_vertices == 0, "{shape:?}: {found:?}");
            let worst = mesh.positions.iter().map(|&x| shape.signed_distance(x).abs()).fold(0.0, f32::max);
            assert!(worst < 1e-6, "{shape:?}: a vertex is {worst} m off the surface");
            let (volume, exact) = (found.volume, shape.volume());
            assert!((volume / exact - 1.0).abs() < 2e-3, "{shape:?}: {volume} m³, not {exact} m³");
        }
    }

    #[test]
    fn a_tank_is_seen_from_inside_and_a_plane_is_a_square_on_it() {
        let tank = Shape::Tank { min: [0.0; 3], max: [1.0, 2.0, 3.0] };
        let found = check(&tessellate(&tank, &[], 1.0).unwrap());
        assert!(found.is_sound() && (found.volume + 6.0).abs() < 1e-6, "{found:?}");
        // Of glass, it has walls of 18 mm around itself.
        let found = check(&shown_mesh(&tank, Look::Glass, &[], 1.0).unwrap());
        let glass = 1.036 * 2.036 * 3.036 - 6.0;
        assert!(
            found.is_sound() && (found.volume - glass).abs() < 1e-4 && found.components == 2,
            "{found:?}"
        );
        assert!((check(&shown_mesh(&tank, Look::Matte, &[], 1.0).unwrap()).volume + 6.0).abs() < 1e-6);
        let plane = Shape::Plane { point: [0.1, 0.2, 0.3], normal: [1.0, 2.0, -3.0] };
        let mesh = tessellate(&plane, &[], 10.0).unwrap();
        assert!(mesh.positions.iter().all(|&x| plane.signed_distance(x).abs() < 1e-5));
        assert!((check(&mesh).area - 400.0).abs() < 1e-3);
        let [a, b, c] = mesh.triangles[0].map(|corner| mesh.positions[corner as usize]);
        assert!((b - a).cross(&(c - a)).dot(&Vec3::new(1.0, 2.0, -3.0)) > 0.0, "it faces along its normal");
    }

    #[test]
    fn a_mesh_of_a_file_is_where_the_collider_is() {
        let text = "v 0 0 0\nv 2 0 0\nv 0 3 0\nv 0 0 4\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";
        let mut shape = MeshShape::new("tetrahedron.obj");
        (shape.scale, shape.rotate, shape.translate) = (0.1, [20.0, 0.0, 70.0], [1.0, 2.0, 3.0]);
        shape.resolution = 64;
        let triangles = import::parse_triangles(Path::new("a.obj"), text.as_bytes()).unwrap();
        let field = sdf::from_triangles(&triangles, shape.resolution).unwrap().field;
        let voxel = field.voxel * shape.scale;
        shape.fill(Arc::new(field));
        let shape = Shape::Mesh(shape);
        let mesh = tessellate(&shape, text.as_bytes(), 1.0).unwrap();
        let found = check(&mesh);
        assert!(found.is_sound() && (found.volume / 4e-3 - 1.0).abs() < 1e-4, "{found:?}");
        for &x in &mesh.positions {
            let distance = shape.signed_distance(x);
            assert!(distance.abs() < voxel, "{x}: {distance} m off the sampled surface");
        }
        let why = tessellate(&shape, b"v 0 0 0\n", 1.0).unwrap_err();
        assert!(why.to_string().contains("tetrahedron.obj"), "{why}");
    }
}
