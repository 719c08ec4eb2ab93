//! The files of a shot that become a stage: the outputs of its manifest.

use super::folder::UsdStage;
use crate::{
    control::printable,
    export::usd::{CAMERA, Identifiers, identifier},
    job::{Manifest, OutputFiles, ShotFolder, batch::ProductFolder},
};
use std::collections::{BTreeMap, HashSet};
use xxhash_rust::xxh3::xxh3_64;

/// The longest name of a file, without the frame and the extension.
const MAX_STEM: usize = 50;

/// Geometry that becomes a prim.
pub(super) struct Source {
    /// The files that it is made of.
    pub(super) output: OutputFiles,
    /// The prim that it is below: the kind of the files.
    pub(super) group: String,
    /// Name of the prim in the group.
    pub(super) name: String,
    /// The name of its files, without the frame and the extension.
    pub(super) stem: String,
    /// Frames with a file of their own, in ascending order; none of what is one file for all frames.
    pub(super) frames: Vec<u32>,
}

/// What a stage is made of.
#[derive(Default)]
pub(super) struct Sources {
    /// Meshes and points with a file for each frame.
    pub(super) sequences: Vec<Source>,
    /// Sheets and colliders: a mesh with its motion.
    pub(super) layers: Vec<Source>,
    /// What is in the manifest and not in the stage, in words.
    pub(super) left_out: Vec<String>,
}

/// How an output becomes a part of a stage.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Form {
    Sequence,
    Layer,
}

impl Sources {
    /// What a stage is made of the outputs of a manifest.
    pub(super) fn of(manifest: &Manifest, shot: &ShotFolder) -> Self {
        let own = format!("{}/", UsdStage.name());
        let outputs: Vec<&OutputFiles> =
            manifest.outputs.iter().filter(|output| !output.pattern.starts_with(&own)).collect();
        let mut sources = Self::default();
        let mut names: BTreeMap<String, Identifiers> = BTreeMap::new();
        let mut stems = HashSet::new();
        for &output in &outputs {
            let Some(form) = form(output) else {
                if !outputs
                    .iter()
                    .any(|other| shows_same(output, other) && form_of(other, &outputs).is_some())
                {
                    sources.left_out.push(remark(output));
                }
                continue;
            };
            if form_of(output, &outputs).is_none() {
                let [kind, name] = [&output.kind, &output.name].map(|text| printable(text));
                let why = "its PLY files are not in the stage, since its point cache is; velocities are in the PLY files alone";
                sources.left_out.push(format!("{kind} {name}: {why}"));
                continue;
            }
            let group = match short(&identifier(&output.kind), MAX_STEM / 4) {
                // The name of another prim of the stage.
                camera if camera == CAMERA => format!("{camera}_"),
                group => group,
            };
            let name = names.entry(group.clone()).or_default().unique(&short(&output.name, MAX_STEM));
            let stem = short(&format!("{group}-{name}"), MAX_STEM);
            let numbered =
                (1_u32..).map(|number| if number == 1 { stem.clone() } else { format!("{stem}-{number}") });
            // No layer has a name like that of a frame.
            let numbered = numbered.map(|stem| {
                let end = stem.rsplit_once('_').map_or("", |(_, end)| end);
                let is_like_frame = end.len() >= 4 && end.bytes().all(|c| c.is_ascii_digit());
                if form == Form::Layer && is_like_frame { format!("{stem}_") } else { stem }
            });
            // Some file systems take both cases of a letter for the same.
            let mut free = numbered.filter(|stem| stems.insert(stem.to_ascii_lowercase()));
            let stem = free.next().expect("there are more numbers than outputs");
            let frames = if form == Form::Sequence { output.present(shot) } else { Vec::new() };
            let missing = output.frames.count().saturating_sub(frames.len() as u64);
            if form == Form::Sequence && missing > 0 {
                sources.left_out.push(missing_remark(output, missing));
            }
            let source = Source { output: output.clone(), group, name, stem, frames };
            match form {
                Form::Sequence => sources.sequences.push(source),
                Form::Layer => sources.layers.push(source),
            }
        }
        sources
    }

    /// The sub-folders that the files are in.
    pub(super) fn folders(&self) -> impl Iterator<Item = String> {
        let all = self.sequences.iter().chain(&self.layers);
        all.map(|source| source.output.pattern.split('/').next().unwrap_or_default().to_owned())
    }
}

/// How an output can become a part of a stage; `None` if it cannot.
fn form(output: &OutputFiles) -> Option<Form> {
    match (output.format.as_str(), output.rest.is_some()) {
        ("ply", false) if output.is_per_frame() => Some(Form::Sequence),
        ("pc2", true) => Some(Form::Layer),
        ("json", true) if output.kind == "collider" => Some(Form::Layer),
        _ => None,
    }
}

/// How an output becomes a part of a stage: a sequence of meshes does not if a point cache shows the same.
fn form_of(output: &OutputFiles, all: &[&OutputFiles]) -> Option<Form> {
    let found = form(output)?;
    let is_cached = |other: &&&OutputFiles| shows_same(output, other) && form(other) == Some(Form::Layer);
    (found == Form::Layer || !all.iter().any(|other| is_cached(&other))).then_some(found)
}

/// Whether two outputs are formats of the same.
fn shows_same(a: &OutputFiles, b: &OutputFiles) -> bool {
    let folder = |output: &OutputFiles| output.pattern.split('/').next().map(str::to_owned);
    (&a.kind, &a.name, folder(a)) == (&b.kind, &b.name, folder(b))
}

/// What is reported of an output that is not in the stage.
fn remark(output: &OutputFiles) -> String {
    let next = match (output.kind.as_str(), output.format.as_str()) {
        ("volume", _) => "a program reads the volumes themselves",
        (_, "ply") => "expected a file for each frame, with {:04} in its pattern: make them again",
        _ => "write PLY files of it to have it there",
    };
    let [kind, name, format] = [&output.kind, &output.name, &output.format].map(|text| printable(text));
    format!("{kind} {name}: not in the stage, since its files are {format}; {next}")
}

/// What is reported of frames without a file.
fn missing_remark(output: &OutputFiles, missing: u64) -> String {
    let [kind, name, pattern] = [&output.kind, &output.name, &output.pattern].map(|text| printable(text));
    let count = output.frames.count();
    format!(
        "{kind} {name}: {missing} of {count} frames have no file {pattern}; make them again to have them in the stage"
    )
}

/// A name of a bounded length: a longer one ends in a hash of all of it.
fn short(name: &str, max: usize) -> String {
    if name.chars().count() <= max {
        return name.to_owned();
    }
    let start: String = name.chars().take(max.saturating_sub(9)).collect();
    format!("{start}_{:08x}", xxh3_64(name.as_bytes()) as u32)
}
