//! The job that turns particles into meshes.

use super::{
    Control, Failure, MeshRecord, OutputFiles, RunError, ShotFolder, Source,
    job::{self, Job, Make, Part, Target},
    ledger::{Done, Made, Piece, Work},
    plan::Product,
    remarks,
};
use crate::{
    export::{self, MeshFormat},
    frame::FrameIndex,
    mesh::{self, Mesh, MeshCheck, Points, Surface, SurfaceError, SurfaceParams},
    par,
    sim::{sheet, smoke},
};
use xxhash_rust::xxh3::xxh3_64;

/// What is made of every frame.
#[derive(Clone, Debug)]
pub struct SurfaceSettings {
    /// How particles become a surface.
    pub params: SurfaceParams,
    /// The files to write.
    pub formats: Vec<MeshFormat>,
}

/// Meshes the frames of `source` into `out`, several at once where memory allows.
///
/// A frame whose files were made from the same particles with the same settings is kept, unless the job forces it: the
/// same state of a simulation, or the same bytes of a file. Frames that are missing between the first and the last are
/// told. Files of a sequence keep their numbers; one without particles gives an empty mesh, since a sequence may start
/// before its liquid does.
///
/// # Errors
/// Frames that cannot be read or meshed, need more memory than the job allows, or are not there, are left out and named
/// together at the end ([`RunError::SomeFailed`]). What is wrong with a file that is all there is, also that it has no
/// particles, is the job's error; a folder or disk that refuses to be written ends the job at once.
pub fn surface(
    source: Source,
    out: &ShotFolder,
    settings: &SurfaceSettings,
    job: &Job,
    control: Control,
) -> Result<Done, RunError> {
    let SurfaceSettings { params, formats } = settings;
    let files = MeshFiles { out, folder: "mesh", formats, points: params.components.is_some() };
    let text = serde_json::to_string(params).expect("settings are plain data");
    job::run(source, out, &Meshes { files, params, text }, job, control)
}

/// Makes meshes.
struct Meshes<'a> {
    files: MeshFiles<'a>,
    params: &'a SurfaceParams,
    /// The parameters as text.
    text: String,
}

impl Make for Meshes<'_> {
    const PRODUCT: Product = Product::Meshes;

    fn params(&self) -> &SurfaceParams {
        self.params
    }

    fn takes(&self, stream: &str) -> bool {
        ![smoke::NAME, smoke::TRACERS].contains(&stream) && !sheet::is_sheet_stream(stream)
    }

    fn nothing(&self) -> String {
        "no liquid in this cache, and only liquids have a surface to mesh: `meniscus volume` makes volumes of smoke, `meniscus \
         export` points"
            .into()
    }

    fn key(&self, _: &str, state: u64, spacing: f32) -> u64 {
        let version = mesh::SURFACE_VERSION;
        xxh3_64(format!("{version} {state:016x} {spacing} {}", self.text).as_bytes())
    }

    fn kept(&self, target: &Target) -> Option<Piece> {
        self.files.kept(target)
    }

    fn make(
        &self,
        Part { stream, .. }: Part<'_>,
        spacing: f32,
        target: &Target,
        made: &mut Made,
        control: Control,
    ) -> Result<(), RunError> {
        let keep_going = || !(control.interrupted)();
        let surface = match mesh::reconstruct(stream, spacing, self.params, &keep_going) {
            Ok(surface) => surface,
            Err(SurfaceError::Interrupted) => return Err(RunError::Interrupted),
            Err(why) => {
                made.fail(why.to_string(), Failure::Other);
                return Ok(());
            }
        };
        let record = MeshRecord::of(&target.name, target.index, target.key, &surface);
        let figures = figures(target.index, &surface);
        let Surface { mesh, points, distance, check, stats, .. } = surface;
        drop(distance);
        complain(made, &mesh, &check, self.params.voxel * spacing);
        let work = Work::on(&mesh, figures, Some((record, stats)));
        made.pieces.push(self.files.write(&mesh, points.as_ref(), target, work)?);
        Ok(())
    }
}

/// The files that a mesh is written to.
pub(super) struct MeshFiles<'a> {
    pub(super) out: &'a ShotFolder,
    /// Its folder for them.
    pub(super) folder: &'static str,
    pub(super) formats: &'a [MeshFormat],
    /// Whether there is one of small pieces as well.
    pub(super) points: bool,
}

/// What the name of the file of small pieces has behind the mesh's.
const POINTS: &str = "_points";

impl MeshFiles<'_> {
    /// The outputs that a frame's files belong to, with that frame alone: those that are written, or all others.
    fn outputs(&self, Target { index, name, .. }: &Target, written: bool) -> Vec<(MeshFormat, OutputFiles)> {
        let formats = MeshFormat::ALL.into_iter().filter(|format| self.formats.contains(format) == written);
        let mesh = formats.map(|format| (format, "mesh", name.clone()));
        let points = (self.points == written).then(|| (MeshFormat::Ply, "points", format!("{name}{POINTS}")));
        let of = |(format, kind, name): (MeshFormat, &str, String)| {
            (format, OutputFiles::of(kind, self.folder, &name, format.extension(), *index))
        };
        mesh.chain(points).map(of).collect()
    }

    /// The files of a target, if all are there and have its key.
    pub(super) fn kept(&self, target: &Target) -> Option<Piece> {
        let outputs = self.outputs(target, true);
        let is_there = |(format, output): &(MeshFormat, OutputFiles)| {
            format.key_in(&output.file(self.out, target.index.0)) == Some(target.key)
        };
        let all = outputs.iter().all(is_there);
        let known = |(format, mut output): (MeshFormat, OutputFiles)| {
            output.attributes = format.attributes_in(&output.file(self.out, target.index.0));
            output
        };
        all.then(|| Piece {
            outputs: outputs.into_iter().map(known).collect(),
            work: None,
            stale: self.stale(target),
        })
    }

    /// The outputs that are not written of a target, and whose file of its frame shows something else.
    fn stale(&self, target: &Target) -> Vec<OutputFiles> {
        let mut stale = self.outputs(target, false);
        stale.retain(|(format, output)| {
            let path = output.file(self.out, target.index.0);
            // A target without a key is like no other.
            path.exists() && (target.key == 0 || format.key_in(&path) != Some(target.key))
        });
        stale.into_iter().map(|(_, output)| output).collect()
    }

    /// Writes the files of a target, of which `work` is known so far.
    ///
    /// # Errors
    /// What a folder or disk refuses.
    pub(super) fn write(
        &self,
        mesh: &Mesh,
        points: Option<&Points>,
        target: &Target,
        mut work: Work,
    ) -> Result<Piece, RunError> {
        let mut outputs = Vec::new();
        for (format, mut output) in self.outputs(target, true) {
            let path = output.file(self.out, target.index.0);
            work.bytes += match points.filter(|_| output.kind == "points") {
                Some(points) => export::ply::write_points(points, &path, target.key)?,
                None => format.write(mesh, &path, target.key)?,
            };
            output.attributes = format.attributes_in(&path);
            outputs.push(output);
        }
        Ok(Piece { outputs, work: Some(work), stale: self.stale(target) })
    }
}

/// Distance of coordinates, over the voxel, from which triangles without area are put down to rounding. Smaller, and a
/// fault of the surfacer near the origin is taken for it; larger, and sound meshes of wide scenes count as failed: spray
/// 10 km wide at voxel 0.05 m, 0.024, has 89 such triangles in a thousand drops.
const COARSE: f32 = 1e-3;

/// Remembers a mesh of cells of `voxel` [m] that is not what it should be; it is written all the same.
///
/// Far from the origin, vertices that differ round to the same single-precision numbers. That is told, and is no fault of
/// the mesh.
pub(super) fn complain(made: &mut Made, mesh: &Mesh, check: &MeshCheck, voxel: f32) {
    let reach = par::max(mesh.positions.len(), |vertex| mesh.positions[vertex].amax())
        .map_or(0.0, |(_, reach)| reach);
    let apart = reach * f32::EPSILON;
    let degenerate = check.degenerate_triangles;
    if apart > COARSE * voxel && (MeshCheck { degenerate_triangles: 0, ..*check }).is_sound() {
        if degenerate > 0 {
            made.notes.push(format!(
                "frame {}: {degenerate} triangles have no area: {reach:.0} m from the origin, coordinates are {apart:.1e} m \
                 apart; move the particles nearer to it",
                made.index
            ));
        }
        return;
    }
    if let Some(fault) = check.first_fault {
        let why = format!(
            "the mesh is written, but it has {} at {:?} (vertex {}); expected a closed, manifold, oriented mesh: please \
             report this with the frame",
            fault.what, fault.at, fault.vertex
        );
        made.fail(why, Failure::Other);
    }
}

fn figures(index: FrameIndex, surface: &Surface) -> String {
    let seconds: f64 = surface.stats.seconds.iter().map(|(_, seconds)| seconds).sum();
    let mut line = format!(
        "frame {index}  {} triangles  volume {:.4} m³  {} pieces  {seconds:.2} s",
        surface.mesh.triangles.len(),
        surface.check.volume,
        surface.check.components,
    );
    for remark in remarks::of_surface(&surface.stats) {
        line += &format!("  {remark}");
    }
    line
}
