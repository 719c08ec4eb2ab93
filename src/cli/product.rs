//! What the verbs that make products share: where their frames come from, and where the files go.

use super::{
    bounds::print_bounds,
    exit::is_disk_full,
    output::print,
    product_args::InputArgs,
    shot_inputs::{ShotInput, shots},
};
use crate::{
    control::printable_path,
    frame::SPACING_RANGE,
    import::{self, Sequence},
    run::{
        self, BatchRequest, Control, ProductInput, ProductRequest, ProductSelection, ProductSettings, Retime,
        RunError, ShotFolder, Source,
    },
    scene::{self, Quality},
};
use std::path::Path;

/// Frames a second of a sequence of files, unless given.
const DEFAULT_FPS: f64 = 24.0;

/// A verb that makes products.
#[derive(Default)]
pub(super) struct ProductVerb {
    /// Name of the product.
    pub(super) name: &'static str,
    /// The product with its article ("a mesh").
    pub(super) makes: &'static str,
    /// Whether it takes particle files, and not only caches.
    pub(super) takes_files: bool,
    /// The beginnings of the preset's keys that can be set.
    pub(super) keys: &'static [&'static str],
    /// The requested tier of surfaces of particle files.
    pub(super) quality: Option<Quality>,
    /// Their tier if none is requested; `None`: the defaults of `[surface]`.
    pub(super) file_quality: Option<Quality>,
    /// Whether only the bounds of surfaces are printed.
    pub(super) bounds: bool,
}

impl ProductVerb {
    /// Makes the verb's products with the settings of preset and command line, which `adjust` completes.
    pub(super) fn run(
        &self,
        args: &InputArgs,
        retime: Option<Retime>,
        adjust: impl Fn(&mut ProductSettings),
        control: Control,
    ) -> Result<(), RunError> {
        let set: Vec<String> = args
            .set
            .iter()
            .cloned()
            .chain(args.voxel.iter().map(|voxel| format!("surface.voxel={voxel}")))
            .collect();
        let batch = BatchRequest {
            selection: args.frames.clone(),
            force: args.force,
            max_memory: args.max_memory,
            concurrent: true,
            follow: args.follow,
            fps: fps(args.fps)?,
        };
        let shots = match self.takes_files {
            true => shots(&args.inputs, control)?,
            false => args.inputs.iter().map(ShotInput::whole).collect(),
        };
        if !shots.is_empty() {
            self.check_shot_arguments(args, retime, shots.len())?;
        }
        let run = |shot: &ShotInput| {
            let batch = BatchRequest { selection: shot.selection(&args.frames)?, ..batch.clone() };
            self.run_shot(&shot.folder, args, retime, &set, batch, &adjust, control)
        };
        match &shots[..] {
            [] => {}
            [shot] => return run(shot),
            shots => return run_each(shots, run, control),
        }
        if retime.is_some() {
            return Err(RunError::Request("--retime is for the cache of a shot. Leave it out".into()));
        }
        if batch.follow.is_some() {
            return Err(RunError::Request("--follow is for the folder of a shot. Leave it out".into()));
        }
        let sequence = import::expand(&args.inputs)?;
        if self.bounds {
            let settings = scene::product_settings(self.quality.or(self.file_quality), &set)?;
            let known = args.spacing.map(|given| spacing(Some(given))).transpose()?;
            let source = Source::Files { sequence: &sequence, spacing: known.unwrap_or(1.0) };
            return print_bounds(source, known.is_some(), &settings, &batch, control);
        }
        let input = if sequence.files().iter().any(|file| is_volume(file)) {
            self.check_level_sets(args, &sequence)?;
            ProductInput::LevelSets(&sequence)
        } else {
            ProductInput::Frames(Source::Files { sequence: &sequence, spacing: spacing(args.spacing)? })
        };
        let Some(output) = &args.output else {
            return Err(RunError::Request("no folder for the files is given: add -o DIR".into()));
        };
        let mut settings = scene::product_settings(self.quality.or(self.file_quality), &set)?;
        adjust(&mut settings);
        let (out, settings) = (&ShotFolder::new(output), &settings);
        self.make(&ProductRequest { input, out, settings, scene: None, retime, batch: &batch }, control)
    }

    /// Makes the products of one shot.
    #[expect(clippy::too_many_arguments, reason = "the parts of one command")]
    fn run_shot(
        &self,
        folder: &Path,
        args: &InputArgs,
        retime: Option<Retime>,
        set: &[String],
        mut batch: BatchRequest,
        adjust: &dyn Fn(&mut ProductSettings),
        control: Control,
    ) -> Result<(), RunError> {
        let cache = ShotFolder::around(folder);
        let out = args.output.as_ref().map_or_else(|| cache.clone(), ShotFolder::new);
        if retime.is_some() && is_same(out.root(), cache.root()) {
            return Err(RunError::Request(
                "a retimed shot has other frames than its cache: name a folder for them with -o".into(),
            ));
        }
        if let Some(limit) = batch.follow {
            batch.selection = Some(run::follow(&cache, batch.selection.as_ref(), limit, control)?);
        }
        let scene = run::recorded_scene(&cache, set)?;
        let mut settings = match &scene {
            Some(scene) => ProductSettings::of(scene),
            None => scene::product_settings(None, set)?,
        };
        if self.bounds {
            return print_bounds(Source::Cache(&cache), true, &settings, &batch, control);
        }
        adjust(&mut settings);
        let input = ProductInput::Frames(Source::Cache(&cache));
        let (scene, settings, batch) = (scene.as_ref(), &settings, &batch);
        self.make(&ProductRequest { input, out: &out, settings, scene, retime, batch }, control)
    }

    fn make(&self, request: &ProductRequest, control: Control) -> Result<(), RunError> {
        let is_own = match request.input {
            ProductInput::Frames(Source::Cache(cache)) => is_same(request.out.root(), cache.root()),
            _ => false,
        };
        if !is_own && run::is_shot(request.out)? {
            return Err(RunError::Request(format!(
                "{}: found another shot, whose files and title would be replaced; name another folder with -o",
                request.out.root().display()
            )));
        }
        run::make_products(ProductSelection::Verb(self.name), request, control, &mut |summary| {
            summary.lines.iter().for_each(|line| print(line));
        })
    }

    /// Refuses particle files among level sets, and arguments that only particles need.
    fn check_level_sets(&self, args: &InputArgs, sequence: &Sequence) -> Result<(), RunError> {
        if let Some(other) = sequence.files().iter().find(|file| !is_volume(file)) {
            return Err(RunError::Request(format!(
                "{}: found particles among volumes, expected one kind of file; mesh them one after the other",
                other.display()
            )));
        }
        let for_particles = [
            ("--spacing", args.spacing.is_some()),
            ("--voxel", args.voxel.is_some()),
            ("--quality", self.quality.is_some()),
            ("--set", !args.set.is_empty()),
        ];
        match for_particles.iter().find(|(_, given)| *given) {
            Some((flag, _)) => Err(RunError::Request(format!(
                "{flag} is for particles; a level set has its grid. Leave it out"
            ))),
            None => Ok(()),
        }
    }

    /// Refuses arguments that a cache answers itself, and those that are for one shot of several.
    fn check_shot_arguments(
        &self,
        args: &InputArgs,
        retime: Option<Retime>,
        count: usize,
    ) -> Result<(), RunError> {
        if retime.is_some() && args.follow.is_some() {
            return Err(RunError::Request(
                "--follow: a retimed shot needs all of its frames; leave it out and wait for them".into(),
            ));
        }
        if retime.is_some() && count > 1 {
            return Err(RunError::Request(format!(
                "--retime: found {count} shots; retimed frames need a folder of their own for each: name one shot, and -o"
            )));
        }
        if args.output.is_some() && count > 1 {
            return Err(RunError::Request(format!(
                "-o: found {count} shots, whose files go to their own folders; leave -o out, or name one shot"
            )));
        }
        let for_files = [("--spacing", args.spacing.is_some()), ("--fps", args.fps.is_some())];
        if let Some((flag, _)) = for_files.iter().find(|(_, given)| *given) {
            return Err(RunError::Request(format!(
                "{flag} is for particle files; a cache has its own. Leave it out"
            )));
        }
        if let Some(quality) = self.quality {
            return Err(RunError::Request(format!(
                "--quality {quality} is for particle files; the surface of a shot is that of its preset, as simulated: change it \
                 with --set surface.KEY=VALUE, or leave --quality out"
            )));
        }
        let has_effect =
            |argument: &&String| self.keys.iter().any(|key| argument.trim_start().starts_with(key));
        match args.set.iter().find(|argument| !has_effect(argument)) {
            Some(argument) => Err(RunError::Request(format!(
                "--set {argument}: found a key that does not change {}, expected one below {}; the frames are simulated \
                 already: `meniscus simulate` changes the other keys",
                self.makes,
                self.keys.join(", ")
            ))),
            None => Ok(()),
        }
    }
}

/// Runs a verb for each of several shots. One that fails does not stop the others, unless the disk is full.
fn run_each(
    shots: &[ShotInput],
    run: impl Fn(&ShotInput) -> Result<(), RunError>,
    control: Control,
) -> Result<(), RunError> {
    let mut failed = Vec::new();
    for (place, shot) in shots.iter().enumerate() {
        control.reporter.note(&format!(
            "shot {} of {}: {}",
            place + 1,
            shots.len(),
            printable_path(&shot.folder)
        ));
        match run(shot) {
            Ok(()) => {}
            Err(RunError::Interrupted) => return Err(RunError::Interrupted),
            Err(why) => {
                control.reporter.stop();
                // At once, since Ctrl-C may end the batch before the list of all.
                control.reporter.note(&format!("{} failed: {why}", printable_path(&shot.folder)));
                let is_last = is_disk_full(&why);
                failed.push((printable_path(&shot.folder).to_string(), why));
                if is_last {
                    control.reporter.note(&format!(
                        "the disk is full: {} shots are not started",
                        shots.len() - place - 1
                    ));
                    break;
                }
            }
        }
    }
    if failed.is_empty() { Ok(()) } else { Err(RunError::ShotsFailed { failed, all: shots.len() }) }
}

/// Whether two paths lead to the same folder.
fn is_same(a: &Path, b: &Path) -> bool {
    a == b || a.canonicalize().ok().zip(b.canonicalize().ok()).is_some_and(|(a, b)| a == b)
}

/// Whether a file is an OpenVDB volume, by its name.
fn is_volume(file: &Path) -> bool {
    file.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("vdb"))
}

/// The spacing of particles at rest [m], which their files do not have.
pub(super) fn spacing(given: Option<f32>) -> Result<f32, RunError> {
    match given {
        Some(spacing) if SPACING_RANGE.contains(&f64::from(spacing)) => Ok(spacing),
        Some(spacing) => Err(RunError::Request(format!(
            "--spacing {spacing}: expected a length above 0, in metres, from {:e} to {:e}",
            SPACING_RANGE.start(),
            SPACING_RANGE.end()
        ))),
        None => Err(RunError::Request(
            "particle files do not state their particle spacing: add --spacing LENGTH (twice the particle \
             radius; 0.05 or \"5 cm\" for a radius of 0.025 m)"
                .into(),
        )),
    }
}

/// The frames a second of a sequence of files.
pub(super) fn fps(given: Option<f64>) -> Result<f64, RunError> {
    match given.unwrap_or(DEFAULT_FPS) {
        fps if fps.is_finite() && fps > 0.0 => Ok(fps),
        fps => Err(RunError::Request(format!("--fps {fps}: expected a number above 0, such as 24"))),
    }
}
