//! Meshes of particles: the surface of every stream of particles, reconstructed and written in every requested format.

use super::{
    SurfaceMesh,
    log::{DIGITS, MeshRecord},
    memory::{max_surface_memory, stream_memory},
    solids::Colliders,
    spacing::NeighbourDistances,
};
use crate::{
    export::MeshFormat,
    frame::{Stream, StreamKind},
    job::{
        Control, Failure, RunError, ShotFolder,
        batch::{
            FileTarget, FrameFiles, FrameOutcome, ProductFolder, StreamHeader, StreamInput, StreamWriter,
            Written,
        },
        nonzero,
        tradeoff::{figure, readable_volume},
    },
    mesh::{
        self, Mesh, MeshCheck, PlacedSolid, RadiusScales, Surface, SurfaceError, SurfaceParams,
        degenerate_in_world_frame, reconstruct_at_solids,
    },
    par,
    product::{colors::StreamColors, mesh_files::MeshFiles},
    solid::body_poses,
};
use xxhash_rust::xxh3::xxh3_64;

/// Writes the surfaces of streams of particles.
///
/// A frame whose files were made from the same particles with the same settings is kept, unless the request forces it: the
/// same state of a simulation, or the same bytes of a file. Files of a sequence keep their numbers; one without particles gives an
/// empty mesh, since a sequence may start before its liquid does.
pub(super) struct SurfaceWriter<'a> {
    files: MeshFiles<'a>,
    params: &'a SurfaceParams,
    colliders: &'a Colliders,
    colors: &'a StreamColors,
    /// The parameters and the colliders as text, for the key.
    text: String,
}

impl<'a> SurfaceWriter<'a> {
    /// A writer of meshes in these formats into `out`.
    pub(super) fn new(
        out: &'a ShotFolder,
        params: &'a SurfaceParams,
        formats: &'a [MeshFormat],
        colliders: &'a Colliders,
        colors: &'a StreamColors,
    ) -> Self {
        let files =
            MeshFiles { out, folder: SurfaceMesh.name(), formats, points: params.components.is_some() };
        let settings = serde_json::to_string(params).expect("settings are plain data");
        Self { files, params, colliders, colors, text: settings + &colliders.text }
    }
}

impl StreamWriter for SurfaceWriter<'_> {
    fn folder(&self) -> &dyn ProductFolder {
        &SurfaceMesh
    }

    fn accepts(&self, kind: StreamKind) -> bool {
        kind == StreamKind::Particles
    }

    fn key(&self, stream: &StreamHeader, spacing: f32) -> u64 {
        let (version, state) = (mesh::SURFACE_VERSION, stream.state);
        let colors = self.colors.text(&stream.name, self.params);
        xxh3_64(format!("{version} {state:016x} {spacing} {}{colors}", self.text).as_bytes())
    }

    fn up_to_date(&self, target: &FileTarget) -> Option<FrameFiles> {
        self.files.up_to_date(target)
    }

    fn max_memory(&self, particles: usize) -> u64 {
        max_surface_memory(particles, self.params)
    }

    fn memory(&self, stream: &Stream, spacing: f32, enough: u64) -> u64 {
        // Without its channel a stream has no colours, and its frame fails before any memory is taken.
        let colors = self.colors.for_surface(stream, self.params).unwrap_or_default();
        stream_memory(colors.with(stream), spacing, self.params, enough)
    }

    fn write(
        &self,
        input: StreamInput<'_>,
        target: &FileTarget,
        outcome: &mut FrameOutcome,
        control: Control,
    ) -> Result<(), RunError> {
        let mut solids = PlacedSolid::at(&self.colliders.solids, input.time);
        solids.extend(PlacedSolid::in_poses(&self.colliders.bodies, body_poses(input.streams)));
        let colors = match self.colors.for_surface(input.stream, self.params) {
            Ok(colors) => colors,
            Err(why) => {
                outcome.fail(why, Failure::Other);
                return Ok(());
            }
        };
        let particles = colors.with(input.stream);
        let made = reconstruct_at_solids(&particles, input.spacing, self.params, &solids, control.cancel);
        let surface = match made {
            Ok(surface) => surface,
            Err(SurfaceError::Interrupted) => return Err(RunError::Interrupted),
            Err(why) => {
                outcome.fail(why.to_string(), Failure::Other);
                return Ok(());
            }
        };
        // A surface that is moved has another volume by intention.
        let is_at_rest = self.params.offset.is_none();
        let volume = is_at_rest.then(|| particle_volume(input.stream, input.spacing, self.params));
        // A simulation knows its spacing, and particles of different sizes have different distances.
        let is_checked = target.state.is_none() && self.params.radius.is_none();
        let neighbours = is_checked.then(|| input.stream.vec3("position")).flatten();
        let neighbours = neighbours.and_then(|positions| NeighbourDistances::new(positions, input.spacing));
        let record = MeshRecord::new(&target.name, target.index, target.key, &surface, volume, neighbours);
        let record_figures = record.figures(&surface.stats);
        let figures = figures(&record, &surface, input.spacing);
        let Surface { mesh, points, distance, check, .. } = surface;
        drop(distance);
        report_faults(outcome, &mesh, &check, self.params.voxel * input.spacing);
        let written = Written { figures, record_figures, ..Written::of(target) };
        outcome.files.push(self.files.write(&mesh, points.as_ref(), target, written)?);
        Ok(())
    }
}

/// Distance of coordinates, over the voxel, from which triangles without area are put down to rounding. Smaller, and a
/// fault of the surfacer near the origin is taken for it; larger, and sound meshes of wide scenes count as failed: spray
/// 10 km wide at voxel 0.05 m, 0.024, has 89 such triangles in a thousand drops.
const MIN_ROUNDING_OVER_VOXEL: f32 = 1e-3;

/// Reports a mesh of cells of `voxel` [m] that is not closed, manifold and oriented; it is written all the same.
///
/// Far from the origin, vertices that differ round to the same single-precision numbers. That is reported, and is no fault
/// of the mesh.
pub(super) fn report_faults(outcome: &mut FrameOutcome, mesh: &Mesh, check: &MeshCheck, voxel: f32) {
    let reach = par::max(mesh.positions.len(), |vertex| mesh.positions[vertex].amax())
        .map_or(0.0, |(_, reach)| reach);
    let rounding = reach * f32::EPSILON;
    let degenerate = check.degenerate_triangles;
    if rounding > MIN_ROUNDING_OVER_VOXEL * voxel
        && (MeshCheck { degenerate_triangles: 0, ..*check }).is_sound()
    {
        if degenerate > 0 {
            outcome.notes.push(format!(
                "frame {}: {degenerate} triangles have no area: {reach:.0} m from the origin, coordinates are {rounding:.1e} m \
                 apart; move the particles nearer to it",
                outcome.index
            ));
        }
        return;
    }
    if let Some(fault) = check.first_fault {
        let at = std::array::from_fn::<f64, 3, _>(|axis| f64::from(fault.at[axis]) + mesh.origin[axis]);
        let why = format!(
            "the mesh is written, but it has {} at {:?} (vertex {}); expected a closed, manifold, oriented mesh: please \
             report this with the frame",
            fault.what, at, fault.vertex
        );
        outcome.fail(why, Failure::Other);
    }
}

/// Rounding of the particles, over the spacing, that is reported. If it is smaller, every wide scene is; if larger, surfaces
/// have steps that no report shows.
const MIN_PARTICLE_ROUNDING: f64 = 0.01;

/// What single precision loses of a mesh far from the origin of the world.
fn rounding_remark(mesh: &Mesh, spacing: f32) -> Option<String> {
    if mesh.origin == nalgebra::Vector3::zeros() {
        return None;
    }
    let reach = mesh.origin.amax();
    let rounding = reach * f64::from(f32::EPSILON) / f64::from(spacing);
    let flat = degenerate_in_world_frame(mesh);
    (flat > 0 || rounding >= MIN_PARTICLE_ROUNDING).then(|| {
        format!(
            "{} m from the origin: positions of particles are rounded to {} spacings, the mesh is in double precision, in single \
             precision (Blender) {flat} triangles would have no area",
            figure(reach, DIGITS),
            figure(rounding, 2),
        )
    })
}

/// Volume of the particles of a stream [m³]: as the system measured it, or else spacing³ each, or the cube of twice their radii.
fn particle_volume(stream: &Stream, spacing: f32, params: &SurfaceParams) -> f64 {
    let each = match RadiusScales::of(stream, spacing, params) {
        Ok(Some(radii)) => radii.mean_volume(),
        _ => 1.0,
    };
    let measured = stream.scalar("volume").filter(|_| params.radius.is_none());
    measured.unwrap_or(stream.len() as f64 * each * f64::from(spacing).powi(3))
}

/// One line about the surface of a frame.
fn figures(record: &MeshRecord, surface: &Surface, spacing: f32) -> String {
    let seconds: f64 = surface.stats.seconds.iter().map(|(_, seconds)| seconds).sum();
    let difference = record.volume_difference().map(|part| format!(" ({:+.1}% of particles)", 100.0 * part));
    let mut line = format!(
        "frame {}  {} triangles  volume {}{}  {} components  {seconds:.2} s",
        record.frame,
        surface.mesh.triangles.len(),
        readable_volume(record.volume, DIGITS),
        difference.unwrap_or_default(),
        record.components,
    );
    for remark in
        nonzero(&surface.stats.adjustments()).into_iter().chain(rounding_remark(&surface.mesh, spacing))
    {
        line += &format!("  {remark}");
    }
    line
}
