//! The judgement of a table, on figures made up, and measures on smoke whose places are known.

use super::{
    compare::{curves, drift, elsewhere},
    row::Row,
    *,
};
use crate::{
    frame::{Frame, FrameIndex, Stream, StreamKind},
    math::Vec3,
    run::tradeoff::runs::Measure,
};
use serde_json::json;

fn line(label: &str, seconds: f64, density: f64, velocity: f64) -> Line {
    let spread = |seconds: f64| Spread { median: seconds, min: seconds, max: seconds };
    Line {
        label: label.into(),
        set: Vec::new(),
        quality: None,
        seconds: spread(seconds),
        cpu_seconds: None,
        shot_seconds: 10.0 * seconds,
        told: Told {
            volume_seconds: Some(spread(0.1)),
            memory: Some(1 << 25),
            cache: 1000,
            volume: Some(2000),
            vortons: 100,
            tracers: 200,
            substeps: 3.0,
            capped: 0,
            clamped: 0,
            velocity: Some(velocity),
            voxel: Some(0.05),
            drift: Drift::default(),
        },
        apart: Apart { density: Some(density), center: Some(density), ..Apart::default() },
        diverged: None,
        same_as: None,
        front: false,
    }
}

fn table(lines: Vec<Line>) -> Table {
    Table {
        title: "A & B".into(),
        about: Smoke { frames: "1-5".parse().unwrap(), cell: 0.1 },
        threads: 2,
        by: By::Density,
        reference: line("reference", 100.0, 0.0, 1e-4),
        refined: line("refined", 400.0, 0.0, 5e-5),
        uncertainty: Apart { density: Some(0.02), center: Some(0.01), ..Apart::default() },
        knee: None,
        lines,
    }
}

#[test]
fn errors_below_the_reference_uncertainty_are_no_reason_to_wait() {
    let found =
        table(vec![line("a", 1.0, 0.2, 1e-2), line("b", 2.0, 0.019, 1e-3), line("c", 9.0, 0.001, 1e-4)]);
    assert_eq!(found.front(By::Density), [0, 1]);
    assert_eq!(found.front(By::Velocity), [0, 1, 2], "that needs no reference");
    assert_eq!(found.judged(&found.lines[2], By::Density), Some(0.02));
    assert_eq!(found.judged(&found.lines[2], By::Energy), None);
    // All volumes took as long and came out alike.
    assert_eq!(found.front(By::Voxel), [0]);
}

#[test]
fn limits_choose_and_what_nothing_keeps_is_said() {
    let mut lost = line("lost", 0.1, 0.0, 0.0);
    lost.diverged = Some("frame 0002".into());
    let mut found =
        table(vec![lost, line("a", 1.0, 0.2, 1e-2), line("b", 2.0, 0.1, 1e-3), line("c", 9.0, 0.03, 1e-4)]);
    assert_eq!(found.choose(Some(25.0), None).unwrap(), Some(2), "the most exact within 25 s for the shot");
    assert_eq!(
        found.choose(None, Some(0.1)).unwrap(),
        Some(2),
        "the cheapest of whose smoke a tenth is elsewhere"
    );
    assert_eq!(found.choose(None, None).unwrap(), None);
    let none = found.choose(Some(25.0), Some(0.05)).unwrap_err().to_string();
    assert!(none.contains("25 s") && none.contains("5% of the smoke"), "{none}");
    found.reference.diverged = Some("frame 0002".into());
    found.lines.iter_mut().for_each(|line| line.apart = Apart::default());
    let lost = found.choose(Some(25.0), None).unwrap_err().to_string();
    assert!(lost.contains("--by velocity"), "{lost}");
    found.by = By::Velocity;
    assert_eq!(found.choose(Some(25.0), None).unwrap(), Some(2));
}

/// A run whose centre lies at `z`, of this size, energy and impulse in frames 2 and 4.
fn row(z: f64, size: f64, energy: f64, impulse: f64) -> Row {
    let seen = |frame: u32| {
        let part = f64::from(frame) / 2.0;
        json!({
            "frame": frame, "counts": [10, 20], "body": { "center": [0, 0, z], "size": size }, "push": 2.0,
            "logged": {
                "substeps": 3, "capped": 0, "clamped": 0, "vortons": 10, "tracers": 20, "error": 1e-4,
                "invariants": {
                    "strength": [0, 0, 0], "impulse": [0, 0, impulse * part], "angular_impulse": [0, 0, 0],
                    "energy": energy * part, "helicity": 0,
                },
            },
        })
    };
    serde_json::from_value(json!({
        "cache": 100, "seconds": [1.0], "cpu_seconds": [], "memory": null, "diverged": null, "last_frame": 0,
        "frames": [seen(2), seen(4)],
    }))
    .unwrap()
}

#[test]
fn curves_are_parts_of_the_size_the_energy_and_the_push() {
    let reference = row(1.0, 0.5, 1.0, 0.5);
    let same = curves(&reference, &reference, &|_| true);
    assert_eq!(
        (same.center, same.extent, same.energy, same.impulse),
        (Some(0.0), Some(0.0), Some(0.0), Some(0.0))
    );
    let other = curves(&row(1.1, 0.6, 1.5, 0.7), &reference, &|_| true);
    let near =
        |found: Option<f64>, wanted: f64| assert!((found.unwrap() - wanted).abs() < 1e-12, "{other:?}");
    near(other.center, 0.2);
    near(other.extent, 0.2);
    // 0.5 and 1 too much, of 2 at most; 0.2 and 0.4, of 2.
    near(other.energy, (0.625_f64).sqrt() / 2.0);
    near(other.impulse, (0.1_f64).sqrt() / 2.0);
    assert_eq!(curves(&reference, &reference, &|_| false), Apart::default());
    let own = drift(&reference);
    assert_eq!((own.energy, own.impulse), (Some(1.0), Some(0.25)));
}

#[test]
fn the_share_that_is_elsewhere_goes_from_none_to_all() {
    let at = |x: i32, value: f32| ([x, 0, 0], value);
    let a = [at(-1, 1.0), at(2, 3.0)];
    assert_eq!(elsewhere(&a, &a), Some(0.0));
    assert_eq!(elsewhere(&a, &[at(0, 4.0), at(5, 1.0)]), Some(1.0));
    assert_eq!(elsewhere(&a, &[at(-1, 1.0), at(0, 1.0), at(2, 2.0)]), Some(0.25));
    assert_eq!(elsewhere(&a, &[]), Some(1.0));
    assert_eq!(elsewhere(&[], &[]), None);
}

#[test]
fn what_moves_by_less_than_a_cell_is_elsewhere_by_a_part_of_it() {
    let frame = |shift: f32| {
        let points: Vec<Vec3> = (0..8000)
            .map(|i| [i % 20, i / 20 % 20, i / 400].map(|v| 0.05 * v as f32))
            .map(|x| Vec3::from(x) + Vec3::x() * shift)
            .collect();
        let stream = Stream::new(crate::sim::smoke::TRACERS, StreamKind::Tracers, points.len());
        let mut stream = stream.with("density", vec![1.0_f32; points.len()]).with("position", points);
        stream.scalars = vec![("spacing".into(), 0.05)];
        Frame { index: FrameIndex(1), time: 0.0, streams: vec![stream] }
    };
    let folder = tempfile::tempdir().unwrap();
    let scene = scene();
    let share = |shift: f32| {
        let kept = |name: &str, frame: &Frame| {
            let place = Place::new::<Smoky>(&folder.path().join(name), &scene, FrameIndex(1), "");
            let shot = ShotFolder::new(&place.folder);
            ShotFolder::create(&shot.cache()).unwrap();
            crate::cache::write_frame(&shot.cache(), frame, 0).unwrap();
            let control = Control { reporter: &Silent, interrupted: &|| false };
            let found = Smoky { cell: 0.2 }.measure(&place, &shot, control).unwrap();
            let body = found.frames[0].body.unwrap();
            assert!((body.center[1] - 0.475).abs() < 1e-6 && (body.size - 0.499).abs() < 1e-3, "{body:?}");
            row::sampled(&place, 1).unwrap().unwrap()
        };
        elsewhere(&kept("a", &frame(0.0)), &kept(&format!("b{shift}"), &frame(shift))).unwrap()
    };
    // A cube of edge 1 that moves by d has d of itself elsewhere.
    let found = [0.05, 0.1, 0.2, 0.4].map(share);
    for (found, exact) in found.iter().zip([0.05, 0.1, 0.2, 0.4]) {
        assert!((found / exact - 1.0).abs() < 0.2, "{found} of {exact}");
    }
}

fn scene() -> Scene {
    let preset = crate::scene::load("smoke-ring").unwrap();
    Scene::from_preset(&preset, &crate::scene::Overrides::default()).unwrap()
}

struct Silent;

impl crate::run::Reporter for Silent {
    fn begin(&self, _: &str, _: usize) {}
    fn progress(&self, _: f64) {}
    fn frame(&self, _: &str) {}
    fn note(&self, _: &str) {}
    fn end(&self) {}
    fn stop(&self) {}
}

#[test]
fn files_hold_every_setting_and_are_well_formed() {
    let mut lost = line("x < y, \"z\"", 0.1, 0.0, 0.0);
    lost.diverged = Some("frame 0002: vorton 1".into());
    let mut found = table(vec![line("a", 1.0, 0.2, 1e-2), lost, line("b", 2.0, 0.1, 1e-3)]);
    found.knee = Some(2);
    let folder = tempfile::tempdir().unwrap();
    let [csv, svg, html] =
        write(&found, folder.path()).unwrap().map(|path| std::fs::read_to_string(path).unwrap());
    assert_eq!(csv.lines().count(), 6);
    let columns = csv.lines().next().unwrap().split(',').count();
    assert_eq!(csv.lines().nth(1).unwrap().split(',').count(), columns);
    assert!(csv.lines().nth(3).unwrap().contains("false,true"), "{csv}");
    for text in [&svg, &html] {
        assert!(text.contains("x &lt; y") && !text.contains("x < y") && !text.contains("NaN"), "{text}");
        // Two points in the panels of density, centre, velocity and voxel, and one knee.
        assert_eq!(text.matches("<circle").count(), 4 * 2 + 1);
    }
    assert!(html.contains("A &amp; B") && html.contains("<svg"));
}
