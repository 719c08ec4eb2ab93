//! Presets good and bad, read from end to end.

use super::*;
use crate::{frame::FrameIndex, preset::model::Kind};
use proptest::prelude::*;

fn preset(text: &str) -> Preset {
    Preset { name: "shot.toml".to_owned(), text: text.to_owned(), home: Home::Folder("".into()) }
}

fn read(text: &str) -> Result<Scene, SceneError> {
    Scene::from_preset(&preset(text), &Overrides::default())
}

fn read_set(text: &str, set: &[&str]) -> Result<Scene, SceneError> {
    let set = set.iter().map(|&argument| argument.to_owned()).collect();
    Scene::from_preset(&preset(text), &Overrides { quality: None, set })
}

fn builtin_preset(name: &str) -> Preset {
    Preset { name: name.to_owned(), text: builtin::get(name).unwrap().to_owned(), home: Home::BuiltIn }
}

/// What the command line prints of an error.
fn rendered(error: &SceneError) -> String {
    crate::cli::diagnostic(error)
}

const GOOD: &str = r#"title = "Good"
frames = "1-10"

[world]
gravity = ["0 m/s²", 0, "-981 cm/s^2"]
[[world.collider]]
shape = { plane = { point = [0, 0, 0], normal = [0, 0, 1] } }

[liquid]
spacing = "2 cm"
iterations = 4
[[liquid.source]]
shape = { box = { min = [0, 0, 0], max = ["100 cm", 1, 1] } }
velocity = ["36 km/h", 0, 0]
"#;

/// `GOOD` with one text replaced by another.
fn bad(from: &str, to: &str) -> String {
    assert!(GOOD.contains(from), "{from}");
    GOOD.replacen(from, to, 1)
}

#[test]
fn units_and_defaults_arrive_in_the_scene() {
    let scene = read(GOOD).unwrap();
    assert_eq!(scene.world.gravity, [0.0, 0.0, -9.81]);
    assert_eq!((scene.fps, scene.frames.last()), (24.0, FrameIndex(10)));
    let liquid = scene.liquid.unwrap();
    assert_eq!((liquid.spacing, liquid.iterations, liquid.density_dev), (0.02, Some(4), None));
    assert_eq!(liquid.source[0].velocity, [10.0, 0.0, 0.0]);
    assert!(liquid.vorticity.is_none());
    let without = read(&bad("iterations = 4\n", "")).unwrap().liquid.unwrap();
    assert_eq!((without.iterations, without.density_dev), (None, Some(0.003)));
}

#[test]
fn every_bounded_shape_of_a_collider_is_a_liquid_source() {
    for shape in [
        "sphere = { center = [0, 0, 1], radius = 1 }",
        "capsule = { from = [0, 0, 1], to = [1, 0, 1], radius = 0.5 }",
        "torus = { center = [0, 0, 1], axis = [0, 0, 1], radius = 1, tube = \"20 cm\" }",
        "ellipsoid = { center = [0, 0, 1], radii = [1, 0.5, 0.5] }",
    ] {
        let scene = read(&bad("box = { min = [0, 0, 0], max = [\"100 cm\", 1, 1] }", shape)).unwrap();
        assert_eq!(scene, read(&scene.to_toml()).unwrap(), "{shape}");
    }
}

#[test]
fn each_mistake_is_shown_where_it_stands() {
    // Text replaced, by what, line, column, words of the rendered message, nearest valid word.
    type Case = (&'static str, &'static str, usize, usize, &'static [&'static str], Option<&'static str>);
    let cases: &[Case] = &[
        ("spacing =", "spacign =", 10, 1, &["unknown key `spacign`", "`liquid`"], Some("spacing")),
        ("frames =", "frame =", 2, 1, &["unknown key `frame`", "did you mean `frames`"], Some("frames")),
        ("gravity", "gravitas", 5, 1, &["valid keys: `gravity`, `collider`"], Some("gravity")),
        (
            "iterations = 4",
            "viscosity = { strength = 1 }",
            11,
            15,
            &["this is `liquid.xsph.strength` now"],
            Some("liquid.xsph.strength"),
        ),
        ("iterations = 4", "gravity = 4", 11, 1, &["did you mean `world.gravity`"], Some("world.gravity")),
        ("title = \"Good\"\n", "", 1, 1, &["needs the key `title`", "text in quotes"], None),
        ("spacing = \"2 cm\"\n", "", 9, 2, &["`spacing` is missing here", "above 0"], None),
        ("max = [\"100 cm\", 1, 1]", "", 13, 11, &["needs the key `max`", "Upper corner"], None),
        ("\"Good\"", "5", 1, 9, &["found 5", "put it in quotes: \"5\""], None),
        ("\"2 cm\"", "\"2 kg\"", 10, 11, &["cannot be in `kg`", "measured in m"], None),
        ("\"2 cm\"", "\"2 furlong\"", 10, 11, &["unknown unit `furlong`"], None),
        ("\"2 cm\"", "\"0.02\"", 10, 11, &["remove the quotes: 0.02"], None),
        ("\"2 cm\"", "\"fine\"", 10, 11, &["is not a number"], None),
        ("\"2 cm\"", "nan", 10, 11, &["not a finite number"], None),
        ("\"2 cm\"", "-inf", 10, 11, &["not a finite number"], None),
        ("\"2 cm\"", "true", 10, 11, &["found true, expected a number in m, above 0"], None),
        ("\"2 cm\"", "0", 10, 11, &["out of range", "above 0", "Distance between particles"], None),
        ("\"2 cm\"", "\"0 cm\"", 10, 11, &["out of range"], None),
        ("\"2 cm\"", "1e-60", 10, 11, &["out of range", "single precision"], None),
        ("\"2 cm\"", "1e60", 10, 11, &["out of range", "single precision"], None),
        ("\"2 cm\"", "{ a = 1 }", 10, 11, &["found a table"], None),
        ("iterations = 4", "iterations = 0", 11, 14, &["found 0", "1 to 100000"], None),
        ("iterations = 4", "iterations = 4.0", 11, 14, &["write 4"], None),
        ("iterations = 4", "iterations = 4.5", 11, 14, &["found 4.5, expected a whole number"], None),
        ("iterations = 4", "iterations = 99999999999999999999999999999999999999999", 11, 14, &["inf"], None),
        (
            "iterations = 4",
            "constraint = \"equalty\"",
            11,
            14,
            &["`compression`, `equality`"],
            Some("equality"),
        ),
        ("iterations = 4", "kernel_radius = \"110 %\"", 11, 17, &["1.8 to 2.5"], None),
        ("iterations = 4", "density_dev = 0.01\niterations = 4", 12, 1, &["exclude each other"], None),
        ("iterations = 4", "vorticity = {}\nmicropolar = {}", 12, 1, &["exclude each other"], None),
        ("iterations = 4", "min_substeps = 200", 11, 1, &["above `max_substeps` (100)"], None),
        ("iterations = 4", "min_substeps = 20\nmax_substeps = 10", 12, 1, &["found 20 to 10"], None),
        ("\"36 km/h\", 0, 0", "1, 0", 14, 12, &["a list of 2 values", "a list of 3 numbers in m/s"], None),
        ("\"36 km/h\", 0, 0", "1, 0, \"x\"", 14, 19, &["liquid.source.0.velocity.2"], None),
        ("plane =", "plain =", 7, 11, &["did you mean `plane`"], Some("plane")),
        ("plane = {", "tank = {}, plane = {", 7, 1, &["found 2 keys", "exactly one of"], None),
        (
            "{ plane = { point = [0, 0, 0], normal = [0, 0, 1] } }",
            "\"plane\"",
            7,
            9,
            &["`point`, `normal`"],
            None,
        ),
        (
            "[[world.collider]]",
            "[[world.collider]]\nfriction = -0.1",
            7,
            12,
            &["out of range", "at least 0"],
            None,
        ),
        (
            "[[world.collider]]",
            "[[world.collider]]\nrestitution = 1.1",
            7,
            15,
            &["out of range", "0 to 1"],
            None,
        ),
        (
            "[[world.collider]]",
            "[[world.collider]]\ncontact_angle = 181",
            7,
            17,
            &["out of range", "0 to 180"],
            None,
        ),
        (
            "[[world.collider]]",
            "[[world.collider]]\ncontact_angle = 60",
            7,
            1,
            &["`contact_angle` of a collider needs", "found 60°", "add `[liquid.surface_tension]`"],
            None,
        ),
        ("{ plane = { point = [0, 0, 0], normal = [0, 0, 1] } }", "{}", 7, 1, &["an empty table"], None),
        ("normal = [0, 0, 1]", "normal = [0, 0, 0]", 7, 40, &["length zero"], None),
        ("min = [0, 0, 0], max", "min = [0, 2, 0], max", 13, 36, &["not above `min` on the y axis"], None),
        (
            "box = { min = [0, 0, 0], max = [\"100 cm\", 1, 1] }",
            "plane = { point = [0, 0, 0], normal = [0, 0, 1] }",
            13,
            11,
            &["`liquid.source.0` cannot be filled: a plane is unbounded", "use `box`, `sphere`"],
            None,
        ),
        ("{ box = {", "{ tank = {", 13, 11, &["found a tank, expected a bounded shape"], None),
        (
            "box = { min = [0, 0, 0], max = [\"100 cm\", 1, 1] }",
            "torus = { center = [0, 0, 0], axis = [0, 0, 1], radius = 1, tube = 2 }",
            13,
            71,
            &["`tube` is not above zero, or not below `radius`"],
            None,
        ),
        ("[[liquid.source]]", "[liquid.source]", 12, 1, &["double brackets"], None),
        ("[[world.collider]]", "[[world.colliders]]", 6, 9, &["valid keys"], Some("collider")),
        ("[liquid]\n", "[[liquid]]\n", 9, 1, &["single brackets"], None),
        ("\"1-10\"", "\"1:10\"", 2, 10, &["use `1-10`"], None),
        ("\"1-10\"", "\":\"", 2, 10, &["use `1-96`"], None),
        ("\"1-10\"", "\"10-1\"", 2, 10, &["backwards"], None),
        ("\"1-10\"", "1979-05-27", 2, 10, &["a date"], None),
        ("\"2 cm\"", "\"2 µm\"", 10, 1, &["particles, more than"], None),
        ("title = \"Good\"", "title = \"Good", 1, 14, &["cannot be read"], None),
        ("frames = \"1-10\"", "frames = 1-10", 2, 10, &["cannot be read"], None),
        ("iterations = 4", "iterations = 4\niterations = 5", 12, 1, &["a key stands once"], None),
        ("[world]", "quality = 3\n[world]", 4, 11, &["tables such as"], None),
        ("[world]", "[quality.drft]\n[world]", 4, 10, &["no quality tier `drft`"], Some("draft")),
        (
            "[world]",
            "[quality.draft]\nliquid.spaced = 1\n[world]",
            5,
            8,
            &["quality `draft`", "`spaced`"],
            Some("spacing"),
        ),
    ];
    let mut wrong = Vec::new();
    for (from, to, line, column, words, nearest) in cases {
        let Err(error) = read(&bad(from, to)) else {
            wrong.push(format!("{to}: accepted"));
            continue;
        };
        let message = rendered(&error);
        let problem = &error.problems()[0];
        let place = (problem.file.as_str(), problem.line, problem.column);
        if place != ("shot.toml", *line, *column) || problem.nearest.as_deref() != *nearest {
            wrong.push(format!("{to}: {place:?} {:?}\n{message}", problem.nearest));
        }
        wrong.extend(
            words
                .iter()
                .filter(|word| !message.contains(**word))
                .map(|word| format!("{word:?} not in\n{message}")),
        );
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn all_problems_are_reported_at_once_in_order() {
    let text = bad("gravity", "gravit").replace("\"2 cm\"", "-1").replace("\"1-10\"", "\"10-1\"");
    let error = read(&text).unwrap_err();
    let lines: Vec<_> = error.problems().iter().map(|problem| problem.line).collect();
    assert_eq!(lines, [2, 5, 10]);
    let message = rendered(&error);
    assert!(message.contains("3 problems") && message.contains("shot.toml:5:1"), "{message}");
    // Syntax errors come together too, one a line.
    let error = read("a = \nb = 1\nc = ]\n").unwrap_err();
    assert_eq!(error.problems().iter().map(|problem| problem.line).collect::<Vec<_>>(), [1, 3]);
}

#[test]
fn rough_colliders_without_a_liquid_are_refused() {
    let text = bad("[[world.collider]]", "[[world.collider]]\nfriction = 0.3\nrestitution = 0.2");
    let collider = read(&text).unwrap().world.collider.remove(0);
    assert_eq!((collider.friction, collider.restitution), (Some(0.3), Some(0.2)));
    let smoke = "[smoke]\nspacing = 0.05\n[[smoke.ring]]\ncenter = [0, 0, 1]\nradius = 0.4\nthickness = 0.08\ncirculation = 1.6\n";
    let without = text.split("[liquid]").next().unwrap().to_owned() + smoke;
    let message = rendered(&read(&without).unwrap_err());
    assert!(message.contains("`friction` of a collider acts on liquids"), "{message}");
}

#[test]
fn a_preset_that_names_nothing_is_refused() {
    let message = |text: &str| rendered(&read(text).unwrap_err());
    assert!(message("title = \"x\"\nframes = \"1\"\n").contains("nothing to simulate"));
    assert!(message("title = \"x\"\nframes = \"1\"\n[liquid]\nspacing = 1\n").contains("has no source"));
    assert!(message("").contains("needs the key `title`"));
}

#[test]
fn set_edits_the_preset_and_its_mistakes_point_into_the_argument() {
    let set = [
        "liquid.source.0.velocity=[1, 0, \"2 m/s\"]",
        "liquid.spacing=3 cm",
        " frames = 5",
        "title=true story",
        "liquid.vorticity.strength=5 %",
        "liquid.iterations=none",
        "world.collider=[]",
    ];
    let scene = read_set(GOOD, &set).unwrap();
    assert_eq!((scene.title.as_str(), scene.frames.to_string().as_str()), ("true story", "5"));
    assert!(scene.world.collider.is_empty());
    let liquid = scene.liquid.unwrap();
    assert_eq!((liquid.spacing, liquid.source[0].velocity), (0.03, [1.0, 0.0, 2.0]));
    assert_eq!((liquid.vorticity.unwrap().strength, liquid.iterations), (0.05, None));

    let cases: &[(&str, usize, &str)] = &[
        ("liquid.spacign=1", 8, "did you mean `spacing`"),
        ("liquid.spacing=-1", 16, "out of range"),
        ("liquid.spacing = 2 kg", 18, "cannot be in `kg`"),
        ("liquid.spacing", 1, "no `=`"),
        ("=1", 1, "a key is missing here"),
        ("liquid..x=1", 8, "a key is missing here"),
        ("liquid.source.1.velocity=[1,0,0]", 15, "one entry, with index 0"),
        ("liquid.source.x=1", 15, "has no entry `x`"),
        ("fps.x=1", 1, ""),
        ("title.x=1", 7, "not a table"),
        ("liquid.source.0.velocity=[1, 0", 31, "the value cannot be read"),
        ("liquid.source.0.velocity=[1, 0, nan]", 33, "not a finite number"),
        ("liquid.source.0.shape={ ball = 1 }", 25, "cannot be `ball`"),
        ("frames=1:96", 8, "use `1-96`"),
        ("frames=", 8, "a frame is missing"),
        ("liquid.density_dev=0.1", 1, ""),
    ];
    for (argument, column, words) in cases {
        let error = read_set(GOOD, &[argument]).expect_err(argument);
        let message = rendered(&error);
        assert!(message.contains(words), "{words:?} in\n{message}");
        if !words.is_empty() {
            let problem = &error.problems()[0];
            assert_eq!(
                (problem.file.as_str(), problem.line, problem.column),
                ("--set", 1, *column),
                "{message}"
            );
        }
    }
    let deep = format!("{}=1", vec!["a"; 50_000].join("."));
    assert!(rendered(&read_set(GOOD, &[&deep]).unwrap_err()).contains("no preset is this deep"));
}

#[test]
fn quality_tiers_change_keys_and_the_command_line_has_the_last_word() {
    let text = format!("{GOOD}\n[quality.draft]\nliquid.spacing = \"8 cm\"\nliquid.iterations = \"none\"\n");
    let at = |quality, set: &[&str]| {
        let set = set.iter().map(|&argument| argument.to_owned()).collect();
        Scene::from_preset(&preset(&text), &Overrides { quality, set })
    };
    let spacing = |scene: Scene| scene.liquid.unwrap().spacing;
    assert_eq!(spacing(at(None, &[]).unwrap()), 0.02);
    assert_eq!(spacing(at(Some(Quality::Final), &[]).unwrap()), 0.02);
    assert_eq!(at(Some(Quality::Draft), &[]).unwrap().liquid.unwrap().iterations, None);
    assert_eq!(spacing(at(Some(Quality::Draft), &[]).unwrap()), 0.08);
    assert_eq!(spacing(at(Some(Quality::Draft), &["liquid.spacing=0.1"]).unwrap()), 0.1);
    let message = rendered(&at(Some(Quality::Preview), &[]).unwrap_err());
    assert!(message.contains("no tier `preview`") && message.contains("`draft`, `final`"), "{message}");

    // A tier that contradicts the preset is found without being requested, and once.
    let text = format!("{GOOD}\n[quality.draft]\nliquid.density_dev = 0.1\n");
    let error = read(&text).unwrap_err();
    assert_eq!(error.problems().len(), 1);
    assert!(error.problems()[0].message.contains("quality `draft`"));
    for name in ["draft", "preview", "final"] {
        assert_eq!(name.parse::<Quality>().unwrap().to_string(), name);
    }
    assert!("Draft".parse::<Quality>().is_err());
}

#[test]
fn built_in_presets_read_in_every_tier_and_survive_being_written() {
    for &(name, _) in builtin::all() {
        let mut counts = Vec::new();
        for quality in [None, Some(Quality::Final), Some(Quality::Preview), Some(Quality::Draft)] {
            let overrides = Overrides { quality, set: Vec::new() };
            let scene = Scene::from_preset(&builtin_preset(name), &overrides)
                .unwrap_or_else(|error| panic!("{}", rendered(&error)));
            let text = scene.to_toml();
            let written = Preset { text: text.clone(), ..builtin_preset(name) };
            let again = Scene::from_preset(&written, &Overrides::default())
                .unwrap_or_else(|error| panic!("{}\n{text}", rendered(&error)));
            assert_eq!(scene, again, "{text}");
            assert_eq!(scene.simulation_key(), again.simulation_key());
            assert!(text.contains("max_substeps") || !scene.sheet.is_empty(), "defaults are written");
            let finer = |smoke: &crate::sim::smoke::SmokeParams| 1e3 * smoke.tracer_spacing().powi(-3);
            let smoke = || scene.smoke.as_ref().map(|smoke| f64::from(finer(smoke)));
            counts.extend(crate::sim::liquid::job::check::final_particle_estimate(&scene).or_else(smoke));
        }
        // Tiers of sheets differ in their steps.
        if counts.is_empty() {
            let solver = |quality| {
                let overrides = Overrides { quality: Some(quality), set: Vec::new() };
                let scene = Scene::from_preset(&builtin_preset(name), &overrides).unwrap();
                scene.sheets.unwrap_or_default().solver
            };
            let [long, short] = [Quality::Draft, Quality::Final].map(solver);
            assert!(short.courant < long.courant || short.substeps > long.substeps, "{name}");
            continue;
        }
        let liquid = as_written(name).liquid.is_some();
        assert!(!liquid || (60_000.0..140_000.0).contains(&counts[0]), "{name}: {counts:?}");
        assert!(counts[0] > counts[2] && counts[2] > counts[3] && counts[3] > 6_000.0, "{name}: {counts:?}");
    }
}

#[test]
fn the_order_of_couplings_and_of_their_sides_is_no_other_shot() {
    let cloth = |name: &str| {
        format!(
            "[[sheet]]\nname = \"{name}\"\ndensity = 1\nstiffness = [1, 1]\nshape = {{ grid = {{ origin = [0, 0, 0], \
             first = [1, 0, 0], second = [0, 1, 0], cells = [2, 2] }} }}\n"
        )
    };
    let shot = |couplings: &str| read(&format!("{GOOD}\n{}{}{couplings}", cloth("a"), cloth("b"))).unwrap();
    let [a, b] = [
        "[[coupling]]\nbetween = [\"liquid\", \"a\"]\n",
        "[[coupling]]\nbetween = [\"b\", \"liquid\"]\nfriction = 0.1\n",
    ];
    let key = shot(&format!("{a}{b}")).simulation_key();
    assert_eq!(
        shot(&format!("{b}{}", a.replace("\"liquid\", \"a\"", "\"a\", \"liquid\""))).simulation_key(),
        key
    );
    assert_ne!(shot(a).simulation_key(), key);
    let error =
        read(&format!("{GOOD}\n{}[[coupling]]\nbetween = [\"liquid\", \"bb\"]\n", cloth("b"))).unwrap_err();
    assert!(rendered(&error).contains("did you mean \"b\"?"), "{}", rendered(&error));
}

/// A built-in preset as it is written.
fn as_written(name: &str) -> Scene {
    Scene::from_preset(&builtin_preset(name), &Overrides::default()).unwrap()
}

/// `GOOD` with a collider that moves so.
fn keyed(shape: &str, keys: &str) -> String {
    let collider = format!("[[world.collider]]\nshape = {{ {shape} }}\nkeyframes = [{keys}]\n\n[liquid]");
    bad("[liquid]", &collider)
}

const BOX: &str = "box = { min = [0, 0, 0], max = [1, 1, 1] }";
const PLANE: &str = "plane = { point = [0, 0, 0], normal = [0, 0, 1] }";

#[test]
fn keyframes_that_contradict_each_other_are_refused() {
    let cases = [
        (BOX, "{ frame = 5 }, { frame = 5 }", "found frame 5 after frame 5"),
        (BOX, "{ frame = 5 }, { frame = 2 }", "do not ascend"),
        (BOX, "{ frame = 1, quaternion = [0, 0, 0, 0] }", "length zero"),
        (BOX, "{ frame = 1, quaternion = [1, 0, 0, 0] }, { frame = 2 }", "some keyframes have a quaternion"),
        (BOX, "{ frame = 1, quaternion = [1, 0, 0, 0], rotation = [0, 0, 9] }", "`rotation` is given too"),
        (PLANE, "{ frame = 1 }, { frame = 2, rotation = [0, 9, 0] }", "cannot turn"),
        (BOX, "{ frame = 1, rotation = [0, 0, \"9 m\"] }", "measured in deg"),
    ];
    for (shape, keys, words) in cases {
        let message = rendered(&read(&keyed(shape, keys)).unwrap_err());
        assert!(message.contains(words), "{keys}: {message}");
    }
    for (shape, keys) in [
        (BOX, "{ frame = 1 }, { frame = 2, rotation = [0, 9, \"1 rad\"] }"),
        (PLANE, "{ frame = 1 }, { frame = 2, position = [0, 0, 1] }"),
        (BOX, "{ frame = 1, quaternion = [1, 0, 0, 0] }, { frame = 2, quaternion = [0, 1, 0, 0] }"),
    ] {
        let scene = read(&keyed(shape, keys)).unwrap();
        assert_eq!(scene, read(&scene.to_toml()).unwrap());
    }
}

#[test]
fn a_camera_looks_from_one_place_to_another() {
    let camera = |text: &str| read_set(GOOD, &[&format!("camera={{ position = [1, 2, 3], {text} }}")]);
    let found = camera("target = [0, 0, 1], focal_length = \"40 mm\"").unwrap().camera.unwrap();
    assert_eq!((found.position, found.target, found.focal_length), ([1.0, 2.0, 3.0], [0.0, 0.0, 1.0], 40.0));
    for (text, part) in [
        ("target = [1, 2, 3]", "found the same place twice"),
        ("target = [0, 0, 1], focal_length = 0", "expected a number in mm, 1 to 5000"),
        ("focal_length = 50", "`target` is missing here"),
    ] {
        let message = rendered(&camera(text).unwrap_err());
        assert!(message.contains(part), "{message}");
    }
}

#[test]
fn the_simulation_key_changes_with_what_is_simulated_and_with_nothing_else() {
    let key = |set: &[&str]| read_set(GOOD, set).unwrap().simulation_key();
    let base = key(&[]);
    for same in [
        "title=other",
        "frames=1-500x3",
        "surface.voxel=0.25",
        "output.mesh=[\"obj\"]",
        "output.volume=[\"density\", \"velocity\"]",
        "volume.precision=float",
        "surface.attributes=[\"velocity\", \"id\"]",
        "liquid.channels=[]",
        "liquid.spacing=0.02",
        "world.collider.0.look=glass",
        "camera={ position = [0, 0, 1], target = [0, 0, 0] }",
    ] {
        assert_eq!(key(&[same]), base, "{same}");
    }
    for other in [
        "frames=2-10",
        "fps=25",
        "world.gravity=[0, 0, -9.8]",
        "world.collider=[]",
        "liquid.spacing=2.01 cm",
        "liquid.iterations=5",
        "liquid.vorticity={}",
        "liquid.channels=[\"age\"]",
        "liquid.channels=[\"source\"]",
        "liquid.source.0.velocity=[0, 0, 0]",
    ] {
        assert_ne!(key(&[other]), base, "{other}");
    }
}

#[test]
fn the_cache_must_have_the_attributes_of_the_surface() {
    assert!(!read(GOOD).unwrap().to_toml().contains("channels"), "absent, it is in no key and no preset");
    let wanted = "surface.attributes=[\"velocity\", \"source\"]";
    let error = read_set(GOOD, &[wanted]).unwrap_err();
    let text = rendered(&error);
    assert!(text.contains("channels = [\"source\"]") && text.contains("simulated again"), "{text}");
    let kept = "liquid.channels=[\"age\", \"source\"]";
    let scene = read_set(GOOD, &[wanted, kept]).unwrap();
    assert_eq!(scene, read(&scene.to_toml()).unwrap());
    assert!(read_set(GOOD, &["liquid.channels=[\"heat\"]"]).is_err());
    let text = rendered(&read_set(GOOD, &[wanted, "liquid.channels=[\"age\"]"]).unwrap_err());
    assert!(text.contains("channels = [\"age\", \"source\"]"), "with what is there: {text}");
    let key = |channels: &str| read_set(GOOD, &[channels]).unwrap().simulation_key();
    for same in ["[\"source\", \"age\"]", "[\"age\", \"source\", \"age\"]"] {
        assert_eq!(key(kept), key(&format!("liquid.channels={same}")));
    }
}

#[test]
fn presets_are_found_by_file_and_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("mine.toml");
    std::fs::write(&file, format!("\u{feff}{GOOD}")).unwrap();
    let loaded = load(file.to_str().unwrap()).unwrap();
    assert_eq!(loaded.text, GOOD);
    assert_eq!(load("dam-break").unwrap(), builtin_preset("dam-break"));

    let error = load("dam-brake").unwrap_err();
    assert!(rendered(&error).contains("did you mean `dam-break`?"), "{error}");
    assert!(rendered(&load("xyzzy").unwrap_err()).contains("double-dam-break"));
    let error = load("nowhere/dam-break.toml").unwrap_err();
    assert!(matches!(&error, SceneError::Unreadable { nearest: Some(name), .. } if name == "dam-break"));

    std::fs::write(&file, b"title = \"x\"\nframes = \"\xff\"\n").unwrap();
    let error = load(file.to_str().unwrap()).unwrap_err();
    assert_eq!((error.problems()[0].line, error.problems()[0].column), (2, 11));
    assert!(rendered(&error).contains("0xFF"));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, ..ProptestConfig::default() })]

    #[test]
    fn no_edit_of_a_preset_panics(
        which in 0_usize..4,
        edits in prop::collection::vec((0.0_f64..1.0, 0_usize..12, "[a-z0-9=\\[\\]{}\"'.,%#\n _é-]{0,8}"), 1..5),
    ) {
        let mut text = builtin::all()[which].1.to_owned();
        for (at, remove, insert) in edits {
            let floor = |mut at: usize| { while !text.is_char_boundary(at) { at -= 1 } at };
            let start = floor((at * text.len() as f64) as usize);
            let end = floor((start + remove).min(text.len())).max(start);
            text.replace_range(start..end, &insert);
        }
        if let Err(error) = read(&text) {
            prop_assert!(!error.problems().is_empty());
            for problem in error.problems() {
                prop_assert!(problem.line <= text.split('\n').count());
                let line = text.split('\n').nth(problem.line - 1).unwrap_or_default();
                prop_assert!(problem.column <= line.chars().count() + 1, "{problem:?}");
            }
            rendered(&error);
        }
    }

    #[test]
    fn no_set_argument_panics(
        path in "(liquid|world|title|frames|quality)(\\.(spacing|source|0|shape|gravity|é)){0,4}",
        value in "[a-z0-9=\\[\\]{}\"'.,% é-]{0,12}",
    ) {
        if let Err(error) = read_set(GOOD, &[&format!("{path}={value}")]) {
            rendered(&error);
        }
    }

    #[test]
    fn a_written_preset_reads_as_the_same_scene(
        spacing in 1e-3_f32..10.0, gravity in prop::array::uniform3(-1e4_f32..1e4), fps in 0.1_f32..1000.0,
        title in "\\PC{0,20}", radius in 1e-6_f32..1e6,
    ) {
        let mut scene = read(GOOD).unwrap();
        scene.title = title;
        scene.fps = fps;
        scene.world.gravity = gravity;
        scene.world.collider[0].shape = crate::solid::Shape::Sphere { center: gravity, radius };
        scene.liquid.as_mut().unwrap().spacing = spacing;
        prop_assert_eq!(read(&scene.to_toml()).unwrap(), scene);
    }
}

#[test]
fn the_schema_of_a_scene_has_only_forms_that_the_check_knows() {
    let Kind::Table(keys) = &Scene::model().kind else { panic!("a scene is a table") };
    let required: Vec<_> = keys.iter().filter(|key| key.required).map(|key| key.name.as_str()).collect();
    assert_eq!(required, ["title", "frames"]);
    let liquid = &keys.iter().find(|key| key.name == "liquid").unwrap().field;
    assert!(liquid.optional && matches!(liquid.kind, Kind::Table(_)));
}
