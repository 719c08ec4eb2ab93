//! `meniscus tradeoff --surface`.

use super::{
    conclude, folder, not_judged, references, refuse_to_replace, request, start_over,
    tell::{Tell, at_least, certainty, maybe, mib, percent, seconds, short},
};
use crate::{
    cli::{
        args::{Judge, TradeoffArgs},
        output::print,
        plan::duration,
        product,
        shot::quality,
    },
    import::{self, Sequence},
    run::{
        self, Control, RunError, ShotFolder, Source,
        tradeoff::{
            Ground, Subject, Sweep,
            surface::{self, By, Job, Line, Surfaces, Table},
        },
    },
    scene::{self, Frames, Overrides, Preset, Scene},
};
use std::path::{Path, PathBuf};

/// What was named on the command line.
enum Input {
    /// A shot that has frames; its preset, if that is there.
    Shot(ShotFolder, Option<Preset>),
    /// A preset whose first frames are simulated.
    Preset(Preset),
    /// Particle files of any solver, and the scene that stands for the preset they lack.
    Files { sequence: Sequence, spacing: f32, scene: Box<Scene> },
}

/// Compares settings of surfaces.
pub(super) fn tradeoff(args: &TradeoffArgs, control: Control) -> Result<(), RunError> {
    let input = Input::of(args)?;
    let bare = Box::new(bare("Untitled"));
    let ground = match &input {
        Input::Shot(_, Some(preset)) | Input::Preset(preset) => Ground::Preset(preset),
        Input::Shot(_, None) => Ground::Bare(&bare),
        Input::Files { scene, .. } => Ground::Bare(scene),
    };
    input.check(args, &ground)?;
    let base = Overrides { quality: args.quality.map(quality), set: args.set.clone() };
    let sweep = request(args, base).sweep(Subject::Surface, ground)?;
    let by = by(args.by)?;
    if !args.dry_run {
        refuse_to_replace(args)?;
    }

    // The particles.
    let folder = folder(args, &input.name());
    if args.force && !args.dry_run {
        start_over(&folder)?;
    }
    let simulated = ShotFolder::new(folder.join("shot"));
    let (source, frames) = match &input {
        Input::Preset(_) => {
            let frames = slice(&sweep.base, args.frames.as_ref())?;
            if args.dry_run {
                return dry_run(&sweep, &frames, None);
            }
            let list = listed(&frames);
            run::simulate(&sweep.base, &simulated, &list, args.force, control)?;
            (Source::Cache(&simulated), frames)
        }
        Input::Shot(shot, _) => {
            let source = Source::Cache(shot);
            (source, source.choose(args.frames.as_ref())?)
        }
        Input::Files { sequence, spacing, .. } => {
            let source = Source::Files { sequence, spacing: *spacing };
            (source, source.choose(args.frames.as_ref())?)
        }
    };
    if args.dry_run {
        return dry_run(&sweep, &frames, source.particles(&frames)?);
    }
    let shot_frames = match &input {
        Input::Preset(_) => sweep.base.frames.count(),
        _ => source.numbers()?.len() as u64,
    };
    let repeats = args.repeats.get() as usize;
    let job = Job { frames, shot_frames, repeats, by, max_memory: args.max_memory };
    let table = surface::tradeoff(&sweep, &source, &job, &folder, control)?;
    conclude(args, &sweep, &table, &folder, &input.command(args))
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
            if input.ends_with(".toml") || product::is_folder(input) {
                return Ok(Self::Preset(scene::load(input)?));
            }
        }
        let sequence = import::expand(&args.inputs)?;
        let spacing = product::spacing(args.spacing)?;
        let title = sequence.files().first().and_then(|file| file.file_stem()).unwrap_or_default();
        let scene = Box::new(bare(&title.to_string_lossy()));
        Ok(Self::Files { sequence, spacing, scene })
    }

    /// Refuses arguments that mean nothing for this input.
    fn check(&self, args: &TradeoffArgs, ground: &Ground<'_>) -> Result<(), RunError> {
        let is_bare = matches!(ground, Ground::Bare(_));
        let simulates = matches!(self, Self::Preset(_));
        let mut wrong = [
            (
                "--spacing",
                args.spacing.is_some() && !matches!(self, Self::Files { .. }),
                "a cache knows its own",
            ),
            ("--quality", args.quality.is_some() && !simulates, "the particles are there already"),
            ("--tiers", args.tiers && !simulates, "the particles are there already"),
            ("--write", args.write.is_some() && is_bare, "there is no preset to change"),
        ]
        .into_iter();
        if let Some((flag, _, why)) = wrong.find(|(_, given, _)| *given) {
            return Err(RunError::Request(format!("{flag}: {why}; leave it out")));
        }
        match args.set.iter().find(|set| !simulates && !set.trim_start().starts_with("surface")) {
            None => Ok(()),
            Some(set) => Err(RunError::Request(format!(
                "--set {set}: found a key that does not change a surface, expected surface.…; the particles are there already"
            ))),
        }
    }

    /// What uses a setting of it.
    fn command(&self, args: &TradeoffArgs) -> String {
        match self {
            Self::Preset(preset) => format!("shot {}", preset.name),
            Self::Shot(shot, _) => format!("mesh {}", shot.root().display()),
            Self::Files { spacing, .. } => {
                format!("mesh {} --spacing {spacing} -o DIR", args.inputs.join(" "))
            }
        }
    }

    /// What the output folder is named after.
    fn name(&self) -> String {
        match self {
            Self::Preset(preset) => preset.name.clone(),
            Self::Files { scene, .. } => scene.title.clone(),
            Self::Shot(shot, _) => {
                let whole = std::fs::canonicalize(shot.root()).unwrap_or_else(|_| PathBuf::from(shot.root()));
                // A dot in a folder's name starts no extension.
                whole.file_name().map_or_else(|| "shot".into(), |name| format!("{}.", name.to_string_lossy()))
            }
        }
    }
}

/// A scene of nothing but particles that come from elsewhere.
fn bare(title: &str) -> Scene {
    Scene {
        title: title.into(),
        frames: "1".parse().expect("a frame"),
        fps: 24.0,
        world: scene::World::default(),
        liquid: None,
        smoke: None,
        sheet: Vec::new(),
        sheets: None,
        coupling: Vec::new(),
        surface: Default::default(),
        volume: Default::default(),
        output: scene::Output::default(),
        tradeoff: None,
        assets: Default::default(),
    }
}

fn by(judge: Option<Judge>) -> Result<By, RunError> {
    match judge {
        None | Some(Judge::Distance) => Ok(By::Distance),
        Some(Judge::Hausdorff) => Ok(By::Hausdorff),
        Some(Judge::Normals) => Ok(By::Normals),
        Some(Judge::Volume) => Ok(By::Volume),
        Some(Judge::Field) => Ok(By::Field),
        Some(other) => Err(not_judged(other, "distance, hausdorff, normals, volume or field with --surface")),
    }
}

/// The frames of a preset to simulate and compare: those named, or three of the first second.
fn slice(scene: &Scene, selection: Option<&Frames>) -> Result<Vec<u32>, RunError> {
    if let Some(selection) = selection {
        return Ok(selection.iter().map(|index| index.0).collect());
    }
    let (first, last) = (scene.frames.first().0, scene.frames.last().0);
    let last = last.min(first.saturating_add(scene.fps.ceil() as u32));
    let mut frames: Vec<u32> = (1..=3).map(|i| first + ((u64::from(last - first) * i) / 3) as u32).collect();
    frames.dedup();
    Ok(frames)
}

/// Some ascending frames as a list.
fn listed(frames: &[u32]) -> Frames {
    let text: Vec<String> = frames.iter().map(u32::to_string).collect();
    text.join(",").parse().expect("ascending frames are a list")
}

/// Lists the runs.
fn dry_run(sweep: &Sweep, frames: &[u32], particles: Option<usize>) -> Result<(), RunError> {
    let runs = (sweep.rows.len() + 2) * frames.len();
    print(&format!("{}, frames {}: {runs} surfaces", sweep.base.title, listed(frames)))?;
    references(sweep).iter().try_for_each(|line| print(line))?;
    let needs = |scene: &Scene| match particles {
        Some(particles) => {
            let bytes = surface::memory_at_most(particles, &scene.surface);
            format!("  (about {} MiB at most)", bytes >> 20)
        }
        None => String::new(),
    };
    print(&format!("     the finest of them{}", needs(&sweep.refined.1)))?;
    for (place, (setting, scene)) in sweep.rows.iter().enumerate() {
        print(&format!("{:>3}  {}{}", place + 1, setting.label, needs(scene)))?;
    }
    Ok(())
}

impl Tell for Surfaces {
    const COMMAND: &'static str = "meniscus tradeoff --surface";
    const WHOLE: &'static str = "all frames";
    const SAME: &'static str = "the same meshes as";

    fn about(&self) -> String {
        format!(
            "frames {}, about {:.0} particles of spacing {} m",
            listed(&self.frames),
            self.particles,
            self.spacing
        )
    }

    fn decides(table: &Table) -> &'static str {
        match table.by {
            By::Distance => "rms",
            By::Hausdorff => "largest",
            By::Normals => "normals",
            By::Volume => "volume",
            By::Field => "field (for its own time)",
        }
    }

    fn head(_: &Table) -> Vec<&'static str> {
        vec!["s a frame", "whole shot", "MiB", "triangles", "rms", "largest", "normals", "volume", "field"]
    }

    fn cells(table: &Table, line: &Line, is_repeated: bool) -> Vec<String> {
        let (told, apart, floor) = (&line.told, line.apart, table.uncertainty);
        let signed = |volume: Option<f64>| match (volume, floor.volume) {
            (Some(volume), Some(floor)) if volume.abs() < floor.abs() => {
                format!("≤ {}", percent(floor.abs()))
            }
            (volume, _) => maybe(volume, &|v| format!("{:+.2} %", 100.0 * v)),
        };
        vec![
            seconds(&line.seconds, is_repeated, 2),
            duration(line.shot_seconds),
            mib(told.memory),
            format!("{:.0}", told.triangles),
            at_least(apart.distance, floor.distance, &|d| spacings(d, table)),
            at_least(apart.hausdorff, floor.hausdorff, &|d| spacings(d, table)),
            at_least(apart.normals, floor.normals, &degrees),
            signed(apart.volume),
            maybe(told.field.map(|field| field.mean), &short),
        ]
    }

    fn legend(table: &Table) -> String {
        let floor = &table.uncertainty;
        let text = "rms, largest    distance between the surface and the reference's, both ways, in particle spacings\n\
             normals, volume    against the reference's: angle of nearest points (RMS), all frames together\n\
             field       signed distance against the exact one to its own zero: mean over the band, in voxels\n";
        text.to_owned()
            + &certainty(&[
                ("rms", maybe(floor.distance, &|d| spacings(d, table))),
                ("largest", maybe(floor.hausdorff, &|d| spacings(d, table))),
                ("normals", maybe(floor.normals, &degrees)),
                ("volume", maybe(floor.volume, &percent)),
            ])
    }

    fn notes(line: &Line) -> Vec<String> {
        let empty = line.apart.distance.is_none();
        let unsound = line.told.unsound;
        let notes = [
            empty.then(|| "a surface is empty where the reference's is not".to_owned()),
            (unsound > 0).then(|| format!("{unsound} meshes are not sound")),
        ];
        notes.into_iter().flatten().collect()
    }

    fn kept(most: f64) -> String {
        format!("the cheapest that is off by at most {} of a spacing", percent(most))
    }

    fn reason(table: &Table, line: &Line) -> String {
        format!("About {} for {} frames", duration(line.shot_seconds), table.about.shot_frames)
    }

    fn write(table: &Table, folder: &Path) -> Result<[PathBuf; 3], RunError> {
        surface::write(table, folder)
    }
}

fn spacings(metres: f64, table: &Table) -> String {
    short(metres / f64::from(table.about.spacing))
}

fn degrees(angle: f64) -> String {
    format!("{}°", short(angle))
}
