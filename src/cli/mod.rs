//! The command line: clap types in `args.rs`, one file a verb. Results go to stdout, talk to stderr.

mod args;
mod exit;
mod export;
mod info;
mod interrupt;
mod mesh;
mod plan;
mod presets;
mod progress;
mod shot;
mod tradeoff;
mod volume;

use crate::{
    par,
    run::{Control, RunError},
};
use args::{Cli, ProgressStyle, Verb};
use clap::Parser;
use std::process::ExitCode;

/// Runs the command line and returns the exit code.
pub fn main() -> ExitCode {
    let cli = Cli::parse();
    interrupt::listen();
    let reporter = progress::reporter(cli.progress);
    let control = Control { reporter: &*reporter, interrupted: &interrupt::interrupted };
    let verb = cli.verb;
    let outcome = par::with_threads(cli.threads, || match &verb {
        Verb::Shot(args) => shot::shot(args, control),
        Verb::Simulate(args) => shot::simulate(args, control),
        Verb::Plan(args) => plan::plan(args, control),
        Verb::Tradeoff(args) => tradeoff::tradeoff(args, control),
        Verb::Mesh(args) => mesh::mesh(args, control),
        Verb::Volume(args) => volume::volume(args, control),
        Verb::Export(args) => export::export(args, control),
        Verb::Info(args) => info::info(args, false),
        Verb::Verify(args) => info::info(args, true),
        Verb::Presets(args) => presets::presets(args),
    });
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(why) => {
            reporter.stop();
            tell(&why, cli.progress);
            exit::code(&why)
        }
    }
}

/// Says something on stderr; if nobody reads it any more, the job goes on untold.
fn say(text: &str) {
    use std::io::Write;
    let _ = writeln!(std::io::stderr(), "{text}");
}

/// Says on stderr why a job stopped, in the form that progress has; problems of a preset are shown in its text.
fn tell(why: &RunError, style: ProgressStyle) {
    match style {
        ProgressStyle::Json => {
            let data = serde_json::json!({ "text": why.to_string() });
            return say(&serde_json::json!({ "event": "error", "data": data }).to_string());
        }
        ProgressStyle::Openjd => progress::open_jd(&format!("openjd_fail: {}", one_line(&why.to_string()))),
        _ => {}
    }
    match why {
        RunError::Scene(scene) => say(&diagnostic(scene)),
        RunError::Interrupted => say(&why.to_string()),
        other => say(&format!("error: {other}")),
    }
}

fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// A preset's problems with the lines they are on, plain where colours or line art are not wanted.
fn diagnostic(problem: &dyn miette::Diagnostic) -> String {
    use std::io::IsTerminal;
    let fancy = std::io::stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none();
    let theme = if fancy {
        miette::GraphicalTheme::unicode()
    } else {
        miette::GraphicalTheme {
            characters: miette::ThemeCharacters::ascii(),
            styles: miette::ThemeStyles::none(),
        }
    };
    let mut text = String::new();
    let shown =
        miette::GraphicalReportHandler::new_themed(theme).with_links(false).render_report(&mut text, problem);
    match shown {
        Ok(()) => text,
        Err(_) => problem.to_string(),
    }
}

/// Prints a result; a reader that went away (`meniscus info … | head`) is no failure.
fn print(text: &str) -> Result<(), RunError> {
    use std::io::{ErrorKind, Write};
    match writeln!(std::io::stdout(), "{}", text.trim_end()) {
        Err(source) if source.kind() != ErrorKind::BrokenPipe => Err(RunError::File {
            path: "standard output".into(),
            source,
            next: "send it to a place that can be written; what the job made is kept",
        }),
        _ => Ok(()),
    }
}
