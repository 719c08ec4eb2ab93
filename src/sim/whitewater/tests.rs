//! Whitewater of liquids whose motion is known.

use super::{
    emission::births,
    liquid::{LiquidFrame, LiquidInterval},
    params::{Kind, WhitewaterParams},
    potentials::Rates,
    state::{Particle, Whitewater},
    step::advance,
    walls::Walls,
};
use crate::{
    control::CancelToken,
    frame::{Stream, StreamKind},
    math::Vec3,
    sim::{Timeline, World, force::ForceParams},
};

const SPACING: f32 = 0.05;

fn walls(gravity: Vec3) -> Walls {
    Walls { solids: Vec::new(), gravity, forces: None }
}

/// A cube of n³ particles around the origin, those that `is_in` accepts.
fn cube(n: i32, is_in: impl Fn(Vec3) -> bool) -> Vec<Vec3> {
    let at = |i: i32| (i as f32 - (n - 1) as f32 / 2.0) * SPACING;
    let places = (0..n * n * n).map(|i| Vec3::new(at(i % n), at(i / n % n), at(i / (n * n))));
    places.filter(|x| is_in(*x)).collect()
}

fn stream(x: &[Vec3], velocity: impl Fn(Vec3) -> Vec3) -> Stream {
    let mut stream = Stream::new("liquid", StreamKind::Particles, x.len())
        .with("position", x.to_vec())
        .with("velocity", x.iter().map(|x| velocity(*x)).collect::<Vec<_>>())
        .with("id", (0..x.len() as u32).collect::<Vec<_>>());
    stream.scalars.push(("spacing".into(), f64::from(SPACING)));
    stream
}

/// Emission of every particle with all that moves at full kinetic energy [1/s].
fn rates(x: &[Vec3], velocity: impl Fn(Vec3) -> Vec3, change: impl Fn(&mut WhitewaterParams)) -> Vec<f32> {
    let mut params = WhitewaterParams { speed: [0.0, 0.001], ..WhitewaterParams::default() };
    change(&mut params);
    let v: Vec<Vec3> = x.iter().map(|x| velocity(*x)).collect();
    Rates::new(&params, &walls(Vec3::zeros())).of(x, &v, SPACING, 0.0)
}

#[test]
fn trapped_air_is_where_neighbours_approach_each_other() {
    let x = cube(9, |_| true);
    let middle = x.len() / 2;
    let common = Vec3::new(5.0, 0.0, 0.0);
    let emission = |gradient: f32| {
        let trapped = |params: &mut WhitewaterParams| {
            (params.trapped_air, params.trapped_air_speed, params.wave_crests) = (1e6, [0.0, 10.0], 0.0);
        };
        rates(&x, |x| common + x * gradient, trapped)[middle]
    };
    // By the integral over filled space, Σ (|v_ij| − v_ij · x̂_ij) W / Σ W = 2.4 k h for v = −k x.
    let expected = 1e6 * SPACING * SPACING * 2.4 * 4.0 * SPACING / 10.0;
    let found = emission(-4.0);
    assert!((found / expected - 1.0).abs() < 0.1, "{found}, expected {expected}");
    assert!(emission(4.0) < 1e-3 * expected, "neighbours that part trap no air");
    assert!(emission(0.0) < 1e-3 * expected, "a common velocity traps no air");
}

#[test]
fn crests_are_convex_and_move_outwards() {
    let ball = cube(13, |x| x.norm() < 6.0 * SPACING);
    let crests = |params: &mut WhitewaterParams| {
        (params.trapped_air, params.wave_crest_curvature) = (0.0, [0.0, 4.0]);
    };
    let found = rates(&ball, |_| Vec3::new(0.0, 0.0, 2.0), crests);
    let sum = |is_in: fn(f32) -> bool| -> f32 {
        let places = ball.iter().zip(&found).filter(|(x, _)| is_in(x.z / (6.0 * SPACING)));
        places.map(|(_, rate)| rate).sum()
    };
    assert!(sum(|z| z > 0.7) > 0.0);
    assert_eq!(sum(|z| z < 0.3), 0.0, "the bulk and the rear emit nothing");
    let block = cube(13, |_| true);
    let flat = rates(&block, |_| Vec3::new(0.0, 0.0, 2.0), crests);
    let top = block.iter().position(|x| x.norm() < 6.01 * SPACING && x.z > 5.9 * SPACING).unwrap();
    assert!(flat[top] < 1e-3 * sum(|z| z > 0.7), "a flat surface is no crest: {}", flat[top]);
}

/// `max_particles` applies to what is left after thinning by kind.
#[test]
fn the_limit_counts_particles_after_thinning_by_kind() {
    let run = |max_particles: u32| {
        let mut params = WhitewaterParams { max_particles, ..WhitewaterParams::default() };
        // Spray of a large amount sets the amount that is drawn, but all that is born here is in the bulk.
        (params.spray.amount, params.foam.amount, params.bubbles.amount) = (1.5, 1.0, 1.0);
        let liquid = crowded(600.0);
        let mut state = Whitewater::default();
        let walls = walls(Vec3::zeros());
        assert!(advance(&mut state, &liquid, &params, &walls, None, &CancelToken::new()).is_continue());
        state
    };
    let all = run(1_000_000);
    let count = all.len() as u32;
    assert!(count > 2000 && all.record.over_limit == 0, "{count}");
    assert_eq!(run(count), all, "a limit that is just met changes nothing");
    let few = run(count - 100);
    assert_eq!((few.len() as u32, few.record.over_limit), (count - 100, 100));
}

/// The interior of a block at rest that emits at a rate [1/s] for a 24th of a second.
fn crowded(rate: f32) -> LiquidInterval {
    let block = cube(17, |_| true);
    let params = WhitewaterParams::default();
    let walls = walls(Vec3::zeros());
    let rates = Rates::new(&params, &walls);
    let frame = |time: f64| {
        let mut frame = LiquidFrame::new(&stream(&block, |_| Vec3::zeros()), time, &rates).unwrap();
        frame.rate = block.iter().map(|x| if x.amax() < 3.0 * SPACING { rate } else { 0.0 }).collect();
        frame
    };
    LiquidInterval::new(&frame(0.0), &frame(1.0 / 24.0))
}

#[test]
fn what_is_slow_and_what_has_no_neighbours_emits_nothing() {
    let x = cube(5, |_| true);
    let slow = |params: &mut WhitewaterParams| params.speed = [0.7, 2.5];
    assert!(rates(&x, |x| x * -2.0, slow).iter().all(|&rate| rate == 0.0));
    assert_eq!(rates(&[Vec3::zeros()], |_| Vec3::new(9.0, 0.0, 0.0), |_| {}), [0.0]);
}

/// A liquid whose particles all emit at a rate [1/s], at rest, from one time to another [s].
fn interval(count: u32, rate: f32, [from, to]: [f64; 2]) -> LiquidInterval {
    let frame = |time: f64| LiquidFrame {
        time,
        spacing: SPACING,
        id: (0..count).collect(),
        position: (0..count).map(|i| Vec3::new(i as f32, 0.0, 0.0)).collect(),
        velocity: vec![Vec3::zeros(); count as usize],
        rate: vec![rate; count as usize],
        left_out: 0,
    };
    LiquidInterval::new(&frame(from), &frame(to))
}

/// Emitters and times [s] of the particles that appear.
fn appearances(liquid: &LiquidInterval, amount: f32, cuts: &[f64]) -> Vec<(u32, i64)> {
    let params = WhitewaterParams::default();
    let parts = cuts.windows(2).flat_map(|cut| births(liquid, &params, amount, cut[0], cut[1]));
    let time = |part: f64| ((liquid.time[0] + part * liquid.seconds()) * 1e9).round() as i64;
    let mut found: Vec<_> = parts.map(|birth| (birth.track, time(birth.part))).collect();
    found.sort_unstable();
    found
}

#[test]
fn emission_has_its_rate_and_depends_on_neither_frames_nor_steps() {
    let whole = interval(400, 130.0, [0.25, 0.5]);
    let found = appearances(&whole, 1.0, &[0.0, 1.0]);
    let expected = 400.0 * 130.0 * 0.25_f64;
    assert!((found.len() as f64 - expected).abs() < 4.0 * expected.sqrt(), "{} of {expected}", found.len());
    assert_eq!(found, appearances(&whole, 1.0, &[0.0, 0.1, 0.35, 0.9, 1.0]), "steps");
    let halves = [[0.25, 0.375], [0.375, 0.5]].map(|span| interval(400, 130.0, span));
    let mut of_halves: Vec<_> = halves.iter().flat_map(|half| appearances(half, 1.0, &[0.0, 1.0])).collect();
    of_halves.sort_unstable();
    assert_eq!(found, of_halves, "frames");
    let fewer = appearances(&whole, 0.3, &[0.0, 1.0]);
    assert!(fewer.iter().all(|birth| found.binary_search(birth).is_ok()), "a smaller amount is a subset");
    let share = fewer.len() as f64 / found.len() as f64;
    assert!((share - 0.3).abs() < 0.03, "{share}");
}

/// Where a particle is after a second in a liquid that moves with a velocity.
fn after_a_second(x: Vec3, kind: Kind, u: Vec3, change: impl Fn(&mut WhitewaterParams)) -> Particle {
    under_forces(x, kind, u, change, "")
}

/// Where a particle is after a second in a liquid that moves with a velocity, under forces.
fn under_forces(
    x: Vec3,
    kind: Kind,
    u: Vec3,
    change: impl Fn(&mut WhitewaterParams),
    forces: &str,
) -> Particle {
    let mut params = WhitewaterParams { amount: 0.0, ..WhitewaterParams::default() };
    change(&mut params);
    let forces: Vec<ForceParams> =
        forces.split(';').filter(|one| !one.is_empty()).map(crate::from_toml).collect();
    let world = World { gravity: Vec3::new(0.0, 0.0, -9.81), solids: Vec::new() };
    let walls = Walls::new(&world, &forces, Timeline { fps: 24.0, first: 0 });
    let rates = Rates::new(&params, &walls);
    let block = cube(17, |_| true);
    let mut state = Whitewater::default();
    let (v, id, age, life, radius, threshold) = (Vec3::zeros(), 0, 0.0, 1.0, 0.002, 0.0);
    state.particles.push(Particle { x, v, id, kind, age, life, radius, threshold });
    let frame = |number: u32| {
        let time = f64::from(number) / 24.0;
        let moved: Vec<Vec3> = block.iter().map(|x| x + u * time as f32).collect();
        LiquidFrame::new(&stream(&moved, |_| u), time, &rates).unwrap()
    };
    for number in 0..24 {
        let (a, b) = (frame(number), frame(number + 1));
        assert!(
            advance(&mut state, &LiquidInterval::new(&a, &b), &params, &walls, None, &CancelToken::new())
                .is_continue()
        );
    }
    state.particles[0]
}

#[test]
fn drops_fall_bubbles_rise_and_foam_floats_at_their_terminal_velocities() {
    let gravity = 9.81_f32;
    let high = Vec3::new(0.0, 0.0, 10.0);
    let drop = after_a_second(high, Kind::Spray, Vec3::zeros(), |params| params.spray.drag = 20.0);
    assert_eq!(drop.kind, Kind::Spray);
    assert!((drop.v.z + gravity / 20.0).abs() < 1e-3, "{}", drop.v);
    // The height of v̇ = −g − k v from rest: g/k (t − 1/k).
    assert!((drop.x.z - 10.0 + gravity / 20.0 * (1.0 - 1.0 / 20.0)).abs() < 1e-3, "{}", drop.x);
    let deep = Vec3::new(0.01, 0.02, -0.2);
    let bubble = after_a_second(deep, Kind::Bubble, Vec3::zeros(), |_| {});
    assert_eq!(bubble.kind, Kind::Bubble);
    assert!((bubble.v.z - 0.25 * gravity / 10.0).abs() < 1e-3, "{}", bubble.v);
    let u = Vec3::new(0.3, -0.1, 0.0);
    let foam = after_a_second(Vec3::new(0.01, 0.02, 0.43), Kind::Foam, u, |_| {});
    assert_eq!(foam.kind, Kind::Foam);
    assert!((foam.v - u).norm() < 1e-3, "{}", foam.v);
    assert!((foam.age - 1.0).abs() < 1e-5);
}

#[test]
fn forces_on_the_liquid_act_on_spray_and_wind_is_its_air() {
    let high = Vec3::new(0.0, 0.0, 10.0);
    let drop = |drag: f32, forces: &str| {
        let set = |params: &mut WhitewaterParams| params.spray.drag = drag;
        under_forces(high, Kind::Spray, Vec3::zeros(), set, forces).v
    };
    let wind = "kind = { drag = { rate = 0.5, velocity = [8, 0, 0] } }";
    // v = U (1 − e^(−(k + K) t)), falling at g/(k + K).
    let v = drop(20.0, wind);
    assert!((v - Vec3::new(8.0, 0.0, -9.81 / 20.5)).norm() < 1e-3, "{v}");
    let slow = drop(0.0, wind);
    assert!((slow.x - 8.0 * (1.0 - (-0.5_f32).exp())).abs() < 1e-4, "{slow}");
    // Two winds are one; half a wind moves the air half as fast.
    assert!((drop(20.0, &format!("{wind};{wind}")).x - 8.0).abs() < 1e-3);
    let half = drop(20.0, &format!("strength_keyframes = [{{ frame = 0, factor = 0.5 }}]\n{wind}"));
    assert!((half.x - (20.0 * 4.0 + 0.25 * 8.0) / 20.25).abs() < 1e-3, "{half}");
    let pushed = drop(0.0, "kind = { uniform = { acceleration = [3, 0, 0] } }");
    assert!((pushed - Vec3::new(3.0, 0.0, -9.81)).norm() < 1e-4, "{pushed}");
    let far = drop(20.0, &format!("shape = {{ sphere = {{ center = [0, 0, 0], radius = 1 }} }}\n{wind}"));
    let sheets = drop(20.0, &format!("systems = ['sheets']\n{wind}"));
    assert!(far.x == 0.0 && sheets.x == 0.0, "{far} {sheets}");
    let still = Vec3::new(0.01, 0.02, 0.43);
    let foam = under_forces(still, Kind::Foam, Vec3::zeros(), |_| {}, wind);
    assert!(foam.v.x.abs() < 1e-3, "foam moves with the liquid: {}", foam.v);
}

#[test]
fn lives_end_after_the_lifetime_of_each_kind() {
    let short = |params: &mut WhitewaterParams| params.bubbles.lifetime = 3.0;
    let bubble = after_a_second(Vec3::zeros(), Kind::Bubble, Vec3::zeros(), short);
    assert!((bubble.life - (1.0 - 1.0 / 3.0)).abs() < 1e-4, "{}", bubble.life);
}

#[test]
fn a_stored_state_comes_back_and_a_crafted_one_is_refused() {
    let particle = |id: u32, kind: Kind| Particle {
        x: Vec3::new(1.0, 2.0, id as f32),
        v: Vec3::new(0.5, 0.0, -1.0),
        id,
        kind,
        age: 0.25,
        life: 0.75,
        radius: 0.002,
        threshold: 0.5,
    };
    let mut state = Whitewater { emitted: 17, ..Whitewater::default() };
    state.particles = Kind::ALL.iter().enumerate().map(|(i, &kind)| particle(i as u32, kind)).collect();
    state.record.expired = 5;
    state.record.kinds = [1, 1, 1];
    let stored = state.stream(SPACING);
    assert_eq!(Whitewater::restore(&stored), Some(state));
    let scalar = |name: &str, value: f64| {
        let mut crafted = stored.clone();
        crafted.scalars.iter_mut().find(|(known, _)| known == name).unwrap().1 = value;
        crafted
    };
    for value in [-1.0, 0.5, f64::NAN, f64::INFINITY, 1e300] {
        for name in ["emitted", "expired", "foam"] {
            assert_eq!(Whitewater::restore(&scalar(name, value)), None, "{name} = {value}");
        }
    }
    let without = |name: &str| {
        let bare = Stream::new(stored.name.clone(), stored.kind, stored.len());
        let kept = stored.channels().iter().filter(|channel| channel.name != name);
        let mut crafted =
            kept.fold(bare, |stream, channel| stream.with(&*channel.name, channel.data.clone()));
        crafted.scalars.clone_from(&stored.scalars);
        crafted
    };
    let column = |name: &str, value: f32| without(name).with(name, vec![value; 3]);
    for (name, value) in [("radius", 0.0), ("radius", -1.0), ("life", f32::NAN), ("age", f32::INFINITY)] {
        assert_eq!(Whitewater::restore(&column(name, value)), None, "{name} = {value}");
    }
    assert_eq!(Whitewater::restore(&without("kind")), None, "without kinds");
    let unknown = without("kind").with("kind", vec![0_u32, 3, 1]);
    assert_eq!(Whitewater::restore(&unknown), None, "a kind that is not known");
}
