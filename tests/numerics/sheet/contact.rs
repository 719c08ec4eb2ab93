//! Contact of sheets with each other and with themselves.

use super::*;
use meniscus::{par, sim::sheet::ContactRecord};

const INTEGRATORS: [&str; 2] = ["symplectic", "implicit"];

/// Integrators of tests that take long: both in the long studies, otherwise the one that needs more contact iterations.
fn integrators() -> &'static [&'static str] {
    if crate::is_soak() { &INTEGRATORS } else { &INTEGRATORS[1..] }
}

/// A square sheet with a name and a side, about a centre.
fn cloth(name: &str, middle: [f32; 3], side: f32, cells: u32, terms: &str) -> String {
    let origin = [middle[0] - 0.5 * side, middle[1] - 0.5 * side, middle[2]];
    let text = grid(origin, [side, 0.0, 0.0], [0.0, side, 0.0], [cells; 2], terms);
    text.replace("'cloth'", &format!("'{name}'"))
}

const SOFT: &str = "density = 0.2\nstiffness = [60.0, 60.0]\nshear = 15.0\nbending = 2e-5\nspring_damping = [0.002, 0.002]\n";

const FAST: &str = "density = 0.2\nstiffness = [60.0, 60.0]\nshear = 15.0\n";

fn common(thickness: f32, friction: Option<f32>, integrator: &str) -> String {
    let friction = friction.map_or(String::new(), |friction| format!("friction = {friction}\n"));
    format!(
        "[sheets.contact]\nthickness = {thickness}\n{friction}[sheets.solver]\nintegrator = '{integrator}'\n"
    )
}

/// Contact record summed over all frames.
fn total_contact(records: &[SheetRecord]) -> ContactRecord {
    records.iter().filter_map(|record| record.contact.clone()).fold(ContactRecord::default(), |all, one| {
        ContactRecord {
            pairs: all.pairs + one.pairs,
            searches: all.searches + one.searches,
            renewed: all.renewed + one.renewed,
            in_impact_zones: all.in_impact_zones + one.in_impact_zones,
            unseparated: all.unseparated + one.unseparated,
            crossings: all.crossings + one.crossings,
        }
    })
}

fn energy(record: &SheetRecord) -> f64 {
    record.kinetic_energy + record.elastic_energy + record.potential_energy
}

fn points(sheets: &Sheets, sheet: usize) -> Vec<Vec3> {
    sheets.positions()[sheets.ranges()[sheet].clone()].to_vec()
}

#[test]
fn a_sheet_that_falls_on_a_pinned_one_rests_at_the_thickness() {
    for integrator in INTEGRATORS {
        // All points of the lower sheet are pinned; those of the upper one are not above them.
        let lower = cloth(
            "lower",
            [0.0; 3],
            0.6,
            7,
            &format!(
                "{SOFT}pin = [{{ at = {{ inside = {{ sphere = {{ center = [0, 0, 0], radius = 1 }} }} }} }}]"
            ),
        );
        let upper = cloth("upper", [0.013, 0.007, 0.1], 0.4, 6, &format!("{SOFT}damping = 2.0\n"));
        let text = format!("{lower}{upper}{}", common(0.01, None, integrator));
        let mut sheets = sheets(&text, &world(9.81, vec![]));
        let records = run(&mut sheets, 0, 18).unwrap();
        let contact_record = total_contact(&records);
        assert!(
            contact_record.pairs > 0 && contact_record.crossings == 0 && contact_record.unseparated == 0,
            "{contact_record:?}"
        );
        let z = points(&sheets, 1).into_iter().map(|x| x.z);
        let (low, high) = z.fold((f32::MAX, f32::MIN), |(low, high), z| (low.min(z), high.max(z)));
        println!("{integrator}: {low} {high} {contact_record:?}");
        assert!((0.01 - 2e-4..0.01 + 2e-4).contains(&low) && high < 0.0115, "{integrator}: {low} {high}");
    }
}

#[test]
#[ignore = "long: tools/soak/run"]
fn a_strip_dropped_on_its_edge_folds_on_itself() {
    for &integrator in integrators() {
        let strip = grid(
            [-0.05, 0.0, 0.01],
            [0.1, 0.0, 0.0],
            [0.0, 0.02, 0.8],
            [4, 40],
            "density = 0.2\nstiffness = [100.0, 100.0]\nshear = 20.0\nbending = 2e-5\nspring_damping = [0.003, 0.003]\ndamping = 1.0\n",
        );
        let text = format!("sheets.friction = 0.4\n{strip}{}", common(0.006, Some(0.2), integrator));
        let floor = Shape::Plane { point: [0.0; 3], normal: [0.0, 0.0, 1.0] };
        let mut sheets = sheets(&text, &world(9.81, vec![floor]));
        let records = run(&mut sheets, 0, 24).unwrap();
        let contact_record = total_contact(&records);
        println!("{integrator}: {contact_record:?}");
        let highest = sheets.positions().iter().map(|x| x.z).fold(f32::MIN, f32::max);
        assert!(
            contact_record.pairs > 1000 && highest < 0.3,
            "it lies in folds: {contact_record:?}, {highest}"
        );
        assert_eq!(
            (contact_record.crossings, contact_record.unseparated),
            (0, 0),
            "{integrator}: {contact_record:?}"
        );
        assert!(records.iter().all(|record| record.inside_solids == 0));
    }
}

/// Two free sheets that collide at 20 m/s, off centre and rotated.
fn meeting(integrator: &str, ratio: f32) -> String {
    let one = cloth("one", [0.05, 0.03, 0.0], 0.5, 14, &format!("{FAST}velocity = [0.0, 0.0, 10.0]\n"));
    let two = cloth("two", [-0.04, 0.0, 0.11], 0.4, 9, &format!("{FAST}velocity = [1.0, 0.0, -10.0]\n"))
        .replace("density = 0.2", &format!("density = {}", 0.2 * ratio));
    format!("{one}{two}{}", common(0.01, None, integrator))
}

#[test]
fn sheets_that_collide_at_20_metres_a_second_do_not_pass_and_conserve_momentum() {
    // Implicit Euler damps rotation.
    let integrators = [("implicit", [1e-5, 0.05]), ("symplectic", [1e-5, 1e-5])];
    for (integrator, bounds) in integrators.into_iter().take(if crate::is_soak() { 2 } else { 1 }) {
        let text = meeting(integrator, 1.0);
        let mut sheets = sheets(&text, &world(0.0, vec![]));
        let (before, start) = (momenta(&sheets), sheets.velocities());
        let first =
            0.5 * (0..sheets.len()).map(|i| f64::from(sheets.mass(i) * start[i].norm_squared())).sum::<f64>();
        let records = run(&mut sheets, 0, 6).unwrap();
        let contact_record = total_contact(&records);
        println!("{integrator}: {contact_record:?}");
        assert!(
            contact_record.pairs > 100 && contact_record.crossings == 0 && contact_record.unseparated == 0,
            "{contact_record:?}"
        );
        for ((after, before), bound) in momenta(&sheets).iter().zip(before).zip(bounds) {
            let change = (after.0 - before.0).norm() / before.1;
            println!("{integrator}: {change}");
            assert!(change < bound, "{integrator}: {change}");
        }
        let mut largest = first;
        for record in &records {
            assert!(energy(record) < largest * (1.0 + 2e-3), "{integrator}: {} {largest}", energy(record));
            largest = energy(record);
        }
        assert!(largest < 0.9 * first, "the collision is inelastic");
    }
}

#[test]
fn sheets_with_a_mass_ratio_of_ten_thousand_do_not_pass_through_each_other() {
    for integrator in INTEGRATORS {
        for ratio in [1e4, 1e-4] {
            if !crate::is_soak() && (ratio > 1.0) == (integrator == "implicit") {
                continue;
            }
            let text = meeting(integrator, ratio);
            let mut sheets = sheets(&text, &world(0.0, vec![]));
            let contact_record = total_contact(&run(&mut sheets, 0, 3).unwrap());
            println!("{integrator} {ratio}: {contact_record:?}");
            assert!(
                contact_record.pairs > 100
                    && contact_record.crossings == 0
                    && contact_record.unseparated == 0,
                "{ratio}: {contact_record:?}"
            );
        }
    }
}

/// A small sheet on a larger pinned one, both tilted about y: it rests where tan θ < μ, and slides otherwise.
#[test]
fn friction_between_layers_holds_below_its_angle_and_slips_above() {
    let (sin, cos) = 20_f32.to_radians().sin_cos();
    for integrator in INTEGRATORS {
        let slid = |friction: f32| {
            let side = |name: &str, along: f32, across: f32, off: f32, size: f32, cells: u32, terms: &str| {
                let origin = [along * cos + off * sin, across, -along * sin + off * cos];
                let first = [size * cos, 0.0, -size * sin];
                grid(origin, first, [0.0, size, 0.0], [cells; 2], terms)
                    .replace("'cloth'", &format!("'{name}'"))
            };
            let stiff = "density = 1.0\nstiffness = [200.0, 200.0]\nshear = 50.0\n";
            let held = format!(
                "{stiff}pin = [{{ at = {{ inside = {{ sphere = {{ center = [0, 0, 0], radius = 9 }} }} }} }}]"
            );
            let lower = side("lower", -0.3, -0.4, 0.0, 1.2, 15, &held);
            let upper = side("upper", 0.013, 0.009, 0.01, 0.3, 5, stiff);
            let text = format!("{lower}{upper}{}", common(0.01, Some(friction), integrator));
            let mut sheets = sheets(&text, &world(9.81, vec![]));
            let records = run(&mut sheets, 0, 12).unwrap();
            assert_eq!(total_contact(&records).crossings, 0);
            let upper = sheets.ranges()[1].clone();
            let v = sheets.velocities()[upper.clone()].to_vec();
            v.iter().map(|v| v.x * cos - v.z * sin).sum::<f32>() / upper.len() as f32
        };
        let (held, slid) = (slid(0.5), slid(0.1));
        let expected = 0.5 * 9.81 * (sin - 0.1 * cos);
        println!("{integrator}: {held} {slid} {expected}");
        assert!(held.abs() < 2e-3, "{integrator}: {held} m/s");
        assert!((slid / expected - 1.0).abs() < 0.03, "{integrator}: {slid} {expected}");
    }
}

#[test]
fn coincident_sheets_separate_without_energy() {
    for integrator in INTEGRATORS {
        let one = cloth("one", [0.0; 3], 0.4, 10, FAST);
        // The second is turned over.
        let two = grid([-0.2, -0.2, 0.0], [0.0, 0.4, 0.0], [0.4, 0.0, 0.0], [10; 2], FAST)
            .replace("'cloth'", "'two'");
        let text = format!("{one}{two}{}", common(0.01, None, integrator));
        let mut sheets = sheets(&text, &world(0.0, vec![]));
        assert_eq!(sheets.crossings(), 0);
        let records = run(&mut sheets, 0, 24).unwrap();
        let contact_record = total_contact(&records);
        let gap = points(&sheets, 0)[60].z - points(&sheets, 1)[60].z;
        println!("{integrator}: {contact_record:?} {gap} {}", energy(&records[23]));
        assert!(
            contact_record.crossings == 0 && (gap.abs() - 0.01).abs() < 5e-4,
            "{contact_record:?}, {gap}"
        );
        // Half of the thickness at 1 mm a frame would be 1e-5 J.
        assert!(records.iter().all(|record| energy(record) < 1e-6), "{}", energy(&records[23]));
    }
}

#[test]
fn sheets_that_intersect_at_the_start_are_reported_and_gain_no_energy() {
    for integrator in INTEGRATORS {
        let one = cloth("one", [0.0; 3], 0.4, 10, FAST);
        let two = grid([-0.13, 0.003, -0.21], [0.29, 0.0, 0.0], [0.0, 0.05, 0.4], [9; 2], FAST)
            .replace("'cloth'", "'two'");
        let text = format!("{one}{two}{}", common(0.01, Some(0.3), integrator));
        let mut sheets = sheets(&text, &world(0.0, vec![]));
        assert!(sheets.crossings() > 10, "{}", sheets.crossings());
        let records = run(&mut sheets, 0, 24).unwrap();
        println!("{integrator}: {:?} {}", total_contact(&records), energy(&records[23]));
        assert!(records.iter().all(|record| energy(record) < 1e-6), "{}", energy(&records[23]));
        assert!(records[23].contact.as_ref().unwrap().crossings > 0, "they stay tangled");
    }
}

#[test]
fn joined_sheets_touch_at_their_seam() {
    for &integrator in integrators() {
        // Two sheets next to each other with a gap, joined along it; the cells are smaller than the
        // thickness.
        let terms = "density = 0.2\nstiffness = [60.0, 60.0]\nshear = 15.0\ndamping = 20.0\n";
        let one = grid([-0.1, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [10; 2], terms);
        let two = grid([0.001, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [10; 2], terms)
            .replace("'cloth'", "'two'");
        let ends = |k: u32| (0..11).map(|j| (11 * j + k).to_string()).collect::<Vec<_>>().join(", ");
        let joint = format!(
            "[[sheets.joint]]\nsheets = ['cloth', 'two']\nat = [{{ points = [{}] }}, {{ points = [{}] }}]\nstiffness = 30.0\n",
            ends(10),
            ends(0)
        );
        let text = format!("{one}{two}{joint}{}", common(0.013, None, integrator));
        let mut sheets = sheets(&text, &world(0.0, vec![]));
        let records = run(&mut sheets, 0, 16).unwrap();
        let (one, two) = (points(&sheets, 0), points(&sheets, 1));
        let gap = (0..11).map(|j| (one[11 * j + 10] - two[11 * j]).norm()).fold(0.0, f32::max);
        println!("{integrator}: {gap} {:?} {}", total_contact(&records), records[15].strain_max);
        assert!(
            gap < 2e-4 && records[15].strain_max < 0.02,
            "{integrator}: {gap}, {}",
            records[15].strain_max
        );
    }
}

#[test]
fn chains_and_meshes_of_triangles_and_quads_have_contact() {
    for integrator in INTEGRATORS {
        let chain = grid(
            [-0.3, 0.011, 0.05],
            [0.6, 0.0, 0.0],
            [0.0, 0.01, 0.0],
            [20, 0],
            "density = 5.0\nstiffness = [3000.0, 60.0]\n",
        );
        let lower = cloth(
            "lower",
            [0.0; 3],
            0.4,
            10,
            "density = 0.2\nstiffness = [60.0, 60.0]\nshear = 15.0\npin = [{ at = 'corners' }]\n",
        );
        let mut shot = shot(&format!("{chain}{lower}{}", common(0.01, Some(0.5), integrator)));
        let mut points = Vec::new();
        let mut faces = Vec::new();
        for j in 0..5_u32 {
            for i in 0..5_u32 {
                points.push([0.04 * i as f32 - 0.1, 0.04 * j as f32 - 0.09, 0.12]);
                if i < 4 && j < 4 {
                    let a = 5 * j + i;
                    if (i + j) % 2 == 0 {
                        faces.push([a, a + 1, a + 6, a + 5]);
                    } else {
                        faces.extend([[a, a + 1, a + 6, a + 6], [a, a + 6, a + 5, a + 5]]);
                    }
                }
            }
        }
        let mut mesh = shot.params.sheet[1].clone();
        mesh.name = "mesh".into();
        mesh.pin.clear();
        let form = meniscus::sim::sheet::SheetMesh { points, faces, ..Default::default() };
        mesh.shape = meniscus::sim::sheet::SheetShape::Mesh(form);
        shot.params.sheet.push(mesh);
        let mut sheets = Sheets::new(shot, &world(9.81, vec![])).unwrap();
        let records = run(&mut sheets, 0, 16).unwrap();
        let contact_record = total_contact(&records);
        println!("{integrator}: {contact_record:?}");
        assert!(
            contact_record.pairs > 100 && contact_record.crossings == 0 && contact_record.unseparated == 0,
            "{contact_record:?}"
        );
        let lowest = |sheet: usize| self::points(&sheets, sheet).iter().map(|x| x.z).fold(f32::MAX, f32::min);
        let fallen = -0.5 * 9.81 * (16.0_f32 / 24.0).powi(2);
        assert!(lowest(2) > 0.5 * fallen, "the mesh is supported: {} {fallen}", lowest(2));
    }
}

#[test]
fn contact_has_the_same_bytes_for_any_threads_and_resumed() {
    // Heights at the start, frames, and the frame after which it is resumed.
    let ([low, high], frames, middle) =
        if crate::is_soak() { ([0.1, 0.2], 6, 4) } else { ([0.06, 0.075], 3, 2) };
    for &integrator in integrators() {
        let one = cloth("one", [0.0, 0.0, low], 0.5, 20, SOFT);
        let two = cloth("two", [0.05, 0.02, high], 0.5, 17, SOFT);
        let text = format!("sheets.friction = 0.3\n{one}{two}{}", common(0.008, Some(0.3), integrator));
        let world = world(9.81, vec![Shape::Sphere { center: [0.0, 0.0, -0.15], radius: 0.2 }]);
        let go = || {
            let mut sheets = sheets(&text, &world);
            let records = run(&mut sheets, 0, frames).unwrap();
            (sheets.streams(), records)
        };
        let whole = par::with_threads(1, go);
        println!("{:?}", total_contact(&whole.1));
        assert!(
            total_contact(&whole.1).pairs > 1000 && total_contact(&whole.1).crossings == 0,
            "{:?}",
            total_contact(&whole.1)
        );
        for &threads in crate::thread_counts() {
            assert!(whole == par::with_threads(threads, go), "{integrator}, {threads} threads");
        }
        let mut first = sheets(&text, &world);
        run(&mut first, 0, middle).unwrap();
        let time = f64::from(middle) * FRAME;
        let mut resumed = Sheets::restore(shot(&text), &world, &first.streams(), time).unwrap();
        let records = run(&mut resumed, middle, frames - middle).unwrap();
        assert!(whole.0 == resumed.streams() && whole.1[middle as usize..] == records, "{integrator}");
    }
}

#[test]
fn contact_that_needs_too_many_substeps_is_an_error() {
    let text = meeting("implicit", 1.0).replace("[sheets.solver]", "[sheets.solver]\nmax_substeps = 16");
    let mut sheets = sheets(&text, &world(0.0, vec![]));
    let error = run(&mut sheets, 0, 6).unwrap_err();
    assert!(error.what.contains("sheets.contact.thickness"), "{error:?}");
    for (key, value) in
        [("thickness", "0.0"), ("thickness", "-1.0"), ("thickness", "nan"), ("friction", "-0.1")]
    {
        let rest = if key == "thickness" { "" } else { "thickness = 0.01\n" };
        let text = format!("{}[sheets.contact]\n{rest}{key} = {value}\n", square([2, 2], 0.0, FAST));
        let error = try_sheets(&text, &world(0.0, vec![])).unwrap_err().to_string();
        assert!(error.contains(&format!("sheets.contact.{key}")), "{error}");
    }
}
