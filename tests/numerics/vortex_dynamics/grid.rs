//! Motion by velocities of the grid sum.

use super::*;
use meniscus::sim::vortex::{Kernel, choose_grid};

/// Lines of vortons around a circle, a body that fits on a grid.
fn body(kernel: Kernel, error: f32) -> Vortons {
    let lines = (-6..=6).flat_map(|i| (-6..=6).map(move |j| (f64::from(i), f64::from(j))));
    let lines = lines.filter(|(i, j)| i * i + j * j < 37.0);
    let body = lines.fold(Vortons::default(), |all, (i, j)| {
        let strength = 0.01 * (-(i * i + j * j) / 13.0).exp();
        joined(all, &ring(120, 1.0 + 0.04 * i, 0.04 * j, strength, 0.08))
    });
    assert!(choose_grid(&body, body.len(), kernel, error).is_some(), "a grid serves");
    body
}

/// Distance of the vortons of two flows over their displacement: RMS.
fn missed(found: &Flow, exact: &Flow, start: &Vortons) -> f64 {
    let places = found.vortons.position.iter().zip(&exact.vortons.position).zip(&start.position);
    let [missed, travelled] = places.fold([0.0, 0.0], |[missed, travelled], ((found, exact), start)| {
        [
            missed + f64::from((found - exact).norm_squared()),
            travelled + f64::from((exact - start).norm_squared()),
        ]
    });
    (missed / travelled).sqrt()
}

#[test]
fn a_flow_by_the_grid_follows_one_by_all_pairs_within_its_error() {
    let start = body(Kernel::default(), 1e-3);
    let run = |sum, error| {
        // Steps of one length, so that only the sums differ.
        let params = FlowParams { sum, error, strain: 100.0, displacement: 100.0, ..FlowParams::default() };
        let mut flow = flow(params, &start, 1e-4);
        for _ in 0..if crate::is_soak() { 2 } else { 1 } {
            advance(&mut flow, 0.05);
        }
        flow
    };
    let exact = run(Sum::Direct, 1e-3);
    let errors: Vec<f64> = [1e-2, 1e-3]
        .into_iter()
        .map(|error| {
            let found = run(Sum::Grid, error);
            let found_error = missed(&found, &exact, &start);
            println!(
                "{error}: {found_error:.1e} of the displacement, sampled {:?}",
                found.account(Some(200)).unwrap().error
            );
            assert!(found_error < f64::from(error), "{error}: {found_error}");
            assert!(
                found.account(Some(200)).unwrap().error.is_some_and(|sampled| sampled < f64::from(error))
            );
            found_error
        })
        .collect();
    assert!(errors[1] < 0.5 * errors[0] && errors[0] > 0.0, "{errors:?}");
}

#[test]
fn strays_do_not_enlarge_the_grid_and_vortons_out_of_range_are_named() {
    // The grid leaves out strays a million radii off and surrounds the body: the tree sums them.
    let mut strayed = body(Kernel::default(), 1e-3);
    for x in [1e6, -3e5] {
        strayed.position.push(Vec3::new(x, 0.0, 1.0));
        strayed.strength.push(Vec3::new(0.0, 0.0, 1e-3));
        strayed.core.push(0.08);
    }
    let around = choose_grid(&strayed, strayed.len(), Kernel::default(), 1e-3).unwrap();
    assert!(around.nodes() < 3_000_000, "{around:?}");
    let params = FlowParams { sum: Sum::Grid, max_substeps: 2, ..FlowParams::default() };
    let mut flow = flow(params, &strayed, 1e-4);
    advance(&mut flow, 0.02);
    assert!(flow.account(Some(200)).unwrap().error.is_some_and(|sampled| sampled < 1e-3));

    // A cloud that is thin everywhere would take too large a grid: the tree sums it.
    let thin: Vec<f64> = (0..3 * 4096).map(|i| 1e5 * noise(i)).collect();
    let mut thin = Vortons {
        position: thin.chunks(3).map(|x| Vector3::new(x[0], x[1], x[2]).cast()).collect(),
        strength: vec![Vec3::new(0.0, 0.0, 1e-6); 4096],
        core: vec![0.01; 4096],
    };
    let params = FlowParams { sum: Sum::Grid, max_substeps: 2, ..FlowParams::default() };
    let mut far = self::flow(params.clone(), &thin, 1e-6);
    advance(&mut far, 0.01);
    assert!(far.account(Some(200)).unwrap().error.is_some_and(|sampled| sampled < 1e-3));

    // What no sum can hold stops the flow.
    thin.position[17].x = 1e10;
    let mut lost = self::flow(params, &thin, 1e-6);
    let stop = lost.advance(0.01, &mut [], &mut NoExternalEffects, &mut Unwatched).unwrap_err();
    let message = format!("{stop:?}");
    assert!(
        message.contains("10000000000") && message.contains("beyond") && message.contains("17"),
        "{message}"
    );
}
