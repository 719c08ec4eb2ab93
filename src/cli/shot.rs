//! `meniscus shot` and `meniscus simulate`.

use super::{
    args::ShotArgs,
    output::{counts, print},
    product_args::Tier,
};
use crate::{
    frame::FrameIndex,
    run::{
        self, BatchRequest, Control, NewBranch, Outline, ProductInput, ProductRequest, ProductSelection,
        ProductSettings, RunError, ShotFolder, Source,
    },
    scene::{self, Frames, Overrides, Preset, Quality, Scene},
};
use std::path::{Path, PathBuf};

/// Simulates, then writes every output the preset names.
pub(super) fn shot(args: &ShotArgs, control: Control) -> Result<(), RunError> {
    let Some((scene, folder, selection)) = simulated(args, control, true)? else { return Ok(()) };
    if !run::is_any_requested(&ProductSettings::of(&scene)) {
        print(
            "no output is named: add `mesh = [\"ply\"]`, `volume = [\"density\"]` or `sheet = [\"pc2\"]` under [output], or run \
             `meniscus mesh`, `meniscus volume` or `meniscus export` on the folder",
        );
        return Ok(());
    }
    make_outputs(&scene, &folder, &selection, args.force, args.max_memory, control)?;
    print(&format!("open {} in Blender: File > Import > Meniscus Shot", folder.manifest().display()));
    Ok(())
}

/// Writes every output that the preset of a shot names.
pub(super) fn make_outputs(
    scene: &Scene,
    folder: &ShotFolder,
    selection: &Frames,
    force: bool,
    max_memory: Option<u64>,
    control: Control,
) -> Result<(), RunError> {
    let batch = BatchRequest {
        selection: Some(selection.clone()),
        force,
        max_memory,
        concurrent: false,
        follow: None,
        fps: f64::from(scene.fps),
    };
    let request = ProductRequest {
        input: ProductInput::Frames(Source::Cache(folder)),
        out: folder,
        settings: &ProductSettings::of_shot(scene, folder)?,
        scene: Some(scene),
        retime: None,
        batch: &batch,
    };
    run::make_products(ProductSelection::Requested, &request, control, &mut |summary| {
        summary.lines.iter().for_each(|line| print(line));
    })
}

/// Fills the cache.
pub(super) fn simulate(args: &ShotArgs, control: Control) -> Result<(), RunError> {
    simulated(args, control, false).map(|_| ())
}

/// The common part; `None` if it was a dry run.
fn simulated(
    args: &ShotArgs,
    control: Control,
    with_outputs: bool,
) -> Result<Option<(Scene, ShotFolder, Frames)>, RunError> {
    let overrides = Overrides { quality: args.quality.map(quality), set: args.set.clone() };
    let (scene, default, branch) = match args.from {
        Some(first) => {
            let parent = ShotFolder::around(Path::new(&args.preset));
            let branch = NewBranch::new(parent.clone(), FrameIndex(first), &overrides)?;
            let mut name = parent
                .root()
                .canonicalize()
                .unwrap_or_default()
                .file_name()
                .unwrap_or("shot".as_ref())
                .to_owned();
            name.push(format!("-from-{first}"));
            (branch.scene.clone(), PathBuf::from(name), Some(branch))
        }
        None => {
            let preset = scene::load(&args.preset)?;
            let scene = Scene::from_preset(&preset, &overrides)?;
            let default = default_folder(&preset, &scene, &overrides)?;
            (scene, default, None)
        }
    };
    let selection = args.frames.clone().unwrap_or_else(|| scene.frames.clone());
    if let Some(allowed) = args.max_memory {
        run::refuse_over_memory(&scene, &selection, with_outputs, allowed, control)?;
    }
    if args.dry_run {
        describe(&scene, &selection, &run::outline(&scene, with_outputs, control)?);
        return Ok(None);
    }
    let folder = ShotFolder::new(args.output.clone().unwrap_or(default));
    if let Some(branch) = branch {
        run::check_selection(&scene, &selection)?;
        branch.start(&folder, args.force, args.max_memory, control)?;
    }
    let done = run::simulate(&scene, &folder, &selection, args.force, args.max_memory, control)?;
    print(&format!(
        "{}: {} frames simulated ({:.1} MiB), {} up to date",
        folder.cache().display(),
        done.computed,
        done.bytes as f64 / f64::from(1 << 20),
        done.kept
    ));
    run::info(&folder)?.total_lines().for_each(|line| print(&line));
    Ok(Some((scene, folder, selection)))
}

/// The preset's name, in the current folder; with the tier's name behind it, unless the tier is the preset as written.
fn default_folder(preset: &Preset, scene: &Scene, overrides: &Overrides) -> Result<PathBuf, RunError> {
    let mut name = Path::new(&preset.name).file_stem().unwrap_or("shot".as_ref()).to_owned();
    match overrides.quality {
        Some(Quality::Final)
            if *scene == Scene::from_preset(preset, &Overrides { quality: None, ..overrides.clone() })? => {}
        Some(tier) => name.push(format!("-{tier}")),
        None => {}
    }
    Ok(name.into())
}

/// The preset's tier that the command line names.
pub(super) fn quality(tier: Tier) -> Quality {
    match tier {
        Tier::Draft => Quality::Draft,
        Tier::Preview => Quality::Preview,
        Tier::Final => Quality::Final,
    }
}

/// What a dry run prints.
fn describe(scene: &Scene, selection: &Frames, outline: &Outline) {
    let mut lines = vec![scene.title.clone()];
    let mut row = |name: &str, text: String| lines.push(format!("{name:<10} {text}"));
    row("frames", format!("{selection} at {} fps", scene.fps));
    for (system, elements) in outline.counts.iter().filter(|(_, elements)| !elements.is_empty()) {
        row(system, counts(elements));
    }
    row("passes", outline.passes.join(", "));
    row("memory", format!("at most about {:.0} MiB", outline.memory as f64 / f64::from(1 << 20)));
    row("time", "`meniscus plan` estimates it, and the disk space".into());
    for remark in &outline.remarks {
        row("note", remark.clone());
    }
    print(&lines.join("\n"));
}
