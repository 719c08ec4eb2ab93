//! Each symptom of docs/troubleshooting.md occurs, and its remedy removes it.
//!
//! A section has files, commands that show the symptom, a block of `text` with what is printed, and commands with the remedy. A
//! second block of `text` is what these print, with other figures; without one, no figures are to remain. `…` in such a block stands for anything within a line.

use super::{
    block::{Block, blocks, commands, read},
    reader::Reader,
    write_file,
};

pub(super) const DOCUMENT: &str = "docs/troubleshooting.md";

/// Whether a line has the parts of a pattern in their order.
fn is_match(line: &str, pattern: &str) -> bool {
    let mut rest = line;
    pattern.split('…').map(str::trim).all(|part| match rest.find(part) {
        Some(at) => {
            rest = &rest[at + part.len()..];
            true
        }
        None => false,
    })
}

/// The blocks before the first section, and those of each section by its heading.
fn sections() -> (Vec<Block>, Vec<(String, Vec<Block>)>) {
    let text = read(DOCUMENT);
    let headings =
        text.lines().enumerate().filter_map(|(at, line)| Some((at + 1, line.strip_prefix("### ")?)));
    let mut sections: Vec<(usize, String, Vec<Block>)> =
        headings.map(|(at, heading)| (at, heading.to_owned(), Vec::new())).collect();
    let mut common = Vec::new();
    for block in blocks(&text) {
        match sections.iter_mut().rev().find(|(at, ..)| *at < block.line) {
            Some(section) => section.2.push(block),
            None => common.push(block),
        }
    }
    (common, sections.into_iter().map(|(_, heading, blocks)| (heading, blocks)).collect())
}

/// Runs the commands of a block and returns what they print.
fn printed(reader: &Reader, block: &Block) -> String {
    let run = |command: super::block::Command| {
        reader.expect(&format!("{DOCUMENT}:{}", command.line), &command.text, command.code)
    };
    commands(block).into_iter().map(run).collect()
}

/// Whether a line that has the parts of a pattern is printed.
fn is_printed(printed: &str, pattern: &str) -> bool {
    printed.lines().any(|line| is_match(line, pattern))
}

/// Checks that every line of a block of `text` is printed.
fn check(block: &Block, printed: &str) {
    for pattern in block.text.lines() {
        assert!(
            is_printed(printed, pattern),
            "{DOCUMENT}:{}: not printed: {pattern:?}\n{printed}",
            block.line
        );
    }
}

/// Checks that no line of a block of `text` is printed, with its figures or, if `any_figures`, with others.
fn check_removed(block: &Block, printed: &str, any_figures: bool) {
    for pattern in block.text.lines() {
        let figure = |c: char| if any_figures && c.is_ascii_digit() { '…' } else { c };
        let pattern: String = pattern.chars().map(figure).collect();
        assert!(
            !is_printed(printed, &pattern),
            "{DOCUMENT}:{}: still printed: {pattern:?}\n{printed}",
            block.line
        );
    }
}

/// Shows the symptom of a section, and removes it.
fn reproduce(heading: &str) {
    let (common, sections) = sections();
    let (_, blocks) = sections.iter().find(|(known, _)| known == heading).expect("the section is there");
    let reader = Reader::new();
    let of = |language: &str| blocks.iter().filter(|block| block.language == language).collect::<Vec<_>>();
    let [symptom, remedy]: [&Block; 2] = of("sh").try_into().expect("two blocks of commands");
    let texts = of("text");
    common.iter().for_each(|block| write_file(&reader, block));
    blocks.iter().filter(|block| block.line < symptom.line).for_each(|block| write_file(&reader, block));
    let before = printed(&reader, symptom);
    check(texts[0], &before);
    blocks
        .iter()
        .filter(|block| (symptom.line..remedy.line).contains(&block.line))
        .for_each(|block| write_file(&reader, block));
    let after = printed(&reader, remedy);
    check_removed(texts[0], &after, texts.len() == 1);
    if let Some(text) = texts.get(1) {
        check(text, &after);
    }
    assert!(texts.len() <= 2, "{heading}: {} blocks of text", texts.len());
}

/// A test for each section.
macro_rules! symptoms {
    ($($name:ident: $heading:literal,)*) => {
        $(#[test]
        fn $name() {
            reproduce($heading);
        })*

        const REPRODUCED: &[&str] = &[$($heading),*];
    };
}

symptoms! {
    leaking_wall: "Liquid leaks through a thin wall",
    shrinking: "The liquid shrinks",
    growing: "The liquid grows when it splashes",
    popcorn: "Droplets pop out of a splash like popcorn",
    thin_honey: "Honey spreads like water",
    small_source: "A small source yields nothing",
    blocked_tap: "Nothing comes out of a tap",
    open_mesh: "A collider mesh is refused as open",
    millimetres: "A mesh in millimetres fills the scene",
    up_axis: "A mesh from Blender lies on its side",
    missing_mesh: "A mesh is not found",
    wrong_spacing: "A surface is a few blobs, or full of holes",
    missing_frames: "Frames are missing in the sequence",
    unknown_key: "A key has no effect, or is unknown",
    other_settings: "Exit code 14 after a setting was changed",
    too_little_memory: "There is not enough memory",
    full_disk: "The disk is full",
    two_jobs: "Two jobs run in one folder",
    smoke_at_rest: "Smoke does not rise",
    thin_plate: "Smoke goes through a thin plate",
    stretched_cloth: "Cloth stretches like rubber",
}

#[test]
fn every_symptom_is_reproduced() {
    let headings: Vec<String> = sections().1.into_iter().map(|(heading, _)| heading).collect();
    assert_eq!(headings, REPRODUCED);
    assert!(headings.len() >= 15, "{} symptoms", headings.len());
}

#[test]
fn patterns_match_parts_in_their_order() {
    assert!(is_match("note: volume 0.12 m³ in frame 0004", "volume … m³ in frame …"));
    assert!(!is_match("in frame 0004, volume", "volume … frame"));
}
