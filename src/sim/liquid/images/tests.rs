use super::*;
use crate::{
    sim::liquid::{
        Constraint, Kernel,
        rigid::RigidSide,
        rigid_pairs::NO_PAIR,
        rigid_pressure::BODY_SKIN,
        setup::{LIST_SKIN, SolverSetup},
        solve::{Pin, Solver},
        walls::{Mirror, Walls},
    },
    simd::tests::in_both_forms,
    solid::{Pose, Shape, Solid, sampled_mesh},
};

const SPACING: f32 = 0.02;

/// A solver whose lists are those of `p`, and a rigid body at `pose`.
fn at_body(shape: Shape, pose: Pose, kernel: Kernel, p: Vec<Vec3>) -> (Solver, Walls, RestState) {
    at_solids((&[shape], 1.0), pose, &[], kernel, p)
}

/// As [`at_body`] with several bodies of this density over that of the liquid, and colliders.
fn at_solids(
    (shapes, density): (&[Shape], f64),
    pose: Pose,
    colliders: &[Solid],
    kernel: Kernel,
    p: Vec<Vec3>,
) -> (Solver, Walls, RestState) {
    let rest = RestState::new(kernel, SPACING, 2.5);
    let mut walls = Walls::new(colliders, &rest);
    let bodies: Vec<Solid> = shapes.iter().cloned().map(Solid::fixed).collect();
    walls.add_rigid_bodies(&bodies, |_| density);
    walls.set_rigid_bodies(shapes.iter().map(|_| [pose, pose]));
    let mut solver = Solver::default();
    solver.p = p;
    solver.find_cells(&rest).expect("no crowd");
    let setup = SolverSetup { rest: &rest, walls: &walls, constraint: Constraint::Equality, softening: 0.0 };
    solver.build_lists(&setup);
    solver.sample_rigid_pairs(&setup);
    (solver, walls, rest)
}

fn at(position: Vec3) -> Pose {
    Pose { position, ..Pose::identity() }
}

fn cuboid(half: f32) -> Shape {
    Shape::Box { min: [-half; 3], max: [half; 3] }
}

/// Particles on a cubic lattice above z = 0, the first layer at half a spacing from it.
fn layers() -> Vec<Vec3> {
    let place = |k: u32| Vec3::new((k % 9) as f32 - 4.0, (k / 9 % 9) as f32 - 4.0, (k / 81) as f32 + 0.5);
    (0..729).map(|k| place(k) * SPACING).collect()
}

#[test]
fn the_density_at_a_flat_face_is_that_inside_the_liquid() {
    for kernel in [Kernel::Wendland, Kernel::Poly6Spiky] {
        let half = 0.5;
        let (mut solver, walls, rest) = at_body(cuboid(half), at(Vec3::z() * -half), kernel, layers());
        let setup =
            SolverSetup { rest: &rest, walls: &walls, constraint: Constraint::Equality, softening: 0.0 };
        solver.measure(&setup);
        for layer in 0..3 {
            let ratio = solver.ratio[4 + 9 * 4 + 81 * layer];
            assert!((ratio - 1.0).abs() < 1e-3, "{kernel:?}, layer {layer}: {ratio}");
        }
    }
}

/// The displacements of particles by their images, with these λ.
fn pushes(solver: &mut Solver, rest: &RestState, lambda: impl Fn(u32) -> f32 + Sync) -> Vec<ImagePush> {
    let RigidSide { pairs, samples, images: lists, image_nodes: nodes, .. } = &mut solver.rigid;
    nodes.set_lambda(pairs, lambda);
    Images { rest, pairs, lists, nodes }.find_pushes(samples);
    samples.iter().map(|sample| sample.push).collect()
}

/// Sum over the particles of λ_i times the density of their images.
fn weighted_density(solver: &Solver, lambda: impl Fn(u32) -> f32) -> f64 {
    let all = solver.rigid.pairs.iter().zip(&solver.rigid.samples);
    all.map(|(pair, sample)| f64::from(lambda(pair.particle) * sample.image.density)).sum()
}

/// A number from −0.5 to 0.5 for each `k`.
fn noise(k: u32) -> f32 {
    (k.wrapping_mul(2_654_435_761) >> 16) as f32 / 65536.0 - 0.5
}

/// Disordered particles around a shape.
fn cloud_around(shape: &Shape) -> Vec<Vec3> {
    let place = |k: u32| {
        let cell = Vec3::new((k % 11) as f32, (k / 11 % 11) as f32, (k / 121) as f32);
        let shift = Vec3::new(noise(3 * k), noise(3 * k + 1), noise(3 * k + 2)) * 0.4;
        (cell - Vec3::repeat(5.0) + shift) * SPACING
    };
    (0..1331).map(place).filter(|x| shape.signed_distance(*x) > 0.3 * SPACING).collect()
}

#[test]
fn densities_at_edges_do_not_depend_on_rounding() {
    let (shape, kernel) = (cuboid(0.05), Kernel::Wendland);
    let cloud = cloud_around(&shape);
    let turned = |angle: f32| -> Vec<f32> {
        let rotation = *nalgebra::Rotation3::from_euler_angles(angle, 2.0 * angle, 3.0 * angle).matrix();
        let pose = Pose { rotation, ..Pose::identity() };
        let p = cloud.iter().map(|x| pose.to_world(*x)).collect();
        at_body(shape.clone(), pose, kernel, p).0.rigid.samples.iter().map(|s| s.image.density).collect()
    };
    let expected = turned(0.0);
    for angle in [0.1, 0.2, 0.3, 0.4] {
        for (density, expected) in turned(angle).iter().zip(&expected) {
            assert!((density - expected).abs() < 1e-3, "{density} turned by {angle}, {expected} else");
        }
    }
}

#[test]
fn lists_hold_every_image_until_particles_or_bodies_have_moved_by_their_skins() {
    let torus = Shape::Torus { center: [0.0; 3], axis: [0.0, 0.0, 1.0], radius: 0.06, tube: 0.03 };
    let mesh = sampled_mesh(0.02, |x| x.abs().amax() - 0.05);
    for shape in [cuboid(0.05), Shape::Sphere { center: [0.0; 3], radius: 0.06 }, torus, mesh] {
        let cloud = cloud_around(&shape);
        let (mut solver, mut walls, rest) =
            at_body(shape.clone(), Pose::identity(), Kernel::Wendland, cloud.clone());
        let skin = LIST_SKIN * rest.support;
        // Each particle towards the body, which comes towards those on one side.
        let place = |x: &Vec3| x - x.normalize() * (0.499 * skin);
        let pose = at(Vec3::new(1.0, 1.0, 0.0).normalize() * (0.999 * BODY_SKIN * skin));
        let moved: Vec<Vec3> = cloud.iter().map(place).collect();
        solver.p.clone_from(&moved);
        walls.set_rigid_bodies([[pose, pose]].into_iter());
        let setup =
            SolverSetup { rest: &rest, walls: &walls, constraint: Constraint::Equality, softening: 0.0 };
        solver.sample_rigid_pairs(&setup);
        let by_particle = |solver: &Solver| {
            let mut densities = vec![(0.0, false); cloud.len()];
            for (pair, sample) in solver.rigid.pairs.iter().zip(&solver.rigid.samples) {
                densities[pair.particle as usize] = (sample.image.density, pair.is_active);
            }
            densities
        };
        let found = by_particle(&solver);
        let expected = by_particle(&at_body(shape.clone(), pose, Kernel::Wendland, moved).0);
        for (i, ((found, is_active), (expected, is_needed))) in found.iter().zip(&expected).enumerate() {
            // At the edges of a box its density, a product of slabs, reaches beyond the support.
            let bound = if *is_active && *is_needed { 1e-6 } else { 5e-5 };
            assert!((found - expected).abs() < bound, "{shape:?}, particle {i}: {found}, not {expected}");
        }
        let active = solver.rigid.pairs.iter().filter(|pair| pair.is_active).count();
        let all = solver.rigid.pairs.len();
        println!("{active} of {all} pairs are active");
        let is_mesh = matches!(shape, Shape::Mesh(_));
        assert!(if is_mesh { active == all } else { 10 * active < 9 * all }, "{shape:?}: {active} of {all}");
        // Most neighbours have no image as near.
        let listed: usize =
            (0..solver.rigid.pairs.len()).map(|k| solver.rigid.images.place_of(k).1.len()).sum();
        let neighbours: usize =
            solver.rigid.pairs.iter().map(|pair| solver.lists.of(pair.particle as usize).len()).sum();
        println!("{listed} of {neighbours}, {} pairs", solver.rigid.pairs.len());
        assert!(2 * listed < neighbours, "{shape:?}: {listed} of {neighbours}");
    }
}

/// Shapes of bodies, and a floor and a post close to them.
fn shapes_and_colliders() -> ([Shape; 4], [Solid; 2]) {
    let plate = Shape::Box { min: [-0.07, -0.07, -0.002], max: [0.07, 0.07, 0.002] };
    let mesh = sampled_mesh(0.02, |x| x.abs().amax() - 0.05);
    let shapes = [cuboid(0.05), Shape::Sphere { center: [0.0; 3], radius: 0.06 }, plate, mesh];
    let floor = Shape::Plane { point: [0.0, 0.0, -0.09], normal: [0.0, 0.0, 1.0] };
    let post = Shape::Box { min: [0.08, -0.1, -0.1], max: [0.083, 0.1, 0.1] };
    (shapes, [floor, post].map(Solid::fixed))
}

#[test]
fn moves_that_exclude_contact_end_where_they_lead() {
    let (shapes, colliders) = shapes_and_colliders();
    for (shape, density) in shapes.into_iter().flat_map(|shape| [(shape.clone(), 1.0), (shape, 0.04)]) {
        let all = cloud_around(&shape);
        let built_at: Vec<Vec3> =
            all.into_iter().filter(|x| x.z > -0.08 && (x.x < 0.07 || x.x > 0.093)).collect();
        let post = Shape::Box { min: [-0.1, 0.075, -0.1], max: [0.1, 0.08, 0.1] };
        let bodies = [shape.clone(), post];
        let (mut solver, mut walls, rest) =
            at_solids((&bodies, density), Pose::identity(), &colliders, Kernel::Wendland, built_at.clone());
        // As far as neither lists nor pairs are stale.
        let skin = LIST_SKIN * rest.support;
        let pose = at(Vec3::new(0.6, -0.6, 0.5).normalize() * (0.999 * BODY_SKIN * skin));
        walls.set_rigid_bodies(bodies.iter().map(|_| [pose, pose]));
        let shift = |k: u32| Vec3::new(noise(7 * k), noise(7 * k + 1), noise(7 * k + 2)).normalize();
        let cloud: Vec<Vec3> = (0..).zip(&built_at).map(|(k, x)| x + shift(k) * (0.499 * skin)).collect();
        solver.p.clone_from(&cloud);
        let setup =
            SolverSetup { rest: &rest, walls: &walls, constraint: Constraint::Equality, softening: 0.0 };
        solver.sample_rigid_pairs(&setup);
        let (samples, _) = solver.rigid.samples_and_projection();
        let (mut clear, mut near, mut touching) = (0, 0, 0);
        for (k, &from) in (0..).zip(&cloud) {
            // Those in contact are moved by any correction.
            if (walls.collide(from, from).0 - from).norm() > 0.0 {
                continue;
            }
            for length in [0.0, 0.02, 0.2, 0.5] {
                let i = k as usize;
                let direction = Vec3::new(noise(5 * k + 1), noise(5 * k + 2), noise(5 * k + 3)).normalize();
                let delta = direction * (length * SPACING);
                let to = from + delta;
                let (free, _) = walls.collide(from, to);
                let is_free = (free - to).norm() < 1e-6;
                let displacement2 = (to - built_at[i]).norm_squared();
                let is_clear = samples.excludes_contact(i, &setup, delta.norm(), displacement2);
                assert!(is_free || !is_clear, "{shape:?}: {from:?} moves by {delta:?} into a solid");
                let (by_pair, _) = samples.collide(i, [from, to], &walls);
                assert!((by_pair - free).norm() < 1e-6, "{shape:?}: {by_pair:?}, {free:?} at all solids");
                if samples.first_pair[i] != NO_PAIR {
                    near += 1;
                    clear += u32::from(is_clear);
                    touching += u32::from(!is_free);
                }
            }
        }
        println!("{clear} of {near} moves are clear, {touching} touch");
        assert!(
            2 * clear > near && touching >= 10,
            "{shape:?}: {clear} of {near} are clear, {touching} touch"
        );
    }
}

#[test]
fn lists_that_are_built_again_in_a_substep_have_the_pairs_and_distances_of_new_ones() {
    let (shapes, colliders) = shapes_and_colliders();
    for shape in shapes {
        let far = |k: u32| Vec3::new((k % 6) as f32 - 15.0, (k / 6 % 6) as f32, (k / 36) as f32) * SPACING;
        let mut cloud = cloud_around(&shape);
        cloud.extend((0..216).map(far));
        let new = |pose: Pose, p: Vec<Vec3>| {
            at_solids((std::slice::from_ref(&shape), 1.0), pose, &colliders, Kernel::Wendland, p)
        };
        let (mut solver, mut walls, rest) = new(Pose::identity(), cloud.clone());
        // One that is near the body.
        let pin = Pin { particle: solver.rigid.pairs[9].particle, target: Vec3::zeros() };
        solver.pins.push(pin);
        solver.free_pins_of_solids();
        let (mut moved, mut bounds) = (cloud.clone(), 0);
        for step in 1..4 {
            // Beyond the skins of both.
            for (k, x) in (0..).zip(&mut moved) {
                let sign = if step == 2 { -1.0 } else { 1.0 };
                let to = Vec3::new(0.2 + noise(5 * k + 1), noise(5 * k + 2), noise(5 * k + 3));
                *x += to * (0.25 * sign * SPACING);
            }
            let pose = at(Vec3::new(-0.2, 0.05, 0.1) * (step as f32 * SPACING));
            walls.set_rigid_bodies([[pose, pose]].into_iter());
            let setup =
                SolverSetup { rest: &rest, walls: &walls, constraint: Constraint::Equality, softening: 0.0 };
            solver.p.clone_from(&moved);
            solver.stale = true;
            solver.ensure_lists(&setup).expect("no crowd");
            let mut expected = new(pose, moved.clone()).0;
            expected.pins.clone_from(&solver.pins);
            expected.free_pins_of_solids();
            let pairs = |solver: &Solver| -> Vec<(u32, bool)> {
                solver.rigid.pairs.iter().map(|pair| (pair.particle, pair.is_active)).collect()
            };
            assert_eq!(pairs(&solver), pairs(&expected), "{shape:?}");
            let reach = setup.boundary_reach();
            for (i, (found, expected)) in solver.clearance.iter().zip(&expected.clearance).enumerate() {
                // Bodies that are farther may be left out.
                let [found, expected] = [found, expected].map(|distance| distance.min(walls.near_reach()));
                let is_bound = expected > reach && found > reach && found <= expected;
                bounds += u32::from(is_bound && found < expected);
                assert!(found == expected || is_bound, "{shape:?}, particle {i}: {found}, not {expected}");
            }
        }
        assert!(bounds > 100, "{shape:?}: {bounds} distances follow from those before");
        // Particles have other indices: the pinned one's belongs to one that is not pinned.
        solver.pins.clear();
        solver.p.clone_from(&moved);
        solver.mark_as_stale();
        let pose = Pose::identity();
        walls.set_rigid_bodies([[pose, pose]].into_iter());
        let setup =
            SolverSetup { rest: &rest, walls: &walls, constraint: Constraint::Equality, softening: 0.0 };
        solver.ensure_lists(&setup).expect("no crowd");
        let first = pin.particle as usize;
        assert_eq!(solver.clearance[first], new(pose, moved).0.clearance[first], "{shape:?}");
    }
}

/// The sums of pair `k` over its list, one image at a time.
fn one_by_one(
    solver: &Solver,
    rest: &RestState,
    k: usize,
    lambda: fn(u32) -> f32,
) -> (ImageDensity, ImagePush) {
    let RigidSide { pairs, images, image_nodes: nodes, .. } = &solver.rigid;
    let own = &pairs[k];
    let (m, change) = (&own.mirror, lambda(own.particle));
    let mut sum = Images { rest, pairs, lists: images, nodes }.own_density(k);
    let mut push = ImagePush { by_body: sum.gradient * change, ..ImagePush::default() };
    let (list, range) = images.place_of(k);
    for other in list.as_slice()[range].iter().map(|&other| &pairs[other as usize]) {
        let (n, both) = (&other.mirror, change + lambda(other.particle));
        let offset = (own.x - other.x) * rest.inv_support;
        let r2 = offset.norm_squared();
        let q2 = r2 + 4.0 * m.distance * n.distance;
        if m.normal.dot(&n.normal) < OPPOSITE || q2 >= 1.0 {
            continue;
        }
        let (w, s) = kernel_and_slope(rest.kernel, q2);
        let w = w * rest.density_scale;
        let s = s * rest.gradient_scale * m.weight * n.weight;
        let real = if r2 < 1.0 { kernel_and_slope(rest.kernel, r2).1 * rest.gradient_scale } else { 0.0 };
        let of_own = m.slope * (n.weight * w) - m.normal * (2.0 * n.distance * s);
        let of_other = n.slope * (m.weight * w) - n.normal * (2.0 * m.distance * s);
        let by_image = of_other + offset * s;
        sum.density += m.weight * n.weight * w;
        sum.gradient += of_own - offset * s;
        sum.others2 += by_image.dot(&(by_image + offset * (2.0 * real)));
        sum.of_body[0] += of_own + of_other;
        sum.of_body[1] -= (offset * rest.support).cross(&of_other);
        push.by_neighbours -= offset * (s * both);
        push.by_body += of_own * both;
    }
    (sum, push)
}

#[test]
fn sums_over_eight_images_are_those_over_single_ones_in_both_forms_of_lanes() {
    let lambda = |i: u32| if i.is_multiple_of(5) { 0.0 } else { 1.0 + noise(7 * i) };
    let plate = Shape::Box { min: [-0.07, -0.07, -0.01], max: [0.07, 0.07, 0.01] };
    let numbers = |density: &ImageDensity, push: &ImagePush| -> Vec<f32> {
        let ImageDensity { density, gradient, others2, of_body: [force, moment] } = *density;
        let vectors = [gradient, force, moment, push.by_neighbours, push.by_body];
        [density, others2].into_iter().chain(vectors.iter().flat_map(|v| [v.x, v.y, v.z])).collect()
    };
    let (mut lengths, mut opposite) = (std::collections::BTreeSet::new(), 0);
    for (shape, kernel) in [
        (cuboid(0.05), Kernel::Wendland),
        (Shape::Sphere { center: [0.0; 3], radius: 0.06 }, Kernel::Poly6Spiky),
        (plate, Kernel::Wendland),
    ] {
        let [scalar, fastest] = in_both_forms(|| {
            let (mut solver, _, rest) =
                at_body(shape.clone(), Pose::identity(), kernel, cloud_around(&shape));
            let pushes = pushes(&mut solver, &rest, lambda);
            let found: Vec<Vec<f32>> = solver
                .rigid
                .samples
                .iter()
                .zip(&pushes)
                .map(|(own, push)| numbers(&own.image, push))
                .collect();
            (solver, rest, found)
        });
        assert_eq!(scalar.2, fastest.2, "{shape:?}");
        let (solver, rest, found) = scalar;
        let pairs = &solver.rigid.pairs;
        let expected: Vec<Vec<f32>> = (0..pairs.len())
            .map(|k| one_by_one(&solver, &rest, k, lambda))
            .map(|(density, push)| numbers(&density, &push))
            .collect();
        for quantity in 0..expected[0].len() {
            let size = expected.iter().map(|row| row[quantity].abs()).fold(0.0, f32::max);
            assert!(size > 0.0, "{shape:?}, {quantity}: nothing to compare");
            for (k, (found, expected)) in found.iter().zip(&expected).enumerate() {
                let (found, expected) = (found[quantity], expected[quantity]);
                assert!(
                    (found - expected).abs() < 1e-5 * size,
                    "{shape:?}, pair {k}, {quantity}: {found}, not {expected}"
                );
            }
        }
        for (k, pair) in pairs.iter().enumerate() {
            let (list, range) = solver.rigid.images.place_of(k);
            lengths.insert(range.len());
            let normal = |&other: &u32| pairs[other as usize].mirror.normal.dot(&pair.mirror.normal);
            opposite += list.as_slice()[range].iter().filter(|other| normal(other) < OPPOSITE).count();
        }
    }
    assert!([0, 1, 7, 8, 9].iter().all(|length| lengths.contains(length)), "{lengths:?}");
    assert!(opposite > 100, "{opposite} images on the opposite side");
}

#[test]
fn gaps_between_a_body_and_its_first_layer_are_no_surface_of_air() {
    let pair = |distance: f32| RigidPair {
        mirror: Mirror { distance, normal: Vec3::z(), ..Mirror::default() },
        ..RigidPair::default()
    };
    let gradient = Vec3::new(3.0, 4.0, -5.0);
    let left = |pairs: &[RigidPair], first_pair: &[u32]| {
        BodySamples { first_pair, pairs, samples: &[] }.without_gaps(0, gradient)
    };
    for (distance, part) in [(0.0, 0.0), (0.25, 0.0), (0.4, 0.6), (0.5, 1.0), (0.9, 1.0)] {
        let found = left(&[pair(distance)], &[0]);
        let expected = Vec3::new(3.0, 4.0, -5.0 * part);
        assert!((found - expected).norm() < 1e-5, "{distance}: {found:?}");
    }
    assert_eq!(left(&[pair(0.1)], &[NO_PAIR]), gradient, "of another particle");
    let other =
        RigidPair { mirror: Mirror { normal: Vec3::x(), ..Mirror::default() }, ..RigidPair::default() };
    assert_eq!(left(&[pair(0.1), other], &[0]), Vec3::new(0.0, 4.0, 0.0), "in a wedge of two bodies");
}

#[test]
fn pushes_are_the_gradients_of_the_density_and_bodies_take_up_the_rest() {
    let lambda = |i: u32| 1.0 + noise(7 * i);
    for shape in [cuboid(0.05), Shape::Sphere { center: [0.0; 3], radius: 0.06 }] {
        let cloud = cloud_around(&shape);
        let (mut solver, _, rest) = at_body(shape.clone(), Pose::identity(), Kernel::Wendland, cloud.clone());
        let pushes = pushes(&mut solver, &rest, lambda);
        let pairs = &solver.rigid.pairs;
        let size = pushes.iter().map(|push| push.by_body.norm()).fold(0.0, f32::max);
        let step = 2e-3 * SPACING;
        for k in (0..pushes.len()).step_by(pushes.len() / 12) {
            let i = pairs[k].particle as usize;
            for axis in 0..3 {
                let moved = |by: f32| {
                    let mut p = cloud.clone();
                    p[i][axis] += by;
                    let solver = at_body(shape.clone(), Pose::identity(), Kernel::Wendland, p).0;
                    weighted_density(&solver, lambda)
                };
                let slope = (moved(step) - moved(-step)) / f64::from(2.0 * step);
                let push = (pushes[k].by_neighbours + pushes[k].by_body)[axis];
                assert!(
                    (slope - f64::from(push)).abs() < 0.01 * f64::from(size),
                    "{shape:?} {i}: {slope}, {push}"
                );
            }
        }
        // Neighbours exchange momentum, and the body takes up what changes the density as it moves.
        let sum = |part: fn(&ImagePush) -> Vec3| pushes.iter().map(part).sum::<Vec3>();
        assert!(sum(|push| push.by_neighbours).norm() < 1e-4 * size * pushes.len() as f32);
        let at_pairs = || pairs.iter().zip(&solver.rigid.samples);
        let of_body =
            at_pairs().map(|(pair, own)| own.image.of_body[0] * lambda(pair.particle)).sum::<Vec3>();
        assert!((of_body - sum(|push| push.by_body)).norm() < 1e-4 * size * pushes.len() as f32);
        let moment = |(pair, own): (&RigidPair, &PairSample)| {
            (pair.x.cross(&own.image.of_body[0]) + own.image.of_body[1]) * lambda(pair.particle)
        };
        let of_body_moment = at_pairs().map(moment).sum::<Vec3>();
        let moments = pairs.iter().zip(&pushes).map(|(pair, push)| pair.x.cross(&push.by_body)).sum::<Vec3>();
        assert!(
            (of_body_moment - moments).norm() < 1e-5 * size * pushes.len() as f32,
            "{of_body_moment}, {moments}"
        );
        let at = |x: f32| {
            let solver = at_body(shape.clone(), at(Vec3::x() * x), Kernel::Wendland, cloud.clone()).0;
            weighted_density(&solver, lambda)
        };
        let slope = (at(-step) - at(step)) / f64::from(2.0 * step);
        let taken = f64::from(of_body.x);
        assert!(
            (slope - taken).abs() < 0.01 * f64::from(size) * (pushes.len() as f64).sqrt(),
            "{slope}, {taken}"
        );
    }
}
