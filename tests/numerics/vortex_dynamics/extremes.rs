//! Vortons at their limits: results are finite and bounded, or the error names what is wrong.

use super::*;
use meniscus::sim::{
    Diverged, Stop,
    vortex::flow::{Relaxation, Remesh, Viscosity, ViscousScheme},
};

/// Every term, by both schemes of viscosity.
fn terms(spacing: f32) -> [FlowParams; 2] {
    [ViscousScheme::Exchange, ViscousScheme::Spreading].map(|scheme| FlowParams {
        viscosity: Some(Viscosity { nu: 1e-4, scheme, eddies: None }),
        relaxation: Some(Relaxation { time: 0.1 }),
        remesh: Some(Remesh::of(spacing)),
        max_substeps: 10,
        ..FlowParams::default()
    })
}

/// Two frames with every term and a remeshing: finite all the while.
fn survives(name: &str, vortons: &Vortons) {
    for params in terms(0.1) {
        let mut flow = flow(params, vortons, 1e-3);
        let mut tracers = [Vec3::zeros(), Vec3::repeat(0.3), Vec3::new(0.0, 0.0, 1e5)];
        for _ in 0..2 {
            flow.advance(0.04, &mut tracers, &mut NoExternalEffects, &mut Unwatched)
                .unwrap_or_else(|stop| panic!("{name}: {stop}"));
            assert!(is_finite(&flow) && tracers.iter().flatten().all(|c| c.is_finite()), "{name}");
        }
        let report = flow.remesh(0, &|_| Medium::Air).unwrap_or_else(|stop| panic!("{name}: {stop}"));
        assert!(is_finite(&flow), "{name}");
        assert!(report.after <= 64 * 27 * report.before, "{name}: {report:?}");
        advance(&mut flow, 0.04);
        assert!(is_finite(&flow), "{name}");
    }
}

/// A cloud that `change` spoils.
fn spoiled(count: usize, change: impl Fn(usize, &mut Vec3, &mut Vec3, &mut f32)) -> Vortons {
    let mut vortons = cloud(count);
    for i in 0..count {
        change(i, &mut vortons.position[i], &mut vortons.strength[i], &mut vortons.core[i]);
    }
    vortons
}

#[test]
fn few_vortons_move() {
    survives("none", &Vortons::default());
    survives("one", &cloud(1));
    survives("two in one place", &spoiled(2, |_, x, _, _| *x = Vec3::repeat(0.5)));
    survives("two 1e-7 apart", &spoiled(2, |i, x, _, _| *x = Vec3::x() * (i as f32 * 1e-7)));
    survives("without strength", &spoiled(100, |_, _, g, _| *g = Vec3::zeros()));
    // One alone turns what is around it and stays.
    let one = Vortons { position: vec![Vec3::zeros()], strength: vec![Vec3::z()], core: vec![0.1] };
    let mut flow = flow(direct(), &one, 1e-3);
    let mut tracer = [Vec3::x() * 0.2];
    flow.advance(1.0, &mut tracer, &mut NoExternalEffects, &mut Unwatched).unwrap();
    assert_eq!(flow.vortons, one);
    assert!((tracer[0].norm() - 0.2).abs() < 1e-4 && tracer[0].y != 0.0, "{tracer:?}");
}

#[test]
fn awkward_clouds_move() {
    survives("coincident", &spoiled(500, |_, x, _, _| *x = Vec3::new(0.3, 0.2, 0.1)));
    survives("nearly coincident", &spoiled(500, |_, x, _, _| *x *= 1e-7));
    survives("collinear", &spoiled(500, |_, x, _, _| *x = Vec3::new(x.x, 0.0, 0.0)));
    survives("coplanar", &spoiled(500, |_, x, _, _| x.z = 0.0));
    survives(
        "strengths over twelve decades",
        &spoiled(500, |i, _, g, _| *g *= 10.0_f32.powi(i as i32 % 13 - 12)),
    );
    survives("cores over three decades", &spoiled(500, |i, _, _, s| *s *= 10.0_f32.powi(i as i32 % 4 - 3)));
    survives(
        "a stray",
        &spoiled(500, |i, x, _, _| {
            if i == 0 {
                *x = Vec3::repeat(1e6)
            }
        }),
    );
    survives(
        "in one cell of strays",
        &spoiled(2000, |i, x, _, _| *x *= if i % 250 == 0 { 1e5 } else { 1e-2 }),
    );
}

#[test]
fn a_stray_costs_what_a_vorton_costs() {
    let remeshed = |vortons: &Vortons| {
        let mut flow = flow(FlowParams { remesh: Some(Remesh::of(0.1)), ..direct() }, vortons, 1e-3);
        flow.remesh(0, &|_| Medium::Air).unwrap().after
    };
    let near = spoiled(500, |_, _, _, core| *core = 0.15);
    let mut far = near.clone();
    far.position[0] = Vec3::repeat(1e6);
    let (without, with) = (remeshed(&near), remeshed(&far));
    // Its own 64 nodes, and what its share of strength lets others keep.
    assert!(with <= without + 128, "{with} {without}");
}

#[test]
fn a_hundredfold_step_stays_finite_and_is_counted() {
    for strength in [1.0_f32, 100.0] {
        let vortons = spoiled(1000, |_, _, g, _| *g *= 100.0 * strength);
        let natural = flow(direct(), &vortons, 1e-3).step(
            SubstepLimits { remaining: 1.0, min_time_step: 0.0, number: 1 },
            &mut [],
            &mut NoExternalEffects,
        );
        let seconds = 100.0 * natural.unwrap().seconds;
        let mut flow = flow(FlowParams { max_substeps: 1, ..direct() }, &vortons, 1e-3);
        let (mut clamped, mut capped) = (0, 0);
        for _ in 0..30 {
            let report = advance(&mut flow, seconds);
            clamped += report.clamped;
            capped += report.capped;
            assert!(is_finite(&flow));
        }
        let largest = |vortons: &Vortons| vortons.strength.iter().map(|g| g.norm()).fold(0.0, f32::max);
        assert!(largest(&flow.vortons) <= 1.01 * largest(&vortons), "{}", largest(&flow.vortons));
        assert!(clamped > 0 && capped > 0, "{clamped} {capped}");
    }
}

#[test]
fn numbers_that_are_not_finite_stop_it_by_name() {
    let stopped = |change: fn(&mut Flow)| -> Diverged {
        let mut flow = flow(direct(), &cloud(100), 1e-3);
        flow.retain(|i| i >= 10);
        change(&mut flow);
        match flow.advance(0.1, &mut [], &mut NoExternalEffects, &mut Unwatched) {
            Err(Stop::Diverged(diverged)) => diverged,
            other => panic!("{other:?}"),
        }
    };
    let diverged = stopped(|flow| flow.vortons.strength[7].y = f32::NAN);
    assert_eq!((diverged.system, diverged.particle, diverged.substep), ("smoke", 17, 1));
    assert!(diverged.to_string().contains("strength"), "{diverged}");
    assert_eq!(stopped(|flow| flow.vortons.position[0].x = f32::INFINITY).particle, 10);
    assert_eq!(stopped(|flow| flow.vortons.strength[1].x = 1e12).particle, 11);
    // A tracer is named as one.
    let mut flow = flow(direct(), &cloud(100), 1e-3);
    let mut tracers = [Vec3::zeros(), Vec3::repeat(f32::NAN)];
    let stop =
        flow.advance(0.1, &mut tracers, &mut NoExternalEffects, &mut Unwatched).unwrap_err().to_string();
    assert!(stop.contains("particle 1 of the tracers"), "{stop}");
    // So does a viscosity that would take for ever, and a vorton beyond the grid.
    let viscosity = Some(Viscosity { nu: 1e9, scheme: ViscousScheme::Exchange, eddies: None });
    let mut thick = super::flow(FlowParams { viscosity, ..direct() }, &cloud(100), 1e-3);
    let stop = thick.advance(0.1, &mut [], &mut NoExternalEffects, &mut Unwatched).unwrap_err().to_string();
    assert!(stop.contains("steps of particle strength exchange"), "{stop}");
    let wanted = FlowParams { remesh: Some(Remesh::of(1e-3)), ..direct() };
    let far = super::flow(
        wanted,
        &spoiled(100, |i, x, _, _| {
            if i == 5 {
                x.y = 1e8
            }
        }),
        1e-3,
    )
    .remesh(3, &|_| Medium::Air)
    .unwrap_err();
    assert_eq!((far.particle, far.substep), (5, 3));
}
