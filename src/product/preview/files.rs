//! The files of other products that previews show: meshes of the same state, and points.

use super::colours::{POINTS, colours_in};
use crate::{
    cache::{self, FrameInfo},
    frame::{COLOR, StreamKind},
    image::render::Balls,
    import::{self, Geometry, ParticleFile},
    job::{
        Manifest, OutputFiles, RunError, ShotFolder,
        batch::state_key,
        file_records::{FileRecords, FileState, hex},
    },
    mesh::{Mesh, normals_from_faces},
};
use std::collections::BTreeMap;

/// Kinds of outputs in manifests.
const MESH: &str = "mesh";
const POINTS_KIND: &str = "points";

/// The outputs of a shot that pictures show.
pub(super) struct ShownFiles<'a> {
    shot: &'a ShotFolder,
    outputs: Vec<OutputFiles>,
    /// By sub-folder.
    records: BTreeMap<String, FileRecords>,
}

/// A file of a frame that is as it was written.
pub(super) struct ShownFile {
    /// Path in the shot folder.
    file: String,
    is_mesh: bool,
    /// The stream or object that it shows.
    pub(super) name: String,
    /// Checksum of its bytes.
    pub(super) checksum: String,
    /// Length of the file [bytes].
    length: u64,
}

/// Memory of reading and showing a mesh [bytes/byte of its file]: the file, what is parsed, the mesh and its normals.
const MESH_BYTES: u64 = 6;

impl ShownFile {
    /// The memory that its mesh takes [bytes]; that of points is known when they are read.
    pub(super) fn memory(&self) -> u64 {
        if self.is_mesh { self.length.saturating_mul(MESH_BYTES) } else { 0 }
    }
}

impl<'a> ShownFiles<'a> {
    /// The files that the manifest of a shot lists.
    ///
    /// # Errors
    /// If a list of files cannot be read.
    pub(super) fn of(shot: &'a ShotFolder, manifest: Option<&Manifest>) -> Result<Self, RunError> {
        let is_shown = |output: &&OutputFiles| {
            output.format == "ply"
                && [MESH, POINTS_KIND].contains(&output.kind.as_str())
                && output.rest.is_none()
        };
        let outputs: Vec<OutputFiles> =
            manifest.iter().flat_map(|manifest| &manifest.outputs).filter(is_shown).cloned().collect();
        let mut records = BTreeMap::new();
        for output in &outputs {
            let folder = folder_of(output);
            if !records.contains_key(folder) {
                records.insert(folder.to_owned(), FileRecords::read(shot, folder)?);
            }
        }
        Ok(Self { shot, outputs, records })
    }

    /// The files that were made of the state of a cached frame, as far as they record it: meshes, and points of what the frame itself
    /// does not show.
    pub(super) fn of_frame(&self, info: &FrameInfo) -> Vec<ShownFile> {
        let index = info.index;
        let states = info.streams.iter().map(|stream| hex(state_key(info.key, index, &stream.name)));
        let states: Vec<String> = states.collect();
        // A file of tracers has the name of the system, with which that of its stream begins.
        let is_tracers = |name: &str| {
            info.streams.iter().any(|stream| {
                let rest = stream.name.strip_prefix(name);
                stream.kind == StreamKind::Tracers
                    && rest.is_some_and(|rest| rest.is_empty() || rest.starts_with('_'))
            })
        };
        let shown = |output: &OutputFiles| {
            if !output.frames.contains(index.0) {
                return None;
            }
            let file = output.file_name(index.0);
            let records = self.records.get(folder_of(output))?;
            let (record, recorded) = records.of(&file)?;
            let is_mesh = output.kind == MESH;
            let is_of_state = match &record.state {
                Some(state) if is_mesh => *state == hex(state_key(info.key, index, &output.name)),
                Some(state) => states.contains(state),
                None => !is_mesh,
            };
            // Tracers are fog, which their points would hide.
            let is_shown = is_of_state && (is_mesh || !is_tracers(&output.name));
            if !is_shown || records.state(self.shot, &file) != FileState::Valid {
                return None;
            }
            let (checksum, length) = (recorded.xxh3.clone(), recorded.bytes);
            Some(ShownFile { file, is_mesh, name: output.name.clone(), checksum, length })
        };
        self.outputs.iter().filter_map(shown).collect()
    }

    /// Reads the mesh that a file holds; `None` of points.
    ///
    /// # Errors
    /// If it cannot be read as one.
    pub(super) fn mesh(&self, file: &ShownFile) -> Result<Option<Mesh>, RunError> {
        if !file.is_mesh {
            return Ok(None);
        }
        let path = self.shot.root().join(&file.file);
        let bytes = cache::read_regular(&path).map_err(|source| RunError::File {
            path: path.clone(),
            source,
            next: "check that the file can be read, or make it again",
        })?;
        let Geometry { positions, triangles, mut attributes, .. } = import::parse_geometry(&path, &bytes)?;
        attributes.retain(|channel| channel.name == COLOR);
        let triangles = triangles.unwrap_or_default();
        let mut mesh = Mesh { positions, triangles, attributes, ..Mesh::default() };
        mesh.normals = normals_from_faces(&mesh);
        Ok(Some(mesh))
    }

    /// Reads the points that a file holds, as balls of their radii; `None` of a mesh.
    ///
    /// # Errors
    /// If it cannot be read as points, or takes more memory than allowed [bytes].
    pub(super) fn points(
        &self,
        file: &ShownFile,
        max_memory: Option<u64>,
    ) -> Result<Option<Balls>, RunError> {
        if file.is_mesh {
            return Ok(None);
        }
        let read = ParticleFile::open(&self.shot.root().join(&file.file), max_memory)?.particles()?;
        let positions = read.stream.vec3("position").unwrap_or_default().to_vec();
        let radii = read.stream.f32("radius").unwrap_or_default().to_vec();
        let other = POINTS[POINTS.len() - 1];
        let colour = |kind: &u32| POINTS.get(*kind as usize).copied().unwrap_or(other);
        let mut colours = colours_in(read.stream.channels());
        if colours.is_empty() {
            let kinds = read.stream.u32("kind");
            colours = kinds.map_or(vec![other], |kinds| kinds.iter().map(colour).collect());
        }
        Ok(Some(Balls { positions, radii, colours }))
    }
}

/// The sub-folder of the files of an output.
fn folder_of(output: &OutputFiles) -> &str {
    output.pattern.split('/').next().unwrap_or_default()
}
