//! Files that someone made to do harm: they put no command into the output.

use super::*;

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
    let named = format!("p\n{COMMAND}\n\u{1b}[31m_1.xyz");
    desk.write(&named.replace('/', "_"), "0 0 0\n");
    desk.write("q\nopenjd_fail: me_1.xyz", "0 nan 0\n");
    desk.write("q\nopenjd_fail: me_2.xyz", "0 0 x\n");
    for style in ["openjd", "plain", "json", "bar"] {
        for (pattern, words) in [
            ("a.vtu", "LD_PRELOAD"),
            ("a.vtk", "LD_PRELOAD"),
            ("p*_1.xyz", ""),
            ("q*_1.xyz", "NaN"),
            ("q*_#.xyz", "of 2 frames failed"),
        ] {
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
