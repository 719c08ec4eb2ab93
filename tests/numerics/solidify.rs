//! Sampled distances of triangle meshes against what is known of the shapes.

use meniscus::{
    math::Vec3,
    par,
    sdf::{Sampled, Triangles, from_triangles},
};
use std::f32::consts::{PI, TAU};

/// A closed surface over a grid of (u, v) that wraps in u, and in v if `wraps`.
fn sheet(nu: u32, nv: u32, wraps: bool, at: impl Fn(f32, f32) -> Vec3) -> Triangles {
    let rows = if wraps { nv } else { nv + 1 };
    let mut mesh = Triangles::default();
    for j in 0..rows {
        mesh.positions.extend((0..nu).map(|i| at(i as f32 / nu as f32, j as f32 / nv as f32)));
    }
    for j in 0..nv {
        for i in 0..nu {
            let corner = |i: u32, j: u32| (i % nu) + nu * (j % rows);
            let [a, b, c, d] = [corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)];
            mesh.triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    mesh
}

/// A ball of radius 1; `fine` squares along the equator.
fn ball(fine: u32, center: Vec3) -> Triangles {
    sheet(fine, fine / 2, false, |u, v| {
        let (a, b) = (TAU * u, PI * (v - 0.5));
        center + Vec3::new(a.cos() * b.cos(), a.sin() * b.cos(), b.sin())
    })
}

fn torus(fine: u32) -> Triangles {
    sheet(2 * fine, fine, true, |u, v| {
        let (a, b) = (TAU * u, TAU * v);
        let r = 1.0 + 0.35 * b.cos();
        Vec3::new(r * a.cos(), r * a.sin(), 0.35 * b.sin())
    })
}

fn torus_distance(x: Vec3) -> f32 {
    (x.xy().norm() - 1.0).hypot(x.z) - 0.35
}

/// The box from -s to s.
fn cuboid(s: Vec3) -> Triangles {
    let positions = (0..8_usize)
        .map(|i| Vec3::from_fn(|axis, _| if i >> axis & 1 == 1 { s[axis] } else { -s[axis] }))
        .collect();
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    Triangles {
        positions,
        triangles: quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect(),
    }
}

fn cuboid_distance(s: Vec3, x: Vec3) -> f32 {
    let q = x.abs() - s;
    q.sup(&Vec3::zeros()).norm() + q.max().min(0.0)
}

fn joined(a: &Triangles, b: &Triangles) -> Triangles {
    let mut out = a.clone();
    let shift = a.positions.len() as u32;
    out.positions.extend(&b.positions);
    out.triangles.extend(b.triangles.iter().map(|t| t.map(|corner| corner + shift)));
    out
}

fn sampled(mesh: &Triangles, resolution: u32) -> Sampled {
    from_triangles(mesh, resolution).expect("the mesh has an extent").field
}

fn nodes(field: &Sampled) -> impl Iterator<Item = (Vec3, f32)> {
    let [nx, ny, _] = field.nodes.map(|n| n as usize);
    field.values.iter().enumerate().map(move |(i, &d)| {
        let node = Vec3::new((i % nx) as f32, (i / nx % ny) as f32, (i / (nx * ny)) as f32);
        (field.origin + node * field.voxel, d)
    })
}

/// The largest error within `band` voxels of the surface and anywhere [voxels], and wrong signs beyond `slack` voxels.
fn errors(field: &Sampled, band: f32, slack: f32, exact: impl Fn(Vec3) -> f32) -> (f32, f32, usize) {
    let (mut near, mut far, mut wrong) = (0.0_f32, 0.0_f32, 0);
    for (x, d) in nodes(field) {
        let exact = exact(x);
        let error = (d - exact).abs() / field.voxel;
        far = far.max(error);
        if exact.abs() < band * field.voxel {
            near = near.max(error);
        }
        wrong += usize::from(exact.abs() > slack * field.voxel && (d < 0.0) != (exact < 0.0));
    }
    (near, far, wrong)
}

#[test]
fn a_ball_a_box_and_a_torus_have_their_distance() {
    let side = Vec3::new(1.0, 0.7, 0.4);
    let mut seen = Vec::new();
    for resolution in [32, 64] {
        let found = [
            errors(&sampled(&ball(256, Vec3::zeros()), resolution), 2.9, 0.05, |x| x.norm() - 1.0),
            errors(&sampled(&cuboid(side), resolution), 2.9, 1e-3, |x| cuboid_distance(side, x)),
            errors(&sampled(&torus(128), resolution), 2.9, 0.05, torus_distance),
        ];
        println!("{resolution}: near, anywhere [voxels], wrong signs: {found:?}");
        for (near, far, wrong) in found {
            // The ball's facets lie up to 1.5e-4 within it. Beyond three voxels the sweeps are first order.
            assert!(near < 0.02 && far < 1.5 && wrong == 0, "{resolution}: {near} {far} {wrong}");
        }
        seen.push(found);
    }
}

/// Nodes on its faces, edges and corners, and on the diagonals that cut its faces in two.
#[test]
fn a_box_in_line_with_the_nodes_has_its_distance() {
    for side in [Vec3::new(2.0, 2.0, 0.2), Vec3::repeat(1.0), Vec3::new(0.6, 0.3, 0.3)] {
        for resolution in [20, 30, 60] {
            let (near, _, wrong) =
                errors(&sampled(&cuboid(side), resolution), 2.9, 1e-3, |x| cuboid_distance(side, x));
            println!("{side:?} {resolution}: {near} {wrong}");
            assert!(near < 1e-3 && wrong == 0, "{side:?} {resolution}: {near} voxels, {wrong} wrong signs");
        }
    }
}

#[test]
fn a_hole_is_closed_where_the_winding_number_crosses_a_half() {
    let mut mesh = ball(64, Vec3::zeros());
    // Take the cap above z = 0.8: a hole of radius 0.6.
    let high = |t: &[u32; 3], mesh: &Triangles| t.iter().all(|&c| mesh.positions[c as usize].z > 0.8);
    let all = mesh.clone();
    mesh.triangles.retain(|t| !high(t, &all));
    let found = from_triangles(&mesh, 48).unwrap();
    assert!(found.caps > 100);
    for (x, d) in nodes(&found.field) {
        let exact = x.norm() - 1.0;
        let rim = (x.xy().norm() - 0.6).hypot(x.z - 0.8);
        // Away from the hole nothing changes; the cap lies between the rim's plane and the sphere.
        if (x.z < 0.3 || exact > 0.15) && exact.abs() > 0.01 {
            assert_eq!(d < 0.0, exact < 0.0, "{x:?}: {d}");
        }
        if x.z < 0.0 && exact.abs() < 0.1 {
            assert!((d - exact).abs() < 0.3 * found.field.voxel, "{x:?}: {d}, exact {exact}");
        }
        assert!(d.abs() <= rim + found.field.voxel, "{x:?}: {d} beyond the rim at {rim}");
    }
    // The cap is a surface: along the axis the distance passes zero with slope one.
    let along = |z: f32| found.field.sample(Vec3::new(0.0, 0.0, z));
    let crossing = (0..100).map(|i| 0.5 + 0.006 * i as f32).find(|&z| along(z).0 > 0.0).unwrap();
    assert!((0.7..1.0).contains(&crossing), "the cap is at {crossing}");
    for offset in [-0.12, -0.06, 0.06, 0.12] {
        assert!(
            (along(crossing + offset).0 - offset).abs() < 0.06,
            "{offset}: {}",
            along(crossing + offset).0
        );
    }
}

#[test]
fn overlapping_and_inside_out_parts_are_solid() {
    let (a, b) = (Vec3::zeros(), Vec3::new(0.9, 0.2, 0.1));
    let mut other = ball(96, b);
    let union = |x: Vec3| ((x - a).norm() - 1.0).min((x - b).norm() - 1.0);
    let field = sampled(&joined(&ball(96, a), &other), 48);
    let (near, _, wrong) = errors(&field, 2.0, 0.1, union);
    // Inside, the union's own formula is off near where the balls meet; the outside decides.
    let outside = nodes(&field).filter(|&(x, _)| union(x) > 0.0);
    let largest = outside.map(|(x, d)| (d - union(x)).abs() / field.voxel).fold(0.0, f32::max);
    assert!(wrong == 0 && largest < 0.7, "{near} {largest} {wrong}");
    // Within the overlap the buried surfaces are no surfaces.
    let middle = field.sample((a + b) * 0.5).0;
    assert!(middle < -0.6, "the middle of the overlap is {middle} deep");

    // A part wound inside out.
    let far = Vec3::new(2.5, 0.0, 0.0);
    other = ball(96, far);
    other.triangles.iter_mut().for_each(|t| t.swap(0, 1));
    let union = |x: Vec3| (x.norm() - 1.0).min((x - far).norm() - 1.0);
    let (near, far, wrong) = errors(&sampled(&joined(&ball(96, a), &other), 64), 2.9, 0.1, union);
    assert!(near < 0.05 && far < 1.0 && wrong == 0, "{near} {far} {wrong}");
}

#[test]
fn meshes_that_enclose_nothing_are_refused() {
    assert!(from_triangles(&Triangles::default(), 16).is_none());
    let point = Triangles { positions: vec![Vec3::zeros(); 3], triangles: vec![[0, 1, 2]] };
    assert!(from_triangles(&point, 16).is_none());
    let flat = Triangles {
        positions: [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
            .map(|[x, y]| Vec3::new(x, y, 0.3))
            .to_vec(),
        triangles: vec![[0, 1, 2], [0, 2, 3]],
    };
    assert_eq!(from_triangles(&flat, 16).unwrap().inside, 0);
    let single = Triangles { positions: vec![Vec3::x(), Vec3::y(), Vec3::z()], triangles: vec![[0, 1, 2]] };
    let found = from_triangles(&single, 16).unwrap();
    assert!(found.inside == 0 && found.field.values.iter().all(|d| d.is_finite() && *d > 0.0));
}

#[test]
fn samples_have_the_same_bits_on_any_number_of_threads() {
    let mesh = torus(48);
    let one = par::with_threads(1, || sampled(&mesh, 40));
    for &threads in crate::thread_counts() {
        assert!(par::with_threads(threads, || sampled(&mesh, 40)) == one, "{threads} threads");
    }
}
