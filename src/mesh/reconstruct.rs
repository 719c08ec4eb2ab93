//! From particles to a surface.
//!
//! *Method*: the density of the particles on sparse bricks ([`crate::field`]), if named the signed distance to its level
//! set ([`crate::sdf`]), marching cubes of either, what the parameters name of removal of small pieces, smoothing and
//! decimation, normals by the field's gradient, and what the vertices take from the particles.
//!
//! Where smoothing moved it, a surface has the normals of its own faces: those of the field show the bumps that it no longer
//! has.
//!
//! Normals by the density's gradient: on a ball of 20 spacings they lean 12.0° on average (particles
//! moved by up to a quarter spacing: 16.1°), the distance's 9.9° (13.9°), and on 30 frames of a splash 101 of
//! 630 000 vertices found no usable gradient instead of 68.
//! *Departs from the paper*: see the modules named.
//! Limits: those of the passes; what is thinner than a voxel may vanish.

use super::{
    ComponentStats, Contour, ContourStats, DecimationStats, Mesh, MeshCheck, Points, SmoothingStats,
    SurfaceParams,
    check::check_linked,
    decimate,
    links::Links,
    marching_cubes,
    marching_cubes::Cut,
    normals::{Directions, some_from_field, unit},
    normals_from_faces, normals_from_field, remove_small,
    smooth::{Smoothed, depth_weights, smooth_linked},
    transfer,
};
use crate::{
    field::{Density, DensityParams, density},
    frame::Stream,
    math::Vec3,
    par,
    sdf::{SdfParams, SignedDistance, from_density},
};
use std::time::Instant;

/// The surface of one stream of particles.
#[derive(Clone, Debug)]
pub struct Surface {
    /// Triangles, normals and the attributes asked for; if nothing was asked, `velocity` [m/s] if the particles have it.
    pub mesh: Mesh,
    /// The pieces that were too small to stay, if small pieces were to go.
    pub points: Option<Points>,
    /// The signed distance that the mesh was cut from, before any clean-up; none if it was cut from the density.
    pub distance: Option<SignedDistance>,
    /// Whether the mesh is sound, and its volume and area.
    pub check: MeshCheck,
    /// What it took.
    pub stats: SurfaceStats,
}

/// What a reconstruction took, and every place where it departed from the rule.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct SurfaceStats {
    /// Particles given.
    pub particles: usize,
    /// Particles too far from the origin for the grid: left out.
    pub too_far_particles: usize,
    /// Particles that fall between the nodes of a coarse grid and do not show.
    pub unseen_particles: usize,
    /// Bricks of the density and of the signed distance.
    pub bricks: [usize; 2],
    /// Nodes of the signed distance that the band did not reach.
    pub unreached_nodes: usize,
    /// Nodes on the surface, moved off it by a millionth of a voxel.
    pub nodes_on_surface: usize,
    /// Vertices of the mesh.
    pub vertices: usize,
    /// Triangles of the mesh.
    pub triangles: usize,
    /// What marching cubes had to do beside extracting.
    pub contour: ContourStats,
    /// What the removal of small pieces did.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub components: Option<ComponentStats>,
    /// What smoothing did.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub smoothing: Option<SmoothingStats>,
    /// What decimation did.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub decimation: Option<DecimationStats>,
    /// Vertices whose normal is that of the faces, because the field has no usable gradient there; none are counted
    /// on a smoothed surface.
    pub normals_from_faces: usize,
    /// Vertices and points whose attributes are those of the nearest particle, because none is within the kernel.
    pub attributes_from_nearest: usize,
    /// Seconds a pass, in the order first run: marching cubes and normals may take turns.
    pub seconds: Vec<(&'static str, f64)>,
}

/// Why there is no surface.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SurfaceError {
    /// The caller asked to stop.
    #[error("interrupted while the surface was made")]
    Interrupted,
    /// The stream holds no vectors named `position`.
    #[error("the particles have no channel of vectors named `position`; expected one to make a surface of")]
    NoPositions,
    /// A position is infinite or not a number.
    #[error(
        "the position of particle {particle} is not finite; simulate the frame again or check its source"
    )]
    NotFinite {
        /// Its place in the stream.
        particle: usize,
    },
    /// The particles lack a channel that the vertices should carry.
    #[error(
        "the particles have no channel `{name}` for the vertices; they have {there}: change surface.attributes"
    )]
    NoChannel {
        /// The name asked for.
        name: String,
        /// The names that are there.
        there: String,
    },
}

/// The surface of `particles` (channel `position` [m], maybe `velocity` [m/s]) that stand `spacing` [m] apart at
/// rest. `keep_going` is asked after every pass and ends the work by returning false.
///
/// The result depends on the particles and parameters alone, not on threads.
///
/// # Errors
/// If asked to stop, or if positions are missing or not finite.
///
/// # Panics
/// If `spacing` or a parameter is out of its range.
pub fn reconstruct(
    particles: &Stream,
    spacing: f32,
    params: &SurfaceParams,
    keep_going: &(dyn Fn() -> bool + Sync),
) -> Result<Surface, SurfaceError> {
    let positions = positions(particles)?;
    let mut clock = Clock { keep_going, seconds: Vec::new() };

    let field = clock.time("density", || {
        let SurfaceParams { voxel, kernel_radius, anisotropy, .. } = *params;
        density(positions, &DensityParams { spacing, kernel_radius, voxel, anisotropy, whole: false })
    })?;
    let distance =
        match params.distance {
            Some(distance) => Some(clock.time("distance", || {
                from_density(&field.grid, field.threshold, &SdfParams::from(distance))
            })?),
            None => None,
        };
    let mut stats = SurfaceStats {
        particles: positions.len(),
        too_far_particles: field.too_far,
        unseen_particles: field.unseen,
        bricks: [field.grid.bricks.len(), distance.as_ref().map_or(0, |distance| distance.grid.bricks.len())],
        unreached_nodes: distance.as_ref().map_or(0, |distance| distance.unreached),
        nodes_on_surface: distance.as_ref().map_or(0, |distance| distance.on_surface),
        ..SurfaceStats::default()
    };
    let Made { mut mesh, mut points, links } = if params.is_as_cut() {
        as_cut(field, distance.as_ref(), &mut clock, &mut stats)?
    } else {
        cleaned(field, distance.as_ref(), params, spacing, &mut clock, &mut stats)?
    };
    (stats.vertices, stats.triangles) = (mesh.positions.len(), mesh.triangles.len());
    stats.attributes_from_nearest =
        clock.time("attributes", || carry(particles, params, spacing, &mut mesh, points.as_mut()))??;
    let check = clock.time("check", || check_linked(&mesh, links))?;
    stats.seconds = clock.seconds;
    Ok(Surface { mesh, points, distance, check, stats })
}

/// A mesh with normals.
struct Made {
    mesh: Mesh,
    points: Option<Points>,
    /// Its half-edges, if somebody needed them.
    links: Option<Links>,
}

/// What the surface is the contour of.
fn contour_of<'a>(field: &'a Density, distance: Option<&'a SignedDistance>) -> Contour<'a> {
    distance.map_or_else(|| Contour::from(field), |distance| Contour::from(&distance.grid))
}

/// The surface as it is cut.
fn as_cut(
    mut field: Density,
    distance: Option<&SignedDistance>,
    clock: &mut Clock,
    stats: &mut SurfaceStats,
) -> Result<Made, SurfaceError> {
    if distance.is_some() {
        field.grid.values = Vec::new();
    }
    let contour = contour_of(&field, distance);
    let (cut, (positions, contour_stats)) = clock.time("marching cubes", || {
        let cut = Cut::new(&contour);
        let vertices = cut.vertices(&contour);
        (cut, vertices)
    })?;
    stats.contour = contour_stats;
    let directions = clock.time("normals", || Directions::of(&positions, &contour))?;

    // The density is most of the memory, and triangles do not need it.
    field.grid.values = Vec::new();
    let bricks = distance.map_or(&field.grid.bricks, |distance| &distance.grid.bricks);
    let triangles = clock.time("marching cubes", || cut.triangles(bricks))?;
    let mut mesh = Mesh { positions, triangles, ..Mesh::default() };
    (mesh.normals, stats.normals_from_faces) = clock.time("normals", || directions.settle(&mesh))?;
    Ok(Made { mesh, points: None, links: None })
}

/// The surface, cleaned up as far as the parameters say.
fn cleaned(
    field: Density,
    distance: Option<&SignedDistance>,
    params: &SurfaceParams,
    spacing: f32,
    clock: &mut Clock,
    stats: &mut SurfaceStats,
) -> Result<Made, SurfaceError> {
    let contour = contour_of(&field, distance);
    let mut mesh;
    (mesh, stats.contour) = clock.time("marching cubes", || marching_cubes(contour))?;
    let mut points = None;
    if let Some(components) = &params.components {
        let (removed, found) = clock.time("components", || remove_small(&mut mesh, components, spacing))?;
        (points, stats.components) = (Some(removed), Some(found));
    }
    let (mut links, mut smoothed) = (None, None);
    if let Some(smoothing) = &params.smoothing {
        smoothed = Some(clock.time("smoothing", || {
            let links = links.insert(Links::new(&mesh, |_| true));
            let weights = depth_weights(&mesh, links, &field, smoothing.thin, spacing);
            smooth_linked(&mut mesh, links, &weights, smoothing, spacing)
        })?);
    }
    stats.smoothing = smoothed.as_ref().map(|smoothed| smoothed.stats);
    if let Some(decimation) = &params.decimation {
        (links, smoothed) = (None, None);
        stats.decimation = Some(clock.time("decimation", || decimate(&mut mesh, decimation, spacing))?);
    }
    (mesh.normals, stats.normals_from_faces) = clock.time("normals", || match smoothed {
        Some(Smoothed { normals, still, .. }) => (smoothed_normals(&mesh, contour, normals, &still), 0),
        None if params.smoothing.is_some() => (normals_from_faces(&mesh), 0),
        None => normals_from_field(&mesh, contour),
    })?;
    Ok(Made { mesh, points, links })
}

/// The positions of the particles, all finite.
///
/// # Errors
/// [`SurfaceError::NoPositions`] or [`SurfaceError::NotFinite`].
pub fn positions(particles: &Stream) -> Result<&[Vec3], SurfaceError> {
    let positions = particles.vec3("position").ok_or(SurfaceError::NoPositions)?;
    match positions.iter().position(|x| !x.iter().all(|x| x.is_finite())) {
        Some(particle) => Err(SurfaceError::NotFinite { particle }),
        None => Ok(positions),
    }
}

/// The normals of a smoothed mesh: those of its `faces`, and those of the field where vertices stood `still`.
fn smoothed_normals(mesh: &Mesh, contour: Contour, mut faces: Vec<Vec3>, still: &[u32]) -> Vec<Vec3> {
    let of_field = some_from_field(mesh, contour, &faces, still);
    par::update(&mut faces, |_, normal| *normal = unit(normal));
    for (&v, normal) in still.iter().zip(of_field) {
        faces[v as usize] = normal;
    }
    faces
}

/// Gives vertices and points what they take from the particles; returns how many took it from the nearest.
fn carry(
    particles: &Stream,
    params: &SurfaceParams,
    spacing: f32,
    mesh: &mut Mesh,
    points: Option<&mut Points>,
) -> Result<usize, SurfaceError> {
    let of = |places: &[Vec3]| {
        transfer(particles, params.attributes.as_deref(), places, params.kernel_radius * spacing)
            .map_err(|name| no_channel(name, particles))
    };
    let (attributes, mut from_nearest) = of(&mesh.positions)?;
    mesh.attributes = attributes;
    if let Some(points) = points {
        let (attributes, more_from_nearest) = of(&points.positions)?;
        points.attributes = attributes;
        from_nearest += more_from_nearest;
    }
    Ok(from_nearest)
}

/// Says which channels there are instead.
fn no_channel(name: String, particles: &Stream) -> SurfaceError {
    let there: Vec<&str> = particles.channels().iter().map(|channel| channel.name.as_str()).collect();
    SurfaceError::NoChannel { name, there: there.join(", ") }
}

/// Runs passes one after the other, with their times, until told to stop. A pass may come in parts.
struct Clock<'a> {
    keep_going: &'a (dyn Fn() -> bool + Sync),
    seconds: Vec<(&'static str, f64)>,
}

impl Clock<'_> {
    fn time<T>(&mut self, pass: &'static str, run: impl FnOnce() -> T) -> Result<T, SurfaceError> {
        let start = Instant::now();
        let result = run();
        let seconds = start.elapsed().as_secs_f64();
        match self.seconds.iter_mut().find(|(name, _)| *name == pass) {
            Some((_, sum)) => *sum += seconds,
            None => self.seconds.push((pass, seconds)),
        }
        if (self.keep_going)() { Ok(result) } else { Err(SurfaceError::Interrupted) }
    }
}
