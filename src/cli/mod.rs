//! The command line: clap types in `args.rs`, one file a verb. Results go to stdout, talk to stderr.

mod allocator;
mod args;
mod bounds;
mod colliders;
mod doctor;
mod examples;
mod exit;
mod export;
mod farm;
mod info;
mod interrupt;
mod live;
mod mesh;
mod output;
mod plan;
mod presets;
mod preview;
mod product;
mod product_args;
mod progress;
mod reference;
mod shot;
mod shot_inputs;
mod tradeoff;
mod usd;
mod values;
mod volume;
mod wedge;
mod whitewater;

#[cfg(any(test, feature = "fuzzing"))]
pub(crate) use output::diagnostic;

use crate::{
    par,
    run::{Control, RunError},
};
pub use allocator::Allocator;
use args::{Cli, Verb};
use clap::FromArgMatches;
use std::{process::ExitCode, time::Duration};

/// Runs the command line and returns the exit code.
pub fn main() -> ExitCode {
    let parsed = args::command().try_get_matches().and_then(|matches| Cli::from_arg_matches(&matches));
    let cli = match parsed {
        Ok(cli) => cli,
        Err(why) => return output::report_usage(&why.format(&mut args::command())),
    };
    let cancel = interrupt::listen();
    let reporter = progress::reporter(cli.progress);
    let control =
        Control { reporter: &*reporter, cancel: &cancel, wait: Duration::from_secs(cli.wait.into()) };
    let verb = cli.verb;
    let outcome = par::try_with_threads(cli.threads.into(), || match &verb {
        Verb::Shot(args) => shot::shot(args, control),
        Verb::Simulate(args) => shot::simulate(args, control),
        Verb::Plan(args) => plan::plan(args, control),
        Verb::Tradeoff(args) => tradeoff::tradeoff(args, control),
        Verb::Mesh(args) => mesh::mesh(args, control),
        Verb::Volume(args) => volume::volume(args, control),
        Verb::Whitewater(args) => whitewater::whitewater(args, control),
        Verb::Export(args) => export::export(args, control),
        Verb::Colliders(args) => colliders::colliders(args, control),
        Verb::Usd(args) => usd::usd(args, control),
        Verb::Farm(args) => farm::farm(args, cli.threads, control),
        Verb::Preview(args) => preview::preview(args, control),
        Verb::Wedge(args) => wedge::wedge(args, control),
        Verb::Info(args) => info::info(args),
        Verb::Verify(args) => info::verify(args),
        Verb::Presets(args) => presets::presets(args),
        Verb::Doctor(args) => doctor::doctor(args),
        Verb::Completions(args) => reference::completions(args),
        Verb::Man(args) => reference::man(args),
    });
    let outcome = outcome.unwrap_or_else(|why| {
        let threads = if cli.threads == 0 { "a thread for every core".into() } else { format!("{} threads", cli.threads) };
        Err(RunError::Request(format!(
            "the system refused to start {threads} ({why}); allow more processes (`ulimit -u`) or memory (`ulimit -v`), or lower --threads"
        )))
    });
    match outcome.and_then(|()| output::unprinted().map_or(Ok(()), Err)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(why) => {
            reporter.stop();
            output::report_error(&why, cli.progress);
            exit::code(&why)
        }
    }
}
