//! Every command of README.md and docs/ is run, in order, in an empty folder; or checked, if [`checked::CHECKED`] has it.
//!
//! A document that writes files has blocks of `toml` whose first line is a comment with the name of the file, `# shot.toml`;
//! `# shot.toml, continued` adds to the file. What a document takes for granted is in [`given`].

mod block;
mod checked;
mod links;
mod reader;
mod symptoms;

use super::*;
use block::{Block, blocks, commands, documents, inline_commands, read};
use checked::CHECKED;
use reader::Reader;

/// A small liquid with tiers, as `shot.toml` of documents that take one for granted.
const SHOT: &str = r#"
title = "A shot"
frames = "1-4"
[[world.collider]]
shape = { tank = { min = [0, 0, 0], max = [1.6, 0.8, 1.2] } }
[liquid]
spacing = 0.1
[[liquid.source]]
shape = { box = { min = [0, 0, 0], max = [0.8, 0.8, 0.8] } }
[output]
mesh = ["ply"]
[quality.preview]
liquid.cfl = 0.5
"#;

/// Smoke and a sheet, which a shot may have with its liquid.
const MORE_SYSTEMS: &str = r#"
[smoke]
spacing = 0.2
[[smoke.ring]]
center = [4, 0, 1]
direction = [0, 0, 1]
radius = 0.5
thickness = 0.2
circulation = 1
[[sheet]]
name = "cloth"
density = 0.2
stiffness = [100, 100]
shape = { grid = { origin = [8, 0, 1], first = [1, 0, 0], second = [0, 1, 0], cells = [4, 4] } }
[sheets]
[sheets.solver]
"#;

/// A test for each document with commands. The long ones are left to the soak.
macro_rules! documents {
    ($($(#[$attribute:meta])* $name:ident: $document:literal,)*) => {
        $($(#[$attribute])*
        #[test]
        fn $name() {
            follow($document);
        })*

        const FOLLOWED: &[&str] = &[$($document),*];
    };
}

documents! {
    #[ignore = "takes long: tools/soak/run"]
    readme: "README.md",
    adding_a_system: "docs/adding-a-system.md",
    benchmarks: "docs/benchmarks.md",
    build: "docs/build.md",
    cleanup: "docs/cleanup.md",
    eikonal: "docs/eikonal.md",
    farm_guide: "docs/farm.md",
    usd_format: "docs/formats/usd.md",
    shot_format: "docs/formats/shot.md",
    #[ignore = "takes long: tools/soak/run"]
    gallery: "docs/gallery.md",
    kernels: "docs/kernels.md",
    liquid: "docs/liquid.md",
    meshing_guide: "docs/meshing.md",
    #[ignore = "takes long: tools/soak/run"]
    paper: "docs/paper.md",
    #[ignore = "takes long: tools/soak/run"]
    plan_guide: "docs/plan.md",
    #[ignore = "takes long: tools/soak/run"]
    preview_guide: "docs/preview.md",
    #[ignore = "takes long: tools/soak/run"]
    recipes: "docs/recipes.md",
    sheet_scenes_guide: "docs/sheet-scenes.md",
    #[ignore = "takes long: tools/soak/run"]
    sheets_guide: "docs/sheets.md",
    #[ignore = "takes long: tools/soak/run"]
    smoke_guide: "docs/smoke.md",
    stability: "docs/stability.md",
    tiers: "docs/tiers.md",
    tradeoff_guide: "docs/tradeoff.md",
    #[ignore = "takes long: tools/soak/run"]
    tutorial: "docs/tutorial.md",
    vortices: "docs/vortices.md",
    whitewater_guide: "docs/whitewater.md",
}

/// Runs or checks the commands of a document in order, in one folder.
fn follow(document: &str) {
    let text = read(document);
    let reader = Reader::new();
    given(document, &reader);
    let mut count = 0;
    for block in &blocks(&text) {
        match block.language.as_str() {
            "toml" | "obj" => write_file(&reader, block),
            "sh" => {
                for command in commands(block) {
                    count += 1;
                    let place = format!("{document}:{}", command.line);
                    match checked::find(document, &command) {
                        Some(entry) => checked::check(&reader, &place, &command.text, CHECKED[entry].check),
                        None => drop(reader.expect(&place, &command.text, command.code)),
                    }
                }
            }
            _ => {}
        }
    }
    assert!(count > 0, "{document} has no command");
}

/// Writes the file that a block of a preset names in its first line, if it does.
fn write_file(reader: &Reader, block: &Block) {
    let name = block.text.lines().next().and_then(|line| line.strip_prefix("# ")).unwrap_or_default();
    let is_name = |name: &str| name.contains('.') && !name.contains(' ');
    match name.strip_suffix(", continued") {
        Some(name) if is_name(name) => {
            let before = fs::read_to_string(reader.path(name)).unwrap_or_else(|why| panic!("{name}: {why}"));
            reader.write(name, before + "\n" + &block.text);
        }
        None if is_name(name) => reader.write(name, &block.text),
        _ => {}
    }
}

/// Puts into the folder what a document takes for granted.
fn given(document: &str, reader: &Reader) {
    let shot = |names: &[&str]| {
        reader.write("shot.toml", SHOT);
        for name in names {
            reader.expect(document, &format!("meniscus shot shot.toml -o {name}"), 0);
        }
    };
    let particles =
        |pattern: &str, spacing: f32, numbers: std::ops::Range<u32>, bytes: fn(&[[f32; 3]]) -> Vec<u8>| {
            for number in numbers {
                let ball = meshing::ball(spacing, 4.0 * spacing, [0.0; 3]);
                reader.write(&pattern.replace("####", &format!("{number:04}")), bytes(&ball));
            }
        };
    match document {
        "README.md" => {
            particles("partio/frame_####.bgeo", 0.05, 1..3, bgeo);
            shot(&["shotA", "shotB", "wedges/thick", "wedges/thin"]);
        }
        "docs/cleanup.md" | "docs/kernels.md" | "docs/eikonal.md" => shot(&["my-shot"]),
        "docs/farm.md" => {
            reader.write("shot.toml", SHOT.replace("1-4", "1-24"));
            reader.add_program("sbatch", "case \"$*\" in *--partition=short*) echo 17 ;; *) exit 1 ;; esac");
        }
        "docs/formats/shot.md" | "docs/formats/usd.md" => shot(&["DIR"]),
        "docs/meshing.md" => {
            shot(&["my-shot"]);
            particles("partio/frame_####.bgeo", 0.05, 1..3, bgeo);
            particles("sim/a_####.vtk", 0.02, 1..3, meshing::vtk);
            particles("sim/a_####.bgeo", 0.02, 1..3, bgeo);
        }
        "docs/plan.md" => shot(&[]),
        "docs/tradeoff.md" => {
            shot(&["my-shot"]);
            reader.write("shot.toml", SHOT.replace("[quality", &format!("{MORE_SYSTEMS}\n[quality")));
            particles("frame_####.bgeo", 0.05, 1..3, bgeo);
        }
        _ => {}
    }
}

/// Classic BGEO, with the radius as `pscale`.
fn bgeo(points: &[[f32; 3]]) -> Vec<u8> {
    let mut file = b"BgeoV".to_vec();
    for number in [5, points.len() as u32, 0, 0, 0, 1, 0, 0, 0] {
        file.extend(number.to_be_bytes());
    }
    file.extend([0, 6]);
    file.extend(b"pscale");
    file.extend([0, 1]);
    file.extend([0_u32.to_be_bytes(), 0.01_f32.to_be_bytes()].concat());
    for point in points {
        let numbers = [point[0], point[1], point[2], 1.0, 0.01];
        file.extend(numbers.into_iter().flat_map(f32::to_be_bytes));
    }
    file
}

/// Whether a test runs the commands of a document; [`symptoms`] has one of its own for each section.
fn is_followed(document: &str) -> bool {
    document == symptoms::DOCUMENT || FOLLOWED.contains(&document)
}

#[test]
fn every_document_with_commands_is_followed() {
    for document in documents() {
        let has_commands = blocks(&read(&document)).iter().any(|block| block.language == "sh");
        assert_eq!(has_commands, is_followed(&document), "{document}");
    }
}

#[test]
fn commands_that_are_not_run_are_counted() {
    let mut counts = vec![0; CHECKED.len()];
    let mut run = 0;
    for document in documents() {
        let text = read(&document);
        for command in blocks(&text).iter().filter(|block| block.language == "sh").flat_map(commands) {
            match checked::find(&document, &command) {
                Some(entry) => counts[entry] += 1,
                None => run += 1,
            }
        }
    }
    for (entry, found) in CHECKED.iter().zip(&counts) {
        assert_eq!(*found, entry.count, "{}: {}… ({})", entry.document, entry.start, entry.why);
    }
    assert!(run > 60, "only {run} commands are run");
    println!("{run} commands are run, {} are checked", counts.iter().sum::<usize>());
}

#[test]
fn inline_commands_are_parsed() {
    let reader = Reader::new();
    let mut count = 0;
    for document in documents() {
        for (line, command) in inline_commands(&read(&document)) {
            let place = format!("{document}:{line}");
            // Comments of PLY files begin with the name of the program.
            if command.starts_with("meniscus key") {
                continue;
            }
            let command = command
                .replace("FRAME", "1")
                .replace("SHELL", "bash")
                .replace("--spacing …", "--spacing 0.1")
                .replace(" …", "")
                .replace('…', "");
            checked::check(&reader, &place, &command, checked::Check::Parse);
            count += 1;
        }
    }
    assert!(count > 20, "{count} commands");
}
