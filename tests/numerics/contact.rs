//! Fitting of surfaces to solids, and masks of smoothing.

use super::cleanup::{SPACING, particles, smoothed};
use meniscus::{
    control::CancelToken,
    field::Anisotropy,
    frame::Stream,
    math::Vec3,
    mesh::{
        ContactParams, DecimationParams, Mesh, PlacedSolid, SmoothingMask, SmoothingParams, Surface,
        SurfaceParams, reconstruct_at_solids,
    },
    par,
    solid::{Interpolation, Keyframe, Motion, Shape, Solid},
};

fn fitted(stream: &Stream, params: &SurfaceParams, solids: &[Solid], time: f64) -> Surface {
    let solids = PlacedSolid::at(solids, time);
    let found = reconstruct_at_solids(stream, SPACING, params, &solids, &CancelToken::new()).unwrap();
    assert!(found.check.is_sound(), "{:?}", found.check);
    found
}

fn with_contact(contact: ContactParams) -> SurfaceParams {
    SurfaceParams { contact: Some(contact), anisotropy: Some(Anisotropy::default()), ..smoothed() }
}

/// Water 12 by 12 by 6 spacings, at rest in a tank half a spacing off its particles, and 6 spacings deeper than its level.
fn tank() -> (Stream, Solid) {
    let water = particles([6, 6, 3], 0.05, Vec3::zeros(), |_| true);
    let wall = |half: f32| (half + 0.5) * SPACING;
    let (min, max) = ([-wall(6.0), -wall(6.0), -wall(3.0)], [wall(6.0), wall(6.0), wall(9.0)]);
    (water, Solid::fixed(Shape::Tank { min, max }))
}

/// Vertices of the mesh that are within `near` [m] of a shape, and their distances [spacings].
fn distances(mesh: &Mesh, shape: &Shape, near: f32) -> Vec<(usize, f32)> {
    let at = |v: usize| (v, shape.signed_distance(mesh.positions[v]) / SPACING);
    (0..mesh.positions.len()).map(at).filter(|(_, d)| *d < near / SPACING).collect()
}

/// The criterion: mesh and glass meet within a tenth of a voxel, up to the edge of the water.
#[test]
fn water_meets_the_walls_of_a_tank() {
    let (water, tank) = tank();
    let tanks = std::slice::from_ref(&tank);
    let free = fitted(
        &water,
        &SurfaceParams { contact: None, ..with_contact(ContactParams::default()) },
        tanks,
        0.0,
    );
    for gap in [ContactParams::default().gap, 0.0, -0.04] {
        let contact = ContactParams { gap, ..ContactParams::default() };
        let found = fitted(&water, &with_contact(contact), tanks, 0.0);
        let stats = found.stats.contact.unwrap();
        assert!(stats.displaced > 1000 && stats.inside == 0, "{stats:?}");

        // Below the level, everything that faces a wall is at the gap: the edges between walls are chamfers.
        let level = 3.0 * SPACING;
        let mut worst = [0.0_f32; 2];
        for (which, surface) in [&free, &found].into_iter().enumerate() {
            for (v, d) in distances(&surface.mesh, &tank.shape, 0.7 * SPACING) {
                let x = surface.mesh.positions[v];
                let corner = [x.x.abs() / SPACING, x.y.abs() / SPACING, (0.0 - x.z) / SPACING + 3.0];
                let near_corner = corner.iter().filter(|&&c| c > 5.0).count() > 1;
                if x.z < level && !near_corner {
                    worst[which] = worst[which].max((d - gap).abs());
                }
            }
        }
        println!("gap {gap}: {stats:?}, farthest from the gap {worst:?} spacings");
        // 0.1 voxel is 0.05 spacings.
        assert!(worst[0] > 0.1 && worst[1] < 0.01, "{worst:?}");
        let deepest =
            distances(&found.mesh, &tank.shape, SPACING).iter().map(|(_, d)| *d).fold(1.0, f32::min);
        assert!((deepest - gap).abs() < 0.002, "{deepest} for {gap}");

        // The level stays, and the water fills the tank below it.
        let top = |surface: &Surface| surface.mesh.positions.iter().map(|x| x.z).fold(f32::MIN, f32::max);
        assert!((top(&found) - top(&free)).abs() < 1e-6);
        let gained = (found.check.volume - free.check.volume) / free.check.volume;
        println!("volume {} {} {gained}", free.check.volume, found.check.volume);
        assert!((0.0..0.08).contains(&gained), "{gained}");
    }
}

/// A ball that moves through the water: the mesh is fitted where the ball is in the frame.
#[test]
fn water_meets_a_moving_ball_where_it_is() {
    let radius = 4.0 * SPACING;
    let key = |frame: u32, x: f32| Keyframe {
        frame,
        position: [x, 0.0, 0.0],
        rotation: [0.0; 3],
        quaternion: None,
        scale: 1.0,
    };
    let motion = Motion::new(&[key(0, -1.0), key(10, 1.0)], Interpolation::Linear, 10.0, 0);
    let ball = Solid { motion, ..Solid::fixed(Shape::Sphere { center: [0.0; 3], radius }) };
    let at = Vec3::new(0.2, 0.0, 0.0);
    let water =
        particles([9; 3], 0.05, Vec3::zeros(), |x| (x * SPACING - at).norm() > radius + 0.45 * SPACING);
    let contact = ContactParams { gap: 0.05, ..ContactParams::default() };
    let found = fitted(&water, &with_contact(contact), &[ball], 0.6);
    let sphere = Shape::Sphere { center: at.into(), radius };
    let near = distances(&found.mesh, &sphere, SPACING);
    assert!(near.len() > 400, "{}", near.len());
    for (v, d) in near {
        // A tenth of a voxel.
        assert!((d - 0.05).abs() < 0.05, "vertex {v} at {d} spacings");
        let out = (found.mesh.positions[v] - at).normalize();
        assert!(found.mesh.normals[v].dot(&out) < -0.9, "its normal points into the ball");
    }
}

/// What no solid touches keeps its bytes, and so does the surface of a drop on the side away from the wall.
#[test]
fn the_free_surface_stays() {
    let drop = particles([5; 3], 0.1, Vec3::zeros(), |x| x.norm() < 5.0);
    let params = with_contact(ContactParams::default());
    let free = fitted(&drop, &SurfaceParams { contact: None, ..params.clone() }, &[], 0.0);
    let plane = |z: f32| Solid::fixed(Shape::Plane { point: [0.0, 0.0, z], normal: [0.0, 0.0, 1.0] });
    let far = fitted(&drop, &params, &[plane(-7.5 * SPACING)], 0.0);
    assert!(far.mesh == free.mesh && far.stats.contact.unwrap().displaced == 0);
    // Not even the normals, which other passes compute anew.
    let decimation = Some(DecimationParams::default());
    let decimated = SurfaceParams { smoothing: None, decimation, ..params.clone() };
    let [without, with] = [None, params.contact].map(|contact| {
        fitted(&drop, &SurfaceParams { contact, ..decimated.clone() }, &[plane(-7.5 * SPACING)], 0.0)
    });
    assert!(without.mesh == with.mesh);
    let near = fitted(&drop, &params, &[plane(-5.2 * SPACING)], 0.0);
    let stats = near.stats.contact.unwrap();
    assert!(stats.displaced > 50, "{stats:?}");
    for (x, before) in near.mesh.positions.iter().zip(&free.mesh.positions) {
        assert!(x == before || (before.z < 0.0 && x.z <= before.z && x.xy() == before.xy()));
    }
    // A plane that cuts off the lower half of the drop: all of it is displaced out, but for what is too deep.
    let cut = fitted(&drop, &params, &[plane(-3.0 * SPACING)], 0.0);
    assert!(cut.stats.contact.unwrap().inside > 0);
    let cut = fitted(
        &drop,
        &with_contact(ContactParams { reach: 2.0, ..ContactParams::default() }),
        &[plane(-3.0 * SPACING)],
        0.0,
    );
    let lowest = cut.mesh.positions.iter().map(|x| x.z).fold(f32::MAX, f32::min);
    println!("{:?}, lowest {}", cut.stats.contact, lowest / SPACING);
    assert_eq!(cut.stats.contact.unwrap().inside, 0);
}

/// Water in the right angle between two planes, whose particles are more or less off them: its edge is a chamfer, little folds, and
/// nothing is inside of either.
#[test]
fn an_edge_between_two_solids_is_a_chamfer() {
    for (wall, reach) in [(6.5, 0.75), (6.5, 2.0), (6.3, 0.75), (6.1, 0.75), (6.1, 2.0)] {
        let plane = |normal| Shape::Plane { point: [-wall * SPACING, 0.0, -wall * SPACING], normal };
        let planes = [plane([1.0, 0.0, 0.0]), plane([0.0, 0.0, 1.0])];
        let water = particles([6; 3], 0.1, Vec3::zeros(), |_| true);
        let contact = ContactParams { reach, ..ContactParams::default() };
        let found = fitted(&water, &with_contact(contact), &planes.clone().map(Solid::fixed), 0.0);
        let stats = found.stats.contact.unwrap();
        let distance = |plane: &Shape, x: &Vec3| plane.signed_distance(*x) / SPACING;
        let nearest = |x: &Vec3| planes.iter().map(|plane| distance(plane, x)).fold(f32::MAX, f32::min);
        let deepest = found.mesh.positions.iter().map(nearest).fold(f32::MAX, f32::min);
        // The farthest part of the edge from the nearest plane, in the middle of its length.
        let is_at_edge = |x: &&Vec3| {
            x.y.abs() < 4.0 * SPACING && planes.iter().map(|plane| distance(plane, x)).sum::<f32>() < 3.0
        };
        let farthest = found.mesh.positions.iter().filter(is_at_edge).map(nearest).fold(0.0, f32::max);
        println!("{wall} {reach}: {stats:?}, deepest {deepest}, farthest {farthest}");
        let inside = found.mesh.positions.iter().filter(|x| nearest(x) < 0.0).count();
        assert!(stats.displaced > 500 && stats.restored * 50 <= stats.displaced, "{stats:?}");
        // What would fold is where the surface was, which here is inside by up to 0.3 spacings.
        assert!(inside <= stats.restored && (wall < 6.2 || deepest > -0.05), "{inside} {deepest}");
        assert!(farthest < 0.05, "{farthest}");
    }
}

/// Water in a trough of two planes at 130°: what the second displaces into the first is displaced out again.
#[test]
fn no_vertex_is_inside_of_another_solid() {
    let (sin, cos) = 65_f32.to_radians().sin_cos();
    let planes = [-1.0, 1.0].map(|side| Shape::Plane { point: [0.0; 3], normal: [side * cos, 0.0, sin] });
    let depth = |x: Vec3| planes.iter().map(|plane| plane.signed_distance(x)).fold(f32::MAX, f32::min);
    let water = particles([12, 6, 6], 0.05, Vec3::zeros(), |x| depth(x * SPACING) > 0.4 * SPACING);
    let solids = planes.clone().map(Solid::fixed);
    for contact in [ContactParams::default(), ContactParams { reach: 2.0, ..ContactParams::default() }] {
        let found = fitted(&water, &with_contact(contact), &solids, 0.0);
        let stats = found.stats.contact.unwrap();
        let mut depths: Vec<f32> = found.mesh.positions.iter().map(|x| depth(*x) / SPACING).collect();
        depths.sort_unstable_by(f32::total_cmp);
        let inside = depths.iter().filter(|d| **d < 0.0).count();
        println!("{stats:?}: deepest {:?}, {inside} inside", &depths[..3]);
        assert!(stats.displaced > 500 && inside <= stats.restored, "{inside} {stats:?}");
        assert!(depths[0] > -0.1, "{}", depths[0]);
    }
}

/// Triangles that oppose the faces around them.
fn flipped(mesh: &Mesh) -> usize {
    let face = |triangle: &[u32; 3]| {
        let [a, b, c] = triangle.map(|v| mesh.positions[v as usize]);
        (b - a).cross(&(c - a))
    };
    let mut around = vec![Vec3::zeros(); mesh.positions.len()];
    for triangle in &mesh.triangles {
        triangle.iter().for_each(|&v| around[v as usize] += face(triangle));
    }
    let is_flipped = |triangle: &&[u32; 3]| {
        face(triangle).dot(&triangle.iter().map(|&v| around[v as usize]).sum::<Vec3>()) <= 0.0
    };
    mesh.triangles.iter().filter(is_flipped).count()
}

/// Spray in front of a wall: what would fold keeps its place, and is counted.
#[test]
fn triangles_that_would_fold_stay() {
    let mut restored = 0;
    for seed in 0..4 {
        let at = Vec3::new(0.013, 0.027, 0.031) * seed as f32;
        let spray = particles([8, 8, 2], 0.5, at, |x| {
            let hash = (x.x * 12.9898 + x.y * 78.233 + x.z * 37.719 + seed as f32).sin() * 43758.547;
            hash - hash.floor() < 0.55
        });
        let plane = Shape::Plane { point: [0.0, 0.0, -2.4 * SPACING], normal: [0.0, 0.0, 1.0] };
        let solids = [Solid::fixed(plane)];
        let params = with_contact(ContactParams { reach: 1.5, ..ContactParams::default() });
        let found = fitted(&spray, &params, &solids, 0.0);
        let free = fitted(&spray, &SurfaceParams { contact: None, ..params }, &[], 0.0);
        let stats = found.stats.contact.unwrap();
        restored += stats.restored;
        let [before, after] = [&free.mesh, &found.mesh].map(flipped);
        println!("{seed}: {stats:?}, {before} and {after} flipped");
        assert!(after <= before, "{after} triangles are flipped, {before} were");
    }
    assert!(restored > 0, "the case shows nothing");
}

/// Unsmoothed, decimated, on any number of threads, and far from the origin.
#[test]
fn surfaces_are_fitted_whatever_their_clean_up() {
    let (water, tank) = tank();
    let tanks = std::slice::from_ref(&tank);
    let plain = SurfaceParams { smoothing: None, ..with_contact(ContactParams::default()) };
    let decimation = Some(DecimationParams::default());
    for params in [plain.clone(), SurfaceParams { decimation, ..with_contact(ContactParams::default()) }] {
        let found = fitted(&water, &params, tanks, 0.0);
        let at_walls = distances(&found.mesh, &tank.shape, 0.03 * SPACING);
        assert!(at_walls.len() > 300, "{}", at_walls.len());
        for &threads in crate::thread_counts() {
            let again = par::with_threads(threads, || fitted(&water, &params, tanks, 0.0));
            assert!(again.mesh == found.mesh && again.stats.contact == found.stats.contact);
        }
    }

    // 8 km off, numbers of single precision are half a millimetre apart.
    let far = Vec3::new(8192.0, 0.0, 0.0);
    let moved: Vec<Vec3> = water.vec3("position").unwrap().iter().map(|x| x + far).collect();
    let water = Stream::new("liquid", water.kind, moved.len()).with("position", moved);
    let Shape::Tank { min, max } = &tank.shape else { unreachable!() };
    let key = Keyframe { frame: 0, position: far.into(), rotation: [0.0; 3], quaternion: None, scale: 1.0 };
    let motion = Motion::new(&[key], Interpolation::Linear, 24.0, 0);
    let moving = Solid { motion, ..Solid::fixed(Shape::Tank { min: *min, max: *max }) };
    let found = fitted(&water, &plain, &[moving], 0.0);
    assert!(found.mesh.origin.x > 8000.0);
    let shift: Vec3 = (found.mesh.origin - far.cast::<f64>()).cast();
    let near =
        Mesh { positions: found.mesh.positions.iter().map(|x| x + shift).collect(), ..Mesh::default() };
    let at_walls = distances(&near, &tank.shape, 0.5 * SPACING);
    let met = at_walls.iter().filter(|(_, d)| (d - 0.02).abs() < 0.006).count();
    println!("{met} of {}", at_walls.len());
    assert!(met > 300 && met * 20 > at_walls.len() * 19, "{met} of {}", at_walls.len());
}

/// Where the attribute has its lower value, the surface of marching cubes stays; elsewhere it is smoothed as without a mask.
#[test]
fn a_mask_keeps_parts_of_the_surface() {
    let ball = particles([10; 3], 0.3, Vec3::zeros(), |x| x.norm() < 10.0);
    let positions = ball.vec3("position").unwrap();
    let values: Vec<f32> = positions.iter().map(|x| if x.x > 0.0 { 1.0 } else { 0.0 }).collect();
    let velocities: Vec<Vec3> = values.iter().map(|&value| Vec3::new(0.0, 3.0 - 2.0 * value, 0.0)).collect();
    let ball = ball.clone().with("detail", values).with("velocity", velocities);
    let surface = |smoothing: Option<SmoothingParams>| {
        fitted(&ball, &SurfaceParams { smoothing, ..SurfaceParams::default() }, &[], 0.0)
    };
    let (rough, smooth) = (surface(None), surface(Some(SmoothingParams::default())));
    let mask = |attribute: &str, none: f32, full: f32| {
        let mask = Some(SmoothingMask { attribute: attribute.to_owned(), none, full });
        surface(Some(SmoothingParams { mask, ..SmoothingParams::default() }))
    };
    let masked = mask("detail", 0.0, 1.0);
    let (mut kept, mut smoothed) = (0, 0);
    for ((x, rough), smooth) in
        masked.mesh.positions.iter().zip(&rough.mesh.positions).zip(&smooth.mesh.positions)
    {
        if rough.x < -2.5 * SPACING {
            assert_eq!(x, rough);
            kept += 1;
        } else if rough.x > 8.0 * SPACING {
            // The volume is corrected by the smoothed part alone.
            assert!((x - smooth).norm() < 0.05 * SPACING, "{}", (x - smooth).norm() / SPACING);
            smoothed += 1;
        }
    }
    assert!(kept > 1000 && smoothed > 300, "{kept} {smoothed}");
    assert!((masked.check.volume / rough.check.volume - 1.0).abs() < 1e-4);
    // The speed is 3 m/s in one half and 1 m/s in the other.
    let by_speed = mask("velocity", 3.0, 1.0);
    for (x, by_value) in by_speed.mesh.positions.iter().zip(&masked.mesh.positions) {
        assert!((x - by_value).norm() < 1e-4 * SPACING);
    }
}
