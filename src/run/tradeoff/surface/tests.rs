//! The judgement of a table of surfaces, on figures made up.

use super::*;
use std::collections::BTreeMap;

/// A row with a mesh of this volume, this far from the reference's.
fn row(seconds: f64, volume: f64, distance: f64) -> Row {
    let one = Distance {
        area: 2.0,
        square: 2.0 * distance * distance,
        largest: 3.0 * distance,
        angle_square: 2.0 * 0.1_f64.powi(2),
    };
    let back = Distance { largest: 4.0 * distance, ..one };
    Row {
        size: [50, 100],
        pieces: 1,
        volume,
        area: 2.0,
        is_sound: true,
        passes: [1.0, 3.0]
            .map(|times| {
                vec![("density".into(), 0.5 * times * seconds), ("distance".into(), 0.5 * times * seconds)]
            })
            .to_vec(),
        cpu_seconds: vec![seconds],
        memory: Some(1 << 20),
        field: Some(FieldError { mean: distance, largest: 2.0 * distance }),
        mesh: distance.to_bits(),
        apart: BTreeMap::from([("reference".into(), Some([one, back]))]),
    }
}

fn place<'a>(params: &'a SurfaceParams, sample: &'a Sample) -> Place<'a> {
    let mut place = Place::new(Path::new(""), params, sample);
    place.name = "reference".into();
    place
}

fn setting(label: &str) -> Setting {
    Setting { label: label.into(), overrides: crate::scene::Overrides::default() }
}

/// A table of lines with these seconds and distances [m], at a spacing of 0.5 m and two frames.
fn table(lines: &[(f64, f64)]) -> Table {
    let samples = [1, 2].map(|frame| Sample::made_up(frame, 100, 0.5));
    let job = Job { frames: vec![1, 2], shot_frames: 10, repeats: 2, by: By::Distance, max_memory: None };
    let scene = crate::scene::load("dam-break").unwrap();
    let scene = Scene::from_preset(&scene, &crate::scene::Overrides::default()).unwrap();
    let params = SurfaceParams::default();
    let places = samples.each_ref().map(|sample| place(&params, sample));
    let sweep = Sweep {
        rows: lines.iter().map(|_| (setting("a < b, \"c\""), scene.clone())).collect(),
        reference: (setting("reference"), scene.clone()),
        refined: (setting("refined"), scene.clone()),
        base: scene,
    };
    let mut rows = vec![vec![row(50.0, 2.0, 0.0), row(50.0, 2.0, 0.0)]];
    rows.push(vec![row(90.0, 2.0, 0.01), row(90.0, 2.002, 0.01)]);
    rows.extend(lines.iter().map(|&(s, d)| vec![row(s, 2.0 + d, d), row(s, 2.0 + d, d)]));
    tabulate(&sweep, &job, &samples, &places, &rows)
}

#[test]
fn rows_become_lines_of_a_frame() {
    let found = table(&[(1.0, 0.3), (2.0, 0.1)]);
    let line = &found.lines[0];
    // A repeat takes 1 and 3 s, half of it for the distance; ten frames ten times that.
    assert_eq!(line.seconds, Spread { median: 2.0, min: 1.0, max: 3.0 });
    assert_eq!((line.told.field_seconds.unwrap().median, line.shot_seconds), (1.0, 20.0));
    assert_eq!(line.told.passes, [("density".to_owned(), 1.0), ("distance".to_owned(), 1.0)]);
    assert_eq!((line.told.triangles, line.told.memory, line.told.volume), (100.0, Some(1 << 20), 2.3));
    let close = |found: Option<f64>, expected: f64| (found.unwrap() - expected).abs() < 1e-12;
    let apart = line.apart;
    assert!(close(apart.distance, 0.3) && close(apart.hausdorff, 1.2), "{apart:?}");
    assert!(close(apart.beyond, 0.9) && close(apart.missing, 1.2), "{apart:?}");
    assert!(close(apart.normals, 0.1_f64.to_degrees()) && close(apart.volume, 0.15), "{apart:?}");
    assert!(close(found.uncertainty.volume, 0.0005) && close(found.uncertainty.distance, 0.01));
    assert_eq!((found.about.spacing, found.about.particles, found.lines[1].same_as), (0.5, 100.0, None));
}

#[test]
fn the_front_the_knee_and_the_limits_choose() {
    let mut found = table(&[(1.0, 0.3), (2.0, 0.04), (8.0, 0.009), (20.0, 0.001), (9.0, 0.2)]);
    // Below the uncertainty of 0.01 more time buys nothing.
    assert_eq!(found.front(By::Distance), [0, 1, 2]);
    assert_eq!(found.front(By::Field), [0, 1, 2, 3], "which needs no reference");
    assert_eq!(found.knee, Some(1));
    assert_eq!(found.judged(&found.lines[3], By::Distance), Some(0.01));
    let chosen = |time, dev| found.choose(time, dev).unwrap();
    assert_eq!((chosen(None, None), chosen(Some(200.0), None)), (Some(1), Some(2)));
    assert_eq!(chosen(None, Some(0.1)), Some(1), "0.04 m are 8 % of a spacing");
    assert_eq!(chosen(None, Some(0.7)), Some(0));
    let none = found.choose(Some(30.0), Some(0.05)).unwrap_err().to_string();
    assert!(none.contains("30 s") && none.contains("5%"), "{none}");
    found.lines[1].apart = Apart::default();
    assert_eq!(found.front(By::Distance), [0, 2], "a surface that vanished is on no front");
    assert_eq!(found.choose(None, Some(0.1)).unwrap(), Some(2));
}

#[test]
fn the_same_meshes_are_told() {
    let found = table(&[(1.0, 0.3), (2.0, 0.1), (5.0, 0.3)]);
    let same: Vec<_> = found.lines.iter().map(|line| line.same_as).collect();
    assert_eq!(same, [None, None, Some(0)]);
}

#[test]
fn files_hold_every_setting_and_are_well_formed() {
    let mut found = table(&[(1.0, 0.3), (2.0, 0.04), (8.0, 0.02)]);
    found.lines[2].apart = Apart::default();
    let folder = tempfile::tempdir().unwrap();
    let [csv, svg, html] =
        write(&found, folder.path()).unwrap().map(|path| std::fs::read_to_string(path).unwrap());
    assert_eq!(csv.lines().count(), 1 + 3 + 2);
    assert!(csv.lines().all(|line| line.matches(',').count() >= 25) && csv.contains("\"a < b, \"\"c\"\"\""));
    assert!(csv.lines().next().unwrap().ends_with("seconds_density,seconds_distance,on_front,knee,diverged"));
    for text in [&svg, &html] {
        assert!(text.contains("a &lt; b") && !text.contains("a < b") && !text.contains("NaN"), "{text}");
        // Two points in four panels, three in the fifth, and one ring.
        assert_eq!(text.matches("<circle").count(), 2 * 4 + 3 + 1);
        assert_eq!(text.matches("class=\"lost\"").count(), 4);
    }
}
