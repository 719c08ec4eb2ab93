//! `shot.json`: what is in a shot folder, for Blender and other tools. Documented in `docs/formats/shot.md`.

use super::{RunError, ShotFolder, folder::is_file_name, report::Control};
use crate::{
    cache::{self, CacheError, FrameKeys, Lock},
    frame::FrameIndex,
    preset::{Branch, Camera, frame_keys},
};
use serde::{Deserialize, Serialize};
use std::{
    collections::{BTreeMap, BTreeSet},
    io::ErrorKind,
    path::PathBuf,
};

/// The largest number of poses in the file of a motion, in which a pose takes about 80 bytes: nearly three hours at 24 frames a second.
pub(crate) const MAX_POSES: u64 = 250_000;

/// The manifest of a shot folder.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Manifest {
    /// Always "meniscus-shot".
    pub format: String,
    /// Version of this format.
    pub version: u32,
    /// The shot's name.
    pub title: String,
    /// Frames a second.
    pub fps: f64,
    /// The requested frames.
    pub frames: FrameSpan,
    /// The axis that points up.
    pub up: String,
    /// The unit of lengths.
    pub length_unit: String,
    /// The ranges of frames that were requested of the simulation, exactly: `frames` covers gaps too.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub requested: Vec<FrameSpan>,
    /// Key of the simulation that the cached frames are of; 16 hexadecimal digits.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub simulation: Option<String>,
    /// Where the shot branched from others: frames before are of other simulations.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub branch: Vec<Branch>,
    /// The camera that the preset names.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera: Option<Camera>,
    /// What was made of the frames.
    pub outputs: Vec<OutputFiles>,
}

/// An arithmetic run of frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct FrameSpan {
    /// First frame.
    pub first: u32,
    /// Last frame.
    pub last: u32,
    /// Distance between frames; for irregular lists the largest that meets every frame.
    pub step: u32,
}

impl FrameSpan {
    /// The span that covers `frames`, which ascend; `None` if there are none.
    pub(crate) fn of(frames: &[u32]) -> Option<Self> {
        let (&first, &last) = (frames.first()?, frames.last()?);
        let step = frames.iter().map(|frame| frame - first).fold(0, gcd);
        Some(Self { first, last, step: step.max(1) })
    }

    /// The span that covers the frames of both.
    #[must_use]
    pub(crate) fn union(self, other: Self) -> Self {
        // A single frame has a step, but no distance that the others would have to keep.
        let distance = |span: Self| if span.first == span.last { 0 } else { span.step };
        let step = gcd(gcd(distance(self), distance(other)), self.first.abs_diff(other.first));
        Self { first: self.first.min(other.first), last: self.last.max(other.last), step: step.max(1) }
    }

    /// Whether `frame` is one of the span.
    pub(crate) fn contains(self, frame: u32) -> bool {
        (self.first..=self.last).contains(&frame) && (frame - self.first).is_multiple_of(self.step.max(1))
    }

    /// How many frames the span has.
    pub(crate) fn count(self) -> u64 {
        self.last.checked_sub(self.first).map_or(0, |length| u64::from(length / self.step.max(1)) + 1)
    }

    /// Every frame of the span, in ascending order.
    pub(crate) fn numbers(self) -> impl Iterator<Item = u32> {
        (self.first..=self.last).step_by(self.step.max(1) as usize)
    }
}

fn gcd(a: u32, b: u32) -> u32 {
    if b == 0 { a } else { gcd(b, a % b) }
}

/// A sequence of files.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct OutputFiles {
    /// The kind of the files, such as "mesh".
    pub kind: String,
    /// The system ("liquid") or one of its objects that the files show.
    pub name: String,
    /// The extension of the files, such as "ply".
    pub format: String,
    /// File name with the frame number as `{:04}`, relative to the folder; or the file of all frames.
    pub pattern: String,
    /// The mesh whose points a file of all frames moves.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rest: Option<String>,
    /// The point cache that deforms that mesh, in the axes that the file of all frames moves.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub point_cache: Option<String>,
    /// Which frames are there.
    pub frames: FrameSpan,
    /// Which file properties hold which attribute of a mesh.
    #[serde(default)]
    pub attributes: BTreeMap<String, Vec<String>>,
    /// The grids of a volume.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub grids: Vec<String>,
}

impl OutputFiles {
    /// The files `NAME_0001.FORMAT` of a kind in a folder of the shot folder, with the frame `index` alone.
    pub(crate) fn of(kind: &str, folder: &str, name: &str, format: &str, index: FrameIndex) -> Self {
        Self {
            kind: kind.into(),
            name: name.into(),
            format: format.into(),
            pattern: format!("{folder}/{name}_{NUMBER}.{format}"),
            rest: None,
            point_cache: None,
            frames: FrameSpan { first: index.0, last: index.0, step: 1 },
            attributes: BTreeMap::new(),
            grids: Vec::new(),
        }
    }

    /// Whether every frame has a file of its own; else a few files have all frames.
    pub(crate) fn is_per_frame(&self) -> bool {
        self.pattern.contains(NUMBER)
    }

    /// Whether the files are those of `other`, whatever the frames.
    pub(crate) fn is_same(&self, other: &Self) -> bool {
        self.name == other.name && self.format == other.format && self.pattern == other.pattern
    }

    /// Where the file of a frame is.
    pub(crate) fn file(&self, folder: &ShotFolder, frame: u32) -> PathBuf {
        folder.root().join(self.file_name(frame))
    }

    /// The file of a frame, relative to the folder.
    pub(crate) fn file_name(&self, frame: u32) -> String {
        self.pattern.replace(NUMBER, &format!("{frame:04}"))
    }

    /// The pattern, or the files of all frames.
    pub(crate) fn paths(&self) -> impl Iterator<Item = &str> {
        [Some(self.pattern.as_str()), self.rest.as_deref(), self.point_cache.as_deref()].into_iter().flatten()
    }

    /// The first of the paths that leads out of the shot folder's own sub-folders, if one does.
    fn foreign_path(&self) -> Option<&str> {
        self.paths().find(|path| !is_own_path(&path.replace(NUMBER, "")))
    }

    /// The frames whose files are there, in ascending order. The folder is listed once: a span may have a frame for each
    /// of 2³² numbers.
    pub(crate) fn present(&self, folder: &ShotFolder) -> Vec<u32> {
        let path = folder.root().join(&self.pattern);
        let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let (Some((before, after)), Some(parent)) = (name.split_once(NUMBER), path.parent()) else {
            return Vec::new();
        };
        let number = |name: &str| {
            let digits = name.strip_prefix(before)?.strip_suffix(after)?;
            let frame: u32 = digits.parse().ok()?;
            (format!("{frame:04}") == digits && self.frames.contains(frame)).then_some(frame)
        };
        let entries = std::fs::read_dir(parent).into_iter().flatten().flatten();
        let mut frames: Vec<u32> =
            entries.filter_map(|entry| number(&entry.file_name().to_string_lossy())).collect();
        frames.sort_unstable();
        frames
    }
}

/// Whether a path is `folder/name.format`, as those of products are, and so in the shot's folder.
pub(crate) fn is_own_path(path: &str) -> bool {
    let parts = path.split_once('/').and_then(|(folder, file)| Some((folder, file.rsplit_once('.')?)));
    parts.is_some_and(|(folder, (name, format))| [folder, name, format].into_iter().all(is_file_name))
}

impl Manifest {
    /// A manifest without outputs.
    pub(crate) fn new(title: &str, fps: f64, frames: FrameSpan) -> Self {
        Self {
            format: FORMAT.into(),
            version: VERSION,
            title: title.into(),
            fps,
            frames,
            up: "+Z".into(),
            length_unit: "m".into(),
            requested: Vec::new(),
            simulation: None,
            branch: Vec::new(),
            camera: None,
            outputs: Vec::new(),
        }
    }

    /// The manifest of a folder, if there is one.
    ///
    /// # Errors
    /// If it is there but cannot be read or is not one.
    pub(crate) fn read(folder: &ShotFolder) -> Result<Option<Self>, RunError> {
        let path = folder.manifest();
        match cache::read_text_within(&path, MAX_BYTES) {
            Ok(text) => Self::parse(path, &text).map(Some),
            Err(absent) if matches!(absent.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => {
                Ok(None)
            }
            Err(source) => Err(unreadable(path, source)),
        }
    }

    /// Reads the text of the manifest at `path`.
    ///
    /// # Errors
    /// As [`Manifest::read`].
    pub(crate) fn parse(path: PathBuf, text: &str) -> Result<Self, RunError> {
        let fail = |source| unreadable(path.clone(), source);
        // A later version may have other fields.
        let version = serde_json::from_str::<Versioned>(text).map_or(VERSION, |found| found.version);
        if version != VERSION {
            return Err(CacheError::Version { path, found: version, expected: VERSION }.into());
        }
        let manifest: Self = serde_json::from_str(text)
            .map_err(|why| fail(std::io::Error::new(ErrorKind::InvalidData, why)))?;
        let invalid = |found: String| Err(fail(std::io::Error::new(ErrorKind::InvalidData, found)));
        if manifest.format != FORMAT {
            return invalid(format!("found format {:?}, expected {FORMAT:?}", manifest.format));
        }
        if manifest.outputs.len() > MAX_OUTPUTS {
            let found = manifest.outputs.len();
            return invalid(format!("found {found} outputs, expected at most {MAX_OUTPUTS}"));
        }
        if let Some(foreign) = manifest.outputs.iter().find_map(OutputFiles::foreign_path) {
            return invalid(format!("found the path {foreign:?}, expected FOLDER/FILE in the shot's folder"));
        }
        let mut patterns = BTreeSet::new();
        if let Some(twice) = manifest.outputs.iter().find(|output| !patterns.insert(&output.pattern)) {
            return invalid(format!("found the output {:?} twice, expected each once", twice.pattern));
        }
        let branches = &manifest.branch;
        let ascend = branches.windows(2).all(|pair| pair[0].frame < pair[1].frame);
        if !ascend || frame_keys(0, branches).is_none() {
            return invalid(
                "found branches without keys or order, expected ascending frames, each with a key".to_owned(),
            );
        }
        Ok(manifest)
    }

    /// Replaces the folder's manifest, whole or not at all.
    ///
    /// # Errors
    /// If it cannot be written.
    pub(crate) fn write(&self, folder: &ShotFolder) -> Result<(), RunError> {
        let text = serde_json::to_string_pretty(self).expect("a manifest is plain data") + "\n";
        ShotFolder::write(folder.manifest(), &text)
    }

    /// Locks the folder's manifest and records until the lock is dropped: jobs that write different files share them. Waits
    /// for another process that holds the lock, as long as the user allows, and reports that.
    ///
    /// # Errors
    /// If the folder cannot be written, or the other process holds the lock for longer.
    pub(crate) fn lock(folder: &ShotFolder, control: Control) -> Result<Lock, RunError> {
        Ok(Lock::wait(folder.root(), &control)?)
    }

    /// Removes the temporaries that crashed jobs left in the root of a folder, whose files are written under the manifest's lock
    /// alone.
    ///
    /// # Errors
    /// As [`Manifest::lock`]; if the folder cannot be listed or a file not removed.
    pub(crate) fn clean_root(folder: &ShotFolder, control: Control) -> Result<(), RunError> {
        let lock = Self::lock(folder, control)?;
        if !lock.is_held() {
            return Ok(());
        }
        cache::remove_temporaries(folder.root()).map(|_| ()).map_err(|source| RunError::File {
            path: folder.root().into(),
            source,
            next: "check that the folder can be read and written",
        })
    }

    /// The keys of the cached frames of a folder; `None` if they are not known.
    ///
    /// # Errors
    /// As [`Manifest::read`].
    pub(crate) fn keys_in(folder: &ShotFolder) -> Result<Option<FrameKeys>, RunError> {
        Ok(Self::read(folder)?.as_ref().and_then(Self::frame_keys))
    }

    /// The keys of the cached frames, if they are known.
    pub(crate) fn frame_keys(&self) -> Option<FrameKeys> {
        frame_keys(self.simulation_key()?, &self.branch)
    }

    /// The key of the simulation that the cached frames are of, if it is known.
    pub(crate) fn simulation_key(&self) -> Option<u64> {
        u64::from_str_radix(self.simulation.as_ref()?, 16).ok()
    }

    /// Puts a manifest that cannot be read out of the way, and reports that. One of another version stays.
    ///
    /// # Errors
    /// [`CacheError::Version`] of another version; if the file cannot be renamed.
    pub(crate) fn set_aside_damaged(folder: &ShotFolder, control: Control) -> Result<(), RunError> {
        let why = match Self::read(folder) {
            Err(RunError::File { source, .. }) if source.kind() == ErrorKind::InvalidData => source,
            read => return read.map(|_| ()),
        };
        let path = folder.manifest();
        // An earlier one stays.
        let names = (1_u32..).map(|number| match number {
            1 => folder.root().join("shot.json.damaged"),
            _ => folder.root().join(format!("shot.json.damaged.{number}")),
        });
        let aside = names.into_iter().find(|name| !name.exists()).unwrap_or_else(|| path.clone());
        std::fs::rename(&path, &aside).map_err(|source| RunError::File {
            path: path.clone(),
            source,
            next: "check that the folder can be written",
        })?;
        control.reporter.note(&format!(
            "{}: {why}; the file is now {}. It named the meshes and volumes of the shot: run `meniscus mesh` and the like \
             again, which name the files that are valid without making them again",
            path.display(),
            aside.display()
        ));
        Ok(())
    }

    /// Adds an output of which the files of `frames` are new, in place of an earlier one of the same name and format.
    /// What that one named stays named as far as its files are in `folder`, so that meshing a few frames again does not
    /// hide the others; then attributes and grids are those that were named before and are named now.
    pub(crate) fn put(&mut self, mut output: OutputFiles, frames: &[u32], folder: &ShotFolder) {
        if let Some(place) = self.outputs.iter().position(|old| old.is_same(&output)) {
            let old = self.outputs.remove(place);
            let there = old.present(folder);
            if there.iter().any(|frame| frames.binary_search(frame).is_err()) {
                output.grids.retain(|grid| old.grids.contains(grid));
                if output.attributes.is_empty() {
                    // Frames without particles have no attributes; those of the others stay.
                    output.attributes = old.attributes;
                } else {
                    output.attributes.retain(|name, properties| old.attributes.get(name) == Some(properties));
                }
            }
            if let Some(there) = FrameSpan::of(&there) {
                output.frames = output.frames.union(there);
            }
        }
        self.outputs.push(output);
    }
}

const FORMAT: &str = "meniscus-shot";

const VERSION: u32 = 1;

/// The largest manifest [bytes].
const MAX_BYTES: u64 = 4 << 20;

/// The largest number of outputs, each of which may name files of a million frames.
const MAX_OUTPUTS: usize = 1000;

fn unreadable(path: PathBuf, source: std::io::Error) -> RunError {
    let next = "restore the file, or remove it and run `meniscus shot` or `meniscus mesh` again";
    RunError::File { path, source, next }
}

/// What every version of the manifest has.
#[derive(Deserialize)]
struct Versioned {
    version: u32,
}

/// What stands for the number of a frame in a pattern.
const NUMBER: &str = "{:04}";

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{control::CancelToken, job::Silent};

    #[test]
    fn spans_keep_the_step_of_regular_lists_and_the_common_one_of_others() {
        let span = |frames: &[u32]| {
            let span = FrameSpan::of(frames).unwrap();
            (span.first, span.last, span.step)
        };
        assert_eq!(span(&(1..=96).collect::<Vec<_>>()), (1, 96, 1));
        assert_eq!(span(&[1, 3, 5, 7, 9]), (1, 9, 2));
        assert_eq!(span(&[4]), (4, 4, 1));
        assert_eq!(span(&[2, 8, 14, 16]), (2, 16, 2));
    }

    #[test]
    fn a_union_meets_every_frame_of_both() {
        let lists: [&[u32]; 6] = [&[1, 2, 3], &[4], &[9], &[1, 3, 5], &[2, 8, 14], &[0, 100]];
        for a in lists {
            for b in lists {
                let mut both = [a, b].concat();
                both.sort_unstable();
                both.dedup();
                let union = FrameSpan::of(a).unwrap().union(FrameSpan::of(b).unwrap());
                assert_eq!(union, FrameSpan::of(&both).unwrap(), "{a:?} {b:?}");
            }
        }
    }

    #[test]
    fn spans_of_all_numbers_are_counted_and_listed_at_once() {
        let all = FrameSpan { first: 0, last: u32::MAX, step: 1 };
        assert_eq!(all.count(), 1 << 32);
        assert_eq!(FrameSpan { first: 2, last: 9, step: 3 }.count(), 3);
        assert_eq!(FrameSpan { first: 9, last: 2, step: 0 }.count(), 0, "of a broken file");
        let dir = tempfile::tempdir().unwrap();
        let folder = ShotFolder::new(dir.path());
        let output = OutputFiles {
            kind: "mesh".into(),
            name: "liquid".into(),
            format: "ply".into(),
            pattern: "mesh/liquid_{:04}.ply".into(),
            rest: None,
            point_cache: None,
            frames: all,
            attributes: Default::default(),
            grids: Vec::new(),
        };
        assert_eq!(output.present(&folder), [0; 0], "no folder");
        std::fs::create_dir(folder.subfolder("mesh")).unwrap();
        for frame in [7, 0, u32::MAX, 12345] {
            std::fs::write(output.file(&folder, frame), "").unwrap();
        }
        for other in ["liquid_7.ply", "liquid_00007.ply", "liquid_x.ply", "liquid_0008.obj", "foam_0008.ply"]
        {
            std::fs::write(folder.subfolder("mesh").join(other), "").unwrap();
        }
        assert_eq!(output.present(&folder), [0, 7, 12345, u32::MAX]);
        let mut manifest = Manifest::new("Odd", 24.0, all);
        manifest.put(output.clone(), &[0, 7, 12345, u32::MAX], &folder);
        let frames = FrameSpan { first: 5, last: 9, step: 2 };
        assert_eq!(OutputFiles { frames, ..output.clone() }.present(&folder), [7]);
        manifest.put(OutputFiles { frames, ..output }, &[5, 7, 9], &folder);
        assert_eq!(manifest.outputs[0].frames, all);
    }

    #[test]
    fn a_manifest_survives_writing_and_replaces_outputs_of_the_same_name() {
        let dir = tempfile::tempdir().unwrap();
        let folder = ShotFolder::new(dir.path());
        assert_eq!(Manifest::read(&folder).unwrap(), None);
        let mut manifest = Manifest::new("Dam", 24.0, FrameSpan { first: 1, last: 5, step: 1 });
        let output = OutputFiles {
            kind: "mesh".into(),
            name: "liquid".into(),
            format: "ply".into(),
            pattern: "mesh/liquid_{:04}.ply".into(),
            rest: None,
            point_cache: None,
            frames: FrameSpan { first: 1, last: 5, step: 1 },
            attributes: Default::default(),
            grids: Vec::new(),
        };
        manifest.put(output.clone(), &[1, 2, 3, 4, 5], &folder);
        let few = OutputFiles { frames: FrameSpan { first: 1, last: 3, step: 1 }, ..output.clone() };
        manifest.put(few.clone(), &[1, 2, 3], &folder);
        let pattern = output.pattern.replace("ply", "obj");
        manifest.put(OutputFiles { format: "obj".into(), pattern, ..output }, &[1, 2, 3, 4, 5], &folder);
        assert_eq!(manifest.outputs.len(), 2);
        assert_eq!(manifest.outputs[0].frames.last, 3, "files that are not there are not named");
        std::fs::create_dir(folder.subfolder("mesh")).unwrap();
        for frame in [1, 3] {
            std::fs::write(few.file(&folder, frame), "").unwrap();
        }
        manifest.put(OutputFiles { frames: FrameSpan { first: 5, last: 5, step: 1 }, ..few }, &[5], &folder);
        assert_eq!(manifest.outputs[1].frames, FrameSpan { first: 1, last: 5, step: 2 });
        manifest.write(&folder).unwrap();
        assert_eq!(Manifest::read(&folder).unwrap(), Some(manifest));
        let text = std::fs::read_to_string(folder.manifest()).unwrap();
        let changed = |from: &str, to: &str| {
            assert!(text.contains(from));
            std::fs::write(folder.manifest(), text.replace(from, to)).unwrap();
            Manifest::read(&folder).unwrap_err().to_string()
        };
        assert!(changed("meniscus-shot", "other").contains("found format \"other\""));
        for path in [
            "../../evil_{:04}.ply",
            "/etc/{:04}.ply",
            "mesh/a/b.ply",
            "mesh/..",
            "C:\\\\x/y.ply",
            "liquid.ply",
        ] {
            assert!(changed("mesh/liquid_{:04}.ply", path).contains("expected FOLDER/FILE"), "{path}");
        }
        assert!(changed("liquid_{:04}.obj", "liquid_{:04}.ply").contains("twice"));
        assert!(changed("\"version\": 1", "\"version\": 2").contains("format version 2, expected 1"));
        assert!(
            Manifest::set_aside_damaged(&folder, Control::new(&Silent, &CancelToken::new())).is_err(),
            "a later version's stays"
        );
        changed("\"title\"", "\"tilte\"");
        Manifest::set_aside_damaged(&folder, Control::new(&Silent, &CancelToken::new())).unwrap();
        assert_eq!(Manifest::read(&folder).unwrap(), None);
        assert!(folder.root().join("shot.json.damaged").exists());
    }
}
