//! What the command line prints: results on stdout, reports and errors on stderr.

use super::args::ProgressStyle;
use crate::{preset::SceneError, run::RunError, sim::ElementCount};
use annotate_snippets::{AnnotationKind, Group, Level, Renderer, Snippet};
use std::{io, sync::OnceLock};

/// Prints a line on stderr; write errors on a closed stderr are ignored.
pub(super) fn print_line(text: &str) {
    use std::io::Write;
    let _ = writeln!(std::io::stderr(), "{text}");
}

/// Reports on stderr why a job stopped, in the style of its progress; problems of a preset are shown in its text.
pub(super) fn report_error(why: &RunError, style: ProgressStyle) {
    match style {
        ProgressStyle::Json => {
            let data = serde_json::json!({ "text": why.to_string() });
            return print_line(&serde_json::json!({ "event": "error", "data": data }).to_string());
        }
        ProgressStyle::Openjd => open_jd(&format!("openjd_fail: {}", one_line(&why.to_string()))),
        _ => {}
    }
    match why {
        RunError::Scene(scene) => print_line(&diagnostic(scene)),
        RunError::Interrupted => print_line(&why.to_string()),
        other => print_line(&format!("error: {other}")),
    }
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
    use std::io::IsTerminal;
    let fancy = std::io::stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none();
    let renderer = if fancy { Renderer::styled() } else { Renderer::plain() };
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
    use std::io::Write;
    if let Err(why) = writeln!(io::stdout(), "{}", text.trim_end())
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

/// Prints a line for the render farm's agent; write errors on a closed stdout are ignored.
pub(super) fn open_jd(line: &str) {
    use std::io::Write;
    let _ = writeln!(std::io::stdout(), "{line}");
}
