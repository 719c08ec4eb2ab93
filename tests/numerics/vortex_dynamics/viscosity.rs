//! Diffusion: by particle strength exchange, and by cores that grow.

use super::*;
use meniscus::sim::vortex::{
    Kernel,
    flow::{Remesh, Viscosity, ViscousScheme},
};

/// A column along z of length 7.875, ω ~ e^(−r²/a²), circulation 1; Gaussian cores add to a².
fn column(spacing: f64, a: f64, core: f64) -> Vortons {
    seeding_lattice(spacing, [1.25, 1.25, 3.875], core, |x| {
        Vector3::z() * ((-(x.x * x.x + x.y * x.y) / (a * a)).exp() / (PI * a * a))
    })
}

/// The speed around the middle of the column whose a² has become `wide`. A line of length L misses Γ r/(πL²) of an
/// endless one's, whatever is around it, but for (r/L)⁴.
fn lamb_oseen(r: f64, wide: f64, length: f64) -> f64 {
    (1.0 - (-r * r / wide).exp()) / (2.0 * PI * r) - r / (PI * length * length)
}

/// The largest error of the speed around the column at radii of 0.1 to 0.9, over the largest speed, after diffusion by ν = 0.1
/// for 0.4 s; and the same against what it was at the start.
fn spun_down(spacing: f64, scheme: ViscousScheme, remesh: Option<Remesh>) -> [f64; 2] {
    let (seconds, core, nu) = (0.4, 1.3 * spacing, 0.1_f32);
    // As wide at the start whatever the cores.
    let start = 0.21;
    let a = (start - 2.0 * core * core).sqrt();
    let params = FlowParams {
        kernel: Kernel::Gaussian,
        viscosity: Some(Viscosity { nu, scheme, eddies: None }),
        remesh,
        strain: 0.5,
        ..FlowParams::default()
    };
    let mut flow = flow(params, &column(spacing, a, core), spacing.powi(3) as f32);
    for _ in 0..2 {
        advance(&mut flow, seconds / 2.0);
    }
    let radii: Vec<f64> = (1..10).map(|k| 0.1 * f64::from(k)).collect();
    let points: Vec<Vec3> = radii.iter().map(|&r| Vector3::new(0.6 * r, 0.8 * r, 0.0).cast()).collect();
    let found = flow.velocity_at(&points).unwrap();
    [start + 4.0 * f64::from(nu) * seconds, start].map(|wide| {
        let exact: Vec<f64> = radii.iter().map(|&r| lamb_oseen(r, wide, 7.875)).collect();
        let largest = exact.iter().copied().fold(0.0, f64::max);
        let missed = found
            .iter()
            .zip(&exact)
            .map(|(u, exact)| (f64::from(Vec3::new(-0.8, 0.6, 0.0).dot(u)) - exact).abs());
        missed.fold(0.0, f64::max) / largest
    })
}

#[test]
#[ignore = "long: tools/soak/run"]
fn a_vortex_spins_down_as_lamb_and_oseen_found() {
    // A seeding lattice of an eighth of a metre is 2.7 to the column's standard deviation.
    let [coarse, fine] = [1.0 / 6.0, 0.125].map(|spacing| spun_down(spacing, ViscousScheme::Exchange, None));
    assert!(fine[0] < 0.04 && fine[1] > 0.25, "exchange: {fine:?}");
    let order = (coarse[0] / fine[0]).ln() / (4.0_f64 / 3.0).ln();
    assert!((1.5..3.0).contains(&order), "exchange: order {order}");
    let [error, change] = spun_down(0.125, ViscousScheme::Spreading, None);
    assert!(error < 0.005 && change > 0.25, "spreading: {error} {change}");
    // Grown cores, divided.
    let remesh = Remesh { core: 1.3, most: 1.5, weak: 1e-4, ..Remesh::of(0.125) };
    let [error, change] = spun_down(0.125, ViscousScheme::Spreading, Some(remesh));
    assert!(error < 0.02 && change > 0.25, "spreading and dividing: {error} {change}");
}

/// A blob of vorticity e^(−r²/2a²) of too little circulation to move, and its strengths' relative L2 error after diffusion.
fn faded(spacing: f64, substeps: u32) -> f64 {
    let (a, nu, seconds) = (0.3_f64, 0.05, 0.5);
    let omega = |x: Vector3<f64>, variance: f64| {
        Vector3::z() * (1e-6 * (variance / (a * a)).powf(-1.5) * (-x.norm_squared() / (2.0 * variance)).exp())
    };
    let vortons = seeding_lattice(spacing, [1.5; 3], 1.25 * spacing, |x| omega(x, a * a));
    let viscosity = Some(Viscosity { nu: nu as f32, scheme: ViscousScheme::Exchange, eddies: None });
    let mut flow = flow(FlowParams { viscosity, ..FlowParams::default() }, &vortons, spacing.powi(3) as f32);
    for _ in 0..substeps {
        let report = advance(&mut flow, seconds / f64::from(substeps));
        assert_eq!(report.substeps, 1, "it does not move");
    }
    let (mut missed, mut whole) = (0.0, 0.0);
    for (x, g) in vortons.position.iter().zip(&flow.vortons.strength) {
        let exact = omega(x.cast(), a * a + 2.0 * nu * seconds) * spacing.powi(3);
        missed += (g.cast() - exact).norm_squared();
        whole += exact.norm_squared();
    }
    (missed / whole).sqrt()
}

#[test]
fn exchange_converges_with_second_order() {
    let spacings = if crate::is_soak() { &[0.15, 0.1, 0.075][..] } else { &[0.15, 0.1] };
    let errors: Vec<f64> = spacings.iter().map(|&spacing| faded(spacing, 1)).collect();
    for (spacing, error) in spacings.windows(2).zip(errors.windows(2)) {
        let order = (error[0] / error[1]).ln() / (spacing[0] / spacing[1]).ln();
        assert!((1.5..3.0).contains(&order), "{errors:?} {order}");
    }
    assert!(errors[1] < 0.06 && errors.get(2).is_none_or(|&error| error < 0.03), "{errors:?}");
}

#[test]
fn exchange_keeps_the_sum_of_strengths() {
    // Too little circulation to stretch, which keeps ΣΓ only among equal cores.
    let mut vortons = cloud(4000);
    vortons.strength.iter_mut().for_each(|g| *g *= 1e-6);
    for (i, core) in vortons.core.iter_mut().enumerate() {
        *core *= 0.5 + noise(99 * i) as f32;
    }
    let sum = |vortons: &Vortons| vortons.strength.iter().map(|g| g.cast::<f64>()).sum::<Vector3<f64>>();
    let size: f64 = vortons.strength.iter().map(|g| f64::from(g.norm())).sum();
    let before = sum(&vortons);
    let viscosity = Some(Viscosity { nu: 0.05, scheme: ViscousScheme::Exchange, eddies: None });
    let mut flow = Flow::new(FlowParams { viscosity, ..direct() });
    // Volumes that differ, too.
    let volume: Vec<f32> = (0..vortons.len()).map(|i| (0.5 + noise(7 * i) as f32) / 4000.0).collect();
    flow.add(&vortons, &volume);
    let report = advance(&mut flow, 0.1);
    assert!(report.exchanges > 0 && report.clamped == 0);
    let after: f64 = flow.vortons.strength.iter().map(|g| f64::from(g.norm())).sum();
    assert!(after < 0.7 * size, "it spread: {after} of {size}");
    assert!((sum(&flow.vortons) - before).norm() < 2e-7 * size, "{} {before}", sum(&flow.vortons));
}

#[test]
fn far_beyond_the_explicit_limit_rounds_keep_it_bounded() {
    // ν dt/s² = 10 in one substep.
    let (spacing, core) = (0.1, 0.125);
    let vortons =
        seeding_lattice(spacing, [0.5; 3], core, |x| Vector3::x() * if x.norm() < 0.12 { 1e-6 } else { 0.0 });
    let largest = |flow: &Flow| flow.vortons.strength.iter().map(|g| g.norm()).fold(0.0, f32::max);
    let seconds = 1.0;
    let nu = (10.0 * core * core / seconds) as f32;
    let viscosity = Some(Viscosity { nu, scheme: ViscousScheme::Exchange, eddies: None });
    let mut flow = flow(FlowParams { viscosity, ..FlowParams::default() }, &vortons, spacing.powi(3) as f32);
    let before = largest(&flow);
    let report = advance(&mut flow, seconds);
    assert!(report.substeps == 1 && (15..30).contains(&report.exchanges), "{report:?}");
    assert!(largest(&flow) < before && flow.vortons.strength.iter().all(|g| g.x >= 0.0));
    // None is redistributed at all.
    let mut frozen = Flow { params: FlowParams::default(), ..flow.clone() };
    flow.params.viscosity = Some(Viscosity { nu: 0.0, scheme: ViscousScheme::Exchange, eddies: None });
    assert_eq!((advance(&mut flow, seconds).exchanges, advance(&mut frozen, seconds).exchanges), (0, 0));
    assert_eq!(flow.vortons, frozen.vortons);
}
