//! `shot.json`: what is in a shot folder, for Blender and other tools. Documented in `docs/formats/shot.md`.

use super::{RunError, ShotFolder};
use crate::{cache::write_atomically, export::MeshFormat};
use serde::{Deserialize, Serialize};
use std::io::ErrorKind;

/// The manifest of a shot folder.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// Always "meniscus-shot".
    pub format: String,
    /// Version of this format.
    pub version: u32,
    /// The shot's name.
    pub title: String,
    /// Frames a second.
    pub fps: f64,
    /// The frames that were asked for.
    pub frames: FrameSpan,
    /// The axis that points up.
    pub up: String,
    /// The unit of lengths.
    pub length_unit: String,
    /// What was made of the frames.
    pub outputs: Vec<MeshOutput>,
}

/// An arithmetic run of frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FrameSpan {
    /// First frame.
    pub first: u32,
    /// Last frame.
    pub last: u32,
    /// Distance between frames; for irregular lists the largest that meets every frame.
    pub step: u32,
}

impl FrameSpan {
    /// The span that covers `frames`, which ascend; `None` if there are none.
    pub fn of(frames: &[u32]) -> Option<Self> {
        let (&first, &last) = (frames.first()?, frames.last()?);
        let step = frames.iter().map(|frame| frame - first).fold(0, gcd);
        Some(Self { first, last, step: step.max(1) })
    }
}

fn gcd(a: u32, b: u32) -> u32 {
    if b == 0 { a } else { gcd(b, a % b) }
}

/// A mesh sequence.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MeshOutput {
    /// Always "mesh".
    pub kind: String,
    /// The system it shows ("liquid").
    pub name: String,
    /// "ply" or "obj".
    pub format: MeshFormat,
    /// File name with the frame number as `{:04}`, relative to the folder.
    pub pattern: String,
    /// Which frames are there.
    pub frames: FrameSpan,
    /// Which file properties hold which attribute.
    pub attributes: std::collections::BTreeMap<String, Vec<String>>,
}

impl Manifest {
    /// A manifest without outputs.
    pub fn new(title: &str, fps: f64, frames: FrameSpan) -> Self {
        Self {
            format: FORMAT.into(),
            version: 1,
            title: title.into(),
            fps,
            frames,
            up: "+Z".into(),
            length_unit: "m".into(),
            outputs: Vec::new(),
        }
    }

    /// The manifest of a folder, if there is one.
    ///
    /// # Errors
    /// If it is there but cannot be read or is not one.
    pub fn read(folder: &ShotFolder) -> Result<Option<Self>, RunError> {
        let path = folder.manifest();
        let fail = |source| RunError::File {
            path: folder.manifest(),
            source,
            next: "restore the file, or remove it and run `meniscus shot` or `meniscus mesh` again",
        };
        let text = match std::fs::read_to_string(path) {
            Ok(text) => text,
            Err(absent) if absent.kind() == ErrorKind::NotFound => return Ok(None),
            Err(source) => return Err(fail(source)),
        };
        let manifest: Self = serde_json::from_str(&text)
            .map_err(|why| fail(std::io::Error::new(ErrorKind::InvalidData, why)))?;
        if manifest.format != FORMAT || manifest.version != 1 {
            let found = format!(
                "found format {:?} version {}, expected {FORMAT:?} version 1",
                manifest.format, manifest.version
            );
            return Err(fail(std::io::Error::new(ErrorKind::InvalidData, found)));
        }
        Ok(Some(manifest))
    }

    /// Replaces the folder's manifest, whole or not at all.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn write(&self, folder: &ShotFolder) -> Result<(), RunError> {
        let text = serde_json::to_string_pretty(self).expect("a manifest is plain data") + "\n";
        let path = folder.manifest();
        write_atomically(&path, |out| out.write_all(text.as_bytes())).map_err(|source| RunError::File {
            path,
            source,
            next: "check that the folder can be written and the disk has room",
        })?;
        Ok(())
    }

    /// Adds an output, in place of an earlier one of the same name and format.
    pub fn put(&mut self, output: MeshOutput) {
        self.outputs.retain(|old| old.name != output.name || old.format != output.format);
        self.outputs.push(output);
    }
}

const FORMAT: &str = "meniscus-shot";

#[cfg(test)]
mod tests {
    use super::*;

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
    fn a_manifest_survives_writing_and_replaces_outputs_of_the_same_name() {
        let dir = tempfile::tempdir().unwrap();
        let folder = ShotFolder::new(dir.path());
        assert_eq!(Manifest::read(&folder).unwrap(), None);
        let mut manifest = Manifest::new("Dam", 24.0, FrameSpan { first: 1, last: 5, step: 1 });
        let output = MeshOutput {
            kind: "mesh".into(),
            name: "liquid".into(),
            format: MeshFormat::Ply,
            pattern: "mesh/liquid_{:04}.ply".into(),
            frames: FrameSpan { first: 1, last: 5, step: 1 },
            attributes: Default::default(),
        };
        manifest.put(output.clone());
        manifest.put(MeshOutput { frames: FrameSpan { first: 1, last: 3, step: 1 }, ..output.clone() });
        manifest.put(MeshOutput { format: MeshFormat::Obj, ..output });
        assert_eq!(manifest.outputs.len(), 2);
        assert_eq!(manifest.outputs[0].frames.last, 3);
        manifest.write(&folder).unwrap();
        assert_eq!(Manifest::read(&folder).unwrap(), Some(manifest));
        std::fs::write(folder.manifest(), "{\"format\": \"other\"}").unwrap();
        assert!(Manifest::read(&folder).is_err());
    }
}
