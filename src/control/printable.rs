//! Text from files, and names of files, made safe for terminals and logs.

use std::{borrow::Cow, fmt::Write, path::Path};

/// `text` with every character escaped that would end its line, steer a terminal or change the direction of what follows.
///
/// The escapes are those of JSON: in a JSON text, where such characters stand in strings only, they mean the same.
pub(crate) fn printable(text: &str) -> Cow<'_, str> {
    if !text.contains(is_control) {
        return Cow::Borrowed(text);
    }
    let mut escaped = String::with_capacity(text.len() + 8);
    text.chars().for_each(|character| escape_into(&mut escaped, character));
    Cow::Owned(escaped)
}

/// A path for a message, in one line, with the system's separators alone.
pub(crate) fn printable_path(path: &Path) -> String {
    let text = path.to_string_lossy();
    // Windows takes both.
    let text = if cfg!(windows) { text.replace('/', "\\") } else { text.into_owned() };
    printable(&text).into_owned()
}

/// An argument as the system's shell takes it, in quotes where it needs them: sh, and on Windows cmd.
pub(crate) fn shell_word(text: &str) -> String {
    quoted(text, cfg!(windows))
}

fn quoted(text: &str, is_windows: bool) -> String {
    let plain = if is_windows { "._=%+-/\\:" } else { "._=%+-/" };
    if !text.is_empty() && text.chars().all(|c| c.is_ascii_alphanumeric() || plain.contains(c)) {
        text.into()
    } else if is_windows {
        // Programs there take backslashes before a quotation mark in pairs.
        let inner = text.replace('"', "\\\"");
        let last = inner.len() - inner.trim_end_matches('\\').len();
        format!("\"{inner}{}\"", "\\".repeat(last))
    } else {
        format!("'{}'", text.replace('\'', "'\\''"))
    }
}

/// A path as the system's shells take it, printable.
pub(crate) fn shell_path(path: &Path) -> String {
    shell_word(&printable_path(path))
}

/// Appends `character`, escaped if it needs to be.
pub(crate) fn escape_into(out: &mut String, character: char) {
    match character {
        '\n' => out.push_str("\\n"),
        '\r' => out.push_str("\\r"),
        '\t' => out.push_str("\\t"),
        control if is_control(control) => {
            // All of them have 16 bits.
            let _ = write!(out, "\\u{:04x}", u32::from(control));
        }
        other => out.push(other),
    }
}

/// Control characters (C0, DEL, C1), line and paragraph separators, and marks that change the direction of text.
fn is_control(character: char) -> bool {
    character.is_control()
        || matches!(character, '\u{2028}' | '\u{2029}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arguments_survive_a_shell() {
        for is_windows in [false, true] {
            assert_eq!(quoted("liquid.density_dev=0.3%", is_windows), "liquid.density_dev=0.3%");
        }
        let words = ["a=[0, 1]", "a=it's", "", r"C:\shots", r"C:\my shots\", "a=\"b\""];
        let expected = ["'a=[0, 1]'", r"'a=it'\''s'", "''", r"'C:\shots'", r"'C:\my shots\'", "'a=\"b\"'"];
        assert_eq!(words.map(|word| quoted(word, false)), expected);
        let expected =
            ["\"a=[0, 1]\"", "\"a=it's\"", "\"\"", r"C:\shots", r#""C:\my shots\\""#, r#""a=\"b\"""#];
        assert_eq!(words.map(|word| quoted(word, true)), expected);
    }

    #[test]
    fn control_characters_are_escaped_and_letters_of_any_script_are_not() {
        let text = "a\n\r\t\u{1b}[31m\u{7f}\u{85}\u{9b}\u{2028}\u{202e}\u{2069}é水\u{200d}";
        let expected = "a\\n\\r\\t\\u001b[31m\\u007f\\u0085\\u009b\\u2028\\u202e\\u2069é水\u{200d}";
        assert_eq!(printable(text), expected);
        assert!(matches!(printable("é水 b"), Cow::Borrowed(_)));
        assert_eq!(printable_path(Path::new("a\nb.ply")), "a\\nb.ply");
    }
}
