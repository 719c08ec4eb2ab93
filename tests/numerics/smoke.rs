//! Smoke: what pushes it, what it flows around, and what it must not be upset by.

use meniscus::{
    frame::{Frame, FrameIndex},
    math::Vec3,
    scene::{Overrides, Quality, Scene, load},
    sim::vortex::{Kernel, Method, Quantity, Targets, Vortons, flow::Sum, induced},
    sim::{
        FrameRecord, SetupError, Simulation, Stop, Systems, Unwatched, World,
        smoke::{FrameAir, Smoke, SmokeRecord, TRACERS},
    },
    solid::{Interpolation, Keyframe, Motion, Shape, Solid},
};

fn smoke(text: &str) -> Systems {
    let params = crate::from_toml(text);
    Systems { smoke: Some(Smoke { params, fps: 24.0, first: 1 }), ..Systems::default() }
}

fn world(gravity: [f32; 3], shapes: Vec<Shape>) -> World {
    World { gravity: gravity.into(), solids: shapes.into_iter().map(Solid::fixed).collect() }
}

const DOWN: [f32; 3] = [0.0, 0.0, -9.81];

/// Advances by frames of 1/24 s and returns their records.
fn advance(simulation: &mut Simulation, frames: u32) -> Vec<SmokeRecord> {
    let record = |record: FrameRecord| record.smoke.expect("there is smoke");
    (0..frames).map(|_| record(simulation.advance(1.0 / 24.0, &mut Unwatched).unwrap())).collect()
}

fn tracers(simulation: &Simulation) -> Frame {
    simulation.frame(FrameIndex(1))
}

fn mean(simulation: &Simulation) -> Vec3 {
    let frame = tracers(simulation);
    let x = frame.stream(TRACERS).unwrap().vec3("position").unwrap();
    x.iter().sum::<Vec3>() / x.len() as f32
}

/// A ball of smoke.
fn blob(more: &str, temperature: f32, density: f32) -> Systems {
    smoke(&format!(
        "spacing = 0.08\n{more}\n[[source]]\nshape = {{ sphere = {{ center = [0, 0, 0], radius = 0.25 }} }}\n\
         temperature = {temperature:e}\ndensity = {density}"
    ))
}

#[test]
fn hot_smoke_rises_heavy_smoke_sinks_and_either_follows_gravity() {
    let shift = |gravity: [f32; 3], temperature: f32, weight: f32| {
        let more = format!("[buoyancy]\nweight = {weight}");
        let mut simulation = Simulation::new(world(gravity, vec![]), blob(&more, temperature, 1.0)).unwrap();
        let start = mean(&simulation);
        advance(&mut simulation, 8);
        mean(&simulation) - start
    };
    let hot = shift(DOWN, 200.0, 0.0);
    // A ball of smoke of weight ρ in air of ρ₀ begins with an acceleration of 2 (ρ₀ − ρ)/(2 ρ + ρ₀) g if it were solid; here
    // the air inside turns with it, and the grid blurs its edge.
    let fall = 0.5 * 9.81 * (8.0_f32 / 24.0).powi(2);
    assert!((0.1 * fall..0.7 * fall).contains(&hot.z) && hot.xy().norm() < 0.02, "{hot} of {fall}");
    assert!(shift(DOWN, -100.0, 0.0).z < -0.02, "cold smoke sinks");
    assert!(shift(DOWN, 0.0, 0.5).z < -0.02, "heavy smoke sinks");
    let side = shift([-9.81, 0.0, 0.0], 200.0, 0.0);
    assert!((side.x - hot.z).abs() < 0.02 && side.z.abs() < 0.02, "{side}");
    assert_eq!(shift([0.0; 3], 200.0, 0.5), Vec3::zeros(), "without gravity nothing has weight");
}

#[test]
fn no_heat_and_no_cold_is_infinite() {
    for temperature in [1e30, -293.0, -1e6, 3e38] {
        let mut simulation =
            Simulation::new(world(DOWN, vec![]), blob("[buoyancy]", temperature, 1.0)).unwrap();
        let records = advance(&mut simulation, 2);
        let frame = tracers(&simulation);
        let x = frame.stream(TRACERS).unwrap().vec3("position").unwrap();
        assert!(x.iter().all(|x| x.norm() < 20.0), "{temperature}");
        assert!(records.iter().all(|record| record.account.invariants.energy.is_finite()));
    }
}

#[test]
fn pushes_leave_no_strength_behind_and_their_impulse_is_the_weight_of_the_smoke() {
    let mut simulation = Simulation::new(world(DOWN, vec![]), blob("[buoyancy]", 100.0, 1.0)).unwrap();
    let records = advance(&mut simulation, 4);
    let last = &records[3].account.invariants;
    // ln(ρ/ρ₀) g over the volume and the time.
    let weight = (393.0_f64 / 293.0).ln() * 9.81 * (4.0 / 3.0 * std::f64::consts::PI * 0.25_f64.powi(3));
    let impulse = weight * 4.0 / 24.0;
    assert!((last.impulse[2] / impulse - 1.0).abs() < 0.2, "{} of {impulse}", last.impulse[2]);
    let scale = impulse / 0.25;
    assert!(last.strength.iter().all(|s| s.abs() < 0.01 * scale), "{:?}", last.strength);
    assert!(records[0].made > 0);
}

#[test]
fn wind_goes_around_a_ball_and_not_through_it() {
    let ball = || Shape::Sphere { center: [0.0; 3], radius: 0.3 };
    let spacing = if crate::is_soak() { 0.06 } else { 0.1 };
    let text = |more: &str| {
        format!(
            "spacing = {spacing}\nwind = [1, 0, 0]\n{more}\n[[emitter]]\nrate = 30\n\
             shape = {{ box = {{ min = [-0.9, -0.2, -0.2], max = [-0.8, 0.2, 0.2] }} }}"
        )
    };
    let mut slipping = Simulation::new(world([0.0; 3], vec![ball()]), smoke(&text(""))).unwrap();
    let records = advance(&mut slipping, 36);
    let last = records.last().unwrap();
    assert!(last.through_flow.unwrap() < 0.02 && last.unsolved.unwrap() <= 1e-4, "{last:?}");
    assert_eq!(last.vortons, 0, "nothing is shed");
    let inside = |simulation: &Simulation| {
        let frame = tracers(simulation);
        let x = frame.stream(TRACERS).unwrap().vec3("position").unwrap();
        (x.iter().filter(|x| x.norm() < 0.3).count(), x.iter().map(|x| x.x).fold(f32::MIN, f32::max))
    };
    let (within, farthest) = inside(&slipping);
    assert!(within == 0 && farthest > 0.4, "{within} inside, the first at {farthest}");

    // With shedding there is a wake: swirls behind the ball, which keep the air out as well.
    let mut shedding = Simulation::new(world([0.0; 3], vec![ball()]), smoke(&text("[shedding]"))).unwrap();
    let records = advance(&mut shedding, 12);
    let last = records.last().unwrap();
    assert!(last.vortons > 50 && last.through_flow.unwrap() < 0.1, "{last:?}");
    assert_eq!(inside(&shedding).0, 0);
}

#[test]
fn a_ring_flies_at_the_floor_and_widens() {
    let ring = "spacing = 0.05\n[[ring]]\ncenter = [0, 0, 0.6]\ndirection = [0, 0, -1]\nradius = 0.3\n\
                thickness = 0.05\ncirculation = 1.5";
    let floor = Shape::Plane { point: [0.0; 3], normal: [0.0, 0.0, 1.0] };
    let mut simulation = Simulation::new(world([0.0; 3], vec![floor]), smoke(ring)).unwrap();
    let radius = |simulation: &Simulation| {
        let frame = tracers(simulation);
        let x = frame.stream(TRACERS).unwrap().vec3("position").unwrap();
        let lowest = x.iter().map(|x| x.z).fold(f32::MAX, f32::min);
        (x.iter().map(|x| x.xy().norm()).sum::<f32>() / x.len() as f32, lowest)
    };
    let (before, _) = radius(&simulation);
    advance(&mut simulation, 24);
    let (after, lowest) = radius(&simulation);
    assert!(after > 1.2 * before && lowest > 0.0, "{before} {after} {lowest}");
    assert!(mean(&simulation).z < 0.4);
}

#[test]
fn tracers_emitted_inside_an_obstacle_are_rejected() {
    let text = "spacing = 0.1\n[[emitter]]\nrate = 20\nvelocity = [0, 0, 1]\n\
                shape = { sphere = { center = [0, 0, 0], radius = 0.1 } }";
    let ball = Shape::Sphere { center: [0.0; 3], radius: 0.4 };
    let mut simulation = Simulation::new(world(DOWN, vec![ball]), smoke(text)).unwrap();
    let records = advance(&mut simulation, 3);
    assert!(records.iter().all(|record| record.emitted == 0 && record.vortons == 0 && record.tracers == 0));
    assert!(records.iter().map(|record| record.rejected).sum::<u64>() > 10);
}

#[test]
fn a_state_that_is_not_finite_is_named_and_not_computed() {
    let text = "spacing = 0.1\n[[ring]]\ncenter = [0, 0, 0]\nradius = 0.3\nthickness = 0.05\ncirculation = 1";
    let simulation = Simulation::new(world([0.0; 3], vec![]), smoke(text)).unwrap();
    let mut frame = tracers(&simulation);
    let stream = &frame.streams[0];
    let mut strength = stream.vec3("strength").unwrap().to_vec();
    strength[7].y = f32::NAN;
    let mut spoiled = meniscus::frame::Stream::new(stream.name.clone(), stream.kind, stream.len());
    for channel in stream.channels() {
        let data = if channel.name == "strength" { strength.clone().into() } else { channel.data.clone() };
        spoiled = spoiled.with(channel.name.clone(), data);
    }
    spoiled.scalars = stream.scalars.clone();
    frame.streams[0] = spoiled;
    let mut restored = Simulation::restore(world([0.0; 3], vec![]), smoke(text), &frame).unwrap();
    let stopped = restored.advance(1.0 / 24.0, &mut Unwatched).unwrap_err();
    let Stop::Diverged(diverged) = stopped else { panic!("{stopped}") };
    assert!(diverged.system == "smoke" && diverged.particle == 7 && diverged.what.contains("strength"));

    // A frame that lacks a column is refused.
    frame.streams[0] = meniscus::frame::Stream::new("smoke", meniscus::frame::StreamKind::Vortons, 0);
    let refused = Simulation::restore(world([0.0; 3], vec![]), smoke(text), &frame).unwrap_err();
    assert!(matches!(refused, SetupError::Missing { stream: "smoke", .. }), "{refused}");
}

#[test]
fn turbulence_has_the_requested_speed_and_no_divergence() {
    let text = "spacing = 0.04\n[turbulence]\nscale = 0.5\nstrength = 0.3\nseed = 2\n\
                shape = { box = { min = [0, 0, 0], max = [1.5, 1.2, 1] } }";
    let simulation = Simulation::new(world([0.0; 3], vec![]), smoke(text)).unwrap();
    let frame = tracers(&simulation);
    let stream = frame.stream("smoke").unwrap();
    let (x, strength) = (stream.vec3("position").unwrap(), stream.vec3("strength").unwrap());
    // The strengths of a curl sum to zero, except for the seeding lattice's error at the rim.
    let sum: Vec3 = strength.iter().sum();
    let all: f32 = strength.iter().map(|g| g.norm()).sum();
    assert!(sum.norm() < 2e-2 * all, "{sum} of {all}");
    // ∇·ω by differences on the seeding lattice is small against its parts.
    let at: std::collections::HashMap<[i32; 3], Vec3> =
        x.iter().zip(strength).map(|(x, g)| (x.map(|v| (v / 0.04).round() as i32).into(), *g)).collect();
    let (mut divergence, mut parts) = (0.0, 0.0);
    for node in at.keys() {
        let neighbour = |axis: usize, by: i32| {
            let mut node = *node;
            node[axis] += by;
            at.get(&node).map(|g| g[axis])
        };
        let slope = |axis: usize| Some(neighbour(axis, 1)? - neighbour(axis, -1)?);
        if let (Some(x), Some(y), Some(z)) = (slope(0), slope(1), slope(2)) {
            divergence += (x + y + z).powi(2);
            parts += x * x + y * y + z * z;
        }
    }
    assert!(divergence < 0.02 * parts, "{divergence} of {parts}");
    // The RMS speed of the air over the vortons is the requested one.
    let vortons = vortons(&frame);
    let found =
        induced(&vortons, Targets::Vortons, Quantity::Velocity, Kernel::default(), Method::Direct).unwrap();
    let square: f64 = found.velocity.iter().map(|v| f64::from(v.norm_squared())).sum();
    let speed = (square / vortons.len() as f64).sqrt();
    assert!((speed / 0.3 - 1.0).abs() < 2e-3, "{speed} m/s");
}

fn vortons(frame: &Frame) -> Vortons {
    let stream = frame.stream("smoke").unwrap();
    Vortons {
        position: stream.vec3("position").unwrap().to_vec(),
        strength: stream.vec3("strength").unwrap().to_vec(),
        core: stream.f32("core").unwrap().to_vec(),
    }
}

#[test]
fn vorticity_shed_by_a_ball_has_the_sense_of_its_layer_and_slows_the_wake() {
    let text = "spacing = 0.06\nwind = [1, 0, 0]\n[shedding]\n[[emitter]]\nrate = 1\n\
                shape = { sphere = { center = [-0.9, 0, 0], radius = 0.05 } }";
    let ball = Shape::Sphere { center: [0.0; 3], radius: 0.3 };
    let mut simulation = Simulation::new(world([0.0; 3], vec![ball]), smoke(text)).unwrap();
    let records = advance(&mut simulation, 6);
    // Above the ball the air is faster farther from it: ω_y = ∂u_x/∂z > 0; below it the other way around.
    let vortons = vortons(&tracers(&simulation));
    let (mut above, mut below, mut all) = (0.0, 0.0, 0.0);
    for (x, strength) in vortons.position.iter().zip(&vortons.strength) {
        *if x.z > 0.0 { &mut above } else { &mut below } += strength.y;
        all += strength.norm();
    }
    assert!(above > 0.2 * all && below < -0.2 * all, "{above} {below} of {all}");
    let impulse = records[5].account.invariants.impulse;
    assert!(impulse[0] < 0.0 && impulse[1].hypot(impulse[2]) < 0.1 * -impulse[0], "{impulse:?}");
}

/// A shot of air that blows with `wind` [m/s] at a shape which sheds, with vortons 0.09 m apart.
fn shedding(wind: f32, more: &str, shape: Shape) -> Simulation {
    let text = format!(
        "spacing = 0.09\nwind = [{wind}, 0, 0]\n[shedding]\n{more}\n[flow]\nviscosity = {{ nu = 4e-4, eddies = 0.2 }}\n\
         [flow.remesh]\nspacing = 0.09\n[[emitter]]\nrate = 1\nshape = {{ sphere = {{ center = [-1.2, 0, 0], radius = 0.05 }} }}"
    );
    Simulation::new(world([0.0; 3], vec![shape]), smoke(&text)).unwrap()
}

#[test]
#[ignore = "long: tools/soak/run"]
fn wakes_of_what_is_hardly_resolved_stay_bounded() {
    // At a stagnation point nothing advects vortons away, and nothing slips: their stretching is bounded only because air sticks to the
    // solid. Without, the gradient is 40 /s on the ball after 36 frames, and 80 000 /s on the wire after 6.
    let ball = Shape::Sphere { center: [0.0; 3], radius: 0.2 };
    let wire = Shape::Capsule { from: [0.0, 0.0, -0.5], to: [0.0, 0.0, 0.5], radius: 0.08 };
    for (wind, layer, shape, frames) in
        [(2.0, 1.0, ball, 36), (3.0, 1.0, wire.clone(), 12), (3.0, 0.25, wire, 12)]
    {
        let mut simulation = shedding(wind, &format!("layer = {layer}"), shape);
        for _ in 0..frames {
            let record = advance(&mut simulation, 1).remove(0);
            assert!(
                record.account.invariants.energy < 0.3 * f64::from(wind).powi(2)
                    && record.flow.gradient < 16.0 * wind
                    && record.flow.capped == 0,
                "{wind} {layer}: {record:?}"
            );
        }
    }
}

#[test]
#[ignore = "long: tools/soak/run"]
fn shed_vorticity_sums_to_zero_and_has_the_drag_of_its_body() {
    let block = Shape::Box { min: [-0.22, -0.25, -0.3], max: [0.22, 0.35, 0.3] };
    let mut simulation = shedding(2.0, "", block);
    let records = advance(&mut simulation, 30);
    let size: f32 = vortons(&tracers(&simulation)).strength.iter().map(|strength| strength.norm()).sum();
    let last = &records[29].account.invariants;
    let sum = Vec3::from(last.strength.map(|v| v as f32)).norm();
    assert!(sum < 0.03 * size, "{sum} of {size}");
    // A cube's drag coefficient is 1.05, [hoerner65]; this block is shorter along the wind, and its wake has just begun.
    let lost = records[11].account.invariants.impulse[0] - last.impulse[0];
    let drag = lost / (18.0 / 24.0) / (0.5 * 2.0_f64.powi(2) * 0.36);
    assert!((0.8..1.6).contains(&drag), "{drag}");
}

#[test]
fn a_box_that_stands_on_a_plane_sheds_nothing_into_it() {
    let text = "spacing = 0.09\nwind = [2, 0, 0]\n[shedding]\n[[emitter]]\nrate = 1\n\
                shape = { sphere = { center = [-1.2, 0, 0.3], radius = 0.05 } }";
    let block = Shape::Box { min: [-0.3, -0.3, 0.0], max: [0.3, 0.3, 0.5] };
    let floor = Shape::Plane { point: [0.0; 3], normal: [0.0, 0.0, 1.0] };
    let mut simulation = Simulation::new(world([0.0; 3], vec![block, floor]), smoke(text)).unwrap();
    let records = advance(&mut simulation, 2);
    // In the first step what is below would be put out in the second.
    assert!(records[1].vortons > 100 && records[1].returned_vortons == 0, "{:?}", records[1]);
    assert!(vortons(&tracers(&simulation)).position.iter().all(|x| x.z > 0.0));
}

#[test]
#[ignore = "long: tools/soak/run"]
fn a_ball_that_spins_takes_the_air_along() {
    let key = |frame: u32, angle: f32| Keyframe {
        frame,
        position: [0.0; 3],
        rotation: [0.0, 0.0, angle],
        quaternion: None,
        scale: 1.0,
    };
    // A quarter of a turn every four frames: 9.4 /s.
    let keys: Vec<Keyframe> = (0..7).map(|n| key(4 * n, 90.0 * n as f32)).collect();
    let shape = Shape::Sphere { center: [0.0; 3], radius: 0.4 };
    let motion = Motion::new(&keys, Interpolation::Linear, 24.0, 1);
    let world = World { gravity: Vec3::zeros(), solids: vec![Solid { motion, ..Solid::fixed(shape) }] };
    let text = "spacing = 0.09\n[shedding]\n[flow]\nviscosity = { nu = 4e-4, eddies = 0.2 }\n[flow.remesh]\n\
                spacing = 0.09\n[[source]]\nshape = { sphere = { center = [0, 0, 0], radius = 0.6 } }";
    let mut simulation = Simulation::new(world.clone(), smoke(text)).unwrap();
    let around = |simulation: &Simulation, time: f64, radius: f32| {
        let systems = smoke(text);
        let frame = simulation.frame(FrameIndex(1));
        let air = FrameAir::of(systems.smoke.as_ref().unwrap(), &world, &frame.streams, time).unwrap();
        let angles = (0..16).map(|n| std::f32::consts::TAU * n as f32 / 16.0);
        let places: Vec<[Vec3; 2]> = angles
            .map(|a| [Vec3::new(a.cos(), a.sin(), 0.0) * radius, Vec3::new(-a.sin(), a.cos(), 0.0)])
            .collect();
        let points: Vec<Vec3> = places.iter().map(|[x, _]| *x).collect();
        let found = air.velocity(&points).unwrap();
        found.iter().zip(&places).map(|(v, [_, along])| v.dot(along)).sum::<f32>() / 16.0
    };
    advance(&mut simulation, 4);
    let early = around(&simulation, 4.0 / 24.0, 0.55);
    let records = advance(&mut simulation, 16);
    let late = around(&simulation, 20.0 / 24.0, 0.55);
    // Its surface moves with 3.8 m/s. Far off the air does not know: the vorticity shed is that of the ball's turning, reversed.
    assert!(early > 0.0 && late > early && late < 1.0, "{early} {late}");
    assert!(around(&simulation, 20.0 / 24.0, 1.5).abs() < 0.05);
    let shed = records[15].account.invariants.strength[2];
    let turning = 2.0 * 4.0 / 3.0 * std::f64::consts::PI * 0.4_f64.powi(3) * (3.0 * std::f64::consts::PI);
    assert!((shed / -turning - 1.0).abs() < 0.15, "{shed} for {}", -turning);
}

#[test]
fn a_small_ball_that_flies_fast_does_not_jump_past_smoke() {
    // Through the middle of a small cloud: 2 m in a frame, 20 of its radii.
    let text = "spacing = 0.08\ntracers = 0.25\n[[source]]\n\
                shape = { box = { min = [-0.06, -0.06, -0.06], max = [0.06, 0.06, 0.06] } }";
    let shot = |limit: &str| {
        let key = |frame: u32, x: f32| Keyframe {
            frame,
            position: [x, 0.0, 0.0],
            rotation: [0.0; 3],
            quaternion: None,
            scale: 1.0,
        };
        let motion = Motion::new(&[key(1, -1.0), key(2, 1.0)], Interpolation::Linear, 24.0, 1);
        let shape = Shape::Sphere { center: [0.0; 3], radius: 0.1 };
        let world = World { gravity: Vec3::zeros(), solids: vec![Solid { motion, ..Solid::fixed(shape) }] };
        let mut simulation = Simulation::new(world, smoke(&format!("{limit}{text}"))).unwrap();
        let record = advance(&mut simulation, 1).remove(0);
        let frame = tracers(&simulation);
        let x = frame.stream(TRACERS).unwrap().vec3("position").unwrap();
        (record, x.iter().map(|x| x.x).sum::<f32>() / x.len() as f32)
    };
    let (record, drift) = shot("");
    // A core is 0.12 m, a panel 0.08 m, the ball's radius 0.1 m.
    assert!(record.flow.substeps >= 25 && record.flow.capped == 0, "{:?}", record.flow);
    assert!(record.returned_tracers > 0, "{record:?}");
    // The ball leaves smoke displaced: half its volume by Darwin's drift, 0.1 m over the face of this cloud if all is there.
    assert!((0.03..0.25).contains(&drift), "{drift} m");
    // Steps longer than their limits, when `max_substeps` is too small, are counted.
    let (record, _) = shot("flow.max_substeps = 3\n");
    assert!(record.flow.substeps == 3 && record.flow.capped == 3, "{:?}", record.flow);
}

#[test]
fn a_ring_that_passes_a_ball_keeps_its_energy_over_remeshings_and_the_balls_effect_is_recorded() {
    let ring = "spacing = 0.05\n[[ring]]\ncenter = [0, 0, -0.2]\nradius = 0.3\nthickness = 0.05\n\
                circulation = 1\n[flow.remesh]\nspacing = 0.05\nstrain = 0.5";
    let ball = Shape::Sphere { center: [0.0; 3], radius: 0.16 };
    let mut simulation = Simulation::new(world([0.0; 3], vec![ball]), smoke(ring)).unwrap();
    let (frames, height) = if crate::is_soak() { (10, 0.05) } else { (5, -0.12) };
    let records = advance(&mut simulation, frames);
    let remeshings: u32 = records.iter().map(|record| record.flow.remeshed).sum();
    assert!(mean(&simulation).z > height && remeshings >= frames / 2, "{} {remeshings}", mean(&simulation));
    let energy = |record: &SmokeRecord| record.account.invariants.energy;
    let first = energy(&records[0]);
    let (mut turned, mut reach) = (0.0, 0.0_f64);
    for record in &records {
        assert!((0.6..1.1).contains(&(energy(record) / first)), "{} of {first}", energy(record));
        assert!(record.through_flow.unwrap() < 0.1, "{record:?}");
        if let Some(sum) = &record.flow.remesh {
            assert_eq!((sum.unconverged, sum.wide), (0, 0), "{sum:?}");
            assert!(sum.lost_impulse < 1e-3 * sum.impulse_scale, "{sum:?}");
            (turned, reach) = (turned + sum.impulse_change_at_solids, reach.max(sum.impulse_scale));
        }
    }
    // Without the ball it is rounding.
    assert!((1e-4..0.1).contains(&(turned / reach)), "{turned} of {reach}");
}

#[test]
fn a_tube_that_stands_on_a_plane_keeps_its_circulation_over_remeshings() {
    let tube = "spacing = 0.05\n[[tube]]\nfrom = [0, 0, 0]\nto = [0, 0, 1]\nthickness = 0.1\n\
                circulation = 1\n[flow.remesh]\nspacing = 0.05\nstrain = 0.5";
    let floor = Shape::Plane { point: [0.0; 3], normal: [0.0, 0.0, 1.0] };
    let mut simulation = Simulation::new(world([0.0; 3], vec![floor]), smoke(tube)).unwrap();
    let mut remeshings = 0;
    while remeshings < 5 {
        remeshings += advance(&mut simulation, 1)[0].flow.remeshed;
    }
    // Between the plane and the middle of two nodes ∫ Γ_z dz is the circulation times the height; the upper end is open, and parts. If
    // lines ended at the plane as at a solid, there would be half of it in the lower part.
    let vortons = vortons(&tracers(&simulation));
    for top in [0.225_f32, 0.525] {
        let each = vortons.position.iter().zip(&vortons.strength);
        let found: f64 = each.filter(|(x, _)| x.z < top).map(|(_, g)| f64::from(g.z)).sum();
        assert!((found / f64::from(top) - 1.0).abs() < 0.03, "{found} below {top} m");
    }
}

#[test]
fn the_curl_of_the_vector_potential_is_the_velocity_of_vortons_and_their_images() {
    let ring = "spacing = 0.05\n[[ring]]\ncenter = [0, 0, 0.4]\ndirection = [1, 0, 1]\nradius = 0.3\nthickness = 0.08\ncirculation = 1";
    let floor = Shape::Plane { point: [0.0; 3], normal: [0.0, 0.0, 1.0] };
    for shapes in [vec![], vec![floor]] {
        let (systems, world) = (smoke(ring), world([0.0; 3], shapes));
        let frame = tracers(&Simulation::new(world.clone(), systems.clone()).unwrap());
        let air = FrameAir::of(systems.smoke.as_ref().unwrap(), &world, &frame.streams, 0.0).unwrap();
        let step = 0.01;
        for x in [[0.1, 0.05, 0.3], [-0.2, 0.3, 0.15], [0.4, -0.1, 0.6]].map(Vec3::from) {
            let at: Vec<Vec3> =
                (0..6).map(|n| x + Vec3::ith(n / 2, if n % 2 == 0 { step } else { -step })).collect();
            let a = air.vector_potential(&at).unwrap();
            let slope = |axis: usize, k: usize| (a[2 * axis][k] - a[2 * axis + 1][k]) / (2.0 * step);
            let curl =
                Vec3::new(slope(1, 2) - slope(2, 1), slope(2, 0) - slope(0, 2), slope(0, 1) - slope(1, 0));
            let velocity = air.velocity(&[x]).unwrap()[0];
            assert!((curl - velocity).norm() < 0.02 * velocity.norm(), "{x}: {curl} {velocity}");
        }
    }
}

#[test]
fn a_ring_flies_at_the_speed_of_its_gaussian_core_at_any_spacing() {
    let (radius, thickness, circulation) = (0.4_f64, 0.08_f64, 1.6_f64);
    // [saffman70], and the term of third order of [fukumoto00].
    let speed = circulation / (4.0 * std::f64::consts::PI * radius)
        * ((8.0 * radius / thickness).ln() - 0.558 - 0.918 * (thickness / radius).powi(2));
    let fine = [0.032, 0.022].map(|spacing| (spacing, "winckelmans_leonard")).into_iter();
    let fine = fine.chain(["gaussian", "rosenhead_moore", "ball"].map(|kernel| (0.032, kernel)));
    for (spacing, kernel) in
        [(0.045, "winckelmans_leonard")].into_iter().chain(fine.filter(|_| crate::is_soak()))
    {
        let text = format!(
            "spacing = {spacing}\nflow = {{ kernel = \"{kernel}\", remesh = {{ spacing = {spacing} }} }}\n[[ring]]\ncenter = [0, 0, 0]\n\
             radius = {radius}\nthickness = {thickness}\ncirculation = {circulation}\ndensity = 0"
        );
        let mut simulation = Simulation::new(world([0.0; 3], vec![]), smoke(&text)).unwrap();
        // The centre of the impulse.
        let height = |simulation: &Simulation| {
            let frame = tracers(simulation);
            let vortons = frame.stream("smoke").unwrap();
            let columns = ["position", "strength"].map(|name| vortons.vec3(name).unwrap());
            let impulse = columns[0].iter().zip(columns[1]).map(|(x, g)| x.cross(g).z);
            let moment: f32 = columns[0].iter().zip(impulse.clone()).map(|(x, push)| x.z * push).sum();
            f64::from(moment / impulse.sum::<f32>())
        };
        advance(&mut simulation, 2);
        let before = height(&simulation);
        let frames = if crate::is_soak() { 10 } else { 5 };
        advance(&mut simulation, frames);
        let found = (height(&simulation) - before) / (f64::from(frames) / 24.0);
        println!("{spacing}, {kernel}: {found} of {speed} m/s");
        // The tail of Rosenhead and Moore's kernel has an effect far away.
        let bound = if kernel == "rosenhead_moore" { 0.045 } else { 0.02 };
        assert!((found / speed - 1.0).abs() < bound, "{spacing}, {kernel}: {found} of {speed} m/s");
    }
}

#[test]
fn the_velocity_of_a_rings_vortons_has_the_requested_error() {
    // On rings errors add up that cancel each other in clouds. Here they are 0.39 of the
    // requested error, and 0.99 with a setting of the tree that is relaxed twice as far (`src/sim/vortex/coherence.rs`).
    let set = ["sample_every=1", "flow.kernel=ball", "flow.error=1e-2", "flow.sum=grid"];
    let set = set.map(|set| format!("smoke.{set}")).to_vec();
    let overrides = Overrides { quality: Some(Quality::Draft), set };
    let scene = Scene::from_preset(&load("smoke-ring").unwrap(), &overrides).unwrap();
    let mut simulation = Simulation::new(scene.surroundings(), scene.systems()).unwrap();
    for record in advance(&mut simulation, 2) {
        let account = record.account;
        assert!(account.error.unwrap() < 0.7 * account.tolerance.unwrap(), "{account:?}");
    }
    let mut systems = scene.systems();
    systems.smoke.as_mut().unwrap().params.flow.sum = Sum::Multigrid;
    let refused = Simulation::new(scene.surroundings(), systems).unwrap_err();
    assert!(matches!(refused, SetupError::MultigridKernel), "{refused}");
}
