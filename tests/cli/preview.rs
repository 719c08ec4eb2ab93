//! Previews: pictures, contact sheet and loop of a shot, and what the folder knows of them.

use super::*;
use serde_json::Value;

/// Width and height of a PNG file.
fn png_size(bytes: &[u8]) -> (u32, u32) {
    assert_eq!(&bytes[..8], b"\x89PNG\r\n\x1a\n");
    let number = |at: usize| u32::from_be_bytes(bytes[at..at + 4].try_into().unwrap());
    (number(16), number(20))
}

/// The chunks of a WebP file, in order, with their lengths.
fn chunks(bytes: &[u8]) -> Vec<(String, usize)> {
    assert_eq!((&bytes[..4], &bytes[8..12]), (&b"RIFF"[..], &b"WEBP"[..]));
    let mut found = Vec::new();
    let mut at = 12;
    while at < bytes.len() {
        let length = u32::from_le_bytes(bytes[at + 4..at + 8].try_into().unwrap()) as usize;
        found.push((String::from_utf8(bytes[at..at + 4].to_vec()).unwrap(), length));
        at += 8 + length + length % 2;
    }
    assert_eq!(at, bytes.len());
    found
}

fn outputs(desk: &Desk, shot: &str) -> Vec<(String, String, String)> {
    let text = fs::read(desk.path(shot).join("shot.json")).unwrap();
    let manifest: Value = serde_json::from_slice(&text).unwrap();
    let own = manifest["outputs"].as_array().unwrap().iter().filter(|output| output["kind"] == "preview");
    let text = |value: &Value| value.as_str().unwrap().to_owned();
    own.map(|o| (text(&o["name"]), text(&o["pattern"]), o["frames"].to_string())).collect()
}

#[test]
fn a_shot_becomes_a_contact_sheet_a_loop_and_the_frames_that_are_selected() {
    let desk = Desk::new();
    desk.run("shot small.toml", 0);
    let (out, _) = desk.run("preview small --frames 2,4 --size 192x108", 0);
    assert!(out.contains("4 files written") && out.contains("0 up to date"), "{out}");
    assert_eq!(desk.names("small/preview"), ["contact.png", "frame_0002.png", "frame_0004.png", "loop.webp"]);
    let file = |name: &str| fs::read(desk.path("small/preview").join(name)).unwrap();
    assert_eq!(png_size(&file("frame_0002.png")), (192, 108));
    // Five pictures in rows of three, with margins of 12 and a title.
    assert_eq!(png_size(&file("contact.png")), (3 * 204 + 12, 2 * 120 + 44));
    let looped: Vec<String> = chunks(&file("loop.webp")).into_iter().map(|(name, _)| name).collect();
    assert_eq!(looped, ["VP8X", "ANIM", "ANMF", "ANMF", "ANMF", "ANMF", "ANMF"]);
    let frames =
        |first: u32, last: u32, step: u32| format!("{{\"first\":{first},\"last\":{last},\"step\":{step}}}");
    let expected = [
        ("frame", "preview/frame_{:04}.png", frames(2, 4, 2)),
        ("contact", "preview/contact.png", frames(1, 5, 1)),
        ("loop", "preview/loop.webp", frames(1, 5, 1)),
    ];
    let mut found = outputs(&desk, "small");
    found.sort_by_key(|(name, ..)| ["frame", "contact", "loop"].iter().position(|known| known == name));
    let expected = expected.map(|(name, pattern, frames)| (name.to_owned(), pattern.to_owned(), frames));
    assert_eq!(found, expected);
    let (out, _) = desk.run("verify small", 0);
    assert_eq!(out.lines().filter(|line| line.starts_with("preview ")).count(), 3, "{out}");
    let (out, _) = desk.run("info small", 0);
    assert!(out.contains("preview    2 png files, 0 missing: preview/frame_{:04}.png"), "{out}");
    assert!(out.contains("preview    webp of 5 frames: preview/loop.webp"), "{out}");

    // What is there is kept, whatever the threads; what is damaged or forced is made again, with the same bytes.
    let before = desk.bytes("small/preview");
    let (out, _) = desk.run("preview small --frames 2,4 --size 192x108 --threads 3", 0);
    assert!(out.contains("0 files written") && out.contains("4 up to date"), "{out}");
    fs::write(desk.path("small/preview/loop.webp"), "RIFF").unwrap();
    let (_, err) = desk.run("verify small", 12);
    assert!(err.contains("preview/loop.webp: corrupt") && err.contains("meniscus preview"), "{err}");
    let (out, _) = desk.run("preview small --frames 2,4 --size 192x108 --threads 1", 0);
    assert!(out.contains("1 files written") && out.contains("3 up to date"), "{out}");
    assert!(desk.bytes("small/preview") == before);
    let (out, _) = desk.run("preview small --frames 2,4 --size 192x108 --threads 2 --force", 0);
    assert!(out.contains("4 files written"), "{out}");
    assert!(desk.bytes("small/preview") == before, "the same bytes for any number of threads");
}

#[test]
fn frames_that_were_not_selected_are_not_missing() {
    let desk = Desk::new();
    desk.run("simulate small.toml", 0);
    desk.run("preview small --frames 1,2,5 --size 64x36", 0);
    let (out, _) = desk.run("verify small", 0);
    assert!(out.contains("3 valid: preview/frame_{:04}.png"), "{out}");
    let (out, _) = desk.run("info small", 0);
    assert!(out.contains("3 png files, 0 missing: preview/frame_{:04}.png"), "{out}");
    // One that was drawn and is not there is.
    fs::remove_file(desk.path("small/preview/frame_0002.png")).unwrap();
    let (_, err) = desk.run("verify small", 10);
    assert!(err.contains("preview/frame_0002.png: missing"), "{err}");
    let (out, _) = desk.run("info small", 0);
    assert!(out.contains("2 png files, 1 missing: preview/frame_{:04}.png"), "{out}");
}

/// Simulates a shot again with other settings, and lists the outputs of the former state as before.
fn simulate_again(desk: &Desk, shot: &str) {
    let path = desk.path(shot).join("shot.json");
    let read = || serde_json::from_slice::<Value>(&fs::read(&path).unwrap()).unwrap();
    let outputs = read()["outputs"].clone();
    desk.run(&format!("simulate {shot}.toml --set liquid.iterations=7 --force"), 0);
    let mut manifest = read();
    manifest["outputs"] = outputs;
    fs::write(&path, manifest.to_string()).unwrap();
}

#[test]
fn previews_of_another_state_are_stale() {
    let desk = Desk::new();
    desk.run("simulate small.toml", 0);
    desk.run("preview small --frames 2 --size 64x36 --report", 0);
    desk.run("verify small", 0);
    simulate_again(&desk, "small");
    let (out, _) = desk.run("verify small", 14);
    for file in ["frame_{:04}.png", "contact.png", "loop.webp", "report.html"] {
        let line = out.lines().find(|line| line.contains(&format!("stale: preview/{file}")));
        assert!(line.is_some(), "{file}: {out}");
    }
}

#[test]
fn foam_of_another_state_and_points_of_fog_are_not_shown() {
    let desk = crate::whitewater::desk();
    desk.run("simulate white.toml", 0);
    desk.run("whitewater white", 0);
    let drawn = |desk: &Desk| desk.run("preview white --frames 16 --size 64x36 --force", 0).1;
    let before = drawn(&desk);
    assert!(before.contains(" whitewater"), "{before}");
    desk.run("verify white", 0);
    simulate_again(&desk, "white");
    let after = drawn(&desk);
    assert!(after.contains("frame 0016  ") && !after.contains(" whitewater"), "{after}");

    desk.write("ring.toml", crate::smoke::RING);
    desk.run("simulate ring.toml", 0);
    desk.run("preview ring --frames 3 --size 64x36", 0);
    desk.run("export ring", 0);
    let (out, _) = desk.run("preview ring --frames 3 --size 64x36", 0);
    assert!(out.contains("0 files written") && out.contains("3 up to date"), "{out}");
}

#[test]
fn particles_by_speed_a_camera_and_a_cache_without_a_mesh_are_drawn() {
    let desk = Desk::new();
    let camera = "[camera]\nposition = [0.8, -4, 0.6]\ntarget = [0.8, 0.4, 0.6]\n";
    desk.write("camera.toml", format!("{SMALL}\n{camera}"));
    desk.run("simulate small.toml", 0);
    desk.run("simulate camera.toml", 0);
    let (_, err) = desk.run("preview small --frames 3 --size 192x108", 0);
    assert!(err.contains("frame 0003  draft surface of "), "{err}");
    let picture = |shot: &str| fs::read(desk.path(shot).join("preview/frame_0003.png")).unwrap();
    let surface = picture("small");
    let (_, err) = desk.run("preview small --frames 3 --size 192x108 --show speed", 0);
    assert!(err.contains("frame 0003  512 particles"), "{err}");
    assert!(picture("small") != surface);
    desk.run("preview camera --frames 3 --size 192x108", 0);
    assert!(picture("camera") != surface, "the preset's camera looks from elsewhere");
}

#[test]
fn what_cannot_be_drawn_is_reported_with_the_codes_of_other_verbs() {
    let desk = Desk::new();
    desk.run("simulate small.toml", 0);
    desk.run("preview nowhere", 10);
    let (_, err) = desk.run("preview small --size 192x108000", 2);
    assert!(err.contains("from 16 to 4096 pixels"), "{err}");
    let (_, err) = desk.run("preview small --max-memory 20MiB", 33);
    assert!(err.contains("--max-memory allows 20 MiB"), "{err}");
    let (_, err) = desk.run("preview small --frames 2,9 --size 64x36", 3);
    assert!(err.contains("frame 0009: not in the cache"), "{err}");
    assert!(desk.path("small/preview/frame_0002.png").exists());
    // A damaged frame is left out of loop and contact sheet, which are made again once it is there.
    let frame = desk.path("small/cache/frame_0004.mcf");
    let sound = fs::read(&frame).unwrap();
    let mut damaged = sound.clone();
    let last = damaged.len() - 40;
    damaged[last] ^= 1;
    fs::write(&frame, &damaged).unwrap();
    let (_, err) = desk.run("preview small --frames 4 --size 64x36 --force", 12);
    assert_eq!(err.matches("frame 0004:").count(), 1, "once, though it is in loop and frames: {err}");
    fs::write(&frame, &sound).unwrap();
    let (out, _) = desk.run("preview small --size 64x36", 0);
    assert!(out.contains("2 files written"), "{out}");
}

#[test]
fn a_mesh_that_is_damaged_is_replaced_by_a_draft_surface() {
    let desk = Desk::new();
    desk.run("shot small.toml", 0);
    let (_, err) = desk.run("preview small --frames 3 --size 64x36", 0);
    assert!(err.contains("frame 0003  mesh of "), "{err}");
    fs::write(desk.path("small/mesh/liquid_0003.ply"), "ply\nformat ascii 1.0\nelement vertex 4000000000\n")
        .unwrap();
    let (_, err) = desk.run("preview small --frames 3 --size 64x36", 0);
    assert!(err.contains("frame 0003  draft surface of "), "{err}");
}

#[test]
fn a_report_is_one_page_with_loop_plots_warnings_settings_and_command() {
    let desk = Desk::new();
    desk.write("evil.toml", SMALL.replacen("Small dam", "<script>alert(1)</script> & \\\"dam\\\"", 1));
    desk.run("shot evil.toml", 0);
    let (out, _) = desk.run("preview evil --size 64x36 --report", 0);
    assert!(out.contains(&shown("evil/preview/report.html")), "{out}");
    let page = fs::read_to_string(desk.path("evil/preview/report.html")).unwrap();
    assert!(!page.contains("<script") && page.contains("&lt;script&gt;alert(1)&lt;/script&gt;"), "escaped");
    assert!(!page.contains("http:") && !page.contains("https:"), "nothing is loaded");
    assert_eq!(page.matches("src=\"data:image/webp;base64,UklG").count(), 1);
    for plot in [
        "Density deviation of the bulk [%]",
        "Volume of the liquid [m³]",
        "Energy of the liquid [J]",
        "Iterations of the liquid [a frame]",
        "Time by pass [s]",
        "Disk [MiB a frame]",
        "Memory of the frame's state [MiB]",
    ] {
        assert!(page.contains(plot), "{plot}");
    }
    for text in [
        "compression",
        "dilation",
        &shown("meniscus shot evil/preset.toml -o NEW_FOLDER --frames 1-5"),
        "spacing = 0.1",
    ] {
        assert!(page.contains(text), "{text}");
    }
    assert!(!page.contains("NaN"));
    let (out, _) = desk.run("verify evil", 0);
    assert!(out.contains("report     1 valid: preview/report.html"), "{out}");
    desk.run("preview evil --size 64x36 --report", 0);
    let page = fs::read_to_string(desk.path("evil/preview/report.html")).unwrap();
    assert!(page.contains("preview/loop.webp") && !page.contains("preview/report.html"), "without itself");
    // Drawing again keeps the report, and a terminal that is none gets no pictures.
    let (out, err) = desk.run("preview evil --size 64x36 --live --follow=10s", 0);
    assert!(
        out.contains("up to date")
            && !out.contains('\u{1b}')
            && err.contains("--live: stdout is no terminal"),
        "{err}"
    );
    assert_eq!(desk.names("evil/preview").iter().filter(|name| name.starts_with("frame_")).count(), 5);
    desk.run("verify evil", 0);
}

#[test]
fn a_picture_whose_mesh_could_not_be_read_is_drawn_again() {
    let desk = Desk::new();
    desk.run("shot small.toml --frames 1-2", 0);
    let mesh = desk.path("small/mesh/liquid_0002.ply");
    let [good, records] = [mesh.clone(), desk.path("small/mesh.jsonl")].map(|path| fs::read(path).unwrap());
    // Its record describes what cannot be read as a mesh.
    let bad = b"ply\nformat binary";
    let line = |line: &str| -> String {
        let mut record: Value = serde_json::from_str(line).unwrap();
        let file = &mut record["files"][0];
        if file["file"] == "mesh/liquid_0002.ply" {
            file["bytes"] = bad.len().into();
            file["xxh3"] = format!("{:016x}", xxhash_rust::xxh3::xxh3_64(bad)).into();
        }
        record.to_string() + "\n"
    };
    let text: String = std::str::from_utf8(&records).unwrap().lines().map(line).collect();
    fs::write(desk.path("small/mesh.jsonl"), text).unwrap();
    fs::write(&mesh, bad).unwrap();
    for _ in 0..2 {
        let (out, talk) = desk.run("preview small --frames 1,2 --size 64x48", 0);
        assert!(out.contains("3 files written") || out.contains("4 files written"), "{out}");
        assert!(talk.contains("frame 0002: shown by a draft surface"), "{talk}");
    }
    fs::write(&mesh, good).unwrap();
    desk.write("small/mesh.jsonl", records);
    let (out, talk) = desk.run("preview small --frames 1,2 --size 64x48", 0);
    assert!(
        out.contains("3 files written") && out.contains("1 up to date") && !talk.contains("draft surface"),
        "{out}{talk}"
    );
    let (out, _) = desk.run("preview small --frames 1,2 --size 64x48", 0);
    assert!(out.contains("0 files written") && out.contains("4 up to date"), "{out}");
}
