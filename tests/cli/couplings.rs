//! Shots whose systems feel each other.

use super::*;

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
fn a_coupled_shot_tells_what_passed_between() {
    let desk = Desk::new();
    desk.write("small.toml", small("", ""));
    let passes = desk.run("shot small.toml --dry-run", 0).0;
    assert!(passes.contains("coupling_search, coupling"), "{passes}");
    let plan = desk.run("plan small.toml", 0).0;
    assert!(plan.contains("81, of sheets"), "{plan}");
    desk.run("simulate small.toml -o small", 0);
    let text = fs::read_to_string(desk.path("small/log.jsonl")).unwrap();
    let lines: Vec<serde_json::Value> =
        text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(lines.len(), 11);
    assert!(lines.iter().all(|line| line["coupling"]["liquid"]["crossed"] == 0), "{text}");
    assert!(lines.iter().any(|line| line["coupling"]["liquid"]["contacts"].as_u64() > Some(0)), "{text}");

    desk.write("alone.toml", small("[[coupling]]\nbetween = [\"liquid\", \"cloth\"]\nfriction = 0.2\n", ""));
    assert!(!desk.run("shot alone.toml --dry-run", 0).0.contains("coupling"));
}

#[test]
fn mistakes_about_couplings_are_shown_in_their_place() {
    let desk = Desk::new();
    for (to, told) in [
        ("[\"liquid\", \"cloths\"]", "did you mean \"cloth\"?"),
        ("[\"smoke\", \"cloth\"]", "add a `[smoke]`"),
        ("[\"cloth\", \"cloth\"]", "cannot be coupled"),
        ("[\"liquid\", \"cloth\"]\ndrag = {}", "coupling.0.drag"),
        (
            "[\"liquid\", \"cloth\"]\n[[coupling]]\nbetween = [\"cloth\", \"liquid\"]",
            "are coupled by `coupling.0` already",
        ),
        ("[\"liquid\"]", "a list of 2"),
    ] {
        desk.write("wrong.toml", small("[\"liquid\", \"cloth\"]", to));
        let talk = desk.run("simulate wrong.toml -o wrong", 2).1;
        assert!(talk.contains(told), "{to}: {talk}");
    }
}
