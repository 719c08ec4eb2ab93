//! `meniscus farm`.

use super::{
    args::{EngineName, FarmArgs},
    output::print,
    shot::quality,
};
use crate::{
    farm::{self, Engine, FarmJob, Request},
    run::{self, Control, RunError, ShotFolder},
    scene::{self, Overrides, Scene},
};

/// Writes a shot or wedges as a job of a render farm.
pub(super) fn farm(args: &FarmArgs, threads: u16, control: Control) -> Result<(), RunError> {
    match &args.preset {
        Some(preset) => {
            let preset = scene::load(preset)?;
            let overrides = Overrides { quality: args.quality.map(quality), set: args.set.clone() };
            run::prepare(&Scene::from_preset(&preset, &overrides)?, &ShotFolder::new(&args.folder), control)?;
        }
        None if !args.set.is_empty() || args.quality.is_some() => {
            return Err(RunError::Request(
                "--set and --quality change a preset: name it with --preset".into(),
            ));
        }
        None => {}
    }
    let engine = match args.engine {
        EngineName::Openjd => Engine::OpenJd,
        EngineName::Slurm => Engine::Slurm,
        EngineName::Flamenco => Engine::Flamenco,
    };
    let job = FarmJob::new(&Request {
        folder: &args.folder,
        frames: args.frames.as_ref(),
        chunk: args.chunk.get(),
        threads,
        max_memory: args.max_memory,
        command: &args.command,
    })?;
    let (files, submit) = farm::write(engine, &job)?;
    files.iter().for_each(|file| print(&format!("{}: written", file.display())));
    print(&format!("submit it in {}: {submit}", args.folder.display()));
    Ok(())
}
