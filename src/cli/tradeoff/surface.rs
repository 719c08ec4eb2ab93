//! `meniscus tradeoff --surface`.

use super::{
    Tell, at_least, conclude, drawn, flags, folder, maybe, not_judged, one_line, percent, references,
    refuse_to_replace, request, seconds, short, start_over,
};
use crate::{
    cli::{
        args::{Judge, TradeoffArgs},
        mesh,
        plan::duration,
        print,
        shot::quality,
    },
    import::{self, Sequence},
    run::{
        self, Control, RunError, ShotFolder, Source,
        tradeoff::{
            Ground, Subject, Sweep, rows,
            surface::{self, By, Job, Line, Table},
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
    conclude(args, &sweep, &table, &folder, |place| advice(&table, place, args, &input))
}

impl Tell for Table {
    fn describe(&self) -> String {
        describe(self)
    }

    fn write(&self, folder: &Path) -> Result<[PathBuf; 3], RunError> {
        surface::write(self, folder)
    }

    fn choose(&self, time: Option<f64>, dev: Option<f64>) -> Result<Option<usize>, RunError> {
        Table::choose(self, time, dev)
    }

    fn comment(&self, place: usize) -> String {
        comment(self, place)
    }
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
            if input.ends_with(".toml") || mesh::is_folder(input) {
                return Ok(Self::Preset(scene::load(input)?));
            }
        }
        let sequence = import::expand(&args.inputs)?;
        let spacing = mesh::spacing(args.spacing)?;
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

/// What people read: a line a setting, then how to read it.
fn describe(table: &Table) -> String {
    let head = [
        "",
        "setting",
        "s a frame",
        "whole shot",
        "MiB",
        "triangles",
        "rms",
        "largest",
        "normals",
        "volume",
        "field",
        "",
    ];
    let repeated = table.lines.iter().any(|line| line.seconds.min < line.seconds.max);
    let rows = rows(
        &table.lines,
        &table.reference,
        table.knee,
        |line| line.front,
        |number, line, mark| cells(number, line, table, repeated, mark),
    );
    let mut text = format!(
        "{}, frames {}, about {:.0} particles of spacing {} m, {} threads\n\n{}\n",
        table.title,
        listed(&table.frames),
        table.particles,
        table.spacing,
        table.threads,
        drawn(&head, rows)
    );
    let by = match table.by {
        By::Distance => "rms",
        By::Hausdorff => "largest",
        By::Normals => "normals",
        By::Volume => "volume",
        By::Field => "field (for its own time)",
    };
    text += &format!(
        "front       settings that no other beats in both time and {by}; knee: after it, more time buys little\n\
         rms, largest    distance between the surface and the reference's, both ways, in particle spacings\n\
         normals, volume    against the reference's: angle of nearest points (RMS), all frames together\n\
         field       signed distance against the exact one to its own zero: mean over the band, in voxels\n"
    );
    let floor = &table.uncertainty;
    text += &format!(
        "certainty   the reference differs from its own refinement by rms {}, largest {}, normals {}, volume {}: smaller \
         errors show as ≤",
        maybe(floor.distance, &|d| spacings(d, table)),
        maybe(floor.hausdorff, &|d| spacings(d, table)),
        maybe(floor.normals, &degrees),
        maybe(floor.volume, &percent)
    );
    for first in 0..table.lines.len() {
        let lines = table.lines.iter().enumerate().filter(|(_, line)| line.same_as == Some(first));
        let same: Vec<String> = lines.map(|(place, _)| (place + 1).to_string()).collect();
        if !same.is_empty() {
            text += &format!("\nsame        the same meshes as {}: {}", first + 1, same.join(", "));
        }
    }
    for (place, line) in table.lines.iter().enumerate() {
        if line.apart.distance.is_none() {
            text += &format!("\nnote        {}: a surface is empty where the reference's is not", place + 1);
        }
        if line.unsound > 0 {
            text += &format!("\nnote        {}: {} meshes are not sound", place + 1, line.unsound);
        }
    }
    text
}

fn spacings(metres: f64, table: &Table) -> String {
    short(metres / f64::from(table.spacing))
}

fn degrees(angle: f64) -> String {
    format!("{}°", short(angle))
}

fn cells(number: &str, line: &Line, table: &Table, repeated: bool, mark: &str) -> Vec<String> {
    let (apart, floor) = (line.apart, table.uncertainty);
    let signed = |volume: Option<f64>| match (volume, floor.volume) {
        (Some(volume), Some(floor)) if volume.abs() < floor.abs() => format!("≤ {}", percent(floor.abs())),
        (volume, _) => maybe(volume, &|v| format!("{:+.2} %", 100.0 * v)),
    };
    vec![
        number.into(),
        line.label.clone(),
        seconds(&line.seconds, repeated, 2),
        duration(line.shot_seconds),
        maybe(line.memory.map(|bytes| bytes as f64), &|bytes| format!("{:.0}", bytes / f64::from(1 << 20))),
        format!("{:.0}", line.triangles),
        at_least(apart.distance, floor.distance, &|d| spacings(d, table)),
        at_least(apart.hausdorff, floor.hausdorff, &|d| spacings(d, table)),
        at_least(apart.normals, floor.normals, &degrees),
        signed(apart.volume),
        maybe(line.field.map(|field| field.mean), &short),
        mark.into(),
    ]
}

/// The setting to use, and why.
fn advice(table: &Table, place: usize, args: &TradeoffArgs, input: &Input) -> String {
    let line = &table.lines[place];
    let why = match (args.time, args.dev) {
        (None, None) => "the knee: faster settings lose much, slower ones gain little".to_owned(),
        (time, None) => format!("the most exact within {} for all frames", duration(time.unwrap_or(0.0))),
        (_, Some(dev)) => format!("the cheapest that is off by at most {} of a spacing", percent(dev)),
    };
    let flags = flags(line.quality.as_ref(), &line.set);
    let command = match input {
        Input::Preset(preset) => format!("shot {}", preset.name),
        Input::Shot(shot, _) => format!("mesh {}", shot.root().display()),
        Input::Files { spacing, .. } => format!("mesh {} --spacing {spacing} -o DIR", args.inputs.join(" ")),
    };
    format!("\nuse         {}: {why}\n            meniscus {command} {flags}", place + 1)
}

/// Where the chosen preset comes from.
fn comment(table: &Table, place: usize) -> String {
    let line = &table.lines[place];
    format!(
        "# {}: surface chosen by `meniscus tradeoff --surface` over frames {} among {} settings.\n# Setting: {}. About {} \
         for {} frames on {} threads.",
        one_line(&table.title),
        listed(&table.frames),
        table.lines.len(),
        line.label,
        duration(line.shot_seconds),
        table.shot_frames,
        table.threads,
    )
}
