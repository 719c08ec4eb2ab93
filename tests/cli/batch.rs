//! Sequences of particle files: patterns, gaps, what is kept and made again, bad frames, memory.

use super::{meshing::xyz, *};

/// Four particles around a place.
fn drop_at(x: f32) -> String {
    xyz(&[[x, 0.0, 0.0], [x + 0.1, 0.0, 0.0], [x, 0.1, 0.0], [x, 0.0, 0.1]])
}

/// A folder with `splash_0001.xyz` and so on.
fn sequence(frames: &[u32]) -> Desk {
    let desk = Desk::new();
    for &frame in frames {
        desk.write(&format!("splash_{frame:04}.xyz"), drop_at(frame as f32));
    }
    desk
}

fn meshes(frames: &[u32]) -> Vec<String> {
    frames.iter().map(|frame| format!("particles_{frame:04}.ply")).collect()
}

/// The tool's output for a command that succeeds.
fn output(desk: &Desk, line: &str) -> String {
    desk.run(line, 0).0
}

#[test]
fn frames_are_named_by_patterns_and_ranges() {
    let desk = sequence(&[1, 2, 3, 4, 5, 6, 7, 8, 9, 10]);
    desk.write("splash_0003_notes.xyz", "");
    let run = |pattern: &str, out: &str| {
        desk.run(&format!("mesh {pattern} --spacing 0.1 -o {out}"), 0);
        desk.names(&format!("{out}/mesh"))
    };
    assert_eq!(run("splash_####.xyz", "all"), meshes(&[1, 2, 3, 4, 5, 6, 7, 8, 9, 10]));
    assert_eq!(run("splash_####.xyz --frames 3-9x3", "range"), meshes(&[3, 6, 9]));
    assert_eq!(run("splash_####.xyz --frames 2,9-10", "list"), meshes(&[2, 9, 10]));
    assert_eq!(run("splash_000[2-4].xyz", "set"), meshes(&[2, 3, 4]));
    assert_eq!(run("splash_001?.xyz splash_0004.xyz", "two"), meshes(&[4, 10]));
    // The digits in place of # are the frame, though no other file distinguishes them.
    assert_eq!(run("splash_001#.xyz", "part"), meshes(&[0]));
    assert_eq!(run("splash_####.xyz --frames 7", "one"), meshes(&[7]));
}

#[test]
fn gaps_are_reported_and_do_not_stop() {
    let desk = sequence(&[1, 2, 5, 9]);
    let (_, talk) = desk.run("mesh splash_####.xyz --spacing 0.1 -o out", 0);
    assert!(talk.contains("note: 5 frames are missing between 1 and 9: 3-4,6-8"), "{talk}");
    assert_eq!(desk.names("out/mesh"), meshes(&[1, 2, 5, 9]));
    let (_, talk) = desk.run("mesh splash_####.xyz --spacing 0.1 -o requested --frames 1-3", 3);
    assert!(talk.contains("1 of 3 frames failed") && talk.contains("frame 0003: no file"), "{talk}");
    assert_eq!(desk.names("requested/mesh"), meshes(&[1, 2]));
    let every_other = sequence(&[1, 3, 5, 7]);
    let (_, talk) = every_other.run("mesh splash_####.xyz --spacing 0.1 -o out", 0);
    assert!(!talk.contains("missing"), "{talk}");
    desk.run("simulate small.toml --frames 1-2,5", 0);
    let (_, talk) = desk.run("mesh small", 0);
    assert!(talk.contains("2 frames are missing between 1 and 5: 3-4"), "{talk}");
}

#[test]
fn a_number_far_from_the_others_is_no_burden() {
    let desk = sequence(&[0, 1, 4_294_967_295]);
    let line = "mesh splash_####.xyz --spacing 0.1 -o out";
    // Were each number between them looked for, this test would not come to its end.
    desk.run(line, 0);
    assert!(output(&desk, line).contains("3 up to date"));
    assert_eq!(named(&desk, "out"), [0, 4_294_967_295]);
    let (out, _) = desk.run("info out", 0);
    assert!(out.contains("3 ply files, 4294967293 missing"), "{out}");
    // The same of a cache.
    desk.run("simulate small.toml --frames 1-2", 0);
    let text = fs::read_to_string(desk.path("small/shot.json")).unwrap();
    desk.write("small/shot.json", text.replacen("\"last\": 2", "\"last\": 4294967295", 1));
    let (out, _) = desk.run("info small", 0);
    assert!(out.contains("4294967293 missing (3-1002,…)"), "{out}");
    for line in [line, "mesh small", "volume small"] {
        let (_, talk) = desk.run(&format!("{line} --frames 0-4294967295"), 2);
        assert!(talk.contains("4294967296 frames") && talk.contains("1000000"), "{talk}");
    }
}

#[test]
fn unchanged_frames_are_kept_and_changed_ones_made_again() {
    let desk = sequence(&[1, 2, 3, 4]);
    let line = "mesh splash_####.xyz --spacing 0.1 -o out";
    assert!(output(&desk, line).contains("4 frames meshed"));
    let first = desk.bytes("out/mesh");
    let age = |name: &str| fs::metadata(desk.path(name)).unwrap().modified().unwrap();
    let made = age("out/mesh/particles_0002.ply");
    assert!(output(&desk, line).contains("0 frames meshed") && made == age("out/mesh/particles_0002.ply"));
    assert_eq!(named(&desk, "out"), [1, 4]);

    // The time of a file does not count: written again, it is the same.
    desk.write("splash_0002.xyz", drop_at(2.0));
    assert!(output(&desk, line).contains("0 frames meshed"));
    // One that was changed, with the time that it had, is another.
    let before = age("splash_0003.xyz");
    desk.write("splash_0003.xyz", drop_at(33.0));
    fs::File::options().write(true).open(desk.path("splash_0003.xyz")).unwrap().set_modified(before).unwrap();
    let out = output(&desk, line);
    assert!(out.contains("1 frames meshed") && out.contains("3 up to date"), "{out}");
    let second = desk.bytes("out/mesh");
    assert_eq!((&first[0], &first[1], &first[3]), (&second[0], &second[1], &second[3]));
    assert_ne!(first[2], second[2]);

    // Settings count as well: of the surface, and the spacing, which files lack.
    assert!(output(&desk, &format!("{line} --voxel 0.6")).contains("4 frames meshed"));
    assert!(output(&desk, &line.replace("0.1", "0.12")).contains("4 frames meshed"));
    assert!(output(&desk, line).contains("4 frames meshed"), "and back");
    assert_eq!(desk.bytes("out/mesh"), second);
    let out = output(&desk, &format!("{line} --format ply,obj"));
    assert!(out.contains("4 frames meshed"), "the second format is not there yet: {out}");
    assert!(output(&desk, &format!("{line} --format ply,obj")).contains("0 frames meshed"));
    assert!(output(&desk, &format!("{line} --force")).contains("4 frames meshed"));
}

/// First and last frame of the manifest's only output.
fn named(desk: &Desk, folder: &str) -> [u64; 2] {
    let text = fs::read(desk.path(&format!("{folder}/shot.json"))).unwrap();
    let manifest: serde_json::Value = serde_json::from_slice(&text).unwrap();
    ["first", "last"].map(|key| manifest["outputs"][0]["frames"][key].as_u64().unwrap())
}

#[test]
fn a_bad_frame_is_named_at_the_end_and_the_others_are_made() {
    let desk = sequence(&[1, 2, 3, 4, 5, 6]);
    desk.write("splash_0002.xyz", "0 0 0\n0 inf 0\n");
    desk.write("splash_0004.xyz", "");
    desk.write("splash_0005.xyz", "2147483648\n0 0 0\n");
    for (verb, threads) in [("mesh", 1), ("mesh", 3), ("volume", 1), ("volume", 3)] {
        let line = format!("{verb} splash_####.xyz --spacing 0.1 -o out{threads} --threads {threads}");
        let (_, talk) = desk.run(&line, 3);
        assert!(talk.contains("3 of 6 frames failed"), "{talk}");
        for line in [
            "splash_0002.xyz: particle 1: found (0, inf, 0) as position",
            "splash_0004.xyz: found an empty file",
            "splash_0005.xyz: line 1: found a count of 2147483648, expected 1 lines of particles",
        ] {
            assert!(talk.contains(line), "{talk}");
        }
        assert!(talk.contains("Progress: 100%"), "{talk}");
        let (what, extension) =
            if verb == "mesh" { ("3 frames meshed", "ply") } else { ("3 volumes written", "vdb") };
        assert!(talk.contains(what), "{talk}");
        let names = [1, 3, 6].map(|frame| format!("particles_{frame:04}.{extension}"));
        assert_eq!(desk.names(&format!("out{threads}/{verb}")), names);
    }
    // The next run makes what was repaired, and only that.
    for frame in [2, 4, 5] {
        desk.write(&format!("splash_{frame:04}.xyz"), drop_at(frame as f32));
    }
    let out = output(&desk, "mesh splash_####.xyz --spacing 0.1 -o out1");
    assert!(out.contains("3 frames meshed") && out.contains("3 up to date"), "{out}");
    let out = output(&desk, "volume splash_####.xyz --spacing 0.1 -o out1");
    assert!(out.contains("3 volumes written") && out.contains("3 up to date"), "{out}");
}

#[test]
fn bytes_and_talk_do_not_depend_on_how_many_frames_run_at_once() {
    let desk = sequence(&(1..=9).collect::<Vec<_>>());
    desk.write("splash_0004.xyz", "# x y z heat\n0 0 0 nan\n");
    desk.run("simulate small.toml", 0);
    for verb in ["mesh", "volume"].into_iter().take(if super::is_soak() { 2 } else { 1 }) {
        let run = |options: &str, out: &str| {
            let (_, talk) = desk.run(&format!("{verb} splash_####.xyz --spacing 0.1 -o {out} {options}"), 0);
            let (_, more) = desk.run(&format!("{verb} small -o {out}/cache {options}"), 0);
            // Seconds differ, and so do the times at which a percentage is printed.
            let lines: Vec<String> = (talk + &more)
                .lines()
                .filter(|line| !line.starts_with("Progress"))
                .map(|line| line.split("components").next().unwrap().split("MiB").next().unwrap().to_owned())
                .collect();
            (lines, desk.bytes(&format!("{out}/{verb}")), desk.bytes(&format!("{out}/cache/{verb}")))
        };
        let alone = run("--threads 1", "alone");
        assert!(alone.0.iter().any(|line| line.contains("heat: particle 0 holds NaN")), "{:?}", alone.0);
        assert_eq!((alone.1.len(), alone.2.len()), (9, 5));
        assert!(alone == run("--threads 4", "together"), "{verb}");
        assert!(alone == run("--threads 4 --max-memory 60MiB", "tight"), "{verb}");
        assert!(alone == run("--threads 9 --max-memory 8GiB", "wide"), "{verb}");
    }
}

#[test]
fn memory_that_is_not_allowed_is_not_taken() {
    let desk = sequence(&[1, 2, 3]);
    let line = "mesh splash_####.xyz --spacing 0.1 -o out";
    let (_, talk) = desk.run(&format!("{line} --max-memory 1MiB"), 33);
    assert!(talk.contains("--max-memory allows 1 MiB") && talk.contains("surface.voxel"), "{talk}");
    assert!(talk.contains("3 of 3 frames failed") && desk.names("out/mesh").is_empty(), "{talk}");
    // What is there already needs none.
    desk.run("mesh splash_####.xyz --spacing 0.1 -o kept", 0);
    desk.run("mesh splash_####.xyz --spacing 0.1 -o kept --max-memory 1MiB", 0);
    // Among many, a file that announces more than its size fails alone.
    let header = "{'descr': '<f4', 'fortran_order': False, 'shape': (250000, 3)}";
    let start = [b"\x93NUMPY\x01\x00", &[header.len() as u8, 0][..], header.as_bytes()].concat();
    // Particles in one place would take half a minute: their search is quadratic.
    let place = |i: u32| [i % 50, i / 50 % 50, i / 2500].map(|v| 0.1 * v as f32);
    let array = (0..250_000).flat_map(place).flat_map(f32::to_le_bytes);
    let array: Vec<u8> = start.into_iter().chain(array).collect();
    let mut archive = zip::ZipWriter::new(fs::File::create(desk.path("splash_0002.npz")).unwrap());
    archive.start_file("x.npy", zip::write::SimpleFileOptions::default()).unwrap();
    std::io::Write::write_all(&mut archive, &array).unwrap();
    archive.finish().unwrap();
    fs::remove_file(desk.path("splash_0002.xyz")).unwrap();
    desk.write("splash_0003.xyz", drop_at(3.0).repeat(200));
    let (_, talk) =
        desk.run("mesh splash_####.xyz splash_0002.npz --spacing 0.1 -o out --max-memory 16MiB", 33);
    assert!(talk.contains("1 of 3 frames failed") && talk.contains("splash_0002.npz: this needs"), "{talk}");
    assert_eq!(desk.names("out/mesh"), meshes(&[1, 3]));
    // Spray takes memory by its bricks: far more than as many particles of a splash.
    let spray: Vec<[f32; 3]> = (0..3000).map(|i| [i as f32, 0.0, 0.0]).collect();
    desk.write("spray.xyz", xyz(&spray));
    let (_, talk) = desk.run("mesh spray.xyz --spacing 0.1 -o spray --max-memory 64MiB", 33);
    assert!(talk.contains("allows 64 MiB"), "{talk}");
    // Of volumes as well, also where another file is larger.
    let heap: Vec<[f32; 3]> =
        (0..8000).map(|i| [i % 20, i / 20 % 20, i / 400].map(|v| 0.1 * v as f32)).collect();
    desk.write("heap.xyz", xyz(&heap));
    let (out, talk) = desk.run("volume spray.xyz heap.xyz --spacing 0.1 -o volumes --max-memory 64MiB", 33);
    assert!(talk.contains("1 of 2 frames failed"), "{talk}");
    assert!(talk.contains("frame 0002: spray.xyz: this needs"), "{talk}");
    assert!(out.is_empty() && talk.contains("note: ") && talk.contains("1 volumes written"), "{out}{talk}");
    assert_eq!(desk.names("volumes/volume"), ["particles_0001.vdb"]);
}

/// The limit against the memory that a batch really takes.
#[cfg(target_os = "linux")]
#[test]
fn frames_at_once_take_more_memory_and_stay_within_the_limit() {
    let desk = Desk::new();
    let n = 24;
    for frame in 1..=8 {
        let heap: Vec<[f32; 3]> = (0..n * n * n)
            .map(|i| [i % n, i / n % n, i / n / n].map(|v| 0.1 * v as f32 + frame as f32))
            .collect();
        desk.write(&format!("heap_{frame}.xyz"), xyz(&heap));
    }
    let mib = f64::from(1 << 20);
    let peak = |verb: &str, limit: u32, out: &str| {
        let line = format!(
            "{verb} heap_#.xyz --spacing 0.1 --voxel 0.3 -o {out} --threads 4 --progress none --max-memory {limit}MiB"
        );
        let found = super::plan::peak(&desk, &line) / mib;
        println!("{verb}: {found:.1} of {limit} MiB");
        assert_eq!(desk.names(&format!("{out}/{verb}")).len(), 8);
        assert!(found < f64::from(limit), "{verb}: {found} of {limit} MiB");
        found
    };
    for (verb, narrow) in
        [("mesh", 90), ("volume", 120)].into_iter().take(if super::is_soak() { 2 } else { 1 })
    {
        let (narrow, wide) = (peak(verb, narrow, "narrow"), peak(verb, 600, "wide"));
        assert!(wide > 1.3 * narrow, "{verb}: {narrow} and {wide} MiB");
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_header_that_claims_more_than_its_file_takes_no_memory() {
    let desk = Desk::new();
    let claim = "2147483648";
    let vtk = format!("# vtk DataFile Version 4.1\n\nBINARY\nDATASET POLYDATA\nPOINTS {claim} float\n");
    let ply = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {claim}\nproperty float x\nproperty float y\n\
         property float z\nend_header\n"
    );
    let vtu = format!(
        "<VTKFile type=\"UnstructuredGrid\"><Piece NumberOfPoints=\"{claim}\"><Points><DataArray type=\"Float32\" \
         NumberOfComponents=\"3\" format=\"ascii\">0 0 0</DataArray></Points></Piece></VTKFile>"
    );
    let npy = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({claim}, 3), }}");
    let npy = [b"\x93NUMPY\x01\x00", &[npy.len() as u8, 0][..], npy.as_bytes(), &[0; 12]].concat();
    let bgeo = [&b"BgeoV\0\0\0\x05\x80\0\0\0"[..], &[0; 100]].concat();
    for (name, bytes, words) in [
        ("a.vtk", vtk.into_bytes(), "6442450944 numbers"),
        ("a.ply", ply.into_bytes(), "2147483648 entries"),
        ("a.vtu", vtu.into_bytes(), "6442450944 numbers"),
        ("a.npy", npy, "2147483648 × 3 numbers"),
        ("a.bgeo", bgeo, "2147483648 points"),
    ] {
        desk.write(name, bytes);
        // With half a gibibyte of address space, to take what is claimed would end the process.
        let tool = assert_cmd::cargo::cargo_bin("meniscus");
        let line =
            format!("ulimit -v 524288; exec {} mesh {name} --spacing 0.1 -o out --threads 1", tool.display());
        let output = std::process::Command::new("sh")
            .args(["-c", &line])
            .current_dir(desk.path("."))
            .output()
            .unwrap();
        let talk = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{talk}");
        assert!(talk.contains(name) && talk.contains("found") && talk.contains("expected"), "{talk}");
        assert!(talk.contains(words), "{talk}");
    }
}

// Windows has no signals that a test could send.
#[cfg(unix)]
#[test]
fn an_interrupt_keeps_the_meshes_that_are_finished() {
    let desk = Desk::new();
    for frame in 1..=300 {
        desk.write(&format!("splash_{frame:04}.xyz"), drop_at(frame as f32).repeat(300));
    }
    let mut child = std::process::Command::new(assert_cmd::cargo::cargo_bin("meniscus"))
        .args("mesh splash_####.xyz --spacing 0.1 -o out --voxel 0.1 --threads 2 --progress none".split(' '))
        .current_dir(desk.path("."))
        .stdout(std::process::Stdio::null())
        .stderr(std::process::Stdio::null())
        .spawn()
        .unwrap();
    let started = std::time::Instant::now();
    while !desk.path("out/mesh/particles_0003.ply").exists() {
        assert!(started.elapsed().as_secs() < 60, "no third mesh after a minute");
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
    let signal =
        std::process::Command::new("kill").args(["-TERM", &child.id().to_string()]).status().unwrap();
    assert!(signal.success());
    assert_eq!(child.wait().unwrap().code(), Some(130));
    let kept = desk.bytes("out/mesh");
    assert!((3..300).contains(&kept.len()), "{} meshes", kept.len());
    assert_eq!(named(&desk, "out"), [1, kept.len() as u64], "every finished frame is named");
    let out = output(&desk, "mesh splash_####.xyz --spacing 0.1 -o out --voxel 0.1 --frames 1-40");
    assert!(out.contains(&format!("{} up to date", kept.len().min(40))), "{out}");
    assert!(desk.bytes("out/mesh").starts_with(&kept[..3]));
}
