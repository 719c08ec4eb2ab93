//! Closing of cavities that are smaller than a particle.

use super::cleanup::{SPACING, particles, smoothed, surface};
use meniscus::{
    field::Anisotropy,
    math::Vec3,
    mesh::{Mesh, SurfaceParams, close_cavities},
    par,
};

fn params(smallest_cavity: f32, anisotropy: Option<Anisotropy>) -> SurfaceParams {
    SurfaceParams { smallest_cavity, anisotropy, ..SurfaceParams::default() }
}

/// Disorder leaves gaps between the particles of a ball, more with anisotropic kernels.
#[test]
fn gaps_between_particles_are_closed() {
    let particle = f64::from(SPACING).powi(3);
    for (jitter, anisotropy, gaps, larger) in [(0.4, None, 20, 0), (0.3, Some(Anisotropy::default()), 30, 1)]
    {
        let ball = particles([10; 3], jitter, Vec3::new(0.2, -0.1, 0.3), |x| x.norm() < 10.0);
        let open = surface(&ball, &params(0.0, anisotropy));
        let closed = surface(&ball, &SurfaceParams { anisotropy, ..SurfaceParams::default() });
        let stats = closed.stats.cavities;
        println!("{} components, {stats:?}", open.check.components);
        assert_eq!(open.stats.cavities.closed, 0);
        assert!(stats.closed > gaps && stats.remaining <= larger && stats.droplets == 0, "{stats:?}");
        assert_eq!(closed.check.components, open.check.components - stats.closed);
        assert_eq!(closed.check.components, 1 + stats.remaining);
        assert!((closed.check.volume - open.check.volume - stats.volume).abs() < 1e-9);
        assert!(stats.volume < particle * stats.closed as f64);
        assert_eq!(closed.mesh.normals.len(), closed.mesh.positions.len());

        // The rest of the mesh is what it was.
        let mut rest = open.mesh.positions.iter().zip(&open.mesh.normals);
        for (x, normal) in closed.mesh.positions.iter().zip(&closed.mesh.normals) {
            let (_, before) = rest.find(|(before, _)| *before == x).expect("a vertex from before");
            assert_eq!(before, normal);
        }

        // With clean-up too, and for any number of threads.
        let clean = surface(&ball, &SurfaceParams { anisotropy, ..smoothed() });
        assert_eq!((clean.check.components, clean.stats.cavities), (closed.check.components, stats));
        for &threads in crate::thread_counts() {
            let again = par::with_threads(threads, || surface(&ball, &params(1.0, anisotropy)));
            assert!(again.mesh == closed.mesh && again.stats.cavities == stats, "{threads} threads");
        }
    }
}

#[test]
fn bubbles_larger_than_a_particle_stay() {
    for anisotropy in [None, Some(Anisotropy::default())] {
        let hollow = particles([8; 3], 0.0, Vec3::zeros(), |x| x.norm() < 7.0 && x.norm() > 1.8);
        let found = surface(&hollow, &params(1.0, anisotropy));
        assert_eq!((found.check.components, found.stats.cavities.remaining), (2, 1));
        assert_eq!(found.stats.cavities.closed, 0);
        let filled = surface(&hollow, &params(100.0, anisotropy));
        assert_eq!((filled.check.components, filled.stats.cavities.closed), (1, 1));
    }
}

/// A tetrahedron with its right angle at `at` and such an edge, oriented outwards if that is positive.
fn tetrahedron(mesh: &mut Mesh, at: [f32; 3], edge: f32) {
    let first = mesh.positions.len() as u32;
    let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(Vec3::from);
    mesh.positions.extend(corners.map(|x| x * edge.abs() + Vec3::from(at)));
    let faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
    let turned = faces.map(|[a, b, c]: [u32; 3]| if edge > 0.0 { [a, b, c] } else { [a, c, b] });
    mesh.triangles.extend(turned.map(|triangle| triangle.map(|v| v + first)));
}

#[test]
fn droplets_in_a_cavity_go_with_it_and_those_next_to_it_stay() {
    let mut mesh = Mesh::default();
    tetrahedron(&mut mesh, [-5.0; 3], 60.0);
    tetrahedron(&mut mesh, [0.0; 3], -1.0);
    tetrahedron(&mut mesh, [0.05; 3], 0.2);
    // In the box of the cavity, and not in the cavity.
    tetrahedron(&mut mesh, [0.7; 3], 0.2);
    tetrahedron(&mut mesh, [3.0; 3], -2.0);
    let stats = close_cavities(&mut mesh, 0.5);
    assert_eq!((stats.closed, stats.droplets, stats.remaining), (1, 1, 1));
    assert!((stats.volume - 1.0 / 6.0).abs() < 1e-9);
    let first: Vec<f32> = mesh.positions.iter().step_by(4).map(|x| x.x).collect();
    assert_eq!(first, [-5.0, 0.7, 3.0]);
    assert_eq!(mesh.triangles.len(), 12);
    assert_eq!(close_cavities(&mut mesh, 0.5).closed, 0);
}
