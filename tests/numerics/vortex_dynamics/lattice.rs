//! Remeshing: what it keeps, and when it is done.

use super::*;
use meniscus::sim::vortex::{
    Kernel,
    flow::{Remesh, Viscosity, ViscousScheme},
};

/// ΣΓ, Σ x × Γ and Σ x × (x × Γ).
fn moments(vortons: &Vortons) -> [Vector3<f64>; 3] {
    let mut sums = [Vector3::zeros(); 3];
    for (x, g) in vortons.position.iter().zip(&vortons.strength) {
        let (x, g): (Vector3<f64>, Vector3<f64>) = (x.cast(), g.cast());
        let impulse = x.cross(&g);
        for (sum, term) in sums.iter_mut().zip([g, impulse, x.cross(&impulse)]) {
            *sum += term;
        }
    }
    sums
}

/// Cloud, cores as the lattice's, and none weak.
fn remesh(weak: f32) -> Remesh {
    Remesh { weak, ..Remesh::of(0.1) }
}

#[test]
fn remeshing_keeps_strength_impulse_and_angular_impulse() {
    let mut vortons = cloud(2000);
    vortons.core.fill(0.15);
    let size: f64 = vortons.strength.iter().map(|g| f64::from(g.norm())).sum();
    let before = moments(&vortons);
    let remeshed = |vortons: &Vortons, weak: f32| {
        let mut flow = flow(FlowParams { remesh: Some(remesh(weak)), ..direct() }, vortons, 1e-3);
        let report = flow.remesh(0).unwrap();
        assert_eq!(report.after as usize, flow.vortons.len());
        assert!(flow.id.iter().all(|&id| (2000..flow.next_id).contains(&id)), "new ones, new numbers");
        assert!(flow.vortons.core.iter().all(|&core| (core - 0.15).abs() < 1e-6));
        (moments(&flow.vortons), report)
    };
    let drift = |after: &[Vector3<f64>; 3], k: usize| (after[k] - before[k]).norm() / size;
    let (after, report) = remeshed(&vortons, 0.0);
    assert!((0..3).all(|k| drift(&after, k) < 1e-6), "{before:?} {after:?}");
    assert_eq!((report.before, report.dropped), (2000, 0));
    // Weak ones hand on strength and impulse; of the second moments they lose little.
    let (after, thinned) = remeshed(&vortons, 1e-2);
    assert!(drift(&after, 0) < 1e-6 && drift(&after, 1) < 1e-6 && drift(&after, 2) < 1e-3, "{after:?}");
    assert!(thinned.dropped > report.after / 20, "{thinned:?}");
    assert_eq!(thinned.after + thinned.dropped, report.after);
    // Wide cores are divided: what is symmetric about them keeps ΣΓ and impulse.
    vortons.core.fill(0.25);
    let (after, _) = remeshed(&vortons, 0.0);
    assert!(drift(&after, 0) < 1e-6 && drift(&after, 1) < 1e-6, "{after:?}");
}

#[test]
fn divided_cores_leave_the_velocity_as_it_was() {
    for kernel in [Kernel::Gaussian, Kernel::WinckelmansLeonard] {
        let spacing = 0.1;
        let omega = |x: Vector3<f64>| Vector3::new(-x.y, x.x, 0.0) * (-x.norm_squared() / 0.18).exp();
        let vortons = lattice(spacing, [1.2; 3], 0.25, omega);
        let points: Vec<Vec3> =
            (0..200).map(|i| Vec3::from_fn(|k, _| 1.6 * noise(3 * i + k) as f32 - 0.8)).collect();
        let wanted = Some(Remesh { weak: 0.0, ..remesh(0.0) });
        let mut flow = flow(FlowParams { kernel, remesh: wanted, ..direct() }, &vortons, 1e-3);
        let before = flow.velocity_at(&points).unwrap();
        flow.remesh(0).unwrap();
        let after = flow.velocity_at(&points).unwrap();
        let norm = |v: &dyn Fn(usize) -> Vec3| (0..200).map(|i| v(i).norm_squared()).sum::<f32>().sqrt();
        let error = norm(&|i| after[i] - before[i]) / norm(&|i| before[i]);
        let bound = if kernel == Kernel::Gaussian { 0.01 } else { 0.06 };
        assert!(error < bound, "{kernel:?}: {error}");
    }
}

#[test]
fn the_overlap_of_a_lattice_is_its_cores_over_its_spacing() {
    let body = lattice(0.1, [0.8; 3], 0.15, |_| Vector3::z());
    let flow = flow(direct(), &body, 1e-3);
    let overlap = flow.overlap();
    let middle = flow.vortons.position.iter().position(|x| x.norm() < 1e-3).unwrap();
    assert!((overlap[middle] - 1.5).abs() < 0.01, "{}", overlap[middle]);
    let least = overlap.iter().copied().fold(f32::INFINITY, f32::min);
    assert!((0.7..1.2).contains(&least), "a corner has an eighth: {least}");
}

#[test]
fn lost_overlap_calls_for_a_lattice_and_a_lattice_for_nothing() {
    let wanted = remesh(1e-3);
    let params = FlowParams { remesh: Some(wanted), ..direct() };
    let smooth = |stretch: f32| {
        let mut body = lattice(0.1, [0.8; 3], 0.15, |x| Vector3::z() * (-x.norm_squared() * 8.0).exp());
        body.position.iter_mut().for_each(|x| *x *= stretch);
        body
    };
    assert_eq!(flow(params.clone(), &smooth(1.0), 1e-3).tend(0).unwrap(), None);
    assert!(flow(params.clone(), &smooth(2.0), 1e-3).tend(0).unwrap().is_some(), "parted");
    assert!(flow(params.clone(), &smooth(0.5), 1e-3).tend(0).unwrap().is_some(), "crowded");
    assert_eq!(flow(direct(), &smooth(2.0), 1e-3).tend(0).unwrap(), None, "not asked for");
    // Grown cores too.
    let viscosity = Some(Viscosity { nu: 0.01, scheme: ViscousScheme::Spreading });
    let kernel = Kernel::Gaussian;
    let mut growing = flow(FlowParams { kernel, viscosity, ..params }, &smooth(1e-0), 1e-3);
    growing.vortons.strength.iter_mut().for_each(|g| *g *= 1e-6);
    assert!(advance(&mut growing, 1.0).remesh.is_none());
    let report = advance(&mut growing, 2.0);
    assert!(report.remesh.is_some() && growing.vortons.core.iter().all(|&c| (c - 0.15).abs() < 1e-6));
}
