//! From the density of particles to a mesh with normals: marching cubes, and the clean-up that the parameters request.
//!
//! *Method*: see [`super::reconstruct`].

use super::{
    Contour, Mesh, PlacedSolid, Points, SurfaceError, SurfaceParams, SurfaceStats,
    cavities::{ClosedCavities, close},
    check::KnownParts,
    contact::fit_to_solids,
    decimate,
    half_edges::HalfEdges,
    marching_cubes,
    marching_cubes::Extraction,
    normals::{Directions, some_from_field, unit},
    normals_from_faces, normals_from_field, remove_small,
    smooth::{Depths, Smoothed, smooth_by_depth},
};
use crate::{control::CancelToken, field::Density, frame::Columns, math::Vec3, par, sdf::SignedDistance};
use std::time::Instant;

/// What a surface is made of.
#[derive(Clone, Copy)]
pub(super) struct Input<'a> {
    /// The particles, near the origin.
    pub(super) particles: &'a Columns<'a>,
    /// The solids that the surface is fitted to.
    pub(super) solids: &'a [PlacedSolid<'a>],
    pub(super) params: &'a SurfaceParams,
    /// Spacing of the particles [m].
    pub(super) spacing: f32,
}

/// A mesh with normals.
pub(super) struct CleanedMesh {
    pub(super) mesh: Mesh,
    pub(super) points: Option<Points>,
    /// What earlier passes found.
    pub(super) known: KnownParts,
}

/// The contour whose isosurface is extracted, at `offset` [m] of the distance.
fn contour_of<'a>(field: &'a Density, distance: Option<&'a SignedDistance>, offset: f32) -> Contour<'a> {
    let at_offset = |distance: &'a SignedDistance| Contour { level: offset, ..Contour::from(&distance.grid) };
    distance.map_or_else(|| Contour::from(field), at_offset)
}

/// The surface of marching cubes, without clean-up.
pub(super) fn without_cleanup(
    mut field: Density,
    distance: Option<&SignedDistance>,
    input: Input,
    clock: &mut Clock,
    stats: &mut SurfaceStats,
) -> Result<CleanedMesh, SurfaceError> {
    let Input { params, spacing, .. } = input;
    if distance.is_some() {
        field.grid.values = Vec::new();
    }
    let contour = contour_of(&field, distance, params.offset.unwrap_or(0.0) * spacing);
    let (extraction, (positions, contour_stats)) = clock.time("marching cubes", || {
        let extraction = Extraction::new(&contour);
        let vertices = extraction.vertices(&contour);
        (extraction, vertices)
    })?;
    stats.contour = contour_stats;
    let mut directions = clock.time("normals", || Directions::of(&positions, &contour))?;

    // The density takes most of the memory, and triangles do not need it.
    field.grid.values = Vec::new();
    let bricks = distance.map_or(&field.grid.bricks, |distance| &distance.grid.bricks);
    let triangles = clock.time("marching cubes", || extraction.triangles(bricks))?;
    let mut mesh = Mesh { positions, triangles, ..Mesh::default() };
    let mut known = KnownParts::default();
    if let Some(ClosedCavities { kept, components, .. }) =
        closed_cavities(&mut mesh, params, spacing, clock, stats)?
    {
        known.components = Some(components);
        if !kept.is_empty() {
            directions.retain(&kept);
        }
    }
    (mesh.normals, stats.normals_from_faces) =
        clock.time("normals", || directions.check_against_faces(&mesh))?;
    Ok(CleanedMesh { mesh, points: None, known })
}

/// Closes the small cavities of a mesh without normals; `None` if it is open or none are to be closed.
fn closed_cavities(
    mesh: &mut Mesh,
    params: &SurfaceParams,
    spacing: f32,
    clock: &mut Clock,
    stats: &mut SurfaceStats,
) -> Result<Option<ClosedCavities>, SurfaceError> {
    if stats.contour.cut_cells > 0 || params.smallest_cavity == 0.0 {
        return Ok(None);
    }
    let smallest = f64::from(params.smallest_cavity) * f64::from(spacing).powi(3);
    let closed = clock.time("cavities", || close(mesh, smallest))?;
    stats.cavities = closed.stats;
    Ok(Some(closed))
}

/// The surface, with the clean-up of the parameters.
pub(super) fn with_cleanup(
    field: Density,
    distance: Option<&SignedDistance>,
    input: Input,
    clock: &mut Clock,
    stats: &mut SurfaceStats,
) -> Result<CleanedMesh, SurfaceError> {
    let Input { particles, solids, params, spacing } = input;
    let offset = params.offset.unwrap_or(0.0) * spacing;
    let contour = contour_of(&field, distance, offset);
    let mut mesh;
    (mesh, stats.contour) = clock.time("marching cubes", || marching_cubes(contour))?;
    closed_cavities(&mut mesh, params, spacing, clock, stats)?;
    let mut points = None;
    if let Some(components) = &params.components {
        let (removed, found) = clock.time("components", || remove_small(&mut mesh, components, spacing))?;
        (points, stats.components) = (Some(removed), Some(found));
    }
    let (mut half_edges, mut smoothed) = (None, None);
    if let Some(smoothing) = &params.smoothing {
        let mask = match &smoothing.mask {
            Some(mask) => {
                let radius = params.kernel_radius * spacing;
                Some(clock.time("mask", || mask.weights(particles, &mesh.positions, radius))??)
            }
            None => None,
        };
        smoothed = Some(clock.time("smoothing", || {
            let half_edges = half_edges.insert(HalfEdges::new(&mesh, |_| true));
            let depths = Depths { field: &field, offset };
            smooth_by_depth(&mut mesh, half_edges, depths, mask.as_deref(), smoothing, spacing)
        })?);
    }
    stats.smoothing = smoothed.as_ref().map(|smoothed| smoothed.stats);
    let mut fitted = None;
    if let Some(contact) = params.contact.as_ref().filter(|_| !solids.is_empty()) {
        let mut found = clock.time("contact", || {
            let half_edges = half_edges.get_or_insert_with(|| HalfEdges::new(&mesh, |_| true));
            let normals = match &mut smoothed {
                Some(smoothed) => std::mem::take(&mut smoothed.normals),
                None => half_edges.normals(&mesh),
            };
            fit_to_solids(&mut mesh, half_edges, normals, solids, contact, spacing)
        })?;
        stats.contact = Some(found.stats);
        if let Some(smoothed) = &mut smoothed {
            smoothed.normals = std::mem::take(&mut found.normals);
            smoothed.unmoved.retain(|v| found.around.binary_search(v).is_err());
        } else {
            fitted = Some(found);
        }
    }
    // Vertices that are not where the field's isosurface was.
    let mut is_moved = false;
    if let Some(decimation) = &params.decimation {
        is_moved = fitted.take().is_some_and(|fitted| !fitted.around.is_empty());
        (half_edges, smoothed) = (None, None);
        stats.decimation = Some(clock.time("decimation", || decimate(&mut mesh, decimation, spacing))?);
    }
    (mesh.normals, stats.normals_from_faces) = clock.time("normals", || match smoothed {
        Some(Smoothed { normals, unmoved, .. }) => (smoothed_normals(&mesh, contour, normals, &unmoved), 0),
        None if params.smoothing.is_some() || is_moved => (normals_from_faces(&mesh), 0),
        None => normals_from_field(&mesh, contour),
    })?;
    if let Some(fitted) = fitted {
        for &v in &fitted.around {
            mesh.normals[v as usize] = unit(&fitted.normals[v as usize]);
        }
    }
    Ok(CleanedMesh { mesh, points, known: KnownParts { half_edges, components: None } })
}

/// The normals of a smoothed mesh: those of its `faces`, and those of the field where vertices did not move.
fn smoothed_normals(mesh: &Mesh, contour: Contour, mut faces: Vec<Vec3>, unmoved: &[u32]) -> Vec<Vec3> {
    let of_field = some_from_field(mesh, contour, &faces, unmoved);
    par::update(&mut faces, |_, normal| *normal = unit(normal));
    for (&v, normal) in unmoved.iter().zip(of_field) {
        faces[v as usize] = normal;
    }
    faces
}

/// Runs passes and measures their times, until interrupted. A pass may have several parts.
pub(super) struct Clock<'a> {
    pub(super) cancel: &'a CancelToken,
    pub(super) seconds: Vec<(&'static str, f64)>,
}

impl Clock<'_> {
    pub(super) fn time<T>(&mut self, pass: &'static str, run: impl FnOnce() -> T) -> Result<T, SurfaceError> {
        let start = Instant::now();
        let result = run();
        let seconds = start.elapsed().as_secs_f64();
        match self.seconds.iter_mut().find(|(name, _)| *name == pass) {
            Some((_, sum)) => *sum += seconds,
            None => self.seconds.push((pass, seconds)),
        }
        if self.cancel.is_cancelled() { Err(SurfaceError::Interrupted) } else { Ok(result) }
    }
}
