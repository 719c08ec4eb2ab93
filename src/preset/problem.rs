//! What is wrong with a preset, and where.

use std::{io::ErrorKind, ops::Range, path::PathBuf, sync::Arc};

/// Why there is no scene.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SceneError {
    /// No built-in preset has this name.
    #[error("no preset file or built-in preset is called `{name}`")]
    UnknownPreset {
        /// The name as given.
        name: String,
        /// The built-in preset whose name is closest.
        nearest: Option<String>,
    },
    /// The preset file cannot be read.
    #[error("cannot read the preset `{}`: {cause}", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// The error of the system.
        cause: std::io::Error,
        /// A built-in preset that may have been meant.
        nearest: Option<String>,
    },
    /// The preset cannot be simulated as written; every problem found, in order of the text.
    #[error("{}", headline(.0))]
    Invalid(Vec<Problem>),
}

impl SceneError {
    /// The problems with a place in the text; empty if the text could not be had at all.
    pub fn problems(&self) -> &[Problem] {
        match self {
            Self::Invalid(problems) => problems,
            Self::UnknownPreset { .. } | Self::Unreadable { .. } => &[],
        }
    }
}

fn headline(problems: &[Problem]) -> String {
    match problems {
        [problem] => problem.message.clone(),
        _ => format!("{} problems in the preset", problems.len()),
    }
}

/// One mistake in a preset or in a `--set` argument.
#[derive(Clone, Debug, thiserror::Error)]
#[error("{message}")]
pub struct Problem {
    /// What is wrong, in one sentence.
    pub message: String,
    /// The dotted key that is concerned ("liquid.source.0.velocity"); empty for the preset as a whole.
    pub key: String,
    /// Where the text came from: the preset's name, `--set` or `--quality`.
    pub file: String,
    /// Line of the text, from 1.
    pub line: usize,
    /// Column of the line in characters, from 1.
    pub column: usize,
    /// What was found, and what was expected there.
    pub label: String,
    /// The next step to take.
    pub help: Option<String>,
    /// The valid word that the one found resembles most.
    pub nearest: Option<String>,
    text: Arc<str>,
    bytes: Range<usize>,
}

impl Problem {
    /// The whole text that the mistake is in, and its bytes there.
    pub fn source(&self) -> (&str, Range<usize>) {
        (&self.text, self.bytes.clone())
    }
}

impl SceneError {
    /// The next step to take, where a preset could not be read at all; a [`Problem`] has its own.
    pub fn help(&self) -> Option<String> {
        let names = || {
            super::builtin::all().iter().map(|(name, _)| format!("`{name}`")).collect::<Vec<_>>().join(", ")
        };
        match self {
            Self::UnknownPreset { nearest, .. } => {
                let meant =
                    nearest.as_ref().map(|name| format!("did you mean `{name}`? ")).unwrap_or_default();
                Some(format!("{meant}built-in presets: {}; a file's name ends in .toml", names()))
            }
            Self::Unreadable { nearest: Some(name), .. } => {
                Some(format!("`{name}` is a built-in preset: give its name alone, without a path or .toml"))
            }
            Self::Unreadable { cause, .. } if cause.kind() == ErrorKind::NotFound => {
                Some(format!("built-in presets: {}", names()))
            }
            Self::Unreadable { .. } => Some(
                "name a text file that this user may read, or a built-in preset; `meniscus presets` lists them".into(),
            ),
            Self::Invalid(_) => None,
        }
    }
}

/// A text that a preset is put together from: the preset itself, or an argument of the command line.
#[derive(Clone, Debug)]
pub(crate) struct Source {
    /// Name in messages.
    pub(crate) name: String,
    /// The whole text.
    pub(crate) text: Arc<str>,
}

/// Some bytes of one of the sources.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(crate) struct Span {
    /// Index of the source.
    pub(crate) source: usize,
    /// First byte.
    pub(crate) start: usize,
    /// One past the last byte.
    pub(crate) end: usize,
}

/// A problem before its place is looked up in the text.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Finding {
    pub(crate) span: Span,
    pub(crate) key: String,
    pub(crate) message: String,
    pub(crate) label: String,
    pub(crate) help: Option<String>,
    pub(crate) nearest: Option<String>,
}

impl Finding {
    /// A finding without advice.
    pub(crate) fn new(
        span: Span,
        key: impl Into<String>,
        message: impl Into<String>,
        label: impl Into<String>,
    ) -> Self {
        Self {
            span,
            key: key.into(),
            message: message.into(),
            label: label.into(),
            help: None,
            nearest: None,
        }
    }

    /// Adds the next step to take.
    pub(crate) fn with_help(mut self, help: impl Into<String>) -> Self {
        self.help = Some(help.into());
        self
    }
}

/// Problems that are reported one by one; the others are counted. Each is looked up in the text and shown with its line.
const MAX_PROBLEMS: usize = 100;

/// The findings as problems with line and column, in order of the text, each once.
pub(crate) fn locate(mut findings: Vec<Finding>, sources: &[Source]) -> Vec<Problem> {
    findings.sort_by_key(|finding| finding.span);
    findings.dedup();
    let unlisted = findings.len().saturating_sub(MAX_PROBLEMS);
    if unlisted > 0 {
        let span = findings[MAX_PROBLEMS].span;
        findings.truncate(MAX_PROBLEMS);
        let message = format!("{unlisted} more problems are not listed");
        let next = Finding::new(span, "", message, "the next one is here");
        findings.push(next.with_help("fix the problems above first"));
    }
    findings.into_iter().map(|finding| place(finding, sources)).collect()
}

fn place(finding: Finding, sources: &[Source]) -> Problem {
    let Finding { span, key, message, label, help, nearest } = finding;
    let source = &sources[span.source];
    let before = &source.text[..span.start];
    let line_start = before.rfind('\n').map_or(0, |newline| newline + 1);
    Problem {
        message,
        key,
        file: source.name.clone(),
        line: before.matches('\n').count() + 1,
        column: before[line_start..].chars().count() + 1,
        label,
        help,
        nearest,
        text: source.text.clone(),
        bytes: span.start..span.end,
    }
}
