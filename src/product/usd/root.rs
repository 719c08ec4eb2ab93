//! The root layer and the manifest of the clips.

use super::{
    folder::{StageJob, UsdStage},
    frames::{KIND, output},
    layers::MadeLayer,
    sources::Source,
};
use crate::{
    cache,
    control::printable_path,
    export::usd::{
        Content, GeometryAttribute, MANIFEST, Member, Stage, StageCamera, attributes, group_members, schema,
    },
    frame::FrameIndex,
    import::{Geometry, MAX_GEOMETRY_HEADER, parse_geometry_header},
    job::{
        Control, FrameSpan, Manifest, OutputFiles, RunError,
        batch::{Ledger, ProductFolder},
        file_records::{FileRecord, FileRecords, hex},
    },
};
use std::{collections::BTreeSet, io::Read, path::Path};
use xxhash_rust::xxh3::xxh3_64;

/// The root layer's file name, without its extension.
const STEM: &str = "shot";

/// A sequence as it is in a stage.
struct Clips {
    member: Member,
    /// The output of its layers.
    output: OutputFiles,
    frames: Vec<u32>,
}

/// Writes the root layer and the manifest, with all layers that are there: also those of frames that were made before.
///
/// # Errors
/// What a folder or disk refuses; [`RunError::Request`] if there is nothing to show.
pub(super) fn write_root(
    job: StageJob,
    manifest: &Manifest,
    sequences: &[Source],
    layers: Vec<(&Source, MadeLayer)>,
    ledger: &mut Ledger<'_>,
    control: Control,
) -> Result<(), RunError> {
    let records = FileRecords::read(job.out, UsdStage.name())?;
    let mut members = Vec::new();
    let mut numbers: BTreeSet<u32> = BTreeSet::new();
    for source in sequences {
        let Some(Clips { member, output, frames }) = clips(job, source, &records, control) else { continue };
        numbers.extend(&frames);
        members.push(member);
        ledger.add_present(output, &frames);
    }
    for (source, MadeLayer { output, is_hidden }) in layers {
        numbers.extend(output.frames.numbers());
        let file = file_name(&output.pattern);
        let content = Content::Layer { file, is_hidden };
        members.push(Member { group: source.group.clone(), name: source.name.clone(), content });
    }
    let frames: Vec<u32> = numbers.into_iter().collect();
    let Some(span) = FrameSpan::of(&frames) else {
        return Err(RunError::Request(
            "found no layer for the stage, expected one at least; the messages above have the reasons".into(),
        ));
    };
    let members = group_members(members);
    let stage = Stage {
        title: &manifest.title,
        settings: job.settings,
        frames: (span.first, span.last),
        camera: camera(manifest, control),
        members: &members,
    };
    let (root, clips) = (stage.root(), stage.manifest());
    let key = xxh3_64(format!("{root}\n{clips}").as_bytes());
    let folder = UsdStage.name();
    let output = OutputFiles {
        pattern: format!("{folder}/{STEM}.usda"),
        rest: Some(format!("{folder}/{MANIFEST}")),
        frames: span,
        ..OutputFiles::of(KIND, folder, STEM, "usda", FrameIndex(span.first))
    };
    let files: Vec<String> = output.paths().map(str::to_owned).collect();
    if !job.request.force && records.confirm(job.out, &files, key) {
        return ledger.add_sequence(output, &frames, None, control);
    }
    let mut record = FileRecord::new(FrameIndex(span.first), STEM, key, None);
    // The root is written last: it names the manifest.
    for (file, text) in files.into_iter().zip([&root, &clips]).rev() {
        let path = job.out.root().join(&file);
        let written = cache::write_atomically(&path, |out| out.write_all(text.as_bytes()));
        let next = "check that the folder can be written and the disk has free space";
        record.add(file, written.map_err(|source| RunError::File { path, source, next })?);
    }
    ledger.add_sequence(output, &frames, Some(&record), control)
}

/// The clips of a sequence: the layers that are there and are made of the files that are there, with the settings of this stage.
fn clips(job: StageJob, source: &Source, records: &FileRecords, control: Control) -> Option<Clips> {
    let (mut frames, mut files, mut found) = (Vec::new(), Vec::new(), Vec::<GeometryAttribute>::new());
    let (mut kind, mut other) = (None, 0_usize);
    for &frame in &source.frames {
        let from = source.output.file_name(frame);
        let made = output(source, FrameIndex(frame));
        let file = made.file_name(frame);
        let key = job.key(&[&from], (&source.group, &source.name)).map(hex);
        let is_fresh = records.of(&file).is_some_and(|(record, _)| Some(&record.key) == key.as_ref());
        if !is_fresh || !made.file(job.out, frame).is_file() {
            other += usize::from(made.file(job.out, frame).exists());
            continue;
        }
        let Some(header) = header(job, &source.output.file(job.shot, frame)) else {
            other += 1;
            continue;
        };
        let schema = *kind.get_or_insert(schema(&header));
        if schema != self::schema(&header) {
            other += 1;
            continue;
        }
        for attribute in attributes(&header, job.params.names) {
            if !found.iter().any(|known| known.name == attribute.name) {
                found.push(attribute);
            }
        }
        frames.push(frame);
        files.push((frame, file_name(&file)));
    }
    if other > 0 {
        control.reporter.note(&format!(
            "{}: {other} frames of other files or settings are not in the stage; run the command without --frames",
            source.stem
        ));
    }
    let &first = frames.first()?;
    let content = Content::Clips { schema: kind?, attributes: found, files };
    let member = Member { group: source.group.clone(), name: source.name.clone(), content };
    Some(Clips { member, output: output(source, FrameIndex(first)), frames })
}

/// The columns of a PLY file; `None` if it is elsewhere or no such file.
fn header(job: StageJob, path: &Path) -> Option<Geometry> {
    if cache::leads_out(job.shot.root(), path) {
        return None;
    }
    let mut bytes = Vec::new();
    let file = cache::open_regular(path).ok()?.0;
    file.take(MAX_GEOMETRY_HEADER as u64).read_to_end(&mut bytes).ok()?;
    parse_geometry_header(path, &bytes).ok()
}

/// The part of a path after its folder.
fn file_name(path: &str) -> String {
    path.rsplit('/').next().unwrap_or(path).to_owned()
}

/// The camera of the shot; one that cannot be is left out and reported.
fn camera(manifest: &Manifest, control: Control) -> Option<StageCamera> {
    let camera = manifest.camera?;
    let (position, target, focal_length) = (camera.position, camera.target, camera.focal_length);
    let is_near = position.iter().chain(&target).all(|c| c.abs() <= 1e9);
    if is_near && position != target && (1.0..=5000.0).contains(&focal_length) {
        return Some(StageCamera { position, target, focal_length });
    }
    control.reporter.note(&format!(
        "{}: found a camera that cannot be (docs/formats/shot.md), so the stage has none; make the manifest again",
        printable_path(Path::new("shot.json"))
    ));
    None
}
