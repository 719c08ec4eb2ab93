//! What the command line prints: results on stdout, reports and errors on stderr.

use super::args::ProgressStyle;
use crate::{
    control::{escape_into, printable},
    preset::{Problem, SceneError},
    run::RunError,
    sim::ElementCount,
};
use annotate_snippets::{AnnotationKind, Group, Level, Renderer, Snippet};
use std::{collections::BTreeSet, io, process::ExitCode, sync::OnceLock};

/// Prints a line on stderr; write errors on a closed stderr are ignored.
pub(super) fn print_line(text: &str) {
    write_line(&escaped(text, false));
}

fn write_line(text: &str) {
    use std::io::Write;
    let _ = writeln!(std::io::stderr(), "{text}");
}

/// The beginning of a line that an agent of Open Job Description obeys, on stdout and on stderr.
const AGENT_COMMAND: &str = "openjd_";

/// `text`, into which names and titles from files may have been put, as it can be printed: no character steers the terminal
/// (colours only, if `keeps_colours`), and no line is a command to the agent of a render farm.
fn escaped(text: &str, keeps_colours: bool) -> String {
    let mut out = String::with_capacity(text.len());
    for (number, line) in text.split('\n').enumerate() {
        if number > 0 {
            out.push('\n');
        }
        if line.get(..AGENT_COMMAND.len()).is_some_and(|start| start.eq_ignore_ascii_case(AGENT_COMMAND)) {
            out.push('\\');
        }
        // A text of the user's may have the line ends of Windows.
        let line = line.strip_suffix('\r').unwrap_or(line);
        for (at, character) in line.char_indices() {
            match character {
                '\t' => out.push('\t'),
                '\u{1b}' if keeps_colours && is_colour(&line[at + 1..]) => out.push(character),
                other => escape_into(&mut out, other),
            }
        }
    }
    out
}

/// Whether what follows an escape character sets colours: `[`, numbers, `m`.
fn is_colour(rest: &str) -> bool {
    let numbers =
        rest.strip_prefix('[').map(|rest| rest.trim_start_matches(|c: char| c.is_ascii_digit() || c == ';'));
    numbers.is_some_and(|rest| rest.starts_with('m'))
}

/// Reports what is wrong with the command line, or prints the help that it requests; returns the exit code.
pub(super) fn report_usage(why: &clap::Error) -> ExitCode {
    if why.use_stderr() {
        let text = why.render();
        let colours = wants_colours();
        let text = if colours { text.ansi().to_string() } else { text.to_string() };
        write_line(escaped(&text, colours).trim_end());
    } else {
        // A reader of the help that went away is no failure.
        let _ = why.print();
    }
    u8::try_from(why.exit_code()).map_or(ExitCode::FAILURE, ExitCode::from)
}

/// Whether stderr is a terminal that can move its cursor.
pub(super) fn is_terminal() -> bool {
    use std::io::IsTerminal;
    std::io::stderr().is_terminal() && std::env::var_os("TERM").is_none_or(|name| name != "dumb")
}

/// Whether messages have colours: <https://no-color.org> may refuse them.
pub(super) fn wants_colours() -> bool {
    is_terminal() && std::env::var_os("NO_COLOR").is_none_or(|value| value.is_empty())
}

/// Reports on stderr why a job stopped, in the style of its progress; problems of a preset are shown in its text.
pub(super) fn report_error(why: &RunError, style: ProgressStyle) {
    match style {
        ProgressStyle::Json => {
            let mut data = serde_json::json!({ "text": why.to_string() });
            if let RunError::Scene(scene) = why {
                data["problems"] = scene.problems().iter().map(problem_json).collect();
                data["help"] = scene.help().into();
            }
            return print_line(&serde_json::json!({ "event": "error", "data": data }).to_string());
        }
        ProgressStyle::Openjd => open_jd("fail", &why.to_string()),
        _ => {}
    }
    match why {
        RunError::Scene(scene) => write_line(&escaped(&diagnostic(scene), wants_colours())),
        RunError::Interrupted => print_line(&why.to_string()),
        other => print_line(&format!("error: {other}")),
    }
    if let RunError::ShotsFailed { failed, .. } = why {
        let diagnostics = failed.iter().filter_map(|(_, why)| match why {
            RunError::Scene(scene) => Some(escaped(&diagnostic(scene), wants_colours())),
            _ => None,
        });
        // Arguments that no shot takes are wrong in the same manner in all of them.
        diagnostics.collect::<BTreeSet<_>>().iter().for_each(|text| write_line(text));
    }
}

/// A problem of a preset with its place, what was found there, and the next step.
fn problem_json(problem: &Problem) -> serde_json::Value {
    let Problem { message, key, file, line, column, label, help, nearest, .. } = problem;
    serde_json::json!({
        "message": message, "key": key, "file": file, "line": line, "column": column, "label": label, "help": help,
        "nearest": nearest,
    })
}

/// The numbers of a system's elements.
pub(super) fn counts(counts: &[ElementCount]) -> String {
    let count = |count: &ElementCount| match count {
        ElementCount { name, start, end, .. } if start == end => format!("{start:.0} {name}"),
        ElementCount { name, start, end, .. } => {
            format!("{start:.0} {name} at the start, about {end:.0} at the end")
        }
    };
    counts.iter().map(count).collect::<Vec<_>>().join("; ")
}

fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Why there is no scene: every problem with the line it is in, plain where colours are not wanted.
pub(crate) fn diagnostic(error: &SceneError) -> String {
    let renderer = if wants_colours() { Renderer::styled() } else { Renderer::plain() };
    let mut blocks = Vec::new();
    if error.problems().len() > 1 {
        let title = error.to_string();
        blocks.push(renderer.render(&[Group::with_title(Level::ERROR.primary_title(&title))]));
    }
    for problem in error.problems() {
        let (text, bytes) = problem.source();
        let place = AnnotationKind::Primary.span(bytes).label(&problem.label);
        let snippet = Snippet::source(text).path(&problem.file).annotation(place);
        let mut group = Level::ERROR.primary_title(&problem.message).element(snippet);
        group = group.elements(problem.help.iter().map(|help| Level::HELP.message(help)));
        blocks.push(renderer.render(&[group]));
    }
    if blocks.is_empty() {
        let (title, help) = (error.to_string(), error.help());
        let group = Level::ERROR.primary_title(&title);
        let group = Group::with_title(group).elements(help.iter().map(|help| Level::HELP.message(help)));
        blocks.push(renderer.render(&[group]));
    }
    blocks.join("\n\n")
}

/// Why standard output could not be written, the first time.
static UNPRINTED: OnceLock<io::Error> = OnceLock::new();

/// Prints a result. A full disk behind standard output does not end a job, which may be of a whole night: it fails at its end
/// ([`unprinted`]). A reader that went away (`meniscus info … | head`) is no failure.
pub(super) fn print(text: &str) {
    print_verbatim(format!("{}\n", escaped(text.trim_end(), false)).as_bytes());
}

/// As [`print`], for what other programs read, into which nothing of a file has been put.
pub(super) fn print_verbatim(bytes: &[u8]) {
    use std::io::Write;
    if let Err(why) = io::stdout().write_all(bytes)
        && why.kind() != io::ErrorKind::BrokenPipe
    {
        let _ = UNPRINTED.set(why);
    }
}

/// Prints the text of a picture, whose control characters the terminal is to obey. Nothing that comes from files is in it.
pub(super) fn print_picture(text: &str) {
    use std::io::Write;
    if let Err(why) = io::stdout().write_all(text.as_bytes())
        && why.kind() != io::ErrorKind::BrokenPipe
    {
        let _ = UNPRINTED.set(why);
    }
}

/// The error of a job whose results could not all be printed.
pub(super) fn unprinted() -> Option<RunError> {
    let why = UNPRINTED.get()?;
    Some(RunError::File {
        path: "standard output".into(),
        source: io::Error::new(why.kind(), why.to_string()),
        next: "send it to a place that can be written; what the job made is kept",
    })
}

/// Prints a line for the render farm's agent: a command and its text, of which line ends become spaces. Write errors on a closed
/// stdout are ignored.
pub(super) fn open_jd(command: &str, text: &str) {
    use std::io::Write;
    let _ = writeln!(std::io::stdout(), "{AGENT_COMMAND}{command}: {}", printable(&one_line(text)));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_line_from_a_file_commands_an_agent_or_steers_a_terminal() {
        let text = "a\nopenjd_env: X=/x\r\n\u{1b}]0;t\u{7}b\tc\u{85}OpenJD_fail: d\nOPENJD_fail: e";
        let expected = "a\n\\openjd_env: X=/x\n\\u001b]0;t\\u0007b\tc\\u0085OpenJD_fail: d\n\\OPENJD_fail: e";
        assert_eq!(escaped(text, false), expected);
        assert_eq!(escaped("\u{1b}[1;31mred\u{1b}[2J\u{1b}", true), "\u{1b}[1;31mred\\u001b[2J\\u001b");
        let json = serde_json::json!({ "title": "a\u{202e}\u{9b}\nb" });
        let printed: serde_json::Value = serde_json::from_str(&escaped(&json.to_string(), false)).unwrap();
        assert_eq!(printed, json, "the escapes are those of JSON");
    }
}
