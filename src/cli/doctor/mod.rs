//! `meniscus doctor`: what this machine has, and what of it will slow down or stop a job.

mod folder;
mod machine;
mod problem;

use super::{
    args::DoctorArgs,
    output::{print, wants_colours},
};
use crate::{cache, run::RunError, sim};
use folder::Folder;
use machine::{Limits, Memory, Processor};
use problem::Problem;
use serde::Serialize;
use std::{io, io::IsTerminal};

/// What was found.
#[derive(Debug, Serialize)]
struct Diagnosis {
    program: Program,
    processor: Processor,
    memory: Memory,
    limits: Limits,
    folder: Folder,
    terminal: Terminal,
    problems: Vec<Problem>,
}

/// The versions that decide which files this program reads and whether a shot continues.
#[derive(Debug, Serialize)]
struct Program {
    version: &'static str,
    system: &'static str,
    architecture: &'static str,
    cache_format: u32,
    state: u32,
}

/// Where this command prints.
#[derive(Debug, Serialize)]
struct Terminal {
    stdout: bool,
    stderr: bool,
    colours: bool,
}

/// Examines the machine and a folder.
pub(super) fn doctor(args: &DoctorArgs) -> Result<(), RunError> {
    let mut problems = Vec::new();
    let diagnosis = Diagnosis {
        program: Program {
            version: env!("CARGO_PKG_VERSION"),
            system: std::env::consts::OS,
            architecture: std::env::consts::ARCH,
            cache_format: cache::FORMAT_VERSION,
            state: sim::STATE_VERSION,
        },
        processor: Processor::examine(&mut problems),
        memory: Memory::examine(&mut problems),
        limits: Limits::examine(&mut problems),
        folder: Folder::examine(&args.folder, &mut problems),
        terminal: Terminal {
            stdout: io::stdout().is_terminal(),
            stderr: io::stderr().is_terminal(),
            colours: wants_colours(),
        },
        problems,
    };
    if args.json {
        print(&serde_json::to_string_pretty(&diagnosis).expect("a diagnosis is plain data"));
    } else {
        print(&describe(&diagnosis));
    }
    match diagnosis.problems.iter().find(|problem| problem.stops) {
        None => Ok(()),
        Some(problem) => Err(RunError::File {
            path: args.folder.clone(),
            source: io::Error::other(problem.what.clone()),
            next: problem.next,
        }),
    }
}

/// What people read.
fn describe(diagnosis: &Diagnosis) -> String {
    let Diagnosis { program, processor, memory, limits, folder, terminal, problems } = diagnosis;
    let mut lines = vec![
        format!(
            "program    meniscus {}, {} {}; cache format {}, simulation state {}",
            program.version, program.system, program.architecture, program.cache_format, program.state
        ),
        processor.line(),
        memory.line(),
        limits.line(),
    ];
    lines.extend(folder.lines());
    lines.push(format!(
        "terminal   progress as {}{}",
        if terminal.stderr { "a bar" } else { "plain lines: stderr is no terminal" },
        if terminal.colours { ", with colours" } else { "" }
    ));
    match problems.len() {
        0 => lines.push("problems   none known".into()),
        count => lines.push(format!("problems   {count}")),
    }
    for problem in problems {
        let gravity = if problem.stops { "stops every shot" } else { "note" };
        lines.push(format!("  {gravity}: {}; {}", problem.what, problem.next));
    }
    lines.join("\n")
}
