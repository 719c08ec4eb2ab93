//! Collisions of sheets with solids.

use super::*;
use crate::solids::{cuboid, filled};
use meniscus::{
    sim::sheet::{SheetMesh, SheetShape},
    solid::{Interpolation, Keyframe, MeshShape, Motion},
};

/// A sheet of 1 m, centred above the origin.
fn above(height: f32, cells: u32, terms: &str) -> String {
    grid(
        [-0.5, -0.5, height],
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [cells; 2],
        &format!(
            "density = 0.2\nstiffness = [100.0, 100.0]\nshear = 30.0\nbending = 0.0005\nspring_damping = [0.004, 0.004]\ndamping = 0.5\n{terms}"
        ),
    )
}

/// The corners of a box, and the angle by which a mesh of it is turned about z.
const BLOCK: [[f32; 3]; 2] = [[-0.3; 3], [0.3, 0.3, 0.1]];
const TURNED: f32 = 30.0;

fn obstacles() -> Vec<(&'static str, Shape)> {
    let z = [0.0, 0.0, 1.0];
    let mut turned = MeshShape::new("made here");
    turned.rotate = [0.0, 0.0, TURNED];
    vec![
        ("plane", Shape::Plane { point: [0.0; 3], normal: z }),
        ("sphere", Shape::Sphere { center: [0.0, 0.0, 0.0], radius: 0.3 }),
        ("ellipsoid", Shape::Ellipsoid { center: [0.0; 3], radii: [0.4, 0.3, 0.2] }),
        ("torus", Shape::Torus { center: [0.0; 3], axis: z, radius: 0.3, tube: 0.1 }),
        ("small hole", Shape::Torus { center: [0.0; 3], axis: z, radius: 0.22, tube: 0.2 }),
        ("capsule", Shape::Capsule { from: [-0.2, 0.0, 0.0], to: [0.2, 0.0, 0.0], radius: 0.15 }),
        ("box", Shape::Box { min: BLOCK[0], max: BLOCK[1] }),
        ("mesh", Shape::Mesh(filled(turned, BLOCK[0], BLOCK[1], 48))),
    ]
}

#[test]
#[ignore = "long: tools/soak/run"]
fn a_sheet_dropped_on_any_solid_comes_to_rest_outside() {
    for (place, (name, shape)) in obstacles().into_iter().enumerate() {
        for (with_repulsion, terms) in
            ["", "[sheets.repulsion]\nenergy = 0.04\nrange = 0.01"].into_iter().enumerate()
        {
            for (is_implicit, integrator) in ["symplectic", "implicit"].into_iter().enumerate() {
                // Otherwise each obstacle has one of the four combinations.
                if !crate::is_soak() && place % 4 != 2 * with_repulsion + is_implicit {
                    continue;
                }
                let sheet = above(0.42, 16, "").replace("damping = 0.5", "damping = 4.0");
                let text = format!(
                    "sheets.friction = 0.4\n{sheet}{terms}\n[sheets.solver]\nintegrator = '{integrator}'"
                );
                let mut sheets = sheets(&text, &world(9.81, vec![shape.clone()]));
                let records = run(&mut sheets, 0, 60).unwrap();
                let inside: Vec<u64> = records.iter().map(|r| r.inside_solids).collect();
                assert!(inside.iter().all(|&count| count == 0), "{name}, {integrator}, {terms}: {inside:?}");
                let mass: f64 = (0..sheets.len()).map(|i| f64::from(sheets.mass(i))).sum();
                let speed = (2.0 * records[59].kinetic_energy / mass).sqrt();
                let fastest =
                    records.iter().map(|r| (2.0 * r.kinetic_energy / mass).sqrt()).fold(0.0, f64::max);
                assert!(
                    fastest > 0.5 && speed < 0.03,
                    "{name}, {integrator}, {terms}: {speed} of {fastest} m/s"
                );
                let nearest =
                    sheets.positions().iter().map(|x| shape.signed_distance(*x)).fold(f32::MAX, f32::min);
                assert!((0.0..0.06).contains(&nearest), "{name}, {integrator}, {terms}: {nearest}");
                // Something supports it: in free fall it would be 11 m down.
                let highest = sheets.positions().iter().map(|x| x.z).fold(f32::MIN, f32::max);
                assert!(highest > -1.0, "{name}, {integrator}: {highest}");
                if name == "mesh" {
                    lies_on_the_block(&sheets, terms.is_empty());
                }
            }
        }
    }
}

/// Asserts that sheets are outside the mesh's block. Its samples deviate by a hundredth of a voxel on faces,
/// and round edges by a voxel, of 12.5 mm.
fn lies_on_the_block(sheets: &Sheets, touches: bool) {
    let block = Shape::Box { min: BLOCK[0], max: BLOCK[1] };
    let (sin, cos) = TURNED.to_radians().sin_cos();
    let own = |x: &Vec3| Vec3::new(cos * x.x + sin * x.y, cos * x.y - sin * x.x, x.z);
    let deepest = sheets.positions().iter().map(|x| block.signed_distance(own(x))).fold(f32::MAX, f32::min);
    // Repulsion supports it at ξ ln(c/(ξ ρ g)) = 7 mm, and closer where cloth is pulled down at the edges.
    let top = 0.1 + if touches { 0.0 } else { 0.01 * (4.0_f32 / (0.2 * 9.81)).ln() };
    let over = sheets.positions().into_iter().filter(|x| own(x).xy().amax() < 0.25);
    let lowest = over.map(|x| x.z).fold(f32::MAX, f32::min);
    println!("{deepest} {lowest} {top}");
    assert!(deepest > -0.0125, "{deepest}");
    assert!(
        if touches { (lowest - top).abs() < 2e-4 } else { (0.1..top + 2e-4).contains(&lowest) },
        "{lowest} {top}"
    );
}

/// The force at a point is A (c/ξ) exp(−f/ξ) (n·∇f) n, [gudukbay97] Eq. 9: along the sheet's normal,
/// whichever side it faces, and zero edge-on.
#[test]
fn repulsion_acts_only_along_the_normal_of_the_sheet() {
    let (energy, range, density, dt) = (0.06, 0.02, 0.2_f64, 1e-5);
    let plane = || Shape::Plane { point: [0.0; 3], normal: [0.0, 0.0, 1.0] };
    for integrator in ["symplectic", "implicit"] {
        for degrees in [0.0_f64, 25.0, 60.0, -40.0, 120.0, 180.0] {
            let (sin, cos) = degrees.to_radians().sin_cos();
            let side = [0.06 * cos as f32, 0.0, 0.06 * sin as f32];
            let text = format!(
                "{}[sheets.repulsion]\nenergy = {energy}\nrange = {range}\n[sheets.solver]\nintegrator = '{integrator}'\n\
                 tolerance = 1e-6",
                grid(
                    [0.0, 0.0, 0.06],
                    side,
                    [0.0, 0.05, 0.0],
                    [3, 2],
                    &format!("density = {density}\nstiffness = [0.5, 0.5]")
                )
            );
            let mut sheets = sheets(&text, &world(0.0, vec![plane()]));
            let places = sheets.positions();
            sheets.step(0.0, dt).unwrap();
            for (x, v) in places.iter().zip(sheets.velocities()) {
                let push = f64::from(energy / range) * (-f64::from(x.z / range)).exp();
                // n = (−sin, 0, cos), ∇f = z.
                let expected = nalgebra::Vector3::new(-sin, 0.0, cos) * (push * cos / density);
                let found = v.cast::<f64>() / dt;
                assert!(
                    (found - expected).norm() < 1e-3 * push / density,
                    "{integrator}, {degrees}: {found} {expected}"
                );
            }
        }
        // Edge-on, within the range.
        let text = format!(
            "{}[sheets.repulsion]\nenergy = {energy}\nrange = {range}\n[sheets.solver]\nintegrator = '{integrator}'",
            grid(
                [0.0, 0.0, 0.001],
                [0.06, 0.0, 0.0],
                [0.0, 0.0, 0.05],
                [3, 2],
                "density = 0.2\nstiffness = [0.5, 0.5]"
            )
        );
        let mut on_edge = sheets(&text, &world(0.0, vec![plane()]));
        on_edge.step(0.0, dt).unwrap();
        // Springs round to 1e-10 m/s; a level sheet would have 1e-4 m/s.
        assert!(
            on_edge.velocities().iter().all(|v| v.norm() < 1e-8),
            "{integrator}: {:?}",
            on_edge.velocities()
        );
    }
}

#[test]
fn repulsion_supports_a_sheet_where_it_equals_its_weight() {
    // c/ξ exp(−f/ξ) = ρ g.
    let (energy, range) = (0.06_f32, 0.02_f32);
    let expected = range * (energy / range / (0.2 * 9.81)).ln();
    for cells in [2, 9] {
        let text = format!(
            "{}[sheets.repulsion]\nenergy = {energy}\nrange = {range}\n",
            above(0.012, cells, "").replace("damping = 0.5", "damping = 8.0")
        );
        let mut sheets =
            sheets(&text, &world(9.81, vec![Shape::Plane { point: [0.0; 3], normal: [0.0, 0.0, 1.0] }]));
        let records = run(&mut sheets, 0, 96).unwrap();
        let z = sheets.positions()[0].z;
        assert!((z - expected).abs() < 2e-4, "{z} {expected}");
        assert_eq!(records.iter().map(|r| r.projected_out).sum::<u64>(), 0, "it never touches");
    }
}

/// A plane of 20 degrees under a stiff sheet that lies on it, some metres from the origin. The sheet slides
/// below a friction of tan 20°, and rests above it, however short substeps are.
#[test]
fn friction_holds_a_sheet_on_a_slope() {
    let (sin, cos) = 20_f32.to_radians().sin_cos();
    let text = |friction: f32, terms: &str, solver: &str, stiffness: f32| {
        let side = Vec3::new(cos, 0.0, -sin);
        // With repulsion, where it supports the weight.
        let off = if terms.is_empty() { 0.0 } else { 0.02 * (50.0 / (9.81 * cos)).ln() };
        let origin = Vec3::new(sin, 0.0, cos) * off + side * 2.3;
        let sheet = grid(
            origin.into(),
            side.into(),
            [0.0, 1.0, 0.0],
            [4, 4],
            &format!("density = 1.0\nstiffness = [{stiffness}, {stiffness}]\nshear = 50.0"),
        );
        format!("sheets.friction = {friction}\n{sheet}\n[sheets.solver]\n{solver}\n{terms}")
    };
    let slope = || world(9.81, vec![Shape::Plane { point: [0.0; 3], normal: [sin, 0.0, cos] }]);
    let solvers = [
        ("integrator = 'symplectic'", 200.0),
        ("integrator = 'symplectic'\nmax_substeps = 1000", 2e5), // 0.14 ms
        ("integrator = 'implicit'", 200.0),
        ("integrator = 'implicit'\nsubsteps = 400\nmax_substeps = 1000", 200.0),
    ];
    for (solver, stiffness) in solvers {
        for terms in ["", "[sheets.repulsion]\nenergy = 1.0\nrange = 0.02"] {
            let down = |of: Vec<Vec3>| of.iter().map(|v| v.x * cos - v.z * sin).sum::<f32>() / 25.0;
            let slide = |friction: f32| {
                let mut sheets = sheets(&text(friction, terms, solver, stiffness), &slope());
                let before = down(sheets.positions());
                run(&mut sheets, 0, 24).unwrap();
                [down(sheets.positions()) - before, down(sheets.velocities())]
            };
            let [slid, speed] = slide(0.5);
            println!("{solver} {terms}: {slid:.1e} m, {speed:.1e} m/s");
            assert!(slid.abs() < 1e-5 && speed.abs() < 1e-5, "{solver} {terms}: {slid} m, {speed} m/s");
            let (expected, [_, speed]) = (9.81 * (sin - 0.1 * cos), slide(0.1));
            assert!((speed / expected - 1.0).abs() < 0.02, "{solver} {terms}: {speed} {expected}");
        }
    }
}

#[test]
fn a_moving_solid_takes_a_sheet_along() {
    let key = |frame, z| Keyframe {
        frame,
        position: [0.0, 0.0, z],
        rotation: [0.0; 3],
        quaternion: None,
        scale: 1.0,
    };
    let (low, high) = ([-1.0, -1.0, -0.2], [1.0, 1.0, 0.0]);
    let shapes = [(Shape::Box { min: low, max: high }, 1e-5), (Shape::Mesh(cuboid(low, high, 40)), 5e-4)];
    // Samples deviate by a hundredth of a voxel, of 5 cm.
    for (integrator, (shape, off)) in
        ["symplectic", "implicit"].into_iter().flat_map(|slid| shapes.clone().map(|shape| (slid, shape)))
    {
        let mut lift = world(9.81, vec![shape]);
        lift.solids[0].motion = Motion::new(&[key(1, 0.0), key(25, 1.0)], Interpolation::Smooth, 24.0, 1);
        let mut sheets =
            sheets(&format!("{}[sheets.solver]\nintegrator = '{integrator}'", above(0.05, 6, "")), &lift);
        let records = run(&mut sheets, 0, 24).unwrap();
        assert!(records.iter().all(|r| r.inside_solids == 0) && records.iter().any(|r| r.projected_out > 0));
        let lowest = sheets.positions().iter().map(|x| x.z).fold(f32::MAX, f32::min);
        assert!((1.0 - off..1.2).contains(&lowest), "{integrator}: {lowest}");
    }
}

#[test]
fn fast_points_do_not_pass_through_a_thin_solid() {
    let text = above(3.0, 4, "velocity = [0.0, 0.0, -300.0]")
        .replace("stiffness = [100.0, 100.0]", "stiffness = [0.1, 0.1]");
    let mut sheets =
        sheets(&text, &world(9.81, vec![Shape::Box { min: [-2.0, -2.0, -0.01], max: [2.0, 2.0, 0.01] }]));
    let records = run(&mut sheets, 0, 2).unwrap();
    assert!(records.iter().map(|r| r.projected_out).sum::<u64>() >= 25);
    assert!(sheets.positions().iter().all(|x| x.z >= 0.01), "{:?}", sheets.positions()[0]);
}

/// Faces are straight between their points: in a ball those of width w lie up to w²/4R deep. A clearance of
/// that distance keeps them out. The default clearance is half of the thickness of contact.
#[test]
fn a_clearance_keeps_faces_out_of_a_ball() {
    let (radius, width) = (0.3, 1.0 / 16.0);
    let depth = f64::from(width * width / (4.0 * radius));
    // Hanging cloth is wider by its strain.
    let enough = 1.3 * depth;
    let ball = Shape::Sphere { center: [0.0; 3], radius };
    for integrator in ["implicit", "symplectic"].into_iter().take(if crate::is_soak() { 2 } else { 1 }) {
        let fall = |first: &str, terms: &str| {
            let sheet = above(0.32, 16, "");
            let text = format!(
                "{first}\nsheets.friction = 0.4\n{sheet}{terms}\n[sheets.solver]\nintegrator = '{integrator}'"
            );
            let mut sheets = sheets(&text, &world(9.81, vec![ball.clone()]));
            let records = run(&mut sheets, 0, 24).unwrap();
            let nearest =
                sheets.positions().iter().map(|x| ball.signed_distance(*x)).fold(f32::MAX, f32::min);
            assert!(records.iter().all(|record| record.inside_solids == 0) && records[23].projected_out > 0);
            (records, nearest)
        };
        let (records, nearest) = fall("", "");
        let last = &records[23];
        println!("{integrator}: {} {} {depth}", last.cut_faces, last.cut_depth);
        assert!(nearest < 1e-5, "it lies on the ball: {nearest}");
        assert!(
            last.cut_faces > 20 && (0.9 * depth..enough).contains(&last.cut_depth),
            "{integrator}: {last:?}"
        );
        let clearance = format!("sheets.clearance = {enough}");
        let thickness = format!("[sheets.contact]\nthickness = {}", 2.0 * enough);
        for (first, terms) in [(&*clearance, ""), ("", &*thickness)] {
            let (records, nearest) = fall(first, terms);
            assert!(
                records.iter().all(|record| (record.cut_faces, record.cut_depth) == (0, 0.0)),
                "{integrator}"
            );
            assert!((f64::from(nearest) - enough).abs() < 1e-5, "{integrator}: {nearest} {enough}");
        }
        let (records, nearest) = fall("sheets.clearance = 0", &thickness);
        assert!(
            records[23].cut_faces > 0 && nearest < 1e-5,
            "{integrator}: the clearance of the preset counts: {nearest}"
        );
    }
}

/// A rod through the middle of an edge of the second of two sheets: no point is inside, and only this tested
/// place of the faces. Likewise through the middle of a triangle.
#[test]
fn cut_faces_are_counted_at_each_tested_place_of_any_sheet() {
    let terms = "density = 0.2\nstiffness = [1.0, 1.0]";
    let one = |z: f32| grid([0.0, 0.0, z], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1; 2], terms);
    let rod = |x: f32, y: f32, radius: f32| Shape::Capsule { from: [x, y, 1.0], to: [x, y, 3.0], radius };
    let two = one(0.0) + &one(2.0).replace("'cloth'", "'other'");
    let record = |text: &str, rod: Shape, motion: Option<Motion>, triangles: bool| {
        let mut around = world(0.0, vec![rod]);
        around.solids[0].motion = motion;
        let mut params: SheetsParams = crate::from_toml(text);
        if triangles {
            params.sheet[1].shape = SheetShape::Mesh(SheetMesh {
                points: vec![[0.0, 0.0, 2.0], [1.0, 0.0, 2.0], [1.0, 1.0, 2.0], [0.0, 1.0, 2.0]],
                faces: vec![[0, 1, 2, 2], [0, 2, 3, 3]],
                ..SheetMesh::default()
            });
        }
        let mut sheets = Sheets::new(Shot { params, fps: 24.0, first: 1 }, &around).unwrap();
        let record = run(&mut sheets, 0, 1).unwrap().pop().unwrap();
        assert_eq!(record.inside_solids, 0);
        (record.cut_faces, (1e4 * record.cut_depth).round())
    };
    for (x, expected) in [(0.5, (1, 2000.0)), (0.65, (1, 500.0)), (0.75, (0, 0.0))] {
        for (x, y) in [(x, 0.0), (1.0 - x, 0.0), (x, 1.0), (0.0, x), (1.0, x)] {
            assert_eq!(record(&two, rod(x, y, 0.2), None, false), expected, "{x} {y}");
        }
    }
    assert_eq!(record(&two, rod(0.5, 0.5, 0.1), None, false), (1, 1000.0), "the middle");
    assert_eq!(record(&two, rod(0.67, 0.33, 0.1), None, true), (1, 953.0), "the middle of a triangle");
    assert_eq!(record(&two, rod(0.5, 0.5, 0.1), None, true), (2, 1000.0), "the edge between two");
    // A rod that is elsewhere at the frame's end, and faces that are pinned.
    let key = |frame, x| Keyframe {
        frame,
        position: [x, 0.0, 0.0],
        rotation: [0.0; 3],
        quaternion: None,
        scale: 1.0,
    };
    let leaves = Motion::new(&[key(1, 0.0), key(2, 9.0)], Interpolation::Linear, 24.0, 1);
    assert_eq!(record(&two, rod(0.5, 0.5, 0.1), leaves, false), (0, 0.0), "it has gone");
    let pinned = one(0.0)
        + &one(2.0)
            .replace("'cloth'", "'other'")
            .replace(terms, &format!("{terms}\npin = [{{ at = {{ points = [3] }} }}]"));
    assert_eq!(record(&pinned, rod(0.5, 0.5, 0.1), None, false), (0, 0.0), "pinned faces do not count");
}

/// Solids that are closer together than twice the clearance: between two boxes, and under a ball on the
/// floor.
#[test]
fn clearances_shrink_between_close_solids() {
    let slab = |low: f32, high: f32| Shape::Box { min: [-1.0, low, -1.0], max: [1.0, high, 1.0] };
    let ball = Shape::Sphere { center: [0.0, 0.0, 0.22], radius: 0.22 };
    let floor = Shape::Plane { point: [0.0; 3], normal: [0.0, 0.0, 1.0] };
    for clearance in [0.0, 0.003, 0.02] {
        for gap in [0.002, 0.005] {
            // A strip is upright in the slit.
            let strip = grid(
                [-0.3, 0.5 * gap, -0.3],
                [0.6, 0.0, 0.0],
                [0.0, 0.0, 0.6],
                [6; 2],
                "density = 0.2\nstiffness = [20.0, 20.0]",
            );
            let text = format!("sheets.clearance = {clearance}\n{strip}");
            let mut sheets = sheets(&text, &world(9.81, vec![slab(-0.5, 0.0), slab(gap, 0.5)]));
            let records = run(&mut sheets, 0, 6).unwrap();
            assert!(records.iter().all(|record| record.inside_solids == 0), "{clearance} {gap}");
        }
        // Cloth whose border lies on the floor extends under the ball.
        let cloth = grid(
            [0.01, -0.2, 1e-4],
            [0.3, 0.0, 0.0],
            [0.0, 0.4, 0.0],
            [60, 20],
            "density = 0.2\nstiffness = [20.0, 20.0]",
        );
        let text = format!("sheets.clearance = {clearance}\n{cloth}");
        let mut sheets = sheets(&text, &world(9.81, vec![ball.clone(), floor.clone()]));
        let records = run(&mut sheets, 0, 6).unwrap();
        assert!(records.iter().all(|record| record.inside_solids == 0), "{clearance}, the ball");
    }
}
