//! Shots with coupled systems, from the preset to log, report and cache.

use super::*;
use meniscus::{cache::read_frame, frame::Frame, math::Vec3};

/// Number of particles below all faces of the sheet "cloth" at their x and y, and of those outside of its outline.
fn below_and_outside(frame: &Frame) -> [usize; 2] {
    let of = |stream: &str| frame.stream(stream).unwrap_or_else(|| panic!("there is a {stream}"));
    let x = of("liquid").vec3("position").unwrap();
    let y = of("sheet.cloth").vec3("position").unwrap();
    let faces = of("sheet.cloth.faces");
    let [a, b, c, d] = ["a", "b", "c", "d"].map(|corner| faces.u32(corner).unwrap());
    let mut lowest = vec![f32::INFINITY; x.len()];
    // Quads are cut as in the coupling.
    for [p, q, r] in (0..a.len()).flat_map(|f| [[a[f], b[f], c[f]], [a[f], c[f], d[f]]]) {
        let [p, q, r] = [p, q, r].map(|i| y[i as usize]);
        let (low, high) = (p.inf(&q).inf(&r), p.sup(&q).sup(&r));
        for (x, lowest) in x.iter().zip(&mut lowest) {
            if x.x >= low.x && x.x <= high.x && x.y >= low.y && x.y <= high.y {
                *lowest = height(*x, [p, q, r]).map_or(*lowest, |height| height.min(*lowest));
            }
        }
    }
    let below = x.iter().zip(&lowest).filter(|(x, lowest)| lowest.is_finite() && x.z < **lowest);
    [below.count(), lowest.iter().filter(|lowest| lowest.is_infinite()).count()]
}

/// Height of a triangle at the x and y of a point; `None` outside of its outline.
fn height(x: Vec3, [p, q, r]: [Vec3; 3]) -> Option<f32> {
    let (u, v, d) = (q - p, r - p, x - p);
    let area = u.x * v.y - u.y * v.x;
    let (s, t) = ((d.x * v.y - d.y * v.x) / area, (u.x * d.y - u.y * d.x) / area);
    (s >= 0.0 && t >= 0.0 && s + t <= 1.0).then(|| p.z + s * u.z + t * v.z)
}

/// The lines of a shot's log.
fn log(desk: &Desk, folder: &str) -> Vec<serde_json::Value> {
    let text = fs::read_to_string(desk.path(folder).join("log.jsonl")).unwrap();
    text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

fn frame(desk: &Desk, folder: &str, number: u32) -> Frame {
    read_frame(&desk.path(folder).join(format!("cache/frame_{number:04}.mcf"))).unwrap().0
}

fn small(from: &str, to: &str) -> String {
    let text = "title = \"Small\"\nframes = \"1-12\"\n[liquid]\nspacing = 0.05\n[[liquid.source]]\n\
                shape = { box = { min = [-0.15, -0.15, 0.03], max = [0.15, 0.15, 0.3] } }\n\
                [[sheet]]\nname = \"cloth\"\ndensity = 0.5\nstiffness = [500, 500]\n\
                shape = { grid = { origin = [-0.4, -0.4, 0], first = [0.8, 0, 0], second = [0, 0.8, 0], cells = [8, 8] } }\n\
                pin = [{ at = \"corners\" }]\n[[coupling]]\nbetween = [\"liquid\", \"cloth\"]\nfriction = 0.2\n";
    assert!(text.contains(from), "{from}");
    text.replace(from, to)
}

#[test]
fn a_coupled_shot_logs_and_reports_contact() {
    let desk = Desk::new();
    desk.write("small.toml", small("", ""));
    let passes = desk.run("shot small.toml --dry-run", 0).0;
    assert!(passes.contains("coupling_search, coupling"), "{passes}");
    let plan = desk.run("plan small.toml", 0).0;
    assert!(plan.contains("81 points"), "{plan}");
    desk.run("simulate small.toml -o small", 0);
    let lines = log(&desk, "small");
    assert_eq!(lines.len(), 11);
    assert!(lines.iter().all(|line| line["coupling"]["liquid"]["crossed"] == 0), "{lines:?}");
    assert!(lines.iter().any(|line| line["coupling"]["liquid"]["contacts"].as_u64() > Some(0)), "{lines:?}");
    assert_eq!(below_and_outside(&frame(&desk, "small", 12))[0], 0);

    // `info` reports the sums over frames that exist.
    let sum =
        |key: &str| lines.iter().map(|line| line["coupling"]["liquid"][key].as_u64().unwrap()).sum::<u64>();
    let report = desk.run("info small", 0).0;
    assert!(report.contains("coupling   liquid: 0 particles through sheets, 0 projected back"), "{report}");
    assert!(
        report.contains(&format!("{} contact solves at their limit, in 11 frames", sum("unfinished"))),
        "{report}"
    );
    assert!(report.contains("sheets     strained by ") && !report.contains("smoke"), "{report}");
    fs::remove_file(desk.path("small/cache/frame_0007.mcf")).unwrap();
    let report: serde_json::Value = serde_json::from_str(&desk.run("info small --json", 0).0).unwrap();
    assert_eq!(
        (&report["liquid_on_sheets"]["frames"], &report["liquid_on_sheets"]["crossed"]),
        (&10.into(), &0.into())
    );
    let strain = lines
        .iter()
        .filter(|line| line["frame"] != 7)
        .map(|line| line["sheets"]["strain_max"].as_f64().unwrap());
    assert_eq!(report["sheets"]["strain_max"].as_f64(), strain.reduce(f64::max));

    desk.write("alone.toml", small("[[coupling]]\nbetween = [\"liquid\", \"cloth\"]\nfriction = 0.2\n", ""));
    assert!(!desk.run("shot alone.toml --dry-run", 0).0.contains("coupling"));
}

#[test]
fn mistakes_about_couplings_are_shown_with_their_place() {
    let desk = Desk::new();
    desk.write("wrong.toml", small("[[liquid.source]]\n", "[[liquid.source]]\njitter = 0.2\n"));
    let talk = desk.run("simulate wrong.toml -o wrong", 2).1;
    assert!(talk.contains("`liquid.source.0.jitter` would displace particles through"), "{talk}");
    for (to, report) in [
        ("[\"liquid\", \"cloths\"]", "did you mean \"cloth\"?"),
        ("[\"smoke\", \"cloth\"]", "add a `[smoke]`"),
        ("[\"cloth\", \"cloth\"]", "cannot be coupled"),
        ("[\"liquid\", \"cloth\"]\ndrag = {}", "coupling.0.drag"),
        (
            "[\"liquid\", \"cloth\"]\n[[coupling]]\nbetween = [\"cloth\", \"liquid\"]",
            "are already coupled by `coupling.0`",
        ),
        ("[\"liquid\"]", "a list of 2"),
    ] {
        desk.write("wrong.toml", small("[\"liquid\", \"cloth\"]", to));
        let talk = desk.run("simulate wrong.toml -o wrong", 2).1;
        assert!(talk.contains(report), "{to}: {talk}");
    }
}

#[test]
#[ignore = "long: tools/soak/run"]
fn cloth_stops_and_holds_water() {
    // Until the cloth is lowest and accelerates the water upwards: these frames have the largest forces of the shot.
    let desk = Desk::new();
    desk.run("simulate water-on-cloth --quality draft --frames 1-15 -o water", 0);
    let lines = log(&desk, "water");
    assert_eq!(lines.len(), 14);
    for line in &lines {
        let report = &line["coupling"]["liquid"];
        assert!(report["crossed"] == 0 && report["put_back"] == 0, "{report}");
    }
    let mut up = Vec::new();
    for number in 1..=15 {
        let frame = frame(&desk, "water", number);
        let [below, outside] = below_and_outside(&frame);
        assert_eq!([below, outside], [0, 0], "frame {number}: below the cloth, and over the border");
        let v = frame.stream("liquid").unwrap().vec3("velocity").unwrap();
        up.push(v.iter().map(|v| v.z).sum::<f32>() / v.len() as f32);
    }
    // It has fallen for at least 0.25 s, and has reversed its motion.
    assert!(up[6] < -2.4 && up[14] > 0.0, "{up:?}");
}

#[test]
#[ignore = "long: tools/soak/run"]
fn a_flag_in_smoke_waves_and_strains_little() {
    let desk = Desk::new();
    desk.run("simulate flag-in-smoke --quality draft --frames 1-9 -o flag", 0);
    let lines = log(&desk, "flag");
    assert_eq!(lines.len(), 8);
    for line in &lines {
        let (air, sheets) = (&line["coupling"]["smoke"], &line["sheets"]);
        // 42 × 28 faces; the wind and its gusts, of 3.5 and 1.2 m/s in the mean; NaN would be null.
        assert!(air["faces"] == 42 * 28 && air["cut"] == 0, "{air}");
        let fastest = air["fastest"].as_f64().unwrap();
        assert!(fastest > 3.5 && fastest < 3.5 + 3.0 * 1.2, "{fastest}");
        // The maximum over all frames of the draft is 11 %.
        let strain = sheets["strain_max"].as_f64().unwrap();
        assert!(strain < 0.12, "{strain}");
        let energies =
            ["kinetic_energy", "elastic_energy", "potential_energy"].map(|key| sheets[key].as_f64());
        assert!(energies.iter().all(Option::is_some), "{sheets}");
    }
    // No point is farther from the hoist than the length of the cloth, and the cloth has left its plane.
    let frame = frame(&desk, "flag", 9);
    let y = frame.stream("sheet.flag").unwrap().vec3("position").unwrap();
    assert!(y.iter().all(|y| y.x.hypot(y.y) < 1.2 * 1.12), "it hangs at its hoist");
    assert!(y.iter().any(|y| y.y.abs() > 0.02), "it waves");
}

#[test]
fn contact_solves_at_their_limit_are_reported() {
    // Springs so stiff that conjugate gradients reach their limit.
    let desk = Desk::new();
    desk.write(
        "stiff.toml",
        small("frames = \"1-12\"", "frames = \"1-6\"").replace("[500, 500]", "[5e5, 5e5]")
            + "[sheets.solver]\nintegrator = \"implicit\"\n",
    );
    let talk = desk.run("simulate stiff.toml -o stiff", 0).1;
    let lines = log(&desk, "stiff");
    let left = |line: &serde_json::Value| line["coupling"]["liquid"]["unfinished"].as_u64().unwrap();
    assert!(lines.iter().map(left).sum::<u64>() > 0, "{talk}");
    for line in lines.iter().filter(|line| left(line) > 0) {
        let remark = format!("{} contact solves reached their iteration limit", left(line));
        let of_frame = talk
            .lines()
            .find(|shown| shown.starts_with(&format!("frame {:04}", line["frame"].as_u64().unwrap())));
        assert!(of_frame.is_some_and(|shown| shown.contains(&remark)), "{remark}: {talk}");
    }
}
