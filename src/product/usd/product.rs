//! Stages, as jobs see them.

use super::{
    folder::{SourceRecords, StageJob, UsdStage},
    frames::write_frames,
    layers::write_layer,
    root::write_root,
    sources::Sources,
};
use crate::{
    export::usd::{LayerSettings, StageParams},
    frame::StreamKind,
    job::{
        Control, Manifest, RunError, ShotFolder,
        batch::{BatchRequest, BatchSummary, Ledger, ProductFolder, Source},
        file_records::FileRecords,
        memory::BASE_MEMORY,
    },
    product::{
        interface::Product,
        request::{ProductRequest, ProductSettings},
    },
};
use std::collections::BTreeSet;

impl Product for UsdStage {
    fn verb(&self) -> &'static str {
        "usd"
    }

    fn input(&self) -> &'static str {
        "meshes and points"
    }

    /// It is made of the files of other products.
    fn is_of_streams(&self) -> bool {
        false
    }

    fn accepts(&self, _: StreamKind) -> bool {
        false
    }

    fn is_requested(&self, settings: &ProductSettings) -> bool {
        settings.usd.is_some()
    }

    fn arguments(&self, settings: &ProductSettings) -> Vec<String> {
        let StageParams { space, names } = settings.usd.unwrap_or_default();
        let arguments = [("--up", space.up.name().to_owned()), ("--scale", space.scale.to_string())];
        let names = ("--names", names.name().to_owned());
        arguments.into_iter().chain([names]).flat_map(|(flag, value)| [flag.to_owned(), value]).collect()
    }

    /// Each process writes the root layer, with the frames that are there.
    fn is_per_frame(&self) -> bool {
        false
    }

    fn max_memory(&self, _: &ProductSettings, _: StreamKind, _: usize) -> f64 {
        BASE_MEMORY
    }

    fn make(&self, request: &ProductRequest, control: Control) -> Result<BatchSummary, RunError> {
        let Source::Cache(shot) = request.frames()? else {
            return Err(RunError::Request("stages are made of the files of a shot folder alone".into()));
        };
        let params = request.settings.usd.unwrap_or_default();
        stage(shot, request.out, params, request.batch, control)
    }
}

/// Writes the stage of `shot` to `out`. Layers that were made of the same files with the same parameters are kept, unless the request
/// forces them.
///
/// # Errors
/// [`RunError::Request`] if the shot has no files that a stage can show. What cannot be made is left out and reported at the end
/// ([`RunError::SomeFailed`]); a folder or disk that refuses ends it at once.
fn stage(
    shot: &ShotFolder,
    out: &ShotFolder,
    params: StageParams,
    request: &BatchRequest,
    control: Control,
) -> Result<BatchSummary, RunError> {
    let Some(manifest) = Manifest::read(shot)? else {
        return Err(RunError::Request(format!(
            "{}: found no shot.json, expected a shot folder with meshes, points, sheets or colliders; run `meniscus shot` or \
             `meniscus mesh` first",
            crate::control::printable_path(shot.root())
        )));
    };
    let sources = Sources::of(&manifest, shot);
    sources.left_out.iter().for_each(|why| control.reporter.note(why));
    if sources.layers.is_empty() && sources.sequences.iter().all(|source| source.frames.is_empty()) {
        return Err(RunError::Request(format!(
            "{}: found no files that a stage can show, expected PLY meshes or points, sheets or colliders; run `meniscus mesh`, \
             `export` or `colliders` first",
            crate::control::printable_path(shot.root())
        )));
    }
    if request.selection.is_some() && !sources.layers.is_empty() {
        let count = sources.layers.len();
        let why = "are made with all their frames, whatever --frames selects of meshes and points";
        control.reporter.note(&format!("{count} sheets and colliders {why}"));
    }
    let fps = manifest.fps;
    if !(0.01..=10_000.0).contains(&fps) {
        return Err(RunError::Request(format!(
            "{}: found {fps} frames a second, expected 0.01 to 10000; make the manifest again",
            crate::control::printable_path(&shot.manifest())
        )));
    }
    let records = &SourceRecords::read(shot, sources.folders())?;
    let settings = LayerSettings { space: params.space, fps };
    let job = StageJob { shot, out, params, settings, request, records };
    let title = manifest.title.as_str();
    let has_sequences = sources.sequences.iter().any(|source| !source.frames.is_empty());
    let (frames, failed) = match has_sequences {
        true => match write_frames(job, &sources.sequences, title, control) {
            Err(why @ RunError::SomeFailed { .. }) => (BatchSummary::default(), Some(why)),
            made => (made?, None),
        },
        false => (BatchSummary::default(), None),
    };
    let mut ledger = Ledger::new(out, &UsdStage, control)?;
    let ended = write_whole(job, &manifest, &sources, &mut ledger, control);
    if ended.is_ok() {
        // Of an earlier stage there may be layers that are not in this one.
        ledger.replace_outputs();
    }
    ledger.add_figures(&frames);
    let numbers: BTreeSet<u32> =
        sources.sequences.iter().flat_map(|source| source.frames.iter().copied()).collect();
    let numbers: Vec<u32> = numbers.into_iter().collect();
    match (ledger.finish(title, fps, &numbers, ended, control), failed) {
        (whole, None) => whole,
        (Ok(_), Some(failed)) => Err(failed),
        (Err(why), Some(failed)) => {
            control.reporter.note(&why.to_string());
            Err(failed)
        }
    }
}

/// Writes the layers of sheets and colliders, and the root layer.
fn write_whole(
    job: StageJob,
    manifest: &Manifest,
    sources: &Sources,
    ledger: &mut Ledger<'_>,
    control: Control,
) -> Result<(), RunError> {
    let records = FileRecords::read(job.out, UsdStage.name())?;
    control.reporter.begin(UsdStage.name(), sources.layers.len());
    let mut layers = Vec::new();
    for (place, source) in sources.layers.iter().enumerate() {
        if control.cancel.is_cancelled() {
            return Err(RunError::Interrupted);
        }
        layers.extend(write_layer(job, source, &records, ledger, control)?.map(|made| (source, made)));
        control.reporter.progress((place + 1) as f64);
    }
    control.reporter.end();
    write_root(job, manifest, &sources.sequences, layers, ledger, control)
}
