//! `meniscus completions` and `meniscus man`: what shells and `man` read, made from the types of the command line.

use super::{
    args::{self, CompletionsArgs, ManArgs},
    output::{print, print_verbatim},
};
use crate::{cache::write_atomically, run::RunError};
use clap::Command;
use std::{io, path::Path};

/// Prints the completions of a shell.
pub(super) fn completions(args: &CompletionsArgs) -> Result<(), RunError> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut command(), "meniscus", &mut script);
    print_verbatim(&script);
    Ok(())
}

/// Prints the man page of the program, or writes that of every verb into a folder.
pub(super) fn man(args: &ManArgs) -> Result<(), RunError> {
    let Some(folder) = &args.output else {
        print_verbatim(&page(command()).map_err(|why| failed(Path::new("standard output"), why))?);
        return Ok(());
    };
    std::fs::create_dir_all(folder).map_err(|why| failed(folder, why))?;
    for (name, command) in pages() {
        let path = folder.join(format!("{name}.1"));
        let bytes = page(command).map_err(|why| failed(&path, why))?;
        write_atomically(&path, |out| out.write_all(&bytes)).map_err(|why| failed(&path, why))?;
        print(&path.display().to_string());
    }
    Ok(())
}

/// The command line with everything derived that pages and completions show.
fn command() -> Command {
    let mut command = args::command();
    command.build();
    command
}

/// The program and its verbs, each under the name of its page, such as `meniscus-mesh`.
fn pages() -> Vec<(String, Command)> {
    let mut pages = Vec::new();
    let mut open = vec![command()];
    while let Some(command) = open.pop() {
        open.extend(command.get_subcommands().filter(|verb| verb.get_name() != "help").cloned());
        let name = command.get_display_name().unwrap_or(command.get_name()).to_owned();
        pages.push((name, command));
    }
    pages.sort_by(|a, b| a.0.cmp(&b.0));
    pages
}

fn page(command: Command) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    clap_mangen::Man::new(command).render(&mut bytes)?;
    Ok(bytes)
}

fn failed(path: &Path, source: io::Error) -> RunError {
    RunError::File { path: path.into(), source, next: "name a folder that can be written" }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_verb_has_a_page_that_names_all_its_flags() {
        let pages = pages();
        let names: Vec<&str> = pages.iter().map(|(name, _)| name.as_str()).collect();
        for name in ["meniscus", "meniscus-shot", "meniscus-mesh", "meniscus-presets-copy", "meniscus-doctor"]
        {
            assert!(names.contains(&name), "{name} in {names:?}");
        }
        for (name, command) in pages {
            let flags: Vec<String> = command
                .get_arguments()
                .filter_map(|argument| argument.get_long().map(str::to_owned))
                .collect();
            let text = String::from_utf8(page(command).unwrap()).unwrap();
            for flag in flags {
                assert!(text.contains(&flag.replace('-', "\\-")), "{name}: --{flag}");
            }
        }
    }
}
