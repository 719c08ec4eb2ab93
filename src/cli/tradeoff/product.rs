//! `meniscus tradeoff` of what is made of particles: of a shot that has frames, of particle files, or of a preset whose
//! first frames are simulated.

use super::comparison::{conclude, criterion, dry_run, folder, job, output, request};
use crate::{
    cli::{args::TradeoffArgs, product, shot_inputs},
    import::{self, Sequence},
    job::{Control, RunError, ShotFolder, batch::Source},
    run::{
        self,
        tradeoff::{Origin, ProductRuns, ProductSource, Subject},
    },
    scene::{self, Frames, Preset, Quality, Scene},
};
use std::path::{Path, PathBuf};

/// What was named on the command line.
enum Input {
    /// A shot that has frames; its preset, if that is there.
    Shot(ShotFolder, Option<Preset>),
    /// A preset whose first frames are simulated.
    Preset(Preset),
    /// Particle files of any solver, and the distance between particles at rest [m].
    Files(Sequence, f32),
}

/// Compares settings of a product.
pub(super) fn tradeoff(
    args: &TradeoffArgs,
    subject: &Subject,
    product: &ProductRuns,
    control: Control,
) -> Result<(), RunError> {
    let input = Input::of(args)?;
    let bare: Scene = serde_json::from_value(serde_json::json!({ "title": input.title(), "frames": "1" }))
        .expect("a title and frames are a scene");
    let origin = match &input {
        Input::Shot(_, Some(preset)) | Input::Preset(preset) => Origin::Preset(preset),
        _ => Origin::Particles(&bare),
    };
    input.check(args, subject, &origin)?;
    let mut request = request(args);
    if matches!(input, Input::Files(..)) {
        // That of `meniscus mesh`.
        request.base.quality = request.base.quality.or(Some(Quality::Final));
    }
    let sweep = request.sweep(subject, origin)?;
    let by = criterion(args, subject, None)?;
    let simulated = ShotFolder::new(output(args, &input.name()).join("shot"));
    let source = match &input {
        Input::Preset(_) => Source::Cache(&simulated),
        Input::Shot(shot, _) => Source::Cache(shot),
        Input::Files(sequence, spacing) => Source::Files { sequence, spacing: *spacing },
    };
    let is_preset = matches!(input, Input::Preset(_));
    let present = if is_preset { Vec::new() } else { source.frames(None)? };
    let numbers: Vec<u32> = present.iter().map(|(index, _)| index.0).collect();
    let frames = if is_preset { slice(&sweep.base, args) } else { chosen(&numbers, args)? };
    if args.dry_run {
        // Only headers of a cache state how many particles there are.
        let is_cached = !matches!(input, Input::Files(..));
        let paths = present.iter().filter(|(index, _)| is_cached && frames.contains(*index));
        let particles = paths.filter_map(|(_, path)| Some(source.max_entries(path.as_deref()?))).max();
        let made = (sweep.rows.len() as u64 + 2) * frames.count();
        dry_run(&sweep, &format!("frames {frames}: {made} surfaces"), |scene| {
            let bytes = particles.map(|particles| (product.memory)(particles, scene));
            bytes.map_or_else(String::new, |bytes| format!("  (about {} MiB at most)", bytes >> 20))
        });
        return Ok(());
    }
    let folder = folder(args, &input.name())?;
    let mut shot_frames = numbers.len() as u64;
    if is_preset {
        run::simulate(&sweep.base, &simulated, &frames, args.force, args.max_memory, control)?;
        shot_frames = sweep.base.frames.count();
    }
    let shot = match &input {
        Input::Shot(shot, Some(_)) => Some(shot),
        Input::Preset(_) => Some(&simulated),
        Input::Shot(_, None) | Input::Files(..) => None,
    };
    let mut scenes = sweep.rows.iter().chain([&sweep.reference, &sweep.refined]).map(|(_, scene)| scene);
    let uses_solids = scenes.any(product.uses_solids);
    let scene = shot.filter(|_| uses_solids);
    let scene =
        scene.map(|shot| run::tradeoff::with_sampled_meshes(&sweep.base, shot, control)).transpose()?;
    let from = ProductSource { source, scene: scene.as_ref(), shot_frames, max_memory: args.max_memory };
    let table = (product.run)(&sweep, &from, &job(args, &frames, &folder, by), control)?;
    conclude(args, &sweep, &table, &folder, &input.command(args))
}

/// Frames that are compared if none are named: enough to see calm and splash.
const DEFAULT_FRAMES: usize = 3;

/// The frames of a preset to simulate and compare: those named, or three of the first second.
fn slice(scene: &Scene, args: &TradeoffArgs) -> Frames {
    let (first, last) = (scene.frames.first().0, scene.frames.last().0);
    let last = last.min(first.saturating_add(scene.fps.ceil() as u32));
    let place = |i: usize| first + (u64::from(last - first) * i as u64 / DEFAULT_FRAMES as u64) as u32;
    args.frames.clone().unwrap_or_else(|| listed((1..=DEFAULT_FRAMES).map(place).collect()))
}

/// The frames to compare among those that are there: those named, or three, evenly spread up to the last.
fn chosen(present: &[u32], args: &TradeoffArgs) -> Result<Frames, RunError> {
    let count = DEFAULT_FRAMES.min(present.len());
    let Some(selection) = args.frames.as_ref().filter(|_| count > 0) else {
        return Ok(listed((1..=count).map(|i| present[i * present.len() / count - 1]).collect()));
    };
    match selection.iter().find(|index| present.binary_search(&index.0).is_err()) {
        None => Ok(selection.clone()),
        Some(missing) => Err(RunError::Request(format!(
            "--frames {selection}: found no frame {missing}, expected frames that are there: {} to {}",
            present[0],
            present[present.len() - 1]
        ))),
    }
}

/// Ascending frames as a list.
fn listed(mut frames: Vec<u32>) -> Frames {
    frames.dedup();
    let text = frames.iter().map(u32::to_string).collect::<Vec<_>>().join(",");
    text.parse().expect("ascending frames are a list")
}

impl Input {
    fn of(args: &TradeoffArgs) -> Result<Self, RunError> {
        if let [input] = &args.inputs[..] {
            let path = Path::new(input);
            if path.is_dir() {
                let shot = ShotFolder::around(path);
                let preset = shot.preset();
                let preset = preset.exists().then(|| scene::load(&preset.to_string_lossy())).transpose()?;
                return Ok(Self::Shot(shot, preset));
            }
            if input.ends_with(".toml") || shot_inputs::is_folder(input) {
                return Ok(Self::Preset(scene::load(input)?));
            }
        }
        Ok(Self::Files(import::expand(&args.inputs)?, product::spacing(args.spacing)?))
    }

    /// Refuses arguments that mean nothing for this input.
    fn check(&self, args: &TradeoffArgs, subject: &Subject, origin: &Origin<'_>) -> Result<(), RunError> {
        let simulates = matches!(self, Self::Preset(_));
        let is_cached = !matches!(self, Self::Files(..));
        let has_preset = matches!(origin, Origin::Preset(_));
        let mut wrong = [
            ("--spacing", args.spacing.is_some() && is_cached, "a cache knows its own"),
            (
                "--quality",
                args.quality.is_some() && matches!(self, Self::Shot(..)),
                "the particles are there already",
            ),
            ("--tiers", args.tiers && !simulates, "the particles are there already"),
            ("--write", args.write.is_some() && !has_preset, "there is no preset to change"),
        ]
        .into_iter();
        if let Some((flag, _, why)) = wrong.find(|(_, given, _)| *given) {
            return Err(RunError::Request(format!("{flag}: {why}; leave it out")));
        }
        let refusal = |set: &String| Some((set.clone(), (subject.refuse)(set.trim_start())?));
        match args.set.iter().filter(|_| !simulates).find_map(refusal) {
            None => Ok(()),
            Some((set, why)) => Err(RunError::Request(format!("--set {set}: found a key that {why}"))),
        }
    }

    /// The command that uses a setting of this input.
    fn command(&self, args: &TradeoffArgs) -> String {
        match self {
            Self::Preset(preset) => format!("shot {}", preset.name),
            Self::Shot(shot, _) => format!("mesh {}", shot.root().display()),
            Self::Files(_, spacing) => format!("mesh {} --spacing {spacing} -o DIR", args.inputs.join(" ")),
        }
    }

    /// The title, where no preset gives one.
    fn title(&self) -> String {
        let Self::Files(sequence, _) = self else { return "Untitled".into() };
        let stem = sequence.files().first().and_then(|file| file.file_stem()).unwrap_or_default();
        stem.to_string_lossy().into_owned()
    }

    /// What the output folder is named after.
    fn name(&self) -> String {
        match self {
            Self::Preset(preset) => preset.name.clone(),
            Self::Files(..) => self.title(),
            Self::Shot(shot, _) => {
                let whole = std::fs::canonicalize(shot.root()).unwrap_or_else(|_| PathBuf::from(shot.root()));
                // A dot in a folder's name starts no extension.
                whole.file_name().map_or_else(|| "shot".into(), |name| format!("{}.", name.to_string_lossy()))
            }
        }
    }
}
