//! What motion keeps, and the same bits for any number of threads.

use super::*;
use meniscus::{
    par,
    sim::vortex::{
        Invariants,
        flow::{Relaxation, Remesh, Viscosity, ViscousScheme},
    },
};

/// Two wavy rings, one tilted, on their way into each other.
fn colliding() -> Vortons {
    let mut both = joined(ring(300, 1.0, 0.0, 1.0, 0.15), &ring(300, 0.8, 1.0, -1.0, 0.15));
    let count = both.len();
    for i in 0..count {
        let (x, g) = (both.position[i], both.strength[i]);
        let wave = 0.05 * (5.0 * x.y.atan2(x.x)).sin();
        let turn = nalgebra::Rotation3::from_euler_angles(if i < count / 2 { 0.0 } else { 0.6 }, 0.0, 0.0);
        (both.position[i], both.strength[i]) = (turn * (x + Vec3::z() * wave), turn * g);
    }
    both
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    (Vector3::from(a) - Vector3::from(b)).norm()
}

/// The drift of ΣΓ over Σ|Γ|, of I and L over ½Σ|x||Γ| and of E over itself, after a second: before they touch.
fn drift(params: FlowParams) -> [f64; 4] {
    let vortons = colliding();
    let size: f64 = vortons.strength.iter().map(|g| f64::from(g.norm())).sum();
    let mut flow = flow(params, &vortons, 1e-3);
    let before: Invariants = flow.account(None).unwrap().invariants;
    for _ in 0..20 {
        let report = advance(&mut flow, 0.05);
        assert_eq!((report.clamped, report.capped), (0, 0));
    }
    let after = flow.account(None).unwrap().invariants;
    [
        distance(before.strength, after.strength) / size,
        distance(before.impulse, after.impulse) / (0.5 * size),
        distance(before.angular_impulse, after.angular_impulse) / (0.5 * size),
        (after.energy / before.energy - 1.0).abs(),
    ]
}

#[test]
fn invariants_drift_within_bounds() {
    let [strength, impulse, angular, energy] = drift(direct());
    // The transpose form keeps ΣΓ pair by pair; nothing keeps the others exactly.
    assert!(strength < 2e-6, "{strength}");
    assert!(impulse < 0.01 && angular < 0.01 && energy < 0.05, "{impulse} {angular} {energy}");
    // By the tree, to its error.
    let [strength, ..] = drift(FlowParams { error: 1e-4, ..FlowParams::default() });
    assert!(strength < 2e-4, "{strength}");
}

/// Everything at once.
fn everything() -> FlowParams {
    FlowParams {
        viscosity: Some(Viscosity { nu: 1e-3, scheme: ViscousScheme::Exchange, eddies: None }),
        relaxation: Some(Relaxation { time: 0.5 }),
        remesh: Some(Remesh { share: 0.0, ..Remesh::of(0.08) }),
        ..FlowParams::default()
    }
}

#[test]
fn the_same_bits_on_any_number_of_threads_and_after_a_pause() {
    let run = |threads: usize, pause: bool| {
        par::with_threads(threads, || {
            let mut flow = flow(everything(), &cloud(3000), 1.0 / 3000.0);
            let mut tracers = cloud(1000).position;
            for _ in 0..3 {
                let report = flow.advance(0.1, &mut tracers, &mut NoExternalEffects, &mut Unwatched).unwrap();
                assert!(report.remesh.is_some() && report.exchanges > 0);
                if pause {
                    let Flow { params, vortons, volume, id, next_id, strained } = flow;
                    flow = Flow::restore(params, vortons, volume, id, next_id, strained);
                }
            }
            let account = flow.account(Some(100)).unwrap();
            assert!(account.error.unwrap() < 1e-3, "{account:?}");
            (flow, tracers, account)
        })
    };
    let one = run(1, false);
    assert!(run(2, true) == one && run(3, false) == one);
}

#[test]
fn tracers_drift_as_vortons_do() {
    let vortons = cloud(500);
    let mut tracers = vortons.position.clone();
    let mut flow = flow(direct(), &vortons, 1e-3);
    flow.advance(0.5, &mut tracers, &mut NoExternalEffects, &mut Unwatched).unwrap();
    for (x, tracer) in flow.vortons.position.iter().zip(&tracers) {
        assert!((x - tracer).norm() < 1e-5, "{x} {tracer}");
    }
    assert!((tracers[7] - vortons.position[7]).norm() > 1e-3, "they moved");
}

/// A wind that turns with time, and strengths that grow by it.
struct Wind;

impl ExternalEffects for Wind {
    fn add_rates(&mut self, now: Stage<'_>, rates: &mut Rates) -> Result<(), OutOfRange> {
        assert_eq!(now.vortons.len(), now.volume.len());
        let wind = Vec3::new(1.0, (now.seconds as f32).powi(2) * 3.0, 0.0);
        rates.velocity.iter_mut().chain(&mut rates.tracers).for_each(|u| *u += wind);
        rates.strength.iter_mut().for_each(|rate| *rate += Vec3::new(0.0, 0.0, 2.0 * now.seconds as f32));
        Ok(())
    }
}

#[test]
fn external_effects_are_integrated_to_third_order() {
    let one = Vortons { position: vec![Vec3::zeros()], strength: vec![Vec3::zeros()], core: vec![1.0] };
    let mut flow = flow(FlowParams { strain: 100.0, displacement: 100.0, ..direct() }, &one, 1e-3);
    let mut tracer = [Vec3::new(5.0, 0.0, 0.0)];
    let span = SubstepLimits { remaining: 0.5, min_time_step: 0.5, number: 1 };
    flow.step(span, &mut tracer, &mut Wind).unwrap();
    // t², integrated over a half: a scheme of third order is exact.
    let moved = Vec3::new(0.5, 0.125, 0.0);
    assert!((flow.vortons.position[0] - moved).norm() < 1e-6, "{:?}", flow.vortons.position);
    assert!((flow.vortons.strength[0].z - 0.25).abs() < 1e-6, "{:?}", flow.vortons.strength);
    // The vorton that gained strength turns what is around it.
    assert!((tracer[0] - Vec3::new(5.0, 0.0, 0.0) - moved).norm() < 1e-2);
}

#[test]
fn time_is_integrated_to_third_order() {
    let mut vortons = cloud(200);
    vortons.strength.iter_mut().for_each(|g| *g *= 20.0);
    let after = |steps: u32| {
        let params = FlowParams { strain: 100.0, displacement: 100.0, ..direct() };
        let mut flow = flow(params, &vortons, 1e-3);
        for number in 1..=steps {
            let seconds = 1.0 / f64::from(steps);
            flow.step(
                SubstepLimits { remaining: seconds, min_time_step: seconds, number },
                &mut [],
                &mut NoExternalEffects,
            )
            .unwrap();
        }
        flow.vortons
    };
    let exact = after(256);
    let error = |steps| {
        let found = after(steps);
        let missed: f32 =
            found.position.iter().zip(&exact.position).map(|(a, b)| (a - b).norm_squared()).sum();
        f64::from(missed).sqrt()
    };
    let errors = [error(4), error(8), error(16)];
    let orders = [(errors[0] / errors[1]).log2(), (errors[1] / errors[2]).log2()];
    assert!(orders.iter().all(|order| (2.5..3.8).contains(order)), "{errors:?} {orders:?}");
}

#[test]
fn relaxation_straightens_and_keeps_sizes() {
    let params = FlowParams { relaxation: Some(Relaxation { time: 0.05 }), ..direct() };
    let run = |params: FlowParams| {
        let mut flow = flow(params, &colliding(), 1e-3);
        advance(&mut flow, 1.0);
        flow
    };
    // Between the strength and the vorticity where it is.
    let misalignment = |flow: &Flow| {
        let found = induced(
            &flow.vortons,
            Targets::Vortons,
            Quantity::VelocityAndGradient,
            flow.params.kernel,
            Method::Direct,
        )
        .unwrap();
        let (mut sum, mut whole) = (0.0, 0.0);
        for (g, m) in flow.vortons.strength.iter().zip(&found.gradient) {
            let omega = Vec3::new(m[(2, 1)] - m[(1, 2)], m[(0, 2)] - m[(2, 0)], m[(1, 0)] - m[(0, 1)]);
            sum += f64::from(g.norm() * (1.0 - g.normalize().dot(&omega.normalize())));
            whole += f64::from(g.norm());
        }
        sum / whole
    };
    let (without, with) = (misalignment(&run(direct())), misalignment(&run(params)));
    assert!(with < 0.5 * without, "{with} {without}");
}
