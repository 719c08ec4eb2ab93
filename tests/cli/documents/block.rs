//! Blocks of code and inline commands of Markdown documents.

use std::{
    fs,
    path::{Path, PathBuf},
};

/// A fenced block of code.
#[derive(Debug)]
pub(super) struct Block {
    /// Its first line in the document, from 1.
    pub(super) line: usize,
    /// What follows the opening fence.
    pub(super) language: String,
    pub(super) text: String,
}

/// A command of a shell, with its place.
#[derive(Clone, Debug)]
pub(super) struct Command {
    pub(super) line: usize,
    /// As typed, without comments. Commands that run in the background are together with the next one.
    pub(super) text: String,
    /// The exit code that a comment `# exit code N` announces, else 0.
    pub(super) code: i32,
}

/// The folder of the repository.
pub(super) fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// README.md and every document below docs/, relative to the repository, sorted.
pub(super) fn documents() -> Vec<String> {
    let mut found = vec![PathBuf::from("README.md")];
    let mut folders = vec![PathBuf::from("docs")];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(root().join(&folder)).unwrap() {
            let entry = entry.unwrap();
            let path = folder.join(entry.file_name());
            if entry.file_type().unwrap().is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|end| end == "md") {
                found.push(path);
            }
        }
    }
    let mut found: Vec<String> = found.iter().map(|path| path.to_str().unwrap().replace('\\', "/")).collect();
    found.sort();
    found
}

pub(super) fn read(document: &str) -> String {
    fs::read_to_string(root().join(document)).unwrap_or_else(|why| panic!("{document}: {why}"))
}

/// The fenced blocks of a document, in its order.
pub(super) fn blocks(text: &str) -> Vec<Block> {
    let mut found: Vec<Block> = Vec::new();
    let mut is_open = false;
    for (number, line) in (1..).zip(text.lines()) {
        match (line.strip_prefix("```"), is_open) {
            (Some(language), false) => {
                let language = language.trim().to_owned();
                found.push(Block { line: number, language, text: String::new() });
                is_open = true;
            }
            (Some(_), true) => is_open = false,
            (None, true) => {
                let block = found.last_mut().expect("it is open");
                block.text.push_str(line);
                block.text.push('\n');
            }
            (None, false) => {}
        }
    }
    assert!(!is_open, "the last block has no end");
    found
}

/// The commands of a block of `sh`.
pub(super) fn commands(block: &Block) -> Vec<Command> {
    let mut found: Vec<Command> = Vec::new();
    let mut goes_on = false;
    for (number, line) in (block.line + 1..).zip(block.text.lines()) {
        let (text, comment) = without_comment(line);
        let text = text.trim();
        if text.is_empty() {
            continue;
        }
        let code = comment.and_then(|comment| comment.strip_prefix("exit code "));
        let code = code.map_or(0, |rest| {
            let digits: String = rest.chars().take_while(char::is_ascii_digit).collect();
            digits.parse().unwrap_or_else(|_| panic!("line {number}: {line}: no number"))
        });
        if goes_on {
            let last = found.last_mut().expect("a command is before it");
            last.text.push('\n');
            last.text.push_str(text);
            last.code = code;
        } else {
            found.push(Command { line: number, text: text.into(), code });
        }
        goes_on = text.ends_with('\\') || (text.ends_with('&') && !text.ends_with("&&"));
    }
    found
}

/// A line up to its comment, and the comment.
fn without_comment(line: &str) -> (&str, Option<&str>) {
    let mut quote = None;
    let mut before = ' ';
    for (at, character) in line.char_indices() {
        match quote {
            Some(open) if open == character => quote = None,
            Some(_) => {}
            None if character == '#' && before.is_whitespace() => {
                return (&line[..at], Some(line[at + 1..].trim()));
            }
            None if matches!(character, '\'' | '"') => quote = Some(character),
            None => {}
        }
        before = character;
    }
    (line, None)
}

/// What is between backticks outside of blocks and begins with `meniscus `, with its line.
pub(super) fn inline_commands(text: &str) -> Vec<(usize, String)> {
    let mut found = Vec::new();
    let mut is_open = false;
    for (number, line) in (1..).zip(text.lines()) {
        if line.starts_with("```") {
            is_open = !is_open;
        } else if !is_open {
            let spans = line.split('`').skip(1).step_by(2);
            found.extend(
                spans.filter(|span| span.starts_with("meniscus ")).map(|span| (number, span.to_owned())),
            );
        }
    }
    found
}

/// The words of a command; quotes join them.
pub(super) fn words(command: &str) -> Vec<String> {
    let mut words: Vec<String> = Vec::new();
    let (mut quote, mut is_in_word) = (None, false);
    for character in command.chars() {
        match quote {
            Some(open) if open == character => quote = None,
            None if matches!(character, '\'' | '"') => {
                quote = Some(character);
                if !is_in_word {
                    words.push(String::new());
                }
                is_in_word = true;
            }
            None if character.is_whitespace() => is_in_word = false,
            _ => {
                if !is_in_word {
                    words.push(String::new());
                }
                is_in_word = true;
                words.last_mut().expect("a word is open").push(character);
            }
        }
    }
    words
}

#[test]
fn blocks_commands_and_comments_are_distinguished() {
    let text = "a `meniscus info x` b\n\n```sh\n# what\nmeniscus a 'b # c' \"d e\"   # exit code 14: why\none &\ntwo\n```\n";
    let [block] = &blocks(text)[..] else { panic!("one block") };
    assert_eq!((block.line, block.language.as_str()), (3, "sh"));
    let [first, second] = &commands(block)[..] else { panic!("two commands: {:?}", commands(block)) };
    assert_eq!((first.line, first.text.as_str(), first.code), (5, "meniscus a 'b # c' \"d e\"", 14));
    assert_eq!((second.line, second.text.as_str(), second.code), (6, "one &\ntwo", 0));
    assert_eq!(words(&first.text), ["meniscus", "a", "b # c", "d e"]);
    assert_eq!(inline_commands(text), [(1, "meniscus info x".to_owned())]);
}
