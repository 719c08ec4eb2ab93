//! The judgement of a table, on figures made up.

use super::{
    compare::curves,
    row::{Row, Seen, show_the_same},
    *,
};

fn line(label: &str, seconds: f64, dev: f64, energy: f64) -> Line {
    Line {
        label: label.into(),
        set: Vec::new(),
        quality: None,
        seconds: Spread { median: seconds, min: seconds, max: seconds },
        cpu_seconds: None,
        shot_seconds: 10.0 * seconds,
        told: Told {
            particles: 512,
            substeps: 8.0,
            iterations: 16.0,
            unconverged: 0,
            density_dev_avg: dev,
            density_dev_max: 2.0 * dev,
            density_dev_largest: 3.0 * dev,
            volume_change: None,
        },
        apart: Apart { energy: Some(energy), observable: Some(energy), position: None },
        diverged: None,
        same_as: None,
        front: false,
    }
}

fn table(lines: Vec<Line>) -> Table {
    Table {
        title: "A & B".into(),
        about: Liquid { frames: "1-5".parse().unwrap(), observable: Observable::Height, horizon: None },
        threads: 2,
        by: By::Energy,
        reference: line("reference", 100.0, 0.001, 0.0),
        refined: line("refined", 400.0, 0.0005, 0.0),
        uncertainty: Apart { energy: Some(0.01), observable: Some(0.01), position: None },
        knee: None,
        lines,
    }
}

#[test]
fn errors_below_the_reference_uncertainty_are_no_reason_to_wait() {
    let found =
        table(vec![line("a", 1.0, 0.03, 0.2), line("b", 2.0, 0.01, 0.009), line("c", 9.0, 0.003, 0.0001)]);
    // By energy, b is as good as the reference can tell, so c is not worth its time; by density it is.
    assert_eq!(found.front(By::Energy), [0, 1]);
    assert_eq!(found.front(By::Density), [0, 1, 2]);
    assert_eq!(found.judged(&found.lines[2], By::Energy), Some(0.01));
}

#[test]
fn limits_choose_and_what_nothing_keeps_is_said() {
    let mut lost = line("lost", 0.1, 0.0, 0.0);
    lost.diverged = Some("frame 0002".into());
    let lines = vec![lost, line("a", 1.0, 0.03, 0.2), line("b", 2.0, 0.01, 0.1), line("c", 9.0, 0.003, 0.05)];
    let mut found = table(lines);
    assert_eq!(found.choose(Some(25.0), None).unwrap(), Some(2), "the most exact within 25 s for the shot");
    assert_eq!(found.choose(None, Some(0.02)).unwrap(), Some(2), "the cheapest below 2 %");
    assert_eq!(found.choose(Some(95.0), Some(0.005)).unwrap(), Some(3));
    assert_eq!(found.choose(None, None).unwrap(), None);
    found.knee = Some(1);
    assert_eq!(found.choose(None, None).unwrap(), Some(1));
    let none = found.choose(Some(25.0), Some(0.001)).unwrap_err().to_string();
    assert!(none.contains("25 s") && none.contains("0.1%"), "{none}");

    // What cannot be compared is not chosen, and without a reference nothing is.
    found.lines[2].apart = Apart::default();
    assert_eq!(found.choose(Some(25.0), None).unwrap(), Some(1));
    assert_eq!(found.choose(Some(25.0), Some(0.02)).unwrap(), Some(2), "the density needs no reference");
    found.lines[1].apart = Apart::default();
    assert!(matches!(found.choose(Some(25.0), None), Err(RunError::NoSetting { .. })));
    found.reference.diverged = Some("frame 0002".into());
    found.lines.iter_mut().for_each(|line| line.apart = Apart::default());
    let lost = found.choose(Some(25.0), None).unwrap_err().to_string();
    assert!(lost.contains("--by density"), "{lost}");
    found.by = By::Density;
    assert_eq!(found.choose(Some(25.0), None).unwrap(), Some(2));
}

#[test]
fn curves_are_compared_over_the_frames_asked_for_and_by_the_kilogram() {
    // Kinetic 2 and 4 J, potential 1 J, in 8 particles; the other has half of it all in 4.
    let row = |particles: usize, scale: f64, height: f64| -> Row {
        let seen = |frame: u32| {
            let logged = serde_json::from_value(serde_json::json!({
                "substeps": 8, "iterations": 16, "unconverged": 0, "density_dev_avg": 0.01,
                "density_dev_max": 0.1, "kinetic_energy": scale * f64::from(frame), "potential_energy": scale,
            }));
            Seen {
                frame,
                observables: vec![height * f64::from(frame); Observable::ALL.len()],
                logged: logged.ok(),
            }
        };
        serde_json::from_value(serde_json::json!({
            "particles": particles, "spacing": 0.5, "seconds": [1.0], "cpu_seconds": [], "memory": null, "volume_change": null,
            "diverged": null, "last_frame": 0, "frames": [seen(2), seen(4)],
        }))
        .unwrap()
    };
    let reference = row(8, 1.0, 1.0);
    let same = curves(&row(4, 0.5, 1.0), &reference, Observable::Height, &|_| true);
    assert_eq!((same.energy, same.observable, same.position), (Some(0.0), Some(0.0), None));
    // Twice the energy: 3 and 5 J too much, over a largest kinetic energy of 4 J.
    let twice = curves(&row(8, 2.0, 1.5), &reference, Observable::Height, &|_| true);
    assert!((twice.energy.unwrap() - (17.0_f64).sqrt() / 4.0).abs() < 1e-12, "{twice:?}");
    assert!((twice.observable.unwrap() - (2.5_f64).sqrt()).abs() < 1e-12, "{twice:?}");
    assert!(
        show_the_same(&row(8, 1.0, 1.5), &row(8, 2.0, 1.5)) && !show_the_same(&reference, &row(8, 1.0, 1.5))
    );
    let late = curves(&row(8, 2.0, 1.5), &reference, Observable::Height, &|frame| frame > 2);
    assert!((late.energy.unwrap() - 5.0 / 4.0).abs() < 1e-12);
    assert_eq!(curves(&row(8, 2.0, 1.5), &reference, Observable::Height, &|_| false), Apart::default());
}

#[test]
fn files_hold_every_setting_and_are_well_formed() {
    let mut lost = line("x < y, \"z\"", 0.1, 0.0, 0.0);
    lost.diverged = Some("frame 0002: particle 1".into());
    let mut found = table(vec![line("a", 1.0, 0.03, 0.2), lost, line("b", 2.0, 0.01, 0.1)]);
    found.knee = Some(2);
    let folder = tempfile::tempdir().unwrap();
    let [csv, svg, html] =
        write(&found, folder.path()).unwrap().map(|path| std::fs::read_to_string(path).unwrap());
    assert_eq!(csv.lines().count(), 6);
    assert!(
        csv.contains("\"x < y, \"\"z\"\"\"") && csv.lines().nth(3).unwrap().contains("false,true"),
        "{csv}"
    );
    for text in [&svg, &html] {
        assert!(text.contains("x &lt; y") && !text.contains("x < y") && !text.contains("NaN"), "{text}");
        let circles = text.matches("<circle").count();
        assert_eq!(circles, 3 * 2 + 1, "two points in three panels, and one knee");
    }
    assert!(html.contains("A &amp; B") && html.contains("<svg"));
}
