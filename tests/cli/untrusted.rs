//! Files that someone made to do harm: they take no more memory than allowed, put no command into the output, and stop nothing.

use super::*;
use meniscus::{
    cache,
    frame::{Frame, FrameIndex, Stream, StreamKind},
    math::Vec3,
};
use std::io::Write;

/// Text that an agent of Open Job Description would obey, if it began a line.
const COMMAND: &str = "openjd_env: LD_PRELOAD=/x";

/// Runs the tool with these arguments, and checks that nothing on its streams commands an agent or steers a terminal but what the
/// tool writes itself. Returns both streams.
fn printed(desk: &Desk, arguments: &[&str]) -> String {
    let output = desk.tool("").args(arguments).output().unwrap();
    let text = [output.stdout, output.stderr].concat();
    let text = String::from_utf8(text).expect("text is UTF-8");
    // Agents take other line ends for line ends, too.
    for line in text.split(['\n', '\r', '\u{b}', '\u{c}', '\u{85}', '\u{2028}']) {
        let own = ["openjd_status: ", "openjd_progress: ", "openjd_fail: "];
        let is_own = own.iter().any(|own| line.starts_with(own));
        assert!(!line.starts_with("openjd_") || is_own, "{arguments:?}: {line:?}");
        assert!(!line.contains(|c: char| c.is_control() && c != '\t'), "{arguments:?}: {line:?}");
    }
    text
}

/// A VTU file with a particle and an attribute of that name that is not taken.
fn vtu(attribute: &str) -> String {
    format!(
        "<VTKFile type=\"PolyData\"><Piece NumberOfPoints=\"1\"><Points><DataArray type=\"Float32\" NumberOfComponents=\"3\" \
         format=\"ascii\">0 0 0</DataArray></Points><PointData><DataArray type=\"Float32\" NumberOfComponents=\"2\" \
         Name=\"{attribute}\" format=\"ascii\">0 0</DataArray></PointData></Piece></VTKFile>"
    )
}

#[test]
fn names_from_files_command_no_agent_and_steer_no_terminal() {
    let desk = Desk::new();
    desk.write("a.vtu", vtu(&format!("a&#10;{COMMAND}&#13;{COMMAND}&#x2028;{COMMAND}&#x9b;2J")));
    let vtk = "# vtk DataFile Version 4.1\n\nASCII\nDATASET POLYDATA\nPOINTS 1 float\n0 0 0\nPOINT_DATA 1\nFIELD FieldData 1\n";
    desk.write("a.vtk", format!("{vtk}a%0A{}%1B[2J 2 1 float\n0 0\n", COMMAND.replace(' ', "%20")));
    let mut inputs = vec![("a.vtu", "LD_PRELOAD"), ("a.vtk", "LD_PRELOAD")];
    // Windows has no file whose name ends a line.
    if cfg!(unix) {
        let named = format!("p\n{COMMAND}\n\u{1b}[31m_1.xyz");
        desk.write(&named.replace('/', "_"), "0 0 0\n");
        desk.write("q\nopenjd_fail: me_1.xyz", "0 nan 0\n");
        desk.write("q\nopenjd_fail: me_2.xyz", "0 0 x\n");
        inputs.extend([("p*_1.xyz", ""), ("q*_1.xyz", "NaN"), ("q*_#.xyz", "of 2 frames failed")]);
    }
    for style in ["openjd", "plain", "json", "bar"] {
        for &(pattern, words) in &inputs {
            for verb in ["mesh", "volume"] {
                let arguments =
                    [verb, pattern, "--spacing", "0.1", "-o", "out", "--force", "--progress", style];
                let text = printed(&desk, &arguments);
                assert!(text.contains(words) || style == "bar", "{verb} {pattern} {style}: {text}");
            }
        }
        printed(
            &desk,
            &["mesh", &format!("none\n{COMMAND}.xyz"), "--spacing", "0.1", "-o", "out", "--progress", style],
        );
        printed(&desk, &["mesh", "a.vtu", &format!("--none\n{COMMAND}"), "--progress", style]);
        printed(&desk, &["shot", &format!("none\n{COMMAND}\u{1b}[2J.toml"), "--progress", style]);
    }
    let folder = format!("out\n{}", COMMAND.replace('/', "_"));
    printed(&desk, &["mesh", "a.vtu", "--spacing", "0.1", "-o", &folder, "--progress", "openjd"]);
    printed(&desk, &["info", &folder]);
}

#[test]
fn titles_of_received_shots_steer_no_terminal() {
    let desk = Desk::new();
    desk.run("simulate small.toml --frames 1", 0);
    let manifest = desk.path("small/shot.json");
    let text = fs::read_to_string(&manifest).unwrap();
    let title = "\\u001b]0;owned\\u0007\\u001b[2J\\nopenjd_env: LD_PRELOAD=/x\\u202e\\u009b2J";
    assert!(text.contains("Small dam"));
    fs::write(&manifest, text.replace("Small dam", title)).unwrap();
    let described = printed(&desk, &["info", "small"]);
    assert!(described.contains("owned") && described.contains("\\u001b[2J"), "{described}");
    let json = printed(&desk, &["info", "small", "--json"]);
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert!(json.to_string().contains("owned"));
    // Problems of a preset quote its text.
    desk.write(
        "bad.toml",
        SMALL.replace("Small dam", "\u{1b}[2J").replace("iterations", "\"iter\\u001b\\nopenjd_env\""),
    );
    printed(&desk, &["simulate", "bad.toml", "--progress", "openjd"]);
}

/// A gzipped BGEO file of so many points at the origin, which are 16 bytes each.
fn bomb(points: u32) -> Vec<u8> {
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
    encoder.write_all(b"BgeoV").unwrap();
    for word in [5, points, 0, 0, 0, 0, 0, 0, 0] {
        encoder.write_all(&word.to_be_bytes()).unwrap();
    }
    for _ in 0..points / 4096 {
        encoder.write_all(&[0; 16 * 4096]).unwrap();
    }
    encoder.finish().unwrap()
}

#[test]
fn a_compressed_file_is_refused_before_it_takes_more_memory_than_allowed() {
    let desk = Desk::new();
    desk.write("bomb_1.bgeo.gz", bomb(24 << 20));
    desk.write("bomb_2.xyz", "0 0 0\n");
    assert!(fs::metadata(desk.path("bomb_1.bgeo.gz")).unwrap().len() < 1 << 20);
    for verb in ["mesh", "volume"] {
        let (_, talk) =
            desk.run(&format!("{verb} bomb_1.bgeo.gz --spacing 0.1 -o out --max-memory 40MiB"), 33);
        assert!(talk.contains("--max-memory allows 40 MiB"), "{talk}");
        // Both verbs read files alike.
        if verb == "volume" {
            continue;
        }
        let (_, talk) = desk
            .run(&format!("{verb} bomb_1.bgeo.gz bomb_2.xyz --spacing 0.1 -o both --max-memory 40MiB"), 33);
        assert!(talk.contains("1 of 2 frames failed") && talk.contains("bomb_1.bgeo.gz"), "{talk}");
        // Without a limit, it is that of files: content of 384 MiB from a file of less than one.
        let (_, talk) = desk.run(&format!("{verb} bomb_1.bgeo.gz --spacing 0.1 -o out"), 1);
        assert!(talk.contains("at most 128 times the file's length"), "{talk}");
        #[cfg(target_os = "linux")]
        {
            let line = format!("{verb} bomb_1.bgeo.gz --spacing 0.1 -o out --max-memory 40MiB --threads 1");
            let peak = plan::peak(&desk, &line);
            assert!(peak < 100e6, "{verb}: {peak} bytes");
        }
    }
}

/// Puts a frame with `count` particles at the origin and this spacing into the cache of the folder `made`.
fn cached(desk: &Desk, frame: u32, count: usize, spacing: f64) {
    fs::create_dir_all(desk.path("made/cache")).unwrap();
    let stream = Stream::new("liquid", StreamKind::Particles, count);
    let mut stream = stream
        .with("position", vec![Vec3::zeros(); count])
        .with("velocity", vec![Vec3::zeros(); count])
        .with("id", vec![0_u32; count]);
    stream.scalars.push(("spacing".into(), spacing));
    let frame = Frame { index: FrameIndex(frame), time: 0.0, streams: vec![stream] };
    cache::write_frame(&desk.path("made/cache"), &frame, 1).unwrap();
}

#[test]
fn a_frame_of_equal_numbers_is_refused_before_it_takes_more_memory_than_allowed() {
    let desk = Desk::new();
    cached(&desk, 1, 4 << 20, 0.1);
    let path = desk.path("made/cache/frame_0001.mcf");
    assert!(fs::metadata(&path).unwrap().len() < 1 << 20);
    assert_eq!(cache::read_header(&path).unwrap().unpacked_bytes(), 28 * (4 << 20));
    for verb in ["mesh", "volume"] {
        let line = format!("{verb} made -o out --max-memory 60MiB");
        let (_, talk) = desk.run(&line, 33);
        assert!(talk.contains("frame 0001") && talk.contains("needs about 112 MiB"), "{talk}");
        #[cfg(target_os = "linux")]
        {
            let peak = plan::peak(&desk, &line);
            assert!(peak < 60e6, "{verb}: {peak} bytes");
        }
    }
}

/// Adds a stream of `zeros` zeros to a cached frame: its file hardly grows, and key and checksums are right.
fn pad(desk: &Desk, shot: &str, frame: u32, zeros: usize) {
    let folder = desk.path(shot).join("cache");
    let path = cache::frame_path(&folder, FrameIndex(frame));
    let (mut padded, info) = cache::read_frame(&path).unwrap();
    padded.streams.retain(|stream| stream.name != "pad");
    padded.streams.push(Stream::new("pad", StreamKind::Unknown, zeros).with("zero", vec![0_f32; zeros]));
    cache::write_frame(&folder, &padded, info.key).unwrap();
    assert!(fs::metadata(&path).unwrap().len() < info.bytes + (64 << 10));
}

/// Runs the tool with 60 MiB of memory on frames that take 128, and compares what it took.
fn refused_frames(desk: &Desk, line: &str, words: &[&str]) {
    let line = format!("{line} --max-memory 60MiB");
    let (_, talk) = desk.run(&line, 33);
    for words in words.iter().chain(&["needs about 129 MiB of memory, and --max-memory allows"]) {
        assert!(talk.contains(words) || talk.contains(&shown(words)), "{words}: {talk}");
    }
    #[cfg(target_os = "linux")]
    {
        let peak = plan::peak(desk, &line);
        assert!(peak < 100e6, "{line}: {peak} bytes");
    }
}

/// Zeros that take 128 MiB.
const PADDING: usize = 32 << 20;

#[test]
fn a_shot_is_not_resumed_from_a_frame_that_takes_more_memory_than_allowed() {
    let desk = Desk::new();
    desk.run("simulate small.toml --frames 1-2", 0);
    pad(&desk, "small", 2, PADDING);
    refused_frames(&desk, "simulate small.toml --frames 1-3", &["small/cache/frame_0002.mcf"]);
    desk.run("simulate small.toml --frames 1-3 --max-memory 300MiB", 0);
}

#[test]
fn smoke_is_not_retimed_from_frames_that_take_more_memory_than_allowed() {
    let desk = Desk::new();
    desk.write("ring.toml", smoke::RING);
    desk.run("simulate ring.toml --frames 1-3", 0);
    pad(&desk, "ring", 2, PADDING);
    let words = ["frame 0002: ", "ring/cache/frame_0002.mcf", "of 3 frames failed"];
    refused_frames(&desk, "volume ring -o again --retime 1 --force", &words);
    assert_eq!(desk.names("again/volume"), ["smoke_0001.vdb", "smoke_0003.vdb"]);
    // Frames that are in memory together count together.
    pad(&desk, "ring", 2, PADDING / 4);
    pad(&desk, "ring", 3, PADDING / 4);
    desk.run("volume ring -o slow --retime 2 --frames 3 --max-memory 60MiB", 0);
    let (_, talk) = desk.run("volume ring -o slow --retime 2 --frames 4 --max-memory 60MiB", 33);
    assert!(talk.contains(&shown("ring/cache/frame_0003.mcf: this frame needs about 33 MiB")), "{talk}");
}

#[test]
fn point_caches_are_not_made_of_frames_that_take_more_memory_than_allowed() {
    let desk = Desk::new();
    desk.write("cloth.toml", sheets::CLOTH);
    desk.write("flag.obj", sheets::FLAG);
    desk.run("simulate cloth.toml --frames 1-3", 0);
    pad(&desk, "cloth", 2, PADDING);
    let words = ["cloth/cache/frame_0002.mcf", "the nearest frame before it stands in its place"];
    refused_frames(&desk, "shot cloth.toml --frames 1-3", &words);
    let samples = sheets::samples(&desk.path("cloth/sheet/cloth.pc2"));
    assert!(samples.len() == 3 && samples[0] == samples[1] && samples[1] != samples[2]);
}

#[test]
fn sheets_with_positions_that_are_not_finite_are_refused() {
    let desk = Desk::new();
    desk.write("cloth.toml", sheets::CLOTH);
    desk.write("flag.obj", sheets::FLAG);
    desk.run("simulate cloth.toml --frames 1-3", 0);
    let folder = desk.path("cloth/cache");
    let (mut frame, info) = cache::read_frame(&cache::frame_path(&folder, FrameIndex(2))).unwrap();
    for stream in &mut frame.streams {
        let Some(positions) = stream.vec3("position") else { continue };
        let mut positions = positions.to_vec();
        positions[0].x = f32::NAN;
        let mut changed =
            Stream::new(stream.name.clone(), stream.kind, stream.len()).with("position", positions);
        for channel in stream.channels().iter().filter(|channel| channel.name != "position") {
            changed = changed.with(channel.name.clone(), channel.data.clone());
        }
        changed.scalars.clone_from(&stream.scalars);
        *stream = changed;
    }
    cache::write_frame(&folder, &frame, info.key).unwrap();
    let (_, talk) = desk.run("export cloth --format ply", 3);
    assert!(talk.contains("frame 0002") && talk.contains("not finite"), "{talk}");
}

#[test]
fn a_spacing_that_is_none_is_named_with_its_frame_and_stream() {
    let desk = Desk::new();
    cached(&desk, 1, 8, 0.1);
    let wrong = [f64::INFINITY, f64::NAN, 1e300, -0.1, 0.0, 1e-40, 5e-324];
    for (i, spacing) in wrong.into_iter().enumerate() {
        cached(&desk, i as u32 + 2, 8, spacing);
    }
    for verb in ["mesh", "volume"] {
        let (_, talk) = desk.run(&format!("{verb} made -o {verb}"), 3);
        assert!(talk.contains("7 of 8 frames failed"), "{talk}");
        for words in
            ["frame_0002.mcf: stream liquid: found a spacing of inf m", "expected 1e-6 to 1e6 m; simulate"]
        {
            assert!(talk.contains(words) || talk.contains(&shown(words)), "{words}: {talk}");
        }
        assert_eq!(
            desk.names(&format!("{verb}/{verb}")).iter().filter(|name| name.contains("liquid")).count(),
            1
        );
    }
    desk.write("a.xyz", "0 0 0\n");
    for spacing in ["1e-40", "inf", "1e30", "nan", "0"] {
        let (_, talk) = desk.run(&format!("mesh a.xyz --spacing {spacing} -o out"), 2);
        assert!(talk.contains("--spacing") && talk.contains("above 0"), "{talk}");
    }
}

#[test]
fn a_frame_of_more_streams_or_channels_than_there_can_be_is_refused() {
    let desk = Desk::new();
    fs::create_dir_all(desk.path("made/cache")).unwrap();
    let mut stream = Stream::new("liquid", StreamKind::Particles, 0);
    for channel in 0..4097 {
        stream = stream.with(format!("c{channel}"), Vec::<f32>::new());
    }
    let frame = Frame { index: FrameIndex(1), time: 0.0, streams: vec![stream] };
    cache::write_frame(&desk.path("made/cache"), &frame, 1).unwrap();
    let (_, talk) = desk.run("mesh made -o out", 12);
    assert!(talk.contains("number of channels: found 4097, expected at most 4096"), "{talk}");
}

// Windows has no pipes among files.
#[cfg(unix)]
#[test]
fn a_pipe_named_like_a_frame_stops_nothing() {
    let desk = Desk::new();
    cached(&desk, 1, 8, 0.1);
    let pipe = |name: &str| {
        let path = desk.path(name);
        assert!(std::process::Command::new("mkfifo").arg(path).status().unwrap().success());
    };
    pipe("made/cache/frame_0002.mcf");
    pipe("a.xyz");
    desk.run("simulate small.toml --frames 1", 0);
    desk.run("mesh small", 0);
    fs::remove_file(desk.path("small/mesh/liquid_0001.ply")).unwrap();
    pipe("small/mesh/liquid_0001.ply");
    desk.run("mesh small", 0);
    assert!(fs::metadata(desk.path("small/mesh/liquid_0001.ply")).unwrap().is_file());
    pipe("made/preset.toml");
    pipe("pipe.toml");
    for line in ["info made", "mesh made -o out", "shot pipe.toml"] {
        let (_, talk) = desk.run(line, if line.starts_with("info") { 3 } else { 2 });
        let is_explained = talk.contains("it is a pipe or a device") && talk.contains("name a text file");
        assert!(line.starts_with("info") || is_explained, "{line}: {talk}");
    }
    fs::remove_file(desk.path("made/preset.toml")).unwrap();
    for verb in ["mesh", "volume"] {
        let (_, talk) = desk.run(&format!("{verb} made -o out"), 3);
        assert!(talk.contains("frame_0002.mcf") && talk.contains("it is a pipe or a device"), "{talk}");
        let (_, talk) = desk.run(&format!("{verb} a.xyz --spacing 0.1 -o out"), 1);
        assert!(talk.contains("a pipe or a device, expected a file"), "{talk}");
    }
}
