//! Same bytes: after a stop, after damage, on any number of threads.

use super::*;

#[test]
fn a_resumed_run_equals_an_uninterrupted_one() {
    let desk = Desk::new();
    desk.run("simulate small.toml -o whole", 0);
    desk.run("simulate small.toml -o parts --frames 1-2", 0);
    desk.run("simulate small.toml -o parts --frames 1-4", 0);
    let (out, talk) = desk.run("simulate small.toml -o parts", 0);
    assert!(
        out.contains("1 frames simulated") && talk.contains("continuing after frame 0004"),
        "{out}{talk}"
    );
    assert_eq!(desk.bytes("whole/cache"), desk.bytes("parts/cache"));
}

#[test]
fn lost_and_damaged_frames_are_made_again_with_the_same_bytes() {
    let desk = Desk::new();
    desk.run("simulate small.toml -o shot", 0);
    let before = desk.bytes("shot/cache");
    fs::remove_file(desk.path("shot/cache/frame_0002.mcf")).unwrap();
    let path = desk.path("shot/cache/frame_0004.mcf");
    let mut damaged = fs::read(&path).unwrap();
    let middle = damaged.len() / 2;
    damaged[middle] ^= 16;
    fs::write(&path, damaged).unwrap();
    let (_, talk) = desk.run("simulate small.toml -o shot --frames 1", 0);
    assert!(talk.contains("frame 0004 is left as it is"), "{talk}");
    let (out, talk) = desk.run("simulate small.toml -o shot", 0);
    assert!(out.contains("2 frames simulated, ") || out.contains("2 frames simulated ("), "{out}");
    assert!(talk.contains("frame 0004 is computed again"), "{talk}");
    assert_eq!(before, desk.bytes("shot/cache"));
}

#[test]
fn one_two_and_three_threads_give_the_same_bytes() {
    let desk = Desk::new();
    for threads in 1..=3 {
        desk.run(&format!("shot small.toml -o t{threads} --threads {threads}"), 0);
    }
    for threads in 2..=3 {
        assert_eq!(desk.bytes("t1/cache"), desk.bytes(&format!("t{threads}/cache")));
        assert_eq!(desk.bytes("t1/mesh"), desk.bytes(&format!("t{threads}/mesh")));
    }
}
